"""Equations of a device: forces, gas, potential, and when a sphere stays a sphere. From docs/physics.md."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tests.oracle.general.scenario import Balloon, Document, Gas, Scenario, read

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Contents:
    """What a closed valve keeps in: pressure and stretches of the state in which it was closed.

    All is reckoned in the relative change of volume since, u, so that no digits are lost at a high ambient
    pressure.
    """

    gas: Gas
    pressure: float
    stretch: tuple[float, ...]
    radius: tuple[float, ...]

    @property
    def volume(self) -> float:
        """Gas volume in the state of sealing."""
        return (
            self.gas.chamber + sum((r * x) ** 3 for r, x in zip(self.radius, self.stretch, strict=True)) / 3.0
        )

    @property
    def is_liquid(self) -> bool:
        """Whether the volume cannot change."""
        return self.gas.law == "liquid"

    def swelling(self, stretch: Sequence[Any]) -> Any:
        """u = V/V₀ − 1."""
        change = sum(
            r**3 * (x - x0) * (x * x + x * x0 + x0 * x0)
            for r, x, x0 in zip(self.radius, stretch, self.stretch, strict=True)
        )
        return change / (3.0 * self.volume)

    def law(self, u: Any) -> tuple[Any, Any]:
        """The pressure of a gas and its derivative in u."""
        top = self.pressure + self.gas.ambient
        if self.gas.law == "isothermal":
            return (self.pressure - self.gas.ambient * u) / (1.0 + u), -top / (1.0 + u) ** 2
        power = -self.gas.exponent
        if isinstance(u, complex):  # with a tiny imaginary part
            value, slope = self.law(u.real)
            second = top * power * (power - 1.0) * (1.0 + u.real) ** (power - 2.0)
            return value + 1j * slope * u.imag, slope + 1j * second * u.imag
        if not u > -1.0:
            return math.nan, math.nan
        value = self.pressure + top * math.expm1(power * math.log1p(u))
        return value, top * power * (1.0 + u) ** (power - 1.0)

    def energy(self, u: float) -> float:
        """−∫p dV from the state of sealing: the free energy of the gas and its surroundings."""
        volume, ambient = self.volume, self.gas.ambient
        if self.is_liquid:
            return 0.0
        if not u > -1.0:
            return math.nan
        log = math.log1p(u)
        if self.gas.law == "isothermal":
            return volume * (ambient * (u - log) - self.pressure * log)
        g = self.gas.exponent - 1.0
        return volume * ((self.pressure + ambient) * math.expm1(-g * log) / g + ambient * u)


@dataclass(frozen=True)
class Device:
    """Balloons and their gas.

    Stretches are (n,), voltages (n_electroded,), in the order of the scenario. `integrators` is how many of
    them must agree on where a flow of this device ends.
    """

    balloons: tuple[Balloon, ...]
    gas: Gas
    integrators: int = 2

    @classmethod
    def from_scenario(cls, document: Document | Scenario | str) -> Device:
        """The device of a scenario: a dict, a path, or one that was read."""
        scenario = document if isinstance(document, Scenario) else read(document)
        return cls(scenario.balloons, scenario.gas)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all balloons."""
        return tuple(b.name for b in self.balloons)

    @property
    def electroded(self) -> tuple[int, ...]:
        """Places of the balloons with electrodes."""
        return tuple(i for i, b in enumerate(self.balloons) if b.electrodes)

    def sealed(self, stretch: ArrayLike, pressure: float) -> Contents:
        """What is kept in when the valve is closed in a state."""
        values = tuple(np.asarray(stretch, dtype=float).tolist())
        return Contents(self.gas, float(pressure), values, tuple(b.radius for b in self.balloons))

    def film_voltage(self, voltage: ArrayLike) -> FloatArray:
        """Voltages of all balloons, 0 where there are no electrodes."""
        out = np.zeros(len(self.balloons))
        out[list(self.electroded)] = voltage
        return out

    def volume(self, stretch: ArrayLike) -> float:
        """Gas volume, with the chamber."""
        x = np.asarray(stretch, dtype=float)
        return float(self.gas.chamber + np.sum((np.array([b.radius for b in self.balloons]) * x) ** 3) / 3.0)

    def charge(self, stretch: ArrayLike, voltage: ArrayLike) -> FloatArray:
        """Charges of the films."""
        x = np.asarray(stretch, dtype=float)[list(self.electroded)]
        return np.asarray(np.asarray(voltage, dtype=float) * self.capacitance() * x**4)

    def capacitance(self) -> FloatArray:
        """Capacitances of the unstretched films, r²e/h."""
        films = [self.balloons[i] for i in self.electroded]
        return np.array([b.radius**2 * b.permittivity / b.thickness for b in films])

    def field(self, stretch: ArrayLike, voltage: ArrayLike) -> FloatArray:
        """True fields φλ²/h."""
        x = np.asarray(stretch, dtype=float)[list(self.electroded)]
        thickness = np.array([self.balloons[i].thickness for i in self.electroded])
        return np.asarray(np.asarray(voltage, dtype=float) * x**2 / thickness)

    def residual(self, stretch: ArrayLike, pressure: float, voltage: ArrayLike) -> FloatArray:
        """Forces gᵢ, (n,)."""
        x, phi = np.asarray(stretch, dtype=float).tolist(), self.film_voltage(voltage).tolist()
        return np.array([force(b, x[i], pressure, phi[i]) for i, b in enumerate(self.balloons)])

    def gas_residual(self, stretch: ArrayLike, pressure: float, contents: Contents) -> float:
        """How far a state is from the law of what is sealed in: p less its law, or the change of volume."""
        u = contents.swelling(np.asarray(stretch, dtype=float).tolist())
        return float(u if contents.is_liquid else pressure - contents.law(u)[0])

    def hessian(
        self,
        stretch: ArrayLike,
        pressure: float,
        voltage: ArrayLike,
        *,
        valve_open: bool = False,
        charged: bool = False,
    ) -> FloatArray:
        """Hessian of Π in the stretches, (n, n); of a liquid only that on ΣaᵢΔλᵢ = 0 counts, a = r³λ²."""
        x, phi = np.asarray(stretch, dtype=float).tolist(), self.film_voltage(voltage).tolist()
        diagonal = []
        for b, xi, v in zip(self.balloons, x, phi, strict=True):
            slope = force_slope(b, xi, pressure, v)
            if charged:  # a voltage that falls as the film grows pulls less
                slope += 16.0 * b.permittivity / b.thickness**2 * v * v * xi * xi
            diagonal.append(b.radius**2 * b.thickness * slope)
        out = np.diag(diagonal)
        if not valve_open and self.gas.law != "liquid":
            a = np.array([b.radius**3 * xi * xi for b, xi in zip(self.balloons, x, strict=True)])
            gamma = self.gas.exponent if self.gas.law == "adiabatic" else 1.0
            out += gamma * (pressure + self.gas.ambient) / self.volume(x) * np.outer(a, a)
        return out

    def potential(
        self,
        stretch: ArrayLike,
        pressure: float,
        voltage: ArrayLike,
        *,
        contents: Contents | None = None,
        charged: bool = False,
    ) -> float:
        """Π; with −pV for the gas where no contents are given (valve open)."""
        x, phi = np.asarray(stretch, dtype=float).tolist(), self.film_voltage(voltage).tolist()
        sign = 1.0 if charged else -1.0
        films = sum(
            b.radius**2
            * b.thickness
            * (b.modulus * b.law.energy(xi) + sign * 0.5 * b.permittivity / b.thickness**2 * v * v * xi**4)
            for b, xi, v in zip(self.balloons, x, phi, strict=True)
        )
        gas = -pressure * self.volume(x) if contents is None else contents.energy(contents.swelling(x))
        return float(films + gas)

    def margins(
        self, stretch: ArrayLike, pressure: float, voltage: ArrayLike
    ) -> dict[tuple[str, str], float]:
        """What must stay positive, by (kind of event, balloon): pressure, strengths, ends of tables."""
        out = {("loss_of_tension", ""): float(pressure)}
        x, phi = np.asarray(stretch, dtype=float).tolist(), self.film_voltage(voltage).tolist()
        for b, xi, v in zip(self.balloons, x, phi, strict=True):
            if b.electrodes and b.strength is not None:
                out["breakdown", b.name] = 1.0 - abs(v) * xi**2 / (b.thickness * strength(b, xi))
            if math.isfinite(b.law.end):
                out["out_of_range", b.name] = b.law.end - xi
        return out

    def sphericity(self, stretch: ArrayLike, voltage: ArrayLike) -> FloatArray:
        """k(f′ − f/λ) − 4(e/h²)φ²λ² of each balloon, (n,): a sphere stays one where it is positive."""
        x, phi = np.asarray(stretch, dtype=float).tolist(), self.film_voltage(voltage).tolist()
        return np.array(
            [
                b.modulus * (b.law.slope(xi) - b.law.force(xi) / xi)
                - 4.0 * b.permittivity / b.thickness**2 * v * v * xi * xi
                for b, xi, v in zip(self.balloons, x, phi, strict=True)
            ]
        )


def force(b: Balloon, x: Any, pressure: Any, voltage: Any) -> Any:
    """g = k f − (r/h) p λ² − 2(e/h²) φ² λ³ of one balloon."""
    electric = 2.0 * b.permittivity / b.thickness**2 * voltage * voltage * x
    return b.modulus * b.law.force(x) - (b.radius / b.thickness * pressure + electric) * x * x


def force_slope(b: Balloon, x: Any, pressure: Any, voltage: Any) -> Any:
    """∂g/∂λ at given pressure and voltage."""
    electric = 3.0 * b.permittivity / b.thickness**2 * voltage * voltage * x
    return b.modulus * b.law.slope(x) - 2.0 * (b.radius / b.thickness * pressure + electric) * x


def strength(b: Balloon, x: Any) -> Any:
    """The true field at which a film fails."""
    assert b.strength is not None
    field, exponent = b.strength
    return field * x**exponent
