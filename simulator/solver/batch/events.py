"""States of the path polished to rounding, many at once: at a given drive, or where a margin is zero."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator.model.conditions import COMPLEX_STEP
from simulator.solver.batch.bordered import Bordered, pivots
from simulator.solver.batch.interval import square
from simulator.solver.batch.stacked import Stacked

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Places = NDArray[np.int64]

_ROUNDS = 10
_CROSSING = 1e-7  # of a tangent's length over those of what it is made from: two curves cross


def at_drive(
    batch: Stacked, weights: FloatArray, guess: FloatArray, v: FloatArray, place: Places
) -> tuple[FloatArray, Bordered, BoolArray]:
    """The states at given v: states, their Jacobian bordered by the drive, and where it is certain."""
    y = guess.copy()
    y[-1] = v
    normal = np.zeros_like(y)
    normal[-1] = 1.0
    sizes = []
    for _ in range(_ROUNDS):
        border = Bordered(batch.parts(y), normal, place)
        step = border.correction()
        step[-1] = 0.0
        y = y + step
        sizes.append(np.sqrt(square(weights, step)))
        if np.all(sizes[-1] <= 1e-11):
            break
    return y, border, (sizes[-1] <= 1e-10) & np.isfinite(y).all(axis=0)


def at_zero(
    batch: Stacked,
    weights: FloatArray,
    guess: FloatArray,
    tangent: FloatArray,
    margin: Callable[[Any], Any] | None,
    place: Places,
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """The states at which a margin (None: stability) falls to zero along the path.

    Newton's method on [residual, margin] = 0: within the plane across the path, and along its tangent.

    Returns
    -------
    states, tangents : (n_unknowns, n_runs) arrays
    good : (n_runs,) array of bool
    """
    y, t = guess.copy(), tangent
    good = np.zeros(y.shape[1], dtype=bool)
    for _ in range(_ROUNDS):
        border = Bordered(batch.parts(y), weights * t, place)
        step, rates = border.correction(), border.rates()
        t = rates / np.sqrt(square(weights, rates))
        y = y + step
        ahead = y + 1j * COMPLEX_STEP * t
        value = pivots(batch.parts(ahead), place)[0] if margin is None else np.asarray(margin(ahead))
        slope = value.imag / COMPLEX_STEP
        change = -value.real / slope
        size = np.sqrt(square(weights, step)) + np.abs(change)
        y = y + change * t
        good = (size <= 1e-9) & (slope < 0.0)
        if np.all(size <= 1e-12):
            break
    good &= np.isfinite(y).all(axis=0)
    if margin is None:
        good &= _turns(border, weights)
    return y, t, good


def _turns(border: Bordered, weights: FloatArray) -> BoolArray:
    """Whether the drive pushes the singular state along its soft mode: a limit point, no branch point."""
    root = 1.0 / np.sqrt(weights)
    if border.parts.area is None:
        rows = [(border.c1 * root[0], border.c3 * root[-1])]
        return np.asarray(np.abs(rows[0][1]) > _CROSSING * np.hypot(*rows[0]))
    scale = (1.0, root[-2], root[-1])
    c = np.stack([x * s for x, s in zip((border.c1, border.c2, border.c3), scale, strict=True)])
    a = np.stack([x * s for x, s in zip((border.a1, border.a2, border.a3), scale, strict=True)])
    cross = np.cross(c, a, axis=0)
    sizes = np.sqrt((c * c).sum(axis=0) * (a * a).sum(axis=0))
    return np.asarray(np.sqrt((cross * cross).sum(axis=0)) > _CROSSING * sizes)
