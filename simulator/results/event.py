"""An event of a history: when, what, and the state on both sides of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulator.events import EventKind
from simulator.results.equality import same
from simulator.units import QUANTITIES, VOLTAGE, Scales, said

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, repr=False, eq=False)
class Event:
    """One event with both sides of its jump; the `after` side is None where the history ends.

    Attributes
    ----------
    time, step, kind
        When, in which step (from 1, cycles unrolled), and what.
    voltage : (n_electroded,) array
        Voltages after the event. Only a `jump` changes them, and any event where charges are given. A valve
        opened on a state that the shared gas alone held is a `jump` that leaves them as they are.
    stretch_before, stretch_after : (n_balloons,) arrays
    pressure_before, pressure_after : float
    field_before, field_after : (n_electroded,) arrays
        True electric fields.
    dissipated : float or None
        Potential lost in the jump, Π before − Π after at the drive of the event. None where there
        is no after side.
    balloon, mode : str or None
        Of an event of a balloon's shape: which balloon, and what it would turn into, "pear" or "shear".
    cycle : int
        In which cycle, from 1; 0 outside of cycles.
    scales : Scales or None
        Of the scenario, for `si`.
    """

    time: float
    step: int
    kind: EventKind
    voltage: FloatArray
    stretch_before: FloatArray
    stretch_after: FloatArray | None
    pressure_before: float
    pressure_after: float | None
    field_before: FloatArray
    field_after: FloatArray | None
    dissipated: float | None
    balloon: str | None = None
    mode: str | None = None
    cycle: int = 0
    scales: Scales | None = None

    def __repr__(self) -> str:
        second = "" if self.scales is None else " s"
        place = ", ".join(
            f"{v:.6g}" if self.scales is None else said(VOLTAGE, self.scales, float(v)) for v in self.voltage
        )
        return f"<Event {self.kind.value} at time {self.time:.6g}{second}, voltage [{place}]>"

    def si(self, quantity: str) -> FloatArray | float:
        """A quantity in its SI unit: `event.si("voltage")` in V, `event.si("pressure_before")` in Pa.

        Parameters
        ----------
        quantity : str
            time, voltage, pressure_before, pressure_after, field_before, field_after or dissipated.

        Raises
        ------
        KeyError
            If the scenario has no [scales], the quantity no unit, or the event no such side.
        """
        dimension = QUANTITIES.get(quantity.partition("_")[0])
        value = getattr(self, quantity, None)
        if self.scales is None or dimension is None or value is None:
            lack = "no [scales]" if self.scales is None else "not a quantity of this event with a unit"
            raise KeyError(f"{quantity!r}: {lack}")
        found: FloatArray | float = value * self.scales.of(dimension)
        return found

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Event) and same(self, other)

    def __hash__(self) -> int:
        return hash((self.time, self.step, self.kind))
