"""What a summary says of materials that have viscoelastic branches: whether a scenario uses them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from simulator.scenario import MaxwellPreset, Preset

if TYPE_CHECKING:
    from simulator.scenario import Scenario


def material_lines(scenario: Scenario) -> Iterator[str]:
    """Whether each material with branches is played with them, or as it is when it has relaxed."""
    used: dict[str, list[str]] = {}
    for balloon in scenario.balloons:
        if not isinstance(balloon.elastomer, Preset) or not balloon.elastomer.material.branches:
            continue
        name, material = balloon.elastomer.preset, balloon.elastomer.material
        count, times = len(material.branches), f"{material.at_once:.2g} times"
        if balloon.maxwell is None:
            said = f"{name} relaxed, its equilibrium alone; at once it is {times} as stiff"
        elif balloon.maxwell == MaxwellPreset(preset=name):
            said = f"{name} with its {count} viscoelastic branches: at once {times} as stiff as relaxed"
        else:
            said = f"{name} with branches of the scenario's own"
        used.setdefault(said, []).append(balloon.name)
    yield from (f"{', '.join(names)}: {said}" for said, names in used.items())
