"""The overdamped flow dλᵢ/dt = −gᵢ at a frozen drive, of many runs at once: where snaps come to rest or end.

A flow forgets where it began: what is off the trajectory decays at the rates of all directions but its own.
So it is integrated loosely first, by a Rosenbrock method that does not mind stiffness, to see where it goes. A
landing is then Newton's. Where the flow ends on its way, that state depends on the trajectory: its last part,
from as far back as it remembers, is integrated once more, tightly, by an explicit method of high order.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from simulator.events import EventKind
from simulator.model.contents import Liquid
from simulator.model.equations import SealedBalloons
from simulator.solver.batch.bordered import Bordered, softest
from simulator.solver.batch.dop853 import ERROR_3, ERROR_5, STAGES, WEIGHTS
from simulator.solver.batch.events import at_drive
from simulator.solver.batch.interval import square
from simulator.solver.batch.stacked import Parts, Stacked

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

GAVE_UP, RESTED = -1, 0  # then 1 + the place in `Stacked.margins`

_FAR_OFF = 1e-2  # stretch by which a snap is started off its limit point
_OFF = 1e-4  # the same where it must be as `solver.flow` starts it: little is forgotten on the way
_LOOSE = 3e-2  # of a loose step, in stretch: what a method of first order would be off
_ACCURACY = 1e-11  # of a tight one
_BACK = (36.0, 90.0, 220.0)  # e-folds that a tight flow is to begin before its end: tried one after the other
_FORGOTTEN = 24.0  # e-folds after which what was off the trajectory is
_MOST_STEPS = 120
_MOST_TIGHT_STEPS, _MANY_STEPS, _FEW = 150, 80, 0.01
_NEAR = 0.05  # how far a Newton step may lead for Newton's method to take over
_LINGERS = 1e-3  # over the largest speed so far: a flow this slow that grows faster again passed a saddle
_GRAZES = 0.02  # a margin that comes as close to zero on the way may be passed by a tight flow
_LONGEST = 2.5  # e-folds of a step: further the method itself forgets less than the flow
_ROUNDS = 8
_MOST_ALIVE = 0.8
_GAMMA = 1.0 - 0.5 * 2.0**0.5

_A = [np.array(row) for row in STAGES]
_B, _E3, _E5 = np.array(WEIGHTS), np.array(ERROR_3), np.array(ERROR_5)


@dataclass
class Rests:
    """Where the flows of n runs ended: states (n_unknowns, n), and how; see `GAVE_UP`."""

    states: FloatArray
    end: NDArray[np.int64]
    largest: FloatArray


def _full(batch: Stacked, stretches: FloatArray, v: FloatArray) -> FloatArray:
    """States with the pressure that goes with stretches in motion."""
    if not batch.sealed:
        return np.concatenate([stretches, v[None]])
    pressure = np.asarray(batch.equations.gas_pressure(list(stretches), v))
    return np.concatenate([stretches, pressure[None], v[None]])


def _rates(batch: Stacked, y: FloatArray) -> FloatArray:
    """Dλ/dt of full states."""
    residual = batch.equations.residual(list(y))
    return np.stack(
        [
            -wall.modulus * r / wall.elastomer.pole_form(x)[1]
            for wall, r, x in zip(batch.equations.walls, residual, y, strict=False)
        ]
    )


def _step(
    batch: Stacked, x: FloatArray, v: FloatArray, h: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """One step of stretches: the new ones, their error over the accuracy, and the lowest pressure on the way."""
    slopes = np.empty((12, *x.shape))
    slopes[0] = _rates(batch, _full(batch, x, v))
    flat = slopes.reshape(12, -1)
    low = np.full(x.shape[1], np.inf)
    for stage, row in enumerate(_A, start=1):
        y = _full(batch, x + h * (row @ flat[:stage]).reshape(x.shape), v)
        if batch.sealed:
            low = np.minimum(low, y[-2])
        slopes[stage] = _rates(batch, y)
    five = (h * (_E5 @ flat).reshape(x.shape)) / (_ACCURACY * (1.0 + np.abs(x)))
    three = (h * (_E3 @ flat).reshape(x.shape)) / (_ACCURACY * (1.0 + np.abs(x)))
    e5, e3 = (five * five).sum(axis=0), (three * three).sum(axis=0)
    error = e5 / np.sqrt(np.maximum((e5 + 0.01 * e3) * len(x), 1e-300))
    return x + h * (_B @ flat).reshape(x.shape), error, low


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


@dataclass
class _Trail:
    """The states that loose flows passed, and what they had forgotten there, step by step for all runs."""

    states: list[FloatArray]
    memory: list[FloatArray]
    margin: list[FloatArray]


class _Jacobian:
    """−∂(dλ/dt)/∂λ = diag(q) + u wᵀ of the flow, and the weights in which it is symmetric."""

    def __init__(self, batch: Stacked, y: FloatArray, parts: Parts) -> None:
        walls = batch.equations.walls
        self.rates, self.q, self.u = (np.empty_like(parts.force) for _ in range(3))
        self.w = np.zeros_like(parts.force)
        self.pull = np.empty_like(parts.force)
        for i, (wall, x) in enumerate(zip(walls, y, strict=False)):
            denominator = wall.elastomer.pole_form(x)[1]
            pace = wall.modulus / denominator
            slope = wall.elastomer.pole_form_slope(x)[1]
            self.rates[i] = -pace * parts.force[i]
            self.q[i] = pace * (parts.along[i] - parts.force[i] * slope / denominator)
            self.u[i] = -pace * parts.per_pressure[i] if parts.per_pressure is not None else 0.0
            self.pull[i] = wall.weight / wall.modulus
        if parts.area is not None:
            self.w = parts.area / parts.gas_pressure

    def solver(self, step: FloatArray) -> Callable[[FloatArray], FloatArray]:
        """Solves (1 + step (diag(q) + u wᵀ)) z = r."""
        inverse = 1.0 / (1.0 + step * self.q)
        turned = inverse * self.u
        share = step / (1.0 + step * (self.w * turned).sum(axis=0))

        def solve(right: FloatArray) -> FloatArray:
            z = inverse * right
            return np.asarray(z - turned * (share * (self.w * z).sum(axis=0)))

        return solve

    def forgets(self) -> FloatArray:
        """The slowest rate at which what is off the trajectory decays, (n_runs,)."""
        count, f = len(self.q), self.rates
        along = (self.pull * f * f).sum(axis=0)
        if count == 1:
            return np.full(f.shape[1], 1e9)  # on a line there is nothing off the trajectory
        if count == 2:
            turned = self.q * f + self.u * (self.w * f).sum(axis=0)
            own = (self.pull * f * turned).sum(axis=0) / along
            return np.asarray((self.q + self.u * self.w).sum(axis=0) - own)
        # In the weights in which the Jacobian is symmetric, projected across the flow.
        root = np.sqrt(self.pull)
        arms = np.sqrt(np.maximum(self.u * self.w, 0.0))
        matrices = arms.T[:, :, None] * arms.T[:, None, :]
        index = np.arange(count)
        matrices[:, index, index] += self.q.T
        across = (
            np.eye(count) - (root * f / np.sqrt(along)).T[:, :, None] * (root * f / np.sqrt(along)).T[:, None]
        )
        projected = across @ matrices @ across
        good = np.isfinite(projected).all(axis=(1, 2))
        values = np.full(f.shape[1], -np.inf)
        # The direction of the flow itself is put above all others.
        lift = np.abs(projected).sum(axis=(1, 2))[:, None, None] * (np.eye(count) - across)
        values[good] = np.linalg.eigvalsh((projected + lift)[good])[:, 0]
        return values


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
    out = Rests(fold.copy(), np.full(fold.shape[1], GAVE_UP), fold[: batch.count].copy())
    left = np.arange(fold.shape[1] if _is_covered(batch) else 0)
    for off in (_FAR_OFF, _OFF):
        if not left.size:
            break
        some, point, way = batch.take(left), fold[:, left], escape[:, left]
        with np.errstate(all="ignore"):
            found = _flow(some, point, point[: batch.count] + off * way, way, off)
            energy = some.equations.potential
            lost = np.asarray(energy(list(point))) - np.asarray(energy(list(found.states)))
        found.end[~(lost >= 0.0)] = GAVE_UP
        out.states[:, left], out.end[left], out.largest[:, left] = found.states, found.end, found.largest
        left = left[found.end == GAVE_UP]
    return out


def relax(batch: Stacked, start: FloatArray) -> Rests:
    """Where states (n_unknowns, n) that are no equilibria go."""
    if not _is_covered(batch):
        return Rests(start.copy(), np.full(start.shape[1], GAVE_UP), start[: batch.count].copy())
    with np.errstate(all="ignore"):
        found = _flow(batch, start, start[: batch.count], None, 0.0)
        margins = _margins(batch, start)
        if len(margins):
            # Broken as it begins.
            broken = margins.min(axis=0) <= 0.0
            found.end[broken] = 1 + np.argmin(margins, axis=0)[broken]
    return found


def _is_covered(batch: Stacked) -> bool:
    """A liquid's pressure in motion is not that of its law."""
    return not (isinstance(batch.equations, SealedBalloons) and isinstance(batch.equations.gas, Liquid))


def _flow(batch: Stacked, origin: FloatArray, x: FloatArray, escape: FloatArray | None, off: float) -> Rests:
    """Where the flow from stretches x goes, at the drive of states that it began in.

    `escape` is the direction in which it must lead on, `off` how far along it x is from `origin`.
    """
    count, runs = batch.count, origin.shape[1]
    out = Rests(origin.copy(), np.full(runs, GAVE_UP), origin[:count].copy())
    v = origin[-1]
    y = _full(batch, x, v)
    flow = _Jacobian(batch, y, batch.parts(y))
    speed = np.sqrt((flow.rates**2).sum(axis=0))
    closest = _margins(batch, y)
    fit = (closest > 0.0).all(axis=0) & np.isfinite(speed)
    if escape is not None:
        fit &= (flow.pull * flow.rates * escape).sum(axis=0) > 0.0
    away = 0.0 if escape is None else np.sqrt(((x - origin[:count]) ** 2).sum(axis=0)) * 0.999
    weights = 1.0 / batch.scales(runs) ** 2
    nothing = np.zeros(runs)
    first = 0.5 * off / speed if off else np.minimum(0.01 / speed, 0.1)
    front = _Front(
        batch, np.arange(runs), weights, x, v, first, nothing, nothing, nothing, speed, speed, closest, fit
    ).take(fit)  # fmt: skip
    trail = _Trail([], [], [])
    ends: list[_Front] = []
    for _ in range(_MOST_STEPS):
        if not front.alive.any():
            break
        front = _loosely(front, origin, away, out, trail, ends)
    if any(e.index.size for e in ends):
        _tightly(batch, v, ends, trail, off <= _OFF, out)
    return out


def _margins(batch: Stacked, y: FloatArray) -> FloatArray:
    found = [np.broadcast_to(np.asarray(m.at(y)), y.shape[1:]) for m in batch.margins]
    return np.array(found).reshape(len(found), *y.shape[1:])


def _loosely(
    front: _Front, fold: FloatArray, away: Any, out: Rests, trail: _Trail, ends: list[_Front]
) -> _Front:
    """One loose step, from states that are looked at first: may they land, have they ended?"""
    batch, v, x, h = front.batch, front.v, front.x, front.h
    y = _full(batch, x, v)
    parts = batch.parts(y)
    flow = _Jacobian(batch, y, parts)
    margins = _margins(batch, y)
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
        ends.append(front.take(on_the_way))
    solve = flow.solver(_GAMMA * h)
    first = solve(flow.rates)
    second = solve(_rates(batch, _full(batch, x + h * first, v)) - 2.0 * first)
    new = x + h * (1.5 * first + 0.5 * second)
    error = np.sqrt(((0.5 * h * (first + second) / (0.5 + 0.5 * x)) ** 2).sum(axis=0)) / _LOOSE
    inside = np.array([np.asarray(d) for d in np.broadcast_arrays(*batch.denominators(new), v)[:-1]])
    fine = (error <= 1.0) & (inside > 0.0).all(axis=0) & (new > 0.0).all(axis=0)
    growth = np.clip(0.75 / np.sqrt(np.maximum(error, 1e-4)), 0.2, 1.5)
    gone = ended | lingered | (h * fastest <= 1e-12)
    gone[landed] = True
    return _Front(
        batch, front.index, front.weights, np.where(fine, new, x), v,
        h * np.where(fine, growth, np.where(np.isfinite(error), np.minimum(growth, 0.5), 0.2)),
        memory, np.where(fine, h, 0.0), fade, fastest, slowest, front.closest, front.alive,
    ).without(gone)  # fmt: skip


@dataclass(frozen=True)
class _Last:
    """The last loose steps of flows that end on their way.

    `index` are the runs, `along` (n_steps, n) what each had forgotten at each step, `over` the first step
    beyond the end, `share` how far between the step before and that one the end is.
    """

    index: NDArray[np.int64]
    states: FloatArray
    along: FloatArray
    over: NDArray[np.int64]
    share: FloatArray

    @classmethod
    def of(cls, index: NDArray[np.int64], trail: _Trail) -> _Last:
        along, margin = np.stack(trail.memory)[:, index], np.stack(trail.margin)[:, index]
        runs = np.arange(index.size)
        over = np.isfinite(along).sum(axis=0) - 1 + np.argmax(np.isfinite(along), axis=0)
        before = np.maximum(over - 1, 0)
        share = margin[before, runs] / (margin[before, runs] - margin[over, runs])
        return cls(index, np.stack(trail.states)[:, :, index], along, over, np.clip(share, 0.0, 1.0))

    def take(self, some: Any) -> _Last:
        return _Last(
            self.index[some], self.states[:, :, some], self.along[:, some], self.over[some], self.share[some]
        )

    def starts(self, batch: Stacked, v: FloatArray, back: float) -> tuple[FloatArray, BoolArray]:
        """States some e-folds before the ends, about, (n_balloons, n), and where that is the very start."""
        runs, before = np.arange(self.index.size), np.maximum(self.over - 1, 0)
        low, high = self.states[before, :, runs].T, self.states[self.over, :, runs].T
        memory = self.along[before, runs]
        end = low + self.share * (high - low)
        y = _full(batch, end, v)
        flow = _Jacobian(batch, y, batch.parts(y))
        speed = np.sqrt((flow.rates**2).sum(axis=0))
        # Within the last step by the way that it takes to forget, else by what was forgotten before.
        length = np.sqrt(((high - low) ** 2).sum(axis=0))
        part = self.share - speed * back / np.maximum(flow.forgets(), 1e-300) / length
        wanted = memory + self.share * (self.along[self.over, runs] - memory) - back
        earlier = (self.along <= np.minimum(wanted, memory)) & np.isfinite(self.along)
        last = np.where(earlier.any(axis=0), len(earlier) - 1 - np.argmax(earlier[::-1], axis=0), 0)
        last = np.minimum(last, before)
        following = np.minimum(last + 1, self.over)
        a, b = self.along[last, runs], self.along[following, runs]
        between = np.nan_to_num(np.clip((wanted - a) / (b - a), 0.0, 1.0))
        x0, x1 = self.states[last, :, runs].T, self.states[following, :, runs].T
        inside = part > 0.0
        x = np.where(
            inside, low + part * (high - low), x0 + np.where(following < self.over, between, 0.0) * (x1 - x0)
        )
        first = ~inside & (last == 0) & ~earlier.any(axis=0)
        x[:, first] = self.states[0, :, runs].T[:, first]
        return x, first


def _tightly(
    batch: Stacked, v: FloatArray, ends: list[_Front], trail: _Trail, exact: bool, out: Rests
) -> None:
    """Integrate once more, from as far back as it matters, the flows that end on their way.

    `exact` says that their very start is to be believed: nothing needs to be forgotten from there on.
    """
    known = _Last.of(np.concatenate([e.index for e in ends]), trail)
    known = known.take(known.over > 0)
    for back in _BACK:
        if not known.index.size:
            return
        some = batch.take(known.index)
        x, first = known.starts(some, v[known.index], back)
        y = _full(some, x, v[known.index])
        nothing = np.zeros(known.index.size)
        flow = _Jacobian(some, y, some.parts(y))
        speed = np.sqrt((flow.rates**2).sum(axis=0))
        margins = _margins(some, y)
        front = _Front(
            some, known.index, np.where(first & exact, np.inf, 0.0), x, v[known.index],
            np.minimum(0.02 / speed, 0.5 / flow.forgets()), nothing, nothing, nothing, speed, speed, margins,
            (margins > 0.0).all(axis=0),
        )  # fmt: skip
        passing: list[_Passing] = []
        for step in range(_MOST_TIGHT_STEPS):
            # A few that take many steps are played faster by themselves.
            few = step > _MANY_STEPS and front.alive.sum() <= _FEW * known.index.size
            if few or not front.alive.any():
                break
            front = _exactly(front, passing)
        if passing:
            _end(batch, v, passing, out)
        known = known.take(out.end[known.index] == GAVE_UP)


class _Passing(NamedTuple):
    """Steps within which tight flows end: what they had forgotten before it, and how fast they forget."""

    index: NDArray[np.int64]
    x: FloatArray
    h: FloatArray
    margins: FloatArray
    memory: FloatArray
    fade: FloatArray


def _exactly(front: _Front, passing: list[_Passing]) -> _Front:
    """One tight step; what will be forgotten need not be right. (Of `weights`, whether nothing needs to be.)"""
    batch, v = front.batch, front.v
    y = _full(batch, front.x, v)
    fade = _Jacobian(batch, y, batch.parts(y)).forgets()
    memory = front.memory + front.span * np.minimum(front.fade, fade)
    left = np.where(front.weights > 0.0, 0.0, np.maximum(_FORGOTTEN - memory, 0.0))
    h = np.minimum(front.h, _LONGEST / np.maximum(fade, 1e-300))
    x, error, low = _step(batch, front.x, v, h)
    error = error * np.exp(-0.8 * left)
    fine = (error <= 1.0) & np.isfinite(x).all(axis=0)
    y = _full(batch, np.where(fine, x, front.x), v)
    margins = _margins(batch, y)
    below = fine & (margins <= 0.0).any(axis=0) & front.alive
    # Tension that is lost within the step and back at its end.
    fine &= (low > 0.0) | below
    if below.any():
        passing.append(
            _Passing(
                front.index[below], front.x[:, below], h[below], margins[:, below],
                (memory + front.weights)[below], fade[below],
            )
        )  # fmt: skip
    growth = np.clip(0.9 * np.maximum(error, 1e-12) ** -0.125, 0.2, 6.0)
    growth = np.where(np.isfinite(growth), np.where(fine, growth, np.minimum(growth, 0.5)), 0.2)
    return _Front(
        batch, front.index, front.weights, y[: len(x)], v, h * growth, memory,
        np.where(fine, h, 0.0), fade, front.fastest, front.slowest,
        np.minimum(front.closest, margins), front.alive,
    ).without(below)  # fmt: skip


def _end(batch: Stacked, v: FloatArray, passing: list[_Passing], out: Rests) -> None:
    """The states at which margins fall to zero within a step, by Newton's method along the flow."""
    index, start, longest, margins, memory, fade = (
        np.concatenate(parts, axis=-1) for parts in zip(*passing, strict=True)
    )
    batch, v = batch.take(index), v[index]
    first = np.argmin(margins, axis=0)
    h = longest
    for _ in range(_ROUNDS):
        x, error, _ = _step(batch, start, v, h)
        y = _full(batch, x, v)
        rates = _rates(batch, y)
        # Along the flow, by a complex step in time.
        later = _full(batch, x + 1e-30j * rates, v)
        values = np.array([np.broadcast_to(m.at(later), v.shape) for m in batch.margins])
        chosen = np.take_along_axis(values, first[None], axis=0)[0]
        change = -chosen.real / (chosen.imag / 1e-30)
        good = np.abs(change) * np.sqrt((rates * rates).sum(axis=0)) <= 1e-12
        if good.all():
            break
        h = np.clip(h + change, 0.0, longest)
    others = values.real.copy()
    np.put_along_axis(others, first[None], np.inf, axis=0)
    good &= (others.min(axis=0) > 0.0) if len(others) > 1 else True
    good &= (memory + h * fade >= _FORGOTTEN) & (error <= 1.0)
    out.states[:, index[good]] = y[:, good]
    out.end[index[good]] = 1 + first[good]
    out.largest[:, index[good]] = np.maximum(out.largest, out.states[: len(start)])[:, index[good]]


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
        ahead[i] += 1e-30j
        slope = np.asarray(margin(ahead)).imag / 1e-30
        if parts.area is not None:
            along_p = state.astype(complex)
            along_p[-2] += 1e-30j
            per_pressure = np.asarray(margin(along_p)).imag / 1e-30
            slope = slope - per_pressure * parts.area[i] / parts.gas_pressure
        total = total + np.abs(slope * change[i])
    return total
