"""A history as a picture: what happened in time at the left, the loops of its actuators at the right."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from math import ceil
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from simulator.events import WORDS, EventKind, Outcome
from simulator.results.history import PANELS
from simulator.results.plot.in_time import (
    colour_of,
    is_common,
    plot_fields,
    plot_margins,
    plot_pressure,
    plot_stretches,
    plot_voltage,
)
from simulator.results.plot.lines import is_crowded
from simulator.results.plot.loop import (
    BETWEEN,
    END_STYLE,
    FIRST,
    cycles_differ,
    plot_charge_loop,
    plot_loop,
    stops_between_events,
)
from simulator.results.plot.loops import last_of_branches
from simulator.results.plot.style import BLACK, COLOURS, FAINT, GREY, THINNER, in_own_style, marker_style
from simulator.results.record import ending
from simulator.results.shapes import lost_rows

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

    from simulator.results.history import History

_Loop = tuple[Callable[..., Any], str | None]  # what draws it, and of which balloon

LEGEND_COLUMNS = 6
MOST_LOOPS = 6

# Panels over time by name, with their heights.
_IN_TIME: dict[str, tuple[Callable[[History, Axes], Axes], float]] = {
    "voltage": (plot_voltage, 1.0),
    "pressure": (plot_pressure, 1.0),
    "stretch": (plot_stretches, 2.0),
    "field": (plot_fields, 1.0),
    "margin": (plot_margins, 1.0),
}


def panels_of(history: History) -> tuple[str, ...]:
    """The panels that a history has by default.

    Fields and margins where a film has a strength, charges where they are given.
    """
    given = any(_gives_charge(step) for step in history.scenario.steps)
    panels = ("voltage", "pressure", "stretch") if history.electroded else ("pressure", "stretch")
    rated = ("field", "margin") if history.rated else ()
    return (*panels, *rated, "loop", *(("charge",) if given else ()))


def _gives_charge(step: Any) -> bool:
    """Whether a step, or one within it, gives charges."""
    return hasattr(step, "charge") or any(_gives_charge(inner) for inner in getattr(step, "steps", ()))


@in_own_style
def plot_history(history: History, panels: Sequence[str] | None = None) -> Figure:
    """Draw a whole history: drive and stretches in time at the left, the loop of each actuator at the right.

    Parameters
    ----------
    history : History
    panels : sequence of str, optional
        Some of voltage, pressure, stretch, field, margin, loop, charge; see `panels_of` for the default.

    Returns
    -------
    matplotlib.figure.Figure
        Not registered with pyplot: save it with ``figure.savefig(path)``.

    Raises
    ------
    ValueError
        If there is no such panel, or the history has nothing to show in it.
    """
    chosen = panels_of(history) if panels is None else tuple(dict.fromkeys(panels))
    _check(history, chosen)
    rows = [name for name in _IN_TIME if name in chosen]
    # A film without electrodes has no loop of its own. Beyond so many, loops are too small to be read.
    names: tuple[str | None, ...] = history.electroded[:MOST_LOOPS] or (None,)
    loops: list[_Loop] = [(plot_loop, name) for name in names if "loop" in chosen]
    loops += [(plot_charge_loop, name) for name in names if "charge" in chosen]
    across = 1 if len(loops) <= 2 else 2
    rows_high = max(sum(_IN_TIME[name][1] for name in rows), 2.0 * ceil(len(loops) / across))
    size = ((5.7 if rows else 0.0) + (5.3 * across if loops else 0.0), max(4.8, 1.6 * rows_high))
    # Room at the left: the labels of a column are aligned after the layout is made.
    figure = Figure(figsize=size, layout=ConstrainedLayoutEngine(w_pad=0.09, wspace=0.06))
    drawn = _place(figure, history, rows, loops, across)
    figure.suptitle(fill(history.scenario.title, 90), parse_math=False, fontsize=13, fontweight="bold")
    if drawn:
        drawn[0].set_title(_ending(history), fontsize=10, color=GREY, loc="right")
    handles = _legend(history)
    columns = ceil(len(handles) / ceil(len(handles) / LEGEND_COLUMNS))
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False)
    return figure


def _place(figure: Figure, history: History, rows: list[str], loops: list[_Loop], across: int) -> list[Axes]:
    """Draw the panels over time into the left and the loops into the right; return the loops, or else all."""
    widths = [1.1, across] if rows and loops else [1.0]
    halves = figure.add_gridspec(1, len(widths), width_ratios=widths)
    times: list[Axes] = []
    if rows:
        grid = halves[0, 0].subgridspec(len(rows), 1, height_ratios=[_IN_TIME[name][1] for name in rows])
        for place, name in enumerate(rows):
            times.append(figure.add_subplot(grid[place], sharex=times[0] if times else None))
            _IN_TIME[name][0](history, times[-1])
    for panel in times[:-1]:
        panel.tick_params(labelbottom=False)
        panel.set_xlabel("")
    figure.align_ylabels(times)
    if not loops:
        return times
    grid = halves[0, -1].subgridspec(ceil(len(loops) / across), across)
    drawn = []
    for place, (draw, balloon) in enumerate(loops):
        drawn.append(figure.add_subplot(grid[place // across, place % across]))
        draw(history, drawn[-1], balloon=balloon)
    return drawn


def _check(history: History, panels: Sequence[str]) -> None:
    """Raise ValueError where a panel is not there, or has nothing to show."""
    bare, unrated = not history.electroded, not history.rated
    nothing = {"voltage": bare, "field": bare, "charge": bare, "margin": unrated}
    for name in panels:
        if name not in PANELS:
            raise ValueError(f"panel {name!r}: must be one of {', '.join(PANELS)}")
        if nothing.get(name):
            lack = "no film has a dielectric strength" if name == "margin" else "no balloon has electrodes"
            raise ValueError(f"panel {name!r}: there is nothing to show, {lack}")
    if not panels:
        raise ValueError(f"panels: must be one or more of {', '.join(PANELS)}")


def _legend(history: History) -> list[Artist]:
    voltage, stretch = history.voltage, history.stretch
    handles: list[Artist] = [
        Line2D([], [], color=colour_of(history, name), linewidth=1.8, label=f"balloon {name}")
        for name in history.balloons
    ]
    if is_common(voltage):
        handles.append(Line2D([], [], color=BLACK, linewidth=1.5, label="voltage, the same on all"))
    if any(is_crowded(values) for values in stretch.T if values.size):
        handles.append(Patch(color=GREY, alpha=0.35, linewidth=0.0, label="range over many cycles"))
    if cycles_differ(history):
        handles.append(Line2D([], [], label="first cycle", **FIRST))
        if len(history.cycles) > 2:
            handles.append(Line2D([], [], color=GREY, label="cycles between", **BETWEEN))
        handles.append(Line2D([], [], color=GREY, linewidth=1.8, label="last cycle"))
    kinds = Counter(event.kind for event in history.events)
    if _leaps(history):
        label = "snap or jump" if EventKind.JUMP in kinds else "snap"
        handles.append(Line2D([], [], color=GREY, linewidth=1.2, linestyle="--", label=label))
    if history.rated:
        handles.append(Line2D([], [], color=GREY, linewidth=1.4, linestyle=":", label="dielectric strength"))
    if lost_rows(history).any():
        faint: dict[str, Any] = {"linewidth": 1.8 * THINNER, "alpha": FAINT}
        handles.append(Line2D([], [], color=GREY, label="no sphere follows", **faint))
    for kind, count in kinds.items():
        times = f"  ({count}×)" if count > 1 else ""
        handles.append(Line2D([], [], label=WORDS[kind] + times, **marker_style(kind)))
    if len(history) and stops_between_events(history):
        handles.append(Line2D([], [], label="end", **END_STYLE))
    return handles


def _leaps(history: History) -> bool:
    """Whether anything is dashed: in real time a limit point begins a branch, and nothing jumps there."""
    ends = last_of_branches(history.branch)
    moved = [np.column_stack([values[ends], values[ends + 1]]) for values in history.stretch.T]
    return any(bool((np.abs(np.diff(pair)) > 1e-9).any()) for pair in moved)


def _ending(history: History) -> str:
    return "" if len(history) and history.outcome is Outcome.COMPLETED else ending(history)


def plot_histories(
    histories: Sequence[History], labels: Sequence[str] | None = None, ax: Axes | None = None
) -> Axes:
    """Draw the loops of several histories into one panel, one colour each.

    Parameters
    ----------
    histories : sequence of History
    labels : sequence of str, optional
        For the legend; by default the titles of the scenarios.
    ax : matplotlib.axes.Axes, optional
        By default those of a new figure, `ax.figure`.

    Raises
    ------
    ValueError
        If there are not as many labels as histories.
    """
    if labels is not None and len(labels) != len(histories):
        raise ValueError(f"{len(labels)} labels for {len(histories)} histories")
    if ax is None:
        ax = Figure(figsize=(7.0, 5.0), layout="constrained").add_subplot()
    names = labels or [history.scenario.title for history in histories]
    handles = []
    for i, (history, name) in enumerate(zip(histories, names, strict=True)):
        colour = COLOURS[i % len(COLOURS)]
        plot_loop(history, ax, colour=colour)
        handles.append(Line2D([], [], color=colour, linewidth=1.8, label=name.replace("$", r"\$")))
    ax.legend(handles=handles, frameon=False)
    return ax
