"""Equilibrium paths as a picture: stretch over voltage, or over pressure for an inflation.

Stable states are solid, unstable ones dashed and thinner.
"""

from __future__ import annotations

from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from simulator.results.curve import farthest_shown
from simulator.results.plot.axes import add_stretch_axis, shown_curves, shown_fold
from simulator.results.plot.style import (
    COLOURS,
    FAINT,
    GREY,
    THINNER,
    dress,
    in_own_style,
    mark,
    marker_style,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from simulator.results.curve import Curve, FloatArray, FoldCurve

STABLE: dict[str, Any] = {"linewidth": 1.8, "solid_capstyle": "round"}
UNSTABLE: dict[str, Any] = {"linewidth": 1.0, "linestyle": (0, (4, 2))}
# Stable but for its shape.
NO_SPHERE: dict[str, Any] = {"linewidth": 1.8 * THINNER, "alpha": FAINT}

_MARKED = (
    "limit_point",
    "branch_point",
    "loss_of_tension",
    "out_of_range",
    "loss_of_sphericity",
    "sphericity_regained",
    "reached",
)


@in_own_style
def plot_curves(curves: Sequence[Curve]) -> Figure:
    """Draw equilibrium paths of one scenario, one colour each, with a legend.

    Parameters
    ----------
    curves : sequence of Curve
        Of the same balloons.

    Returns
    -------
    matplotlib.figure.Figure
        Not registered with pyplot: save it with ``figure.savefig(path)``.
    """
    figure = Figure(figsize=(7.2, 5.2), layout="constrained")
    ax = plot_paths(curves, figure.add_subplot())
    # Titles are the user's words: a dollar sign in them is money, not mathematics.
    title = f"{fill(curves[0].title, 70)}\n{_subject(curves)}"
    ax.set_title(title, parse_math=False, fontsize=12, fontweight="bold")
    figure.legend(handles=_legend(curves), loc="outside lower center", ncols=3, frameon=False)
    return figure


@in_own_style
def plot_fold(curve: FoldCurve) -> Figure:
    """Draw a limit point's voltage (of an inflation: its pressure) over the number that changes."""
    figure = Figure(figsize=(6.4, 4.6), layout="constrained")
    ax = dress(figure.add_subplot())
    curve, labels, parameter = shown_fold(curve)
    inflation = not curve.voltage.any()
    drive = curve.pressure if inflation else curve.voltage
    ax.plot(curve.value, drive, color=COLOURS[0], **STABLE)
    ax.plot(curve.value[-1:], drive[-1:], "o", color=COLOURS[0])
    right = curve.value[-1] > curve.value[0]
    ax.annotate(
        curve.end.replace("_", " "),
        (curve.value[-1], drive[-1]),
        (-8 if right else 8, 10),
        textcoords="offset points",
        ha="right" if right else "left",
    )
    ax.margins(0.08, 0.14)
    ax.set_xlabel(parameter, parse_math=False)
    what = "limit point" if curve.balloon is None else f"{curve.of.replace('_', ' ')} of {curve.balloon}"
    drive_shown = f"pressure of the {what}  {labels.pressure}"
    ax.set_ylabel(drive_shown if inflation else f"voltage of the {what}  {labels.voltage}", parse_math=False)
    # What is seen, under the name of the device: the page may be read without its axes.
    subject = f"{what} over {curve.parameter}"
    ax.set_title(f"{fill(curve.title, 60)}\n{subject}", parse_math=False, fontsize=12, fontweight="bold")
    return figure


def plot_paths(curves: Sequence[Curve], ax: Axes) -> Axes:
    """Draw stretch over voltage of the first electroded balloon (of an inflation: over pressure).

    With [scales] it is the radius, with the stretch at the right.

    Parts that run off along the stretch limit, to enormous voltages, are cut off.

    Parameters
    ----------
    curves : sequence of Curve
        Of the same balloons.
    ax : matplotlib.axes.Axes

    Returns
    -------
    matplotlib.axes.Axes
        The same axes.
    """
    curves, labels = shown_curves(curves, max(_farthest(curve) for curve in curves))
    farthest = max(_farthest(curve) for curve in curves)
    for i, curve in enumerate(curves):
        x, y = _shown(curve)
        seen = int(np.append(np.flatnonzero(x > 1.05 * farthest), x.size - 1)[0]) + 1
        lost = curve.lost[:seen] if curve.lost.size else None
        draw_path(x[:seen], y[:seen], curve.unstable[:seen], ax, COLOURS[i % len(COLOURS)], lost=lost)
    for curve in curves:
        balloon = _balloon(curve)
        for point in curve.points:
            at = float(point.voltage[0]) if curve.electroded else point.pressure
            is_other = point.balloon not in (None, curve.balloons[balloon])
            if point.kind in _MARKED and at <= farthest and not is_other:
                mark(point.kind, at, float(point.stretch[balloon]), ax)
    balloon = _balloon(curves[0])
    name = curves[0].balloons[balloon]
    electroded = curves[0].electroded
    ax.set_xlabel(f"voltage on {name}  {labels.voltage}" if electroded else f"pressure  {labels.pressure}")
    ax.set_ylabel(f"{labels.extent} of {name}  {labels.size}")
    if labels.unstretched:
        add_stretch_axis(ax, labels.unstretched[balloon])
    ax.margins(0.06)
    ax.set_xlim(right=1.05 * farthest)
    return dress(ax)


def draw_path(
    x: FloatArray,
    y: FloatArray,
    unstable: NDArray[np.int64],
    ax: Axes,
    colour: str,
    *,
    lost: NDArray[np.bool_] | None = None,
    **style: Any,
) -> list[Line2D]:
    """Draw one path, its stable parts solid and its unstable parts dashed and thinner.

    What would be stable, were its balloons spheres, is solid, thin and faint.

    Parameters
    ----------
    x, y : (n,) arrays
    unstable : (n,) array of int
        Number of unstable directions. A turning point belongs to the part before it.
    ax : matplotlib.axes.Axes
    colour : str
    lost : (n,) array of bool, optional
        Where some balloon is no sphere.
    **style
        Further keywords of the stable lines.

    Returns
    -------
    list of Line2D
        One for each part.
    """
    lines: list[Line2D] = []
    unshaped = np.zeros(x.size, dtype=bool) if lost is None else lost & (unstable == 0)
    starts = np.flatnonzero(np.diff(unstable > 0) | np.diff(unshaped)) + 1
    for start, end in zip([0, *starts], [*starts, x.size], strict=True):
        part = slice(max(start - 1, 0), end)
        dressed = (
            UNSTABLE if unstable[start] else {**STABLE, **style, **(NO_SPHERE if unshaped[start] else {})}
        )
        lines += ax.plot(x[part], y[part], color=colour, **dressed)
    return lines


def _balloon(curve: Curve) -> int:
    return curve.balloons.index(curve.electroded[0]) if curve.electroded else 0


def _shown(curve: Curve) -> tuple[FloatArray, FloatArray]:
    return curve.voltage[:, 0] if curve.electroded else curve.pressure, curve.stretch[:, _balloon(curve)]


def _farthest(curve: Curve) -> float:
    """The voltage or pressure up to which a path is worth showing."""
    x, y = _shown(curve)
    marked = [float(p.voltage[0]) if curve.electroded else p.pressure for p in curve.points[:-1]]
    return farthest_shown(x, y, marked, curve.end.kind)


def _subject(curves: Sequence[Curve]) -> str:
    """What is seen, in words."""
    curve = curves[0]
    name = curve.balloons[_balloon(curve)]
    what = "radius" if curve.scales else "stretch"
    if not curve.electroded:
        return f"inflation of {name}: {what} over pressure"
    count = "equilibria" if len(curves) == 1 else f"{len(curves)} paths of equilibria"
    common = "the voltage on all films" if len(curve.electroded) > 1 else "its voltage"
    return f"{count}: {what} of {name} over {common}"


def _legend(curves: Sequence[Curve]) -> list[Artist]:
    names = ["stable"] if len(curves) == 1 else [f"curve {i}, stable" for i in range(1, len(curves) + 1)]
    handles: list[Artist] = [
        Line2D([], [], color=COLOURS[i % len(COLOURS)], label=name, **STABLE) for i, name in enumerate(names)
    ]
    if any((curve.lost & (curve.unstable == 0)).any() for curve in curves if curve.lost.size):
        handles.append(Line2D([], [], color=GREY, label="stable for spheres only", **NO_SPHERE))
    if any((curve.unstable > 0).any() for curve in curves):
        handles.append(Line2D([], [], color=GREY, label="unstable", **UNSTABLE))
    kinds = dict.fromkeys(point.kind for curve in curves for point in curve.points if point.kind in _MARKED)
    kinds = {kind: None for kind in _MARKED if kind in kinds}
    words = {kind: kind.replace("_", " ") for kind in kinds} | {"reached": "where it was to stop"}
    handles += [Line2D([], [], label=words[kind], **marker_style(kind)) for kind in kinds]
    return handles
