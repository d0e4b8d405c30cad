"""How a sealed gas expands: at the temperature of its surroundings, or without exchange of heat.

Functions of the fraction u by which the volume has grown since the gas was sealed, u = V/V₀ − 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
# A float, a complex number or an array of either.
Number = Any


class Expansion(Protocol):
    """How the absolute pressure falls as the volume grows by the fraction u from where it was sealed."""

    def fall(self, u: Number) -> tuple[Number, Number]:
        """The fraction of the absolute pressure that is lost, and its derivative in u."""
        ...

    def work(self, u: Number) -> Number:
        """−∫ of the fraction of the pressure that is left, from 0 to u."""
        ...

    def energy(self, amount: FloatArray, absolute: FloatArray, volume: FloatArray) -> FloatArray:
        """−∫(p + pₑ) dV of states with the amount n = (p + pₑ)V at sealing, up to a constant."""
        ...

    def formula(self, pressure: str, volume: str) -> str:
        """The law as an equation, in words."""
        ...


@dataclass(frozen=True)
class Isotherm:
    """Pressure times volume stays."""

    def fall(self, u: Number) -> tuple[Number, Number]:
        return u / (1.0 + u), 1.0 / ((1.0 + u) * (1.0 + u))

    def work(self, u: Number) -> Number:
        return -np.log1p(u)

    def energy(self, amount: FloatArray, absolute: FloatArray, volume: FloatArray) -> FloatArray:
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.where(amount > 0.0, -amount * np.log(volume), 0.0))

    def formula(self, pressure: str, volume: str) -> str:
        return f"{pressure} {volume} = n"


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

    def energy(self, amount: FloatArray, absolute: FloatArray, volume: FloatArray) -> FloatArray:
        return np.asarray(absolute * volume / (self.exponent - 1.0))

    def formula(self, pressure: str, volume: str) -> str:
        bracketed = volume if volume.startswith("(") else f"({volume})"
        return f"{pressure} {bracketed}^{self.exponent:g} = constant"


ISOTHERM = Isotherm()


def work_against(
    expansion: Expansion, pressure: Number, ambient: Number, volume: Number, u: Number
) -> Number:
    """−∫p dV from a volume, at an excess pressure, to (1 + u) times that: the large parts cancel on paper."""
    work = expansion.work(u)
    return volume * (pressure * work + ambient * (work + u))
