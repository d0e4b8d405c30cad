"""Histories in real time, for scenarios with `[dynamics]`: every step is a flow, none a branch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.events import EventKind
from simulator.model.drive import Leg, Waveform, Way
from simulator.model.groups import Group
from simulator.simulation import motion
from simulator.simulation.atlas import loses_tension
from simulator.simulation.present import Samples, Snapshot
from simulator.simulation.recorder import sample_fractions
from simulator.solver.follow import Effort
from simulator.solver.viscous import Flow, Material, MaxwellBranch, Passage

if TYPE_CHECKING:
    from simulator.scenario import PlayedStep, Scenario
    from simulator.simulation.books import Books
    from simulator.simulation.recorder import Recorder
    from simulator.simulation.until import Watch

FloatArray = NDArray[np.float64]
# v and dv/dt at a time since the leg began.
Drive = Callable[[float], tuple[float, float]]


class RealTime:
    """How balloons move that need time to follow; see `simulation.run.Kinetics`."""

    branches = 0

    def __init__(self, scenario: Scenario, record: Recorder, books: Books) -> None:
        self.scenario, self.record, self.books = scenario, record, books
        self.effort = Effort()
        self.material = material_of(scenario)
        # Inner stretches of the Maxwell branches: stress free, as the stretches.
        self.inner: FloatArray = np.ones(len(self.material.creeping))

    def release(self) -> None:
        """Nothing moves at once."""

    def jump(self, way: Way, v: float, *, loosened: bool) -> bool:
        """Change the voltages at once to those at v; nothing else does."""
        present = self.record.present
        target = way.at(v)
        if np.array_equal(target, present.voltage):
            return False
        self.books.change_voltages(present.device, present.stretch, present.voltage, target)
        present.voltage = target
        self.record.sample_now()
        return True

    def travel(
        self, step: PlayedStep, legs: Sequence[Leg], start: float, lasts: float, watch: Watch | None
    ) -> str | None:
        """Let the balloons flow through the legs of a step, which has no early end."""
        present = self.record.present
        fractions = sample_fractions(self.scenario.output, lasts)
        for leg in legs:
            within = leg.within(fractions)
            groups = motion.moving(
                self.scenario, present.device, step, leg, present.pressure, present.contents
            )
            self._flow(
                groups,
                leg,
                within[(within >= 0.0) & (within <= 1.0)],
                start + lasts * leg.start,
                lasts * (leg.end - leg.start),
            )
            if self.record.ended:
                break
        return None

    def _flow(self, groups: list[Group], leg: Leg, fractions: FloatArray, start: float, lasts: float) -> None:
        """Let the balloons flow through a leg, with samples at some fractions of it."""
        present, waveform = self.record.present, leg.waveform
        first = float(waveform.values[np.argmax(waveform.values != waveform.values[0])])
        v = float(waveform.values[0])
        if any(loses_tension(g.equations, present.unknowns(g, v), first) for g in groups):
            self.record.event(EventKind.LOSS_OF_TENSION, present.snapshot)
            return
        flow = Flow(groups, self.material)
        for begin, end, drive in smooth_parts(waveform, lasts):
            inside = fractions[(fractions > begin) & (fractions < end)]
            times = np.concatenate([[begin], inside, [end]]) * lasts
            before, inner_before = present.stretch, self.inner
            passage = flow.run(drive, present.stretch, self.inner, times, self.effort)
            wanted = np.isin(passage.time, fractions * lasts) | (passage.time == times[-1])
            self._record(flow, leg.way, drive, passage, wanted, start)
            self._book(flow, drive, passage, before, inner_before)
            if passage.ended:
                return
        present.time = start + lasts

    def _record(
        self,
        flow: Flow,
        way: Way,
        drive: Drive,
        passage: Passage,
        wanted: NDArray[np.bool_],
        start: float,
    ) -> None:
        """Samples and events of a passage in order of time."""
        read = 1  # the first is here already
        for passed in passage.passed:
            upto = int(np.searchsorted(passage.time, passed.time))
            self._samples(flow.groups, way, drive, passage, range(read, upto), wanted, start)
            read = max(read, upto)
            self.record.present.time = start + passed.time
            v = drive(passed.time)[0]
            here = Snapshot(passed.stretch, _pressure(flow.groups, passed.stretch, v), way.at(v))
            if passed.kind == EventKind.LIMIT_POINT:
                self.record.event(EventKind.LIMIT_POINT, here, here, 0.0)
            else:
                self.record.event(EventKind(passed.kind), here)
        if not passage.ended:
            self._samples(flow.groups, way, drive, passage, range(read, passage.time.size), wanted, start)

    def _book(
        self, flow: Flow, drive: Drive, passage: Passage, before: FloatArray, inner_before: FloatArray
    ) -> None:
        """The energies of a passage that has led from some stretches to the present ones."""
        stretch = self.record.present.stretch
        springs = flow.spring_energy(before, inner_before)
        self.inner = passage.inner
        self.books.stored += flow.spring_energy(stretch, self.inner) - springs
        self.books.dissipated += passage.dissipated
        v0 = drive(passage.time[0])[0]
        v1 = drive(passage.passed[-1].time if passage.ended else passage.time[-1])[0]
        work = passage.work
        for group in flow.groups:
            first = np.array(flow.state(group, before.tolist(), v0))
            last = np.array(flow.state(group, stretch.tolist(), v1))
            self.books.change(group.equations, first, last, work)
            work = 0.0  # that of all groups together, booked once

    def _samples(
        self,
        groups: Sequence[Group],
        way: Way,
        drive: Drive,
        passage: Passage,
        rows: range,
        wanted: NDArray[np.bool_],
        start: float,
    ) -> None:
        chosen = [k for k in rows if wanted[k]]
        if not chosen:
            return
        times, stretch = passage.time[chosen], passage.stretch[chosen]
        v = np.array([drive(t)[0] for t in times])
        pressure = np.array([_pressure(groups, x, c) for x, c in zip(stretch, v, strict=True)])
        self.record.samples(start + times, Samples(stretch, pressure, way.at(v)))


def material_of(scenario: Scenario) -> Material:
    """How a scenario's balloons take their time."""
    dynamics = scenario.dynamics
    assert dynamics is not None
    return Material(
        tuple(dynamics.relaxation_of(balloon.name) for balloon in scenario.balloons),
        tuple(
            None if balloon.maxwell is None else MaxwellBranch(balloon.maxwell.modulus, balloon.maxwell.time)
            for balloon in scenario.balloons
        ),
    )


def smooth_parts(waveform: Waveform, lasts: float) -> list[tuple[float, float, Drive]]:
    """Fractions of a leg between which the drive is smooth, and v and dv/dt at a time since its start."""
    if waveform.shape == "sine":
        mean, amplitude, cycles = waveform.wave
        rate = 2.0 * np.pi * cycles / lasts

        def wave(t: float) -> tuple[float, float]:
            return (
                float(mean + amplitude * np.sin(rate * t)),
                float(amplitude * rate * np.cos(rate * t)),
            )

        return [(0.0, 1.0, wave)]

    def straight(begin: float, v0: float, speed: float) -> Drive:
        return lambda t: (v0 + speed * (t - begin), speed)

    parts = []
    for (t0, t1), (v0, v1) in zip(
        zip(waveform.fractions, waveform.fractions[1:], strict=False),
        zip(waveform.values, waveform.values[1:], strict=False),
        strict=True,
    ):
        speed = float((v1 - v0) / ((t1 - t0) * lasts))
        parts.append((float(t0), float(t1), straight(float(t0 * lasts), float(v0), speed)))
    return parts


def _pressure(groups: Sequence[Group], stretch: FloatArray, v: float) -> float:
    equations = groups[0].equations
    if equations.has_pressure:
        return float(equations.gas_pressure([stretch[i] for i in groups[0].members], v))
    return float(equations.pressure([1.0, v]))
