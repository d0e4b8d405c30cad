"""Equilibrium paths: special points against 40 digits, every point against the equations, and the command."""

from __future__ import annotations

from pathlib import Path

import mpmath as mp
import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from simulator.analysis.trace import rests, sealed_state, trace, trace_all, trace_inflation
from simulator.cli import app
from simulator.results.columns import curve_columns, point_columns
from simulator.results.files import OutputError
from simulator.results.plot import plot_curves, png
from simulator.results.tables import write_curves
from simulator.scenario import ScenarioError, Shape, load_scenario
from simulator.solver.follow import PathError
from tests.closed_form import Pair
from tests.pairs import gent_force, pair, single
from tests.test_export import EXACT

ROOT = Path(__file__).parent.parent
SCENARIOS = sorted((ROOT / "scenarios").glob("*.toml"))
CLOSE = 1e-10

PAIRS = {
    "3a_a": Pair("1", "1", "0.6"),
    "3a_b": Pair("1", "1", "1.2"),
    "3a_c": Pair("1", "1", "1.3"),
    "3b_a": Pair("1", "0.2", "0.6"),
    "3b_b": Pair("1", "0.2", "1.2"),
    "3b_c": Pair("1", "0.2", "1.3"),
    "3c_a": Pair("1", "0.015", "0.6"),
    "3c_b": Pair("1", "0.015", "1.2"),
    "3c_c": Pair("1", "0.015", "1.3"),
    "5b_a": Pair("0.5", "1", "1.2"),
    "5b_b": Pair("0.5", "1", "2.4"),
    "5b_c": Pair("0.5", "1", "2.6"),
    "5c_a": Pair("0.5", "0.05", "1.2"),
    "5c_b": Pair("0.5", "0.05", "2.4"),
    "5c_c": Pair("0.5", "0.05", "2.6"),
}  # fmt: skip

# Guesses (λ₁, λ₂) of the limit points, and whether tension is lost at the end.
TURNS = {
    "3a_a": ([], True),
    "3a_b": ([], True),
    "3a_c": ([], False),
    "3b_a": ([(1.4115, 1.028)], True),
    "3b_b": ([(2.1204, 1.0316)], True),
    "3b_c": ([], False),
    "3c_a": ([(1.3852, 1.037)], True),
    "3c_b": ([(2.0545, 1.05), (4.9436, 1.002)], True),
    "3c_c": ([], False),
    "5b_a": ([(1.3206, 1.239), (2.66088, 1.0364), (2.91696, 1.0132)], True),
    "5b_b": ([(1.3886, 6.7311)], False),
    "5b_c": ([], False),
    "5c_a": ([(1.3191, 1.242), (4.7361, 1.0122)], False),
    "5c_b": ([(1.3885, 6.7311)], False),
    "5c_c": ([], False),
}
ENDS = {"5b_b": "zero_voltage", "5c_b": "zero_voltage"}

# Where tension is lost on whole paths, unstable parts too.
SLACK = {
    "3a_a": (0.66343884, 1.42273100),
    "3a_b": (0.51182337, 1.98790939),
    "3b_a": (0.49689606, 2.05667863),
    "3b_b": (0.36071083, 3.00655999),
    "3c_a": (0.27875742, 4.61702739),
    "3c_b": (0.50037230, 6.87572519),
    "5b_a": (0.35135102, 3.11035532),
}


def scenario(name: str):
    return load_scenario(ROOT / "scenarios" / f"fig{name[:2]}_state_{name[-1]}.toml")


def special(curve, kind: str):
    return [point for point in curve.points if point.kind == kind]


@pytest.mark.parametrize("name", PAIRS)
def test_special_points_are_those_of_the_closed_form(name):
    curve, (guesses, slack) = trace(scenario(name)), TURNS[name]
    found = special(curve, "limit_point")
    assert len(found) == len(guesses)
    for point, guess in zip(found, guesses, strict=True):
        voltage, active, passive, pressure = PAIRS[name].limit_point(*guess)
        assert point.voltage[0] == pytest.approx(float(voltage), abs=CLOSE)
        assert point.pressure == pytest.approx(float(pressure), abs=CLOSE)
        assert point.stretch == pytest.approx([float(active), float(passive)], abs=1e-9)
    assert curve.end.kind == ("loss_of_tension" if slack else ENDS.get(name, "stretch_limit"))
    if slack:
        voltage, active = PAIRS[name].slack()
        assert curve.end.voltage[0] == pytest.approx(float(voltage), abs=CLOSE)
        assert curve.end.stretch == pytest.approx([float(active), 1.0], abs=CLOSE)
        assert abs(curve.end.pressure) < CLOSE
        assert (curve.end.voltage[0], curve.end.stretch[0]) == pytest.approx(SLACK[name], abs=1e-8)


@pytest.mark.parametrize("name", ["5b_b", "5c_b"])
def test_zero_voltage_beyond_the_limit_point(name):
    point = trace(scenario(name)).end
    active, passive, pressure = PAIRS[name].state(mp.mpf(0), 1.61, point.stretch[1])
    assert point.voltage[0] == 0.0
    assert point.stretch == pytest.approx([float(active), float(passive)], abs=1e-9)
    assert point.pressure == pytest.approx(float(pressure), abs=CLOSE)


@pytest.mark.parametrize("name", PAIRS)
def test_all_points_satisfy_the_equations(name):
    made = scenario(name)
    m, ambient = made.balloons[0].radius, made.gas.ambient_pressure
    for curve in trace_all(made):
        (x, y), p, v = curve.stretch.T, curve.pressure, curve.voltage[:, 0]
        for stretch, load in ((x, m * p * x**2 + 2 * v**2 * x**3), (y, p * y**2)):
            # Eqs. 5 and 6 times their pole: what is left of J − I near the limit has lost its digits.
            invariant = (2 * stretch**2 + stretch**-4 - 3) / 100
            terms = [2 * stretch, -2 * stretch**-5, -load, invariant * load]
            assert np.max(np.abs(sum(terms)) / sum(np.abs(term) for term in terms)) < 1e-12
        gas = (p + ambient) * (m**3 * x**3 + y**3)
        assert np.max(np.abs(gas / gas[0] - 1)) < 1e-12
        assert curve.field[:, 0] == pytest.approx(v * x**2, rel=1e-14)
        assert curve.charge[:, 0] == pytest.approx(m**2 * v * x**4, rel=1e-14)


@pytest.mark.parametrize("name", PAIRS)
def test_stability_changes_at_limit_points_and_nowhere_else(name):
    curve = trace(scenario(name))
    changes = np.flatnonzero(np.diff(curve.unstable))
    turns = [point.arclength for point in special(curve, "limit_point")]
    assert curve.arclength[changes] == pytest.approx(turns, abs=1e-9)
    assert curve.unstable[0] == 0
    clear = np.abs(curve.stability) > 1e-9
    assert ((curve.stability > 0) == (curve.unstable == 0))[clear].all()
    assert (np.diff(curve.arclength) > 0).all()


@pytest.mark.parametrize("file", SCENARIOS, ids=lambda file: file.stem)
def test_every_shipped_scenario_traces(file):
    made = load_scenario(file)
    curve = trace(made) if made.electroded else trace_inflation(made)
    assert curve.end.kind in {"loss_of_tension", "stretch_limit", "zero_voltage", "out_of_range"}
    assert np.isfinite(curve.energy).all()


@pytest.mark.parametrize(("count", "ambient"), [(2, 0.5), (2, 0.015), (3, 0.5)])
def test_equal_actuators_trace_through_their_branch_point_and_on(count, ambient):
    """On the symmetric path all are alike: its limit point is that of one balloon on its share of gas."""
    gent = {"model": "gent", "J_lim": 100}

    def made(names):
        balloons = [{"name": name, "electrodes": True, "elastomer": gent} for name in names]
        return load_scenario(
            {
                "title": "equal",
                "gas": {"ambient_pressure": ambient},
                "balloon": balloons,
                "step": [{"inflate": 1.2}],
            }
        )

    curve, alone = trace(made("abc"[:count])), trace(made("a"))
    (fold,), (own,) = special(curve, "limit_point")[:1], special(alone, "limit_point")[:1]
    assert special(curve, "branch_point")[0].arclength < fold.arclength
    assert fold.stretch == pytest.approx([own.stretch[0]] * count, abs=1e-9)
    assert fold.voltage[0] == pytest.approx(own.voltage[0], abs=1e-11)


@pytest.mark.parametrize(("name", "kept"), [("5b_b", 6.02643177), ("5c_b", 6.05890575)])
def test_detached_branches_are_found_when_asked_for(name, kept):
    first, detached = trace_all(scenario(name))
    assert first.end.kind == "zero_voltage"
    assert detached.stretch[0, 0] == pytest.approx(kept, abs=5e-9)
    exact = PAIRS[name].state(mp.mpf(0), kept, detached.stretch[0, 1])
    assert [*detached.stretch[0], detached.pressure[0]] == pytest.approx([float(x) for x in exact], abs=CLOSE)
    assert (detached.unstable == 0).all()


def test_a_path_without_detached_branches_is_alone():
    assert len(trace_all(scenario("3c_b"))) == 1


def test_rests_are_in_equilibrium():
    device, group, start = sealed_state(scenario("5b_b"))
    found = rests(device, group.equations.gas)
    assert any(np.abs(rest - start).max() < 1e-9 for rest in found)
    for active, passive, pressure, voltage in found:
        assert voltage == 0.0
        assert gent_force(active) == pytest.approx(0.5 * pressure * active**2, rel=1e-10)
        assert gent_force(passive) == pytest.approx(pressure * passive**2, rel=1e-10)


@pytest.mark.parametrize(("balloon", "ratio"), [("active", 2.0), ("passive", 1.0), (None, 1.0)])
def test_peak_and_valley_of_inflation(balloon, ratio):
    curve = trace_inflation(scenario("5b_a"), balloon, to_stretch=7.0)
    found = special(curve, "limit_point")
    for point, guess in zip(found, (1.4, 4.14), strict=True):
        exact = mp.findroot(lambda a: mp.diff(lambda x: mp_force(x) / x**2, a), mp.mpf(guess))
        assert point.stretch[0] == pytest.approx(float(exact), abs=1e-9)
        assert point.pressure == pytest.approx(ratio * float(mp_force(exact) / exact**2), abs=CLOSE)
    assert [point.pressure / ratio for point in found] == pytest.approx(
        [1.2536545513298676, 0.7028725314932649], abs=CLOSE
    )
    assert curve.balloons == ((balloon or "passive"),)
    assert curve.end.kind == "reached"
    assert curve.end.stretch[0] == pytest.approx(7.0, abs=1e-12)
    assert curve.pressure * curve.stretch[:, 0] ** 2 / ratio == pytest.approx(
        gent_force(curve.stretch[:, 0]), rel=1e-12, abs=1e-13
    )


def mp_force(stretch):
    return 200 * (stretch - stretch**-5) / (100 - (2 * stretch**2 + stretch**-4 - 3))


def test_peak_of_a_neo_hookean_balloon():
    curve = trace_inflation(single({"inflate": 1.0}, elastomer={"model": "neo-hookean"}), to_stretch=3.0)
    (peak,) = special(curve, "limit_point")
    assert peak.stretch[0] == pytest.approx(7 ** (1 / 6), abs=1e-9)
    assert peak.pressure == pytest.approx(2 * (7 ** (-1 / 6) - 7 ** (-7 / 6)), abs=CLOSE)


@pytest.mark.parametrize(
    ("until", "kind"),
    [
        ({"to_voltage": 0.2}, "reached"),
        ({"to_stretch": 6.0}, "reached"),
        ({"to_voltage": 0.7}, "loss_of_tension"),
        ({"to_stretch": 7.0}, "loss_of_tension"),
    ],
)
def test_a_path_stops_where_it_is_asked_to_if_it_gets_there(until, kind):
    end = trace(scenario("3c_b"), **until).end
    assert end.kind == kind
    if kind == "reached" and "to_voltage" in until:
        assert end.voltage[0] == until["to_voltage"]
    elif kind == "reached":
        assert end.stretch[0] == pytest.approx(until["to_stretch"], abs=1e-12)


def test_a_voltage_is_met_on_the_way_up_first():
    end = trace(scenario("5b_b"), to_voltage=0.1).end
    exact = PAIRS["5b_b"].state(mp.mpf("0.1"), *end.stretch)
    assert end.stretch[0] < 1.38
    assert end.stretch == pytest.approx([float(x) for x in exact[:2]], abs=1e-9)


def test_an_elastomer_without_a_limit_is_followed_far():
    curve = trace_inflation(single({"inflate": 0.5}, elastomer={"model": "neo-hookean"}))
    assert [point.kind for point in curve.points] == ["limit_point", "unbounded"]
    assert curve.points[0].stretch[0] == pytest.approx(7 ** (1 / 6), abs=1e-12)
    assert curve.end.stretch[0] == pytest.approx(1e3, rel=1e-12)
    assert curve.end.pressure == pytest.approx(2e-3, rel=1e-12)  # p = 2(λ⁻¹ − λ⁻⁷)


@pytest.mark.parametrize(
    ("elastomer", "unit", "points"),
    [
        ({"model": "neo-hookean"}, 1.0, [(7 ** (1 / 6), 1.239463)]),
        # Pressures in Pa: c₁ = 3e5, c₂ = 3e4, H/R = 0.01, so that μH/R = 6600.
        ({"model": "mooney-rivlin", "C1": 3e5, "C2": 3e4}, 6600.0, [(1.47607, 8943.7), (3.14262, 7581.7)]),
        (
            {"model": "ogden", "mu": [3e5, -3e4], "alpha": [2, -2]},
            6600.0,
            [(1.47607, 8943.7), (3.14262, 7581.7)],
        ),
        ({"model": "gent", "J_lim": 50}, 1.0, [(1.41440, 1.269166), (2.96438, 0.951209)]),
    ],
    ids=["neo-hookean", "mooney-rivlin", "ogden", "gent"],
)
def test_limit_points_of_a_balloon(elastomer, unit, points):
    curve = trace_inflation(single({"inflate": 0.5}, elastomer=elastomer))
    found = [(p.stretch[0], p.pressure * unit) for p in curve.points if p.kind == "limit_point"]
    assert len(found) == len(points)
    for (stretch, pressure), (wanted, at) in zip(found, points, strict=True):
        assert stretch == pytest.approx(wanted, abs=5e-6)
        assert pressure == pytest.approx(at, rel=6e-6)


def test_what_cannot_be_traced_is_said():
    without = load_scenario(ROOT / "scenarios/fig2_inflation.toml")
    with pytest.raises(ScenarioError, match="needs electrodes = true"):
        trace(without)
    with pytest.raises(ScenarioError, match=r"step\.1"):
        trace(single({"ramp": 0.1}))
    with pytest.raises(ScenarioError, match="must be > 0"):
        trace(pair(0.0))
    with pytest.raises(ScenarioError, match="must be one of first, second"):
        trace_inflation(without, "third")


# --- tables and pictures ---


def test_columns_of_a_path():
    curve = trace(scenario("3c_b"))
    table = curve.to_dataframe()
    assert list(table) == [
        "arclength", "voltage_active", "stretch_active", "stretch_passive", "pressure", "field_active",
        "charge_active", "energy", "stability", "stable", "sphericity_active", "sphericity_passive",
        "spheres",
    ]  # fmt: skip
    assert len(table) == len(curve)
    assert table["stable"].dtype == bool
    points = curve.points_to_dataframe()
    assert list(points) == [
        "kind", "balloon", "mode", "arclength", "voltage_active", "stretch_active", "stretch_passive",
        "pressure",
    ]  # fmt: skip
    assert points["kind"].tolist() == [
        "loss_of_sphericity", "limit_point", "limit_point", "sphericity_regained", "loss_of_tension",
    ]  # fmt: skip


def test_files_of_a_path_read_back_exactly(tmp_path):
    curve = trace(scenario("3c_b"))
    paths = curve.to_csv(tmp_path)
    assert [path.name for path in paths] == ["curve.csv", "points.csv", "trace.json"]
    assert b",true\n" in paths[0].read_bytes()
    pd.testing.assert_frame_equal(pd.read_csv(paths[0], **EXACT), curve.to_dataframe(), check_exact=True)
    pd.testing.assert_frame_equal(
        pd.read_csv(paths[1], keep_default_na=False, **EXACT),
        curve.points_to_dataframe(),
        check_exact=True,
        check_dtype=False,
    )


def test_several_paths_are_numbered(tmp_path):
    curves = trace_all(scenario("5b_b"))
    table = pd.read_csv(write_curves(curves, tmp_path)[0])
    assert next(iter(table)) == "curve"
    assert table["curve"].value_counts().to_dict() == {1: len(curves[0]), 2: len(curves[1])}
    assert point_columns(curves)["curve"].tolist() == [1, 1, 2]
    assert "curve" not in curve_columns(curves[:1])


def test_a_path_that_cannot_be_written(tmp_path):
    (tmp_path / "curve.csv").mkdir()
    with pytest.raises(OutputError, match="cannot write"):
        trace(scenario("3a_a")).to_csv(tmp_path)


def test_picture_shows_stable_solid_and_unstable_dashed():
    curve = trace(scenario("3c_b").model_copy(update={"shape": Shape(on_loss="ignore")}))
    (ax,) = curve.plot().axes
    parts = [line for line in ax.get_lines() if line.get_marker() == "None"]
    assert [line.get_linestyle() for line in parts] == ["-", "--", "-"]
    assert parts[1].get_linewidth() < parts[0].get_linewidth()
    marks = [line.get_marker() for line in ax.get_lines() if line.get_marker() != "None"]
    assert marks == ["*", "*", "X"]
    ends = [line.get_xydata()[-1] for line in parts]
    assert ends[0] == pytest.approx([curve.points[0].voltage[0], curve.points[0].stretch[0]])


def test_picture_leaves_out_enormous_voltages():
    figure = plot_curves(trace_all(scenario("5b_b")))
    assert figure.axes[0].get_xlim()[1] < 1.0
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "curve 1, stable", "curve 2, stable", "unstable", "limit point",
    ]  # fmt: skip


def test_picture_of_an_inflation_is_over_pressure():
    curve = trace_inflation(scenario("3a_a"), to_pressure=2.0)
    assert png(plot_curves([curve]), dots_per_inch=50).startswith(b"\x89PNG")
    assert plot_curves([curve]).axes[0].get_xlabel() == "pressure  PR/(μH)"


# --- the command ---


def command(*arguments: object):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


SEALED = ROOT / "scenarios/fig3c_state_b.toml"
DETACHED = ROOT / "scenarios/fig5b_state_b.toml"
INFLATION = ROOT / "scenarios/fig2_inflation.toml"


def test_trace_writes_two_tables_where_it_says(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = command("trace", SEALED)
    assert done.exit_code == 0
    assert "0.360441" in done.stdout
    assert "end      loss of tension; " in done.stdout
    folder = tmp_path / "results/fig3c_state_b-trace"
    assert sorted(path.name for path in folder.iterdir()) == ["curve.csv", "points.csv", "trace.json"]


def test_trace_quiet_with_a_picture(tmp_path):
    done = command("trace", SEALED, "--out", tmp_path / "here", "--plot", "--quiet")
    assert (done.exit_code, done.stdout) == (0, "")
    assert (tmp_path / "here/curve.png").read_bytes().startswith(b"\x89PNG")


def test_trace_all_numbers_the_curves(tmp_path):
    done = command("trace", DETACHED, "--all", "--out", tmp_path)
    assert done.exit_code == 0
    assert "end      curve 2: stretch limit" in done.stdout
    assert (tmp_path / "points.csv").read_text("utf-8").startswith("curve,kind,")


def test_trace_of_an_inflation(tmp_path):
    done = command(
        "trace", INFLATION, "--inflation", "--balloon", "first", "--to-pressure", 3, "--out", tmp_path
    )
    assert done.exit_code == 0
    assert "end      reached" in done.stdout
    table = pd.read_csv(tmp_path / "points.csv")
    assert list(table) == ["kind", "balloon", "mode", "arclength", "stretch_first", "pressure"]
    assert table["pressure"].to_numpy()[-1] == 3.0


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--to-voltage", 0.2), "end      reached"),
        (("--to-stretch", 3), "end      reached"),
        (("--to-voltage", 0.7), "not reached: the path ended by loss of tension"),
        (("--to-stretch", 7.1), "not reached: the path ended by loss of tension"),
    ],
)
def test_trace_says_whether_it_got_there(tmp_path, options, said):
    done = command("trace", SEALED, "--out", tmp_path, *options)
    assert done.exit_code == 0
    assert said in done.stdout


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((INFLATION,), "needs electrodes = true"),
        (("nothing.toml",), "nothing.toml"),
        ((INFLATION, "--inflation", "--balloon", "third"), "must be one of first, second"),
        ((SEALED, "--to-pressure", 1), "--to-pressure goes with --inflation"),
        ((SEALED, "--inflation", "--to-voltage", 1), "--to-voltage does not go with --inflation"),
        ((SEALED, "--balloon", "active"), "--balloon goes with --inflation"),
        ((SEALED, "--all", "--to-voltage", 1), "--all traces whole paths"),
        ((SEALED, "--all", "--inflation"), "--all traces whole paths"),
        ((SEALED, "--to-voltage", -1), "must be a number >= 0"),
        ((SEALED, "--to-voltage", "nan"), "must be a number >= 0"),
        ((SEALED, "--to-stretch", 0.5), "must be a number >= 1"),
    ],
)
def test_trace_of_what_makes_no_sense_is_refused(tmp_path, arguments, said):
    done = command("trace", *arguments, "--out", tmp_path / "out")
    assert done.exit_code == 2
    assert said in done.stderr
    assert not (tmp_path / "out").exists()


def test_a_path_that_cannot_be_followed_is_exit_code_3(tmp_path, monkeypatch):
    def fail(*_: object, **__: object) -> None:
        raise PathError("lost the way")

    monkeypatch.setattr("simulator.analysis.trace.trace", fail)
    done = command("trace", SEALED, "--out", tmp_path / "out")
    assert done.exit_code == 3
    assert "the solver failed: lost the way" in done.stderr
    assert not (tmp_path / "out").exists()


def test_an_interrupted_trace_writes_nothing(tmp_path, monkeypatch):
    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("simulator.analysis.trace.trace", interrupt)
    assert command("trace", SEALED, "--out", tmp_path / "out").exit_code == 130
    assert not (tmp_path / "out").exists()
