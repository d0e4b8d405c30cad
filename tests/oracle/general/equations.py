"""A set of balloons that move together, as equations of their stretches, their pressure and the drive.

The unknowns are y = (stretches…, pressure if the valve is closed, v). With the valve closed all balloons
are in one set; with it open each is a set of its own on a branch, while a flow may have several in one.
While a pressure is ramped, v is that pressure.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.oracle.general.device import Contents, Device, force, force_slope, strength
from tests.oracle.general.drive import Sines, Way
from tests.oracle.general.scenario import Balloon

FloatArray = NDArray[np.float64]
STEP = 1e-40  # of complex steps
ENDLESS = 1e3


@dataclass(frozen=True)
class Equations:
    """Balances of some balloons and, valve closed, the law of what is sealed in.

    Attributes
    ----------
    device : Device
    members : tuple of int
        Which balloons.
    way : Way
        What is given at each v, voltages or charges of all electrodes of the device.
    charged : bool
        Whether charges are given.
    contents : Contents or None
        What is sealed in.
    pressure : float or None
        The pressure while the valve is open; None, without contents, where v is the pressure.
    """

    device: Device
    members: tuple[int, ...]
    way: Way
    charged: bool
    contents: Contents | None
    pressure: float | None

    @cached_property
    def key(self) -> tuple[Any, ...]:
        """What makes two sets the same."""
        return self.members, self.way, self.charged, self.contents, self.pressure

    @cached_property
    def walls(self) -> list[Balloon]:
        """The balloons."""
        return [self.device.balloons[i] for i in self.members]

    @cached_property
    def places(self) -> list[int | None]:
        """Each balloon's place among those with electrodes."""
        order = {i: place for place, i in enumerate(self.device.electroded)}
        return [order.get(i) for i in self.members]

    @cached_property
    def capacitances(self) -> list[float]:
        """r²e/h of each balloon."""
        return [b.radius**2 * b.permittivity / b.thickness for b in self.walls]

    @cached_property
    def weights(self) -> list[float]:
        """r²h: what makes a force of a balloon a derivative of the potential."""
        return [b.radius**2 * b.thickness for b in self.walls]

    @property
    def closed(self) -> bool:
        """Whether the valve is closed."""
        return self.contents is not None

    @property
    def size(self) -> int:
        """How many balloons."""
        return len(self.members)

    def given(self, v: Any) -> list[tuple[Any, Any]]:
        """What is given on each balloon, and its derivative in v."""
        if not self.closed and self.pressure is None:
            v = 0.0  # v is the pressure
            return [(0.0 if p is None else self.way.at(v, p), 0.0) for p in self.places]
        return [(0.0, 0.0) if p is None else (self.way.at(v, p), self.way.slope(v, p)) for p in self.places]

    def pressure_of(self, y: Sequence[Any]) -> Any:
        """The pressure in a state."""
        if self.closed:
            return y[-2]
        return y[-1] if self.pressure is None else self.pressure

    def voltages(self, y: Sequence[Any]) -> list[Any]:
        """Voltages on each balloon."""
        given = self.given(y[-1])
        if not self.charged:
            return [value for value, _ in given]
        return [q / (c * x**4) for (q, _), c, x in zip(given, self.capacitances, y, strict=False)]

    def residual(self, y: Sequence[Any]) -> FloatArray:
        """Forces and, valve closed, the gas law, all zero in an equilibrium."""
        p, phi = self.pressure_of(y), self.voltages(y)
        out = [force(b, x, p, f) for b, x, f in zip(self.walls, y, phi, strict=False)]
        if self.contents is not None:
            u = self.contents.swelling(y[: self.size])
            out.append(u if self.contents.is_liquid else p - self.contents.law(u)[0])
        return np.array(out)

    def jacobian(self, y: Sequence[float]) -> FloatArray:
        """Derivatives of the residual, one column for each unknown."""
        n = self.size
        p, phi, given = self.pressure_of(y), self.voltages(y), self.given(y[-1])
        out = np.zeros((n + self.closed, n + self.closed + 1))
        for i, b in enumerate(self.walls):
            x = y[i]
            out[i, i] = self._slope(b, x, p, phi[i])
            out[i, -1] = self._pull(i, x, given[i])
            lift = -b.radius / b.thickness * x * x
            if self.closed:
                out[i, n] = lift
            elif self.pressure is None:
                out[i, -1] = lift
        if self.contents is not None:
            slope = 1.0 if self.contents.is_liquid else -self.contents.law(self.contents.swelling(y[:n]))[1]
            volume = self.contents.volume
            for i, b in enumerate(self.walls):
                out[n, i] = slope * b.radius**3 * y[i] * y[i] / volume
            out[n, n] = 0.0 if self.contents.is_liquid else 1.0
        return out

    def _slope(self, b: Balloon, x: Any, p: Any, phi: Any) -> Any:
        """∂g/∂λ at what is given."""
        out = force_slope(b, x, p, phi)
        if self.charged:
            out += 16.0 * b.permittivity / b.thickness**2 * phi * phi * x * x
        return out

    def _pull(self, i: int, x: Any, given: tuple[Any, Any]) -> Any:
        """∂g/∂v through the voltage or charge of a balloon."""
        value, rate = given
        b = self.walls[i]
        factor = -4.0 * b.permittivity / b.thickness**2 * value * rate
        return factor / (self.capacitances[i] ** 2 * x**5) if self.charged else factor * x**3

    def load(self, y: Sequence[float]) -> FloatArray:
        """∂²Π/∂λ∂v, (n,): how the drive pushes."""
        rates = self.jacobian(y)[: self.size, -1]
        return np.asarray(rates * self.weights)

    def hessian(self, y: Sequence[Any]) -> NDArray[Any]:
        """Hessian of Π in the stretches, the gas following; of a liquid, at given pressure."""
        p, phi = self.pressure_of(y), self.voltages(y)
        out = np.diag(
            [
                w * self._slope(b, x, p, f)
                for w, b, x, f in zip(self.weights, self.walls, y, phi, strict=False)
            ]
        )
        if self.contents is not None and not self.contents.is_liquid:
            a = self.areas(y)
            stiffness = -self.contents.law(self.contents.swelling(y[: self.size]))[1] / self.contents.volume
            out = out + stiffness * np.outer(a, a)
        return out

    def areas(self, y: Sequence[Any]) -> NDArray[Any]:
        """∂V/∂λ = r³λ²."""
        return np.array([b.radius**3 * x * x for b, x in zip(self.walls, y, strict=False)])

    def modes(self, y: Sequence[float]) -> tuple[FloatArray, FloatArray]:
        """Eigenvalues of the Hessian, ascending, and its eigenvectors as columns; with a liquid one fewer."""
        h = self.hessian(y)
        if not np.all(np.isfinite(h)):
            return np.full(self.size, math.nan), np.eye(self.size)
        if self.contents is None or not self.contents.is_liquid:
            return np.linalg.eigh(h)
        a = self.areas(y)
        basis = np.linalg.svd(a[None])[2][1:].T  # what keeps the volume
        values, vectors = np.linalg.eigh(basis.T @ h @ basis)
        return values, basis @ vectors

    def stability(self, y: Sequence[float]) -> float:
        """The smallest eigenvalue; infinite where nothing can move."""
        values = self.modes(y)[0]
        return float(values[0]) if values.size else math.inf

    def margin_names(self) -> list[tuple[str, int]]:
        """Kinds of events, and the place of the balloon, in the order of `margins`."""
        return [("singular", -1), *self._others]

    @cached_property
    def _others(self) -> list[tuple[str, int]]:
        out = [("loss_of_tension", -1)] if self.closed else []
        for i, b in enumerate(self.walls):
            if b.electrodes and b.strength is not None:
                out.append(("breakdown", i))
        for i, b in enumerate(self.walls):
            if math.isfinite(b.law.end):
                out.append(("out_of_range", i))
            elif b.law.may_run_away:
                out.append(("runaway", i))
        return out

    def margin(self, name: tuple[str, int], y: Sequence[Any]) -> Any:
        """One margin of a state, positive while all is well."""
        kind, i = name
        match kind:
            case "singular":
                return self.stability(y)
            case "loss_of_tension":
                return self.pressure_of(y)
            case "breakdown":
                b = self.walls[i]
                share = self.voltages(y)[i] * y[i] ** 2 / (b.thickness * strength(b, y[i]))
                return 1.0 - share * share
            case "out_of_range":
                return self.walls[i].law.end - y[i]
        return 1.0 - y[i] / ENDLESS

    def margins(self, y: Sequence[float]) -> FloatArray:
        """All margins."""
        return np.array([self.margin(name, y) for name in self.margin_names()])

    def potential(self, y: Sequence[float]) -> float:
        """Π of these balloons and their gas, with −pV where the valve is open."""
        phi = self.voltages(y)
        sign = 1.0 if self.charged else -1.0
        out = 0.0
        for w, b, x, f in zip(self.weights, self.walls, y, phi, strict=False):
            electric = 0.5 * b.permittivity / b.thickness**2 * f * f * x**4
            out += w * (b.modulus * b.law.energy(x) + sign * electric)
        if self.contents is not None:
            return float(out + self.contents.energy(self.contents.swelling(y[: self.size])))
        return float(out - self.pressure_of(y) * self.volume(y))

    def volume(self, y: Sequence[float]) -> float:
        """Volume of these balloons."""
        return sum((b.radius * x) ** 3 for b, x in zip(self.walls, y, strict=False)) / 3.0

    def charges(self, y: Sequence[float]) -> list[float]:
        """Charges of these balloons."""
        if self.charged:
            return [value for value, _ in self.given(y[-1])]
        return [c * f * x**4 for c, f, x in zip(self.capacitances, self.voltages(y), y, strict=False)]

    def twins(self, v: float) -> list[list[int]]:
        """Places of balloons that are alike and under the same load at v, together."""
        found: dict[Any, list[int]] = {}
        for i, (b, (value, _)) in enumerate(zip(self.walls, self.given(v), strict=True)):
            load = value * value / b.permittivity if self.charged else value * value * b.permittivity
            found.setdefault((b.mechanics, load), []).append(i)
        return list(found.values())

    @cached_property
    def classes(self) -> list[list[int]]:
        """Places of balloons that are alike and under the same load at any v; without single ones."""
        found: dict[Any, list[int]] = {}
        for i, (b, place) in enumerate(zip(self.walls, self.places, strict=True)):
            part = () if place is None else self.way.part(place)
            load = (b.permittivity, part) if any(part) else None
            found.setdefault((b.mechanics, load), []).append(i)
        return [places for places in found.values() if len(places) > 1]

    def alike(self, y: FloatArray, within: float = 1e-14) -> list[list[int]]:
        """Places of balloons that are alike and stretched alike, together; without single ones."""
        out = []
        for places in self.classes:
            rest = list(places)
            while rest:
                same = [i for i in rest if abs(y[i] - y[rest[0]]) <= within * abs(y[rest[0]])]
                rest = [i for i in rest if i not in same]
                if len(same) > 1:
                    out.append(same)
        return out

    def scales(self, y: FloatArray) -> FloatArray:
        """Changes of the unknowns that count as one: steps are small fractions of these."""
        out: list[float] = np.abs(y[: self.size]).tolist()
        unit = max(b.modulus * b.thickness / b.radius for b in self.walls)
        if self.closed:
            out.append(max(abs(y[-2]), 0.2 * unit))
        if not self.closed and self.pressure is None:
            out.append(max(abs(y[-1]), 0.2 * unit))
        else:
            out.append(self._drive_scale(y.tolist()))
        return np.array(out)

    def _drive_scale(self, y: Sequence[float]) -> float:
        """The change of v in which some voltage (or charge) changes by about its unit."""
        sizes = []
        for b, c, x, (value, _), place in zip(
            self.walls, self.capacitances, y, self.given(y[-1]), self.places, strict=False
        ):
            if place is None:
                continue
            unit = 0.3 * b.thickness * math.sqrt(b.modulus / b.permittivity)
            if self.charged:
                unit *= c * x**2
            if isinstance(self.way, Sines):
                rate = 2.0 * math.pi * self.way.amplitude[place]
            else:
                rate = self.way.rate[place]
            if rate:
                sizes.append(max(unit, 0.3 * abs(value)) / abs(rate))
        size = min(sizes, default=1.0)
        return min(size, 0.2) if isinstance(self.way, Sines) else size


def evened(y: FloatArray, alike: Sequence[Sequence[int]]) -> FloatArray:
    """A state, or a change of one, averaged over balloons that are alike."""
    out = y.copy()
    for places in alike:
        out[list(places)] = np.mean(y[list(places)])
    return out
