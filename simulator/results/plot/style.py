"""What all pictures share: colours, labels, marks, and how a figure becomes bytes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from io import BytesIO
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import matplotlib

from simulator.events import EventKind

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    Point = tuple[float, float]

_P = ParamSpec("_P")
_T = TypeVar("_T")

# Okabe & Ito's palette, which colour-blind readers can tell apart; one colour per balloon.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
BLACK = "#000000"
GREY = "#7F7F7F"

# Where no sphere follows, a line is as much thinner, and fainter.
THINNER = 0.6
FAINT = 0.5

VOLTAGE = "Φ√(ε/μ)/H"
PRESSURE = "PR/(μH)"
STRETCH = "λ = r/R"
FIELD = "|E|√(ε/μ)"
CHARGE = "q/(4πR²√(εμ))"

MARKERS: dict[str, str] = {
    EventKind.LIMIT_POINT: "*",
    EventKind.BRANCH_POINT: "P",
    EventKind.JUMP: "o",
    EventKind.LOSS_OF_TENSION: "X",
    EventKind.BREAKDOWN: "D",
    EventKind.RUNAWAY: "^",
    EventKind.OUT_OF_RANGE: "v",
    EventKind.LOSS_OF_SPHERICITY: "p",
    EventKind.SPHERICITY_REGAINED: "h",
    "reached": "s",
}
MARKER_SIZES: dict[str, float] = {
    EventKind.LIMIT_POINT: 12.0,
    EventKind.JUMP: 5.5,
    EventKind.BREAKDOWN: 6.5,
    "reached": 6.0,
}


# What distinguishes these pictures from matplotlib's own; whatever else a user has set does not reach them.
SETTINGS: Any = {"svg.hashsalt": "dielectric-balloons", "svg.fonttype": "path", "pdf.fonttype": 42}

# Of a file without the moment it was made, so that the same figure gives the same bytes.
_METADATA: dict[str, dict[str, Any]] = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}


@contextmanager
def own_style() -> Iterator[None]:
    """matplotlib as it comes, with `SETTINGS`, whatever its user has set; undone at the end."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(SETTINGS)
        yield


def in_own_style(draw: Callable[_P, _T]) -> Callable[_P, _T]:
    """A function that makes a whole figure, in our own style."""

    @wraps(draw)
    def styled(*args: _P.args, **keywords: _P.kwargs) -> _T:
        with own_style():
            return draw(*args, **keywords)

    return styled


def rendered(figure: Figure, form: str, dots_per_inch: float = 150.0) -> bytes:
    """A figure as the bytes of a file; the same figure gives the same bytes.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    form : {"png", "svg", "pdf"}
    dots_per_inch : float
    """
    stream = BytesIO()
    with own_style():
        figure.savefig(stream, format=form, dpi=dots_per_inch, metadata=_METADATA[form])
    return stream.getvalue()


def png(figure: Figure, dots_per_inch: float = 150.0) -> bytes:
    """A figure as the bytes of a PNG file, see `rendered`."""
    return rendered(figure, "png", dots_per_inch)


def mark(kind: str, x: float, y: float, ax: Axes) -> None:
    """Put the marker of an event or a special point at (x, y), in the numbers of the axes."""
    ax.plot([x], [y], zorder=5, **marker_style(kind))


def marker_style(kind: str) -> dict[str, Any]:
    """The marker of an event or a special point, as keywords of a line."""
    hollow = kind == EventKind.SPHERICITY_REGAINED
    return {
        "marker": MARKERS[kind],
        "markersize": MARKER_SIZES.get(kind, 8.0),
        "markerfacecolor": "white" if hollow else BLACK,
        "markeredgecolor": BLACK if hollow else "white",
        "markeredgewidth": 1.1 if hollow else 0.7,
        "linestyle": "none",
    }


def arrowhead(start: Point, end: Point, ax: Axes, colour: str) -> None:
    """Draw a head without a shaft at the end of a line from `start` to `end`, each an (x, y) of the axes."""
    ax.annotate(
        "",
        xy=end,
        xytext=start,
        arrowprops={
            "arrowstyle": "-|>,head_length=0.5,head_width=0.22",
            "color": colour,
            "linewidth": 0.0,
            "shrinkA": 0.0,
            "shrinkB": 0.0,
            "mutation_scale": 14.0,
        },
        zorder=3,
    )


def dress(ax: Axes) -> Axes:
    """Axes with a light grid and no box."""
    ax.spines[["top", "right"]].set_visible(False)
    ax.grid(color="#E5E5E5", linewidth=0.6)
    ax.set_axisbelow(True)
    return ax
