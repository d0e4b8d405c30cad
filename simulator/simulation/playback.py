"""Samples and events of a leg, read off the responses to it in order of time."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.events import EventKind
from simulator.model.drive import Waveform, Way
from simulator.model.groups import Group
from simulator.simulation.atlas import Exit, by_time
from simulator.simulation.books import Books
from simulator.simulation.chords import Chords, closer
from simulator.simulation.legs import SAME_INSTANT, PlayedLeg
from simulator.simulation.recorder import MOST_CORNERS, Recorder
from simulator.simulation.sampling import corners_of
from simulator.solver.branch import Branch

if TYPE_CHECKING:
    from simulator.simulation.peaks import Peak, Peaks
    from simulator.simulation.present import Samples
    from simulator.simulation.shape import ShapeChange, ShapeWatch

FloatArray = NDArray[np.float64]


def record_exits(
    record: Recorder,
    books: Books,
    groups: Sequence[Group],
    way: Way,
    exits: Mapping[int, Exit],
    states: Sequence[FloatArray],
    shapes: ShapeWatch | None,
) -> None:
    """Record how some groups leave their states at one instant; the others stay.

    Parameters
    ----------
    record, books
        Added to.
    groups : sequence of Group
    way : VoltageLine or VoltageCurve
        That v is the coordinate of.
    exits : mapping of int to Exit
        By the group's place.
    states : sequence of (n_unknowns,) arrays
        The state y of each group before.
    shapes : ShapeWatch, optional
        What is known of the balloons' shapes.
    """
    states = list(states)
    before = record.present.at_instant(groups, way, states)
    # One balloon may end the history while another only snaps: the end is what is recorded.
    last = [exit for exit in exits.values() if exit.rest is None or exit.runs_away]
    if last:
        record.event(last[0].kind, before)
    else:
        for place, exit in exits.items():
            assert exit.rest is not None
            states[place] = exit.rest.state
            books.at_once(groups[place], exit.before, exit.rest.state, exit.dissipated)
        kind = next(iter(exits.values())).kind
        after = record.present.at_instant(groups, way, states)
        record.event(kind, before, after, sum(exit.dissipated for exit in exits.values()))
    if shapes is not None and not last:
        for place, exit in exits.items():
            for change in shapes.in_exit(groups[place], exit):
                if shapes.takes(change) and record.shape(change, before, after):
                    return
    # What ended a flow on its way.
    ends = [exit.rest.end for exit in exits.values() if exit.rest is not None and exit.rest.end is not None]
    if ends and not record.ended:
        record.event(EventKind(ends[0]), record.present.at_instant(groups, way, states))


class Playback:
    """One leg of a step as it is read, from its start to its end.

    Parameters
    ----------
    record, books
        Added to.
    shapes : ShapeWatch, optional
        What is known of the balloons' shapes.
    peaks : Peaks
        What is known of where something is largest or smallest.
    chords : Chords, optional
        What is known of how branches bend, where samples are to follow that.
    played : PlayedLeg
    start, lasts : float
        When the leg begins, and how long it takes.
    """

    def __init__(
        self,
        record: Recorder,
        books: Books,
        shapes: ShapeWatch | None,
        peaks: Peaks,
        chords: Chords | None,
        played: PlayedLeg,
        start: float,
        lasts: float,
    ) -> None:
        self.record, self.books, self.shapes = record, books, shapes
        self.chords, self.played = chords, played
        self.start, self.lasts = start, lasts
        self.groups = [response.group for response in played.responses]
        self.v = float(played.leg.waveform.values[0])
        self.passed = 0.0  # fraction of the leg up to which all is recorded
        # On which branch each group is, and from which v on.
        self.branches: list[Branch | None] = [response.branch for response in played.responses]
        self.since = [self.v] * len(self.groups)
        found = shapes.on_the_way(played.responses, self.waveform) if shapes is not None else []
        self.changes = deque(found)
        corners = corners_of(played.leg)
        few = np.unique(corners).tolist() if corners.size <= MOST_CORNERS else []
        self.corners = deque(corner for corner in few if 0.0 < corner < 1.0)
        self.peaks = peaks.on_the_way(
            played.responses, self.waveform, lambda at: record.cycles.numbers(start + lasts * at)
        )

    def play(self, fractions: FloatArray) -> None:
        """Record the leg, with samples at some fractions of it.

        Raises
        ------
        ArithmeticError, LinAlgError
            Where a response could not be found to its end, once all before that is recorded.
        """
        for fraction, exits in by_time(self.played.responses, SAME_INSTANT):
            between = (fractions > self.passed + SAME_INSTANT) & (fractions < fraction - SAME_INSTANT)
            self._samples(fractions[between], fraction)
            if not self.record.ended:
                self._cycles(fraction)
                self._exits(fraction, exits)
            if self.record.ended:
                for place in set(range(len(self.groups))) - set(exits):
                    self._book(place)
                return
        rest = fractions[fractions > self.passed + SAME_INSTANT]
        goes_on = self.played.early_end is None and self.waveform.values[-1] != self.v
        if not rest.size and goes_on:
            # However near an event was: what follows begins where this ends.
            rest = fractions[fractions > 1.0 - SAME_INSTANT][-1:]
        failure = next((one.failure for one in self.played.responses if one.failure is not None), None)
        if failure is not None:
            self._samples(rest[: _leading(rest, self.waveform, self.branches)], 1.0)
            self.record.present.time = float(self.record.rows.time[-1][-1])
            raise failure
        self._finish(rest, goes_on=bool(goes_on))

    @property
    def waveform(self) -> Waveform:
        """How v moves in the leg."""
        return self.played.leg.waveform

    def _samples(self, fractions: FloatArray, upto: float) -> None:
        """Samples at some fractions up to one, and changes of shape, all groups staying on their branches."""
        start = self.start
        self._between_samples(upto)
        fractions = self._closer(fractions, upto)
        at = self._states(fractions) if fractions.size else None
        begin = 0
        for change in self._changes(upto):
            place = int(np.searchsorted(fractions, change.fraction))
            if at is not None and place > begin:
                self.record.samples(start + self.lasts * fractions[begin:place], at.part(begin, place))
            begin = place
            self._shape(change)
            if self.record.ended:
                return
        if at is not None and begin < fractions.size:
            self.record.samples(start + self.lasts * fractions[begin:], at.part(begin, fractions.size))

    def _closer(self, fractions: FloatArray, upto: float) -> FloatArray:
        """Some fractions, and those between at which samples are needed for chords to be on the curve."""
        waveform, present, way = self.waveform, self.record.present, self.played.leg.way
        marks = np.concatenate([[self.passed], fractions, [upto]])
        v = waveform.at(marks)
        chords, bends = self.chords, []
        if chords is None or (v == v[0]).all():
            return fractions
        for group, branch in zip(self.groups, self.branches, strict=True):
            if branch is not None and branch.states.shape[1] > 1:

                def quantities(states: FloatArray, group: Group = group) -> FloatArray:
                    return present.quantities(group, way, states)

                bends.append(chords.bend(branch, v, quantities))
        found = closer(marks, waveform, v, bends) if bends else np.empty(0)
        if not found.size:
            return fractions
        place = np.searchsorted(marks, found)
        apart = np.minimum(found - marks[place - 1], marks[np.minimum(place, marks.size - 1)] - found)
        return np.sort(np.concatenate([fractions, found[apart > SAME_INSTANT]]))

    def _between_samples(self, upto: float) -> None:
        """Note where something is largest or smallest up to a fraction, all groups staying on branches."""
        here = [peak for peak in self.peaks if peak.fraction <= upto]
        if here:
            self.peaks = self.peaks[len(here) :]
            fractions = np.array([peak.fraction for peak in here])
            self.record.between_samples(self.start + self.lasts * fractions, self._states_at(here, fractions))

    def _cycles(self, upto: float) -> None:
        """Book up to the end of every cycle, and every turn of a wave, before a fraction.

        All groups stay on their branches.
        """
        leg, cycles = self.played.leg, self.record.cycles
        while True:
            turn = corner = math.inf
            if cycles.marks and cycles.marks[0] <= leg.of_step(upto) + SAME_INSTANT:
                turn = min(max((cycles.marks[0] - leg.start) / (leg.end - leg.start), 0.0), 1.0)
            if self.corners and self.corners[0] <= upto + SAME_INSTANT:
                corner = self.corners[0]
            fraction = min(turn, corner)
            if math.isinf(fraction):
                return
            self.v = float(self.waveform.at(np.array(fraction)))
            for place in range(len(self.groups)):
                self._book(place)
            if corner <= fraction + SAME_INSTANT:
                self.record.account(self.start + self.lasts * self.corners.popleft(), self.books)
            if turn <= fraction + SAME_INSTANT:
                cycles.turns(self.start + self.lasts * fraction, self.books)

    def _states(self, fractions: FloatArray) -> Samples:
        """The device at some fractions, all groups staying on their branches."""
        v, way = self.waveform.at(fractions), self.played.leg.way
        states = [branch.at(v) for branch in self.branches if branch is not None]
        return self.record.present.with_groups(self.groups, way, v, states)

    def _states_at(self, peaks: Sequence[Peak], fractions: FloatArray) -> Samples:
        """As `_states`, where one group is in a state that is known."""
        v, way = self.waveform.at(fractions), self.played.leg.way
        states = []
        for place, branch in enumerate(self.branches):
            if branch is not None:
                known = np.array([peak.place == place for peak in peaks])
                found = np.empty((len(branch.states), v.size))
                found[:, known] = np.array([peak.state for peak in peaks if peak.place == place]).T
                found[:, ~known] = branch.at(v[~known])
                states.append(found)
        return self.record.present.with_groups(self.groups, way, v, states)

    def _changes(self, upto: float) -> Iterator[ShapeChange]:
        """What the balloons' shapes do up to a fraction of the leg, in order of time."""
        while self.changes and self.changes[0].fraction <= upto and self.shapes is not None:
            change = self.changes.popleft()
            if self.shapes.takes(change):
                yield change

    def _shape(self, change: ShapeChange) -> None:
        """Record a change of shape; all groups are on their branches."""
        self._cycles(change.fraction)
        self.passed = max(self.passed, change.fraction)
        self.record.present.time = self.start + self.lasts * change.fraction
        self.v = float(change.before[-1])
        states = self._on_branches({change.place: change.before})
        at = self.record.present.at_instant(self.groups, self.played.leg.way, states)
        self.record.shape(change, at, at)
        if self.record.ended:
            for place in range(len(self.groups)):
                self._book(place)

    def _on_branches(self, known: Mapping[int, FloatArray]) -> list[FloatArray]:
        """The state y of each group at the present v; some, by their places, are known."""
        present = self.record.present
        return [
            known[place]
            if place in known
            else present.unknowns(group, self.v)
            if branch is None
            else branch.state_at(self.v)
            for place, (group, branch) in enumerate(zip(self.groups, self.branches, strict=True))
        ]

    def _exits(self, fraction: float, exits: Mapping[int, Exit]) -> None:
        """What happens at one instant."""
        self.passed = fraction
        self.record.present.time = self.start + self.lasts * fraction
        self.v = float(next(iter(exits.values())).before[-1])
        states = self._on_branches({place: exit.before for place, exit in exits.items()})
        for place, exit in exits.items():
            states[place] = exit.before
            self._book(place)
            self.branches[place], self.since[place] = exit.onward, self.v
        record_exits(self.record, self.books, self.groups, self.played.leg.way, exits, states, self.shapes)

    def _finish(self, fractions: FloatArray, *, goes_on: bool) -> None:
        """From the last event to the end of the leg, or to where the step ends early."""
        present, way, early = self.record.present, self.played.leg.way, self.played.early_end
        end = early.state if early else None
        far = early.fraction if early else 1.0
        self._samples(fractions if end is None else fractions[:-1], far)
        if self.record.ended:
            return
        self._cycles(far)
        self.v = early.v if early else float(self.waveform.values[-1])
        for place in range(len(self.groups)):
            self._book(place)
        present.time = self.start + self.lasts * far
        if present.given == "charge":
            present.charge = way.at(self.v)
        noted = max(self.passed, float(fractions[-1]) if fractions.size else 0.0)
        if end is not None or noted < far - SAME_INSTANT or (goes_on and not fractions.size):
            states = [branch.state_at(self.v) for branch in self.branches if branch is not None]
            if end is not None:
                states[end[0]] = end[1]
            at = [y[:, None] for y in states]
            present.take(present.with_groups(self.groups, way, np.array([self.v]), at).last)
        if end is not None:
            self.record.sample_now()

    def _book(self, place: int) -> None:
        """Book the way of a group along its branch up to here."""
        self.books.along_branch(self.groups[place], self.branches[place], self.since[place], self.v)
        self.since[place] = self.v


def _leading(fractions: FloatArray, waveform: Waveform, branches: Sequence[Branch | None]) -> int:
    """How many of the fractions, from the first on, lie where all branches are known."""
    v = waveform.at(fractions)
    known = np.ones(v.size, dtype=bool)
    for branch in branches:
        if branch is not None:
            low, high = branch.known_range()
            known &= (v >= low) & (v <= high)
    return int(v.size if known.all() else np.argmin(known))
