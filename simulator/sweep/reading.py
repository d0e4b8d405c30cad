"""The sweep file, read and checked by `read_sweep`.

The grammar is that of `docs/sweep.md`. As for a scenario, all problems are reported at once, each with
file, key, value and what is allowed, in one `ScenarioError`.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from simulator import __version__
from simulator.scenario import Cycle, Problem, Ramp, Scenario, ScenarioError, load_scenario
from simulator.scenario.dimensions import dimension_of
from simulator.scenario.fields import problems_of
from simulator.scenario.keys import all_keys, physical_keys
from simulator.scenario.mapping import near, number_and_unit, value_at, with_values
from simulator.scenario.reading import check_kind, read_toml
from simulator.sweep.grammar import Range, SampleTable, SpreadTable, SweepFile
from simulator.sweep.measures import units_of
from simulator.sweep.plan import Axis, Job, Past, Recorded, Sample, Sweep, Value, as_recorded, drawn
from simulator.sweep.rows import columns
from simulator.sweep.spreads import matrix_of, spread_axis, wrong_axis, wrong_sample, wrong_spread

MAX_RUNS = 10_000_000

_FIXED = ("title", "source", "name", "electrodes")
_CHECKED = 200  # values of an axis that are tried beforehand, its ends among them


SweepLike = Sweep | str | os.PathLike[str] | Mapping[str, Any]
"""A sweep, or what `read_sweep` makes one of."""


def read_sweep(source: SweepLike, *, file: str | None = None) -> Sweep:
    """Read and check a sweep, with its base scenario.

    Parameters
    ----------
    source : path, mapping or Sweep
        A TOML file, or its content as a mapping. The path of the scenario is relative to the folder of
        the file, for a mapping to the current directory; in a mapping, "scenario" may be a scenario's
        mapping itself. A sweep is returned as it is.
    file : str, optional
        Of a mapping: the file it was read from, for messages and for the path of the scenario.

    Returns
    -------
    Sweep

    Raises
    ------
    ScenarioError
        With every problem found: file, key, value and what is allowed.

    Examples
    --------
    >>> sweep = read_sweep({
    ...     "scenario": "scenarios/fig3c_state_b.toml",
    ...     "vary": {"gas.ambient_pressure": [0.015, 0.05, 0.2], "balloon.active.radius": [0.8, 1.0]},
    ... })
    >>> sweep.shape, sweep.size
    ((3, 2), 6)
    """
    if isinstance(source, Sweep):
        return source
    base: Mapping[str, Any] | None = None
    if isinstance(source, Mapping):
        folder, data = os.path.dirname(file) if file else "", dict(source)
        file = file or "<dict>"
        if isinstance(data.get("scenario"), Mapping):
            base, data["scenario"] = data["scenario"], "<dict>"
        check_kind(file, data, "a sweep")
    else:
        file, folder = os.fspath(source), os.path.dirname(os.fspath(source))
        data = read_toml(file, "a sweep")
    try:
        read = SweepFile.model_validate(data)
    except ValidationError as error:
        raise ScenarioError(file, *problems_of(error, _quoted)) from None
    scenario = load_scenario(os.path.join(folder, read.scenario) if base is None else base)
    home = os.path.dirname(os.path.abspath(scenario.file)) if base is None else ""
    axes = tuple(
        replace(_as_axis(key, values, scenario), folder=home if _is_path(key) else "")
        for key, values in read.vary.items()
    )
    problems = [*_of_form(read, axes)]
    problems = problems or [*_of_keys(scenario, read, axes)]
    if problems:
        raise ScenarioError(file, *problems)
    return _sweep(file, read, scenario, axes)


def _sweep(file: str, read: SweepFile, scenario: Scenario, axes: tuple[Axis, ...]) -> Sweep:
    mapping = as_recorded(scenario, shapes=read.record.shapes)
    asked = read.record.sensitivities
    keys = (physical_keys(scenario) if asked else ()) if isinstance(asked, bool) else asked
    past = None
    if read.past_limit_point:
        ((key, table),) = read.past_limit_point.items()
        past = Past(key, int(key.split(".")[1]), table.times)
    sample = _as_sample(read.sample, axes) if read.sample else None
    job = Job(
        scenario=mapping,
        axes=axes,
        past=past,
        recorded=Recorded(read.record.limit_points, keys, read.record.shapes, _margins(read, scenario)),
        balloons=tuple(balloon.name for balloon in scenario.balloons),
        electroded=scenario.electroded,
        version=__version__,
    )
    job = replace(job, units=units_of(scenario, job, columns(job)))
    definition: dict[str, Any] = {
        **read.model_dump(
            mode="json", by_alias=True, include={"vary", "sample", "past_limit_point", "record"}
        ),
        "scenario": mapping,
        "version": __version__,
    }
    definition["tables"] = {path: _digest(Path(path).read_bytes()) for path in _table_files(job)}
    if sample:
        # Another release of SciPy may draw other points from the same seed.
        definition["points"] = _digest(drawn(sample, axes).tobytes())
    title = read.title or scenario.title
    return Sweep(file=file, title=title, job=job, sample=sample, definition=definition)


def _margins(read: SweepFile, scenario: Scenario) -> tuple[str, ...]:
    """The balloons of which margins to breakdown are recorded."""
    films = [balloon.name for balloon in scenario.balloons if balloon.breakdown is not None]
    return tuple(films) if read.record.margins else ()


def _as_sample(table: SampleTable, axes: tuple[Axis, ...]) -> Sample:
    correlation: tuple[tuple[float, ...], ...] = ()
    if table.correlations:
        correlation = tuple(tuple(row) for row in matrix_of(table.correlations, axes).tolist())
    return Sample(table.method, table.size, table.seed, correlation, table.indices)


def _as_axis(key: str, values: Range | SpreadTable | tuple[Value, ...], scenario: Scenario) -> Axis:
    if isinstance(values, SpreadTable):
        return spread_axis(key, values, scenario)
    if not isinstance(values, Range):
        quantities = [number_and_unit(value) for value in values if isinstance(value, str)]
        numbers = tuple(found[0] for found in quantities if found is not None)
        if len(numbers) < len(values) or not _is_measured(scenario, key, values[0]):
            return Axis(key, values)
        units = {found[1] for found in quantities if found is not None}
        return Axis(key, numbers, units.pop()) if len(units) == 1 else Axis(key, values)
    (low, unit), (high, _) = values.start, values.to
    log = values.spacing == "log"
    if values.points is None or values.points > MAX_RUNS or (log and min(low, high) <= 0.0):
        return Axis(key, (low, high), unit, log)
    spaced = np.geomspace if log else np.linspace
    return Axis(key, tuple(spaced(low, high, values.points).tolist()), unit, log)


def _is_measured(scenario: Scenario, key: str, value: Value) -> bool:
    """Whether a key may hold a value, and takes numbers with a unit."""
    try:
        return dimension_of(scenario.with_values({key: value}), key) is not None
    except ScenarioError:  # said later, with the key of the sweep
        return False


def _is_path(key: str) -> bool:
    """Whether a key of the scenario holds the path of a table or a recording."""
    *above, last = key.split(".")
    return last == "table" or (last == "file" and "table" in above)


def _of_form(read: SweepFile, axes: tuple[Axis, ...]) -> Iterator[Problem]:
    """What can be said of the sweep without its scenario."""
    size = 1
    for axis, (key, values) in zip(axes, read.vary.items(), strict=True):
        name = _quoted(("vary", key))
        if isinstance(values, SpreadTable):
            yield from wrong_spread(name, values, sampled=read.sample is not None)
            continue
        if not isinstance(values, Range):
            size *= len(axis.values)
            found = [number_and_unit(value) for value in values if isinstance(value, str)]
            units = {each[1].strip() for each in found if each is not None}
            if axis.kind == "text" and None not in found and len(units) > 1 and not _is_path(key):
                yield Problem(name, list(values), "must be all in one unit")
            if read.sample:
                yield Problem(
                    name, list(values), "must be an interval such as { from = 0.1, to = 1 }: drawn from"
                )
            continue
        size *= values.points or 1
        (low, unit), (high, other) = values.start, values.to
        if unit != other:
            yield Problem(
                f"{name}.to", f"{high!r}{other}", f"must be in the unit of from, {unit.strip() or 'none'}"
            )
        if low == high:
            yield Problem(f"{name}.to", high, "must differ from from")
        if values.spacing == "log" and min(low, high) <= 0.0:
            end = "from" if low <= 0.0 else "to"
            yield Problem(f"{name}.{end}", min(low, high), "must be > 0 with log spacing")
        if values.points is None and not read.sample:
            yield Problem(f"{name}.points", None, "is missing, must be a whole number >= 2")
        if values.points is not None and read.sample:
            yield Problem(f"{name}.points", values.points, "does not go with sample, which has a size")
    if read.sample:
        size = read.sample.size
        if read.sample.method == "sobol" and size & (size - 1):
            yield Problem(
                "sample.size", size, f"must be a power of 2 for sobol, such as {1 << size.bit_length()}"
            )
        yield from wrong_sample(read.sample, list(read.vary), [_quoted(("vary", key)) for key in read.vary])
    if size > MAX_RUNS:
        key, value = ("sample.size", size) if read.sample else ("vary", None)
        yield Problem(key, value, f"must ask for at most {MAX_RUNS:,} runs, asks for {size:,}")


def _of_keys(scenario: Scenario, read: SweepFile, axes: tuple[Axis, ...]) -> Iterator[Problem]:
    """Keys that are not there, and values that the scenario refuses."""
    known = all_keys(scenario)
    mapping = scenario.to_dict()
    for axis in axes:
        name = _quoted(("vary", axis.key))
        if axis.key.rpartition(".")[2] in _FIXED:
            yield Problem(name, None, "cannot be varied, results have columns by name")
            continue
        values = read.vary[axis.key]
        if isinstance(values, SpreadTable) and (wrong := [*wrong_axis(name, axis, values)]):
            yield from wrong
            continue
        problem = _refused_value(mapping, axis, known)
        if problem is not None:
            value, allowed = problem
            yield Problem(name, value, allowed)
    asked = read.record.sensitivities
    if asked and scenario.dynamics is not None:
        yield Problem("record.sensitivities", None, "not with [dynamics]: a limit point is passed late")
    if read.record.margins and not _margins(read, scenario):
        yield Problem("record.margins", True, "no balloon of the scenario has a breakdown")
    numbers = dict.fromkeys(physical_keys(scenario))
    for key in () if isinstance(asked, bool) else asked:
        if key not in numbers:
            yield Problem("record.sensitivities", key, f"no number of the device; {near(key, numbers)}")
    if read.sample:
        yield from _of_indices(scenario, read, axes)
    for key in read.past_limit_point or {}:
        yield from _of_past(scenario, key, axes)


def _of_indices(scenario: Scenario, read: SweepFile, axes: tuple[Axis, ...]) -> Iterator[Problem]:
    """Indices of columns that a sweep does not have."""
    assert read.sample is not None
    names = tuple(balloon.name for balloon in scenario.balloons)
    recorded = Recorded(read.record.limit_points, (), read.record.shapes, _margins(read, scenario))
    job = Job({}, axes, None, recorded, names, scenario.electroded, __version__)
    numbers = {name: 0.0 for name, kind in columns(job).items() if kind in ("number", "whole")}
    for name in read.sample.indices:
        if name not in numbers or name in read.vary:
            yield Problem("sample.indices", name, f"must be a column of numbers; {near(name, numbers)}")


def _refused_value(
    mapping: Mapping[str, Any], axis: Axis, known: Mapping[str, Any]
) -> tuple[Any, str] | None:
    stride = max(1, len(axis.values) // _CHECKED)
    for value in (*axis.values[::stride], axis.values[-1]):
        try:
            load_scenario(with_values(mapping, {axis.key: axis.written(value)}))
        except KeyError:
            return None, f"no such key in the scenario, {near(axis.key, known)}"
        except ScenarioError as error:
            same_name = error.key.rpartition(".")[2] == axis.key.rpartition(".")[2]
            own = same_name or f"{axis.key}.".startswith(f"{error.key}.")
            if own and error.allowed.startswith("unknown key"):
                return None, f"no such key in the scenario, {near(axis.key, known)}"
            where = "" if own else f"makes {error.key} wrong: "
            return axis.written(value), f"{where}{error.allowed}"
    return None


def _of_past(scenario: Scenario, key: str, axes: tuple[Axis, ...]) -> Iterator[Problem]:
    name = _quoted(("past_limit_point", key))
    parts = key.split(".")
    steps = scenario.steps
    place = int(parts[1]) - 1 if len(parts) == 3 and parts[1].isdecimal() else -1
    found = steps[place] if 0 <= place < len(steps) else None
    if parts[0] != "step" or parts[-1] != "ramp" or not isinstance(found, Ramp):
        ramps = [f"step.{i}.ramp" for i, step in enumerate(steps, 1) if isinstance(step, Ramp)]
        yield Problem(name, None, f"must be a ramp of the scenario, {' or '.join(ramps) or 'it has none'}")
    elif any(isinstance(step, Cycle) for step in steps[:place]):
        yield Problem(name, None, "must come before any cycle")
    elif number_and_unit(value_at(scenario.to_dict(), key)) is None:
        yield Problem(name, None, "must be one number for all electrodes")
    elif any(axis.key == key for axis in axes):
        yield Problem(name, None, "is varied, too; it can be one of both")


def _table_files(job: Job) -> list[str]:
    """The tables that any run may read, each once."""
    found: dict[str, None] = {}

    def search(value: Any) -> None:
        if isinstance(value, Mapping):
            # By now paths are absolute; a balloon called table may have a voltage of "8 kV".
            paths = (value.get("table"), value.get("file"))
            found.update(
                dict.fromkeys(path for path in paths if isinstance(path, str) and os.path.isabs(path))
            )
            for item in value.values():
                search(item)
        elif isinstance(value, list | tuple):
            for item in value:
                search(item)

    search(job.scenario)
    for axis in job.axes:
        if _is_path(axis.key):
            found.update(dict.fromkeys(os.path.abspath(str(axis.written(value))) for value in axis.values))
    return list(found)


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _quoted(loc: tuple[int | str, ...]) -> str:
    """A place in the sweep file as one would write it there: keys with dots stand in quotes."""
    return ".".join(f'"{part}"' if isinstance(part, str) and "." in part else str(part) for part in loc)
