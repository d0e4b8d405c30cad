"""The voltages that a step prescribes, as smooth parts between corners."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Part:
    """A smooth part of a step: when it begins and how long it lasts, and voltages over its own time."""

    begin: float
    lasts: float
    voltages: Callable[[float], FloatArray]
    longest: float


def _straight(begin: float, end: float, first: FloatArray, last: FloatArray) -> Part:
    lasts = end - begin
    slope = (last - first) / lasts

    def voltages(t: float) -> FloatArray:
        return last if t == lasts else np.asarray(first + slope * t)

    return Part(begin, lasts, voltages, lasts / 12.0)


def parts_of(step: Any, names: Sequence[str], films: Sequence[str], now: FloatArray) -> list[Part]:
    """The smooth parts of a step, in order; a jump is one that lasts no time.

    Parameters
    ----------
    step
        As played, of a `Scenario`.
    names, films : sequence of str
        All balloons, and those with electrodes.
    now : (n_balloons,) array
        Voltages before the step.
    """

    def given(value: Any) -> FloatArray:
        out = now.copy()
        for name in films:
            if not isinstance(value, dict) or name in value:
                out[names.index(name)] = value[name] if isinstance(value, dict) else value
        return out

    if hasattr(step, "inflate"):
        return [_straight(0.0, step.over, now, now)]
    if hasattr(step, "hold"):
        return [_straight(0.0, step.hold, now, now)]
    if hasattr(step, "ramp"):
        return [_straight(0.0, step.over, now, given(step.ramp))]
    if hasattr(step, "jump"):
        target = given(step.jump)
        return [Part(0.0, 0.0, lambda _: target, 0.0)]
    if hasattr(step, "table"):
        rows = [given(float(v)) for v in step.voltages]
        times = step.times.tolist()
        return [_straight(times[i], times[i + 1], rows[i], rows[i + 1]) for i in range(len(rows) - 1)]
    return _waves(step, names, films, now)


def _waves(step: Any, names: Sequence[str], films: Sequence[str], now: FloatArray) -> list[Part]:
    kind = "sine" if hasattr(step, "sine") else "triangle"
    wave = getattr(step, kind)
    own = getattr(wave, "balloons", None) or dict.fromkeys(films, wave)
    first, second = ("mean", "amplitude") if kind == "sine" else ("low", "high")
    a, b, phase = now.copy(), np.zeros(len(names)), np.zeros(len(names))
    moves = np.zeros(len(names), dtype=bool)
    for name, one in own.items():
        i = names.index(name)
        a[i], b[i], moves[i] = getattr(one, first), getattr(one, second), True
        phase[i] = getattr(one, "phase", 0.0)
    if kind == "sine":

        def sine(t: float) -> FloatArray:
            return np.where(moves, a + b * np.sin(2.0 * np.pi * (t / wave.period + phase)), now)

        return [Part(0.0, wave.period * wave.cycles, sine, wave.period / 24.0)]

    def triangle(turns: float) -> FloatArray:
        share = 1.0 - np.abs(1.0 - 2.0 * np.mod(turns + phase, 1.0))
        return np.where(moves, a + (b - a) * share, now)

    corners = {0.0, float(wave.cycles)}
    for shift in phase[moves]:
        for half in range(-2, 2 * math.ceil(wave.cycles) + 3):
            corner = 0.5 * half - math.fmod(shift, 1.0)
            if 1e-12 < corner < wave.cycles - 1e-12:
                corners.add(corner)
    turns = sorted(corners)
    kept = [turns[0], *(t for s, t in itertools.pairwise(turns) if t - s > 1e-12)]
    return [
        _straight(s * wave.period, t * wave.period, triangle(s), triangle(t))
        for s, t in itertools.pairwise(kept)
    ]
