"""Films behind a resistance: the source charges them by a current, and they leak.

A source of voltage φ_s drives a film through a resistance ρ, with a current of at most i_max; the film loses
charge through itself,

    dq/dt = I − σ(E) q/e,    I = (φ_s − φ)/ρ within ±i_max,    φ = q/(cλ⁴),  c = r²e/h.

The conductivity σ is constant or grows with the true field, σ = σ₀ exp(|E|/E_σ). Resistances are in units of
H/(4πR²ε) times the unit of time, currents in 4πR²√(εμ) and conductivities in ε per unit of time.

References
----------
C. C. Foo, S. J. A. Koh, C. Keplinger, R. Kaltseis, S. Bauer, Z. Suo, J. Appl. Phys. 111 (2012) 094107: the
conductivity that grows exponentially; of VHB 4910 σ₀ = 3.23e-14 S/m and E_σ = 40 MV/m.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.model.parts import Numbers, Tangent

if TYPE_CHECKING:
    from simulator.model.drive import Drive
    from simulator.model.elastomers import Number
    from simulator.model.strength import Strength

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Leak:
    """A conductivity of a film, and the field that multiplies it by e; inf where it is constant."""

    conductivity: float
    field: float = math.inf

    def at(self, field: float) -> tuple[float, float]:
        """σ(E) and dσ/d|E|."""
        found = self.conductivity * math.exp(min(abs(field) / self.field, 700.0))
        return found, found / self.field


@dataclass(frozen=True)
class SuppliedFilm:
    """The film of one balloon behind a resistance; its own unknown is its charge q.

    Attributes
    ----------
    capacitance : float
        c = r²e/h.
    thickness, permittivity : float
        h and e.
    pull : float
        2/(r⁴e): S = −pull q²λ⁻⁵.
    resistance, limit : float
        ρ and i_max, inf for none.
    leak : Leak or None
    drive : AffineDrive, SineDrive or None
        The voltage of its source; None for none.
    strength : ConstantStrength, PowerStrength or None
        The dielectric strength of the film.
    """

    capacitance: float
    thickness: float
    permittivity: float
    pull: float
    resistance: float
    limit: float
    leak: Leak | None
    drive: Drive | None
    # No part of the equations: balloons that differ in it alone are equal, and stay alike.
    strength: Strength | None = field(compare=False)

    at_rest = (0.0,)
    books = ("resistance", "leak", "work")
    electrical = True

    def voltage(self, stretch: Number, own: Numbers) -> Number:
        """φ of the film."""
        return own[0] / (self.capacitance * stretch**4)

    def source(self, v: float) -> float:
        """φ_s."""
        return float(self.drive.at(v)) if self.drive is not None else 0.0

    def intactness(self, stretch: float, own: Sequence[float]) -> float:
        """1 − (E/E_b)² of a film with a strength; at zero it breaks down."""
        assert self.strength is not None
        true_field = self.voltage(stretch, own) * stretch * stretch / self.thickness
        share = true_field / self.strength.at(stretch)
        return float(1.0 - share * share)

    def moves(
        self, stretch: float, own: Sequence[float], v: float
    ) -> tuple[float, Sequence[float], Sequence[float]]:
        (charge,) = own
        voltage, source = self.voltage(stretch, own), self.source(v)
        current = self._current(source - voltage)[0]
        lost = self._lost(stretch, charge)[0]
        powers = ((source - voltage) * current, voltage * lost, source * current)
        return -self.pull * charge * charge * stretch**-5, (current - lost,), powers

    def tangent(self, stretch: float, own: Sequence[float], v: float) -> Tangent:
        (charge,) = own
        voltage, source = self.voltage(stretch, own), self.source(v)
        along, across = -4.0 * voltage / stretch, 1.0 / (self.capacitance * stretch**4)
        current, slope = self._current(source - voltage)
        lost, lost_along, lost_across = self._lost(stretch, charge)
        falls = (-current - (source - voltage) * slope, -source * slope)  # per voltage
        return Tangent(
            5.0 * self.pull * charge * charge * stretch**-6,
            (-2.0 * self.pull * charge * stretch**-5,),
            (-slope * along - lost_along,),
            (-slope * across - lost_across,),
            (falls[0] * along, along * lost + voltage * lost_along, falls[1] * along),
            ((falls[0] * across,), (across * lost + voltage * lost_across,), (falls[1] * across,)),
        )

    def stiffness(self, stretch: Number, own: Numbers) -> Number:
        """∂S/∂λ at the present voltage of the film."""
        return -3.0 * self.pull * own[0] * own[0] * stretch**-6

    def sphericity(self, stretch: Number, own: Numbers) -> Number:
        return -2.0 * self.pull * own[0] * own[0] * stretch**-6

    def shear_stiffness(self, stretch: Number, own: Numbers) -> Number:
        return 0.0

    def energy(self, stretch: Number, own: Numbers) -> Number:
        """½φq."""
        return 0.5 * own[0] * self.voltage(stretch, own)

    def columns(self, own: FloatArray) -> dict[str, FloatArray]:
        return {}

    def _current(self, difference: float) -> tuple[float, float]:
        """I and its slope in the difference of the voltages."""
        current = difference / self.resistance
        if abs(current) > self.limit:
            return math.copysign(self.limit, current), 0.0
        return current, 1.0 / self.resistance

    def _lost(self, stretch: float, charge: float) -> tuple[float, float, float]:
        """The current through the film, and its slopes in the stretch and the charge."""
        if self.leak is None:
            return 0.0, 0.0, 0.0
        true_field = charge / (self.capacitance * stretch * stretch * self.thickness)
        conductivity, slope = self.leak.at(true_field)
        rise = slope * abs(true_field) / self.permittivity
        rate = conductivity / self.permittivity
        return rate * charge, -2.0 * rise * charge / stretch, rate + rise
