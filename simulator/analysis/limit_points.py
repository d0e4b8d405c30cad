"""The equations of a limit point, with one number q of the scenario as a further unknown.

Those of a loss of sphericity differ in the last one: the margin of a balloon in place of det S.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulator.analysis.varied import Varied
from simulator.model.conditions import shape_conditions
from simulator.model.drive import VoltageLine
from simulator.model.elastomers import Number
from simulator.model.equations import Equations, OpenBalloon
from simulator.scenario import Shape
from simulator.simulation.run import simulate

FloatArray = NDArray[np.float64]

SOFT = 1e-2  # a stiffness this small is that of an inflated state at its limit
_SAME = 1e-3  # two inflated states closer than this are one


@dataclass(frozen=True)
class Alone:
    """Limit points of one balloon with the valve open: unknowns (λ, v, q), equations R = 0, ∂R/∂λ = 0.

    v is the pressure where it `inflates`, else the voltage. With a `mode` it is the loss of that shape, and
    its margin in place of ∂R/∂λ.
    """

    varied: Varied
    place: int
    inflates: bool
    mode: str | None = None

    @property
    def balloons(self) -> tuple[str, ...]:
        return (self.varied.device.names[self.place],)

    @property
    def scales(self) -> FloatArray:
        return np.array([*self._equations(self.varied.value).scales, abs(self.varied.value) or 1.0])

    def _equations(self, q: Number) -> OpenBalloon:
        device, pressure = self.varied.at(q)
        many = len(device.electroded)
        if self.inflates:
            return device.inflated(self.place, [0.0] * many)
        return device.actuated(self.place, pressure, VoltageLine.common(many))

    def residual(self, z: Sequence[Number]) -> list[Number]:
        """The equations' residuals."""
        equations = self._equations(z[-1])
        last = self.singularity(z) if self.mode is None else margin_of(equations, 0, self.mode, z[:-1])
        return [*equations.residual(z[:-1]), last]

    def singularity(self, z: Sequence[Number]) -> Number:
        """∂R/∂λ, zero at a limit point."""
        return self._equations(z[-1]).stiffness(z[:-1])[0][0]

    def margins(self, z: Sequence[float]) -> list[tuple[str, int | None, float]]:
        """What may end the curve: its kind, the unknown that is then 0, and how far it is from that."""
        return [] if self.inflates else [("zero_voltage", -2, z[-2])]

    def reading(self, z: FloatArray) -> tuple[FloatArray, float, float]:
        """Stretches, pressure and voltage."""
        if self.inflates:
            return z[:1], float(z[1]), 0.0
        return z[:1], float(self.varied.at(float(z[-1]))[1]), float(z[1])


@dataclass(frozen=True)
class Sealed:
    """Limit points of the sealed device: unknowns (λ inflated…, λ…, p, v, q).

    With a `mode` it is where the balloon at a `place` loses that shape, and its margin in place of det S.
    """

    varied: Varied
    place: int = -1
    mode: str | None = None

    @property
    def balloons(self) -> tuple[str, ...]:
        return self.varied.device.names

    @property
    def scales(self) -> FloatArray:
        walls = self.varied.device.walls
        softest = min(1.0 / float(wall.pressure_load) for wall in walls)
        return np.array([1.0] * (2 * len(walls)) + [softest, 1.0, abs(self.varied.value) or 1.0])

    def residual(self, z: Sequence[Number]) -> list[Number]:
        """The equations' residuals."""
        device, inflation = self.varied.at(z[-1])
        count = len(device.names)
        inflated, y = z[:count], z[count:-1]
        swelling = device.swelling(np.array([inflated]))[0]
        gas = device.law.sealed(inflation, swelling.item())
        sealed = device.sealed(gas, VoltageLine.common(len(device.electroded)))
        out = [wall.force(x, inflation, 0.0) for wall, x in zip(device.walls, inflated, strict=True)]
        if self.mode is not None:
            return [*out, *sealed.residual(y), margin_of(sealed, self.place, self.mode, y)]
        return [*out, *sealed.residual(y), sealed.spectrum.determinant(*sealed.stiffness(y))]

    def singularity(self, z: Sequence[Number]) -> Number:
        """det S, zero at a limit point."""
        device, inflation = self.varied.at(z[-1])
        count = len(device.names)
        swelling = device.swelling(np.array([z[:count]]))[0]
        sealed = device.sealed(
            device.law.sealed(inflation, swelling.item()), VoltageLine.common(len(device.electroded))
        )
        return sealed.spectrum.determinant(*sealed.stiffness(z[count:-1]))

    def margins(self, z: Sequence[float]) -> list[tuple[str, int | None, float]]:
        """Pressure, voltage, and the softest inflated balloon's stiffness; see `Alone.margins`."""
        softest = min(self.softnesses(z))
        return [
            ("loss_of_tension", -3, z[-3]),
            ("zero_voltage", -2, z[-2]),
            ("inflation_limit", None, softest),
        ]

    def softnesses(self, z: Sequence[float]) -> list[float]:
        """The stiffness of each inflated balloon by itself."""
        device, inflation = self.varied.at(z[-1])
        return [float(wall.stiffness(x, inflation, 0.0)[0]) for wall, x in zip(device.walls, z, strict=False)]

    def leads_to(self, z: FloatArray, end: str) -> bool:
        """Whether the scenario is inflated to this state; True where that is its limit."""
        if end == "inflation_limit" and min(self.softnesses(z.tolist())) < SOFT:
            return True
        inflations = self.varied.inflations(float(z[-1]))
        history = simulate(inflations.model_copy(update={"shape": Shape(on_loss="ignore")}))
        wanted = z[: len(self.balloons)]
        return history.outcome == "completed" and bool(np.all(np.abs(history.stretch[-1] - wanted) < _SAME))

    def reading(self, z: FloatArray) -> tuple[FloatArray, float, float]:
        """Stretches, pressure and voltage."""
        count = len(self.balloons)
        return z[count : 2 * count], float(z[-3]), float(z[-2])


LimitPoint = Alone | Sealed


def margin_of(equations: Equations, place: int, mode: str, y: Sequence[Number]) -> Number:
    """The margin of one balloon of some equations against losing its shape."""
    found = next(one for one in shape_conditions(equations) if (one.place, one.mode) == (place, mode))
    return found.condition.margin(y)
