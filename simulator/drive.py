"""The drive: voltages and pressure in time, as straight lines through drive space walked along and back.

A history is rate independent, so time only labels its points. Each step of a scenario moves the drive
along one straight line; a `Waveform` says how far along it (the coordinate v) at each fraction θ of the
step, with the corners, where the motion turns round or kinks, declared and never discovered. Between two
corners v is monotone, so that the θ at which v takes a value is known in closed form.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Sequence

FloatArray = NDArray[np.float64]
# What the source of the electrodes gives; the other follows.
Quantity = Literal["voltage", "charge"]


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
        change = [b - a for a, b in zip(start, end, strict=True)]
        largest = max(change, key=abs)
        if largest == 0.0:
            return cls.still(start, quantity)
        leader = change.index(largest)
        rate = tuple(c / largest for c in change)
        offset = tuple(
            0.0 if i == leader or a == r * start[leader] else a - r * start[leader]
            for i, (a, r) in enumerate(zip(start, rate, strict=True))
        )
        return cls(offset, rate, quantity)

    @classmethod
    def common(cls, count: int, quantity: Quantity = "voltage") -> VoltageLine:
        """One voltage (or charge) on all electrodes: φᵢ = v."""
        return cls((0.0,) * count, (1.0,) * count, quantity)

    def coordinate(self, voltages: Sequence[float]) -> float:
        """The v at which the line passes through `voltages`; 0 on a line that goes nowhere."""
        return float(voltages[self.rate.index(1.0)]) if any(self.rate) else 0.0

    def at(self, v: FloatArray | float) -> FloatArray:
        """Voltages, or charges, at v: shape (n_electroded,) for a float, (n, n_electroded) for n values."""
        return np.asarray(np.multiply.outer(v, self.rate) + np.asarray(self.offset))


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
