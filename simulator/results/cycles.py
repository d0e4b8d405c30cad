"""The cycles of a history, and the largest and smallest values on its way."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.results.equality import same

if TYPE_CHECKING:
    from simulator.results.history import Event

FloatArray = NDArray[np.float64]

_ROUNDING = 1e-15  # of a field: what a sine leaves of none
VISCOUS = "viscous"  # what is lost between events, under [dynamics]


@dataclass(frozen=True, eq=False)
class Extremes:
    """The largest and smallest values of a history, or of a cycle, between its samples too.

    The states are those of the equilibrium paths and both sides of every event (of a snap not what lies
    between them); under `[dynamics]` those that the integrator passes.

    Attributes
    ----------
    largest_stretch, smallest_stretch : (n_balloons,) arrays
    largest_field, smallest_field : (n_electroded,) arrays
        Of the size of the true electric field.
    """

    largest_stretch: FloatArray
    smallest_stretch: FloatArray
    largest_field: FloatArray
    smallest_field: FloatArray

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Extremes) and same(self, other)

    @classmethod
    def of(cls, stretch: FloatArray, field: FloatArray) -> Extremes:
        """Those of n states: stretches (n, n_balloons) and fields (n, n_electroded); of none, NaN."""
        if not len(stretch):
            nothing, none = np.full(stretch.shape[1], np.nan), np.full(field.shape[1], np.nan)
            return cls(nothing, nothing, none, none)
        largest, smallest = np.abs(field).max(axis=0), np.abs(field).min(axis=0)
        smallest[smallest <= _ROUNDING * largest] = 0.0
        return cls(stretch.max(axis=0), stretch.min(axis=0), largest, smallest)


@dataclass(frozen=True)
class Closest:
    """Where a film comes closest to breakdown: time, step, |E|, E_b and the margin 1 − |E|/E_b."""

    time: float
    step: int
    field: float
    strength: float
    margin: float


@dataclass(frozen=True, eq=False)
class Cycle:
    """One cycle of a history: a period of a wave, or a repetition of `cycle`.

    Attributes
    ----------
    number : int
        From 1, through the whole history.
    start, end : float
        Times.
    complete : bool
        Whether it went to its end.
    loop_work : (n_electroded,) array
        ∫φ dq of each balloon's source over the cycle. In a closed loop their sum is what was lost. NaN with
        several electrodes under `[dynamics]`, where only the sum is known.
    total_work : float
        That of all of them.
    gas_work : float
        ∫p dV of the supply while the valve is open.
    extremes : Extremes
    dissipated : float
        All that was lost.
    losses : mapping of str to float
        What was lost in events, by their kind; and "viscous", under `[dynamics]`.
    """

    number: int
    start: float
    end: float
    complete: bool
    loop_work: FloatArray
    total_work: float
    gas_work: float
    extremes: Extremes
    dissipated: float
    losses: Mapping[str, float]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Cycle) and same(self, other)


@dataclass(frozen=True, eq=False)
class Account:
    """What had been booked by a turn of the voltages, or the end of a step.

    Attributes
    ----------
    step : int
    time : float
    works : (n_electroded,) array
        ∫φ dq of the source of each so far. NaN where only the sum is known.
    total : float
        That of all of them.
    dissipated : float
        All that was lost so far, in events and in the film.
    """

    step: int
    time: float
    works: FloatArray
    total: float
    dissipated: float

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Account) and same(self, other)


def losses(events: tuple[Event, ...], dissipated: float, *, in_real_time: bool) -> dict[str, float]:
    """What was lost in events, by their kind, and, in real time, between them."""
    found: dict[str, float] = {}
    for event in events:
        if event.dissipated:
            found[event.kind.value] = found.get(event.kind.value, 0.0) + event.dissipated
    if in_real_time:
        found[VISCOUS] = dissipated - sum(found.values())
    return found
