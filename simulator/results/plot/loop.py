"""Loops of a history: stretch over voltage of each actuator, and its charge over its voltage.

Each function draws into axes it is given and returns them.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import dist
from typing import TYPE_CHECKING, Any

import numpy as np

from simulator.events import SHAPE_EVENTS, EventKind, Outcome
from simulator.results.plot.axes import add_stretch_axis, shown_history
from simulator.results.plot.in_time import colour_of, shown_balloon
from simulator.results.plot.loops import (
    cell,
    distinct_jumps,
    first_passages,
    moving,
    polyline,
    span,
    told_apart,
    travelled,
)
from simulator.results.plot.style import BLACK, FAINT, THINNER, arrowhead, dress, mark
from simulator.results.shapes import lost_rows
from simulator.units import ENERGY, with_prefix

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from simulator.results.history import Event, FloatArray, History

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

# Of cycles that do not repeat.
FIRST: dict[str, Any] = {"color": BLACK, "linewidth": 1.0}
BETWEEN: dict[str, Any] = {"linewidth": 0.8, "alpha": 0.4}

SHORTEST_ARROW = 0.05  # of the panel; a shorter arrow is all head


@dataclass(frozen=True)
class _Shown:
    """Which balloon a loop shows, and which of the electrodes are its own (or the first)."""

    balloon: int
    electrodes: int

    @classmethod
    def of(cls, history: History, name: str | None) -> _Shown:
        balloon = shown_balloon(history) if name is None else history.balloons.index(name)
        own = history.balloons[balloon]
        return cls(balloon, history.electroded.index(own) if own in history.electroded else 0)


def plot_loop(history: History, ax: Axes, *, balloon: str | None = None, colour: str | None = None) -> Axes:
    """Draw stretch over voltage of one balloon, with jumps dashed and events marked.

    Where no balloon has electrodes it is stretch over pressure. Parts of the loop that are retraced, cycle
    after cycle, are drawn once. Where the scenario has [scales] it is the radius, with the stretch at the
    right.

    Parameters
    ----------
    history : History
    ax : matplotlib.axes.Axes
    balloon : str, optional
        By default the first one with electrodes.
    colour : str, optional
        By default that of the balloon.

    Returns
    -------
    matplotlib.axes.Axes
        The same axes.
    """
    history, labels = shown_history(history)
    shown = _Shown.of(history, balloon)
    name = history.balloons[shown.balloon]
    x = history.voltage[:, shown.electrodes] if history.electroded else history.pressure
    y = history.stretch[:, shown.balloon]
    if len(history):
        colour = colour or colour_of(history, name)
        _draw_path(history, x, y, ax, colour)
        for kind, at in _distinct_marks(history, shown, np.array([span(x), span(y)])):
            mark(kind, at[0], at[1], ax)
        if stops_between_events(history):
            ax.plot(x[-1:], y[-1:], **END_STYLE)
    on = history.electroded[shown.electrodes] if history.electroded else ""
    ax.set_xlabel(f"voltage on {on}  {labels.voltage}" if on else f"pressure  {labels.pressure}")
    ax.set_ylabel(f"{labels.extent} of {name}  {labels.size}")
    ax.margins(0.06)
    if labels.unstretched:
        add_stretch_axis(ax, labels.unstretched[shown.balloon])
    return dress(ax)


def cycles_differ(history: History) -> bool:
    """Whether in some loop the first and the last cycle are told apart."""
    for place, name in enumerate(history.electroded):
        x, y = history.voltage[:, place], history.stretch[:, history.balloons.index(name)]
        if len(history) and told_apart(history, x, y, np.array([span(x), span(y)])) is not None:
            return True
    return False


def plot_charge_loop(history: History, ax: Axes, *, balloon: str | None = None) -> Axes:
    """Draw charge over voltage of one balloon's electrodes, with jumps dashed; its area is the work.

    The title is the work ∫φ dq of the source over the whole history, on all electrodes where there are
    several.

    Parameters
    ----------
    history : History
    ax : matplotlib.axes.Axes
    balloon : str, optional
        By default the first one with electrodes.

    Returns
    -------
    matplotlib.axes.Axes
        The same axes.
    """
    work = history.energy_balance.electrical_work
    scales = history.scenario.scales
    said = with_prefix(ENERGY, work * scales.energy, 4) if scales else f"{work:.4g} × 4πR²Hμ"
    history, labels = shown_history(history)
    shown = _Shown.of(history, balloon)
    name = history.electroded[shown.electrodes]
    if len(history):
        x, y = history.voltage[:, shown.electrodes], history.charge[:, shown.electrodes]
        _draw_path(history, x, y, ax, colour_of(history, name))
        if stops_between_events(history):
            ax.plot(x[-1:], y[-1:], **END_STYLE)
    ax.set_xlabel(f"voltage on {name}  {labels.voltage}")
    ax.set_ylabel(f"charge  {labels.charge}")
    whose = " on all electrodes" if len(history.electroded) > 1 else ""
    ax.set_title(f"work of the source{whose}, ∫Φ dq = {said}", fontsize=10, loc="left")
    ax.margins(0.06)
    return dress(ax)


def _draw_path(history: History, x: FloatArray, y: FloatArray, ax: Axes, colour: str) -> None:
    """Draw where a history went in the plane of two quantities, with its direction, and its jumps dashed."""
    spans = np.array([span(x), span(y)])
    told = told_apart(history, x, y, spans)
    kept = moving(x, y, history.branch, spans)
    x, y, branch = x[kept], y[kept], history.branch[kept]
    lost = lost_rows(history)[kept][:-1]
    shown = np.zeros(max(x.size - 1, 0), dtype=bool)
    for among, style in _phases(history, kept, told):
        new = first_passages(x, y, branch, spans, among)
        look = {"color": colour, "linewidth": 1.8, "solid_capstyle": "round", **style}
        ax.plot(*polyline(x, y, new & ~lost), **look)
        if (new & lost).any():
            faint = {"linewidth": THINNER * look["linewidth"], "alpha": FAINT}
            ax.plot(*polyline(x, y, new & lost), **{**look, **faint})
        shown |= new if "alpha" not in style else False
    for start, end in travelled(x, y, shown, spans):
        arrowhead(start, end, ax, colour)
    at_once = [event.time for event in history.events if event.kind is EventKind.JUMP]
    first_the_drive = np.isin(history.time[kept], at_once)
    for before, corner, after in distinct_jumps(x, y, branch, spans, first_the_drive):
        ax.plot(*zip(before, corner, after, strict=True), color=colour, linewidth=1.2, linestyle="--")
        if dist(corner / spans, after / spans) > SHORTEST_ARROW:
            arrowhead(corner, after, ax, colour)


def _phases(
    history: History, kept: NDArray[np.bool_], told: tuple[int, int] | None
) -> list[tuple[NDArray[np.bool_] | None, dict[str, Any]]]:
    """Parts of a loop that look different, each as a choice of segments and its style.

    Where cycles do not repeat the first is thin and black, the last as usual, and those between are faint.
    """
    if told is None:
        return [(None, {})]
    cycle = history.cycle[kept][1:]
    first, last = (cycle == number for number in told)
    outside = cycle == 0
    return [(~(first | last | outside), BETWEEN), (outside, {}), (first, FIRST), (last, {})]


def _distinct_marks(history: History, shown: _Shown, spans: FloatArray) -> list[tuple[EventKind, Point]]:
    """Kind and place of the events that concern the balloon shown, each place once."""
    marks: dict[tuple[EventKind, int, int], tuple[EventKind, Point]] = {}
    for event in history.events:
        if event.kind in SHAPE_EVENTS and event.balloon != history.balloons[shown.balloon]:
            continue
        drive = float(event.voltage[shown.electrodes]) if history.electroded else event.pressure_before
        if history.electroded and event.kind not in {EventKind.JUMP, *SHAPE_EVENTS}:
            # At a given charge the voltage falls in a snap; the event has it after that.
            drive = _voltage_before(history, event, shown.electrodes)
        at = (drive, float(event.stretch_before[shown.balloon]))
        after = event.stretch_after
        if event.kind in SHAPE_EVENTS and after is not None:
            at = (drive, float(after[shown.balloon]))
        elif after is not None:
            stays = cell(at, spans) == cell((drive, float(after[shown.balloon])), spans)
            # In real time nothing jumps at a limit point; otherwise it is another balloon that does.
            if stays and not np.array_equal(event.stretch_before, after):
                continue
        key = (event.kind, *cell(at, spans))
        marks.setdefault(key, (event.kind, at))
    return list(marks.values())


def _voltage_before(history: History, event: Event, electrodes: int) -> float:
    rows = np.flatnonzero(history.time == event.time)
    same = rows[(history.stretch[rows] == event.stretch_before).all(axis=1)]
    return float(history.voltage[same[0] if same.size else rows[0], electrodes])


def stops_between_events(history: History) -> bool:
    """Whether no event marks the place where the history ends."""
    return history.outcome in (Outcome.COMPLETED, Outcome.FAILED)
