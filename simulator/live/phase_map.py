"""A map of what happens over two numbers of the scenario, computed in lockstep; a click goes there."""

from __future__ import annotations

import html
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import panel as pn
from bokeh.models import ColumnDataSource
from panel.io import unlocked

from simulator.live import links, worker
from simulator.live.controls import Number, dimensionless, numbers, rounded, shortest
from simulator.live.figures import INK, blank
from simulator.live.inputs import chooser
from simulator.results.plot.map import BEHAVIOURS

if TYPE_CHECKING:
    from simulator.scenario import Scenario

CELLS = 40  # along each side
_FIRST = ("gas.ambient_pressure", "step.1.inflate")
_WORDS = {name: words for name, (_, words) in BEHAVIOURS.items()}
_COLOURS = {name: colour for name, (colour, _) in BEHAVIOURS.items()}


class PhaseMap:
    """The map, and the choice of its two numbers.

    Parameters
    ----------
    newest : Newest
        Of a process beside the one that plays histories.
    later : callable
        Makes of a function one that may be called by an event.
    go : callable
        Told the texts of the two numbers by key, where the map is clicked.
    """

    def __init__(
        self,
        newest: worker.Newest,
        later: Callable[..., Any],
        go: Callable[[dict[str, str]], None],
        *,
        dark: bool,
    ) -> None:
        self._newest, self._go = newest, go
        self._scenario: Scenario | None = None
        self._numbers: dict[str, Number] = {}
        self._asked = ""
        self.cells = ColumnDataSource({"x": [], "y": [], "colour": []}, name="cells")
        self._here = ColumnDataSource({"x": [], "y": []}, name="here")
        self._panel = blank("map", "", 330, dark=dark)
        self._rects = self._panel.rect(
            "x", "y", width=1, height=1, source=self.cells, color="colour", line_width=0
        )
        self._panel.scatter("x", "y", source=self._here, size=12, marker="cross", color="black", line_width=3)
        self._panel.on_event("tap", later(self._tapped))
        self._words = pn.pane.HTML(
            "", sizing_mode="stretch_width", styles={"color": INK[dark], "font-size": "12px"}
        )
        self._x, self._y = (chooser(name, (), None, 150) for name in ("across", "upwards"))
        for select in (self._x, self._y):
            select.param.watch(later(lambda _: self.update(self._scenario)), "value")
        head = pn.pane.HTML("<h2>Phase map</h2>", stylesheets=["h2 { font-size: 14px; margin: 2px; }"])
        choice = pn.Row(self._x, self._y)
        self.view = pn.Card(
            choice, self._panel, self._words, header=head, collapsed=True, sizing_mode="stretch_width"
        )
        self.view.param.watch(later(lambda _: self.update(self._scenario)), "collapsed")

    def update(self, scenario: Scenario | None) -> None:
        """Show where a scenario is, and compute the map where it is open and not of this scenario."""
        if scenario is None:
            return
        self._scenario = scenario
        self._numbers = {n.key: n for n in numbers(scenario) if not n.key.startswith(("output.", "solver."))}
        if list(self._x.options) != list(self._numbers):
            keys = list(self._numbers)
            first, second = _FIRST if set(_FIRST) <= set(keys) else keys[:2]
            self._x.param.update(options=keys, value=first)
            self._y.param.update(options=keys, value=second)
        x, y = self._numbers[self._x.value], self._numbers[self._y.value]
        self._here.data = {"x": [x.value], "y": [y.value]}
        neutral = {x.key: "", y.key: ""}
        rest = [(k, v) for k, v in links.values_of(scenario).items() if k not in neutral]
        asked = repr((x.key, y.key, rest))
        inside = all(r.start <= n.value <= r.end for r, n in self._axes(x, y))
        if self.view.collapsed or x.key == y.key or (asked == self._asked and inside):
            return
        self._asked = asked
        across, upwards = _centres(x), _centres(y)
        grid = np.meshgrid(across, upwards)
        try:
            played = {n.key: v.ravel() * _one(scenario, n) for n, v in zip((x, y), grid, strict=True)}
        except (KeyError, ZeroDivisionError):
            self._words.object = f"No map over {html.escape(x.key)} and {html.escape(y.key)}."
            self.cells.data = {"x": [], "y": [], "colour": []}
            return
        self._words.object = '<span role="status">Computing the map …</span>'
        values = {x.key: grid[0].ravel(), y.key: grid[1].ravel()}
        done = partial(self._arrived, asked, x, y, values)
        self._newest.ask(worker.phases, (scenario, played), done)

    def _axes(self, x: Number, y: Number) -> tuple[tuple[Any, Number], ...]:
        return (self._panel.x_range, x), (self._panel.y_range, y)

    def _arrived(self, asked: str, x: Number, y: Number, values: Any, answer: worker.Answer) -> None:
        if asked != self._asked:
            return
        if answer.failure:
            self._words.object = html.escape(answer.failure)
            return
        found = list(answer.result)
        with unlocked():
            self.cells.data = {
                "x": values[x.key], "y": values[y.key], "colour": [_COLOURS[b] for b in found],
            }  # fmt: skip
            self._rects.glyph.width = (x.high - x.low) / CELLS
            self._rects.glyph.height = (y.high - y.low) / CELLS
            for axis, number in self._axes(x, y):
                axis.update(start=number.low, end=number.high)
            for axis, number in ((self._panel.xaxis, x), (self._panel.yaxis, y)):
                axis.axis_label = f"{number.key} [{number.unit.strip()}]" if number.unit else number.key
            kinds = sorted(set(found), key=found.count, reverse=True)
            self._words.object = "<br>".join(
                f'<span aria-hidden="true" style="color: {_COLOURS[kind]}">■</span> '
                f"{html.escape(_WORDS[kind])}: {100 * found.count(kind) / len(found):.0f} %"
                for kind in kinds
            )

    def _tapped(self, event: Any) -> None:
        chosen = {self._x.value: event.x, self._y.value: event.y}
        self._go({k: shortest(rounded(value)) + self._numbers[k].unit for k, value in chosen.items()})


def _one(scenario: Scenario, number: Number) -> float:
    """What one unit of a number is in the numbers that a scenario computes with."""
    return dimensionless(scenario, number.key) / number.value if number.unit else 1.0


def _centres(number: Number) -> Any:
    """The middles of the cells along one side."""
    width = (number.high - number.low) / CELLS
    return number.low + width * (np.arange(CELLS) + 0.5)
