"""One balloon without a voltage: its inflation curve, and what it does as the pressure comes and goes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np

from simulator.model.elastomers import Elastomer, Number
from tests.oracle.closed_form.roots import all_roots, bracketed, clustered

GRID = 800  # points of the first scans
UNBOUNDED = 1e4  # a balloon that never stiffens is followed to this stretch


@dataclass(frozen=True)
class Balloon:
    """One balloon: its elastomer, and its numbers as ratios to the reference balloon.

    `breakdown` is the strength of its film, a true field over √(μ/ε); None for a film that never breaks.
    """

    elastomer: Elastomer
    radius: float = 1.0
    thickness: float = 1.0
    modulus: float = 1.0
    permittivity: float = 1.0
    breakdown: float | None = None

    @property
    def pressure_load(self) -> float:
        """r/(hk): without a voltage, f(λ)/λ² = r/(hk) p."""
        return self.radius / (self.thickness * self.modulus)

    @property
    def electric_load(self) -> float:
        """2e/(h²k), the factor of φ²λ³ beside f(λ)."""
        return 2.0 * self.permittivity / (self.thickness**2 * self.modulus)

    @property
    def cube(self) -> float:
        """r³; the balloon's volume is r³λ³/3 over 4πR³."""
        return self.radius**3


def balloon_pressure(balloon: Balloon, stretch: Number) -> Number:
    """p(λ) = khf(λ)/(rλ²) of a balloon without a voltage, over μH/R."""
    numerator, denominator = balloon.elastomer.pole_form(stretch)
    return numerator / (denominator * balloon.pressure_load * stretch * stretch)


class Extremum(NamedTuple):
    """A peak or a valley of a balloon's inflation curve."""

    kind: Literal["peak", "valley"]
    stretch: float
    pressure: float


@lru_cache(maxsize=64)
def inflation_extrema(balloon: Balloon) -> tuple[Extremum, ...]:
    """Peaks and valleys of p(λ) for λ > 1, by rising stretch; found as roots of dp/dλ.

    Empty for a balloon that inflates without a snap (Gent: J_lim < 17.638).
    """
    top = min(balloon.elastomer.stretch_limit, UNBOUNDED)
    grid = 1.0 + (top - 1.0) * clustered(GRID)

    def slope(x: Number) -> Number:
        n, d = balloon.elastomer.pole_form(x)
        n1, d1 = balloon.elastomer.pole_form_slope(x)
        return (n1 * d - n * d1) * x - 2.0 * n * d  # D²λ³ d(f/λ²)/dλ

    found = []
    for x in all_roots(slope, grid):
        kind: Literal["peak", "valley"] = (
            "peak" if slope(x * (1 - 1e-7)) > slope(x * (1 + 1e-7)) else "valley"
        )
        found.append(Extremum(kind, float(x), float(balloon_pressure(balloon, x))))
    return tuple(found)


def stretches_at(balloon: Balloon, pressure: float) -> tuple[float, ...]:
    """All stretches λ ≥ 1 at which a balloon without a voltage is in equilibrium with a pressure, rising."""
    if pressure == 0.0:
        return (1.0,)
    limit = balloon.elastomer.stretch_limit
    extrema = inflation_extrema(balloon)
    corners = [1.0, *(e.stretch for e in extrema), min(limit, UNBOUNDED)]
    values = [0.0, *(e.pressure for e in extrema), np.inf if np.isfinite(limit) else 0.0]
    if not np.isfinite(limit):
        values[-1] = float(balloon_pressure(balloon, UNBOUNDED))

    def excess(x: Number) -> Number:
        n, d = balloon.elastomer.pole_form(x)
        return n - d * balloon.pressure_load * pressure * x * x

    found: list[float] = []
    for low, high, first, last in zip(corners, corners[1:], values, values[1:], strict=False):
        ends = sorted((first, last))
        if ends[0] <= pressure <= ends[1]:
            if pressure == first:
                root = low
            elif pressure == last:
                root = high
            else:
                root = float(bracketed(excess, np.array([low]), np.array([high]), np.sign(first - last))[0])
            if not found or root != found[-1]:
                found.append(root)
    return tuple(found)


def inflated_stretch(balloon: Balloon, pressure: float) -> float:
    """The inflated state: the first one met on raising the pressure from zero, the smallest root.

    Raises
    ------
    ValueError
        If there is none: the balloon runs away.
    """
    roots = stretches_at(balloon, pressure)
    if not roots:
        raise ValueError(f"no equilibrium at the pressure {pressure!r}")
    return roots[0]


class InflationSnap(NamedTuple):
    """A mechanical snap while the valve is open: at which pressure, from which stretch to which.

    `after` is None for a runaway. `leg` counts the pressures of the sequence from 0.
    """

    leg: int
    pressure: float
    before: float
    after: float | None


def inflation_history(
    balloon: Balloon, pressures: Iterable[float]
) -> tuple[float, tuple[InflationSnap, ...]]:
    """Quasi-static inflation and deflation, from the stress-free state, through a sequence of pressures.

    Returns the stretch at its end and the snaps on the way; a runaway ends it.
    """
    extrema = inflation_extrema(balloon)
    stretch, now = 1.0, 0.0
    snaps: list[InflationSnap] = []
    for leg, target in enumerate(pressures):
        while True:
            wanted = "peak" if target > now else "valley"
            ahead = [e for e in extrema if e.kind == wanted]
            # A rising state is stopped by the next peak beyond it, a falling one by the next valley below.
            stops = [e for e in ahead if (e.stretch - stretch) * (target - now) >= 0.0]
            stop = (stops[0] if target > now else stops[-1]) if stops else None
            if stop is None or (stop.pressure - target) * (target - now) >= 0.0:
                break
            roots = stretches_at(balloon, stop.pressure)
            if target > now:
                landing = next((x for x in roots if x > stop.stretch * (1.0 + 1e-9)), None)
            else:
                landing = next((x for x in reversed(roots) if x < stop.stretch * (1.0 - 1e-9)), None)
            snaps.append(InflationSnap(leg, stop.pressure, stop.stretch, landing))
            if landing is None:
                return stop.stretch, tuple(snaps)
            stretch, now = landing, stop.pressure
        # The stable root on the rising branch that the state is on.
        low = max((e.stretch for e in extrema if e.kind == "valley" and e.stretch <= stretch), default=1.0)
        high = min((e.stretch for e in extrema if e.kind == "peak" and e.stretch >= stretch), default=np.inf)
        stretch = next(x for x in stretches_at(balloon, target) if low <= x <= high)
        now = target
    return stretch, tuple(snaps)
