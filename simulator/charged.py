"""A balloon's wall with electrodes on which the charge is given, and the voltage follows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from simulator.model import Membrane

Number = Any


@dataclass(frozen=True)
class ChargedMembrane:
    """A balloon's wall with electrodes, under the charge q = offset + rate·v.

    The charge adds ½q²/(cλ⁴) to the potential, c = r²e/h, where a voltage adds −½φ²cλ⁴; the force of
    attraction is the same, φ = q/(cλ⁴). Besides the `wall`: `electric_load` is b = 2/(r²hk c), so that

        R = N − D [a p λ² + b q² λ⁻⁵],

    `capacitance` c, `thickness` h.
    """

    wall: Membrane
    electric_load: float
    capacitance: float
    thickness: float
    offset: float
    rate: float

    def force(self, stretch: Number, pressure: Number, v: Number) -> Number:
        """R, see above."""
        wall = self.wall
        numerator, denominator = wall.elastomer.pole_form(stretch)
        charge = self.offset + self.rate * v
        square = stretch * stretch
        electric = self.electric_load * charge * charge / (square * square * stretch)
        return numerator - denominator * (wall.pressure_load * pressure * square + electric)

    def linearised(
        self, stretch: Number, pressure: Number, v: Number
    ) -> tuple[Number, Number, Number, Number]:
        """R and ∂R/∂(λ, p, v)."""
        wall = self.wall
        numerator, denominator = wall.elastomer.pole_form(stretch)
        numerator_slope, denominator_slope = wall.elastomer.pole_form_slope(stretch)
        charge = self.offset + self.rate * v
        square = stretch * stretch
        per_pressure = wall.pressure_load * square
        per_charge = self.electric_load * charge / (square * square * stretch)
        mechanical, electric = per_pressure * pressure, per_charge * charge
        load = mechanical + electric
        return (
            numerator - denominator * load,
            numerator_slope
            - denominator_slope * load
            - denominator * ((2.0 * mechanical - 5.0 * electric) / stretch),
            -denominator * per_pressure,
            -denominator * (2.0 * self.rate) * per_charge,
        )

    def stiffness(self, stretch: Number, pressure: Number, v: Number) -> tuple[Number, Number]:
        """∂R/∂λ and D."""
        return self.linearised(stretch, pressure, v)[1], self.wall.elastomer.pole_form(stretch)[1]

    def field(self, stretch: Number, v: Number) -> Number:
        """True electric field φλ²/h."""
        return (self.offset + self.rate * v) / (self.capacitance * stretch * stretch * self.thickness)

    def potential(self, stretch: Number, v: Number) -> Number:
        """Elastic energy and ½φq."""
        charge = self.offset + self.rate * v
        return self.wall.potential(stretch, v) + 0.5 * charge * charge / (self.capacitance * stretch**4)

    def charge_rate(self, stretch: Number, v: Number) -> Number:
        """−φ dq/dv = −∂Π/∂v of this wall."""
        return -(self.offset + self.rate * v) * self.rate / (self.capacitance * stretch**4)

    def supplied(self, stretch: Number, v: Number) -> Number:
        """0: all work of the source is in the potential."""
        return 0.0
