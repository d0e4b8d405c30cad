"""The [scales] of a scenario: the reference balloon in units, so that everything else may have units too."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from pydantic import AfterValidator, Field, ValidationError, ValidationInfo
from pydantic_core import PydanticCustomError

from simulator.scenario.fields import (
    Chosen,
    Frozen,
    Modulus,
    Permittivity,
    Radius,
    Thickness,
)
from simulator.units import SI, Scales, Written

if TYPE_CHECKING:
    pass


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
