"""The graph of a device's stable states: a walk from the sealed state, breadth first."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.analysis.path import whole_path
from simulator.analysis.shapes import lost_on
from simulator.analysis.start import rests
from simulator.events import EventKind
from simulator.hysteresis.landscape import DOWN, UP, Departure, Landscape, Stay
from simulator.hysteresis.setting import Setting, setting
from simulator.results.loops import snapping
from simulator.results.states import Direction, State, StateGraph, Transition
from simulator.scenario import Problem, ScenarioError, dimensionless, load_scenario
from simulator.simulation.atlas import Atlas
from simulator.units import VOLTAGE

if TYPE_CHECKING:
    from simulator.scenario import Scenario, ScenarioLike

FloatArray = NDArray[np.float64]

_SHOWN = 65  # points of a state


def states(
    scenario: ScenarioLike,
    *,
    low: float | str = 0.0,
    high: float | str | None = None,
    along: Mapping[str, float] | None = None,
    every: bool = False,
) -> StateGraph:
    """The stable states that a drive between two voltages can reach from the sealed state, as a graph.

    Beginning in the state that the scenario's inflations lead to, each state is followed up and down in
    voltage to where it ends, and left there as a history leaves it.

    Parameters
    ----------
    scenario : Scenario, path or mapping
    low, high : float or str
        The range of the drive, over H√(μ/ε); with [scales] also texts with a unit. By default `high` is the
        highest voltage of the scenario's own steps.
    along : mapping of str to float, optional
        The share of the drive that each electroded balloon has, by its name. By default the line on which
        the scenario's steps move the voltages; where none does, one voltage on all.
    every : bool
        Also the states that no drive between the two leads to: those on equilibrium paths that come to zero
        voltage, and what they lead to. With the valve closed only.

    Returns
    -------
    StateGraph

    Raises
    ------
    ScenarioError
        If the scenario has no such drive (`docs/hysteresis.md`), the range makes no sense, or the device
        ends below `low`.
    ArithmeticError
        If the solver fails.

    Examples
    --------
    >>> graph = states("scenarios/fig5c_state_a.toml")
    >>> [(state.number, round(state.low, 6), round(state.high, 6)) for state in graph.states]
    [(0, 0.0, 0.496198), (1, 0.263329, 0.6)]
    >>> up, down = graph.transitions
    >>> up.balloons, round(up.drive, 6), round(down.drive, 6), round(up.dissipated + down.dissipated, 6)
    (('active',), 0.496198, 0.263329, 40.783907)
    """
    scenario = load_scenario(scenario)
    begin = setting(scenario, along)
    bottom, top = drive_range(scenario, begin, low, high)
    landscape = Landscape(begin, Atlas(scenario.solver.rtol), bottom, top)
    first = first_state(scenario, landscape)
    _explore(landscape, 0)
    reached = len(landscape.stays)
    if every:
        _add_others(scenario, landscape)
    return _graph(scenario, landscape, first, reached, complete=every)


def drive_range(
    scenario: Scenario, begin: Setting, low: float | str, high: float | str | None
) -> tuple[float, float]:
    """The range of a drive, dimensionless. Raises ScenarioError where it is none."""
    bottom = dimensionless(scenario, "low", low, VOLTAGE, 0.0)
    if high is None:
        top = begin.highest
        if top <= 0.0:
            raise ScenarioError(
                scenario.file, Problem("high", None, "is needed: the scenario's steps raise no voltage")
            )
        high = top
    else:
        top = dimensionless(scenario, "high", high, VOLTAGE, 0.0)
    if top <= bottom:
        raise ScenarioError(scenario.file, Problem("high", high, f"must be > low, which is {bottom:.12g}"))
    return bottom, top


def first_state(scenario: Scenario, landscape: Landscape) -> Stay:
    """Where the drive begins. Raises ScenarioError where the device ends before."""
    first = landscape.start()
    if isinstance(first, Stay):
        return first
    end = first.rest.end if first.rest is not None and first.rest.end is not None else first.kind
    raise ScenarioError(
        scenario.file,
        Problem(
            "low",
            landscape.low,
            f"must be < {first.before[-1]:.12g}, where a rising voltage ends the device: "
            f"{EventKind(end).value.replace('_', ' ')}",
        ),
    )


def _explore(landscape: Landscape, number: int) -> None:
    """Leave all states from a number on in both directions, and those that are found on the way."""
    while number < len(landscape.stays):
        for direction in (UP, DOWN):
            landscape.departure(landscape.stays[number], direction)
        number += 1


def _add_others(scenario: Scenario, landscape: Landscape) -> None:
    """Add the stable parts of all paths that come to zero voltage, and the states that they lead to."""
    begin = landscape.setting
    group = begin.groups[0]
    if group.equations.is_open:
        raise ScenarioError(
            scenario.file,
            Problem("all", None, "needs a closed valve: with it open, balloons are on their own"),
        )
    known: list[FloatArray] = []
    for rest in rests(begin.device, group.equations.gas):  # type: ignore[union-attr]
        if any(np.abs(rest - state).max() < 1e-7 for state in known):
            continue
        path = whole_path(group, rest, to_drive=None)
        known += [path.pieces[0].states[:, 0], path.pieces[-1].states[:, -1]]
        for piece in path.pieces:
            v = piece.states[-1]
            inside = np.flatnonzero((v >= landscape.low) & (v <= landscape.high))
            if piece.unstable == 0 and inside.size:
                # Away from the ends, where it may be singular.
                middle = piece.states[:, inside[inside.size // 2]]
                if group.conditions[0].margin(middle.tolist()) > 0.0:
                    before = len(landscape.stays)
                    landscape.stay([landscape.atlas.branch_at(group, middle)])
                    _explore(landscape, before)


def _graph(
    scenario: Scenario, landscape: Landscape, first: Stay, reached: int, *, complete: bool
) -> StateGraph:
    begin = landscape.setting
    # Those that no way leads to were found in an order that depends on that of the balloons.
    others = sorted(landscape.stays[reached:], key=lambda stay: (round(stay.low, 9), round(stay.high, 9)))
    stays = [*landscape.stays[:reached], *others]
    numbers = {stay.number: number for number, stay in enumerate(stays)}
    transitions = [
        _transition(landscape, stay, departure, "up" if direction > 0.0 else "down", numbers)
        for stay in stays
        for direction in (UP, DOWN)
        if (departure := landscape.departure(stay, direction)) is not None
    ]
    device = begin.device
    return StateGraph(
        title=scenario.title,
        balloons=device.names,
        electroded=tuple(device.names[i] for i in device.electroded),
        share=np.array(begin.line.rate),
        low=landscape.low,
        high=landscape.high,
        start=first.number,
        states=tuple(_state(scenario, landscape, stay, i, i < reached) for i, stay in enumerate(stays)),
        transitions=tuple(transitions),
        complete=complete,
        radius=device.radius,
        scales=scenario.scales,
    )


def _state(scenario: Scenario, landscape: Landscape, stay: Stay, number: int, reachable: bool) -> State:
    # Closer together at both ends, where stretches may run away from the voltage.
    share = 0.5 - 0.5 * np.cos(np.linspace(0.0, math.pi, _SHOWN))
    v = stay.low + share * (stay.high - stay.low)
    v[-1] = stay.high
    states = [branch.at(v) for branch in stay.branches]
    stretch, pressure = landscape.setting.states(states)
    lost = np.zeros(v.size, dtype=bool)
    if scenario.shape.on_loss != "ignore":
        for group, y in zip(landscape.setting.groups, states, strict=True):
            lost |= lost_on(group, y)
    return State(number, reachable, v, stretch, pressure, lost)


def _transition(
    landscape: Landscape,
    stay: Stay,
    departure: Departure,
    direction: Direction,
    numbers: Mapping[int, int],
) -> Transition:
    begin = landscape.setting
    before = [branch.state_at(departure.v) for branch in stay.branches]
    after = list(before)
    goes_on, lost = True, 0.0
    for place, exit in departure.exits.items():
        before[place] = exit.before
        if exit.rest is None or exit.runs_away:
            goes_on = False
        else:
            after[place] = exit.rest.state
            lost += exit.dissipated
    stretch, pressure = begin.states([y[:, None] for y in before])
    landed, pressed = begin.states([y[:, None] for y in after])
    return Transition(
        source=numbers[stay.number],
        target=None if departure.target is None else numbers[departure.target.number],
        direction=direction,
        kind=departure.kind,
        ending=departure.ending,
        drive=departure.v,
        voltage=begin.line.at(departure.v),
        balloons=snapping(begin.device.names, stretch[0], landed[0]) if goes_on else (),
        stretch_before=stretch[0],
        stretch_after=landed[0] if goes_on else None,
        pressure_before=float(pressure[0]),
        pressure_after=float(pressed[0]) if goes_on else None,
        dissipated=lost if goes_on else None,
    )
