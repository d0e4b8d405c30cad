"""The largest value of a quantity on an interval of path, where it is largest between its ends."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator.model.conditions import COMPLEX_STEP
from simulator.solver.batch.bordered import Bordered
from simulator.solver.batch.interval import GRID, SLOPES, basis, on_grid
from simulator.solver.batch.stacked import Stacked

FloatArray = NDArray[np.float64]
Quantity = Callable[[Stacked, Any], Any]

_ROUNDS = 5
_NEAR = 1e-4  # over the largest so far: how close a polynomial must come for a look at the curve itself


def largest(
    batch: Stacked,
    quantity: Quantity,
    states: FloatArray,
    tangents: FloatArray,
    place: NDArray[np.int64],
    so_far: FloatArray,
) -> FloatArray:
    """The larger of `so_far` (n_runs,) and a quantity's largest value on intervals given by their points.

    Parameters
    ----------
    batch : Stacked
    quantity : callable
        Of runs and their states (n_unknowns, …, n_runs), real or complex.
    states : (n_unknowns, 5, n_runs) array
        See `interval`.
    tangents : (n_unknowns, 2, n_runs) array
        At the first and the last point.
    place : (n_runs,) array
        The softest balloon.
    so_far : (n_runs,) array
    """
    values = np.asarray(quantity(batch, states))
    out: FloatArray = np.maximum(so_far, values.max(axis=0))
    slopes = np.einsum("ej,jn->en", SLOPES, values)
    # Those at the two ends, as they are: it may be largest right beside one, where a path ends.
    ahead = np.asarray(quantity(batch, states[:, [0, -1]] + 1j * COMPLEX_STEP * tangents))
    slopes[[0, -1]] = ahead.imag
    some = np.flatnonzero(~((slopes >= 0.0).all(axis=0) | (slopes <= 0.0).all(axis=0)))
    if not some.size:
        return out
    seen = on_grid(values[:, some])
    top = np.argmax(seen, axis=0)
    first, last = slopes[[0, -1]][:, some]
    last_place = len(GRID) - 1
    inner = np.where(top == 0, first > 0.0, np.where(top == last_place, last < 0.0, True))
    inner &= seen.max(axis=0) > so_far[some] - _NEAR * np.abs(so_far[some])
    some, top = some[inner], top[inner]
    if not some.size:
        return out
    batch, states, place = batch.take(some), states[:, :, some], place[some]
    chord = states[:, -1] - states[:, 0]
    low, high = GRID[np.maximum(top - 1, 0)], GRID[np.minimum(top + 1, last_place)]
    rise_low, _ = _rise(batch, quantity, states, chord, place, low)
    rise_high, _ = _rise(batch, quantity, states, chord, place, high)
    best = np.full(some.size, -np.inf)
    for _ in range(_ROUNDS):
        middle = np.clip(
            np.where(
                (rise_low > 0.0) & (rise_high < 0.0),
                (low * rise_high - high * rise_low) / (rise_high - rise_low),
                0.5 * (low + high),
            ),
            low,
            high,
        )
        rise, value = _rise(batch, quantity, states, chord, place, middle)
        best = np.fmax(best, value)
        up = rise > 0.0
        low, rise_low = np.where(up, middle, low), np.where(up, rise, 0.5 * rise_low)
        high, rise_high = np.where(up, high, middle), np.where(up, 0.5 * rise_high, rise)
    out[some] = np.maximum(out[some], best)
    return out


def _rise(
    batch: Stacked,
    quantity: Quantity,
    states: FloatArray,
    chord: FloatArray,
    place: NDArray[np.int64],
    at: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """How a quantity changes along the path at some place of the intervals, and its value there."""
    y = (states * basis(at)).sum(axis=1)
    for _ in range(2):
        border = Bordered(batch.parts(y), chord, place)
        y = y + border.correction()
    found = np.asarray(quantity(batch, y + 1j * COMPLEX_STEP * border.rates()))
    return found.imag / COMPLEX_STEP, found.real
