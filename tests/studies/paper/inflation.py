"""Fig. 2: the inflation curve."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy import optimize

from simulator.analysis.trace import trace_inflation
from simulator.model.device import Device
from simulator.model.elastomers import Elastomer, tension_force
from simulator.scenario import load_scenario
from tests.pairs import run
from tests.studies.paper.case import Case, Misprint, Statement
from tests.studies.paper.real import inflations

if TYPE_CHECKING:
    from simulator.results.curve import Curve

_FAR = 7.17  # stretch up to which curves are traced


def statements(scenarios: Path, cases: dict[str, Case]) -> list[Statement]:
    """The N-shaped curve, its states and its snap."""
    curve = trace_inflation(cases["3a A"].scenario, "passive", to_stretch=_FAR)
    peak, valley = (point for point in curve.points if point.kind == "limit_point")
    top, bottom = float(peak.stretch[0]), float(valley.stretch[0])
    pressures = {letter: _load(cases[f"3a {letter}"]) for letter in "ABC"}
    elastomer = Device.from_scenario(cases["3a A"].scenario).elastomers[1]
    roots = {letter: _roots(curve, elastomer, p) for letter, p in pressures.items()}
    inflated = {letter: float(cases[f"3a {letter}"].curve.stretch[0, 1]) for letter in "ABC"}
    up, down = _snaps(scenarios)
    limit = elastomer.stretch_limit
    parts = np.sign(np.diff(curve.pressure))
    turns = parts[np.insert(np.diff(parts) != 0, 0, True)].tolist()
    half = [trace_inflation(cases["5b A"].scenario, name, to_stretch=_FAR) for name in ("active", "passive")]
    active, passive = (one.mechanical[0] for one in half)
    spheres = inflations([curve])
    return [
        Statement(
            "Fig. 2",
            "N-shaped: going up, going down, going up",
            f"peak {peak.pressure:.10f} at λ = {top:.8f}, valley {valley.pressure:.10f} at λ = {bottom:.8f}",
            turns == [1.0, -1.0, 1.0],
            real=spheres,
        ),
        Statement(
            "Fig. 2",
            "P_snap R₂/(μH) = 1.254",
            f"{peak.pressure:.10f}",
            round(peak.pressure, 3) == 1.254,
            real=spheres,
        ),
        Statement("Fig. 2", "λ_snap = 1.4", f"{top:.8f}", round(top, 1) == 1.4, real=spheres),
        Statement(
            "Section 2",
            "at the pressures of A and C there is one stretch, at that of B there are three",
            "; ".join(f"{k}: {', '.join(f'{x:.4f}' for x in roots[k])}" for k in "ABC"),
            [len(roots[k]) for k in "ABC"] == [1, 3, 1],
            real=spheres,
        ),
        Statement(
            "Section 2",
            "the smallest of the three is reached when the pressure rises from small stretches",
            f"B inflates to λ = {inflated['B']:.10f}",
            abs(inflated["B"] - min(roots["B"])) < 1e-10,
            real=spheres,
        ),
        Statement(
            "Section 2",
            "on decreasing the pressure other states are stable",
            f"on the way down the balloons stay snapped below {up[1]:.4f}, until {down[1]:.10f}",
            down[1] < up[1] - 0.1,
            real=spheres,
        ),
        Statement(
            "Fig. 2",
            "above the critical pressure the balloon jumps to a large deformation",
            f"from λ = {up[0]:.6f} to {up[2]:.6f}, at the pressure {up[1]:.6f}",
            up[2] > 2.0 * up[0] and abs(up[1] - peak.pressure) < 1e-9,
            real=spheres,
        ),
        Statement(
            "Section 3",
            "A is far below snap-through, B at its verge, C beyond it",
            ", ".join(
                f"{k}: λ = {inflated[k]:.8f}, {p / peak.pressure:.0%} of the peak"
                for k, p in pressures.items()
            ),
            pressures["A"] < 0.6 * peak.pressure
            and 0.9 < pressures["B"] / peak.pressure < 1.0 < pressures["C"] / peak.pressure
            and inflated["C"] > bottom,
            real=spheres,
        ),
        Statement(
            "Section 3",
            "the active balloon's curve is the same but for the radius ratio m",
            f"at m = 0.5 its peak is {active.pressure:.8f} at the same stretch, "
            f"{active.pressure / passive.pressure:.6f} of the passive one's",
            abs(0.5 * active.pressure - passive.pressure) < 1e-10
            and abs(float(active.stretch[0] - passive.stretch[0])) < 1e-7,
            real=inflations(half),
        ),
        Statement(
            "Section 3", "the stretch limit is approximately seven", f"{limit:.10f}", round(limit) == 7
        ),
    ]


def misprints(cases: dict[str, Case]) -> list[Misprint]:
    """Section 3 calls Fig. 3a an inflation curve."""
    ratios = []
    for name in ("3a A", "5b A"):
        peaks = [
            trace_inflation(cases[name].scenario, balloon, to_stretch=_FAR).mechanical[0]
            for balloon in ("active", "passive")
        ]
        ratios.append(peaks[0].pressure / peaks[1].pressure)
    return [
        Misprint(
            "Section 3",
            "“this is shown in Fig. 3a”, “only Figs. 2, 3a are pressure-controlled inflation curves”",
            "Fig. 5a",
            "the caption of Fig. 3 and the text on it call all of 3a–c actuation curves, at m = 1; there the peaks of "
            f"the two balloons' inflation curves are the same (ratio {ratios[0]:.6f}) and nothing is to be shown, while "
            f"at the m = 0.5 of Fig. 5 their ratio is {ratios[1]:.6f}",
            abs(ratios[0] - 1.0) < 1e-9 and abs(ratios[1] - 2.0) < 1e-9,
        )
    ]


def _load(case: Case) -> float:
    """The pressure to which a case is inflated."""
    return float(case.curve.pressure[0])


def _roots(curve: Curve, elastomer: Elastomer, at: float) -> list[float]:
    """Stretches at which an inflation curve p = f/λ² has a pressure, between its points."""
    stretch = curve.stretch[:, 0]
    between = np.flatnonzero(np.diff(curve.pressure > at))
    return [
        float(optimize.brentq(lambda x: tension_force(elastomer, x) / x**2 - at, stretch[i], stretch[i + 1]))
        for i in between
    ]


def _snaps(scenarios: Path) -> list[tuple[float, float, float]]:
    """Stretch before, pressure and stretch after the snaps of a whole inflation and deflation."""
    events = run(load_scenario(scenarios / "fig2_inflation.toml")).events
    rests = [(event, event.stretch_after) for event in events if event.stretch_after is not None]
    snaps = [(float(e.stretch_before[0]), e.pressure_before, float(after[0])) for e, after in rests]
    return [snaps[0], snaps[-1]]
