"""The fit file, read and checked by `read_fit`.

The grammar is that of `docs/fit.md`. All problems that can be found without playing the scenario are reported
at once, each with file, key, value and what is allowed, in one `ScenarioError`.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationError, ValidationInfo

from simulator.identification.measurements import read_measured
from simulator.identification.problem import (
    Column,
    FitProblem,
    FreeNumber,
    Measured,
    MeasuredCurve,
    Search,
)
from simulator.scenario import Problem, Scenario, ScenarioError, load_scenario
from simulator.scenario.fields import Chosen, Float, Frozen, Int, Text, problems_of, refused
from simulator.scenario.keys import all_keys
from simulator.scenario.mapping import near, number_and_unit
from simulator.scenario.reading import check_kind, read_toml
from simulator.scenario.recordings import DecimalSign, LinesBefore, Separator
from simulator.units import DIMENSIONS, read_si

_TRIED = 21  # values between the bounds, where a start is refused


def _quantity(value: Any, _: ValidationInfo) -> tuple[float, str]:
    found = number_and_unit(value)
    if found is None or not math.isfinite(found[0]):
        raise refused('must be a number, or a text such as "40 kPa"', value)
    return found[0], found[1].strip()


Quantity = Annotated[
    tuple[float, str], Chosen(_quantity), Field(description='a number, or a text such as "40 kPa"')
]


def _numbers(value: Any, info: ValidationInfo) -> Any:
    if isinstance(value, Mapping):
        return {str(name): _quantity(item, info) for name, item in value.items()}
    return _quantity(value, info)


Sigmas = Annotated[
    tuple[float, str] | dict[str, tuple[float, str]],
    Chosen(_numbers),
    Field(description="a number, or a table of numbers by column"),
]

_COLUMNS = 'a table such as { pressure = "p" }: the column of the results = the column of the file'
Names = Annotated[dict[str, Text], Field(min_length=1, description=_COLUMNS)]


class DataTable(Frozen):
    """Measured curves of a file, or one measured event."""

    file: Annotated[Text | None, Field(description="the path of a CSV file")] = None
    x: Annotated[Names | None, Field(max_length=1, description=f"one column, {_COLUMNS}")] = None
    y: Annotated[Names | None, Field(description=_COLUMNS)] = None
    units: Annotated[
        dict[str, Text], Field(description='a table of units by column such as { p = "kPa" }')
    ] = Field(default_factory=dict)
    sigma: Annotated[dict[str, Quantity], Field(description="a table of numbers by column")] = Field(
        default_factory=dict
    )
    step: Annotated[Int | None, Field(ge=1, description="a whole number >= 1")] = None
    separator: Separator = ","
    decimal: DecimalSign = "."
    skip: LinesBefore = 0
    offset: Annotated[Quantity, Field(description="a time")] = (0.0, "")
    event: Annotated[
        dict[str, Any] | None,
        Field(description='a table such as { kind = "limit_point", number = 1, voltage_<name> = "4.4 kV" }'),
    ] = None


class FreeTable(Frozen):
    """One number that is sought."""

    start: Annotated[Quantity | None, Field(description='a number, or a text such as "40 kPa"')] = None
    low: Annotated[Quantity | None, Field(description='a number, or a text such as "40 kPa"')] = None
    high: Annotated[Quantity | None, Field(description='a number, or a text such as "40 kPa"')] = None


class SearchTable(Frozen):
    """How the numbers are sought."""

    loss: Annotated[
        Literal["linear", "soft_l1", "huber", "cauchy", "arctan"],
        Field(description='"linear", "soft_l1", "huber", "cauchy" or "arctan"'),
    ] = "linear"
    starts: Annotated[Int, Field(ge=1, le=10_000, description="a whole number from 1 to 10000")] = 1
    seed: Annotated[Int, Field(ge=0, description="a whole number >= 0")] = 0
    confidence: Annotated[Float, Field(gt=0, lt=1, description="a number between 0 and 1")] = 0.95
    profile: Annotated[bool, Field(strict=True, description="true or false")] = False


class FitFile(Frozen):
    """The fit file as written."""

    title: Annotated[Text | None, Field(description="a non-empty text")] = None
    scenario: Annotated[str, Field(strict=True, min_length=1, description="the path of a scenario file")]
    data: Annotated[tuple[DataTable, ...], Field(min_length=1, description="one or more [[data]] tables")]
    free: Annotated[
        dict[str, FreeTable], Field(min_length=1, description="a table with one or more keys of the scenario")
    ]
    fit: Annotated[SearchTable, Field(description="a table of loss, starts, seed, confidence, profile")] = (
        SearchTable()
    )


FitLike = FitProblem | str | os.PathLike[str] | Mapping[str, Any]
"""A fit, or what `read_fit` makes one of."""


def read_fit(source: FitLike) -> FitProblem:
    """Read and check a fit, with its scenario and its data.

    Parameters
    ----------
    source : path, mapping or FitProblem
        A TOML file, or its content as a mapping. The paths of the scenario and of the data are relative to
        the folder of the file, for a mapping to the current directory; in a mapping, the scenario may be a
        `Scenario`, or the mapping of one. A fit is returned as it is.

    Returns
    -------
    FitProblem

    Raises
    ------
    ScenarioError
        With every problem found: file, key, value and what is allowed.

    Examples
    --------
    >>> problem = read_fit("scenarios/fits/vhb_inflation.toml")
    >>> [one.key for one in problem.free]
    ['scales.shear_modulus', 'balloon.active.elastomer.J_lim']
    """
    if isinstance(source, FitProblem):
        return source
    given: Any = None
    if isinstance(source, Mapping):
        file, folder, data = "<dict>", "", dict(source)
        if not isinstance(data.get("scenario"), str) and data.get("scenario") is not None:
            given, data["scenario"] = data["scenario"], "<dict>"
        check_kind(file, data, "a fit")
    else:
        file, folder = os.fspath(source), os.path.dirname(os.fspath(source))
        data = read_toml(file, "a fit")
    try:
        read = FitFile.model_validate(data)
    except ValidationError as error:
        raise ScenarioError(file, *problems_of(error, _place)) from None
    scenario = load_scenario(os.path.join(folder, read.scenario) if given is None else given)
    problems: list[Problem] = []
    measured: list[Measured] = []
    for number, table in enumerate(read.data, start=1):
        try:
            measured.append(read_measured(table, scenario, folder, file))
        except ScenarioError as error:
            problems += [p._replace(key=f"data.{number}.{p.key}".rstrip(".")) for p in error.problems]
    free: list[FreeNumber] = []
    for key, bounds in read.free.items():
        found = _free_number(key, bounds, scenario)
        if isinstance(found, Problem):
            problems.append(found)
        else:
            free.append(found)
    search = Search(**read.fit.model_dump())
    problems += [] if problems else [*_together(measured, free, search)]
    if problems:
        raise ScenarioError(file, *problems)
    return FitProblem(file, read.title or scenario.title, scenario, tuple(measured), tuple(free), search)


def _place(loc: tuple[int | str, ...]) -> str:
    """A place in the fit file: keys with dots stand in quotes, tables are counted from 1."""
    parts = [str(part + 1) if isinstance(part, int) else part for part in loc]
    return ".".join(f'"{part}"' if "." in part else part for part in parts)


def _free_number(key: str, table: FreeTable, scenario: Scenario) -> FreeNumber | Problem:
    """One free number with its bounds in one unit; or what is wrong with it."""
    name = f'free."{key}"' if "." in key else f"free.{key}"
    known = all_keys(scenario)
    start = table.start or number_and_unit(known.get(key))
    if start is None:
        there = key in known
        allowed = "must hold a number" if there else f"no such key in the scenario, {near(key, known)}"
        return Problem(name, None, allowed)
    unit = start[1].strip()
    values = {"start": start[0]}
    for word, bound in (("low", table.low), ("high", table.high)):
        if bound is not None:
            factor = _in_unit(bound[1], unit)
            if factor is None:
                said = unit or "none"
                return Problem(f"{name}.{word}", _said(bound), f"must be in the unit of start, {said}")
            values[word] = bound[0] * factor
    found = FreeNumber(key, unit, **values)
    if found.low >= found.high:
        return Problem(
            f"{name}.high", _said(table.high), f"must be larger than low, {found.written(found.low)}"
        )
    if not found.low <= found.start <= found.high:
        said = f"must be from low to high, {found.written(found.low)} to {found.written(found.high)}"
        return Problem(f"{name}.start", _said(start), said)
    return _refused_value(found, name, scenario) or found


def _refused_value(free: FreeNumber, name: str, scenario: Scenario) -> Problem | None:
    """What the scenario has against the start; it must be a device, bounds need not be."""
    try:
        scenario.with_values({free.key: free.written(free.start)})
    except ScenarioError as error:
        if error.allowed.startswith(("unknown key", "no such key")):
            known = all_keys(scenario)
            return Problem(name, None, f"no such key in the scenario, {near(free.key, known)}")
        own = error.key.rpartition(".")[2] == free.key.rpartition(".")[2]
        why = error.allowed if own else f"makes {error.key} wrong: {error.allowed}"
        if free.is_bounded and not any(_is_device(free, v, scenario) for v in _between(free)):
            bounds = f"{free.written(free.low)} to {free.written(free.high)}"
            return Problem(name, bounds, f"the bounds exclude every valid device: {why}")
        return Problem(f"{name}.start", free.written(free.start), why)
    return None


def _between(free: FreeNumber) -> Iterator[float]:
    yield from np.linspace(free.low, free.high, _TRIED).tolist()


def _is_device(free: FreeNumber, value: float, scenario: Scenario) -> bool:
    try:
        scenario.with_values({free.key: free.written(value)})
    except ScenarioError:
        return False
    return True


def _in_unit(unit: str, other: str) -> float | None:
    """One unit over another one; None where they do not measure the same."""
    unit = unit.strip()
    if unit == other:
        return 1.0
    if not unit or not other:
        return None
    for dimension in DIMENSIONS:
        try:
            return read_si(f"1 {unit}", dimension) / read_si(f"1 {other}", dimension)
        except ValueError:
            continue
    return None


def _said(quantity: tuple[float, str] | None) -> float | str | None:
    """A quantity as it was written."""
    if quantity is None:
        return None
    return f"{quantity[0]!r} {quantity[1].strip()}" if quantity[1].strip() else quantity[0]


def _columns(one: Measured) -> tuple[Column, ...]:
    return (one.x, *one.y) if isinstance(one, MeasuredCurve) else one.y


def _together(measured: list[Measured], free: list[FreeNumber], search: Search) -> Iterator[Problem]:
    """What is wrong with a fit whose parts are right."""
    size = sum(one.values.size for one in measured)
    known = all(bool(np.isfinite(one.sigma).all()) for one in measured)
    least = len(free) + (0 if known else 1)
    if size < least:
        keys = f"{len(free)} free key{'s' if len(free) > 1 else ''}"
        more = "" if known else " and a standard deviation to estimate"
        yield Problem("data", size, f"must have {least} or more measured values for {keys}{more}")
    if search.starts > 1:
        for one in free:
            if not one.is_bounded:
                yield Problem(
                    f'free."{one.key}"', None, "must have low and high: fit.starts are drawn between"
                )
    if search.profile and search.loss != "linear":
        yield Problem("fit.profile", True, 'goes with loss = "linear"')
