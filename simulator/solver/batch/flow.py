"""The overdamped flow dλᵢ/dt = −gᵢ at a frozen drive, of many runs at once: where snaps come to rest or end.

A flow forgets where it began: what is off the trajectory decays at the rates of all directions but its own.
So it is integrated loosely first, by a Rosenbrock method that does not mind stiffness, to see where it goes.
A landing is then Newton's. Where the flow ends on its way, that state depends on the trajectory: its last
part is integrated once more, see `tight`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator.events import EventKind
from simulator.model.conditions import COMPLEX_STEP
from simulator.model.equations import SealedBalloons
from simulator.model.liquid import Liquid
from simulator.solver.batch import tight
from simulator.solver.batch.bordered import Bordered, softest
from simulator.solver.batch.events import at_drive
from simulator.solver.batch.interval import square
from simulator.solver.batch.motion import Jacobian, Trail, full_state, is_possible, margins_at, rates_at
from simulator.solver.batch.stacked import Parts, Stacked

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

GAVE_UP, RESTED = -1, 0  # then 1 + the place in `Stacked.margins`

_FAR_OFF = 1e-2  # stretch by which a snap is started off its limit point
_OFF = 1e-4  # the same where it must be as `solver.flow` starts it: little is forgotten on the way
_LOOSE = 3e-2  # of a loose step, in stretch: what a method of first order would be off
_MOST_STEPS = 120
_NEAR = 0.05  # how far a Newton step may lead for Newton's method to take over
_LINGERS = 1e-3  # over the largest speed so far: a flow this slow that grows faster again passed a saddle
_GRAZES = 0.02  # a margin that comes as close to zero on the way may be passed by a tight flow
_GROWS = 1.0  # e-folds by which anything off the trajectory may grow in a loose step
_MOST_ALIVE = 0.8
_ROUNDING = 1e-12  # of a potential
_GAMMA = 1.0 - 0.5 * 2.0**0.5


@dataclass
class Rests:
    """Where the flows of n runs ended: states (n_unknowns, n), and how; see `GAVE_UP`.

    `low` and `high` (n_balloons, n) are the smallest and largest stretches on the way, loosely.
    """

    states: FloatArray
    end: NDArray[np.int64]
    largest: FloatArray
    low: FloatArray
    high: FloatArray

    @classmethod
    def given_up(cls, origin: FloatArray, count: int) -> Rests:
        """Flows from states that lead nowhere yet, of so many balloons."""
        x = origin[:count]
        return cls(origin.copy(), np.full(origin.shape[1], GAVE_UP), x.copy(), x.copy(), x.copy())


@dataclass
class _Front:
    """The flows still under way.

    `memory` is how much they have forgotten since they began, in e-folds, up to the last step; that one took
    the time `span`, and began with the rate `fade`.
    """

    batch: Stacked
    index: NDArray[np.int64]
    weights: FloatArray
    x: FloatArray
    v: FloatArray
    h: FloatArray
    memory: FloatArray
    span: FloatArray
    fade: FloatArray
    fastest: FloatArray
    slowest: FloatArray
    closest: FloatArray
    alive: BoolArray

    def take(self, keep: BoolArray | NDArray[np.int64]) -> _Front:
        return _Front(self.batch.take(keep), *(getattr(self, name)[..., keep] for name in _FIELDS))

    def without(self, gone: BoolArray) -> _Front:
        """Without some runs; they stay as dead weight as long as they are few."""
        self.alive = self.alive & ~gone
        return self if self.alive.mean() > _MOST_ALIVE else self.take(self.alive)


_FIELDS = tuple(field.name for field in fields(_Front) if field.name != "batch")


def snap(batch: Stacked, fold: FloatArray, ahead: FloatArray) -> Rests:
    """Where the states of n runs go from polished limit points.

    Parameters
    ----------
    batch : Stacked
    fold : (n_unknowns, n) array
    ahead : (n_balloons, n) array
        How the stretches change along the path there.
    """
    escape = ahead / np.sqrt((ahead * ahead).sum(axis=0))
    out = Rests.given_up(fold, batch.count)
    left = np.arange(fold.shape[1] if _is_covered(batch) else 0)
    for off in (_FAR_OFF, _OFF):
        if not left.size:
            break
        some, point, way = batch.take(left), fold[:, left], escape[:, left]
        with np.errstate(all="ignore"):
            found = _flow(some, point, point[: batch.count] + off * way, way, off)
            _give_up_what_rises(some, point, found)
        out.states[:, left], out.end[left], out.largest[:, left] = found.states, found.end, found.largest
        out.low[:, left], out.high[:, left] = found.low, found.high
        left = left[found.end == GAVE_UP]
    return out


def relax(batch: Stacked, start: FloatArray) -> Rests:
    """Where states (n_unknowns, n) that are no equilibria go."""
    if not _is_covered(batch):
        return Rests.given_up(start, batch.count)
    with np.errstate(all="ignore"):
        found = _flow(batch, start, start[: batch.count], None, 0.0)
        margins = margins_at(batch, start)
        if len(margins):
            # Broken as it begins.
            broken = margins.min(axis=0) <= 0.0
            found.end[broken] = 1 + np.argmin(margins, axis=0)[broken]
        _give_up_what_rises(batch, start, found)
    return found


def _give_up_what_rises(batch: Stacked, start: FloatArray, found: Rests) -> None:
    """A gradient flow only loses potential. What gains some, or has none, is not where the flow leads."""
    first, last = (np.asarray(batch.equations.potential(list(y))) for y in (start, found.states))
    found.end[~(first - last >= -_ROUNDING * np.abs(first))] = GAVE_UP


def _is_covered(batch: Stacked) -> bool:
    """A liquid's pressure in motion is not that of its law."""
    return not (isinstance(batch.equations, SealedBalloons) and isinstance(batch.equations.gas, Liquid))


def _flow(batch: Stacked, origin: FloatArray, x: FloatArray, escape: FloatArray | None, off: float) -> Rests:
    """Where the flow from stretches x goes, at the drive of states that it began in.

    `escape` is the direction in which it must lead on, `off` how far along it x is from `origin`.
    """
    count, runs = batch.count, origin.shape[1]
    out = Rests.given_up(origin, count)
    v = origin[-1]
    y = full_state(batch, x, v)
    flow = Jacobian(batch, y, batch.parts(y))
    speed = np.sqrt((flow.rates**2).sum(axis=0))
    closest = margins_at(batch, y)
    fit = (closest > 0.0).all(axis=0) & np.isfinite(speed)
    if escape is not None:
        # Downhill all the way there: closer structure would be stepped over.
        for share in (0.1, 0.3, 1.0):
            between = full_state(batch, origin[:count] + share * (x - origin[:count]), v)
            fit &= (flow.pull * rates_at(batch, between) * escape).sum(axis=0) > 0.0
    away = 0.0 if escape is None else np.sqrt(((x - origin[:count]) ** 2).sum(axis=0)) * 0.999
    weights = 1.0 / batch.scales(runs) ** 2
    nothing = np.zeros(runs)
    first = 0.5 * off / speed if off else np.minimum(0.01 / speed, 0.1)
    front = _Front(
        batch, np.arange(runs), weights, x, v, first, nothing, nothing, nothing, speed, speed, closest, fit
    ).take(fit)  # fmt: skip
    trail = Trail([], [], [])
    ends: list[NDArray[np.int64]] = []
    for _ in range(_MOST_STEPS):
        if not front.alive.any():
            break
        front = _loosely(front, origin, away, out, trail, ends)
    if ends:
        for found in tight.ends(batch, v, np.concatenate(ends), trail, exact=off <= _OFF):
            out.states[:, found.runs], out.end[found.runs] = found.states, 1 + found.margin
            out.largest[:, found.runs] = np.maximum(out.largest[:, found.runs], found.states[:count])
    if batch.watched and trail.states:
        passed = np.array(trail.states)
        out.low = np.fmin(out.low, np.fmin.reduce(passed))
        out.high = np.fmax(out.high, np.fmax.reduce(passed))
    return out


def _loosely(
    front: _Front,
    fold: FloatArray,
    away: Any,
    out: Rests,
    trail: Trail,
    ends: list[NDArray[np.int64]],
) -> _Front:
    """One loose step, from states that are looked at first: may they land, have they ended?"""
    batch, v, x, h = front.batch, front.v, front.x, front.h
    y = full_state(batch, x, v)
    parts = batch.parts(y)
    flow = Jacobian(batch, y, parts)
    margins = margins_at(batch, y)
    ended = (margins <= 0.0).any(axis=0) & front.alive
    front.closest = np.minimum(front.closest, margins)
    landed = _landed(front, y, parts, front.alive & ~ended, fold, away, out)
    speed = np.sqrt((flow.rates**2).sum(axis=0))
    fastest = np.maximum(front.fastest, speed)
    slowest = np.where(speed >= fastest, speed, np.minimum(front.slowest, speed))
    lingered = (slowest < _LINGERS * fastest) & (speed > 10.0 * slowest)
    count, runs = len(x), out.states.shape[1]
    fade = flow.forgets()
    memory = front.memory + front.span * np.minimum(front.fade, fade)
    trail.states.append(np.full((count, runs), np.nan))
    trail.memory.append(np.full(runs, np.inf))
    trail.margin.append(np.full(runs, np.nan))
    going = front.alive
    here = front.index[going]
    trail.states[-1][:, here], trail.memory[-1][here] = x[:, going], memory[going]
    if len(margins):
        trail.margin[-1][here] = margins.min(axis=0)[going]
    if ended.any():
        # How a flow without an end goes is not asked for.
        endless = [place for place, m in enumerate(batch.margins) if m.kind == EventKind.RUNAWAY]
        first = np.argmin(margins, axis=0)
        away_for_good = ended & np.isin(first, endless)
        out.end[front.index[away_for_good]] = 1 + first[away_for_good]
        out.states[:, front.index[away_for_good]] = y[:, away_for_good]
        on_the_way = ended & ~away_for_good
        ends.append(front.index[on_the_way])
    # An implicit method takes what grows much within a step for what decays, and turns it round.
    h = np.minimum(h, _GROWS / np.maximum(-flow.softest(), 1e-300))
    solve = flow.solver(_GAMMA * h)
    first = solve(flow.rates)
    second = solve(rates_at(batch, full_state(batch, x + h * first, v)) - 2.0 * first)
    new = x + h * (1.5 * first + 0.5 * second)
    error = np.sqrt(((0.5 * h * (first + second) / (0.5 + 0.5 * x)) ** 2).sum(axis=0)) / _LOOSE
    fine = (error <= 1.0) & is_possible(batch, new)
    growth = np.clip(0.75 / np.sqrt(np.maximum(error, 1e-4)), 0.2, 1.5)
    gone = ended | lingered | (h * fastest <= 1e-12)
    gone[landed] = True
    return _Front(
        batch, front.index, front.weights, np.where(fine, new, x), v,
        h * np.where(fine, growth, np.where(np.isfinite(error), np.minimum(growth, 0.5), 0.2)),
        memory, np.where(fine, h, 0.0), fade, fastest, slowest, front.closest, front.alive,
    ).without(gone)  # fmt: skip


def _landed(
    front: _Front, y: FloatArray, parts: Parts, which: BoolArray, fold: FloatArray, away: Any, out: Rests
) -> NDArray[np.int64]:
    """The runs whose flows are certain to come to rest beside where they are; their rests are noted."""
    batch = front.batch
    place = softest(parts)
    normal = np.zeros_like(y)
    normal[-1] = 1.0
    border = Bordered(parts, normal, place)
    stable = which & (border.pivot > 0.0) & (border.others > 0.0)
    step = border.correction()
    step[-1] = 0.0
    near = np.flatnonzero(stable & (np.sqrt(square(front.weights, step)) < _NEAR))
    if not near.size:
        return near
    some, w = batch.take(near), front.weights[:, near]
    rest, _, good = at_drive(some, w, y[:, near] + step[:, near], front.v[near], place[near])
    change = rest - y[:, near]
    good &= np.sqrt(w * change * change).max(axis=0) <= 2.0 * _NEAR
    for share in (0.5, 1.0):
        between = some.parts(y[:, near] + share * change)
        soft = softest(between)
        found = Bordered(between, normal[:, near], soft)
        good &= (found.pivot > 0.0) & (found.others > 0.0)
    index = front.index[near]
    way = (rest - fold[:, index])[: batch.count]
    good &= np.sqrt((way * way).sum(axis=0)) >= np.broadcast_to(away, fold[-1].shape)[index]
    # No margin can fall to zero on the way, whatever way it is.
    law = found.parts
    for margin, closest in zip(some.margins, front.closest[:, near], strict=True):
        least = np.minimum(np.asarray(margin.at(y[:, near])), np.asarray(margin.at(rest)))
        good &= least > 0.0
        good &= least >= 2.0 * _variation(margin.at, rest, law, change)
        # Loosely integrated, it must have kept well away from zero all the way.
        low = np.minimum(np.asarray(margin.at(fold[:, index])), np.asarray(margin.at(rest)))
        good &= (closest > _GRAZES) | (closest > 0.5 * low)
    done = near[good]
    out.states[:, index[good]] = rest[:, good]
    out.end[index[good]] = RESTED
    count = batch.count
    out.largest[:, index[good]] = np.maximum(out.largest[:, index[good]], rest[:count, good])
    return done


def _variation(
    margin: Callable[[Any], Any], state: FloatArray, parts: Parts, change: FloatArray
) -> FloatArray:
    """How much a margin varies, at most and to first order, as the stretches change by so much each."""
    count = len(parts.along)
    total = np.zeros(state.shape[1])
    for i in range(count):
        ahead = state.astype(complex)
        ahead[i] += 1j * COMPLEX_STEP
        slope = np.asarray(margin(ahead)).imag / COMPLEX_STEP
        if parts.area is not None:
            along_p = state.astype(complex)
            along_p[-2] += 1j * COMPLEX_STEP
            per_pressure = np.asarray(margin(along_p)).imag / COMPLEX_STEP
            slope = slope - per_pressure * parts.area[i] / parts.gas_pressure
        total = total + np.abs(slope * change[i])
    return total
