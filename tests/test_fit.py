"""Fits of made data: estimates and errors against formulas, SciPy and the model's own sensitivities."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import curve_fit
from typer.testing import CliRunner

from simulator import fit, load_scenario, read_fit, sensitivities, simulate
from simulator.cli import app
from simulator.identification import estimation
from tests.pairs import pair

FITS = Path("scenarios/fits")
KEY = "balloon.active.elastomer.J_lim"


def gent(stretch, modulus, J):
    """Pressure of a Gent balloon over its stretch, R/H = 1: the formula of docs/physics.md written anew."""
    first = 2.0 * stretch**2 + stretch**-4 - 3.0
    return modulus * 2.0 * (stretch**-1 - stretch**-7) * J / (J - first)


def written(path, columns):
    lines = [
        ",".join(columns),
        *(",".join(f"{v:.12g}" for v in row) for row in zip(*columns.values(), strict=True)),
    ]
    path.write_text("\n".join(lines) + "\n")
    return str(path)


def inflation(tmp_path, noise=0.01, count=30, seed=1, J=100.0):
    stretch = np.linspace(1.05, 5.5, count)
    pressure = gent(stretch, 1.0, J) + np.random.default_rng(seed).normal(0.0, noise, count)
    file = written(tmp_path / "inflation.csv", {"lam": stretch, "p": pressure})
    return stretch, pressure, file


def inflated(file, free, scenario=None, **more):
    table = {"file": file, "x": {"stretch_active": "lam"}, "y": {"pressure": "p"}, **more.pop("data", {})}
    return {
        "scenario": scenario or pair(1.0, {"ramp": 0.1}),
        "data": [{**table, "step": 1}],
        "free": free,
        **more,
    }


FREE = {
    KEY: {"start": 60, "low": 45, "high": 400},
    "balloon.active.modulus": {"start": 1.3, "low": 0.2, "high": 5},
}


def test_an_inflation_gives_what_scipys_curve_fit_gives(tmp_path):
    stretch, pressure, file = inflation(tmp_path)
    for sigma in ({"sigma": {"p": 0.01}}, {}):
        found = fit(inflated(file, FREE, data=sigma))
        known = np.full(stretch.size, 0.01) if sigma else None
        best, covariance = curve_fit(
            lambda x, J, modulus: gent(x, modulus, J), stretch, pressure, p0=[80.0, 1.1], sigma=known,
            absolute_sigma=bool(sigma), ftol=1e-13, xtol=1e-13,
        )  # fmt: skip
        assert found.converged
        assert [one.value for one in found.estimates] == pytest.approx(best, rel=1e-5)
        errors = np.sqrt(np.diag(covariance))
        assert [one.standard_error for one in found.estimates] == pytest.approx(errors, rel=1e-3)
        assert found.correlation[0, 1] == pytest.approx(covariance[0, 1] / errors.prod(), rel=1e-3)
    assert found.reduced_chi2 == pytest.approx(1.0, abs=1e-3)


def test_intervals_are_those_of_normal_and_student_distributions(tmp_path):
    _, _, file = inflation(tmp_path, count=6)
    for sigma, times in (
        ({"sigma": {"p": 0.01}}, 1.6448536),
        ({}, 2.1318468),
    ):  # z and t of 4 degrees at 0.95
        one = fit(inflated(file, FREE, data=sigma, fit={"confidence": 0.9})).estimates[1]
        assert (one.high - one.value) / one.standard_error == pytest.approx(times, rel=1e-6)
        assert (one.value - one.low) / one.standard_error == pytest.approx(times, rel=1e-6)


def test_estimates_are_unbiased_and_their_intervals_cover_the_truth(tmp_path):
    """A slice of `tests/benchmarks/test_fit_coverage.py`, which has 200 draws."""
    scores, covered = [], 0
    for seed in range(24):
        _, _, file = inflation(tmp_path, seed=seed)
        one = fit(inflated(file, FREE, data={"sigma": {"p": 0.01}}))[KEY]
        scores.append((one.value - 100.0) / one.standard_error)
        covered += one.low <= 100.0 <= one.high
    assert abs(np.mean(scores)) < 3.5 / np.sqrt(24)
    assert 0.6 < np.std(scores) < 1.5
    assert covered >= 20


@pytest.fixture(scope="module")
def ramp():
    """A ramp with a snap: the paper's pair, and 61 samples of each step."""
    scenario = pair(
        1.2, {"ramp": 0.45, "over": 10}, ambient=0.015, output={"points": 61}, shape={"on_loss": "ignore"}
    )
    return scenario, simulate(scenario)


def test_a_fit_goes_through_a_snap(tmp_path, ramp):
    scenario, history = ramp
    rows = (history.step == 2) & (history["voltage_active"] != history.events[0].voltage[0])
    stretch = history["stretch_active"][rows] + np.random.default_rng(3).normal(0.0, 0.01, rows.sum())
    file = written(tmp_path / "ramp.csv", {"v": history["voltage_active"][rows], "lam": stretch})
    data = {
        "file": file,
        "x": {"voltage_active": "v"},
        "y": {"stretch_active": "lam"},
        "sigma": {"lam": 0.01},
    }
    for start in (70.0, 130.0):
        free = {"balloon.*.elastomer.J_lim": {"start": start, "low": 30, "high": 300}}
        found = fit({"scenario": scenario, "data": [{**data, "step": 2}], "free": free})
        (one,) = found.estimates
        assert found.converged
        assert abs(one.value - 100.0) < 3.0 * one.standard_error < 9.0
        (column,) = found.columns
        assert not column.beyond.any()
        assert set(column.branch.tolist()) == {1, 2}
        assert np.abs(column.residual / column.sigma).max() < 4.0


def test_an_event_gives_the_error_that_the_sensitivity_says(ramp):
    scenario, history = ramp
    key = "gas.ambient_pressure"
    (rate,) = sensitivities(history, history.mechanical[0], [key])
    voltage = float(history.mechanical[0].voltage[0])
    event = {"kind": "limit_point", "number": 1, "voltage_active": voltage, "sigma": 1e-4}
    free = {key: {"start": 0.02, "low": 0, "high": 1}}
    found = fit({"scenario": scenario, "data": [{"event": event, "step": 2}], "free": free})
    (one,) = found.estimates
    assert one.value == pytest.approx(0.015, rel=1e-5)
    assert one.standard_error == pytest.approx(1e-4 / abs(rate.derivative), rel=1e-3)


def test_an_event_that_the_start_does_not_reach_is_found(ramp):
    scenario, history = ramp
    stiff = scenario.with_values({"step.2.ramp": 0.3})  # which is below the limit point
    voltage = float(history.mechanical[0].voltage[0])
    event = {"kind": "limit_point", "voltage_active": 0.8 * voltage, "sigma": 1e-3}
    free = {"balloon.active.permittivity": {"start": 1, "low": 0.5, "high": 4}}
    (one,) = fit({"scenario": stiff, "data": [{"event": event, "step": 2}], "free": free}).estimates
    assert one.value == pytest.approx(1.0 / 0.8**2, rel=1e-4)  # of one film e and the voltage enter as eφ²


def test_a_profile_ends_where_the_likelihood_has_fallen_as_far_as_it_should(tmp_path):
    stretch, pressure, file = inflation(tmp_path, noise=0.05, count=12)
    asked = inflated(file, FREE, data={"sigma": {"p": 0.05}}, fit={"profile": True})
    one = fit(asked)[KEY]

    def chi2(J):
        (modulus,), _ = curve_fit(lambda x, m: gent(x, m, J), stretch, pressure, p0=[1.0])
        return float((((pressure - gent(stretch, modulus, J)) / 0.05) ** 2).sum())

    for end in (one.low, one.high):
        assert chi2(end) - chi2(one.value) == pytest.approx(3.8414588, rel=2e-2)  # χ² of 1 degree at 0.95
    assert one.high - one.value > 1.1 * (one.value - one.low)  # which an ellipse does not know
    single = {KEY: FREE[KEY]}
    alone = fit(inflated(file, single, data={"sigma": {"p": 0.05}}, fit={"profile": True}))[KEY]
    squares = [
        (((pressure - gent(stretch, 1.0, J)) / 0.05) ** 2).sum() for J in (alone.value, alone.low, alone.high)
    ]
    assert [s - squares[0] for s in squares[1:]] == pytest.approx([3.8414588] * 2, rel=1e-3)


def test_what_the_data_do_not_tell_is_named(tmp_path):
    _, _, file = inflation(tmp_path)
    keys = (
        "balloon.active.modulus",
        "balloon.active.thickness",
    )  # of which the pressure has the product alone
    found = fit(inflated(file, {key: {"start": 1.1, "low": 0.5, "high": 2} for key in keys}))
    (open_one,) = found.undetermined
    assert open_one.weights[keys[0]] == pytest.approx(-open_one.weights[keys[1]], rel=1e-3)
    assert all(np.isnan(one.standard_error) or one.standard_error > 1e3 for one in found.estimates)
    assert found.estimates[0].value * found.estimates[1].value == pytest.approx(1.0, abs=0.02)


def test_an_outlier_counts_less_with_another_loss(tmp_path):
    stretch, pressure, _ = inflation(tmp_path)
    pressure[-3] += 1.0
    file = written(tmp_path / "outlier.csv", {"lam": stretch, "p": pressure})
    plain, soft = (fit(inflated(file, FREE, fit={"loss": loss}))[KEY].value for loss in ("linear", "soft_l1"))
    assert abs(soft - 100.0) < 0.2 * abs(plain - 100.0)


def test_starts_are_drawn_and_the_best_minimum_is_kept(tmp_path):
    _, _, file = inflation(tmp_path)
    found = fit(inflated(file, FREE, fit={"starts": 4, "seed": 7}))
    assert len(found.starts) == 4
    assert max(found.starts) == pytest.approx(28.0)
    assert found[KEY].value == pytest.approx(fit(inflated(file, FREE))[KEY].value, rel=1e-4)


def test_an_unknown_number_of_units_is_read_as_it_is_written(tmp_path):
    scenario = load_scenario("scenarios/vhb_snap.toml")
    plain = fit(FITS / "vhb_inflation.toml")
    with open(FITS / "vhb_inflation.csv") as stream:
        rows = [[float(cell) for cell in line.split(",")] for line in stream.readlines()[2:]]
    lines = [f"{a * 40.0:.6f};{1e3 * b:.4f}".replace(".", ",") for a, b in rows]  # mm and Pa
    (tmp_path / "d.csv").write_text("\n\nd (mm);p [Pa]\n" + "\n".join(lines) + "\n", "utf-8")
    table = {"x": {"diameter_active": "d"}, "y": {"pressure": "p"}, "sigma": {"p": 20}, "step": 1}
    file = {"file": str(tmp_path / "d.csv"), "separator": ";", "decimal": ",", "skip": 2}
    free = {
        "scales.shear_modulus": {"start": "40000 Pa", "low": "5 kPa", "high": "0.2 MPa"},
        KEY: {"start": 80, "low": 10, "high": 1000},
    }
    other = fit({"scenario": scenario, "data": [{**file, **table}], "free": free})
    assert other[KEY].value == pytest.approx(plain[KEY].value, rel=1e-4)
    assert other["scales.shear_modulus"].unit == "Pa"
    pair_of = [found["scales.shear_modulus"].value for found in (other, plain)]
    assert pair_of[0] == pytest.approx(1e3 * pair_of[1], rel=1e-4)


def test_the_shipped_data_are_those_of_the_device_that_they_are_said_to_be_of():
    for name in ("vhb_inflation", "vhb_snap"):
        problem = read_fit(FITS / f"{name}.toml")
        truth = {"scales.shear_modulus": 45.0, "scales.permittivity": 4.7}
        values = {one.key: truth.get(one.key, 270.0) for one in problem.free}
        weights = [1.0 / np.where(np.isnan(one.sigma), 0.02, one.sigma) for one in problem.measured]
        found = estimation.Residuals.of(problem).model.predict(values, weights)
        squares = [
            (((one.values - part.values) * weight) ** 2).sum()
            for one, part, weight in zip(problem.measured, found, weights, strict=True)
        ]
        assert 0.6 < sum(squares) / problem.size < 1.4


def test_the_command_writes_estimates_values_a_scenario_and_a_picture(tmp_path):
    done = CliRunner().invoke(app, ["fit", str(FITS / "vhb_inflation.toml"), "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    assert {path.name for path in tmp_path.iterdir()} == {
        "fit.json", "fit.csv", "fit-record.json", "fitted.toml", "fit.png",
    }  # fmt: skip
    record = json.loads((tmp_path / "fit.json").read_text("utf-8"))
    assert list(record) == ["estimates", "correlation", "reduced_chi2", "converged"]
    assert list(record["estimates"][KEY]) == ["value", "unit", "standard_error", "low", "high"]
    assert record["correlation"][KEY]["scales.shear_modulus"] == pytest.approx(0.65, abs=0.1)
    assert record["estimates"]["scales.shear_modulus"]["unit"] == "kPa"
    assert record["converged"] is True
    fitted = load_scenario(tmp_path / "fitted.toml")
    assert fitted.balloons[0].elastomer.J_lim == record["estimates"][KEY]["value"]
    with open(tmp_path / "fit.csv", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 40
    assert rows[0]["row"] == "3"
    assert rows[0]["unit"] == "kPa"
    for row in rows:
        assert float(row["data"]) - float(row["model"]) == pytest.approx(float(row["residual"]), abs=1e-12)


def test_a_search_that_did_not_converge_says_so_and_writes_what_it_has(tmp_path, monkeypatch):
    found = replace(fit(FITS / "vhb_inflation.toml"), converged=False, message="too many calls")
    monkeypatch.setattr(estimation, "fit", lambda problem, progress=None: found)
    words = ["fit", str(FITS / "vhb_inflation.toml"), "--out", str(tmp_path), "--no-plot", "--quiet"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 3
    assert "not converged: too many calls" in done.output
    assert json.loads((tmp_path / "fit.json").read_text("utf-8"))["converged"] is False


def test_a_recorded_voltage_is_followed_row_by_row(tmp_path):
    """Its corners are corners of the stretch in time: straight between rows, not smoothed over."""
    times = np.linspace(0.0, 10.0, 400)
    voltage = 0.15 * np.abs(np.sin(3.0 * times)) + 0.05 * times / 10.0
    drive = written(tmp_path / "drive.csv", {"time": times, "voltage": voltage})
    scenario = pair(1.1, {"table": drive}, output={"rows": True})
    history = simulate(scenario)
    rows = np.flatnonzero(history.step == 2)[5::23]
    data = {"t": history.time[rows], "lam": history["stretch_active"][rows]}
    table = {"file": written(tmp_path / "lam.csv", data), "x": {"time": "t"}, "y": {"stretch_active": "lam"}}
    free = {"balloon.active.permittivity": {"start": 1.3, "low": 0.5, "high": 2}}
    found = fit({"scenario": scenario, "data": [{**table, "sigma": {"lam": 1e-3}, "step": 2}], "free": free})
    assert found.estimates[0].value == pytest.approx(1.0, abs=1e-7)


def test_a_search_leaves_the_bound_that_it_starts_from(tmp_path):
    _, _, file = inflation(tmp_path)
    expected = fit(inflated(file, FREE))[KEY].value
    for bounds in ({"start": 50, "low": 50}, {"start": 50, "low": 50, "high": 400}):
        found = fit(inflated(file, {**FREE, KEY: bounds}))
        assert found.converged
        assert found[KEY].value == pytest.approx(expected, rel=1e-4)
