"""The eight-chain network of Arruda and Boyce, with the inverse Langevin function to rounding."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import ClassVar

import numpy as np

from simulator.model.elastomers.law import Number, invariant_limit

# L(β) = coth β − 1/β = Σ aₙ β^(2n+1), aₙ = 2^(2n+2) B_(2n+2)/(2n+2)!, to rounding for β < _SMALL.
_SERIES = (
    1 / 3,
    -1 / 45,
    2 / 945,
    -1 / 4725,
    2 / 93555,
    -1382 / 638512875,
    4 / 18243225,
    -3617 / 162820783125,
    87734 / 38979295480125,
    -349222 / 1531329465290625,
)
_SLOPES = tuple((2 * n + 1) * a for n, a in enumerate(_SERIES))
_ENERGIES = tuple(a / (2 * n + 2) for n, a in enumerate(_SERIES))
_SMALL = 0.5
_AT_POLE = 1e-9  # 1 − x below which 1/β = 1 − x to all digits
_BEYOND = 1e12
_ITERATIONS = 4  # from a guess good to 1.5 %; each squares the error


@dataclass(frozen=True)
class ArrudaBoyce:
    """Arruda–Boyce elastomer: eight chains of N = λ_L² links along the diagonals of a cube.

    With the stretch of a chain λ_c = √(I₁/3), x = λ_c/λ_L and β = L⁻¹(x), L(β) = coth β − 1/β,

        W = nkT N [xβ + ln(β/sinh β)] + const,    f = 2(λ − λ⁻⁵) (β/x)/(β₀/x₀),    x₀ = 1/λ_L, β₀ = L⁻¹(x₀).

    The inverse Langevin function is solved for by Newton's method, no series and no Padé approximant. Over
    the small-strain shear modulus μ = nkT λ_L β₀/3 (which is nkT only for long chains) f is as above; it has
    its pole at x = 1, and D = 1 − x² = 1 − I₁/(3λ_L²). For λ_L → ∞ it is neo-Hookean.

    Parameters
    ----------
    lambda_L : float
        Limiting stretch λ_L = √N > 1 of a chain. The wall's limiting stretch is the root of I₁ = 3λ_L².

    References
    ----------
    E. M. Arruda and M. C. Boyce, J. Mech. Phys. Solids 41 (1993) 389–412. The guess that the iteration starts
    from is R. Jedynak's, Rheol. Acta 54 (2015) 29–39.
    """

    stays_spherical: ClassVar[bool] = True

    lambda_L: float

    @cached_property
    def _rest(self) -> tuple[float, float, float]:
        """x₀, 2x₀/β₀ and the free energy xβ + ln(β/sinh β) of a chain at rest."""
        x = 1.0 / self.lambda_L
        beta = _beta(x)
        return x, 2.0 * x / beta, _free_energy(x, beta)

    @cached_property
    def stretch_limit(self) -> float:
        """λ_lim, the root of I₁ = 3λ_L²."""
        return invariant_limit(3.0 * (self.lambda_L * self.lambda_L - 1.0))

    def _chain(self, stretch: Number) -> Number:
        square = stretch * stretch
        return ((2.0 * square + 1.0 / (square * square)) / 3.0) ** 0.5 / self.lambda_L

    def energy(self, stretch: Number) -> Number:
        start, scale, rest = self._rest
        x = self._chain(stretch)
        # 3λ_L/β₀ = 3/(x₀β₀) = 3 (2x₀/β₀)/(2x₀²).
        return 1.5 * scale / (start * start) * (_free_energy(x, _beta(x)) - rest)

    def pole_form(self, stretch: Number) -> tuple[Number, Number]:
        _, scale, _ = self._rest
        square = stretch * stretch
        x = self._chain(stretch)
        stiffening = _finite_part(x)[0] * (1.0 + x) / x
        return scale * (stretch - 1.0 / (square * square * stretch)) * stiffening, (1.0 - x) * (1.0 + x)

    def pole_form_slope(self, stretch: Number) -> tuple[Number, Number]:
        _, scale, _ = self._rest
        square = stretch * stretch
        quintic = 1.0 / (square * square * stretch)
        x = self._chain(stretch)
        rate = 2.0 * (stretch - quintic) / (3.0 * self.lambda_L**2 * x)
        part, slope = _finite_part(x)
        stiffening = part * (1.0 + x) / x
        stiffening_slope = (slope * (1.0 + x) - part / x) / x
        return (
            scale
            * ((1.0 + 5.0 * quintic / stretch) * stiffening + (stretch - quintic) * stiffening_slope * rate),
            -2.0 * x * rate,
        )


def _finite_part(x: Number) -> tuple[Number, Number]:
    """β(1 − x) and its derivative in x, smooth also beyond the pole x = 1 of β: there they are 1 and 0."""
    return _finite_part_of_float(x) if type(x) is float else _finite_part_of(x)


@lru_cache(maxsize=64)  # forces, stiffnesses and denominators of one state all ask for it
def _finite_part_of_float(x: float) -> tuple[Number, Number]:
    return _finite_part_of(x)


def _finite_part_of(x: Number) -> tuple[Number, Number]:
    beta = _beta(x)
    if isinstance(beta, float | complex):
        if beta.real < _SMALL:
            return beta * (1.0 - x), (1.0 - x) / _polynomial(_SLOPES, beta) - beta
        return _finite_part_of_large(beta)
    small = np.real(beta) < _SMALL
    low, high = np.where(small, beta, _SMALL), np.where(small, 1.0, beta)
    part, slope = _finite_part_of_large(high)
    return (
        np.where(small, low * (1.0 - x), part),
        np.where(small, (1.0 - x) / _polynomial(_SLOPES, low) - low, slope),
    )


def _finite_part_of_large(beta: Number) -> tuple[Number, Number]:
    # 1 − x = 1/β − s with s = coth β − 1, and L′ = 1/β² − s(s + 2): close to the pole nothing cancels.
    s = _excess(beta)
    csch = s * (s + 2.0)
    return 1.0 - beta * s, beta * (beta * (beta * csch - s)) / (1.0 - beta * beta * csch)


def _excess(beta: Number) -> Number:
    """Coth β − 1 for β that are not small."""
    decay = math.exp(-2.0 * beta) if isinstance(beta, float) else np.exp(-2.0 * beta)
    return 2.0 * decay / (1.0 - decay)


def _polynomial(coefficients: tuple[float, ...], beta: Number) -> Number:
    square = beta * beta
    out: Number = 0.0
    for a in reversed(coefficients):
        out = out * square + a
    return out


def _beta(x: Number) -> Number:
    """L⁻¹(x) for x > 0; beyond the pole x = 1 a number so large that its exponentials vanish."""
    ahead = 1.0 - x
    if isinstance(x, float | complex):
        if ahead.real < _AT_POLE:
            return 1.0 / ahead if ahead.real > 0.0 else _BEYOND
        beta = _guess(x, ahead)
        for _ in range(_ITERATIONS):
            beta = beta - (_step_of_small(beta, x) if beta.real < _SMALL else _step_of_large(beta, ahead))
        return beta
    near = np.real(ahead) < _AT_POLE
    beyond = np.real(ahead) <= 0.0
    at_pole = np.where(beyond, _BEYOND, 1.0 / np.where(beyond, 1.0, ahead))
    x, ahead = np.where(near, 0.5, x), np.where(near, 0.5, ahead)
    beta = _guess(x, ahead)
    for _ in range(_ITERATIONS):
        small = np.real(beta) < _SMALL
        beta = beta - np.where(
            small,
            _step_of_small(np.where(small, beta, _SMALL), x),
            _step_of_large(np.where(small, 1.0, beta), ahead),
        )
    return np.where(near, at_pole, beta)


def _guess(x: Number, ahead: Number) -> Number:
    return x * (3.0 - 2.6 * x + 0.7 * x * x) / (ahead * (1.0 + 0.1 * x))


def _step_of_small(beta: Number, x: Number) -> Number:
    return (beta * _polynomial(_SERIES, beta) - x) / _polynomial(_SLOPES, beta)


def _step_of_large(beta: Number, ahead: Number) -> Number:
    # On 1 − L = 1/β − s, which keeps its digits close to the pole.
    s = _excess(beta)
    return beta * (ahead * beta + s * beta - 1.0) / (1.0 - beta * beta * s * (s + 2.0))


def _free_energy(x: Number, beta: Number) -> Number:
    """The free energy xβ + ln(β/sinh β) of a chain, over kT per link."""
    if isinstance(beta, float | complex):
        if beta.real < _SMALL:
            return x * beta - beta * beta * _polynomial(_ENERGIES, beta)
        return _free_energy_of_large(x, beta)
    small = np.real(beta) < _SMALL
    low = np.where(small, beta, _SMALL)
    return np.where(
        small,
        x * low - low * low * _polynomial(_ENERGIES, low),
        _free_energy_of_large(x, np.where(small, 1.0, beta)),
    )


def _free_energy_of_large(x: Number, beta: Number) -> Number:
    # sinh β = e^β (1 − e^(−2β))/2; −(1 − x)β stays finite at the pole where xβ and ln sinh β do not.
    return np.log(2.0 * beta) - np.log1p(-np.exp(-2.0 * beta)) - beta * (1.0 - x)
