"""The way along the overdamped flow, see `flow`: by IDA, or closely; and the rates with which it sets out."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.model.elastomers import Number
from simulator.model.equations import Equations, State
from simulator.solver import adams, ida
from simulator.solver.forgetting import jacobians
from simulator.solver.ida import Effort

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

FloatArray = NDArray[np.float64]

_LONGEST = 1e12  # a time never reached
_MOST_STEPS = 50_000
_STIFF = 800  # steps of Adams' method after which the flow is stiff
_COARSER = 10.0  # IDA's tolerance over that: finer, its steps are lost in rounding


def integrate(
    equations: Equations,
    margins: Sequence[Callable[[State], Number]],
    start: FloatArray,
    rtol: float,
    effort: Effort,
) -> tuple[FloatArray, int]:
    """IDA's states along the flow, (n_unknowns, n), until one of the margins falls to zero, and which.

    Raises IntegrationError.
    """
    v = float(start[-1])
    parts = [
        (wall.elastomer.pole_form, wall.elastomer.pole_form_slope, wall.modulus) for wall in equations.walls
    ]
    count = len(parts)
    sealed = equations.has_pressure

    def full(stretches: list[float]) -> list[float]:
        # The gas law is solved for the pressure here: as an unknown of the DAE it is the stiffer the higher
        # the ambient pressure, and IDA would have to follow its every digit.
        return [*stretches, equations.gas_pressure(stretches, v), v] if sealed else [*stretches, v]

    def residual(t: float, values: list[float], speeds: list[float]) -> list[Number]:
        rows = equations.residual(full(values))[:count]
        for i, (pole_form, _, modulus) in enumerate(parts):
            denominator = pole_form(values[i])[1]
            # Beyond the stretch limit there is nothing: IDA takes it for a step too long.
            rows[i] = rows[i] + denominator / modulus * speeds[i] if denominator > 0.0 else math.nan
        return rows

    def jacobian(t: float, values: list[float], speeds: list[float], cj: float) -> list[list[Number]]:
        state = full(values)
        forces, rows = equations.linearised(state)
        slopes = equations.flow_law(state, forces, rows)[1] if sealed else []
        for i, (pole_form, slope, modulus) in enumerate(parts):
            rows[i][i] += (cj * pole_form(values[i])[1] + slope(values[i])[1] * speeds[i]) / modulus
        if sealed:
            gas = [slope / slopes[count] for slope in slopes[:count]]
            for row in rows[:count]:
                row[:count] = [entry - row[count] * g for entry, g in zip(row, gas, strict=False)]
        return [row[:count] for row in rows[:count]]

    def watched(t: float, values: list[float], speeds: list[float]) -> list[Number]:
        state = full(values)
        return [margin(state) for margin in margins]

    y0, yp0 = consistent(equations, start)
    course = ida.integrate(
        ida.System(residual, jacobian, watched, [True] * len(margins)),
        [0.0, _LONGEST],
        y0[:count],
        yp0[:count],
        effort,
        rtol=rtol,
        atol=rtol,
        most_steps=_MOST_STEPS,
    )
    states = np.array([full(values) for values in course.states.tolist()]).T
    if not course.events:
        raise ida.IntegrationError("the flow does not end", states[:, -1])
    return states, course.events[-1].which


def integrate_closely(
    equations: Equations,
    margins: Sequence[Callable[[State], Number]],
    start: FloatArray,
    rtol: float,
    effort: Effort,
) -> tuple[FloatArray, int]:
    """As `integrate`, by a method of high order, in fewer steps; where the flow is stiff for it, by IDA."""
    v = float(start[-1])
    parts = [(wall.elastomer.pole_form, wall.modulus) for wall in equations.walls]
    count = len(parts)
    sealed = equations.has_pressure

    def full(stretches: list[float]) -> list[float]:
        return [*stretches, equations.gas_pressure(stretches, v), v] if sealed else [*stretches, v]

    def rates(stretches: list[float]) -> list[float]:
        out = []
        forces = equations.residual(full(stretches))
        for (pole_form, modulus), force, x in zip(parts, forces, stretches, strict=False):
            denominator = pole_form(x)[1]
            out.append(-force * modulus / denominator if denominator > 0.0 else math.nan)
        return out

    def derivatives(stretches: list[float]) -> FloatArray:
        found: FloatArray = jacobians(equations, np.array(full(stretches))[:, None])[1][0]
        return found

    def watched(stretches: list[float]) -> list[Number]:
        state = full(stretches)
        return [margin(state) for margin in margins]

    first = consistent(equations, start)[0][:count]
    try:
        passed, which = adams.integrate(
            rates, derivatives, watched, first, effort, rtol=rtol, most_steps=_STIFF
        )
    except (ArithmeticError, np.linalg.LinAlgError):
        return integrate(equations, margins, start, _COARSER * rtol, effort)
    return np.array([full(stretches) for stretches in passed.tolist()]).T, which


def consistent(equations: Equations, start: FloatArray) -> tuple[FloatArray, FloatArray]:
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
