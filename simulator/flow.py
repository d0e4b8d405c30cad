"""The overdamped flow dλᵢ/dt = −gᵢ at a frozen drive, with IDA: where a state without a place comes to rest.

The gas law holds throughout. Written for Rᵢ = D gᵢ/k it has no pole: (D/k) dλᵢ/dt = −Rᵢ. Only the place
where the flow rests is wanted, so it is integrated until Newton's method, checked, takes over. Where it
ends on the way instead (tension lost, film broken) that state depends on the trajectory, and the flow is
integrated once more, tightly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from simulator import equilibrium
from simulator.equilibrium import NotConverged
from simulator.events import Condition, stability
from simulator.model import Equations
from simulator.path import Effort

if TYPE_CHECKING:
    from collections.abc import Sequence

FloatArray = NDArray[np.float64]

_LOOSE = 1e-4
_TIGHT = 1e-11
_NEAR = 0.05  # how far a Newton step may lead for Newton's method to take over
_MOST_STEPS = 20_000
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
    rest, closest = _flow(equations, conditions, start, _TIGHT if tight else _LOOSE, effort)
    if tight:
        return rest
    if rest.end is None:
        values = rest.state.tolist()
        # A margin that was smallest at the rest itself was not grazed on the way.
        if all(
            low > 0.02 or low > 0.5 * c.margin(values) for low, c in zip(closest, conditions, strict=True)
        ):
            return rest
    return _flow(equations, conditions, start, _TIGHT, effort)[0]


def snap(
    equations: Equations, conditions: Sequence[Condition], fold: FloatArray, direction: float, effort: Effort
) -> Rest:
    """Where the state goes from a polished limit point when the drive goes on in `direction`.

    Raises
    ------
    FlowError
        If the flow does not lead away from the limit point.
    """
    escape = equilibrium.escape_direction(equations, fold, direction)
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


def leave_branch_point(
    equations: Equations, conditions: Sequence[Condition], point: FloatArray, direction: float, effort: Effort
) -> Rest:
    """Where the state goes from a branch point when the drive goes on, along the unstable direction.

    Of the two senses of that direction, equal by symmetry, the one in which the first balloon concerned
    grows. Where the state leaves at once the new place is far away; where it leaves gradually, v is moved
    on by a little first, and the new place is near.
    """
    escape = equilibrium.escape_direction(equations, point, direction)
    escape = escape * (1.0 if escape[np.argmax(np.abs(escape) > 1e-6)] > 0.0 else -1.0)
    for ahead in (0.0, 1e-8, 1e-7, 1e-6, 1e-5):
        moved = point.copy()
        moved[-1] += direction * ahead * equations.scales[-1]
        for distance in _NUDGES:
            start = _nudged(equations, moved, distance * escape)
            if _speed_along(equations, start, escape) > 0.0:
                return relax(equations, conditions, start, effort)
    raise FlowError("no way on from the branch point")


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
    """How fast the flow carries a state along a direction of the stretches."""
    _, rates = _consistent(equations, state)
    return float(rates[: escape.size] @ escape)


def _flow(
    equations: Equations, conditions: Sequence[Condition], start: FloatArray, rtol: float, effort: Effort
) -> tuple[Rest, list[float]]:
    """Where the flow ends, and the smallest value of each margin on the way."""
    from sksundae.ida import IDA

    v = float(start[-1])
    walls = equations.walls
    count = len(walls)
    rates = [wall.modulus for wall in walls]
    margins = [condition.margin for condition in conditions]
    stable = stability(equations)

    def residual(t: float, y: FloatArray, yp: FloatArray, out: FloatArray) -> None:
        values = y.tolist()
        rows = equations.residual([*values, v])
        for i in range(count):
            denominator = walls[i].elastomer.pole_form(values[i])[1]
            # Beyond the stretch limit there is nothing: IDA takes it for a step too long.
            rows[i] = rows[i] + denominator / rates[i] * yp[i] if denominator > 0.0 else math.nan
        out[:] = rows

    def jacobian(
        t: float, y: FloatArray, yp: FloatArray, res: FloatArray, cj: float, out: FloatArray
    ) -> None:
        values = y.tolist()
        _, rows = equations.linearised([*values, v])
        for i in range(count):
            elastomer = walls[i].elastomer
            rows[i][i] += (
                cj * elastomer.pole_form(values[i])[1] + elastomer.pole_form_slope(values[i])[1] * yp[i]
            ) / rates[i]
        out[:] = [row[:-1] for row in rows]

    def events(t: float, y: FloatArray, yp: FloatArray, out: FloatArray) -> None:
        values = [*y.tolist(), v]
        for i, margin in enumerate(margins):
            out[i] = margin(values)

    events.direction = [-1] * len(margins)  # type: ignore[attr-defined]
    y0, yp0 = _consistent(equations, start)
    solver: Any = IDA(
        residual,
        jacfn=jacobian,
        eventsfn=events if margins else None,
        num_events=len(margins),
        rtol=rtol,
        atol=rtol * equations.scales[:-1],
        algebraic_idx=[count] if equations.has_pressure else None,
    )
    solver.init_step(0.0, y0, yp0)
    effort.ida_solves += 1
    closest = [np.inf] * len(margins)
    finite = np.isfinite([wall.elastomer.stretch_limit for wall in walls])
    far = _FAR * float(np.max(start[:count]))
    try:
        for _ in range(_MOST_STEPS):
            result = solver.step(1e12, method="onestep")
            effort.ida_steps += 1
            if result.status < 0:
                raise FlowError(f"IDA: {result.message}")
            state = np.append(result.y, v)
            if result.status == 2:
                place = int(np.flatnonzero(result.i_events[-1])[0])
                return Rest(state, conditions[place].kind), closest
            values = state.tolist()
            closest = [min(low, margin(values)) for low, margin in zip(closest, margins, strict=True)]
            if np.any(result.y[:count][~finite] > far):
                return Rest(state, "runaway"), closest
            landing = _landing(equations, stable, state)
            if landing is not None:
                return Rest(landing, None), closest
    finally:
        if "result" in locals():
            effort.residual_calls += int(result.nfev)
            effort.jacobian_calls += int(result.njev)
    raise FlowError(f"the flow did not come to rest in {_MOST_STEPS} steps")


def _consistent(equations: Equations, start: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Consistent values and rates of the flow's unknowns (stretches, [pressure]) for given stretches."""
    count = len(equations.walls)
    values = start.tolist()
    if equations.has_pressure:
        # The gas row is linear in the pressure: one Newton step is exact.
        residual, rows = equations.linearised(values)
        values[count] -= residual[count] / rows[count][count]
    residual, rows = equations.linearised(values)
    rates = [
        -residual[i] * wall.modulus / wall.elastomer.pole_form(values[i])[1]
        for i, wall in enumerate(equations.walls)
    ]
    if equations.has_pressure:
        rates.append(-sum(rows[count][i] * rates[i] for i in range(count)) / rows[count][count])
    return np.array(values[:-1]), np.array(rates)


def _landing(equations: Equations, stable: Condition, state: FloatArray) -> FloatArray | None:
    """The stable rest that a flowing state is about to reach, or None while it is not certain."""
    values = state.tolist()
    if stable.margin(values) <= 0.0:
        return None
    residual, rows = equations.linearised(values)
    step = np.linalg.solve(np.array(rows, dtype=np.float64)[:, :-1], np.array(residual))
    if np.max(np.abs(step) / equations.scales[:-1]) > _NEAR:
        return None
    try:
        landing = equilibrium.at_drive(equations, state[:, None])[:, 0]
    except NotConverged:
        return None
    # Stable all the way there: nothing else can hold the flow up in between.
    if np.max(np.abs(landing - state) / equations.scales) > 2.0 * _NEAR:
        return None
    if any(stable.margin((state + share * (landing - state)).tolist()) <= 0.0 for share in (0.5, 1.0)):
        return None
    return landing
