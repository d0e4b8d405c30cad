"""A sweep as a map: outcome or any other column over two of its keys, small multiples over a third."""

from __future__ import annotations

import re
from dataclasses import dataclass
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from simulator.results.plot.style import BLACK, COLOURS, PRESSURE, VOLTAGE, dress, in_own_style

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]
    Columns = Mapping[str, NDArray[Any]]

# What a history may amount to, with its colour and words, in the order of a legend.
BEHAVIOURS: dict[str, tuple[str, str]] = {
    "continuous": ("#56B4E9", "continuous actuation"),
    "snap": ("#0072B2", "stable snap"),
    "snap_returns": ("#009E73", "stable snap, goes back when off"),
    "snap_stays": ("#F0E442", "stable snap, stays when off"),
    "snap_then_loss_of_tension": ("#CC79A7", "stable snap, loss of tension later"),
    "snap_to_loss_of_tension": ("#D55E00", "snap that loses tension"),
    "loss_of_tension": ("#BDBDBD", "loss of tension without a snap"),
    "snap_then_breakdown": ("#8C6D31", "stable snap, breakdown later"),
    "snap_to_breakdown": ("#5E3C99", "snap that breaks the film"),
    "breakdown": ("#B2ABD2", "breakdown without a snap"),
    "snap_to_runaway": ("#7F0000", "snap without an end"),
    "snap_then_runaway": ("#B15928", "stable snap, runaway later"),
    "runaway": ("#FB9A99", "runaway"),
    "snap_to_out_of_range": ("#33A02C", "snap off the measured curve"),
    "snap_then_out_of_range": ("#B2DF8A", "stable snap, off the measured curve later"),
    "out_of_range": ("#CAB2D6", "off the measured curve without a snap"),
    "snap_to_loss_of_sphericity": ("#8C6BB1", "snap to no sphere"),
    "snap_then_loss_of_sphericity": ("#C7E9C0", "stable snap, sphere lost later"),
    "loss_of_sphericity": ("#8C510A", "sphere lost without a snap"),
    "refused": ("#F0F0F0", "makes no sense"),
    "failed": (BLACK, "solver failed"),
}
_NOTHING = "#FFFFFF"


@dataclass(frozen=True)
class MapCurve:
    """A line over a map, such as a limit point followed by `balloons fold`.

    Attributes
    ----------
    x, y : (n,) arrays
        In the units of the map's axes.
    label : str
        Its words in the legend.
    panel : float or str, optional
        The value of the third key whose panel it belongs to; None for all.
    """

    x: FloatArray
    y: FloatArray
    label: str
    panel: float | str | None = None


@dataclass(frozen=True)
class MapMark:
    """A point on a map with a letter beside it; `panel` as for a `MapCurve`."""

    x: float
    y: float
    label: str
    panel: float | str | None = None


@in_own_style
def plot_map(
    columns: Columns,
    x: str,
    y: str,
    color: str,
    *,
    panels: str | None = None,
    curves: Sequence[MapCurve] = (),
    marks: Sequence[MapMark] = (),
    log: frozenset[str] = frozenset(),
    title: str = "",
    units: Mapping[str, str] | None = None,
) -> Figure:
    """Draw one column of a sweep over two others.

    A full grid is drawn as cells, anything else as dots. A text column becomes categories with a legend,
    a number a colour scale; cells without a number stay blank, which the legend says.

    Parameters
    ----------
    columns : mapping of str to (n,) array
        The rows to draw.
    x, y, color : str
        Names of columns.
    panels : str, optional
        Column with one panel for each value.
    curves : sequence of MapCurve
    marks : sequence of MapMark
    log : set of str
        Columns with a logarithmic axis.
    title : str
    units : mapping of str to str, optional
        Of the columns that have one.

    Returns
    -------
    matplotlib.figure.Figure
        Not registered with pyplot: save it with ``figure.savefig(path)``.
    """
    units = units or {}
    shown: list[Any] = [None] if panels is None else list(dict.fromkeys(columns[panels].tolist()))
    across = min(len(shown), 3)
    down = -(-len(shown) // across)
    figure = Figure(figsize=(1.6 + 4.2 * across, 1.5 + 3.7 * down), layout="constrained")
    axes = figure.subplots(down, across, sharex=True, sharey=True, squeeze=False).ravel()
    painter = _Painter.of(columns[color])
    drawn: Any = None
    for ax, value in zip(axes, shown, strict=False):
        chosen = np.ones(columns[x].size, dtype=bool) if panels is None else columns[panels] == value
        drawn = _draw_panel(
            ax, columns[x][chosen], columns[y][chosen], painter, columns[color][chosen], x in log, y in log
        )
        for curve in (curve for curve in curves if curve.panel in (None, value)):
            ax.plot(curve.x, curve.y, color=BLACK, linewidth=1.5, linestyle=_line(curve.label, curves))
        for mark in (mark for mark in marks if mark.panel in (None, value)):
            ax.plot(mark.x, mark.y, "o", color=BLACK, markeredgecolor="white", markersize=5.5)
            ax.annotate(mark.label, (mark.x, mark.y), (5, 4), textcoords="offset points", parse_math=False)
        if panels is not None:
            ax.set_title(_value(panels, value, units), fontsize=11)
    for ax in axes[len(shown) :]:
        ax.set_visible(False)
    # Curves may run on beyond the map. Axes are shared: one is all.
    axes[0].set_xlim(*_ends(columns[x], x in log))
    axes[0].set_ylim(*_ends(columns[y], y in log))
    for ax in axes[-across:]:
        ax.set_xlabel(words(x, units))
    for ax in axes[::across]:
        ax.set_ylabel(words(y, units))
    handles = painter.legend(curves)
    if painter.categories is None and not np.isfinite(columns[color].astype(float)).all():
        blank = Patch(facecolor=_NOTHING, edgecolor="#7F7F7F", linewidth=0.5)
        blank.set_label(f"blank: the run has no {color.replace('_', ' ')}")
        handles.append(blank)
    if handles:
        columns_of_words = max(1, int(figure.get_figwidth() / 2.8))
        figure.legend(
            handles=handles,
            loc="outside lower center",
            ncols=min(columns_of_words, len(handles)),
            frameon=False,
            fontsize=9,
        )
    if painter.categories is None:
        figure.colorbar(drawn, ax=list(axes[: len(shown)]), label=words(color, units))
    # Titles are the user's words: a dollar sign in them is money, not mathematics.
    figure.suptitle(_filled(title, figure), parse_math=False, fontsize=12, fontweight="bold")
    return figure


_LINES: tuple[Any, ...] = ("-", (0, (5, 2)), (0, (1, 1.5)), (0, (5, 2, 1, 2)))


def _line(label: str, curves: Sequence[MapCurve]) -> Any:
    """The dashes of a curve: the same for all of one label."""
    labels = list(dict.fromkeys(curve.label for curve in curves))
    return _LINES[labels.index(label) % len(_LINES)]


@dataclass(frozen=True)
class _Painter:
    """How values become colours: `categories` with theirs, or where that is None a scale."""

    categories: dict[str, tuple[str, str]] | None
    low: float
    high: float

    @classmethod
    def of(cls, values: NDArray[Any]) -> _Painter:
        if values.dtype.kind in "fiu":
            finite = values[np.isfinite(values)] if values.dtype.kind == "f" else values
            return cls(None, float(finite.min(initial=np.inf)), float(finite.max(initial=-np.inf)))
        there = {str(value) for value in values.tolist()}
        known = {name: BEHAVIOURS[name] for name in BEHAVIOURS if name in there}
        others = sorted(there - set(known) - {""})
        palette = [colour for colour in COLOURS if colour not in {c for c, _ in known.values()}] or list(
            COLOURS
        )
        known |= {n: (palette[i % len(palette)], n.replace("_", " ")) for i, n in enumerate(others)}
        return cls(known, 0.0, len(known) + 1.0)

    def numbers(self, values: NDArray[Any]) -> FloatArray:
        """Values as numbers on the scale of the colours."""
        if self.categories is None:
            return np.asarray(values, dtype=np.float64)
        place = {name: i + 0.5 for i, name in enumerate(self.categories)}
        return np.array([place.get(str(value), np.nan) for value in values.tolist()])

    @property
    def style(self) -> dict[str, Any]:
        if self.categories is None:
            return {"cmap": "viridis", "vmin": self.low, "vmax": self.high}
        colours = [colour for colour, _ in self.categories.values()]
        return {"cmap": ListedColormap([*colours, _NOTHING]), "vmin": 0.0, "vmax": self.high}

    def legend(self, curves: Sequence[MapCurve]) -> list[Artist]:
        handles: list[Artist] = [
            Patch(facecolor=colour, edgecolor="#7F7F7F", linewidth=0.5, label=words)
            for colour, words in (self.categories or {}).values()
        ]
        for label in dict.fromkeys(curve.label for curve in curves):
            style = _line(label, curves)
            handles.append(Line2D([], [], color=BLACK, linewidth=1.5, linestyle=style, label=label))
        return handles


def _draw_panel(
    ax: Axes,
    x: NDArray[Any],
    y: NDArray[Any],
    painter: _Painter,
    values: NDArray[Any],
    log_x: bool,
    log_y: bool,
) -> Any:
    """Cells where there is one value for each pair of x and y, else dots."""
    numbers = painter.numbers(values)
    across, column = np.unique(x, return_inverse=True)
    up, row = np.unique(y, return_inverse=True)
    if across.size * up.size == x.size and across.size > 1 and up.size > 1:
        cells = np.full((up.size, across.size), np.nan)
        cells[row, column] = numbers
        drawn: Any = ax.pcolormesh(
            _edges(across, log_x), _edges(up, log_y), cells, rasterized=True, **painter.style
        )
    else:
        drawn = ax.scatter(x, y, c=numbers, s=14, linewidths=0.0, **painter.style)
    for wanted, axis, scale in ((log_x, ax.xaxis, ax.set_xscale), (log_y, ax.yaxis, ax.set_yscale)):
        if wanted:
            scale("log")
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            axis.set_minor_formatter(NullFormatter())
    return drawn


def _filled(title: str, figure: Figure) -> str:
    """A title with its lines filled, each by itself, so that none is longer than its figure is wide."""
    letters = int(9.7 * figure.get_figwidth())  # of the bold type of titles
    return "\n".join(fill(line, letters) for line in title.splitlines())


def _ends(values: FloatArray, log: bool) -> FloatArray:
    """Where an axis begins and ends: with the cells of these values."""
    return _edges(np.unique(values), log)[[0, -1]]


def _edges(centres: FloatArray, log: bool) -> FloatArray:
    """Borders of cells about their centres, half-way between these."""
    at = np.log(centres) if log else centres
    if at.size == 1:
        edges = np.array([at[0] - 0.5, at[0] + 0.5])
    else:
        middle = 0.5 * (at[1:] + at[:-1])
        edges = np.array([2 * at[0] - middle[0], *middle, 2 * at[-1] - middle[-1]])
    return np.exp(edges) if log else edges


def subject(color: str, x: str, y: str | None, panels: str | None) -> str:
    """What a map shows, in words: "behaviour over inflation pressure and radius of passive"."""
    over = _plain(x) if y is None else f"{_plain(x)} and {_plain(y)}"
    each = "" if panels is None else f", a {'line' if y is None else 'panel'} for each {_plain(panels)}"
    return f"{_plain(color)} over {over}{each}"


def words(key: str, units: Mapping[str, str]) -> str:
    """A column in words, with its unit, or where it has none with what it is a multiple of."""
    unit = f" [{units[key]}]" if key in units else ""
    symbols = {"ambient pressure": PRESSURE, "inflation pressure": PRESSURE, "voltage": VOLTAGE}
    plain = _plain(key)
    return f"{plain} {unit or f' {symbols[plain]}'}" if plain in symbols else plain + unit


def _value(key: str, value: Any, units: Mapping[str, str]) -> str:
    """One value of a key, in words: "radius of active = 19 mm"."""
    number = f"{value:g}" if isinstance(value, float) else f"{value}"
    return f"{_plain(key)} = {number} {units.get(key, '')}".rstrip()


def _plain(key: str) -> str:
    found = re.fullmatch(r"balloon\.(.+)\.(radius|thickness|modulus|permittivity)", key)
    if found:
        return f"{found[2]} of {'all' if found[1] == '*' else found[1]}"
    if key == "gas.ambient_pressure":
        return "ambient pressure"
    step = re.fullmatch(r"step\.\d+\.(inflate|ramp|jump)", key)
    if step:
        return "inflation pressure" if step[1] == "inflate" else "voltage"
    return key.replace("_", " ")


@in_own_style
def plot_lines(
    columns: Columns,
    x: str,
    shown: str,
    *,
    lines: str | None = None,
    log: frozenset[str] = frozenset(),
    title: str = "",
    units: Mapping[str, str] | None = None,
) -> Figure:
    """Draw one column of a sweep over one other: numbers as lines, words as dots in a row of their own.

    Parameters
    ----------
    columns : mapping of str to (n,) array
        The rows to draw.
    x, shown : str
        Names of columns.
    lines : str, optional
        Column with a line for each value.
    log, title, units
        As for `plot_map`.

    Returns
    -------
    matplotlib.figure.Figure
        Not registered with pyplot: save it with ``figure.savefig(path)``.
    """
    units = units or {}
    figure = Figure(figsize=(6.8, 4.6), layout="constrained")
    ax = dress(figure.add_subplot())
    values = columns[shown]
    heights = np.asarray(values, dtype=np.float64) if values.dtype.kind in "fiub" else None
    if heights is None:
        known = [word for word in BEHAVIOURS if word in values]
        rows = [*known, *sorted({str(value) for value in values.tolist()} - {*known, ""})]
        heights = np.array([rows.index(str(v)) if str(v) in rows else np.nan for v in values.tolist()])
        ax.set_yticks(range(len(rows)), [BEHAVIOURS[w][1] if w in BEHAVIOURS else w for w in rows])
        ax.set_ylim(-0.5, len(rows) - 0.5)
    else:
        ax.set_ylabel(words(shown, units))
    each: list[Any] = [None] if lines is None else list(dict.fromkeys(columns[lines].tolist()))
    for i, value in enumerate(each):
        mine = np.ones(heights.size, dtype=bool) if lines is None else columns[lines] == value
        order = np.flatnonzero(mine)[np.argsort(columns[x][mine], kind="stable")]
        style = "o-" if values.dtype.kind in "fiub" else "o"
        label = None if lines is None else _value(lines, value, units)
        colour = COLOURS[i % len(COLOURS)]
        # Dots of several lines in one row stand above one another.
        aside = 0.0 if style == "o-" else 0.12 * (i - 0.5 * (len(each) - 1))
        ax.plot(columns[x][order], heights[order] + aside, style, color=colour, markersize=3.5, label=label)
    if x in log:
        ax.set_xscale("log")
        ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.set_xlabel(words(x, units))
    if lines is not None:
        figure.legend(loc="outside lower center", ncols=min(len(each), 4), frameon=False, fontsize=9)
    figure.suptitle(_filled(title, figure), parse_math=False, fontsize=12, fontweight="bold")
    return figure
