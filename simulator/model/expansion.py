"""How a sealed gas expands: at the temperature of its surroundings, or without exchange of heat.

Functions of the fraction u by which the volume has grown since the gas was sealed, u = V/V₀ − 1. The ratio
V/V₀ is given beside it: where u is near −1 it has digits that 1 + u has lost.
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

    def fall(self, u: Number, ratio: Number) -> tuple[Number, Number, Number]:
        """The fractions of the absolute pressure that are left and lost, and the derivative of that in u."""
        ...

    def work(self, u: Number, ratio: Number) -> Number:
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

    def fall(self, u: Number, ratio: Number) -> tuple[Number, Number, Number]:
        return 1.0 / ratio, u / ratio, 1.0 / (ratio * ratio)

    def work(self, u: Number, ratio: Number) -> Number:
        return -_logarithm(u, ratio)

    def energy(self, amount: FloatArray, absolute: FloatArray, volume: FloatArray) -> FloatArray:
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.where(amount > 0.0, -amount * np.log(volume), 0.0))

    def formula(self, pressure: str, volume: str) -> str:
        return f"{pressure} {volume} = n"


@dataclass(frozen=True)
class Adiabat:
    """Pressure times volume^γ stays."""

    exponent: Number

    def fall(self, u: Number, ratio: Number) -> tuple[Number, Number, Number]:
        if not isinstance(u, float):
            power = -self.exponent * _logarithm(u, ratio)
            left = np.exp(power)
            return left, -np.expm1(power), self.exponent * left / ratio
        if not ratio > 0.0:
            return math.nan, math.nan, math.nan
        power = -self.exponent * (math.log1p(u) if abs(u) < _SMALL else math.log(ratio))
        left = math.exp(power)
        return left, -math.expm1(power), self.exponent * left / ratio

    def work(self, u: Number, ratio: Number) -> Number:
        g = self.exponent - 1.0
        return np.expm1(-g * _logarithm(u, ratio)) / g

    def energy(self, amount: FloatArray, absolute: FloatArray, volume: FloatArray) -> FloatArray:
        return np.asarray(absolute * volume / (self.exponent - 1.0))

    def formula(self, pressure: str, volume: str) -> str:
        bracketed = volume if volume.startswith("(") else f"({volume})"
        return f"{pressure} {bracketed}^{self.exponent:g} = constant"


ISOTHERM = Isotherm()
_SMALL = 0.5  # growth below which its logarithm is that of 1 + u


def _logarithm(u: Number, ratio: Number) -> Number:
    """log V/V₀, with all digits of small growths and of small ratios."""
    small = np.abs(u) < _SMALL
    return np.where(small, np.log1p(np.where(small, u, 0.0)), np.log(np.where(small, 1.0, ratio)))[()]


def work_against(
    expansion: Expansion, pressure: Number, ambient: Number, volume: Number, u: Number, ratio: Number
) -> Number:
    """−∫p dV from a volume, at an excess pressure, to 1 + u times that: the large parts cancel on paper."""
    work = expansion.work(u, ratio)
    return volume * (pressure * work + ambient * (work + u))
