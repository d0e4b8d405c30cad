"""Numbers of a scenario by dotted key."""

from __future__ import annotations

import pytest

from simulator import load_scenario
from simulator.scenario.keys import all_keys, changed_scenario, number_at, physical_keys
from simulator.scenario.mapping import near, quantity, value_at, with_values
from tests.pairs import pair

BASE = pair(1.2, {"cycle": 2, "steps": [{"ramp": {"active": 0.3}}, {"hold": 1.0}]}).to_dict()


@pytest.mark.parametrize(
    ("value", "read"),
    [
        (2, (2.0, "")),
        (2.5, (2.5, "")),
        ("2 kPa", (2.0, " kPa")),
        ("-1.5e-3 V", (-0.0015, " V")),
        ("8kV", (8.0, "kV")),
        ("1e3", (1000.0, "")),
        (".5 mm", (0.5, " mm")),
        (True, None),
        ("gent", None),
        ("", None),
        (None, None),
        ("1.2.3", None),
    ],
)
def test_quantities(value, read):
    assert quantity(value) == read


def test_keys_are_set_where_they_are_and_nowhere_else():
    changed = with_values(
        BASE, {"balloon.active.radius": 0.5, "step.2.steps.1.ramp.active": 0.1, "step.2.cycle": 3.0}
    )
    assert changed["balloon"][0]["radius"] == 0.5
    assert changed["step"][1] == {"cycle": 3, "steps": [{"ramp": {"active": 0.1}}, {"hold": 1.0}]}
    assert type(changed["step"][1]["cycle"]) is int
    assert BASE["step"][1]["cycle"] == 2
    assert BASE["balloon"][0]["radius"] == 1.0
    assert with_values(BASE, {"balloon.*.thickness": 2.0})["balloon"][1]["thickness"] == 2.0
    assert with_values(BASE, {"balloon.2.thickness": 2.0})["balloon"][1]["thickness"] == 2.0
    assert with_values(BASE, {"balloon.active.breakdown.field": 9.0})["balloon"][0]["breakdown"] == {
        "field": 9.0
    }
    assert with_values({"a": {"b": [1.0, 2.0]}}, {"a.b.2": 3.0}) == {"a": {"b": [1.0, 3.0]}}


@pytest.mark.parametrize(
    "key",
    [
        "",
        ".",
        "gas",
        "gas.",
        "balloon.none.radius",
        "balloon.0.radius",
        "step.3.ramp",
        "step.2.steps",
        "gas.ambient_pressure.x",
    ],
)
def test_keys_that_lead_nowhere(key):
    with pytest.raises(KeyError):
        with_values(BASE, {key: 1.0})


def test_every_key_that_is_known_can_be_read_and_set():
    scenario = load_scenario(BASE)
    for key, value in all_keys(scenario).items():
        assert load_scenario(with_values(BASE, {key: value})).title == "a pair"
        assert value_at(with_values(BASE, {key: value}), key) == value


def test_numbers_of_the_device():
    scenario = load_scenario(BASE)
    keys = physical_keys(scenario)
    assert keys == (
        "gas.ambient_pressure",
        *(
            f"balloon.{name}.{what}"
            for name in ("active", "passive")
            for what in ("radius", "thickness", "modulus", "permittivity", "elastomer.J_lim")
        ),
        "step.1.inflate",
    )
    for key in keys:
        value = number_at(scenario, key)
        assert number_at(changed_scenario(scenario, key, 1.25 * value), key) == 1.25 * value
    assert number_at(scenario, "balloon.passive.radius") == 1.0  # a default
    with pytest.raises(KeyError):
        number_at(scenario, "balloon.active.breakdown.field")


def test_near_keys():
    known = all_keys(load_scenario(BASE))
    assert near("gas.pressure", known) == "did you mean gas.ambient_pressure?"
    assert "balloon.active.radius" in near("balloon.small.radius", known)
    assert near("xyz", {"a.b": 1.0, "c.d": 2.0, "e.f": "text"}) == "has a.b, c.d"
