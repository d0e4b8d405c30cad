"""The flow τᵢ dλᵢ/dt = −gᵢ of balloons in real time, by integrators of SciPy.

Between two corners of the drive everything is smooth. There the flow is followed step by step; every margin
is read several times in each step, and where it falls through zero the time is found by integrating anew
from the step's start. Nothing is taken from the simulator.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import BDF, LSODA, Radau
from scipy.optimize import brentq

from tests.oracle.general.elastomers import Law
from tests.oracle.general.springs import AnySpring, Source

FloatArray = NDArray[np.float64]

_RTOL = 1e-10
_ATOL = 1e-13
_LOOKS = 6  # times that margins are read in each step
_MOST_STEPS = 10_000
_GRAZING = 1e-9  # a margin that comes this near zero and turns, over its largest value in the leg
ENDLESS = 1e3  # stretch that counts as without end


@dataclass(frozen=True)
class Film:
    """One balloon as the flow sees it; `strength` gives E_b of its stretch."""

    radius: float
    thickness: float
    modulus: float
    permittivity: float
    wall: Law
    strength: Callable[[float], float] | None
    relaxation: float
    exponent: float
    springs: tuple[AnySpring, ...]
    source: Source | None = None


@dataclass(frozen=True)
class Drive:
    """A smooth part of the drive, from time 0 to `lasts`.

    Attributes
    ----------
    lasts : float
    voltages : callable
        Of all balloons, at a time.
    pressure : callable or None
        At a time, where the valve is open.
    gas_pressure : callable or None
        p and dp/dV of a volume, where the valve is closed.
    longest : float
        Step that an integrator may take.
    taut : bool
        Whether the pressure is watched.
    liquid : bool
        Whether a liquid keeps its volume, in the place of a gas.
    """

    lasts: float
    voltages: Callable[[float], FloatArray]
    pressure: Callable[[float], float] | None
    gas_pressure: Callable[[float], tuple[float, float]] | None
    longest: float
    taut: bool = True
    liquid: bool = False


@dataclass(frozen=True)
class Crossing:
    """A margin that fell through zero."""

    time: float
    kind: str
    place: int
    state: FloatArray


@dataclass(frozen=True)
class Leg:
    """What became of the flow in one part of the drive."""

    state: FloatArray
    time: float
    crossings: tuple[Crossing, ...]
    ended: bool
    grazing: tuple[str, ...]
    states: FloatArray


class FlowError(ArithmeticError):
    """An integrator could not follow the flow."""


@dataclass
class Motion:
    """All balloons on one gas, and how fast they are.

    Unknowns are λ, inner stretches, the voltages of films behind resistances, and the heat so far.
    """

    films: Sequence[Film]
    chamber: float
    springs: list[tuple[int, AnySpring, slice]] = field(init=False)
    behind: dict[int, int] = field(init=False)

    def __post_init__(self) -> None:
        self.springs = []
        begin = len(self.films)
        for i, film in enumerate(self.films):
            for spring in film.springs:
                self.springs.append((i, spring, slice(begin, begin + spring.size)))
                begin += spring.size
        behind = [i for i, film in enumerate(self.films) if film.source is not None]
        self.behind = {i: begin + place for place, i in enumerate(behind)}

    @property
    def count(self) -> int:
        return len(self.films)

    def at_rest(self) -> FloatArray:
        inner = sum(spring.size for _, spring, _ in self.springs)
        return np.concatenate([np.ones(self.count + inner), np.zeros(len(self.behind) + 1)])

    def voltages(self, time: float, y: FloatArray, drive: Drive) -> FloatArray:
        """Those of the films."""
        found = np.array(drive.voltages(time), dtype=float)
        for i, place in self.behind.items():
            found[i] = y[place]
        return found

    def is_sound(self, y: FloatArray) -> bool:
        """Whether a state is one at all: numbers, and no wall beyond where it locks."""
        below = all(0.0 < x < film.wall.limit for film, x in zip(self.films, y, strict=False))
        return below and bool(np.all(np.isfinite(y)))

    def volume(self, stretch: Sequence[float]) -> float:
        cubes = (film.radius**3 * x**3 / 3.0 for film, x in zip(self.films, stretch, strict=True))
        return self.chamber + math.fsum(cubes)

    def pressure(self, time: float, y: FloatArray, drive: Drive) -> float:
        if drive.pressure is not None:
            return drive.pressure(time)
        if drive.liquid:
            # How fast the volume grows at two pressures; that at which it does not is on the line.
            none, one = (self._growth(time, y, drive, pressure) for pressure in (0.0, 1.0))
            return none / (none - one)
        assert drive.gas_pressure is not None
        return drive.gas_pressure(self.volume(y[: self.count].tolist()))[0]

    def _growth(self, time: float, y: FloatArray, drive: Drive, pressure: float) -> float:
        balance = self.balance(y, pressure, self.voltages(time, y, drive))
        terms = zip(self.films, balance, y[: self.count].tolist(), strict=True)
        return -math.fsum(f.radius**3 * x * x * g / (f.relaxation * x**f.exponent) for f, g, x in terms)

    def balance(self, y: FloatArray, pressure: float, voltage: FloatArray) -> list[float]:
        """gᵢ with the shares of the springs."""
        found = self.forces(y[: self.count].tolist(), pressure, voltage)
        for i, spring, places in self.springs:
            found[i] += spring.share(float(y[i]), y[places].tolist())
        return found

    def forces(self, stretch: Sequence[float], pressure: float, voltage: FloatArray) -> list[float]:
        """gᵢ of the equilibrium part."""
        return [
            film.modulus * film.wall.force(x)
            - film.radius / film.thickness * pressure * x * x
            - 2.0 * film.permittivity / film.thickness**2 * float(v) ** 2 * x**3
            for film, x, v in zip(self.films, stretch, voltage, strict=True)
        ]

    def rates(self, time: float, y: FloatArray, drive: Drive) -> FloatArray:
        """dλ/dt, dξ/dt and the heat per time; NaN beyond where a wall locks."""
        stretch, inner = y[: self.count], y[self.count : -1]
        if any(not 0.0 < x < film.wall.limit for film, x in zip(self.films, stretch, strict=True)):
            return np.full(y.size, np.nan)
        if np.any(inner[: len(inner) - len(self.behind)] <= 0.0):
            return np.full(y.size, np.nan)
        out = np.zeros(y.size)
        balance = self.balance(y, self.pressure(time, y, drive), self.voltages(time, y, drive))
        heat = 0.0
        for i, spring, places in self.springs:
            x, own = float(stretch[i]), y[places].tolist()
            out[places] = spring.rates(x, own)
            heat += self.films[i].radius ** 2 * self.films[i].thickness * spring.heat(x, own)
        for i, film in enumerate(self.films):
            slow = film.relaxation * float(stretch[i]) ** film.exponent
            out[i] = -balance[i] / slow
            heat += film.radius**2 * film.thickness * slow * out[i] ** 2
        given = drive.voltages(time)
        for i, place in self.behind.items():
            film, x, phi = self.films[i], float(stretch[i]), float(y[place])
            assert film.source is not None
            capacity = film.radius**2 * film.permittivity / film.thickness * x**4
            true_field, charge = phi * x * x / film.thickness, capacity * phi
            here, lost = film.source.currents(float(given[i]), phi, true_field, charge, film.permittivity)
            out[place] = (here - lost) / capacity - 4.0 * phi * out[i] / x
            heat += (float(given[i]) - phi) * here + phi * lost
        out[-1] = heat
        return out

    def jacobian(self, time: float, y: FloatArray, drive: Drive) -> FloatArray:
        count = self.count
        stretch = y[:count]
        voltage = drive.voltages(time)
        out = np.zeros((y.size, y.size))
        diagonal, coupling = self.slopes(time, y, voltage, drive)
        out[:count, :count] = coupling
        out[np.arange(count), np.arange(count)] += diagonal
        for i, spring, places in self.springs:
            x, own = float(stretch[i]), y[places].tolist()
            out[i, i] += spring.stiffness(x, own)
            own_places = np.arange(places.start, places.stop)
            out[i, own_places], out[own_places, i], out[own_places, own_places] = spring.slopes(x, own)
        rate = self.rates(time, y, drive)
        for i, film in enumerate(self.films):
            x = float(stretch[i])
            out[i] /= -film.relaxation * x**film.exponent
            out[i, i] -= film.exponent * rate[i] / x
            size = film.radius**2 * film.thickness * film.relaxation * x**film.exponent
            out[-1] += 2.0 * size * rate[i] * out[i]
        return out

    def slopes(
        self, time: float, y: FloatArray, voltage: FloatArray, drive: Drive
    ) -> tuple[FloatArray, FloatArray]:
        """∂gᵢ/∂λᵢ at given pressure, and the share of the shared gas, −(rᵢ/hᵢ) λᵢ² dp/dV r_j³ λ_j²."""
        stretch, pressure = y[: self.count].tolist(), self.pressure(time, y, drive)
        diagonal = np.array(
            [
                film.modulus * film.wall.slope(x)
                - 2.0 * film.radius / film.thickness * pressure * x
                - 6.0 * film.permittivity / film.thickness**2 * float(v) ** 2 * x * x
                for film, x, v in zip(self.films, stretch, voltage, strict=True)
            ]
        )
        if drive.gas_pressure is None or drive.liquid:
            return diagonal, np.zeros((self.count, self.count))
        slope = drive.gas_pressure(self.volume(stretch))[1]
        area = np.array([film.radius**3 * x * x for film, x in zip(self.films, stretch, strict=True)])
        pull = np.array([f.radius / f.thickness * x * x for f, x in zip(self.films, stretch, strict=True)])
        return diagonal, -slope * np.outer(pull, area)

    def stability(self, time: float, y: FloatArray, drive: Drive) -> list[float]:
        """Smallest eigenvalue of the Hessian with the valve closed, one for each balloon with it open.

        Inner stretches are too slow to follow a snap. The Hessian is scaled by r²h on both sides: its sign is
        that of the potential's.
        """
        stretch = y[: self.count].tolist()
        diagonal, coupling = self.slopes(time, y, self.voltages(time, y, drive), drive)
        for i, spring, places in self.springs:
            diagonal[i] += spring.stiffness(stretch[i], y[places].tolist())
        if drive.gas_pressure is None:
            return [float(d) for d in diagonal]
        root = np.sqrt([film.radius**2 * film.thickness for film in self.films])
        hessian = np.diag(diagonal) + coupling * root[:, None] / root[None, :]
        if drive.liquid:
            # Of the directions that keep the volume; one balloon has none.
            area = np.array([f.radius**3 * x * x for f, x in zip(self.films, stretch, strict=True)]) / root
            ways = np.linalg.svd(area[None])[2][1:]
            hessian = ways @ hessian @ ways.T
            if not hessian.size:
                return [np.inf]
        return [float(np.linalg.eigvalsh((hessian + hessian.T) / 2.0)[0])]

    def margins(self, time: float, y: FloatArray, drive: Drive) -> list[tuple[str, int, float]]:
        """What is watched: kind, balloon, and a margin that is positive while all is well."""
        stretch = y[: self.count].tolist()
        out = [("limit_point", i, m) for i, m in enumerate(self.stability(time, y, drive))]
        if drive.gas_pressure is not None and drive.taut:
            out.append(("loss_of_tension", 0, self.pressure(time, y, drive)))
        voltage = self.voltages(time, y, drive)
        for i, (film, x) in enumerate(zip(self.films, stretch, strict=True)):
            if film.strength is not None:
                field_ = abs(float(voltage[i])) * x * x / film.thickness
                out.append(("breakdown", i, 1.0 - field_ / film.strength(x)))
            if film.wall.end < math.inf:
                out.append(("out_of_range", i, film.wall.end - x))
            elif math.isinf(film.wall.limit):
                out.append(("runaway", i, ENDLESS - x))
        return out


def follow(motion: Motion, drive: Drive, start: FloatArray, times: FloatArray, method: str) -> Leg:
    """Integrate one smooth part of the drive, up to its end or to what ends the history.

    Parameters
    ----------
    motion : Motion
    drive : Drive
    start : (n_unknowns,) array
    times : (n,) array
        Rising, within the part; states at these are returned, as far as it gets.
    method : {"LSODA", "BDF", "Radau"}

    Raises
    ------
    FlowError
        If the integrator gives up.
    """
    solver = _solver(motion, drive, 0.0, start, drive.lasts, method)
    found: list[Crossing] = []
    kept: list[FloatArray] = []
    lows: dict[tuple[str, int], float] = {}
    before = motion.margins(0.0, start, drive)
    tops = [abs(m) for _, _, m in before]
    for _ in range(_MOST_STEPS):
        t0, y0 = solver.t, solver.y.copy()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            message = solver.step()
        if solver.status == "failed" or not motion.is_sound(solver.y):
            raise FlowError(f"{method}: {message} at {solver.t!r}")
        dense = solver.dense_output()
        end = False
        for t in np.linspace(t0, solver.t, _LOOKS + 1)[1:]:
            y = solver.y if t == solver.t else dense(t)
            after = motion.margins(float(t), y, drive)
            for k, ((kind, place, a), (_, _, b)) in enumerate(zip(before, after, strict=True)):
                tops[k] = max(tops[k], abs(b))
                lows[kind, place] = min(lows.get((kind, place), math.inf), abs(b))
                if a > 0.0 >= b:
                    at = max(t0, float(t) - (solver.t - t0) / _LOOKS)
                    found.append(_refine(motion, drive, t0, y0, at, float(t), k, method))
            before = after
        ends = [c for c in found if c.kind != "limit_point"]
        if ends:
            first = min(ends, key=lambda c: c.time)
            found = [c for c in found if c.time < first.time or c is first]
            end = True
        stop = first.time if end else solver.t
        kept += [dense(t) for t in times[(times > t0) & (times <= stop)]]
        if end:
            break
        if solver.status == "finished":
            break
    else:
        raise FlowError(f"{method}: no end within {_MOST_STEPS} steps")
    crossed = {(c.kind, c.place) for c in found}
    grazing = tuple(
        kind
        for (kind, place, _), top in zip(before, tops, strict=True)
        if (kind, place) not in crossed and lows[kind, place] < _GRAZING * max(top, 1e-3)
    )
    found.sort(key=lambda c: c.time)
    last = found[-1] if found and found[-1].kind != "limit_point" else None
    states = np.array(kept).reshape(len(kept), start.size)
    if last is not None:
        return Leg(last.state, last.time, tuple(found), True, grazing, states)
    return Leg(solver.y.copy(), drive.lasts, tuple(found), False, grazing, states)


def _solver(motion: Motion, drive: Drive, t0: float, y0: FloatArray, end: float, method: str) -> Any:
    def rates(t: float, y: FloatArray) -> FloatArray:
        return motion.rates(t, y, drive)

    def jacobian(t: float, y: FloatArray) -> FloatArray:
        return motion.jacobian(t, y, drive)

    # With voltages of their own, or on a liquid, the slopes are by differences.
    slopes = None if motion.behind or drive.liquid else jacobian
    kind: Any = {"LSODA": LSODA, "BDF": BDF, "Radau": Radau}[method]
    # The heat of a small motion is small: it is only told, and nothing depends on it.
    atol = np.array([*[_ATOL] * (y0.size - 1), 1e-12])
    return kind(rates, t0, y0, end, rtol=_RTOL, atol=atol, jac=slopes, max_step=drive.longest)


def _refine(
    motion: Motion, drive: Drive, t0: float, y0: FloatArray, low: float, high: float, which: int, method: str
) -> Crossing:
    """When a margin falls through zero, by integrating from a step's start."""
    states: dict[float, FloatArray] = {t0: y0}

    def state(t: float) -> FloatArray:
        if t not in states:
            solver = _solver(motion, drive, t0, y0, t, method)
            while solver.status == "running":
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    message = solver.step()
            if solver.status == "failed":
                raise FlowError(f"{method}: {message}")
            states[t] = solver.y.copy()
        return states[t]

    def margin(t: float) -> float:
        return motion.margins(t, state(t), drive)[which][2]

    a, b = margin(low), margin(high)
    kind, place, _ = motion.margins(t0, y0, drive)[which]
    if a <= 0.0:
        root = low
    elif b > 0.0:
        root = high
    else:
        root = float(brentq(margin, low, high, xtol=1e-15 * drive.lasts, rtol=1e-14))
    return Crossing(root, kind, place, state(root))
