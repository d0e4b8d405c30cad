"""Flows that end on their way, integrated once more: what they end in depends on how they got there.

A flow forgets where it began, so only its last part matters. It is integrated by an explicit method of high
order, ever more tightly, and taken only where it began far enough back.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from simulator.model.conditions import COMPLEX_STEP
from simulator.solver.batch.dop853 import ERROR_3, ERROR_5, STAGES, WEIGHTS
from simulator.solver.batch.motion import Jacobian, Trail, full_state, is_possible, margins_at, rates_at
from simulator.solver.batch.stacked import Stacked

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Index = NDArray[np.int64]

_ACCURACY = 1e-11  # of a step, of what is not forgotten
_BACK = (36.0, 90.0, 220.0)  # e-folds that a flow is to begin before its end: tried one after the other
_FORGOTTEN = 24.0  # e-folds after which what was off the trajectory is
_LONGEST = 2.5  # e-folds of a step: further the method itself forgets less than the flow
_MOST_STEPS, _MANY_STEPS, _FEW = 150, 80, 0.01
_ROUNDS = 8
_MOST_ALIVE = 0.8

_A = [np.array(row) for row in STAGES]
_B, _E3, _E5 = np.array(WEIGHTS), np.array(ERROR_3), np.array(ERROR_5)


class Ends(NamedTuple):
    """Runs (n,) whose flows end, their states (n_unknowns, n), and the places of the margins zero there."""

    runs: Index
    states: FloatArray
    margin: Index


def _step(
    batch: Stacked, x: FloatArray, v: FloatArray, h: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """One step of stretches: the new ones, their error over the accuracy, the lowest pressure on the way."""
    slopes = np.empty((12, *x.shape))
    slopes[0] = rates_at(batch, full_state(batch, x, v))
    low = np.full(x.shape[1], np.inf)
    for stage, row in enumerate(_A, start=1):
        y = full_state(batch, x + h * _sum(row, slopes[:stage]), v)
        if batch.sealed:
            low = np.minimum(low, y[-2])
        slopes[stage] = rates_at(batch, y)
    five = h * _sum(_E5, slopes) / (_ACCURACY * (1.0 + np.abs(x)))
    three = h * _sum(_E3, slopes) / (_ACCURACY * (1.0 + np.abs(x)))
    e5, e3 = (five * five).sum(axis=0), (three * three).sum(axis=0)
    error = e5 / np.sqrt(np.maximum((e5 + 0.01 * e3) * len(x), 1e-300))
    return x + h * _sum(_B, slopes), error, low


def _sum(weights: FloatArray, slopes: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("s,sin->in", weights, slopes))


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
    def of(cls, index: NDArray[np.int64], trail: Trail) -> _Last:
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
        y = full_state(batch, end, v)
        flow = Jacobian(batch, y, batch.parts(y))
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


@dataclass
class _Front:
    """The flows still under way; `memory`, `span` and `fade` as in `flow`.

    `believed` are those whose very start is: nothing needs to be forgotten from there on.
    """

    batch: Stacked
    index: Index
    x: FloatArray
    v: FloatArray
    h: FloatArray
    memory: FloatArray
    span: FloatArray
    fade: FloatArray
    believed: BoolArray
    alive: BoolArray

    def without(self, gone: BoolArray) -> _Front:
        """Without some runs; they stay as dead weight as long as they are few."""
        self.alive = self.alive & ~gone
        if self.alive.mean() > _MOST_ALIVE:
            return self
        names = (field.name for field in fields(self) if field.name != "batch")
        return _Front(self.batch.take(self.alive), *(getattr(self, name)[..., self.alive] for name in names))


def ends(batch: Stacked, v: FloatArray, index: Index, trail: Trail, *, exact: bool) -> list[Ends]:
    """Where flows end that were seen to end on their way; those that are not certain are left out.

    Parameters
    ----------
    batch : Stacked
        Of all runs.
    v : (n_runs,) array
    index : (n,) array
        The runs that end on their way.
    trail : Trail
        What was seen of them.
    exact : bool
        Whether the very start of each flow is to be believed.
    """
    known = _Last.of(index, trail)
    known = known.take(known.over > 0)
    found: list[Ends] = []
    for back in _BACK:
        if not known.index.size:
            break
        some = batch.take(known.index)
        x, first = known.starts(some, v[known.index], back)
        y = full_state(some, x, v[known.index])
        flow = Jacobian(some, y, some.parts(y))
        speed = np.sqrt((flow.rates**2).sum(axis=0))
        nothing = np.zeros(known.index.size)
        front = _Front(
            some, known.index, x, v[known.index], np.minimum(0.02 / speed, 0.5 / flow.forgets()), nothing,
            nothing, nothing, first & (exact or batch.count == 1),
            np.asarray((margins_at(some, y) > 0.0).all(axis=0)),
        )  # fmt: skip
        passing: list[_Passing] = []
        for step in range(_MOST_STEPS):
            # A few that take many steps are played faster by themselves.
            few = step > _MANY_STEPS and front.alive.sum() <= _FEW * known.index.size
            if few or not front.alive.any():
                break
            front = _stepped(front, passing)
        if passing:
            found.append(_located(batch, v, passing))
            known = known.take(~np.isin(known.index, found[-1].runs))
    return found


class _Passing(NamedTuple):
    """Steps within which tight flows end: what they had forgotten before it, and how fast they forget."""

    runs: Index
    x: FloatArray
    h: FloatArray
    margins: FloatArray
    memory: FloatArray
    fade: FloatArray


def _stepped(front: _Front, passing: list[_Passing]) -> _Front:
    """One tight step; what will be forgotten need not be right."""
    batch, v = front.batch, front.v
    y = full_state(batch, front.x, v)
    fade = Jacobian(batch, y, batch.parts(y)).forgets()
    memory = front.memory + front.span * np.minimum(front.fade, fade)
    left = np.where(front.believed, 0.0, np.maximum(_FORGOTTEN - memory, 0.0))
    h = np.minimum(front.h, _LONGEST / np.maximum(fade, 1e-300))
    x, error, low = _step(batch, front.x, v, h)
    error = error * np.exp(-0.8 * left)
    fine = (error <= 1.0) & np.isfinite(x).all(axis=0) & is_possible(batch, x)
    y = full_state(batch, np.where(fine, x, front.x), v)
    margins = margins_at(batch, y)
    below = fine & (margins <= 0.0).any(axis=0) & front.alive
    # Tension that is lost within the step and back at its end.
    fine &= (low > 0.0) | below
    if below.any():
        passing.append(
            _Passing(
                front.index[below], front.x[:, below], h[below], margins[:, below],
                np.where(front.believed, np.inf, memory)[below], fade[below],
            )
        )  # fmt: skip
    growth = np.clip(0.9 * np.maximum(error, 1e-12) ** -0.125, 0.2, 6.0)
    growth = np.where(np.isfinite(growth), np.where(fine, growth, np.minimum(growth, 0.5)), 0.2)
    return _Front(
        batch, front.index, y[: len(x)], v, h * growth, memory, np.where(fine, h, 0.0), fade, front.believed,
        front.alive,
    ).without(below)  # fmt: skip


def _located(batch: Stacked, v: FloatArray, passing: list[_Passing]) -> Ends:
    """The states at which margins fall to zero within a step, by Newton's method along the flow."""
    index, start, longest, margins, memory, fade = (
        np.concatenate(parts, axis=-1) for parts in zip(*passing, strict=True)
    )
    batch, v = batch.take(index), v[index]
    first = np.argmin(margins, axis=0)
    h = longest
    for _ in range(_ROUNDS):
        x, error, _ = _step(batch, start, v, h)
        y = full_state(batch, x, v)
        rates = rates_at(batch, y)
        # Along the flow, by a complex step in time.
        later = full_state(batch, x + 1j * COMPLEX_STEP * rates, v)
        values = np.array([np.broadcast_to(m.at(later), v.shape) for m in batch.margins])
        chosen = np.take_along_axis(values, first[None], axis=0)[0]
        change = -chosen.real / (chosen.imag / COMPLEX_STEP)
        good = np.abs(change) * np.sqrt((rates * rates).sum(axis=0)) <= 1e-12
        if good.all():
            break
        h = np.clip(h + change, 0.0, longest)
    others = values.real.copy()
    np.put_along_axis(others, first[None], np.inf, axis=0)
    good &= (others.min(axis=0) > 0.0) if len(others) > 1 else True
    good &= (memory + h * fade >= _FORGOTTEN) & (error <= 1.0) & is_possible(batch, x)
    return Ends(index[good], y[:, good], first[good])
