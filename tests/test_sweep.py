"""Sweeps: which runs are played, and what their rows say."""

from __future__ import annotations

import csv
import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simulator import load_scenario, simulate
from simulator.analysis.trace import trace
from simulator.simulation.run import SolverError
from simulator.sweep import load_sweep, read_sweep
from simulator.sweep import rows as rows_room
from simulator.sweep.optimum import read_question
from simulator.sweep.plan import Axis, Sweep
from simulator.sweep.rows import as_text, play
from tests.pairs import pair
from tests.sweeps import CHEAP, FIG3C, FIG5B, ROOT, swept

# --- what a row says ---


@pytest.mark.parametrize(
    ("radius", "ambient", "inflation", "behaviour", "voltage"),
    [  # the table of docs/physics.md, 40 digits rounded to eight
        (1.0, 1.0, 0.6, "loss_of_tension", None),
        (1.0, 1.0, 1.3, "continuous", None),
        (1.0, 0.2, 0.6, "snap_to_loss_of_tension", 0.58183674),
        (1.0, 0.015, 1.2, "snap_returns", 0.36044087),
        (0.5, 1.0, 1.2, "snap_to_loss_of_tension", 0.49689270),
        (0.5, 1.0, 2.4, "snap_stays", 0.13925397),
        (0.5, 1.0, 2.6, "continuous", None),
        (0.5, 0.05, 1.2, "snap_returns", 0.49619765),
        (0.5, 0.05, 2.4, "snap_stays", 0.13914986),
    ],
)
def test_what_the_paper_finds_is_what_the_rows_say(radius, ambient, inflation, behaviour, voltage):
    sweep = read_sweep(ROOT / "scenarios/sweeps/paper_map.toml")
    row = play(sweep.job, 0, (radius, ambient, inflation))
    assert row["behaviour"] == behaviour
    if voltage is None:
        assert row["limit_points"] == 0
        assert row["step.2.ramp"] == 0.75
    else:
        assert row["limit_point_1_voltage_active"] == pytest.approx(voltage, abs=5e-9)
        met = row["limit_point_1_voltage_active"]
        assert row["step.2.ramp"] == pytest.approx(1.001 * met, rel=1e-14)
    assert row["energy_imbalance"] < 1e-8


def test_a_row_has_the_numbers_of_the_history(tmp_path):
    (_, row), *_ = swept(tmp_path, {"scenario": str(FIG3C), "vary": {"step.1.inflate": [1.2]}}).iterrows()
    history = simulate(load_scenario(FIG3C))
    up, down = history.mechanical
    assert row["limit_points"] == 2
    assert row["limit_point_1_voltage_active"] == up.voltage[0] == pytest.approx(0.36044087, abs=5e-9)
    assert row["limit_point_2_voltage_active"] == down.voltage[0] == pytest.approx(0.27029133, abs=5e-9)
    assert row["landing_stretch_active"] == up.stretch_after[0] == pytest.approx(6.51514013, abs=5e-9)
    assert row["landing_pressure"] == up.pressure_after
    assert row["largest_stretch_passive"] == history.stretch[:, 1].max()
    assert row["largest_field_active"] == np.abs(history.field).max()
    assert row["residual_stretch_active"] == pytest.approx(1.2625778856, abs=1e-10)
    assert row["sealed_stretch_passive"] == pytest.approx(1.2625778856, abs=1e-10)
    assert row["loop_work"] == pytest.approx(40.830526, abs=5e-7)
    assert row["dissipated"] == pytest.approx(40.830526, abs=5e-7)


def test_snaps_of_the_inflation_are_told_apart_from_those_of_the_voltage(tmp_path):
    table = swept(tmp_path, {"scenario": str(FIG5B), "vary": {"step.1.inflate": [1.2, 2.4, 2.6]}})
    assert table["inflation_snaps"].tolist() == [0, 1, 2]
    assert table["limit_points"].tolist() == [0, 1, 0]
    assert table["behaviour"].tolist() == ["continuous", "snap_stays", "continuous"]
    assert table["residual_stretch_active"][1] == pytest.approx(6.02643177, abs=5e-9)
    assert math.isnan(table["landing_pressure"][0])


def test_breakdown_and_voltage_left_on(tmp_path):
    strong = {**load_scenario(FIG3C).to_dict()}
    strong["step"] = strong["step"][:2]
    table = swept(
        tmp_path, {"scenario": strong, "vary": {"balloon.active.breakdown.field": [0.5, 12.0, 50.0]}}
    )
    assert table["behaviour"].tolist() == ["breakdown", "snap_to_breakdown", "snap"]
    assert table["outcome"].tolist() == ["breakdown", "breakdown", "completed"]
    assert table["largest_field_active"][0] == pytest.approx(0.5, abs=1e-9)


def test_a_run_that_fails_is_a_row(tmp_path, monkeypatch):
    def broken(scenario):
        if scenario.gas.ambient_pressure == 2.0:
            raise ZeroDivisionError("a bug,\nsomewhere")
        return simulate(scenario)

    monkeypatch.setattr(rows_room, "simulate", broken)
    definition = {"scenario": CHEAP, "vary": {"gas.ambient_pressure": [1.0, 2.0, 3.0]}}
    table = swept(tmp_path, definition)
    assert table["outcome"].tolist() == ["completed", "failed", "completed"]
    assert table["error"].tolist() == ["", "ZeroDivisionError: a bug, somewhere", ""]
    assert math.isnan(table["limit_points"][1])
    grid = load_sweep(tmp_path)
    assert np.isnan(grid["loop_work"].to_numpy()).tolist() == [False, True, False]


def test_values_that_do_not_go_together_are_rows(tmp_path):
    scenario = {**CHEAP, "output": {"every": 1e6}}
    table = swept(
        tmp_path, {"scenario": scenario, "vary": {"step.2.over": [1.0, 1e7], "output.every": [0.5, 1e6]}}
    )
    assert table["outcome"].tolist() == ["completed", "completed", "refused", "completed"]
    assert table["error"][2].startswith("output.every = 0.5: must ask for at most 10,000,000 samples")


def test_a_ramp_down_goes_past_its_limit_point_too(tmp_path):
    scenario = pair(1.2, {"ramp": 0.4}, {"ramp": 0.0}, ambient=0.015).to_dict()
    definition = {
        "scenario": scenario,
        "vary": {"gas.ambient_pressure": [0.015]},
        "past_limit_point": {"step.3.ramp": {"times": 1.01}},
    }
    row = swept(tmp_path, definition).iloc[0]
    assert row["limit_point_2_voltage_active"] == pytest.approx(0.27029133, abs=5e-9)
    assert row["step.3.ramp"] == pytest.approx(0.4 + 1.01 * (0.27029133 - 0.4), abs=2e-8)
    assert row["behaviour"] == "snap"  # the voltage is still on


def test_what_fails_beyond_the_limit_point_is_not_gone_through(monkeypatch):
    scenario = pair(1.2, {"ramp": 0.75}, {"ramp": 0.0}, ambient=0.015)
    job = read_sweep(
        {
            "scenario": scenario.to_dict(),
            "vary": {"gas.ambient_pressure": [0.015]},
            "past_limit_point": {"step.2.ramp": {"times": 1.001}},
        }
    ).job

    def fragile(scenario):
        if scenario.steps[1].ramp == 0.75:
            raise SolverError("beyond", simulate(scenario))
        return simulate(scenario)

    monkeypatch.setattr(rows_room, "simulate", fragile)
    row = play(job, 0, (0.015,))
    assert (row["behaviour"], row["outcome"]) == ("snap_returns", "completed")
    job = replace(job, past=None)
    row = play(job, 0, (0.015,))
    assert (row["behaviour"], row["outcome"], row["error"]) == ("failed", "failed", "beyond")


def limit_point(scenario):
    return next(point for point in trace(scenario).points if point.kind == "limit_point")


def test_sensitivities_as_columns(tmp_path):
    keys = ["gas.ambient_pressure", "step.1.inflate"]
    definition = {
        "scenario": str(FIG3C),
        "vary": {"step.1.inflate": [1.2, 1.3]},
        "record": {"sensitivities": keys},
    }
    table = swept(tmp_path, definition)
    found = table["d(limit_point_1_voltage_active)/d(step.1.inflate)"]
    h = 1e-5
    ends = [limit_point(pair(1.2 + e, {"ramp": 0.1}, ambient=0.015)).voltage[0] for e in (h, -h)]
    assert found[0] == pytest.approx((ends[0] - ends[1]) / (2 * h), rel=1e-7)
    assert math.isnan(found[1])  # state C has no limit point


def test_a_run_without_sensitivities_keeps_its_other_numbers(monkeypatch):
    def none(*words):
        raise ArithmeticError("the state is no limit point")

    monkeypatch.setattr("simulator.analysis.sensitivity.sensitivities", none)
    definition = {
        "scenario": str(FIG3C),
        "vary": {"step.1.inflate": [1.2]},
        "record": {"sensitivities": True},
    }
    row = play(read_sweep(definition).job, 0, (1.2,))
    assert (row["behaviour"], row["error"]) == (
        "snap_returns",
        "no sensitivities: the state is no limit point",
    )
    assert row["loop_work"] == pytest.approx(40.830526, abs=5e-7)


# --- what is played ---


def test_the_last_axis_changes_fastest_and_all_balloons_go_by_a_star():
    sweep = read_sweep(
        {
            "scenario": CHEAP,
            "vary": {"gas.ambient_pressure": [1, 2], "balloon.*.elastomer.J_lim": [50, 60, 70]},
        }
    )
    assert (sweep.shape, sweep.size) == ((2, 3), 6)
    assert sweep.values(2, 5) == [(1.0, 70.0), (2.0, 50.0), (2.0, 60.0)]
    row = play(sweep.job, 0, (1.0, 50.0))
    alone = simulate(pair(0.6, {"ramp": 0.2}, J_lim=50.0))
    assert row["largest_stretch_passive"] == pytest.approx(alone.stretch[:, 1].max(), abs=1e-14)


def test_spacings_reach_their_ends():
    span = {"from": 0.01, "to": 1.0, "points": 5}
    values = {
        spacing: read_sweep({"scenario": CHEAP, "vary": {"step.1.inflate": {**span, "spacing": spacing}}})
        for spacing in ("linear", "log")
    }
    for spacing, sweep in values.items():
        (axis,) = sweep.axes
        steps = np.diff(np.log(axis.values) if spacing == "log" else axis.values)
        assert (axis.values[0], axis.values[-1]) == (0.01, 1.0)
        assert np.ptp(steps) < 1e-14


@pytest.mark.parametrize("method", ["sobol", "latin-hypercube", "random"])
def test_samples_fill_their_intervals_and_come_again(method):
    definition = {
        "scenario": CHEAP,
        "sample": {"method": method, "size": 256, "seed": 3},
        "vary": {
            "gas.ambient_pressure": {"from": 0.01, "to": 1.0, "spacing": "log"},
            "step.1.inflate": {"from": 1.0, "to": 0.5},
        },
    }
    sweep, again = read_sweep(definition), read_sweep(definition)
    points = np.array(sweep.values(0, 256))
    assert points.tolist() == np.array(again.values(0, 256)).tolist()
    assert points[100:103].tolist() == [list(row) for row in sweep.values(100, 103)]
    assert (points.min(0) >= [0.01, 0.5]).all()
    assert (points.max(0) <= [1.0, 1.0]).all()
    tenths = np.histogram(np.log(points[:, 0]), 8, (math.log(0.01), 0.0))[0]
    assert (tenths == 32).all() if method != "random" else (tenths > 10).all()
    other = read_sweep({**definition, "sample": {"method": method, "size": 256, "seed": 4}})
    assert other.values(0, 1) != sweep.values(0, 1)


def test_whole_numbers_stay_whole_and_texts_are_values(tmp_path):
    scenario = {**CHEAP, "step": [CHEAP["step"][0], {"cycle": 1, "steps": [{"ramp": 0.1}, {"ramp": 0.0}]}]}
    definition = {
        "scenario": scenario,
        "vary": {"step.2.cycle": [1, 3], "step.2.steps.1.valve": ["open", "closed"]},
    }
    table = swept(tmp_path, definition)
    assert (table["outcome"] == "completed").all()
    grid = load_sweep(tmp_path)
    assert grid["step.2.steps.1.valve"].to_numpy().tolist() == ["open", "closed"]
    assert (
        grid["loop_work"].sel({"step.2.cycle": 3.0, "step.2.steps.1.valve": "closed"}).item()
        == table["loop_work"][3]
    )


@given(st.lists(st.integers(1, 7), min_size=1, max_size=4), st.data())
def test_every_run_of_a_grid_has_its_own_values(shape, data):
    axes = tuple(Axis(f"key.{i}", tuple(float(v) for v in range(n))) for i, n in enumerate(shape))
    job = replace(read_sweep({"scenario": CHEAP, "vary": {"step.1.inflate": [0.1]}}).job, axes=axes)
    sweep = Sweep("", "", job, None, {})
    values = sweep.values(0, sweep.size)
    assert values == list(product(*(axis.values for axis in axes)))
    start = data.draw(st.integers(0, sweep.size))
    stop = data.draw(st.integers(start, sweep.size))
    assert sweep.values(start, stop) == values[start:stop]


@given(st.lists(st.floats(), min_size=2, max_size=2), st.text(max_size=30))
def test_rows_come_back_to_the_last_bit(numbers, text):
    ((first, second, words),) = csv.reader([as_text([[*numbers, text]]).removesuffix("\n")])
    for cell, number in zip((first, second), numbers, strict=True):
        assert math.isnan(number) if cell == "" else float(cell) == number
    assert words == " ".join(text.split())


@pytest.mark.parametrize(
    "file", sorted((ROOT / "scenarios/sweeps").glob("*.toml")), ids=lambda file: file.stem
)
def test_every_shipped_file_reads(file):
    text = file.read_text()
    if "maximize" in text:
        assert read_question(file).column in ("largest_stretch_active", "least_margin_active")
    elif "[vary]" in text:
        assert read_sweep(file).size > 1000
    else:
        assert load_scenario(file).title


def test_numbers_in_units_keep_them():
    scenario = load_scenario(ROOT / "scenarios/vhb_snap.toml").to_dict()
    vary = {"gas.ambient_pressure": {"from": "1 kPa", "to": "3 kPa", "points": 3}}
    (axis,) = read_sweep({"scenario": scenario, "vary": vary}).job.axes
    assert axis == Axis("gas.ambient_pressure", (1.0, 2.0, 3.0), " kPa")
    assert [axis.written(value) for value in axis.values] == ["1.0 kPa", "2.0 kPa", "3.0 kPa"]
