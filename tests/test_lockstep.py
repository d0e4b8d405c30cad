"""Runs in lockstep come out as run by run; what is not certain is given up, never guessed."""

from __future__ import annotations

import json

import numpy as np
import pytest

from simulator import load_scenario, simulate
from simulator.scenario import ScenarioError
from simulator.scenario.mapping import with_values
from simulator.solver.batch.interval import POINTS, look
from simulator.sweep import load_table, read_sweep, run_sweep, simulate_many
from simulator.sweep.lockstep import chunk
from simulator.sweep.lockstep.chunk import DisagreementError
from simulator.sweep.lockstep.programme import NotCovered
from simulator.sweep.lockstep.stacking import Stack, rule, stacks
from simulator.sweep.rows import columns, play
from tests.fuzz.lockstep import fixed_slice
from tests.sweeps import ROOT, Here

GENT = {"model": "gent", "J_lim": 100}
PAIR = {
    "title": "a pair",
    "gas": {"ambient_pressure": 0.5},
    "balloon": [
        {"name": "active", "electrodes": True, "elastomer": GENT},
        {"name": "passive", "elastomer": GENT},
    ],
    "step": [{"inflate": 1.0}, {"ramp": 0.75}, {"ramp": 0.0}],
    "output": {"points": 41},
}


def in_lockstep(definition):
    """The rows of a sweep of samples; of runs that were given up only what varies."""
    sweep = read_sweep(definition)
    names, values = list(columns(sweep.job)), sweep.values(0, sweep.size)
    together = chunk.rows(
        sweep.job,
        0,
        values,
        (),
        names,
        lambda job, index, values: {a.key: v for a, v in zip(job.axes, values, strict=True)},
    )
    return [dict(zip(names, row, strict=True)) for row in together]


def both_ways(definition, least):
    """Play a sweep of samples in lockstep, and every run that was certain by itself, too."""
    sweep = read_sweep(definition)
    job, values = sweep.job, sweep.values(0, sweep.size)
    rows = in_lockstep(definition)
    certain = [k for k, row in enumerate(rows) if row["way"] == chunk.LOCKSTEP]
    assert len(certain) >= least * len(values)
    for k in certain:
        chunk.compare(k + 1, rows[k], play(job, k, values[k]))
    return rows


def sampled(scenario, vary, size=40, **more):
    return {
        "scenario": scenario,
        "vary": {key: {"from": low, "to": high} for key, (low, high) in vary.items()},
        "sample": {"method": "random", "size": size, "seed": 7},
        **more,
    }


def test_the_papers_map_comes_out_the_same():
    sweep = read_sweep(ROOT / "scenarios/sweeps/paper_map.toml")
    some = np.random.default_rng(3).choice(sweep.size, 60, replace=False).tolist()
    values = [sweep.values(k, k + 1)[0] for k in some]
    names = list(columns(sweep.job))
    together = chunk.rows(sweep.job, 0, values, (), names, lambda job, index, values: {})
    rows = [dict(zip(names, row, strict=True)) for row in together]
    assert sum(row["way"] == chunk.LOCKSTEP for row in rows) >= 59
    assert len({row["behaviour"] for row in rows if row["way"]}) >= 4
    for row, point in zip(rows, values, strict=True):
        if row["way"] == chunk.LOCKSTEP:
            alone = play(sweep.job, 0, point)
            chunk.compare(0, row, alone)
            for name in ("limit_point_1_voltage_active", "limit_point_2_voltage_active"):
                here, there = row[name], alone.get(name, np.nan)
                assert here == pytest.approx(there, rel=1e-12, nan_ok=True)


@pytest.mark.parametrize(
    ("changes", "vary"),
    [
        ({"gas.law": "adiabatic", "gas.chamber": 0.7}, {"gas.chamber": (0.2, 2.0)}),
        ({"balloon.active.breakdown": {"field": 3.0}}, {"balloon.active.breakdown.field": (1.5, 8.0)}),
        (
            {"balloon.active.elastomer": {"model": "mooney-rivlin", "C1": 1.0, "C2": 0.1}},
            {"balloon.active.elastomer.C2": (0.05, 0.2), "balloon.passive.modulus": (0.8, 1.3)},
        ),
        (
            {"balloon.passive.elastomer": {"model": "arruda-boyce", "lambda_L": 5.0}},
            {"balloon.passive.elastomer.lambda_L": (4.0, 7.0), "balloon.active.thickness": (0.8, 1.2)},
        ),
        (
            {"balloon.active.elastomer": {"model": "ogden", "mu": [6.3, 0.012, -0.1], "alpha": [1.3, 5, -2]}},
            {"balloon.active.radius": (0.7, 1.2)},
        ),
    ],
)
def test_other_devices_come_out_the_same(changes, vary):
    scenario = json.loads(json.dumps(PAIR))
    for key, value in changes.items():
        table, _, name = key.rpartition(".")
        if table == "gas":
            scenario["gas"][name] = value
        else:
            next(b for b in scenario["balloon"] if b["name"] == table.split(".")[1])[name] = value
    vary = {**vary, "step.1.inflate": (0.6, 1.2)}
    both_ways(sampled(scenario, vary), least=0.9)


@pytest.mark.parametrize(
    ("steps", "vary", "least"),
    [
        ([{"inflate": 0.8}, {"jump": 0.3}, {"ramp": 0.0}], {"step.2.jump": (0.1, 0.9)}, 0.9),
        ([{"inflate": 0.8}, {"triangle": {"low": 0.1, "high": 0.6, "period": 1, "cycles": 2.5}}],
         {"step.2.triangle.high": (0.3, 0.8)}, 0.9),
        ([{"inflate": 1.0}, {"ramp": 0.5, "valve": "open"}, {"hold": 1.0}, {"ramp": 0.9}],
         {"step.2.ramp": (0.1, 0.6)}, 0.9),
        # Some balloons leave as the valve opens again.
        ([{"inflate": 1.3}, {"ramp": 0.4}, {"inflate": 0.7}, {"ramp": 0.5}],
         {"step.1.inflate": (1.0, 1.5)}, 0.6),
        ([{"inflate": 1.0}, {"cycle": 2, "steps": [{"ramp": 0.3}, {"ramp": 0.0}]}],
         {"step.2.steps.1.ramp": (0.1, 0.7)}, 0.9),
    ],
)  # fmt: skip
def test_other_histories_come_out_the_same(steps, vary, least):
    both_ways(sampled({**PAIR, "step": steps}, {**vary, "gas.ambient_pressure": (0.02, 1.0)}), least)


def test_a_film_that_breaks_as_its_balloon_snaps_while_inflated():
    film = {**PAIR["balloon"][0], "breakdown": {"field": 1.2}}
    steps = [{"inflate": 0.8}, {"jump": 0.05, "valve": "open"}, {"inflate": 1.4}]
    rows = both_ways(sampled({**PAIR, "balloon": [film], "step": steps}, {"step.3.inflate": (1.3, 1.6)}), 1.0)
    assert {(row["behaviour"], row["inflation_snaps"]) for row in rows} == {("breakdown", 1)}


def test_random_devices_and_steps(tmp_path):
    """A slice of `python -m tests.fuzz.lockstep`."""
    for outcome in fixed_slice(tmp_path):
        assert outcome.problems == []
        assert outcome.counts["compared"] > 0


@pytest.mark.parametrize("count", [1, 3, 5])
def test_any_number_of_balloons(count):
    balloons = [
        {"name": f"b{i}", "elastomer": GENT, "radius": 1.0 - 0.07 * i, "electrodes": i < 2}
        for i in range(count)
    ]
    scenario = {**PAIR, "balloon": balloons}
    vary = {"gas.ambient_pressure": (0.02, 2.0), "step.1.inflate": (0.5, 1.2)}
    both_ways(sampled(scenario, vary), least=0.8)


@pytest.mark.parametrize("radius", [0.99, 0.9999, 0.999999])
def test_almost_equal_balloons_part_the_right_way(radius):
    # An imperfection tells which of two balloons, both driven, grows; a coarse step takes the other.
    balloons = [
        {**b, "electrodes": True, "radius": r} for b, r in zip(PAIR["balloon"], (radius, 1.0), strict=True)
    ]
    vary = {"gas.ambient_pressure": (0.02, 1.0), "step.1.inflate": (0.5, 1.2)}
    both_ways(sampled({**PAIR, "balloon": balloons}, vary), least=0.8)


def test_equal_balloons_are_left_to_simulate():
    balloons = [{**b, "electrodes": True} for b in PAIR["balloon"]]
    vary = {"gas.ambient_pressure": (0.02, 1.0), "step.1.inflate": (0.5, 1.2)}
    both_ways(sampled({**PAIR, "balloon": balloons}, vary), least=0.0)


def test_where_a_cruder_method_went_wrong():
    # At the limit points of these three a tension is almost lost, or another branch is close.
    devices = np.array([
        [0.643833268483049, 1.6686814631906215, 1.5522126013948552, 51.4054222470497],
        [0.9048414079411011, 0.8977858322825276, 0.9918261292845929, 167.58499217464512],
        [0.6416479839101564, 2.3084498262831414, 0.5359999332637589, 266.06910526088143],
    ])  # fmt: skip
    keys = ("balloon.active.radius", "gas.ambient_pressure", "step.1.inflate", "balloon.*.elastomer.J_lim")
    vary = {key: (float(c.min()), float(c.max())) for key, c in zip(keys, devices.T, strict=True)}
    sweep = read_sweep(sampled(PAIR, vary, past_limit_point={"step.2.ramp": {"times": 1.001}}))
    values = np.repeat(devices, 12, axis=0).tolist()
    names = list(columns(sweep.job))
    for k, row in enumerate(chunk.rows(sweep.job, 0, values, (), names, play)):
        if k % 12 == 0:
            chunk.compare(k, dict(zip(names, row, strict=True)), play(sweep.job, k, values[k]))


def test_what_is_not_covered_goes_to_simulate():
    until = {**PAIR, "step": [{"inflate": 0.8}, {"ramp": 0.6, "until": {"stretch": 2.0}}]}
    slow = {**PAIR, "dynamics": {"relaxation_time": 1.0}}
    for scenario in (until, slow):
        sweep = read_sweep(sampled(scenario, {"gas.ambient_pressure": (0.1, 1.0)}, size=4))
        found = list(stacks(sweep.job, sweep.values(0, 4)))
        assert not any(isinstance(one, Stack) for one in found)


def test_a_number_that_does_not_move_in_proportion_is_refused():
    power = {"law": "power", "field": 3.0, "stretch_exponent": 0.6, "thickness_exponent": -0.3}
    scenario = json.loads(json.dumps(PAIR))
    scenario["balloon"][0]["breakdown"] = power
    sweep = read_sweep(sampled(scenario, {"balloon.active.thickness": (0.8, 1.2)}))
    with pytest.raises(NotCovered):
        rule(sweep.job, (1.2,), ((0.8, 1.2),))


def test_the_sweep_says_by_which_way_a_row_came(tmp_path):
    definition = sampled(PAIR, {"gas.ambient_pressure": (0.02, 1.0)}, size=220)
    run_sweep(read_sweep(definition), tmp_path, executor=Here(), workers=1)
    table = load_table(tmp_path)
    ways = json.loads((tmp_path / "sweep.json").read_text())["ways"]
    assert ways == {way: int((table["way"] == way).sum()) for way in ("lockstep", "simulate")}
    assert ways["lockstep"] >= 215


def test_a_disagreement_is_an_error_that_names_the_run(monkeypatch):
    sweep = read_sweep(sampled(PAIR, {"gas.ambient_pressure": (0.02, 1.0)}))
    names = list(columns(sweep.job))

    def wrong(job, index, values, expected):
        return {**play(job, index, values), "limit_points": 7}

    with pytest.raises(DisagreementError, match=r"run 12: limit_points is \d in lockstep and 7"):
        chunk.rows(sweep.job, 10, sweep.values(0, 40), (1,), names, wrong)


@pytest.mark.parametrize("off", [-1e-7, 1e-7])
@pytest.mark.parametrize("name", ["largest_stretch_passive", "largest_field_active"])
def test_largest_values_are_compared_both_ways(name, off):
    alone = play(read_sweep(sampled(PAIR, {"gas.ambient_pressure": (0.02, 1.0)})).job, 0, (0.5,))
    chunk.compare(1, alone, alone)
    with pytest.raises(DisagreementError, match=name):
        chunk.compare(1, {**alone, name: alone[name] * (1.0 + off)}, alone)


@pytest.mark.parametrize(("name", "share"), [("dissipated", 1e-12), ("loop_work", 1e-10)])
def test_works_are_compared_over_what_was_exchanged(name, share):
    alone, off = {name: 84.0, "exchanged": 1e7}, 1e-8 * 85.0 + share * 1e7
    chunk.compare(1, {name: 84.0 + 0.99 * off}, alone)
    with pytest.raises(DisagreementError, match=name):
        chunk.compare(1, {name: 84.0 + 1.01 * off}, alone)


def test_the_new_voltage_on_old_films_is_not_among_the_fields_of_a_jump():
    """A film that runs away at once was never at rest under a voltage."""
    film = {"name": "active", "electrodes": True, "elastomer": {"model": "neo-hookean"}}
    scenario = {**PAIR, "balloon": [film], "step": [{"inflate": 0.8}, {"jump": 0.7, "valve": "open"}]}
    rows = in_lockstep(sampled(scenario, {"step.2.jump": (0.6, 0.9)}))
    assert {(row["outcome"], row["largest_field_active"]) for row in rows} == {("runaway", 0.0)}


def test_where_margins_fall_through_zero():
    x = POINTS
    falls, far = 0.5 - x, 1.0 + 0.0 * x
    early, late = (1e-3 + 40.0 * (x - at) ** 4 for at in (0.25, 0.75))  # dips that nearly reach zero
    runs = [(falls, 2.0 * falls), (falls, early), (falls, late), (far, far), (early, far), (far, falls)]
    found = look(np.array(runs).transpose(1, 2, 0))
    assert found.first.tolist() == [0, 0, 0, -1, -1, 1]
    assert found.at == pytest.approx([0.5, 0.5, 0.5, np.inf, np.inf, 0.5])
    assert found.unclear.tolist() == [False, True, False, False, True, False]


def test_a_flow_does_not_lead_beyond_a_stretch_limit():
    """A film breaks in the jump, while the passive balloon is close to its limit, at 14.86."""
    elastomer = {"model": "ogden", "mu": [630000.0, 1200.0, -10000.0], "alpha": [1.3, 5.0, -2.0]}
    strength = {"law": "power", "field": 3.967, "stretch_exponent": -0.7419, "thickness_exponent": 0.2309}
    balloons = [
        {
            "name": "film",
            "permittivity": 0.5534,
            "electrodes": True,
            "breakdown": strength,
            "elastomer": GENT,
        },
        {"name": "small", "radius": 0.1999, "thickness": 0.6494, "elastomer": elastomer},
        {"name": "large", "thickness": 0.8657898477541551, "elastomer": {"model": "gent", "J_lim": 438.8}},
    ]
    steps = [{"inflate": 1.202}, {"jump": 0.2979}]
    scenario = {"title": "far out", "gas": {"ambient_pressure": 0.001603}, "balloon": balloons, "step": steps}
    sweep = sampled(scenario, {"balloon.film.radius": (0.93, 0.96)})
    assert {row["outcome"] for row in in_lockstep(sweep)} <= {"breakdown", None}
    assert play(read_sweep(sweep).job, 0, (0.94,))["outcome"] == "breakdown"


def test_a_largest_field_right_before_a_limit_point():
    radii = (0.176, 0.1842811024233263, 0.176, 0.16153214827334192)
    thick = (1.0, 1.0, 0.8194679644473716, 1.0)
    balloons = [
        {
            "name": f"b{i}",
            "electrodes": True,
            "radius": r,
            "thickness": h,
            "elastomer": {"model": "neo-hookean"},
        }
        for i, (r, h) in enumerate(zip(radii, thick, strict=True))
    ]
    scenario = {
        "title": "a peak right before a limit point",
        "gas": {"ambient_pressure": 0.0, "chamber": 0.008429},
        "balloon": balloons,
        "step": [{"inflate": 2.657921664201753}, {"ramp": 0.8566472244801931}],
        "shape": {"on_loss": "ignore"},
    }
    rows = in_lockstep(sampled(scenario, {"step.2.ramp": (0.8, 0.9)}, size=32))
    turn = rows[0]["limit_point_1_voltage_b0"]
    # Densely, on the last of the way there.
    steps = [{"inflate": 2.657921664201753}, {"ramp": turn * 0.9995}, {"ramp": turn * 0.9999}]
    history = simulate({**scenario, "step": steps, "output": {"points": 2001}})
    right = history.field[:, 0].max()
    assert right > history.field[-1, 0] + 1e-6
    assert rows[0]["largest_field_b0"] == pytest.approx(right, abs=1e-9)


@pytest.mark.parametrize(("size", "audited"), [(12, 12), (700, 20), (5_000, 50), (100_000, 200)])
def test_one_run_in_a_hundred_is_played_both_ways(size, audited):
    sweep = read_sweep(sampled(PAIR, {"gas.ambient_pressure": (0.02, 1.0)}, size=size))
    assert len(set(sweep.audited)) == audited
    assert 0 <= min(sweep.audited) <= max(sweep.audited) < size


def test_of_a_chunk_in_lockstep_only_the_audited_runs_are_played_by_themselves():
    sweep = read_sweep(sampled(PAIR, {"gas.ambient_pressure": (0.02, 1.0)}))
    alone = []

    def noted(job, index, values, *expected):
        alone.append(index)
        return play(job, index, values, *expected)

    rows = chunk.rows(sweep.job, 10, sweep.values(0, 40), (3, 17), list(columns(sweep.job)), noted)
    way = list(columns(sweep.job)).index("way")
    handed_back = [10 + k for k, row in enumerate(rows) if row[way] == chunk.ALONE]
    assert sorted(alone) == sorted([13, 27, *handed_back])


def test_what_is_expected_of_a_ramp_past_its_limit_point_is_checked():
    sweep = read_sweep(ROOT / "scenarios/sweeps/paper_map.toml")
    key = sweep.job.past.key
    for run, limit_points in ((10_050, 2), (9_999, 0)):
        values = sweep.values(run, run + 1)[0]
        alone = play(sweep.job, run, values)
        assert alone["limit_points"] == limit_points
        right = alone[key]
        for expected in (right, right * 1.0000001, right * 0.9, 0.75):
            again = play(sweep.job, run, values, expected)
            assert again[key] == pytest.approx(right, rel=1e-14)
            chunk.compare(run + 1, again, alone)


def test_simulate_many():
    scenario = load_scenario(PAIR)
    pressures = np.geomspace(0.02, 1.0, 50)
    runs = simulate_many(scenario, {"gas.ambient_pressure": pressures, "step.1.inflate": 0.9})
    assert len(runs) == 50
    assert set(runs["way"]) == {"lockstep"}
    assert runs["gas.ambient_pressure"].tolist() == pressures.tolist()
    changed = with_values(PAIR, {"gas.ambient_pressure": float(pressures[7]), "step.1.inflate": 0.9})
    alone = simulate_many(load_scenario(changed), {"gas.ambient_pressure": pressures[7]})
    assert alone["way"][0] == "simulate"
    name = "limit_point_1_voltage_active"
    assert runs[name][7] == pytest.approx(alone[name][0], rel=1e-12)
    assert runs.to_dataframe().shape[0] == 50
    with pytest.raises(ScenarioError, match="did you mean"):
        simulate_many(scenario, {"gas.ambient_presure": pressures})


def test_many_runs_of_a_scenario_with_scales_are_in_si_units(tmp_path):
    """As a sweep of the same runs has them."""
    scenario = load_scenario("scenarios/vhb_snap.toml")
    inflations = np.linspace(0.9, 1.1, 3)
    runs = simulate_many(scenario, {"step.1.inflate": inflations})
    vary = {"step.1.inflate": inflations.tolist()}
    store = run_sweep(read_sweep({"scenario": "scenarios/vhb_snap.toml", "vary": vary}), tmp_path, workers=1)
    table, frame = load_table(store.directory), runs.to_dataframe()
    shared = [title for title in frame.columns if title in table.columns]
    assert runs.units["limit_point_1_voltage_active"] == "V"
    assert {"step.1.inflate [μH/R]", "landing_pressure [Pa]", "loop_work [J]"} <= set(shared)
    assert set(frame.columns) <= set(table.columns)
    for title in shared:
        if frame[title].dtype.kind == "f" and title not in ("seconds", "energy_imbalance"):
            np.testing.assert_allclose(frame[title], table[title], rtol=1e-12, err_msg=title)
    assert simulate_many(PAIR, {"step.1.inflate": 0.9}).units == {}


@pytest.mark.parametrize("count", [2, 3])
def test_equal_balloons_come_out_the_same_or_are_given_up(count):
    """How they part is for `simulate` to say."""
    balloons = [{"name": f"b{i}", "electrodes": True, "elastomer": GENT} for i in range(count)]
    scenario = {**PAIR, "balloon": balloons, "shape": {"on_loss": "ignore"}}
    rows = both_ways(sampled(scenario, {"step.2.ramp": (0.1, 0.75)}, size=32), least=0.3)
    together = [row["step.2.ramp"] for row in rows if row["way"] == chunk.LOCKSTEP]
    assert len(together) < len(rows)
    assert max(together) < 0.51735541  # where a pair parts, and any number
