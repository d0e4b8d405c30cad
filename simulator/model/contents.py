"""What the balloons share: a gas at one temperature, a gas without exchange of heat, or a liquid.

A *law* (`Isothermal`, `Adiabatic`, `Incompressible`) is what a scenario names. Closing the valve makes of it
the *contents* (`IdealGas`, `SealedGas`, `Liquid`): one equation between pressure and volume, chosen when
the equations are composed. Only a gas in a rigid chamber knows of the chamber.

Volumes are over 4πR³. The balloons' own is called `swelling`; the equations sum Σ r³λ³, three times that,
called `cubes` here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from simulator.model.coupling import CONSTRAINED, COUPLED, Spectrum

if TYPE_CHECKING:
    from simulator.model.membranes import AnyMembrane, Membrane

FloatArray = NDArray[np.float64]
Number = Any

_TINY = float(np.finfo(float).tiny)


class Contents(Protocol):
    """What is sealed in, as the equations need it."""

    @property
    def spectrum(self) -> Spectrum:
        """How it couples the balloons' stabilities."""
        ...

    def defect(self, pressure: Number, cubes: Number) -> Number:
        """The equation between pressure and volume, zero where it holds."""
        ...

    def term_size(self, pressure: Number, cubes: Number) -> Number:
        """Sizes of the terms of the defect, added up."""
        ...

    def linearised(self, pressure: Number, cubes: Number) -> tuple[Number, Number, Number]:
        """The defect and its derivatives in p and in the swelling."""
        ...

    def stiffness(self, cubes: Number) -> Number:
        """−dp/dV; 1 for a liquid, whose own is infinite and replaced by a constraint."""
        ...

    def energy(self, swelling: Number) -> Number:
        """−∫p dV, up to a constant, small near the state of sealing."""
        ...

    def flow_pressure(
        self,
        membranes: Sequence[AnyMembrane],
        walls: Sequence[Membrane],
        stretches: Sequence[Number],
        v: Number,
    ) -> Number:
        """The pressure of stretches in motion."""
        ...

    def flow_law(
        self, walls: Sequence[Membrane], y: Sequence[float], residual: list[Number], rows: list[list[Number]]
    ) -> tuple[Number, list[Number]]:
        """What is zero at the `flow_pressure`, linear in p, and its derivatives in (stretches…, p)."""
        ...

    def admitted(
        self, membranes: Sequence[AnyMembrane], walls: Sequence[Membrane], y: list[float]
    ) -> list[float]:
        """A state from which a flow can start: close to `y`, and of a volume that is possible."""
        ...


@dataclass(frozen=True)
class IdealGas:
    """(p + pₑ)V = n, in the balloons alone."""

    amount: Number
    ambient: Number

    spectrum = COUPLED

    def defect(self, pressure: Number, cubes: Number) -> Number:
        return (pressure + self.ambient) * cubes / (3.0 * self.amount) - 1.0

    def term_size(self, pressure: Number, cubes: Number) -> Number:
        return 2.0

    def linearised(self, pressure: Number, cubes: Number) -> tuple[Number, Number, Number]:
        per_pressure = cubes / (3.0 * self.amount)
        absolute = pressure + self.ambient
        return per_pressure * absolute - 1.0, per_pressure, absolute / self.amount

    def stiffness(self, cubes: Number) -> Number:
        return 9.0 * self.amount / (cubes * cubes)

    def energy(self, swelling: Number) -> Number:
        # −n ln V + pₑV, from the volume V₀ = n/(1 + pₑ): with u = V/V₀ − 1 the large parts cancel on paper.
        start = self.amount / (1.0 + self.ambient)
        u = (swelling - start) / start
        return -(start * (np.log1p(u) + self.ambient * (np.log1p(u) - u)))

    def flow_pressure(
        self,
        membranes: Sequence[AnyMembrane],
        walls: Sequence[Membrane],
        stretches: Sequence[Number],
        v: Number,
    ) -> Number:
        return 3.0 * self.amount / _cubes(walls, stretches) - self.ambient

    def flow_law(
        self, walls: Sequence[Membrane], y: Sequence[float], residual: list[Number], rows: list[list[Number]]
    ) -> tuple[Number, list[Number]]:
        return residual[-1], rows[-1]

    def admitted(
        self, membranes: Sequence[AnyMembrane], walls: Sequence[Membrane], y: list[float]
    ) -> list[float]:
        return y


class Expansion(Protocol):
    """How the absolute pressure falls as the volume grows by the fraction u from where it was sealed."""

    def fall(self, u: Number) -> tuple[Number, Number]:
        """The fraction of the absolute pressure that is lost, and its derivative in u."""
        ...

    def work(self, u: Number) -> Number:
        """−∫ of the fraction of the pressure that is left, from 0 to u."""
        ...


@dataclass(frozen=True)
class Isotherm:
    """Pressure times volume stays."""

    def fall(self, u: Number) -> tuple[Number, Number]:
        return u / (1.0 + u), 1.0 / ((1.0 + u) * (1.0 + u))

    def work(self, u: Number) -> Number:
        return -np.log1p(u)


@dataclass(frozen=True)
class Adiabat:
    """Pressure times volume^γ stays."""

    exponent: Number

    def fall(self, u: Number) -> tuple[Number, Number]:
        if not isinstance(u, float):
            left = -self.exponent * np.log1p(u)
            return -np.expm1(left), self.exponent * np.exp(left) / (1.0 + u)
        if not u > -1.0:
            return math.nan, math.nan
        left = -self.exponent * math.log1p(u)
        return -math.expm1(left), self.exponent * math.exp(left) / (1.0 + u)

    def work(self, u: Number) -> Number:
        g = self.exponent - 1.0
        return np.expm1(-g * np.log1p(u)) / g


@dataclass(frozen=True)
class SealedGas:
    """A gas by the state in which it was sealed: pressure and swelling then, and the chamber it shares.

    In differences from that state, because beside a large chamber, or a high ambient pressure, (p + pₑ)V
    hardly changes at all.
    """

    pressure: Number
    swelling: Number
    ambient: Number
    chamber: Number
    expansion: Expansion

    spectrum = COUPLED

    @cached_property
    def _volume(self) -> Number:
        return self.swelling + self.chamber

    def _growth(self, swelling: Number) -> Number:
        return (swelling - self.swelling) / self._volume

    def defect(self, pressure: Number, cubes: Number) -> Number:
        fall, _ = self.expansion.fall(self._growth(cubes / 3.0))
        return pressure - self.pressure + (self.pressure + self.ambient) * fall

    def term_size(self, pressure: Number, cubes: Number) -> Number:
        fall, _ = self.expansion.fall(self._growth(cubes / 3.0))
        return abs(pressure) + abs(self.pressure) + (self.pressure + self.ambient) * abs(fall)

    def linearised(self, pressure: Number, cubes: Number) -> tuple[Number, Number, Number]:
        fall, slope = self.expansion.fall(self._growth(cubes / 3.0))
        absolute = self.pressure + self.ambient
        return pressure - self.pressure + absolute * fall, 1.0, absolute * slope / self._volume

    def stiffness(self, cubes: Number) -> Number:
        return self.linearised(0.0, cubes)[2]

    def energy(self, swelling: Number) -> Number:
        u = self._growth(swelling)
        work = self.expansion.work(u)
        return self._volume * (self.pressure * work + self.ambient * (work + u))

    def flow_pressure(
        self,
        membranes: Sequence[AnyMembrane],
        walls: Sequence[Membrane],
        stretches: Sequence[Number],
        v: Number,
    ) -> Number:
        return -self.defect(0.0, _cubes(walls, stretches))

    def flow_law(
        self, walls: Sequence[Membrane], y: Sequence[float], residual: list[Number], rows: list[list[Number]]
    ) -> tuple[Number, list[Number]]:
        return residual[-1], rows[-1]

    def admitted(
        self, membranes: Sequence[AnyMembrane], walls: Sequence[Membrane], y: list[float]
    ) -> list[float]:
        return y


@dataclass(frozen=True)
class Liquid:
    """V = V₀ of the balloons, whatever the pressure. A rigid chamber full of it makes no difference."""

    volume: Number

    spectrum = CONSTRAINED

    def defect(self, pressure: Number, cubes: Number) -> Number:
        return cubes / (3.0 * self.volume) - 1.0

    def term_size(self, pressure: Number, cubes: Number) -> Number:
        return 2.0

    def linearised(self, pressure: Number, cubes: Number) -> tuple[Number, Number, Number]:
        return cubes / (3.0 * self.volume) - 1.0, 0.0, 1.0 / self.volume

    def stiffness(self, cubes: Number) -> Number:
        return 1.0

    def energy(self, swelling: Number) -> Number:
        return 0.0

    # The constraint V = V₀ does not contain the pressure. Its derivative in time does: with aᵢ = ∂V/∂λᵢ,
    #     Σ aᵢ gᵢ(λ, p) = κ (V − V₀),
    # where the right-hand side, zero on paper, draws the volume back to V₀ at the rate κ (J. Baumgarte,
    # Comput. Methods Appl. Mech. Eng. 1 (1972) 1–16), so that the errors of the integration do not add up.

    def flow_pressure(
        self,
        membranes: Sequence[AnyMembrane],
        walls: Sequence[Membrane],
        stretches: Sequence[Number],
        v: Number,
    ) -> Number:
        push: Number = 0.0
        per_pressure: Number = 0.0
        cubes: Number = 0.0
        for membrane, wall, x in zip(membranes, walls, stretches, strict=True):
            area = wall.cube * x * x
            weight = area * wall.modulus
            push = push + weight * membrane.force(x, 0.0, v) / wall.elastomer.pole_form(x)[1]
            per_pressure = per_pressure + weight * wall.pressure_load * x * x
            cubes = cubes + area * x
        return (push - _pace(walls) * (cubes / 3.0 - self.volume)) / per_pressure

    def flow_law(
        self, walls: Sequence[Membrane], y: Sequence[float], residual: list[Number], rows: list[list[Number]]
    ) -> tuple[Number, list[Number]]:
        count, pace = len(walls), _pace(walls)
        value = -pace * residual[-1] * self.volume
        slopes: list[Number] = [0.0] * (count + 1)
        for i, (wall, x) in enumerate(zip(walls, y, strict=False)):
            denominator = wall.elastomer.pole_form(x)[1]
            denominator_slope = wall.elastomer.pole_form_slope(x)[1]
            area = wall.cube * x * x
            weight = area * wall.modulus / denominator
            value += weight * residual[i]
            slopes[i] = (
                weight * (rows[i][i] + residual[i] * (2.0 / x - denominator_slope / denominator))
                - pace * area
            )
            slopes[-1] += weight * rows[i][count]
        return value, slopes

    def admitted(
        self, membranes: Sequence[AnyMembrane], walls: Sequence[Membrane], y: list[float]
    ) -> list[float]:
        stretches = y[: len(walls)]
        for _ in range(30):
            missing = self.volume - _cubes(walls, stretches) / 3.0
            # Towards the volume where it costs least: a wall near its stretch limit hardly moves.
            change = [
                wall.cube * x * x * wall.elastomer.pole_form(x)[1] / wall.weight
                for wall, x in zip(walls, stretches, strict=True)
            ]
            gain = sum(wall.cube * x * x * c for wall, x, c in zip(walls, stretches, change, strict=True))
            stretches = [x + missing / gain * c for x, c in zip(stretches, change, strict=True)]
            if abs(missing) <= 1e-15 * self.volume:
                break
        return [*stretches, self.flow_pressure(membranes, walls, stretches, y[-1]), y[-1]]


class Law(Protocol):
    """What a scenario says of the contents; arrays where states are arrays. `volume` includes the chamber."""

    @property
    def ambient(self) -> Number: ...
    @property
    def chamber(self) -> Number: ...
    @property
    def spectrum(self) -> Spectrum: ...

    def amount(self, pressure: Number, volume: Number) -> Number:
        """What stays when the valve is closed in a state: n, or for a liquid the volume."""
        ...

    def sealed(self, pressure: Number, swelling: Number) -> Contents:
        """The valve closed in a state; `swelling` is the balloons' volume, without the chamber."""
        ...

    def energy(self, amount: FloatArray, pressure: FloatArray, volume: FloatArray) -> FloatArray:
        """The share of the contents and their surroundings in Π."""
        ...

    def stiffness(self, amount: FloatArray, pressure: FloatArray, volume: FloatArray) -> FloatArray:
        """−dp/dV; 1 for a liquid, whose own is infinite and replaced by a constraint."""
        ...


@dataclass(frozen=True)
class Isothermal:
    """An ideal gas at the temperature of its surroundings."""

    ambient: Number
    chamber: Number = 0.0

    spectrum = COUPLED

    def amount(self, pressure: Number, volume: Number) -> Number:
        return (pressure + self.ambient) * volume

    def sealed(self, pressure: Number, swelling: Number) -> IdealGas | SealedGas:
        if self.chamber != 0.0:
            return SealedGas(pressure, swelling, self.ambient, self.chamber, Isotherm())
        # Sealed at no pressure in a vacuum there is no gas; tension is lost before its law is ever used.
        amount = self.amount(pressure, swelling)
        return IdealGas(_TINY if amount == 0.0 else amount, self.ambient)

    def energy(self, amount: FloatArray, pressure: FloatArray, volume: FloatArray) -> FloatArray:
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.where(amount > 0.0, -amount * np.log(volume), 0.0) + self.ambient * volume)

    def stiffness(self, amount: FloatArray, pressure: FloatArray, volume: FloatArray) -> FloatArray:
        return np.asarray(amount / volume**2)


@dataclass(frozen=True)
class Adiabatic:
    """An ideal gas that exchanges no heat while sealed; it is sealed at the temperature of its supply."""

    ambient: Number
    chamber: Number = 0.0
    exponent: Number = 1.4

    spectrum = COUPLED

    def amount(self, pressure: Number, volume: Number) -> Number:
        return (pressure + self.ambient) * volume

    def sealed(self, pressure: Number, swelling: Number) -> SealedGas:
        return SealedGas(pressure, swelling, self.ambient, self.chamber, Adiabat(self.exponent))

    def energy(self, amount: FloatArray, pressure: FloatArray, volume: FloatArray) -> FloatArray:
        inner = (pressure + self.ambient) * volume / (self.exponent - 1.0)
        return np.asarray(inner + self.ambient * volume)

    def stiffness(self, amount: FloatArray, pressure: FloatArray, volume: FloatArray) -> FloatArray:
        return np.asarray(self.exponent * (pressure + self.ambient) / volume)


@dataclass(frozen=True)
class Incompressible:
    """A liquid: its volume stays. The ambient pressure and a rigid chamber make no difference."""

    ambient: Number
    chamber: Number = 0.0

    spectrum = CONSTRAINED

    def amount(self, pressure: Number, volume: Number) -> Number:
        return volume

    def sealed(self, pressure: Number, swelling: Number) -> Liquid:
        return Liquid(swelling)

    def energy(self, amount: FloatArray, pressure: FloatArray, volume: FloatArray) -> FloatArray:
        return np.zeros_like(volume)

    def stiffness(self, amount: FloatArray, pressure: FloatArray, volume: FloatArray) -> FloatArray:
        return np.ones_like(volume)


def _cubes(walls: Sequence[Membrane], stretches: Sequence[Number]) -> Number:
    """Σ r³λ³."""
    total: Number = 0.0
    for wall, x in zip(walls, stretches, strict=True):
        total = total + wall.cube * x * x * x
    return total


def _pace(walls: Sequence[Membrane]) -> float:
    """A rate of the flow: the largest modulus."""
    return max(wall.modulus for wall in walls)
