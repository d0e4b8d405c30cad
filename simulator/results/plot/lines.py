"""One quantity of a history in time, as a line of few points, or as a band where it would be a wall."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from simulator.results.plot.loops import GRID, last_of_branches, polyline, span
from simulator.results.plot.style import FAINT, THINNER

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from simulator.results.history import FloatArray, History

    BoolArray = NDArray[np.bool_]
    IntArray = NDArray[np.int64]

# Beyond these a picture gains ink and no information: two points for each pixel of a panel, and as many times
# up and down as can still be told apart.
MOST_POINTS = 3000
MOST_TURNS = 150
TURN = 0.05  # of the height of a panel: a smaller one is noise on a line, and no cycle


def draw_in_time(
    history: History, values: FloatArray, ax: Axes, colour: str, width: float, lost: BoolArray | None = None
) -> None:
    """Draw a line in time, solid along a branch and dashed from one to the next; where crowded, a band.

    Parameters
    ----------
    history : History
        Its times and branches.
    values : (n_samples,) array
    ax : matplotlib.axes.Axes
    colour : str
    width : float
        Of the solid line, in points.
    lost : (n_samples,) array of bool, optional
        Where the line is faint: a balloon has lost its shape.
    """
    if not values.size:
        return
    if is_crowded(values):
        starts = _bins(values.size, _turns(values) // 4)
        low, high = np.minimum.reduceat(values, starts), np.maximum.reduceat(values, starts)
        # Each bin reaches to the next one's first sample, and the last to the end.
        edges = history.time[np.append(starts, values.size - 1)]
        bounds = np.append(low, low[-1]), np.append(high, high[-1])
        # With an edge, so that a band does not vanish where it is narrow.
        ax.fill_between(edges, *bounds, step="post", facecolor=colour, alpha=0.35, linewidth=0.0)
        for bound in bounds:
            ax.step(edges, bound, where="post", color=colour, linewidth=0.8)
        return
    kept = _envelope(values, last_of_branches(history.branch))
    unmoved = span(values) / GRID
    time, values, branch = history.time[kept], values[kept], history.branch[kept]
    # A jump of another quantity leaves this line whole.
    joined = np.asarray((np.diff(branch) == 0) | (np.abs(np.diff(values)) < unmoved))
    faint = joined & (np.zeros_like(joined) if lost is None else lost[kept][:-1])
    ax.plot(*polyline(time, values, joined & ~faint), color=colour, linewidth=width, solid_capstyle="round")
    if faint.any():
        ax.plot(*polyline(time, values, faint), color=colour, linewidth=THINNER * width, alpha=FAINT)
    ends = np.flatnonzero(~joined)
    gap = np.full(ends.size, np.nan)
    ax.plot(
        np.column_stack([time[ends], time[ends + 1], gap]).ravel(),
        np.column_stack([values[ends], values[ends + 1], gap]).ravel(),
        color=colour,
        linewidth=1.2,
        linestyle="--",
    )


def is_crowded(values: FloatArray) -> bool:
    """Whether a line in time goes up and down so often that it would fill the panel like a wall."""
    return _turns(values) > MOST_TURNS


def _turns(values: FloatArray) -> int:
    """How often a line goes up and down by more than noise does."""
    least = TURN * span(values)
    count, up, low, high = 0, None, np.inf, -np.inf
    # The highest and lowest points of pixels have all turns that a picture can show.
    for value in values[thinned(values)].tolist():
        low, high = min(low, value), max(high, value)
        if up is not False and value < high - least:
            count, up, low = count + (up is True), False, value
        elif up is not True and value > low + least:
            count, up, high = count + (up is False), True, value
    return count


def _bins(size: int, count: int) -> IntArray:
    """First indices of `count` consecutive bins, at most 400."""
    edges = np.linspace(0, size, min(count, 400), endpoint=False)
    return edges.astype(np.int64)


def _envelope(values: FloatArray, ends: IntArray) -> IntArray:
    """Indices that draw the same line with few points: those of `thinned`, and all jumps."""
    kept = thinned(values)
    if kept.size == values.size:
        return kept
    return np.unique(np.concatenate([[0, values.size - 1], kept, ends, ends + 1])).astype(np.int64)


def thinned(values: FloatArray) -> IntArray:
    """Indices of the lowest and the highest of consecutive samples, at most `MOST_POINTS` in all."""
    if values.size <= MOST_POINTS:
        return np.arange(values.size)
    from tsdownsample import MinMaxDownsampler

    thinner: Any = MinMaxDownsampler
    found = thinner().downsample(np.ascontiguousarray(values), n_out=MOST_POINTS)
    return np.asarray(found, dtype=np.int64)
