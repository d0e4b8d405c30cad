"""The balloons of a scenario in numbers: their equations, and what is derived from a state."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.model.contents import Contents, Gas, Incompressible, Law
from simulator.model.drive import Quantity, VoltageLine, Way
from simulator.model.elastomers import Elastomer, as_written, tension_force, tension_stiffness
from simulator.model.equations import OpenBalloon, SealedBalloons
from simulator.model.expansion import Adiabat
from simulator.model.membranes import AnyMembrane, ElectrodedMembrane, Membrane, curvature
from simulator.model.strength import ConstantStrength, PowerStrength, Strength

if TYPE_CHECKING:
    from simulator.scenario import Balloon, Scenario
    from simulator.scenario import Gas as GasTable

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
        sizes = (part.tolist() for part in (self.radius, self.thickness, self.modulus))
        return tuple(Membrane.of(*each) for each in zip(self.elastomers, *sizes, strict=True))

    def membrane(self, balloon: int, way: Way) -> AnyMembrane:
        """One balloon's wall under its share of the voltages or charges; without one, the bare wall."""
        wall = self.walls[balloon]
        if balloon not in self.electroded:
            return wall
        drive = way.drive(self.electroded.index(balloon))
        if drive is None:
            return wall
        parts = (self.radius, self.thickness, self.modulus, self.permittivity)
        r, h, k, e = (part[balloon].item() for part in parts)
        return ElectrodedMembrane.of(wall, r, h, k, e, drive)

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

    def sphericity(self, stretch: FloatArray, voltage: FloatArray) -> FloatArray:
        """Margins of sphericity s = k(f′ − f/λ) − 4(e/h²)φ²λ², (n, n_balloons), over μ.

        Where s falls through zero a balloon stops being a sphere, see `docs/shape.md`.
        """
        found = np.empty_like(stretch)
        for i, wall in enumerate(self.walls):
            x = stretch[:, i]
            force, stiffness = tension_force(wall.elastomer, x), tension_stiffness(wall.elastomer, x)
            found[:, i] = wall.modulus * (stiffness - force / x)
        chosen = list(self.electroded)
        load = 4.0 * self.permittivity[chosen] / self.thickness[chosen] ** 2
        found[:, chosen] -= load * (voltage * stretch[:, chosen]) ** 2
        return found

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
        """The potential Π of n states, over 4πR²Hμ, with −pV for its gas terms where the valve is open.

        Where the charges are given (`charged`) it has +½φq in place of −½φq.

        Parameters
        ----------
        stretch : (n, n_balloons) array
        pressure, gas : (n,) arrays
            Excess pressure, and the amount of gas at sealing.
        voltage : (n, n_electroded) array
        is_open, charged : (n,) arrays of bool
        """
        volume = self.volume(stretch)
        walls = self._energies(stretch, voltage, "voltage")
        if charged is not None and charged.any():
            walls = np.where(charged, self._energies(stretch, self.charge(stretch, voltage), "charge"), walls)
        sealed = self.law.energy(gas, pressure, volume)
        return np.asarray(walls + np.where(is_open, -pressure * volume, sealed))

    def stability(
        self,
        stretch: FloatArray,
        pressure: FloatArray,
        voltage: FloatArray,
        is_open: NDArray[np.bool_],
        charged: NDArray[np.bool_] | None = None,
        added: FloatArray | None = None,
    ) -> FloatArray:
        """Smallest eigenvalue of the Hessian of Π in the stretches, (n,), over 4πR²Hμ; see `energy`.

        At given voltages, or where `charged` at given charges. With a liquid, of what changes no volume;
        NaN where nothing can move (one balloon). `added` is what other parts of the balloons add to its
        diagonal, (n, n_balloons).
        """
        diagonal = self._curvatures(stretch, pressure, voltage, "voltage")
        if charged is not None and charged.any():
            at_charge = self._curvatures(stretch, pressure, self.charge(stretch, voltage), "charge")
            diagonal = np.where(charged[:, None], at_charge, diagonal)
        if added is not None:
            diagonal = diagonal + added
        swelling = self.swelling(stretch)
        # Each state as if it were sealed there: its contents have the stiffness that they have in any case.
        contents = self.law.sealed(pressure, swelling)
        arms = self.radius**3 * stretch**2
        squares = np.asarray(contents.stiffness(3.0 * swelling))[..., None] * arms**2
        together = contents.spectrum.eigenvalue(list(diagonal.T), list(squares.T), 0)
        if contents.spectrum.count(len(self.names)) == 0:
            together = np.full(len(stretch), np.nan)
        return np.asarray(np.where(is_open, diagonal.min(axis=1), together))

    def _membranes(
        self, drive: FloatArray, quantity: Quantity
    ) -> Iterator[tuple[AnyMembrane, FloatArray | float]]:
        """Every balloon's membrane, and what drives it in n states: voltages or charges (n, n_electroded)."""
        for i, membrane in enumerate(self._by_voltage if quantity == "voltage" else self._by_charge):
            yield membrane, drive[:, self.electroded.index(i)] if i in self.electroded else 0.0

    @cached_property
    def _by_voltage(self) -> tuple[AnyMembrane, ...]:
        line = VoltageLine.common(len(self.electroded))
        return tuple(self.membrane(i, line) for i in range(len(self.names)))

    @cached_property
    def _by_charge(self) -> tuple[AnyMembrane, ...]:
        line = VoltageLine.common(len(self.electroded), "charge")
        return tuple(self.membrane(i, line) for i in range(len(self.names)))

    def _energies(self, stretch: FloatArray, drive: FloatArray, quantity: Quantity) -> FloatArray:
        """Energies of the walls and films, (n,)."""
        membranes = self._membranes(drive, quantity)
        return np.asarray(sum(m.potential(x, v) for (m, v), x in zip(membranes, stretch.T, strict=True)))

    def _curvatures(
        self, stretch: FloatArray, pressure: FloatArray, drive: FloatArray, quantity: Quantity
    ) -> FloatArray:
        """r²h ∂g/∂λ of each balloon, (n, n_balloons), at given pressures and voltages or charges."""
        membranes = self._membranes(drive, quantity)
        return np.stack(
            [curvature(m, x, pressure, v) for (m, v), x in zip(membranes, stretch.T, strict=True)], axis=1
        )


def _strength(balloon: Balloon) -> Strength | None:
    chosen = balloon.breakdown
    if chosen is None:
        return None
    if chosen.law == "power":
        return PowerStrength.from_thickness(
            chosen.field, chosen.stretch_exponent, chosen.thickness_exponent, balloon.thickness
        )
    return ConstantStrength(chosen.field)


def _law(gas: GasTable) -> Law:
    match gas.law:
        case "isothermal":
            return Gas(gas.ambient_pressure, gas.chamber)
        case "adiabatic":
            return Gas(gas.ambient_pressure, gas.chamber, Adiabat(gas.exponent))
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
