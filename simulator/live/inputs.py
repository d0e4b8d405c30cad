"""Controls of the page that a keyboard and a screen reader can use: one number, and the playback.

Panel's own slider and player have no names for a screen reader (axe: `aria-input-field-name`,
`button-name`), so these two are made of the browser's own elements. So are words that change: when the text
of Panel's pane changes, the whole page is laid out anew, and a slider that is being dragged is let go of.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import panel as pn
import param

from simulator.live.controls import Number
from simulator.scenario.mapping import number_and_unit

_STYLE = """
:host { color: var(--ink); font-size: 14px; } h1 { font-size: 18px; margin: 0; }
.problem { color: var(--problem, #b00020); }
label { display: block; font-size: 12px; } [role=alert] { color: var(--problem, #b00020); font-size: 12px; }
.row { display: flex; gap: 10px; align-items: center; color: var(--ink); }
input[type=text] { width: 102px; box-sizing: border-box; font: inherit; font-size: 13px; padding: 2px 5px;
  color: inherit; background: transparent; border: 1px solid #8a8a8a; border-radius: 3px; }
input[type=range] { flex: 1; min-width: 80px; accent-color: var(--accent, #0072B2); margin: 0; }
button { width: 76px; font: inherit; font-size: 13px; padding: 3px; }
"""


def chooser(label: str, options: Sequence[Any], value: Any, width: int) -> Any:
    """A list to choose from, with the browser's own arrow, which is seen on dark ground too."""
    style = "select.bk-input { appearance: auto !important; background-image: none !important; }"
    return pn.widgets.Select(
        label=label, options=list(options), value=value, width=width, stylesheets=[style]
    )


class NumberInput(pn.custom.JSComponent):  # type: ignore[misc]
    """An exact field and a slider that show one number, and what is wrong with it.

    Parameters
    ----------
    number : Number
    moved : callable
        Told the input, its text, and whether the slider is still being dragged.
    """

    label, text, unit, problem = param.String(), param.String(), param.String(), param.String()
    value, low, high, step = param.Number(), param.Number(), param.Number(), param.Number()

    _esm = """
    export function render({ model }) {
      const box = document.createElement("div")
      box.innerHTML = `<label></label><div class="row"><input type="text"><input type="range"></div>
                       <span role="alert"></span>`
      const [label, text, range, alert] = ["label", "[type=text]", "[type=range]", "span"].map(
        (part) => box.querySelector(part))
      const name = model.label.replace(/\\W/g, "-") + Math.random().toString(36).slice(2)
      label.textContent = model.label
      label.htmlFor = text.id = name
      range.setAttribute("aria-label", model.label + " (slider)")
      const show = () => {
        Object.assign(range, { min: model.low, max: model.high, step: model.step })
        range.value = model.value
        text.value = model.text
        complain()
      }
      const complain = () => {
        alert.textContent = model.problem
        text.setAttribute("aria-invalid", model.problem !== "")
      }
      const tell = (dragging) => model.send_msg({ text: text.value, dragging })
      range.oninput = () => {
        text.value = Number(Number(range.value).toPrecision(6)) + model.unit
        tell(true)
      }
      // A browser may say that a slider has changed while the mouse still holds it.
      let held = false
      range.onpointerdown = () => {
        held = true
        window.addEventListener("pointerup", () => { held = false; tell(false) }, { once: true })
      }
      range.onchange = () => { if (!held) tell(false) }
      text.onchange = () => tell(false)
      model.on(["text", "value", "low", "high", "step"], show)
      model.on("problem", complain)
      show()
      return box
    }
    """

    def __init__(self, number: Number, moved: Callable[[NumberInput, str, bool], None]) -> None:
        self.number, self._moved = number, moved
        super().__init__(
            label=number.label, text=number.text, unit=number.unit, value=number.value, low=number.low,
            high=number.high, step=number.step, sizing_mode="stretch_width", margin=(2, 8),
            stylesheets=[_STYLE],
        )  # fmt: skip

    def _handle_msg(self, data: Any) -> None:
        self.tell(str(data["text"])[:100], bool(data["dragging"]))

    def tell(self, text: str, dragging: bool) -> None:
        """Say what the field says now."""
        self._moved(self, text, dragging)

    def show(self, text: str) -> None:
        """Show a text in the field, and its number on the slider, which makes room for it."""
        read = number_and_unit(text) or number_and_unit(float(text))
        assert read is not None
        low, high = min(self.low, read[0]), max(self.high, read[0])
        self.param.update(text=text, value=read[0], low=low, high=high, unit=read[1])


class Words(pn.custom.JSComponent):  # type: ignore[misc]
    """Text that changes.

    Parameters
    ----------
    role : str, optional
        "heading", or "status" or "alert" for what a screen reader is to say at once.
    look : str, optional
        "problem" for something wrong.
    """

    text, role, look = param.String(), param.String(), param.String()

    _esm = """
    export function render({ model }) {
      const box = document.createElement(model.role === "heading" ? "h1" : "div")
      if (["status", "alert"].includes(model.role)) box.setAttribute("role", model.role)
      box.className = model.look
      const show = () => { box.textContent = model.text }
      model.on("text", show)
      show()
      return box
    }
    """

    def __init__(self, role: str = "", look: str = "", margin: Any = (0, 10)) -> None:
        super().__init__(
            role=role, look=look, margin=margin, sizing_mode="stretch_width", stylesheets=[_STYLE]
        )


class Playback(pn.custom.JSComponent):  # type: ignore[misc]
    """A button that plays, and a slider for the frame that is shown, counted from 0.

    It also dims the pictures in the column that it stands in, without laying out the page anew.

    Parameters
    ----------
    seek : callable
        Told the frame.
    """

    frame, last, dim = param.Integer(default=1), param.Integer(default=1), param.Boolean()

    _esm = """
    export function render({ model }) {
      const box = document.createElement("div")
      box.className = "row"
      box.innerHTML = `<button type="button">▶ Play</button><input type="range" min="0" step="1">`
      const [button, range] = [box.querySelector("button"), box.querySelector("input")]
      range.setAttribute("aria-label", "moment shown")
      let timer = null
      const tell = () => model.send_msg({ frame: Number(range.value) })
      const stop = () => { clearInterval(timer); timer = null; button.textContent = "▶ Play" }
      const next = () => {
        if (Number(range.value) >= model.last) return stop()
        range.value = Number(range.value) + 1
        tell()
      }
      button.onclick = () => {
        if (timer !== null) return stop()
        if (Number(range.value) >= model.last) range.value = 0
        button.textContent = "❚❚ Pause"
        timer = setInterval(next, 40)
      }
      range.oninput = tell
      const show = () => { range.max = model.last; range.value = model.frame }
      model.on(["frame", "last"], show)
      model.on("dim", () => {
        box.getRootNode().host.getRootNode().host.style.setProperty("--shown", model.dim ? 0.4 : 1)
      })
      model.on("remove", stop)
      show()
      return box
    }
    """

    def __init__(self, seek: Callable[[int], None]) -> None:
        self._seek = seek
        super().__init__(sizing_mode="stretch_width", margin=(4, 10), stylesheets=[_STYLE])

    def _handle_msg(self, data: Any) -> None:
        with param.parameterized.discard_events(self):  # the browser knows
            self.frame = min(max(int(data["frame"]), 0), self.last)
        self._seek(self.frame)
