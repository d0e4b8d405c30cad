"""What a scenario is made of: as assembled, step by step."""

from __future__ import annotations

import pytest

from simulator.scenario import load_scenario
from simulator.simulation.explanation import explain
from tests.pairs import pair, single


def test_a_sealed_pair():
    text = explain(load_scenario("scenarios/fig5b_state_b.toml"))
    assert "unknowns   stretch_active, stretch_passive, pressure, voltage (driven)" in text
    assert "force balance of active: f(λ) − 0.5 p λ² − 2 φ² λ³ = 0" in text
    assert "force balance of passive: f(λ) − p λ² = 0" in text
    assert "gas: (p + 1) Σ r³λ³/3 = n" in text
    assert "3. hold, 5 long, valve closed: everything is kept; nothing is integrated" in text
    assert "4. jump, valve closed: the overdamped flow at the new voltage" in text
    assert "electrical terms of passive: no electrodes" in text
    assert "breakdown: no balloon names a field" in text


def test_an_open_valve_has_no_gas_law_and_no_coupling():
    text = explain(single({"inflate": 0.5}, {"ramp": 0.1, "valve": "open"}))
    assert "gas:" not in text
    assert "gas law and coupling: no voltage moves with the valve closed" in text
    assert "coupling: there is one balloon" in text
    assert "loss_of_tension" not in text


def test_without_electrodes_there_are_no_electrical_terms():
    text = explain(load_scenario("scenarios/fig2_inflation.toml"))
    assert "φ" not in text
    assert "electrical terms: no balloon has electrodes" in text


def test_breakdown_is_an_event_where_it_is_named():
    assert "limit_point, loss_of_tension, breakdown" in explain(
        pair(0.6, {"ramp": 0.1}, active={"breakdown": {"field": 2.0}})
    )


def test_what_keeps_the_balloons_spheres_is_listed_unless_ignored():
    scenario = load_scenario("scenarios/fig3c_state_b.toml")
    text = explain(scenario)
    assert text.count("shape      loss_of_sphericity: active to a pear") == 2
    assert "loss of sphericity of passive: without a voltage this elastomer stays a sphere" in text
    film = {"model": "ogden", "mu": [0.2, -1.2, -1.4], "alpha": [2, 1, -2]}
    assert "only to a pear, only to shear in its surface" in explain(single({"inflate": 1.0}, elastomer=film))
    assert "loss_of_sphericity" not in explain(
        load_scenario(scenario.to_dict() | {"shape": {"on_loss": "ignore"}})
    )


@pytest.mark.parametrize(
    ("amplitude", "mean", "jumps"), [(0.1, 0.0, False), (0.1, 0.2, True), (0.0, 0.2, True)]
)
def test_a_wave_that_starts_elsewhere_is_announced(amplitude, mean, jumps):
    wave = {"sine": {"mean": mean, "amplitude": amplitude, "period": 1, "cycles": 2}}
    text = explain(pair(0.6, wave, {"ramp": mean}))
    assert ("begins by a jump of the voltage to 0.2" in text) == jumps
    assert "3. ramp, 1 long, valve closed: nothing moves" in text


def test_opening_the_valve_is_announced_once():
    hold = {"hold": 1, "valve": "open"}
    assert explain(pair(0.6, {"ramp": 0.1}, hold, hold)).count("opens the valve") == 1


def test_pieces_and_long_cycles():
    text = explain(pair(0.6, {"cycle": 40, "steps": [{"ramp": 0.1}, {"ramp": 0.0}]}))
    assert "… and 57 more steps" in text
    wave = {"triangle": {"low": 0.0, "high": 0.1, "period": 1, "cycles": 2}}
    assert "4 smooth pieces" in explain(pair(0.6, wave))
