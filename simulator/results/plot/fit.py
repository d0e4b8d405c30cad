"""A fit as a picture: data over the model with its band, residuals below."""

from __future__ import annotations

from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from simulator.results.plot.style import BLACK, COLOURS, GREY, dress, in_own_style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from simulator.results.fit import Fit, FittedColumn

_MOST_COLUMNS = 4  # of panels beside each other
_ERROR_BARS = 80  # values from which on these would be a wall


@in_own_style
def plot_fit(fit: Fit) -> Figure:
    """Draw the data of a fit over the model with its confidence band, and the residuals below.

    Returns
    -------
    matplotlib.figure.Figure
        Not registered with pyplot: save it with ``figure.savefig(path)``.
    """
    curves = [column for column in fit.columns if not column.is_event]
    events = [column for column in fit.columns if column.is_event]
    count = len(curves) + bool(events)
    across = min(count, _MOST_COLUMNS)
    down = -(-count // across)
    figure = Figure(figsize=(1.6 + 4.6 * across, 5.4 * down), layout="constrained")
    ratios = [3.0, 1.2] * down
    axes = figure.subplots(2 * down, across, squeeze=False, height_ratios=ratios)
    for place in range(down * across):
        above, below = axes[2 * (place // across) : 2 * (place // across) + 2, place % across]
        if place < len(curves):
            _draw_curve(curves[place], above, fit.confidence)
            _draw_residuals(curves[place], below)
            below.sharex(above)
            above.tick_params(labelbottom=False)
        elif place == len(curves) and events:
            _draw_events(events, above)
            below.set_axis_off()
        else:
            above.set_axis_off()
            below.set_axis_off()
    figure.suptitle(fill(_heading(fit), 46 * across), parse_math=False, fontsize=11, fontweight="bold")
    return figure


def _heading(fit: Fit) -> str:
    return fit.title if fit.converged else f"{fit.title} (not converged)"


def _draw_curve(column: FittedColumn, ax: Axes, confidence: float) -> None:
    """The data, and the model with its band, branch by branch."""
    for number, (x, y, half) in enumerate(column.curve):
        band = f"{100.0 * confidence:g} % band" if number == 0 else None
        ax.fill_between(x, y - half, y + half, color=COLOURS[0], alpha=0.25, linewidth=0.0, label=band)
        ax.plot(x, y, color=COLOURS[0], linewidth=1.6, label="model" if number == 0 else None)
    inside = ~column.beyond
    if column.data.size <= _ERROR_BARS:
        ax.errorbar(
            column.x,
            column.data,
            column.sigma,
            fmt="none",
            ecolor=GREY,
            elinewidth=0.8,
            capsize=0.0,
            zorder=2.5,
        )
    ax.plot(*_at(column, inside), label="data", **_MARKER)
    if column.beyond.any():
        label = "data beyond their branch"
        ax.plot(*_at(column, column.beyond), label=label, **(_MARKER | {"markerfacecolor": "white"}))
    ax.set_ylabel(_label(column.y_name, column.y_unit), parse_math=False)
    ax.set_title(column.label, parse_math=False, fontsize=9, color=GREY)
    ax.legend(frameon=False, fontsize=8.5)
    dress(ax)


_MARKER: dict[str, Any] = {
    "marker": "o",
    "markersize": 3.6,
    "markerfacecolor": BLACK,
    "markeredgecolor": BLACK,
    "markeredgewidth": 0.7,
    "linestyle": "none",
    "zorder": 3,
}


def _at(column: FittedColumn, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return column.x[chosen], column.data[chosen]


def _draw_residuals(column: FittedColumn, ax: Axes) -> None:
    """Residuals over their standard deviation, with the strip in which two thirds of them should lie."""
    ax.axhspan(-1.0, 1.0, color=GREY, alpha=0.15, linewidth=0.0)
    ax.axhline(0.0, color=COLOURS[0], linewidth=1.2)
    ax.plot(column.x, column.residual / column.sigma, **_MARKER)
    largest = float(np.nanmax(np.abs(column.residual / column.sigma), initial=3.0))
    ax.set_ylim(-1.15 * largest, 1.15 * largest)
    ax.set_ylabel("residual / σ")
    ax.set_xlabel(_label(column.x_name, column.x_unit), parse_math=False)
    dress(ax)


def _draw_events(events: list[FittedColumn], ax: Axes) -> None:
    """Each quantity of each event as a residual over its standard deviation, with its numbers."""
    ax.axvspan(-1.0, 1.0, color=GREY, alpha=0.15, linewidth=0.0)
    ax.axvline(0.0, color=COLOURS[0], linewidth=1.2)
    names = []
    largest = 3.0
    for place, column in enumerate(events):
        off = float(column.residual[0] / column.sigma[0])
        largest = max(largest, abs(off))
        ax.errorbar([off], [place], xerr=[1.0], fmt="o", color=BLACK, markersize=4.5, elinewidth=1.0)
        unit = f" {column.y_unit}" if column.y_unit else ""
        numbers = f"{column.data[0]:.4g}{unit}, model {column.model[0]:.4g}{unit}"
        names.append(f"{column.label}\n{column.y_name}\n{numbers}")
    ax.set_xlim(-1.3 * largest, 1.3 * largest)
    ax.set_ylim(len(events) - 0.4, -0.6)
    ax.set_yticks(range(len(events)), names, fontsize=8, parse_math=False)
    ax.set_xlabel("residual / σ")
    ax.set_title("events", fontsize=9, color=GREY)
    dress(ax)


def _label(name: str, unit: str) -> str:
    words = name.replace("_", " ", 1)
    return f"{words} [{unit}]" if unit else words
