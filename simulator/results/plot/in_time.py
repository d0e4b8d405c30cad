"""Panels of a history over time: voltage, pressure, stretches, fields and margins.

Each function draws into axes it is given and returns them. Solid lines are states the balloons went through;
a jump is dashed, since nothing in between was an equilibrium.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from simulator.events import SHAPE_EVENTS
from simulator.results.plot.axes import Labels, shown_history
from simulator.results.plot.lines import draw_in_time
from simulator.results.plot.style import BLACK, COLOURS, GREY, dress, mark
from simulator.results.shapes import lost_rows

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from simulator.results.history import Event, FloatArray, History

MOST_MARKED_EVENTS = 40  # beyond these a picture gains ink and no information


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
    if is_common(voltage):
        draw_in_time(history, voltage[:, 0], ax, BLACK, 1.5)
    else:
        for i, name in enumerate(history.electroded):
            draw_in_time(history, voltage[:, i], ax, colour_of(history, name), _width(i))
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
        draw_in_time(history, history.stretch[:, i], ax, colour_of(history, name), _width(i), lost)
    if len(history.events) <= MOST_MARKED_EVENTS:
        for event in history.events:
            side = event.stretch_before if event.kind not in SHAPE_EVENTS else event.stretch_after
            if side is not None:
                mark(event.kind, event.time, side[_most_moved(history, event)], ax)
    return _dress_time_axes(ax, labels, f"{labels.extent}\n{labels.size}")


def plot_fields(history: History, ax: Axes) -> Axes:
    """Draw the true field of every film in time, and its dielectric strength, if it has one, dotted.

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
    for i, name in enumerate(history.electroded):
        draw_in_time(history, np.abs(history.field[:, i]), ax, colour_of(history, name), _width(i))
    for i, name in enumerate(history.rated):
        ax.plot(history.time, history.strength[:, i], ":", color=colour_of(history, name), linewidth=1.4)
    return _dress_time_axes(ax, labels, f"field\n{labels.field}")


def plot_margins(history: History, ax: Axes) -> Axes:
    """Draw how far the field of each film with a dielectric strength is from breakdown, which is at 0.

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
    for i, name in enumerate(history.rated):
        draw_in_time(history, history.margin[:, i], ax, colour_of(history, name), _width(i))
    ax.axhline(0.0, color=GREY, linewidth=0.8, linestyle=":")
    return _dress_time_axes(ax, labels, "margin to\nbreakdown")


def is_common(voltage: FloatArray) -> bool:
    """Whether there are several electroded balloons, always at one voltage."""
    return voltage.shape[1] > 1 and bool((voltage == voltage[:, :1]).all())


def _most_moved(history: History, event: Event) -> int:
    if event.balloon is not None:
        return history.balloons.index(event.balloon)
    if event.stretch_after is None:
        return shown_balloon(history)
    return int(np.argmax(np.abs(np.log(event.stretch_after / event.stretch_before))))


def shown_balloon(history: History) -> int:
    """The balloon whose loop is shown first: that of the first electrodes."""
    return history.balloons.index(history.electroded[0]) if history.electroded else 0


def colour_of(history: History, name: str) -> str:
    """The colour of a balloon."""
    return COLOURS[history.balloons.index(name) % len(COLOURS)]


def _width(i: int) -> float:
    """Later lines are thinner, so that a line they cover still shows beside them."""
    return (2.2, 1.4)[i] if i < 2 else 1.0


def _dress_time_axes(ax: Axes, labels: Labels, label: str) -> Axes:
    ax.set_xlabel(f"time  {labels.time}")
    ax.set_ylabel(label)
    ax.margins(x=0.01, y=0.08)
    return dress(ax)
