"""Candidates fitted to the same data, ranked by AICc."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
import tomli_w

from simulator import fit, load_scenario, rank_fits
from tests.sweeps import balloons

VHB = load_scenario("scenarios/vhb_snap.toml")
SIGMA = 0.02
TABLE = {
    "file": "scenarios/fits/vhb_inflation.csv",
    "skip": 1,
    "x": {"stretch_active": "lam"},
    "y": {"pressure": "p"},
    "units": {"p": "kPa"},
    "sigma": {"p": f"{SIGMA} kPa"},
    "step": 1,
}
MODULUS = {"scales.shear_modulus": {"start": "40 kPa", "low": "5 kPa", "high": "200 kPa"}}
J_LIM = {"balloon.active.elastomer.J_lim": {"start": 80, "low": 10, "high": 1000}}
NEO = VHB.with_elastomers({"active": {"model": "neo-hookean"}})


def candidates(**changes):
    table = {key: value for key, value in {**TABLE, **changes}.items() if value is not None}
    return [
        fit({"scenario": VHB, "data": [table], "free": {**MODULUS, **J_LIM}}),
        fit({"scenario": NEO, "data": [table], "free": MODULUS}),
    ]


def test_with_known_errors_aicc_is_chi_squared_and_the_price_of_numbers():
    gent, neo = candidates()
    ranked = rank_fits([neo, gent])
    assert [one.fit for one in ranked] == [gent, neo]
    chi2 = [one.reduced_chi2 * one.degrees for one in (gent, neo)]
    price = [2 * k + 2 * k * (k + 1) / (40 - k - 1) for k in (2, 1)]
    assert ranked[1].delta == pytest.approx(chi2[1] + price[1] - chi2[0] - price[0], rel=1e-6)
    assert (ranked[0].delta, ranked[0].weight) == (0.0, pytest.approx(1.0))
    assert ranked[1].weight == pytest.approx(np.exp(-0.5 * ranked[1].delta))


def test_with_estimated_errors_it_is_that_of_the_largest_likelihood():
    gent, neo = candidates(sigma=None)
    square = [float(np.mean(one.columns[0].residual ** 2)) for one in (gent, neo)]
    price = [2 * k + 2 * k * (k + 1) / (40 - k - 1) for k in (3, 2)]  # sigma is a number, too
    expected = 40 * np.log(square[1] / square[0]) + price[1] - price[0]
    assert rank_fits([gent, neo])[1].delta == pytest.approx(expected, rel=1e-6)


def test_fits_to_other_data_are_not_compared(tmp_path):
    rows = Path(TABLE["file"]).read_text("utf-8").splitlines()
    (tmp_path / "less.csv").write_text("\n".join(rows[:30]) + "\n", "utf-8")
    with pytest.raises(ValueError, match="has other data than"):
        rank_fits([candidates()[0], candidates(file=str(tmp_path / "less.csv"))[1]])


def test_the_command_ranks_several_files(tmp_path):
    for name, scenario, free in (("gent", VHB, {**MODULUS, **J_LIM}), ("neo", NEO, MODULUS)):
        (tmp_path / f"{name}-device.toml").write_text(tomli_w.dumps(scenario.to_dict()), "utf-8")
        table = {**TABLE, "file": str(tmp_path / "i.csv")}
        written = {"title": name, "scenario": f"{name}-device.toml", "data": [table], "free": free}
        (tmp_path / f"{name}.toml").write_text(tomli_w.dumps(written), "utf-8")
    (tmp_path / "i.csv").write_text(Path(TABLE["file"]).read_text("utf-8"), "utf-8")
    files = [tmp_path / "neo.toml", tmp_path / "gent.toml"]
    done = balloons("fit", *files, "--out", tmp_path / "out", "--no-plot")
    assert done.exit_code == 0, done.output
    with open(tmp_path / "out" / "ranking.csv", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["fit"].rpartition("/")[2] for row in rows] == ["gent.toml", "neo.toml"]
    assert (tmp_path / "out/neo/fit.json").exists()
    assert "ranking  AICc over the best, weight" in done.output
    assert balloons("fit", files[0], files[0], "--out", tmp_path / "twice").exit_code == 2
