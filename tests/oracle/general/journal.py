"""What is written down while a history is played, and the reference that comes of it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tests.oracle.general.energy import Energy, Stay
from tests.oracle.general.record import Reference, ReferenceEvent, Segment, State

FloatArray = NDArray[np.float64]


class Journal:
    """Events, ends of steps, stays on branches and works, and the first thing that could not be decided."""

    def __init__(self) -> None:
        self.events: list[ReferenceEvent] = []
        self.ends: list[State] = []
        self.segments: list[Segment] = []
        self.stays: list[Stay] = []
        self.grid: list[FloatArray] = []
        self.booked = Energy()
        self.doubt: str | None = None
        self.certain = 0

    def undecided(self, why: str) -> None:
        """From the next event on nothing is certain."""
        if self.doubt is None:
            self.doubt, self.certain = why, len(self.events)

    def book(
        self, electrical: float = 0.0, gas: float = 0.0, stored: float = 0.0, dissipated: float = 0.0
    ) -> None:
        """Add works, and what they became."""
        self.booked = self.booked.plus(electrical, gas, stored, dissipated)

    def reference(self, outcome: str, end: State) -> Reference:
        """All of it."""
        return Reference(
            outcome,
            tuple(self.events),
            end,
            tuple(self.ends),
            self.doubt,
            len(self.events) if self.doubt is None else self.certain,
            tuple(self.segments),
            tuple(self.stays),
            self.booked,
            np.concatenate(self.grid) if self.grid else np.zeros(0),
        )


def sample_times(start: float, end: float, lasts: float, points: int, every: float | None) -> FloatArray:
    """Times of the samples that a scenario asks for in a step, as far as it was played."""
    if not lasts:
        return np.array([start])
    played = end - start
    if every is None:
        return start + played * np.linspace(0.0, 1.0, points)
    count = math.floor(played / every * (1.0 + 1e-12))
    times = np.minimum(np.arange(count + 1) * every, played)
    return start + (times if times[-1] > played * (1.0 - 1e-9) else np.append(times, played))
