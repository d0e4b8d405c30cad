"""Where the device is at one moment of a run, and what its electrodes and its valve are connected to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from simulator.model.contents import Contents
from simulator.model.device import Device
from simulator.model.drive import Quantity, Way
from simulator.model.groups import Group
from simulator.simulation.motion import Electrodes
from simulator.solver.segment import ULPS

FloatArray = NDArray[np.float64]

_NOTHING = np.empty(0)


class Snapshot(NamedTuple):
    """A state of the whole device: stretches (n_balloons,), pressure, and voltages (n_electroded,).

    In real time also what else moves in the balloons, (n_own,), and the voltages of sources, (n_electroded,),
    where these are not those of the films.
    """

    stretch: FloatArray
    pressure: float
    voltage: FloatArray
    own: FloatArray = _NOTHING
    supply: FloatArray = _NOTHING


class Samples(NamedTuple):
    """n states: stretches (n, n_balloons), pressures (n,), and voltages (n, n_electroded).

    In real time also what else moves in the balloons, (n, n_own), and the voltages of sources,
    (n, n_electroded), where these are not those of the films.
    """

    stretch: FloatArray
    pressure: FloatArray
    voltage: FloatArray
    own: FloatArray = _NOTHING
    supply: FloatArray = _NOTHING

    def part(self, begin: int, end: int) -> Samples:
        """Some of them."""
        return Samples(*(values[begin:end] for values in self))

    @property
    def last(self) -> Snapshot:
        """The last of them."""
        own, supply = (values[-1] if values.size else _NOTHING for values in (self.own, self.supply))
        return Snapshot(self.stretch[-1], float(self.pressure[-1]), self.voltage[-1], own, supply)


@dataclass
class Present:
    """The present state of a device, which changes as a run goes on.

    Attributes
    ----------
    device : Device
    stretch : (n_balloons,) array
    pressure : float
    voltage : (n_electroded,) array
    charge : (n_electroded,) array
        As it is given, where charges are given.
    given : {"voltage", "charge"}
        What the sources of the electrodes give.
    valve_open : bool
    sealed : Contents
        The gas or liquid that was inside when the valve was last closed.
    amount : float
        How much that is.
    time : float
    step : int
        Number of the step, from 1.
    largest_voltage : float
        That there has been so far: what rounding leaves of voltages is in proportion to it.
    own : (n_own,) array
        What else moves in the balloons in real time: inner strains, charges.
    supply : (n_electroded,) array
        The voltages of sources that are not those of the films; none where they are.
    """

    device: Device
    stretch: FloatArray
    pressure: float
    voltage: FloatArray
    charge: FloatArray
    given: Quantity
    valve_open: bool
    sealed: Contents
    amount: float
    time: float
    step: int
    largest_voltage: float = 0.0
    own: FloatArray = field(default_factory=lambda: _NOTHING)
    supply: FloatArray = field(default_factory=lambda: _NOTHING)

    @classmethod
    def unstretched(cls, device: Device) -> Present:
        """Stress free at p = 0, the valve closed over whatever gas that is."""
        ones, nothing = np.ones(len(device.names)), np.zeros(len(device.electroded))
        sealed, amount = _sealed(device, ones, 0.0)
        return cls(device, ones, 0.0, nothing, nothing, "voltage", False, sealed, amount, 0.0, 1)

    @property
    def snapshot(self) -> Snapshot:
        """The state that it is in."""
        return Snapshot(self.stretch, self.pressure, self.voltage, self.own, self.supply)

    @property
    def contents(self) -> Contents | None:
        """The gas or liquid that the balloons share; None while the valve is open."""
        return None if self.valve_open else self.sealed

    @property
    def electrodes(self) -> Electrodes:
        """The voltages and charges of the electrodes."""
        charge = self.charge if self.given == "charge" else self._charges()
        return Electrodes(self.given_voltage.tolist(), charge.tolist(), self.given)

    @property
    def given_voltage(self) -> FloatArray:
        """The voltages of the sources."""
        return self.supply if self.supply.size else self.voltage

    def seal(self) -> None:
        """Close the valve in the present state."""
        self.sealed, self.amount = _sealed(self.device, self.stretch, self.pressure)

    def connect(self, given: Quantity) -> bool:
        """Put the electrodes on sources of voltage or of charge, which take over what is there.

        Returns whether charges were given before, and now voltages are.
        """
        before, self.given = self.given, given
        if given == "charge" and before == "voltage":
            self.charge = self._charges()
        return given == "voltage" and before == "charge"

    def unknowns(self, group: Group, v: float) -> FloatArray:
        """The present state as a group's unknowns y, at drive coordinate v."""
        return unknowns_of(group, self.stretch, self.pressure, v)

    def is_at(self, voltage: FloatArray) -> bool:
        """Whether the voltages are these, but for the last digits of several that move along one way."""
        largest = max(float(np.abs(voltage).max()), self.largest_voltage)
        return bool(np.abs(voltage - self.given_voltage).max() <= ULPS * largest)

    def take(self, state: Snapshot) -> None:
        """Be in another state."""
        self.stretch, self.pressure, self.voltage, self.own, self.supply = state
        self.largest_voltage = max(self.largest_voltage, float(np.abs(self.voltage).max(initial=0.0)))

    def with_groups(
        self, groups: Sequence[Group], way: Way, v: FloatArray, states: Sequence[FloatArray]
    ) -> Samples:
        """The device where some groups are in other states y; all other balloons stay as they are.

        Parameters
        ----------
        groups : sequence of Group
        way : VoltageLine or VoltageCurve
            That v is the coordinate of.
        v : (n,) array
        states : sequence of (n_unknowns, n) arrays
            For each group.
        """
        stretch = np.repeat(self.stretch[None], v.size, axis=0)
        pressure = np.full(v.size, self.pressure)
        for group, y in zip(groups, states, strict=True):
            stretch[:, list(group.members)] = y[: len(group.members)].T
            pressure[:] = group.equations.pressure(y)
        return Samples(stretch, pressure, self.device.voltage(way, v, stretch))

    def quantities(self, group: Group, way: Way, states: FloatArray) -> FloatArray:
        """All that pictures show of the device where a group is in some states (n_unknowns, n).

        Returns
        -------
        (n, n_quantities) array
            Stretches, pressure, voltages, fields and charges.
        """
        at, device = self.with_groups([group], way, states[-1], [states]), self.device
        fields, charges = device.field(at.stretch, at.voltage), device.charge(at.stretch, at.voltage)
        return np.column_stack([at.stretch, at.pressure, at.voltage, fields, charges])

    def at_instant(self, groups: Sequence[Group], way: Way, states: Sequence[FloatArray]) -> Snapshot:
        """As `with_groups`, for one state (n_unknowns,) of each group, all at the same v."""
        return self.with_groups(groups, way, states[0][-1:], [y[:, None] for y in states]).last

    def _charges(self) -> FloatArray:
        return np.asarray(self.device.charge(self.stretch[None], self.voltage[None])[0])


def unknowns_of(group: Group, stretch: FloatArray, pressure: float, v: float) -> FloatArray:
    """A state of the device as a group's unknowns y, at drive coordinate v."""
    stretches = stretch[list(group.members)]
    return np.array([*stretches, pressure, v] if group.equations.has_pressure else [*stretches, v])


def _sealed(device: Device, stretch: FloatArray, pressure: float) -> tuple[Contents, float]:
    """What is inside when the valve is closed in a state, and how much."""
    sealed = device.law.sealed(pressure, float(device.swelling(stretch[None])[0]))
    return sealed, float(device.law.amount(pressure, float(device.volume(stretch[None])[0])))
