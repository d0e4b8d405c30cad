"""The page: numbers at the left, pictures at the right, computed anew while a number moves."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import panel as pn
from panel.io import unlocked

from simulator.events import WORDS
from simulator.live import links, worker
from simulator.live.cards import Cards
from simulator.live.controls import Corner, check_size, rounded, shortest, written
from simulator.live.figures import INK, PAPER, PROBLEM, Figures, Shown, device_of, event_list
from simulator.live.inputs import Playback, Words, chooser
from simulator.live.phase_map import PhaseMap
from simulator.results.plot.animation import frames
from simulator.results.record import ending
from simulator.scenario import ScenarioError, load_scenario

if TYPE_CHECKING:
    from simulator.results.history import History
    from simulator.scenario import Scenario

SLOW = 0.15  # seconds; a scenario that takes longer is played when a slider is let go of
_TRIED = 1.0  # seconds; one that took less is tried once a drag: steps that did not change take no time
_SAID = 300  # ms after which "computing" is said

_STYLE = """
:host { color: %s; } .problem { color: %s; font-size: 12px; }
"""


class Page:
    """A scenario on a page.

    Parameters
    ----------
    opened : Scenario
        What changes are told against.
    scenario : Scenario
        What is shown first.
    compute : callable
        A `Worker`, or what answers like one.
    post : callable
        See `Newest`.
    compute_map : callable, optional
        Another one beside `compute`, for what takes longer.
    presets : mapping of str to path, optional
        Scenarios to start from.
    preset : str, optional
        Which of them was opened, if any.
    in_page : bool, optional
        Whether it has a page, and so an address, of its own.
    """

    def __init__(
        self,
        opened: Scenario,
        scenario: Scenario,
        compute: Callable[..., worker.Answer],
        post: Callable[[Callable[[], None]], None],
        *,
        compute_map: Callable[..., worker.Answer] | None = None,
        dark: bool = False,
        presets: Mapping[str, str] | None = None,
        preset: str = "",
        problem: str = "",
        in_page: bool = True,
    ) -> None:
        self.opened, self.scenario, self.dark = opened, scenario, dark
        self.shown: Shown | None = None
        self.figures: Figures | None = None
        self._frames: list[int] = [0]
        self._corner: Corner | None = None  # the one that is being pulled
        self._post, self.preset = post, preset
        self._location = pn.state.location if in_page else None
        self._newest = worker.Newest(compute, post)
        mapping = worker.Newest(compute_map or compute, post)
        self._map = PhaseMap(mapping, self._later, self._set, dark=dark)
        self._paths: dict[str, Any] = {}
        self._texts: dict[str, str] = {}
        self._is_dragging = False
        self._seconds = 0.0
        self._awaited: Scenario | None = None  # whose history has been asked for and is not there yet
        self._presets = dict(presets or {})
        self._cards = Cards(
            self._later, self._move, self._try, lambda text: links.from_text(text, self.opened)
        )
        self._make_widgets()
        self._cards.fill(scenario)
        self._say(problem)
        # At once, as part of the page: what is sent while a page is still being opened may be lost.
        self._paths[worker.path_key(scenario)] = compute(worker.follow, scenario).result or ()
        self._arrived(scenario, compute(worker.play, scenario), False)

    # What the page is made of.

    def _make_widgets(self) -> None:
        style = [_STYLE % (INK[self.dark], PROBLEM[self.dark])]
        self._title, self._status = Words("heading", margin=(5, 10, 0, 10)), Words("status")
        self._banner = Words("alert", "problem")
        reset = pn.widgets.Button(label="Reset", width=70)
        reset.on_click(self._later(lambda _: self.open(self.opened)))
        downloads = [
            pn.widgets.FileDownload(
                callback=make,
                filename=name,
                label=label,
                auto=True,
                embed=False,
                width=60,
                button_type="default",
            )
            for make, name, label in (
                (self._toml, "scenario.toml", "TOML"),
                (self._csv, "history.csv", "CSV"),
                (self._png, "history.png", "PNG"),
            )
        ]
        self._preset = chooser("Start from", ["", *self._presets], self.preset, 150)
        self._preset.visible = bool(self._presets)
        self._preset.param.watch(self._later(self._start_from), "value")
        self._pictures = pn.Column(sizing_mode="stretch_width", min_height=300)
        self._player = Playback(self._later(self._seek_frame))
        self._now = Words()
        self._events = pn.widgets.Select(
            label="Events (choose one to go there)", size=6, sizing_mode="stretch_width",
            stylesheets=[*style, "select { font-size: 12px; }"],
        )  # fmt: skip
        self._events.param.watch(self._later(self._seek_event), "value")
        said = pn.Column(self._title, self._status, styles={"flex": "1 1 260px"})
        head = pn.FlexBox(said, self._preset, reset, *downloads, align_items="end", flex_wrap="wrap")
        # Each of the two columns scrolls by itself, so that pictures stay in sight of every slider.
        tall = {"max-height": "calc(100vh - 75px)", "overflow": "auto"}
        layout = pn.Column(
            head, self._banner,
            pn.FlexBox(
                pn.Column(self._cards.view, styles={"flex": "0 0 clamp(250px, 30vw, 340px)", **tall}),
                pn.Column(self._pictures, min_width=420, styles={"flex": "1", **tall}),
                flex_wrap="nowrap",
            ),
            sizing_mode="stretch_width", styles={"background": PAPER[self.dark]},
        )  # fmt: skip
        self.view = layout

    def _later(self, function: Callable[..., None]) -> Callable[..., None]:
        """A function that does the same when the page may be changed; events arrive when it may not."""
        return lambda *arguments: self._post(partial(function, *arguments))

    # What a visitor does.

    def _move(self, texts: Mapping[str, str], dragging: bool) -> None:
        self._texts.update(texts)
        begins, self._is_dragging = dragging and not self._is_dragging, dragging
        if begins and self.figures:
            self.figures.keep_ghost()
        if dragging and self._seconds > (_TRIED if begins else SLOW):
            return
        self._apply(dragging=dragging)

    def _pulled(self, event: Any) -> None:
        """Move a corner of the voltage with the mouse, and with it what its step says."""
        assert self.figures is not None
        if event.event_name == "panstart":
            self._corner = self.figures.corner_at(event.x, event.y)
        if self._corner is None or self.shown is None:
            return
        texts = {self._corner.voltage_key: shortest(rounded(event.y)) + self.shown.voltage_unit}
        if self._corner.time_key:
            texts[self._corner.time_key] = shortest(rounded(event.x - self._corner.begins))
        self._move(texts, event.event_name != "panend")

    def _set(self, texts: Mapping[str, str]) -> None:
        """Give several numbers other values."""
        self._texts.update(texts)
        self._apply(dragging=False)

    def _apply(self, *, dragging: bool) -> None:
        """Play the scenario with the texts of its fields, or say what is wrong with them."""
        try:
            changed = self.scenario.with_values({key: written(t) for key, t in self._texts.items()})
            check_size(changed)
        except ScenarioError as error:
            self._complain(error)
            return
        self.scenario = changed
        if not dragging:
            self._cards.show(self._texts)
        self._texts.clear()
        self._cards.complain()
        self._say("")
        self.ask(dragging=dragging)

    def _complain(self, error: ScenarioError) -> None:
        """Say what is wrong; the last picture stays."""
        self._say(self._cards.complain(error.problems))
        self._player.dim = True

    def _try(self, make: Callable[[Scenario], Scenario]) -> None:
        """Open what is made of the scenario that is shown, or say why it makes no sense."""
        try:
            made = make(self.scenario)
            check_size(made)
        except ScenarioError as error:
            self._complain(error)
        else:
            self.open(made)

    def _read(self, text: str) -> Scenario:
        return links.from_text(text, self.opened)

    def _start_from(self, event: Any) -> None:
        if event.new:
            self.preset, self.opened = event.new, load_scenario(self._presets[event.new])
            self._try(lambda _: self.opened)

    def open(self, scenario: Scenario) -> None:
        """Show another scenario."""
        self.scenario = scenario
        self._say("")
        self._texts.clear()
        self._cards.fill(scenario)
        self.ask(dragging=False)

    # What is computed for it.

    def ask(self, *, dragging: bool) -> None:
        """Have the history computed, and the path where it is not known."""
        asked = self._awaited = self.scenario
        self._newest.ask(worker.play, asked, lambda answer: self._arrived(asked, answer, dragging))
        document = pn.state.curdoc
        if document and not dragging:
            document.add_timeout_callback(self._still_computing, _SAID)

    def _still_computing(self) -> None:
        if self._awaited is not None:
            self._status.text = "Computing …"

    def _arrived(self, asked: Scenario, answer: worker.Answer, dragging: bool) -> None:
        self._seconds = answer.seconds
        if asked is self._awaited:
            self._awaited = None
        history, failure = answer.result or (None, answer.failure)
        with unlocked():
            if failure:
                self._say(f"The solver failed: {failure}" if history else failure)
            if history is None or not len(history):
                self._player.dim = True
                return
            self._draw(history, growing=dragging and self._is_dragging)
            path = worker.path_key(asked)
            if path in self._paths:
                self.figures.show_path(self._paths[path], self.shown)  # type: ignore[union-attr,arg-type]
            else:
                self.figures.show_path((), self.shown)  # type: ignore[union-attr,arg-type]
                self._newest.ask(worker.follow, asked, lambda answer: self._followed(path, answer))

    def _followed(self, key: str, answer: worker.Answer) -> None:
        while len(self._paths) > 50:
            self._paths.pop(next(iter(self._paths)))
        self._paths[key] = answer.result or ()
        if self.figures and self.shown and worker.path_key(self.scenario) == key:
            with unlocked():
                self.figures.show_path(self._paths[key], self.shown)

    # What is shown.

    def _draw(self, history: History, *, growing: bool) -> None:
        shown = self.shown = Shown(history)
        if self.figures is None or self.figures.device != device_of(history):
            self.figures = Figures(history, dark=self.dark)
            for name in ("panstart", "pan", "panend"):
                self.figures.voltage.on_event(name, self._later(self._pulled))
            self._arrange(self.figures)
        self._player.dim = False
        self.figures.show(shown, growing=growing)
        was_at_end, share = self._player.frame >= self._player.last, self._player.frame / self._player.last
        self._frames = frames(history, 240, 8)
        last = len(self._frames) - 1
        frame = last if was_at_end or self._is_dragging else round(share * last)
        self._player.param.update(last=last, frame=frame)
        self._seek(self._frames[frame])
        self._title.text = history.scenario.title
        kinds = [WORDS[event.kind] for event in history.events]
        summary = ", ".join(f"{kinds.count(k)} × {k}" for k in dict.fromkeys(kinds)) or "no events"
        self._status.text = f"{ending(history)}; {summary}"
        if not growing:
            self._events.param.update(options=event_list(shown), value=None)
            self._cards.tell(self.scenario)
            self._map.update(self.scenario)
            if self._location:
                self._location.search = links.link(self.opened, self.scenario, self._link_also())

    def _link_also(self) -> dict[str, str]:
        """What a link says beside changes."""
        also = {"scenario": self.preset} if self.preset else {}
        return {**also, "theme": "dark"} if self.dark else also

    def _arrange(self, figures: Figures) -> None:
        time = [figures.voltage] if figures.sources and figures.device[1] else []
        wide: Any = {"sizing_mode": "stretch_width", "min_width": 300}
        left = pn.Column(*time, figures.stretch, figures.pressure, **wide)
        right = pn.Column(figures.loop, self._events, self._map.view, **wide)
        for column in (left, right):
            column.styles = {"flex": "1 1 300px"}
        self._pictures[:] = [
            figures.balloons, self._player, self._now,
            # Where they do not stand beside each other the loop comes first.
            pn.FlexBox(
                left, right, flex_wrap="wrap-reverse", align_items="flex-end", sizing_mode="stretch_width"
            ),
        ]  # fmt: skip

    def _seek(self, sample: int) -> None:
        if self.shown and self.figures and sample < len(self.shown.history):
            with unlocked():
                self.figures.seek(self.shown, sample)
                self._tell_sample(sample)

    def _seek_frame(self, frame: int) -> None:
        self._seek(self._frames[min(frame, len(self._frames) - 1)])

    def _seek_event(self, chosen: Any) -> None:
        if self.shown is None or chosen.new is None:
            return
        time = self.shown.history.events[chosen.new].time
        frame = next(i for i, s in enumerate(self._frames) if self.shown.history.time[s] >= time)
        self._player.frame = frame
        self._seek(self._frames[frame])

    def _tell_sample(self, sample: int) -> None:
        shown = self.shown
        assert shown is not None
        volts = ", ".join(f"{v:.4g}" for v in shown.voltage[sample]) or "–"
        self._now.text = (
            f"t = {shown.history.time[sample]:.4g}{shown.time_unit} · φ = {volts}{shown.voltage_unit}"
            f" · p = {shown.pressure[sample]:.4g}{shown.pressure_unit}"
        )

    def _say(self, words: str) -> None:
        self._banner.text = words

    # Downloads.

    def _toml(self) -> io.BytesIO:
        return io.BytesIO(links.to_text(self.scenario).encode())

    def _csv(self) -> io.BytesIO:
        assert self.shown is not None
        return io.BytesIO(self.shown.history.to_dataframe().to_csv(index=False).encode())

    def _png(self) -> io.BytesIO:
        from simulator.results.plot import plot_history, png

        assert self.shown is not None
        return io.BytesIO(png(plot_history(self.shown.history)))
