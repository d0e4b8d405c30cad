"""The graph of states: against the closed form of the pair, against histories, and against itself."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import networkx
import numpy as np
import pytest
from typer.testing import CliRunner

from simulator import (
    ScenarioError,
    StateGraph,
    load_scenario,
    return_point_memory,
    simulate,
    states,
)
from simulator.cli import app
from tests.fuzz.states import examine, played
from tests.oracle.closed_form import SealedPair, equilibrium_curve, reference_history

SCENARIOS = Path(__file__).parent.parent / "scenarios"
FIVE = SCENARIOS / "five_states.toml"


@pytest.fixture(scope="module")
def five() -> StateGraph:
    return states(FIVE)


@pytest.mark.parametrize("name", ["fig3c_state_b", "fig5b_state_b", "fig5c_state_a", "fig5c_state_b"])
def test_the_states_of_a_pair_are_the_stable_segments_of_its_exact_curve(name):
    scenario = load_scenario(SCENARIOS / f"{name}.toml")
    graph = states(scenario)
    curve = equilibrium_curve(SealedPair.from_scenario(scenario))
    exact = sorted(
        (float(np.sqrt(s.squares[0])), min(float(np.sqrt(s.squares[-1])), graph.high))
        for s in curve.segments
        if not s.unstable and np.sqrt(s.squares[0]) < graph.high
    )
    found = sorted((state.low, state.high) for state in states(scenario, every=True).states)
    np.testing.assert_allclose(found, exact, rtol=1e-12, atol=1e-14)
    reference = reference_history(SealedPair.from_scenario(scenario), [graph.high, 0.0])
    passed = graph.visits([graph.high, 0.0])
    assert [one.kind.value for one in passed] == [event.kind for event in reference.events]
    for one, event in zip(passed, reference.events, strict=True):
        assert one.drive == pytest.approx(event.voltage, rel=1e-12)
        assert one.dissipated == pytest.approx(event.dissipated, rel=1e-10)
        np.testing.assert_allclose(one.stretch_after, event.after[:2], rtol=1e-10)
        assert one.balloons == ("active",)


def test_where_the_snap_of_a_pair_ends_the_device_the_graph_says_so():
    (one,) = states(SCENARIOS / "fig3b_state_a.toml").transitions
    assert (one.target, one.kind.value, one.ending.value) == (None, "limit_point", "loss_of_tension")
    assert one.drive == pytest.approx(0.58183674, abs=1e-8)
    (along,) = states(SCENARIOS / "fig3a_state_b.toml").transitions
    assert (along.kind, along.ending, along.stretch_after) == (along.ending, "loss_of_tension", None)
    assert along.drive == pytest.approx(0.51182337, abs=1e-8)


def test_the_graph_does_not_change_with_the_order_of_balloons(five):
    document = load_scenario(FIVE).to_dict()
    document["balloon"] = [document["balloon"][i] for i in (3, 0, 4, 2, 1)]
    other = states(document)
    assert len(other) == len(five) == 11
    places = [other.balloons.index(name) for name in five.balloons]
    for one, same in zip(five.states, other.states, strict=True):
        assert (same.low, same.high) == pytest.approx((one.low, one.high), rel=1e-10)
        np.testing.assert_allclose(same.stretch[32, places], one.stretch[32], rtol=1e-9)
    ways = [[(t.source, t.target, t.balloons) for t in graph.transitions] for graph in (five, other)]
    assert ways[0] == ways[1]


@pytest.mark.parametrize("number", [3, 17, 24, 38])
def test_histories_visit_the_states_that_the_graph_says(number):
    _, _, _, problems, compared = examine(number, histories=2)
    assert not problems
    assert compared


def test_five_balloons_forget_a_turning_point_and_a_history_shows_it(five):
    lost = return_point_memory(five)
    assert lost is not None
    assert lost.turns[0] == lost.turns[-1]
    assert len(lost.turns) == 3
    document = load_scenario(FIVE).to_dict()
    document["step"] = document["step"][:1]
    once = played(document, five, [lost.turns[0]])
    again = played(document, five, list(lost.turns))
    for history, number in ((once, lost.left), (again, lost.found)):
        state = five.states[number]
        at = [np.interp(lost.turns[0], state.drive, state.stretch[:, i]) for i in range(5)]
        np.testing.assert_allclose(history.stretch[-1], at, rtol=1e-2)
    assert np.abs(once.stretch[-1] - again.stretch[-1]).max() > 1.0


def open_valve(*, equal: bool = False) -> dict[str, Any]:
    films = [("a", 0.5), ("b", 0.5 if equal else 0.6), ("c", 0.7)]
    balloons = [
        {"name": name, "radius": radius, "electrodes": True, "elastomer": {"model": "gent", "J_lim": 100}}
        for name, radius in films
    ]
    steps = [{"inflate": 1.2}, {"ramp": 0.6, "valve": "open"}, {"ramp": 0.0, "valve": "open"}]
    return {"title": "open", "gas": {"ambient_pressure": 1.0}, "balloon": balloons, "step": steps}


def test_with_the_valve_open_balloons_are_independent_and_remember():
    graph = states(open_valve())
    alone = []
    for balloon in open_valve()["balloon"]:
        single = states({**open_valve(), "balloon": [balloon]})
        alone.append(sorted(one.drive for one in single.transitions))
    found = sorted({round(one.drive, 10) for one in graph.transitions})
    assert found == pytest.approx(sorted(v for one in alone for v in one))
    assert return_point_memory(graph) is None
    # Of two equal balloons both snap at once.
    both = states(open_valve(equal=True))
    assert ("a", "b") in {one.balloons for one in both.transitions}


def test_equal_balloons_part_and_come_together_as_in_a_history():
    graph = states(SCENARIOS / "push_pull.toml", along={"left": 1.0, "right": 1.0}, high=0.45)
    document = load_scenario(SCENARIOS / "push_pull.toml").to_dict()
    document["step"] = document["step"][:1]
    at = [0.45, 0.0, 0.3, 0.1, 0.45, 0.2]
    events = [event for event in played(document, graph, at).mechanical if event.step > 1]
    passed = graph.visits(at)
    assert [event.kind for event in events] == [one.kind for one in passed]
    assert [float(event.voltage[0]) for event in events] == pytest.approx([one.drive for one in passed])


def test_the_drive_is_along_the_line_of_the_scenarios_steps():
    document = load_scenario(SCENARIOS / "push_pull.toml").to_dict()
    document["step"] = [{"inflate": 1.2}, {"ramp": {"left": 0.2, "right": -0.1}}, {"ramp": 0.0}]
    graph = states(document)
    assert graph.share.tolist() == [1.0, -0.5]
    assert graph.high == pytest.approx(0.2)
    (same,) = [states(document, along={"left": 2.0, "right": -1.0}, high=0.2)]
    assert same == graph
    only = states(document, along={"left": 1.0}, high=0.2)
    assert only.share.tolist() == [1.0, 0.0]


def test_states_that_no_way_leads_to_have_no_order_of_balloons():
    document = load_scenario(FIVE).to_dict()
    document["balloon"] = [document["balloon"][i] for i in (0, 3, 4)]
    mirrored = {**document, "balloon": document["balloon"][::-1]}
    one = states(document, every=True)
    other = states(mirrored, every=True)
    assert sum(not state.reachable for state in one.states) > 1
    assert [(s.low, s.high) for s in other.states] == [pytest.approx((s.low, s.high)) for s in one.states]
    ways = [[(t.source, t.target, t.balloons) for t in graph.transitions] for graph in (one, other)]
    assert ways[0] == ways[1]


def test_a_range_above_zero_begins_where_a_rise_leads_to():
    graph = states(SCENARIOS / "fig5c_state_a.toml", low=0.3, high=0.6)
    assert [(s.number, s.low) for s in graph.states] == [(0, 0.3), (1, 0.3)]
    beyond = states(SCENARIOS / "fig5c_state_a.toml", low=0.5, high=0.6)
    assert len(beyond) == 1
    assert beyond.states[0].stretch[0, 0] > 6.0


@pytest.mark.parametrize(
    ("options", "key", "allowed"),
    [
        ({"low": -0.1}, "low", ">= 0"),
        ({"low": 0.5, "high": 0.2}, "high", "> low"),
        ({"low": "x"}, "low", "a number"),
        ({"high": "5 kV"}, "high", "[scales]"),
        ({"along": {"passive": 1.0}}, "along.passive", "no balloon with electrodes"),
        ({"along": {"active": 0.0}}, "along", "other than 0"),
        ({"along": {"active": float("nan")}}, "along.active", "a number"),
    ],
)
def test_a_drive_that_makes_no_sense_is_refused(options, key, allowed):
    with pytest.raises(ScenarioError) as caught:
        states(SCENARIOS / "fig5c_state_a.toml", **options)
    assert caught.value.key == key
    assert allowed in caught.value.allowed


@pytest.mark.parametrize(
    ("name", "key"),
    [
        ("fig2_inflation", "balloon"),
        ("delayed_snap", "dynamics"),
        ("charge_control", "step.2"),
        ("ring", "step.3"),
    ],
)
def test_scenarios_without_such_a_drive_are_refused(name, key):
    with pytest.raises(ScenarioError) as caught:
        states(SCENARIOS / f"{name}.toml")
    assert caught.value.key == key


def test_a_device_that_ends_below_the_range_is_refused():
    with pytest.raises(ScenarioError, match="loss of tension"):
        states(SCENARIOS / "fig3b_state_a.toml", low=0.6, high=0.7)
    with pytest.raises(ScenarioError, match=r"shape\.on_loss"):
        states(load_scenario(SCENARIOS / "fig5c_state_a.toml").to_dict() | {"shape": {"on_loss": "stop"}})
    inflated = load_scenario(SCENARIOS / "fig5c_state_a.toml").to_dict()
    with pytest.raises(ScenarioError, match="raise no voltage"):
        states(inflated | {"step": inflated["step"][:1]})
    with pytest.raises(ValueError, match="outside the range"):
        states(SCENARIOS / "fig5c_state_a.toml").visits([0.7])


def test_the_files_hold_the_graph(tmp_path, five):
    result = CliRunner().invoke(
        app,
        ["states", str(FIVE), "--graphml", "--plot", "--out", str(tmp_path), "--low", "0", "--high", "0.6"],
    )
    assert result.exit_code == 0, result.output
    assert "lost: turned at" in result.output
    read = networkx.read_graphml(tmp_path / "states.graphml", force_multigraph=True)
    record = json.loads((tmp_path / "states.json").read_text())
    assert read.number_of_nodes() == len(record["states"]) == 11
    assert read.number_of_edges() == len(record["transitions"]) == 19
    for one in record["transitions"]:
        edge = read.edges[str(one["source"]), str(one["target"]), one["direction"]]
        assert edge["voltage_a"] == one["voltage_a"]
        assert edge["dissipated"] == one["dissipated"]
    assert five.to_dataframe().shape[0] == 11
    assert five.transitions_to_dataframe()["balloon"].tolist()[0] == "e"
    assert (tmp_path / "states.png").read_bytes().startswith(b"\x89PNG")


def test_with_scales_voltages_and_radii_have_units(tmp_path):
    graph = states(SCENARIOS / "vhb_snap.toml", low="1 kV", high="5 kV")
    table = graph.transitions_to_dataframe()
    assert table["voltage_active [V]"].tolist() == pytest.approx([4414.67, 2827.31], rel=1e-5)
    result = CliRunner().invoke(
        app, ["states", str(SCENARIOS / "vhb_snap.toml"), "--high", "5 kV", "--out", str(tmp_path)]
    )
    assert "4.41467 kV to 1" in result.output
    assert io.StringIO((tmp_path / "states.csv").read_text()).readline().count("[m]") >= 4


def test_options_that_make_no_sense_leave_with_code_2(tmp_path):
    for along in ("left", "left=x", "nobody=1"):
        result = CliRunner().invoke(
            app, ["states", str(SCENARIOS / "push_pull.toml"), "--along", along, "--out", str(tmp_path)]
        )
        assert result.exit_code == 2


def test_a_history_of_the_shipped_five_is_as_the_graph_says(five):
    history = simulate(load_scenario(FIVE).with_values({"output.points": 2}))
    events = [event for event in history.mechanical if event.kind == "limit_point"]
    passed = five.visits([0.6, 0.0])
    assert [float(event.voltage[0]) for event in events] == pytest.approx(
        [one.drive for one in passed], rel=1e-12
    )
    assert history.energy_balance.electrical_work == pytest.approx(
        sum(one.dissipated for one in passed)
        + history.energy_balance.stored
        - history.energy_balance.gas_work,
        rel=1e-8,
    )
