"""The record of a run: samples and events as they come, and the history that they make."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.events import OUTCOMES, EventKind, Outcome
from simulator.results.cycles import Account, Closest, Extremes
from simulator.results.history import Event, History, SolverStatistics, Stop
from simulator.simulation.cycles import Cycles, cycles_of
from simulator.simulation.parts_seen import PartsSeen
from simulator.simulation.present import Present, Samples, Snapshot

if TYPE_CHECKING:
    from simulator.model.device import Device
    from simulator.scenario import Scenario
    from simulator.simulation.books import Books
    from simulator.simulation.shape import ShapeChange
    from simulator.solver.ida import Effort
    from simulator.solver.passage import Material

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

MOST_CORNERS = 5_000  # of a leg, each with its account; long recordings have none


@dataclass
class Rows:
    """Samples in chunks, each an array of n rows."""

    time: list[FloatArray] = field(default_factory=list)
    step: list[IntArray] = field(default_factory=list)
    branch: list[IntArray] = field(default_factory=list)
    cycle: list[IntArray] = field(default_factory=list)
    stretch: list[FloatArray] = field(default_factory=list)
    pressure: list[FloatArray] = field(default_factory=list)
    voltage: list[FloatArray] = field(default_factory=list)
    gas: list[FloatArray] = field(default_factory=list)
    is_open: list[NDArray[np.bool_]] = field(default_factory=list)
    charged: list[NDArray[np.bool_]] = field(default_factory=list)
    own: list[FloatArray] = field(default_factory=list)
    supply: list[FloatArray] = field(default_factory=list)


@dataclass
class Between:
    """States between samples, in which something is largest or smallest."""

    time: list[FloatArray] = field(default_factory=list)
    step: list[IntArray] = field(default_factory=list)
    cycle: list[IntArray] = field(default_factory=list)
    stretch: list[FloatArray] = field(default_factory=list)
    voltage: list[FloatArray] = field(default_factory=list)


@dataclass(frozen=True)
class WholeWay:
    """All states that are known: n samples in order of time, and then those between samples."""

    time: FloatArray
    step: IntArray
    cycle: IntArray
    stretch: FloatArray
    field: FloatArray

    def closest(self, device: Device) -> tuple[Closest, ...]:
        """Where each film with a strength comes closest to breakdown."""
        strength = device.breakdown_field(self.stretch)
        found = []
        for column, place in enumerate(device.rated):
            size = np.abs(self.field[:, place])
            margin = 1.0 - size / strength[:, column]
            least = np.flatnonzero(margin == margin.min())
            at = int(least[np.argmin(self.time[least])])
            found.append(
                Closest(
                    float(self.time[at]),
                    int(self.step[at]),
                    float(size[at]),
                    float(strength[at, column]),
                    float(margin[at]),
                )
            )
        return tuple(found)


@dataclass
class Recorder:
    """What has been seen of a device so far. What is recorded last is where the device then is."""

    present: Present
    rows: Rows = field(default_factory=Rows)
    between: Between = field(default_factory=Between)
    cycles: Cycles = field(default_factory=Cycles)
    events: list[Event] = field(default_factory=list)
    stops: list[Stop] = field(default_factory=list)
    accounts: list[Account] = field(default_factory=list)
    jumps: int = 0  # events that the device went on from
    stops_at_shape: bool = False  # whether the history ends where a balloon stops being a sphere
    material: Material | None = None  # of balloons that have parts besides their walls

    @property
    def outcome(self) -> Outcome:
        """How the history has ended, `COMPLETED` while it has not."""
        last = self.events[-1].kind if self.events else None
        if last is EventKind.LOSS_OF_SPHERICITY and self.stops_at_shape:
            return Outcome.LOSS_OF_SPHERICITY
        return Outcome.COMPLETED if last is None else OUTCOMES.get(last, Outcome.COMPLETED)

    @property
    def ended(self) -> bool:
        """Whether an event has ended the history."""
        return self.outcome is not Outcome.COMPLETED

    def samples(self, times: FloatArray, states: Samples) -> None:
        """Add n samples; the device is then where the last of them is."""
        present, rows, count = self.present, self.rows, times.size
        rows.time.append(times)
        rows.step.append(np.full(count, present.step))
        rows.branch.append(np.full(count, self.jumps))
        rows.cycle.append(self.cycles.numbers(times))
        rows.stretch.append(states.stretch)
        rows.pressure.append(states.pressure)
        rows.voltage.append(states.voltage)
        law, volume = present.device.law, present.device.volume(states.stretch)
        gas = law.amount(states.pressure, volume)
        rows.gas.append(gas if present.valve_open else np.full(count, present.amount))
        rows.is_open.append(np.full(count, present.valve_open))
        rows.charged.append(np.full(count, present.given == "charge"))
        if self.material is not None:
            rows.own.append(states.own)
            rows.supply.append(states.supply)
        present.take(states.last)

    def between_samples(self, times: FloatArray, states: Samples) -> None:
        """Note n states that are no samples, in which something is largest or smallest."""
        more = self.between
        more.time.append(times)
        more.step.append(np.full(times.size, self.present.step))
        more.cycle.append(self.cycles.numbers(times))
        more.stretch.append(states.stretch)
        more.voltage.append(states.voltage)

    @property
    def cycle(self) -> int:
        """The cycle that the device is in, 0 for none."""
        return int(self.cycles.numbers(np.array([self.present.time]))[0])

    def account(self, time: float, books: Books) -> None:
        """Note what has been booked by a time of the present step."""
        works, total = books.works.copy(), books.electrical_work
        self.accounts.append(Account(self.present.step, time, works, total, books.dissipated))

    def sample_now(self) -> None:
        """Add a sample of the present state."""
        now = self.present
        states = Samples(*(np.asarray(values)[None] for values in now.snapshot))
        self.samples(np.array([now.time]), states)

    def event(
        self,
        kind: EventKind,
        before: Snapshot,
        after: Snapshot | None = None,
        dissipated: float | None = None,
    ) -> None:
        """Add an event of the present moment and the rows of its sides.

        A row that is there already is not repeated.

        Parameters
        ----------
        kind : EventKind
        before : Snapshot
        after : Snapshot, optional
            Where the balloons are after a snap, a jump or at a branch point.
        dissipated : float, optional
            What the potential lost in between.
        """
        present, rows = self.present, self.rows
        present.take(before)
        if not (rows.time[-1][-1] == present.time and np.array_equal(rows.stretch[-1][-1], before.stretch)):
            self.sample_now()
        field_before = present.device.field(before.stretch[None], rows.voltage[-1][-1:])[0]
        end = before if after is None else after
        event = Event(
            time=present.time,
            step=present.step,
            kind=kind,
            voltage=end.voltage,
            stretch_before=before.stretch,
            stretch_after=None if after is None else after.stretch,
            pressure_before=before.pressure,
            pressure_after=None if after is None else after.pressure,
            field_before=field_before,
            field_after=None
            if after is None
            else present.device.field(after.stretch[None], after.voltage[None])[0],
            dissipated=dissipated,
            cycle=self.cycle,
        )
        self.events.append(event)
        if after is not None:
            self.jumps += 1
            present.take(after)
            self.sample_now()

    def shape(self, change: ShapeChange, before: Snapshot, after: Snapshot) -> bool:
        """Add a change of a balloon's shape, and a row of the state in which it happens.

        Parameters
        ----------
        change : ShapeChange
        before, after : Snapshot
            One state on a branch; of a flow, those between which it happens, which have their rows already.

        Returns
        -------
        bool
            Whether the history ends with it.
        """
        present, rows = self.present, self.rows
        device = present.device
        sides = (before, after)
        fields = [device.field(side.stretch[None], side.voltage[None])[0] for side in sides]
        self.events.append(
            Event(
                time=present.time,
                step=present.step,
                kind=change.kind,
                voltage=after.voltage,
                stretch_before=before.stretch,
                stretch_after=after.stretch,
                pressure_before=before.pressure,
                pressure_after=after.pressure,
                field_before=fields[0],
                field_after=fields[1],
                dissipated=0.0,
                balloon=device.names[change.balloon],
                mode=change.mode,
                cycle=self.cycle,
            )
        )
        if rows.time[-1][-1] != present.time or not np.array_equal(rows.stretch[-1][-1], after.stretch):
            present.take(after)
            self.sample_now()
        return self.ended

    def history(
        self, scenario: Scenario, books: Books, statistics: SolverStatistics, outcome: Outcome
    ) -> History:
        """The record so far, with everything derived from it."""
        rows, device = self.rows, self.present.device
        stretch, voltage = np.concatenate(rows.stretch), np.concatenate(rows.voltage)
        pressure, gas = np.concatenate(rows.pressure), np.concatenate(rows.gas)
        is_open, charged = np.concatenate(rows.is_open), np.concatenate(rows.charged)
        volume, charge = device.volume(stretch), device.charge(stretch, voltage)
        true_field, strength = device.field(stretch, voltage), device.breakdown_field(stretch)
        time, step, cycle = np.concatenate(rows.time), np.concatenate(rows.step), np.concatenate(rows.cycle)
        whole = self._whole_way(time, step, cycle, stretch, true_field)
        laps = self.cycles.cut(float(time[-1]), books)
        energy = device.energy(stretch, pressure, voltage, gas, is_open, charged)
        sphericity = (
            np.empty((0, 0)) if scenario.shape.on_loss == "ignore" else device.sphericity(stretch, voltage)
        )
        parts, supplied = PartsSeen(), self.present.supply.size > 0
        if self.material:
            parts = PartsSeen.of(self.material, device, stretch, np.concatenate(rows.own))
            energy = energy + parts.energy
            sphericity = sphericity + parts.roundness if sphericity.size else sphericity
        return History(
            scenario=scenario,
            balloons=device.names,
            electroded=scenario.electroded,
            time=time,
            step=step,
            cycle=cycle,
            branch=np.concatenate(rows.branch),
            voltage=voltage,
            stretch=stretch,
            pressure=pressure,
            volume=volume,
            gas=gas,
            field=true_field,
            charge=charge,
            energy=energy,
            stability=device.stability(stretch, pressure, voltage, is_open, charged, parts.stiffening),
            events=tuple(self.events),
            outcome=outcome,
            energy_balance=books.balance(voltage, charge, pressure, volume, is_open),
            statistics=statistics,
            stops=tuple(self.stops),
            rated=tuple(scenario.electroded[place] for place in device.rated),
            strength=strength,
            margin=1.0 - np.abs(true_field[:, list(device.rated)]) / strength,
            sphericity=sphericity,
            supply=np.concatenate(rows.supply) if supplied else np.empty((0, 0)),
            inner_of=tuple(parts.columns),
            inner=np.column_stack(list(parts.columns.values())) if parts.columns else np.empty((0, 0)),
            extremes=Extremes.of(whole.stretch, whole.field),
            closest=whole.closest(device),
            accounts=tuple(self.accounts),
            cycles=tuple(
                cycles_of(
                    laps,
                    whole.cycle,
                    whole.stretch,
                    whole.field,
                    self.events,
                    in_real_time=scenario.dynamics is not None,
                )
                if laps
                else ()
            ),
        )

    def _whole_way(
        self, time: FloatArray, step: IntArray, cycle: IntArray, stretch: FloatArray, true_field: FloatArray
    ) -> WholeWay:
        """The samples and what is between them."""
        more = self.between
        if not more.time:
            return WholeWay(time, step, cycle, stretch, true_field)
        found, voltage = np.concatenate(more.stretch), np.concatenate(more.voltage)
        return WholeWay(
            np.concatenate([time, *more.time]),
            np.concatenate([step, *more.step]),
            np.concatenate([cycle, *more.cycle]),
            np.concatenate([stretch, found]),
            np.concatenate([true_field, self.present.device.field(found, voltage)]),
        )

    def statistics(self, effort: Effort, branches: int, seconds: float) -> SolverStatistics:
        """What the run has cost."""
        return SolverStatistics(
            effort.ida_solves,
            effort.ida_steps,
            effort.residual_calls,
            effort.jacobian_calls,
            branches,
            sum(event.kind in (EventKind.LIMIT_POINT, EventKind.BRANCH_POINT) for event in self.events),
            seconds,
        )
