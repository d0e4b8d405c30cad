"""What is said of input that people really write: the key, its value, what is allowed, and what to write."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from simulator import ScenarioError, explain, load_scenario, read_question, read_sweep, simulate, trace
from simulator.cli import app
from simulator.results.plot.map import BEHAVIOURS as DRAWN
from simulator.scenario import Ramp
from simulator.sweep.rows import BEHAVIOURS

PAIR = """title = "A pair"

[gas]
ambient_pressure = 0.015

[[balloon]]
name = "active"
electrodes = true
elastomer = { model = "gent", J_lim = 100 }

[[balloon]]
name = "passive"
elastomer = { model = "gent", J_lim = 100 }

[[step]]
inflate = 1.2

[[step]]
ramp = 0.2
over = 1
"""
RAMP = "ramp = 0.2\nover = 1"
SCALES = """
[scales]
shear_modulus = "45 kPa"
thickness = "0.5 mm"
radius = "20 mm"
permittivity = 4.7
"""
SINE = "sine = { mean = 0.1, amplitude = 0.05, period = 1, cycles = 1e9 }"
TRIANGLE = "triangle = { low = 0.0, high = 0.1, period = 1, cycles = 1e9 }"
TIMES = "must be a number from 1e-100 to 1e100"
CYCLES = "must be at most 1,000,000 cycles of sines and triangles over the whole scenario"

# What is written in place of what, and the line that is said of it.
WRITTEN = {
    "a single balloon table": (
        PAIR[PAIR.index("[[balloon]]") : PAIR.index("[[step]]")],
        '[balloon]\nname = "a"\n',
        'balloon = {"name": "a"}: must be one or more [[balloon]] tables; '
        "[balloon] is a single table, write [[balloon]]",
    ),
    "several single balloon tables": (
        "[[balloon]]",
        "[balloon]",
        "must be TOML: Cannot declare ('balloon',) twice (at line 11, column 9); "
        "several tables are written [[balloon]], each of them",
    ),
    "a unit without quotes": (
        "ramp = 0.2",
        "ramp = 5 kV",
        "must be TOML: Expected newline or end of document after a statement (at line 19, column 10); "
        'a number with a unit stands in quotes: ramp = "5 kV"',
    ),
    "a word without quotes": (
        '"A pair"',
        "A pair",
        'must be TOML: Invalid value (at line 1, column 9); a text stands in quotes: title = "A pair"',
    ),
    "a list of points": (
        RAMP,
        f"{RAMP}\n[output]\npoints = [11, 21]",
        "output.points = [11, 21]: must be a whole number >= 2",
    ),
    "a number of points that no float holds": (
        RAMP,
        f"{RAMP}\n[output]\npoints = 1{'0' * 400}",
        f"output.points = 1{'0' * 78}…: must ask for at most 10,000,000 samples over the whole scenario",
    ),
    "a sine without end": (RAMP, SINE, f"step.2.sine.cycles = 1000000000.0: {CYCLES}"),
    "a triangle without end": (RAMP, TRIANGLE, f"step.2.triangle.cycles = 1000000000.0: {CYCLES}"),
    "a sine that is repeated without end": (
        RAMP,
        f"cycle = 2000\nsteps = [ {{ hold = 1 }}, {{ {SINE.replace('1e9', '501')} }} ]",
        f"step.2.steps.2.sine.cycles = 501.0: {CYCLES}",
    ),
    "no time at all": ("over = 1", "over = 5e-324", f"step.2.over = 5e-324: {TIMES}"),
    "times whose sum is infinite": ("over = 1", "over = 1e308", f"step.2.over = 1e+308: {TIMES}"),
    "a period whose cycles take for ever": (
        RAMP,
        SINE.replace("period = 1", "period = 1e308").replace("1e9", "10"),
        f"step.2.sine.period = 1e+308: {TIMES}",
    ),
    "a size whose cube is no number": (
        'name = "active"',
        'name = "active"\nradius = 1e308',
        "balloon.active.radius = 1e+308: must be a number from 1e-30 to 1e30",
    ),
    "a wall of no stretch": (
        'name = "passive"\nelastomer = { model = "gent", J_lim = 100 }',
        'name = "passive"\nelastomer = { model = "gent", J_lim = 5e-324 }',
        "balloon.passive.elastomer.J_lim = 5e-324: must be a number from 1e-30 to 1e30",
    ),
    "a voltage whose square is no number": (
        RAMP,
        "jump = -1e200",
        "step.2.jump = -1e+200: must be a number from -1e30 to 1e30",
    ),
    "a pressure that is none": (
        RAMP,
        "inflate = 1e308",
        "step.2.inflate = 1e+308: must be a number from 0 to 1e30",
    ),
    "a sweep": (
        PAIR,
        'scenario = "pair.toml"\n[vary]\n"gas.ambient_pressure" = [1, 2]\n',
        "vary: belongs to a sweep, not to a scenario; a sweep is played with `balloons sweep`",
    ),
    "an optimum": (
        PAIR,
        'scenario = "pair.toml"\nmaximize = "dissipated"\n[vary]\n"gas.ambient_pressure" = [1, 2]\n',
        "maximize: belongs to an optimum, not to a scenario; an optimum is played with `balloons optimize`",
    ),
}


@pytest.fixture(autouse=True)
def _in_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("pair.toml").write_text(PAIR, "utf-8")


def refused(read: Callable[[Any], object], source: object) -> str:
    with pytest.raises(ScenarioError) as caught:
        read(source)
    return str(caught.value)


@pytest.mark.parametrize(("old", "new", "line"), WRITTEN.values(), ids=WRITTEN)
def test_a_file_that_makes_no_sense_is_exit_code_2_and_one_line(old: str, new: str, line: str) -> None:
    Path("mine.toml").write_text(PAIR.replace(old, new), "utf-8")
    result = CliRunner().invoke(app, ["run", "mine.toml", "--out", "out"])
    assert (result.exit_code, result.stderr) == (2, f"balloons: mine.toml: {line}\n")
    assert not Path("out").exists()


def test_times_that_make_no_sense_are_all_named() -> None:
    steps = "".join(f"[[step]]\nramp = {v}\nover = 1e308\n" for v in (0.0, 0.1))
    Path("mine.toml").write_text(PAIR.replace("over = 1", "over = 1e308") + steps, "utf-8")
    lines = refused(load_scenario, "mine.toml").splitlines()
    assert lines == [f"mine.toml: step.{number}.over = 1e+308: {TIMES}" for number in (2, 3, 4)]


@pytest.mark.parametrize("over", [1e-100, 1e100])
def test_the_shortest_and_the_longest_times_are_played(over: float) -> None:
    Path("mine.toml").write_text(PAIR.replace("over = 1", f"over = {over!r}"), "utf-8")
    history = simulate("mine.toml")
    assert history.outcome == "completed"
    assert history.voltage[-1, 0] == 0.2


def test_a_table_has_no_longer_times_than_a_step() -> None:
    Path("wave.csv").write_text("time,voltage\n0,0\n1e308,0.1\n", "utf-8")
    Path("mine.toml").write_text(PAIR.replace(RAMP, 'table = "wave.csv"'), "utf-8")
    line = refused(load_scenario, "mine.toml")
    assert line.endswith('wave.csv": row 3: time must be at most 1e100, is 1e308,0.1')


def test_a_file_that_is_not_there_is_named_by_whatever_plays_it() -> None:
    line = "x.toml: cannot be read, no such file or directory"
    assert refused(simulate, "x.toml") == line
    assert refused(read_sweep, "x.toml") == line
    assert refused(read_question, "x.toml") == line


def test_a_path_and_a_mapping_are_played_as_the_scenario_they_hold() -> None:
    scenario = load_scenario("pair.toml")
    for source in (Path("pair.toml"), tomllib.loads(PAIR)):
        assert simulate(source).to_dataframe().equals(simulate(scenario).to_dataframe())
        assert explain(source) == explain(scenario)
        assert trace(source).to_dataframe().equals(trace(scenario).to_dataframe())


@pytest.mark.parametrize("read", [read_sweep, lambda file: read_sweep(Path(file))])
def test_a_scenario_is_no_sweep(read: Callable[[Any], object]) -> None:
    assert refused(read, "pair.toml") == (
        "pair.toml: gas: belongs to a scenario, not to a sweep; a scenario is played with `balloons run`"
    )


class Soft:
    """No elastomer yet: an energy, and nothing else."""

    stretch_limit = float("inf")

    def energy(self, stretch: float) -> float:
        return stretch


def test_an_object_that_is_no_elastomer_is_answered_by_what_one_has() -> None:
    scenario = load_scenario("pair.toml")
    table = 'must be a table such as { model = "gent", J_lim = 100 } or { preset = "VHB-4910" }'
    functions = (
        "or an object with energy, pole_form, pole_form_slope, stretch_limit "
        "(see simulator.model.elastomers.Elastomer)"
    )

    def line(elastomer: object) -> str:
        return refused(scenario.with_elastomers, {"active": elastomer})

    assert line(Soft()).endswith(f": {table}, {functions}, lacks pole_form, pole_form_slope")
    assert line(object()).endswith(f": {table}, {functions}")
    assert line("gent") == f'pair.toml: balloon.active.elastomer = "gent": {table}'


@pytest.mark.parametrize("scales", ["", SCALES])
@pytest.mark.parametrize(
    ("column", "means"),
    [
        ("stress [MPa]", "must be the stress over the shear modulus of the wall, without a unit"),
        ("pressure [kPa]", "must be the pressure over μH/R of the balloon, without a unit"),
    ],
)
def test_a_measured_curve_has_no_units(scales: str, column: str, means: str) -> None:
    rows = "".join(f"{1 + 0.1 * i:.1f},{0.2 * i:.1f}\n" for i in range(7))
    Path("rubber.csv").write_text(f"stretch,{column}\n{rows}", "utf-8")
    written = PAIR.replace(
        '{ model = "gent", J_lim = 100 }', '{ model = "tabulated", table = "rubber.csv" }', 1
    )
    Path("mine.toml").write_text(written.replace("\n[gas]", f"{scales}\n[gas]"), "utf-8")
    assert refused(load_scenario, "mine.toml").endswith(f": header {column}: {means}")


# -- sweeps and optima ---------------------------------------------------------------------------------


def varied(key: str, *values: object) -> dict[str, Any]:
    return {"scenario": "pair.toml", "vary": {key: list(values)}}


def test_a_model_that_is_varied_says_which_number_it_does_not_take() -> None:
    key = "balloon.active.elastomer.model"
    assert refused(read_sweep, varied(key, "gent", "neo-hookean")) == (
        f'<dict>: vary."{key}" = "neo-hookean": makes balloon.active.elastomer.J_lim wrong: '
        "unknown key, allowed here: model"
    )


@pytest.mark.parametrize(
    ("key", "like"),
    [("outut.points", "output.points"), ("balloon.active.radus", "balloon.active.radius")],
)
def test_a_key_that_is_not_there_is_answered_by_the_most_like_it(key: str, like: str) -> None:
    line = refused(read_sweep, varied(key, 1, 2))
    assert line.startswith(f'<dict>: vary."{key}": no such key in the scenario, did you mean {like}')
    assert f"{key} or" not in line


def test_whole_numbers_can_be_varied_where_the_scenario_does_not_write_them() -> None:
    sweep = read_sweep(varied("output.points", 11, 21))
    assert sweep.axes[0].values == (11.0, 21.0)
    assert load_scenario("pair.toml").with_values({"output.points": 11.0}).output.points == 11


@pytest.mark.parametrize("column", ["outcome", "behaviour"])
def test_an_optimum_does_not_look_for_a_word_that_no_run_has(column: str) -> None:
    question = {
        "scenario": "pair.toml",
        "minimize": "dissipated",
        "where": {column: ["snap_stays" if column == "behaviour" else "completed", "complete"]},
        "vary": {"gas.ambient_pressure": {"from": 0.1, "to": 0.2}},
    }
    line = refused(read_question, question)
    assert line.startswith(f'<dict>: where.{column} = "complete": must be one of co')
    assert ", breakdown, " in line


def test_a_map_has_a_colour_for_every_behaviour() -> None:
    assert set(BEHAVIOURS) - {"snap"} <= set(DRAWN)


# -- scenario.with_values ------------------------------------------------------------------------------


def test_values_are_checked_as_in_a_file() -> None:
    def line(**values: object) -> str:
        return refused(
            load_scenario("pair.toml").with_values, {k.replace("__", "."): v for k, v in values.items()}
        )

    assert line(gas__ambient_pressure=-1) == "pair.toml: gas.ambient_pressure = -1: must be a number >= 0"
    assert (
        line(step__9__over=2)
        == "pair.toml: step.9.over: no such key, did you mean step.2.over or step.2.ramp?"
    )
    assert line(step__2__ovr=2).startswith("pair.toml: step.2.ovr = 2: unknown key, allowed here: ramp, over")
    assert (
        line(step__2__over="3 s")
        == 'pair.toml: step.2.over = "3 s": must be a number > 0; a unit needs [scales]'
    )


def test_values_may_have_units_where_the_scenario_has_scales() -> None:
    Path("mine.toml").write_text(PAIR.replace("\n[gas]", f"{SCALES}\n[gas]"), "utf-8")
    scenario = load_scenario("mine.toml").with_values({"step.2.over": "2 min", "step.2.ramp": "3 kV"})
    ramp = scenario.steps[1]
    assert isinstance(ramp, Ramp)
    assert ramp.over == 120.0
    assert scenario.to_dict()["step"][1] == {"ramp": "3 kV", "over": "2 min"}


def test_values_leave_an_elastomer_made_in_python_as_it_is() -> None:
    from simulator.model.elastomers import Gent

    scenario = load_scenario("pair.toml").with_elastomers({"active": Gent(80.0)})
    changed = scenario.with_values({"gas.ambient_pressure": 0.2})
    assert changed.gas.ambient_pressure == 0.2
    assert changed.balloons[0].elastomer == scenario.balloons[0].elastomer
