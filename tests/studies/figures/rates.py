"""Loops of a VHB film under triangles of voltage, at rates over six decades: material against snaps."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from simulator import History, load_scenario, simulate
from tests.studies.figures.style import INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PERIODS = (1e-2, 1e-1, 1.0, 1e1, 1e2, 1e3, 1e4)  # s
HIGHEST = "8 kV"
# Dark to light as it gets slower, and the slowest in a colour of its own.
COLOURS = ("#00224e", "#2a3f6d", "#575d6d", "#7f7c75", "#a69d75", "#d1c05f", "#d55e00")


def draw(scenarios: Path) -> Figure:
    """A balloon of VHB 4910 at a constant pressure, from the folder of the scenario files."""
    figure = Figure(figsize=(9.6, 4.0), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.2, 1.0))
    document = load_scenario(scenarios / "vhb_delayed_snap.toml").to_dict()
    histories = {period: simulate(load_scenario(_triangles(document, period, 2))) for period in PERIODS}
    relaxed = simulate(load_scenario(_relaxed(document)))
    draw_loops(left, histories, relaxed)
    first = [simulate(load_scenario(_triangles(document, period, 1))) for period in PERIODS]
    draw_losses(right, histories, first, relaxed)
    return figure


def draw_loops(ax: Axes, histories: dict[float, History], relaxed: History) -> Axes:
    """The second cycle of each rate, and the loop of the relaxed film."""
    kept = relaxed.cycle == 1
    ax.plot(
        relaxed.si("voltage_active")[kept] / 1e3, relaxed.stretch[kept, 0] - 1.0, color=INK, lw=1.0, ls=":"
    )
    for colour, (period, history) in zip(COLOURS, histories.items(), strict=True):
        kept = history.cycle == 2
        volts, strain = history.si("voltage_active")[kept] / 1e3, history.stretch[kept, 0] - 1.0
        ax.plot(volts, strain, color=colour, lw=1.3, label=f"{period:g} s")
    ax.set(yscale="log", xlabel=r"voltage  $\Phi$ / kV", ylabel=r"strain of the second cycle  $\lambda-1$")
    ax.legend(
        title="period (dotted: relaxed)", ncols=2, loc="center", bbox_to_anchor=(0.45, 0.52), fontsize=8.5
    )
    return ax


def draw_losses(ax: Axes, histories: dict[float, History], first: list[History], relaxed: History) -> Axes:
    """What the second cycle has lost in the material's branches, and besides: in snaps."""
    unit = relaxed.scenario.scales
    assert unit is not None
    millijoule = 1e3 * unit.energy
    material, snaps = [], []
    for history, before in zip(histories.values(), first, strict=True):
        here, there = history.energy_balance, before.energy_balance
        lost = sum(here.dissipated_in.values()) - sum(there.dissipated_in.values())
        material.append(millijoule * lost)
        snaps.append(millijoule * (here.dissipated - there.dissipated) - material[-1])
    periods = np.array(PERIODS)
    ax.plot(periods, material, "o-", color="#0072B2", label="in the viscoelastic branches")
    ax.plot(periods, snaps, "s-", color="#D55E00", label="in the friction: in snaps")
    ax.axhline(millijoule * relaxed.energy_balance.dissipated, color=INK, lw=1.0, ls=":")
    ax.text(
        1.2e-2, 1.25 * millijoule * relaxed.energy_balance.dissipated, "snaps of the relaxed film", fontsize=9
    )
    ax.set(xscale="log", yscale="log", xlabel="period / s", ylabel="lost in the second cycle / mJ")
    ax.legend(loc="upper left", bbox_to_anchor=(0.0, 0.9))
    return ax


def _triangles(document: dict[str, Any], period: float, cycles: int) -> dict[str, Any]:
    """The film at rest at a pressure, and then triangles; a friction that is small at every rate."""
    wave = {"low": "0 V", "high": HIGHEST, "period": f"{period!r} s", "cycles": cycles}
    rest = {"hold": "1000 s", "valve": "open"}
    return {
        **document,
        "dynamics": {"relaxation_time": f"{1e-5 * period!r} s"},
        "step": [{"inflate": "0.15 kPa", "over": "20 s"}, rest, {"triangle": wave, "valve": "open"}],
        "output": {"points": 401},
        "shape": {"on_loss": "ignore"},
    }


def _relaxed(document: dict[str, Any]) -> dict[str, Any]:
    """The same without branches, at rest at every moment."""
    found = _triangles(document, 1.0, 1)
    (film,) = found["balloon"]
    del found["dynamics"]
    return {**found, "balloon": [{key: value for key, value in film.items() if key != "maxwell"}]}
