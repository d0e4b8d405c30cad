"""Singular points of the equilibrium path: what they are, and how the state leaves them.

Where the scaled Hessian S is singular the path folds back in v (a limit point) or another path crosses it (a
branch point). S = T H T, so a mode z of S is the change T z of the stretches.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from simulator.model.conditions import modes, softest_mode
from simulator.model.equations import Equations
from simulator.model.symmetry import symmetry

FloatArray = NDArray[np.float64]

CROSSING = 1e-11  # a singular value this small, of rows of unit length, is zero: two curves cross
_SOFT = 1e-8  # of the largest stiffness: eigenvalues so close are one
_PART = 1e-3  # of a unit mode: a balloon that takes part in it
_AHEAD = 1e-3  # over the scale of v: where it is seen what v pushes as it goes on
_PUSH_DIGITS = 6  # of a push over the largest: what is less is none
_SAME = 1e-9  # directions that are one


def _unit_rows(equations: Equations, state: FloatArray) -> FloatArray:
    """The Jacobian at one state in scaled unknowns, rows of unit length; one of rounding alone is none."""
    rows = np.array(equations.linearised(state.tolist())[1], dtype=np.float64) * equations.scales
    lengths = np.sqrt(np.einsum("ij,ij->i", rows, rows))
    terms = np.array(equations.term_sizes(state.tolist()), dtype=np.float64)
    return np.asarray(rows / np.where(lengths > CROSSING * terms, lengths, terms)[:, None])


def is_fold(equations: Equations, state: FloatArray) -> bool:
    """Whether the drive pushes a singular point along its soft mode: a limit point (else a branch point)."""
    return bool(np.linalg.svd(_unit_rows(equations, state))[1][-1] > CROSSING)


def sets_off(equations: Equations, state: FloatArray, sense: float) -> bool:
    """Whether v, as it sets out without a voltage, pushes balloons off a singular point together.

    The forces change with its square then, and `is_fold` sees no push.
    """
    pushes = [row[-1] for row in equations.linearised(state.tolist())[1][: len(equations.walls)]]
    soft = _soft_modes(equations, state)
    push = soft.T @ (_pushed_ahead(equations, state, sense) / _compliance(equations, state))
    pushed = bool(np.any(np.round(push, _PUSH_DIGITS)))
    return pushed and not np.any(pushes) and not parts_equal_balloons(equations, state)


def tangent_at_end(equations: Equations, state: FloatArray, towards: FloatArray) -> FloatArray:
    """Unit tangent at one state on the side of `towards`, also at a branch point, where two curves cross."""
    scales = equations.scales
    # One tangent spans the null space of the rows; where two curves cross there are two, and what `towards`
    # has in their plane is the curve that was followed.
    _, sizes, vectors = np.linalg.svd(_unit_rows(equations, state))
    null = vectors[np.count_nonzero(sizes > CROSSING) :]
    along = null.T @ (null @ (towards / scales))
    return np.asarray(scales * along / np.linalg.norm(along))


def _compliance(equations: Equations, state: FloatArray) -> FloatArray:
    """T of S = T H T up to the moduli: √(D/(r²h)) of every balloon, (n_balloons,)."""
    return np.array(
        [
            np.sqrt(max(wall.elastomer.pole_form(x)[1], 1e-300) / wall.weight)
            for wall, x in zip(equations.walls, state.tolist(), strict=False)
        ]
    )


def escape_direction(equations: Equations, state: FloatArray, direction: float) -> FloatArray:
    """How the stretches leave a fold when the drive goes on: the soft mode, on the downhill side.

    Parameters
    ----------
    state : (n_unknowns,) array
        A limit point.
    direction : ±1
        Sense in which v moves.

    Returns
    -------
    (n_balloons,) array
        Change of the stretches, unit length.
    """
    mode = softest_mode(equations, state)
    scale = _compliance(equations, state)
    # R's push on the mode z is Σ z √(weight/D) ∂R/∂v.
    rows = equations.linearised(state.tolist())[1][: mode.size]
    push = np.array([row[-1] for row in rows], dtype=np.float64)
    away = -np.sign(direction * (mode / scale) @ push)
    change = (away if away else 1.0) * scale * mode
    return np.asarray(change / np.linalg.norm(change))


def softest_change(equations: Equations, state: FloatArray) -> FloatArray:
    """The softest mode as a change of the stretches, unit length, (n_balloons,)."""
    change = _compliance(equations, state) * softest_mode(equations, state)
    return np.asarray(change / np.linalg.norm(change))


def parts_equal_balloons(equations: Equations, state: FloatArray) -> bool:
    """Whether a state is softest against the parting of balloons that are alike in it."""
    alike = symmetry(equations, state)
    if alike is None:
        return False
    together = modes(alike.equations, alike.narrowed(state))[0][:1]
    softest = modes(equations, state)[0][:1]
    size = np.abs(equations.stiffness(state.tolist())[0]).max()
    return bool(np.all(together - softest > _SOFT * size))


def parting_directions(equations: Equations, state: FloatArray, sense: float = 0.0) -> list[FloatArray]:
    """The ways in which stretches may part where several modes are soft: one balloon against all others.

    In order of how much the drive pushes that way as v goes on in a sense (±1; 0 where it stands still).
    Where it does not choose, first those on which one balloon grows, the first before the others; then those
    on which one shrinks, the last before the others. Each of unit length, (n_balloons,).
    """
    soft = _soft_modes(equations, state)
    compliance = _compliance(equations, state)
    push = soft.T @ (_pushed_ahead(equations, state, sense) / compliance)
    concerned = np.flatnonzero(np.linalg.norm(soft, axis=1) > _PART)
    ways = [*soft[concerned], *-soft[concerned[::-1]]]
    along = np.round([float(push @ way) / np.linalg.norm(way) for way in ways], _PUSH_DIGITS)
    found: list[FloatArray] = []
    for place in np.argsort(-along, kind="stable").tolist():
        change = compliance * (soft @ ways[place])
        change = change / np.linalg.norm(change)
        if all(change @ other < 1.0 - _SAME for other in found):
            found.append(np.asarray(change))
    return found


def _soft_modes(equations: Equations, state: FloatArray) -> FloatArray:
    """The softest mode and those as soft, (n_balloons, n_soft)."""
    diagonal, _ = equations.stiffness(state.tolist())
    sizes, vectors = modes(equations, state)
    largest = max(np.abs(sizes).max(), np.abs(diagonal).max())
    return np.asarray(vectors[:, np.abs(sizes - sizes[0]) <= _SOFT * largest])


def _pushed_ahead(equations: Equations, state: FloatArray, sense: float) -> FloatArray:
    """How v pushes the balloons as it goes on, over the largest push; (n_balloons,), 0 where it does not."""
    count = len(equations.walls)
    ahead = state.copy()
    ahead[-1] += sense * _AHEAD * equations.scales[-1]
    forces = -np.array(equations.residual(ahead.tolist())[:count], dtype=np.float64)
    largest = float(np.abs(forces).max())
    return forces / largest if sense and largest > 0.0 else np.zeros(count)
