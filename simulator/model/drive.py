"""The drive: voltages and pressure in time, as straight lines through drive space walked along and back.

A history is rate independent, so time only labels its points. A step of a scenario moves the drive along
one straight line; a `Waveform` says how far along it (the coordinate v) at each fraction θ of the step,
with the corners, where the motion turns round or kinks, declared and never discovered. Between two
corners v is monotone, so that the θ at which v takes a value is known in closed form.

Actuators with waves of their own leave the straight line. Out of step, triangles make a polygon, one straight
`Leg` after the other; sines make a closed `VoltageCurve`, travelled once in each period.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Sequence

FloatArray = NDArray[np.float64]
# A float, a complex number or an array of either.
Number = Any
# What the source of the electrodes gives; the other follows.
Quantity = Literal["voltage", "charge"]

_ROUNDING = 4e-16  # of a voltage: about two units in its last place
_SOON = 1e-4  # of a way: where it is seen whether an oscillating voltage rises
_ONE_CORNER = 1e-12  # corners of two triangles closer than this part of a period are one


@dataclass(frozen=True)
class AffineDrive:
    """What drives one film: a voltage or charge that is offset + rate·v."""

    offset: float
    rate: float
    quantity: Quantity = "voltage"
    longest_step: ClassVar[float] = math.inf

    def at(self, v: Number) -> Number:
        """The voltage or charge at v."""
        return self.offset + self.rate * v

    def slope(self, v: Number) -> Number:
        """Its derivative in v."""
        return self.rate

    def scale(self, size: float) -> float:
        """The change of v that changes the voltage or charge by `size`; inf where it stays."""
        return size / abs(self.rate) if self.rate else math.inf

    def grows(self, v: float, target: float) -> bool:
        """Whether its magnitude grows as v sets out towards `target`."""
        return _grows(self.at(v), self.rate * (target - v))

    @property
    def wave(self) -> str:
        """The formula of a voltage that oscillates; none here."""
        return ""


@dataclass(frozen=True)
class SineDrive:
    """What drives one film: a voltage mean + amplitude·sin 2π(v + phase); v is the time in periods."""

    mean: float
    amplitude: float
    phase: float
    quantity: ClassVar[Quantity] = "voltage"
    # An eighth of a period: work integrals over it are good to 1e-10.
    longest_step: ClassVar[float] = 0.125

    def at(self, v: Number) -> Number:
        """The voltage at v."""
        return self.mean + self.amplitude * sine_of_turns(v + self.phase)

    def slope(self, v: Number) -> Number:
        """Its derivative in v."""
        return 2.0 * np.pi * self.amplitude * sine_of_turns(v + (self.phase + 0.25))

    def scale(self, size: float) -> float:
        """The change of v that changes the voltage by `size` at most, at most a period."""
        return min(size / (2.0 * np.pi * abs(self.amplitude)), 1.0)

    def grows(self, v: float, target: float) -> bool:
        """Whether its magnitude grows as v sets out towards `target`."""
        now = self.at(v)
        return _grows(now, self.at(v + _SOON * (target - v)) - now)

    @property
    def wave(self) -> str:
        """Its formula."""
        return f"φ = {self.mean:g} + {self.amplitude:g} sin 2π(θ + {self.phase:g})"


Drive = AffineDrive | SineDrive


def _grows(now: float, change: float) -> bool:
    return now * change > 0.0 or (now == 0.0 and change != 0.0)


@dataclass(frozen=True)
class VoltageLine:
    """A line φᵢ = offsetᵢ + rateᵢ·v in the space of the electroded balloons' voltages, or of their charges.

    Its form is canonical: the largest rate is 1 and its offset 0, so v is that balloon's voltage and
    two steps along the same line, there and back, compare equal.
    """

    offset: tuple[float, ...]
    rate: tuple[float, ...]
    quantity: Quantity = "voltage"

    @classmethod
    def still(cls, values: Sequence[float], quantity: Quantity = "voltage") -> VoltageLine:
        """One set of voltages or charges, at any v."""
        return cls(tuple(values), (0.0,) * len(values), quantity)

    @classmethod
    def through(
        cls, start: Sequence[float], end: Sequence[float], quantity: Quantity = "voltage"
    ) -> VoltageLine:
        """The line from one set of values to another; from a set to itself, that set at any v."""
        # What rounding has left of an earlier ramp to the same value is no change.
        change = [
            0.0 if math.isclose(a, b, rel_tol=_ROUNDING) else b - a for a, b in zip(start, end, strict=True)
        ]
        largest = max(change, key=abs)
        if largest == 0.0:
            return cls.still(start, quantity)
        leader = change.index(largest)
        rate = tuple(c / largest for c in change)
        # A line through zero has no offset: what rounding leaves of one would be a voltage where all are off.
        offset = tuple(
            0.0
            if i == leader or math.isclose(a, r * start[leader], rel_tol=_ROUNDING)
            else a - r * start[leader]
            for i, (a, r) in enumerate(zip(start, rate, strict=True))
        )
        return cls(offset, rate, quantity)

    @classmethod
    def common(cls, count: int, quantity: Quantity = "voltage") -> VoltageLine:
        """One voltage (or charge) on all electrodes: φᵢ = v."""
        return cls((0.0,) * count, (1.0,) * count, quantity)

    @property
    def moves(self) -> tuple[bool, ...]:
        """Which voltages, or charges, change along it."""
        return tuple(bool(rate) for rate in self.rate)

    def drive(self, place: int) -> Drive | None:
        """What drives the film at one place among the electroded; None where it is always 0."""
        offset, rate = self.offset[place], self.rate[place]
        return AffineDrive(offset, rate, self.quantity) if offset or rate else None

    def coordinate(self, voltages: Sequence[float]) -> float:
        """The v at which the line passes through `voltages`; 0 on a line that goes nowhere."""
        return float(voltages[self.rate.index(1.0)]) if any(self.rate) else 0.0

    def at(self, v: FloatArray | float) -> FloatArray:
        """Voltages, or charges, at v: shape (n_electroded,) for a float, (n, n_electroded) for n values."""
        moved, offset = np.multiply.outer(v, self.rate), np.asarray(self.offset)
        voltages = moved + offset
        # A voltage that the line switches off is off, and not what rounding leaves of the two parts.
        off = np.abs(voltages) <= _ROUNDING * np.abs(offset)
        return np.asarray(np.where(off, 0.0, voltages))


def sine_of_turns(turns: Any) -> Any:
    """sin(2π turns) of a float, a complex number or an array; exact at every quarter turn."""
    if isinstance(turns, float):
        part = turns - round(turns)
        if abs(part) > 0.25:
            part = math.copysign(0.5, part) - part
        return math.sin(2.0 * math.pi * part)
    part = turns - np.round(np.real(turns))
    side = np.real(part)
    return np.sin(2.0 * np.pi * np.where(np.abs(side) > 0.25, np.copysign(0.5, side) - part, part))


@dataclass(frozen=True)
class VoltageCurve:
    """A closed curve φᵢ = meanᵢ + amplitudeᵢ sin 2π(v + phaseᵢ) in the space of voltages; v in periods."""

    mean: tuple[float, ...]
    amplitude: tuple[float, ...]
    phase: tuple[float, ...]
    quantity: ClassVar[Quantity] = "voltage"

    @property
    def moves(self) -> tuple[bool, ...]:
        """Which voltages change along it."""
        return tuple(bool(amplitude) for amplitude in self.amplitude)

    def drive(self, place: int) -> Drive | None:
        """What drives the film at one place among the electroded; None where it is always 0."""
        mean, amplitude = self.mean[place], self.amplitude[place]
        if amplitude:
            return SineDrive(mean, amplitude, self.phase[place])
        return AffineDrive(mean, 0.0) if mean else None

    def at(self, v: FloatArray | float) -> FloatArray:
        """Voltages at v: shape (n_electroded,) for a float, (n, n_electroded) for n values."""
        # Closed to the last digit: a period ends where the next one begins.
        turns = np.where(np.asarray(v) == 1.0, 0.0, v)[..., None] + np.asarray(self.phase)
        return np.asarray(np.asarray(self.mean) + np.asarray(self.amplitude) * sine_of_turns(turns))


Way = VoltageLine | VoltageCurve


@dataclass(frozen=True)
class Waveform:
    """The coordinate v along the drive's line over the fraction θ ∈ [0, 1] of a step.

    Attributes
    ----------
    fractions, values : (n_corners,) arrays
        The corners; fractions rise from 0 to 1, v is monotone between neighbours.
    shape : {"linear", "sine"}
        How v gets from corner to corner. A sine's corners are its start, its extremes and its end.
    wave : (float, float, float)
        Mean, amplitude and cycles in the step, of a sine.
    """

    fractions: FloatArray
    values: FloatArray
    shape: Literal["linear", "sine"] = "linear"
    wave: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def at(self, fractions: FloatArray) -> FloatArray:
        """v at the given fractions of the step; exact at corners."""
        if self.shape == "linear":
            return np.interp(fractions, self.fractions, self.values)
        mean, amplitude, cycles = self.wave
        v = mean + amplitude * np.sin(2.0 * np.pi * cycles * fractions)
        # Exact at the ends, and never beyond an extreme, whatever the rounding of the sine.
        v = np.where(fractions == 0.0, self.values[0], np.where(fractions == 1.0, self.values[-1], v))
        return np.clip(v, self.values.min(), self.values.max())

    def when(self, leg: int, v: float) -> float:
        """The fraction θ at which v is reached between corners `leg` and `leg + 1`."""
        t0, t1 = self.fractions[leg], self.fractions[leg + 1]
        v0, v1 = self.values[leg], self.values[leg + 1]
        if v0 == v1:
            return float(t0)
        if self.shape == "linear":
            fraction = t0 + (v - v0) / (v1 - v0) * (t1 - t0)
        else:
            mean, amplitude, cycles = self.wave
            angle = float(np.arcsin(np.clip((v - mean) / amplitude, -1.0, 1.0)))
            # arcsin is in the rising quarter around 0; fold it into this leg's half period.
            half = round(float(t0 + t1) * cycles)
            fraction = (half * np.pi + (angle if half % 2 == 0 else -angle)) / (2.0 * np.pi * cycles)
        return float(min(max(fraction, t0), t1))


@dataclass(frozen=True)
class Leg:
    """A part of a step, from fraction `start` to `end` of it: the way that voltages go, and how v moves."""

    way: Way
    waveform: Waveform
    start: float = 0.0
    end: float = 1.0

    def of_step(self, fraction: float) -> float:
        """A fraction of this leg as one of the step."""
        return self.start + (self.end - self.start) * fraction

    def within(self, fractions: FloatArray) -> FloatArray:
        """Rising fractions of the step as those of this leg; those that lie in it, up to rounding."""
        slack = 1e-9 * (self.end - self.start)
        first = np.searchsorted(fractions, self.start - slack)
        last = np.searchsorted(fractions, self.end + slack, side="right")
        return (fractions[first:last] - self.start) / (self.end - self.start)


def ramp(start: float, end: float) -> Waveform:
    """From `start` to `end` in a straight line."""
    return Waveform(np.array([0.0, 1.0]), np.array([start, end]))


def sine(mean: float, amplitude: float, cycles: float) -> Waveform:
    """`mean + amplitude sin(2π cycles θ)`, beginning at its mean."""
    quarters = np.arange(1, np.floor(4.0 * cycles) + 1)
    extremes = quarters[(quarters % 2 == 1) & (quarters < 4.0 * cycles)]
    fractions = np.concatenate(([0.0], extremes / (4.0 * cycles), [1.0]))
    values = np.concatenate(
        (
            [mean],
            mean + amplitude * np.where(extremes % 4 == 1, 1.0, -1.0),
            [mean + amplitude * np.sin(2.0 * np.pi * cycles) if (2.0 * cycles) % 1.0 else mean],
        )
    )
    return Waveform(fractions, values, "sine", (mean, amplitude, cycles))


def triangle(low: float, high: float, cycles: float) -> Waveform:
    """`low` to `high` and back `cycles` times; a broken cycle stops where it is."""
    halves = np.arange(np.ceil(2.0 * cycles) + 1)
    values = np.where(halves % 2 == 0, low, high)
    fractions = halves / (2.0 * cycles)
    if fractions[-1] > 1.0:
        values[-1] = np.interp(1.0, fractions, values)
    fractions[-1] = 1.0
    return Waveform(fractions, values.astype(np.float64))


def table(times: FloatArray, values: FloatArray) -> Waveform:
    """Straight lines between the rows of a table; times rise from 0."""
    return Waveform(times / times[-1], np.asarray(values, dtype=np.float64))


def sines(
    mean: Sequence[float], amplitude: Sequence[float], phase: Sequence[float], cycles: float
) -> tuple[Leg, ...]:
    """One leg for each period of sines of their own; a broken period stops where it is."""
    curve = VoltageCurve(tuple(mean), tuple(amplitude), tuple(phase))
    return tuple(
        Leg(curve, ramp(0.0, min(cycles - k, 1.0)), k / cycles, min(k + 1.0, cycles) / cycles)
        for k in range(math.ceil(cycles))
    )


def triangles(
    low: Sequence[float], high: Sequence[float], phase: Sequence[float], cycles: float
) -> tuple[Leg, ...]:
    """Straight legs between the corners of triangle waves of their own, `low` at phase 0, `high` at ½."""
    bottom, top, shift = (np.asarray(part, dtype=np.float64) for part in (low, high, phase))

    def at(turns: float) -> list[float]:
        share = 1.0 - np.abs(1.0 - 2.0 * np.mod(turns + shift, 1.0))
        voltages: list[float] = (bottom * (1.0 - share) + top * share).tolist()
        return voltages

    found = np.unique(np.mod(np.concatenate([[0.0], -shift, 0.5 - shift]), 1.0) % 1.0)
    corners = found[np.append(True, np.diff(found) > _ONE_CORNER)].tolist()
    voltages = [at(corner) for corner in corners]
    corners, voltages = [*corners, 1.0], [*voltages, voltages[0]]
    legs: list[Leg] = []
    for k in range(math.ceil(cycles)):
        for i in range(len(corners) - 1):
            start, end = k + corners[i], min(k + corners[i + 1], cycles)
            if start >= end:
                break
            target = voltages[i + 1] if end == k + corners[i + 1] else at(end - k)
            line = VoltageLine.through(voltages[i], target)
            moving = ramp(line.coordinate(voltages[i]), line.coordinate(target))
            legs.append(Leg(line, moving, start / cycles, end / cycles))
    return tuple(legs)


def polygon(times: FloatArray, voltages: FloatArray) -> tuple[Leg, ...]:
    """Straight legs from row to row of a table with a voltage for each electrode.

    Rows that follow each other along one line share a leg: where one voltage alone moves, all of them do.

    Parameters
    ----------
    times : (n,) array
        They rise from 0.
    voltages : (n, n_electroded) array
    """
    start, change = voltages[:-1], np.diff(voltages, axis=0)
    segments = np.arange(len(change))
    leader = np.argmax(np.abs(change), axis=1)
    largest = change[segments, leader]
    moves = largest != 0.0
    # Each segment on its line, as `VoltageLine.through` has it; one that stands still is on its neighbour's.
    rate = change / np.where(moves, largest, 1.0)[:, None]
    along = rate * start[segments, leader][:, None]
    through_zero = np.abs(start - along) <= _ROUNDING * np.maximum(np.abs(start), np.abs(along))
    through_zero[segments, leader] = True
    offset = np.where(through_zero, 0.0, start - along)
    if not moves.any():
        line = VoltageLine.still(voltages[0].tolist())
        return (Leg(line, Waveform(times / times[-1], np.zeros(len(times)))),)
    owner = np.maximum.accumulate(np.where(moves, segments, int(np.argmax(moves))))
    lines = np.hstack([rate, offset])[owner]
    first = np.flatnonzero(np.append(True, (lines[1:] != lines[:-1]).any(axis=1)))
    last = np.append(first[1:], len(change))
    whole = float(times[-1])
    legs = []
    for i, j, own in zip(first.tolist(), last.tolist(), owner[first].tolist(), strict=True):
        line = VoltageLine(tuple(offset[own].tolist()), tuple(rate[own].tolist()))
        begin, end = float(times[i]), float(times[j])
        fractions = (times[i : j + 1] - begin) / (end - begin)
        wave = Waveform(fractions, voltages[i : j + 1, leader[own]])
        legs.append(Leg(line, wave, begin / whole, end / whole))
    return tuple(legs)
