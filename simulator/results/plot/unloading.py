"""Unloading as a picture: the family of curves over the whole path, and what remains over the peak."""

from __future__ import annotations

from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from simulator.results.plot.style import COLOURS, GREY, STRETCH, VOLTAGE, dress, in_own_style
from simulator.units import ENERGY as ENERGIES
from simulator.units import VOLTAGE as VOLTAGES
from simulator.units import prefixed

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from simulator.results.unloading import FloatArray, Unloading, UnloadingMap
    from simulator.units import Dimension, Scales

_LEGS = {"load": COLOURS[1], "unload": COLOURS[0], "reload": COLOURS[2]}
_WORDS = {"load": "up to the peak", "unload": "back to zero", "reload": "up again"}


@in_own_style
def plot_unloading(found: Unloading) -> Figure:
    """Draw the family of curves, and beside it what remains, and the area of each loop, over the peak.

    Returns
    -------
    matplotlib.figure.Figure
        Not registered with pyplot: save it with ``figure.savefig(path)``.
    """
    figure = Figure(figsize=(12.0, 5.4), layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=(1.15, 1.0))
    draw_family(found, figure.add_subplot(grid[:, 0]))
    above = _draw_remanence(found, figure.add_subplot(grid[0, 1]))
    _draw_area(found, figure.add_subplot(grid[1, 1], sharex=above))
    figure.suptitle(fill(found.title, 100), parse_math=False, fontsize=12, fontweight="bold")
    figure.legend(handles=_legend(found), loc="outside lower center", ncols=6, frameon=False)
    return figure


def draw_family(found: Unloading, ax: Axes) -> Axes:
    """Draw the stretch of the electroded balloon that moves most over the voltage, for all peaks.

    Parameters
    ----------
    found : Unloading
    ax : matplotlib.axes.Axes

    Returns
    -------
    matplotlib.axes.Axes
        The same axes.
    """
    volts, label = _axis(found.scales, VOLTAGES, float(found.peaks.max()), "Φ", VOLTAGE)
    balloon = _most_moving(found.balloons, found.electroded, found.stretch)
    top = 1.06 * volts * float(found.peaks.max())
    if found.path.drive.size:
        # Up to where the picture ends, and no farther: the path may run off along its stretch limit.
        shown = volts * found.path.drive <= top
        y = np.where(shown, found.path.stretch[:, balloon], np.nan)
        for unstable, style in ((False, "-"), (True, (0, (4, 2)))):
            part = np.where((found.path.unstable > 0) == unstable, y, np.nan)
            ax.plot(volts * found.path.drive, part, color=GREY, linewidth=1.0, linestyle=style, zorder=1)
    for leg, colour in _LEGS.items():
        x, y = _lines(found, leg, balloon)
        ax.plot(volts * x, y, color=colour, linewidth=1.6, alpha=0.8, zorder=2)
    x, y = _jumps(found, balloon)
    ax.plot(volts * x, y, color=GREY, linewidth=1.0, linestyle=":", zorder=1)
    ends = found.leg == "load"
    at = np.flatnonzero(ends & (found.drive == found.peak) & (found.event == ""))
    ax.plot(volts * found.drive[at], found.stretch[at, balloon], ".", color=_LEGS["load"], markersize=4)
    ax.set_xlim(-0.02 * top, top)
    leader = found.electroded[int(np.argmax(found.share == 1.0))]
    whose = "" if set(found.share.tolist()) == {1.0} and len(found.share) > 1 else f" on {leader}"
    ax.set_xlabel(f"voltage{whose}  {label}", parse_math=False)
    ax.set_ylabel(f"stretch of {found.balloons[balloon]}  {STRETCH}")
    return dress(ax)


@in_own_style
def plot_map(found: UnloadingMap) -> Figure:
    """Draw what remains of the electroded balloon that changes most, over peak and value."""
    figure = Figure(figsize=(6.8, 5.0), layout="constrained")
    ax = figure.add_subplot()
    volts, label = _axis(found.scales, VOLTAGES, float(found.peaks.max()), "Φ", VOLTAGE)
    factor, unit = 1.0, found.key
    if found.scales is not None and found.dimension is not None:
        scale = found.scales.of(found.dimension)
        size, symbol = prefixed(found.dimension, float(np.abs(found.values).max()) * scale)
        factor, unit = scale / size, f"{found.key} [{symbol}]"
    remains = found.remanent_stretch.reshape(-1, len(found.balloons))
    balloon = _most_moving(found.balloons, found.electroded, remains)
    peaks, values = np.argsort(found.peaks), np.argsort(found.values)
    shown = found.remanent_stretch[np.ix_(values, peaks)][:, :, balloon]
    mesh = ax.pcolormesh(
        volts * _edges(found.peaks[peaks]),
        factor * _edges(found.values[values]),
        np.ma.masked_invalid(shown),
        cmap="viridis",
        rasterized=True,
    )
    ax.set_facecolor("#D9D9D9")
    figure.colorbar(mesh, ax=ax, label=f"stretch of {found.balloons[balloon]} that remains  {STRETCH}")
    ax.set_xlabel(f"peak of the voltage  {label}")
    ax.set_ylabel(unit, parse_math=False)
    ax.set_title(fill(found.title, 60), parse_math=False, fontsize=12, fontweight="bold")
    if np.isnan(shown).any():
        handle = Line2D([], [], color="#D9D9D9", linewidth=8, label="the device ends, or no such device")
        figure.legend(handles=[handle], loc="outside lower center", frameon=False)
    return figure


def _most_moving(balloons: tuple[str, ...], electroded: tuple[str, ...], stretch: FloatArray) -> int:
    """The place of the electroded balloon whose stretch (n, n_balloons) changes most."""
    places = [balloons.index(name) for name in electroded]
    known = stretch[np.isfinite(stretch).all(axis=1)]
    return max(places, key=lambda i: float(np.ptp(known[:, i])) if len(known) else 0.0)


def _edges(values: FloatArray) -> FloatArray:
    """The borders of cells about sorted values."""
    if values.size == 1:
        half = 0.5 * abs(float(values[0])) or 0.5
        return np.array([values[0] - half, values[0] + half])
    middle = 0.5 * (values[1:] + values[:-1])
    first, last = 2.0 * values[0] - middle[0], 2.0 * values[-1] - middle[-1]
    return np.concatenate([[first], middle, [last]])


def _lines(found: Unloading, leg: str, balloon: int) -> tuple[FloatArray, FloatArray]:
    """All stays of one leg as one line, broken after each event and between peaks."""
    rows = np.flatnonzero(found.leg == leg)
    if not rows.size:
        return np.empty(0), np.empty(0)
    breaks = np.flatnonzero((found.event[rows[:-1]] != "") | (np.diff(found.peak[rows]) != 0.0)) + 1
    x, y = found.drive[rows], found.stretch[rows, balloon]
    return np.insert(x, breaks, np.nan), np.insert(y, breaks, np.nan)


def _jumps(found: Unloading, balloon: int) -> tuple[FloatArray, FloatArray]:
    """Both sides of all events that lead somewhere, each pair followed by a gap."""
    rows = np.flatnonzero(found.event[:-1] != "")
    goes_on = (found.leg[rows] == found.leg[rows + 1]) & (found.peak[rows] == found.peak[rows + 1])
    rows = rows[goes_on]
    gap = np.full(rows.size, np.nan)
    x = np.column_stack([found.drive[rows], found.drive[rows + 1], gap]).ravel()
    y = np.column_stack([found.stretch[rows, balloon], found.stretch[rows + 1, balloon], gap]).ravel()
    return x, y


def _draw_remanence(found: Unloading, ax: Axes) -> Axes:
    volts, _ = _axis(found.scales, VOLTAGES, float(found.peaks.max()), "Φ", VOLTAGE)
    _mark_thresholds(found, ax, volts)
    for i, name in enumerate(found.balloons):
        colour = COLOURS[i % len(COLOURS)]
        x, y = _stepped(found, found.remanent_stretch[:, i])
        ax.plot(volts * x, y, color=colour, marker=".", markersize=3.5, linewidth=1.2, label=name)
    ax.set_ylabel(f"remanent stretch  {STRETCH}")
    ax.legend(frameon=False, fontsize=8, ncols=min(len(found.balloons), 3))
    return dress(ax)


def _draw_area(found: Unloading, ax: Axes) -> Axes:
    volts, label = _axis(found.scales, VOLTAGES, float(found.peaks.max()), "Φ", VOLTAGE)
    largest = float(np.nanmax(np.abs(found.area), initial=0.0)) if np.isfinite(found.area).any() else 0.0
    joules, unit = _axis(found.scales, ENERGIES, largest, "∮φ dq", "∮φ dq/(4πR²Hμ)")
    _mark_thresholds(found, ax, volts)
    x, y = _stepped(found, found.area)
    ax.plot(volts * x, joules * y, color=GREY, linewidth=1.2, marker=".", markersize=3.5)
    is_open = ~found.closed & np.isfinite(found.area)
    ax.plot(
        volts * found.peaks[is_open],
        joules * found.area[is_open],
        linestyle="none",
        marker="o",
        markersize=4.5,
        markerfacecolor="white",
        markeredgecolor=GREY,
        zorder=3,
    )
    ax.set_ylabel(f"loop area  {unit}")
    ax.set_xlabel(f"peak of the voltage  {label}")
    return dress(ax)


def _stepped(found: Unloading, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Values over the peaks, in order, broken where a threshold of the way up lies between two peaks."""
    order = np.argsort(found.peaks, kind="stable")
    peaks, values = found.peaks[order], values[order]
    up = [v for v, leg in found.thresholds if leg == "load"]
    breaks = np.unique(np.searchsorted(peaks, up))
    breaks = breaks[(breaks > 0) & (breaks < peaks.size)]
    return np.insert(peaks, breaks, np.nan), np.insert(values, breaks, np.nan)


def _mark_thresholds(found: Unloading, ax: Axes, volts: float) -> None:
    for v, leg in found.thresholds:
        if leg != "reload":
            ax.axvline(volts * v, color=_LEGS[leg], linewidth=0.9, linestyle="--", zorder=0)


def _axis(
    scales: Scales | None, dimension: Dimension, largest: float, symbol: str, plain: str
) -> tuple[float, str]:
    """What dimensionless values are to be multiplied by, and the label of their axis."""
    if scales is None:
        return 1.0, plain
    scale = scales.of(dimension)
    size, unit = prefixed(dimension, largest * scale)
    return scale / size, f"{symbol} [{unit}]"


def _legend(found: Unloading) -> list[Line2D]:
    handles = [
        Line2D([], [], color=colour, linewidth=1.6, label=_WORDS[leg])
        for leg, colour in _LEGS.items()
        if (found.leg == leg).any()
    ]
    if (found.path.unstable > 0).any():
        handles.append(Line2D([], [], color=GREY, linestyle=(0, (4, 2)), linewidth=1.0, label="unstable"))
    if found.thresholds:
        handles.append(Line2D([], [], color=GREY, linestyle="--", linewidth=0.9, label="threshold"))
    if (~found.closed & np.isfinite(found.area)).any():
        handles.append(
            Line2D([], [], color=GREY, marker="o", markerfacecolor="white", label="the loop is not closed")
        )
    return handles
