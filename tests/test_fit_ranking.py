"""Candidates fitted to the same data, ranked by AICc."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from scipy.optimize import curve_fit

from simulator import fit, load_scenario, rank_fits
from tests.pairs import pair
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


def treloar():
    """Stretches and pressures of a balloon of natural rubber, from Treloar's equal-biaxial stresses.

    Trans. Faraday Soc. 40 (1944), as in `scenarios/treloar_equibiaxial.csv`: nominal stresses σ over
    0.4225 MPa. A balloon of that film has the pressure 2σ/λ².
    """
    rows = np.loadtxt("scenarios/treloar_equibiaxial.csv", delimiter=",", skiprows=2)
    return rows[:, 0], 2.0 * rows[:, 1] / rows[:, 0] ** 2


def gent(x, modulus, J):
    return 2.0 * modulus * (x**-1 - x**-7) * J / (J - (2.0 * x**2 + x**-4 - 3.0))


def mooney_rivlin(x, modulus, second):
    return 2.0 * modulus * (x**-1 - x**-7) * (1.0 + second * x**2) / (1.0 + second)


def ogden(x, modulus, second):
    """Of two terms, the powers those of R. W. Ogden, Proc. R. Soc. Lond. A 326 (1972): 1.3 and 5."""
    terms = [m * (x ** (a - 3.0) - x ** (-2.0 * a - 3.0)) for m, a in ((1.0, 1.3), (second, 5.0))]
    return 4.0 * modulus * sum(terms) / (1.3 + 5.0 * second)  # 2μ = Σ μᵢαᵢ


@pytest.mark.parametrize(
    ("elastomer", "keys", "formula", "start"),
    [
        ({"model": "gent", "J_lim": 60}, ("modulus", "elastomer.J_lim"), gent, (0.9, 60.0)),
        (
            {"model": "mooney-rivlin", "C1": 1, "C2": 0.1},
            ("modulus", "elastomer.C2"),
            mooney_rivlin,
            (0.9, 0.1),
        ),
        (
            {"model": "ogden", "mu": [1, 0.01], "alpha": [1.3, 5]},
            ("modulus", "elastomer.mu.2"),
            ogden,
            (0.9, 0.01),
        ),
    ],
)
def test_treloars_equal_biaxial_data_give_what_scipy_finds_in_the_formula(
    tmp_path, elastomer, keys, formula, start
):
    stretch, pressure = treloar()
    rows = "\n".join(f"{x!r},{p!r}" for x, p in zip(stretch.tolist(), pressure.tolist(), strict=True))
    (tmp_path / "t.csv").write_text(f"lam,p\n{rows}\n", "utf-8")
    scenario = pair(1.0, active={"elastomer": elastomer})
    table = {"file": str(tmp_path / "t.csv"), "x": {"stretch_active": "lam"}, "y": {"pressure": "p"}}
    free = {f"balloon.active.{key}": {"start": at} for key, at in zip(keys, start, strict=True)}
    found = fit({"scenario": scenario, "data": [table], "free": free})
    best, covariance = curve_fit(formula, stretch, pressure, p0=start)
    assert [one.value for one in found.estimates] == pytest.approx(best, rel=1e-4)
    assert [one.standard_error for one in found.estimates] == pytest.approx(
        np.sqrt(np.diag(covariance)), rel=1e-2
    )
