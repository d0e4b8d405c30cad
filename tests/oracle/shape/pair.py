"""Where the active balloon of the paper's sealed pair loses the sphere, in 40 digits.

Of an equilibrium with s = 0 everything is explicit in λ₁: φ² from s, the pressure from the active balloon's
balance, λ₂ from the gas law. What is left is one equation, the balance of the passive balloon.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import mpmath as mp
import numpy as np

DIGITS = 40
SCAN = 2000  # intervals of λ₁ searched for a change of sign


@dataclass(frozen=True)
class Loss:
    """An equilibrium with s = 0 that is stable as a pair of spheres.

    Parameters
    ----------
    voltage, active, passive, pressure : mpf
        φ, λ₁, λ₂, p.
    rising : bool
        Whether s falls through zero as the voltage rises (or else as it falls).
    """

    voltage: mp.mpf
    active: mp.mpf
    passive: mp.mpf
    pressure: mp.mpf
    rising: bool


@dataclass(frozen=True)
class Pair:
    """Gent balloons; radius m of the active one, ambient pressure, inflation pressure, as decimal strings."""

    radius: str
    ambient: str
    inflation: str
    limit: int = 100

    @cached_property
    def content(self) -> tuple[mp.mpf, mp.mpf, mp.mpf]:
        """(m, pₑ, n): the valve is closed in the first state met on raising the pressure from zero."""
        with mp.workdps(DIGITS):
            m, ambient, pressure = (mp.mpf(x) for x in (self.radius, self.ambient, self.inflation))
            volume = (m**3 * self._inflated(pressure * m) ** 3 + self._inflated(pressure) ** 3) / 3
            return m, ambient, (pressure + ambient) * volume

    def force(self, stretch: mp.mpf) -> mp.mpf:
        """f(λ)."""
        return 2 * (stretch - stretch**-5) / self._left(stretch)

    def slope(self, stretch: mp.mpf) -> mp.mpf:
        """f′(λ)."""
        left = self._left(stretch)
        return 2 * (1 + 5 * stretch**-6) / left + 8 * (stretch - stretch**-5) ** 2 / (self.limit * left**2)

    def at(self, active: mp.mpf) -> tuple[mp.mpf, mp.mpf, mp.mpf]:
        """(φ², λ₂³, p) of the state with s = 0 that balances the active balloon and the gas."""
        m, ambient, gas = self.content
        f, df = self.force(active), self.slope(active)
        pressure = (3 * f - active * df) / (2 * m * active**2)
        return (
            (df - f / active) / (4 * active**2),
            3 * gas / (pressure + ambient) - m**3 * active**3,
            pressure,
        )

    def excess(self, active: mp.mpf) -> mp.mpf | None:
        """The passive balloon's balance in that state, free of its pole; None without a tension (p ≤ 0).

        Where the gas leaves the passive balloon less than its unstretched volume, that of λ₂ = 1, which is
        negative: so no change of sign is missed beside the end of that range.
        """
        _, cube, pressure = self.at(active)
        return self._balance(mp.cbrt(max(cube, mp.mpf(1))), pressure) if pressure > 0 else None

    def losses(self) -> list[Loss]:
        """All stable equilibria with s = 0, by λ₁. (A pair of them closer than 0.003 would go unseen.)"""
        end = float(mp.findroot(self._left, mp.sqrt(mp.mpf(self.limit + 3) / 2)))
        grid = np.linspace(1.0, end, SCAN + 1)[1:-1]
        found = []
        with mp.workdps(DIGITS):
            values = [self.excess(mp.mpf(float(x))) for x in grid]
            for (x, before), (y, after) in pairwise(zip(grid, values, strict=True)):
                if before is not None and after is not None and before * after <= 0:
                    root = mp.findroot(self.excess, (mp.mpf(float(x)), mp.mpf(float(y))), solver="bisect")
                    loss = self._classified(root)
                    found += [loss] if loss else []
        return found

    def _left(self, stretch: mp.mpf) -> mp.mpf:
        return 1 - (2 * stretch**2 + stretch**-4 - 3) / mp.mpf(self.limit)

    def _balance(self, stretch: mp.mpf, load: mp.mpf) -> mp.mpf:
        """(f − p r λ²)(1 − I/J)."""
        return 2 * (stretch - stretch**-5) - load * stretch**2 * self._left(stretch)

    def _inflated(self, load: mp.mpf) -> mp.mpf:
        peak, valley = (
            mp.findroot(lambda x: x * self.slope(x) - 2 * self.force(x), mp.mpf(x)) for x in ("1.4", "4.1")
        )
        below = load < self.force(peak) / peak**2
        ends = (1 + mp.mpf("1e-20"), peak) if below else (valley, mp.sqrt(mp.mpf(self.limit + 3) / 2))
        return mp.findroot(lambda x: self._balance(x, load), ends, solver="anderson")

    def _classified(self, active: mp.mpf) -> Loss | None:
        """The loss at λ₁, None where the pair of spheres is unstable."""
        m, ambient, _ = self.content
        square, cube, pressure = self.at(active)
        passive = mp.cbrt(cube)
        volume = (m**3 * active**3 + cube) / 3
        a = mp.matrix([m**3 * active**2, passive**2])
        own = self.slope(active) - 2 * m * pressure * active - 6 * square * active**2
        H = (
            mp.diag([m**2 * own, self.slope(passive) - 2 * pressure * passive])
            + (pressure + ambient) / volume * a * a.T
        )
        if H[0, 0] <= 0 or mp.det(H) <= 0:
            return None
        climb = (H**-1)[0, 0] * 2 * m**2 * active**3  # dλ₁/dφ² along the branch
        curvature = mp.diff(lambda x: self.slope(x) - self.force(x) / x, active) - 8 * square * active
        return Loss(mp.sqrt(square), active, passive, pressure, bool(curvature * climb < 4 * active**2))
