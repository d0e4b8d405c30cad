"""The data of a fit: columns of CSV files, and events, in the numbers that they are compared in."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from simulator.events import EventKind
from simulator.identification.problem import Column, Measured, MeasuredCurve, MeasuredEvent
from simulator.scenario import Problem, Scenario, ScenarioError
from simulator.scenario.columns import (
    Layout,
    Opened,
    RecordingError,
    name_and_unit,
    numbers,
    opened,
    place_of,
)
from simulator.scenario.mapping import near, number_and_unit
from simulator.units import QUANTITIES, RADIUS, TIME, Dimension, read_si

if TYPE_CHECKING:
    from simulator.identification.reading import DataTable

_BARE = ("", "-", "1")  # what stands for a unit where there is none
_SIDES = ("_before", "_after")


class _Refused(Exception):
    """What is wrong with a table of data."""

    def __init__(self, key: str, value: object, allowed: str) -> None:
        super().__init__(allowed)
        self.problem = Problem(key, value, allowed)


def quantities(scenario: Scenario) -> dict[str, Dimension | None]:
    """The quantities of a scenario's histories that may have been measured, and what they measure."""
    volume = QUANTITIES["volume"]
    found: dict[str, Dimension | None] = {"time": TIME}
    for balloon in scenario.balloons:
        found |= {
            f"stretch_{balloon.name}": None,
            f"radius_{balloon.name}": RADIUS,
            f"diameter_{balloon.name}": RADIUS,
        }
    for name in scenario.electroded:
        found |= {f"{word}_{name}": QUANTITIES[word] for word in ("voltage", "field", "charge")}
    return {**found, "pressure": QUANTITIES["pressure"], "volume": volume}


def read_measured(table: DataTable, scenario: Scenario, folder: str, file: str) -> Measured:
    """One [[data]] table with its numbers.

    Parameters
    ----------
    table : DataTable
    scenario : Scenario
    folder : str
        Where the path of its file starts.
    file : str
        Of the fit, for messages.

    Raises
    ------
    ScenarioError
        With the key in the table, its value and what is allowed.
    """
    try:
        _check_step(table.step, scenario)
        return _event(table, scenario) if table.event is not None else _curve(table, scenario, folder)
    except _Refused as error:
        raise ScenarioError(file, error.problem) from None
    except RecordingError as error:
        value = table.file if error.key == ("file",) else error.value
        raise ScenarioError(file, Problem(".".join(error.key), value, error.allowed)) from None


def _check_step(step: int | None, scenario: Scenario) -> None:
    if step is None:
        return
    count = sum(1 for _ in scenario.played_steps())
    if step > count:
        raise _Refused("step", step, f"must be a step of the scenario, 1 to {count} with cycles unrolled")


def _curve(table: DataTable, scenario: Scenario, folder: str) -> MeasuredCurve:
    for key in ("file", "x", "y"):
        if getattr(table, key) is None:
            raise _Refused(key, None, "is missing; a table has file, x and y, or an event")
    assert table.file is not None
    assert table.x is not None
    assert table.y is not None
    if table.separator == table.decimal:
        raise _Refused("decimal", table.decimal, "must differ from the separator")
    layout = Layout(table.separator, table.decimal, table.skip)
    file = opened(os.path.abspath(os.path.join(folder, table.file)), layout)
    ((x_name, x_title),) = table.x.items()
    known = quantities(scenario)
    asked = [("x", x_name, x_title), *(("y", name, title) for name, title in table.y.items())]
    for word, name, _ in asked:
        _check_quantity(f"{word}.{name}", name, known)
    if x_name in table.y:
        raise _Refused(f"y.{x_name}", table.y[x_name], "must be another quantity than x")
    if "time" in table.y:
        raise _Refused("y.time", table.y["time"], "must be x: a history is at each time in one state")
    places = [place_of(file, f"{word}.{name}", title) for word, name, title in asked]
    if len(set(places)) < len(places):
        raise _Refused("y", dict(table.y), "must be columns of their own")
    titles = [{title, *_names(file, place)} for (_, _, title), place in zip(asked, places, strict=True)]
    _check_titles("units", table.units, titles)
    _check_titles("sigma", table.sigma, titles[1:])
    columns = [
        _column(name, known[name], title, file.names[place], table.units, scenario)
        for (_, name, title), place in zip(asked, places, strict=True)
    ]
    factors = np.array([column.factor for column in columns])
    values = numbers(file, tuple(places)) * factors[:, None]
    at = values[0] + _offset(table, columns[0])
    sigma = [
        _sigma(table.sigma, column, names) for column, names in zip(columns[1:], titles[1:], strict=True)
    ]
    rows = np.array([row.number for row in file.rows()], dtype=np.int64)
    if float(np.ptp(at)) == 0.0:
        raise _Refused(f"x.{x_name}", x_title, "must take more than one value")
    return MeasuredCurve(
        table.file, columns[0], tuple(columns[1:]), at, values[1:].T.copy(), np.array(sigma), rows, table.step
    )


def _check_quantity(key: str, name: str, known: Mapping[str, Dimension | None]) -> None:
    if name not in known:
        like = near(name, dict.fromkeys(known, 0.0))
        allowed = like if like.startswith("did") else f"has {', '.join(known)}"
        raise _Refused(key, None, f"no quantity of this scenario; {allowed}")


def _names(file: Opened, place: int) -> tuple[str, str]:
    cell = file.names[place]
    return cell, name_and_unit(cell)[0]


def _check_titles(key: str, given: Mapping[str, Any], titles: list[set[str]]) -> None:
    for name in given:
        if not any(name in names for names in titles):
            columns = ", ".join(sorted(min(names, key=len) for names in titles))
            raise _Refused(f"{key}.{name}", None, f"must be a column that is read as {_WORD[key]}: {columns}")


_WORD = {"units": "x or y", "sigma": "y"}


def _column(
    name: str,
    dimension: Dimension | None,
    title: str,
    cell: str,
    units: Mapping[str, str],
    scenario: Scenario,
) -> Column:
    """A column of a file with its unit: that of `units`, or of its header."""
    bare, in_header = name_and_unit(cell)
    key = next((one for one in (title, cell, bare) if one in units), None)
    unit = units[key] if key is not None else in_header
    where = f"units.{key}" if key is not None else f'column "{cell}"'
    if dimension is None:
        if unit is not None and unit.strip() not in _BARE:
            raise _Refused(where, unit, f"must have no unit: {name} is a ratio")
        return Column(name, "", 1.0, None)
    if scenario.scales is None:
        if unit is not None and unit.strip() not in _BARE and dimension is not TIME:
            raise _Refused(where, unit, "a unit needs [scales] in the scenario")
        return Column(name, "", 1.0, dimension)
    if unit is None and dimension is TIME:
        return Column(name, "s", 1.0, dimension)
    example = dimension.example.split()[-1]
    if unit is None:
        said = f'is missing, the header of column "{cell}" has no unit: units = {{ {title} = "{example}" }}'
        raise _Refused("units", None, said)
    if unit.strip() in _BARE:
        # Of a bare number the unit is that of the dimensionless model.
        return Column(name, dimension.symbol, scenario.scales.of(dimension), dimension)
    return Column(name, unit.strip(), _factor(unit, dimension, where), dimension)


def _factor(unit: str, dimension: Dimension, where: str) -> float:
    try:
        factor = read_si(f"1 {unit.strip()}", dimension)
    except ValueError as error:
        reason = f"; {error}" if str(error) else ""
        example = dimension.example.split()[-1]
        raise _Refused(where, unit, f'must be {_of(dimension)} such as "{example}"{reason}') from None
    return factor


def _of(dimension: Dimension) -> str:
    return f"a unit of {dimension.name.partition(' ')[2]}"


def _offset(table: DataTable, x: Column) -> float:
    """What is added to a time."""
    if "offset" not in table.model_fields_set:
        return 0.0
    number, unit = table.offset
    if x.name != "time":
        raise _Refused("offset", number, "goes with x = { time = … }")
    if not unit:
        return number * x.factor
    return number * _factor(unit, TIME, "offset")


def _sigma(given: Mapping[str, tuple[float, str]], column: Column, names: set[str]) -> float:
    """The standard deviation of a column, NaN where none is given."""
    key = next((name for name in names if name in given), None)
    return math.nan if key is None else _deviation(given[key], column, f"sigma.{key}")


def _deviation(quantity: tuple[float, str], column: Column, key: str) -> float:
    """A standard deviation in the numbers of its column."""
    number, unit = quantity
    value = f"{number!r} {unit}" if unit else number
    factor = column.factor
    if unit:
        if column.dimension is None or not column.unit:
            raise _Refused(key, value, "must be a number without a unit, as its column is")
        try:
            factor = _factor(unit, column.dimension, key)
        except _Refused as error:
            raise _Refused(key, value, error.problem.allowed) from None
    if not number * factor > 0.0:
        raise _Refused(key, value, "must be > 0")
    return number * factor


def _event(table: DataTable, scenario: Scenario) -> MeasuredEvent:
    assert table.event is not None
    for key in ("file", "x", "y", "units", "sigma", "offset"):
        if key in table.model_fields_set:
            raise _Refused(key, None, "does not go with event")
    given = dict(table.event)
    kinds = [kind.value for kind in EventKind]
    kind = given.pop("kind", None)
    if kind not in kinds:
        raise _Refused("event.kind", kind, f"must be one of {', '.join(kinds)}")
    number = given.pop("number", 1)
    if not isinstance(number, int) or isinstance(number, bool) or number < 1:
        raise _Refused("event.number", number, "must be a whole number >= 1")
    sigma = given.pop("sigma", None)
    known = quantities(scenario)
    if not given:
        raise _Refused("event", None, f"must have a measured quantity, such as {_example(known)}")
    found = [*_of_event(given, known, scenario)]
    columns, values = tuple(column for column, _ in found), np.array([value for _, value in found])
    deviations = np.array([_of_sigma(sigma, column) for column in columns])
    label = f"{kind.replace('_', ' ')} {number}"
    return MeasuredEvent(label, EventKind(kind), number, columns, values, deviations, table.step)


def _example(known: Mapping[str, Dimension | None]) -> str:
    return next((name for name in known if name.startswith("voltage_")), "pressure")


def _of_event(
    given: Mapping[str, Any], known: Mapping[str, Dimension | None], scenario: Scenario
) -> Iterator[tuple[Column, float]]:
    """The quantities of an event, each with its value."""
    for name, value in given.items():
        plain = name
        for side in _SIDES:
            plain = plain.removesuffix(side)
        if plain not in known or plain == "volume" or plain.startswith("charge_"):
            without = dict.fromkeys([n for n in known if n != "volume" and not n.startswith("charge_")])
            _check_quantity(f"event.{name}", plain, without)
        quantity = number_and_unit(value)
        if quantity is None or not math.isfinite(quantity[0]):
            raise _Refused(f"event.{name}", value, 'must be a number, or a text such as "4.4 kV"')
        number, unit = quantity[0], quantity[1].strip()
        dimension = known[plain]
        if unit and (dimension is None or scenario.scales is None):
            why = "must be a number without a unit" if dimension is None else "a unit needs [scales]"
            raise _Refused(f"event.{name}", value, why)
        if dimension is None or scenario.scales is None:
            yield Column(name, "", 1.0, dimension), number
        elif not unit and dimension is not TIME:
            allowed = f'must be {dimension.name} such as "{dimension.example}": the scenario has [scales]'
            raise _Refused(f"event.{name}", value, allowed)
        else:
            yield _with_unit(name, value, (number, unit), dimension)


def _with_unit(
    name: str, value: Any, quantity: tuple[float, str], dimension: Dimension
) -> tuple[Column, float]:
    number, unit = quantity
    try:
        factor = _factor(unit, dimension, name) if unit else 1.0
    except _Refused as error:
        raise _Refused(f"event.{name}", value, error.problem.allowed) from None
    return Column(name, unit or "s", factor, dimension), number * factor


def _of_sigma(sigma: Any, column: Column) -> float:
    """The standard deviation of a quantity of an event, which must be given."""
    key = "event.sigma"
    if isinstance(sigma, Mapping):
        sigma, key = sigma.get(column.name), f"event.sigma.{column.name}"
    if sigma is None:
        raise _Refused(key, None, "is missing: a single value has no scatter to estimate it from")
    quantity = number_and_unit(sigma)
    if quantity is None:
        raise _Refused(key, sigma, 'must be a number > 0, or a text such as "0.05 kV"')
    return _deviation((quantity[0], quantity[1].strip()), column, key)
