"""The stretch–voltage loop as lines and arrows: what is drawn of a path that is passed again and again.

Throughout, `x` and `y` are the (n,) samples in the numbers of the axes, `branch` their (n,) branches, and
`spans` the width and height of the panel, (2,). Points closer than 1/1000 of it are one point, `GRID`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from simulator.results.history import FloatArray, History

    BoolArray = NDArray[np.bool_]
    IntArray = NDArray[np.int64]
    Point = tuple[float, float]

MOST_ARROWS = 8
_SHORTEST_RUN = 0.15  # of the panel: a way in one direction that has an arrow
_PHASES = 201  # of a cycle, at which it is compared with another
_ALIKE = 0.005  # of the panel: cycles that differ by less look alike
GRID = 1000  # a loop's points closer than 1/1000 of its height or width are one point


def polyline(x: FloatArray, y: FloatArray, drawn: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Points of a line that is broken (by NaN) where the segment to the next point is not drawn.

    `drawn` is (n − 1,), one for each segment.
    """
    # Points with no drawn segment on either side go, so that a thousand retraced cycles cost nothing.
    kept = np.flatnonzero(np.append(drawn, False) | np.insert(drawn, 0, False))
    joined = drawn[kept[:-1]] & (np.diff(kept) == 1)
    breaks = np.flatnonzero(~joined) + 1
    return np.insert(x[kept], breaks, np.nan), np.insert(y[kept], breaks, np.nan)


def moving(x: FloatArray, y: FloatArray, branch: IntArray, spans: FloatArray) -> BoolArray:
    """Which samples are somewhere else than the one before, or an end of a branch, (n,)."""
    places = cells(x, y, spans)
    jumps = np.diff(branch) != 0
    moved = np.any(np.diff(places, axis=0) != 0, axis=1) | jumps
    return np.asarray(np.insert(moved, 0, True) | np.append(jumps, True))


def cells(x: FloatArray, y: FloatArray, spans: FloatArray) -> IntArray:
    """The places of points on the grid, (n, 2)."""
    return np.round(np.column_stack([x, y]) / spans * GRID).astype(np.int64)


def first_passages(
    x: FloatArray, y: FloatArray, branch: IntArray, spans: FloatArray, among: BoolArray | None = None
) -> BoolArray:
    """Which segments, (n − 1,), are on one branch and were not passed before, to within the grid.

    `among` is (n − 1,) and says which of them are looked at, by default all.
    """
    places = cells(x, y, spans)
    looked_at = np.arange(len(places) - 1) if among is None else np.flatnonzero(among)
    first = np.zeros(max(len(places) - 1, 0), dtype=bool)
    if looked_at.size:
        across = places - places.min(axis=0)
        wide = int(across.max()) + 1  # about GRID: four of them make one number
        place = across[:, 0] * wide + across[:, 1]
        steps = place[looked_at] * (wide * wide) + place[looked_at + 1]
        first[looked_at[np.unique(steps, return_index=True)[1]]] = True
    same_branch = np.diff(branch) == 0
    return np.asarray(first & same_branch)


def told_apart(history: History, x: FloatArray, y: FloatArray, spans: FloatArray) -> tuple[int, int] | None:
    """The first and the last complete cycle, where they do not look alike; None where they do.

    They are compared at equal shares of their time, but for the few at which one of them jumps.
    """
    whole = [cycle for cycle in history.cycles if cycle.complete]
    if len(whole) < 2:
        return None
    shares = np.linspace(0.0, 1.0, _PHASES)
    first, last = (
        np.column_stack([np.interp(c.start + shares * (c.end - c.start), history.time, v) for v in (x, y)])
        for c in (whole[0], whole[-1])
    )
    apart = np.abs((last - first) / spans).max(axis=1)
    return (whole[0].number, whole[-1].number) if np.quantile(apart, 0.9) > _ALIKE else None


def travelled(x: FloatArray, y: FloatArray, drawn: BoolArray, spans: FloatArray) -> list[tuple[Point, Point]]:
    """Where to show the direction of travel: the ends of a short piece inside each long way in one direction.

    `drawn` is (n − 1,), one for each segment. At most `MOST_ARROWS` of them, the longest first.
    """
    direction = np.where(drawn, np.sign(np.diff(x)), 0)
    turns = np.flatnonzero(np.diff(direction)) + 1
    if not direction.size:
        return []
    starts, ends = np.append(0, turns), np.append(turns, direction.size)
    steps = np.hypot(np.diff(x) / spans[0], np.diff(y) / spans[1])
    upto = np.concatenate([[0.0], np.cumsum(np.where(direction, steps, 0.0))])
    lengths = upto[ends] - upto[starts]
    found = []
    for k in np.argsort(-lengths, kind="stable")[:MOST_ARROWS].tolist():
        # Past the middle, so that the arrows of a curve travelled both ways do not sit on one another.
        at = int(np.searchsorted(upto, upto[starts[k]] + 0.6 * lengths[k]))
        if lengths[k] > _SHORTEST_RUN and at > 0:
            found.append(((float(x[at - 1]), float(y[at - 1])), (float(x[at]), float(y[at]))))
    return found


def distinct_jumps(
    x: FloatArray, y: FloatArray, branch: IntArray, spans: FloatArray, first_the_drive: BoolArray
) -> list[tuple[Point, Point, Point]]:
    """The points before and after every jump that looks different, with a corner between them.

    `first_the_drive` is (n,) and says at which samples a voltage was about to jump. There, first the drive
    moves, then the state. At a given charge a snap moves both at once.
    """
    jumps: dict[tuple[int, ...], tuple[Point, Point, Point]] = {}
    for i in last_of_branches(branch):
        before, after = (float(x[i]), float(y[i])), (float(x[i + 1]), float(y[i + 1]))
        moves_first = first_the_drive[i] and before[1] != after[1] and before[0] != after[0]
        corner = (after[0], before[1]) if moves_first else before
        key = (*cell(before, spans), *cell(after, spans))
        if key[:2] != key[2:]:  # another balloon may have jumped
            jumps.setdefault(key, (before, corner, after))
    return list(jumps.values())


def cell(at: Point, spans: FloatArray) -> tuple[int, int]:
    """The place of one point on the grid."""
    return round(at[0] / spans[0] * GRID), round(at[1] / spans[1] * GRID)


def span(values: FloatArray) -> float:
    """Height or width of the panel that values need; 1 where they are constant."""
    return float(np.ptp(values)) or 1.0


def last_of_branches(branch: IntArray) -> IntArray:
    """Places of the last sample on each branch but the last."""
    return np.flatnonzero(np.diff(branch))
