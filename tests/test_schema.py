"""The JSON Schema of scenario files: what the program reads is valid, and what it refuses by a key is not."""

from __future__ import annotations

import json
import tomllib
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft7Validator
from typer.testing import CliRunner

from simulator import ScenarioError, load_scenario
from simulator.cli import app
from simulator.scenario.schema import scenario_schema
from tests.fuzz import grammar

SCENARIOS = Path(__file__).parent.parent / "scenarios"
SCHEMA = Draft7Validator(scenario_schema())

WHOLE: dict[str, Any] = {
    "title": "Everything that has a limit of its own",
    "scales": {"shear_modulus": "45 kPa", "thickness": "1 mm", "radius": "2 cm", "permittivity": 4.7},
    "gas": {"ambient_pressure": "1 bar", "chamber": 0.0, "law": "adiabatic", "exponent": 1.3},
    "balloon": [
        {
            "name": "a",
            "radius": "3 cm",
            "electrodes": True,
            "breakdown": {"field": "200 MV/m"},
            "elastomer": {"model": "ogden", "mu": [1.0], "alpha": [2.0]},
        },
        {"name": "b", "elastomer": {"preset": "VHB-4910"}},
    ],
    "step": [
        {"inflate": "1 kPa"},
        {"ramp": {"a": "2 kV"}, "over": "3 s", "until": {"stretch": 2}},
        {"sine": {"period": 1, "cycles": 2, "a": {"mean": 0.1, "amplitude": 0.05}}},
        {"cycle": 2, "steps": [{"cycle": 3, "steps": [{"hold": 1}, {"jump": 0}]}]},
    ],
    "shape": {"on_loss": "ignore"},
    "output": {"points": 11},
    "solver": {"rtol": 1e-4},
}


def test_the_schema_is_one():
    Draft7Validator.check_schema(scenario_schema())


@pytest.mark.parametrize("path", sorted(SCENARIOS.glob("*.toml")), ids=lambda path: path.stem)
def test_shipped_scenarios_are_valid(path):
    SCHEMA.validate(tomllib.loads(path.read_text("utf-8")))


def test_random_scenarios_of_the_whole_grammar_are_valid(tmp_path):
    for number in range(80):
        SCHEMA.validate(grammar.numbered(number, tmp_path))


def changed(*way: Any) -> dict[str, Any]:
    """WHOLE with a value, the last of a way, at the place that the others lead to."""
    document = deepcopy(WHOLE)
    *parts, key, value = way
    place: Any = document
    for part in parts:
        place = place[part]
    place[key] = value
    return document


REFUSED: list[tuple[Any, ...]] = [
    ("titel", "x"),
    ("gas", "ambient_presure", 1),
    ("gas", "ambient_pressure", -1),
    ("gas", "law", "ideal"),
    ("gas", "exponent", 1),
    ("gas", "exponent", "1 kPa"),
    ("balloon", {"name": "a"}),
    ("balloon", []),
    ("balloon", 0, "name", 1),
    ("balloon", 0, "radius", 0),
    ("balloon", 0, "electrodes", "yes"),
    ("balloon", 0, "breakdown", {"law": "power", "field": 1}),
    ("balloon", 0, "elastomer", {"model": "gent"}),
    ("balloon", 0, "elastomer", "mu", []),
    ("balloon", 1, "elastomer", {"preset": "chewing gum"}),
    ("balloon", 1, "elastomer", {"model": "python"}),
    ("step", 0, {"inflate": 1, "ramp": 1}),
    ("step", 0, "over", 0),
    ("step", 0, "inflate", True),
    ("step", 1, "ramp", {}),
    ("step", 1, "valve", "shut"),
    ("step", 1, "until", {"event": "snap"}),
    ("step", 2, "sine", "a", {"mean": 0.1}),
    ("step", 3, "cycle", 0),
    ("step", 3, "steps", 0, "steps", 0, {"hold": 0}),
    ("shape", "on_loss", "continue"),
    ("output", "points", 1),
    ("output", "points", 11.5),
    ("solver", "rtol", 0.2),
]


@pytest.mark.parametrize("way", REFUSED, ids=repr)
def test_both_refuse(way):
    load_scenario(WHOLE)
    SCHEMA.validate(WHOLE)
    with pytest.raises(ScenarioError):
        load_scenario(changed(*way))
    assert not SCHEMA.is_valid(changed(*way))


def test_every_key_says_what_it_allows():
    tables = [scenario_schema(), *scenario_schema()["definitions"].values()]
    for table in tables:
        for key, node in table["properties"].items():
            assert {"description", "enum"} & set(node), key


def test_the_command_prints_it():
    printed = CliRunner().invoke(app, ["schema"])
    assert printed.exit_code == 0
    assert json.loads(printed.output) == json.loads(json.dumps(scenario_schema()))
