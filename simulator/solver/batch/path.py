"""The equilibrium paths of many runs followed at once, each to its target or to the first event before it."""

from __future__ import annotations

from dataclasses import dataclass, field
from dataclasses import fields as fields_of
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator.model.membranes import ElectrodedMembrane
from simulator.solver.batch import shapes
from simulator.solver.batch.bordered import Bordered, pivots, softest
from simulator.solver.batch.events import at_drive, at_zero
from simulator.solver.batch.extremes import largest
from simulator.solver.batch.interval import Interval, Node, basis, interval, look, square
from simulator.solver.batch.stacked import Stacked

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Places = NDArray[np.int64]

GAVE_UP, REACHED, TURNED = -1, 0, 1  # then 2 + the place in `Stacked.margins`

_FIRST = 0.1
_LONGEST = 1.5
_SHORTEST = 1e-6
_TURN = 0.45  # by which a tangent may turn from one node to the next, about, in radians
_MISS = 0.03  # by which a step may be off where it was predicted to lead, about, over its length
_MOST_STEPS = 300
_MOST_ALIVE = 0.8
_ROUNDING = 1e-12


@dataclass
class Passage:
    """Where the paths of n runs ended, and what was seen on the way.

    Attributes
    ----------
    states, tangents : (n_unknowns, n) arrays
        At their ends.
    end : (n,) array
        GAVE_UP, REACHED, TURNED (a limit point), or 2 + the place of a margin.
    work, exchanged, defect : (n,) arrays
        ∫ −∂Π/∂v dv, its absolute value integrated, and what the potential does not agree by.
    largest : (n_balloons, n) array
        Stretches.
    largest_field : (n_balloons, n) array
        Largest true electric fields, 0 without electrodes.
    least : (n_balloons, n) array
        Smallest margins s of sphericity, where they are watched.
    uncertain : (n,) array of bool
        Whether it is left open where spheres are lost; such runs are given up.
    crossings : list of Crossings
        Where spheres are lost and regained, where that is watched.
    """

    states: FloatArray
    tangents: FloatArray
    end: NDArray[np.int64]
    work: FloatArray
    exchanged: FloatArray
    defect: FloatArray
    largest: FloatArray
    largest_field: FloatArray
    least: FloatArray
    uncertain: BoolArray
    crossings: list[shapes.Crossings] = field(default_factory=list)
    steps: int = field(default=0)


@dataclass
class _Front:
    """The runs still under way."""

    batch: Stacked
    index: NDArray[np.int64]
    weights: FloatArray
    state: FloatArray
    tangent: FloatArray
    before: FloatArray
    before_tangent: FloatArray
    last_length: FloatArray
    length: FloatArray
    sense: FloatArray
    target: FloatArray
    place: Places
    pivot: FloatArray
    others: FloatArray
    alive: BoolArray

    def take(self, keep: BoolArray) -> _Front:
        return _Front(self.batch.take(keep), *(getattr(self, name)[..., keep] for name in _FIELDS))

    def without(self, gone: BoolArray) -> _Front:
        """Without some runs; they stay as dead weight as long as they are few."""
        self.alive = self.alive & ~gone
        return self if self.alive.mean() > _MOST_ALIVE else self.take(self.alive)


_FIELDS = tuple(field.name for field in fields_of(_Front) if field.name != "batch")


def follow(batch: Stacked, start: FloatArray, sense: FloatArray, target: FloatArray) -> Passage:
    """Follow the paths of n runs from stable states.

    Parameters
    ----------
    batch : Stacked
    start : (n_unknowns, n) array
    sense, target : (n,) arrays
        Whether v rises or falls, ±1, and the v wanted.
    """
    runs = start.shape[1]
    count = batch.count
    weights = 1.0 / batch.scales(runs) ** 2
    out = Passage(
        start.copy(), np.zeros_like(start), np.full(runs, GAVE_UP), np.zeros(runs), np.zeros(runs),
        np.zeros(runs), start[:count].copy(), np.abs(fields(batch, start)), np.full((count, runs), np.inf),
        np.zeros(runs, dtype=bool),
    )  # fmt: skip
    normal = np.zeros_like(start)
    normal[-1] = sense
    with np.errstate(all="ignore"):
        parts = batch.parts(start)
        border = Bordered(parts, normal, softest(parts))
        rates = border.rates()
        tangent = rates / np.sqrt(square(weights, rates))
        fit = (border.pivot > 0.0) & (border.others > 0.0)
        fit &= np.abs(tangent[-1]) > 1e-5 / np.sqrt(weights[-1])
        for margin in batch.margins:
            fit &= np.asarray(margin.at(start)) > 0.0
        out.tangents[:] = tangent
        place = softest(parts)
        front = _Front(
            batch, np.arange(runs), weights, start, tangent, start, tangent, np.zeros(runs),
            np.full(runs, _FIRST), sense, target, place, border.pivot, border.others, fit,
        ).take(fit)  # fmt: skip
        ends: list[_Ends] = []
        for _ in range(_MOST_STEPS):
            if not front.alive.any():
                if not ends:
                    break
                # All ends together; those that are not certain are gone up to in shorter steps.
                front = _finish(batch, weights, sense, target, _Ends.joined(ends), out)
                ends = []
                continue
            front = _advance(front, out, ends)
            out.steps += 1
    out.end[out.uncertain] = GAVE_UP
    return out


def _predicted(front: _Front) -> FloatArray:
    """The states one step ahead, from the cubic through the last two nodes."""
    # Not much further than to the target, which may not be there at all.
    ahead = front.sense * (front.target - front.state[-1]) / np.maximum(front.sense * front.tangent[-1], 1e-9)
    front.length = np.minimum(front.length, np.maximum(1.1 * ahead, 1e-6))
    h, k = front.length, front.last_length
    straight = front.state + h * front.tangent
    fresh = k <= 0.0
    if fresh.all():
        return straight
    x = 1.0 + h / np.where(fresh, 1.0, k)
    chord = front.state - front.before
    m0, m1 = front.before_tangent * k, front.tangent * k
    a, b = 3.0 * chord - 2.0 * m0 - m1, m0 + m1 - 2.0 * chord
    cubic = front.before + x * (m0 + x * (a + x * b))
    return np.where(fresh | (x > 3.0), straight, cubic)


def _advance(front: _Front, out: Passage, ends: list[_Ends]) -> _Front:
    """One step of all runs under way."""
    batch, w, t0 = front.batch, front.weights, front.tangent
    guess = _predicted(front)
    normal = w * t0
    y = guess
    place = front.place
    for _ in range(3):
        border = Bordered(batch.parts(y), normal, place)
        step = border.correction()
        y = y + step
    rates = border.rates()
    t1 = rates / np.sqrt(square(w, rates))
    turn = (normal * t1).sum(axis=0)
    moved = np.sqrt(square(w, y - guess))
    fine = (square(w, step) <= 1e-11) & (turn > 0.8) & (moved < 0.3 * front.length)
    first = Node(front.state, t0, front.pivot, front.others)
    found = interval(batch, w, first, Node(y, t1, border.pivot, border.others), place)
    fine &= found.smooth
    sight = look(_with_target(found, front))
    # What is softer than the softest was not looked at.
    hidden = (sight.first == 2) & (batch.count > 1)
    fine &= ~sight.unclear & ~hidden & front.alive
    ended = fine & (sight.first >= 0)
    onward = fine & ~ended
    _note(out, batch, front.index, found, place, onward)
    if ended.any():
        ends.append(_Ends.of(front, first, found, sight.first, sight.at, place, ended))
    gone = ended | (front.alive & ~fine & (front.length < _SHORTEST))
    angle = np.arccos(np.clip(turn, -1.0, 1.0))
    missed = (moved / front.length + 1e-6) / _MISS
    growth = np.clip(np.minimum(_TURN / (angle + 0.02), missed ** (-1.0 / 3.0)), 0.4, 2.0)
    arc = np.sqrt(square(w, y - front.state)) * (1.0 + angle * angle / 24.0)
    moved_on = np.where(onward, arc, front.last_length)
    # At the node it may be another balloon that is softest.
    softer = softest(border.parts)
    pivot, others = border.pivot, border.others
    if (softer != place).any():
        pivot, others = pivots(border.parts, softer)
    return _Front(
        batch, front.index, w,
        np.where(onward, y, front.state), np.where(onward, t1, t0),
        np.where(onward, front.state, front.before), np.where(onward, t0, front.before_tangent),
        moved_on,
        np.where(onward, np.minimum(front.length * growth, _LONGEST), front.length * 0.4),
        front.sense, front.target, np.where(onward, softer, place), np.where(onward, pivot, front.pivot),
        np.where(onward, others, front.others), front.alive,
    ).without(gone)  # fmt: skip


def _with_target(found: Interval, front: _Front) -> FloatArray:
    left = front.sense * (front.target - found.states[-1])
    return np.concatenate([left[None], found.margins])


def _note(
    out: Passage, batch: Stacked, index: NDArray[np.int64], found: Interval, place: Places, which: BoolArray
) -> None:
    """Add what was seen in an interval to the runs chosen."""
    at = index[which]
    if not at.size:
        return
    out.work[at] += found.work[which]
    out.exchanged[at] += found.exchanged[which]
    out.defect[at] += found.defect[which]
    states, tangents, place = found.states[:, :, which], found.tangents[:, :, which], place[which]
    batch = batch if which.all() else batch.take(which)
    if batch.watched:
        out.least[:, at] = shapes.least_on(batch, states, tangents, place, out.least[:, at])
        crossings, certain = shapes.crossings(batch, states, place, out.steps)
        out.crossings += [one._replace(runs=at[one.runs]) for one in crossings]
        out.uncertain[at[~certain]] = True
    for i, membrane in enumerate(batch.membranes):
        out.largest[i, at] = largest(batch, partial(_stretch, i), states, tangents, place, out.largest[i, at])
        if isinstance(membrane, ElectrodedMembrane):
            square_so_far = out.largest_field[i, at] ** 2
            out.largest_field[i, at] = np.sqrt(
                largest(batch, partial(_field_squared, i), states, tangents, place, square_so_far)
            )


def _stretch(i: int, batch: Stacked, y: Any) -> Any:
    return y[i]


def _field_squared(i: int, batch: Stacked, y: Any) -> Any:
    membrane = batch.membranes[i]
    assert isinstance(membrane, ElectrodedMembrane)
    return membrane.field(y[i], y[-1]) ** 2


@dataclass
class _Ends:
    """Intervals in which something ends the paths of some runs: what (0 the target), and where about."""

    index: NDArray[np.int64]
    first: Node
    states: FloatArray
    event: Places
    at: FloatArray
    place: Places
    length: FloatArray

    @classmethod
    def of(
        cls, front: _Front, first: Node, found: Interval, event: Places, at: FloatArray, place: Places,
        which: BoolArray,
    ) -> _Ends:  # fmt: skip
        return cls(
            front.index[which], Node(*(part[..., which] for part in first)), found.states[:, :, which],
            event[which], at[which], place[which], front.length[which],
        )  # fmt: skip

    @classmethod
    def joined(cls, ends: list[_Ends]) -> _Ends:
        def join(parts: list[NDArray[Any]]) -> NDArray[Any]:
            return np.concatenate(parts, axis=-1)

        return cls(
            join([e.index for e in ends]),
            Node(*(join(list(parts)) for parts in zip(*(e.first for e in ends), strict=True))),
            *(
                join([getattr(e, name) for e in ends])
                for name in ("states", "event", "at", "place", "length")
            ),
        )


def _finish(
    batch: Stacked, weights: FloatArray, sense: FloatArray, target: FloatArray, ends: _Ends, out: Passage
) -> _Front:
    """Polish the ends of some runs, look at the way there again, and note it; return the uncertain ones."""
    others = 1 if batch.count > 1 else 0
    settled = np.zeros(ends.index.size, dtype=bool)
    guesses = (ends.states * basis(ends.at)).sum(axis=1)
    for which in np.unique(ends.event).tolist():
        mine = np.flatnonzero(ends.event == which)
        runs = ends.index[mine]
        part, w = batch.take(runs), weights[:, runs]
        left = target[runs], sense[runs]
        soft, guess = ends.place[mine], guesses[:, mine]
        first = Node(*(p[..., mine] for p in ends.first))
        if which == 0:
            y, _, good = at_drive(part, w, guess, left[0], soft)
            border = Bordered(part.parts(y), w * first.tangent, soft)
            rates = border.rates()
            t = rates / np.sqrt(square(w, rates))
            last, code = Node(y, t, border.pivot, border.others), REACHED
            good &= last.pivot > 0.0
        else:
            margin = None if which == 1 else part.margins[which - 2 - others].at
            y, t, good = at_zero(part, w, guess, first.tangent, margin, soft)
            last, code = Node(y, t, *pivots(part.parts(y), soft)), which if which == 1 else which - others
            good &= left[1] * (left[0] - y[-1]) > 0.0
            good &= (which == 1) | (last.pivot > 0.0)
        good &= last.others > 0.0
        for other in part.margins:
            good &= np.asarray(other.at(y)) > -_ROUNDING
        good &= square(w, y - guess) <= 0.25 * square(w, ends.states[:, -1, mine] - first.state)
        way = interval(part, w, first, last, soft)
        good &= way.smooth & (way.margins[:, :-1] > 0.0).all(axis=(0, 1))
        _note(out, part, runs, way, soft, good)
        done = runs[good]
        out.states[:, done], out.tangents[:, done], out.end[done] = y[:, good], t[:, good], code
        settled[mine] = good
    again = np.flatnonzero(~settled & (ends.length > _SHORTEST))
    index, state, tangent = ends.index[again], ends.first.state[:, again], ends.first.tangent[:, again]
    return _Front(
        batch.take(index), index, weights[:, index], state, tangent, state, tangent, np.zeros(again.size),
        0.35 * ends.length[again], sense[index], target[index], ends.place[again],
        ends.first.pivot[again], ends.first.others[again], np.ones(again.size, dtype=bool),
    )  # fmt: skip


def fields(batch: Stacked, y: FloatArray) -> FloatArray:
    """True electric fields, (n_balloons, …, n_runs), 0 where there are no electrodes."""
    out = np.zeros((batch.count, *y.shape[1:]))
    for i, membrane in enumerate(batch.membranes):
        if isinstance(membrane, ElectrodedMembrane):
            out[i] = membrane.field(y[i], y[-1])
    return out
