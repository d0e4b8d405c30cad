"""How the paper's figures look: journal type, three states told apart by colour, letter and marker."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from simulator.results.plot.curve import UNSTABLE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]
    Point = tuple[float, float]

# Of the paper's words: in Fig. 3c A is blue and B red. From Okabe & Ito's palette; in a copy without colour
# the letter and the marker of each inflated state tell them apart.
COLOURS = {"A": "#0072B2", "B": "#D55E00", "C": "#009E73"}
MARKERS = {"A": "o", "B": "s", "C": "^"}
INK = "#222222"
SNAP = "#555555"

ACTIVE = r"stretch of the active balloon  $\lambda_1$"
PASSIVE = r"stretch of the passive balloon  $\lambda_2$"
VOLTAGE = r"voltage  $(\Phi/H)\sqrt{\varepsilon/\mu}$"
PRESSURE = r"pressure  $PR_2/(\mu H)$"
INFLATION = r"inflation pressure  $P_0R_2/(\mu H)$"

SETTINGS: dict[str, Any] = {
    "font.family": "STIXGeneral",
    "mathtext.fontset": "stix",
    "font.size": 10.5,
    "axes.labelsize": 11.5,
    "axes.linewidth": 0.8,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "xtick.top": True,
    "ytick.right": True,
    "xtick.minor.visible": True,
    "ytick.minor.visible": True,
    "legend.frameon": False,
    "legend.fontsize": 9.5,
    "legend.handlelength": 2.2,
    "path.simplify": True,
    "svg.hashsalt": "dielectric-balloons",
    "svg.fonttype": "path",
}


def panel() -> tuple[Figure, Axes]:
    """A figure of the size of a journal's column and a half, with one panel."""
    figure = Figure(figsize=(4.8, 3.6), layout="constrained")
    return figure, figure.add_subplot()


def star(at: Point, ax: Axes, colour: str) -> Axes:
    """Mark an electromechanical instability."""
    ax.plot(*at, zorder=6, color=colour, **_STAR)
    return ax


def cross(at: Point, ax: Axes, colour: str) -> Axes:
    """Mark a loss of tension."""
    ax.plot(*at, zorder=6, color=colour, **_CROSS)
    return ax


def state(letter: str, at: Point, ax: Axes, offset: Point, align: str = "center") -> Axes:
    """Mark an inflated state and write its letter beside it, offset in points."""
    ax.plot(*at, zorder=6, **inflated(letter))
    ax.annotate(
        letter,
        at,
        xytext=offset,
        textcoords="offset points",
        color=COLOURS[letter],
        fontsize=12,
        fontweight="bold",
        ha=align,
        va="center",
    )
    return ax


def inflated(letter: str) -> dict[str, Any]:
    """The marker of an inflated state, as keywords of a line."""
    return {
        "marker": MARKERS[letter],
        "markersize": 6.0,
        "markerfacecolor": "white",
        "markeredgecolor": COLOURS[letter],
        "markeredgewidth": 1.4,
        "linestyle": "none",
        "clip_on": False,
    }


def snap_path(start: Point, end: Point, ax: Axes, colour: str = SNAP) -> Axes:
    """Draw a snap: dashed, with an arrow at its end."""
    ax.annotate(
        "",
        xy=end,
        xytext=start,
        arrowprops={
            "arrowstyle": "-|>,head_length=0.5,head_width=0.2",
            "linestyle": (0, (5, 3)),
            "linewidth": 1.1,
            "color": colour,
            "shrinkA": 5.0,
            "shrinkB": 3.0,
            "mutation_scale": 13.0,
        },
        zorder=4,
    )
    return ax


def thin(x: FloatArray, y: FloatArray, spans: Point, cells: float = 400.0) -> NDArray[np.int64]:
    """Indices of points enough to draw a line: each a cell of the panel away from the one before."""
    kept = [0]
    for i in range(1, x.size):
        if np.hypot((x[i] - x[kept[-1]]) / spans[0], (y[i] - y[kept[-1]]) / spans[1]) > 1.0 / cells:
            kept.append(i)
    return np.unique([*kept, x.size - 1])


def key(ax: Axes, *kinds: str, **where: Any) -> Axes:
    """A legend of what is drawn the same way for all states."""
    handles = {
        "stable": Line2D([], [], color=INK, linewidth=1.8, label="stable"),
        "unstable": Line2D([], [], color=INK, label="unstable", **UNSTABLE),
        "snap": Line2D([], [], color=SNAP, linewidth=1.1, linestyle=(0, (5, 3)), marker=">", markersize=4,
                       markevery=(1, 2), label="snap"),
        "star": Line2D([], [], color=INK, label="EMI", **_STAR),
        "cross": Line2D([], [], color=INK, label="loss of tension", **_CROSS),
    }  # fmt: skip
    ax.legend(handles=[handles[kind] for kind in kinds], **where)
    return ax


_STAR: dict[str, Any] = {
    "marker": "*",
    "markersize": 12.0,
    "markeredgecolor": "white",
    "markeredgewidth": 0.6,
    "linestyle": "none",
}
_CROSS: dict[str, Any] = {
    "marker": "x",
    "markersize": 7.5,
    "markeredgewidth": 1.9,
    "linestyle": "none",
    "clip_on": False,
}
