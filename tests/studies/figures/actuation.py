"""Figs. 3a–c, 5b and 5c: voltage over stretch from the inflated states A, B and C."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from simulator.analysis.trace import trace_all
from simulator.results.plot.curve import draw_path
from simulator.scenario import load_scenario
from tests.pairs import run
from tests.studies.figures import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from simulator.results.curve import Curve
    from simulator.results.history import Event, FloatArray, History

_STRETCHES = (0.5, 8.0)
_HIGHEST = {"3a": 0.8, "3b": 0.7, "3c": 0.7, "5b": 0.6, "5c": 0.6}
_LEGENDS: dict[str, dict[str, Any]] = {
    "3a": {"loc": "center", "bbox_to_anchor": (0.47, 0.5)},
    "3b": {"loc": "center", "bbox_to_anchor": (0.53, 0.5)},
    "3c": {"loc": "center", "bbox_to_anchor": (0.45, 0.2), "ncols": 2},
    "5b": {"loc": "center", "bbox_to_anchor": (0.57, 0.55)},
    "5c": {"loc": "center", "bbox_to_anchor": (0.5, 0.63), "ncols": 2},
}
_MARKS = {
    "3a": ("stable", "cross"),
    "3b": ("stable", "unstable", "star", "cross"),
    "3c": ("stable", "unstable", "snap", "star", "cross"),
    "5b": ("stable", "unstable", "snap", "star", "cross"),
    "5c": ("stable", "unstable", "snap", "star"),
}
_LETTERS = {"A": (-9.0, 9.0), "B": (10.0, 9.0), "C": (11.0, 9.0)}  # in points from the inflated state


def draw(scenarios: Path, panel: str) -> Figure:
    """One panel: the whole equilibrium paths of states A, B and C, with their snaps."""
    figure, ax = style.panel()
    for letter in "ABC":
        scenario = load_scenario(scenarios / f"fig{panel}_state_{letter.lower()}.toml")
        curves = trace_all(scenario)
        plot_state(letter, curves, ax, _HIGHEST[panel])
        plot_snaps(run(scenario), ax)
        start = (float(curves[0].stretch[0, 0]), 0.0)
        style.state(letter, start, ax, _LETTERS[letter])
        for curve in curves[1:]:
            _residual(letter, float(curve.stretch[0, 0]), ax)
    ax.set_xlim(*_STRETCHES)
    ax.set_ylim(0.0, _HIGHEST[panel])
    ax.set_xlabel(style.ACTIVE)
    ax.set_ylabel(style.VOLTAGE)
    ambient = rf"$P_{{\mathrm{{env}}}}R_2/(\mu H) = {scenario.gas.ambient_pressure:g}$"
    style.key(ax, *_MARKS[panel], title=ambient, **_LEGENDS[panel])
    return figure


def plot_state(letter: str, curves: tuple[Curve, ...], ax: Axes, highest: float) -> Axes:
    """Draw the paths of one state up to a voltage: stars at EMI, crosses where tension is lost."""
    colour = style.COLOURS[letter]
    for curve in curves:
        x, y = curve.stretch[:, 0], curve.voltage[:, 0]
        seen = int(np.append(np.flatnonzero(y > highest), x.size - 1)[0]) + 1
        x, y, unstable = x[:seen], y[:seen], curve.unstable[:seen]
        kept = style.thin(x, y, (7.0, highest))
        turns = np.flatnonzero(np.diff(unstable))  # the turning points themselves
        kept = np.union1d(kept, turns)
        draw_path(x[kept], y[kept], unstable[kept], ax, colour)
        for i, point in enumerate(curve.mechanical):
            at = (float(point.stretch[0]), float(point.voltage[0]))
            if point.kind == "limit_point" and i == 0:
                style.star(at, ax, colour)
            if point.kind == "loss_of_tension":
                style.cross(at, ax, colour)
    return ax


def plot_snaps(history: History, ax: Axes) -> Axes:
    """Draw the voltage-driven snaps of a history on the way up that come to rest."""
    for event, after in snaps(history):
        if after[0] > event.stretch_before[0]:
            voltage = float(event.voltage[0])
            style.snap_path((float(event.stretch_before[0]), voltage), (float(after[0]), voltage), ax)
    return ax


def snaps(history: History) -> list[tuple[Event, FloatArray]]:
    """The voltage-driven snaps that come to rest, with the stretches there."""
    found = [(event, event.stretch_after) for event in history.snaps if event.voltage.any()]
    return [(event, after) for event, after in found if after is not None]


def _residual(letter: str, stretch: float, ax: Axes) -> None:
    """Mark the stretch that is left when the voltage is switched off."""
    ax.plot([stretch], [0.0], **{**style.inflated(letter), "markerfacecolor": style.COLOURS[letter]})
    ax.annotate(
        f"switched off: {stretch:.2f}",
        (stretch, 0.0),
        xytext=(-9.0, 9.0),
        textcoords="offset points",
        color=style.COLOURS[letter],
        fontsize=9.5,
        ha="right",
        va="center",
    )
