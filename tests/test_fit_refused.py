"""Fits that make no sense, and the messages that say so: file, key, value, what is allowed."""

from __future__ import annotations

import pytest
from typer.testing import CliRunner

from simulator import ScenarioError, fit, read_fit
from simulator.cli import app

UNITS, PLAIN = "scenarios/vhb_snap.toml", "scenarios/fig3c_state_b.toml"
J = "balloon.active.elastomer.J_lim"


def problem(
    tmp_path,
    text="lam,p\n1.1,1\n1.2,1.2\n1.3,1.3\n1.4,1.3\n",
    *,
    scenario=PLAIN,
    free=None,
    fit=None,
    **table,
):
    (tmp_path / "d.csv").write_text(text, "utf-8")
    first = {
        "file": str(tmp_path / "d.csv"),
        "x": {"stretch_active": "lam"},
        "y": {"pressure": "p"},
        "step": 1,
    }
    rows = {key: value for key, value in {**first, **table}.items() if value is not None}
    free = {J: {"start": 100, "low": 20, "high": 400}} if free is None else free
    return {"scenario": scenario, "data": [rows], "free": free, **({"fit": fit} if fit else {})}


def refused(asked):
    with pytest.raises(ScenarioError) as caught:
        read_fit(asked)
    return str(caught.value)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"text": "lam,p\n1.1,1\n1.2,nan\n1.3,2\n"}, "data.1.file = "),
        ({"text": "lam,p\n1.1,1\n1.2,nan\n1.3,2\n"}, "row 3: must be a finite number in column p, is nan"),
        ({"text": "lam,p\n1.1,\n1.2,2\n1.3,2\n"}, "row 2: must be a finite number in column p, is empty"),
        ({"text": "lam,p\n1.1,1\n"}, "must have at least two rows below the header, has 1"),
        (
            {"text": "lam,p\n1.1,1\n1.1,2\n1.1,3\n"},
            'data.1.x.stretch_active = "lam": must take more than one value',
        ),
        (
            {"y": {"pressure": "q"}},
            'data.1.y.pressure = "q": must be a column of the header in row 1: lam, p',
        ),
        ({"y": {"pressur": "p"}}, "data.1.y.pressur: no quantity of this scenario; did you mean pressure"),
        ({"y": {"voltage_passive": "p"}}, "no quantity of this scenario; did you mean voltage_active"),
        ({"x": {"stretch_third": "lam"}}, "data.1.x.stretch_third: no quantity of this scenario"),
        ({"x": {"pressure": "lam"}}, "must be another quantity than x"),
        ({"x": {"stretch_active": "lam", "time": "p"}}, "data.1.x = "),
        ({"y": {"time": "p"}}, "must be x: a history is at each time in one state"),
        ({"step": 9}, "data.1.step = 9: must be a step of the scenario, 1 to 4"),
        ({"units": {"p": "kPa"}}, "a unit needs [scales] in the scenario"),
        (
            {"scenario": UNITS},
            'data.1.units: is missing, the header of column "p" has no unit: units = { p =',
        ),
        (
            {"scenario": UNITS, "units": {"p": "kV"}},
            'data.1.units.p = "kV": must be a unit of pressure such as "kPa"',
        ),
        (
            {"scenario": UNITS, "units": {"p": "kPa", "lam": "mm"}},
            "must have no unit: stretch_active is a ratio",
        ),
        ({"units": {"r": "1"}}, "data.1.units.r: must be a column that is read as x or y: lam, p"),
        ({"sigma": {"p": 0}}, "data.1.sigma.p = 0.0: must be > 0"),
        ({"sigma": {"lam": 1}}, "data.1.sigma.lam: must be a column that is read as y: p"),
        ({"sigma": {"p": "1 kPa"}}, "must be a number without a unit"),
        ({"file": None}, "data.1.file: is missing"),
        ({"file": "nowhere.csv"}, 'data.1.file = "nowhere.csv": cannot be read, no such file or directory'),
        ({"separator": ",", "decimal": ","}, "data.1.decimal"),
        ({"offset": 1}, "data.1.offset = 1.0: goes with x = { time = … }"),
        ({"free": {}}, "free = {}: must be a table with one or more keys of the scenario"),
        (
            {"free": {"balloon.active.elastomer.J_lm": {"start": 1}}},
            "did you mean balloon.active.elastomer.J_lim",
        ),
        ({"free": {"balloon.active.elastomer.model": {"start": 1}}}, '"balloon.active.elastomer.model"'),
        (
            {"free": {J: {"start": 10, "low": 20, "high": 400}}},
            f'free."{J}".start = 10.0: must be from low to high',
        ),
        (
            {"free": {J: {"start": 10, "low": 20, "high": 4}}},
            f'free."{J}".high = 4.0: must be larger than low',
        ),
        (
            {"free": {J: {"start": -1, "low": -20, "high": 400}}},
            f'free."{J}".start = -1.0: must be a number > 0',
        ),
        ({"free": {J: {"start": -1, "low": -20, "high": -0.5}}}, "the bounds exclude every valid device"),
        (
            {"free": {J: {"start": 100, "low": "1 kPa"}}},
            f'free."{J}".low = "1.0 kPa": must be in the unit of start',
        ),
        ({"free": {J: {"start": "far"}}}, 'must be a number, or a text such as "40 kPa"'),
        ({"fit": {"loss": "square"}}, 'fit.loss = "square": must be "linear", "soft_l1"'),
        ({"fit": {"confidence": 1.0}}, "fit.confidence = 1.0: must be a number between 0 and 1"),
        (
            {"fit": {"starts": 3}, "free": {J: {"start": 100}}},
            "must have low and high: fit.starts are drawn between",
        ),
        ({"fit": {"profile": True, "loss": "huber"}}, 'fit.profile = true: goes with loss = "linear"'),
        (
            {"text": "lam,p\n1.1,1\n1.2,2\n", "free": {J: {"start": 100}, "balloon.active.modulus": {}}},
            "data = 2: must",
        ),
    ],
)
def test_what_makes_no_sense_is_said(tmp_path, change, said):
    text = refused(problem(tmp_path, **change))
    assert said in text
    assert text.startswith("<dict>: ")


EVENT = {"kind": "limit_point", "number": 1, "voltage_active": "4.41 kV", "sigma": "0.05 kV"}


@pytest.mark.parametrize(
    ("event", "said"),
    [
        ({"kind": "snap"}, 'data.1.event.kind = "snap": must be one of limit_point, branch_point'),
        ({"number": 0}, "data.1.event.number = 0: must be a whole number >= 1"),
        ({"sigma": None}, "data.1.event.sigma: is missing: a single value has no scatter"),
        ({"sigma": "0.05 kPa"}, 'data.1.event.sigma = "0.05 kPa": must be a unit of voltage'),
        ({"voltage_active": 4.4}, 'data.1.event.voltage_active = 4.4: must be a voltage such as "8 kV"'),
        ({"voltage_passive": "1 kV"}, "data.1.event.voltage_passive: no quantity of this scenario"),
        ({"voltage_active": None}, "data.1.event: must have a measured quantity, such as voltage_active"),
    ],
)
def test_what_makes_no_sense_of_an_event_is_said(event, said):
    table = {key: value for key, value in {**EVENT, **event}.items() if value is not None}
    free = {"scales.permittivity": {"start": 4, "low": 2, "high": 10}}
    assert said in refused({"scenario": UNITS, "data": [{"event": table}], "free": free})


def test_all_problems_are_said_at_once(tmp_path):
    text = refused(
        problem(tmp_path, y={"pressur": "p"}, free={"gas.ambient": {"start": 1}, J: {"start": -1}})
    )
    assert len(text.splitlines()) == 3


def test_a_free_number_that_changes_nothing_is_refused(tmp_path):
    asked = problem(
        tmp_path, free={J: {"start": 100}, "balloon.passive.radius": {"start": 1, "low": 0.5, "high": 2}}
    )
    with pytest.raises(
        ScenarioError, match=r'free."balloon\.passive\.radius": changes nothing that was measured'
    ):
        fit(asked)


def test_a_later_step_changes_nothing(tmp_path):
    asked = problem(
        tmp_path, free={J: {"start": 100}, "step.2.ramp": {"start": 0.3, "low": 0.1, "high": 0.5}}
    )
    with pytest.raises(ScenarioError, match=r'free."step\.2\.ramp": changes nothing that was measured'):
        fit(asked)


def test_what_was_measured_must_move_in_its_step(tmp_path):
    text = "time,p\n0.1,1\n0.2,1.2\n0.3,1.3\n"
    free = {J: {"start": 100}}
    asked = problem(tmp_path, text.replace("time", "v"), x={"voltage_active": "v"}, free=free)
    with pytest.raises(ScenarioError, match="voltage_active does not change in step 1"):
        fit(asked)


def test_a_file_of_another_kind_is_known(tmp_path):
    with pytest.raises(ScenarioError, match="belongs to a scenario, not to a fit"):
        read_fit("scenarios/vhb_snap.toml")
    done = CliRunner().invoke(app, ["run", "scenarios/fits/vhb_inflation.toml", "--out", str(tmp_path)])
    assert done.exit_code == 2
    assert "belongs to a fit, not to a scenario" in done.output
    assert "`balloons fit`" in done.output
