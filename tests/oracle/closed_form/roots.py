"""Roots of functions of one variable, to rounding.

Derivatives are by complex step.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Function = Callable[[Any], Any]

LOOSE = 1e-7  # for the place of a minimum: its value is then good to 1e-14 of the curvature
STEP = 1e-40  # of complex-step derivatives


def signs(values: FloatArray) -> FloatArray:
    """−1 or 1: a zero must not hide a change of sign."""
    return np.where(values < 0.0, -1.0, 1.0)


def clustered(count: int) -> FloatArray:
    """Points on [0, 1], dense at both ends."""
    return np.asarray(0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, count)))


def all_roots(function: Function, grid: FloatArray) -> list[float]:
    """All roots of a smooth function on a grid, pairs hiding between two points included, to rounding."""
    value = np.asarray(function(grid))
    slope = derivative(function, grid)
    sign = signs(value)
    dips = (sign[:-1] == sign[1:]) & (sign[:-1] * slope[:-1] < 0.0) & (sign[1:] * slope[1:] > 0.0)
    if np.any(dips):
        low, high = grid[:-1][dips], grid[1:][dips]
        bottoms = bracketed(lambda x: derivative(function, x), low, high, np.sign(slope[:-1][dips]), LOOSE)
        grid = np.sort(np.concatenate([grid, bottoms]))
        sign = signs(np.asarray(function(grid)))
    at = np.flatnonzero(sign[:-1] != sign[1:])
    if not at.size:
        return []
    roots: list[float] = bracketed(function, grid[at], grid[at + 1], sign[at]).tolist()
    return roots


def derivative(function: Function, x: FloatArray) -> FloatArray:
    """Derivative of an analytic function, by a complex step."""
    return np.asarray(function(x + 1j * STEP)).imag / STEP


def bracketed(
    function: Function, low: FloatArray, high: FloatArray, sign: Any, tolerance: float = 2.3e-16
) -> FloatArray:
    """One root in each bracket, by Chandrupatla's method; `sign` is the function's at `low`.

    References
    ----------
    T. R. Chandrupatla, Adv. Eng. Softw. 28 (1997) 145–149.
    """
    sign = np.broadcast_to(np.asarray(sign, dtype=np.float64), low.shape)
    # What rounding made of an end's value counts for less than what is known of its sign.
    f1, f2 = np.asarray(function(low)), np.asarray(function(high))
    x1, f1 = low, np.where(f1 * sign > 0.0, f1, sign * 1e-300)
    x2, f2 = high, np.where(f2 * sign < 0.0, f2, -sign * 1e-300)
    share = np.full(low.shape, 0.5)
    for _ in range(120):
        x = x1 + share * (x2 - x1)
        f = np.asarray(function(x))
        same = f * f1 > 0.0
        x3, f3 = np.where(same, x1, x2), np.where(same, f1, f2)
        x2, f2 = np.where(same, x2, x1), np.where(same, f2, f1)
        x1, f1 = x, f
        best = np.where(np.abs(f1) < np.abs(f2), x1, x2)
        width = np.abs(x2 - x1)
        least = tolerance * np.maximum(np.abs(best), 1.0)
        done = (f1 == 0.0) | (width <= 2.0 * least)
        if np.all(done):
            return best
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            xi, phi = (x1 - x2) / (x3 - x2), (f1 - f2) / (f3 - f2)
            inverse = (phi * phi < xi) & ((1.0 - phi) ** 2 < 1.0 - xi)
            quadratic = f1 / (f2 - f1) * f3 / (f2 - f3) + (x3 - x1) / (x2 - x1) * f1 / (f3 - f1) * f2 / (
                f3 - f2
            )
            share = np.where(inverse & np.isfinite(quadratic), quadratic, 0.5)
            tight = np.minimum(least / np.where(width > 0.0, width, 1.0), 0.5)
        share = np.where(done, 0.0, np.clip(share, tight, 1.0 - tight))
    return best
