"""Histories in which balloons follow at once: stays on branches of equilibria, and flows between them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.events import EventKind
from simulator.model.drive import Leg, VoltageLine, Way
from simulator.model.groups import Group
from simulator.simulation import motion
from simulator.simulation.atlas import Atlas, Exit, is_slack, loses_tension
from simulator.simulation.legs import SAME_INSTANT, PlayedLeg, played_legs
from simulator.simulation.playback import Playback, record_exits
from simulator.simulation.recorder import sample_fractions
from simulator.solver.certify import ULPS
from simulator.solver.newton import softest_change

if TYPE_CHECKING:
    from simulator.scenario import PlayedStep, Scenario
    from simulator.simulation.books import Books
    from simulator.simulation.recorder import Recorder
    from simulator.simulation.until import Watch
    from simulator.solver.follow import Effort

FloatArray = NDArray[np.float64]

_OFF = 1e-3  # stretch by which a state that nothing holds is put off its place


class QuasiStatic:
    """How balloons move that follow at once; see `simulation.run.Kinetics`."""

    def __init__(self, scenario: Scenario, record: Recorder, books: Books) -> None:
        self.scenario, self.record, self.books = scenario, record, books
        self.atlas = Atlas(scenario.solver.rtol)

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
        exits: dict[int, Exit] = {}
        leaving: list[Group] = []
        for group in motion.all_balloons(present.device, line, present.pressure, present.contents):
            state = present.unknowns(group, 0.0)
            if group.conditions[0].margin(state.tolist()) >= 0.0:
                continue
            equations = group.equations
            nudge = np.zeros(state.size)
            nudge[: len(group.members)] = _OFF * softest_change(equations, state)
            # It may leave either way; it takes the steeper.
            starts = [equations.admitted((state + sign * nudge).tolist()) for sign in (1.0, -1.0)]
            start = np.array(min(starts, key=lambda y: float(equations.potential(y))))
            exits[len(leaving)] = self.atlas.settle(group, start, state, tight=True)
            leaving.append(group)
        if leaving:
            states = [present.unknowns(group, 0.0) for group in leaving]
            record_exits(self.record, self.books, leaving, line, exits, states)

    def jump(self, way: Way, v: float) -> bool:
        """Change the voltages at once to those at v; the old state relaxes under them."""
        present = self.record.present
        target = way.at(v)
        largest = max(float(np.abs(target).max()), float(np.abs(present.voltage).max()))
        if np.abs(target - present.voltage).max() <= ULPS * largest:
            return False  # where several voltages move along one way, their last digits are not exact
        across = VoltageLine.through(present.voltage.tolist(), target.tolist())
        old, new = across.coordinate(present.voltage.tolist()), across.coordinate(target.tolist())
        groups = motion.driven(present.device, across, present.pressure, present.contents)
        if any(
            loses_tension(g.equations, present.unknowns(g, old), new)
            or is_slack(g.equations, present.unknowns(g, new))
            for g in groups
        ):
            self.record.event(EventKind.LOSS_OF_TENSION, present.snapshot)
            return True
        states = [present.unknowns(group, new) for group in groups]
        exits = {place: self.atlas.settle(g, states[place], states[place]) for place, g in enumerate(groups)}
        self.books.change_voltages(present.device, present.stretch, present.voltage, target)
        present.voltage = target
        record_exits(self.record, self.books, groups, across, exits, states)
        return True

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
            self.atlas, legs, moving, present.stretch, present.pressure, watch
        )
        last = 1.0
        if watch is not None:
            # Samples are spread over what is played: how far that is comes first.
            found = list(found)
            end = found[-1]
            last = end.leg.of_step(end.early_end.fraction) if end.early_end else 1.0
        fractions = last * sample_fractions(self.scenario.output, last * lasts) if last else np.zeros(1)
        reached = None
        for played in found:
            leg = played.leg
            within = leg.within(fractions)
            Playback(
                self.record, self.books, played, start + lasts * leg.start, lasts * (leg.end - leg.start)
            ).play(within[within <= 1.0 + SAME_INSTANT])
            reached = played.early_end.reached if played.early_end else None
            if self.record.ended:
                break
        return reached
