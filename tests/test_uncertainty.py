"""Samples from distributions and what they say, against SciPy, closed forms and an integral over a grid."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from scipy import stats

from simulator import (
    OutputError,
    ScenarioError,
    load_table,
    read_question,
    read_sweep,
    simulate_many,
    uncertainty,
)
from simulator.sweep.indices import indices_of
from simulator.sweep.lockstep.stacking import Stack, stacks
from simulator.sweep.picking import PickError, pick
from simulator.sweep.plan import Axis, Sample, drawn
from simulator.sweep.quantiles import QUANTILES, Probability, of_columns
from simulator.sweep.spread import Spread
from tests.sweeps import CHEAP, FIG3C, balloons, swept

SHARES = np.array([0.001, 0.1, 0.5, 0.8, 0.999])
VHB = "scenarios/vhb_snap.toml"
AMBIENT = "gas.ambient_pressure"


def test_distributions_have_the_quantiles_that_scipy_gives():
    assert Spread("normal", 2.0, 0.3).at(SHARES) == pytest.approx(stats.norm.ppf(SHARES, 2.0, 0.3))
    cut = stats.truncnorm((1.9 - 2.0) / 0.3, (2.2 - 2.0) / 0.3, loc=2.0, scale=0.3)
    assert Spread("normal", 2.0, 0.3, 1.9, 2.2).at(SHARES) == pytest.approx(cut.ppf(SHARES))
    low, mode, high = 1.0, 1.5, 4.0
    turn = (mode - low) / (high - low)
    rising = low + np.sqrt(SHARES * (high - low) * (mode - low))
    falling = high - np.sqrt((1.0 - SHARES) * (high - low) * (high - mode))
    triangular = Spread("triangular", mode, low=low, high=high)
    assert triangular.at(SHARES) == pytest.approx(np.where(turn > SHARES, rising, falling))


def test_a_lognormal_number_has_the_mean_and_the_deviation_that_are_written():
    spread = Spread("lognormal", 45.0, 9.0)
    values = spread.at((np.arange(400_000) + 0.5) / 400_000)
    assert values.mean() == pytest.approx(45.0, rel=1e-4)
    assert values.std() == pytest.approx(9.0, rel=1e-3)
    assert np.log(values).std() == pytest.approx(np.sqrt(np.log(1.04)), rel=1e-4)  # σ² = ln(1 + (s/m)²)


def test_correlated_numbers_keep_their_distributions():
    axes = (Axis("a", (0.0, 1.0), spread=Spread("normal", 1.0, 0.1)), Axis("b", (0.0, 2.0)))
    points = drawn(Sample("sobol", 4096, 3, ((1.0, -0.7), (-0.7, 1.0))), axes)
    assert np.quantile(points[:, 0], SHARES[1:4]) == pytest.approx(
        stats.norm.ppf(SHARES[1:4], 1.0, 0.1), abs=1e-3
    )
    assert np.quantile(points[:, 1], SHARES[1:4]) == pytest.approx(2.0 * SHARES[1:4], abs=5e-3)
    # Of a Gaussian copula Spearman's coefficient is 6/π asin(ρ/2).
    assert stats.spearmanr(points).statistic == pytest.approx(6.0 / np.pi * np.arcsin(-0.35), abs=5e-3)


def test_ishigamis_function_has_its_known_indices():
    a, b = 7.0, 0.1

    def ishigami(x):
        return (np.sin(x[:, 0]) + a * np.sin(x[:, 1]) ** 2 + b * x[:, 2] ** 4 * np.sin(x[:, 0]))[:, None]

    axes = [Axis(key, (-np.pi, np.pi)) for key in "xyz"]
    (found,) = indices_of(ishigami, axes, ["f"], 2048, seed=1)
    parts = np.array([0.5 * (1.0 + b * np.pi**4 / 5.0) ** 2, a**2 / 8.0, 0.0])
    together = b**2 * np.pi**8 * 8.0 / 225.0 * np.array([1.0, 0.0, 1.0])
    variance = parts.sum() + together[0]
    assert found.first_order == pytest.approx(parts / variance, abs=2e-2)
    assert found.total_order == pytest.approx((parts + together) / variance, abs=2e-2)
    assert (found.total_low <= found.total_order).all()
    assert (found.total_order <= found.total_high).all()


def test_a_probability_has_wilsons_interval():
    one = Probability.of(7, 50)
    p, z, n = 7 / 50, 1.959963985, 50
    middle = (p + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z / (1 + z**2 / n) * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
    assert (one.value, one.low, one.high) == pytest.approx((p, middle - half, middle + half))
    assert Probability.of(0, 50).high > 0.0


SPREAD = {"mean": 0.02, "sd": 0.01, "low": 0.0}


def test_a_probability_is_an_integral_over_the_region(tmp_path):
    """Of one number: the distribution between the values at which the behaviour changes, on a fine grid."""
    swept(
        tmp_path,
        {"scenario": str(FIG3C), "sample": {"method": "sobol", "size": 512}, "vary": {AMBIENT: SPREAD}},
    )
    found = uncertainty(tmp_path)
    grid = np.linspace(0.0, 0.06, 241)
    stays = simulate_many(FIG3C, {AMBIENT: grid})["behaviour"] == "snap_returns"
    law = stats.truncnorm(-2.0, np.inf, loc=0.02, scale=0.01)
    edges = np.concatenate([[0.0], 0.5 * (grid[1:] + grid[:-1]), [np.inf]])
    exact = float((law.cdf(edges[1:]) - law.cdf(edges[:-1]))[stays].sum())
    one = found.probabilities["snap_returns"]
    assert 0.1 < exact < 0.95
    assert one.value == pytest.approx(exact, abs=0.01)
    assert one.low < exact < one.high
    # The voltage of the limit point rises with the ambient pressure, so its quantiles are those of this.
    voltage = simulate_many(FIG3C, {AMBIENT: law.ppf(QUANTILES)})["limit_point_1_voltage_active"]
    assert found.quantiles["limit_point_1_voltage_active"] == pytest.approx(voltage, rel=2e-3)
    assert sum(p.value for p in found.probabilities.values()) == pytest.approx(1.0)
    runs = sorted({row[0] for row in found.settling})
    assert runs == [64, 128, 256, 512]


def test_what_is_not_written_is_that_of_the_scenario():
    sweep = read_sweep(
        {
            "scenario": VHB,
            "sample": {"method": "sobol", "size": 8},
            "vary": {
                "balloon.passive.thickness": {"rel": 0.05},
                "balloon.*.elastomer.J_lim": {"distribution": "triangular", "low": 200, "high": 300},
            },
        }
    )
    thickness, limit = sweep.axes
    assert thickness.unit.strip() == "mm"
    assert (thickness.spread.centre, thickness.spread.deviation) == (1.5, pytest.approx(0.075))
    assert (limit.spread.low, limit.spread.centre, limit.spread.high) == (200.0, 270.0, 300.0)
    assert sweep.job.units["balloon.passive.thickness"] == "mm"


def test_films_in_millimetres_are_played_in_lockstep():
    """Sizes with units are rounded to 15 digits; that is none of a rule's business."""
    vary = {
        "balloon.active.thickness": {"mean": "0.5 mm", "rel": 0.02},
        "balloon.passive.thickness": {"rel": 0.02},
    }
    sweep = read_sweep({"scenario": VHB, "sample": {"method": "random", "size": 300}, "vary": vary})
    for start in range(0, 300, 50):
        (stack,) = stacks(sweep.job, sweep.values(start, start + 50))
        assert isinstance(stack, Stack)


def test_the_command_writes_what_a_sample_says(tmp_path):
    text = 'sample = { method = "latin-hypercube", size = 40, indices = ["largest_stretch_active"] }\n'
    text += '[vary]\n"gas.ambient_pressure" = { rel = 0.05 }\n"balloon.*.elastomer.J_lim" = { rel = 0.1 }\n'
    scenario = tmp_path / "s.toml"
    import tomli_w

    scenario.write_text(tomli_w.dumps(CHEAP), "utf-8")
    (tmp_path / "sweep.toml").write_text('scenario = "s.toml"\n' + text, "utf-8")
    done = balloons("sweep", tmp_path / "sweep.toml", "--out", tmp_path / "out", "--workers", 1)
    assert done.exit_code == 0, done.output
    assert "probability, 95 % interval" in done.output
    tables = {}
    for name in ("quantiles", "probabilities", "convergence", "indices"):
        with open(tmp_path / "out" / f"{name}.csv", newline="") as stream:
            tables[name] = list(csv.DictReader(stream))
    assert [row["behaviour"] for row in tables["probabilities"]] == ["continuous"]
    assert {row["key"] for row in tables["indices"]} == {AMBIENT, "balloon.*.elastomer.J_lim"}
    first = {row["key"]: float(row["total_order"]) for row in tables["indices"]}
    assert first["balloon.*.elastomer.J_lim"] < 0.1 < first[AMBIENT]
    row = next(row for row in tables["quantiles"] if row["column"] == "largest_stretch_active")
    assert row["runs"] == "40"
    assert float(row["quantile_0.05"]) < float(row["quantile_0.5"]) < float(row["quantile_0.95"])
    assert uncertainty(tmp_path / "out").quantile("largest_stretch_active", 0.5) == float(row["quantile_0.5"])


def test_runs_that_fail_have_their_share():
    columns = {
        "run": np.arange(4),
        "behaviour": np.array(["snap", "", "snap", ""]),
        "outcome": np.array(["completed", "refused", "completed", "failed"]),
        "largest_stretch_a": np.array([1.0, np.nan, 3.0, np.nan]),
    }
    found = of_columns(columns, "t", {})
    assert {name: one.count for name, one in found.probabilities.items()} == {
        "snap": 2,
        "refused": 1,
        "failed": 1,
    }
    assert (found.counts["largest_stretch_a"], found.means["largest_stretch_a"]) == (2, 2.0)


def test_a_grid_says_nothing_of_probabilities(tmp_path):
    swept(tmp_path, {"scenario": CHEAP, "vary": {AMBIENT: [0.5, 0.6]}})
    with pytest.raises(OutputError, match="has a grid, which is not drawn"):
        uncertainty(tmp_path)


TWO = {AMBIENT: {"rel": 0.1}, "balloon.active.radius": {"rel": 0.1}}
ONE = {"of": [AMBIENT, "balloon.active.radius"], "value": 0.5}


@pytest.mark.parametrize(
    ("vary", "sample", "said"),
    [
        (
            {AMBIENT: {"rel": 0.1}},
            None,
            'vary."gas.ambient_pressure": is a distribution, which goes with sample',
        ),
        ({AMBIENT: {"rel": -0.1}}, {}, "rel = -0.1: must be a number > 0"),
        ({AMBIENT: {"rel": 0.1, "sd": 1}}, {}, "sd: must be given, or rel, and not both"),
        ({AMBIENT: {"mean": 1}}, {}, "sd: must be given, or rel, and not both"),
        ({AMBIENT: {"mean": 1, "sd": "1 kPa"}}, {}, "must have all its numbers in one unit"),
        ({AMBIENT: {"sd": "1 kPa"}}, {}, "must be in the unit of its mean, none"),
        ({AMBIENT: {"rel": 0.1, "low": 2, "high": 1}}, {}, "high = 1.0: must be larger than low, 2.0"),
        ({AMBIENT: {"rel": 0.1, "mode": 2}}, {}, "mode = 2.0: goes with triangular"),
        ({AMBIENT: {"distribution": "triangular", "low": 0}}, {}, "high: is missing, a triangular"),
        (
            {AMBIENT: {"distribution": "triangular", "low": 2, "high": 3}},
            {},
            "must have its mode between low and high",
        ),
        ({AMBIENT: {"distribution": "beta"}}, {}, '= "beta": must be "normal", "lognormal" or "triangular"'),
        ({"gas.ambient": {"rel": 0.1}}, {}, 'vary."gas.ambient"'),
        (TWO, {"correlations": [{"of": [AMBIENT, "gas.chamber"], "value": 0.5}]}, "must be varied"),
        (
            TWO,
            {"correlations": [{"of": [AMBIENT, AMBIENT], "value": 0.5}]},
            "must be two keys, each pair once",
        ),
        (TWO, {"correlations": [{**ONE, "value": 1}]}, "must be a number between -1 and 1"),
        (TWO, {"correlations": [ONE], "indices": ["largest_stretch_active"]}, "go with independent keys"),
        (
            TWO,
            {"indices": ["largest_stretch"]},
            'sample.indices = "largest_stretch": must be a column of numbers',
        ),
    ],
)
def test_what_makes_no_sense_is_said(vary, sample, said):
    given = {} if sample is None else {"sample": {"method": "random", "size": 4, **sample}}
    with pytest.raises(ScenarioError) as caught:
        read_sweep({"scenario": CHEAP, "vary": vary, **given})
    assert said in str(caught.value)


def test_three_correlations_that_exclude_one_another_are_refused():
    keys = [AMBIENT, "balloon.active.radius", "step.1.inflate"]
    pairs = [((0, 1), 0.9), ((1, 2), 0.9), ((0, 2), -0.9)]
    correlations = [{"of": [keys[i], keys[j]], "value": value} for (i, j), value in pairs]
    sample = {"method": "random", "size": 4, "correlations": correlations}
    with pytest.raises(ScenarioError, match="cannot all be true together"):
        read_sweep({"scenario": CHEAP, "sample": sample, "vary": {key: {"rel": 0.1} for key in keys}})


def test_an_optimum_is_searched_in_intervals():
    with pytest.raises(ScenarioError, match="must be an interval such as"):
        read_question({"scenario": CHEAP, "maximize": "loop_work", "vary": {AMBIENT: {"rel": 0.1}}})


def test_a_map_of_a_probability_is_a_share_in_each_cell(tmp_path):
    vary = {AMBIENT: {"from": 0.0, "to": 0.06}, "step.2.ramp": {"from": 0.3, "to": 0.5}}
    swept(tmp_path, {"scenario": str(FIG3C), "sample": {"method": "sobol", "size": 256}, "vary": vary})
    picked = pick(tmp_path, AMBIENT, "step.2.ramp", "P(behaviour=snap_returns)")
    shares = picked.columns["P(behaviour=snap_returns)"]
    table = load_table(tmp_path)
    assert shares.size == 4  # √(256/40) cells each way
    returns = table["behaviour"] == "snap_returns"
    low = (table[AMBIENT] < 0.03) & (table["step.2.ramp"] < 0.4)
    assert shares[0] == pytest.approx(returns[low].mean(), abs=0.02)
    picture = balloons(
        "map", tmp_path, "--x", AMBIENT, "--y", "step.2.ramp", "--color", "P(outcome=completed)"
    )
    assert picture.exit_code == 0, picture.output
    with pytest.raises(PickError, match="must be of a column of words, seconds holds number"):
        pick(tmp_path, AMBIENT, "step.2.ramp", "P(seconds=x)")


def test_of_a_grid_a_probability_is_the_share_over_what_is_not_shown(tmp_path):
    vary = {AMBIENT: [0.5, 0.6, 0.7], "step.2.ramp": [0.1, 0.2], "balloon.active.radius": [0.9, 1.0]}
    swept(tmp_path, {"scenario": CHEAP, "vary": vary})
    picked = pick(tmp_path, AMBIENT, "step.2.ramp", "P(behaviour=continuous)")
    assert picked.columns["P(behaviour=continuous)"].size == 6
    table = load_table(tmp_path)
    expected = (table["behaviour"] == "continuous").groupby([table[AMBIENT], table["step.2.ramp"]]).mean()
    assert picked.columns["P(behaviour=continuous)"].tolist() == pytest.approx(expected.tolist())


def test_what_is_drawn_from_distributions_can_be_mapped(tmp_path):
    vary = {AMBIENT: {"rel": 0.1}, "balloon.active.radius": {"rel": 0.1}}
    swept(tmp_path, {"scenario": CHEAP, "sample": {"method": "random", "size": 8}, "vary": vary})
    for color in ("behaviour", "largest_stretch_active", "P(behaviour=continuous)"):
        words = ["--x", AMBIENT, "--y", "balloon.active.radius", "--color", color]
        assert balloons("map", tmp_path, *words).exit_code == 0
