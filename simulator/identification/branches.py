"""A history cut into branches on which one quantity is a function of another, and rows compared with them.

A history jumps, and a measured curve does. A row of it lies on one side of the jump or on the other, never in
between. So the history is cut at its jumps, at the ends of its steps and where x turns round. Which row
belongs to which branch is decided for all rows of a file together: in their order they may go on from a
branch to a later one, not back, and of all such ways the one with the least squares counts. That sum is a
continuous function of the numbers that are sought, wherever the model has its jump.

A row that lies beyond the end of its branch, because the model jumps at another place than the device did,
has nothing to be compared with. It is compared with a line that leans from there to the other side. So rows
pull the jump to where it was measured, and none of them is compared with a state in between. Where the model
jumps between the same rows as the device, there are no such rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_STILL = 1e-12  # of the whole range of x: a smaller change is none
_HALVINGS = 48  # of an interval between two samples
_LEAN = 3.0  # slope beyond the end of a branch, over that of the measured values as a whole
_IN_RANGE = 1e-9  # of the range of x: a row so far outside is inside


@dataclass(frozen=True)
class Branch:
    """A part of a history on which x rises or falls.

    Attributes
    ----------
    x : (n,) array
    y : (n, n_y) array
    step : int
    movement : int
        Which uninterrupted movement of x it belongs to: branches before and behind a jump share one.
    smooth : bool
        Whether it is smooth; else it has the corners of a table, and is taken as straight between samples.
    jumps : (bool, bool)
        Whether a jump leads to its start, and another one away from its end.
    """

    x: FloatArray
    y: FloatArray
    step: int
    movement: int
    smooth: bool
    jumps: tuple[bool, bool]

    @cached_property
    def _spline(self) -> tuple[FloatArray, Any]:
        """The length along the curve at each sample, and (x, y) as a function of it.

        At a limit point y is no smooth function of x, but both are of the length.
        """
        from scipy.interpolate import CubicSpline, make_interp_spline

        together = np.column_stack([self.x, self.y])
        sizes = np.ptp(together, axis=0)
        chords = np.diff(together / np.where(sizes > 0.0, sizes, 1.0), axis=0)
        length = np.concatenate([[0.0], np.cumsum(np.sqrt(np.einsum("ij,ij->i", chords, chords)))])
        if self.smooth and length.size > 3:
            return length, CubicSpline(length, together)
        return length, make_interp_spline(length, together, k=1)

    def at(self, x: FloatArray, lean: FloatArray) -> tuple[FloatArray, BoolArray]:
        """The values at some x, and whether these are beyond its ends.

        Parameters
        ----------
        x : (n,) array
        lean : (n_y,) array
            The slope of the line beyond a jump, by its amount; beyond other ends the branch goes on straight.

        Returns
        -------
        (n, n_y) array, (n,) array of bool
        """
        length, spline = self._spline
        way = 1.0 if self.x[-1] > self.x[0] else -1.0
        place = np.clip(np.searchsorted(way * self.x, way * x) - 1, 0, self.x.size - 2)
        low, high = length[place], length[place + 1]
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            short = way * (spline(middle)[:, 0] - x) < 0.0
            low, high = np.where(short, middle, low), np.where(short, high, middle)
        values = np.asarray(spline(0.5 * (low + high))[:, 1:])
        before, behind = way * (x - self.x[0]) < 0.0, way * (x - self.x[-1]) > 0.0
        for outside, end in ((before, 0), (behind, -1)):
            if outside.any():
                values[outside] = self.y[end] + (x[outside, None] - self.x[end]) * self._slope(end, lean)
        span = _IN_RANGE * abs(self.x[-1] - self.x[0])
        return values, (way * (x - self.x[0]) < -span) | (way * (x - self.x[-1]) > span)

    def _slope(self, end: int, lean: FloatArray) -> FloatArray:
        """dy/dx of the line beyond an end; beyond a jump it has the sign of the slope there."""
        first, second = (0, 1) if end == 0 else (-2, -1)
        run = self.x[second] - self.x[first]
        slope = (self.y[second] - self.y[first]) / (run if run else 1.0)
        return np.asarray(np.where(slope < 0.0, -lean, lean) if self.jumps[end] else slope)


def branches(
    x: FloatArray,
    y: FloatArray,
    step: IntArray,
    branch: IntArray,
    *,
    broken: bool,
    cornered: Sequence[int] = (),
) -> tuple[Branch, ...]:
    """The branches of a history on which y is a function of x, in order.

    Parameters
    ----------
    x : (n_samples,) array
    y : (n_samples, n_y) array
    step, branch : (n_samples,) arrays
        As in a `History`.
    broken : bool
        Whether the history ended before all steps were played.
    cornered : sequence of int
        The steps whose drive has corners.
    """
    found: list[Branch] = []
    movement, last_way, last_step = -1, 0, 0
    least = _STILL * float(np.ptp(x)) if x.size else 0.0
    cuts = np.flatnonzero((np.diff(step) != 0) | (np.diff(branch) != 0)) + 1
    for start, stop in zip([0, *cuts], [*cuts, x.size], strict=True):
        # A step begins where the last one ended, unless it begins with a jump.
        first = start - 1 if start and branch[start] == branch[start - 1] else start
        for part, way in _monotone(x[first:stop], least):
            here = np.arange(first, stop)[part]
            if (way, int(step[start])) != (last_way, last_step):
                movement += 1
            last_way, last_step = way, int(step[start])
            jumps = (_differ(branch, first - 1) and here[0] == first, here[-1] == stop - 1)
            ends = jumps[1] and (broken if stop == x.size else _differ(branch, stop - 1))
            smooth = last_step not in cornered
            found.append(Branch(x[here], y[here], last_step, movement, smooth, (jumps[0], ends)))
    return tuple(found)


def _differ(branch: IntArray, place: int) -> bool:
    """Whether a jump leads from a sample to the next one."""
    return place >= 0 and bool(branch[place] != branch[place + 1])


def _monotone(x: FloatArray, least: float) -> list[tuple[slice, int]]:
    """The parts of a row of numbers that rise or fall, each with 1 or −1."""
    ways = np.sign(np.where(np.abs(np.diff(x)) > least, np.diff(x), 0.0)).astype(int)
    edges = np.flatnonzero(np.diff(ways)) + 1
    parts = zip([0, *edges], [*edges, ways.size], strict=True)
    return [(slice(a, b + 1), int(ways[a])) for a, b in parts if b > a and ways[a]]


@dataclass(frozen=True)
class Compared:
    """What the rows of a file are compared with.

    Attributes
    ----------
    values : (n_rows, n_y) array
    branch : (n_rows,) array
        The place of each row's branch.
    beyond : (n_rows,) array of bool
        Whether a row lies beyond the end of its branch.
    """

    values: FloatArray
    branch: IntArray
    beyond: BoolArray


def compare(found: Sequence[Branch], at: FloatArray, measured: FloatArray, weight: FloatArray) -> Compared:
    """Compare the rows of a file with the branches of a history.

    Parameters
    ----------
    found : sequence of Branch
        One or more.
    at : (n_rows,) array
        The measured x.
    measured : (n_rows, n_y) array
    weight : (n_y,) array
        What residuals are multiplied by.
    """
    slope = lean(at, measured)
    values, beyond = (np.array(part) for part in zip(*(b.at(at, slope) for b in found), strict=True))
    if len(found) == 1:
        return Compared(values[0], np.zeros(at.size, dtype=np.int64), beyond[0])
    cost = np.einsum("brk,k->rb", (values - measured) ** 2, weight**2)
    cost[~_allowed(found, at)] = np.inf
    rows = np.arange(at.size)
    chosen = _in_order(cost)
    if found[0].movement == found[-1].movement:
        # One movement may also have been written in another order than that of time.
        order = np.argsort(at if found[0].x[-1] > found[0].x[0] else -at, kind="stable")
        other = np.empty_like(chosen)
        other[order] = _in_order(cost[order])
        chosen = min((chosen, other), key=lambda places: float(cost[rows, places].sum()))
    return Compared(values[chosen, rows], chosen, beyond[chosen, rows])


def lean(at: FloatArray, measured: FloatArray) -> FloatArray:
    """The slope beyond the ends of branches, (n_y,), by its amount."""
    return np.asarray(_LEAN * np.ptp(measured, axis=0) / np.ptp(at))


def _allowed(found: Sequence[Branch], at: FloatArray) -> BoolArray:
    """Which rows may lie on which branches, (n_rows, n_branches): x passes there in that movement.

    Where it passes nowhere, on those that come nearest.
    """
    low, high = np.empty((2, len(found)))
    for place, branch in enumerate(found):
        ends = [x for one in found if one.movement == branch.movement for x in (one.x[0], one.x[-1])]
        low[place], high[place] = min(ends), max(ends)
    off = np.maximum(np.maximum(low - at[:, None], at[:, None] - high), 0.0)
    return np.asarray(off <= off.min(axis=1, keepdims=True) + _IN_RANGE * float(np.ptp(at)))


def _in_order(cost: FloatArray) -> IntArray:
    """The branch of each row with the least cost in all, none before that of the row before it."""
    total, came = cost[0], np.empty(cost.shape, dtype=np.int64)
    for row in range(1, len(cost)):
        best = np.minimum.accumulate(total)
        places = np.where(total == best, np.arange(total.size), 0)
        came[row] = np.maximum.accumulate(places)
        total = best + cost[row]
    chosen = np.empty(len(cost), dtype=np.int64)
    chosen[-1] = int(np.argmin(total))
    for row in range(len(cost) - 1, 0, -1):
        chosen[row - 1] = came[row, chosen[row]]
    if not np.isfinite(total[chosen[-1]]):
        # No order of branches fits the rows, as where they are not in order of time: each by itself.
        return np.asarray(np.argmin(cost, axis=1))
    return chosen
