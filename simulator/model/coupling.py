"""Eigenvalues of the scaled Hessian: of balloons coupled by a gas, and of balloons on one constant volume.

A gas adds a finite stiffness to one direction of the stretches: S = diag(d) + √s √sᵀ. A liquid forbids that
direction: of diag(d) only what it does across √s is left, and one eigenvalue fewer. Both are written for the
same two lists, d and s, of floats or rows of arrays.
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


class Spectrum(Protocol):
    """Eigenvalues, modes and determinant, from the diagonal d and the squares s of the coupling."""

    def eigenvalue(self, diagonal: Sequence[Number], squares: Sequence[Number], place: int) -> Number:
        """The eigenvalue at a place in ascending order."""
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

    def eigenvalue(self, diagonal: Sequence[Number], squares: Sequence[Number], place: int) -> Number:
        if len(diagonal) == 1:
            return diagonal[0] + squares[0]
        if len(diagonal) == 2:
            (d, e), (s, t) = diagonal, squares
            half = 0.5 * (d + s - e - t)
            square = half * half + s * t
            # D, and with it s or t, can be a rounding error below zero at the stretch limit.
            root = (
                math.sqrt(max(square, 0.0)) if isinstance(square, float) else np.sqrt(np.maximum(square, 0.0))
            )
            return 0.5 * (d + s + e + t) + (root if place else -root)
        arms = np.sqrt(np.maximum(np.asarray(squares).T, 0.0))
        matrices = arms[..., :, None] * arms[..., None, :]
        index = np.arange(len(diagonal))
        matrices[..., index, index] += np.asarray(diagonal).T
        found = np.linalg.eigvalsh(matrices)[..., place]
        return float(found) if found.ndim == 0 else found

    def modes(self, diagonal: Sequence[float], squares: Sequence[float]) -> tuple[FloatArray, FloatArray]:
        arms = np.sqrt(np.maximum(squares, 0.0))
        values, vectors = np.linalg.eigh(np.diag(diagonal) + np.outer(arms, arms))
        return np.asarray(values), np.asarray(vectors)

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

    def eigenvalue(self, diagonal: Sequence[Number], squares: Sequence[Number], place: int) -> Number:
        if len(diagonal) == 1:
            return 1.0 + 0.0 * diagonal[0]
        if len(diagonal) == 2:
            (d, e), (s, t) = diagonal, squares
            total = s + t
            if isinstance(total, float) and total == 0.0:
                return math.nan  # both beyond their stretch limits: a trial that leads nowhere
            return (d * t + e * s) / total
        arms = np.sqrt(np.maximum(np.asarray(squares).T, 0.0))
        across = arms / np.maximum(np.sqrt(np.sum(arms * arms, axis=-1, keepdims=True)), _LEAST)
        spread = np.asarray(diagonal).T
        turned = spread * across
        # D − u(Du)ᵀ − (Du)uᵀ + (u·Du + σ) u uᵀ; σ puts the forbidden direction above all others.
        lift = np.sum(across * turned, axis=-1) + np.max(np.abs(spread), axis=-1) + 1.0
        matrices = (
            lift[..., None, None] * across[..., :, None] * across[..., None, :]
            - across[..., :, None] * turned[..., None, :]
            - turned[..., :, None] * across[..., None, :]
        )
        index = np.arange(len(diagonal))
        matrices[..., index, index] += spread
        found = np.linalg.eigvalsh(matrices)[..., place]
        return float(found) if found.ndim == 0 else found

    def modes(self, diagonal: Sequence[float], squares: Sequence[float]) -> tuple[FloatArray, FloatArray]:
        arms = np.sqrt(np.maximum(squares, 0.0))
        basis = np.linalg.svd(arms[None, :])[2][1:].T  # orthonormal, across the arms
        values, vectors = np.linalg.eigh(basis.T @ (np.asarray(diagonal)[:, None] * basis))
        return np.asarray(values), np.asarray(basis @ vectors)

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


COUPLED = Coupled()
CONSTRAINED = Constrained()
