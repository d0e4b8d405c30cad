"""Pictures of histories and of equilibrium paths; functions take axes and return them."""

from simulator.results.plot.curve import (
    draw_curves_png,
    draw_fold_png,
    draw_path,
    plot_curves,
    plot_fold,
    plot_paths,
)
from simulator.results.plot.history import (
    draw_png,
    plot_histories,
    plot_history,
    plot_loop,
    plot_pressure,
    plot_stretches,
    plot_voltage,
)
from simulator.results.plot.style import COLOURS, MARKERS

__all__ = [
    "COLOURS",
    "MARKERS",
    "draw_curves_png",
    "draw_fold_png",
    "draw_path",
    "draw_png",
    "plot_curves",
    "plot_fold",
    "plot_histories",
    "plot_history",
    "plot_loop",
    "plot_paths",
    "plot_pressure",
    "plot_stretches",
    "plot_voltage",
]
