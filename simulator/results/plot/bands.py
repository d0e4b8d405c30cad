"""The loop of a history with the bands in which other runs of it lie."""

from __future__ import annotations

from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from simulator.results.plot.axes import shown_history
from simulator.results.plot.loop import plot_loop
from simulator.results.plot.style import COLOURS, GREY, in_own_style

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from simulator.results.history import FloatArray, History

    Index = NDArray[np.int64]

_FEWEST = 0.005  # of the runs: what fewer do is not drawn


@in_own_style
def plot_bands(
    history: History, step: Index, snaps: Index, runs: Index, voltage: FloatArray, stretch: FloatArray
) -> Figure:
    """Draw the loop of each actuator, and the band in which the middle 95 % of the runs are at each voltage.

    Runs with another number of snaps so far have a band of their own; its darkness is their share.

    Parameters
    ----------
    history : History
        Of the numbers as written.
    step, snaps, runs : (n,) arrays
    voltage : (n, n_electroded) array
    stretch : (n, n_balloons, 3) array
        Lower end, median and upper end.

    Returns
    -------
    matplotlib.figure.Figure
        Not registered with pyplot: save it with ``figure.savefig(path)``.
    """
    count = max(len(history.electroded), 1)
    figure = Figure(figsize=(1.2 + 5.2 * count, 4.8), layout="constrained")
    axes = figure.subplots(1, count, squeeze=False)[0]
    volts, radii = _factors(history)
    total = float(runs.max())
    for place, name in enumerate(history.electroded):
        ax, balloon = axes[place], history.balloons.index(name)
        for part in _groups(step, snaps):
            if runs[part].max() < _FEWEST * total:
                continue
            low, middle, high = radii[balloon] * stretch[part, balloon].T
            shade = 0.08 + 0.32 * float(runs[part].mean()) / total
            colour = COLOURS[int(snaps[part[0]]) % len(COLOURS)]
            x = volts * voltage[part, place]
            ax.fill_between(x, low, high, color=colour, alpha=shade, linewidth=0.0)
            ax.plot(x, middle, color=colour, linewidth=0.9, linestyle=":")
        plot_loop(history, ax, balloon=name)
    said = f"Bands: the middle 95 % of {int(total):,} runs; colours: snaps so far"
    figure.suptitle(
        fill(history.scenario.title, 60 * count), parse_math=False, fontsize=11, fontweight="bold"
    )
    figure.supxlabel(said, fontsize=8.5, color=GREY)
    return figure


def _groups(step: Index, snaps: Index) -> Sequence[NDArray[np.intp]]:
    """The rows of each band: of one step, and of one number of snaps so far."""
    pairs = sorted(set(zip(step.tolist(), snaps.tolist(), strict=True)))
    found = [np.flatnonzero((step == number) & (snaps == count)) for number, count in pairs]
    return [rows for rows in found if rows.size > 1]


def _factors(history: History) -> tuple[float, FloatArray]:
    """What voltages and stretches are multiplied by to be those of the axes."""
    shown, labels = shown_history(history)
    largest = int(np.argmax(np.abs(history.voltage[:, 0])))
    volts = float(shown.voltage[largest, 0] / history.voltage[largest, 0]) if history.voltage.any() else 1.0
    radii = np.array(labels.unstretched) if labels.unstretched else np.ones(len(history.balloons))
    return volts, radii
