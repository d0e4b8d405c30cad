"""The balloons of a scenario in numbers: their equations, and what is derived from a state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.model.contents import Adiabatic, Contents, Incompressible, Isothermal, Law
from simulator.model.coupling import CONSTRAINED
from simulator.model.drive import Quantity, VoltageCurve, VoltageLine, Way
from simulator.model.elastomers import Elastomer, as_written
from simulator.model.equations import OpenBalloon, SealedBalloons
from simulator.model.membranes import (
    AnyMembrane,
    ChargedMembrane,
    ElectrodedMembrane,
    Membrane,
    OscillatingMembrane,
)
from simulator.model.strength import ConstantStrength, PowerStrength, Strength

if TYPE_CHECKING:
    from simulator.scenario import Balloon, Gas, Scenario

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Device:
    """The balloons of a scenario, arrays of shape (n_balloons,).

    `electroded` are the indices of the balloons with electrodes, `strength` the dielectric strengths of
    their films (None where the scenario names none), `law` that of the gas or liquid they share.
    """

    names: tuple[str, ...]
    elastomers: tuple[Elastomer, ...]
    radius: FloatArray
    thickness: FloatArray
    modulus: FloatArray
    permittivity: FloatArray
    electroded: tuple[int, ...]
    strength: tuple[Strength | None, ...]
    law: Law

    @classmethod
    def from_scenario(cls, scenario: Scenario) -> Device:
        """The device that a scenario describes."""
        balloons = scenario.balloons
        electroded = tuple(i for i, b in enumerate(balloons) if b.electrodes)
        return cls(
            names=tuple(b.name for b in balloons),
            elastomers=tuple(_elastomer(scenario, b) for b in balloons),
            radius=np.array([b.radius for b in balloons]),
            thickness=np.array([b.thickness for b in balloons]),
            modulus=np.array([b.modulus for b in balloons]),
            permittivity=np.array([b.permittivity for b in balloons]),
            electroded=electroded,
            strength=tuple(_strength(balloons[i]) for i in electroded),
            law=_law(scenario.gas),
        )

    def bare(self, balloon: int) -> Device:
        """One balloon by itself and without electrodes."""
        one = slice(balloon, balloon + 1)
        return Device(
            self.names[one],
            self.elastomers[one],
            self.radius[one],
            self.thickness[one],
            self.modulus[one],
            self.permittivity[one],
            (),
            (),
            self.law,
        )

    @property
    def ambient(self) -> float:
        """Ambient pressure, over μH/R."""
        return float(self.law.ambient)

    @cached_property
    def walls(self) -> tuple[Membrane, ...]:
        """The balloons' walls without voltages."""
        return tuple(
            Membrane(elastomer, float(r / (h * k)), float(k), float(r * r * h * k), float(r**3))
            for elastomer, r, h, k in zip(
                self.elastomers, self.radius, self.thickness, self.modulus, strict=True
            )
        )

    def membrane(self, balloon: int, way: Way) -> AnyMembrane:
        """One balloon's wall under its share of the voltages or charges; without one, the bare wall."""
        wall = self.walls[balloon]
        if balloon not in self.electroded:
            return wall
        place = self.electroded.index(balloon)
        h, k, e = self.thickness[balloon], self.modulus[balloon], self.permittivity[balloon]
        film = wall, float(2.0 * e / (h * h * k)), float(self.radius[balloon] ** 2 * e / h), float(h)
        if isinstance(way, VoltageCurve):
            offset, rate = way.mean[place], 0.0
            if way.amplitude[place]:
                return OscillatingMembrane(*film, offset, way.amplitude[place], way.phase[place])
        else:
            offset, rate = way.offset[place], way.rate[place]
        if offset == 0.0 and rate == 0.0:
            return wall
        if way.quantity == "charge":
            _, _, capacitance, _ = film
            load = 2.0 / (wall.weight * capacitance)
            return ChargedMembrane(wall, load, capacitance, float(h), offset, rate)
        return ElectrodedMembrane(*film, offset, rate)

    def sealed(self, gas: Contents, way: Way) -> SealedBalloons:
        """Valve closed over a gas (or liquid), voltages or charges moving along `way`."""
        return SealedBalloons(tuple(self.membrane(i, way) for i in range(len(self.names))), gas)

    def actuated(self, balloon: int, pressure: float, way: Way) -> OpenBalloon:
        """One balloon with the valve open at `pressure`, voltages or charges moving along `way`."""
        return OpenBalloon(self.membrane(balloon, way), pressure, 0.0)

    def inflated(self, balloon: int, values: Sequence[float], quantity: Quantity = "voltage") -> OpenBalloon:
        """One balloon with the valve open under a moving pressure, voltages or charges held."""
        return OpenBalloon(self.membrane(balloon, VoltageLine.still(values, quantity)), 0.0, 1.0)

    def volume(self, stretch: FloatArray) -> FloatArray:
        """V = V_c + Σ rᵢ³λᵢ³/3 of states (n, n_balloons), with the chamber's V_c, over 4πR³."""
        return np.asarray(self.swelling(stretch) + self.law.chamber)

    def swelling(self, stretch: FloatArray) -> FloatArray:
        """The balloons' share of the volume."""
        return np.asarray(stretch**3 @ (self.radius**3 / 3.0))

    def field(self, stretch: FloatArray, voltage: FloatArray) -> FloatArray:
        """True electric fields φλ²/h, (n, n_electroded), over √(μ/ε)."""
        chosen = list(self.electroded)
        return np.asarray(voltage * stretch[:, chosen] ** 2 / self.thickness[chosen])

    @cached_property
    def rated(self) -> tuple[int, ...]:
        """Places, among the electroded balloons, of those whose film has a strength."""
        return tuple(place for place, strength in enumerate(self.strength) if strength is not None)

    def breakdown_field(self, stretch: FloatArray) -> FloatArray:
        """Strengths E_b of the films that have one, (n, n_rated), over √(μ/ε)."""
        fields = np.empty((len(stretch), len(self.rated)))
        for column, place in enumerate(self.rated):
            strength = self.strength[place]
            assert strength is not None
            fields[:, column] = strength.at(stretch[:, self.electroded[place]])
        return fields

    def charge(self, stretch: FloatArray, voltage: FloatArray) -> FloatArray:
        """Charges r²(e/h)φλ⁴, (n, n_electroded), over 4πR²√(εμ)."""
        chosen = list(self.electroded)
        return np.asarray(self._unstretched_capacitance * voltage * stretch[:, chosen] ** 4)

    def voltage(self, way: Way, v: FloatArray, stretch: FloatArray) -> FloatArray:
        """Voltages (n, n_electroded) of states (n, n_balloons) at n places of the drive's way."""
        if way.quantity == "voltage":
            return way.at(v)
        return np.asarray(
            way.at(v) / (self._unstretched_capacitance * stretch[:, list(self.electroded)] ** 4)
        )

    @cached_property
    def _unstretched_capacitance(self) -> FloatArray:
        """r²e/h of the balloons with electrodes."""
        chosen = list(self.electroded)
        return np.asarray(self.radius[chosen] ** 2 * self.permittivity[chosen] / self.thickness[chosen])

    def energy(
        self,
        stretch: FloatArray,
        pressure: FloatArray,
        voltage: FloatArray,
        gas: FloatArray,
        is_open: NDArray[np.bool_],
        charged: NDArray[np.bool_] | None = None,
    ) -> FloatArray:
        """The potential Π of states (n,), with −pV for its gas terms where the valve is open.

        Where the charges are given (`charged`) it has +½φq in place of −½φq.
        """
        volume = self.volume(stretch)
        elastic = sum(w.potential(x, 0.0) for w, x in zip(self.walls, stretch.T, strict=True))
        electric = 0.5 * np.sum(self.charge(stretch, voltage) * voltage, axis=1)
        if charged is not None:
            electric = np.where(charged, -electric, electric)
        sealed = self.law.energy(gas, pressure, volume)
        return np.asarray(elastic - electric + np.where(is_open, -pressure * volume, sealed))

    def stability(
        self,
        stretch: FloatArray,
        pressure: FloatArray,
        voltage: FloatArray,
        gas: FloatArray,
        is_open: NDArray[np.bool_],
        charged: NDArray[np.bool_] | None = None,
    ) -> FloatArray:
        """Smallest eigenvalue of the Hessian of Π in the stretches, (n,).

        At given voltages, or where `charged` at given charges.

        With a liquid, of what changes no volume; NaN where nothing can move (one balloon).
        """
        diagonal = self._curvatures(stretch, pressure, voltage, "voltage")
        if charged is not None and charged.any():
            charge = self.charge(stretch, voltage)
            at_charge = self._curvatures(stretch, pressure, charge, "charge")
            diagonal = np.where(charged[:, None], at_charge, diagonal)
        arms = self.radius**3 * stretch**2
        stiffness = self.law.stiffness(gas, pressure, self.volume(stretch))
        if self.law.spectrum is CONSTRAINED:
            return np.where(is_open, diagonal.min(axis=1), _across(diagonal, arms))
        return smallest_eigenvalue(diagonal, np.where(is_open, 0.0, stiffness), arms)

    def _curvatures(
        self, stretch: FloatArray, pressure: FloatArray, drive: FloatArray, quantity: Quantity
    ) -> FloatArray:
        """r²h ∂g/∂λ of each balloon, (n, n_balloons), at given pressures and voltages or charges."""
        diagonal = np.empty_like(stretch)
        line = VoltageLine.common(len(self.electroded), quantity)
        for i, (wall, x) in enumerate(zip(self.walls, stretch.T, strict=True)):
            membrane = self.membrane(i, line)
            v = drive[:, self.electroded.index(i)] if i in self.electroded else 0.0
            force, slope, _, _ = membrane.linearised(x, pressure, v)
            _, denominator = wall.elastomer.pole_form(x)
            _, denominator_slope = wall.elastomer.pole_form_slope(x)
            # ∂g/∂λ from R = Dg, also right where g is not zero (states in which a snap lost its tension).
            diagonal[:, i] = wall.weight * (slope - force / denominator * denominator_slope) / denominator
        return diagonal


def _across(diagonal: FloatArray, arms: FloatArray) -> FloatArray:
    """Smallest eigenvalues of diag(d) across a, for n pairs of d and a, (n, k)."""
    if diagonal.shape[1] == 1:
        return np.full(len(diagonal), np.nan)
    return np.asarray(CONSTRAINED.eigenvalue(list(diagonal.T), list((arms**2).T), 0))


def smallest_eigenvalue(diagonal: FloatArray, coupling: FloatArray, arms: FloatArray) -> FloatArray:
    """Smallest eigenvalues of diag(d) + c a aᵀ for n matrices: d and a of shape (n, k), c of shape (n,)."""
    count = diagonal.shape[1]
    if count == 1:
        return np.asarray(diagonal[:, 0] + coupling * arms[:, 0] ** 2)
    if count == 2:
        # det/λ_max: the plain formula ½(tr − √…) cancels where one balloon is near its stretch limit.
        x, y = (diagonal + coupling[:, None] * arms**2).T
        cross = coupling * arms[:, 0] * arms[:, 1]
        root = np.hypot(0.5 * (x - y), cross)
        mean = 0.5 * (x + y)
        determinant = diagonal[:, 0] * diagonal[:, 1] + coupling * (
            diagonal[:, 0] * arms[:, 1] ** 2 + diagonal[:, 1] * arms[:, 0] ** 2
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.where(mean > 0.0, determinant / (mean + root), mean - root))
    matrices = coupling[:, None, None] * arms[:, :, None] * arms[:, None, :]
    index = np.arange(count)
    matrices[:, index, index] += diagonal
    return np.asarray(np.linalg.eigvalsh(matrices)[:, 0])


def _strength(balloon: Balloon) -> Strength | None:
    chosen = balloon.breakdown
    if chosen is None:
        return None
    if chosen.law == "power":
        return PowerStrength.from_thickness(
            chosen.field, chosen.stretch_exponent, chosen.thickness_exponent, balloon.thickness
        )
    return ConstantStrength(chosen.field)


def _law(gas: Gas) -> Law:
    match gas.law:
        case "isothermal":
            return Isothermal(gas.ambient_pressure, gas.chamber)
        case "adiabatic":
            return Adiabatic(gas.ambient_pressure, gas.chamber, gas.exponent)
        case "liquid":
            return Incompressible(gas.ambient_pressure, gas.chamber)


def _elastomer(scenario: Scenario, balloon: Balloon) -> Elastomer:
    """A balloon's elastomer. A curve between rows and an object made elsewhere are checked only here."""
    key, elastomer = f"balloon.{balloon.name}.elastomer", balloon.elastomer
    try:
        made = as_written(elastomer)
    except ValueError as error:
        raise _refused(scenario, key, elastomer.words, str(error)) from None
    if elastomer.model == "python":
        from simulator.model.elastomers.checks import defect

        found = defect(made)
        if found is not None:
            raise _refused(scenario, key, repr(made), found)
    return made


def _refused(scenario: Scenario, key: str, value: str, allowed: str) -> Exception:
    from simulator.scenario import Problem, ScenarioError

    return ScenarioError(scenario.file, Problem(key, value, allowed))
