"""A balloon's wall: bare, or with electrodes that are driven by a voltage or a charge.

Every force balance is divided by kᵢ and multiplied through by the denominator D of the elastomer's force,

    Rᵢ = N(λᵢ) − D(λᵢ) [aᵢ p λᵢ² + bᵢ φᵢ² λᵢ³] = D gᵢ/kᵢ,    a = r/(hk),  b = 2e/(h²k),

which stays smooth at the limiting stretch, where gᵢ itself has a pole. A given charge q is the voltage
φ = q/(cλ⁴), c = r²e/h, which falls as the film grows: the force is the same, its derivatives are not.

Methods take floats, complex numbers or arrays, and compute with whatever they are given. Everything is
dimensionless, in the units of `docs/physics.md`. IDA calls these methods at every step; a cached property on
a membrane would slow every access to its attributes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from simulator.model.drive import Drive
from simulator.model.elastomers import Elastomer, Number


@dataclass(frozen=True)
class Membrane:
    """A balloon's wall without a voltage.

    Attributes
    ----------
    elastomer : Elastomer
    pressure_load : float
        a = r/(hk).
    modulus : float
        k.
    weight : float
        r²hk, the scale of the wall's energy.
    cube : float
        r³, three times the unstretched volume.
    """

    elastomer: Elastomer
    pressure_load: Number
    modulus: Number
    weight: Number
    cube: Number

    @classmethod
    def of(cls, elastomer: Elastomer, radius: Number, thickness: Number, modulus: Number) -> Membrane:
        """The wall of a balloon of unstretched radius r and thickness h and shear modulus k."""
        return cls(
            elastomer,
            radius / (thickness * modulus),
            modulus,
            radius * radius * thickness * modulus,
            radius**3,
        )

    @property
    def wall(self) -> Membrane:
        """The bare wall: itself."""
        return self

    @property
    def drive(self) -> None:
        """What drives its electrodes: nothing."""
        return None

    @property
    def drive_scale(self) -> float:
        """The smallest change of v that matters: no voltage, inf."""
        return math.inf

    def force(self, stretch: Number, pressure: Number, v: Number) -> Number:
        """R, see the head of this module."""
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

    def field(self, stretch: Number, v: Number) -> Number:
        """True electric field: no voltage, 0."""
        return 0.0

    def potential(self, stretch: Number, v: Number) -> Number:
        """Elastic energy r²hk ŵ."""
        return self.weight * self.elastomer.energy(stretch)

    def charge_rate(self, stretch: Number, v: Number) -> Number:
        """−∂Π/∂v of this wall: no voltage, 0."""
        return 0.0

    def supplied(self, stretch: Number, v: Number) -> Number:
        """φq of a source of voltage: none, 0."""
        return 0.0


@dataclass(frozen=True)
class ElectrodedMembrane:
    """A balloon's wall with electrodes, under a given voltage φ or a given charge q.

    A source of voltage adds −½cφ²λ⁴ to the potential, a source of charge +½q²/(cλ⁴).

    Attributes
    ----------
    wall : Membrane
    electric_load : float
        b = 2e/(h²k).
    capacitance : float
        c = r²e/h of the unstretched film: q = cφλ⁴.
    thickness : float
        h.
    drive : AffineDrive or SineDrive
        What is given, as a function of the drive's coordinate v.
    exponent : float
        That of the stretch in the electric load: 3 under a given voltage, bφ²λ³, and −5 under a given
        charge, bq²λ⁻⁵/c².
    """

    wall: Membrane
    electric_load: Number
    capacitance: Number
    thickness: Number
    drive: Drive
    exponent: float

    @classmethod
    def of(
        cls,
        wall: Membrane,
        radius: Number,
        thickness: Number,
        modulus: Number,
        permittivity: Number,
        drive: Drive,
    ) -> ElectrodedMembrane:
        """The wall of a balloon with a film of this permittivity, driven so."""
        return cls(
            wall,
            2.0 * permittivity / (thickness * thickness * modulus),
            radius**2 * permittivity / thickness,
            thickness,
            drive,
            -5.0 if drive.quantity == "charge" else 3.0,
        )

    @property
    def drive_scale(self) -> float:
        """The smallest change of v that matters: of the voltage √(2/b), of the charge c times that."""
        size = math.sqrt(2.0 / self.electric_load)
        return self.drive.scale(size * self.capacitance if self.exponent < 0.0 else size)

    def capacitance_at(self, stretch: Number) -> Number:
        """cλ⁴ = q/φ."""
        return self.capacitance * stretch**4

    def voltage(self, stretch: Number, v: Number) -> Number:
        """φ."""
        given = self.drive.at(v)
        return given / self.capacitance_at(stretch) if self.exponent < 0.0 else given

    def force(self, stretch: Number, pressure: Number, v: Number) -> Number:
        """R, see the head of this module."""
        wall = self.wall
        numerator, denominator = wall.elastomer.pole_form(stretch)
        given = self.drive.at(v)
        voltage = given / self.capacitance_at(stretch) if self.exponent < 0.0 else given
        load = wall.pressure_load * pressure + self.electric_load * voltage * voltage * stretch
        return numerator - denominator * load * stretch * stretch

    def linearised(
        self, stretch: Number, pressure: Number, v: Number
    ) -> tuple[Number, Number, Number, Number]:
        """R and ∂R/∂(λ, p, v)."""
        wall = self.wall
        numerator, denominator = wall.elastomer.pole_form(stretch)
        numerator_slope, denominator_slope = wall.elastomer.pole_form_slope(stretch)
        voltage, rate = self.drive.at(v), self.drive.slope(v)
        if self.exponent < 0.0:
            capacitance = self.capacitance_at(stretch)
            voltage, rate = voltage / capacitance, rate / capacitance
        square = stretch * stretch
        per_pressure = wall.pressure_load * square
        per_voltage = self.electric_load * voltage * square * stretch
        mechanical, electric = per_pressure * pressure, per_voltage * voltage
        load = mechanical + electric
        return (
            numerator - denominator * load,
            numerator_slope
            - denominator_slope * load
            - denominator * ((2.0 * mechanical + self.exponent * electric) / stretch),
            -denominator * per_pressure,
            -denominator * (2.0 * rate) * per_voltage,
        )

    def stiffness(self, stretch: Number, pressure: Number, v: Number) -> tuple[Number, Number]:
        """∂R/∂λ and D."""
        wall = self.wall
        _, denominator = wall.elastomer.pole_form(stretch)
        numerator_slope, denominator_slope = wall.elastomer.pole_form_slope(stretch)
        given = self.drive.at(v)
        voltage = given / self.capacitance_at(stretch) if self.exponent < 0.0 else given
        mechanical = wall.pressure_load * pressure * stretch
        electric = self.electric_load * voltage * voltage * stretch * stretch
        return (
            numerator_slope
            - denominator_slope * stretch * (mechanical + electric)
            - denominator * (2.0 * mechanical + self.exponent * electric),
            denominator,
        )

    def field(self, stretch: Number, v: Number) -> Number:
        """True electric field φλ²/h."""
        return self.voltage(stretch, v) * stretch * stretch / self.thickness

    def potential(self, stretch: Number, v: Number) -> Number:
        """Elastic energy, less ½φq under a given voltage, plus ½φq under a given charge."""
        voltage = self.voltage(stretch, v)
        stored = 0.5 * self.capacitance * voltage * voltage * stretch**4
        elastic = self.wall.potential(stretch, v)
        return elastic + stored if self.exponent < 0.0 else elastic - stored

    def charge_rate(self, stretch: Number, v: Number) -> Number:
        """−∂Π/∂v of this wall: q dφ/dv under a given voltage, −φ dq/dv under a given charge."""
        voltage, rate = self.voltage(stretch, v), self.drive.slope(v)
        return -voltage * rate if self.exponent < 0.0 else self.capacitance * voltage * rate * stretch**4

    def supplied(self, stretch: Number, v: Number) -> Number:
        """φq of a source of voltage; 0 of a source of charge, all of whose work is in the potential."""
        return 0.0 if self.exponent < 0.0 else self.capacitance * self.voltage(stretch, v) ** 2 * stretch**4


AnyMembrane = Membrane | ElectrodedMembrane


def curvature(membrane: AnyMembrane, stretch: Number, pressure: Number, v: Number) -> Number:
    """r²h ∂g/∂λ of one balloon at a fixed pressure: its share of the diagonal of the Hessian of Π.

    It has the pole of the wall's stiffness. Also right where g is not zero, as in the state in which a
    snap lost its tension.
    """
    force, slope, _, _ = membrane.linearised(stretch, pressure, v)
    wall = membrane.wall
    _, denominator = wall.elastomer.pole_form(stretch)
    _, denominator_slope = wall.elastomer.pole_form_slope(stretch)
    return wall.weight * (slope - force / denominator * denominator_slope) / denominator


def sphericity(membrane: AnyMembrane, stretch: Number, v: Number) -> Number:
    """D²s/k of one balloon: positive where it stays a sphere, zero where it begins to turn into a pear.

    s = k(f′ − f/λ) − 4(e/h²)φ²λ² says whether the tension pλ/2 rises with the stretch at the present voltage.
    What holds the volume or the charge does not enter: a pear has the volume and the charge of the sphere to
    first order. See `docs/shape.md`. Multiplied by D² it has no pole.
    """
    wall = membrane.wall
    numerator, denominator = wall.elastomer.pole_form(stretch)
    numerator_slope, denominator_slope = wall.elastomer.pole_form_slope(stretch)
    margin = numerator_slope * denominator - numerator * (denominator_slope + denominator / stretch)
    if isinstance(membrane, ElectrodedMembrane):
        field = membrane.voltage(stretch, v) * stretch * denominator
        margin = margin - 2.0 * membrane.electric_load * field * field
    return margin


def sum_of_cubes(walls: Sequence[Membrane], stretches: Sequence[Number]) -> Number:
    """Σ r³λ³, three times the balloons' volume over 4πR³."""
    total: Number = 0.0
    for wall, x in zip(walls, stretches, strict=True):
        total = total + wall.cube * x * x * x
    return total
