"""What is written down while a history is played, and the reference that comes of it."""

from __future__ import annotations

from tests.oracle.general.energy import Energy, Stay
from tests.oracle.general.record import Course, Reference, ReferenceEvent, Segment, State


class Journal:
    """Events, ends of steps, stays on branches and works, and the first thing that could not be decided."""

    def __init__(self) -> None:
        self.events: list[ReferenceEvent] = []
        self.ends: list[State] = []
        self.segments: list[Segment] = []
        self.stays: list[Stay] = []
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
            self.booked.dissipated,
            Course(tuple(self.segments), tuple(self.stays), self.booked),
        )
