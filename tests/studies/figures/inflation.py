"""Figs. 2 and 5a: inflation curves, with the states A, B and C on them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from simulator.analysis.trace import trace_inflation
from simulator.results.plot.curve import draw_path
from simulator.scenario import load_scenario
from tests.pairs import run
from tests.studies.figures import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from simulator.results.curve import Curve
    from simulator.scenario import Scenario


_FAR = 7.1  # stretch up to which curves are drawn
_HIGHEST = 1.6
_BIG = "#888888"


def draw_equal_balloons(scenarios: Path) -> Figure:
    """Fig. 2: the N-shaped curve, the states on it and the mechanical snap-through."""
    figure, ax = style.panel()
    curve = trace_inflation(load_scenario(scenarios / "fig3a_state_c.toml"), "passive", to_stretch=_FAR)
    plot_inflation(curve, ax, style.INK)
    _plot_snap(load_scenario(scenarios / "fig2_inflation.toml"), ax)
    peak = curve.mechanical[0]
    ax.annotate(
        rf"snap-through: {peak.pressure:.3f} at $\lambda_2$ = {float(peak.stretch[0]):.2f}",
        (float(peak.stretch[0]), peak.pressure),
        xytext=(2.0, 12.0),
        textcoords="offset points",
    )
    for letter, offset in (("A", (11.0, -2.0)), ("B", (-9.0, 7.0)), ("C", (11.0, -3.0))):
        scenario = load_scenario(scenarios / f"fig3a_state_{letter.lower()}.toml")
        style.state(letter, _inflated(scenario, 1), ax, offset)
    ax.set_xlim(0.5, 8.0)
    ax.set_ylim(0.0, _HIGHEST)
    ax.set_xlabel(style.PASSIVE)
    ax.set_ylabel(style.INFLATION)
    style.key(ax, "stable", "unstable", "snap", loc="lower center", bbox_to_anchor=(0.5, 0.08))
    return figure


def draw_unequal_balloons(scenarios: Path) -> Figure:
    """Fig. 5a: the curves of both balloons, the active one of half the radius."""
    figure, ax = style.panel()
    states = {letter: load_scenario(scenarios / f"fig5b_state_{letter.lower()}.toml") for letter in "ABC"}
    offsets = {
        "active": {"A": (-9.0, 7.0), "B": (-9.0, 7.0), "C": (11.0, -3.0)},
        "passive": {"A": (11.0, -7.0), "B": (11.0, -6.0), "C": (11.0, 5.0)},
    }
    for balloon, (name, places) in enumerate(offsets.items()):
        plot_inflation(trace_inflation(states["A"], name, to_stretch=_FAR), ax, (style.INK, _BIG)[balloon])
        for letter, scenario in states.items():
            style.state(letter, _inflated(scenario, balloon), ax, places[letter])
    ax.text(3.2, 1.86, r"active, $R_1 = 0.5\,R_2$", color=style.INK)
    ax.text(3.2, 0.52, "passive", color=_BIG)
    ax.set_xlim(0.5, 8.0)
    ax.set_ylim(0.0, 3.0)
    ax.set_xlabel(r"stretch  $\lambda_1,\ \lambda_2$")
    ax.set_ylabel(style.INFLATION)
    style.key(ax, "stable", "unstable", loc="lower right")
    return figure


def plot_inflation(curve: Curve, ax: Axes, colour: str) -> Axes:
    """Draw pressure over stretch, unstable where a pressure cannot hold it."""
    x, y = curve.stretch[:, 0], curve.pressure
    kept = np.union1d(style.thin(x, y, (7.0, 2.0)), np.flatnonzero(np.diff(curve.unstable)))
    draw_path(x[kept], y[kept], curve.unstable[kept], ax, colour)
    return ax


def _inflated(scenario: Scenario, balloon: int) -> tuple[float, float]:
    """Stretch and pressure of a balloon of a scenario at the end of its inflation."""
    history = run(scenario)
    last = int(np.flatnonzero(history.step == 1)[-1])
    return float(history.stretch[last, balloon]), float(history.pressure[last])


def _plot_snap(scenario: Scenario, ax: Axes) -> None:
    """The snap on the way up, at constant pressure."""
    event = run(scenario).events[0]
    if event.stretch_after is None:
        return
    start, end = (float(stretch[-1]) for stretch in (event.stretch_before, event.stretch_after))
    style.snap_path((start, event.pressure_before), (end, event.pressure_before), ax)
