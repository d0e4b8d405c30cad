"""The work–precision figure: errors of limit point and landing over run time, one marker for each method."""

from __future__ import annotations

import math
from collections.abc import Sequence
from io import BytesIO
from typing import TYPE_CHECKING, Any, cast

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from tests.studies.accuracy.study import DEFAULT, SCIPY_DAE, SIMULATOR, UNPOLISHED, Row

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Okabe & Ito's palette. Marker and line tell the methods apart without colour.
_STYLES: dict[str, dict[str, Any]] = {
    SIMULATOR: {"color": "#0072B2", "marker": "o", "markersize": 6.5, "linewidth": 1.8, "zorder": 5},
    UNPOLISHED: {
        "color": "#56B4E9",
        "marker": "s",
        "markersize": 5.0,
        "linestyle": "--",
        "markerfacecolor": "w",
    },
    SCIPY_DAE: {
        "color": "#009E73",
        "marker": "D",
        "markersize": 4.5,
        "linestyle": "-.",
        "markerfacecolor": "w",
    },
    "LSODA": {"color": "#D55E00", "marker": "^", "markersize": 5.5},
    "BDF": {"color": "#E69F00", "marker": "v", "markersize": 5.5},
    "Radau": {"color": "#CC79A7", "marker": ">", "markersize": 5.5},
}
_RING: dict[str, Any] = {
    "color": "#000000",
    "marker": "o",
    "markersize": 13.0,
    "markerfacecolor": "none",
    "linestyle": "none",
    "zorder": 6,
}
_NAMES = {name: f"viscous, SciPy's {name}" for name in ("LSODA", "BDF", "Radau")}
_FLOOR = 1e-16  # an error below this is drawn at it: the axis has no zero
_PANELS = (
    ("limit_voltage_error", "relative error of the limit-point voltage"),
    ("landing_error", "error of the state that the snap lands in"),
)
_SETTINGS: dict[str, Any] = {
    "font.size": 9.5,
    "axes.labelsize": 10.0,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "svg.hashsalt": "dielectric-balloons",
    "svg.fonttype": "path",
}


def draw(rows: Sequence[Row], scenario: str, title: str) -> Figure:
    """Errors over run time of one scenario.

    Parameters
    ----------
    rows : sequence of Row
    scenario : str
        Which of the rows' scenarios.
    title : str

    Returns
    -------
    matplotlib.figure.Figure
    """
    chosen = [row for row in rows if row.scenario == scenario]
    figure = Figure(figsize=(9.6, 4.9), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True, sharex=True)
    for ax, (column, label) in zip(axes, _PANELS, strict=True):
        plot_errors(chosen, column, ax)
        ax.set_title(label, fontsize=10.0)
        ax.set_xlabel("processor time, one whole history  (ms)")
    axes[0].set_ylabel("error")
    handles, labels = axes[0].get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    figure.legend(unique.values(), unique.keys(), loc="outside lower center", ncols=3, frameon=False)
    figure.suptitle(title, fontsize=11.5, fontweight="bold", parse_math=False)
    return figure


def plot_errors(rows: Sequence[Row], column: str, ax: Axes) -> Axes:
    """Draw one kind of error over run time, a line through the tolerances of each method and delay.

    Parameters
    ----------
    rows : sequence of Row
        Of one scenario.
    column : str
        Which error, a name of `Row`'s.
    ax : matplotlib.axes.Axes

    Returns
    -------
    matplotlib.axes.Axes
        The same axes.
    """
    ax.set_xscale("log")
    ax.set_yscale("log")
    lines: dict[tuple[str, float], list[Row]] = {}
    for row in rows:
        lines.setdefault((row.method, 0.0 if math.isnan(row.delay) else row.delay), []).append(row)
    for (method, _), runs in lines.items():
        # A run that went wrong is not a number, and breaks its line.
        heights = np.maximum([float(getattr(run, column)) for run in runs], _FLOOR).tolist()
        name = _NAMES.get(method, method)
        ax.plot(
            [run.milliseconds for run in runs], heights, label=name, **({"linewidth": 1.1} | _STYLES[method])
        )
        for run, height in zip(runs, heights, strict=True):
            if method == SIMULATOR and run.rtol == DEFAULT:
                label = rf"its default, rtol = $10^{{{round(math.log10(DEFAULT))}}}$"
                ax.plot(run.milliseconds, height, label=label, **_RING)
    _tell_delays(rows, column, ax)
    ax.set_ylim(0.4 * _FLOOR, 0.5)
    ax.yaxis.set_minor_locator(NullLocator())
    ax.grid(which="major", color="#DDDDDD", linewidth=0.6)
    ax.set_axisbelow(True)
    return ax


def _tell_delays(rows: Sequence[Row], column: str, ax: Axes) -> None:
    """Write the relaxation time beside the slowest run of each band of viscous runs."""
    below = math.inf  # the height, in decades, of the label above
    for delay in sorted({row.delay for row in rows if not math.isnan(row.delay)}, reverse=True):
        band = [row for row in rows if row.delay == delay and not math.isnan(getattr(row, column))]
        if band:
            last = max(band, key=lambda row: row.milliseconds)
            height = math.log10(getattr(last, column))
            below = min(height, below - 0.75)
            ax.annotate(
                rf"$\delta = 10^{{{round(math.log10(delay))}}}$",
                (last.milliseconds, 10.0**below),
                xytext=(7, 0),
                textcoords="offset points",
                va="center",
            )
    times = [row.milliseconds for row in rows if not row.failure]
    if times:  # with room for the words
        ax.set_xlim(0.6 * min(times), 3.0 * max(times))


def files(figure: Figure, name: str) -> dict[str, bytes]:
    """A figure as SVG and PNG, by file name."""
    found = {}
    kinds: dict[str, dict[str, None]] = {"svg": {"Date": None, "Creator": None}, "png": {"Software": None}}
    for kind, metadata in kinds.items():
        stream = BytesIO()
        figure.savefig(stream, format=kind, dpi=110, metadata=metadata)
        found[f"{name}.{kind}"] = stream.getvalue()
    return found


def picture(rows: Sequence[Row], scenario: str, title: str, name: str) -> dict[str, bytes]:
    """`draw`, as files."""
    with mpl.rc_context(cast("Any", _SETTINGS)):
        return files(draw(rows, scenario, title), name)
