"""One interval of path between two states, for all runs at once: five points on the curve, and what they say.

The points are those of Lobatto's rule, so that they serve for quadrature, for polynomials of the margins, and
to see that the two ends are on one smooth curve.
"""

from __future__ import annotations

from math import comb
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from simulator.solver.batch.bordered import Bordered
from simulator.solver.batch.stacked import Stacked

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

_ROOT = float(np.sqrt(3.0 / 7.0))
POINTS = 0.5 + 0.5 * np.array([-1.0, -_ROOT, 0.0, _ROOT, 1.0])
WEIGHTS = np.array([0.05, 49.0 / 180.0, 16.0 / 45.0, 49.0 / 180.0, 0.05])
GRID = np.linspace(0.0, 1.0, 33)
_ASIDE = 0.2  # over the length of an interval: how far the curve may be from the cubic through its ends
_WORK = 1e-5  # of the work of an interval: how well it must agree with what is stored


def basis(x: FloatArray) -> FloatArray:
    """Lagrange's polynomials through the points at x (n,), shape (5, n)."""
    rows = []
    for j, here in enumerate(POINTS):
        others = np.delete(POINTS, j)
        rows.append(np.prod(x - others[:, None], axis=0) / np.prod(here - others))
    return np.array(rows)


_AT_GRID = basis(GRID).T.copy()  # (33, 5)
# The slope of the polynomial through five values, in Bernstein's form: between the least and the greatest of
# these four, and the first and the last of them at the two ends.
SLOPES = (
    np.array([[comb(i, k) / comb(3, k) for k in range(4)] for i in range(4)])
    @ np.diag([1.0, 2.0, 3.0, 4.0])
    @ np.linalg.inv(np.vander(POINTS, increasing=True))[1:]
)
# A quartic through five values, in Bernstein's form: it is not below the least of these.
_COEFFICIENTS = np.array([[comb(i, k) / comb(4, k) for k in range(5)] for i in range(5)]) @ np.linalg.inv(
    np.vander(POINTS, increasing=True)
)
_HIGHEST = np.array([np.prod(p - np.delete(POINTS, j)) ** -1.0 for j, p in enumerate(POINTS)])
_SHAPE = np.abs(np.prod(GRID[:, None] - POINTS, axis=1))  # of the polynomial through five points: its error
_SHARE = np.max(_SHAPE)
_X = POINTS[1:4, None]


class Interval(NamedTuple):
    """What is known of an interval; arrays end in (n_runs,).

    Attributes
    ----------
    states : (n_unknowns, 5, n_runs) array
    tangents : (n_unknowns, 2, n_runs) array
        Unit tangents at its two ends.
    margins : (n_margins, 5, n_runs) array
        The softest balloon's pivot, the smallest ∂R/∂λ of the others, then those of `Stacked.margins`.
    work : (n_runs,) array
        ∫ −∂Π/∂v dv.
    exchanged : (n_runs,) array
        Its absolute value, integrated.
    defect : (n_runs,) array
        What the work and the change of the potential do not agree by.
    smooth : (n_runs,) array of bool
        Whether the points lie as they must.
    """

    states: FloatArray
    tangents: FloatArray
    margins: FloatArray
    work: FloatArray
    exchanged: FloatArray
    defect: FloatArray
    smooth: BoolArray


class Node(NamedTuple):
    """States (n_unknowns, n_runs), unit tangents, and their margins and potential where they are known."""

    state: FloatArray
    tangent: FloatArray
    pivot: FloatArray
    others: FloatArray


def on_grid(values: FloatArray) -> FloatArray:
    """The polynomials through values (…, 5, n_runs) at the points, on `GRID`: (…, 33, n_runs)."""
    # Not by @, here and elsewhere in this package: BLAS starts threads for rows so long, and waiting for them
    # takes longer than the product where other workers keep the cores busy.
    return np.asarray(np.einsum("gj,...jn->...gn", _AT_GRID, values))


def blur(values: FloatArray) -> FloatArray:
    """By how much the polynomials through values (5, n_runs) may be off on `GRID`, about."""
    return np.asarray(2.0 * np.abs(_HIGHEST @ values) * _SHAPE[:, None])


def square(weights: FloatArray, change: FloatArray) -> FloatArray:
    """|change|² in scaled unknowns."""
    return np.asarray((weights * change * change).sum(axis=0))


def interval(
    batch: Stacked, weights: FloatArray, first: Node, last: Node, place: NDArray[np.int64]
) -> Interval:
    """Look at the path between two nodes."""
    chord = last.state - first.state
    length = np.sqrt(square(weights, chord))
    cosines = (weights * chord * (first.tangent + last.tangent)).sum(axis=0) / length
    # Arc over chord, exact to fourth order: the cosines between directions and chord tell the turn.
    arc = length * 3.0 / (2.0 + 0.5 * cosines)
    m0, m1 = first.tangent * arc, last.tangent * arc
    a, b = 3.0 * chord - 2.0 * m0 - m1, m0 + m1 - 2.0 * chord
    y0, m, a, b = (part[:, None, :] for part in (first.state, m0, a, b))
    guesses = y0 + _X * (m + _X * (a + _X * b))
    slopes = m + _X * (2.0 * a + _X * 3.0 * b)
    normal = weights[:, None, :] * slopes
    states = guesses
    for _ in range(2):
        border = Bordered(batch.parts(states), normal, place)
        step = border.correction()
        states = states + step
    aside = states - guesses
    w = weights[:, None, :]
    speed = square(w, slopes)
    # On planes across the cubic the state moves at dy/dξ = rate (|c′|² − c″·(y − c)).
    along = speed - (w * (2.0 * a + 6.0 * _X * b) * aside).sum(axis=0)
    speeds = np.concatenate([m0[-1:], border.rates()[-1] * along, m1[-1:]])
    states = np.concatenate([y0, states, last.state[:, None, :]], axis=1)
    inner = border.others if batch.count > 1 else np.broadcast_to(np.inf, border.pivot.shape)
    margins = [
        np.concatenate([first.pivot[None], border.pivot, last.pivot[None]]),
        *([np.concatenate([first.others[None], inner, last.others[None]])] if batch.count > 1 else []),
        *(np.broadcast_to(margin.at(states), states.shape[1:]) for margin in batch.margins),
    ]
    power = np.asarray(batch.equations.drive_power(states)) * speeds
    work = np.einsum("j,jn->n", WEIGHTS, power)
    exchanged = np.einsum("j,jn->n", WEIGHTS, np.abs(power))
    energy = np.asarray(batch.equations.potential(states[:, [0, -1]]))
    defect = energy[1] - energy[0] + work
    smooth = (
        (square(w, aside) <= _ASIDE**2 * speed).all(axis=0)
        & (square(w, step) <= 1e-11 * np.maximum(speed, 1e-10)).all(axis=0)
        & (np.abs(defect) <= _WORK * (exchanged + 1e-4 * np.abs(energy).max(axis=0)))
        & (cosines > 1.4)
    )
    tangents = np.stack([first.tangent, last.tangent], axis=1)
    return Interval(states, tangents, np.stack(margins), work, exchanged, defect, smooth)


class Sight(NamedTuple):
    """What margins do in an interval.

    `first` (n_runs,) is which of them is zero first, −1 where none is, `at` where; `unclear` where the
    polynomial through five points leaves open whether one is.
    """

    first: NDArray[np.int64]
    at: FloatArray
    unclear: BoolArray


def look(margins: FloatArray) -> Sight:
    """Where margins (n_margins, 5, n_runs) first fall through zero."""
    runs = margins.shape[2]
    rough = 2.0 * np.abs(np.einsum("j,mjn->mn", _HIGHEST, margins)) * _SHARE
    first = np.full(runs, -1)
    at = np.full(runs, np.inf)
    unclear = np.zeros(runs, dtype=bool)
    # Most margins are far from zero all along.
    low = np.einsum("ej,mjn->emn", _COEFFICIENTS, margins).min(axis=0)
    which, run = np.nonzero(low <= rough)
    if not run.size:
        return Sight(first, at, unclear)
    values = on_grid(margins[which, :, run].T)  # (33, n)
    below = values < 0.0
    place = np.argmax(below, axis=0)
    before = np.maximum(place - 1, 0)
    each = np.arange(run.size)
    upper, lower = values[before, each], values[place, each]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(place > 0, upper / (upper - lower), 0.0)
    root = np.where(below.any(axis=0), GRID[before] + share * GRID[1], np.inf)
    np.minimum.at(at, run, root)
    falls = np.isfinite(root) & (root == at[run])
    winners = np.flatnonzero(falls)[::-1]  # of several at once the first stays
    first[run[winners]] = which[winners]
    falls &= first[run] == which
    # A dip that may reach zero before that.
    doubt = (values < rough[which, run] * (_SHAPE / _SHARE)[:, None]) & (GRID[:, None] < at[run])
    unclear[run[doubt.any(axis=0) & ~falls]] = True
    return Sight(first, at, unclear | (at == 0.0))
