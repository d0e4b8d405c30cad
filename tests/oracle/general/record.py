"""What a reference says of a scenario: outcome, events, states, and where it cannot decide."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.oracle.general.branch import Branch
from tests.oracle.general.device import Device
from tests.oracle.general.drive import Leg
from tests.oracle.general.energy import Energy, Stay, balance_of
from tests.oracle.general.equations import Equations

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class State:
    """One state of the device.

    Attributes
    ----------
    time : float
    step : int
        From 1, cycles unrolled.
    stretch : (n_balloons,) array
    pressure : float
    voltage, charge : (n_electroded,) arrays
    valve_open : bool
    """

    time: float
    step: int
    stretch: FloatArray
    pressure: float
    voltage: FloatArray
    charge: FloatArray
    valve_open: bool


@dataclass(frozen=True)
class ReferenceEvent:
    """One event with both of its sides; `after` and `dissipated` are None where the history ends.

    `voltage` is that after the event, `balloon` the one whose film broke, whose curve ended, or that ran
    away.
    """

    kind: str
    step: int
    time: float
    voltage: FloatArray
    before: State
    after: State | None
    dissipated: float | None
    balloon: str | None = None


@dataclass(frozen=True)
class Segment:
    """A stay between two events (or corners of the drive): how a state follows from the time."""

    device: Device
    step: int
    start: float
    end: float
    began: float
    lasts: float
    leg: Leg | None
    groups: tuple[tuple[Equations, Branch], ...]
    stretch: FloatArray
    pressure: float
    values: tuple[float, ...]
    charged: bool
    is_open: bool

    def state(self, time: float) -> State:
        """The state at a time of the segment."""
        stretch, pressure, values = self.stretch.copy(), self.pressure, self.values
        if self.leg is not None and self.groups:
            v = self.leg.at((time - self.began) / self.lasts)
            if any(e.closed or e.pressure is not None for e, _ in self.groups):
                values = tuple(self.leg.way.at(v, place) for place in range(len(values)))
            for equations, branch in self.groups:
                y = branch.state(v)
                stretch[list(equations.members)] = y[: equations.size]
                pressure = float(equations.pressure_of(y.tolist()))
        return state_of(self.device, time, self.step, stretch, pressure, values, self.charged, self.is_open)


def state_of(
    device: Device,
    time: float,
    step: int,
    stretch: FloatArray,
    pressure: float,
    values: Iterable[float],
    charged: bool,
    is_open: bool,
) -> State:
    """A state with what follows from it; `values` are voltages, or charges."""
    given = np.array(list(values), dtype=float)
    unit = device.charge(stretch, np.ones(given.size))
    voltage, charge = (given / unit, given) if charged else (given, given * unit)
    return State(time, step, stretch.copy(), float(pressure), voltage, charge, is_open)


@dataclass(frozen=True)
class Course:
    """A quasi-static history between its events; `booked` is what jumps and snaps did."""

    segments: tuple[Segment, ...]
    stays: tuple[Stay, ...]
    booked: Energy

    @cached_property
    def energy(self) -> Energy:
        """The energy balance: works by quadrature along the branches, the rest by differences of states."""
        return balance_of(self.stays, self.booked)

    def at(self, times: Iterable[float]) -> list[State]:
        """States at times that are none of an event; at a corner of the drive, that before it."""
        out = []
        starts = [segment.start for segment in self.segments]
        for time in times:
            place = max(int(np.searchsorted(starts, time)) - 1, 0)
            segment = self.segments[place]
            if not segment.start - 1e-9 <= time <= segment.end + 1e-9 * (1.0 + abs(time)):
                raise ValueError(f"time {time} is not in the history")
            out.append(segment.state(min(max(time, segment.start), segment.end)))
        return out


@dataclass(frozen=True)
class Reference:
    """A whole history.

    Attributes
    ----------
    outcome : str
        "completed", or the kind of the event that ended it.
    events : tuple of ReferenceEvent
    end : State or None
        None where nothing could be played.
    step_ends : tuple of State
        At the end of each step that was played to its end.
    undecided : str or None
        Why something might be otherwise.
    certain : int
        How many of the events, from the first on, are certain.
    dissipated : float
        By all events, or by all motion in real time.
    course : Course or None
        Of a quasi-static history. It stays in its process: no other one gets it.
    samples : (n, n_balloons) array or None
        Of a history in real time: stretches at `sample_times` in `sample_steps`.
    spread : float
        How far two ways to compute it are apart, where it was computed in two ways.
    """

    outcome: str
    events: tuple[ReferenceEvent, ...]
    end: State | None
    step_ends: tuple[State, ...]
    undecided: str | None
    certain: int
    dissipated: float = math.nan
    course: Course | None = field(default=None, repr=False)
    samples: FloatArray | None = None
    sample_times: FloatArray | None = None
    sample_steps: FloatArray | None = None
    spread: float = 0.0

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "course": None}
