"""The drive of a step: legs along which a coordinate v moves one way, and what is given at each v.

On a `Line` all that is given (voltages, or charges) is linear in v, on `Sines` v is the time in periods.
Equal ways compare equal, so that what is known of one leg is found again in the next.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from tests.oracle.general.scenario import Step

Values = tuple[float, ...]


@dataclass(frozen=True)
class Line:
    """offset + rate·v."""

    offset: Values
    rate: Values

    def at(self, v: Any, place: int) -> Any:
        """What is given at one place."""
        return self.offset[place] + self.rate[place] * v

    def slope(self, v: Any, place: int) -> float:
        """Its derivative in v."""
        return self.rate[place]

    def part(self, place: int) -> Values:
        """All about one place."""
        return self.offset[place], self.rate[place]

    def moves(self, place: int) -> bool:
        """Whether it changes."""
        return self.rate[place] != 0.0


@dataclass(frozen=True)
class Sines:
    """mean + amplitude·sin 2π(v + phase)."""

    mean: Values
    amplitude: Values
    phase: Values

    def at(self, v: Any, place: int) -> Any:
        """What is given at one place; v may have a tiny imaginary part."""
        turns = 2.0 * math.pi * math.remainder(v.real + self.phase[place], 1.0)
        value = self.mean[place] + self.amplitude[place] * math.sin(turns)
        return value + 1j * self.slope(v.real, place) * v.imag if isinstance(v, complex) else value

    def slope(self, v: Any, place: int) -> Any:
        """Its derivative in v."""
        turns = 2.0 * math.pi * math.remainder(v.real + self.phase[place], 1.0)
        size = 2.0 * math.pi * self.amplitude[place]
        if isinstance(v, complex):
            return size * complex(math.cos(turns), -2.0 * math.pi * math.sin(turns) * v.imag)
        return size * math.cos(turns)

    def part(self, place: int) -> Values:
        """All about one place."""
        return self.mean[place], self.amplitude[place], self.phase[place]

    def moves(self, place: int) -> bool:
        """Whether it changes."""
        return self.amplitude[place] != 0.0


Way = Line | Sines


@dataclass(frozen=True)
class Leg:
    """A part of a step, from fraction `begin` to `end` of it, in which v moves from `first` to `last`.

    `wave` are mean, amplitude and cycles in the step where v is a sine of time. `start` and `values` are what
    is given at the ends, exactly.
    """

    way: Way
    first: float
    last: float
    begin: float
    end: float
    start: Values
    values: Values
    wave: tuple[float, float, float] | None = None

    def at(self, fraction: float) -> float:
        """v at a fraction of the step."""
        if fraction <= self.begin:
            return self.first
        if fraction >= self.end:
            return self.last
        if self.wave is None:
            share = (fraction - self.begin) / (self.end - self.begin)
            return self.first + (self.last - self.first) * share
        mean, amplitude, cycles = self.wave
        v = mean + amplitude * math.sin(2.0 * math.pi * math.remainder(cycles * fraction, 1.0))
        return min(max(v, min(self.first, self.last)), max(self.first, self.last))

    def when(self, v: float) -> float:
        """The fraction of the step at which v is reached."""
        if v == self.last:
            return self.end
        if v == self.first:
            return self.begin
        if self.wave is None:
            share = (v - self.first) / (self.last - self.first)
            return self.begin + (self.end - self.begin) * share
        mean, amplitude, cycles = self.wave
        half = round((self.begin + self.end) * cycles)  # the pass through the mean that is in this leg
        angle = math.asin(min(max((v - mean) / amplitude, -1.0), 1.0))
        turns = 0.5 * half + (angle if half % 2 == 0 else -angle) / (2.0 * math.pi)
        return min(max(turns / cycles, self.begin), self.end)


def line_between(start: Sequence[float], end: Sequence[float]) -> tuple[Line, float, float]:
    """The line from one set of values to another, and v at both; v is the value that changes most."""
    change = [b - a for a, b in zip(start, end, strict=True)]
    leader = max(range(len(change)), key=lambda i: abs(change[i]), default=0)
    if not change or change[leader] == 0.0:
        return Line(tuple(start), (0.0,) * len(change)), 0.0, 0.0
    rate = tuple(c / change[leader] for c in change)
    offset = tuple(
        0.0 if rate[i] == 1.0 and a == start[leader] else a - rate[i] * start[leader]
        for i, a in enumerate(start)
    )
    return Line(offset, rate), start[leader], end[leader]


def targets(
    wanted: float | Mapping[str, float], names: Sequence[str], present: Sequence[float]
) -> list[float]:
    """The values that a step asks for; balloons not named keep theirs."""
    if isinstance(wanted, Mapping):
        return [float(wanted.get(name, now)) for name, now in zip(names, present, strict=True)]
    return [float(wanted)] * len(present)


def legs_of(step: Step, names: Sequence[str], present: Sequence[float]) -> list[Leg]:
    """The legs of a step that moves voltages or charges, from those at present.

    The first leg of a wave, a table or a jump may begin elsewhere than at present: with a jump.
    """
    count = len(present)
    match step.kind:
        case "ramp" | "charge":
            return [_straight(present, targets(step.target, names, present), 0.0, 1.0)]
        case "jump":
            there = targets(step.target, names, present)
            return [_straight(there, there, 0.0, 1.0)]
        case "hold":
            return [_straight(present, present, 0.0, 1.0)]
        case "table":
            times, values = step.rows
            return _polyline(count, [t / times[-1] for t in times], values)
    wave = step.wave
    assert wave is not None
    if wave.common is not None:
        first, second = wave.common
        if step.kind == "triangle":
            return _polyline(count, *_triangle(first, second, wave.cycles))
        return _sine(count, first, second, wave.cycles)
    parts = [wave.by_name.get(name) for name in names]
    if step.kind == "sine":
        known = [p or (now, 0.0, 0.0) for p, now in zip(parts, present, strict=True)]
        return _sines(Sines(*(tuple(column) for column in zip(*known, strict=True))), wave.cycles)
    known = [p or (now, now, 0.0) for p, now in zip(parts, present, strict=True)]
    return _triangles(known, wave.cycles)


def _straight(start: Sequence[float], end: Sequence[float], begin: float, finish: float) -> Leg:
    line, first, last = line_between(start, end)
    return Leg(line, first, last, begin, finish, tuple(start), tuple(end))


def _polyline(count: int, fractions: Sequence[float], values: Sequence[float]) -> list[Leg]:
    """One voltage for all, linear between corners."""
    line = Line((0.0,) * count, (1.0,) * count)
    return [
        Leg(
            line,
            values[i],
            values[i + 1],
            t,
            fractions[i + 1],
            (values[i],) * count,
            (values[i + 1],) * count,
        )
        for i, t in enumerate(fractions[:-1])
    ]


def _triangle(low: float, high: float, cycles: float) -> tuple[list[float], list[float]]:
    halves = math.floor(2.0 * cycles)
    fractions = [i / (2.0 * cycles) for i in range(halves + 1)]
    values = [high if i % 2 else low for i in range(halves + 1)]
    left = 2.0 * cycles - halves
    if left > 0.0:
        here, there = (high, low) if halves % 2 else (low, high)
        fractions.append(1.0)
        values.append(here + (there - here) * left)
    fractions[-1] = 1.0
    return fractions, values


def _sine(count: int, mean: float, amplitude: float, cycles: float) -> list[Leg]:
    line = Line((0.0,) * count, (1.0,) * count)
    extremes = [k + 0.5 for k in range(math.ceil(2.0 * cycles)) if k + 0.5 < 2.0 * cycles]
    last = mean + amplitude * math.sin(2.0 * math.pi * math.remainder(cycles, 1.0))
    if (2.0 * cycles) % 1.0 == 0.0:
        last = mean
    corners = [(0.0, mean)]
    corners += [(k / (2.0 * cycles), mean + (amplitude if int(k) % 2 == 0 else -amplitude)) for k in extremes]
    corners.append((1.0, last))
    wave = mean, amplitude, cycles
    return [
        Leg(line, v0, v1, t0, t1, (v0,) * count, (v1,) * count, wave)
        for (t0, v0), (t1, v1) in pairwise(corners)
    ]


def _sines(way: Sines, cycles: float) -> list[Leg]:
    """One leg for each period, begun at v = 0."""
    places = range(len(way.mean))
    legs = []
    for k in range(math.ceil(cycles)):
        last = min(cycles - k, 1.0)
        end = 0.0 if last == 1.0 else last
        start, values = (tuple(way.at(v, i) for i in places) for v in (0.0, end))
        legs.append(Leg(way, 0.0, last, k / cycles, min(k + 1.0, cycles) / cycles, start, values))
    return legs


def _triangles(parts: Sequence[tuple[float, float, float]], cycles: float) -> list[Leg]:
    """Straight legs between all corners of all triangles."""

    def at(turns: float) -> list[float]:
        out = []
        for low, high, phase in parts:
            share = 1.0 - abs(1.0 - 2.0 * ((turns + phase) % 1.0))
            out.append(low * (1.0 - share) + high * share)
        return out

    corners = {0.0} | {(shift - phase) % 1.0 for _, _, phase in parts for shift in (0.0, 0.5)}
    once: list[float] = []
    for corner in sorted(corners):
        if corner < 1.0 - 1e-12 and (not once or corner - once[-1] > 1e-12):
            once.append(corner)
    turns = [k + corner for k in range(math.ceil(cycles)) for corner in once if k + corner < cycles - 1e-12]
    turns.append(cycles)
    # The same corner has the same voltages in every period.
    known = [at(once[i % len(once)]) for i in range(len(turns) - 1)]
    last = cycles % 1.0
    known.append(
        at(min(once, key=lambda c: abs(c - last)) if min(abs(c - last) for c in once) < 1e-12 else last)
    )
    return [
        _straight(known[i], known[i + 1], turns[i] / cycles, turns[i + 1] / cycles)
        for i in range(len(turns) - 1)
    ]
