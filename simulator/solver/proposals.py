"""Ways too short for steps, which rounding would lose: to an event close by, or off a singular state."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.model.conditions import Condition, softest_mode
from simulator.model.equations import Equations
from simulator.solver import newton
from simulator.solver.certify import GAUSS_POINTS, Segment, before_event, between, rounding, straight, work
from simulator.solver.newton import NotConverged

if TYPE_CHECKING:
    from collections.abc import Sequence

FloatArray = NDArray[np.float64]

_LITTLE = 1e-2  # a margin below which the event may be close
_BARELY = 1e-3  # a margin of stability this small may be that of a singular point
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
    found: tuple[str, FloatArray] | None = None
    for condition in conditions:
        if float(condition.margin(values)) > _LITTLE:
            continue
        event = _event_beside(equations, condition, start, sense)
        if event is not None and (found is None or sense * (event[-1] - found[1][-1]) < 0.0):
            found = condition.kind, event
    if found is None:
        return None
    kind, event = found
    ahead = sense * float(event[-1] - start[-1])
    way = np.zeros_like(start)
    way[-1] = sense
    if ahead <= rounding(equations, values[-1]):
        tangent = newton.tangent_at_end(equations, event, way)[:, None]
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
            newton.tangents(equations, start[:, None], way[:, None])[:, 0],
            newton.tangent_at_end(equations, last, last - start),
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


def _event_beside(
    equations: Equations, condition: Condition, start: FloatArray, sense: float
) -> FloatArray | None:
    """The event close to a state that ends the path ahead of it, if there is one."""
    if condition.kind == "loss_of_tension" and start[-2] > _CLOSE * equations.scales[-2]:
        return None  # p = 0 is no closer than that
    for ahead in (0.0, 1e-6, 1e-4):  # without a voltage the forces do not yet depend on it
        guess = start.copy()
        guess[-1] += sense * ahead * equations.scales[-1]
        try:
            event = newton.at_event(equations, condition, guess)
        except NotConverged:
            continue
        if (
            np.max(np.abs(event - start) / equations.scales) < _CLOSE
            and sense * (event[-1] - start[-1]) >= -rounding(equations, float(start[-1]))
            and _ends_path(equations, condition, event, sense)
        ):
            return event
    return None


def _ends_path(equations: Equations, condition: Condition, event: FloatArray, sense: float) -> bool:
    """Whether an event ends a path on which v goes in a sense, or one on which it goes the other way."""
    towards = np.zeros_like(event)
    towards[-1] = sense
    if condition.kind == "limit_point" and newton.is_fold(equations, event):
        # No path goes on from there; the state falls, and a path that ends there led up to where it falls.
        escape = newton.escape_direction(equations, event, sense)
        towards[: escape.size], towards[-1] = escape, 0.0
    with np.errstate(invalid="ignore"):  # there may be no such tangent
        tangent = newton.tangent_at_end(equations, event, towards)
    return bool(condition.slope(event) @ tangent < -1e-9)


def off_singular(
    equations: Equations, conditions: Sequence[Condition], start: FloatArray, target: float
) -> tuple[FloatArray, FloatArray] | None:
    """A state that is barely stable, the next one on the path along its soft mode, and tangents, columns.

    Balloons sealed at the very pressure at which they snap open are in such a state: as the voltage rises
    from 0 they part like φ^⅔, at once steeply, along the mode in which one grows and the other shrinks.
    None if the path does not set out like that.
    """
    stable = conditions[0].margin
    softness = float(stable(start.tolist()))
    if not softness < _BARELY:
        return None
    sense = 1.0 if target > start[-1] else -1.0
    weights = 1.0 / equations.scales[:, None] ** 2
    mode = np.zeros((start.size, 1))
    mode[: len(equations.walls), 0] = softest_mode(equations, start)
    for length in (_CLOSE, 0.1 * _CLOSE, 0.01 * _CLOSE):
        for way in (mode, -mode):
            guess = start[:, None] + length * way
            guess[-1] += 10.0 * sense * length * equations.scales[-1]
            try:
                near, rates = newton.on_planes(equations, guess, weights * way)
            except NotConverged:
                continue
            values = near[:, 0].tolist()
            if (
                0.0 < sense * (values[-1] - start[-1]) < abs(target - start[-1])
                and float(stable(values)) > max(10.0 * softness, 0.0)
                and all(float(condition.margin(values)) > 0.0 for condition in conditions)
            ):
                nodes = np.concatenate([start[:, None], near], axis=1)
                return nodes, newton.unit(equations, np.concatenate([way, rates], axis=1))
    return None
