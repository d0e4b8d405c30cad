"""The left of the page: the numbers of a scenario by group, its steps, and its text."""

from __future__ import annotations

import html
from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import panel as pn

from simulator.live import links
from simulator.live.controls import NEW_STEPS, numbers, with_kind, with_step, without_step
from simulator.live.inputs import NumberInput, chooser

if TYPE_CHECKING:
    from simulator.scenario import Problem, Scenario


class Cards:
    """What can be changed of a scenario.

    Parameters
    ----------
    later : callable
        Makes of a function one that may be called by an event.
    moved : callable
        Told new texts by key, and whether a slider is still being dragged.
    change : callable
        Told how another scenario is made of the one that is shown, which may raise ScenarioError.
    read : callable
        Makes a scenario of a text.
    """

    def __init__(
        self,
        later: Callable[..., Callable[..., None]],
        moved: Callable[[Mapping[str, str], bool], None],
        change: Callable[[Callable[[Scenario], Scenario]], None],
        read: Callable[[str], Scenario],
    ) -> None:
        self._later, self._moved, self._change, self._read = later, moved, change, read
        self._inputs: dict[str, NumberInput] = {}
        self.view = pn.Column(sizing_mode="stretch_width")

    def fill(self, scenario: Scenario) -> None:
        """Show the numbers of a scenario."""
        moved = self._later(lambda one, text, dragging: self._moved({one.number.key: text}, dragging))
        self._inputs = {n.key: NumberInput(n, moved) for n in numbers(scenario)}
        groups: dict[str, list[NumberInput]] = {}
        for one in self._inputs.values():
            groups.setdefault(one.number.group, []).append(one)
        cards = []
        for group, inputs in sorted(groups.items(), key=lambda item: not item[0].startswith("Step ")):
            views: list[Any] = list(inputs)
            if group.startswith("Step "):
                number, _, kind = group.removeprefix("Step ").partition(": ")
                views.append(self._of_step(int(number), kind))
            collapsed = group in ("Settings", "Scales") or (group.startswith("Balloon") and len(groups) > 9)
            cards.append(_card(group, *views, collapsed=collapsed))
        cards.append(_card("Add a step", self._new_step(len(scenario.steps))))
        self._text = pn.widgets.TextAreaInput(
            label="The scenario as text", value=links.to_text(scenario), rows=16, max_length=100_000,
            sizing_mode="stretch_width",
        )  # fmt: skip
        apply = self._button("Apply text", lambda _: self._read(self._text.value))
        cards.append(_card("Text", self._text, apply, collapsed=True))
        self.view[:] = cards

    def _of_step(self, number: int, was: str) -> Any:
        """Another kind for a step, or none."""
        kinds = list(dict.fromkeys([was, *NEW_STEPS]))
        kind = chooser(f"Kind of step {number}", kinds, was, 95)

        def chosen(event: Any) -> None:
            self._change(partial(with_kind, number=number, kind=event.new))

        kind.param.watch(self._later(chosen), "value")
        return pn.Row(kind, self._button(f"Remove step {number}", partial(without_step, number=number)))

    def _new_step(self, count: int) -> Any:
        kind = chooser("New step", list(NEW_STEPS), "ramp", 85)
        place = chooser("behind", range(count, -1, -1), count, 55)
        return pn.Row(kind, place, self._button("Add step", lambda s: with_step(s, kind.value, place.value)))

    def _button(self, label: str, make: Callable[[Scenario], Scenario]) -> Any:
        made = pn.widgets.Button(label=label, width=105, align="end", margin=5)
        made.on_click(self._later(lambda _: self._change(make)))
        return made

    def show(self, texts: Mapping[str, str]) -> None:
        """Show other texts in their fields."""
        for key, text in texts.items():
            self._inputs[key].show(text)

    def tell(self, scenario: Scenario) -> None:
        """Show a scenario as text."""
        self._text.value = links.to_text(scenario)

    def complain(self, problems: tuple[Problem, ...] = ()) -> str:
        """Say every problem under its field, and no other; what has no field is returned."""
        others = []
        for one in self._inputs.values():
            one.problem = ""
        for problem in problems:
            if problem.key in self._inputs:
                self._inputs[problem.key].problem = problem.allowed
            else:
                others.append(f"{problem.key}: {problem.allowed}".removeprefix(": "))
        return "; ".join(others)


def _card(title: str, *views: Any, collapsed: bool = False) -> Any:
    head = pn.pane.HTML(f"<h2>{html.escape(title)}</h2>", stylesheets=["h2 {font-size: 14px; margin: 2px;}"])
    return pn.Card(*views, header=head, collapsed=collapsed, sizing_mode="stretch_width")
