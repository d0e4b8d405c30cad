"""What the numbers of a scenario measure; numbers from elsewhere, such as an option, that go with it."""

from __future__ import annotations

import math
from typing import Any

from simulator import units
from simulator.scenario.document import Scenario
from simulator.scenario.errors import Problem, ScenarioError
from simulator.scenario.fields import Measured
from simulator.units import Dimension


def dimension_of(scenario: Scenario, key: str) -> Dimension | None:
    """What a number of a scenario measures; None where it never has a unit.

    Parameters
    ----------
    scenario : Scenario
    key : str
        Dotted, and one that the scenario has: `balloon.<name>.…` as in error messages, `balloon.*.…` for all
        balloons.
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
