"""A history as a picture: drive and stretches in time, and the stretch–voltage loop.

Every `plot_*` function but `plot_history` draws into axes it is given and returns them. Solid lines
are states the balloons went through; a jump is dashed, since nothing in between was an equilibrium.
"""

from __future__ import annotations

from collections import Counter
from math import ceil, dist
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from simulator.events import SHAPE_EVENTS, WORDS, EventKind, Outcome
from simulator.results.plot.axes import Labels, add_stretch_axis, shown_history
from simulator.results.plot.lines import draw_in_time, is_crowded
from simulator.results.plot.loops import (
    cell,
    distinct_jumps,
    first_passages,
    last_of_branches,
    moving,
    polyline,
    span,
    travelled,
)
from simulator.results.plot.style import (
    BLACK,
    COLOURS,
    FAINT,
    GREY,
    THINNER,
    arrowhead,
    dress,
    in_own_style,
    mark,
    marker_style,
)
from simulator.results.record import ending
from simulator.results.shapes import lost_rows

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from simulator.results.history import Event, FloatArray, History

    BoolArray = NDArray[np.bool_]
    IntArray = NDArray[np.int64]
    Point = tuple[float, float]

END_STYLE: dict[str, Any] = {
    "marker": "o",
    "markersize": 7.0,
    "markerfacecolor": "white",
    "markeredgecolor": BLACK,
    "markeredgewidth": 1.2,
    "linestyle": "none",
    "zorder": 4,
}

# Beyond these a picture gains ink and no information.
MOST_MARKED_EVENTS = 40
LEGEND_COLUMNS = 6

# Shorter than this part of the panel, an arrow is all head.
SHORTEST_ARROW = 0.05


@in_own_style
def plot_history(history: History) -> Figure:
    """Draw a whole history: drive and stretches in time at the left, the loop at the right.

    Parameters
    ----------
    history : History

    Returns
    -------
    matplotlib.figure.Figure
        Not registered with pyplot: save it with ``figure.savefig(path)``.
    """
    # Room at the left: the labels of a column are aligned after the layout is made.
    figure = Figure(figsize=(11.0, 6.4), layout=ConstrainedLayoutEngine(w_pad=0.09, wspace=0.06))
    has_voltage = bool(history.electroded)
    heights = [1.0, 1.0, 2.0] if has_voltage else [1.0, 2.0]
    grid = figure.add_gridspec(len(heights), 2, height_ratios=heights, width_ratios=[1.1, 1.0])
    panels = [figure.add_subplot(grid[0, 0])]
    panels += [figure.add_subplot(grid[row, 0], sharex=panels[0]) for row in range(1, len(heights))]
    loop = figure.add_subplot(grid[:, 1])

    if has_voltage:
        plot_voltage(history, panels[0])
    plot_pressure(history, panels[-2])
    plot_stretches(history, panels[-1])
    plot_loop(history, loop)

    for panel in panels[:-1]:
        panel.tick_params(labelbottom=False)
        panel.set_xlabel("")
    figure.align_ylabels(panels)
    # Titles are the user's words: a dollar sign in them is money, not mathematics.
    figure.suptitle(fill(history.scenario.title, 90), parse_math=False, fontsize=13, fontweight="bold")
    loop.set_title(_ending(history), fontsize=10, color=GREY, loc="right")
    handles = _legend(history)
    columns = ceil(len(handles) / ceil(len(handles) / LEGEND_COLUMNS))
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False)
    return figure


def plot_voltage(history: History, ax: Axes) -> Axes:
    """Draw the voltage of every electroded balloon in time; one black line where all are the same.

    Parameters
    ----------
    history : History
    ax : matplotlib.axes.Axes

    Returns
    -------
    matplotlib.axes.Axes
        The same axes.
    """
    history, labels = shown_history(history)
    voltage = history.voltage
    if _is_common(voltage):
        draw_in_time(history, voltage[:, 0], ax, BLACK, 1.5)
    else:
        for i, name in enumerate(history.electroded):
            draw_in_time(history, voltage[:, i], ax, _colour(history, name), _width(i))
    return _dress_time_axes(ax, labels, f"voltage\n{labels.voltage}")


def plot_pressure(history: History, ax: Axes) -> Axes:
    """Draw the excess pressure in time.

    Parameters
    ----------
    history : History
    ax : matplotlib.axes.Axes

    Returns
    -------
    matplotlib.axes.Axes
        The same axes.
    """
    history, labels = shown_history(history)
    draw_in_time(history, history.pressure, ax, BLACK, 1.5, lost_rows(history))
    return _dress_time_axes(ax, labels, f"pressure\n{labels.pressure}")


def plot_stretches(history: History, ax: Axes) -> Axes:
    """Draw the stretch of every balloon in time, with the events on the balloon that each moves most.

    Where the scenario has [scales] it is the radius.

    Parameters
    ----------
    history : History
    ax : matplotlib.axes.Axes

    Returns
    -------
    matplotlib.axes.Axes
        The same axes.
    """
    history, labels = shown_history(history)
    lost = lost_rows(history)
    for i, name in enumerate(history.balloons):
        draw_in_time(history, history.stretch[:, i], ax, _colour(history, name), _width(i), lost)
    if len(history.events) <= MOST_MARKED_EVENTS:
        for event in history.events:
            side = event.stretch_before if event.kind not in SHAPE_EVENTS else event.stretch_after
            if side is not None:
                mark(event.kind, event.time, side[_most_moved(history, event)], ax)
    return _dress_time_axes(ax, labels, f"{labels.extent}\n{labels.size}")


def plot_loop(history: History, ax: Axes, *, colour: str | None = None) -> Axes:
    """Draw stretch over voltage of the first electroded balloon, with jumps dashed and events marked.

    Where no balloon has electrodes it is stretch over pressure of the first balloon. Parts of the
    loop that are retraced, cycle after cycle, are drawn once. Where the scenario has [scales] it is
    the radius, with the stretch at the right.

    Parameters
    ----------
    history : History
    ax : matplotlib.axes.Axes
    colour : str, optional
        By default that of the balloon.

    Returns
    -------
    matplotlib.axes.Axes
        The same axes.
    """
    history, labels = shown_history(history)
    balloon = _shown_balloon(history)
    name = history.balloons[balloon]
    colour = colour or _colour(history, name)
    x = history.voltage[:, 0] if history.electroded else history.pressure
    y = history.stretch[:, balloon]
    if len(history):
        spans = np.array([span(x), span(y)])
        kept = moving(x, y, history.branch, spans)
        x, y, branch = x[kept], y[kept], history.branch[kept]
        new = first_passages(x, y, branch, spans)
        lost = lost_rows(history)[kept][:-1]
        ax.plot(*polyline(x, y, new & ~lost), color=colour, linewidth=1.8, solid_capstyle="round")
        if lost.any():
            ax.plot(*polyline(x, y, new & lost), color=colour, linewidth=1.8 * THINNER, alpha=FAINT)
        for start, end in travelled(x, y, new, spans):
            arrowhead(start, end, ax, colour)
        at_once = [event.time for event in history.events if event.kind is EventKind.JUMP]
        first_the_drive = np.isin(history.time[kept], at_once)
        for before, corner, after in distinct_jumps(x, y, branch, spans, first_the_drive):
            ax.plot(*zip(before, corner, after, strict=True), color=colour, linewidth=1.2, linestyle="--")
            if dist(corner / spans, after / spans) > SHORTEST_ARROW:
                arrowhead(corner, after, ax, colour)
        for kind, at in _distinct_marks(history, balloon, spans):
            mark(kind, at[0], at[1], ax)
        if _stops_between_events(history):
            ax.plot(x[-1:], y[-1:], **END_STYLE)
    drive = f"voltage on {name}  {labels.voltage}" if history.electroded else f"pressure  {labels.pressure}"
    ax.set_xlabel(drive)
    ax.set_ylabel(f"{labels.extent} of {name}  {labels.size}")
    ax.margins(0.06)
    if labels.unstretched:
        add_stretch_axis(ax, labels.unstretched[balloon])
    return dress(ax)


def _distinct_marks(history: History, balloon: int, spans: FloatArray) -> list[tuple[EventKind, Point]]:
    """Kind and place of the events that concern the balloon shown, each place once."""
    marks: dict[tuple[EventKind, int, int], tuple[EventKind, Point]] = {}
    for event in history.events:
        if event.kind in SHAPE_EVENTS and event.balloon != history.balloons[balloon]:
            continue
        drive = float(event.voltage[0]) if history.electroded else event.pressure_before
        if history.electroded and event.kind not in {EventKind.JUMP, *SHAPE_EVENTS}:
            # At a given charge the voltage falls in a snap; the event has it after that.
            drive = _voltage_before(history, event)
        at = (drive, float(event.stretch_before[balloon]))
        after = event.stretch_after
        if event.kind in SHAPE_EVENTS and after is not None:
            at = (float(event.voltage[0]) if history.electroded else drive, float(after[balloon]))
        elif after is not None and cell(at, spans) == cell((drive, float(after[balloon])), spans):
            continue
        key = (event.kind, *cell(at, spans))
        marks.setdefault(key, (event.kind, at))
    return list(marks.values())


def _voltage_before(history: History, event: Event) -> float:
    rows = np.flatnonzero(history.time == event.time)
    same = rows[(history.stretch[rows] == event.stretch_before).all(axis=1)]
    return float(history.voltage[same[0] if same.size else rows[0], 0])


def _legend(history: History) -> list[Artist]:
    voltage, stretch = history.voltage, history.stretch
    handles: list[Artist] = [
        Line2D([], [], color=_colour(history, name), linewidth=1.8, label=f"balloon {name}")
        for name in history.balloons
    ]
    if _is_common(voltage):
        handles.append(Line2D([], [], color=BLACK, linewidth=1.5, label="voltage, the same on all"))
    if any(is_crowded(values) for values in stretch.T if values.size):
        handles.append(Patch(color=GREY, alpha=0.35, linewidth=0.0, label="range over many cycles"))
    kinds = Counter(event.kind for event in history.events)
    if last_of_branches(history.branch).size:
        label = "snap or jump" if EventKind.JUMP in kinds else "snap"
        handles.append(Line2D([], [], color=GREY, linewidth=1.2, linestyle="--", label=label))
    if lost_rows(history).any():
        faint: dict[str, Any] = {"linewidth": 1.8 * THINNER, "alpha": FAINT}
        handles.append(Line2D([], [], color=GREY, label="no sphere follows", **faint))
    for kind, count in kinds.items():
        times = f"  ({count}×)" if count > 1 else ""
        handles.append(Line2D([], [], label=WORDS[kind] + times, **marker_style(kind)))
    if len(history) and _stops_between_events(history):
        handles.append(Line2D([], [], label="end", **END_STYLE))
    return handles


def _stops_between_events(history: History) -> bool:
    """Whether no event marks the place where the history ends."""
    return history.outcome in (Outcome.COMPLETED, Outcome.FAILED)


def _is_common(voltage: FloatArray) -> bool:
    """Whether there are several electroded balloons, always at one voltage."""
    return voltage.shape[1] > 1 and bool((voltage == voltage[:, :1]).all())


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


def _shown_balloon(history: History) -> int:
    return history.balloons.index(history.electroded[0]) if history.electroded else 0


def _most_moved(history: History, event: Event) -> int:
    if event.balloon is not None:
        return history.balloons.index(event.balloon)
    if event.stretch_after is None:
        return _shown_balloon(history)
    return int(np.argmax(np.abs(np.log(event.stretch_after / event.stretch_before))))


def _colour(history: History, name: str) -> str:
    return COLOURS[history.balloons.index(name) % len(COLOURS)]


def _width(i: int) -> float:
    """Later lines are thinner, so that a line they cover still shows beside them."""
    return (2.2, 1.4)[i] if i < 2 else 1.0


def _dress_time_axes(ax: Axes, labels: Labels, label: str) -> Axes:
    ax.set_xlabel(f"time  {labels.time}")
    ax.set_ylabel(label)
    ax.margins(x=0.01, y=0.08)
    return dress(ax)
