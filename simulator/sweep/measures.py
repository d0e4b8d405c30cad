"""The units of a sweep's columns: what was varied as it was written, results in SI units.

Runs are played and compared without units. Where the scenario has [scales], their rows are turned into SI
units at the very end, each with the scales of its own run, since these may be varied too. Without [scales]
nothing has a unit.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from simulator.scenario import Scenario
from simulator.scenario.dimensions import dimension_of, unit_of
from simulator.scenario.mapping import with_values
from simulator.scenario.scales import scales_of
from simulator.sweep.plan import Axis, Job, Value
from simulator.units import ENERGY, FIELD, PRESSURE, VOLTAGE, Dimension, Scales, per

_RESULTS: tuple[tuple[re.Pattern[str], Dimension], ...] = (
    (re.compile(r"(limit_point_\d+|sphericity)_voltage_\w+"), VOLTAGE),
    (re.compile(r"landing_pressure"), PRESSURE),
    (re.compile(r"largest_field_\w+"), FIELD),
    (re.compile(r"loop_work|dissipated"), ENERGY),
)
_SENSITIVITY = re.compile(r"d\(.*\)/d\((?P<key>.*)\)")


def quantity(column: str) -> Dimension | None:
    """What a column of results measures; None for a pure number, a count or a word."""
    return next((dimension for name, dimension in _RESULTS if name.fullmatch(column)), None)


def units_of(scenario: Scenario, job: Job, names: Iterable[str]) -> dict[str, str]:
    """The units of columns by name; those that have none are left out.

    Parameters
    ----------
    scenario : Scenario
        The base scenario.
    job : Job
    names : iterable of str
        The columns.

    Returns
    -------
    dict of str to str
        Of what is varied the unit it is written in, or where it has none what it is a multiple of, such as
        "μH/R"; of results the SI unit.
    """
    if scenario.scales is None:
        return {}
    axes = {axis.key: axis for axis in job.axes}
    units = {}
    for name in names:
        found = _SENSITIVITY.fullmatch(name)
        dimension = quantity(name)
        if name in axes:
            units[name] = _of_axis(scenario, axes[name])
        elif job.past is not None and name == job.past.key:
            units[name] = VOLTAGE.unit
        elif found:
            units[name] = per(VOLTAGE.unit, _of_number(scenario, found["key"], axes))
        elif dimension is not None:
            units[name] = dimension.unit
    return {name: unit for name, unit in units.items() if unit}


def _of_number(scenario: Scenario, key: str, axes: Mapping[str, Axis]) -> str:
    """The unit in which a number of the device is written."""
    if key in axes:
        return _of_axis(scenario, axes[key])
    return unit_of(scenario, key)


def _of_axis(scenario: Scenario, axis: Axis) -> str:
    if axis.kind != "number" or axis.unit.strip():
        return axis.unit.strip()
    # With a value in its place, since the base scenario may not have the key.
    dimension = dimension_of(scenario.with_values({axis.key: axis.values[0]}), axis.key)
    return dimension.symbol if dimension else ""


def titled(names: Iterable[str], units: Mapping[str, str]) -> list[str]:
    """Columns as a table heads them: with their unit, where they have one."""
    return [f"{name} [{units[name]}]" if name in units else name for name in names]


def scale_sizes(job: Job, names: Iterable[str]) -> dict[str, float]:
    """What is 1 without units, in the unit of each column of results that has one."""
    if not job.units:
        return {}
    scales = scales_of(job.scenario["scales"])
    return {name: scales.of(dimension) for name in names if (dimension := quantity(name))}


def in_units(job: Job, names: Sequence[str]) -> Callable[[Sequence[Value], Sequence[Any]], Sequence[Any]]:
    """What turns the cells of a run, in the order of some columns, into the units of these columns.

    Parameters
    ----------
    job : Job
    names : sequence of str

    Returns
    -------
    callable
        Of the values of a run, by axis, and of its cells; returns the cells.
    """
    past = job.past.key if job.past else None
    measured = [(i, d) for i, n in enumerate(names) if (d := VOLTAGE if n == past else quantity(n))]
    measured = [(i, d) for i, d in measured if names[i] in job.units]
    if not measured:
        return lambda values, cells: cells
    rescaled = any(axis.key.startswith("scales.") for axis in job.axes)
    base = scales_of(job.scenario["scales"])

    def converted(values: Sequence[Value], cells: Sequence[Any]) -> Sequence[Any]:
        scales = _scales(job, values) if rescaled else base
        out = list(cells)
        for place, dimension in measured:
            if out[place] is not None:
                out[place] = out[place] * scales.of(dimension)
        return out

    return converted


def _scales(job: Job, values: Sequence[Value]) -> Scales:
    written = {axis.key: axis.written(value) for axis, value in zip(job.axes, values, strict=True)}
    return scales_of(with_values(job.scenario, written)["scales"])
