"""What the paper cannot show: voltage up, held and off again in time, and the work lost on the way."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from simulator.results.plot import plot_loop, plot_pressure, plot_stretches, plot_voltage
from simulator.results.plot.style import COLOURS, VOLTAGE, dress, mark, marker_style
from simulator.scenario import Output, load_scenario
from tests.pairs import run
from tests.studies.figures.style import INK, SNAP

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from simulator.results.history import History

_POINTS = 301  # samples per step, so that a loop is smooth at its limit points


def draw(scenarios: Path, name: str) -> Figure:
    """A history of a scenario: voltage, pressure and stretches in time; both of its loops.

    Parameters
    ----------
    scenarios : Path
        Folder of the scenario files.
    name : str
        Of the scenario file, without its ending.

    Returns
    -------
    matplotlib.figure.Figure
    """
    scenario = load_scenario(scenarios / f"{name}.toml")
    history = run(scenario.model_copy(update={"output": Output(points=_POINTS)}))
    figure = Figure(figsize=(7.6, 5.6), layout="constrained")
    halves = figure.add_gridspec(1, 2, width_ratios=[1.0, 1.05])
    rows = halves[0].subgridspec(3, 1, height_ratios=[1.0, 1.5, 1.0])
    times = [figure.add_subplot(rows[0])]
    times += [figure.add_subplot(rows[i], sharex=times[0]) for i in (1, 2)]
    plot_voltage(history, times[0])
    plot_stretches(history, times[1])
    plot_pressure(history, times[2])
    for ax in times[:-1]:
        ax.tick_params(labelbottom=False)
        ax.set_xlabel("")
    figure.align_ylabels(times)
    loops = halves[1].subgridspec(2, 1)
    plot_loop(history, figure.add_subplot(loops[0]))
    plot_charge_loop(history, figure.add_subplot(loops[1]))
    figure.suptitle(scenario.title, parse_math=False, fontsize=12.5, fontweight="bold")
    _key(history, figure)
    return figure


def plot_charge_loop(history: History, ax: Axes) -> Axes:
    """Draw voltage over charge of the first electroded balloon; the area inside is the work the supply lost.

    Parameters
    ----------
    history : History
    ax : matplotlib.axes.Axes

    Returns
    -------
    matplotlib.axes.Axes
        The same axes.
    """
    sealed = history.step > 1  # the paper's scenarios inflate in their first step
    charge, voltage, branches = history.charge[sealed, 0], history.voltage[sealed, 0], history.branch[sealed]
    times = history.time[sealed]
    colour = COLOURS[history.balloons.index(history.electroded[0])]
    ax.fill(charge, voltage, color=colour, alpha=0.15, linewidth=0.0)
    for branch in np.unique(branches):
        on = branches == branch
        ax.plot(charge[on], voltage[on], color=colour, linewidth=1.8, solid_capstyle="round")
    for i in np.flatnonzero(np.diff(branches)):
        ends = slice(i, i + 2)
        ax.plot(charge[ends], voltage[ends], color=colour, linewidth=1.2, linestyle="--")
        kind = next(event.kind for event in history.events if event.time == times[i])
        mark(kind, float(charge[i]), float(voltage[i]), ax)
    work = history.energy_balance.electrical_work
    lost = sum(event.dissipated or 0.0 for event in history.events if event.step > 1)
    books = f"{lost:.2f} lost, {work - lost:+.2f} stored" if abs(work - lost) > 1e-3 else "lost in the snaps"
    books = books.replace("-", "\u2212")
    area = rf"$\oint\Phi\,\mathrm{{d}}Q$ = {work:.2f}"
    ax.text(0.97, 0.06, f"{area}\n{books}", transform=ax.transAxes, ha="right", va="bottom", color=INK)
    ax.set_xlabel(f"charge on {history.electroded[0]}  Q/(4πR²√(εμ))")
    ax.set_ylabel(f"voltage  {VOLTAGE}")
    ax.margins(0.06)
    return dress(ax)


def _key(history: History, figure: Figure) -> None:
    handles = [
        Line2D([], [], color=COLOURS[i], linewidth=1.8, label=f"{name} balloon")
        for i, name in enumerate(history.balloons)
    ]
    handles.append(Line2D([], [], color=SNAP, linewidth=1.2, linestyle="--", label="snap"))
    for kind in dict.fromkeys(event.kind for event in history.events):
        handles.append(Line2D([], [], label=kind.replace("_", " "), **marker_style(kind)))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
