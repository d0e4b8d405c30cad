"""Elastomers given by a formula: Gent, neo-Hookean, Mooney–Rivlin, Ogden."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from simulator.model.elastomers.law import Number, exponential, exponential_less_one, invariant_limit


@dataclass(frozen=True)
class Gent:
    """Gent elastomer: ŵ = −(J/2) ln(1 − I/J), I = 2λ² + λ⁻⁴ − 3, f = 2(λ − λ⁻⁵)/(1 − I/J).

    Stiffens without bound as I → J; close to neo-Hookean for J → ∞. For J_lim = 100, λ_lim = 7.176.

    Parameters
    ----------
    J_lim : float
        Extension limit J > 0 of the polymer network.

    References
    ----------
    A. N. Gent, Rubber Chem. Technol. 69 (1996) 59–61.
    """

    stays_spherical: ClassVar[bool] = True

    J_lim: float

    @cached_property
    def _stiffening(self) -> float:
        return 1.0 / self.J_lim

    @cached_property
    def stretch_limit(self) -> float:
        """λ_lim, the root of I₁ − 3 = J."""
        return invariant_limit(self.J_lim)

    def energy(self, stretch: Number) -> Number:
        square = stretch * stretch
        return -0.5 * self.J_lim * np.log1p(-(2.0 * square + 1.0 / (square * square) - 3.0) / self.J_lim)

    def pole_form(self, stretch: Number) -> tuple[Number, Number]:
        square = stretch * stretch
        quartic = 1.0 / (square * square)
        return 2.0 * (stretch - quartic / stretch), 1.0 - self._stiffening * (2.0 * square + quartic - 3.0)

    def pole_form_slope(self, stretch: Number) -> tuple[Number, Number]:
        square = stretch * stretch
        sextic = 1.0 / (square * square * square)
        return 2.0 + 10.0 * sextic, (-4.0 * self._stiffening) * (stretch - sextic * stretch)


@dataclass(frozen=True)
class NeoHookean:
    """Neo-Hookean elastomer: ŵ = λ² + λ⁻⁴/2 − 3/2, f = 2(λ − λ⁻⁵). Never stiffens.

    A balloon of it has its pressure peak at λ = 7^(1/6), p = 2(λ⁻¹ − λ⁻⁷) = 1.239463, and no valley.

    References
    ----------
    R. W. Ogden, Non-linear Elastic Deformations (1984), ch. 5.
    """

    stays_spherical: ClassVar[bool] = True

    @property
    def stretch_limit(self) -> float:
        return float("inf")

    def energy(self, stretch: Number) -> Number:
        square = stretch * stretch
        return square + 0.5 / (square * square) - 1.5

    def pole_form(self, stretch: Number) -> tuple[Number, Number]:
        square = stretch * stretch
        return 2.0 * (stretch - 1.0 / (square * square * stretch)), 1.0

    def pole_form_slope(self, stretch: Number) -> tuple[Number, Number]:
        square = stretch * stretch
        return 2.0 + 10.0 / (square * square * square), 0.0


@dataclass(frozen=True)
class MooneyRivlin:
    """Mooney–Rivlin elastomer: W = c₁(I₁ − 3) + c₂(I₂ − 3), μ = 2(c₁ + c₂).

    Over μ, ŵ = ½[C₁(2λ² + λ⁻⁴ − 3) + C₂(λ⁴ + 2λ⁻² − 3)] and f = 2(λ − λ⁻⁵)(C₁ + C₂λ²), with the shares
    C₁ = c₁/(c₁ + c₂), C₂ = c₂/(c₁ + c₂). The constants may be given in any one unit: only their ratio counts,
    since the balloon's `modulus` carries their size. Never stiffens without bound; a balloon of it,
    p = 2(λ⁻¹ − λ⁻⁷)(C₁ + C₂λ²), has a peak and a valley for small C₂ > 0.

    It is good for rubber up to a stretch of about 2 to 3, where the chains' finite length begins to tell.

    Parameters
    ----------
    C1, C2 : float
        c₁ and c₂ in any one unit, >= 0 and not both 0.

    References
    ----------
    M. Mooney, J. Appl. Phys. 11 (1940) 582–592. R. S. Rivlin, Phil. Trans. R. Soc. A 241 (1948) 379–397.
    """

    stays_spherical: ClassVar[bool] = True

    C1: float
    C2: float

    @cached_property
    def _shares(self) -> tuple[float, float]:
        total = self.C1 + self.C2
        return self.C1 / total, self.C2 / total

    @property
    def stretch_limit(self) -> float:
        return float("inf")

    def energy(self, stretch: Number) -> Number:
        first, second = self._shares
        square = stretch * stretch
        quartic = square * square
        return 0.5 * (first * (2.0 * square + 1.0 / quartic - 3.0) + second * (quartic + 2.0 / square - 3.0))

    def pole_form(self, stretch: Number) -> tuple[Number, Number]:
        first, second = self._shares
        square = stretch * stretch
        return 2.0 * (stretch - 1.0 / (square * square * stretch)) * (first + second * square), 1.0

    def pole_form_slope(self, stretch: Number) -> tuple[Number, Number]:
        first, second = self._shares
        square = stretch * stretch
        sextic = 1.0 / (square * square * square)
        # (λ − λ⁻⁵)λ² = λ³ − λ⁻³.
        return first * (2.0 + 10.0 * sextic) + second * 6.0 * square * (1.0 + sextic), 0.0


@dataclass(frozen=True)
class Ogden:
    """Ogden elastomer: W = Σ μᵢ/αᵢ (λ₁^αᵢ + λ₂^αᵢ + λ₃^αᵢ − 3), μ = ½ Σ μᵢαᵢ.

    Over μ, ŵ = Σ mᵢ/αᵢ (2λ^αᵢ + λ^(−2αᵢ) − 3) and f = 2 Σ mᵢ (λ^(αᵢ−1) − λ^(−2αᵢ−1)), with mᵢ = μᵢ/μ. The
    μᵢ may be given in any one unit: they are divided by ½ Σ μᵢαᵢ, so that the small-strain shear modulus is 1
    and the balloon's `modulus` carries their size. One term α = 2 is neo-Hookean; α = 2 and −2 are
    Mooney–Rivlin with c₁ = μ₁/2, c₂ = −μ₂/2.

    It holds as far as the data that its constants were fitted to; it never stiffens without bound. Beware
    of codes that write μᵢ for what is μᵢαᵢ/2 here (Abaqus: 2μᵢ/αᵢ² before the stretches).

    Parameters
    ----------
    mu, alpha : tuple of float
        Moduli in any one unit, and exponents other than 0; equally many, Σ μᵢαᵢ > 0.

    References
    ----------
    R. W. Ogden, Proc. R. Soc. A 326 (1972) 565–584.
    """

    mu: tuple[float, ...]
    alpha: tuple[float, ...]

    @cached_property
    def _terms(self) -> tuple[tuple[float, float], ...]:
        """(mᵢ, αᵢ)."""
        pairs = list(zip(self.mu, self.alpha, strict=True))
        modulus = 0.5 * sum(mu * alpha for mu, alpha in pairs)
        return tuple((mu / modulus, alpha) for mu, alpha in pairs)

    @property
    def stretch_limit(self) -> float:
        return float("inf")

    @cached_property
    def shear_stiffness(self) -> Callable[[Number], Number] | None:
        """½Σ mᵢαᵢλ^(αᵢ−2), the stiffness against shear in the surface; None where it cannot vanish."""
        if all(mu * alpha > 0.0 for mu, alpha in self._terms):
            return None

        def stiffness(stretch: Number) -> Number:
            log = _log(stretch)
            return 0.5 * sum(mu * alpha * exponential((alpha - 2.0) * log) for mu, alpha in self._terms)

        return stiffness

    def energy(self, stretch: Number) -> Number:
        log = _log(stretch)
        out: Number = 0.0
        for mu, alpha in self._terms:
            out = out + mu / alpha * (
                2.0 * exponential_less_one(alpha * log) + exponential_less_one(-2.0 * alpha * log)
            )
        return out

    def pole_form(self, stretch: Number) -> tuple[Number, Number]:
        log = _log(stretch)
        out: Number = 0.0
        for mu, alpha in self._terms:
            out = out + mu * _difference(alpha * log)
        return 2.0 * out / stretch, 1.0

    def pole_form_slope(self, stretch: Number) -> tuple[Number, Number]:
        log = _log(stretch)
        out: Number = 0.0
        for mu, alpha in self._terms:
            rising, falling = exponential(alpha * log), exponential(-2.0 * alpha * log)
            out = out + mu * ((alpha - 1.0) * rising + (2.0 * alpha + 1.0) * falling)
        return 2.0 * out / (stretch * stretch), 0.0


def _log(stretch: Number) -> Number:
    # A step of Newton's method may lead to a stretch below zero: not a number, as from NumPy, and rejected.
    if isinstance(stretch, float):
        return math.log(stretch) if stretch > 0.0 else math.nan
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.log(stretch)


def _difference(power: Number) -> Number:
    """e^a − e^(−2a); without cancellation where both are near one."""
    if isinstance(power, float) and abs(power) > 0.3:
        return exponential(power) - exponential(-2.0 * power)
    near = exponential(-2.0 * power) * exponential_less_one(3.0 * power)
    if isinstance(power, float):
        return near
    return np.where(np.abs(np.real(power)) > 0.3, exponential(power) - exponential(-2.0 * power), near)
