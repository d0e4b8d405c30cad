"""Strain energies of elastomers under equal-biaxial stretching, and their derivatives.

A balloon's wall is stretched by λ in both directions of its surface and by λ⁻² through its thickness
(incompressible). ŵ(λ) is the strain energy per unit volume over the shear modulus μ, f = ŵ′.

Where an elastomer stiffens without bound, f has a pole at the limiting stretch, and Newton steps taken
on f itself jump across it. So each elastomer gives f as a fraction N/D of two smooth functions: the
equations of `model` are multiplied through by D and stay smooth at any load.

Every function is a plain formula: it takes a float, a complex number or an array of either, and
returns the like. That is what makes derivatives by complex step exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np

# A float, a complex number or an array of either: the formulas are the same for all.
Number = Any


class Elastomer(Protocol):
    """What the equations need to know of a material."""

    @property
    def stretch_limit(self) -> float:
        """Limiting stretch λ_lim, where D = 0; inf for an elastomer without one."""
        ...

    def energy(self, stretch: Number) -> Number:
        """ŵ(λ), strain energy per unit volume over μ."""
        ...

    def pole_form(self, stretch: Number) -> tuple[Number, Number]:
        """(N, D) with f = ŵ′ = N/D, both smooth, D > 0 below the limiting stretch."""
        ...

    def pole_form_slope(self, stretch: Number) -> tuple[Number, Number]:
        """(N′, D′), derivatives of the two in λ."""
        ...


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

    J_lim: float

    @cached_property
    def _stiffening(self) -> float:
        return 1.0 / self.J_lim

    @cached_property
    def stretch_limit(self) -> float:
        """λ_lim, the root of I = J: with x = λ², 2x³ − (3 + J)x² + 1 = 0."""
        c = 3.0 + self.J_lim
        x = c / 2.0
        for _ in range(60):
            step = ((2.0 * x - c) * x * x + 1.0) / ((6.0 * x - 2.0 * c) * x)
            x -= step
            if abs(step) <= 1e-16 * x:
                break
        return float(np.sqrt(x))

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


def tension_force(elastomer: Elastomer, stretch: Number) -> Number:
    """f(λ) = ŵ′ of an elastomer, over its μ."""
    numerator, denominator = elastomer.pole_form(stretch)
    return numerator / denominator


def tension_stiffness(elastomer: Elastomer, stretch: Number) -> Number:
    """f′(λ) = ŵ″ of an elastomer, over its μ."""
    numerator, denominator = elastomer.pole_form(stretch)
    numerator_slope, denominator_slope = elastomer.pole_form_slope(stretch)
    return (numerator_slope - numerator * denominator_slope / denominator) / denominator
