"""Eigenvalues of the scaled Hessian: of balloons coupled by a gas, and of balloons on one constant volume.

A gas adds a finite stiffness to one direction of the stretches: S = diag(d) + √s √sᵀ. A liquid forbids that
direction: of diag(d) only what it does across √s is left, and one eigenvalue fewer. Both are written for the
same two lists, d and s, of floats or rows of arrays.

Both spectra are the roots x of one equation (G. H. Golub, SIAM Rev. 15 (1973) 318–334),

    c + Σ sᵢ/(dᵢ − x) = 0,    c = 1 for a gas, 0 for a liquid,

one between each two neighbours of the sorted d and, for a gas, one above the largest. The sum is taken from 0
and not from a neighbour, so that a root close to 0 has the right sign and the right digits however large the
other eigenvalues are: next to a stretch limit they grow without bound.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Number = Any

_LEAST = float(np.finfo(float).tiny)
_EPS = float(np.finfo(float).eps)
_CLOSEST = 1e-150  # two d closer than this are one: the squares of their distances are no numbers
_MOST_ITERATIONS = 2000
_PATIENCE = 16  # iterations in which the bounds must come together by half


class Spectrum(Protocol):
    """Eigenvalues, modes and determinant, from the diagonal d and the squares s of the coupling."""

    def count(self, balloons: int) -> int:
        """The number of eigenvalues of so many balloons."""
        ...

    def eigenvalue(self, diagonal: Sequence[Number], squares: Sequence[Number], place: int) -> Number:
        """The eigenvalue at a place in ascending order; NaN where d or s are none."""
        ...

    def modes(self, diagonal: Sequence[float], squares: Sequence[float]) -> tuple[FloatArray, FloatArray]:
        """All eigenvalues, ascending, (n_modes,), and unit eigenvectors as columns, (n_balloons, n_modes)."""
        ...

    def slopes(
        self,
        mode: FloatArray,
        diagonal: FloatArray,
        squares: FloatArray,
        diagonal_slopes: FloatArray,
        square_slopes: FloatArray,
    ) -> FloatArray:
        """Derivatives of the eigenvalue of a unit mode, (n,), from those of d and s, (n_balloons, n)."""
        ...

    def determinant(self, diagonal: Sequence[Number], squares: Sequence[Number]) -> Number:
        """The product of all eigenvalues, up to a positive factor."""
        ...


class Coupled:
    """S = diag(d) + √s √sᵀ; with s = 0 no coupling at all."""

    def count(self, balloons: int) -> int:
        return balloons

    def eigenvalue(self, diagonal: Sequence[Number], squares: Sequence[Number], place: int) -> Number:
        if len(diagonal) == 1:
            return diagonal[0] + squares[0]
        if len(diagonal) == 2:
            return _one_of_two(diagonal, squares, place)
        return _roots(diagonal, squares, place, 1.0)

    def modes(self, diagonal: Sequence[float], squares: Sequence[float]) -> tuple[FloatArray, FloatArray]:
        arms = np.sqrt(np.maximum(squares, 0.0))
        _, vectors = np.linalg.eigh(np.diag(diagonal) + np.outer(arms, arms))
        values = [self.eigenvalue(diagonal, squares, place) for place in range(len(diagonal))]
        return np.array(values, dtype=np.float64), np.asarray(vectors)

    def slopes(
        self,
        mode: FloatArray,
        diagonal: FloatArray,
        squares: FloatArray,
        diagonal_slopes: FloatArray,
        square_slopes: FloatArray,
    ) -> FloatArray:
        # Of the eigenvalue z·Sz: z·S′z.
        arms = np.sqrt(np.maximum(squares, 0.0))[:, None]
        turns = np.divide(square_slopes, 2.0 * arms, out=np.zeros_like(square_slopes), where=arms > 0.0)
        return np.asarray(mode**2 @ diagonal_slopes + 2.0 * (mode @ arms) * (mode @ turns))

    def determinant(self, diagonal: Sequence[Number], squares: Sequence[Number]) -> Number:
        # Π d + Σ sᵢ Π_{j≠i} dⱼ
        return _product(diagonal) + _minors(diagonal, squares)


class Constrained:
    """P diag(d) P on the complement of √s: what moves no volume.

    The limit of `Coupled` for s → ∞ without the eigenvalue that goes there. One balloon alone has no such
    motion: nothing can make it unstable, and its margin is 1 at any state.
    """

    def count(self, balloons: int) -> int:
        return balloons - 1

    def eigenvalue(self, diagonal: Sequence[Number], squares: Sequence[Number], place: int) -> Number:
        if len(diagonal) == 1:
            return 1.0 + 0.0 * diagonal[0]
        if len(diagonal) == 2:
            (d, e), (s, t) = diagonal, squares
            total = s + t
            if isinstance(total, float) and total == 0.0:
                return math.nan  # both beyond their stretch limits: a trial that leads nowhere
            return (d * t + e * s) / total
        return _roots(diagonal, squares, place, 0.0)

    def modes(self, diagonal: Sequence[float], squares: Sequence[float]) -> tuple[FloatArray, FloatArray]:
        arms = np.sqrt(np.maximum(squares, 0.0))
        basis = np.linalg.svd(arms[None, :])[2][1:].T  # orthonormal, across the arms
        _, vectors = np.linalg.eigh(basis.T @ (np.asarray(diagonal)[:, None] * basis))
        values = [self.eigenvalue(diagonal, squares, place) for place in range(len(diagonal) - 1)]
        return np.array(values, dtype=np.float64), np.asarray(basis @ vectors)

    def slopes(
        self,
        mode: FloatArray,
        diagonal: FloatArray,
        squares: FloatArray,
        diagonal_slopes: FloatArray,
        square_slopes: FloatArray,
    ) -> FloatArray:
        if mode.size == 1:
            return np.zeros(diagonal_slopes.shape[1])
        # Of the eigenvalue z·Dz: z·D′z + 2 z′·Dz, and z stays across the arms u: z′·u = −z·u′.
        arms = np.sqrt(np.maximum(squares, 0.0))
        turns = np.divide(
            square_slopes,
            2.0 * arms[:, None],
            out=np.zeros_like(square_slopes),
            where=arms[:, None] > 0.0,
        )
        pull = float(arms @ (diagonal * mode)) / max(float(arms @ arms), _LEAST)
        return np.asarray(mode**2 @ diagonal_slopes - 2.0 * pull * (mode @ turns))

    def determinant(self, diagonal: Sequence[Number], squares: Sequence[Number]) -> Number:
        return _minors(diagonal, squares)


COUPLED = Coupled()
CONSTRAINED = Constrained()


def _one_of_two(diagonal: Sequence[Number], squares: Sequence[Number], place: int) -> Number:
    """One of the two eigenvalues of two balloons: the larger by the root, the other by the product."""
    (d, e), (s, t) = diagonal, squares
    mean, half = 0.5 * (d + s + e + t), 0.5 * (d + s - e - t)
    # D, and with it s or t, can be a rounding error below zero at the stretch limit.
    if isinstance(half, float):
        root = math.sqrt(max(half * half + s * t, 0.0))
        if (mean > 0.0) == bool(place) or mean == 0.0:
            return mean + root if place else mean - root
        other = mean + root if mean > 0.0 else mean - root
        return (d * e + d * t + e * s) / other
    root = np.sqrt(np.maximum(half * half + s * t, 0.0))
    positive = mean > 0.0
    if positive.all():
        return mean + root if place else (d * e + d * t + e * s) / (mean + root)
    larger = np.where(positive, mean + root, mean - root)
    product = d * e + d * t + e * s
    smaller = np.divide(product, larger, out=np.zeros_like(larger), where=larger != 0.0)
    return np.where(positive == bool(place), larger, smaller)


def _roots(diagonal: Sequence[Number], squares: Sequence[Number], place: int, constant: float) -> Number:
    """`_root` for floats or for rows of arrays."""
    if isinstance(diagonal[0], float):
        return _root(diagonal, squares, place, constant)
    rows = np.broadcast_arrays(*diagonal, *squares)
    columns = np.array(rows, dtype=np.float64).reshape(len(rows), -1).T.tolist()
    count = len(diagonal)
    found = [_root(column[:count], column[count:], place, constant) for column in columns]
    return np.array(found).reshape(np.shape(rows[0]))


def _root(diagonal: Sequence[float], squares: Sequence[float], place: int, constant: float) -> float:
    """The eigenvalue at a place in ascending order: the root of c + Σ s/(d − x) above the d at that place.

    By the rational interpolation that has the same two poles, value and slope (R.-C. Li, LAPACK Working Note
    89, 1993), kept between bounds, from 0 where that is between them.
    """
    flushed = (0.0 if abs(d) < _CLOSEST else d for d in diagonal)
    pairs = sorted(zip(flushed, (max(square, 0.0) for square in squares), strict=True))
    total = sum(square for _, square in pairs)
    if not math.isfinite(total + sum(d for d, _ in pairs)) or total + constant == 0.0:
        return math.nan
    below, last = pairs[place][0], place + 1 == len(pairs)
    above = below + total if last else pairs[place + 1][0]
    if above - below <= _CLOSEST:
        return below
    neighbour = _at_neighbour(pairs, below, None if last else above, constant)
    if neighbour is not None:
        return neighbour
    low, high = below, above
    x = 0.0 if low < 0.0 < high else 0.5 * (low + high)
    width = high - low
    for count in range(1, _MOST_ITERATIONS + 1):
        # Close beside a pole a step may only double the distance to it.
        due = count % _PATIENCE == 0
        stuck = due and high - low > 0.5 * width
        width = high - low if due else width
        if stuck or not low < x < high:
            x = 0.5 * (low + high)
            if not low < x < high:
                return x  # no number between the bounds
        value, slope, size = constant, 0.0, constant
        for d, square in pairs:
            part = square / (d - x)
            value += part
            size += abs(part)
            slope += part / (d - x)
        if value > 0.0:
            high = x
        elif value < 0.0:
            low = x
        if abs(value) <= _EPS * size:
            return x
        left, right = below - x, above - x
        if last:
            step = -value / slope
        else:
            # The root η of c′η² − uη + w of the interpolation.
            u, w = (left + right) * value - left * right * slope, left * right * value
            curve = _rest(pairs, place, x, left, right, constant)
            root = math.sqrt(max(u * u - 4.0 * w * curve, 0.0))
            step = 2.0 * w / (u + root) if u > 0.0 else ((u - root) / (2.0 * curve) if curve else 0.0)
        if not step * value < 0.0:
            x = math.nan  # next to a pole rounding may take the step the wrong way
            continue
        if abs(step) <= _EPS * abs(x):
            return x + step
        x += step
    raise ArithmeticError("the softest mode was not found")


def _at_neighbour(
    pairs: Sequence[tuple[float, float]], below: float, above: float | None, constant: float
) -> float | None:
    """The root where it is one of its neighbours: where nothing couples that one it is no pole."""
    if _uncoupled(pairs, below) and _value(pairs, below, constant) >= 0.0:
        return below
    if above is not None and _uncoupled(pairs, above) and _value(pairs, above, constant) <= 0.0:
        return above
    return None


def _uncoupled(pairs: Sequence[tuple[float, float]], d: float) -> bool:
    return not any(square for other, square in pairs if other == d)


def _value(pairs: Sequence[tuple[float, float]], x: float, constant: float) -> float:
    """The sum at one of the d, where that is no pole."""
    return constant + sum(square / (d - x) for d, square in pairs if d != x)


def _rest(
    pairs: Sequence[tuple[float, float]],
    place: int,
    x: float,
    left: float,
    right: float,
    constant: float,
) -> float:
    """The constant of the interpolation: what the two poles do not account for."""
    rest = constant
    for k, (d, square) in enumerate(pairs):
        part = square / (d - x)
        rest += part - part / (d - x) * (left if k <= place else right)
    return rest


def _product(values: Sequence[Number]) -> Number:
    out: Number = 1.0
    for value in values:
        out = out * value
    return out


def _minors(diagonal: Sequence[Number], squares: Sequence[Number]) -> Number:
    """Σ sᵢ Π_{j≠i} dⱼ."""
    out: Number = 0.0
    for i, square in enumerate(squares):
        rest = square
        for j, d in enumerate(diagonal):
            rest = rest * d if j != i else rest
        out = out + rest
    return out
