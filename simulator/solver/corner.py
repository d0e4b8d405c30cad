"""States at given v of a part of a curve that turns too sharply for a cubic: first along v, then along it.

Where v counts in large numbers, as charges of a film that has grown do, nearly all of a part beside a limit
point is a corner. Measured by how far it goes, each unknown by its own change, it is a gentle bend.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from simulator.model.equations import Equations
from simulator.solver import newton

FloatArray = NDArray[np.float64]

_ROUNDS = 60
_CLOSE = 1e-9  # of a chord's change in v: near enough for Newton's method at v


def at_drive_between(
    equations: Equations, guesses: FloatArray, left: FloatArray, right: FloatArray
) -> FloatArray:
    """The states of a curve at the guesses' own v, each between two states of it, (n_unknowns, n).

    Parameters
    ----------
    equations : Equations
    guesses, left, right : (n_unknowns, n) arrays
        v goes one way from left to right.

    Raises
    ------
    NotConverged
        If any state was not found.
    """
    try:
        return newton.at_drive(equations, guesses)
    except newton.NotConverged:
        return newton.at_drive(equations, _nearly(equations, left, right, guesses[-1]))


def _nearly(equations: Equations, left: FloatArray, right: FloatArray, v: FloatArray) -> FloatArray:
    """States near those at n values of v: by regula falsi, as of Illinois, on planes across the chords."""
    chords = right - left
    moves = chords != 0.0
    normals = np.where(moves, 1.0 / np.where(moves, chords, 1.0), 0.0) / moves.sum(axis=0)
    low, high = np.zeros(v.size), np.ones(v.size)
    first, last = left[-1] - v, right[-1] - v
    for _ in range(_ROUNDS):
        middle = (low * last - high * first) / (last - first)
        states, _ = newton.on_planes(equations, left + middle * chords, normals)
        miss = states[-1] - v
        if (np.abs(miss) <= _CLOSE * np.abs(chords[-1])).all():
            break
        same = miss * first > 0.0
        low, high = np.where(same, middle, low), np.where(same, high, middle)
        first, last = np.where(same, miss, 0.5 * first), np.where(same, 0.5 * last, miss)
    states[-1] = v
    return states
