"""Results as a notebook shows them: what happened, a table of the events or special points, a picture."""

from __future__ import annotations

import base64
import html
from typing import TYPE_CHECKING

import numpy as np

from simulator.events import WORDS
from simulator.results.record import ending

if TYPE_CHECKING:
    from simulator.results.curve import Curve
    from simulator.results.history import History
    from simulator.results.unloading import Unloading, UnloadingMap

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


def unloading_html(found: Unloading | UnloadingMap) -> str:
    """Unloading from many peaks as HTML: of a map the picture alone."""
    from simulator.results.unloading import Unloading

    table = ""
    if isinstance(found, Unloading):
        shown = np.unique(np.linspace(0, len(found) - 1, min(len(found), EVENTS_SHOWN)).round().astype(int))
        rows = [
            [
                f"{found.peaks[i]:.6g}",
                found.outcome[i].replace("_", " "),
                _numbers(found.remanent_stretch[i]),
                f"{found.area[i]:.6g}",
                f"{found.dissipated[i]:.6g}",
                "yes" if found.closed[i] else "no",
            ]
            for i in shown.tolist()
        ]
        header = ["peak", "outcome", "stretches that remain", "area", "lost in snaps", "closed"]
        table = _table(header, rows)
        if len(found) > len(rows):
            table += f"<p>{len(rows)} of {len(found)} peaks</p>"
    return f"<h4>{html.escape(found.title)}</h4>{table}{_picture(found)}"


def _numbers(values: np.ndarray | None) -> str:
    return "" if values is None else ", ".join(f"{value:.6g}" for value in values)


def _table(header: list[str], rows: list[list[str]]) -> str:
    head = "".join(f"<th>{cell}</th>" for cell in header)
    body = "".join("<tr>" + "".join(f"<td>{html.escape(c)}</td>" for c in row) + "</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _picture(shown: History | Curve | Unloading | UnloadingMap) -> str:
    from simulator.results.plot.style import png

    content = base64.b64encode(png(shown.plot(), 100.0)).decode()
    return f'<img alt="" src="data:image/png;base64,{content}" style="max-width: 100%">'
