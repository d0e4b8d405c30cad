"""Newton's method on a path of equilibria: points in a plane, states at an event, singular states."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.oracle.general.equations import STEP, Equations, evened

FloatArray = NDArray[np.float64]


class PathError(ArithmeticError):
    """A path that could not be followed."""


def on_plane(eq: Equations, guess: FloatArray, normal: FloatArray) -> FloatArray | None:
    """The equilibrium near `guess` in the plane through it; None where Newton's method finds none.

    It ends when a step is below rounding, or as good as that and no longer falling.
    """
    y, last = guess, np.inf
    scales = eq.scales(guess)
    # Among equal balloons stretched alike the matrix may be singular, in the direction in which they part.
    alike = eq.alike(guess)
    for _ in range(15):
        residual = eq.residual(y.tolist())
        if not np.all(np.isfinite(residual)):
            return None
        matrix = np.vstack([eq.jacobian(y.tolist()), normal])
        step = _solved(matrix * scales, -np.append(residual, normal @ (y - guess)))
        if step is None:
            return None
        step = evened(step * scales, alike)
        y = evened(y + step, alike)
        size = float(np.max(np.abs(step) / scales))
        if not size < 1.0:
            return None
        if size < 2e-16 or (size < 1e-8 and size >= 0.5 * last):
            return y
        last = size
    return None


def _solved(matrix: FloatArray, right: FloatArray) -> FloatArray | None:
    """The solution of linear equations; the smallest where they are singular, None where not finite."""
    if not np.all(np.isfinite(matrix)):
        return None
    try:
        return np.asarray(np.linalg.solve(matrix, right))
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.lstsq(matrix, right, rcond=1e-12)[0])


def at_drive(eq: Equations, guess: FloatArray, v: float) -> FloatArray | None:
    """The equilibrium near `guess` at a given v."""
    start = guess.copy()
    start[-1] = v
    normal = np.zeros(guess.size)
    normal[-1] = 1.0
    found = on_plane(eq, start, normal)
    if found is not None:
        found[-1] = v
    return found


def tangent(eq: Equations, y: FloatArray, like: FloatArray) -> tuple[FloatArray, float]:
    """Unit tangent of the path (in `eq.scales`) along `like`, and the sign of its bordered determinant."""
    scales = eq.scales(y)
    jacobian = eq.jacobian(y.tolist()) * scales
    row = like / scales
    row /= np.linalg.norm(row)
    rhs = np.zeros(y.size)
    rhs[-1] = 1.0
    found = _solved(np.vstack([jacobian, row]), rhs)
    if found is None:
        return null_direction(eq, y, like), 0.0
    size = float(np.max(np.abs(like)))
    together = [p for p in eq.alike(y) if np.ptp(like[p]) <= 1e-12 * size]
    t = evened(found * scales, together) / scales
    t /= np.linalg.norm(t)
    sign = float(np.linalg.slogdet(np.vstack([jacobian, t]))[0])
    return t * scales, sign


def null_direction(eq: Equations, y: FloatArray, like: FloatArray) -> FloatArray:
    """The direction nearest to `like` in which the equilibria go on, also where there are several."""
    scales = eq.scales(y)
    jacobian = eq.jacobian(y.tolist()) * scales
    values, vectors = np.linalg.svd(jacobian)[1:]
    flat = [vectors[-1], *(v for s, v in zip(values, vectors, strict=False) if s < 1e-6 * values[0])]
    t = sum((v @ (like / scales)) * v for v in flat)
    return np.asarray(t / np.linalg.norm(t) * scales)


def complex_steps(y: FloatArray, function: Callable[[Sequence[Any]], Any]) -> FloatArray:
    """Derivatives of a function of the state in every unknown, (n_unknowns, …)."""
    columns = []
    for j in range(y.size):
        z = [complex(value) if i == j else value for i, value in enumerate(y.tolist())]
        z[j] += 1j * STEP
        columns.append(np.imag(function(z)) / STEP)
    return np.array(columns)


def where(eq: Equations, guess: FloatArray, margin: Callable[[Sequence[Any]], Any]) -> FloatArray | None:
    """The equilibrium near `guess` at which a margin vanishes, by Newton's method."""
    y, last = guess, np.inf
    scales = eq.scales(guess)
    for _ in range(20):
        full = np.append(eq.residual(y.tolist()), margin(y.tolist()))
        matrix = np.vstack([eq.jacobian(y.tolist()), complex_steps(y, margin)])
        step = np.linalg.lstsq(matrix * scales, -full, rcond=1e-15)[0] * scales
        y = np.asarray(y + step)
        size = float(np.max(np.abs(step) / scales))
        if not size < 0.1:
            return None
        if size < 2e-16 or (size < 1e-9 and size >= 0.5 * last):
            return y
        last = size
    return None


def _volume_change(eq: Equations, w: FloatArray, y: Sequence[Any]) -> Any:
    return eq.areas(y) @ w


def singular(eq: Equations, guess: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """The equilibrium near `guess` at which the Hessian is singular, and its null vector.

    Gauss–Newton on equilibrium, H w + s a = 0 (a = ∂V/∂λ and a·w = 0 with a liquid, without them else) and
    |w| = 1; its matrix is regular at a fold, and at a branch point singular in a direction that is not
    needed.
    """
    n, m = eq.size, guess.size
    liquid = eq.contents is not None and eq.contents.is_liquid
    y = guess
    w, s = eq.modes(y.tolist())[1][:, 0], 0.0
    if liquid:
        a = eq.areas(y.tolist())
        s = -float(a @ (eq.hessian(y.tolist()) @ w)) / float(a @ a)
    last = np.inf
    scales = np.concatenate([eq.scales(y), np.ones(n), np.ones(1 if liquid else 0)])
    for _ in range(30):
        z = y.tolist()
        hessian, areas = eq.hessian(z), eq.areas(z)
        rows = 1.0 / np.maximum(np.max(np.abs(hessian), axis=1), 1e-300)
        pull = (hessian @ w + (s * areas if liquid else 0.0)) * rows

        def moved(u: Sequence[Any], w: FloatArray = w, s: float = s, rows: FloatArray = rows) -> NDArray[Any]:
            return np.asarray((eq.hessian(u) @ w + (s * eq.areas(u) if liquid else 0.0)) * rows)

        matrix = np.zeros((m - 1 + n + 1 + liquid, scales.size))
        matrix[: m - 1, :m] = eq.jacobian(z)
        matrix[m - 1 : m - 1 + n, :m] = complex_steps(y, moved).T
        matrix[m - 1 : m - 1 + n, m : m + n] = hessian * rows[:, None]
        matrix[m - 1 + n, m : m + n] = 2.0 * w
        full = [eq.residual(z), pull, [w @ w - 1.0]]
        if liquid:
            matrix[m - 1 : m - 1 + n, -1] = areas * rows
            matrix[-1, m : m + n] = areas
            matrix[-1, :m] = complex_steps(y, partial(_volume_change, eq, w))
            full.append([areas @ w])
        step = np.linalg.lstsq(matrix * scales, -np.concatenate(full), rcond=1e-10)[0] * scales
        y, w = y + step[:m], w + step[m : m + n]
        s += float(step[-1]) if liquid else 0.0
        size = float(np.max(np.abs(step) / scales))
        if not size < 1.0 or not np.all(np.isfinite(eq.residual(y.tolist()))):
            return None
        if size < 1e-15 or (size < 1e-8 and size >= 0.5 * last):
            return y, w / np.linalg.norm(w)
        last = size
    return None
