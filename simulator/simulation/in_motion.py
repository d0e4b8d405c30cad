"""Passages in real time: the parts of a leg that they go through, and what is between their samples.

The integrator takes the same steps whatever samples are asked for. Where curves bend some of its steps are
samples too, and what is largest or smallest between samples is found on them.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from simulator.model.drive import Waveform, Way
from simulator.simulation.chords import Ranges, needed
from simulator.simulation.present import Samples
from simulator.solver.passage import Passage
from simulator.solver.viscous import Flow

if TYPE_CHECKING:
    from simulator.model.device import Device
    from simulator.simulation.sources import Sources

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
# v and dv/dt at a time since a part of a leg began.
Drive = Callable[[float], tuple[float, float]]

_BESIDE = 3  # steps on either side of an extreme through which a polynomial goes
_CLOSE = 0.05  # of the longest of them: a shorter step is left out
_GRID, _ROUNDS = 33, 4  # how finely a polynomial is looked at, and how often again


class Moving(NamedTuple):
    """A flow, and what moves it: the sources, their way, and the drive along it."""

    flow: Flow
    sources: Sources
    way: Way
    drive: Drive


@dataclass(frozen=True)
class PassageStates:
    """What became of the balloons over a part of a leg, and how the drive moved meanwhile."""

    passage: Passage
    flow: Flow
    sources: Sources
    way: Way
    drive: Drive

    def of(self, stretch: FloatArray, own: FloatArray, times: Sequence[float] | FloatArray) -> Samples:
        """The states of stretches (n, n_balloons) and own unknowns (n, n_own) at n times of the passage."""
        v = self._drives(times)
        group = self.flow.groups[0]
        pressure = [
            float(group.equations.pressure(self.flow.state(group, values, at)))
            for values, at in zip(np.hstack([stretch, own]).tolist(), v.tolist(), strict=True)
        ]
        given = self.way.at(v)
        voltage, supply = self.sources.voltage(given, stretch, own), self.sources.supply(given)
        return Samples(stretch, np.array(pressure), voltage, own, supply)

    def voltage(self, times: FloatArray, stretch: FloatArray, own: FloatArray) -> FloatArray:
        """The voltages of the films in n states at n times of the passage, (n, n_electroded)."""
        return self.sources.voltage(np.asarray(self.way.at(self._drives(times))), stretch, own)

    def _drives(self, times: Sequence[float] | FloatArray) -> FloatArray:
        return np.array([self.drive(float(t))[0] for t in times])


def smooth_parts(waveform: Waveform, lasts: float) -> list[tuple[float, float, Drive]]:
    """Parts of a leg on which the drive is smooth: from and to which fraction of it, and the drive.

    The drive gives v and dv/dt at a time since the part began.
    """
    if waveform.shape == "sine":
        mean, amplitude, cycles = waveform.wave
        rate = 2.0 * np.pi * cycles / lasts

        def wave(t: float) -> tuple[float, float]:
            return (
                float(mean + amplitude * np.sin(rate * t)),
                float(amplitude * rate * np.cos(rate * t)),
            )

        return [(0.0, 1.0, wave)]

    def straight(v0: float, speed: float) -> Drive:
        return lambda t: (v0 + speed * t, speed)

    corners = zip(waveform.fractions.tolist(), waveform.values.tolist(), strict=True)
    return [
        (t0, t1, straight(v0, (v1 - v0) / ((t1 - t0) * lasts)))
        for (t0, v0), (t1, v1) in itertools.pairwise(corners)
    ]


def closer(
    states: PassageStates,
    wanted: NDArray[np.bool_],
    clock: FloatArray,
    device: Device,
    ranges: Ranges,
    chord: float,
) -> IntArray:
    """The steps of a passage that are samples too, so that chords are on the curve: their places.

    Parameters
    ----------
    states : PassageStates
    wanted : (n,) array of bool
        Which times of the passage are samples.
    clock : (m,) array
        When the steps were, over the time up to the end of the step of the scenario.
    device : Device
    ranges : Ranges
        What the quantities of the run have ranged over; widened.
    chord : float
        How far a chord may be from the curve, over these.
    """
    passage, steps = states.passage, states.passage.steps
    if steps.time.size < 3:
        return np.empty(0, dtype=np.int64)
    at = states.of(steps.stretch, steps.own, steps.time)
    fields, charges = device.field(at.stretch, at.voltage), device.charge(at.stretch, at.voltage)
    columns = np.column_stack([clock, at.stretch, at.pressure, at.voltage, fields, charges])
    ranges.widen(columns)
    ranges.low[0], ranges.high[0] = 0.0, 1.0
    upto = needed(columns, ranges.spans, chord)
    kept = np.append(True, wanted[1:])  # the first is a sample of what was before
    marks = np.interp(passage.time[kept], steps.time, upto)
    found: list[IntArray] = []
    for first, last in itertools.pairwise(marks.tolist()):
        pieces = int(np.ceil(last - first))
        if pieces > 1:
            found.append(np.searchsorted(upto, first + (last - first) * np.arange(1, pieces) / pieces))
    return np.unique(np.concatenate(found)) if found else np.empty(0, dtype=np.int64)


def extremes(
    states: PassageStates, device: Device, cycles: Callable[[FloatArray], IntArray]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Where in a passage stretches, fields and their shares of strengths are largest or smallest, by cycle.

    Parameters
    ----------
    states : PassageStates
    device : Device
    cycles : callable
        Which cycle the times (m,) of steps belong to.

    Returns
    -------
    times : (k,) array
        In order.
    stretch : (k, n_balloons) array
    own : (k, n_own) array
    """
    steps = states.passage.steps
    found: dict[float, FloatArray] = {}
    if steps.time.size > 2 * _BESIDE:
        values = _watched(states, device, np.hstack([steps.stretch, steps.own]), steps.time)
        number = cycles(steps.time)
        for one in np.unique(number):
            mine = np.flatnonzero(number == one)
            for column in range(values.shape[1]):
                for sign in (1.0, -1.0):
                    place = int(mine[np.argmax(sign * values[mine, column])])
                    time, unknowns = _polished(states, device, place, column, sign)
                    found[time] = unknowns
    order, balloons = sorted(found), steps.stretch.shape[1]
    rows = np.array([found[time] for time in order]).reshape(-1, balloons + steps.own.shape[1])
    return np.array(order), rows[:, :balloons], rows[:, balloons:]


def _watched(states: PassageStates, device: Device, unknowns: FloatArray, times: FloatArray) -> FloatArray:
    """All that is largest or smallest somewhere, (n, n_quantities), in n states."""
    stretch, own = np.split(unknowns, [states.passage.stretch.shape[1]], axis=1)
    fields = np.abs(device.field(stretch, states.voltage(times, stretch, own)))
    shares = fields[:, list(device.rated)] / device.breakdown_field(stretch)
    return np.column_stack([stretch, fields, shares])


def _polished(
    states: PassageStates, device: Device, place: int, column: int, sign: float
) -> tuple[float, FloatArray]:
    """Where a quantity is largest (sign 1) or smallest beside a step: on a polynomial through some steps."""
    steps = states.passage.steps
    times, values = steps.time, np.hstack([steps.stretch, steps.own])
    chosen = _apart(times, place)
    here = chosen.index(place)
    low, high = times[chosen[max(here - 1, 0)]], times[chosen[min(here + 1, len(chosen) - 1)]]
    size = 0.5 * (times[chosen[-1]] - times[chosen[0]])
    powers = np.polynomial.polynomial.polyvander((times[chosen] - times[place]) / size, len(chosen) - 1)
    coefficients = np.linalg.solve(powers, values[chosen])

    def unknowns(when: FloatArray) -> FloatArray:
        return np.asarray(np.polynomial.polynomial.polyval((when - times[place]) / size, coefficients).T)

    for _ in range(_ROUNDS):
        grid = np.linspace(low, high, _GRID)
        best = int(np.argmax(sign * _watched(states, device, unknowns(grid), grid)[:, column]))
        low, high = grid[max(best - 1, 0)], grid[min(best + 1, _GRID - 1)]
    return float(grid[best]), unknowns(grid[best : best + 1])[0]


def _apart(times: FloatArray, place: int) -> list[int]:
    """The places of a step and of some on either side, no two so close that they say the same."""
    first, last = max(place - 3 * _BESIDE, 0), min(place + 3 * _BESIDE, times.size - 1)
    least = _CLOSE * float(np.diff(times[first : last + 1]).max())
    chosen = [place]
    for ahead in (range(place + 1, last + 1), range(place - 1, first - 1, -1)):
        before, count = place, 0
        for k in ahead:
            if count < _BESIDE and abs(times[k] - times[before]) >= least:
                chosen.append(k)
                before, count = k, count + 1
    return sorted(chosen)
