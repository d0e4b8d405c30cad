"""The way through a step: its legs, one after the other, walked by all that moves in them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.model.drive import Leg
from simulator.model.groups import Group
from simulator.simulation.atlas import Atlas, Walk

if TYPE_CHECKING:
    from simulator.simulation.until import Stop, Watch

FloatArray = NDArray[np.float64]

SAME_INSTANT = 1e-12  # fractions of a step closer than this are one


@dataclass(frozen=True)
class Course:
    """A leg of a step as it is walked, and where in it the step ends early, if it does."""

    leg: Leg
    walks: tuple[Walk, ...]
    stop: Stop | None


def courses(
    atlas: Atlas,
    legs: Sequence[Leg],
    groups_of: Callable[[Leg], list[Group]],
    stretch: FloatArray,
    pressure: float,
    watch: Watch | None,
) -> Iterator[Course]:
    """The legs of a step, walked; none after the one in which the step or the history ends.

    Parameters
    ----------
    atlas : Atlas
    legs : sequence of Leg
    groups_of : callable
        The sets of equations that move in a leg.
    stretch : (n_balloons,) array
    pressure : float
        Where the device is when the step begins.
    watch : Watch, optional
        What ends the step early.
    """
    for leg in legs:
        values = leg.waveform.values
        groups = [] if np.all(values == values[0]) else groups_of(leg)
        starts = [state_of(group, stretch, pressure, float(values[0])) for group in groups]
        walks = [atlas.walk(group, y, leg.waveform) for group, y in zip(groups, starts, strict=True)]
        stop = None
        if watch is not None:
            from simulator.simulation.until import first_stop  # a run without `until` does without

            stop, walks = first_stop(watch, walks, leg.waveform, SAME_INSTANT)
        yield Course(leg, tuple(walks), stop)
        if stop is not None or leg is legs[-1]:
            return
        stretch = stretch.copy()
        for walk in walks:
            branch = walk.turns[-1].onward if walk.turns else walk.branch
            if branch is None or walk.failure is not None:
                return
            end = branch.state_at(float(values[-1]))
            stretch[list(walk.group.members)] = end[: len(walk.group.members)]
            pressure = float(walk.group.equations.pressure(end.tolist()))


def state_of(group: Group, stretch: FloatArray, pressure: float, v: float) -> FloatArray:
    """A state of the device as a group's unknowns, at drive coordinate v."""
    stretches = stretch[list(group.members)]
    return np.array([*stretches, pressure, v] if group.equations.has_pressure else [*stretches, v])
