"""A run in real time, for scenarios with `[dynamics]`: every step is a flow (`creep`), none a branch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.model import groups
from simulator.model.drive import Leg, Waveform, Way
from simulator.model.equations import OpenBalloon
from simulator.model.groups import Group
from simulator.results.history import Outcome
from simulator.simulation.atlas import loses_tension
from simulator.simulation.run import _Run
from simulator.solver.viscous import Flow, Material, MaxwellBranch, Passage

if TYPE_CHECKING:
    from simulator.scenario import PlayedStep, Scenario
    from simulator.simulation.until import Watch

FloatArray = NDArray[np.float64]


class CreepingRun(_Run):
    """As `_Run`, with balloons that need time to move."""

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        dynamics = scenario.dynamics
        assert dynamics is not None
        self.material = Material(
            tuple(dynamics.relaxation_of(balloon.name) for balloon in scenario.balloons),
            tuple(
                None
                if balloon.maxwell is None
                else MaxwellBranch(balloon.maxwell.modulus, balloon.maxwell.time)
                for balloon in scenario.balloons
            ),
        )
        self.inner: FloatArray = np.ones(len(self.material.creeping))  # stress free, as the stretches

    def _actuated(self, way: Way) -> list[Group]:
        if self.is_open:
            return groups.held_open(self.device, way, pressure=self.pressure)
        return [groups.held(self.device, way, gas=self.gas)]

    def _release(self, free: Sequence[Group]) -> None:
        """Nothing moves at once."""

    def _jump_to(self, way: Way, v: float) -> bool:
        target = way.at(v)
        if np.array_equal(target, self.voltage):
            return False
        self._charge(target)
        self._note_now()
        return True

    def _travel(
        self, step: PlayedStep, legs: Sequence[Leg], start: float, lasts: float, watch: Watch | None
    ) -> str | None:
        """Let the balloons flow through the legs of a step, which has no early end."""
        fractions = self._grid(lasts)
        for leg in legs:
            within = leg.within(fractions)
            share = lasts * (leg.end - leg.start)
            self._flow(
                self._groups(step, leg),
                leg.way,
                leg.waveform,
                within[(within >= 0.0) & (within <= 1.0)],
                start + lasts * leg.start,
                share,
            )
            if self.outcome is not Outcome.COMPLETED:
                break
        return None

    def _flow(
        self,
        groups: list[Group],
        line: Way,
        waveform: Waveform,
        fractions: FloatArray,
        start: float,
        lasts: float,
    ) -> None:
        first = float(waveform.values[np.argmax(waveform.values != waveform.values[0])])
        v = float(waveform.values[0])
        if any(loses_tension(g.equations, self._state(g, v), first) for g in groups):
            self._note_event("loss_of_tension", self.stretch, self.pressure, None, None, None)
            return
        flow = Flow(groups, self.material)
        for begin, end, drive in _smooth_parts(waveform, lasts):
            inside = fractions[(fractions > begin) & (fractions < end)]
            times = np.concatenate([[begin], inside, [end]]) * lasts
            passage = flow.run(drive, self.stretch, self.inner, times, self.atlas.effort)
            wanted = np.isin(passage.time, fractions * lasts) | (passage.time == times[-1])
            self._record(flow, line, drive, passage, wanted, start)
            if passage.ended:
                return
        self.clock = start + lasts

    def _record(
        self,
        flow: Flow,
        line: Way,
        drive: Callable[[float], tuple[float, float]],
        passage: Passage,
        wanted: NDArray[np.bool_],
        start: float,
    ) -> None:
        """Samples and events of a passage in order of time, and its books."""
        before, inner_before = self.stretch, self.inner
        v0 = drive(passage.time[0])[0]
        read = 1  # the first is here already
        for passed in passage.passed:
            upto = int(np.searchsorted(passage.time, passed.time))
            self._read_off(flow.groups, line, drive, passage, range(read, upto), wanted, start)
            read = max(read, upto)
            self.clock = start + passed.time
            self.voltage = line.at(drive(passed.time)[0])
            pressure = self._pressure_of(flow.groups, passed.stretch, drive(passed.time)[0])
            if passed.kind == "limit_point":
                self._note_event(passed.kind, passed.stretch, pressure, passed.stretch, pressure, 0.0)
            else:
                self._note_event(passed.kind, passed.stretch, pressure, None, None, None)
        if not passage.ended:
            self._read_off(flow.groups, line, drive, passage, range(read, passage.time.size), wanted, start)
        self.inner = passage.inner
        self.stored += flow.spring_energy(self.stretch, self.inner) - flow.spring_energy(before, inner_before)
        self.dissipated += passage.dissipated
        v1 = drive(passage.passed[-1].time if passage.ended else passage.time[-1])[0]
        work = passage.work
        for group in flow.groups:
            first = np.array(flow.state(group, before.tolist(), v0))
            last = np.array(flow.state(group, self.stretch.tolist(), v1))
            inflates = isinstance(group.equations, OpenBalloon) and group.equations.pressure_rate != 0.0
            self._book(group.equations, first, last, work if inflates else 0.0, work)
            work = 0.0  # that of all groups together, booked once

    def _read_off(
        self,
        groups: Sequence[Group],
        line: Way,
        drive: Callable[[float], tuple[float, float]],
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
        pressure = np.array([self._pressure_of(groups, x, c) for x, c in zip(stretch, v, strict=True)])
        self._note(start + times, stretch, pressure, line.at(v))

    def _pressure_of(self, groups: Sequence[Group], stretch: FloatArray, v: float) -> float:
        equations = groups[0].equations
        if equations.has_pressure:
            return float(equations.gas_pressure([stretch[i] for i in groups[0].members], v))
        return float(equations.pressure([1.0, v]))


def _smooth_parts(
    waveform: Waveform, lasts: float
) -> list[tuple[float, float, Callable[[float], tuple[float, float]]]]:
    """Fractions of a step between which the drive is smooth, and v and dv/dt at a time since its start."""
    if waveform.shape == "sine":
        mean, amplitude, cycles = waveform.wave
        rate = 2.0 * np.pi * cycles / lasts

        def wave(t: float) -> tuple[float, float]:
            return (
                float(mean + amplitude * np.sin(rate * t)),
                float(amplitude * rate * np.cos(rate * t)),
            )

        return [(0.0, 1.0, wave)]

    def straight(begin: float, v0: float, speed: float) -> Callable[[float], tuple[float, float]]:
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
