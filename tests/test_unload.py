"""Unloading from every peak: against the closed form of the pair, and against histories one by one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from simulator import (
    OutputError,
    ScenarioError,
    load_scenario,
    load_unloading,
    simulate,
    simulate_many,
    states,
    unload,
    unload_map,
)
from simulator.cli import app
from simulator.results.html import unloading_html
from tests.oracle.closed_form import SealedPair, equilibrium_curve, reference_history

SCENARIOS = Path(__file__).parent.parent / "scenarios"


def scenario(name: str):
    return load_scenario(SCENARIOS / f"{name}.toml")


def test_a_state_remains_from_every_peak_beyond_the_threshold():
    found = unload(scenario("fig5b_state_b"), "0.1:0.2:41", reload=True)
    beyond = found.peaks > 0.13925397
    np.testing.assert_allclose(found.remanent_stretch[beyond, 0], 6.02643177, rtol=1e-9)
    np.testing.assert_allclose(found.remanent_pressure[beyond], 2.18594438, rtol=1e-8)
    np.testing.assert_allclose(found.remanent_stretch[~beyond, 0], 1.2625778856, rtol=1e-10)
    assert found.closed.tolist() == (~beyond).tolist()
    assert found.reloaded.all()
    (threshold,) = {v for v, _ in found.thresholds}
    assert threshold == pytest.approx(0.13925397, abs=1e-8)


@pytest.mark.parametrize("name", ["fig3c_state_b", "fig5c_state_a", "fig5b_state_b", "fig5c_state_b"])
def test_remanence_losses_and_areas_are_those_of_the_closed_form(name):
    one = scenario(name)
    pair = SealedPair.from_scenario(one)
    curve = equilibrium_curve(pair)
    found = unload(one, [0.1, 0.2, 0.3, 0.37, 0.45, 0.55], points=3)
    for i, peak in enumerate(found.peaks.tolist()):
        exact = reference_history(pair, [peak, 0.0], curve)
        if found.outcome[i] != "completed":
            assert exact.outcome == found.outcome[i]
            continue
        np.testing.assert_allclose(found.remanent_stretch[i], exact.state[:2], rtol=1e-10)
        lost = sum(event.dissipated or 0.0 for event in exact.events)
        assert found.dissipated[i] == pytest.approx(lost, rel=1e-9, abs=1e-12)
        # Of a closed loop the area, a quadrature along the branches, is what the snaps lose.
        if found.closed[i]:
            assert abs(found.area[i] - lost) <= 1e-8 * max(lost, 1e-3)


def test_the_area_of_fig_3c_b_is_that_of_40_digit_arithmetic():
    found = unload(scenario("fig3c_state_b"), [0.3, 0.4])
    assert found.area.tolist() == pytest.approx([0.0, 40.830526], abs=1e-6)
    assert found.dissipated[1] == pytest.approx(37.383002 + 3.447524, abs=1e-6)


@pytest.mark.parametrize(
    ("name", "peaks"),
    [("fig5c_state_a", (0.2, 0.55)), ("five_states", (0.42, 0.5, 0.54, 0.6)), ("fig3b_state_a", (0.5, 0.6))],
)
def test_each_peak_is_as_a_history_of_its_own(name, peaks):
    document = scenario(name).to_dict()
    found = unload(document, peaks)
    names = found.electroded
    for i, peak in enumerate(peaks):
        steps = [{"ramp": dict.fromkeys(names, v)} for v in (peak, 0.0)]
        history = simulate({**document, "step": [document["step"][0], *steps], "output": {"points": 2}})
        assert history.outcome.value == found.outcome[i]
        rows = (found.peak == peak) & (found.event != "")
        events = [e for e in history.mechanical if e.step > 1]
        assert found.drive[rows] == pytest.approx(
            [float(e.voltage[0]) for e in events[: rows.sum()]], rel=1e-12
        )
        if found.outcome[i] == "completed":
            np.testing.assert_allclose(found.remanent_stretch[i], history.stretch[-1], rtol=1e-10)
            balance = history.energy_balance
            assert found.area[i] == pytest.approx(balance.electrical_work, abs=1e-8 * balance.exchanged)
            assert found.dissipated[i] == pytest.approx(balance.dissipated, rel=1e-10, abs=1e-12)


def test_what_was_written_is_read_back_exactly(tmp_path):
    found = unload(scenario("vhb_snap"), "2kV:6kV:3", reload=True, points=3)
    ended = unload(scenario("fig3a_state_a"), [0.3, 0.6], points=3)
    maps = unload_map(scenario("fig5c_state_a"), [0.4, 0.6], "gas.ambient_pressure", [0.05, 1.0])
    for number, one in enumerate((found, ended, maps)):
        one.to_csv(tmp_path / str(number))
        again = load_unloading(tmp_path / str(number))
        assert again == one
        assert type(again) is type(one)
    with pytest.raises(OutputError, match=r"unload\.json"):
        load_unloading(tmp_path)
    (tmp_path / "unload.json").write_text("{}")
    with pytest.raises(OutputError, match="no unloading"):
        load_unloading(tmp_path)


def test_unloading_as_labelled_arrays_and_in_a_notebook():
    one = scenario("vhb_snap")
    found = unload(one, "2kV:6kV:3", points=3)
    arrays = found.to_xarray()
    assert arrays["peak"].values.tolist() == pytest.approx([2000.0, 4000.0, 6000.0])
    assert (arrays["peak"].attrs["units"], arrays["area"].attrs["units"]) == ("V", "J")
    np.testing.assert_allclose(arrays["area"], found.area * one.scales.energy, rtol=1e-15)
    np.testing.assert_allclose(
        arrays["remanent_stretch"].sel(balloon="active"), found.remanent_stretch[:, 0], rtol=0
    )
    maps = unload_map(scenario("fig5c_state_a"), [0.4, 0.6], "gas.ambient_pressure", [0.05, 1.0])
    assert maps.to_xarray()["outcome"].sel({"gas.ambient_pressure": 1.0, "peak": 0.6}) == "loss_of_tension"
    assert not maps.to_xarray()["area"].attrs
    assert "stretches that remain" in unloading_html(found)
    assert all(text in unloading_html(maps) for text in ("<h4>", "data:image/png"))


def test_a_map_takes_the_place_of_what_was_there_before(tmp_path):
    words = ["unload", str(SCENARIOS / "fig5c_state_a.toml"), "--peaks", "0.4:0.6:2", "--out", str(tmp_path)]
    assert CliRunner().invoke(app, words).exit_code == 0
    assert CliRunner().invoke(app, [*words, "--vary", "gas.ambient_pressure=0.05:1:2"]).exit_code == 0
    assert {path.name for path in tmp_path.iterdir()} == {"unload_map.csv", "unload_map.json"}
    assert CliRunner().invoke(app, words).exit_code == 0
    assert {path.name for path in tmp_path.iterdir()} == {"unload.csv", "peaks.csv", "unload.json"}


def test_in_lockstep_the_same_remains():
    one = scenario("five_states").with_values({"output.points": 2})
    peaks = np.linspace(0.3, 0.6, 9)
    found = unload(one, peaks, points=2)
    runs = simulate_many(one, {"step.2.ramp": peaks})
    for i, name in enumerate(found.balloons):
        np.testing.assert_allclose(runs[f"residual_stretch_{name}"], found.remanent_stretch[:, i], rtol=1e-7)
    np.testing.assert_allclose(runs["dissipated"], found.dissipated, rtol=1e-7, atol=1e-9)


def test_steps_are_where_they_are_and_a_second_rise_may_lead_elsewhere():
    found = unload(scenario("five_states"), [0.5, 0.562, 0.6], reload=True, points=2)
    up = [one.drive for one in states(scenario("five_states")).visits([0.6])]
    assert sorted({v for v, leg in found.thresholds if leg == "load"}) == pytest.approx(up, rel=1e-12)
    # The counterexample to return-point memory: e is small at 0.562 the second time.
    assert found.reloaded.tolist() == [True, False, True]


def test_where_the_device_ends_nothing_remains():
    found = unload(scenario("fig3b_state_a"), [0.5, 0.6])
    assert found.outcome == ("completed", "loss_of_tension")
    assert np.isnan(found.remanent_stretch[1]).all()
    assert np.isnan(found.area[1])
    assert found.drive[found.peak == 0.6].max() == pytest.approx(0.58183674, abs=1e-8)


def test_a_map_is_what_unloading_gives_for_each_value():
    values = [0.05, 0.4, 1.0]
    found = unload_map(scenario("fig5c_state_b"), "0.1:0.2:5", "gas.ambient_pressure", values)
    for i, value in enumerate(values):
        one = unload(scenario("fig5c_state_b").with_values({"gas.ambient_pressure": value}), found.peaks)
        np.testing.assert_array_equal(found.remanent_stretch[i], one.remanent_stretch)
    assert found.remanent_stretch[2, -1, 0] == pytest.approx(6.02643177, abs=1e-8)
    refused = unload_map(scenario("fig5c_state_b"), [0.1], "step.1.inflate", [2.4, 0.0])
    assert refused.outcome == (("completed",), ("refused",))


@pytest.mark.parametrize(
    ("peaks", "allowed"),
    [
        ([-0.1, 0.2], ">= 0"),
        ([0.0, 0.2], "> 0"),
        ([], "must be numbers"),
        ("0.1:0.2", "first:last:count"),
        ("0.1:0.2:0", "first:last:count"),
        ("a:0.2:3", "a number"),
        ("1 kV:2 kV:3", "[scales]"),
        ([[0.1]], "must be numbers"),
        ([float("nan")], "a number"),
    ],
)
def test_peaks_that_make_no_sense_are_refused(peaks, allowed):
    with pytest.raises(ScenarioError) as caught:
        unload(scenario("fig5c_state_a"), peaks)
    assert caught.value.key == "peaks"
    assert allowed in caught.value.allowed


def test_other_input_that_makes_no_sense_is_refused():
    with pytest.raises(ScenarioError, match="electrodes = true"):
        unload(SCENARIOS / "fig2_inflation.toml", [0.1])
    with pytest.raises(ScenarioError, match="dynamics"):
        unload(SCENARIOS / "delayed_snap.toml", [0.1])
    with pytest.raises(ScenarioError, match="points"):
        unload(scenario("fig5c_state_a"), [0.1], points=1)
    with pytest.raises(ScenarioError, match="no such key"):
        unload_map(scenario("fig5c_state_a"), [0.1], "gas.ambient_presure", [0.1])


def test_the_command_writes_what_python_gives(tmp_path):
    result = CliRunner().invoke(
        app,
        [
            "unload",
            str(SCENARIOS / "vhb_snap.toml"),
            "--peaks",
            "2 kV:6 kV:9",
            "--reload",
            "--plot",
            "--out",
            str(tmp_path),
        ],
    )
    assert result.exit_code == 0, result.output
    assert "4.41467 kV" in result.output
    found = unload(SCENARIOS / "vhb_snap.toml", "2 kV:6 kV:9", reload=True)
    header = (tmp_path / "unload.csv").read_text().split("\n", 1)[0]
    assert header.split(",") == list(found.rows_to_dataframe().columns)
    assert "peak [V]" in header
    assert "area [J]" in (tmp_path / "peaks.csv").read_text().split("\n", 1)[0]
    assert (tmp_path / "unload.png").read_bytes().startswith(b"\x89PNG")


def test_the_command_maps_a_second_number(tmp_path):
    arguments = [
        "unload",
        str(SCENARIOS / "fig5c_state_b.toml"),
        "--peaks",
        "0.1:0.2:3",
        "--out",
        str(tmp_path),
    ]
    result = CliRunner().invoke(app, [*arguments, "--vary", "gas.ambient_pressure=0.05:1:3", "--plot"])
    assert result.exit_code == 0, result.output
    assert len((tmp_path / "unload_map.csv").read_text().splitlines()) == 10
    assert (tmp_path / "unload_map.png").exists()
    for wrong in (
        ["--vary", "gas.ambient_pressure"],
        ["--peaks", "-1:2:3"],
        ["--vary", "gas.pressure=1:2:3"],
    ):
        assert CliRunner().invoke(app, [*arguments, *wrong]).exit_code == 2
