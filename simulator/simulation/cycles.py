"""The cycles of a run as they pass, and what they amount to."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.results.cycles import Cycle, Extremes, losses
from simulator.scenario.cycles import Count

if TYPE_CHECKING:
    from simulator.results.history import Event
    from simulator.simulation.books import Books

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_SAME = 1e-9  # of a period: a time that belongs to the cycle before it


@dataclass(frozen=True)
class Account:
    """A moment, and what had been booked until then."""

    time: float
    works: FloatArray
    electrical: float
    gas: float
    dissipated: float

    @classmethod
    def now(cls, time: float, books: Books) -> Account:
        """What has been booked."""
        return cls(time, books.works.copy(), books.electrical_work, books.gas_work, books.dissipated)


@dataclass(frozen=True)
class Lap:
    """A cycle that has been played, or the part of it that was."""

    number: int
    first: Account
    last: Account
    complete: bool


@dataclass
class Cycles:
    """The cycles of a run so far.

    Attributes
    ----------
    marks : deque of float
        Fractions of the present step at which one cycle ends and the next begins.
    """

    laps: list[Lap] = field(default_factory=list)
    marks: deque[float] = field(default_factory=deque)
    _count: Count = field(default_factory=Count)
    _start: float = 0.0
    _period: float = math.inf
    _number: int = 0
    _since: Account | None = None

    def numbers(self, times: FloatArray) -> IntArray:
        """Which cycle some times of the present step belong to, 0 for none: its end to the one that ends."""
        if math.isinf(self._period):
            return np.full(times.size, self._count.first)
        passed = np.ceil((times - self._start) / self._period - _SAME).astype(np.int64) - 1
        return self._count.first + np.maximum(passed, 0)

    def step_begins(self, count: Count, start: float, lasts: float, books: Books) -> None:
        """Note that a step begins."""
        self._count, self._start = count, start
        self._period = lasts / count.periods if count.periods else math.inf
        whole = math.ceil(count.periods - _SAME)
        self.marks = deque(k / count.periods for k in range(1, whole))
        if count.first != self._number or count.periods:
            self._open(count.first, start, books)

    def turns(self, time: float, books: Books) -> None:
        """Note that one cycle of the present step ends, and the next begins."""
        self.marks.popleft()
        self._close(time, books, complete=True)
        self._open(self._number + 1, time, books)

    def step_ends(self, time: float, books: Books, *, played: bool) -> None:
        """Note that the present step is over, and whether all of it was played."""
        self.marks.clear()
        if self._count.periods or self._count.closes or not played:
            whole = self._count.whole if self._count.periods else self._count.closes
            self._close(time, books, complete=played and whole)

    def _open(self, number: int, time: float, books: Books) -> None:
        self._number = number
        self._since = Account.now(time, books) if number else None

    def _close(self, time: float, books: Books, *, complete: bool) -> None:
        if self._since is not None:
            self.laps.append(Lap(self._number, self._since, Account.now(time, books), complete))
        self._since = None

    def cut(self, time: float, books: Books) -> list[Lap]:
        """All laps, with the one that is under way where a run fails."""
        if self._since is None:
            return self.laps
        return [*self.laps, Lap(self._number, self._since, Account.now(time, books), complete=False)]


def cycles_of(
    laps: Sequence[Lap],
    cycle: IntArray,
    stretch: FloatArray,
    true_field: FloatArray,
    events: Sequence[Event],
    *,
    in_real_time: bool,
) -> Iterator[Cycle]:
    """What the cycles of a run amount to.

    Parameters
    ----------
    laps : sequence of Lap
    cycle : (n,) array
        Of all states known: the samples in order of time, and then those between samples.
    stretch : (n, n_balloons) array
    true_field : (n, n_electroded) array
    events : sequence of Event
    in_real_time : bool
    """
    order = np.argsort(cycle, kind="stable")
    in_order = cycle[order]
    by_cycle: dict[int, list[Event]] = {}
    for event in events:
        by_cycle.setdefault(event.cycle, []).append(event)
    for lap in laps:
        first, last = np.searchsorted(in_order, [lap.number, lap.number + 1])
        mine = order[first:last]
        if mine.size and mine[0] > 0:
            mine = np.append(mine, mine[0] - 1)  # a cycle begins where the sample before its first is
        dissipated = lap.last.dissipated - lap.first.dissipated
        yield Cycle(
            lap.number,
            lap.first.time,
            lap.last.time,
            lap.complete,
            lap.last.works - lap.first.works,
            lap.last.electrical - lap.first.electrical,
            lap.last.gas - lap.first.gas,
            Extremes.of(stretch[mine], true_field[mine]),
            dissipated,
            losses(tuple(by_cycle.get(lap.number, ())), dissipated, in_real_time=in_real_time),
        )
