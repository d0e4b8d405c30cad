"""Elastomers that stiffen at large stretches, by a formula: Yeoh, Gent–Gent, Fung."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from simulator.model.elastomers.law import Number, exponential, exponential_less_one, invariant_limit


def _first(stretch: Number) -> tuple[Number, Number, Number]:
    """I = I₁ − 3, half its derivative 2(λ − λ⁻⁵), and half its second derivative 2 + 10λ⁻⁶."""
    square = stretch * stretch
    quartic = 1.0 / (square * square)
    return (
        2.0 * square + quartic - 3.0,
        2.0 * (stretch - quartic / stretch),
        2.0 + 10.0 * quartic / square,
    )


@dataclass(frozen=True)
class Yeoh:
    """Yeoh elastomer: W = c₁(I₁ − 3) + c₂(I₁ − 3)² + c₃(I₁ − 3)³, μ = 2c₁.

    Over μ, with I = 2λ² + λ⁻⁴ − 3, ŵ = ½[I + (c₂/c₁)I² + (c₃/c₁)I³] and
    f = 2(λ − λ⁻⁵)[1 + 2(c₂/c₁)I + 3(c₃/c₁)I²]. The constants may be given in any one unit: only their ratios
    count, since the balloon's `modulus` carries their size. Fits to filled rubber often have c₂ < 0.

    Parameters
    ----------
    C1, C2, C3 : float
        c₁ > 0, c₂ and c₃ in any one unit.

    References
    ----------
    O. H. Yeoh, Rubber Chem. Technol. 66 (1993) 754–771.
    """

    C1: float
    C2: float
    C3: float

    @cached_property
    def _ratios(self) -> tuple[float, float]:
        return self.C2 / self.C1, self.C3 / self.C1

    @property
    def stretch_limit(self) -> float:
        return float("inf")

    def energy(self, stretch: Number) -> Number:
        second, third = self._ratios
        excess, _, _ = _first(stretch)
        return 0.5 * excess * (1.0 + excess * (second + excess * third))

    def pole_form(self, stretch: Number) -> tuple[Number, Number]:
        second, third = self._ratios
        excess, rise, _ = _first(stretch)
        return rise * (1.0 + excess * (2.0 * second + excess * (3.0 * third))), 1.0

    def pole_form_slope(self, stretch: Number) -> tuple[Number, Number]:
        second, third = self._ratios
        excess, rise, bend = _first(stretch)
        stiffness = 1.0 + excess * (2.0 * second + excess * (3.0 * third))
        return bend * stiffness + 2.0 * rise * rise * (2.0 * second + 6.0 * third * excess), 0.0


@dataclass(frozen=True)
class GentGent:
    """Gent–Gent elastomer: W = −c₁J ln(1 − (I₁ − 3)/J) + c₂ ln(I₂/3), μ = 2c₁ + ⅔c₂.

    With I = 2λ² + λ⁻⁴ − 3, I₂ = λ⁴ + 2λ⁻² and the shares m₁ = 2c₁/μ, m₂ = ⅔c₂/μ of the modulus,
    f = 2(λ − λ⁻⁵)[m₁/(1 − I/J) + 3m₂λ²/I₂]. The constants c₁ and c₂ may be given in any one unit. With c₂ = 0
    it is a Gent elastomer; the logarithm of I₂ makes it softer at moderate stretches, as rubber is.

    Parameters
    ----------
    C1, C2 : float
        c₁ > 0 and c₂ >= 0 in any one unit.
    J_lim : float
        Extension limit J > 0 of the polymer network.

    References
    ----------
    E. Pucci and G. Saccomandi, Rubber Chem. Technol. 75 (2002) 839–852; for balloons R. Mangan and
    M. Destrade, Int. J. Non-Linear Mech. 68 (2015) 52–58.
    """

    C1: float
    C2: float
    J_lim: float

    @cached_property
    def _shares(self) -> tuple[float, float]:
        total = 2.0 * self.C1 + 2.0 * self.C2 / 3.0
        return 2.0 * self.C1 / total, 2.0 * self.C2 / (3.0 * total)

    @cached_property
    def stretch_limit(self) -> float:
        """λ_lim, the root of I₁ − 3 = J."""
        return invariant_limit(self.J_lim)

    def energy(self, stretch: Number) -> Number:
        first, second = self._shares
        excess, _, _ = _first(stretch)
        square = stretch * stretch
        return -0.5 * first * self.J_lim * np.log1p(-excess / self.J_lim) + 1.5 * second * np.log(
            (square * square + 2.0 / square) / 3.0
        )

    def pole_form(self, stretch: Number) -> tuple[Number, Number]:
        first, second = self._shares
        excess, rise, _ = _first(stretch)
        square = stretch * stretch
        denominator = 1.0 - excess / self.J_lim
        # λ²/I₂ = λ⁴/(λ⁶ + 2)
        share = 3.0 * square * square / (square * square * square + 2.0)
        return rise * (first + second * share * denominator), denominator

    def pole_form_slope(self, stretch: Number) -> tuple[Number, Number]:
        first, second = self._shares
        excess, rise, bend = _first(stretch)
        square = stretch * stretch
        quartic = square * square
        sextic = quartic * square
        denominator = 1.0 - excess / self.J_lim
        denominator_slope = -2.0 * rise / self.J_lim
        share = 3.0 * quartic / (sextic + 2.0)
        share_slope = 3.0 * square * stretch * (8.0 - 2.0 * sextic) / ((sextic + 2.0) * (sextic + 2.0))
        return (
            bend * (first + second * share * denominator)
            + rise * second * (share_slope * denominator + share * denominator_slope),
            denominator_slope,
        )


@dataclass(frozen=True)
class Fung:
    """Fung elastomer: W = (μ/2b)(exp(b(I₁ − 3)) − 1), f = 2(λ − λ⁻⁵) exp(bI), I = 2λ² + λ⁻⁴ − 3.

    It stiffens exponentially, as soft tissue does. The pressure peak of its balloon vanishes for b > 0.06685.

    Parameters
    ----------
    b : float
        Stiffening b > 0.

    References
    ----------
    Y. C. Fung, Am. J. Physiol. 213 (1967) 1532–1544; for a balloon, H. Demiray, J. Biomech. 5 (1972) 309–311.
    """

    stays_spherical: ClassVar[bool] = True

    b: float

    @property
    def stretch_limit(self) -> float:
        return float("inf")

    def energy(self, stretch: Number) -> Number:
        return 0.5 * exponential_less_one(self.b * _first(stretch)[0]) / self.b

    def pole_form(self, stretch: Number) -> tuple[Number, Number]:
        excess, rise, _ = _first(stretch)
        return rise * exponential(self.b * excess), 1.0

    def pole_form_slope(self, stretch: Number) -> tuple[Number, Number]:
        excess, rise, bend = _first(stretch)
        return (bend + 2.0 * self.b * rise * rise) * exponential(self.b * excess), 0.0
