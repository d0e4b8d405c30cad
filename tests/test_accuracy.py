"""Error against run time: the errors, on physics and not on times; the files; and what a scenario imports."""

from __future__ import annotations

import importlib.util
import math
import subprocess
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from simulator.scenario import ScenarioError, load_scenario
from simulator.simulation.explanation import assembled
from tests.pairs import pair, run, single
from tests.studies import accuracy
from tests.studies.accuracy import arclength, digest, page, study
from tests.studies.accuracy.__main__ import main
from tests.studies.accuracy.left_out import SCENARIOS, anatomies, imported, sets
from tests.studies.accuracy.problem import Samples, WrongHistory, errors, load_task

ROOT = Path(__file__).parent.parent
FILES = ROOT / "scenarios"
TOLERANCES = (1e-3, 1e-6, 1e-9)
ERRORS = ("limit_voltage_error", "limit_state_error", "landing_error", "state_error", "work_error")


@pytest.fixture(scope="module")
def task():
    return load_task(load_scenario(FILES / "fig3c_state_b.toml"))


@pytest.fixture(scope="module")
def rows(task):
    return study.measure([task], TOLERANCES, (1e-3, 1e-5), repetitions=1)


@pytest.fixture(scope="module")
def taken_apart():
    return anatomies([SCENARIOS[0], SCENARIOS[3], SCENARIOS[-1]], repetitions=1)


def of(rows, method, **chosen):
    return [r for r in rows if r.method == method and all(getattr(r, k) == v for k, v in chosen.items())]


# -- errors ----------------------------------------------------------------------------------------------


def test_the_exact_history_is_that_of_fig_3c(task):
    up, down = task.limit_points
    assert (up.leg, down.leg) == (0, 2)
    assert up.voltage == pytest.approx(0.36044087, abs=5e-9)
    assert down.after.active == pytest.approx(1.45301845, abs=5e-9)
    assert task.work == pytest.approx(40.830526, abs=5e-7)


def test_polished_errors_are_at_the_floor_at_every_tolerance(rows):
    found = of(rows, study.SIMULATOR)
    assert [row.rtol for row in found] == list(TOLERANCES)
    for row in found:
        assert row.failure == ""
        assert max(getattr(row, column) for column in ERRORS) < 1e-10


def test_unpolished_errors_fall_with_the_tolerance(rows):
    found = of(rows, study.UNPOLISHED)
    assert not any(row.failure for row in found)
    for column in ERRORS:
        measured = [getattr(row, column) for row in found]
        assert all(tight < loose for loose, tight in pairwise(measured))
        assert 0.5 < digest.order(TOLERANCES, measured) < 1.5
        assert measured[0] > 1e-4


def test_scipy_dae_agrees_where_it_is_installed(rows):
    pytest.importorskip("scipy_dae")
    found = of(rows, study.SCIPY_DAE)
    assert len(found) == len(TOLERANCES)
    assert found[-1].limit_voltage_error < 1e-6 < found[0].limit_voltage_error


def test_without_scipy_dae_it_is_left_out_and_said(task, monkeypatch):
    monkeypatch.setattr(study, "has_scipy_dae", lambda: False)
    found = study.measure([task], [1e-3], [], repetitions=1)
    assert [row.method for row in found] == [study.SIMULATOR, study.UNPOLISHED]
    subject = page.Subject(task.name, task.scenario.title, task.loses_tension)
    text = page.accuracy_page(found, [subject], [], "nowhere")
    assert "The package scipy_dae, which would be another integrator, is not installed here." in " ".join(
        text.split()
    )


@pytest.mark.parametrize("method", study.VISCOUS)
def test_viscous_delay_goes_as_the_two_thirds_power(rows, method):
    found = of(rows, method)
    assert len(found) == 4  # two tolerances, two delays
    assert 0.6 < digest.delay_power(found) < 0.75
    for delay in (1e-3, 1e-5):  # and no tolerance takes it away
        loose, tight = (row.limit_voltage_error for row in of(rows, method, delay=delay))
        assert loose == pytest.approx(tight, rel=0.2)
        assert tight > 0.1 * delay ** (2 / 3)
    assert all(math.isnan(row.limit_state_error) for row in found)


@pytest.mark.parametrize("name", ["fig5b_state_b", "fig5c_state_a", "fig3b_state_b"])
def test_other_histories_at_the_default(name):
    task = load_task(load_scenario(FILES / f"{name}.toml"))
    found = errors(task, arclength.read_history(task, arclength.simulated(task, study.DEFAULT)))
    assert max(found.limit_voltage, found.limit_state, found.state) < 1e-12
    # Where a snap loses its tension, that state depends on a flow, integrated in the reference at 1e-10.
    assert found.landing < (1e-9 if task.loses_tension else 1e-12)
    assert found.work < 1e-10


def test_order_of_the_balloons_does_not_matter(task):
    scenario = load_scenario(FILES / "fig3c_state_b.toml")
    turned = load_task(scenario.model_copy(update={"balloons": scenario.balloons[::-1]}))
    assert turned.active == 1
    found = errors(turned, arclength.read_history(turned, arclength.simulated(turned, 1e-4)))
    assert max(found.limit_state, found.landing, found.state) < 1e-12
    assert errors(turned, arclength.unpolished_ida(turned, 1e-8)).landing < 1e-6


def test_an_error_put_in_is_found(task):
    solution = arclength.read_history(task, arclength.simulated(task, 1e-4))
    states = solution.samples.states.copy()
    states[1, 150] *= 1.0 + 1e-5
    samples = Samples(solution.samples.position, solution.samples.voltage, states, solution.samples.jumps)
    limit = replace(solution.limit_points[0], voltage=1.001 * solution.limit_points[0].voltage, after=None)
    spoilt = replace(
        solution,
        samples=samples,
        limit_points=(limit, solution.limit_points[1]),
        work=1.01 * solution.work,
    )
    found = errors(task, spoilt)
    assert found.limit_voltage == pytest.approx(1e-3, rel=1e-9)
    assert found.state == pytest.approx(1e-5, rel=1e-6)
    assert found.work == pytest.approx(1e-2, rel=1e-9)
    assert math.isnan(found.landing)  # one that is missing is not passed over
    states[0, 3] = np.nan
    assert math.isnan(errors(task, replace(solution, samples=replace(samples, states=states))).state)


def test_another_history_has_no_errors(task):
    solution = arclength.read_history(task, arclength.simulated(task, 1e-4))
    with pytest.raises(WrongHistory, match="limit points in steps 2, not 2, 4"):
        errors(task, replace(solution, limit_points=solution.limit_points[:1]))
    with pytest.raises(WrongHistory, match="tension is lost"):
        errors(task, replace(solution, loses_tension=True))


def test_a_snap_that_falls_back_is_a_failure(task):
    (row,) = of(study.measure([task], [1e-4], [], repetitions=1), study.UNPOLISHED)
    assert row.failure == "a snap falls back onto the branch it left"
    assert math.isnan(row.limit_voltage_error)
    assert math.isnan(row.milliseconds)
    assert row.repetitions == 0


def test_orders_of_what_is_known():
    rtols = [1e-2, 1e-4, 1e-6, 1e-8]
    assert digest.order(rtols, [3 * r**1.5 for r in rtols[:3]] + [1e-16]) == pytest.approx(1.5)
    assert math.isnan(digest.order(rtols, [1e-15] * 4))


# -- what is refused -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("scenario", "message"),
    [
        (
            load_scenario(SCENARIOS[-1]),
            'balloon = "3 balloons, 2 of them with electrodes": the closed form needs two balloons, one of',
        ),
        (single({"inflate": 0.5}, {"ramp": 0.1}), "1 balloons, 1 of them with electrodes"),
        (pair(1.2, {"ramp": 0.1}), "<dict>: step: must take the voltage over a limit point; there is none"),
        (
            pair(1.2, {"ramp": 0.1}, active={"breakdown": {"field": 3.0}}),
            "balloon.active.breakdown = ",
        ),
        (
            pair(1.2, {"ramp": 0.1, "valve": "open"}),
            'step.2 = "ramp": must be a ramp, hold or jump with the valve closed',
        ),
        (
            pair(1.2, {"sine": {"mean": 0, "amplitude": 0.4, "period": 1, "cycles": 1}}),
            'step.2 = "sine": must be a ramp, hold or jump',
        ),
        (pair(1.2, {"ramp": 0.1}, {"inflate": 1.0}), 'step.3 = "inflate": must be a ramp'),
    ],
)
def test_scenarios_without_an_exact_history_are_refused(scenario, message):
    with pytest.raises(ScenarioError) as refused:
        load_task(scenario)
    assert message in str(refused.value)


def test_a_scenario_that_begins_sealed_is_refused():
    scenario = pair(1.2, {"ramp": 0.1})
    with pytest.raises(ScenarioError, match=r"step\.1: must be an inflate step"):
        load_task(scenario.model_copy(update={"steps": scenario.steps[1:]}))


# -- files -----------------------------------------------------------------------------------------------


def test_csv_goes_round_to_the_last_digit(rows):
    text = study.to_csv(rows)
    assert text.splitlines()[0] == (
        "scenario,method,delay,rtol,limit_voltage_error,limit_state_error,landing_error,state_error,"
        "work_error,milliseconds,repetitions,solves,steps,calls,failure"
    )
    assert repr(study.from_csv(text)) == repr(rows)  # as text, in which NaN equals NaN
    with pytest.raises(ValueError, match=r"the columns must be scenario, method, .*, are a, b"):
        study.from_csv("a,b\n1,2\n")


def test_command_writes_page_table_and_figure(tmp_path, monkeypatch, taken_apart, capsys):
    monkeypatch.setattr(accuracy, "anatomies", lambda: taken_apart)
    options = ["--rtol", "1e-3", "--rtol", "1e-6", "--rtol", "1e-9", "--delay", "1e-5", "--repeat", "1"]
    file = str(FILES / "fig3b_state_b.toml")
    assert main([file, "--out", str(tmp_path), *options]) == 0
    names = ", ".join(Path(name).name for name in accuracy.FILES)
    assert capsys.readouterr() == (f"files    {tmp_path}: {names}\n", "")
    assert sorted(str(p.relative_to(tmp_path)) for p in tmp_path.rglob("*.*")) == sorted(accuracy.FILES)
    found = study.from_csv((tmp_path / "accuracy.csv").read_text("utf-8"))
    assert {row.scenario for row in found} == {"fig3b_state_b"}
    assert [row.rtol for row in of(found, study.SIMULATOR)] == list(TOLERANCES)
    assert [row.rtol for row in of(found, "BDF")] == [1e-3, 1e-9]
    text = (tmp_path / "accuracy.md").read_text("utf-8")
    for row in of(found, study.UNPOLISHED):
        assert f"{row.limit_voltage_error:.1e}" in text
    assert "nan" not in text
    assert (tmp_path / "figures/accuracy.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("what", ["missing", "three balloons"])
def test_command_says_what_is_wrong(tmp_path, what, capsys):
    file = tmp_path / "scenario.toml"
    if what != "missing":
        gent = 'elastomer = { model = "gent", J_lim = 100 }'
        balloons = "".join(f'[[balloon]]\nname = "{n}"\nelectrodes = true\n{gent}\n' for n in "abc")
        step = "[[step]]\ninflate = 1.2\n[[step]]\nramp = 0.4\n"
        file.write_text(f'title = "three"\n[gas]\nambient_pressure = 0.1\n{balloons}{step}')
    assert main([str(file), "--out", str(tmp_path / "out")]) == 2
    expected = "cannot be read" if what == "missing" else "the closed form needs two balloons"
    said = capsys.readouterr().err
    assert expected in said
    assert "scenario.toml" in said
    assert not (tmp_path / "out").exists()


def test_command_refuses_a_place_it_cannot_write(tmp_path, capsys):
    (tmp_path / "taken").write_text("")
    assert main(["--out", str(tmp_path / "taken")]) == 2
    assert "cannot write to" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--rtol", "0.2"], "argument --rtol: 0.2: must be from 1e-12 to 0.1"),
        (["--rtol", "nan"], "argument --rtol: nan: must be from 1e-12 to 0.1"),
        (["--delay", "soon"], "argument --delay: invalid number value: 'soon'"),
        (["--repeat", "0"], "argument --repeat: 0: must be at least 1"),
        (["--repeat", "1.5"], "argument --repeat: invalid whole number value: '1.5'"),
    ],
)
def test_command_refuses_numbers_out_of_range(options, said, capsys):
    with pytest.raises(SystemExit, match="2"):
        main(options)
    assert said in capsys.readouterr().err


def test_the_committed_table_has_every_case_and_the_floor():
    found = study.from_csv((ROOT / "docs/accuracy.csv").read_text("utf-8"))
    assert list(dict.fromkeys(row.scenario for row in found)) == list(accuracy.SCENARIOS)
    for name in accuracy.SCENARIOS:
        polished = of(found, study.SIMULATOR, scenario=name)
        assert [row.rtol for row in polished] == list(study.TOLERANCES)
        assert all(row.limit_voltage_error < 1e-13 and row.state_error < 1e-12 for row in polished)
        assert len([r for r in found if r.scenario == name and r.method in study.VISCOUS]) == 45
    text = (ROOT / "docs/accuracy.md").read_text("utf-8")
    assert f"{max(row.work_error for row in of(found, study.SIMULATOR)):.1e}" in text


def test_machine_names_processor_and_versions():
    where = page.machine()
    assert "SUNDIALS" in where
    assert "scipy " in where
    assert " cores" in where


# -- what is left out ------------------------------------------------------------------------------------

PACKAGES = {"events", "model", "results", "scenario", "simulation", "solver", "units"}
ON_DEMAND = {
    "model.elastomers.tabulated",
    "results.curve",
    "results.plot",
    "results.tables",
    "simulation.real_time",
    "simulation.until",
    "solver.viscous",
}
LIBRARIES = {
    "annotated_types",
    "numpy",
    "pydantic",
    "pydantic_core",
    "typing_extensions",
    "typing_inspection",
}
SOLVER = {"sksundae", "scipy", "cython_runtime"}  # scikit-sundae brings scipy
BY_CHANCE = {"charset_normalizer"}  # numpy's f2py, which scipy loads, takes it where it is there


@pytest.mark.parametrize("name", sorted(ON_DEMAND))
def test_what_is_loaded_on_demand_is_there(name):
    assert importlib.util.find_spec(f"simulator.{name}")


def test_a_run_imports_exactly_what_it_needs(taken_apart):
    for anatomy in taken_apart:
        assert {name.partition(".")[0] for name in anatomy.modules} == PACKAGES
        assert not ON_DEMAND & set(anatomy.modules)
        assert set(anatomy.libraries) - BY_CHANCE == (LIBRARIES | SOLVER if anatomy.solves else LIBRARIES)
        assert (anatomy.solves == 0) == (anatomy.title == "a balloon left alone")


def test_balloons_run_imports_exactly_what_it_needs(tmp_path):
    program = (
        "import sys; from simulator.cli.app import app; "
        f"app(['run', 'scenarios/fig5b_state_b.toml', '--out', {str(tmp_path)!r}], standalone_mode=False); "
        "print(*sys.modules, file=sys.stderr)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, cwd=ROOT, check=True
    )
    loaded = set(done.stderr.split())
    assert {name.split(".")[1] for name in loaded if name.startswith("simulator.")} == PACKAGES | {
        "cli",
        "hysteresis",  # for its loops
    }
    assert not {f"simulator.{name}" for name in ON_DEMAND - {"results.tables"}} & loaded
    assert not {"matplotlib", "scipy_dae", "mpmath", "tests"} & loaded


def test_a_process_that_fails_is_told():
    with pytest.raises(RuntimeError, match=r"(?s)a process that runs 'nothing' failed: .*ScenarioError"):
        imported([{"title": "nothing"}])


def test_every_feature_adds_what_it_needs_and_no_more():
    assert [list(dict.fromkeys(sets(load_scenario(written)))) for written in SCENARIOS] == [
        [],
        [(2, 1)],
        [(2, 1)],
        [(2, 1), (4, 2)],
        [(2, 1), (4, 3)],
        [(2, 1), (4, 3)],
        [(2, 1), (5, 4)],
    ]


def test_ten_cycles_integrate_what_one_does():
    once, often = (run(load_scenario(written)).statistics for written in SCENARIOS[4:6])
    assert (once.ida_solves, once.ida_steps) == (often.ida_solves, often.ida_steps)
    assert (once.residual_calls, once.jacobian_calls) == (often.residual_calls, often.jacobian_calls)


RAMP = {"ramp": 0.3}


@pytest.mark.parametrize(
    ("more", "events"),
    [
        (pair(1.2, RAMP, {"hold": 3}, ambient=0.015), 2),
        (pair(1.2, RAMP, ambient=0.015, output={"points": 1001}), 2),
        (pair(1.2, RAMP, ambient=0.015, active={"breakdown": {"field": 50.0}}), 3),
        (pair(1.2, RAMP, {"ramp": 0.0}, RAMP, ambient=0.015), 2),
    ],
    ids=["a hold", "more samples", "a strength that is not reached", "back and there again"],
)
def test_what_does_not_move_the_path_costs_no_integration(more, events):
    plain = pair(1.2, RAMP, ambient=0.015)
    groups = {g.equations: len(g.conditions) for step in assembled(more) for g in step.groups}
    assert groups.keys() == {g.equations: 0 for step in assembled(plain) for g in step.groups}.keys()
    assert max(groups.values()) == events
    before, after = run(plain).statistics, run(more).statistics
    assert (after.ida_solves, after.ida_steps) == (before.ida_solves, before.ida_steps)
    assert (after.residual_calls, after.jacobian_calls) == (before.residual_calls, before.jacobian_calls)
