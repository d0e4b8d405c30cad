"""What a flow forgets: off its trajectory everything decays, so that only its last part matters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from simulator.model.conditions import Condition
from simulator.model.equations import Equations
from simulator.solver.newton import linearised

FloatArray = NDArray[np.float64]

_FORGOTTEN = 60.0  # e-folds after which nothing is left of where a flow was loosely
_CLEAR = 0.02  # a margin so large was not near zero


def jacobians(equations: Equations, states: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The rates dλ/dt of states in motion (n_unknowns, m), and their derivatives in the stretches.

    Returns
    -------
    rates : (m, n_balloons) array
    derivatives : (m, n_balloons, n_balloons) array
    """
    walls, count = equations.walls, len(equations.walls)
    force, rows = linearised(equations, states)
    along = rows[:, :count, :count].copy()
    if equations.has_pressure:
        for k, state in enumerate(states.T.tolist()):
            slopes = equations.flow_law(state, force[k].tolist(), rows[k].tolist())[1]
            along[k] -= np.outer(rows[k, :count, count], np.array(slopes[:count]) / slopes[count])
    paces = np.empty((states.shape[1], count))
    for i, wall in enumerate(walls):
        denominator = np.asarray(wall.elastomer.pole_form(states[i])[1])
        slope = np.asarray(wall.elastomer.pole_form_slope(states[i])[1])
        paces[:, i] = wall.modulus / denominator
        along[:, i, i] -= force[:, i] * slope / denominator
    return -paces * force[:, :count], -paces[:, :, None] * along


def memory(equations: Equations, states: FloatArray) -> FloatArray:
    """By how many e-folds what is off a trajectory decays from each state (n_unknowns, m) to the last.

    Of at least two balloons: of one nothing is off. Within the flow nothing decays; across it the slowest
    direction counts, in the weights in which the flow is a gradient.

    Returns
    -------
    (m,) array
    """
    count, steps = len(equations.walls), states.shape[1]
    rates, derivatives = jacobians(equations, states)
    root = np.sqrt([wall.weight / wall.modulus for wall in equations.walls])
    speed = np.sqrt((rates * rates).sum(axis=1))
    ahead = root * rates
    ahead /= np.sqrt((ahead * ahead).sum(axis=1))[:, None]
    along = ahead[:, :, None] * ahead[:, None, :]
    matrices = -derivatives * root[:, None] / root
    across = np.eye(count) - along
    projected = across @ (0.5 * (matrices + matrices.transpose(0, 2, 1))) @ across
    # The direction of the flow itself is put above all others.
    lifted = projected + (1.0 + np.abs(projected).sum(axis=(1, 2)))[:, None, None] * along
    fades = np.full(steps, -np.inf)
    good = np.isfinite(lifted).all(axis=(1, 2))
    fades[good] = np.linalg.eigvalsh(lifted[good])[:, 0]
    length = np.sqrt((np.diff(states[:count], axis=1) ** 2).sum(axis=0))
    folds = length / np.maximum(speed[1:], speed[:-1]) * np.minimum(fades[1:], fades[:-1])
    return np.append(np.cumsum(folds[::-1])[::-1], 0.0)


def forgotten(equations: Equations, conditions: Sequence[Condition], path: FloatArray) -> FloatArray | None:
    """The part of a loose flow (n_unknowns, m) to an event that does not matter, but for its last state.

    None where there is none, or where the flow may have ended within it.
    """
    if path.shape[1] < 3 or len(equations.walls) < 2:
        return None  # of one balloon the way cannot matter
    late = np.flatnonzero(memory(equations, path) >= _FORGOTTEN)
    if not late.size or late[-1] == 0:
        return None
    before = path[:, : late[-1] + 1]
    for condition in conditions:
        margins = np.broadcast_to(np.asarray(condition.margin(before)), before.shape[1])
        if not (margins.min() > _CLEAR or margins.min() > 0.5 * min(margins[0], margins[-1]) > 0.0):
            return None
    return before
