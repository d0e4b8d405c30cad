"""Where the paths of a scenario in voltage begin: the state after its inflations, and others like it."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.model import groups
from simulator.model.conditions import ENDLESS
from simulator.model.contents import Contents, Supply
from simulator.model.device import Device
from simulator.model.drive import VoltageLine
from simulator.model.elastomers import largest_stretch
from simulator.model.groups import Group
from simulator.results.history import Outcome
from simulator.scenario import Hold, Inflate, Problem, ScenarioError, Shape
from simulator.simulation.run import simulate
from simulator.solver import newton
from simulator.solver.follow import PathError
from simulator.solver.newton import NotConverged

if TYPE_CHECKING:
    from simulator.scenario import PlayedStep, Scenario

FloatArray = NDArray[np.float64]


def sealed_state(scenario: Scenario) -> tuple[Device, Group, FloatArray]:
    """Where the path of a scenario in voltage begins.

    The inflations that the scenario begins with are played, as quasi-static even with `[dynamics]`. What the
    balloons share is then what the scenario goes on with: the contents as they are sealed in that state, or,
    where its voltages move with `valve = "open"`, a supply at the pressure reached.

    Returns
    -------
    device : Device
    group : Group
        The equations of all balloons, one voltage on all electrodes.
    state : (n_unknowns,) array
        Stretches, pressure and voltage 0.

    Raises
    ------
    ScenarioError
        If no balloon has electrodes, the scenario does not begin by inflating, an inflation ends in an event,
        or voltages move both with the valve open and with it closed.
    PathError
        If the state reached is no equilibrium to rounding.
    """
    steps = list(scenario.played_steps())
    count = next((i for i, step in enumerate(steps) if not isinstance(step, Inflate)), len(steps))
    if not scenario.electroded:
        raise ScenarioError(
            scenario.file, Problem("balloon", None, "one needs electrodes = true for a path in voltage")
        )
    if count == 0:
        raise ScenarioError(
            scenario.file, Problem("step.1", None, "must be an inflate step for a path in voltage")
        )
    is_open = _is_open(scenario, steps[count:])
    only = {"steps": tuple(steps[:count]), "dynamics": None, "shape": Shape(on_loss="ignore")}
    history = simulate(scenario.model_copy(update=only))
    if history.outcome is not Outcome.COMPLETED:
        event = history.events[-1]
        end = f"{_with_article(event.kind.value)} at p = {event.pressure_before:.6g}"
        raise ScenarioError(
            scenario.file,
            Problem(
                f"step.{event.step}.inflate",
                steps[event.step - 1].inflate,  # type: ignore[union-attr]
                f"the inflation ends in {end}: there is no state for a path in voltage",
            ),
        )
    pressure = float(history.pressure[-1])
    if pressure <= 0.0:
        raise ScenarioError(
            scenario.file, Problem(f"step.{count}.inflate", 0.0, "must be > 0 for a path in voltage")
        )
    device = Device.from_scenario(scenario)
    swelling = float(device.swelling(history.stretch[-1:])[0])
    gas = Supply(pressure) if is_open else device.law.sealed(pressure, swelling)
    group = groups.held(device, VoltageLine.common(len(device.electroded)), gas=gas)
    start = np.array([*history.stretch[-1], pressure, 0.0])
    try:
        return device, group, newton.one_at_drive(group.equations, start)
    except NotConverged as failure:
        raise PathError(f"the state at the end of step {count} is no equilibrium to rounding") from failure


def _is_open(scenario: Scenario, steps: list[PlayedStep]) -> bool:
    """Whether the steps after the inflations move the voltages with the valve open; closed if none does."""
    moving = [(i, step.valve) for i, step in enumerate(steps) if not isinstance(step, Inflate | Hold)]
    valves = {valve for _, valve in moving}
    if len(valves) > 1:
        other = next(i for i, valve in moving if valve != moving[0][1])
        number = len(list(scenario.played_steps())) - len(steps) + other + 1
        raise ScenarioError(
            scenario.file,
            Problem(
                f"step.{number}.valve",
                dict(moving)[other],
                "must be that of the other steps that move voltages, for a path in voltage",
            ),
        )
    return valves == {"open"}


def _with_article(kind: str) -> str:
    words = kind.replace("_", " ")
    return words if kind in ("breakdown", "loss_of_tension", "out_of_range") else f"a {words}"


def rests(device: Device, gas: Contents) -> list[FloatArray]:
    """All equilibria of a device on its contents at zero voltage, stable or not.

    Every balloon lies on its own inflation curve p(λ), at one common pressure p; on the monotone parts of
    these curves λ is a function of p, and the law of the contents one equation for p in each combination of
    parts.

    Returns
    -------
    list of (n_balloons + 2,) arrays
        Stretches, pressure and 0.
    """
    parts = [_monotone_parts(device, i) for i in range(len(device.names))]
    group = groups.held(device, VoltageLine.common(len(device.electroded)), gas=gas)
    found: list[FloatArray] = []
    for combination in itertools.product(*parts):
        low = max(part[1][0] for part in combination)
        high = min(part[1][-1] for part in combination)
        if low >= high:
            continue
        pressures = np.unique(np.concatenate([part[1] for part in combination]))
        pressures = np.concatenate([[low], pressures[(pressures > low) & (pressures < high)], [high]])
        stretches = np.array([np.interp(pressures, part[1], part[0]) for part in combination])
        with np.errstate(over="ignore"):  # exponential walls have curves up to the largest numbers
            excess = np.asarray(gas.defect(pressures, device.radius**3 @ stretches**3))
        signs = np.sign(excess)
        for i in np.flatnonzero(signs[:-1] * signs[1:] <= 0.0):
            share = excess[i] / (excess[i] - excess[i + 1]) if excess[i] != excess[i + 1] else 0.0
            guess = np.array([*stretches[:, i], pressures[i]])
            guess += share * (np.array([*stretches[:, i + 1], pressures[i + 1]]) - guess)
            try:
                rest = newton.one_at_drive(group.equations, np.append(guess, 0.0))
            except NotConverged:
                continue
            if not any(np.abs(rest - other).max() < 1e-8 for other in found):
                found.append(rest)
    return found


def _monotone_parts(device: Device, balloon: int) -> list[tuple[FloatArray, FloatArray]]:
    """Stretches and pressures, pressures rising, along each monotone part of a balloon's inflation curve."""
    wall = device.walls[balloon]
    limit = min(wall.elastomer.stretch_limit, largest_stretch(wall.elastomer))
    top = limit * (1.0 - 1e-9) if np.isfinite(limit) else ENDLESS
    stretches = np.concatenate(
        [np.geomspace(1.0, 0.99 * top, 4000), top - np.geomspace(0.01 * top, 1e-9 * top, 400)[1:]]
    )
    with np.errstate(over="ignore"):  # a wall that stiffens exponentially has no end, but floats have
        numerator, denominator = wall.elastomer.pole_form(stretches)
        pressures = numerator / denominator / (wall.pressure_load * stretches**2)
    finite = np.isfinite(pressures)
    stretches, pressures = stretches[finite], pressures[finite]
    turns = np.flatnonzero(np.diff(np.sign(np.diff(pressures)))) + 1
    pieces = zip([0, *turns], [*turns, stretches.size - 1], strict=True)
    parts = [(stretches[i : j + 1], pressures[i : j + 1]) for i, j in pieces]
    return [part if part[1][0] < part[1][-1] else (part[0][::-1], part[1][::-1]) for part in parts]
