"""Viscoelastic branches and sources for the reference in real time.

Branches are written in inner stretches and come from their energies; a film behind a resistance has a
voltage of its own.

The linear flow is written in the stretches p (in the plane) and q (across) in which a branch is free of
stress, a = p⁻² and b = q⁻², and its heat as −∂ψ/∂p dp/dt − ∂ψ/∂q dq/dt of

    ψ = (k/2)[2(λ/p)² + (λ²q)⁻² − 3 + 4 ln p + 2 ln q].
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Spring:
    """A neo-Hookean spring on a Newtonian dashpot, with an inner stretch ξ: modulus and relaxation time."""

    modulus: float
    time: float

    size = 1

    def share(self, x: float, inner: Sequence[float]) -> float:
        """Its part of g."""
        return self.modulus / inner[0] * _force(x / inner[0])

    def rates(self, x: float, inner: Sequence[float]) -> list[float]:
        return [x / (12.0 * self.time) * _force(x / inner[0])]

    def heat(self, x: float, inner: Sequence[float]) -> float:
        """Per time and volume."""
        y = x / inner[0]
        return self.modulus * (y * _force(y)) ** 2 / (12.0 * self.time)

    def stiffness(self, x: float, inner: Sequence[float]) -> float:
        """∂(share)/∂λ."""
        return self.modulus * _slope(x / inner[0]) / inner[0] ** 2

    def slopes(self, x: float, inner: Sequence[float]) -> tuple[list[float], list[float], list[float]]:
        """∂(share)/∂inner, ∂rates/∂λ, ∂rates/∂inner."""
        y = x / inner[0]
        both = _force(y) + y * _slope(y)
        return (
            [-self.modulus / inner[0] ** 2 * both],
            [both / (12.0 * self.time)],
            [-(y**2) * _slope(y) / (12.0 * self.time)],
        )


@dataclass(frozen=True)
class LinearSpring:
    """A branch of the linear flow, with inner stretches (p, q): modulus and relaxation time."""

    modulus: float
    time: float

    size = 2

    def share(self, x: float, inner: Sequence[float]) -> float:
        p, q = inner
        return 2.0 * self.modulus * (x / p**2 - 1.0 / (x**5 * q**2))

    def rates(self, x: float, inner: Sequence[float]) -> list[float]:
        p, q = inner
        return [0.5 * (p - p**3 / x**2) / self.time, 0.5 * (q - q**3 * x**4) / self.time]

    def heat(self, x: float, inner: Sequence[float]) -> float:
        p, q = inner
        plane, across = self.rates(x, inner)
        return self.modulus * (
            2.0 * (x**2 / p**2 - 1.0) / p * plane + (1.0 / (x**4 * q**2) - 1.0) / q * across
        )

    def stiffness(self, x: float, inner: Sequence[float]) -> float:
        p, q = inner
        return 2.0 * self.modulus * (1.0 / p**2 + 5.0 / (x**6 * q**2))

    def slopes(self, x: float, inner: Sequence[float]) -> tuple[list[float], list[float], list[float]]:
        p, q = inner
        return (
            [-4.0 * self.modulus * x / p**3, 4.0 * self.modulus / (x**5 * q**3)],
            [p**3 / x**3 / self.time, -2.0 * q**3 * x**3 / self.time],
            [0.5 * (1.0 - 3.0 * p**2 / x**2) / self.time, 0.5 * (1.0 - 3.0 * q**2 * x**4) / self.time],
        )


@dataclass(frozen=True)
class Source:
    """What is between a film and its source: resistance, largest current, conductivity and its field."""

    resistance: float
    limit: float = math.inf
    conductivity: float = 0.0
    field: float = math.inf

    def currents(
        self, given: float, voltage: float, field: float, charge: float, permittivity: float
    ) -> tuple[float, float]:
        """What comes from the source, and what goes through the film."""
        current = min(max((given - voltage) / self.resistance, -self.limit), self.limit)
        return current, self.conductivity * math.exp(abs(field) / self.field) * charge / permittivity


AnySpring = Spring | LinearSpring


def _force(x: float) -> float:
    return 2.0 * (x - x**-5)


def _slope(x: float) -> float:
    return 2.0 + 10.0 * x**-6
