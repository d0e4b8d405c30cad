"""Whether the balloons of many runs stay spheres: on intervals of path, and in flows.

As everything in lockstep it is certain, or said to be not.
"""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from simulator.model.membranes import ElectrodedMembrane, sphericity
from simulator.solver.batch.events import at_zero
from simulator.solver.batch.extremes import largest
from simulator.solver.batch.interval import GRID, basis, blur, on_grid
from simulator.solver.batch.stacked import Stacked

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Places = NDArray[np.int64]

_NEXT_TO = 3  # neighbours on `GRID` between which a margin may be of either sign, where it vanishes once
_WITHIN = 129  # stretches between the smallest and the largest of a flow
_AROUND = 0.05  # of the stretches that a flow passes, by how much more it may have passed
_NOTHING = 1e-10  # of the largest value of a margin: it has no sign


class Crossings(NamedTuple):
    """Where some runs lose a sphere along their path, or have one again; arrays (n,).

    `place` is the balloon, `when` is in order along the path of each run, `states` is (n_unknowns, n).
    """

    runs: Places
    place: Places
    falls: BoolArray
    when: FloatArray
    states: FloatArray


class Flown(NamedTuple):
    """What flows do to the shapes of n runs, (n_balloons, n): whether a balloon ends as no sphere, whether it
    is none on the way, and whether the latter is certain.
    """

    ends_lost: BoolArray
    passes: BoolArray
    certain: BoolArray


def margin(i: int, batch: Stacked, y: Any) -> Any:
    """D²s/k of one balloon."""
    return sphericity(batch.membranes[i], y[i], y[-1])


def minus_margin(i: int, batch: Stacked, y: Any) -> Any:
    """−s of one balloon, over μ."""
    wall = batch.membranes[i].wall
    denominator = wall.elastomer.pole_form(y[i])[1]
    return -wall.modulus * margin(i, batch, y) / (denominator * denominator)


def least(batch: Stacked, y: FloatArray) -> FloatArray:
    """S of every balloon in states (n_unknowns, n_runs), (n_balloons, n_runs)."""
    return np.stack([np.broadcast_to(-minus_margin(i, batch, y), y.shape[1:]) for i in range(batch.count)])


def least_on(
    batch: Stacked, states: FloatArray, tangents: FloatArray, place: Places, so_far: FloatArray
) -> FloatArray:
    """The smaller of `so_far` (n_balloons, n_runs) and s of every balloon on intervals given by points."""
    return np.stack(
        [
            -largest(batch, partial(minus_margin, i), states, tangents, place, -so_far[i])
            for i in range(batch.count)
        ]
    )


def crossings(
    batch: Stacked, states: FloatArray, place: Places, step: int
) -> tuple[list[Crossings], BoolArray]:
    """Where balloons lose or regain their spheres on intervals.

    Parameters
    ----------
    batch : Stacked
    states : (n_unknowns, 5, n_runs) array
        See `interval`.
    place : (n_runs,) array
        The softest balloon.
    step : int
        Number of the interval along the paths.

    Returns
    -------
    list of Crossings
        Their `runs` are places among these.
    (n_runs,) array of bool
        Whether all of that is certain.
    """
    runs = states.shape[2]
    certain = np.ones(runs, dtype=bool)
    found: list[Crossings] = []
    for i, membrane in enumerate(batch.membranes):
        if not isinstance(membrane, ElectrodedMembrane):
            continue
        values = np.broadcast_to(np.asarray(margin(i, batch, states)), states.shape[1:])
        seen, off = on_grid(values), blur(values)
        above, below = seen > off, seen < -off
        near = np.flatnonzero(~(above.all(axis=0) | below.all(axis=0)))
        if not near.size:
            continue
        falls, at, once = _once(values[:, near], above[:, near], below[:, near], seen[:, near])
        certain[near[~once]] = False
        near, falls, at = near[once], falls[once], at[once]
        if not near.size:
            continue
        some, their = batch.take(near), states[:, :, near]
        polished, good = _polished(some, i, their, place[near], falls, at)
        certain[near[~good]] = False
        near, falls, at = near[good], falls[good], at[good]
        found.append(Crossings(near, np.full(near.size, i), falls, step + at, polished[:, good]))
    return found, certain


def _once(
    values: FloatArray, above: BoolArray, below: BoolArray, seen: FloatArray
) -> tuple[BoolArray, FloatArray, BoolArray]:
    """Whether margins fall, where they vanish, and whether they do so exactly once, as far as is certain."""
    falls = values[0] > 0.0
    before, after = np.where(falls, above, below), np.where(falls, below, above)
    # Up to here surely as at the start, from there on surely as at the end.
    last = len(GRID) - 1
    first = np.where(before.all(axis=0), last, np.argmin(before, axis=0) - 1)
    end = np.where(after.all(axis=0), 0, last + 1 - np.argmin(after[::-1], axis=0))
    once = (first >= 0) & (end <= last) & (end > first) & (end - first <= _NEXT_TO)
    # And straight from one to the other.
    steps = np.where(falls, -1.0, 1.0) * np.diff(seen, axis=0)
    between = (np.arange(last)[:, None] >= first) & (np.arange(last)[:, None] < end)
    once &= np.where(between, steps > 0.0, True).all(axis=0)
    once &= np.abs(values[[0, -1]]).min(axis=0) > _NOTHING * np.abs(values).max(axis=0)
    first, end = np.clip(first, 0, last), np.clip(end, 0, last)
    left, right = (np.take_along_axis(seen, k[None], axis=0)[0] for k in (first, end))
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.clip(np.nan_to_num(left / (left - right)), 0.0, 1.0)
    return falls, GRID[first] + share * (GRID[end] - GRID[first]), once


def _polished(
    batch: Stacked, i: int, states: FloatArray, place: Places, falls: BoolArray, at: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """The states of paths in which a margin vanishes, near places of intervals, and which are good."""
    sign = np.where(falls, 1.0, -1.0)
    weights = 1.0 / batch.scales(at.size) ** 2
    chord = states[:, -1] - states[:, 0]
    length = np.sqrt((weights * chord * chord).sum(axis=0))
    y, _, good = at_zero(
        batch,
        weights,
        (states * basis(at)).sum(axis=1),
        chord / length,
        lambda y: sign * margin(i, batch, y),
        place,
    )
    # Within the interval: forward of its start, and not beyond its end.
    ahead = (weights * chord * (y - states[:, 0])).sum(axis=0) / length**2
    return y, good & (ahead > 0.0) & (ahead < 1.0)


def flown(batch: Stacked, start: FloatArray, rest: FloatArray, low: FloatArray, high: FloatArray) -> Flown:
    """What flows do to the shapes.

    Parameters
    ----------
    batch : Stacked
    start, rest : (n_unknowns, n) arrays
        States, the drive as at rest.
    low, high : (n_balloons, n) arrays
        The smallest and largest stretches on the way, about.
    """
    shape = batch.count, rest.shape[1]
    out = Flown(np.zeros(shape, dtype=bool), np.zeros(shape, dtype=bool), np.ones(shape, dtype=bool))
    share = np.linspace(0.0, 1.0, _WITHIN)[:, None]
    for i, membrane in enumerate(batch.membranes):
        if not isinstance(membrane, ElectrodedMembrane):
            continue

        def along(first: FloatArray, last: FloatArray, i: int = i) -> FloatArray:
            states = np.repeat(rest[:, None], _WITHIN, axis=1)
            states[i] = first + share * (last - first)
            return np.asarray(margin(i, batch, states))

        out.ends_lost[i] = np.asarray(margin(i, batch, rest)) < 0.0
        # A stretch passes all values between both sides; beyond them it is not known so well.
        between = along(start[i], rest[i])
        size = np.abs(between).max(axis=0)
        out.passes[i] = between.min(axis=0) < -_NOTHING * size
        room = _AROUND * (high[i] - low[i])
        around = along(
            np.minimum(low[i], np.minimum(start[i], rest[i])) - room, np.maximum(high[i], rest[i]) + room
        )
        # Between two of them a curve is lower than both by an eighth of how much it bends.
        bends = np.abs(np.diff(around, 2, axis=0))
        lowest = np.minimum(around[1:-1] - bends, np.minimum(around[:-2], around[2:])).min(axis=0)
        out.certain[i] = out.passes[i] | (lowest > _NOTHING * size)
    return out
