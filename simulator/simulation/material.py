"""How the balloons of a scenario take their time: their friction and their viscoelastic branches."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from simulator.model.viscoelastic import AnyBranch, LinearBranch, NewtonianBranch
from simulator.solver.passage import Friction, Material

if TYPE_CHECKING:
    from simulator.scenario import Balloon, Scenario


def material_of(scenario: Scenario) -> Material:
    """How a scenario's balloons take their time."""
    dynamics = scenario.dynamics
    assert dynamics is not None
    return Material(
        tuple(Friction(*dynamics.friction_of(balloon.name)) for balloon in scenario.balloons),
        tuple(tuple(_branches(balloon)) for balloon in scenario.balloons),
    )


def _branches(balloon: Balloon) -> Iterator[AnyBranch]:
    """The viscoelastic branches of a balloon."""
    weight = balloon.radius**2 * balloon.thickness
    for branch in balloon.branches:
        kind = LinearBranch if branch.flow == "linear" else NewtonianBranch
        yield kind(branch.modulus, branch.time, weight)
