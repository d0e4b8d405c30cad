"""A balloon's wall: bare, under a voltage, under a voltage that oscillates, or under a given charge.

Every force balance is divided by kᵢ and multiplied through by the denominator D of the elastomer's force,

    Rᵢ = N(λᵢ) − D(λᵢ) [aᵢ p λᵢ² + bᵢ φᵢ² λᵢ³] = D gᵢ/kᵢ,    a = r/(hk),  b = 2e/(h²k),

which stays smooth at the limiting stretch, where gᵢ itself has a pole. Methods take floats, complex numbers
or arrays, and compute with whatever they are given.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simulator.model.drive import sine_of_turns
from simulator.model.elastomers import Elastomer, Number


@dataclass(frozen=True)
class Membrane:
    """A balloon's wall without a voltage.

    `pressure_load` is a = r/(hk), `modulus` k, `weight` r²hk (energy of the wall), `cube` r³ (volume).
    """

    elastomer: Elastomer
    pressure_load: float
    modulus: float
    weight: float
    cube: float

    def force(self, stretch: Number, pressure: Number, v: Number) -> Number:
        """R, see the head of this file."""
        numerator, denominator = self.elastomer.pole_form(stretch)
        return numerator - denominator * (self.pressure_load * pressure * stretch * stretch)

    def linearised(
        self, stretch: Number, pressure: Number, v: Number
    ) -> tuple[Number, Number, Number, Number]:
        """R and ∂R/∂(λ, p, v)."""
        numerator, denominator = self.elastomer.pole_form(stretch)
        numerator_slope, denominator_slope = self.elastomer.pole_form_slope(stretch)
        per_pressure = self.pressure_load * stretch * stretch
        load = per_pressure * pressure
        return (
            numerator - denominator * load,
            numerator_slope - denominator_slope * load - denominator * (2.0 * load / stretch),
            -denominator * per_pressure,
            0.0,
        )

    def stiffness(self, stretch: Number, pressure: Number, v: Number) -> tuple[Number, Number]:
        """∂R/∂λ and D."""
        _, denominator = self.elastomer.pole_form(stretch)
        numerator_slope, denominator_slope = self.elastomer.pole_form_slope(stretch)
        load = self.pressure_load * pressure * stretch
        return numerator_slope - load * (denominator_slope * stretch + 2.0 * denominator), denominator

    def potential(self, stretch: Number, v: Number) -> Number:
        """Elastic energy r²hk ŵ."""
        return self.weight * self.elastomer.energy(stretch)

    def charge_rate(self, stretch: Number, v: Number) -> Number:
        """q dφ/dv: no voltage, 0."""
        return 0.0

    def supplied(self, stretch: Number, v: Number) -> Number:
        """φq: no voltage, 0."""
        return 0.0


@dataclass(frozen=True)
class ElectrodedMembrane:
    """A balloon's wall with electrodes, under the voltage φ = offset + rate·v.

    Besides the `wall`: `electric_load` is b = 2e/(h²k), `capacitance` r²e/h (so that q = capacitance φ λ⁴),
    `thickness` h.
    """

    wall: Membrane
    electric_load: float
    capacitance: float
    thickness: float
    offset: float
    rate: float

    def force(self, stretch: Number, pressure: Number, v: Number) -> Number:
        """R, see the head of this file."""
        wall = self.wall
        numerator, denominator = wall.elastomer.pole_form(stretch)
        voltage = self.offset + self.rate * v
        load = wall.pressure_load * pressure + self.electric_load * voltage * voltage * stretch
        return numerator - denominator * load * stretch * stretch

    def linearised(
        self, stretch: Number, pressure: Number, v: Number
    ) -> tuple[Number, Number, Number, Number]:
        """R and ∂R/∂(λ, p, v)."""
        wall = self.wall
        numerator, denominator = wall.elastomer.pole_form(stretch)
        numerator_slope, denominator_slope = wall.elastomer.pole_form_slope(stretch)
        voltage = self.offset + self.rate * v
        square = stretch * stretch
        per_pressure = wall.pressure_load * square
        per_voltage = self.electric_load * voltage * square * stretch
        mechanical, electric = per_pressure * pressure, per_voltage * voltage
        load = mechanical + electric
        return (
            numerator - denominator * load,
            numerator_slope
            - denominator_slope * load
            - denominator * ((2.0 * mechanical + 3.0 * electric) / stretch),
            -denominator * per_pressure,
            -denominator * (2.0 * self.rate) * per_voltage,
        )

    def stiffness(self, stretch: Number, pressure: Number, v: Number) -> tuple[Number, Number]:
        """∂R/∂λ and D."""
        wall = self.wall
        _, denominator = wall.elastomer.pole_form(stretch)
        numerator_slope, denominator_slope = wall.elastomer.pole_form_slope(stretch)
        voltage = self.offset + self.rate * v
        mechanical = wall.pressure_load * pressure * stretch
        electric = self.electric_load * voltage * voltage * stretch * stretch
        return (
            numerator_slope
            - denominator_slope * stretch * (mechanical + electric)
            - denominator * (2.0 * mechanical + 3.0 * electric),
            denominator,
        )

    def field(self, stretch: Number, v: Number) -> Number:
        """True electric field φλ²/h."""
        return (self.offset + self.rate * v) * stretch * stretch / self.thickness

    def potential(self, stretch: Number, v: Number) -> Number:
        """Elastic energy less ½φq."""
        voltage = self.offset + self.rate * v
        return self.wall.potential(stretch, v) - 0.5 * self.capacitance * voltage * voltage * stretch**4

    def charge_rate(self, stretch: Number, v: Number) -> Number:
        """q dφ/dv = −∂Π/∂v of this wall."""
        return self.capacitance * (self.offset + self.rate * v) * self.rate * stretch**4

    def supplied(self, stretch: Number, v: Number) -> Number:
        """φq."""
        return self.capacitance * (self.offset + self.rate * v) ** 2 * stretch**4


@dataclass(frozen=True)
class OscillatingMembrane:
    """A balloon's wall with electrodes, under the voltage φ = mean + amplitude·sin 2π(v + phase).

    At any v it is an `ElectrodedMembrane` whose voltage moves along the tangent there.
    """

    wall: Membrane
    electric_load: float
    capacitance: float
    thickness: float
    mean: float
    amplitude: float
    phase: float

    def voltage(self, v: Number) -> Number:
        """φ."""
        return self.mean + self.amplitude * sine_of_turns(v + self.phase)

    def _tangent(self, v: Number) -> ElectrodedMembrane:
        rate = 2.0 * np.pi * self.amplitude * sine_of_turns(v + (self.phase + 0.25))
        return ElectrodedMembrane(
            self.wall, self.electric_load, self.capacitance, self.thickness, self.voltage(v), rate
        )

    def force(self, stretch: Number, pressure: Number, v: Number) -> Number:
        """R, see the head of this file."""
        return self._tangent(v).force(stretch, pressure, 0.0)

    def linearised(
        self, stretch: Number, pressure: Number, v: Number
    ) -> tuple[Number, Number, Number, Number]:
        """R and ∂R/∂(λ, p, v)."""
        return self._tangent(v).linearised(stretch, pressure, 0.0)

    def stiffness(self, stretch: Number, pressure: Number, v: Number) -> tuple[Number, Number]:
        """∂R/∂λ and D."""
        return self._tangent(v).stiffness(stretch, pressure, 0.0)

    def field(self, stretch: Number, v: Number) -> Number:
        """True electric field φλ²/h."""
        return self._tangent(v).field(stretch, 0.0)

    def potential(self, stretch: Number, v: Number) -> Number:
        """Elastic energy less ½φq."""
        return self._tangent(v).potential(stretch, 0.0)

    def charge_rate(self, stretch: Number, v: Number) -> Number:
        """q dφ/dv = −∂Π/∂v of this wall."""
        return self._tangent(v).charge_rate(stretch, 0.0)

    def supplied(self, stretch: Number, v: Number) -> Number:
        """φq."""
        return self._tangent(v).supplied(stretch, 0.0)


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


AnyMembrane = Membrane | ElectrodedMembrane | ChargedMembrane | OscillatingMembrane


def wall_of(membrane: AnyMembrane) -> Membrane:
    """The bare wall of a balloon, whatever drives it."""
    return membrane if isinstance(membrane, Membrane) else membrane.wall
