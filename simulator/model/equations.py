"""The equations: membranes, and the two sets that they are composed into.

The unknowns of a set of equations are y = (stretches…, [pressure], v): the stretches of the balloons that
feel each other, the gas pressure where it is unknown, and last the coordinate v of the drive (a voltage,
a charge or, while inflating, the pressure). There are one fewer equations than unknowns, so they define a
curve, the equilibrium path.

Two sets of equations exist. `SealedBalloons`: valve closed, all balloons on one fixed amount of gas, or
liquid, see `contents`. `OpenBalloon`: valve open, the pressure is given, balloons do not feel each other and
each has its own. Both are composed of membranes (`membranes`), which say how a force balance is written; a
membrane without a voltage has no electrical term at all.

Methods take y as a sequence of floats, complex numbers, or rows of arrays, and compute with whatever they
are given.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from simulator.model.contents import Contents
from simulator.model.coupling import COUPLED, Spectrum
from simulator.model.elastomers import Number
from simulator.model.membranes import AnyMembrane, Membrane

FloatArray = NDArray[np.float64]
Rows = list[list[Number]]
# Unknowns y in order: floats, complex numbers, or rows of arrays.
State = Sequence[Number] | NDArray[Any]


class Equations(Protocol):
    """What following, polishing and relaxing need to know of a set of equations.

    `scales` are the natural sizes of the unknowns, shape (n_unknowns,), that of v no smaller than
    `least_drive`; `membranes` the balloons in it, as they are driven, and `walls` without that;
    `longest_step` the largest part of v that one step may pass over, inf where the drive is straight.
    """

    @property
    def scales(self) -> FloatArray: ...
    @property
    def least_drive(self) -> float: ...
    @property
    def membranes(self) -> tuple[AnyMembrane, ...]: ...
    @property
    def walls(self) -> tuple[Membrane, ...]: ...
    @property
    def longest_step(self) -> float: ...
    @property
    def has_pressure(self) -> bool:
        """Whether the pressure is an unknown, y[-2], bound by the gas law."""
        ...

    @property
    def spectrum(self) -> Spectrum:
        """What d and s of `stiffness` are to each other: how the balloons are coupled."""
        ...

    @property
    def is_open(self) -> bool:
        """Whether the valve is open: the pressure is given."""
        ...

    @property
    def can_go_slack(self) -> bool:
        """Whether the pressure can fall to 0 by itself."""
        ...

    def measured_by(self, least_drive: float) -> Self:
        """The same equations, with a scale of v no smaller than that."""
        ...

    def residual(self, y: State) -> list[Number]:
        """The equations' residuals, (n_unknowns − 1)."""
        ...

    def linearised(self, y: State) -> tuple[list[Number], Rows]:
        """The residuals and ∂(residual)/∂y, rows of (n_unknowns)."""
        ...

    def stiffness(self, y: State) -> tuple[list[Number], list[Number]]:
        """Diagonal d and squares s of S = diag(d) + √s √sᵀ.

        S = T H T with H the Hessian of Π in the stretches (pressure eliminated by the gas law) and
        T = diag √(D/(r²hk)): congruent, so of the same inertia, and without a pole. For a liquid √s is
        the direction that is forbidden, see `spectrum`.
        """
        ...

    def pressure(self, y: State) -> Number:
        """Excess pressure."""
        ...

    def gas_pressure(self, stretches: Sequence[Number], v: Number) -> Number:
        """The pressure of stretches in motion, where the pressure is an unknown."""
        ...

    def flow_law(self, y: Sequence[float], residual: list[Number], rows: Rows) -> tuple[Number, list[Number]]:
        """What is zero at the `gas_pressure`, linear in p, and its derivatives in (stretches…, p)."""
        ...

    def admitted(self, y: list[float]) -> list[float]:
        """A state from which a flow can start, close to `y`: of a volume that is possible."""
        ...

    def term_sizes(self, y: State) -> list[Number]:
        """Sizes of the terms of each residual, (n_unknowns − 1): their rounding is in it."""
        ...

    def potential(self, y: State) -> Number:
        """Π up to a constant, small where y is near the state of sealing (so that little cancels)."""
        ...

    def drive_power(self, y: State) -> Number:
        """−∂Π/∂v: Σ q dφ/dv, or −Σ φ dq/dv, or V dp/dv."""
        ...

    def electric_supply(self, y: State) -> Number:
        """Σ φq where voltages are given."""
        ...

    def gas_supply(self, y: State) -> Number:
        """pV of the gas supply; 0 with the valve closed."""
        ...


@dataclass(frozen=True)
class SealedBalloons:
    """Force balances of all balloons together, and the law of the gas (or liquid) that they share.

    Unknowns (λ₁ … λₙ, p, v). Mostly the valve is closed; on a `Supply` they are together at a given pressure.
    """

    membranes: tuple[AnyMembrane, ...]
    gas: Contents
    least_drive: float = 0.0

    has_pressure = True

    @cached_property
    def spectrum(self) -> Spectrum:
        return self.gas.spectrum

    @property
    def is_open(self) -> bool:
        return self.gas.is_open

    @property
    def can_go_slack(self) -> bool:
        return self.gas.slackens

    @cached_property
    def walls(self) -> tuple[Membrane, ...]:
        return tuple(m.wall for m in self.membranes)

    # What IDA asks for at every step, looked up once.
    @cached_property
    def _forces(self) -> tuple[list[tuple[Callable[..., Number], float]], Callable[..., Number]]:
        walls = [(m.force, w.cube) for m, w in zip(self.membranes, self.walls, strict=True)]
        return walls, self.gas.defect

    @cached_property
    def _linears(self) -> tuple[list[tuple[Callable[..., Any], float]], Callable[..., Any]]:
        walls = [(m.linearised, w.cube) for m, w in zip(self.membranes, self.walls, strict=True)]
        return walls, self.gas.linearised

    @cached_property
    def _stiffnesses(self) -> tuple[list[tuple[Callable[..., Any], float, float]], Callable[..., Number]]:
        walls = [(m.stiffness, w.cube, w.weight) for m, w in zip(self.membranes, self.walls, strict=True)]
        return walls, self.gas.stiffness

    def measured_by(self, least_drive: float) -> Self:
        return replace(self, least_drive=least_drive)

    @cached_property
    def longest_step(self) -> float:
        return _longest_step(self.membranes)

    @cached_property
    def scales(self) -> FloatArray:
        softest = min(1.0 / wall.pressure_load for wall in self.walls)
        return np.array(
            [1.0] * len(self.membranes) + [softest, max(_drive_scale(self.membranes), self.least_drive)]
        )

    def residual(self, y: State) -> list[Number]:
        *stretches, pressure, v = y
        out: list[Number] = []
        cubes: Number = 0.0
        walls, defect = self._forces
        for (force, cube), x in zip(walls, stretches, strict=True):
            out.append(force(x, pressure, v))
            cubes = cubes + cube * x * x * x
        out.append(defect(pressure, cubes))
        return out

    def linearised(self, y: State) -> tuple[list[Number], Rows]:
        *stretches, pressure, v = y
        count = len(stretches)
        residual: list[Number] = []
        rows: Rows = []
        areas: list[Number] = []
        cubes: Number = 0.0
        walls, law = self._linears
        for (linearised, cube), x in zip(walls, stretches, strict=True):
            row: list[Number] = [0.0] * (count + 2)
            force, row[len(rows)], row[-2], row[-1] = linearised(x, pressure, v)
            residual.append(force)
            rows.append(row)
            area = cube * x * x
            areas.append(area)
            cubes = cubes + area * x
        defect, per_pressure, per_volume = law(pressure, cubes)
        residual.append(defect)
        gas = [per_volume * area for area in areas]
        gas += (per_pressure, 0.0)
        rows.append(gas)
        return residual, rows

    def stiffness(self, y: State) -> tuple[list[Number], list[Number]]:
        *stretches, pressure, v = y
        diagonal: list[Number] = []
        areas: list[Number] = []
        cubes: Number = 0.0
        walls, coupling = self._stiffnesses
        for (stiffness, cube, weight), x in zip(walls, stretches, strict=True):
            slope, denominator = stiffness(x, pressure, v)
            diagonal.append(slope)
            area = cube * x * x
            areas.append(area * area * denominator / weight)
            cubes = cubes + area * x
        gas = coupling(cubes)
        return diagonal, [gas * area for area in areas]

    def pressure(self, y: State) -> Number:
        return y[-2]

    def gas_pressure(self, stretches: Sequence[Number], v: Number) -> Number:
        return self.gas.flow_pressure(self.membranes, self.walls, stretches, v)

    def flow_law(self, y: Sequence[float], residual: list[Number], rows: Rows) -> tuple[Number, list[Number]]:
        return self.gas.flow_law(self.walls, y, residual, rows)

    def admitted(self, y: list[float]) -> list[float]:
        return self.gas.admitted(self.membranes, self.walls, y)

    def term_sizes(self, y: State) -> list[Number]:
        *stretches, pressure, v = y
        out: list[Number] = []
        cubes: Number = 0.0
        for membrane, x in zip(self.membranes, stretches, strict=True):
            out.append(_term_size(membrane, x, pressure, v))
            cubes = cubes + membrane.wall.cube * x * x * x
        out.append(self.gas.term_size(pressure, cubes))
        return out

    def potential(self, y: State) -> Number:
        *stretches, _, v = y
        walls: Number = 0.0
        volume: Number = 0.0
        for membrane, wall, x in zip(self.membranes, self.walls, stretches, strict=True):
            walls = walls + membrane.potential(x, v)
            volume = volume + wall.cube * x * x * x / 3.0
        return walls + self.gas.energy(volume)

    def drive_power(self, y: State) -> Number:
        *stretches, _, v = y
        power: Number = 0.0
        for membrane, x in zip(self.membranes, stretches, strict=True):
            power = power + membrane.charge_rate(x, v)
        return power

    def electric_supply(self, y: State) -> Number:
        *stretches, _, v = y
        return sum(membrane.supplied(x, v) for membrane, x in zip(self.membranes, stretches, strict=True))

    def gas_supply(self, y: State) -> Number:
        return 0.0


@dataclass(frozen=True)
class OpenBalloon:
    """Valve open: the force balance of one balloon at the pressure p = offset + rate·v.

    Unknowns (λ, v). Voltage driven: rate 0. While inflating: offset 0, rate 1, and v is the pressure.
    """

    membrane: AnyMembrane
    pressure_offset: float
    pressure_rate: float
    least_drive: float = 0.0

    has_pressure = False
    is_open = True
    can_go_slack = False
    spectrum = COUPLED

    @cached_property
    def membranes(self) -> tuple[AnyMembrane, ...]:
        return (self.membrane,)

    @cached_property
    def walls(self) -> tuple[Membrane, ...]:
        return (self.membrane.wall,)

    def measured_by(self, least_drive: float) -> Self:
        return replace(self, least_drive=least_drive)

    @cached_property
    def longest_step(self) -> float:
        return _longest_step((self.membrane,))

    @cached_property
    def scales(self) -> FloatArray:
        if self.pressure_rate:
            return np.array([1.0, 1.0 / self.walls[0].pressure_load])
        return np.array([1.0, max(_drive_scale((self.membrane,)), self.least_drive)])

    def residual(self, y: State) -> list[Number]:
        x, v = y
        return [self.membrane.force(x, self.pressure_offset + self.pressure_rate * v, v)]

    def linearised(self, y: State) -> tuple[list[Number], Rows]:
        x, v = y
        pressure = self.pressure_offset + self.pressure_rate * v
        force, along, per_pressure, per_v = self.membrane.linearised(x, pressure, v)
        return [force], [[along, per_pressure * self.pressure_rate + per_v]]

    def stiffness(self, y: State) -> tuple[list[Number], list[Number]]:
        x, v = y
        return [self.membrane.stiffness(x, self.pressure_offset + self.pressure_rate * v, v)[0]], [0.0]

    def pressure(self, y: State) -> Number:
        return self.pressure_offset + self.pressure_rate * y[1]

    def gas_pressure(self, stretches: Sequence[Number], v: Number) -> Number:
        """No gas law here, the pressure is given."""
        raise NotImplementedError

    def term_sizes(self, y: State) -> list[Number]:
        x, v = y
        pressure = self.pressure_offset + self.pressure_rate * v
        return [_term_size(self.membrane, x, pressure, v)]

    def flow_law(self, y: Sequence[float], residual: list[Number], rows: Rows) -> tuple[Number, list[Number]]:
        """No gas law here, the pressure is given."""
        raise NotImplementedError

    def admitted(self, y: list[float]) -> list[float]:
        return y

    def potential(self, y: State) -> Number:
        x, v = y
        return self.membrane.potential(x, v) - self.pressure(y) * self.walls[0].cube * x * x * x / 3.0

    def drive_power(self, y: State) -> Number:
        x, v = y
        return self.membrane.charge_rate(x, v) + self.pressure_rate * self.walls[0].cube * x * x * x / 3.0

    def electric_supply(self, y: State) -> Number:
        x, v = y
        return self.membrane.supplied(x, v)

    def gas_supply(self, y: State) -> Number:
        return self.pressure(y) * self.walls[0].cube * y[0] ** 3 / 3.0


def _term_size(membrane: AnyMembrane, x: Number, pressure: Number, v: Number) -> Number:
    """|N| + |D a p λ² + …| of a force balance: the wall's own force and the load on it."""
    own = membrane.wall.elastomer.pole_form(x)[0]
    return abs(own) + abs(own - membrane.force(x, pressure, v))


def _drive_scale(membranes: Sequence[AnyMembrane]) -> float:
    """The smallest v that matters to a membrane; 1 where no voltage or charge moves."""
    smallest = min(m.drive_scale for m in membranes)
    return smallest if np.isfinite(smallest) else 1.0


def _longest_step(membranes: Sequence[AnyMembrane]) -> float:
    return min(np.inf if m.drive is None else m.drive.longest_step for m in membranes)
