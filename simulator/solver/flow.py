"""The overdamped flow dλᵢ/dt = −gᵢ at a frozen drive, with IDA: where a state without a place comes to rest.

The gas law holds throughout. Written for Rᵢ = D gᵢ/k it has no pole: (D/k) dλᵢ/dt = −Rᵢ. Only the place
where the flow rests is wanted, so it is integrated until Newton's method, checked, takes over. Where it
ends on the way instead (tension lost, film broken) that state depends on the trajectory, and the flow is
integrated once more, tightly.
"""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.model.conditions import Condition, stability
from simulator.model.equations import Equations, State
from simulator.model.symmetry import symmetry
from simulator.solver import newton, singular
from simulator.solver.forgetting import forgotten
from simulator.solver.ida import Effort, IntegrationError
from simulator.solver.landing import (
    NEAR,
    broken_at_rest,
    fold_beside,
    holds,
    landing_from,
    variation,
)
from simulator.solver.overdamped import consistent, integrate, integrate_closely

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

FloatArray = NDArray[np.float64]

_LOOSE = 1e-4
_TIGHT = 1e-12
_NEAREST = {_LOOSE: 1e-7, _TIGHT: 1e-10}  # the same, at last, by tolerance
_PARTING = 1e-12  # an eigenvalue below zero by more is one that parts equal balloons
_GHOST = 1e-3  # how near a limit point that no longer holds it a creeping state is taken past it
_NUDGES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)  # stretch by which a snap is started off its limit point
_FINE = (1e-4, 1e-5, 1e-6)  # the same where the way matters: what it is off the way goes with the square
_NOISE = 4.0 * float(np.finfo(float).eps)  # of the terms of a force: its rounding
# Stretch by which balloons part where only powers of it drive them on: as little as gets them going.
_APART = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 3e-2, 1e-1)
_BRISK = 1e-6  # of that stretch: a speed that is no creeping
_SPEED_DIGITS = 3  # of speeds, over the largest: those alike in them are equal
_LEAST = float(np.finfo(float).tiny)
_FAR = 1e3  # stretch, over the largest at the start, at which a flow without a limit counts as runaway


class FlowError(ArithmeticError):
    """The flow neither rested nor ended."""


@dataclass(frozen=True)
class Rest:
    """Where a flow ended: at rest (`end` None), in an event (its kind), or nowhere ("runaway").

    `state` is the full state (n_unknowns,); for a rest it solves the equations to rounding. `path` are the
    states (n_unknowns, n) that the flow passed on its way.
    """

    state: FloatArray
    end: str | None
    path: FloatArray = field(default_factory=lambda: np.empty((0, 0)), repr=False, compare=False)


def relax(
    equations: Equations,
    conditions: Sequence[Condition],
    start: FloatArray,
    effort: Effort,
    *,
    tight: bool = False,
    fine_start: Callable[[], FloatArray | None] | None = None,
) -> Rest:
    """Let a state flow, at its own v, until it rests or one of the conditions ends it.

    Parameters
    ----------
    equations
    conditions
        Those that can end it; stability is not among them.
    start : (n_unknowns,) array
        Where it starts: any stretches; the pressure is computed from them.
    effort : Effort
        Counters, added to.
    tight : bool
        Integrate tightly from the start.
    fine_start : callable, optional
        Gives the state (n_unknowns,) it starts from when it is integrated tightly; `start` if not given.

    Raises
    ------
    FlowError
        If it does neither within many steps.

    Notes
    -----
    Equal balloons that start alike flow alike. Where they come to rest in a state that is unstable against
    their parting they leave it as from a branch point.
    """
    alike = symmetry(equations, start)
    if alike is None:
        return _relaxed(equations, conditions, start, effort, tight, fine_start)
    # What is alike stays alike, and may come to a rest that is none against its parting.
    narrow = [alike.condition(condition) for condition in conditions]

    def fine() -> FloatArray | None:
        found = fine_start() if fine_start is not None else None
        return None if found is None else alike.narrowed(found)

    rest = _relaxed(alike.equations, narrow, alike.narrowed(start), effort, tight, fine)
    state = np.array(alike.widened(rest.state.tolist()))
    together = np.array(alike.widened(list(rest.path))) if rest.path.size else np.empty((start.size, 0))
    if rest.end is not None or not float(stability(equations).margin(state.tolist())) < -_PARTING:
        return Rest(state, rest.end, together)
    directions = steepest_first(equations, state, singular.parting_directions(equations, state))
    starts = (_off(equations, conditions, state, way, [off]) for off in _FINE[::-1] for way in directions)
    start_apart = next((found for found in starts if found is not None), None)
    if start_apart is None:
        raise FlowError("no way down from where equal balloons part")
    apart = relax(equations, conditions, start_apart, effort, tight=True)
    return replace(
        apart, path=np.concatenate([together, apart.path], axis=1) if apart.path.size else together
    )


def _relaxed(
    equations: Equations,
    conditions: Sequence[Condition],
    start: FloatArray,
    effort: Effort,
    tight: bool,
    fine_start: Callable[[], FloatArray | None] | None,
) -> Rest:
    """As `relax`, all balloons by themselves."""
    before: FloatArray | None = None
    if not tight:
        # Loosely, unless that fails, or what is found depends on the way.
        with contextlib.suppress(FlowError, IntegrationError):
            rest, closest = _flow(equations, conditions, start, _LOOSE, effort)
            if rest.end is None and _certain(equations, conditions, start, rest.state, closest):
                return rest
            if rest.end is not None:
                before = forgotten(equations, conditions, rest.path)
    if before is not None:
        with contextlib.suppress(FlowError, IntegrationError):
            last, _ = _flow(equations, conditions, before[:, -1], _TIGHT, effort)
            return replace(last, path=np.concatenate([before, last.path], axis=1))
    fine = fine_start() if fine_start is not None else None
    return _flow(equations, conditions, start if fine is None else fine, _TIGHT, effort)[0]


def _certain(
    equations: Equations,
    conditions: Sequence[Condition],
    start: FloatArray,
    rest: FloatArray,
    closest: Sequence[float],
) -> bool:
    """Whether a loose flow to a rest kept well away from the margins, whose smallest values are given."""
    first, last = start.tolist(), rest.tolist()
    blur = _LOOSE * (1.0 + rest[: len(equations.walls)])
    return all(
        # A margin that was smallest at the start or at the rest was not grazed on the way.
        (low > 0.02 or low > 0.5 * min(c.margin(first), c.margin(last)))
        and low > 10.0 * variation(equations, c, rest, blur)
        for low, c in zip(closest, conditions, strict=True)
    )


def snap(
    equations: Equations,
    conditions: Sequence[Condition],
    fold: FloatArray,
    escape: FloatArray,
    effort: Effort,
) -> Rest:
    """Where the state goes from a polished limit point (or branch point) along an unstable direction.

    Parameters
    ----------
    equations
    conditions
        Those that can end it; stability is not among them.
    fold : (n_unknowns,) array
    escape : (n_balloons,) array
        Unit change of the stretches, downhill.
    effort : Effort
        Counters, added to.

    Raises
    ------
    FlowError
        If the flow does not lead away from the limit point.
    """
    start = _off(equations, conditions, fold, escape, _NUDGES)
    if start is None:
        at_once = _nudged(equations, fold, _NUDGES[-1] * escape)
        if not holds(conditions, at_once):
            values = at_once.tolist()
            return Rest(at_once, min(conditions, key=lambda c: float(c.margin(values))).kind)
        raise FlowError("no way down from the limit point")
    distance = np.max(np.abs(start - fold) / equations.scales)

    def fine() -> FloatArray | None:
        return _off(equations, conditions, fold, escape, _FINE)

    for once_more in (False, True):
        rest = relax(equations, conditions, start, effort, tight=once_more, fine_start=fine)
        if rest.end is not None or np.max(np.abs(rest.state - fold) / equations.scales) > distance:
            return rest
    raise FlowError("the snap fell back to where it came from")


def parted(
    equations: Equations,
    conditions: Sequence[Condition],
    point: FloatArray,
    escapes: Sequence[FloatArray],
    effort: Effort,
) -> Rest:
    """Where the state goes from a branch point off which no branch goes on, by the first way that leads down.

    Parameters as of `snap`. Where it stands nothing but the third or fourth power of the parting drives it
    on, which is of the size of what the other modes have to make up for; they do so first.

    Raises
    ------
    FlowError
        If no way leads down.
    """
    ways = steepest_first(equations, point, escapes)
    for distance in _APART:
        for escape in ways:
            try:
                start = newton.held_apart(equations, point, distance * escape)
            except newton.NotConverged:
                continue
            if holds(conditions, start) and _speed_along(equations, start, escape) > _BRISK * distance:
                return relax(equations, conditions, start, effort, tight=True)
    raise FlowError("no way down from where equal balloons part")


def steepest_first(equations: Equations, state: FloatArray, ways: Sequence[FloatArray]) -> list[FloatArray]:
    """Ways in which balloons may part, those first on which the flow is fastest; equal ones as they are.

    Where balloons are not quite equal they part by the mode of their differences, at first slowly; but the
    third power of the parting turns them to where the potential falls most.
    """
    speeds = np.array([_speed_along(equations, _nudged(equations, state, _NUDGES[0] * w), w) for w in ways])
    shares = np.round(speeds / max(float(np.abs(speeds).max()), _LEAST), _SPEED_DIGITS)
    return [ways[place] for place in np.argsort(-shares, kind="stable")]


def _off(
    equations: Equations,
    conditions: Sequence[Condition],
    fold: FloatArray,
    escape: FloatArray,
    distances: Sequence[float],
) -> FloatArray | None:
    """The state at the first of some distances off a limit point from which the flow leads away, if any."""
    for distance in distances:
        start = _nudged(equations, fold, distance * escape)
        if _speed_along(equations, start, escape) > 0.0 and holds(conditions, start):
            return start
    return None


def _nudged(equations: Equations, state: FloatArray, change: FloatArray) -> FloatArray:
    """A state with its stretches changed, and the pressure that goes with them."""
    out = state.copy()
    out[: change.size] += change
    out[:-1], _ = consistent(equations, out)
    return out


def _speed_along(equations: Equations, state: FloatArray, escape: FloatArray) -> float:
    """How fast the flow carries a state along a direction of the stretches, surely.

    Measured with the weights r²h, in which the flow is a gradient: what the stiff directions do, however
    fast, does not count.
    """
    values, rates = consistent(equations, state)
    full = [*values.tolist(), float(state[-1])]
    weights = np.array([wall.weight / wall.modulus for wall in equations.walls])
    speed = float((weights * rates[: escape.size]) @ escape)
    # Of forces that balance to the last digit, nothing says which way they lead.
    blur = 0.0
    for wall, term, part, x in zip(
        equations.walls, equations.term_sizes(full), escape.tolist(), full, strict=False
    ):
        blur += wall.weight * abs(part) * _NOISE * term / wall.elastomer.pole_form(x)[1]
    return speed - blur if speed > 0.0 else speed


def _flow(
    equations: Equations, conditions: Sequence[Condition], start: FloatArray, rtol: float, effort: Effort
) -> tuple[Rest, list[float]]:
    """Where the flow ends, and the smallest value of each margin on the way."""
    stable = stability(equations).margin
    count = len(equations.walls)
    endless = [i for i, wall in enumerate(equations.walls) if math.isinf(wall.elastomer.stretch_limit)]
    far = _FAR * float(np.max(start[:count]))
    closest = [math.inf] * len(conditions)
    path = np.empty((start.size, 0))
    state, near = np.array(equations.admitted(start.tolist())), NEAR
    passed = False
    while True:

        def resting(y: State, near: float = near) -> float:
            """Falls through zero where a Newton step, at most |R| over the smallest eigenvalue, is short."""
            softest = stable(y)
            if softest <= 0.0:
                return 1.0
            return float(min(max(map(abs, equations.residual(y))) / softest - near, 1.0))

        margins = [condition.margin for condition in conditions]
        margins.append(resting)
        if endless:
            margins.append(lambda y: far - max(y[i] for i in endless))
        if resting(state.tolist()) > 0.0:
            way = integrate if rtol == _LOOSE else integrate_closely
            states, ended = way(equations, margins, state, rtol, effort)
            _check_downhill(equations, states)
            closest = [
                min(low, float(np.min(margin(states))))
                for low, margin in zip(closest, margins[: len(conditions)], strict=True)
            ]
            state, path = states[:, -1], np.concatenate([path, states], axis=1)
            if ended < len(conditions):
                at_margin = _at_margin(equations, conditions[ended], state)
                return Rest(at_margin, conditions[ended].kind, path), closest
            if ended > len(conditions):
                return Rest(state, "runaway", path), closest
        nearest = near <= _NEAREST[rtol]
        landing = landing_from(equations, conditions, state, state, surely=not nearest)
        if landing is not None:
            return Rest(landing, None, path), closest
        fold = fold_beside(equations, state)
        if fold is not None and not passed and np.max(np.abs(fold - state) / equations.scales) < _GHOST:
            onward = _past(equations, conditions, fold, float(state[-1]))
            if onward is not None:
                state, near, passed = onward, NEAR, True
                continue
        if nearest:
            break
        near *= 0.1
    broken = broken_at_rest(equations, conditions, state)
    if broken is not None:
        return Rest(_at_margin(equations, broken, state), broken.kind, path), closest
    raise FlowError("the flow slows down where there is no rest")


def _check_downhill(equations: Equations, states: FloatArray) -> None:
    """A gradient flow only loses potential. What gains some is not the flow."""
    energy = np.asarray(equations.potential(states))
    rounding = 1e-12 * sum(wall.weight for wall in equations.walls) + 3e-14 * np.abs(energy).max()
    if np.any(np.diff(energy) > 1e-3 * np.ptp(energy) + rounding):
        raise FlowError("the potential rises along the flow")


def _past(
    equations: Equations, conditions: Sequence[Condition], fold: FloatArray, v: float
) -> FloatArray | None:
    """Where a state goes on that creeps past a limit point, at a v a little beyond the limit point's.

    It takes a time like 1/√(distance in v) for that, at speeds down to the rounding of the forces, and ever
    closer to the soft mode. So it is put beyond, on the soft mode.
    """
    ghost = fold.copy()
    ghost[-1] = v
    escape = singular.escape_direction(equations, fold, 1.0 if v > fold[-1] else -1.0)
    return _off(equations, conditions, ghost, escape, _FINE)


def _at_margin(equations: Equations, condition: Condition, state: FloatArray) -> FloatArray:
    """The state of the flow, close to the given one, at which a margin is zero to rounding."""
    for _ in range(3):
        values, rates = consistent(equations, state)
        state = np.append(values, state[-1])
        margin = float(condition.margin(state.tolist()))
        if margin == 0.0:
            break
        speed = float(condition.slope(state)[:-1] @ rates)
        if speed == 0.0:
            break  # at rest already
        ahead = -margin / speed
        state[: len(equations.walls)] += ahead * rates[: len(equations.walls)]
    return np.append(consistent(equations, state)[0], state[-1])
