"""Fig. 4: the snap of Fig. 3c, state B, in the pressures of both balloons and in the voltage."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from simulator.analysis.trace import trace, trace_inflation
from simulator.model.device import Device
from simulator.model.elastomers import tension_force
from simulator.scenario import load_scenario
from tests.pairs import run
from tests.studies.figures import style
from tests.studies.figures.actuation import plot_snaps, plot_state, snaps
from tests.studies.figures.inflation import plot_inflation

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from simulator.scenario import Scenario
    from tests.studies.figures.style import FloatArray

SCENARIO = "fig3c_state_b.toml"

_VOLTAGES = {0.0: 4.1, 0.2: 4.6, 0.3: 2.82, 0.45: 1.95}  # each with the stretch where its curve is labelled
_HIGHEST = 1.4
_COLOUR = style.COLOURS["B"]
_GREYS = ("#9A9A9A", "#858585", "#6A6A6A", "#4D4D4D")


def draw_pressures_of_active(scenarios: Path) -> Figure:
    """Fig. 4a: the membrane's pressure at several voltages, and the gas's, touching at the critical one."""
    figure, ax = style.panel()
    scenario = load_scenario(scenarios / SCENARIO)
    event, after = snaps(run(scenario))[0]
    critical = float(event.voltage[0])
    for (voltage, place), colour in zip(_VOLTAGES.items(), _GREYS, strict=True):
        stretch, pressure = membrane_pressure(scenario, voltage)
        ax.plot(stretch, pressure, color=colour, linewidth=1.0)
        _label(f"{voltage:g}", place, float(np.interp(place, stretch, pressure)), ax, colour)
    stretch, pressure = membrane_pressure(scenario, critical)
    ax.plot(stretch, pressure, color=_COLOUR, linewidth=1.9)
    _label(f"{critical:.4f}", 2.75, float(np.interp(2.75, stretch, pressure)), ax, _COLOUR)
    stretch, pressure = gas_pressure(scenario)
    ax.plot(stretch, pressure, color=style.INK, linewidth=1.3, linestyle=(0, (5, 2)))
    near = int(np.argmin(np.abs(pressure - 1.1)))
    ax.annotate(
        "gas, with the passive balloon",
        (float(stretch[near]), float(pressure[near])),
        xytext=(2.6, 1.25),
        va="center",
        arrowprops={"arrowstyle": "-", "color": style.INK, "linewidth": 0.7, "shrinkB": 2.0},
    )
    ax.text(2.6, 1.05, "membrane, at the voltage\nwritten on it", va="center")
    before = float(event.stretch_before[0]), event.pressure_before
    _point("O", before, ax, (-8.0, -8.0))
    _point("O\u2032", (float(after[0]), float(event.pressure_after or 0.0)), ax, (17.0, -9.0))
    ax.set_xlim(0.5, 8.0)
    ax.set_ylim(-0.2, _HIGHEST)
    ax.axhline(0.0, color=style.INK, linewidth=0.6)
    ax.set_xlabel(style.ACTIVE)
    ax.set_ylabel(style.PRESSURE)
    return figure


def draw_voltage(scenarios: Path) -> Figure:
    """Fig. 4b: voltage over stretch of the active balloon, with the snap from O to O′."""
    figure, ax = style.panel()
    scenario = load_scenario(scenarios / SCENARIO)
    curve, history = trace(scenario), run(scenario)
    plot_state("B", (curve,), ax, 0.6)
    plot_snaps(history, ax)
    event, after = snaps(history)[0]
    voltage = float(event.voltage[0])
    _point("O", (float(event.stretch_before[0]), voltage), ax, (0.0, 12.0))
    _point("O\u2032", (float(after[0]), voltage), ax, (10.0, -5.0))
    style.state("B", (float(curve.stretch[0, 0]), 0.0), ax, (10.0, 9.0))
    ax.set_xlim(0.5, 8.0)
    ax.set_ylim(0.0, 0.6)
    ax.set_xlabel(style.ACTIVE)
    ax.set_ylabel(style.VOLTAGE)
    style.key(
        ax, "stable", "unstable", "snap", "star", "cross", loc="center", bbox_to_anchor=(0.5, 0.2), ncols=2
    )
    return figure


def draw_pressures_of_passive(scenarios: Path) -> Figure:
    """Fig. 4c: the passive balloon's pressure over its stretch, from O to O′."""
    figure, ax = style.panel()
    scenario = load_scenario(scenarios / SCENARIO)
    history = run(scenario)
    plot_inflation(trace_inflation(scenario, "passive", to_stretch=1.6), ax, style.INK)
    event, after = snaps(history)[0]
    start = float(event.stretch_before[1]), event.pressure_before
    end = float(after[1]), float(event.pressure_after or 0.0)
    _point("O", start, ax, (-10.0, 4.0))
    _point("O\u2032", end, ax, (-12.0, 4.0))
    first = int(np.flatnonzero(history.step == 1)[-1])
    style.state("B", (float(history.stretch[first, 1]), float(history.pressure[first])), ax, (-9.0, 8.0))
    ax.annotate(
        "",
        xy=(end[0] + 0.022, end[1] + 0.02),
        xytext=(start[0] + 0.022, start[1]),
        arrowprops={"arrowstyle": "-|>,head_length=0.5,head_width=0.2", "color": style.SNAP,
                    "linewidth": 1.1, "linestyle": (0, (5, 3)), "mutation_scale": 13.0,
                    "connectionstyle": "arc3,rad=-0.12"},
    )  # fmt: skip
    ax.set_xlim(0.95, 1.6)
    ax.set_ylim(-0.05, _HIGHEST)
    ax.set_xlabel(style.PASSIVE)
    ax.set_ylabel(style.PRESSURE)
    return figure


def membrane_pressure(scenario: Scenario, voltage: float) -> tuple[FloatArray, FloatArray]:
    """Stretches and the pressure (f − 2φ²λ³)/λ² that holds the active balloon there (Eq. 5)."""
    device = Device.from_scenario(scenario)
    stretch = np.linspace(1.0, 7.12, 400)
    force = tension_force(device.elastomers[0], stretch)
    return stretch, (force - 2.0 * voltage**2 * stretch**3) / (device.radius[0] * stretch**2)


def gas_pressure(scenario: Scenario) -> tuple[FloatArray, FloatArray]:
    """Stretches of the active balloon and the gas's own pressure there (Eqs. 6 and 8).

    The passive balloon is eliminated: its stretch says what the pressure is, and the gas law what room
    that leaves to the active one.
    """
    device = Device.from_scenario(scenario)
    curve = trace(scenario)
    amount = 3.0 * (curve.pressure[0] + device.ambient) * device.volume(curve.stretch[:1])[0]
    passive = 1.0 + np.concatenate([[0.0], np.geomspace(1e-6, 0.395, 500)])
    pressure = tension_force(device.elastomers[1], passive) / passive**2
    cube = (amount / (pressure + device.ambient) - passive**3) / device.radius[0] ** 3
    room = cube > 0.9
    return np.cbrt(cube[room]), pressure[room]


def _label(text: str, x: float, y: float, ax: Axes, colour: str) -> None:
    """Write on a line, which stops for it."""
    around = {"boxstyle": "square,pad=0.1", "facecolor": "white", "edgecolor": "none"}
    ax.text(x, y, text, color=colour, fontsize=9.5, ha="center", va="center", bbox=around, zorder=3)


def _point(name: str, at: tuple[float, float], ax: Axes, offset: tuple[float, float]) -> None:
    ax.plot(*at, marker="o", markersize=5.5, color=style.INK, markeredgecolor="white", zorder=7)
    ax.annotate(
        name, at, xytext=offset, textcoords="offset points", fontsize=12, ha="center", va="center", zorder=7
    )
