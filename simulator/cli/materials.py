"""`balloons explain`, `presets` and `schema`: what a scenario leads to, and what it may name and say."""

from __future__ import annotations

from simulator.cli.endings import errors_reported
from simulator.cli.options import ScenarioArgument


def explain(scenario: ScenarioArgument) -> None:
    """Say which unknowns, equations, events and smooth pieces a scenario leads to, and what is left out."""
    with errors_reported():
        from simulator.simulation.explanation import explain as explanation

        print(explanation(scenario))


def presets() -> None:
    """List the elastomers that a scenario may name by their material, with their constants and sources."""
    from simulator.cli.summary import list_presets
    from simulator.scenario import PRESETS, Preset

    list_presets({name: (Preset(preset=name).law.words, material) for name, material in PRESETS.items()})


def schema() -> None:
    """Print the grammar of scenario files as a JSON Schema, from which editors complete."""
    import json

    from simulator.scenario.schema import scenario_schema

    print(json.dumps(scenario_schema(), indent=2, ensure_ascii=False))
