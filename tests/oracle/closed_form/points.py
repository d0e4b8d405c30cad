"""Functions of points y = (λ₁, λ₂, p) of the equilibrium curve, and their roots on it.

Points are rows of arrays, real or complex.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.oracle.closed_form.pair import SealedPair
from tests.oracle.closed_form.roots import STEP, bracketed

FloatArray = NDArray[np.float64]
CellFunction = Callable[[Any, Any], Any]


def constraints(pair: SealedPair, y: Any) -> tuple[Any, Any, tuple[Any, Any], tuple[Any, Any, Any]]:
    """Passive balance and gas law, with their gradients; that of the balance has no part in λ₁."""
    x, z, p = y
    balloon = pair.passive
    a = balloon.pressure_load
    n, d = balloon.elastomer.pole_form(z)
    n1, d1 = balloon.elastomer.pole_form_slope(z)
    load = a * p * z * z
    gas = pair.sealed.pressure + pair.ambient
    start = pair.volume(*pair.sealed[:2])
    scale = gas * start
    volume = pair.volume(x, z)
    # Two forms of one law, each where it cancels less.
    law = np.where(
        np.real(volume) > 2.0 * start,
        (p + pair.ambient) * volume - gas * start,
        (p - pair.sealed.pressure) * volume + gas * pair.swelling(x, z),
    )
    law = law / scale
    density = (p + pair.ambient) / scale
    slopes = (density * pair.active.cube * x * x, density * pair.passive.cube * z * z, volume / scale)
    return n - d * load, law, (n1 - d1 * load - 2.0 * d * a * p * z, -d * a * z * z), slopes


def tangent_of(pair: SealedPair, y: Any) -> tuple[Any, Any, Any]:
    """A tangent of the curve, towards falling λ₂."""
    _, _, (u2, u3), (v1, v2, v3) = constraints(pair, y)
    return u2 * v3 - u3 * v2, u3 * v1, -u2 * v1


def force_excess(pair: SealedPair, y: Any, square: Any) -> Any:
    """D₁g₁/k₁ at the given φ²: positive where the equilibrium takes a higher voltage."""
    x, _, p = y
    n, d = pair.active.elastomer.pole_form(x)
    return n - d * x * x * (pair.active.pressure_load * p + pair.active.electric_load * square * x)


def voltage_square(pair: SealedPair, y: Any) -> Any:
    """φ² of a point; negative where no voltage does it."""
    x, _, p = y
    n, d = pair.active.elastomer.pole_form(x)
    with np.errstate(divide="ignore", invalid="ignore"):
        force = n / d
    return (force - pair.active.pressure_load * p * x * x) / (pair.active.electric_load * x * x * x)


def determinant_of(pair: SealedPair, y: Any) -> Any:
    """det H, and the slope of φ² along `tangent_of`, up to positive factors; smooth at the stretch limit."""
    x, _, p = y
    a = pair.active.pressure_load
    n, d = pair.active.elastomer.pole_form(x)
    n1, d1 = pair.active.elastomer.pole_form_slope(x)
    t1, _, t3 = tangent_of(pair, y)
    return (d * n1 - n * d1 - 3.0 * n * d / x + d * d * a * p * x) * t1 - d * d * a * x * x * t3


def determinant_slope(pair: SealedPair, y: FloatArray) -> FloatArray:
    """Derivative of `determinant_of` along `tangent_of`."""
    step = [a + 1j * STEP * b for a, b in zip(y, tangent_of(pair, y), strict=True)]
    return np.asarray(determinant_of(pair, step).imag) / STEP


def projected(pair: SealedPair, guess: FloatArray, normal: FloatArray) -> FloatArray:
    """Points of the curve on planes through the guesses, all (3, n), by Newton's method to rounding."""
    y = guess
    n1, n2, n3 = normal
    last = False
    for _ in range(30):
        r, s, (u2, u3), (v1, v2, v3) = constraints(pair, y)
        # Cramer's rule for the rows (0, u2, u3), (v1, v2, v3), (n1, n2, n3).
        c1, c2, c3 = v2 * n3 - v3 * n2, v3 * n1 - v1 * n3, v1 * n2 - v2 * n1
        det = u2 * c2 + u3 * c3
        change = np.array([r * c1 + s * (n2 * u3 - n3 * u2), r * c2 - s * n1 * u3, r * c3 + s * n1 * u2])
        change = np.asarray(change / det)
        y = np.asarray(y - change)
        if last:
            return y
        last = bool(np.all(np.abs(change) <= 1e-9 * (np.abs(y) + 1e-3)))
    return y


def metric(pair: SealedPair, y: FloatArray) -> FloatArray:
    """Metric of the curve: relative changes of the stretches and, from a softest balloon's unit on, of p."""
    softest = min(1.0 / pair.active.pressure_load, 1.0 / pair.passive.pressure_load)
    return np.array([1.0 / y[0], 1.0 / y[1], 1.0 / (softest + np.abs(y[2]))])


def roots_on_cells(
    pair: SealedPair, low: FloatArray, high: FloatArray, function: CellFunction, sign: FloatArray
) -> FloatArray:
    """Roots of a function of the point, one in each piece of curve from `low` to `high`, (3, n).

    `function(y, cells)` is evaluated for some of the pieces, an index array. `sign` is its sign at `low`;
    at `high` it is the opposite.
    """
    every = np.arange(low.shape[1])
    chord = high - low
    weights = metric(pair, low)
    normal = weights * weights * chord
    square = np.sum(normal * chord, axis=0)
    # Newton's method along the curve, from the chord's root.
    at_low, at_high = np.asarray(function(low, every)), np.asarray(function(high, every))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        share = np.clip(np.nan_to_num(at_low / (at_low - at_high), nan=0.5), 0.05, 0.95)
        y = low + share * chord
        converged = np.zeros(every.size, dtype=bool)
        for _ in range(15):
            r, s, (u2, u3), (v1, v2, v3) = constraints(pair, y)
            t1, t2, t3 = tangent = np.array([u2 * v3 - u3 * v2, u3 * v1, -u2 * v1])
            n1, n2, n3 = weights * weights * tangent
            across = np.array(
                [
                    r * (v2 * n3 - v3 * n2) + s * (n2 * u3 - n3 * u2),
                    r * (v3 * n1 - v1 * n3) - s * n1 * u3,
                    r * (v1 * n2 - v2 * n1) + s * n1 * u2,
                ]
            ) / (t1 * n1 + t2 * n2 + t3 * n3)
            change = np.asarray(function(y + 1j * STEP * tangent, every))
            along = change.real / (change.imag / STEP) * tangent
            y = y - across - along
            if np.all(converged):  # once more than that
                break
            converged = np.all(np.abs(weights * along) <= 1e-11, axis=0)
        share = np.sum(normal * (y - low), axis=0) / square
        left = every[~(converged & (share > -1e-9) & (share < 1.0 + 1e-9))]
    if left.size:
        y[:, left] = bracketed_on_cells(
            pair, low[:, left], high[:, left], lambda y, _: function(y, left), sign[left]
        )
    return np.asarray(y)


def bracketed_on_cells(
    pair: SealedPair,
    low: FloatArray,
    high: FloatArray,
    function: CellFunction,
    sign: FloatArray,
    tolerance: float = 2.3e-16,
) -> FloatArray:
    """The same, slower: for functions without derivatives, and for what Newton's method misses."""
    chord = high - low
    normal = metric(pair, low) ** 2 * chord

    def point(share: FloatArray) -> FloatArray:
        return projected(pair, low + share * chord, normal)

    zero = np.zeros(chord.shape[1])
    return point(bracketed(lambda share: function(point(share), None), zero, zero + 1.0, sign, tolerance))
