"""Results as they show themselves in a notebook: what happened, a table of the events, a picture."""

from __future__ import annotations

import base64
import html
from typing import TYPE_CHECKING

import numpy as np

from simulator.events import WORDS, Outcome

if TYPE_CHECKING:
    from simulator.results.curve import Curve
    from simulator.results.history import History

EVENTS_SHOWN = 12


def history_html(history: History) -> str:
    """A history as HTML."""
    count = len(history.events)
    rows = [
        [
            WORDS[event.kind],
            f"{event.time:.6g}",
            str(event.step),
            _numbers(event.voltage),
            _numbers(event.stretch_before),
            _numbers(event.stretch_after),
        ]
        for event in history.events[:EVENTS_SHOWN]
    ]
    header = ["event", "time", "step", "voltage", "stretches before", "stretches after"]
    more = f"<p>and {count - EVENTS_SHOWN} more</p>" if count > EVENTS_SHOWN else ""
    picture = _picture(history)
    return (
        f"<h4>{html.escape(history.scenario.title)}</h4><p>{ending(history)}</p>"
        f"{_table(header, rows) if rows else ''}{more}{picture}"
    )


def curve_html(curve: Curve) -> str:
    """An equilibrium path as HTML."""
    rows = [
        [
            point.kind.replace("_", " "),
            _numbers(point.voltage),
            _numbers(point.stretch),
            f"{point.pressure:.6g}",
        ]
        for point in curve.points
    ]
    header = ["point", "voltage", "stretches", "pressure"]
    picture = _picture(curve)
    return f"<h4>{html.escape(curve.title)}</h4>{_table(header, rows)}{picture}"


def ending(history: History) -> str:
    """How a history ended, in a few words."""
    if not len(history):
        return "nothing was computed"
    time = f"time {history.time[-1]:.6g}{' s' if history.scenario.scales else ''}"
    match history.outcome:
        case Outcome.COMPLETED:
            return f"completed at {time}"
        case Outcome.FAILED:
            return f"partial: the solver failed after {time}"
    return f"ended by {history.outcome.value.replace('_', ' ')} at {time}"


def _numbers(values: np.ndarray | None) -> str:
    return "" if values is None else ", ".join(f"{value:.6g}" for value in values)


def _table(header: list[str], rows: list[list[str]]) -> str:
    head = "".join(f"<th>{cell}</th>" for cell in header)
    body = "".join("<tr>" + "".join(f"<td>{html.escape(c)}</td>" for c in row) + "</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _picture(shown: History | Curve) -> str:
    from simulator.results.plot.style import png

    content = base64.b64encode(png(shown.plot(), 100.0)).decode()
    return f'<img alt="" src="data:image/png;base64,{content}" style="max-width: 100%">'
