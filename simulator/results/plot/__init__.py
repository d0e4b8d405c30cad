"""Pictures of histories and of equilibrium paths.

Functions that draw into axes take them and return them; those that make a whole figure return it. `png` makes
a file of a figure.
"""

from simulator.results.plot.curve import draw_path, plot_curves, plot_fold, plot_paths
from simulator.results.plot.history import plot_histories, plot_history
from simulator.results.plot.in_time import (
    plot_fields,
    plot_margins,
    plot_pressure,
    plot_stretches,
    plot_voltage,
)
from simulator.results.plot.loop import plot_charge_loop, plot_loop
from simulator.results.plot.style import COLOURS, MARKERS, png

__all__ = [
    "COLOURS",
    "MARKERS",
    "draw_path",
    "plot_charge_loop",
    "plot_curves",
    "plot_fields",
    "plot_fold",
    "plot_histories",
    "plot_history",
    "plot_loop",
    "plot_margins",
    "plot_paths",
    "plot_pressure",
    "plot_stretches",
    "plot_voltage",
    "png",
]
