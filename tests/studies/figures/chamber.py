"""A balloon on chambers of growing size: from hardly moving to the snap of an open valve."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from simulator.analysis.trace import trace_all
from simulator.model.device import Device
from simulator.model.elastomers import tension_force, tension_stiffness
from simulator.results.plot.curve import UNSTABLE
from simulator.scenario import load_scenario
from tests.studies.figures import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from simulator.scenario import Scenario
    from tests.studies.figures.style import FloatArray

SCENARIO = "keplinger_chamber.toml"

_CHAMBERS = {0.0: "#CC79A7", 300.0: "#56B4E9", 1000.0: "#0072B2", 3000.0: "#009E73", 10000.0: "#D55E00"}
_OPEN = "#8A8A8A"
_SPANS = (6.0, 0.4)


def draw(scenarios: Path) -> Figure:
    """Voltage over stretch of the scenario's balloon on several chambers, and with the valve open.

    Parameters
    ----------
    scenarios : Path
        Folder of the scenario files.

    Returns
    -------
    matplotlib.figure.Figure
    """
    scenario = load_scenario(scenarios / SCENARIO)
    figure = Figure(figsize=(4.8, 4.2), layout="constrained")
    ax = figure.add_subplot()
    stretch, voltage, stable = open_valve(scenario)
    _line(stretch, voltage, stable, ax, _OPEN, 2.8)
    for chamber, colour in _CHAMBERS.items():
        gas = scenario.gas.model_copy(update={"chamber": chamber})
        for curve in trace_all(scenario.model_copy(update={"gas": gas})):
            _line(curve.stretch[:, 0], curve.voltage[:, 0], curve.unstable == 0, ax, colour, 1.6)
            end = curve.end
            if end.kind == "loss_of_tension" and end.voltage[0] < _SPANS[1]:
                style.cross((float(end.stretch[0]), float(end.voltage[0])), ax, colour)
    ax.set_xlim(1.0, 7.0)
    ax.set_ylim(0.0, _SPANS[1])
    ax.set_xlabel(r"stretch  $\lambda$")
    ax.set_ylabel(style.VOLTAGE)
    handles = [
        Line2D([], [], color=colour, linewidth=1.6, label=f"{chamber:g}")
        for chamber, colour in _CHAMBERS.items()
    ]
    handles.append(Line2D([], [], color=_OPEN, linewidth=2.8, label=r"$\infty$ (valve open)"))
    handles.append(Line2D([], [], color=style.INK, label="unstable", **UNSTABLE))
    handles.append(Line2D([], [], color=style.INK, marker="x", linestyle="none", label="loss of tension"))
    title = r"chamber  $V_c/(4\pi R^3)$"
    figure.legend(handles=handles, title=title, loc="outside upper center", ncols=4, frameon=False)
    return figure


def open_valve(scenario: Scenario) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Stretches, voltages and stability of the first balloon at its constant inflation pressure.

    φ² = (f − a p λ²)/(b λ³), stable while that rises.
    """
    device = Device.from_scenario(scenario)
    pressure = float(scenario.steps[0].inflate)  # type: ignore[union-attr]
    wall = device.walls[0]
    stretch = np.linspace(1.0, wall.elastomer.stretch_limit, 20_000)[1:-1]
    net = tension_force(wall.elastomer, stretch) - wall.pressure_load * pressure * stretch**2
    slope = tension_stiffness(wall.elastomer, stretch) - 2.0 * wall.pressure_load * pressure * stretch
    taut = net >= 0.0
    load = 2.0 * device.permittivity[0] / (device.thickness[0] ** 2 * device.modulus[0])
    voltage = np.where(taut, np.sqrt(np.maximum(net, 0.0) / (load * stretch**3)), np.nan)
    return stretch, voltage, np.asarray(slope * stretch - 3.0 * net > 0.0)


def _line(
    stretch: FloatArray, voltage: FloatArray, stable: FloatArray, ax: Axes, colour: str, width: float
) -> None:
    """A curve: solid where it is stable, dashed where not."""
    keep = style.thin(stretch, np.nan_to_num(voltage), _SPANS)
    stretch, voltage, stable = stretch[keep], voltage[keep], stable[keep]
    for wanted, looks in ((True, {"linewidth": width}), (False, {**UNSTABLE, "linewidth": 0.7 * width})):
        shown = stable == wanted
        # Where a curve turns stable both styles reach the same point.
        reach = shown | np.append(shown[1:], False)
        ax.plot(stretch, np.where(reach, voltage, np.nan), color=colour, **looks)
