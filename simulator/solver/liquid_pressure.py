"""The pressure of a liquid in real time: what keeps the volume while every balloon moves at its own pace.

With cᵢλᵢⁿ dλᵢ/dt = −(gᵢ + Sᵢ) and aᵢ = ∂V/∂λᵢ the volume stays where Σ mᵢ(gᵢ + Sᵢ) = κ(V − V₀) with
mᵢ = aᵢ/(cᵢλᵢⁿ), which is linear in p. The right-hand side, zero on paper, draws the volume back to V₀
(J. Baumgarte, Comput. Methods Appl. Mech. Eng. 1 (1972) 1–16), so that the errors of the integration do not
add up.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from simulator.model.liquid import Liquid

if TYPE_CHECKING:
    from simulator.model.groups import Group
    from simulator.solver.viscous import Flow


def holds_liquid(group: Group) -> bool:
    """Whether a group's balloons share a liquid."""
    return group.equations.has_pressure and isinstance(getattr(group.equations, "gas", None), Liquid)


def liquid_pressure(flow: Flow, group: Group, values: Sequence[float], v: float) -> float:
    """The pressure that keeps the volume, of all unknowns of a flow."""
    forces = group.equations.residual([*(values[i] for i in group.members), 0.0, v])
    shares = _shares(flow, values, v)
    push = per_pressure = cubes = 0.0
    for i, wall, force in zip(group.members, group.equations.walls, forces, strict=False):
        x = values[i]
        mobility = wall.cube * x * x / flow.material.friction[i].at(x)
        push += mobility * (wall.modulus * force / wall.elastomer.pole_form(x)[1] + shares[i])
        per_pressure += mobility * wall.modulus * wall.pressure_load * x * x
        cubes += wall.cube * x**3
    return (push - _pace(flow, group) * (cubes / 3.0 - _volume(group))) / per_pressure


def liquid_slopes(
    flow: Flow,
    group: Group,
    values: Sequence[float],
    state: Sequence[float],
    rows: Sequence[Sequence[float]],
) -> list[float]:
    """Its derivatives in all unknowns of the flow.

    `state` are those of the group's equations, `rows` the derivatives of their residuals in them.
    """
    v = state[-1]
    forces, shares = group.equations.residual(state), _shares(flow, values, v)
    out = [0.0] * len(values)
    per_pressure, mobilities = 0.0, {}
    for place, (i, wall) in enumerate(zip(group.members, group.equations.walls, strict=True)):
        x, friction = values[i], flow.material.friction[i]
        area = wall.cube * x * x
        mobilities[i] = mobility = area / friction.at(x)
        denominator, fall = wall.elastomer.pole_form(x)[1], wall.elastomer.pole_form_slope(x)[1]
        balance = wall.modulus * forces[place] / denominator + shares[i]
        slope = wall.modulus * (rows[place][place] - forces[place] * fall / denominator) / denominator
        out[i] = mobility * ((2.0 - friction.exponent) * balance / x + slope) - _pace(flow, group) * area
        per_pressure += mobility * wall.modulus * wall.pressure_load * x * x
    for i, _, part, own, _ in flow.slots:
        slopes = part.tangent(values[i], values[own], v)
        out[i] += mobilities[i] * slopes.share_per_stretch
        out[own] = [mobilities[i] * slope for slope in slopes.share_per_own]
    return [entry / per_pressure for entry in out]


def _shares(flow: Flow, values: Sequence[float], v: float) -> list[float]:
    """Σ S of the parts of each balloon."""
    found = [0.0] * flow.count
    for i, _, part, own, _ in flow.slots:
        found[i] += part.moves(values[i], values[own], v)[0]
    return found


def _volume(group: Group) -> float:
    return float(group.equations.gas.volume)  # type: ignore[union-attr]


def _pace(flow: Flow, group: Group) -> float:
    """A rate of the flow: the quickest of the walls."""
    walls = zip(group.members, group.equations.walls, strict=True)
    return float(max(wall.modulus / flow.material.friction[i].at(1.0) for i, wall in walls))
