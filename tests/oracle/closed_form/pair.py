"""The sealed pair: two balloons on one fixed amount of gas, its forces, potential and Hessian."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from simulator.model.elastomers import Elastomer, Number, as_written
from tests.oracle.closed_form.balloons import Balloon, inflation_history
from tests.oracle.closed_form.roots import STEP

FloatArray = NDArray[np.float64]


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
            If it is not two balloons on an isothermal gas, one of them with electrodes and under voltages.
        """
        if scenario.gas.law != "isothermal" or scenario.gas.chamber:
            raise ValueError("the closed form needs an isothermal gas without a chamber")
        if any(hasattr(step, "charge") for step in scenario.played_steps()):
            raise ValueError("the closed form needs voltages, not charges")
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
            x[j] += 1j * STEP
            forces = self.forces(x[0], x[1], self.pressure(x[0], x[1]), voltage)
            out[:, j] = [w * g.imag / STEP for w, g in zip(weights, forces, strict=True)]
        return 0.5 * (out + out.T)


def _as_balloon(written: Any) -> Balloon:
    elastomer: Elastomer = as_written(written.elastomer)
    if written.breakdown and written.breakdown.law != "constant":
        raise ValueError("the closed form's histories know a constant breakdown field alone")
    strength = written.breakdown.field if written.breakdown else None
    return Balloon(
        elastomer, written.radius, written.thickness, written.modulus, written.permittivity, strength
    )
