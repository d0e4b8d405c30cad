"""Dielectric strengths: the true field E_b at which a film breaks down, as a function of its stretch."""

from __future__ import annotations

import math
from dataclasses import dataclass

from simulator.model.elastomers import Number


@dataclass(frozen=True)
class ConstantStrength:
    """One field, whatever the stretch."""

    field: float

    def at(self, stretch: Number) -> Number:
        """E_b, over √(μ/ε)."""
        return self.field


@dataclass(frozen=True)
class PowerStrength:
    """E_b = field · λ^exponent.

    A law in the stretch and the present thickness h, E_b = E₀ λ^a (h/H)^b, is of this form: a wall is
    incompressible, h = h₀ λ⁻², so that exponent = a − 2b and field = E₀ (h₀/H)^b (`from_thickness`).

    References
    ----------
    J. Huang, S. Shian, R. M. Diebold, Z. Suo, D. R. Clarke, Applied Physics Letters 101, 122905 (2012):
    a = 0.63, b = −0.25 for an acrylic elastomer.
    """

    field: float
    exponent: float

    @classmethod
    def from_thickness(
        cls, field: float, stretch_exponent: float, thickness_exponent: float, thickness: float
    ) -> PowerStrength:
        """From E₀, a, b and the unstretched thickness h₀/H."""
        return cls(field * thickness**thickness_exponent, stretch_exponent - 2.0 * thickness_exponent)

    def at(self, stretch: Number) -> Number:
        """E_b, over √(μ/ε)."""
        if isinstance(stretch, float) and stretch <= 0.0:
            return math.nan  # a Newton step gone astray, and no complex number
        return self.field * stretch**self.exponent


Strength = ConstantStrength | PowerStrength
