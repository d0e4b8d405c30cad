"""The way to an event so close that steps towards it would be lost in rounding: one interval, or none."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator import equilibrium
from simulator.equilibrium import NotConverged
from simulator.events import Condition
from simulator.model import Equations
from simulator.piece import GAUSS_POINTS, Segment, before_event, between, rounding, straight, work

if TYPE_CHECKING:
    from collections.abc import Sequence

FloatArray = NDArray[np.float64]

_LITTLE = 1e-2  # a margin below which the event may be close
_CLOSE = 1e-3  # of two states, in scaled unknowns: too close for steps from one to the other
_STRAIGHT = 1e-6  # in scaled unknowns: the length of a chord that is the curve to rounding


def up_to_event(
    equations: Equations, conditions: Sequence[Condition], start: FloatArray, target: float
) -> Segment | None:
    """A piece to an event ahead too close for steps, or to a target before it; None if none is that close.

    One interval, or the event alone where the start cannot be told from it.
    """
    sense = 1.0 if target > start[-1] else -1.0
    values = start.tolist()
    found: tuple[float, str, FloatArray] | None = None
    for condition in conditions:
        if float(condition.margin(values)) > _LITTLE:
            continue
        try:
            event = equilibrium.at_event(equations, condition, start)
        except NotConverged:
            continue
        ahead = sense * float(event[-1] - start[-1])
        if (
            np.max(np.abs(event - start) / equations.scales) < _CLOSE
            and ahead >= -rounding(equations, values[-1])
            and (found is None or ahead < found[0])
            and _ends_path(equations, condition, event, sense)
        ):
            found = ahead, condition.kind, event
    if found is None:
        return None
    ahead, kind, event = found
    way = np.zeros_like(start)
    way[-1] = sense
    if ahead <= rounding(equations, values[-1]):
        tangent = equilibrium.tangent_at_end(equations, event, way)[:, None]
        dense = np.empty((start.size, 0, GAUSS_POINTS.size))
        return Segment(event[:, None], tangent, dense, dense, np.zeros(0), kind)
    last: FloatArray = event
    end: str | None = kind
    if sense * (event[-1] - target) > rounding(equations, target):
        try:
            last = before_event(equations, start, event, target)
            end = None
        except NotConverged:
            return None
    nodes = np.stack([start, last], axis=1)
    tangents = np.stack(
        [
            equilibrium.tangents(equations, start[:, None], way[:, None])[:, 0],
            equilibrium.tangent_at_end(equations, last, last - start),
        ],
        axis=1,
    )
    # On a chord as short as the second, its points are on the curve to rounding.
    curved = np.max(np.abs(last - start) / equations.scales) > _STRAIGHT
    try:
        dense, speeds = between(equations, nodes, tangents) if curved else straight(nodes)
    except NotConverged:
        return None
    return Segment(nodes, tangents, dense, speeds, work(equations, dense, speeds), end)


def _ends_path(equations: Equations, condition: Condition, event: FloatArray, sense: float) -> bool:
    """Whether an event ends a path on which v goes in a sense, or one on which it goes the other way."""
    towards = np.zeros_like(event)
    towards[-1] = sense
    if condition.kind == "limit_point" and equilibrium.is_fold(equations, event):
        # No path goes on from there; the state falls, and a path that ends there led up to where it falls.
        escape = equilibrium.escape_direction(equations, event, sense)
        towards[: escape.size], towards[-1] = escape, 0.0
    tangent = equilibrium.tangent_at_end(equations, event, towards)
    return bool(condition.slope(event) @ tangent < 0.0)
