"""What the equations need to know of a material, and what follows from it."""

from __future__ import annotations

import math
from typing import Any, Protocol

import numpy as np

# A float, a complex number or an array of either: the formulas are the same for all.
Number = Any


class Elastomer(Protocol):
    """What the equations need to know of a material.

    An elastomer known only up to some stretch (a measured curve) also has ``largest_stretch``;
    a history ends there with the event `out_of_range`. One whose balloon stays a sphere without a voltage,
    whatever the pressure, may say so by `stays_spherical = True`. Elastomers are compared and hashed: two
    balloons are equal where theirs are.
    """

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


def largest_stretch(elastomer: Elastomer) -> float:
    """Stretch up to which an elastomer is known; inf where it is known for all that it can reach."""
    return float(getattr(elastomer, "largest_stretch", math.inf))


def tension_force(elastomer: Elastomer, stretch: Number) -> Number:
    """f(λ) = ŵ′ of an elastomer, over its μ."""
    numerator, denominator = elastomer.pole_form(stretch)
    return numerator / denominator


def tension_stiffness(elastomer: Elastomer, stretch: Number) -> Number:
    """f′(λ) = ŵ″ of an elastomer, over its μ."""
    numerator, denominator = elastomer.pole_form(stretch)
    numerator_slope, denominator_slope = elastomer.pole_form_slope(stretch)
    return (numerator_slope - numerator * denominator_slope / denominator) / denominator


def invariant_limit(excess: float) -> float:
    """The stretch λ > 1 at which I₁ − 3 = 2λ² + λ⁻⁴ − 3 is `excess`: with x = λ², 2x³ − (3 + J)x² + 1 = 0."""
    c = 3.0 + excess
    x = c / 2.0
    for _ in range(60):
        step = ((2.0 * x - c) * x * x + 1.0) / ((6.0 * x - 2.0 * c) * x)
        x -= step
        if abs(step) <= 1e-16 * x:
            break
    return math.sqrt(x)


def exponential(power: Number) -> Number:
    """e^x, inf where that is too large for a float."""
    if isinstance(power, float):
        return math.inf if power > 700.0 else math.exp(power)
    with np.errstate(over="ignore"):
        return np.exp(power)


def exponential_less_one(power: Number) -> Number:
    """e^x − 1 without cancellation at small x, inf where that is too large for a float."""
    if isinstance(power, float):
        return math.inf if power > 700.0 else math.expm1(power)
    with np.errstate(over="ignore"):
        return np.expm1(power)
