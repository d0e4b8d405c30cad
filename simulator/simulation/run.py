"""The only loop: step → stay on a branch → event → record, snap or stop → next stay.

A step moves the drive along a line (`drive`). Each set of equations that moves with it (`model`: one for
all balloons with the valve closed, one for each with it open) walks through the step (`walk`); their
events are merged in order of time, and samples are read off the branches on the grid the scenario asks for.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.model import groups
from simulator.model.device import Device
from simulator.model.drive import Leg, Quantity, VoltageLine, Waveform, Way
from simulator.model.equations import OpenBalloon
from simulator.model.groups import AnyEquations, Group
from simulator.results.history import EnergyBalance, Event, EventKind, History, Outcome, SolverStatistics
from simulator.results.history import Stop as StepEnd
from simulator.scenario import Charge, Hold, Inflate, Ramp, duration, until_of
from simulator.simulation import motion
from simulator.simulation.atlas import Atlas, Happening, Turn, Walk, by_time, is_slack, loses_tension
from simulator.simulation.legs import SAME_INSTANT, Course, courses, state_of
from simulator.simulation.motion import Electrodes
from simulator.solver.branch import Branch
from simulator.solver.segment import ULPS
from simulator.solver.singular import softest_change

if TYPE_CHECKING:
    from simulator.scenario import PlayedStep, Scenario, Until
    from simulator.simulation.until import Watch

FloatArray = NDArray[np.float64]

_WORK = 1e-8  # how well the work along a branch must agree with what is stored, relatively
_ENDS = ("loss_of_tension", "breakdown", "runaway", "out_of_range")


class SolverError(RuntimeError):
    """The solver failed; `history` holds everything computed up to there, its outcome `failed`."""

    def __init__(self, message: str, history: History | None = None) -> None:
        super().__init__(message)
        self.history = history


def simulate(scenario: Scenario, *, progress: Callable[[float], None] | None = None) -> History:
    """Play a scenario's steps and return what happened.

    Parameters
    ----------
    scenario : Scenario
        From `load_scenario`.
    progress : callable, optional
        Called with the fraction of steps done, after each.

    Returns
    -------
    History
        Physical ends (tension lost, film broken, runaway) are outcomes of a history, not errors.

    Raises
    ------
    SolverError
        If the solver failed; with the history up to there.
    """
    run = _Run(scenario) if scenario.dynamics is None else _creeping(scenario)
    total = sum(1 for _ in scenario.played_steps()) if progress else 0
    number = 0
    try:
        for number, step in enumerate(scenario.played_steps(), start=1):
            run.play(number, step)
            if progress:
                progress(number / total)
            if run.outcome is not Outcome.COMPLETED:
                break
    except (ArithmeticError, np.linalg.LinAlgError) as failure:
        run.outcome = Outcome.FAILED
        raise SolverError(
            f"{scenario.file}: step {number}, time {run.clock:.12g}: {failure}; last stretches "
            f"{run.stretch.tolist()}, pressure {run.pressure:.12g}, voltages {run.voltage.tolist()}; "
            "the history up to there is kept; a small change of the scenario may help",
            run.history(),
        ) from failure
    return run.history()


def _watch(ends: Until, device: Device) -> Watch:
    from simulator.simulation.until import Watch  # a run without `until` does without

    return Watch.over(ends, device)


def _creeping(scenario: Scenario) -> _Run:
    """A run in real time; its room is entered by those who ask for it."""
    from simulator.simulation.real_time import CreepingRun

    return CreepingRun(scenario)


def _leading(fractions: FloatArray, waveform: Waveform, branches: Sequence[Branch | None]) -> int:
    """How many of the fractions, from the first on, lie where all branches are known."""
    v = waveform.at(fractions)
    known = np.ones(v.size, dtype=bool)
    for branch in branches:
        if branch is not None:
            low, high = branch.known_range()
            known &= (v >= low) & (v <= high)
    return int(v.size if known.all() else np.argmin(known))


@dataclass
class _Rows:
    """Samples as they come, in chunks."""

    time: list[FloatArray] = field(default_factory=list)
    step: list[FloatArray] = field(default_factory=list)
    branch: list[FloatArray] = field(default_factory=list)
    stretch: list[FloatArray] = field(default_factory=list)
    pressure: list[FloatArray] = field(default_factory=list)
    voltage: list[FloatArray] = field(default_factory=list)
    gas: list[FloatArray] = field(default_factory=list)
    is_open: list[NDArray[np.bool_]] = field(default_factory=list)
    charged: list[NDArray[np.bool_]] = field(default_factory=list)


class _Run:
    """The state of one run: where the device is now, the branches known, the record and the books."""

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.device = Device.from_scenario(scenario)
        self.atlas = Atlas(scenario.solver.rtol)
        self.outcome = Outcome.COMPLETED
        self.rows = _Rows()
        self.events: list[Event] = []
        self.stops: list[StepEnd] = []
        self.jumps = 0
        self.electrical_work = self.gas_work = self.stored = self.dissipated = 0.0
        self.started = time.perf_counter()
        # Stress free at p = 0, the valve closed over whatever gas that is.
        self.clock = 0.0
        self.number = 1
        self.stretch: FloatArray = np.ones(len(scenario.balloons))
        self.pressure = 0.0
        self.voltage: FloatArray = np.zeros(len(self.device.electroded))
        self.charge: FloatArray = self.voltage  # as given, where the charges are
        self.given: Quantity = "voltage"
        self.is_open = False
        self._seal()

    def play(self, number: int, step: PlayedStep) -> None:
        """Play one step: first what changes at once, then what moves."""
        self.number = number
        start, lasts = self.clock, duration(step)
        opens = isinstance(step, Inflate) or step.valve == "open"
        ends = until_of(step)
        watch = _watch(ends, self.device) if ends else None
        before = self._distances(watch)
        if not self.rows.time:
            self.is_open = opens
            self._note_now()
        connects = self._connect(motion.given_by(step) or self.given)
        if opens and not self.is_open:
            self.is_open = True
            self._release(groups.held_open(self.device, self._electrodes().line, pressure=self.pressure))
        self.is_open = opens
        if self.outcome is Outcome.COMPLETED:
            legs = motion.motion(step, self.scenario.electroded, self._electrodes(), self.pressure)
            # Ramps begin where they are.
            jumps = not isinstance(step, Inflate | Hold | Ramp | Charge)
            jumped = jumps and self._jump_to(legs[0].way, float(legs[0].waveform.values[0]))
            if connects and not jumped:
                self._release_at_voltages()
            reached = self._passed(watch, before)
            if self.outcome is Outcome.COMPLETED and lasts > 0.0 and reached is None:
                reached = self._travel(step, legs, start, lasts, watch)
            if watch:
                self.stops.append(StepEnd(number, self.clock, reached))
        if opens:
            self._seal()

    def _actuated(self, way: Way) -> list[Group]:
        """What moves with the voltages along a way, as the valve stands."""
        if self.is_open:
            return groups.actuated_open(self.device, way, pressure=self.pressure)
        return groups.actuated(self.device, way, gas=self.gas)

    def _state(self, group: Group, v: float) -> FloatArray:
        """The present state as a group's unknowns, at drive coordinate v."""
        return state_of(group, self.stretch, self.pressure, v)

    def _distances(self, watch: Watch | None) -> list[float]:
        """How far the device is from each value that a step waits for."""
        present = self.device, self.stretch, self.pressure, self.voltage
        return [quantity.distance(*present) for quantity in watch.quantities] if watch else []

    def _passed(self, watch: Watch | None, before: list[float]) -> str | None:
        """The first value that a jump has passed over."""
        if watch is None:
            return None
        distances = zip(watch.quantities, before, self._distances(watch), strict=True)
        return next((quantity.label for quantity, a, b in distances if a * b < 0.0), None)

    def _electrodes(self) -> Electrodes:
        """The electrodes as they are now."""
        charge = self.charge if self.given == "charge" else self._charge_now()
        return Electrodes(self.voltage.tolist(), charge.tolist(), self.given)

    def _charge_now(self) -> FloatArray:
        return np.asarray(self.device.charge(self.stretch[None], self.voltage[None])[0])

    # -- what changes at once ------------------------------------------------------------------------

    def _connect(self, given: Quantity) -> bool:
        """Put the electrodes on sources of voltage or of charge, which take over what is there.

        Returns whether charges were given before, and now voltages are.
        """
        before, self.given = self.given, given
        if given == "charge" and before == "voltage":
            self.charge = self._charge_now()
        return given == "voltage" and before == "charge"

    def _release_at_voltages(self) -> None:
        """A state that only the given charges held leaves at the voltages it has."""
        line = self._electrodes().line
        self._release(
            groups.held_open(self.device, line, pressure=self.pressure)
            if self.is_open
            else [groups.held(self.device, line, gas=self.gas)]
        )

    def _release(self, free: Sequence[Group]) -> None:
        """Balloons that were held by what is no longer there (shared gas, given charges) leave."""
        line = self._electrodes().line
        turns: dict[int, Turn] = {}
        groups: list[Group] = []
        for group in free:
            state = self._state(group, 0.0)
            if group.conditions[0].margin(state.tolist()) >= 0.0:
                continue
            equations = group.equations
            nudge = np.zeros(state.size)
            nudge[: len(group.members)] = 1e-3 * softest_change(equations, state)
            # It may leave either way; it takes the steeper.
            starts = [equations.admitted((state + sign * nudge).tolist()) for sign in (1.0, -1.0)]
            start = np.array(min(starts, key=lambda y: float(equations.potential(y))))
            turns[len(groups)] = self.atlas.settle(group, "jump", start, state, tight=True)
            groups.append(group)
        if groups:
            self._turn(groups, line, turns, [self._state(g, 0.0) for g in groups])

    def _jump_to(self, way: Way, v: float) -> bool:
        """Voltages change at once to those at v, and the old state relaxes under them; whether they do."""
        target = way.at(v)
        largest = max(float(np.abs(target).max()), float(np.abs(self.voltage).max()))
        if np.abs(target - self.voltage).max() <= ULPS * largest:
            return False  # where several voltages move along one way, their last digits are not exact
        across = VoltageLine.through(self.voltage.tolist(), target.tolist())
        old, new = across.coordinate(self.voltage.tolist()), across.coordinate(target.tolist())
        groups = self._actuated(across)
        if any(
            loses_tension(g.equations, self._state(g, old), new) or is_slack(g.equations, self._state(g, new))
            for g in groups
        ):
            self._note_event("loss_of_tension", self.stretch, self.pressure, None, None, None)
            return True
        turns = {}
        for place, group in enumerate(groups):
            start = self._state(group, new)
            turns[place] = self.atlas.settle(group, "jump", start, start)
        self._charge(target)
        self._turn(groups, across, turns, [self._state(g, new) for g in groups])
        return True

    def _charge(self, voltage: FloatArray) -> None:
        """Change the voltages at frozen stretches: all of the supplies' work, ∫φ dq, is stored."""
        unit = self.device.charge(self.stretch[None], np.ones((1, voltage.size)))[0]
        work = 0.5 * float(unit @ (voltage**2 - self.voltage**2))
        self.electrical_work += work
        self.stored += work
        self.voltage = voltage

    # -- what moves ----------------------------------------------------------------------------------

    def _groups(self, step: PlayedStep, leg: Leg) -> list[Group]:
        """The sets of equations that move in a leg of a step."""
        if isinstance(step, Inflate):
            return groups.inflating(self.device, leg.way)
        return self._actuated(leg.way)

    def _travel(
        self, step: PlayedStep, legs: Sequence[Leg], start: float, lasts: float, watch: Watch | None
    ) -> str | None:
        """Read samples and events off the courses of a step, and say what ended it early, if anything did."""
        groups_of = partial(self._groups, step)
        found: Iterable[Course] = courses(self.atlas, legs, groups_of, self.stretch, self.pressure, watch)
        last = 1.0
        if watch is not None:
            # Samples are spread over what is played: how far that is comes first.
            found = list(found)
            end = found[-1]
            last = end.leg.of_step(end.stop.fraction) if end.stop else 1.0
        fractions = last * self._grid(last * lasts) if last else np.zeros(1)
        reached = None
        for course in found:
            self._move(course, fractions, start, lasts)
            reached = course.stop.reached if course.stop else None
            if self.outcome is not Outcome.COMPLETED:
                break
        return reached

    def _move(self, course: Course, fractions: FloatArray, start: float, lasts: float) -> None:
        """Read samples, at fractions of the step, and events off the walks of one leg, in order of time."""
        leg, walks, stop = course.leg, course.walks, course.stop
        line, waveform = leg.way, leg.waveform
        fractions = leg.within(fractions)
        fractions = fractions[fractions <= 1.0 + SAME_INSTANT]
        start, lasts = start + lasts * leg.start, lasts * (leg.end - leg.start)
        values = waveform.values
        groups = [walk.group for walk in walks]
        v = float(values[0])
        at = [walk.branch for walk in walks]
        since = [v] * len(walks)
        passed = 0.0
        for fraction, turns in by_time(walks, SAME_INSTANT):
            between = (fractions > passed + SAME_INSTANT) & (fractions < fraction - SAME_INSTANT)
            self._read(walks, at, line, waveform, fractions[between], start, lasts)
            passed = fraction
            self.clock = start + lasts * fraction
            v = float(next(iter(turns.values())).happenings[0].before[-1])
            states = [
                self._state(w.group, v) if b is None else b.state_at(v)
                for w, b in zip(walks, at, strict=True)
            ]
            for place, turn in turns.items():
                states[place] = turn.happenings[0].before
                self._book_stay(walks[place], at[place], since[place], v)
                at[place], since[place] = turn.onward, v
            self._turn(groups, line, turns, states)
            if self.outcome is not Outcome.COMPLETED:
                for place in set(range(len(walks))) - set(turns):
                    self._book_stay(walks[place], at[place], since[place], v)
                return
        rest = fractions[fractions > passed + SAME_INSTANT]
        goes_on = stop is None and values[-1] != v
        if not rest.size and goes_on:
            # However near an event was: what follows begins where this ends.
            rest = fractions[fractions > 1.0 - SAME_INSTANT][-1:]
        failure = next((walk.failure for walk in walks if walk.failure is not None), None)
        if failure is not None:
            rest = rest[: _leading(rest, waveform, at)]
        end = stop.state if stop else None
        self._read(walks, at, line, waveform, rest if end is None else rest[:-1], start, lasts)
        if failure is not None:
            self.clock = float(self.rows.time[-1][-1])
            raise failure
        v = stop.v if stop else float(values[-1])
        for walk, branch, v0 in zip(walks, at, since, strict=True):
            self._book_stay(walk, branch, v0, v)
        far = stop.fraction if stop else 1.0
        self.clock = start + lasts * far
        if self.given == "charge":
            self.charge = line.at(v)
        noted = max(passed, float(rest[-1]) if rest.size else 0.0)
        if end is not None or noted < far - SAME_INSTANT or (goes_on and not rest.size):
            states = [branch.state_at(v) for branch in at if branch is not None]
            if end is not None:
                states[end[0]] = end[1]
            present = self._compose(groups, line, np.array([v]), [y[:, None] for y in states])
            self.stretch, self.pressure, self.voltage = present[0][0], float(present[1][0]), present[2][0]
        if end is not None:
            self._note_now()

    def _grid(self, lasts: float) -> FloatArray:
        """Fractions of a step at which samples are wanted."""
        every = self.scenario.output.every
        if every is None:
            return np.linspace(0.0, 1.0, self.scenario.output.points)
        count = int(np.floor(lasts / every * (1.0 + 1e-12)))
        fractions = np.minimum(np.arange(count + 1) * (every / lasts), 1.0)
        return fractions if fractions[-1] > 1.0 - 1e-9 else np.append(fractions, 1.0)

    def _read(
        self,
        walks: Sequence[Walk],
        at: Sequence[Branch | None],
        line: Way,
        waveform: Waveform,
        fractions: FloatArray,
        start: float,
        lasts: float,
    ) -> None:
        """Samples at the given fractions, all walks staying on their branches; the last is the present."""
        if not fractions.size:
            return
        v = waveform.at(fractions)
        states = [branch.at(v) for branch in at if branch is not None]
        self._note(start + lasts * fractions, *self._compose([w.group for w in walks], line, v, states))

    def _compose(
        self, groups: Sequence[Group], line: Way, v: FloatArray, states: Sequence[FloatArray]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Stretches (n, n_balloons), pressure (n,), voltages (n, n_electroded) from the groups' states."""
        stretch = np.repeat(self.stretch[None], v.size, axis=0)
        pressure = np.full(v.size, self.pressure)
        for group, y in zip(groups, states, strict=True):
            stretch[:, list(group.members)] = y[: len(group.members)].T
            pressure[:] = group.equations.pressure(y)
        return stretch, pressure, self.device.voltage(line, v, stretch)

    def _turn(
        self, groups: Sequence[Group], line: Way, turns: dict[int, Turn], states: list[FloatArray]
    ) -> None:
        """Record what happens to some groups at one instant, round by round; the others stay."""
        states = list(states)
        rounds = max(len(turn.happenings) for turn in turns.values())
        for k in range(rounds):
            now = {place: turn.happenings[k] for place, turn in turns.items() if k < len(turn.happenings)}
            stretch, pressure, self.voltage = self._instant(groups, line, states)
            ended = next((h for h in now.values() if h.after is None), None)
            if ended is not None and any(h.after is not None for h in now.values()):
                # One balloon ends the history while another only snaps: what ends it is what is told.
                now = {place: h for place, h in now.items() if h.after is None}
            kind = next(iter(now.values())).kind
            if ended is not None:
                self._note_event(kind, stretch, float(pressure), None, None, None)
                continue
            for place, happening in now.items():
                assert happening.after is not None
                states[place] = happening.after
                self._book_jump(groups[place], happening)
            stretch_after, pressure_after, voltage_after = self._instant(groups, line, states)
            lost = sum(h.dissipated or 0.0 for h in now.values())
            self._note_event(kind, stretch, pressure, stretch_after, pressure_after, lost, voltage_after)

    def _instant(
        self, groups: Sequence[Group], line: Way, states: Sequence[FloatArray]
    ) -> tuple[FloatArray, float, FloatArray]:
        stretch, pressure, voltage = self._compose(groups, line, states[0][-1:], [y[:, None] for y in states])
        return stretch[0], float(pressure[0]), voltage[0]

    # -- record --------------------------------------------------------------------------------------

    def _seal(self) -> None:
        """Close the valve in the present state."""
        device, stretch = self.device, self.stretch[None]
        self.gas = device.law.sealed(self.pressure, float(device.swelling(stretch)[0]))
        self.amount = float(device.law.amount(self.pressure, float(device.volume(stretch)[0])))

    def _note(
        self, times: FloatArray, stretch: FloatArray, pressure: FloatArray, voltage: FloatArray
    ) -> None:
        """Add samples; the last is where the device is now."""
        rows, count = self.rows, times.size
        rows.time.append(times)
        rows.step.append(np.full(count, self.number))
        rows.branch.append(np.full(count, self.jumps))
        rows.stretch.append(stretch)
        rows.pressure.append(pressure)
        rows.voltage.append(voltage)
        gas = self.device.law.amount(pressure, self.device.volume(stretch))
        rows.gas.append(gas if self.is_open else np.full(count, self.amount))
        rows.is_open.append(np.full(count, self.is_open))
        rows.charged.append(np.full(count, self.given == "charge"))
        self.stretch, self.pressure, self.voltage = stretch[-1], float(pressure[-1]), voltage[-1]

    def _note_now(self) -> None:
        self._note(np.array([self.clock]), self.stretch[None], np.array([self.pressure]), self.voltage[None])

    def _note_event(
        self,
        kind: str,
        stretch: FloatArray,
        pressure: float,
        stretch_after: FloatArray | None,
        pressure_after: float | None,
        dissipated: float | None,
        voltage_after: FloatArray | None = None,
    ) -> None:
        """Add an event and the two rows of its sides; a row that is there already is not repeated."""
        self.stretch, self.pressure = stretch, pressure
        rows = self.rows
        if not (rows.time[-1][-1] == self.clock and np.array_equal(rows.stretch[-1][-1], stretch)):
            self._note_now()
        voltage = self.voltage if voltage_after is None else voltage_after
        field_before = self.device.field(stretch[None], rows.voltage[-1][-1:])[0]
        field_after = None
        if stretch_after is not None and pressure_after is not None:
            self.jumps += 1
            field_after = self.device.field(stretch_after[None], voltage[None])[0]
            self._note(np.array([self.clock]), stretch_after[None], np.array([pressure_after]), voltage[None])
        elif kind in _ENDS:
            self.outcome = Outcome(kind)
        self.events.append(
            Event(
                self.clock,
                self.number,
                EventKind(kind),
                voltage,
                stretch,
                stretch_after,
                pressure,
                pressure_after,
                field_before,
                field_after,
                dissipated,
            )
        )

    # -- books ---------------------------------------------------------------------------------------

    def _book_stay(self, walk: Walk, branch: Branch | None, start: float, end: float) -> None:
        """Energies of a stay on a branch: work by quadrature, storage by difference."""
        if branch is None or start == end:
            return
        equations = walk.group.equations
        work = branch.work_between(start, end)
        before, after = branch.state_at(start), branch.state_at(end)
        # The one is found along the path and the other at its ends: a path that is wrong shows here.
        first, last = (float(equations.potential(y.tolist())) for y in (before, after))
        passed = float(np.abs(branch.work).sum()) + 1e-4 * max(abs(first), abs(last))
        if abs(last - first + work) > _WORK * passed + np.finfo(float).tiny:
            raise ArithmeticError(
                f"the work along a branch, {work:.12g}, is not what the potential lost, {first - last:.12g}"
            )
        self._book(
            equations,
            before,
            after,
            work if isinstance(equations, OpenBalloon) and equations.pressure_rate else 0.0,
            work,
        )

    def _book_jump(self, group: Group, happening: Happening) -> None:
        """Energies of a jump: the drive is frozen, the loss is what the potential lost."""
        assert happening.after is not None
        self.dissipated += happening.dissipated or 0.0
        self._book(group.equations, happening.before, happening.after, 0.0, 0.0)

    def _book(
        self, equations: AnyEquations, before: FloatArray, after: FloatArray, gas: float, total: float
    ) -> None:
        a, b = before.tolist(), after.tolist()
        electric = equations.electric_supply(b) - equations.electric_supply(a)
        supplied = equations.gas_supply(b) - equations.gas_supply(a)
        # ∫φ dq = [φq] − ∫q dφ, and ∫p dV = [pV] − ∫V dp.
        self.electrical_work += electric - (total - gas)
        self.gas_work += supplied - gas
        self.stored += float(equations.potential(b)) - float(equations.potential(a)) + electric + supplied

    def _exchanged(
        self,
        voltage: FloatArray,
        charge: FloatArray,
        pressure: FloatArray,
        gas: FloatArray,
        is_open: NDArray[np.bool_],
        volume: FloatArray,
    ) -> float:
        """∫|φ dq| + ∫|p dV| as far as the samples show it: the size that an imbalance is judged against."""
        electrical = 0.5 * np.abs((voltage[1:] + voltage[:-1]) * np.diff(charge, axis=0)).sum()
        supplied = 0.5 * np.abs((pressure[1:] + pressure[:-1]) * np.diff(volume))[is_open[1:]].sum()
        # Few samples show little of it; what was booked is a bound from below.
        booked = abs(self.electrical_work) + abs(self.gas_work) + self.dissipated
        return float(max(electrical + supplied, booked))

    def history(self) -> History:
        """The record so far, with everything derived from it."""
        rows, device = self.rows, self.device
        stretch, voltage = np.concatenate(rows.stretch), np.concatenate(rows.voltage)
        pressure, gas = np.concatenate(rows.pressure), np.concatenate(rows.gas)
        is_open, charged = np.concatenate(rows.is_open), np.concatenate(rows.charged)
        volume, charge = device.volume(stretch), device.charge(stretch, voltage)
        true_field, strength = device.field(stretch, voltage), device.breakdown_field(stretch)
        books = EnergyBalance(
            self.electrical_work,
            self.gas_work,
            self.stored,
            self.dissipated,
            self.electrical_work + self.gas_work - self.stored - self.dissipated,
            self._exchanged(voltage, charge, pressure, gas, is_open, volume),
        )
        effort = self.atlas.effort
        return History(
            scenario=self.scenario,
            balloons=device.names,
            electroded=self.scenario.electroded,
            time=np.concatenate(rows.time),
            step=np.concatenate(rows.step),
            branch=np.concatenate(rows.branch),
            voltage=voltage,
            stretch=stretch,
            pressure=pressure,
            volume=volume,
            gas=gas,
            field=true_field,
            charge=charge,
            energy=device.energy(stretch, pressure, voltage, gas, is_open, charged),
            stability=device.stability(stretch, pressure, voltage, gas, is_open, charged),
            events=tuple(self.events),
            outcome=self.outcome,
            energy_balance=books,
            statistics=SolverStatistics(
                effort.ida_solves,
                effort.ida_steps,
                effort.residual_calls,
                effort.jacobian_calls,
                sum(len(known) for known in self.atlas.branches.values()),
                sum(event.kind in (EventKind.LIMIT_POINT, EventKind.BRANCH_POINT) for event in self.events),
                time.perf_counter() - self.started,
            ),
            stops=tuple(self.stops),
            rated=tuple(self.scenario.electroded[place] for place in device.rated),
            strength=strength,
            margin=1.0 - np.abs(true_field[:, list(device.rated)]) / strength,
        )
