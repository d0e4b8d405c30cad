"""Newton's method on the equilibrium equations: many states at once, or one event to the last bit.

States are columns: an array of n states has shape (n_unknowns, n). Every function returns states that
solve the equations to rounding, or says that it could not.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from simulator.model.conditions import Condition, modes, softest_mode
from simulator.model.equations import Equations, Rows, SealedBalloons

FloatArray = NDArray[np.float64]

_EPS = float(np.finfo(float).eps)
_ITERATIONS = 14
_CROSSING = 1e-11  # a singular value this small, of rows of unit length, is zero: two curves cross


class NotConverged(ArithmeticError):
    """Newton's method did not reach a state; the caller repairs it (shorter steps) or gives up."""


def linearised(equations: Equations, states: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Residuals (n, n_unknowns − 1) and their Jacobians (n, n_unknowns − 1, n_unknowns) of n states."""
    unknowns, count = states.shape
    right = np.empty((count, unknowns - 1))
    matrices = np.zeros((count, unknowns - 1, unknowns))
    _linearise(equations, states, right, matrices)
    return right, matrices


def _linearise(equations: Equations, states: FloatArray, right: FloatArray, matrices: FloatArray) -> None:
    """As `linearised`, into arrays that are there; zeros are left as they are."""
    residual, rows = equations.linearised(states)
    for i, row in enumerate(rows):
        right[:, i] = residual[i]
        for j, entry in enumerate(row):
            if not isinstance(entry, float) or entry:
                matrices[:, i, j] = entry


def on_planes(
    equations: Equations, guesses: FloatArray, normals: FloatArray, accuracy: float = np.inf
) -> tuple[FloatArray, FloatArray]:
    """The states of the curve on planes through the guesses, and how they move as the planes move.

    Parameters
    ----------
    equations
    guesses, normals : (n_unknowns, n) arrays
        With normals along the last axis these are the states at given v.
    accuracy : float
        Accuracy wanted of the rates; the states are always right to rounding.

    Returns
    -------
    states, rates : (n_unknowns, n) arrays
        `rates` is tangent to the curve, with normal · rate = 1.

    Raises
    ------
    NotConverged
        If any state did not converge.
    """
    states = guesses.copy()
    unknowns, count = states.shape
    scales = equations.scales[:, None]
    matrices = np.zeros((count, unknowns, unknowns))
    matrices[:, -1, :] = normals.T
    right = np.zeros((count, unknowns, 2))
    right[:, -1, 1] = 1.0
    residual = right[:, :-1, 0]
    before = np.full(count, np.nan)  # unknown: no first step is believed
    for iteration in range(_ITERATIONS):
        _linearise(equations, states, residual, matrices)
        try:
            solved = np.linalg.solve(matrices, right)
        except np.linalg.LinAlgError:
            break
        step = solved[:, :, 0].T
        states -= step
        size = (np.abs(step) / np.maximum(np.abs(states), scales)).max(axis=0)
        if not size.max() < 1e3:  # also where it is not a number
            break
        # Newton's method squares the error: the next step would be about size³/before².
        done = (size**3 <= 1e-15 * before**2) & (size <= accuracy) | (size <= 4e-15)
        if iteration > 1 and not done.all():
            # Beside a fold or a stretch limit rounding keeps the steps larger than that. A residual that
            # the last bits of the unknowns make up is zero.
            noise = np.einsum("nij,jn->ni", np.abs(matrices[:, :-1]), np.abs(states))
            noise += np.broadcast_to(equations.given_load(states), count)[:, None]
            done |= np.all(np.abs(residual) <= 16.0 * _EPS * noise, axis=1)
        if done.all():
            return states, np.asarray(solved[:, :, 1].T)
        before = size
    raise NotConverged("states on given planes")


def at_drive(equations: Equations, guesses: FloatArray) -> FloatArray:
    """The states at the guesses' own v. Raises NotConverged."""
    normals = np.zeros_like(guesses)
    normals[-1] = 1.0
    return on_planes(equations, guesses, normals)[0]


def one_at_drive(equations: Equations, guess: FloatArray) -> FloatArray:
    """The one state at the guess's own v, shape (n_unknowns,); as `at_drive`, without arrays of one."""
    state: list[float] = guess.tolist()
    scales: list[float] = equations.scales.tolist()
    before = np.nan
    for _ in range(_ITERATIONS):
        residual, rows = equations.linearised(state)
        matrix = np.array(rows, dtype=np.float64)[:, :-1]
        try:
            step: list[float] = np.linalg.solve(matrix, np.array(residual, dtype=np.float64)).tolist()
        except np.linalg.LinAlgError:
            break
        size = 0.0
        for i, change in enumerate(step):
            state[i] -= change
            size = max(size, abs(change) / max(abs(state[i]), scales[i]))
        if not size < 1e3:
            break
        if size**3 <= 1e-15 * before**2 or size <= 4e-15 or _is_noise(equations, residual, rows, state):
            return np.array(state)
        before = size
    raise NotConverged("state at a given drive")


def _is_noise(equations: Equations, residual: Sequence[float], rows: Rows, state: Sequence[float]) -> bool:
    """Whether a residual is no more than the last bits of the unknowns make it."""
    given = equations.given_load(state)
    return all(
        abs(r) <= 16.0 * _EPS * (given + sum(abs(a * y) for a, y in zip(row, state, strict=True)))
        for r, row in zip(residual, rows, strict=True)
    )


def tangents(equations: Equations, states: FloatArray, towards: FloatArray) -> FloatArray:
    """Unit tangents of the curve (in scaled unknowns) at n states, on the side of `towards`."""
    weights = 1.0 / equations.scales[:, None] ** 2
    matrices = np.empty((states.shape[1], states.shape[0], states.shape[0]))
    matrices[:, :-1, :] = linearised(equations, states)[1]
    matrices[:, -1, :] = (weights * towards).T
    right = np.zeros((states.shape[1], states.shape[0], 1))
    right[:, -1] = 1.0
    return unit(equations, np.asarray(np.linalg.solve(matrices, right)[:, :, 0].T))


def tangent_at_end(equations: Equations, state: FloatArray, towards: FloatArray) -> FloatArray:
    """Unit tangent at one state on the side of `towards`, also at a branch point, where two curves cross."""
    scales = equations.scales
    rows = np.array(equations.linearised(state.tolist())[1], dtype=np.float64) * scales
    # One tangent spans the null space of the rows; where two curves cross there are two, and what `towards`
    # has in their plane is the curve that was followed.
    rows /= np.sqrt(np.einsum("ij,ij->i", rows, rows))[:, None]
    _, sizes, vectors = np.linalg.svd(rows)
    null = vectors[np.count_nonzero(sizes > _CROSSING) :]
    along = null.T @ (null @ (towards / scales))
    return np.asarray(scales * along / np.linalg.norm(along))


def unit(equations: Equations, directions: FloatArray) -> FloatArray:
    """Directions (n_unknowns, n) made of unit length in scaled unknowns."""
    scaled = directions / equations.scales[:, None]
    return np.asarray(directions / np.sqrt(np.einsum("ij,ij->j", scaled, scaled)))


def at_event(equations: Equations, condition: Condition, guess: FloatArray) -> FloatArray:
    """The state of the curve at which a condition is zero, shape (n_unknowns,), to rounding.

    Solved by Newton on [residual, margin] = 0; at a branch point the system is consistent but singular
    across the branch, hence least squares.

    Raises
    ------
    NotConverged
        If the residual or the margin does not vanish.
    """
    state = _evened(equations, guess)
    before = np.nan  # unknown: no first step is believed
    for _ in range(2 * _ITERATIONS):
        values = state.tolist()
        residual, rows = equations.linearised(values)
        if not np.all(np.isfinite(residual)):
            break
        defect = np.array([*residual, condition.margin(values)])
        if not np.all(np.isfinite(defect)):
            break
        slope = condition.slope(state).tolist()
        if not np.all(np.isfinite(slope)):
            break
        # In sizes of the state itself: near a stretch limit the pressure or voltage is far above its scale.
        scales = np.maximum(equations.scales, np.abs(state))
        matrix = np.array([*rows, slope], dtype=np.float64) * scales
        # Rows of one size, so that only a true singularity is cut off, not a small row.
        sizes = np.sqrt(np.einsum("ij,ij->i", matrix, matrix))
        if not sizes.all():
            break  # a margin that nothing changes
        step = np.linalg.lstsq(matrix / sizes[:, None], defect / sizes, rcond=1e-9)[0]
        state = state - scales * step
        size = float(np.max(np.abs(step)))
        settled = size <= 4e-15 or size**3 <= 1e-15 * before**2
        if settled or (
            not size < 0.5 * before and _is_noise(equations, defect.tolist(), [*rows, slope], values)
        ):
            even = _symmetric(equations, np.asarray(state))
            # Told apart by rounding only, equal balloons split a multiple eigenvalue: again, from the middle.
            return even if np.abs(even - state).max() <= 1e-12 else at_event(equations, condition, even)
        before = size
    raise NotConverged(f"state at a {condition.kind}")


def _symmetric(equations: Equations, state: FloatArray) -> FloatArray:
    """A state with the stretches of equal balloons made equal where they differ by rounding.

    At the branch point where equal balloons part, rounding is all that tells them apart, and much enlarged.
    """
    even = _evened(equations, state)
    residual, rows = equations.linearised(even.tolist())
    return even if _is_noise(equations, residual, rows, even.tolist()) else state


def _evened(equations: Equations, state: FloatArray) -> FloatArray:
    """A state with the stretches of equal balloons averaged where they are close."""
    even = state.copy()
    if isinstance(equations, SealedBalloons):
        for membrane in set(equations.membranes):
            same = [i for i, other in enumerate(equations.membranes) if other == membrane]
            if np.ptp(state[same]) < 1e-6:
                even[same] = state[same].mean()
    return even


def is_fold(equations: Equations, state: FloatArray) -> bool:
    """Whether the drive pushes a singular point along its soft mode: a limit point (else a branch point)."""
    rows = np.array(equations.linearised(state.tolist())[1], dtype=np.float64) * equations.scales
    rows /= np.sqrt(np.einsum("ij,ij->i", rows, rows))[:, None]
    return bool(np.linalg.svd(rows)[1][-1] > _CROSSING)


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
    values = state.tolist()
    mode = softest_mode(equations, state)
    walls = equations.walls
    denominators = np.array([w.elastomer.pole_form(x)[1] for w, x in zip(walls, values, strict=False)])
    weights = np.array([w.weight for w in walls])
    # S = T H T: the mode z of S is the mode T z of H, and R's push on it is Σ z √(weight/D) ∂R/∂v.
    push = np.array([row[-1] for row in equations.linearised(values)[1][: len(walls)]], dtype=np.float64)
    scale = np.sqrt(np.maximum(denominators, 1e-300) / weights)
    away = -np.sign(direction * (mode * np.sqrt(weights / np.maximum(denominators, 1e-300))) @ push)
    change = (away if away else 1.0) * scale * mode
    return np.asarray(change / np.linalg.norm(change))


def softest_change(equations: Equations, state: FloatArray) -> FloatArray:
    """The softest mode as a change of the stretches, unit length, (n_balloons,)."""
    # S = T H T: the mode z of S is the mode T z of H.
    values = state.tolist()
    scale = [
        np.sqrt(max(w.elastomer.pole_form(x)[1], 1e-300) / w.weight)
        for w, x in zip(equations.walls, values, strict=False)
    ]
    change = np.array(scale) * softest_mode(equations, state)
    return np.asarray(change / np.linalg.norm(change))


def parting_direction(equations: Equations, state: FloatArray) -> FloatArray:
    """How the stretches part at a branch point: of all soft modes, what lets the first balloon grow most.

    With more than two equal balloons there are several soft modes, and the first balloon against all others
    is the direction in which another branch leaves. Unit length, (n_balloons,).
    """
    values = state.tolist()
    diagonal, _ = equations.stiffness(values)
    sizes, vectors = modes(equations, state)
    soft = vectors[:, np.abs(sizes) <= 1e-8 * max(np.abs(sizes).max(), np.abs(diagonal).max())]
    soft = soft if soft.size else vectors[:, :1]
    first = int(np.argmax(np.abs(soft).max(axis=1) > 1e-3))
    walls = equations.walls
    scale = np.array(
        [
            np.sqrt(max(w.elastomer.pole_form(x)[1], 1e-300) / w.weight)
            for w, x in zip(walls, values, strict=False)
        ]
    )
    change = scale * (soft @ soft[first])
    return np.asarray(change / np.linalg.norm(change))
