"""The overdamped flow dλᵢ/dt = −gᵢ at a frozen drive, with IDA: where a state without a place comes to rest.

The gas law holds throughout. Written for Rᵢ = D gᵢ/k it has no pole: (D/k) dλᵢ/dt = −Rᵢ. Only the place
where the flow rests is wanted, so it is integrated until Newton's method, checked, takes over. Where it
ends on the way instead (tension lost, film broken) that state depends on the trajectory, and the flow is
integrated once more, tightly.
"""

from __future__ import annotations

import contextlib
import io
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from simulator import equilibrium
from simulator.elastomer import Number
from simulator.equilibrium import NotConverged
from simulator.events import Condition, stability
from simulator.model import Equations, State
from simulator.path import Effort

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

FloatArray = NDArray[np.float64]

_LOOSE = 1e-4
_TIGHT = 1e-11
_NEAR = 0.05  # how far a Newton step may lead for Newton's method to take over
_NEAREST = 1e-7
_LONGEST = 1e12  # a time never reached
_MOST_LOOKS = 50_000  # of IDA at the margins, about one a step
_NUDGES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)  # stretch by which a snap is started off its limit point
_FAR = 1e3  # stretch, over the largest at the start, at which a flow without a limit counts as runaway


class FlowError(ArithmeticError):
    """The flow neither rested nor ended."""


@dataclass(frozen=True)
class Rest:
    """Where a flow ended: at rest (`end` None), in an event (its kind), or nowhere ("runaway").

    `state` is the full state (n_unknowns,); for a rest it solves the equations to rounding.
    """

    state: FloatArray
    end: str | None


def relax(
    equations: Equations,
    conditions: Sequence[Condition],
    start: FloatArray,
    effort: Effort,
    *,
    tight: bool = False,
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

    Raises
    ------
    FlowError
        If it does neither within many steps.
    """
    if tight:
        return _flow(equations, conditions, start, _TIGHT, effort)[0]
    try:
        rest, closest = _flow(equations, conditions, start, _LOOSE, effort)
    except FlowError:
        return _flow(equations, conditions, start, _TIGHT, effort)[0]
    if rest.end is None:
        values = rest.state.tolist()
        # A margin that was smallest at the rest itself was not grazed on the way.
        if all(
            low > 0.02 or low > 0.5 * c.margin(values) for low, c in zip(closest, conditions, strict=True)
        ):
            return rest
    return _flow(equations, conditions, start, _TIGHT, effort)[0]


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
    for distance in _NUDGES:
        start = _nudged(equations, fold, distance * escape)
        if _speed_along(equations, start, escape) > 0.0 and _holds(conditions, start):
            break
    else:
        if not _holds(conditions, start):
            values = start.tolist()
            return Rest(start, min(conditions, key=lambda c: float(c.margin(values))).kind)
        raise FlowError("no way down from the limit point")
    for once_more in (False, True):
        rest = relax(equations, conditions, start, effort, tight=once_more)
        if rest.end is not None or np.max(np.abs(rest.state - fold) / equations.scales) > distance:
            return rest
    raise FlowError("the snap fell back to where it came from")


def _nudged(equations: Equations, state: FloatArray, change: FloatArray) -> FloatArray:
    """A state with its stretches changed, and the pressure that goes with them."""
    out = state.copy()
    out[: change.size] += change
    out[:-1], _ = _consistent(equations, out)
    return out


def _holds(conditions: Sequence[Condition], state: FloatArray) -> bool:
    values = state.tolist()
    return all(condition.margin(values) > 0.0 for condition in conditions)


def _speed_along(equations: Equations, state: FloatArray, escape: FloatArray) -> float:
    """How fast the flow carries a state along a direction of the stretches.

    Measured with the weights r²h, in which the flow is a gradient: what the stiff directions do, however
    fast, does not count.
    """
    _, rates = _consistent(equations, state)
    weights = np.array([wall.weight / wall.modulus for wall in equations.walls])
    return float((weights * rates[: escape.size]) @ escape)


def _flow(
    equations: Equations, conditions: Sequence[Condition], start: FloatArray, rtol: float, effort: Effort
) -> tuple[Rest, list[float]]:
    """Where the flow ends, and the smallest value of each margin on the way."""
    stable = stability(equations).margin
    count = len(equations.walls)
    endless = [i for i, wall in enumerate(equations.walls) if math.isinf(wall.elastomer.stretch_limit)]
    far = _FAR * float(np.max(start[:count]))
    closest = [math.inf] * len(conditions)
    state, near = np.array(equations.admitted(start.tolist())), _NEAR
    while near > _NEAREST:

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
            states, ended = _integrate(equations, margins, state, rtol, effort)
            closest = [
                min(low, float(np.min(margin(states))))
                for low, margin in zip(closest, margins[: len(conditions)], strict=True)
            ]
            state = states[:, -1]
            if ended < len(conditions):
                return Rest(_at_margin(equations, conditions[ended], state), conditions[ended].kind), closest
            if ended > len(conditions):
                return Rest(state, "runaway"), closest
        landing = _landing(equations, conditions, state)
        if landing is None:
            landing = _at_fold(equations, state)
        if landing is not None:
            return Rest(landing, None), closest
        near *= 0.1
    broken = _broken_at_rest(equations, conditions, state)
    if broken is not None:
        return Rest(_at_margin(equations, broken, state), broken.kind), closest
    raise FlowError("the flow slows down where there is no rest")


def _at_margin(equations: Equations, condition: Condition, state: FloatArray) -> FloatArray:
    """The state of the flow, close to the given one, at which a margin is zero to rounding."""
    for _ in range(3):
        values, rates = _consistent(equations, state)
        state = np.append(values, state[-1])
        speed = float(condition.slope(state)[:-1] @ rates)
        ahead = -float(condition.margin(state.tolist())) / speed
        state[: len(equations.walls)] += ahead * rates[: len(equations.walls)]
    return np.append(_consistent(equations, state)[0], state[-1])


def _integrate(
    equations: Equations,
    margins: Sequence[Callable[[State], Number]],
    start: FloatArray,
    rtol: float,
    effort: Effort,
) -> tuple[FloatArray, int]:
    """IDA's states along the flow, (n_unknowns, n), until one of the margins falls to zero, and which."""
    from sksundae.ida import IDA

    v = float(start[-1])
    looks = 0
    parts = [
        (wall.elastomer.pole_form, wall.elastomer.pole_form_slope, wall.modulus) for wall in equations.walls
    ]

    count = len(parts)
    sealed = equations.has_pressure

    def full(stretches: list[float]) -> list[float]:
        # The gas law is solved for the pressure here: as an unknown of the DAE it is the stiffer the higher
        # the ambient pressure, and IDA would have to follow its every digit.
        return [*stretches, equations.gas_pressure(stretches, v), v] if sealed else [*stretches, v]

    def residual(t: float, y: FloatArray, yp: FloatArray, out: FloatArray) -> None:
        values, speeds = y.tolist(), yp.tolist()
        rows = equations.residual(full(values))[:count]
        for i, (pole_form, _, modulus) in enumerate(parts):
            denominator = pole_form(values[i])[1]
            # Beyond the stretch limit there is nothing: IDA takes it for a step too long.
            rows[i] = rows[i] + denominator / modulus * speeds[i] if denominator > 0.0 else math.nan
        out[:] = rows

    def jacobian(
        t: float, y: FloatArray, yp: FloatArray, res: FloatArray, cj: float, out: FloatArray
    ) -> None:
        values, speeds = y.tolist(), yp.tolist()
        state = full(values)
        forces, rows = equations.linearised(state)
        slopes = equations.flow_law(state, forces, rows)[1] if sealed else []
        for i, (pole_form, slope, modulus) in enumerate(parts):
            rows[i][i] += (cj * pole_form(values[i])[1] + slope(values[i])[1] * speeds[i]) / modulus
        if sealed:
            gas = [slope / slopes[count] for slope in slopes[:count]]
            for row in rows[:count]:
                row[:count] = [entry - row[count] * g for entry, g in zip(row, gas, strict=False)]
        out[:] = [row[:count] for row in rows[:count]]

    def events(t: float, y: FloatArray, yp: FloatArray, out: FloatArray) -> None:
        nonlocal looks
        looks += 1
        if looks > _MOST_LOOKS:
            raise FlowError(f"no rest within {_MOST_LOOKS} steps")
        values = full(y.tolist())
        out[:] = [margin(values) for margin in margins]

    events.direction = [-1] * len(margins)  # type: ignore[attr-defined]
    y0, yp0 = _consistent(equations, start)
    solver: Any = IDA(
        residual,
        jacfn=jacobian,
        eventsfn=events,
        num_events=len(margins),
        rtol=rtol,
        atol=rtol,
    )
    with contextlib.redirect_stdout(io.StringIO()):  # where scikit-sundae prints failures
        result = solver.solve([0.0, _LONGEST], y0[:count], yp0[:count])
    effort.ida_solves += 1
    effort.ida_steps += len(result.t) - 1
    effort.residual_calls += int(result.nfev)
    effort.jacobian_calls += int(result.njev)
    if result.status != 2:
        raise FlowError(f"IDA: {result.message}")
    states = np.array([full(values) for values in result.y.tolist()]).T
    return states, int(np.flatnonzero(result.i_events[-1])[0])


def _consistent(equations: Equations, start: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Consistent values and rates of the flow's unknowns (stretches, [pressure]) for given stretches."""
    count = len(equations.walls)
    values = equations.admitted(start.tolist())
    if equations.has_pressure:
        # The law is linear in the pressure: one Newton step is exact.
        defect, slopes = equations.flow_law(values, *equations.linearised(values))
        values[count] -= defect / slopes[count]
    residual, rows = equations.linearised(values)
    rates = [
        -residual[i] * wall.modulus / wall.elastomer.pole_form(values[i])[1]
        for i, wall in enumerate(equations.walls)
    ]
    if equations.has_pressure:
        slopes = equations.flow_law(values, residual, rows)[1]
        rates.append(-sum(slopes[i] * rates[i] for i in range(count)) / slopes[count])
    return np.array(values[:-1]), np.array(rates)


def _at_fold(equations: Equations, state: FloatArray) -> FloatArray | None:
    """The limit point that a state creeps up to where v is just its voltage, or a little short of it."""
    try:
        fold = equilibrium.at_event(equations, stability(equations), state)
    except NotConverged:
        return None
    if np.max(np.abs(fold - state) / equations.scales) > 2.0 * _NEAR:
        return None
    v = float(state[-1])
    if abs(fold[-1] - v) <= 16.0 * np.finfo(float).eps * max(abs(v), float(equations.scales[-1])):
        fold[-1] = v
        return fold
    # Beside a fold the distance to it goes as the root of the distance in v: tried closer and closer.
    stable = stability(equations).margin
    for share in 10.0 ** np.arange(0.0, -8.0, -0.5):
        guess = fold + share * (state - fold)
        guess[-1] = v
        try:
            landing = equilibrium.one_at_drive(equations, guess)
        except NotConverged:
            continue
        if (
            np.max(np.abs(landing - state) / equations.scales) < 2.0 * _NEAR
            and stable(landing.tolist()) > 0.0
        ):
            return landing
    return None


def _broken_at_rest(
    equations: Equations, conditions: Sequence[Condition], state: FloatArray
) -> Condition | None:
    """The condition that a state creeping to its rest will break only there, at the last digit."""
    try:
        rest = equilibrium.one_at_drive(equations, state).tolist()
    except NotConverged:
        return None
    return next((condition for condition in conditions if condition.margin(rest) <= 0.0), None)


def _landing(equations: Equations, conditions: Sequence[Condition], state: FloatArray) -> FloatArray | None:
    """The stable rest that a flowing state is about to reach, or None where that is not certain."""
    try:
        landing = equilibrium.one_at_drive(equations, state)
    except NotConverged:
        return None
    # Near, and stable all the way there: nothing else can hold the flow up in between.
    if np.max(np.abs(landing - state) / equations.scales) > 2.0 * _NEAR:
        return None
    if not _holds(conditions, landing):
        return None  # something ends the flow before it gets there
    stable = stability(equations).margin
    if any(stable((state + share * (landing - state)).tolist()) <= 0.0 for share in (0.5, 1.0)):
        return None
    return landing
