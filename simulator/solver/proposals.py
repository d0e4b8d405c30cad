"""Ways to points along a path, the cheapest that may do first; only what is certified is taken.

An event close by, or a target, can be reached by one chord; the pressure that inflates one balloon is a
formula of its stretch; and IDA follows any path, at the tolerance asked for and then at tighter ones.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from simulator.model.conditions import Condition, softest_mode
from simulator.model.equations import Equations, OpenBalloon
from simulator.model.symmetry import symmetry
from simulator.solver import newton, singular
from simulator.solver.arclength import along
from simulator.solver.certify import NOISE, Proposal
from simulator.solver.ida import Effort
from simulator.solver.inflation import inflated
from simulator.solver.newton import NotConverged
from simulator.solver.segment import rounding

FloatArray = NDArray[np.float64]

_LITTLE = 1e-2  # a margin below which the event may be close
_BARELY = 1e-3  # a margin of stability this small may be that of a singular point
_CLOSE = 1e-3  # of two states, in scaled unknowns: too close for steps from one to the other
_NEAR = 1e-2  # of a target, in scaled v: as in recordings, row by row; what the chord misses is certified
_TIGHTEST = 1e-12
# Tolerance, over the one asked for, and longest step (0: any) of each attempt to follow a path with IDA.
ATTEMPTS = ((1.0, 0.0), (0.1, 0.0), (1e-2, 0.25), (1e-3, 0.05), (1e-4, 0.01), (1e-5, 2e-3))
_UPRIGHT = 1e-6  # share of v in a unit tangent, below which the state is a limit point to rounding


def proposals(
    equations: Equations,
    conditions: Sequence[Condition],
    start: FloatArray,
    target: float,
    rtol: float,
    effort: Effort,
) -> Iterator[Callable[[], Proposal | None]]:
    """Ways to propose the path from a state to v = `target`, the cheapest first; parameters as of `follow`.

    Each gives None where it does not apply, and raises NotConverged where it fails.
    """
    yield partial(to_event, equations, conditions, start, target)
    if abs(target - start[-1]) < _NEAR * equations.scales[-1]:
        yield partial(chord, equations, conditions, start, target)
    if isinstance(equations, OpenBalloon) and equations.pressure_rate:
        yield partial(by_formula, equations, conditions, start, target)
    bound = equations.longest_step / float(equations.scales[-1])
    for tighter, longest in ATTEMPTS:
        step = min(longest or bound, bound)
        yield partial(
            by_ida, equations, conditions, start, target, max(rtol * tighter, _TIGHTEST), step, effort
        )


def to_event(
    equations: Equations, conditions: Sequence[Condition], start: FloatArray, target: float
) -> Proposal | None:
    """The chord to an event ahead that is too close for steps; None if none is.

    It is the event alone where the start cannot be told from it.
    """
    sense = 1.0 if target > start[-1] else -1.0
    values = start.tolist()
    found = [
        (sense * float(event[-1] - start[-1]), place, event)
        for place, condition in enumerate(conditions)
        if float(condition.margin(values)) <= _LITTLE
        and (event := _event_beside(equations, condition, start, sense)) is not None
    ]
    if not found:
        return None
    ahead, place, event = min(found, key=lambda item: item[:2])
    way = _along_drive(start, sense)
    if ahead <= rounding(equations, values[-1]):
        with np.errstate(invalid="ignore"):
            tangent = singular.tangent_at_end(equations, event, way[:, 0])
        if not np.all(np.isfinite(tangent)):  # v does not change at a limit point: the margin falls ahead
            falling = -conditions[place].slope(event) * equations.scales**2
            tangent = singular.tangent_at_end(equations, event, falling)
        return Proposal(event[:, None], tangent[:, None], place)
    # Voltage free, v may not yet change anything at the start; at a limit point it does not change itself.
    directions = np.concatenate(
        [newton.tangents(equations, start[:, None], way), newton.unit(equations, (event - start)[:, None])],
        axis=1,
    )
    return Proposal(np.stack([start, event], axis=1), directions, place)


def chord(
    equations: Equations, conditions: Sequence[Condition], start: FloatArray, target: float
) -> Proposal:
    """The chord to a target too close for steps, which rounding would lose."""
    points = np.repeat(start[:, None], 2, axis=1)
    points[-1, 1] = target
    points[:, 1] = newton.one_at_drive(equations, points[:, 1])
    ahead = np.repeat(_along_drive(start, 1.0 if target > start[-1] else -1.0), 2, axis=1)
    return Proposal(points, newton.tangents(equations, points, ahead), len(conditions))


def by_formula(
    equations: OpenBalloon, conditions: Sequence[Condition], start: FloatArray, target: float
) -> Proposal:
    """The path of one balloon under a moving pressure, which is a formula of its stretch."""
    return Proposal(*inflated(equations, conditions, start, target))


def by_ida(
    equations: Equations,
    conditions: Sequence[Condition],
    start: FloatArray,
    target: float,
    rtol: float,
    longest_step: float,
    effort: Effort,
) -> Proposal:
    """IDA's points along the arclength, to the target or the first condition whose margin falls to zero."""
    sense = 1.0 if target > start[-1] else -1.0
    margins = [condition.margin for condition in conditions]

    def events(values: list[float], rates: list[float]) -> list[float]:
        found = [margin(values) for margin in margins]
        found.append(sense * (target - values[-1]))
        return found

    direction = newton.tangents(equations, start[:, None], _along_drive(start, sense))[:, 0]
    if abs(direction[-1]) < _UPRIGHT * equations.scales[-1]:
        # On a limit point v does not tell which way is ahead. It is where the state grows stable.
        direction = singular.tangent_at_end(equations, start, direction)
        values = start.tolist()
        # A trace knows several; it begins beside one of them.
        nearest = min(conditions, key=lambda c: (c.kind != "limit_point", abs(float(c.margin(values)))))
        direction *= np.sign(nearest.slope(start) @ direction) or 1.0
    return Proposal(
        *along(
            equations.residual,
            lambda values: equations.linearised(values)[1],
            events,
            start,
            direction,
            equations.scales,
            rtol,
            longest_step,
            effort,
        )
    )


def _along_drive(state: FloatArray, sense: float) -> FloatArray:
    """The direction in which v alone goes in a sense, a column."""
    way = np.zeros((state.size, 1))
    way[-1] = sense
    return way


def _event_beside(
    equations: Equations, condition: Condition, start: FloatArray, sense: float
) -> FloatArray | None:
    """The event close to a state that ends the path ahead of it, if there is one."""
    if condition.kind == "loss_of_tension" and start[-2] > _CLOSE * equations.scales[-2]:
        return None  # p = 0 is no closer than that
    if condition.kind == "limit_point" and abs(float(condition.margin(start.tolist()))) <= NOISE:
        if _softens_together(equations, condition, start, sense):
            return start
        if not singular.is_fold(equations, start):
            return None  # what is singular beside it is it
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


def _softens_together(equations: Equations, condition: Condition, start: FloatArray, sense: float) -> bool:
    """Whether balloons alike in a singular state are unstable as soon as v sets out.

    Without a voltage the margin falls with the square of it only, and its slope does not tell.
    """
    alike = symmetry(equations, start)
    if alike is None:
        return False
    ahead = alike.narrowed(start)
    ahead[-1] += sense * _CLOSE * equations.scales[-1]
    try:
        ahead = newton.one_at_drive(alike.equations, ahead)
    except NotConverged:
        return False
    return float(condition.margin(alike.widened(ahead.tolist()))) < -NOISE


def _ends_path(equations: Equations, condition: Condition, event: FloatArray, sense: float) -> bool:
    """Whether an event ends a path on which v goes in a sense, or one on which it goes the other way."""
    towards = np.zeros_like(event)
    towards[-1] = sense
    if condition.kind == "limit_point" and singular.is_fold(equations, event):
        # No path goes on from there; the state falls, and a path that ends there led up to where it falls.
        escape = singular.escape_direction(equations, event, sense)
        towards[: escape.size], towards[-1] = escape, 0.0
    with np.errstate(invalid="ignore"):  # there may be no such tangent
        tangent = singular.tangent_at_end(equations, event, towards)
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
