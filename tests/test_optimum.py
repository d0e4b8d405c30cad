"""The best run under conditions: against roots that are known, and what cannot be asked."""

from __future__ import annotations

import csv
import dataclasses
from collections import Counter

import pytest
from scipy.optimize import brentq

from simulator import load_scenario, simulate
from simulator.scenario import ScenarioError
from simulator.scenario.mapping import with_values
from simulator.sweep import evaluations
from simulator.sweep.lockstep.chunk import DisagreementError, compare
from simulator.sweep.optimum import Bounds, optimize, read_question
from simulator.sweep.rows import play
from tests.pairs import pair
from tests.sweeps import balloons

DRIVEN = pair(1.2, {"ramp": 0.5}, output={"points": 2}).to_dict()
QUICK = {"population": 5, "generations": 14, "seed": 1}


def test_the_largest_stretch_below_a_field_is_where_the_field_is_reached():
    question = read_question(
        {
            "scenario": DRIVEN,
            "maximize": "largest_stretch_active",
            "vary": {"step.2.ramp": {"from": 0.1, "to": 0.6}},
            "where": {"largest_field_active": {"below": 0.8}, "behaviour": "snap"},
            "search": QUICK,
        }
    )
    nothing = optimize(question)
    assert nothing.row is None  # this pair has no limit point at an ambient pressure of 1
    question = type(question)(
        question.sweep,
        question.column,
        question.sense,
        {**question.where, "behaviour": ("continuous", "snap")},
        question.search,
    )
    found = optimize(question)

    def excess(voltage):
        history = simulate(load_scenario(with_values(DRIVEN, {"step.2.ramp": voltage})))
        return history.field.max() - 0.8

    voltage = brentq(excess, 0.1, 0.5, xtol=1e-12)
    assert found.row["largest_field_active"] <= 0.8
    assert found.row["step.2.ramp"] == pytest.approx(voltage, abs=1e-3)
    assert found.value == found.row["largest_stretch_active"]
    assert len({row["step.2.ramp"] for row in found.runs}) == len(found.runs)


def test_a_limit_point_made_small_lies_at_the_mechanical_peak(tmp_path):
    """The voltage of the limit point falls as the inflation nears its own, at p = 1.2537."""
    question = read_question(
        {
            "scenario": pair(1.0, {"ramp": 0.75}, ambient=0.015, output={"points": 2}).to_dict(),
            "minimize": "limit_point_1_voltage_active",
            "vary": {"step.1.inflate": {"from": 0.5, "to": 1.4, "spacing": "log"}},
            "search": QUICK,
        }
    )
    found = optimize(question)
    assert 1.25 < found.row["step.1.inflate"] < 1.2536546
    best, every = found.to_csv(tmp_path)
    with open(best, newline="") as stream:
        (row,) = csv.DictReader(stream)
    assert float(row["limit_point_1_voltage_active"]) == found.value
    assert len(every.read_text().splitlines()) == len(found.runs) + 1


def generations():
    return read_question(
        {
            "scenario": pair(1.2, {"ramp": 0.5}, ambient=0.015, output={"points": 2}).to_dict(),
            "maximize": "largest_stretch_active",
            "vary": {
                "step.1.inflate": {"from": 0.9, "to": 1.2},
                "step.2.ramp": {"from": 0.1, "to": 0.5},
            },
            "where": {"largest_field_active": {"below": 1.0}},
            "search": {"population": 8, "generations": 3},
        }
    )


def test_a_generation_is_played_in_lockstep_and_the_best_run_by_itself():
    question = generations()
    found = optimize(question)
    ways = Counter(row["way"] for row in found.runs)
    assert len(found.runs) > 48
    assert ways["lockstep"] > 0.9 * len(found.runs)
    assert found.row["way"] == "simulate"
    for k in (found.row["run"] - 1, 20, 45):
        row = found.runs[k]
        values = [row[axis.key] for axis in question.sweep.job.axes]
        compare(k + 1, row, play(question.sweep.job, k, values))
    fit = [row for row in found.runs if row["largest_field_active"] <= 1.0]
    assert 0 < len(fit) < len(found.runs)
    assert found.value == max(row["largest_stretch_active"] for row in fit)


def test_a_best_run_that_crosses_its_limit_by_itself_is_none(monkeypatch):
    # The two ways differ by rounding, and an optimum lies on its limit.
    question = generations()
    best = optimize(question)
    limit = best.row["largest_field_active"]

    def beyond(job, index, values, *expected):
        row = play(job, index, values, *expected)
        if row["largest_field_active"] == limit:
            row["largest_field_active"] = 1.0 + 1e-9 if limit == 1.0 else limit * (1.0 + 1e-10)
        return row

    monkeypatch.setattr(evaluations, "play", beyond)
    bounds = {"largest_field_active": Bounds(below=limit)}
    found = optimize(dataclasses.replace(question, where=bounds))
    assert found.row["run"] != best.row["run"]
    assert found.row["largest_field_active"] < limit


@pytest.mark.parametrize("which", ["all", "best"])
def test_a_run_that_comes_out_otherwise_by_itself_is_an_error(which, monkeypatch):
    best = optimize(generations()).row["run"] - 1

    def wrong(job, index, values, *expected):
        right = play(job, index, values, *expected)
        return {**right, "limit_points": 7} if which == "all" or index == best else right

    monkeypatch.setattr(evaluations, "play", wrong)
    with pytest.raises(DisagreementError, match="limit_points"):
        optimize(generations())


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        ({"maximise": "loop_work"}, 'maximise = "loop_work": unknown key'),
        ({}, "maximize: must be given, or minimize, and not both"),
        ({"maximize": "loop_work", "minimize": "loop_work"}, "must be given, or minimize, and not both"),
        ({"maximize": "stretch_active"}, "must be a column of numbers; did you mean"),
        (
            {"maximize": "loop_work", "where": {"behavior": "snap"}},
            "where.behavior: must be a column of words; did",
        ),
        ({"maximize": "loop_work", "where": {"behaviour": {"below": 1.0}}}, "must be a column of numbers"),
        ({"maximize": "loop_work", "where": {"behaviour": 3}}, "where.behaviour = 3: must be { below = … }"),
        (
            {"maximize": "loop_work", "where": {"dissipated": {}}},
            "where.dissipated = {}: must have below or above",
        ),
        ({"maximize": "loop_work", "search": {"seed": -1}}, "search.seed = -1: must be a whole number >= 0"),
        ({"maximize": "loop_work", "sample": {}}, "sample = {}: does not go with an optimum"),
        ({"maximize": "loop_work", "vary": {"step.2.ramp": [1.0]}}, "must be an interval such as"),
    ],
)
def test_refused(asked, told):
    vary = {"step.2.ramp": {"from": 0.1, "to": 0.2}}
    with pytest.raises(ScenarioError) as caught:
        read_question({"scenario": DRIVEN, "vary": vary, **asked})
    assert told in str(caught.value)


def test_the_command(tmp_path):
    (tmp_path / "pair.toml").write_text(
        'title = "a film"\n[gas]\nambient_pressure = 1.0\n[[balloon]]\nname = "a"\nelectrodes = true\n'
        'elastomer = { model = "neo-hookean" }\n[[step]]\ninflate = 0.5\n[[step]]\nramp = 0.1\n'
    )
    text = (
        'scenario = "pair.toml"\nmaximize = "largest_stretch_a"\n'
        '[vary]\n"step.2.ramp" = { from = 0.0, to = 0.2 }\n'
        "[where]\nlargest_field_a = { LIMIT }\n[search]\ngenerations = 3\npopulation = 5\n"
    )
    (tmp_path / "best.toml").write_text(text.replace("LIMIT", "below = 1.0"))
    result = balloons("optimize", tmp_path / "best.toml", "--out", tmp_path / "out")
    assert result.exit_code == 0
    assert "largest  largest_stretch_a = 1." in result.stdout
    assert "at       step.2.ramp = 0.1" in result.stdout
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["evaluations.csv", "optimum.csv"]
    (tmp_path / "none.toml").write_text(text.replace("LIMIT", "above = 100.0"))
    result = balloons("optimize", tmp_path / "none.toml", "--out", tmp_path / "none")
    assert result.exit_code == 3
    assert "runs meets the conditions" in result.stderr
    (tmp_path / "bad.toml").write_text(text.replace("LIMIT", "beyond = 1.0"))
    result = balloons("optimize", tmp_path / "bad.toml")
    assert result.exit_code == 2
    assert (
        "bad.toml: where.largest_field_a.beyond = 1.0: unknown key, allowed here: below, above"
        in result.stderr
    )


def test_the_least_margin_to_breakdown_can_be_asked_for():
    """Of a constant strength it is 1 − E/E_b of the largest field; it is recorded where it is named."""
    scenario = pair(1.1, {"ramp": 0.2}, active={"breakdown": {"field": 5.0}}).to_dict()
    question = {
        "scenario": scenario,
        "maximize": "largest_stretch_active",
        "where": {"least_margin_active": {"above": 0.9}},
        "vary": {"step.2.ramp": {"from": 0.1, "to": 0.5}},
        "search": {"population": 5, "generations": 5},
    }
    found = optimize(question)
    assert found.row["least_margin_active"] == pytest.approx(1.0 - found.row["largest_field_active"] / 5.0)
    assert 0.9 <= found.row["least_margin_active"] < 0.91
    without = pair(1.1, {"ramp": 0.2}).to_dict()
    with pytest.raises(ScenarioError, match="no balloon of the scenario has a breakdown"):
        read_question({**question, "scenario": without})
