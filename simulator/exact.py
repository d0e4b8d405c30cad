"""The sealed pair's closed form: all equilibria of one active and one passive balloon on one amount of gas.

The reference that errors are measured against; it shares nothing with the simulator but the elastomers.

Given λ₂, everything else is explicit:

    p = k₂h₂f₂(λ₂)/(r₂λ₂²),    r₁³λ₁³ = 3n/(p + pₑ) − r₂³λ₂³,    φ² = (k₁f₁(λ₁) − (r₁/h₁)pλ₁²) h₁²/(2e₁λ₁³),

so all equilibria, stable or not, on whatever disconnected branch, lie on one curve over λ₂ ∈ [1, λ_lim). It
ends where tension is lost (λ₂ = 1, p = 0) and where the active balloon comes to its stretch limit (φ → ∞).

Computed that way, λ₁ loses digits where λ₂ hardly changes (a large passive balloon is a supply of constant
pressure). So λ₂ serves to find the curve and to order it, while a point of it is a triple (λ₁, λ₂, p) that
solves the two equations

    passive balance  N₂ − D₂ a₂pλ₂² = 0,    gas  (p − p₀)V + (p₀ + pₑ)(V − V₀) = 0

to rounding. f = N/D has no pole, and the gas law, as the difference from the state of sealing (subscript 0),
keeps its digits at any ambient pressure. (Where V has grown far beyond V₀, (p + pₑ)V − n does better.) φ² is
explicit in such a point, and its slope along the curve is, up to a positive factor, the determinant of the
Hessian H of Π: limit points are its roots. Once all of them are known, φ² is monotone between each two, so
every equilibrium at a given voltage is bracketed.

Accuracy, measured against 40-digit arithmetic over the range of `tests/fuzz.py` (`tests/test_exact.py`):
limit points are good to 3e-15 in the states and 1e-14 in the voltage (1e-13 next to a stretch limit, where
1/D amplifies rounding); other states to 1e-14, and next to a limit point to that over the slope dφ/dλ. Where
a snap loses its tension is good to about 1e-9.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from simulator.elastomer import Elastomer, Gent, NeoHookean, Number

FloatArray = NDArray[np.float64]
Function = Callable[[Any], Any]
CellFunction = Callable[[Any, Any], Any]

_GRID = 800  # points of the first scans
_LENGTH = 0.05  # longest piece of curve between two nodes, relative to λ and p
_ANGLE = 0.15  # sharpest turn between two nodes
_MOST_NODES = 50_000
_UNBOUNDED = 1e4  # an active balloon that never stiffens is followed to this stretch
_LOOSE = 1e-7  # for the place of a minimum: its value is then good to 1e-14 of the curvature
_SLOW = 1e-3  # a speed of the flow below which it is followed in time
_MOST_CALLS = 300_000  # of the flow's right-hand side
_STEP = 1e-40  # of complex-step derivatives


# -- balloons ------------------------------------------------------------------------------------------


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
    top = min(balloon.elastomer.stretch_limit, _UNBOUNDED)
    grid = 1.0 + (top - 1.0) * _clustered(_GRID)

    def slope(x: Number) -> Number:
        n, d = balloon.elastomer.pole_form(x)
        n1, d1 = balloon.elastomer.pole_form_slope(x)
        return (n1 * d - n * d1) * x - 2.0 * n * d  # D²λ³ d(f/λ²)/dλ

    found = []
    for x in _all_roots(slope, grid):
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
    corners = [1.0, *(e.stretch for e in extrema), min(limit, _UNBOUNDED)]
    values = [0.0, *(e.pressure for e in extrema), np.inf if np.isfinite(limit) else 0.0]
    if not np.isfinite(limit):
        values[-1] = float(balloon_pressure(balloon, _UNBOUNDED))

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
                root = float(_bracketed(excess, np.array([low]), np.array([high]), np.sign(first - last))[0])
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


# -- the pair ------------------------------------------------------------------------------------------


class State(NamedTuple):
    """A state of the pair: stretches of the active and the passive balloon, and the excess pressure."""

    active: float
    passive: float
    pressure: float


@dataclass(frozen=True)
class SealedPair:
    """One active (electroded) and one passive balloon on one fixed amount of gas, (p + pₑ)V = n.

    Attributes
    ----------
    active, passive : Balloon
    ambient : float
        Ambient pressure pₑ ≥ 0, over μH/R.
    sealed : State
        A state at which the gas was enclosed. It says how much gas there is; it need not be an equilibrium.
    """

    active: Balloon
    passive: Balloon
    ambient: float
    sealed: State

    @classmethod
    def inflated(cls, active: Balloon, passive: Balloon, ambient: float, *pressures: float) -> SealedPair:
        """The pair sealed after quasi-static inflation through the given pressures (often just one).

        Raises
        ------
        ValueError
            If a balloon runs away on the way.
        """
        ends = [inflation_history(balloon, pressures) for balloon in (active, passive)]
        if any(snap.after is None for _, snaps in ends for snap in snaps):
            raise ValueError(f"a balloon runs away on the way through the pressures {pressures!r}")
        return cls(active, passive, ambient, State(ends[0][0], ends[1][0], float(pressures[-1])))

    @classmethod
    def with_gas(cls, active: Balloon, passive: Balloon, ambient: float, amount: float) -> SealedPair:
        """The pair on the gas amount n = (p + pₑ)V, over 4πR²Hμ."""
        pressure = 3.0 * amount / (active.cube + passive.cube) - ambient
        return cls(active, passive, ambient, State(1.0, 1.0, pressure))

    @classmethod
    def from_scenario(cls, scenario: Any) -> SealedPair:
        """The pair of a scenario (see `simulator.scenario`), sealed after the `inflate` steps it begins with.

        Raises
        ------
        ValueError
            If it is not two balloons, one of them with electrodes.
        """
        balloons = sorted(scenario.balloons, key=lambda b: not b.electrodes)
        if [b.electrodes for b in balloons] != [True, False]:
            raise ValueError("the closed form needs two balloons, one of them with electrodes")
        active, passive = (_as_balloon(b) for b in balloons)
        pressures = [s.inflate for s in scenario.played_steps() if hasattr(s, "inflate")]
        return cls.inflated(active, passive, scenario.gas.ambient_pressure, *(pressures or [0.0]))

    @property
    def amount(self) -> float:
        """Gas amount n = (p + pₑ)V, over 4πR²Hμ."""
        return float((self.sealed.pressure + self.ambient) * self.volume(*self.sealed[:2]))

    def volume(self, active: Number, passive: Number) -> Number:
        """V = Σ rᵢ³λᵢ³/3, over 4πR³."""
        return (self.active.cube * active**3 + self.passive.cube * passive**3) / 3.0

    def swelling(self, active: Number, passive: Number) -> Number:
        """V − V₀, the volume gained since sealing, without cancellation."""
        a, b = self.sealed.active, self.sealed.passive
        return (
            self.active.cube * (active - a) * (active * active + active * a + a * a)
            + self.passive.cube * (passive - b) * (passive * passive + passive * b + b * b)
        ) / 3.0

    def pressure(self, active: Number, passive: Number) -> Number:
        """The gas's excess pressure n/V − pₑ at two given stretches, real or complex (no arrays)."""
        gas = self.sealed.pressure + self.ambient
        volume, start = self.volume(active, passive), self.volume(*self.sealed[:2])
        if volume.real > 2.0 * start:
            return gas * start / volume - self.ambient
        return self.sealed.pressure - gas * self.swelling(active, passive) / volume

    def forces(
        self, active: Number, passive: Number, pressure: Number, voltage: Number
    ) -> tuple[Number, Number]:
        """gᵢ of both balloons, over μH/R of the reference: dλᵢ/dt = −gᵢ is the overdamped flow."""
        out = []
        for balloon, x, phi in ((self.active, active, voltage), (self.passive, passive, 0.0)):
            n, d = balloon.elastomer.pole_form(x)
            load = balloon.pressure_load * pressure + balloon.electric_load * phi * phi * x
            out.append(balloon.modulus * (n / d - load * x * x))
        return out[0], out[1]

    def potential(self, state: State, voltage: Number) -> Number:
        """Π, with its gas terms counted from the state of sealing: −n ln(V/V₀) + pₑ(V − V₀)."""
        walls: Number = 0.0
        for balloon, x in ((self.active, state.active), (self.passive, state.passive)):
            weight = balloon.radius**2 * balloon.thickness * balloon.modulus
            walls = walls + weight * balloon.elastomer.energy(x)
        active = self.active
        capacitance = active.radius**2 * active.permittivity / active.thickness
        walls = walls - 0.5 * capacitance * voltage**2 * state.active**4
        swelling = self.swelling(state.active, state.passive)
        share = swelling / self.volume(*self.sealed[:2])
        # −n ln(1 + u) + pₑV₀u, u = (V − V₀)/V₀: the large parts cancel on paper.
        return walls - self.sealed.pressure * swelling - self.amount * (np.log1p(share) - share)

    def hessian(self, state: State, voltage: float) -> FloatArray:
        """Second derivatives of Π in the two stretches, shape (2, 2); positive definite where stable."""
        out = np.empty((2, 2))
        weights = [b.radius**2 * b.thickness for b in (self.active, self.passive)]
        for j in range(2):
            x = [complex(state.active), complex(state.passive)]
            x[j] += 1j * _STEP
            forces = self.forces(x[0], x[1], self.pressure(x[0], x[1]), voltage)
            out[:, j] = [w * g.imag / _STEP for w, g in zip(weights, forces, strict=True)]
        return 0.5 * (out + out.T)


def _as_balloon(written: Any) -> Balloon:
    chosen = written.elastomer
    elastomer: Elastomer = Gent(chosen.J_lim) if chosen.model == "gent" else NeoHookean()
    if written.breakdown and written.breakdown.law != "constant":
        raise ValueError("the closed form's histories know a constant breakdown field alone")
    strength = written.breakdown.field if written.breakdown else None
    return Balloon(
        elastomer, written.radius, written.thickness, written.modulus, written.permittivity, strength
    )


# -- the equilibrium curve -----------------------------------------------------------------------------

End = Literal["unloaded", "limit_point", "loss_of_tension", "stretch_limit", "cut"]


@dataclass(frozen=True)
class Segment:
    """A piece of the equilibrium curve between two limit points or ends; φ² is monotone on it.

    Attributes
    ----------
    nodes : (3, n) array
        Points (λ₁, λ₂, p) in order of rising φ², each to rounding.
    squares : (n,) array
        φ² at them, rising; inf at the stretch limit.
    first, last : str
        What ends it below and above: "unloaded" (φ = 0), "limit_point", "loss_of_tension", "stretch_limit"
        (φ → ∞), "cut" (an active balloon without a stretch limit, followed no further).
    unstable : int
        Number of negative eigenvalues of H on it; 0 where stable.
    """

    nodes: FloatArray
    squares: FloatArray
    first: End
    last: End
    unstable: int

    @property
    def voltages(self) -> tuple[float, float]:
        """The lowest and the highest voltage on it."""
        return float(np.sqrt(self.squares[0])), float(np.sqrt(self.squares[-1]))

    def end(self, place: Literal[0, -1]) -> State:
        """Its first or last point."""
        return State(*self.nodes[:, place].tolist())


class Equilibrium(NamedTuple):
    """An equilibrium at some voltage; `unstable` counts the negative eigenvalues of H there."""

    state: State
    voltage: float
    unstable: int


class Point(NamedTuple):
    """A special point of the curve, and its voltage."""

    state: State
    voltage: float


@dataclass(frozen=True)
class Curve:
    """All equilibria of a pair with p ≥ 0.

    Attributes
    ----------
    pair : SealedPair
    segments : tuple of Segment
        By falling λ₂ along each connected piece of the curve.
    limit_points : tuple of Point
        All of them, between stable or unstable parts.
    loss_of_tension : Point or None
        Where p = 0. There is at most one such point.
    """

    pair: SealedPair
    segments: tuple[Segment, ...]
    limit_points: tuple[Point, ...]
    loss_of_tension: Point | None


def equilibrium_curve(pair: SealedPair) -> Curve:
    """The whole equilibrium curve of a pair.

    Raises
    ------
    ValueError
        If there is no gas.
    ArithmeticError
        If the curve could not be resolved. Seen only where p < 1e-5 and the passive balloon is a thousand
        times larger, so that its stretch hardly differs from 1 and hardly changes.
    """
    if not pair.amount > 0.0:
        raise ValueError("a pair without gas has no equilibrium curve")
    segments: list[Segment] = []
    limit_points: list[Point] = []
    for first, last, nodes in _pieces(pair):
        found, folds = _segments(pair, first, last, _resolved(pair, nodes))
        segments += found
        limit_points += folds
    if not segments and pair.sealed.pressure > 0.0:
        raise ArithmeticError("the whole curve is within the rounding of the passive balloon's stretch")
    lost = next((_end_point(s) for s in segments if "loss_of_tension" in (s.first, s.last)), None)
    return Curve(pair, tuple(segments), tuple(limit_points), lost)


def _end_point(segment: Segment) -> Point:
    place: Literal[0, -1] = 0 if segment.first == "loss_of_tension" else -1
    return Point(segment.end(place), segment.voltages[place])


def states_on(pair: SealedPair, segment: Segment, voltages: Sequence[float] | FloatArray) -> FloatArray:
    """The states (λ₁, λ₂, p) on a segment at n voltages within its range, shape (3, n).

    Voltages outside the range are brought to its ends.
    """
    squares = np.asarray(voltages, dtype=np.float64) ** 2
    cell = np.clip(np.searchsorted(segment.squares, squares, side="right") - 1, 0, segment.squares.size - 2)
    low, high = segment.nodes[:, cell], segment.nodes[:, cell + 1]
    out = np.where(squares <= segment.squares[cell], low, high)
    inside = (squares > segment.squares[cell]) & (squares < segment.squares[cell + 1])
    if np.any(inside):
        wanted = squares[inside]

        def excess(y: Number, cells: Any) -> Number:
            return _excess(pair, y, wanted[cells])

        # More voltage than the low node needs: the excess of the elastic force is negative there.
        out[:, inside] = _on_cells(pair, low[:, inside], high[:, inside], excess, -np.ones(wanted.size))
    return np.asarray(out)


def equilibria(curve: Curve, voltage: float) -> tuple[Equilibrium, ...]:
    """All equilibria at a voltage, stable or not, by rising stretch of the active balloon.

    At a limit point's own voltage that point is among them twice, once for each of the two that merge in it.
    """
    square = voltage * voltage
    found = [
        Equilibrium(State(*states_on(curve.pair, s, [voltage])[:, 0].tolist()), voltage, s.unstable)
        for s in curve.segments
        if s.squares[0] <= square <= s.squares[-1]
    ]
    return tuple(sorted(found))


# Functions of points y = (λ₁, λ₂, p), rows of arrays, real or complex.


def _constraints(pair: SealedPair, y: Any) -> tuple[Any, Any, tuple[Any, Any], tuple[Any, Any, Any]]:
    """Passive balance and gas law, with their gradients; that of the balance has no part in λ₁."""
    x, z, p = y
    balloon = pair.passive
    a = balloon.pressure_load
    n, d = balloon.elastomer.pole_form(z)
    n1, d1 = balloon.elastomer.pole_form_slope(z)
    load = a * p * z * z
    gas = pair.sealed.pressure + pair.ambient
    start = pair.volume(*pair.sealed[:2])
    scale = gas * start
    volume = pair.volume(x, z)
    # Two forms of one law, each where it cancels less.
    law = np.where(
        np.real(volume) > 2.0 * start,
        (p + pair.ambient) * volume - gas * start,
        (p - pair.sealed.pressure) * volume + gas * pair.swelling(x, z),
    )
    law = law / scale
    density = (p + pair.ambient) / scale
    slopes = (density * pair.active.cube * x * x, density * pair.passive.cube * z * z, volume / scale)
    return n - d * load, law, (n1 - d1 * load - 2.0 * d * a * p * z, -d * a * z * z), slopes


def _tangent(pair: SealedPair, y: Any) -> tuple[Any, Any, Any]:
    """A tangent of the curve, towards falling λ₂."""
    _, _, (u2, u3), (v1, v2, v3) = _constraints(pair, y)
    return u2 * v3 - u3 * v2, u3 * v1, -u2 * v1


def _excess(pair: SealedPair, y: Any, square: Any) -> Any:
    """D₁g₁/k₁ at the given φ²: positive where the equilibrium takes a higher voltage."""
    x, _, p = y
    n, d = pair.active.elastomer.pole_form(x)
    return n - d * x * x * (pair.active.pressure_load * p + pair.active.electric_load * square * x)


def _square(pair: SealedPair, y: Any) -> Any:
    """φ² of a point; negative where no voltage does it."""
    x, _, p = y
    n, d = pair.active.elastomer.pole_form(x)
    with np.errstate(divide="ignore", invalid="ignore"):
        force = n / d
    return (force - pair.active.pressure_load * p * x * x) / (pair.active.electric_load * x * x * x)


def _determinant(pair: SealedPair, y: Any) -> Any:
    """det H, and the slope of φ² along `_tangent`, up to positive factors; smooth at the stretch limit."""
    x, _, p = y
    a = pair.active.pressure_load
    n, d = pair.active.elastomer.pole_form(x)
    n1, d1 = pair.active.elastomer.pole_form_slope(x)
    t1, _, t3 = _tangent(pair, y)
    return (d * n1 - n * d1 - 3.0 * n * d / x + d * d * a * p * x) * t1 - d * d * a * x * x * t3


def _determinant_slope(pair: SealedPair, y: FloatArray) -> FloatArray:
    """Derivative of `_determinant` along `_tangent`."""
    step = [a + 1j * _STEP * b for a, b in zip(y, _tangent(pair, y), strict=True)]
    return np.asarray(_determinant(pair, step).imag) / _STEP


def _projected(pair: SealedPair, guess: FloatArray, normal: FloatArray) -> FloatArray:
    """Points of the curve on planes through the guesses, all (3, n), by Newton's method to rounding."""
    y = guess
    n1, n2, n3 = normal
    last = False
    for _ in range(30):
        r, s, (u2, u3), (v1, v2, v3) = _constraints(pair, y)
        # Cramer's rule for the rows (0, u2, u3), (v1, v2, v3), (n1, n2, n3).
        c1, c2, c3 = v2 * n3 - v3 * n2, v3 * n1 - v1 * n3, v1 * n2 - v2 * n1
        det = u2 * c2 + u3 * c3
        change = np.array([r * c1 + s * (n2 * u3 - n3 * u2), r * c2 - s * n1 * u3, r * c3 + s * n1 * u2])
        change = np.asarray(change / det)
        y = np.asarray(y - change)
        if last:
            return y
        last = bool(np.all(np.abs(change) <= 1e-9 * (np.abs(y) + 1e-3)))
    return y


def _weights(pair: SealedPair, y: FloatArray) -> FloatArray:
    """Metric of the curve: relative changes of the stretches and, from a softest balloon's unit on, of p."""
    softest = min(1.0 / pair.active.pressure_load, 1.0 / pair.passive.pressure_load)
    return np.array([1.0 / y[0], 1.0 / y[1], 1.0 / (softest + np.abs(y[2]))])


def _on_cells(
    pair: SealedPair, low: FloatArray, high: FloatArray, function: CellFunction, sign: FloatArray
) -> FloatArray:
    """Roots of a function of the point, one in each piece of curve from `low` to `high`, (3, n).

    `function(y, cells)` is evaluated for some of the pieces, an index array. `sign` is its sign at `low`;
    at `high` it is the opposite.
    """
    every = np.arange(low.shape[1])
    chord = high - low
    weights = _weights(pair, low)
    normal = weights * weights * chord
    square = np.sum(normal * chord, axis=0)
    # Newton's method along the curve, from the chord's root.
    at_low, at_high = np.asarray(function(low, every)), np.asarray(function(high, every))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        share = np.clip(np.nan_to_num(at_low / (at_low - at_high), nan=0.5), 0.05, 0.95)
        y = low + share * chord
        converged = np.zeros(every.size, dtype=bool)
        for _ in range(15):
            r, s, (u2, u3), (v1, v2, v3) = _constraints(pair, y)
            t1, t2, t3 = tangent = np.array([u2 * v3 - u3 * v2, u3 * v1, -u2 * v1])
            n1, n2, n3 = weights * weights * tangent
            across = np.array(
                [
                    r * (v2 * n3 - v3 * n2) + s * (n2 * u3 - n3 * u2),
                    r * (v3 * n1 - v1 * n3) - s * n1 * u3,
                    r * (v1 * n2 - v2 * n1) + s * n1 * u2,
                ]
            ) / (t1 * n1 + t2 * n2 + t3 * n3)
            change = np.asarray(function(y + 1j * _STEP * tangent, every))
            along = change.real / (change.imag / _STEP) * tangent
            y = y - across - along
            if np.all(converged):  # once more than that
                break
            converged = np.all(np.abs(weights * along) <= 1e-11, axis=0)
        share = np.sum(normal * (y - low), axis=0) / square
        left = every[~(converged & (share > -1e-9) & (share < 1.0 + 1e-9))]
    if left.size:
        y[:, left] = _bracketed_on_cells(
            pair, low[:, left], high[:, left], lambda y, _: function(y, left), sign[left]
        )
    return np.asarray(y)


def _bracketed_on_cells(
    pair: SealedPair,
    low: FloatArray,
    high: FloatArray,
    function: CellFunction,
    sign: FloatArray,
    tolerance: float = 2.3e-16,
) -> FloatArray:
    """The same, slower: for functions without derivatives, and for what Newton's method misses."""
    chord = high - low
    normal = _weights(pair, low) ** 2 * chord

    def point(share: FloatArray) -> FloatArray:
        return _projected(pair, low + share * chord, normal)

    zero = np.zeros(chord.shape[1])
    return point(_bracketed(lambda share: function(point(share), None), zero, zero + 1.0, sign, tolerance))


def _pieces(pair: SealedPair) -> list[tuple[End | None, End | None, FloatArray]]:
    """Connected pieces of the curve with 1 ≤ λ₁ ≤ λ_lim, by falling λ₂: their ends and some nodes (3, n).

    An end is None where the curve leaves the region at λ₁ = 1, which takes φ² < 0 and is cut off later.
    """
    active, passive = pair.active, pair.passive
    gas = pair.sealed.pressure + pair.ambient
    limit = active.elastomer.stretch_limit
    far: End = "stretch_limit" if np.isfinite(limit) else "cut"
    highest = limit if np.isfinite(limit) else _UNBOUNDED

    def lacks(x: Number) -> Callable[[Number], Number]:
        """Like (p(λ₂) + pₑ)V − n with λ₁ = x, as a smooth function of λ₂."""

        def function(z: Number) -> Number:
            n, d = passive.elastomer.pole_form(z)
            slack = n / passive.pressure_load - pair.sealed.pressure * d * z * z
            return slack * pair.volume(x, z) + d * z * z * gas * pair.swelling(x, z)

        return function

    # λ₁ > 0 takes λ₂ below the root of a monotone function; λ₁ between 1 and the limit takes two signs.
    top = passive.elastomer.stretch_limit
    if not np.isfinite(top):
        top = 2.0
        while lacks(0.0)(top) < 0.0:
            top *= 2.0
    if lacks(0.0)(1.0) >= 0.0:
        return []
    top = float(_bracketed(lacks(0.0), np.array([1.0]), np.array([top]), np.array([-1.0]))[0])
    grid = 1.0 + (top - 1.0) * _clustered(_GRID)
    smallest, largest = lacks(1.0), lacks(highest)
    corners = [(z, 1.0) for z in _all_roots(smallest, grid)] + [
        (z, highest) for z in _all_roots(largest, grid)
    ]
    ends = [(1.0, 0.0), *sorted(corners), (top, 0.0)]
    pieces: list[tuple[End | None, End | None, FloatArray]] = []
    for (z0, x0), (z1, x1) in pairwise(ends):
        middle = 0.5 * (z0 + z1)
        if not (smallest(middle) <= 0.0 <= largest(middle)) or z0 == z1:
            continue
        if x1 == 0.0 or (x0 == 0.0 and pair.ambient == 0.0):
            continue  # where rounding has it that λ₁ goes to 0, or p with no gas around
        names: list[End | None] = []
        points = []
        for z, x in ((z1, x1), (z0, x0)):
            if x == 0.0:  # p = 0 at λ₂ = 1
                x = (
                    (gas / pair.ambient * 3.0 * pair.volume(*pair.sealed[:2]) - passive.cube) / active.cube
                ) ** (1 / 3)
                names.append("loss_of_tension")
                points.append(
                    _projected(pair, np.array([[x], [1.0], [0.0]]), np.array([[0.0], [1.0], [0.0]]))
                )
                points[-1][1:] = [[1.0], [0.0]]
            else:
                names.append(far if x == highest else None)
                guess = np.array([[x], [z], [float(balloon_pressure(passive, z))]])
                points.append(_projected(pair, guess, np.array([[1.0], [0.0], [0.0]])))
                points[-1][0] = x
        inner = grid[(grid > z0) & (grid < z1)][::-1]
        inner = inner[(inner < points[0][1]) & (inner > points[1][1])]
        p = np.asarray(balloon_pressure(passive, inner))
        x = np.cbrt((3.0 * pair.amount / (p + pair.ambient) - passive.cube * inner**3) / active.cube)
        across = np.zeros((3, inner.size))
        across[1] = 1.0
        nodes = _projected(pair, np.array([x, inner, p]), across) if inner.size else np.empty((3, 0))
        pieces.append((names[0], names[1], np.concatenate([points[0], nodes, points[1]], axis=1)))
    return pieces


def _resolved(pair: SealedPair, nodes: FloatArray) -> FloatArray:
    """Nodes so dense that neighbours see each other nearly straight ahead."""
    while nodes.shape[1] < _MOST_NODES:
        weights = _weights(pair, nodes)
        tangent = np.array(_tangent(pair, nodes)) * weights
        tangent = tangent / np.sqrt(np.sum(tangent * tangent, axis=0))
        chord = np.diff(nodes, axis=1)
        length = np.sqrt(np.sum((weights[:, :-1] * chord) ** 2, axis=0))
        turn = 1.0 - np.sum(tangent[:, :-1] * tangent[:, 1:], axis=0)
        split = np.flatnonzero((length > _LENGTH) | ((turn > 0.5 * _ANGLE**2) & (length > 1e-9)))
        if not split.size:
            return nodes
        low, high = nodes[:, split], nodes[:, split + 1]
        weights = weights[:, split]
        middle = _projected(pair, 0.5 * (low + high), weights * weights * (high - low))
        # The curve goes strictly towards falling λ₂; where its plane led elsewhere, λ₂ itself is halved.
        astray = ~((middle[1] <= low[1]) & (middle[1] >= high[1]) & (middle[0] > 0.0))
        if np.any(astray):
            z = 0.5 * (low[1] + high[1])[astray]
            p = np.asarray(balloon_pressure(pair.passive, z))
            cube = (3.0 * pair.amount / (p + pair.ambient) - pair.passive.cube * z**3) / pair.active.cube
            across = np.zeros((3, z.size))
            across[1] = 1.0
            middle[:, astray] = _projected(pair, np.array([np.cbrt(cube), z, p]), across)
        nodes = np.insert(nodes, split + 1, middle, axis=1)
    raise ArithmeticError("the equilibrium curve takes too many nodes")


def _segments(
    pair: SealedPair, first: End | None, last: End | None, nodes: FloatArray
) -> tuple[list[Segment], list[Point]]:
    """A piece of curve cut into segments, and the limit points between them."""

    def determinant(y: Any, cells: Any = None) -> Any:
        return _determinant(pair, y)

    def bend(y: Any, cells: Any = None) -> Any:
        return _determinant_slope(pair, y)

    # Where |det| has a minimum between two nodes, a pair of roots may hide: that minimum becomes a node.
    sign, slope = _signs(determinant(nodes)), _determinant_slope(pair, nodes)
    dips = np.flatnonzero(
        (sign[:-1] == sign[1:]) & (sign[:-1] * slope[:-1] < 0.0) & (sign[1:] * slope[1:] > 0.0)
    )
    if dips.size:
        low, high = nodes[:, dips], nodes[:, dips + 1]
        bottom = _bracketed_on_cells(pair, low, high, bend, np.sign(slope[dips]), _LOOSE)
        nodes = np.insert(nodes, dips + 1, bottom, axis=1)
        sign = _signs(determinant(nodes))
    at = np.flatnonzero(sign[:-1] != sign[1:])
    if at.size:
        folds = _on_cells(pair, nodes[:, at], nodes[:, at + 1], determinant, sign[at])
        nodes = np.insert(nodes, at + 1, folds, axis=1)
    cuts = [0, *(at + 1 + np.arange(at.size)).tolist(), nodes.shape[1] - 1]
    inner: list[End | None] = ["limit_point"] * at.size
    kinds = [first, *inner, last]
    segments = []
    for begin, end, kind, other in zip(cuts, cuts[1:], kinds, kinds[1:], strict=False):
        part = nodes[:, begin : end + 1]
        squares = np.asarray(_square(pair, part))
        squares[0] = np.inf if kind == "stretch_limit" else squares[0]
        squares[-1] = np.inf if other == "stretch_limit" else squares[-1]
        rising = (
            determinant(part[:, np.argmax(np.abs(determinant(part)[1:-1])) + 1]) > 0.0
            if part.shape[1] > 2
            else squares[-1] > squares[0]
        )
        lower, upper = kind, other
        if not rising:
            part, squares, lower, upper = part[:, ::-1], squares[::-1], other, kind
        if not squares[-1] > 0.0:
            continue
        if lower is None or not squares[0] >= 0.0:
            part, lower = _loaded(pair, part, squares), "unloaded"
            squares = np.maximum(np.concatenate([[0.0], squares[squares.size - part.shape[1] + 1 :]]), 0.0)
        assert upper is not None
        # Next to a limit point neighbours differ by less than rounding.
        squares = np.maximum.accumulate(squares)
        segments.append(Segment(part, squares, lower, upper, _unstable(pair, part)))
    points = [
        Point(State(*nodes[:, i].tolist()), float(np.sqrt(_square(pair, nodes[:, i]))))
        for i in cuts[1:-1]
        if _square(pair, nodes[:, i]) >= 0.0
    ]
    return segments, points


def _loaded(pair: SealedPair, part: FloatArray, squares: FloatArray) -> FloatArray:
    """The nodes with φ² ≥ 0, the first of them at φ = 0."""
    place = int(np.argmax(squares > 0.0))
    low, high = part[:, place - 1 : place], part[:, place : place + 1]
    start = _on_cells(pair, low, high, lambda y, _: _excess(pair, y, 0.0), np.array([-1.0]))
    return np.concatenate([start, part[:, place:]], axis=1)


def _unstable(pair: SealedPair, nodes: FloatArray) -> int:
    """Negative eigenvalues of H on a segment: the same at all inner points, or the curve was not resolved."""
    x, _, p = y = nodes
    n, d = pair.active.elastomer.pole_form(x)
    n1, d1 = pair.active.elastomer.pole_form_slope(x)
    _, _, _, (v1, _, v3) = _constraints(pair, y)
    a = pair.active.pressure_load
    diagonal = d * n1 - n * d1 - 3.0 * n * d / x + d * d * a * p * x + d * d * a * x * x * v1 / v3
    counts = np.where(_determinant(pair, y) < 0.0, 1, np.where(diagonal > 0.0, 0, 2))
    if counts.size == 2:
        return int(counts[0])
    inner = counts[1:-1]
    if np.any(inner != inner[0]):
        raise ArithmeticError("the stability changes between two limit points")
    return int(inner[0])


# -- histories -----------------------------------------------------------------------------------------


class Jump(NamedTuple):
    """A turning point that the voltage jumps to, in place of a ramp."""

    voltage: float


EventKind = Literal["limit_point", "jump", "loss_of_tension", "breakdown", "runaway"]


@dataclass(frozen=True)
class ReferenceEvent:
    """One event, with both sides of its jump; `after` and `dissipated` are None where the history ends.

    `leg` counts the turning points from 0. `dissipated` is Π before − Π after at the voltage of the event.
    """

    kind: EventKind
    leg: int
    voltage: float
    before: State
    after: State | None
    dissipated: float | None


class Margin(NamedTuple):
    """How near a decision of the history was to falling the other way.

    `what` is "turn" (a voltage beside the end of a segment, or of any if it was jumped to), "tension" (the
    lowest pressure of a flow that came to rest), or "breakdown" (the same of 1 − E/E_b); `size` is in units
    of that quantity, `leg` counts the turning points from 0, `events` is how many events there were before.
    `voltage` is that of the decision, without its sign.
    """

    what: Literal["turn", "tension", "breakdown"]
    size: float
    leg: int
    events: int
    voltage: float


@dataclass(frozen=True)
class ReferenceHistory:
    """What a sealed pair does under a voltage history.

    Attributes
    ----------
    outcome : str
        "completed", or the kind of the event that ended it.
    events : tuple of ReferenceEvent
    state, voltage
        At its end.
    segments : tuple of Segment
        Those it stayed on, in order; every event with an `after` at rest begins another.
    margins : tuple of Margin
    """

    outcome: Literal["completed", "loss_of_tension", "breakdown", "runaway"]
    events: tuple[ReferenceEvent, ...]
    state: State
    voltage: float
    segments: tuple[Segment, ...]
    margins: tuple[Margin, ...]


def reference_history(
    pair: SealedPair, turns: Sequence[float | Jump], curve: Curve | None = None
) -> ReferenceHistory:
    """Play voltage ramps (and jumps) from no voltage through turning points, valve closed.

    Between events the state is read off the exact curve. A snap runs along the overdamped flow, integrated
    tightly by SciPy, until it is about to rest at one of the exact equilibria, or ends on the way.

    Parameters
    ----------
    pair : SealedPair
        It starts at the stable equilibrium without voltage that is nearest to `pair.sealed`.
    turns : sequence of float or Jump
        Voltages ramped to, one after the other; negative ones are allowed.
    curve : Curve, optional
        Of the pair, where it is known already.

    Raises
    ------
    ValueError
        If the pair has no stable equilibrium without voltage.
    """
    if pair.sealed.pressure == 0.0:
        return _sealed_without_pressure(pair, turns)
    curve = curve or equilibrium_curve(pair)
    rests = [s for s in curve.segments if s.first == "unloaded" and not s.unstable]
    if not rests:
        raise ValueError("the pair has no stable equilibrium without voltage")
    walk = _Walk(curve, min(rests, key=lambda s: abs(s.nodes[0, 0] - pair.sealed.active)))
    for leg, turn in enumerate(turns):
        if isinstance(turn, Jump):
            walk.jump(leg, turn.voltage)
        elif walk.voltage * turn < 0.0:
            walk.ramp(leg, 0.0, walk.voltage)
            walk.ramp(leg, float(turn), float(turn))
        else:
            walk.ramp(leg, float(turn), float(turn) or walk.voltage)
        if walk.outcome != "completed":
            break
    return ReferenceHistory(
        walk.outcome, tuple(walk.events), walk.state, walk.voltage, tuple(walk.segments), tuple(walk.margins)
    )


def _sealed_without_pressure(pair: SealedPair, turns: Sequence[float | Jump]) -> ReferenceHistory:
    """Sealed at p = 0, tension is lost at the first rise of the voltage."""
    start = State(1.0, 1.0, 0.0)
    for leg, turn in enumerate(turns):
        if (turn.voltage if isinstance(turn, Jump) else turn) != 0.0:
            event = ReferenceEvent("loss_of_tension", leg, 0.0, start, None, None)
            return ReferenceHistory("loss_of_tension", (event,), start, 0.0, (), ())
    return ReferenceHistory("completed", (), start, 0.0, (), ())


class _Walk:
    """Where a reference history is now, and its record."""

    def __init__(self, curve: Curve, segment: Segment) -> None:
        self.curve = curve
        self.pair = curve.pair
        self.segments = [segment]
        self.state = segment.end(0)
        self.voltage = 0.0
        self.events: list[ReferenceEvent] = []
        self.margins: list[Margin] = []
        self.flows: dict[tuple[State, float, EventKind], Flow] = {}
        self.outcome: Literal["completed", "loss_of_tension", "breakdown", "runaway"] = "completed"

    def ramp(self, leg: int, target: float, side: float) -> None:
        """Ramp |φ| to that of `target`; `side` has the sign of the voltages on the way."""
        sign = -1.0 if side < 0.0 else 1.0
        goal = abs(target)
        while self.outcome == "completed":
            segment, now = self.segments[-1], abs(self.voltage)
            lowest, highest = segment.voltages
            if goal == now:
                self.voltage = sign * goal
                return
            rising = goal > now
            end = highest if rising else lowest
            kind = segment.last if rising else segment.first
            breaks = self._breaks(segment, min(goal, highest)) if rising else None
            if breaks is not None:
                self._stop("breakdown", leg, sign * breaks, self._at(segment, breaks))
                return
            if kind not in ("unloaded", "stretch_limit"):
                self.margins.append(Margin("turn", abs(goal - end), leg, len(self.events), end))
            point = segment.end(-1 if rising else 0)
            if (goal <= end) if rising else (goal >= end):
                self.voltage = sign * goal
                self.state = point if goal == end else self._at(segment, goal)
                return
            if kind == "loss_of_tension":
                self._stop("loss_of_tension", leg, sign * end, point)
            elif kind == "cut":
                self._stop("runaway", leg, sign * end, point)
            else:
                self._snap(leg, sign * end, point, rising)

    def jump(self, leg: int, target: float) -> None:
        """Change the voltage at once, and let the state flow."""
        if target == self.voltage:
            return
        special = [
            *self.curve.limit_points,
            *([self.curve.loss_of_tension] if self.curve.loss_of_tension else []),
        ]
        for point in special:
            size = abs(abs(target) - point.voltage)
            self.margins.append(Margin("turn", size, leg, len(self.events), point.voltage))
        if self.state.pressure <= 0.0 and abs(target) > abs(self.voltage):
            self._stop("loss_of_tension", leg, self.voltage, self.state)  # as at the first rise from p = 0
            return
        before, self.voltage = self.state, target
        self._flow("jump", leg, before, np.array(before[:2]), ())

    def _at(self, segment: Segment, voltage: float) -> State:
        return State(*states_on(self.pair, segment, [voltage])[:, 0].tolist())

    def _breaks(self, segment: Segment, highest: float) -> float | None:
        """The voltage, at most `highest`, at which the active film breaks on a stable segment."""
        active = self.pair.active
        if active.breakdown is None:
            return None
        strength = active.breakdown

        def margin(voltages: FloatArray) -> FloatArray:
            stretch = states_on(self.pair, segment, voltages)[0]
            return np.asarray(strength - voltages * stretch * stretch / active.thickness)

        # λ₁ and with it the field rise with the voltage wherever H is positive definite.
        bounds = np.array([abs(self.voltage), min(highest, segment.voltages[1])])
        if not np.isfinite(bounds[1]):
            bounds[1] = strength * active.thickness
        if margin(bounds[1:])[0] > 0.0:
            return None
        return float(_bracketed(margin, bounds[:1], bounds[1:], np.array([1.0]))[0])

    def _snap(self, leg: int, voltage: float, fold: State, rising: bool) -> None:
        """Leave a limit point along the null vector of H, downhill: λ₁ goes the way the voltage pushes it."""
        self.voltage = voltage
        values, vectors = np.linalg.eigh(self.pair.hessian(fold, voltage))
        mode = vectors[:, np.argmin(np.abs(values))]
        mode = mode * (np.sign(mode[0]) * (1.0 if rising else -1.0))
        others = [e.state for e in equilibria(self.curve, voltage)]
        gaps = [math.hypot(e.active - fold.active, e.passive - fold.passive) for e in others]
        distance = 1e-3 * min([1.0, *(gap for gap in gaps if gap > 1e-6)])
        # So near that no margin has changed much yet.
        at_fold = self._margins(np.array(fold[:2]))
        while (
            np.any(self._margins(np.array(fold[:2]) + distance * mode) < 0.99 * at_fold) and distance > 1e-9
        ):
            distance *= 0.1
        self._flow("limit_point", leg, fold, np.array(fold[:2]) + distance * mode, (fold,))

    def _margins(self, stretches: FloatArray) -> FloatArray:
        """The pressure and, where there is a strength, 1 − E/E_b."""
        active = self.pair.active
        field = abs(self.voltage) * stretches[0] ** 2 / active.thickness
        strength = 1.0 - field / active.breakdown if active.breakdown else 1.0
        return np.array([self.pair.pressure(*stretches.tolist()), strength])

    def _flow(
        self, kind: EventKind, leg: int, before: State, start: FloatArray, excluded: tuple[State, ...]
    ) -> None:
        """Record a jump along the flow from `start`, and go on from where it ends."""
        segments = {
            self._at(s, abs(self.voltage)): s
            for s in self.curve.segments
            if s.voltages[0] <= abs(self.voltage) <= s.voltages[1]
        }
        stable = [
            state
            for state, s in segments.items()
            if not s.unstable and all(max(map(abs, np.subtract(state, e))) > 1e-6 for e in excluded)
        ]
        key = (before, self.voltage, kind)
        if key not in self.flows:
            self.flows[key] = overdamped_flow(self.pair, self.voltage, start, stable, list(segments))
        flow = self.flows[key]
        if flow.end == "runaway":
            self.events.append(ReferenceEvent(kind, leg, self.voltage, before, None, None))
            self._stop("runaway", leg, self.voltage, before)
            return
        lost = float(
            self.pair.potential(before, self.voltage) - self.pair.potential(flow.state, self.voltage)
        )
        self.events.append(ReferenceEvent(kind, leg, self.voltage, before, flow.state, lost))
        if flow.end is None:
            here = (leg, len(self.events) - 1, abs(self.voltage))
            self.margins.append(Margin("tension", flow.lowest_pressure, *here))
            if self.pair.active.breakdown is not None:
                self.margins.append(Margin("breakdown", flow.lowest_strength, *here))
            self.state = flow.state
            self.segments.append(segments[flow.state])
        else:
            self._stop(flow.end, leg, self.voltage, flow.state)

    def _stop(
        self, kind: Literal["loss_of_tension", "breakdown", "runaway"], leg: int, voltage: float, state: State
    ) -> None:
        self.events.append(ReferenceEvent(kind, leg, voltage, state, None, None))
        self.outcome, self.voltage, self.state = kind, voltage, state


@dataclass(frozen=True)
class Flow:
    """Where an overdamped flow ended: at rest in `state` (`end` None), or in an event on the way.

    `lowest_pressure` and `lowest_strength` (of 1 − E/E_b) are the smallest values it passed.
    """

    state: State
    end: Literal["loss_of_tension", "breakdown", "runaway"] | None
    lowest_pressure: float
    lowest_strength: float


def overdamped_flow(
    pair: SealedPair, voltage: float, start: FloatArray, rests: Sequence[State], equilibria: Sequence[State]
) -> Flow:
    """The flow dλᵢ/dt = −gᵢ at a frozen voltage, the gas law holding throughout, to the end.

    Only the way matters, so it is integrated over its length, which passes the slow start off a limit point
    in a few steps; and where it hardly moves, g ≪ 1e-3, over the time times 1e-3: there rounding blurs the
    direction of g, not where it leads.

    Parameters
    ----------
    start : (2,) array
        Stretches it starts from.
    rests : sequence of State
        The stable equilibria at this voltage: the only places where it can rest. It is there when it is
        within 1e-5 of one, and a thousand times nearer than any other equilibrium is.
    equilibria : sequence of State
        All equilibria at this voltage.

    Raises
    ------
    ArithmeticError
        If it neither rests nor ends.
    """
    from scipy.integrate import solve_ivp

    active = pair.active
    limits = [b.elastomer.stretch_limit for b in (pair.active, pair.passive)]
    balls = []
    for rest in rests:
        gaps = (math.hypot(e.active - rest.active, e.passive - rest.passive) for e in equilibria)
        balls.append((rest.active, rest.passive, min([1e-5, *(1e-3 * gap for gap in gaps if gap > 0.0)])))
    calls = 0

    # In Python's own numbers: arrays of two are slow.
    highest = [limit * (1.0 - 1e-13) for limit in limits]

    def rates(x: FloatArray) -> tuple[float, float]:
        a, b = x.tolist()
        # A trial step may lead across the stretch limit; it comes back from there.
        a, b = min(a, highest[0]), min(b, highest[1])
        g, h = pair.forces(a, b, pair.pressure(a, b), voltage)
        return -g, -h

    def direction(t: float, x: FloatArray) -> tuple[float, float]:
        nonlocal calls
        calls += 1
        if calls > _MOST_CALLS:
            raise ArithmeticError(f"the flow from {start.tolist()} at the voltage {voltage!r} does not end")
        u, v = rates(x)
        speed = math.hypot(u, v) + _SLOW
        return u / speed, v / speed

    def jacobian(t: float, x: FloatArray) -> FloatArray:
        rate = np.array(rates(x))
        speed = math.hypot(*rate)
        unit = rate / (speed or 1.0)
        out = np.empty((2, 2))
        for j in range(2):
            y: list[Any] = [min(a, top) for a, top in zip(x.tolist(), highest, strict=True)]
            y[j] += 1j * _STEP
            forces = pair.forces(y[0], y[1], pair.pressure(y[0], y[1]), voltage)
            out[:, j] = [-g.imag / _STEP for g in forces]
        share = speed / (speed + _SLOW)
        return np.asarray((out - share * np.outer(unit, unit @ out)) / (speed + _SLOW))

    def tension(t: float, x: FloatArray) -> float:
        return float(pair.pressure(*x.tolist()))

    def pressure_rate(t: float, x: FloatArray) -> float:
        # −dV/dt, of the sign of dp/dt: zero at the lowest pressure, which a step might pass over.
        (a, b), (u, v) = x.tolist(), rates(x)
        return float(-pair.active.cube * a * a * u - pair.passive.cube * b * b * v)

    def strength(t: float, x: FloatArray) -> float:
        if active.breakdown is None:
            return 1.0
        return 1.0 - abs(voltage) * float(x[0]) ** 2 / (active.thickness * active.breakdown)

    def distance(t: float, x: FloatArray) -> float:
        a, b = x.tolist()
        return min((math.hypot(a - c, b - d) - r for c, d, r in balls), default=1.0)

    def nearest(x: FloatArray) -> State:
        return min(rests, key=lambda rest: math.hypot(x[0] - rest.active, x[1] - rest.passive))

    def away(t: float, x: FloatArray) -> float:
        return _UNBOUNDED - max(
            (a for a, top in zip(x.tolist(), limits, strict=True) if top == math.inf), default=0.0
        )

    events: list[Any] = [tension, strength, distance, away, pressure_rate]
    for event in events[:4]:
        event.terminal, event.direction = True, -1.0
    pressure_rate.direction = 1.0  # type: ignore[attr-defined]
    if distance(0.0, start) <= 0.0:
        rest = nearest(start)
        return Flow(rest, None, rest.pressure, strength(0.0, start))
    if tension(0.0, start) <= 0.0:
        return Flow(_flowing(pair, start), "loss_of_tension", tension(0.0, start), strength(0.0, start))
    if strength(0.0, start) <= 0.0:
        return Flow(_flowing(pair, start), "breakdown", tension(0.0, start), strength(0.0, start))
    result = solve_ivp(
        direction,
        (0.0, 1e9),
        start,
        method="Radau",
        rtol=1e-10,
        atol=1e-12,
        jac=jacobian,
        events=events,
        dense_output=True,
    )
    lows = [tension(0.0, x) for x in [*result.y.T, *result.y_events[4]]]
    weakest = min(strength(0.0, x) for x in result.y.T)
    crossings = result.t_events[0].tolist()
    # A dip below zero within one step shows in its lowest point alone.
    for t in [t for t in result.t_events[4] if tension(t, result.sol(t)) < 0.0][:1]:
        begin = result.t[np.searchsorted(result.t, t) - 1]
        at = _bracketed(
            lambda s: np.array([tension(0.0, result.sol(x)) for x in s]),
            np.array([begin]),
            np.array([t]),
            1.0,
        )
        crossings = [float(at[0]), *crossings]
    if crossings:
        return Flow(_flowing(pair, result.sol(crossings[0])), "loss_of_tension", 0.0, weakest)
    if result.t_events[1].size:
        return Flow(_flowing(pair, result.y_events[1][0]), "breakdown", min(lows), 0.0)
    if result.t_events[2].size:
        rest = nearest(result.y[:, -1])
        return Flow(rest, None, min(min(lows), rest.pressure), weakest)
    if result.t_events[3].size:
        return Flow(_flowing(pair, result.y[:, -1]), "runaway", min(lows), weakest)
    raise ArithmeticError(f"the flow from {start.tolist()} at the voltage {voltage!r} neither rests nor ends")


def _flowing(pair: SealedPair, stretches: FloatArray) -> State:
    active, passive = (float(x) for x in stretches)
    return State(active, passive, float(pair.pressure(active, passive)))


# -- roots of functions of one variable ----------------------------------------------------------------


def _signs(values: FloatArray) -> FloatArray:
    """−1 or 1: a zero must not hide a change of sign."""
    return np.where(values < 0.0, -1.0, 1.0)


def _clustered(count: int) -> FloatArray:
    """Points on [0, 1], dense at both ends."""
    return np.asarray(0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, count)))


def _all_roots(function: Function, grid: FloatArray) -> list[float]:
    """All roots of a smooth function on a grid, pairs hiding between two points included, to rounding."""
    value = np.asarray(function(grid))
    slope = _derivative(function, grid)
    sign = _signs(value)
    dips = (sign[:-1] == sign[1:]) & (sign[:-1] * slope[:-1] < 0.0) & (sign[1:] * slope[1:] > 0.0)
    if np.any(dips):
        low, high = grid[:-1][dips], grid[1:][dips]
        bottoms = _bracketed(lambda x: _derivative(function, x), low, high, np.sign(slope[:-1][dips]), _LOOSE)
        grid = np.sort(np.concatenate([grid, bottoms]))
        sign = _signs(np.asarray(function(grid)))
    at = np.flatnonzero(sign[:-1] != sign[1:])
    if not at.size:
        return []
    roots: list[float] = _bracketed(function, grid[at], grid[at + 1], sign[at]).tolist()
    return roots


def _derivative(function: Function, x: FloatArray) -> FloatArray:
    return np.asarray(function(x + 1j * _STEP)).imag / _STEP


def _bracketed(
    function: Function, low: FloatArray, high: FloatArray, sign: Any, tolerance: float = 2.3e-16
) -> FloatArray:
    """One root in each bracket, by Chandrupatla's method; `sign` is the function's at `low`.

    References
    ----------
    T. R. Chandrupatla, Adv. Eng. Softw. 28 (1997) 145–149.
    """
    sign = np.broadcast_to(np.asarray(sign, dtype=np.float64), low.shape)
    # What rounding made of an end's value counts for less than what is known of its sign.
    f1, f2 = np.asarray(function(low)), np.asarray(function(high))
    x1, f1 = low, np.where(f1 * sign > 0.0, f1, sign * 1e-300)
    x2, f2 = high, np.where(f2 * sign < 0.0, f2, -sign * 1e-300)
    share = np.full(low.shape, 0.5)
    for _ in range(120):
        x = x1 + share * (x2 - x1)
        f = np.asarray(function(x))
        same = f * f1 > 0.0
        x3, f3 = np.where(same, x1, x2), np.where(same, f1, f2)
        x2, f2 = np.where(same, x2, x1), np.where(same, f2, f1)
        x1, f1 = x, f
        best = np.where(np.abs(f1) < np.abs(f2), x1, x2)
        width = np.abs(x2 - x1)
        least = tolerance * np.maximum(np.abs(best), 1.0)
        done = (f1 == 0.0) | (width <= 2.0 * least)
        if np.all(done):
            return best
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            xi, phi = (x1 - x2) / (x3 - x2), (f1 - f2) / (f3 - f2)
            inverse = (phi * phi < xi) & ((1.0 - phi) ** 2 < 1.0 - xi)
            quadratic = f1 / (f2 - f1) * f3 / (f2 - f3) + (x3 - x1) / (x2 - x1) * f1 / (f3 - f1) * f2 / (
                f3 - f2
            )
            share = np.where(inverse & np.isfinite(quadratic), quadratic, 0.5)
            tight = np.minimum(least / np.where(width > 0.0, width, 1.0), 0.5)
        share = np.where(done, 0.0, np.clip(share, tight, 1.0 - tight))
    return best
