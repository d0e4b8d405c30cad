"""How good fits are: estimates of made data beside the truth, and starts that lead to it.

    python -m tests.studies.fits [--draws 200] [--starts 100] [--out docs/fits.json]

Data are those of a known device plus normal noise, drawn anew each time. What is counted: whether the estimates
are unbiased, how often the 95 % interval holds the truth, and how often a fit through a snap finds its way from
starts that are off by up to 30 %.
"""

from __future__ import annotations

import argparse
import csv
import json
import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator import ScenarioError, fit, load_scenario, simulate
from simulator.scenario import Scenario

FloatArray = NDArray[np.float64]

SCENARIO = Path("scenarios/vhb_snap.toml")
TRUTH = {"scales.shear_modulus": 45.0, "balloon.*.elastomer.J_lim": 270.0, "scales.permittivity": 4.7}
FREE: dict[str, dict[str, Any]] = {
    "scales.shear_modulus": {"start": "40 kPa", "low": "5 kPa", "high": "200 kPa"},
    "balloon.*.elastomer.J_lim": {"start": 200, "low": 10, "high": 2000},
    "scales.permittivity": {"start": 4, "low": 2, "high": 10},
}
SIGMA, PRESSURE_SIGMA, EVENT_SIGMA = 0.02, 0.02, 0.05


def pressure_of_gent(stretch: FloatArray) -> FloatArray:
    """Of the active balloon, in kPa: the formula of docs/physics.md, written anew."""
    first = 2.0 * stretch**2 + stretch**-4 - 3.0
    return np.asarray(45.0 * 0.5 / 20.0 * 2.0 * (stretch**-1 - stretch**-7) * 270.0 / (270.0 - first))


def written(path: Path, **columns: FloatArray) -> str:
    with open(path, "w", newline="") as stream:
        table = csv.writer(stream)
        table.writerow(columns)
        table.writerows(zip(*(column.tolist() for column in columns.values()), strict=True))
    return str(path)


class Device:
    """The known device, and what would be measured of it."""

    def __init__(self, scenario: Scenario) -> None:
        history = simulate(scenario)
        event = next(event for event in history.events if event.kind == "limit_point")
        rows = np.flatnonzero((history.step == 2) & (history.time != event.time))[4::6]
        self.voltage = history.si("voltage_active")[rows] / 1e3
        self.extent = history["stretch_active"][rows]
        self.snap = float(np.asarray(event.si("voltage"))[0]) / 1e3
        self.scenario = scenario
        self.inflation = np.linspace(1.05, 5.0, 40)

    def problem(
        self, folder: Path, rng: np.random.Generator, *, sigma: bool, parts: str = "all"
    ) -> dict[str, Any]:
        """A fit of one draw; with the standard deviations or without them; of the ramp, the inflation, or all."""
        noisy = self.extent + rng.normal(0.0, SIGMA, self.extent.size)
        pumped = pressure_of_gent(self.inflation) + rng.normal(0.0, PRESSURE_SIGMA, self.inflation.size)
        through: dict[str, Any] = {
            "file": written(folder / "ramp.csv", **{"v [kV]": self.voltage, "lam": noisy}),
            "x": {"voltage_active": "v"},
            "y": {"stretch_active": "lam"},
            "step": 2,
        }
        inflation: dict[str, Any] = {
            "file": written(folder / "inflation.csv", **{"lam": self.inflation, "p [kPa]": pumped}),
            "x": {"stretch_active": "lam"},
            "y": {"pressure": "p"},
            "step": 1,
        }
        if sigma:
            through["sigma"], inflation["sigma"] = {"lam": SIGMA}, {"p": PRESSURE_SIGMA}
        snapped = self.snap + rng.normal(0.0, EVENT_SIGMA)
        event = {"kind": "limit_point", "voltage_active": f"{snapped!r} kV", "sigma": f"{EVENT_SIGMA} kV"}
        everything = [through, inflation, {"event": event, "step": 2}]
        data = {"ramp": [through], "inflation": [inflation], "all": everything}[parts]
        free = {key: FREE[key] for key in FREE if parts == "all" or key != "scales.permittivity"}
        return {"scenario": self.scenario, "data": data, "free": free}


def coverage(device: Device, draws: int, folder: Path, *, sigma: bool, parts: str = "all") -> dict[str, Any]:
    """Bias over its error, spread over the standard errors, and coverage of the 95 % intervals, by key."""
    scores: dict[str, list[float]] = {}
    covered: Counter[str] = Counter()
    failed = 0
    for seed in range(draws):
        found = fit(device.problem(folder, np.random.default_rng([18, seed]), sigma=sigma, parts=parts))
        failed += not found.converged
        for one in found.estimates:
            scores.setdefault(one.key, []).append((one.value - TRUTH[one.key]) / one.standard_error)
            covered[one.key] += one.low <= TRUTH[one.key] <= one.high
    return {
        "draws": draws,
        "not_converged": failed,
        "bias_over_its_error": {k: round(float(np.mean(s)) * draws**0.5, 2) for k, s in scores.items()},
        "spread_over_standard_error": {k: round(float(np.std(s)), 3) for k, s in scores.items()},
        "coverage": {k: round(covered[k] / draws, 3) for k in scores},
    }


def starts(device: Device, count: int, folder: Path) -> dict[str, Any]:
    """How many of so many starts, each number off by up to 30 %, lead to the best minimum; from the ramp alone."""
    keys = ("scales.shear_modulus", "scales.permittivity")
    problem = device.problem(folder, np.random.default_rng(18), sigma=True, parts="ramp")
    units = {"scales.shear_modulus": " kPa", "scales.permittivity": ""}
    rng = np.random.default_rng(30)
    found = []
    for _ in range(count):
        factors = rng.uniform(0.7, 1.3, len(keys))
        free = {
            key: {**FREE[key], "start": f"{TRUTH[key] * f!r}{units[key]}" if units[key] else TRUTH[key] * f}
            for key, f in zip(keys, factors.tolist(), strict=True)
        }
        try:
            one = fit({**problem, "free": free})
        except ScenarioError:  # the start cannot be played
            found.append((False, np.inf))
            continue
        found.append((one.converged, one.reduced_chi2 * one.degrees))
    best = min(chi2 for _, chi2 in found)
    led = sum(converged and chi2 < best + 0.01 for converged, chi2 in found)
    return {"starts": count, "led_to_the_best_minimum": led, "chi2_of_the_best": round(best, 2)}


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.studies.fits", description=__doc__)
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--starts", type=int, default=100)
    parser.add_argument("--out", type=Path, default=Path("docs/fits.json"))
    asked = parser.parse_args()
    device = Device(load_scenario(SCENARIO))
    record: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        parts: dict[str, Callable[[], dict[str, Any]]] = {
            "inflation_sigma_given": lambda: coverage(
                device, asked.draws, place, sigma=True, parts="inflation"
            ),
            "inflation_sigma_estimated": lambda: coverage(
                device, asked.draws, place, sigma=False, parts="inflation"
            ),
            "through_a_snap": lambda: starts(device, asked.starts, place),
            "sigma_given": lambda: coverage(device, asked.draws, place, sigma=True),
            "sigma_estimated": lambda: coverage(device, asked.draws, place, sigma=False),
        }
        for name, part in parts.items():
            record[name] = part()
            print(name, json.dumps(record[name], indent=2), flush=True)
    asked.out.write_text(json.dumps(record, indent=2) + "\n", "utf-8")


if __name__ == "__main__":
    main()
