"""The runs of a sweep as one device and one programme whose numbers are arrays.

Which number of the device each axis of the sweep moves is found out by trying: no table of keys is needed.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator.model.device import Device
from simulator.model.elastomers import ArrudaBoyce, Gent, MooneyRivlin, NeoHookean, Ogden
from simulator.scenario import ScenarioError, load_scenario
from simulator.scenario.mapping import with_values
from simulator.sweep.lockstep.programme import Move, NotCovered, programme
from simulator.sweep.plan import Axis, Job, Sweep, Value

FloatArray = NDArray[np.float64]

_SAME = 1.2e-14  # two values of a number, relatively, that are one: sizes with units are rounded to 15 digits
_MOST_CORNERS = 64  # of the box that the axes span, that are tried
_TRIED = 4  # further places in it
_WORTH_IT = 200  # runs of a sweep
_ELASTOMERS = (Gent, NeoHookean, MooneyRivlin, Ogden, ArrudaBoyce)

Subject = tuple[Device, tuple[Move, ...]]


@dataclass(frozen=True)
class Stack:
    """Runs that are played together: device and programme with arrays, last axis (n_runs,)."""

    device: Device
    moves: tuple[Move, ...]
    runs: NDArray[np.int64]


def numbers(value: Any) -> Iterator[float]:
    """All floats in a nest of dataclasses, tuples and arrays, in order."""
    if isinstance(value, float):
        yield value
    elif isinstance(value, np.ndarray):
        yield from value.ravel().tolist()
    elif isinstance(value, tuple):
        for item in value:
            yield from numbers(item)
    elif is_dataclass(value):
        for field in fields(value):
            yield from numbers(getattr(value, field.name))


def form(value: Any) -> Any:
    """The same nest without its floats: what two runs must share to be played together."""
    if isinstance(value, float):
        return float
    if isinstance(value, np.ndarray):
        return value.shape
    if isinstance(value, tuple):
        return tuple(form(item) for item in value)
    if is_dataclass(value):
        return type(value), tuple(form(getattr(value, field.name)) for field in fields(value))
    return value


def filled(value: Any, found: Iterator[Any]) -> Any:
    """The nest with other numbers, arrays where they vary, in its floats' places."""
    if isinstance(value, float):
        return next(found)
    if isinstance(value, np.ndarray):
        columns = [next(found) for _ in range(value.size)]
        return np.stack(np.broadcast_arrays(*columns)) if columns else value
    if isinstance(value, tuple):
        return tuple(filled(item, found) for item in value)
    if is_dataclass(value) and not isinstance(value, type):
        return type(value)(**{f.name: filled(getattr(value, f.name), found) for f in fields(value)})
    return value


def subject(job: Job, values: Sequence[Value]) -> Subject:
    """Device and programme of one run. Raises ScenarioError or NotCovered."""
    written = {axis.key: axis.written(value) for axis, value in zip(job.axes, values, strict=True)}
    scenario = load_scenario(with_values(job.scenario, written))
    return Device.from_scenario(scenario), programme(scenario)


@dataclass(frozen=True)
class Rule:
    """How the numbers of a run follow from its values: those of `base`, some times an axis over its own."""

    base: Subject
    numbers: FloatArray
    follows: Mapping[int, int]

    def stacked(self, columns: Sequence[FloatArray | None], base: Sequence[Value], count: int) -> Subject:
        """Device and programme of `count` runs with the values of their axes."""
        found: list[Any] = self.numbers.tolist()
        for place, axis in self.follows.items():
            column = columns[axis]
            assert column is not None
            found[place] = column * (self.numbers[place] / float(base[axis]))
        device, moves = self.base
        # The arrays of a device have one row for each balloon.
        made = filled((device, moves), iter(found))
        full = np.broadcast_to
        changed: Any = {
            name: np.array(full(np.atleast_2d(getattr(made[0], name).reshape(len(device.names), -1)),
                                (len(device.names), count)))
            for name in ("radius", "thickness", "modulus", "permittivity")
        }  # fmt: skip
        return dataclasses.replace(made[0], **changed), made[1]


def rule(job: Job, base: Sequence[Value], ranges: Sequence[tuple[float, float] | None]) -> Rule:
    """Find out how the numbers of runs follow from their values.

    Parameters
    ----------
    job : Job
    base : sequence
        A value for each axis; what is not in `ranges` stays at it.
    ranges : sequence of (float, float) or None
        For each axis of numbers, the smallest and the largest value in use.

    Raises
    ------
    NotCovered
        If a number does not move in proportion to one axis, or the form of the scenario changes.
    ScenarioError
        If a corner of the box is no scenario.
    """
    first = subject(job, base)
    if not known(first[0]):
        raise NotCovered("an elastomer")
    if job.recorded.shapes and not all(getattr(e, "stays_spherical", False) for e in first[0].elastomers):
        raise NotCovered("shapes of an elastomer that may lose its sphere without a voltage")
    shape, start = form(first), np.array(list(numbers(first)))

    def at(values: Sequence[Value]) -> FloatArray:
        found = subject(job, values)
        if form(found) != shape:
            raise NotCovered("a number that changes what the scenario is made of")
        return np.array(list(numbers(found)))

    intervals = {axis: span for axis, span in enumerate(ranges) if span is not None}
    follows = _followed(job, base, intervals, start, at)
    for chosen in _tried(intervals, len(ranges)):
        values = [chosen.get(k, b) for k, b in enumerate(base)]
        wanted = start.copy()
        for place, axis in follows.items():
            wanted[place] = start[place] * (float(values[axis]) / float(base[axis]))
        if not np.allclose(at(values), wanted, rtol=_SAME, atol=0.0):
            raise NotCovered("a number that does not move in proportion")
    return Rule(first, start, follows)


def _followed(
    job: Job,
    base: Sequence[Value],
    intervals: Mapping[int, tuple[float, float]],
    start: FloatArray,
    at: Callable[[Sequence[Value]], FloatArray],
) -> dict[int, int]:
    """Which axis each number that moves follows, found at both ends of every interval. Raises NotCovered."""
    follows: dict[int, int] = {}
    for axis, (low, high) in intervals.items():
        if low == high:
            continue
        if not float(base[axis]) or not job.axes[axis].kind == "number":
            raise NotCovered("an axis whose base is zero")
        for value in (end for end in (low, high) if end != base[axis]):
            found = at([value if k == axis else b for k, b in enumerate(base)])
            for place in np.flatnonzero(found != start).tolist():
                if follows.setdefault(place, axis) != axis:
                    raise NotCovered("a number that follows two axes")
    return follows


def _tried(intervals: Mapping[int, tuple[float, float]], axes: int) -> Iterator[dict[int, float]]:
    """Places in the box of some intervals at which a rule is tried: its corners, if few, and some inside."""
    if 2 ** len(intervals) <= _MOST_CORNERS:
        for corner in itertools.product(*intervals.values()):
            yield dict(zip(intervals, corner, strict=True))
    rng = np.random.default_rng(len(intervals))
    for _ in range(_TRIED):
        share = rng.random(axes)
        yield {k: float(low + share[k] * (high - low)) for k, (low, high) in intervals.items()}


def covered(sweep: Sweep) -> bool:
    """Whether the runs of a sweep can be stacked, so that large chunks serve; how well, chunks find out."""
    try:
        found = subject(sweep.job, sweep.values(0, 1)[0])
    except (NotCovered, ScenarioError):
        return False
    recorded = sweep.job.recorded
    alone = recorded.sensitivities or recorded.margins
    return sweep.size >= _WORTH_IT and not alone and known(found[0])


def known(device: Device) -> bool:
    """Whether all elastomers are of a kind that computes with arrays of devices."""
    return all(isinstance(elastomer, _ELASTOMERS) for elastomer in device.elastomers)


def stacks(job: Job, values: Sequence[Sequence[Value]]) -> Iterator[Stack | tuple[NDArray[np.int64], str]]:
    """The runs of a chunk as stacks, or their places and why they are none."""
    columns = list(zip(*values, strict=True))
    plain = [_plain(job.axes[k], columns[k]) for k in range(len(columns))]
    yield from _split(job, values, plain, np.arange(len(values)))


def _split(
    job: Job, values: Sequence[Sequence[Value]], plain: list[bool], runs: NDArray[np.int64]
) -> Iterator[Stack | tuple[NDArray[np.int64], str]]:
    """Runs with the same values of all axes that are not plain numbers, together."""
    kinds: dict[tuple[Value, ...], list[int]] = {}
    for run in runs.tolist():
        kinds.setdefault(tuple(v for v, p in zip(values[run], plain, strict=True) if not p), []).append(run)
    for members in kinds.values():
        index = np.array(members)
        columns = [
            np.array([float(values[run][k]) for run in members]) if p else None for k, p in enumerate(plain)
        ]
        base = [
            float(c[np.argmax(np.abs(c))]) if c is not None else values[members[0]][k]
            for k, c in enumerate(columns)
        ]
        spans = [(float(c.min()), float(c.max())) if c is not None else None for c in columns]
        try:
            found = rule(job, base, spans)
            device, moves = found.stacked(columns, base, len(members))
        except NotCovered as reason:
            few = [k for k, p in enumerate(plain) if p and len({values[run][k] for run in members}) <= 4]
            if few and str(reason).startswith("a number"):
                # Not in proportion, but it has few values: each by itself.
                yield from _split(job, values, [p and k not in few[:1] for k, p in enumerate(plain)], index)
            else:
                yield index, str(reason)
        except ScenarioError:
            yield index, "a corner of the box is no scenario"
        else:
            yield Stack(device, moves, index)


def _plain(axis: Axis, column: Sequence[Value]) -> bool:
    return axis.kind == "number" and all(isinstance(value, float) for value in column)
