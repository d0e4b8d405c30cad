"""What the numbers of a scenario measure; numbers from elsewhere, such as an option, that go with it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np
from pydantic import BaseModel

from simulator import units
from simulator.scenario.document import Scenario
from simulator.scenario.errors import Problem, ScenarioError
from simulator.scenario.fields import ByName, Chosen, Measured
from simulator.scenario.keys import all_keys
from simulator.scenario.mapping import all_values, number_and_unit
from simulator.scenario.reading import has_units
from simulator.scenario.recordings import Recording, RecordingByName
from simulator.scenario.steps import Cycle, Table
from simulator.units import Dimension


def measured(scenario: Scenario) -> dict[str, Dimension]:
    """What the numbers of a scenario measure, by dotted key, defaults too.

    A number that never has a unit, such as a stretch or a count, is left out. So is `[scales]`, which says
    what the units of the others are.
    """
    return {key: dimension for key, dimension in _measured(scenario, "") if not key.startswith("scales.")}


def _measured(table: BaseModel, prefix: str) -> Iterator[tuple[str, Dimension]]:
    fields = {field.alias or name: (name, field) for name, field in type(table).model_fields.items()}
    for title, (name, field) in fields.items():
        value = getattr(table, name)
        yield from _below(value, f"{prefix}{title}", _declared([*field.metadata, *_marks(field.annotation)]))
    for name, value in (table.__pydantic_extra__ or {}).items():
        yield from _below(value, f"{prefix}{name}", None)


def _declared(marks: Sequence[Any]) -> Dimension | None:
    """What a field measures, as its marks say."""
    functions = [mark.function for mark in marks if isinstance(mark, Chosen)]
    by_name = [function.dimension for function in functions if isinstance(function, ByName)]
    return next((mark.dimension for mark in marks if isinstance(mark, Measured)), (*by_name, None)[0])


def _marks(annotation: Any) -> Iterator[Any]:
    """The marks on the members of a union."""
    for member in get_args(annotation):
        yield from getattr(member, "__metadata__", ())
        yield from _marks(member)


def _below(value: Any, key: str, dimension: Dimension | None) -> Iterator[tuple[str, Dimension]]:
    """A value, or what is in a table or several tables."""
    if isinstance(value, BaseModel):
        yield from _measured(value, f"{key}.")
    elif isinstance(value, tuple):
        for number, item in enumerate(value, start=1):
            yield from _below(item, f"{key}.{getattr(item, 'name', number)}", dimension)
    elif isinstance(value, dict):
        for name, item in value.items():
            yield from _below(item, f"{key}.{name}", dimension)
    elif isinstance(value, float) and dimension is not None:
        yield key, dimension


def dimension_of(scenario: Scenario, key: str) -> Dimension | None:
    """What a number of a scenario measures; None where it never has a unit.

    Parameters
    ----------
    scenario : Scenario
    key : str
        Dotted, and one that the scenario has: `balloon.<name>.…` as in error messages, `balloon.*.…` for all
        balloons, `balloon.<n>.…` by number.
    """
    parts = key.split(".")
    if parts[0] == "balloon" and len(parts) > 1:
        place = int(parts[1]) - 1 if parts[1].isdecimal() else 0
        names = [balloon.name for balloon in scenario.balloons]
        parts[1] = parts[1] if parts[1] in names else names[place]
    return measured(scenario).get(".".join(parts))


def unit_of(scenario: Scenario, key: str) -> str:
    """The unit that a number of a scenario with [scales] is written in, or what it is a multiple of.

    "" for a number that never has one. `key` as for `dimension_of`.
    """
    written = number_and_unit(all_keys(scenario).get(key))
    if written is not None and written[1].strip():
        return written[1].strip()
    dimension = dimension_of(scenario, key)
    return dimension.symbol if dimension else ""


@dataclass(frozen=True)
class Bare:
    """A number that was written without a unit although the scenario has [scales].

    Attributes
    ----------
    key : str
    value : float
        As written; of a table the largest voltage, by its amount.
    dimension : Dimension
    """

    key: str
    value: float
    dimension: Dimension


def bare_numbers(scenario: Scenario) -> tuple[Bare, ...]:
    """The numbers of a scenario with [scales] that were written without a unit, and measure something.

    They are multiples of the scales. Not those for which that makes no difference: zeros, and times, which
    are seconds either way. A table counts where its header names no unit; a recording whose `units` say "1"
    does not, since that was meant.
    """
    if scenario.scales is None:
        return ()
    dimensions = measured(scenario)
    found = []
    for key, value in all_values(scenario.to_dict()).items():
        dimension = dimensions.get(key)
        if dimension is None or dimension is units.TIME or isinstance(value, str | bool) or value == 0.0:
            continue
        found.append(Bare(key, float(value), dimension))
    return (*found, *_bare_tables(scenario.steps, "step"))


def _bare_tables(steps: Sequence[Any], prefix: str) -> Iterator[Bare]:
    for number, step in enumerate(steps, start=1):
        key = f"{prefix}.{number}"
        if isinstance(step, Cycle):
            yield from _bare_tables(step.steps, f"{key}.steps")
        elif isinstance(step, Table) and isinstance(step.table, RecordingByName):
            for name, recording in step.table.balloons.items():
                yield from _bare_voltages(recording, f"{key}.table.{name}", recording.bare)
        elif isinstance(step, Table) and isinstance(step.table, Recording):
            yield from _bare_voltages(step, f"{key}.table", step.table.bare)
        elif isinstance(step, Table) and isinstance(step.table, str):
            yield from _bare_voltages(step, f"{key}.table", not has_units(step.table))


def _bare_voltages(table: Table | Recording, key: str, bare: bool) -> Iterator[Bare]:
    largest = float(np.abs(table.voltages).max()) if bare else 0.0
    if largest > 0.0:
        yield Bare(key, largest, units.VOLTAGE)


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
