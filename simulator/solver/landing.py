"""Where a flow is about to come to rest: found by Newton's method, and taken only where it is certain."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from simulator.model.conditions import Condition, stability
from simulator.model.equations import Equations
from simulator.solver import newton
from simulator.solver.newton import NotConverged

FloatArray = NDArray[np.float64]

NEAR = 0.05  # how far a Newton step may lead for Newton's method to take over


def landing_from(
    equations: Equations,
    conditions: Sequence[Condition],
    guess: FloatArray,
    state: FloatArray,
    *,
    surely: bool,
) -> FloatArray | None:
    """The stable rest that a flowing state is about to reach, or None where that is not certain.

    Parameters
    ----------
    equations, conditions
        What flows, and what ends it on the way; stability is not among them.
    guess, state : (n_unknowns,) arrays
        Where Newton's method starts, and the state that flows.
    surely : bool
        Only where no margin can fall to zero on the way, whatever way it is.
    """
    try:
        landing = newton.one_at_drive(equations, guess)
    except NotConverged:
        return None
    # Near, and stable all the way there: nothing else can hold the flow up in between.
    if np.max(np.abs(landing - state) / equations.scales) > 2.0 * NEAR:
        return None
    stable = stability(equations).margin
    if any(stable((state + share * (landing - state)).tolist()) <= 0.0 for share in (0.5, 1.0)):
        return None
    return landing if _keeps(equations, conditions, state, landing, surely=surely) else None


def fold_beside(equations: Equations, state: FloatArray) -> FloatArray | None:
    """The limit point that a state is beside, if it is."""
    try:
        fold = newton.at_event(equations, stability(equations), state)
    except NotConverged:
        return None
    return fold if np.max(np.abs(fold - state) / equations.scales) <= 2.0 * NEAR else None


def broken_at_rest(
    equations: Equations, conditions: Sequence[Condition], state: FloatArray
) -> Condition | None:
    """The condition that a state creeping to its rest will break only there, at the last digit."""
    try:
        rest = newton.one_at_drive(equations, state).tolist()
    except NotConverged:
        return None
    return next((condition for condition in conditions if condition.margin(rest) <= 0.0), None)


def _keeps(
    equations: Equations,
    conditions: Sequence[Condition],
    state: FloatArray,
    landing: FloatArray,
    *,
    surely: bool,
) -> bool:
    """Whether the conditions hold where a flow is about to rest; `surely`, on any way there too."""
    if not holds(conditions, landing):
        return False  # something ends the flow before it gets there
    way = (landing - state)[: len(equations.walls)]
    return not surely or all(
        min(float(c.margin(y.tolist())) for y in (state, landing))
        >= 2.0 * variation(equations, c, landing, way)
        for c in conditions
    )


def holds(conditions: Sequence[Condition], state: FloatArray) -> bool:
    """Whether all margins are positive."""
    values = state.tolist()
    return all(condition.margin(values) > 0.0 for condition in conditions)


def variation(equations: Equations, condition: Condition, state: FloatArray, change: FloatArray) -> float:
    """How much a margin varies, at most and to first order, as the stretches change by so much each."""
    count = len(equations.walls)
    slope = condition.slope(state)
    along = slope[:count]
    if equations.has_pressure:
        values = state.tolist()
        law = equations.flow_law(values, *equations.linearised(values))[1]
        along = along - slope[count] * np.array(law[:count], dtype=np.float64) / float(law[count])
    return float(np.abs(along) @ np.abs(change))
