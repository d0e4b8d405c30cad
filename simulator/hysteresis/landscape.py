"""The stable states of a device along one line of voltages, found as far as somebody asks for them.

A state is a branch of equilibria between two voltages (with the valve open: one of each balloon that is
driven). It is followed once, and its ends are left once, by the same functions that play a history.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from simulator.events import EventKind
from simulator.hysteresis.setting import Setting
from simulator.model.drive import ramp
from simulator.model.groups import Alike
from simulator.simulation.atlas import Atlas, Exit, Response, by_time
from simulator.simulation.legs import SAME_INSTANT
from simulator.solver.branch import Branch

FloatArray = NDArray[np.float64]

_SAME, _OTHER = 1e-8, 1e-6  # scaled distances of polished states that are one, and that are two
UP, DOWN = 1.0, -1.0


class AmbiguousStates(ArithmeticError):
    """Two stable states are so near each other that it cannot be told whether they are one."""


@dataclass(eq=False)
class Stay:
    """A stable state: where its groups stay while v moves from `low` to `high`.

    Attributes
    ----------
    number : int
        In the order in which the states were found, from 0.
    branches : tuple of Branch
        One of each group.
    low, high : float
        Where a branch ends, or the range of the drive does.
    """

    number: int
    branches: tuple[Branch, ...]
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Departure:
    """How a state is left at one end.

    Attributes
    ----------
    kind : EventKind
    v : float
    exits : dict of int to Exit
        By the place of the group that leaves.
    target : Stay or None
        Where it comes to rest; None where the device ends.
    ending : EventKind or None
        What ends the device, there or on the way.
    """

    kind: EventKind
    v: float
    exits: dict[int, Exit]
    target: Stay | None
    ending: EventKind | None = None


@dataclass(frozen=True, eq=False)
class Passage:
    """A part of a way of the drive, in one state, from `start` to `end`; then its departure, if any."""

    stay: Stay
    start: float
    end: float
    departure: Departure | None


@dataclass(eq=False)
class Landscape:
    """The stable states between two voltages that are known so far.

    Attributes
    ----------
    setting : Setting
    atlas : Atlas
    low, high : float
        The range of the drive.
    stays : list of Stay
    """

    setting: Setting
    atlas: Atlas
    low: float
    high: float
    stays: list[Stay] = field(default_factory=list)
    _branches: dict[Alike, list[Branch]] = field(default_factory=dict)
    _first: dict[int, Branch] = field(default_factory=dict)
    _departures: dict[tuple[int, float], Departure | None] = field(default_factory=dict)

    def start(self) -> Stay | Exit:
        """The state that the drive comes to from the sealed state, on the way up to the low end.

        The exit with which the device ends, if it does before.
        """
        branches: list[Branch] = []
        for group, y in zip(self.setting.groups, self.setting.unknowns(), strict=True):
            response = self.atlas.response(group, y, ramp(0.0, self.low))
            if response.failure is not None:
                raise response.failure
            last = response.exits[-1].onward if response.exits else response.branch
            if last is None:
                return response.exits[-1]
            branches.append(last)
        return self.stay(branches)

    def stay(self, branches: Sequence[Branch]) -> Stay:
        """The state in which the groups are on some branches: a known one, if it is one.

        Raises
        ------
        AmbiguousStates
            If that cannot be told.
        ArithmeticError, LinAlgError
            If a branch cannot be followed.
        """
        known = tuple(self._first_known(place, branch) for place, branch in enumerate(branches))
        for stay in self.stays:
            if all(a is b for a, b in zip(stay.branches, known, strict=True)):
                return stay
        low, high = zip(*(self._range(branch) for branch in known), strict=True)
        self.stays.append(Stay(len(self.stays), known, max(low), min(high)))
        return self.stays[-1]

    def departure(self, stay: Stay, direction: float) -> Departure | None:
        """How a state is left upwards (1) or downwards (−1); None where it reaches to the range's end."""
        key = stay.number, direction
        if key not in self._departures:
            self._departures[key] = self._found(stay, direction)
        return self._departures[key]

    def way(self, stay: Stay, start: float, end: float) -> Iterator[Passage]:
        """The states that a drive passes from one v to another, beginning in a state.

        A drive that turns at a threshold, to within rounding, has not passed it.
        """
        v, direction = start, UP if end > start else DOWN
        while True:
            departure = self.departure(stay, direction) if v != end or start != end else None
            if departure is None or not self._passes(stay, departure, end, direction):
                yield Passage(stay, v, end, None)
                return
            yield Passage(stay, v, departure.v, departure)
            if departure.target is None:
                return
            stay, v = departure.target, departure.v

    def at(self, stay: Stay, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Stretches (n, n_balloons) and pressures (n,) of a state at n values of v in its range."""
        return self.setting.states([branch.at(v) for branch in stay.branches])

    @staticmethod
    def _passes(stay: Stay, departure: Departure, end: float, direction: float) -> bool:
        for place in departure.exits:
            low, high = stay.branches[place].known_range()
            if (end > high) if direction > 0.0 else (end < low):
                return True
        return False

    def _first_known(self, place: int, branch: Branch) -> Branch:
        """The first known branch that is the same one as this."""
        if id(branch) not in self._first:
            known = self._branches.setdefault(self.setting.groups[place].alike, [])
            reaches = self._range(branch)
            found = next((other for other in known if self._are_one(branch, reaches, other)), None)
            if found is None:
                known.append(branch)
            self._first[id(branch)] = found or branch
        return self._first[id(branch)]

    def _range(self, branch: Branch) -> tuple[float, float]:
        """Where a branch begins and ends within the range of the drive, once it is followed so far."""
        lower = self.atlas.reach(branch, self.low, self.low)
        upper = self.atlas.reach(branch, self.high, self.high)
        return (
            self.low if lower is None else float(lower.state[-1]),
            self.high if upper is None else float(upper.state[-1]),
        )

    def _are_one(self, branch: Branch, reaches: tuple[float, float], other: Branch) -> bool:
        """Whether two branches, each followed to its ends, are one: the same ends, and one state between.

        Two that only meet, at a branch point, have a state in common and no range.
        """
        theirs = self._range(other)
        low, high = max(reaches[0], theirs[0]), min(reaches[1], theirs[1])
        scales = branch.equations.scales
        apart = max(abs(a - b) for a, b in zip(reaches, theirs, strict=True)) / float(scales[-1])
        if low > high or (apart >= _OTHER and high - low < _OTHER * float(scales[-1])):
            return False
        middle = 0.5 * (low + high)
        gap = float(np.max(np.abs(branch.state_at(middle) - other.state_at(middle)) / scales))
        if gap >= _OTHER:
            return False
        if gap >= _SAME or apart >= _OTHER:
            raise AmbiguousStates(f"two states at v = {middle:.12g} are {gap:.2g} apart: one, or two?")
        return True

    def _found(self, stay: Stay, direction: float) -> Departure | None:
        """How a state is left at one end, by the first of its groups that leaves."""
        limit = self.high if direction > 0.0 else self.low
        met = [self.atlas.reach(branch, limit, limit) for branch in stay.branches]
        ends = {place: end for place, end in enumerate(met) if end is not None}
        if not ends:
            return None
        v = min((float(end.state[-1]) for end in ends.values()), key=lambda end: end * direction)
        instant = SAME_INSTANT * max(self.high - self.low, abs(v))
        leaving = [place for place, end in ends.items() if abs(float(end.state[-1]) - v) <= instant]
        groups = self.setting.groups
        responses = [
            Response(
                groups[place],
                stay.branches[place],
                (self.atlas.leave(groups[place], stay.branches[place], ends[place], direction),),
            )
            for place in leaving
        ]
        # With the valve open several balloons may leave at once; the first that ends ends them all.
        _, found = by_time(responses, SAME_INSTANT)[0]
        exits = {leaving[number]: exit for number, exit in found.items()}
        ended = [exit for exit in exits.values() if exit.landing is None]
        if ended:
            return Departure(ended[0].kind, v, exits, None, _ending(ended))
        onward = list(stay.branches)
        for place, exit in exits.items():
            assert exit.onward is not None
            onward[place] = exit.onward
        return Departure(next(iter(exits.values())).kind, v, exits, self.stay(onward))


def _ending(exits: Sequence[Exit]) -> EventKind:
    """What ends the device where some groups leave at once."""
    at_once = [exit.kind for exit in exits if exit.rest is None]
    ends = [exit.rest.end for exit in exits if exit.rest is not None and exit.rest.end is not None]
    return EventKind((at_once or ends)[0])
