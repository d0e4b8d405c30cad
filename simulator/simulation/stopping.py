"""What ends a step in real time before its time: a quantity that takes a value, or an event.

A quantity is continuous in time, so a value is taken where its distance changes sign; one that is only
touched is not. A value that holds when the step begins is left first: it is looked for from that side.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from simulator.events import EventKind
from simulator.solver.margins import Stopping, Watched

if TYPE_CHECKING:
    from simulator.model.device import Device
    from simulator.simulation.in_motion import Moving
    from simulator.simulation.present import Present
    from simulator.simulation.until import Watch, WatchedValue

    Margin = Callable[[Sequence[float], float], float]

_HOLDS = 1e-7  # a relative distance from a value in which it holds: a step that ended at one is as near


def stopping(watch: Watch, moving: Moving, present: Present, soon: float) -> Stopping:
    """What ends a passage, if it is reached.

    Parameters
    ----------
    watch : Watch
    moving : Moving
        The flow that is about to begin.
    present : Present
        Where it begins.
    soon : float
        A short time after which it is seen to which side a value is left that holds; 0 where the step has
        begun before, and no value holds.
    """
    found: list[Watched] = []
    for value in watch.values:
        distance = distance_of(value, moving, present.device)
        sides = [1.0, -1.0]
        if soon and abs(value.distance(present)) <= _HOLDS:
            sides = [_leaves_to(distance, moving, present, soon)]
        found += [Watched(value.label, _signed(distance, side), ends=True) for side in sides]
    kinds = (EventKind.LIMIT_POINT,) * watch.limit_point
    return Stopping(
        tuple(found), frozenset((*kinds, *(EventKind.LOSS_OF_SPHERICITY,) * watch.loss_of_sphericity))
    )


def distance_of(value: WatchedValue, moving: Moving, device: Device) -> Margin:
    """How far a quantity is from its value, relatively, of all unknowns of a flow and v."""
    flow, at, balloon = moving.flow, value.value, value.balloon
    if value.kind == "stretch":
        return lambda y, v: y[balloon] / at - 1.0
    if value.kind == "pressure":
        group = flow.groups[0]
        return lambda y, v: float(group.equations.pressure(flow.state(group, y, v))) / at - 1.0
    place = device.electroded.index(balloon)

    def field(y: Sequence[float], v: float) -> float:
        stretch, own = np.array([y[: flow.count]]), np.array([flow.own(y)])
        voltage = moving.sources.voltage(moving.way.at(np.array([v])), stretch, own)
        return float((device.field(stretch, voltage)[0, place] / at) ** 2 - 1.0)

    return field


def _signed(distance: Margin, side: float) -> Margin:
    return lambda y, v: side * distance(y, v)


def _leaves_to(distance: Margin, moving: Moving, present: Present, soon: float) -> float:
    """The sign of a distance a little after now: by a step of Euler's under the drive of then."""
    now, v = moving.flow.unknowns(present.stretch, present.own), moving.drive(soon)[0]
    rates = moving.flow.rates_at(now, v)
    after = [value + soon * rate for value, rate in zip(now, rates, strict=True)]
    return 1.0 if distance(after, v) >= distance(now, moving.drive(0.0)[0]) else -1.0
