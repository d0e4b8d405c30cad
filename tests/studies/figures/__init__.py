"""The figures of Sun, Wang & Zhou (2015), three histories behind them, and others, from scenario files.

Each `draw_*` function returns a whole figure, made of functions that take axes and return them.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import matplotlib as mpl

from tests.studies.figures import actuation, chamber, histories, hysteresis, inflation, rates, snap
from tests.studies.figures.style import SETTINGS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["FIGURES", "draw_figures"]

FIGURES: dict[str, Callable[[Path], Figure]] = {
    "fig2": inflation.draw_equal_balloons,
    "fig3a": partial(actuation.draw, panel="3a"),
    "fig3b": partial(actuation.draw, panel="3b"),
    "fig3c": partial(actuation.draw, panel="3c"),
    "fig4a": snap.draw_pressures_of_active,
    "fig4b": snap.draw_voltage,
    "fig4c": snap.draw_pressures_of_passive,
    "fig5a": inflation.draw_unequal_balloons,
    "fig5b": partial(actuation.draw, panel="5b"),
    "fig5c": partial(actuation.draw, panel="5c"),
    "history3c_b": partial(histories.draw, name="fig3c_state_b"),
    "history5b_b": partial(histories.draw, name="fig5b_state_b"),
    "history5c_a": partial(histories.draw, name="fig5c_state_a"),
}

# What the paper does not have.
MORE: dict[str, Callable[[Path], Figure]] = {
    "chamber": chamber.draw,
    "states": hysteresis.draw_states,
    "unload": hysteresis.draw_unloading,
    "rates": rates.draw,
}

_DOTS_PER_INCH = 200.0
_WIDEST = 1120.0  # dots


def draw_figures(scenarios: Path) -> dict[str, bytes]:
    """Draw all figures.

    Parameters
    ----------
    scenarios : Path
        Folder of the paper's scenario files.

    Returns
    -------
    dict of str to bytes
        File name to content, an SVG and a PNG of each. The same scenarios give the same bytes.

    Raises
    ------
    ScenarioError
        If a scenario file is missing.
    """
    files: dict[str, bytes] = {}
    with mpl.rc_context(cast("Any", SETTINGS)):
        for name, draw in {**FIGURES, **MORE}.items():
            figure = draw(scenarios)
            files[f"{name}.svg"] = _saved(figure, "svg", {"Date": None, "Creator": None})
            files[f"{name}.png"] = _saved(figure, "png", {"Software": None})
    return files


def _saved(figure: Figure, kind: str, metadata: dict[str, None]) -> bytes:
    stream = BytesIO()
    dots_per_inch = min(_DOTS_PER_INCH, _WIDEST / figure.get_figwidth())
    figure.savefig(stream, format=kind, dpi=dots_per_inch, metadata=metadata)
    return stream.getvalue()
