"""The legs of a step, one after the other, with the response of all that moves in them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.model.drive import Leg
from simulator.model.groups import Group
from simulator.simulation.atlas import Atlas, Response
from simulator.simulation.present import unknowns_of

if TYPE_CHECKING:
    from simulator.simulation.shape import ShapeWatch
    from simulator.simulation.until import EarlyEnd, Watch

FloatArray = NDArray[np.float64]

SAME_INSTANT = 1e-12  # fractions of a leg closer than this are one


@dataclass(frozen=True)
class PlayedLeg:
    """A leg of a step, the response to it, and where in it the step ends early, if it does."""

    leg: Leg
    responses: tuple[Response, ...]
    early_end: EarlyEnd | None


def played_legs(
    atlas: Atlas,
    legs: Sequence[Leg],
    groups_of: Callable[[Leg], list[Group]],
    stretch: FloatArray,
    pressure: float,
    watch: Watch | None,
    shapes: ShapeWatch | None = None,
) -> Iterator[PlayedLeg]:
    """The legs of a step with their responses; none after the one in which the step or the history ends.

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
    shapes : ShapeWatch, optional
        What is known of the balloons' shapes when the step begins; brought to its end.
    """
    for leg in legs:
        values = leg.waveform.values
        groups = groups_of(leg)
        starts = [unknowns_of(group, stretch, pressure, float(values[0])) for group in groups]
        responses = [atlas.response(g, y, leg.waveform) for g, y in zip(groups, starts, strict=True)]
        early_end = None
        if watch is not None:
            from simulator.simulation.until import first_end  # a run without `until` does without

            early_end, responses = first_end(watch, responses, leg.waveform, SAME_INSTANT, shapes)
        yield PlayedLeg(leg, tuple(responses), early_end)
        if early_end is not None or leg is legs[-1]:
            return
        stretch = stretch.copy()
        for response in responses:
            branch = response.exits[-1].onward if response.exits else response.branch
            if branch is None or response.failure is not None:
                return
            end = branch.state_at(float(values[-1]))
            stretch[list(response.group.members)] = end[: len(response.group.members)]
            pressure = float(response.group.equations.pressure(end.tolist()))
