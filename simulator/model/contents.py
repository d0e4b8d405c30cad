"""What the balloons share: a gas at one temperature, a gas without exchange of heat, or a liquid.

A *law* (`Gas`, `Incompressible`) is what a scenario names. Closing the valve makes of it the *contents*
(`IdealGas`, `SealedGas`, `Liquid`): one equation between pressure and volume, chosen when the equations are
composed. A gas is written in products (`IdealGas`) or, where these would hardly change, in differences
from the state in which it was sealed (`SealedGas`).

Volumes are over 4πR³. The balloons' own is called `swelling`; the equations sum Σ r³λ³, three times that,
called `cubes` here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from simulator.model.coupling import COUPLED, Spectrum
from simulator.model.expansion import ISOTHERM, Expansion, work_against
from simulator.model.liquid import Liquid
from simulator.model.membranes import sum_of_cubes

if TYPE_CHECKING:
    from simulator.model.membranes import AnyMembrane, Membrane

FloatArray = NDArray[np.float64]
Number = Any


class Contents(Protocol):
    """What is sealed in, as the equations need it."""

    @property
    def spectrum(self) -> Spectrum:
        """How it couples the balloons' stabilities."""
        ...

    @property
    def is_open(self) -> bool:
        """Whether more can come in and go out."""
        ...

    @property
    def slackens(self) -> bool:
        """Whether the excess pressure can fall to 0: in a vacuum it cannot, or is 0 from the beginning."""
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


def _gas_flow_law(
    gas: Contents,
    walls: Sequence[Membrane],
    y: Sequence[float],
    residual: list[Number],
    rows: list[list[Number]],
) -> tuple[Number, list[Number]]:
    """Of a gas: its own equation, which is linear in p."""
    return residual[-1], rows[-1]


def _any_volume(
    gas: Contents, membranes: Sequence[AnyMembrane], walls: Sequence[Membrane], y: list[float]
) -> list[float]:
    """Of a gas: it takes any volume."""
    return y


@dataclass(frozen=True)
class IdealGas:
    """(p + pₑ)V = n, in the balloons alone."""

    amount: Number
    ambient: Number

    spectrum = COUPLED
    is_open = False

    @property
    def slackens(self) -> bool:
        return bool(self.ambient > 0.0)

    flow_law = _gas_flow_law
    admitted = _any_volume

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
        # From the volume V₀ = n/(1 + pₑ), at which p = 1.
        start = self.amount / (1.0 + self.ambient)
        return work_against(ISOTHERM, 1.0, self.ambient, start, (swelling - start) / start, swelling / start)

    def flow_pressure(
        self,
        membranes: Sequence[AnyMembrane],
        walls: Sequence[Membrane],
        stretches: Sequence[Number],
        v: Number,
    ) -> Number:
        return 3.0 * self.amount / sum_of_cubes(walls, stretches) - self.ambient


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
    is_open = False

    @property
    def slackens(self) -> bool:
        return bool(self.ambient > 0.0)

    flow_law = _gas_flow_law
    admitted = _any_volume

    @cached_property
    def _volume(self) -> Number:
        return self.swelling + self.chamber

    def _growth(self, swelling: Number) -> tuple[Number, Number]:
        """By which fraction the volume has grown, and to how much of what it was."""
        return (swelling - self.swelling) / self._volume, (swelling + self.chamber) / self._volume

    def defect(self, pressure: Number, cubes: Number) -> Number:
        left, lost, _ = self.expansion.fall(*self._growth(cubes / 3.0))
        return pressure - self.pressure * left + self.ambient * lost

    def term_size(self, pressure: Number, cubes: Number) -> Number:
        left, lost, _ = self.expansion.fall(*self._growth(cubes / 3.0))
        return abs(pressure) + self.pressure * abs(left) + self.ambient * abs(lost)

    def linearised(self, pressure: Number, cubes: Number) -> tuple[Number, Number, Number]:
        left, lost, slope = self.expansion.fall(*self._growth(cubes / 3.0))
        defect = pressure - self.pressure * left + self.ambient * lost
        return defect, 1.0, (self.pressure + self.ambient) * slope / self._volume

    def stiffness(self, cubes: Number) -> Number:
        return self.linearised(0.0, cubes)[2]

    def energy(self, swelling: Number) -> Number:
        return work_against(
            self.expansion, self.pressure, self.ambient, self._volume, *self._growth(swelling)
        )

    def flow_pressure(
        self,
        membranes: Sequence[AnyMembrane],
        walls: Sequence[Membrane],
        stretches: Sequence[Number],
        v: Number,
    ) -> Number:
        return -self.defect(0.0, sum_of_cubes(walls, stretches))


@dataclass(frozen=True)
class Supply:
    """Gas or liquid from a supply at one excess pressure: the valve is open."""

    pressure: Number

    spectrum = COUPLED
    is_open = True
    slackens = False
    flow_law = _gas_flow_law
    admitted = _any_volume

    def defect(self, pressure: Number, cubes: Number) -> Number:
        return pressure - self.pressure + 0.0 * cubes

    def term_size(self, pressure: Number, cubes: Number) -> Number:
        return abs(pressure) + abs(self.pressure)

    def linearised(self, pressure: Number, cubes: Number) -> tuple[Number, Number, Number]:
        return pressure - self.pressure, 1.0, 0.0

    def stiffness(self, cubes: Number) -> Number:
        return 0.0 * cubes

    def energy(self, swelling: Number) -> Number:
        return -self.pressure * swelling

    def flow_pressure(
        self,
        membranes: Sequence[AnyMembrane],
        walls: Sequence[Membrane],
        stretches: Sequence[Number],
        v: Number,
    ) -> Number:
        return self.pressure


class Law(Protocol):
    """What a scenario says of the contents; numbers or arrays. `volume` includes the chamber."""

    @property
    def ambient(self) -> Number:
        """Ambient pressure, over μH/R."""
        ...

    @property
    def chamber(self) -> Number:
        """Volume of the chamber, over 4πR³."""
        ...

    def amount(self, pressure: Number, volume: Number) -> Number:
        """What stays when the valve is closed in a state: n, or for a liquid the volume."""
        ...

    def sealed(self, pressure: Number, swelling: Number) -> Contents:
        """The valve closed in a state, or in each of several.

        `swelling` is the balloons' volume, without the chamber.
        """
        ...

    def energy(self, amount: FloatArray, pressure: FloatArray, volume: FloatArray) -> FloatArray:
        """The share of the contents and their surroundings in Π."""
        ...

    def formula(self) -> str:
        """The law as an equation, in words."""
        ...


@dataclass(frozen=True)
class Gas:
    """An ideal gas, sealed at the temperature of its surroundings or its supply, and what is kept then."""

    ambient: Number
    chamber: Number = 0.0
    expansion: Expansion = ISOTHERM

    def amount(self, pressure: Number, volume: Number) -> Number:
        return (pressure + self.ambient) * volume

    def sealed(self, pressure: Number, swelling: Number) -> IdealGas | SealedGas:
        amount = self.amount(pressure, swelling)
        # Sealed at no pressure in a vacuum there is no gas, and nothing to divide by.
        if self.chamber != 0.0 or self.expansion != ISOTHERM or np.any(amount == 0.0):
            return SealedGas(pressure, swelling, self.ambient, self.chamber, self.expansion)
        return IdealGas(amount, self.ambient)

    def energy(self, amount: FloatArray, pressure: FloatArray, volume: FloatArray) -> FloatArray:
        own = self.expansion.energy(amount, pressure + self.ambient, volume)
        return np.asarray(own + self.ambient * volume)

    def formula(self) -> str:
        volume = f"({self.chamber:g} + Σ r³λ³/3)" if self.chamber else "Σ r³λ³/3"
        return f"gas: {self.expansion.formula(f'(p + {self.ambient:g})', volume)}"


@dataclass(frozen=True)
class Incompressible:
    """A liquid: its volume stays. The ambient pressure and a rigid chamber make no difference."""

    ambient: Number
    chamber: Number = 0.0

    def amount(self, pressure: Number, volume: Number) -> Number:
        return volume

    def sealed(self, pressure: Number, swelling: Number) -> Liquid:
        return Liquid(swelling)

    def energy(self, amount: FloatArray, pressure: FloatArray, volume: FloatArray) -> FloatArray:
        return np.zeros_like(volume)

    def formula(self) -> str:
        return "liquid: Σ r³λ³/3 = constant"
