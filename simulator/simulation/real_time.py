"""Histories in real time, for scenarios with `[dynamics]`: every step is a flow, none a branch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.events import SHAPE_EVENTS, EventKind
from simulator.model.conditions import stability_in_motion
from simulator.model.drive import Leg, VoltageLine, Way
from simulator.model.groups import Group
from simulator.simulation import motion
from simulator.simulation.atlas import is_empty, loses_tension
from simulator.simulation.chords import Ranges
from simulator.simulation.in_motion import Drive, Moving, PassageStates, closer, extremes, smooth_parts
from simulator.simulation.legs import SAME_INSTANT
from simulator.simulation.material import material_of
from simulator.simulation.present import Samples, Snapshot
from simulator.simulation.recorder import MOST_CORNERS
from simulator.simulation.sampling import corners_of, sample_fractions
from simulator.simulation.shape import ShapeChange, ShapeWatch
from simulator.simulation.sources import sources_of
from simulator.solver.ida import Effort
from simulator.solver.liquid_pressure import holds_liquid
from simulator.solver.margins import added_to_shape
from simulator.solver.passage import Passage
from simulator.solver.viscous import Flow

if TYPE_CHECKING:
    from simulator.model.conditions import ShapeCondition
    from simulator.model.contents import Contents
    from simulator.scenario import PlayedStep, Scenario
    from simulator.simulation.books import Books
    from simulator.simulation.recorder import Recorder
    from simulator.simulation.until import Watch
    from simulator.solver.margins import Stopping

FloatArray = NDArray[np.float64]

_BEYOND = 1e-9  # a margin so far below zero is not one of rounding
_SOON = 1e-4  # of a part of a leg: where it is seen which way voltages go
_AT_REST = 1e-12  # stretch: what moves by less does not move
_FIRST = 1e-5  # of a part of a leg: where it is seen to which side a value is left
_KINDS = frozenset(EventKind)
_SLACK = 1e-14  # of the ambient pressure: what rounding leaves of no pressure


class RealTime:
    """How balloons move that need time to follow; see `simulation.run.Kinetics`."""

    branches = 0

    def __init__(self, scenario: Scenario, record: Recorder, books: Books) -> None:
        self.scenario, self.record, self.books = scenario, record, books
        self.effort = Effort()
        self.sources = sources_of(scenario, record.present.device, material_of(scenario))
        self.material = self.sources.material(None)
        charged = self.sources.charged
        self.shapes = None if scenario.shape.on_loss == "ignore" else ShapeWatch(charged=charged)
        self.ranges = None if scenario.output.on_grid else Ranges()
        # When the step that is played ends. What comes later is not known to a run that is kept.
        self.upto = 1.0
        ambient = 1.0 if scenario.gas.law == "liquid" else scenario.gas.ambient_pressure
        self.no_pressure = _SLACK * ambient
        record.present.own = self.material.at_rest()
        record.present.supply = self.sources.supply(record.present.voltage)
        record.material = self.material if self.material.slots else None
        # What ends the step that is played early, and what of that was reached.
        self.watch: Watch | None = None
        self.reached: str | None = None
        # What held the balloons until now: before the first step nothing, as with the valve open.
        self.held_by: Contents | None = None

    def release(self) -> None:
        """Nothing moves at once, but a state that only the sealed gas held is stable no more."""
        present = self.record.present
        still = present.electrodes.line
        if self._stable(still, self.held_by) and not self._stable(still, present.contents):
            self.record.event(EventKind.LIMIT_POINT, present.snapshot, present.snapshot, 0.0)

    def jump(self, way: Way, v: float, *, loosened: bool) -> bool:
        """Change the voltages at once to those at v; nothing else does."""
        present = self.record.present
        target = way.at(v)
        if present.is_at(target):
            return False
        before = VoltageLine.still(present.given_voltage.tolist())
        still = VoltageLine.still(target.tolist())
        held = self._stable(before, self.held_by)
        groups = motion.all_balloons(self.sources.device, still, present.pressure, present.contents)
        pressure = self._pressure(self._flow(groups, still), 0.0)
        if pressure < -self.no_pressure < present.pressure:  # of a liquid, before anything has moved
            self.record.event(EventKind.LOSS_OF_TENSION, present.snapshot)
            return True
        self.sources.change(present, self.books, target)
        present.pressure = pressure
        self.record.sample_now()
        if not self._ends_at_once(groups, 0.0) and held and not self._stable(still, present.contents):
            self.record.event(EventKind.LIMIT_POINT, present.snapshot, present.snapshot, 0.0)
        self.held_by = present.contents
        return True

    def _stable(self, way: Way, contents: Contents | None) -> bool:
        """Whether the present stretches would be stable under voltages that stand still."""
        present = self.record.present
        added = self.material.stiffening(present.stretch.tolist(), present.own.tolist())
        return all(
            stability_in_motion(group.equations)(
                present.unknowns(group, 0.0).tolist(), [added[i] for i in group.members]
            )
            >= 0.0
            for group in motion.all_balloons(self.sources.device, way, present.pressure, contents)
        )

    def travel(
        self, step: PlayedStep, legs: Sequence[Leg], start: float, lasts: float, watch: Watch | None
    ) -> str | None:
        """Let the balloons flow through the legs of a step; return what ended it early, if anything did."""
        present = self.record.present
        self.watch, self.reached = watch, None
        self.held_by = present.contents
        self.upto = start + lasts or 1.0
        fractions = sample_fractions(self.scenario.output, step, legs, lasts)
        for leg in legs:
            groups = motion.moving(
                self.scenario, self.sources.device, step, leg, present.pressure, present.contents
            )
            self._leg(
                groups, leg, leg.within(fractions), start + lasts * leg.start, lasts * (leg.end - leg.start)
            )
            if self.record.ended or self.reached:
                break
        return self.reached

    def _leg(self, groups: list[Group], leg: Leg, fractions: FloatArray, start: float, lasts: float) -> None:
        """Let the balloons flow through a leg, with samples at those of the fractions that lie in it."""
        present, waveform = self.record.present, leg.waveform
        flow = self._flow(groups, leg.way)
        present.pressure = self._pressure(flow, float(waveform.values[0]))
        if self._ends_at_once(groups, float(waveform.values[0])):
            return
        every = np.unique(corners_of(leg))
        for begin, end, drive in smooth_parts(waveform, lasts):
            if self._goes_slack(flow, leg.way, drive, (end - begin) * lasts):
                self.record.event(EventKind.LOSS_OF_TENSION, present.snapshot)
                return
            within = fractions[(fractions > begin + SAME_INSTANT) & (fractions <= end + SAME_INSTANT)]
            at_end = within > end - SAME_INSTANT
            marks = np.concatenate([[begin], within[~at_end], [end]])
            # Each part in its own time: an edge of a nanosecond is as long as its own steps.
            times = (marks - begin) * lasts
            before, own_before = present.stretch, present.own
            moving = Moving(flow, self.sources, leg.way, drive)
            stops = self._stopping(moving, _FIRST * times[-1] if leg.start == begin == 0.0 else 0.0)
            passage = flow.run(drive, before, own_before, times, self.effort, stops)
            wanted = np.full(times.size, True)
            wanted[0], wanted[-1] = False, bool(at_end.any())  # the first is here already
            states = PassageStates(passage, *moving)
            place = np.searchsorted(times, passage.time)
            clock, wanted = (start + marks * lasts)[place], wanted[place]
            self._extremes(states, clock[0])
            self._record(*self._closer(states, clock, wanted))
            turns = lasts * (self._turns(leg, begin, end) - begin)
            inner = every[np.searchsorted(every, begin, side="right") : np.searchsorted(every, end)]
            corners = lasts * (inner[:MOST_CORNERS] - begin)
            self._book(states, before, own_before, turns.tolist(), corners.tolist(), start + lasts * begin)
            if passage.ended:
                return
            unseen = self._beyond(groups, drive(times[-1])[0])
            if unseen is not None:
                raise ArithmeticError(f"{unseen} was passed unseen")
        present.time = start + lasts

    def _flow(self, groups: Sequence[Group], way: Way) -> Flow:
        """The flow of all balloons along a way of the sources."""
        material = self.sources.material(way)
        return Flow(groups, material, self.scenario.shape.on_loss, self.no_pressure)

    def _pressure(self, flow: Flow, v: float) -> float:
        """The present pressure; that of a liquid follows what moves the balloons at once."""
        present = self.record.present
        if not holds_liquid(flow.groups[0]):
            return present.pressure
        return flow.state(flow.groups[0], flow.unknowns(present.stretch, present.own), v)[-2]

    def _stopping(self, moving: Moving, soon: float) -> Stopping | None:
        """What ends the step early in a passage that is about to begin; None where it has no `until`."""
        if self.watch is None:
            return None
        from simulator.simulation.stopping import stopping  # a step without `until` does without

        return stopping(self.watch, moving, self.record.present, soon)

    def _goes_slack(self, flow: Flow, way: Way, drive: Drive, lasts: float) -> bool:
        """Whether balloons without pressure lose their tension as a part of a leg begins: where they grow."""
        present = self.record.present
        if abs(present.pressure) < self.no_pressure:
            present.pressure = 0.0
        v, ahead = drive(0.0)[0], drive(_SOON * lasts)[0]
        empty = [g for g in flow.groups if is_empty(g.equations, present.unknowns(g, v))]
        if not empty:
            return False
        swelling, fastest = flow.swelling(present.stretch, present.own, v)
        if holds_liquid(flow.groups[0]):
            gains = self.sources.charged and fastest * lasts <= _AT_REST and np.any(way.at(ahead))
            return bool(gains) or self._pressure(flow, ahead) < -self.no_pressure
        if fastest * lasts > _AT_REST:
            return swelling > 0.0
        if self.sources.charged:  # films without a charge, which any voltage of a source gives one
            return bool(np.any(way.at(ahead)))
        return any(loses_tension(g.equations, present.unknowns(g, v), ahead) for g in empty)

    def _ends_at_once(self, groups: Sequence[Group], v: float) -> bool:
        """Whether the present state is beyond what ends a history; then that is recorded.

        So is a balloon's shape that a jump of the voltage has changed.
        """
        kind = self._beyond(groups, v)
        if kind is not None:
            self.record.event(kind, self.record.present.snapshot)
            return True
        for group in groups if self.shapes is not None else ():
            present = self.record.present
            state, added = present.unknowns(group, v), self._added_to_shapes(group)
            for change in self.shapes.in_state(group, state, added) if self.shapes is not None else ():
                self._shape(change, present.snapshot)
        return self.record.ended

    def _added_to_shapes(self, group: Group) -> Callable[[ShapeCondition], float]:
        """What parts of the balloons add to the margins of their shapes in the present state."""
        present, material = self.record.present, self.material
        stretch, own = present.stretch.tolist(), present.own.tolist()
        return lambda one: added_to_shape(material, group, one, stretch, own)

    def _shape(self, change: ShapeChange, here: Snapshot) -> None:
        """Record a change of a balloon's shape, if it is one."""
        if self.shapes is not None and self.shapes.takes(change):
            self.record.shape(change, here, here)

    def _beyond(self, groups: Sequence[Group], v: float) -> EventKind | None:
        """What ends a history and has a margin below zero in the present state.

        Below by more than rounding: a pressure of zero may be one of −1e-16.
        """
        for group in groups:
            state = self.record.present.unknowns(group, v).tolist()
            for condition in group.conditions[1:]:
                if condition.margin(state) < -_BEYOND:
                    return EventKind(condition.kind)
        return None

    def _extremes(self, states: PassageStates, begins: float) -> None:
        """Note where in a passage, that begins at a time, something is largest or smallest."""
        cycles = self.record.cycles
        times, stretch, own = extremes(
            states, self.record.present.device, lambda times: cycles.numbers(begins + times)
        )
        if times.size:
            nothing = np.full(times.size, np.nan)
            found = Samples(stretch, nothing, states.voltage(times, stretch, own))
            self.record.between_samples(begins + times, found)

    def _closer(
        self, states: PassageStates, clock: FloatArray, wanted: NDArray[np.bool_]
    ) -> tuple[PassageStates, FloatArray, NDArray[np.bool_]]:
        """A passage with samples where curves bend, what time it is at its times, and which are samples."""
        if self.ranges is None:
            return states, clock, wanted
        passage, device = states.passage, self.record.present.device
        chord, steps = self.scenario.output.chord, clock[0] + passage.steps.time
        places = closer(states, wanted, steps / self.upto, device, self.ranges, chord)
        at = np.searchsorted(passage.time, passage.steps.time[places])
        return (
            replace(states, passage=passage.with_steps(places)),
            np.insert(clock, at, steps[places]),
            np.insert(wanted, at, True),
        )

    def _record(self, states: PassageStates, clock: FloatArray, wanted: NDArray[np.bool_]) -> None:
        """Samples and events of a passage in order of time.

        `clock` says what time it is at the times of the passage, `wanted` which of them are samples.
        """
        present, passage = self.record.present, states.passage
        read = 1
        for passed in passage.passed:
            upto = int(np.searchsorted(passage.time, passed.time))
            self._samples(states, [k for k in range(read, upto) if wanted[k]], clock)
            read = max(read, upto)
            present.time = float(clock[0] + passed.time)
            here = states.of(passed.stretch[None], passed.own[None], [passed.time]).last
            if self.watch is not None and passed.kind in self.watch.labels:
                self.reached = str(passed.kind)
            if passed.kind not in _KINDS:
                present.take(here)
                self.record.sample_now()
                break
            if passed.kind in SHAPE_EVENTS:
                self._shape(ShapeChange(EventKind(passed.kind), passed.balloon, passed.mode), here)
            elif passed.kind == EventKind.LIMIT_POINT:
                self.record.event(EventKind.LIMIT_POINT, here, here, 0.0)
            else:
                self.record.event(EventKind(passed.kind), here)
                break  # what equal balloons do at the same instant is said once
        if not passage.ended:
            rows = [k for k in range(read, passage.time.size) if wanted[k]]
            self._samples(states, rows, clock)
            present.time = float(clock[-1])
            present.take(states.of(passage.stretch[-1:], passage.own[-1:], passage.time[-1:]).last)

    def _samples(self, states: PassageStates, rows: Sequence[int], clock: FloatArray) -> None:
        if rows:
            passage = states.passage
            found = states.of(passage.stretch[rows], passage.own[rows], passage.time[rows])
            self.record.samples(clock[rows], found)

    def _turns(self, leg: Leg, begin: float, end: float) -> FloatArray:
        """The fractions of a leg, within a part of it, at which cycles end and others begin."""
        found = leg.within(np.array(self.record.cycles.marks))
        return found[(found > begin + SAME_INSTANT) & (found <= end + SAME_INSTANT)]

    def _book(
        self,
        states: PassageStates,
        before: FloatArray,
        own: FloatArray,
        turns: Sequence[float],
        corners: Sequence[float],
        clock: float,
    ) -> None:
        """The energies of a passage that has led from some stretches to the present ones.

        Parameters
        ----------
        states : PassageStates
        before, own : arrays
            Stretches and own unknowns of the parts where it began.
        turns, corners : sequences of float
            Times of the passage at which cycles end and others begin, and at which the voltage turns.
        clock : float
            What time it was when it began.
        """
        flow, passage, cycles = states.flow, states.passage, self.record.cycles
        ended = passage.passed[-1].time if passage.ended else float(passage.time[-1])
        marks = sorted({*turns, *corners})
        places = [int(np.argmin(np.abs(passage.time - mark))) for mark in marks if mark <= ended]
        time, work, since = passage.time[0], 0.0, 0
        for number, place in enumerate([*places, passage.time.size - 1]):
            stretch, onward = passage.stretch[place], passage.own[place]
            self._book_parts(passage, since, place)
            stored = self.material.stored(before.tolist(), own.tolist())
            self.books.stored += float(self.material.stored(stretch.tolist(), onward.tolist()) - stored)
            self.books.dissipated += float(passage.friction[place] - passage.friction[since])
            done = float(passage.work[place]) - work
            until = passage.time[place]
            for group in flow.groups:
                first = np.array(flow.state(group, flow.unknowns(before, own), states.drive(time)[0]))
                last = np.array(flow.state(group, flow.unknowns(stretch, onward), states.drive(until)[0]))
                self.books.works[:] += self._share(self.books.change(group.equations, first, last, done))
                done = 0.0  # that of all groups together, booked once
            at = clock + (marks[number] if number < len(places) else float(until))
            self.record.account(at, self.books)
            if number < len(places) and marks[number] in turns:
                cycles.turns(at, self.books)
            before, own, time, since = stretch, onward, until, place
            work = float(passage.work[place])

    def _book_parts(self, passage: Passage, first: int, last: int) -> None:
        """What the parts have exchanged between two of the times of a passage."""
        device = self.record.present.device
        for i, number, part, _, places in self.material.slots:
            amounts = passage.books[last, places] - passage.books[first, places]
            for book, amount in zip(part.books, amounts.tolist(), strict=True):
                if book == "work":
                    self.books.source_works(device.electroded.index(i), amount)
                elif book == "heat" or amount:
                    which = f"{number + 1}" if book == "heat" else book
                    self.books.lose(f"{device.names[i]}_{which}", amount)

    def _share(self, work: float) -> float:
        """The work of the only source; of several only the sum is known, unless each keeps its own books."""
        if self.sources.charged:
            return 0.0
        return work if len(self.books.electroded) == 1 else np.nan
