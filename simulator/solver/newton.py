"""Newton's method on the equilibrium equations: many states at once, one state, or one event.

States are columns: an array of n states has shape (n_unknowns, n). Every function returns states that
solve the equations to rounding, or says that it could not. There is one rule for when the iteration stops,
`settled` and `rounds_to_zero`, for many states as for one; what differs is only how a step is found.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from simulator.model.conditions import Condition
from simulator.model.equations import Equations
from simulator.model.symmetry import symmetry

FloatArray = NDArray[np.float64]
Flags = NDArray[np.bool_]

_EPS = float(np.finfo(float).eps)
_ITERATIONS = 14
_ROUNDED = 4e-15  # a step this small, relatively, is rounding
_DIVERGED = 1e3  # a step this large, relatively, leads nowhere
_STALLED = 0.5  # of the step before it: a step that is no shorter is made of rounding, or leads nowhere
NOISE = 16.0 * _EPS  # of the terms of a residual: it is zero to rounding
_SINGULAR = 1e-9  # a singular value this small, of rows of unit length, is cut off in a least-squares step
_NEARLY = 1e-4  # relatively: stretches of equal balloons this close may be those of balloons that part
_EQUAL = 1e-6  # stretches of equal balloons closer than this may be equal


class NotConverged(ArithmeticError):
    """Newton's method did not reach a state; the caller repairs it (shorter steps) or gives up.

    Attributes
    ----------
    states : (n_unknowns, n) array or None
        Of several states sought, what was reached.
    failed : (n,) array or None
        Which of them are not right.
    """

    def __init__(self, what: str, states: FloatArray | None = None, failed: Flags | None = None) -> None:
        super().__init__(what)
        self.states, self.failed = states, failed


def solved(
    steps: Callable[[FloatArray], tuple[FloatArray, Callable[[], Flags]]],
    guesses: FloatArray,
    scales: FloatArray,
    what: str,
    *,
    accuracy: float = np.inf,
    iterations: int = _ITERATIONS,
) -> FloatArray:
    """Newton's iteration for n states at once, until every one of them is right to rounding.

    Parameters
    ----------
    steps : callable
        Gives, for states (n_unknowns, n), the steps to be subtracted from them, and a function that tells
        which of their residuals, (n,), are no more than rounding makes them.
    guesses : (n_unknowns, n) array
    scales : (n_unknowns,) array
        Sizes below which an unknown counts as zero.
    what : str
        What is sought, for the message.
    accuracy : float
        A last step no longer than this is wanted, besides.
    iterations : int
        At most.

    Raises
    ------
    NotConverged
        If any state did not converge.
    """
    states = guesses
    least = scales[:, None]
    before = np.full(guesses.shape[1], np.nan)  # unknown: no first step is believed
    done = np.zeros(guesses.shape[1], dtype=bool)
    lost = np.zeros_like(done)
    for _ in range(iterations):
        try:
            change, is_noise = steps(states)
        except np.linalg.LinAlgError:
            break
        states = states - change
        size = (np.abs(change) / np.maximum(np.abs(states), least)).max(axis=0)
        if not size.max() < _DIVERGED:  # also where it is not a number
            lost |= ~(size < _DIVERGED)
            if lost.all():
                break
            states[:, lost], size[lost] = guesses[:, lost], 0.0
        done |= settled(size, before, accuracy)
        if not done.all():
            # Beside a fold or a stretch limit rounding keeps the steps larger than that.
            stalled = size >= _STALLED * before
            if stalled.any():
                done |= stalled & is_noise()
        if done.all():
            if lost.any():
                break
            return states
        before = size
    raise NotConverged(what, states, lost | ~done)


def solved_one(
    step: Callable[[list[float]], tuple[Iterable[float], Callable[[], bool]]],
    guess: FloatArray,
    scales: FloatArray,
    what: str,
    *,
    iterations: int = _ITERATIONS,
) -> FloatArray:
    """As `solved` for one state (n_unknowns,), without arrays of one.

    `step` gives the changes to be subtracted, of as many unknowns as change, and whether the residual is no
    more than rounding makes it.
    """
    state: list[float] = guess.tolist()
    least: list[float] = scales.tolist()
    before = math.nan  # unknown: no first step is believed
    for _ in range(iterations):
        try:
            changes, is_noise = step(state)
        except np.linalg.LinAlgError:
            break
        state, size = state.copy(), 0.0
        for i, change in enumerate(changes):
            state[i] -= change
            part = abs(change) / max(abs(state[i]), least[i])
            if not part < _DIVERGED:  # also where it is not a number
                raise NotConverged(what)
            size = max(size, part)
        # Beside a fold or a stretch limit rounding keeps the steps larger than what settles it.
        if settled(size, before, np.inf) or (size >= _STALLED * before and is_noise()):
            return np.array(state)
        before = size
    raise NotConverged(what)


@overload
def settled(size: float, before: float, accuracy: float) -> bool: ...
@overload
def settled(size: FloatArray, before: FloatArray, accuracy: float) -> Flags: ...
def settled(size: Any, before: Any, accuracy: float) -> Any:
    """Whether a step, relatively of some size after one of another, was the last that is needed."""
    # Newton's method squares the error: the next step would be about size³/before².
    return (size**3 <= 1e-15 * before**2) & (size <= accuracy) | (size <= _ROUNDED)


def linearised(equations: Equations, states: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Residuals (n, n_unknowns − 1) and their Jacobians (n, n_unknowns − 1, n_unknowns) of n states."""
    unknowns, count = states.shape
    right = np.empty((count, unknowns - 1))
    matrices = np.zeros((count, unknowns - 1, unknowns))
    _linearise(equations, states, right, matrices)
    return right, matrices


def _linearise(equations: Equations, states: FloatArray, right: FloatArray, matrices: FloatArray) -> None:
    """As `linearised`, into arrays that are there; zeros are left as they are."""
    residual, rows = equations.linearised(states if states.shape[1] > 1 else states[:, 0].tolist())
    for i, row in enumerate(rows):
        right[:, i] = residual[i]
        for j, entry in enumerate(row):
            if not isinstance(entry, float) or entry:
                matrices[:, i, j] = entry


def rounds_to_zero(
    equations: Equations, states: FloatArray, residuals: FloatArray, matrices: FloatArray
) -> Flags:
    """Whether residuals (n, m) are no more than rounding makes them, (n,).

    Rounding of the unknowns enters through the Jacobians (n, m, n_unknowns), that of the residual itself
    through the terms it is made of: where the force is sublinear or flat these are the larger.
    """
    sizes = np.einsum("nij,jn->ni", np.abs(matrices), np.abs(states))
    for i, terms in enumerate(equations.term_sizes(states)):
        sizes[:, i] += terms
    return np.asarray(np.all(np.abs(residuals) <= NOISE * sizes, axis=1))


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
    unknowns, count = guesses.shape
    matrices = np.zeros((count, unknowns, unknowns))
    matrices[:, -1, :] = normals.T
    right = np.zeros((count, unknowns, 2))
    right[:, -1, 1] = 1.0
    residual = right[:, :-1, 0]
    found: FloatArray = right

    def steps(states: FloatArray) -> tuple[FloatArray, Callable[[], Flags]]:
        nonlocal found
        _linearise(equations, states, residual, matrices)
        found = np.asarray(np.linalg.solve(matrices, right), dtype=np.float64)
        return found[:, :, 0].T, lambda: rounds_to_zero(equations, states, residual, matrices[:, :-1])

    states = solved(steps, guesses, equations.scales, "states on given planes", accuracy=accuracy)
    return states, np.asarray(found[:, :, 1].T)


def at_drive(equations: Equations, guesses: FloatArray) -> FloatArray:
    """The states at the guesses' own v, (n_unknowns, n). Raises NotConverged."""
    unknowns, count = guesses.shape
    right = np.empty((count, unknowns - 1))
    matrices = np.zeros((count, unknowns - 1, unknowns))
    change = np.zeros_like(guesses)

    def steps(states: FloatArray) -> tuple[FloatArray, Callable[[], Flags]]:
        _linearise(equations, states, right, matrices)
        change[:-1] = np.linalg.solve(matrices[:, :, :-1], right[:, :, None])[:, :, 0].T
        return change, lambda: rounds_to_zero(equations, states, right, matrices)

    return solved(steps, guesses, equations.scales, "state at a given drive")


def one_at_drive(equations: Equations, guess: FloatArray) -> FloatArray:
    """The state at the guess's own v, both (n_unknowns,). Raises NotConverged."""

    def step(state: list[float]) -> tuple[list[float], Callable[[], bool]]:
        residual, rows = equations.linearised(state)
        matrix = np.array(rows, dtype=np.float64)
        changes = np.linalg.solve(matrix[:, :-1], np.array(residual, dtype=np.float64)).tolist()
        return changes, lambda: _rounds_to_zero(equations, state, residual, matrix)

    return solved_one(step, guess, equations.scales, "state at a given drive")


def at_event(equations: Equations, condition: Condition, guess: FloatArray) -> FloatArray:
    """The state of the curve at which a condition is zero, (n_unknowns,), to rounding.

    Solved by Newton on [residual, margin] = 0; at a branch point the system is consistent but singular
    across the branch, hence least squares.

    Raises
    ------
    NotConverged
        If the residual or the margin does not vanish.
    """
    what = f"state at a {condition.kind}"

    def step(state: list[float]) -> tuple[list[float], Callable[[], bool]]:
        residual, rows = equations.linearised(state)
        defect = np.array([*residual, condition.margin(state)])
        if not np.all(np.isfinite(defect)):
            raise NotConverged(what)
        values = np.array(state)
        derivatives = np.array([*rows, condition.slope(values)], dtype=np.float64)
        # In sizes of the state itself: near a stretch limit the pressure or voltage is far above its scale.
        scales = np.maximum(equations.scales, np.abs(values))
        matrix = derivatives * scales
        # Rows of one size, so that only a true singularity is cut off, not a small row.
        sizes = np.sqrt(np.einsum("ij,ij->i", matrix, matrix))
        if not sizes.all() or not np.all(np.isfinite(sizes)):
            raise NotConverged(what)  # a margin that nothing changes
        found = np.linalg.lstsq(matrix / sizes[:, None], defect / sizes, rcond=_SINGULAR)[0]
        return (scales * found).tolist(), lambda: _rounds_to_zero(equations, state, defect, derivatives)

    start = guess
    alike = symmetry(equations, guess, _EQUAL)
    if alike is not None:
        # Several modes of equal balloons soften at once. Which of them the margin's slope is of is chance,
        # and the step would lead aside; among states in which they are alike there is no choice.
        narrow = alike.narrowed(guess)
        start = np.array(alike.widened(narrow.tolist()))
        with contextlib.suppress(NotConverged):
            found = at_event(alike.equations, alike.condition(condition), narrow)
            return np.array(alike.widened(found.tolist()))
    state = solved_one(step, start, equations.scales, what, iterations=2 * _ITERATIONS)
    return _together(equations, condition, state)


def held_apart(equations: Equations, point: FloatArray, change: FloatArray) -> FloatArray:
    """The state with stretches changed by (n_balloons,) in a direction, held there, and at rest across it.

    At the point's own v. Raises NotConverged.
    """
    count = change.size
    guess = np.append(point, 0.0)  # the last unknown is the force that holds it
    guess[:count] += change
    walls = equations.walls

    def step(state: list[float]) -> tuple[list[float], Callable[[], bool]]:
        residual, rows = equations.linearised(state[:-1])
        size = len(residual) + 1
        matrix, right = np.zeros((size, size)), np.zeros(size)
        matrix[:-1, :-1] = np.array(rows, dtype=np.float64)[:, :-1]
        matrix[-1, :count] = change
        right[:-1] = residual
        right[-1] = change @ (np.array(state[:count]) - point[:count] - change)
        for i, (wall, x) in enumerate(zip(walls, state, strict=False)):
            # Π + force · change: of R = D g/k.
            matrix[i, -1] = wall.elastomer.pole_form(x)[1] / wall.weight * change[i]
            right[i] += matrix[i, -1] * state[-1]
        found = np.linalg.solve(matrix, right).tolist()
        return [*found[:-1], 0.0, found[-1]], lambda: True

    scales = np.append(equations.scales, 1.0)
    return solved_one(step, guess, scales, "state held apart")[:-1]


def _together(equations: Equations, condition: Condition, state: FloatArray) -> FloatArray:
    """The event of balloons that are alike where a state cannot be told from it, else the state.

    Where equal balloons part the equations are singular: what they are off the event goes into the residual
    with its third power. Among states in which they are alike it is a regular solution.
    """
    alike = symmetry(equations, state, _NEARLY)
    if alike is None:
        return state
    try:
        found = at_event(alike.equations, alike.condition(condition), alike.narrowed(state))
    except NotConverged:
        return state
    event = np.array(alike.widened(found.tolist()))
    if np.max(np.abs(event - state) / equations.scales) > _NEARLY * np.max(np.abs(state / equations.scales)):
        return state
    # Another event close by, such as a limit point after the parting, has forces between it and this one.
    halfway = 0.5 * (state + event)
    residual, matrices = linearised(equations, halfway[:, None])
    for places in map(list, alike.sets):
        parting = residual[0, places] - residual[0, places].mean()
        if np.any(np.abs(parting) > NOISE * (np.abs(matrices[0, places]) @ np.abs(halfway))):
            return state
    return event


def at_crossing(equations: Equations, condition: Condition, guess: FloatArray) -> FloatArray:
    """As `at_event`, of a condition that the curve crosses in a regular state.

    Raises
    ------
    NotConverged
        If the residual or the margin does not vanish, or the state is not regular.
    """

    def step(state: list[float]) -> tuple[list[float], Callable[[], bool]]:
        residual, rows = equations.linearised(state)
        defect = [*residual, condition.margin(state)]
        matrix = np.array([*rows, condition.slope(np.array(state))], dtype=np.float64)
        changes = np.linalg.solve(matrix, np.array(defect, dtype=np.float64)).tolist()
        return changes, lambda: _rounds_to_zero(equations, state, defect, matrix)

    return solved_one(step, guess, equations.scales, f"state at a {condition.kind}")


def _rounds_to_zero(
    equations: Equations, state: list[float], residual: Sequence[float] | FloatArray, rows: FloatArray
) -> bool:
    """As `rounds_to_zero`, for one state."""
    return bool(rounds_to_zero(equations, np.array(state)[:, None], np.array(residual)[None], rows[None])[0])


def tangents(equations: Equations, states: FloatArray, towards: FloatArray) -> FloatArray:
    """Unit tangents of the curve (in scaled unknowns) at n states, on the side of `towards`."""
    weights = 1.0 / equations.scales[:, None] ** 2
    matrices = np.empty((states.shape[1], states.shape[0], states.shape[0]))
    matrices[:, :-1, :] = linearised(equations, states)[1]
    matrices[:, -1, :] = (weights * towards).T
    right = np.zeros((states.shape[1], states.shape[0], 1))
    right[:, -1] = 1.0
    return unit(equations, np.asarray(np.linalg.solve(matrices, right)[:, :, 0].T))


def unit(equations: Equations, directions: FloatArray) -> FloatArray:
    """Directions (n_unknowns, n) made of unit length in scaled unknowns."""
    scaled = directions / equations.scales[:, None]
    return np.asarray(directions / np.sqrt(np.einsum("ij,ij->j", scaled, scaled)))
