"""The pictures of the page, drawn by Bokeh: what a history becomes in their sources."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from bokeh.models import ColumnDataSource, Range1d, Span
from bokeh.plotting import figure

from simulator.events import WORDS, EventKind
from simulator.live.controls import Corner, corners
from simulator.results.plot.style import COLOURS, PRESSURE, VOLTAGE
from simulator.units import PRESSURE as PRESSURES
from simulator.units import VOLTAGE as VOLTAGES
from simulator.units import prefixed

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from simulator.results.curve import Curve
    from simulator.results.history import History

    FloatArray = NDArray[np.float64]

INK, PAPER, FAINT = ("#1a1a1a", "#e6e6e6"), ("#ffffff", "#1b1e22"), ("#8a8a8a", "#8f9499")
ACCENT = ("#0072B2", "#56B4E9")  # of sliders
PROBLEM = ("#b00020", "#ff9d9d")
GASES = ("#dbe9f4", "#2c3e50")
_NEAR = 0.06  # of the width of a picture: what is near enough to be meant
_MARKERS = {
    EventKind.LIMIT_POINT: "star",
    EventKind.BRANCH_POINT: "plus",
    EventKind.JUMP: "circle",
    EventKind.LOSS_OF_TENSION: "x",
    EventKind.BREAKDOWN: "diamond",
    EventKind.RUNAWAY: "triangle",
    EventKind.OUT_OF_RANGE: "inverted_triangle",
    EventKind.LOSS_OF_SPHERICITY: "hex",
    EventKind.SPHERICITY_REGAINED: "hex",
}
_COLUMNS = {
    "samples": "",  # as many as there are balloons; each column is a message of its own
    "jumps": "xs ys",
    "events": "t x y marker",
    "stable": "x y",
    "unstable": "x y",
    "ghost": "",
    "now": "x y",
    "balloons": "x r colour width words below",
    "tube": "x to",
    "corners": "x y",
}


class Shown:
    """A history in the numbers of the axes.

    Attributes
    ----------
    x, y : (n,) arrays
        Of the loop: voltage (without electrodes the pressure) and stretch of the first electroded balloon.
    voltage, pressure : arrays
        In the unit of the axes.
    volts, pascals : float
        What dimensionless numbers were multiplied by.
    """

    def __init__(self, history: History) -> None:
        self.history = history
        self.balloon = history.balloons.index(history.electroded[0]) if history.electroded else 0
        self.volts, self.voltage_label = _unit(history, VOLTAGES, history.voltage, VOLTAGE)
        self.pascals, self.pressure_label = _unit(history, PRESSURES, history.pressure, PRESSURE)
        self.voltage, self.pressure = history.voltage * self.volts, history.pressure * self.pascals
        self.x = self.voltage[:, 0] if history.electroded else self.pressure
        self.y = history.stretch[:, self.balloon]

    @property
    def voltage_unit(self) -> str:
        """The unit of the voltage axis as a scenario takes it, with its blank; "" without units."""
        return f" {self.voltage_label[1:-1]}" if self.history.scenario.scales else ""

    @property
    def time_unit(self) -> str:
        """That of times: with units they are in seconds."""
        return " s" if self.history.scenario.scales else ""

    @property
    def pressure_unit(self) -> str:
        """That of the pressure axis."""
        return f" {self.pressure_label[1:-1]}" if self.history.scenario.scales else ""

    @property
    def is_common(self) -> bool:
        """Whether all electrodes see one voltage, as on a path."""
        voltage = self.history.voltage
        return bool(voltage.size) and bool((voltage == voltage[:, :1]).all())


def _unit(history: History, dimension: Any, values: FloatArray, symbol: str) -> tuple[float, str]:
    scales = history.scenario.scales
    if scales is None:
        return 1.0, symbol
    scale = scales.of(dimension)
    size, unit = prefixed(dimension, float(np.max(np.abs(values), initial=0.0)) * scale)
    return scale / size, f"[{unit}]"


def blank(name: str, title: str, height: int, *, dark: bool, axes: bool = True) -> Any:
    """A picture in which nothing is drawn yet."""
    ink, paper, faint = INK[dark], PAPER[dark], FAINT[dark]
    bare: Any = {} if axes else {"x_axis_type": None, "y_axis_type": None}
    made = figure(
        name=name, title=title, height=height, sizing_mode="stretch_width", tools="", toolbar_location=None,
        x_range=Range1d(0, 1), y_range=Range1d(0, 1), background_fill_color=paper, border_fill_color=paper,
        outline_line_color=faint, lod_threshold=None, min_border_right=12,
        stylesheets=[":host { opacity: var(--shown, 1); }"], **bare,
    )  # fmt: skip
    made.title.text_color = ink
    for axis in made.axis:
        axis.axis_label_text_color = axis.major_label_text_color = ink
        axis.axis_line_color = axis.major_tick_line_color = ink
        axis.minor_tick_line_color = None
        axis.axis_label_text_font_style = "normal"
    made.grid.grid_line_alpha = 0.25 if axes else 0.0
    return made


class Figures:
    """The pictures of one device; `show` puts a history into them.

    Attributes
    ----------
    balloons, loop, voltage, stretch, pressure : figure
    sources : dict of str to ColumnDataSource
    """

    def __init__(self, history: History, *, dark: bool) -> None:
        self.device = device_of(history)
        picture = partial(blank, dark=dark)
        self._path: Any = None  # what is drawn of it
        ink, faint, gas = INK[dark], FAINT[dark], GASES[dark]
        self.sources = {
            name: ColumnDataSource({column: [] for column in columns.split()}, name=name)
            for name, columns in _COLUMNS.items()
        }
        voltages: dict[str, Any] = {f"v{i}": [] for i in range(len(history.electroded))}
        stretches: dict[str, Any] = {f"s{i}": [] for i in range(len(history.balloons))}
        s = self.sources
        for name in ("samples", "ghost"):
            s[name].data = {"t": [], "p": [], **voltages, **stretches}
        shown = history.balloons.index(history.electroded[0]) if history.electroded else 0
        x, y = "v0" if history.electroded else "p", f"s{shown}"  # the loop
        self.loop = picture(
            "loop", "Stretch over voltage" if history.electroded else "Stretch over pressure", 390
        )
        self.voltage = picture("voltage", "Voltage in time (drag its corners)", 170)
        self.stretch = picture("stretch", "Stretches in time", 200)
        self.pressure = picture("pressure", "Pressure in time", 150)
        self.balloons = picture("balloons", "Balloons to scale", 190, axes=False)
        self._spans = [Span(dimension="height", line_color=faint, line_dash="dotted") for _ in range(3)]
        for panel, span in zip((self.voltage, self.stretch, self.pressure), self._spans, strict=True):
            panel.x_range = self.voltage.x_range
            panel.add_layout(span)
        if history.electroded:
            self.voltage.line("t", "v0", source=s["ghost"], color=faint, alpha=0.5)
        self.stretch.line("t", y, source=s["ghost"], color=faint, alpha=0.5)
        self.loop.line(x, y, source=s["ghost"], color=faint, alpha=0.6, line_width=3)
        self.loop.line("x", "y", source=s["stable"], color=faint, line_width=1.5)
        self.loop.line("x", "y", source=s["unstable"], color=faint, line_width=1, line_dash="dotted")
        self.loop.multi_line("xs", "ys", source=s["jumps"], color=ink, line_dash="dashed")
        colours = [COLOURS[i % len(COLOURS)] for i in range(len(history.balloons))]
        self.colours = colours
        for i, name in enumerate(history.electroded):
            colour = colours[history.balloons.index(name)]
            self.voltage.line("t", f"v{i}", source=s["samples"], color=colour, line_width=2)
        for i, colour in enumerate(colours):
            self.stretch.line("t", f"s{i}", source=s["samples"], color=colour, line_width=2)
        self.voltage.scatter(
            "x", "y", source=s["corners"], marker="square", size=9, color=ink, fill_color=PAPER[dark]
        )
        self.pressure.line("t", "p", source=s["samples"], color=ink, line_width=2)
        self.loop.line(x, y, source=s["samples"], color=colours[shown], line_width=2.5)
        for panel, place in ((self.loop, "x"), (self.stretch, "t")):
            panel.scatter(place, "y", source=s["events"], marker="marker", size=12, color=ink, fill_alpha=0.5)
        self.loop.scatter(
            "x", "y", source=s["now"], size=13, color=colours[shown], line_color=ink, line_width=2
        )
        self.balloons.segment("x", 0, "to", 0, source=s["tube"], color=gas, line_width=10)
        self.balloons.circle(
            "x", 0, radius="r", radius_dimension="min", source=s["balloons"], fill_color=gas,
            line_color="colour", line_width="width",
        )  # fmt: skip
        self.balloons.text(
            "x", "below", text="words", source=s["balloons"], text_align="center", text_baseline="top",
            text_color=ink, text_font_size="12px",
        )  # fmt: skip

    def show(self, shown: Shown, *, growing: bool) -> None:
        """Put a history into the pictures; `growing` axes keep what they showed before."""
        history, x, y = shown.history, shown.x, shown.y
        breaks = np.flatnonzero(np.diff(history.branch)) + 1
        columns = {"t": history.time, "p": shown.pressure}
        columns |= {f"v{i}": shown.voltage[:, i] for i in range(shown.voltage.shape[1])}
        columns |= {f"s{i}": history.stretch[:, i] for i in range(len(history.balloons))}
        self.sources["samples"].data = {k: np.insert(v, breaks, np.nan) for k, v in columns.items()}
        self.sources["jumps"].data = {  # short ones as lists: each array is a message of its own
            "xs": [x[b - 1 : b + 1].tolist() for b in breaks],
            "ys": [y[b - 1 : b + 1].tolist() for b in breaks],
        }
        self.sources["events"].data = _marks(shown)
        self.loop.xaxis.axis_label = (
            f"voltage {shown.voltage_label}" if history.electroded else f"pressure {shown.pressure_label}"
        )
        self.loop.yaxis.axis_label = f"stretch of {history.balloons[shown.balloon]}"
        self.voltage.yaxis.axis_label = shown.voltage_label
        self.pressure.yaxis.axis_label = shown.pressure_label
        self.stretch.yaxis.axis_label = "λ = r/R"
        for panel in (self.voltage, self.stretch, self.pressure):
            panel.xaxis.axis_label = "time [s]" if shown.time_unit else "time t"
        self._fit(self.voltage.x_range, history.time, growing, margin=0.01)
        self._fit(self.voltage.y_range, np.append(shown.voltage, 0.0), growing)
        self._fit(self.stretch.y_range, history.stretch, growing)
        self._fit(self.pressure.y_range, shown.pressure, growing)
        self._fit(self.loop.x_range, x, growing)
        self._fit(self.loop.y_range, y, growing)
        self._place(history)
        self._corners = corners(history.scenario) if history.electroded else []
        self.sources["corners"].data = {
            "x": [corner.time for corner in self._corners],
            "y": [corner.voltage * shown.volts for corner in self._corners],
        }

    def corner_at(self, x: float, y: float) -> Corner | None:
        """The corner of the voltage that is near a point of its picture, if any."""
        axes, places = (self.voltage.x_range, self.voltage.y_range), self.sources["corners"].data
        across, upwards = (axis.end - axis.start for axis in axes)
        far = [
            math.hypot((x - u) / across, 0.5 * (y - v) / upwards)
            for u, v in zip(places["x"], places["y"], strict=True)
        ]
        return self._corners[far.index(min(far))] if far and min(far) < _NEAR else None

    def _place(self, history: History) -> None:
        """Where the balloons stand: each has room for the largest that it becomes."""
        radii = np.array([balloon.radius for balloon in history.scenario.balloons])
        largest = (history.stretch * radii).max(axis=0, initial=0.0)
        gap = 0.3 * largest.max(initial=1.0)
        self.centres = np.cumsum(2 * largest + gap) - largest - gap
        width = float(2 * largest.sum() + gap * (len(radii) - 1)) * 1.06
        self.balloons.x_range.start, self.balloons.x_range.end = -0.03 * width, width
        self.balloons.y_range.start, self.balloons.y_range.end = -1.7 * largest.max(), 1.1 * largest.max()
        self.sources["tube"].data = {"x": self.centres[:-1].tolist(), "to": self.centres[1:].tolist()}

    @staticmethod
    def _fit(axis: Range1d, values: FloatArray, growing: bool, margin: float = 0.06) -> None:
        finite = values[np.isfinite(values)]
        low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
        room = margin * ((high - low) or abs(high) or 1.0)
        low, high = low - room, high + room
        if growing:
            low, high = min(low, axis.start), max(high, axis.end)
        axis.update(start=low, end=high)

    def seek(self, shown: Shown, sample: int) -> None:
        """Show the state at one sample."""
        history = shown.history
        stretch, radii = history.stretch[sample], [b.radius for b in history.scenario.balloons]
        has_electrodes = [name in history.electroded for name in history.balloons]
        self.sources["balloons"].data = {
            "x": self.centres.tolist(),
            "below": [self.balloons.y_range.start / 1.6] * len(radii),
            "r": (stretch * radii).tolist(),
            "colour": self.colours,
            "width": [5 if on else 2 for on in has_electrodes],
            "words": [f"{n}\nλ = {v:.4g}" for n, v in zip(history.balloons, stretch, strict=True)],
        }
        self.sources["now"].data = {"x": [float(shown.x[sample])], "y": [float(shown.y[sample])]}
        for span in self._spans:
            span.location = float(history.time[sample])

    def keep_ghost(self) -> None:
        """Leave what is shown as a faint line behind what follows."""
        self.sources["ghost"].data = dict(self.sources["samples"].data)

    def show_path(self, curves: Sequence[Curve], shown: Shown) -> None:
        """Draw equilibrium paths behind the loop, and make room for the next limit point; none hide them."""
        if not shown.is_common:
            curves = ()
        if self._path != (drawn := (curves, shown.volts, shown.balloon)):
            self._path = drawn
            self._draw_path(curves, shown)
        beyond = [
            (p.voltage[0] * shown.volts, p.stretch[shown.balloon])
            for p in (point for curve in curves for point in curve.points)
            if p.kind == "limit_point" and p.voltage[0] * shown.volts > shown.x.max()
        ]
        if beyond:
            next_x, next_y = min(beyond)
            self._fit(self.loop.x_range, np.append(shown.x, next_x), True)
            self._fit(self.loop.y_range, np.append(shown.y, next_y), True)

    def _draw_path(self, curves: Sequence[Curve], shown: Shown) -> None:
        lines: dict[str, list[FloatArray]] = {"stable": [np.empty((2, 0))], "unstable": [np.empty((2, 0))]}
        for curve in curves:
            points = np.array([curve.voltage[:, 0] * shown.volts, curve.stretch[:, shown.balloon]])
            is_unstable = curve.unstable > 0
            # A limit point belongs to both parts, so that no gap is left there.
            touches = is_unstable | np.append(is_unstable[1:], False)
            for name, drawn in (("stable", ~is_unstable), ("unstable", touches)):
                lines[name] += [np.where(drawn, points, np.nan), np.full((2, 1), np.nan)]
        for name, parts in lines.items():
            self.sources[name].data = dict(zip("xy", np.hstack(parts), strict=True))


def device_of(history: History) -> Any:
    """What the pictures are made for: balloons by name, and which of them have electrodes."""
    return history.balloons, history.electroded


def _marks(shown: Shown) -> dict[str, Any]:
    """Where the events stand, and their marks."""
    marks: dict[str, list[Any]] = {"t": [], "x": [], "y": [], "marker": []}
    for event in shown.history.events:
        after = event.kind is EventKind.JUMP and event.stretch_after is not None
        stretch = event.stretch_after if after else event.stretch_before
        has_voltage = event.voltage.size > 0
        x = event.voltage[0] * shown.volts if has_voltage else event.pressure_before * shown.pascals
        values = (event.time, x, stretch[shown.balloon], _MARKERS[event.kind])  # type: ignore[index]
        for column, value in zip(marks.values(), values, strict=True):
            column.append(value)
    return marks


def event_list(shown: Shown) -> dict[str, int | None]:
    """The events as the page lists them, each with its number."""
    rows: dict[str, int | None] = {"–": None}
    for number, event in enumerate(shown.history.events):
        volts = ", ".join(f"{v * shown.volts:.4g}" for v in event.voltage)
        sides = [
            "–" if side is None else ", ".join(f"{v:.4g}" for v in side)
            for side in (event.stretch_before, event.stretch_after)
        ]
        words = f"{number + 1} {WORDS[event.kind]} {event.balloon or ''}".rstrip()
        rows[f"{words}, t = {event.time:.5g}, φ = {volts or '–'}, λ = {sides[0]} → {sides[1]}"] = number
    return rows
