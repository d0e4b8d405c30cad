"""The graph of states as a picture: each state over its range, and arrows where one leads to another."""

from __future__ import annotations

from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from simulator.results.plot.curve import NO_SPHERE, STABLE, draw_path
from simulator.results.plot.style import BLACK, COLOURS, GREY, VOLTAGE, dress, in_own_style, marker_style
from simulator.units import VOLTAGE as VOLTAGES
from simulator.units import prefixed

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

    from simulator.results.states import State, StateGraph, Transition

_MOST_STRETCHES = 6  # balloons whose stretches are written beside a state
UPWARDS, DOWNWARDS = COLOURS[1], COLOURS[0]


@in_own_style
def plot_states(graph: StateGraph) -> Figure:
    """Draw the largest stretch of each state over the voltage, and beside it the graph.

    Returns
    -------
    matplotlib.figure.Figure
        Not registered with pyplot: save it with ``figure.savefig(path)``.
    """
    height = min(max(4.6, 1.6 + 0.3 * len(graph)), 14.0)
    figure = Figure(figsize=(12.4, height), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(0.8, 1.0))
    _draw_stretches(graph, left)
    draw_graph(graph, right)
    figure.suptitle(fill(graph.title, 100), parse_math=False, fontsize=12, fontweight="bold")
    figure.legend(handles=_legend(graph), loc="outside lower center", ncols=6, frameon=False)
    return figure


def draw_graph(graph: StateGraph, ax: Axes) -> Axes:
    """Draw each state as a bar over its range of voltages, and arrows at the thresholds.

    States are in order of the volume that their balloons have where they are at their lowest voltage.

    Parameters
    ----------
    graph : StateGraph
    ax : matplotlib.axes.Axes

    Returns
    -------
    matplotlib.axes.Axes
        The same axes.
    """
    volts, label = _volts(graph)
    volume = [float(np.sum((graph.radius * state.stretch[0]) ** 3)) for state in graph.states]
    height = {int(number): place for place, number in enumerate(np.argsort(volume, kind="stable"))}
    for state in graph.states:
        _bar(graph, state, height[state.number], volts, ax)
    for one in graph.transitions:
        _arrow(one, height, volts, ax)
    ax.set_ylim(-0.8, len(graph) - 0.2)
    ax.set_xlim(volts * graph.low - 0.04 * volts * (graph.high - graph.low))
    ax.set_yticks(range(len(graph)), [str(n) for n in sorted(height, key=lambda n: height[n])])
    ax.set_ylabel("state")
    ax.set_xlabel(label, parse_math=False)
    return dress(ax)


def _bar(graph: StateGraph, state: State, height: int, volts: float, ax: Axes) -> None:
    colour = BLACK if state.reachable else GREY
    low, high = volts * state.low, volts * state.high
    ax.plot([low, high], [height, height], color=colour, linewidth=3.2, solid_capstyle="butt", zorder=2)
    if len(graph.balloons) <= _MOST_STRETCHES:
        shown = "  ".join(f"{x:.1f}" for x in state.stretch[state.stretch.shape[0] // 2])
        middle = 0.5 * (low + high)
        ax.annotate(
            shown,
            (middle, height),
            (0, 3),
            textcoords="offset points",
            ha="center",
            fontsize=7.5,
            color=colour,
        )


def _arrow(one: Transition, height: dict[int, int], volts: float, ax: Axes) -> None:
    x, colour = volts * one.drive, UPWARDS if one.direction == "up" else DOWNWARDS
    start = height[one.source]
    if one.target is None:
        assert one.ending is not None
        ax.plot([x], [start], zorder=5, **marker_style(one.ending))
        return
    end = height[one.target]
    ax.annotate(
        "",
        (x, end),
        (x, start),
        arrowprops={"arrowstyle": "-|>", "color": colour, "linewidth": 1.1, "shrinkA": 0, "shrinkB": 1.5},
        zorder=3,
    )
    ax.annotate(
        "+".join(one.balloons),
        (x, start + (0.5 if end > start else -0.5)),
        (3 if one.direction == "up" else -3, 0),
        textcoords="offset points",
        ha="left" if one.direction == "up" else "right",
        va="center",
        fontsize=7.5,
        color=colour,
        parse_math=False,
        bbox={"boxstyle": "round,pad=0.05", "facecolor": "white", "edgecolor": "none", "alpha": 0.75},
    )


def _draw_stretches(graph: StateGraph, ax: Axes) -> None:
    """The largest stretch of each state over the voltage, and dashed where one leads to another."""
    volts, label = _volts(graph)
    for state in graph.states:
        lost = state.lost if state.lost.any() else None
        stable = np.zeros(state.drive.size, dtype=np.int64)
        colour = BLACK if state.reachable else GREY
        draw_path(volts * state.drive, state.stretch.max(axis=1), stable, ax, colour, lost=lost)
    for one in graph.transitions:
        x, colour = volts * one.drive, UPWARDS if one.direction == "up" else DOWNWARDS
        if one.target is None:
            assert one.ending is not None
            ax.plot([x], [one.stretch_before.max()], zorder=5, **marker_style(one.ending))
        elif one.stretch_after is not None:
            ends = [float(one.stretch_before.max()), float(one.stretch_after.max())]
            ax.plot([x, x], ends, color=colour, linewidth=1.0, linestyle="--", zorder=1)
    ax.set_xlabel(label, parse_math=False)
    ax.set_ylabel("largest stretch of all balloons")
    ax.margins(0.06)
    dress(ax)


def _volts(graph: StateGraph) -> tuple[float, str]:
    """What the drive is to be multiplied by on the axis, and its label."""
    shares = set(graph.share.tolist())
    leader = graph.electroded[int(np.argmax(graph.share == 1.0))]
    what = "voltage" if shares == {1.0} and len(graph.share) > 1 else f"voltage on {leader}"
    if graph.scales is None:
        return 1.0, f"{what}  {VOLTAGE}"
    scale = graph.scales.of(VOLTAGES)
    size, unit = prefixed(VOLTAGES, graph.high * scale)
    return scale / size, f"{what}  Φ [{unit}]"


def _legend(graph: StateGraph) -> list[Artist]:
    handles: list[Artist] = [Line2D([], [], color=BLACK, label="stable state", **STABLE)]
    if not all(state.reachable for state in graph.states):
        handles.append(Line2D([], [], color=GREY, label="no way leads to it", **STABLE))
    if any(state.lost.any() for state in graph.states):
        handles.append(Line2D([], [], color=BLACK, label="stable for spheres only", **NO_SPHERE))
    for direction, colour, words in (("up", UPWARDS, "voltage rises"), ("down", DOWNWARDS, "voltage falls")):
        if any(one.direction == direction and one.target is not None for one in graph.transitions):
            handles.append(Line2D([], [], color=colour, linestyle="--", label=f"snap as the {words}"))
    endings = dict.fromkeys(one.ending for one in graph.transitions if one.ending is not None)
    handles += [Line2D([], [], label=kind.value.replace("_", " "), **marker_style(kind)) for kind in endings]
    return handles
