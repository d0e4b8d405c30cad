"""One set of equations driven from one v to another, for many runs: along branches, and off their ends."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator.events import EventKind
from simulator.solver.batch import flow, path, shapes
from simulator.solver.batch.stacked import Stacked, arrays
from simulator.sweep.plan import AT_REST

FloatArray = NDArray[np.float64]
Index = NDArray[np.int64]

GAVE_UP, THERE = -1, 0  # then 1 + the place in `ENDS`
ENDS = (EventKind.LOSS_OF_TENSION, EventKind.BREAKDOWN, EventKind.RUNAWAY, EventKind.OUT_OF_RANGE)
_WITH_A_SIDE = [1 + ENDS.index(kind) for kind in (EventKind.BREAKDOWN, EventKind.OUT_OF_RANGE)]
_MOST_TURNS = 20


@dataclass(frozen=True)
class Turn:
    """Limit points that some runs met, and the states y in which the snaps from there rested or ended."""

    runs: Index
    before: FloatArray
    after: FloatArray
    rested: NDArray[np.bool_]
    dissipated: FloatArray


@dataclass(frozen=True)
class Flight:
    """What the flows of some runs (n,) do to their balloons' shapes.

    `v` is the drive, and `lands` whether each is a snap with a side after it.
    """

    runs: Index
    flown: shapes.Flown
    v: FloatArray
    lands: NDArray[np.bool_]


@dataclass
class Ride:
    """How n runs went.

    Attributes
    ----------
    states : (n_unknowns, n) array
        At the end.
    end : (n,) array
        GAVE_UP, THERE, or 1 + the place of the event in `ENDS`.
    snapped : (n,) array of bool
        Whether a snap ended so, not the path.
    turns : list of Turn
        In order for each run.
    work, defect, exchanged : (n,) arrays
    largest, largest_field, least : (n_balloons, n) arrays
        `least` is the margin s of sphericity, where that is watched.
    changes : list of Crossings or Flight
        Of shapes, where they are watched; in order for each run.
    """

    states: FloatArray
    end: Index
    snapped: NDArray[np.bool_]
    work: FloatArray
    defect: FloatArray
    exchanged: FloatArray
    largest: FloatArray
    largest_field: FloatArray
    least: FloatArray
    turns: list[Turn] = field(default_factory=list)
    changes: list[shapes.Crossings | Flight] = field(default_factory=list)

    @classmethod
    def at(cls, batch: Stacked, start: FloatArray) -> Ride:
        """One that has not begun."""
        runs = start.shape[1]
        return cls(
            start.copy(), np.full(runs, THERE), np.zeros(runs, dtype=bool),
            np.zeros(runs), np.zeros(runs), np.zeros(runs), start[: batch.count].copy(),
            np.abs(path.fields(batch, start)),
            shapes.least(batch, start) if batch.watched else np.full((batch.count, runs), np.inf),
        )  # fmt: skip


def drive(batch: Stacked, start: FloatArray, target: FloatArray, times: float | None = None) -> Ride:
    """Drive n runs from their states to target values of v.

    Parameters
    ----------
    batch : Stacked
    start : (n_unknowns, n) array
    target : (n,) array
    times : float, optional
        Where given, the target is moved, at the first limit point of a run, so many times as far.
    """
    runs = start.shape[1]
    sense = np.where(target >= start[-1], 1.0, -1.0)
    target = target.copy()
    out = Ride.at(batch, start)
    left = np.flatnonzero(target != start[-1])
    for turn in range(_MOST_TURNS):
        if not left.size:
            return out
        some = batch.take(left) if left.size < runs else batch
        passed = path.follow(some, out.states[:, left], sense[left], target[left])
        out.states[:, left] = passed.states
        out.work[left] += passed.work
        out.defect[left] += passed.defect
        out.exchanged[left] += passed.exchanged
        out.largest[:, left] = np.maximum(out.largest[:, left], passed.largest)
        out.largest_field[:, left] = np.maximum(out.largest_field[:, left], passed.largest_field)
        out.least[:, left] = np.minimum(out.least[:, left], passed.least)
        out.changes += [one._replace(runs=left[one.runs]) for one in passed.crossings]
        _ended(some, out, left, passed.end - 2, passed.end < 0, passed.end >= 2)
        turned = np.flatnonzero(passed.end == path.TURNED)
        left = left[turned]
        if times is not None and turn == 0:
            target[left] = start[-1, left] + times * (out.states[-1, left] - start[-1, left])
        left = _snap(some.take(turned), out, left, passed.tangents[: batch.count, turned])
        # On to the target, if the limit point was not there.
        left = left[sense[left] * (target[left] - out.states[-1, left]) > 0.0]
    out.end[left] = GAVE_UP
    return out


def drive_each_once(batch: Stacked, start: FloatArray, target: FloatArray) -> Ride:
    """As `drive`; of runs that are equal in all that matters only one is played."""
    runs = target.size
    columns = [c for c in arrays((batch.equations, batch.strengths)) if c.shape == (runs,)]
    rows = np.column_stack([*columns, *start, target])
    rows = np.ascontiguousarray(rows[:, np.any(rows != rows[:1], axis=0)])
    if not rows.shape[1]:
        rows = np.zeros((runs, 1))
    # Compared as bytes, which is much faster than number by number.
    as_bytes = rows.view(np.dtype((np.void, rows.dtype.itemsize * rows.shape[1]))).ravel()
    _, first, inverse = np.unique(as_bytes, return_index=True, return_inverse=True)
    if first.size > 0.7 * runs:
        return drive(batch, start, target)
    ride = drive(batch.take(first), start[:, first], target[first])
    out = Ride(
        *(getattr(ride, f.name)[..., inverse] for f in fields(Ride) if f.name not in ("turns", "changes"))
    )
    order = np.argsort(inverse, kind="stable")
    counts = np.bincount(inverse, minlength=first.size)
    begins = np.concatenate([[0], np.cumsum(counts)])
    for turn in ride.turns:
        here = np.repeat(np.arange(turn.runs.size), counts[turn.runs])
        runs_of = [order[begins[k] : begins[k + 1]] for k in turn.runs.tolist()]
        index = np.concatenate(runs_of) if runs_of else np.zeros(0, dtype=int)
        out.turns.append(
            Turn(index, turn.before[:, here], turn.after[:, here], turn.rested[here], turn.dissipated[here])
        )
    return out


def _snap(batch: Stacked, out: Ride, left: Index, ahead: FloatArray) -> Index:
    """Let runs snap from the limit points they are at; return those that came to rest."""
    before = out.states[:, left].copy()
    rests = flow.snap(batch, before, ahead)
    settle(batch, out, left, before, rests)
    rested = rests.end == flow.RESTED
    return np.asarray(left[rested])


def settle(batch: Stacked, out: Ride, left: Index, before: FloatArray, rests: flow.Rests) -> None:
    """Note where flows from some states ended."""
    rested = rests.end == flow.RESTED
    _ended(batch, out, left, rests.end - 1, rests.end < 0, rests.end >= 1)
    energy = batch.equations.potential
    lost = np.asarray(energy(before)) - np.asarray(energy(rests.states))
    out.snapped[left[rests.end >= 1]] = True
    # A flow without an end has no side after it.
    runaway = np.array([False, *(m.kind == EventKind.RUNAWAY for m in batch.margins)])
    kept = ~runaway[np.maximum(rests.end, 0)]
    out.states[:, left] = np.where(kept, rests.states, before)
    lost = np.where(kept, lost, 0.0)
    fields = np.abs(path.fields(batch, rests.states))
    out.largest[:, left] = np.maximum(out.largest[:, left], np.where(kept, rests.largest, 0.0))
    out.largest_field[:, left] = np.maximum(out.largest_field[:, left], np.where(kept, fields, 0.0))
    out.turns.append(Turn(left, before, rests.states, rested, lost))
    if batch.watched:
        out.least[:, left] = np.minimum(
            out.least[:, left], np.where(kept, shapes.least(batch, rests.states), np.inf)
        )
        flown = shapes.flown(batch, before, rests.states, rests.low, rests.high)
        landed = lands(out.turns[-1], out.end[left], batch.count)
        going = np.flatnonzero(kept & (rests.end >= 0))
        flown = shapes.Flown(*(part[:, going] for part in flown))
        out.changes.append(Flight(left[going], flown, before[-1, going], landed[going]))


def lands(turn: Turn, end: Index, count: int) -> NDArray[np.bool_]:
    """Which snaps, of runs of so many balloons that end so, lead elsewhere and have a side after them."""
    moved = np.abs(turn.after[:count] - turn.before[:count]).max(axis=0) > AT_REST
    return np.asarray(moved & arrived(turn, end))


def arrived(turn: Turn, end: Index) -> NDArray[np.bool_]:
    """Which snaps have a side after them: where a film breaks on the way, not where tension is lost."""
    return np.asarray(turn.rested | np.isin(end, _WITH_A_SIDE))


def _ended(batch: Stacked, out: Ride, runs: Index, place: Any, lost: Any, ended: Any) -> None:
    out.end[runs[lost]] = GAVE_UP
    for which, margin in enumerate(batch.margins):
        out.end[runs[ended & (place == which)]] = 1 + ENDS.index(margin.kind)
