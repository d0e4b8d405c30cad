"""Histories in which balloons follow at once: stays on branches of equilibria, and flows between them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.events import EventKind
from simulator.model.drive import Leg, VoltageLine, Way
from simulator.model.groups import Group
from simulator.simulation import motion
from simulator.simulation.atlas import Atlas, Exit, jumps_slack
from simulator.simulation.chords import Chords
from simulator.simulation.legs import SAME_INSTANT, PlayedLeg, played_legs
from simulator.simulation.peaks import Peaks
from simulator.simulation.playback import Playback, record_exits
from simulator.simulation.present import unknowns_of
from simulator.simulation.sampling import sample_fractions
from simulator.solver.flow import Rest, steepest_first
from simulator.solver.singular import parting_directions, parts_equal_balloons, softest_change

if TYPE_CHECKING:
    from simulator.scenario import PlayedStep, Scenario
    from simulator.simulation.books import Books
    from simulator.simulation.recorder import Recorder
    from simulator.simulation.shape import ShapeWatch
    from simulator.simulation.until import Watch
    from simulator.solver.ida import Effort

FloatArray = NDArray[np.float64]

_OFF = 1e-5  # stretch by which a state that nothing holds is put off; its way is off by less than that


class QuasiStatic:
    """How balloons move that follow at once; see `simulation.run.Kinetics`."""

    def __init__(self, scenario: Scenario, record: Recorder, books: Books) -> None:
        self.scenario, self.record, self.books = scenario, record, books
        self.atlas = Atlas(scenario.solver.rtol)
        self.shapes = shape_watch(scenario)
        self.peaks = Peaks()
        self.chords = None if scenario.output.on_grid else Chords(scenario.output.chord)

    @property
    def effort(self) -> Effort:
        """What it has cost so far."""
        return self.atlas.effort

    @property
    def branches(self) -> int:
        """How many branches are known."""
        return sum(len(known) for known in self.atlas.branches.values())

    def release(self) -> None:
        """Let the balloons leave that were held by what is no longer there: shared gas, or given charges."""
        present = self.record.present
        line = present.electrodes.line
        leaving = [group for group in self._all(line) if self._falls(group, 0.0)]
        if leaving:
            exits = {place: self._fall(group, 0.0) for place, group in enumerate(leaving)}
            self._leave(leaving, line, 0.0, exits)

    def jump(self, way: Way, v: float, *, loosened: bool) -> bool:
        """Change the voltages at once to those at v; the old state relaxes under them."""
        present = self.record.present
        target = way.at(v)
        if present.is_at(target):
            return False
        across = VoltageLine.through(present.voltage.tolist(), target.tolist())
        old, new = across.coordinate(present.voltage.tolist()), across.coordinate(target.tolist())
        groups = motion.driven(present.device, across, present.pressure, present.contents)
        if any(jumps_slack(g.equations, present.unknowns(g, new), old) for g in groups):
            self.record.event(EventKind.LOSS_OF_TENSION, present.snapshot)
            return True
        exits: dict[int, Exit] = {}
        for place, group in enumerate(groups):
            state = present.unknowns(group, new)
            exits[place] = self.atlas.settle(group, state, state)
        if loosened:
            moved = {i for group in groups for i in group.members}
            for group in self._all(across):
                if not moved.intersection(group.members) and self._falls(group, new):
                    exits[len(groups)] = self._fall(group, new)
                    groups.append(group)
        self.books.change_voltages(present.device, present.stretch, present.voltage, target)
        present.voltage = target
        self._leave(groups, across, new, exits)
        return True

    def _all(self, way: Way) -> list[Group]:
        """The sets of equations of all balloons, as the valve stands."""
        present = self.record.present
        return motion.all_balloons(present.device, way, present.pressure, present.contents)

    def _falls(self, group: Group, v: float) -> bool:
        """Whether a group is where nothing holds it."""
        return float(group.conditions[0].margin(self.record.present.unknowns(group, v).tolist())) < 0.0

    def _fall(self, group: Group, v: float) -> Exit:
        """How a group leaves an equilibrium that is not stable: the way on which the potential falls more.

        Equal balloons part as from a branch point.
        """
        state, equations = self.record.present.unknowns(group, v), group.equations

        def along(change: FloatArray) -> Exit:
            start = state.copy()
            start[: change.size] += _OFF * change
            return self.atlas.settle(group, np.array(equations.admitted(start.tolist())), state, tight=True)

        if parts_equal_balloons(equations, state):
            return along(steepest_first(equations, state, parting_directions(equations, state))[0])
        change = softest_change(equations, state)
        one, other = along(change), along(-change)
        return other if other.falls_further_than(one) else one

    def _leave(self, groups: Sequence[Group], way: Way, v: float, exits: dict[int, Exit]) -> None:
        """Record the flows of some groups that begin at one instant.

        With the valve open each balloon has its own, but the first that ends the history ends them all.
        """
        if len(groups) > 1 and any(exit.landing is None for exit in exits.values()):
            exits = self._first_end(groups, way, v, exits)
        states = [self.record.present.unknowns(group, v) for group in groups]
        record_exits(self.record, self.books, groups, way, exits, states, self.shapes)

    def _first_end(
        self, groups: Sequence[Group], way: Way, v: float, exits: Mapping[int, Exit]
    ) -> dict[int, Exit]:
        """The flows of some groups up to where the first of them ends the history."""
        from simulator.simulation.common_flow import first_end  # few histories end so

        present = self.record.present
        stretch = present.stretch.copy()
        for place, exit in exits.items():
            members = list(groups[place].members)
            stretch[members] = exit.start[: len(members)]
        kind, stretch = first_end(self._all(way), stretch, v, self.effort)
        ends = [Rest(unknowns_of(group, stretch, present.pressure, v), kind) for group in groups]
        return {place: exit.ending(groups[place], ends[place]) for place, exit in exits.items()}

    def travel(
        self, step: PlayedStep, legs: Sequence[Leg], start: float, lasts: float, watch: Watch | None
    ) -> str | None:
        """Play the legs of a step; return what ended it early, if anything did."""
        present = self.record.present
        moving = partial(
            motion.moving,
            self.scenario,
            present.device,
            step,
            pressure=present.pressure,
            contents=present.contents,
        )
        found: Iterable[PlayedLeg] = played_legs(
            self.atlas,
            legs,
            moving,
            present.stretch,
            present.pressure,
            watch,
            self.shapes.ahead() if self.shapes and watch else None,
        )
        last = 1.0
        if watch is not None:
            # How far it is played comes first.
            found = list(found)
            end = found[-1]
            last = end.leg.of_step(end.early_end.fraction) if end.early_end else 1.0
        output = self.scenario.output
        fractions = sample_fractions(output, step, legs, lasts, last) if last else np.zeros(1)
        reached = None
        for played in found:
            leg = played.leg
            within = leg.within(fractions)
            begins, takes = start + lasts * leg.start, lasts * (leg.end - leg.start)
            seen = self.shapes, self.peaks, self.chords
            playback = Playback(self.record, self.books, *seen, played, begins, takes)
            playback.play(within[within <= 1.0 + SAME_INSTANT])
            reached = played.early_end.reached if played.early_end else None
            if self.record.ended:
                break
        return reached


def shape_watch(scenario: Scenario) -> ShapeWatch | None:
    """What is known of the balloons' shapes; None where the scenario ignores them."""
    if scenario.shape.on_loss == "ignore":
        return None
    from simulator.simulation.shape import ShapeWatch  # a scenario that ignores shapes does without

    return ShapeWatch()
