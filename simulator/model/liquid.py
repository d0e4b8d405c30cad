"""A liquid: a constraint on the volume in the place of a law between pressure and volume.

See `contents.Contents` for what its methods are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from simulator.model.coupling import CONSTRAINED
from simulator.model.membranes import sum_of_cubes

if TYPE_CHECKING:
    from simulator.model.membranes import AnyMembrane, Membrane

Number = Any


@dataclass(frozen=True)
class Liquid:
    """V = V₀ of the balloons, whatever the pressure. A rigid chamber full of it makes no difference."""

    volume: Number

    spectrum = CONSTRAINED
    is_open = False
    slackens = True

    def defect(self, pressure: Number, cubes: Number) -> Number:
        return cubes / (3.0 * self.volume) - 1.0

    def term_size(self, pressure: Number, cubes: Number) -> Number:
        return 2.0

    def linearised(self, pressure: Number, cubes: Number) -> tuple[Number, Number, Number]:
        return cubes / (3.0 * self.volume) - 1.0, 0.0, 1.0 / self.volume

    def stiffness(self, cubes: Number) -> Number:
        return 1.0

    def energy(self, swelling: Number) -> Number:
        return 0.0

    # The constraint V = V₀ does not contain the pressure. Its derivative in time does: with aᵢ = ∂V/∂λᵢ,
    #     Σ aᵢ gᵢ(λ, p) = κ (V − V₀),
    # where the right-hand side, zero on paper, draws the volume back to V₀ at the rate κ (J. Baumgarte,
    # Comput. Methods Appl. Mech. Eng. 1 (1972) 1–16), so that the errors of the integration do not add up.

    def flow_pressure(
        self,
        membranes: Sequence[AnyMembrane],
        walls: Sequence[Membrane],
        stretches: Sequence[Number],
        v: Number,
    ) -> Number:
        push: Number = 0.0
        per_pressure: Number = 0.0
        cubes: Number = 0.0
        for membrane, wall, x in zip(membranes, walls, stretches, strict=True):
            area = wall.cube * x * x
            weight = area * wall.modulus
            push = push + weight * membrane.force(x, 0.0, v) / wall.elastomer.pole_form(x)[1]
            per_pressure = per_pressure + weight * wall.pressure_load * x * x
            cubes = cubes + area * x
        return (push - _pace(walls) * (cubes / 3.0 - self.volume)) / per_pressure

    def flow_law(
        self, walls: Sequence[Membrane], y: Sequence[float], residual: list[Number], rows: list[list[Number]]
    ) -> tuple[Number, list[Number]]:
        count, pace = len(walls), _pace(walls)
        value = -pace * residual[-1] * self.volume
        slopes: list[Number] = [0.0] * (count + 1)
        for i, (wall, x) in enumerate(zip(walls, y, strict=False)):
            denominator = wall.elastomer.pole_form(x)[1]
            denominator_slope = wall.elastomer.pole_form_slope(x)[1]
            area = wall.cube * x * x
            weight = area * wall.modulus / denominator
            value += weight * residual[i]
            slopes[i] = (
                weight * (rows[i][i] + residual[i] * (2.0 / x - denominator_slope / denominator))
                - pace * area
            )
            slopes[-1] += weight * rows[i][count]
        return value, slopes

    def admitted(
        self, membranes: Sequence[AnyMembrane], walls: Sequence[Membrane], y: list[float]
    ) -> list[float]:
        stretches = y[: len(walls)]
        for _ in range(30):
            missing = self.volume - sum_of_cubes(walls, stretches) / 3.0
            # Towards the volume where it costs least: a wall near its stretch limit hardly moves.
            change = [
                wall.cube * x * x * wall.elastomer.pole_form(x)[1] / wall.weight
                for wall, x in zip(walls, stretches, strict=True)
            ]
            gain = sum(wall.cube * x * x * c for wall, x, c in zip(walls, stretches, change, strict=True))
            stretches = [x + missing / gain * c for x, c in zip(stretches, change, strict=True)]
            if abs(missing) <= 1e-15 * self.volume:
                break
        return [*stretches, self.flow_pressure(membranes, walls, stretches, y[-1]), y[-1]]


def _pace(walls: Sequence[Membrane]) -> Number:
    """A rate of the flow: the largest modulus."""
    return max(wall.modulus for wall in walls)
