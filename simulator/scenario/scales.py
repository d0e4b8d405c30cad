"""The [scales] of a scenario: the reference balloon in units, so that everything else may have units too."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any, Self

from pydantic import AfterValidator, Field, ValidationError, ValidationInfo, model_validator
from pydantic_core import PydanticCustomError

from simulator import units
from simulator.scenario.errors import Problem, ScenarioError
from simulator.scenario.fields import (
    Chosen,
    Frozen,
    Measured,
    Modulus,
    Permittivity,
    Radius,
    Thickness,
    refused,
)
from simulator.units import SI, Dimension, Scales, Written

if TYPE_CHECKING:
    from simulator.scenario.document import Scenario


def _with_unit(number: float) -> float:
    if not isinstance(number, Written):
        raise PydanticCustomError("no_unit", "no_unit")
    return number


class Reference(Frozen):
    """The reference balloon; lengths and moduli in SI units, the permittivity over that of the vacuum."""

    shear_modulus: Annotated[
        Modulus, AfterValidator(_with_unit), Field(description='a modulus > 0 such as "45 kPa"')
    ]
    thickness: Annotated[
        Thickness, AfterValidator(_with_unit), Field(description='a length > 0 such as "0.5 mm"')
    ]
    radius: Annotated[Radius, AfterValidator(_with_unit), Field(description='a length > 0 such as "20 mm"')]
    permittivity: Annotated[
        Permittivity, Field(description='a relative permittivity > 0 such as 4.7, or one such as "41.6 pF/m"')
    ]

    @property
    def scales(self) -> Scales:
        """The scales that follow from it."""
        return Scales(
            float(self.shear_modulus), float(self.thickness), float(self.radius), float(self.permittivity)
        )

    @model_validator(mode="after")
    def _representable(self) -> Self:
        try:
            representable = all(math.isfinite(size) and size > 0.0 for size in self.scales.record().values())
        except ArithmeticError:
            representable = False
        if not representable:
            raise refused("must be a balloon whose scales are finite numbers", None)
        return self


def reference(value: Any, _: ValidationInfo) -> Reference:
    """The [scales] of a file. Raises ValidationError."""
    return Reference.model_validate(value, context={"scales": SI})


def scales_of(value: Any) -> Scales:
    """The scales to read a scenario with; SI where [scales] is wrong, which is then a problem of its own."""
    try:
        return Reference.model_validate(value, context={"scales": SI}).scales
    except ValidationError:
        return SI


Scaled = Annotated[Reference, Chosen(reference)]


def dimension_of(scenario: Scenario, key: str) -> Dimension | None:
    """What a number of a scenario measures, by its dotted key; None where it never has a unit.

    `balloon.<name>.…` as in error messages, `balloon.*.…` for all balloons.
    """
    here: Any = scenario
    *places, last = key.split(".")
    for place in places:
        if not isinstance(here, tuple):
            names = {field.alias or name: name for name, field in type(here).model_fields.items()}
            here = getattr(here, names[place])
        elif place.isdecimal():
            here = here[int(place) - 1]
        else:
            here = next(balloon for balloon in here if place in ("*", balloon.name))
    field = type(here).model_fields[last]
    return next((mark.dimension for mark in field.metadata if isinstance(mark, Measured)), None)


def dimensionless(
    scenario: Scenario, key: str, value: float | str, dimension: Dimension | None, least: float = -math.inf
) -> float:
    """A number that goes with a scenario: dimensionless, from a number or a text, which may have a unit.

    Parameters
    ----------
    scenario : Scenario
    key : str
        What the number is called in messages.
    value : float or str
    dimension : Dimension or None
        What it measures.
    least : float
        The least that is allowed, dimensionless.

    Raises
    ------
    ScenarioError
        If it is none.
    """
    scales, reason = scenario.scales, ""
    bound = "" if math.isinf(least) else f" >= {least:g}"
    measured = isinstance(value, str) and dimension is not None and units.has_unit(value)
    try:
        if isinstance(value, str) and dimension is not None and scales is not None and measured:
            found = units.read(value, dimension, scales)
        else:
            found = float(value)
        if math.isfinite(found) and found >= least:
            return found
    except ValueError as error:
        reason = str(error) if measured and scales else ""
    allowed = f"a number{bound}"
    if scales is not None and dimension is not None:
        quantity = f'{dimension.name}{bound} such as "{dimension.example}"'
        allowed = quantity if measured else f"{allowed}, or {quantity}"
    elif measured:
        reason = "a unit needs [scales]"
    problem = Problem(key, value, f"must be {allowed}{reason and '; '}{reason}")
    raise ScenarioError(scenario.file, problem)
