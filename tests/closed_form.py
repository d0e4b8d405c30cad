"""The paper's sealed pair in 40 digits, solved by mpmath from the printed equations: what must come out.

Independent of the simulator. Positions are roots of derivatives, never minima (those lose half the digits).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import mpmath as mp

mp.mp.dps = 40
ONE = mp.mpf(1)


def force(stretch, J=100):
    """f(λ) of the Gent elastomer (the paper's Eq. 3, with λ⁻⁴ in the logarithm's argument)."""
    return 2 * J * (stretch - stretch**-5) / (J - (2 * stretch**2 + stretch**-4 - 3))


def inflated(load):
    """Stretch of the first state met on raising the load p r from zero."""
    ends = (
        (ONE + mp.mpf("1e-12"), mp.mpf("1.39")) if load < mp.mpf("1.2536") else (mp.mpf(6), mp.mpf("7.1763"))
    )
    return mp.findroot(lambda x: force(x) / x**2 - load, ends, solver="anderson")


@dataclass(frozen=True)
class Pair:
    """Radius ratio m, ambient pressure and inflation pressure, as decimal strings."""

    radius: str
    ambient: str
    inflation: str

    @cached_property
    def numbers(self):
        m, ambient, inflation = (mp.mpf(x) for x in (self.radius, self.ambient, self.inflation))
        volume = (m**3 * inflated(inflation * m) ** 3 + inflated(inflation) ** 3) / 3
        return m, ambient, (inflation + ambient) * volume

    def at(self, active, passive):
        """(φ², λ₂, p) of the equilibrium with active stretch λ₁, from a guess of λ₂."""
        m, ambient, gas = self.numbers

        def excess(x):
            return (force(x) / x**2 + ambient) * (m**3 * active**3 + x**3) / 3 - gas

        passive = mp.findroot(excess, mp.mpf(passive))
        pressure = force(passive) / passive**2
        return (force(active) - m * pressure * active**2) / (2 * active**3), passive, pressure

    def limit_point(self, active, passive):
        """(φ, λ₁, λ₂, p) of the limit point near a guess."""
        x = mp.findroot(lambda a: mp.diff(lambda b: self.at(b, passive)[0], a), mp.mpf(active))
        square, other, pressure = self.at(x, passive)
        return mp.sqrt(square), x, other, pressure

    def state(self, voltage, active, passive):
        """(λ₁, λ₂, p) of the equilibrium at a voltage near a guess."""
        x = mp.findroot(lambda a: self.at(a, passive)[0] - voltage**2, mp.mpf(active))
        return x, *self.at(x, passive)[1:]

    def slack(self):
        """(φ, λ₁) of the state without pressure, where λ₂ = 1."""
        m, ambient, gas = self.numbers
        x = ((3 * gas / ambient - 1) / m**3) ** (ONE / 3)
        return mp.sqrt(force(x) / (2 * x**3)), x
