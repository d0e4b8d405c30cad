"""Scenarios of the paper's kind, in one line each."""

from __future__ import annotations

from typing import Any

from simulator.results.history import History
from simulator.scenario import Scenario, Shape, load_scenario
from simulator.simulation.run import simulate


def pair(
    inflate: float,
    *steps: dict[str, Any],
    ambient: float = 1.0,
    radius: float = 1.0,
    J_lim: float = 100.0,
    active: dict[str, Any] | None = None,
    passive: dict[str, Any] | None = None,
    **sections: Any,
) -> Scenario:
    """An electroded balloon of the given radius and a passive one of radius 1, inflated, then driven."""
    gent = {"model": "gent", "J_lim": J_lim}
    return load_scenario(
        {
            "title": "a pair",
            "gas": {"ambient_pressure": ambient},
            "balloon": [
                {"name": "active", "radius": radius, "electrodes": True, "elastomer": gent, **(active or {})},
                {"name": "passive", "elastomer": gent, **(passive or {})},
            ],
            "step": [{"inflate": inflate}, *steps],
            **sections,
        }
    )


def single(
    *steps: dict[str, Any], ambient: float = 1.0, elastomer: dict[str, Any] | None = None, **sections: Any
) -> Scenario:
    """One electroded balloon."""
    material = elastomer or {"model": "gent", "J_lim": 100.0}
    return load_scenario(
        {
            "title": "one balloon",
            "gas": {"ambient_pressure": ambient},
            "balloon": [{"name": "only", "electrodes": True, "elastomer": material}],
            "step": list(steps),
            **sections,
        }
    )


def run(scenario: Scenario) -> History:
    """Play a scenario for spheres only, with samples on the grid alone.

    Shapes, the events of their loss, and samples where curves bend have tests of their own.
    """
    output = scenario.output.model_copy(update={"chord": 1.0})
    return simulate(scenario.model_copy(update={"shape": Shape(on_loss="ignore"), "output": output}))


def kinds(history: History) -> list[str]:
    return [event.kind.value for event in history.events]


def gent_force(stretch: float, J_lim: float = 100.0) -> float:
    """f(λ) of the Gent elastomer as the paper prints it."""
    return 2 * J_lim * (stretch - stretch**-5) / (J_lim - (2 * stretch**2 + stretch**-4 - 3))
