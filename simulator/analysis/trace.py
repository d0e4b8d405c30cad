"""The whole equilibrium path with the drive free: through limit points, stable and unstable alike.

A history shows what happens; the path shows why. Where the path ends is said, and why.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.analysis.closer import closer
from simulator.analysis.path import Path, PathPoints, stretch_stop, whole_path
from simulator.analysis.shapes import lost_on, shape_points
from simulator.analysis.start import rests, sealed_state
from simulator.model import groups
from simulator.model.conditions import conditions
from simulator.model.device import Device
from simulator.model.drive import VoltageLine
from simulator.model.equations import SealedBalloons
from simulator.model.groups import Group
from simulator.results.curve import Curve, SpecialPoint, farthest_shown
from simulator.scenario import Problem, ScenarioError, dimensionless, load_scenario
from simulator.units import PRESSURE, VOLTAGE

if TYPE_CHECKING:
    from simulator.scenario import Scenario, ScenarioLike

FloatArray = NDArray[np.float64]

__all__ = ["rests", "sealed_state", "trace", "trace_all", "trace_inflation"]


def trace(
    scenario: ScenarioLike,
    *,
    to_voltage: float | str | None = None,
    to_stretch: float | None = None,
) -> Curve:
    """The equilibrium path of a scenario in voltage, one voltage on all electrodes.

    It begins in the state that the scenario's inflations lead to. From there on the valve is closed, or open
    where the scenario moves its voltages with `valve = "open"`.

    Parameters
    ----------
    scenario : Scenario, path or mapping
    to_voltage : float or str, optional
        Voltage at which to stop, over H√(μ/ε); with [scales] also a text with a unit.
    to_stretch : float, optional
        Stretch of the first balloon with electrodes at which to stop.

    Returns
    -------
    Curve
        It ends where asked, or where tension is lost, a stretch comes within 1e-6 of its limit, to 1000
        where the elastomer has none or to the end of its measured curve, or where the path comes back to
        zero voltage (where it meets its mirror image) or to a branch point for the second time.

    Raises
    ------
    ScenarioError
        If no balloon has electrodes, the scenario does not begin by inflating, an inflation ends in an event,
        voltages move both with the valve open and with it closed, or a place to stop makes no sense.
    PathError
        If the path cannot be followed.

    Examples
    --------
    >>> curve = trace("scenarios/fig3c_state_b.toml")
    >>> [(p.kind, round(float(p.voltage[0]), 6)) for p in curve.points if p.balloon is None]
    [('limit_point', 0.360441), ('limit_point', 0.270291), ('loss_of_tension', 0.500372)]
    """
    scenario = load_scenario(scenario)
    to_drive = None if to_voltage is None else dimensionless(scenario, "to_voltage", to_voltage, VOLTAGE, 0.0)
    _check_stretch(scenario, to_stretch)
    device, group, start = sealed_state(scenario)
    return _traced(scenario, device, group, start, to_drive, to_stretch)


def trace_all(scenario: ScenarioLike) -> tuple[Curve, ...]:
    """The path of `trace`, and those detached from it on the same contents.

    The detached ones are those through any other equilibrium at zero voltage. Raises as `trace`.
    """
    scenario = load_scenario(scenario)
    device, group, start = sealed_state(scenario)
    curves = [_traced(scenario, device, group, start, None, None)]
    for rest in rests(device, group.equations.gas):  # type: ignore[union-attr]
        met = np.array([curve.stretch[i] for curve in curves for i in (0, -1)])
        if np.min(np.max(np.abs(met - rest[: met.shape[1]]), axis=1)) > 1e-7:
            curves.append(_traced(scenario, device, group, rest, None, None))
    return tuple(curves)


def trace_inflation(
    scenario: ScenarioLike,
    balloon: str | None = None,
    *,
    to_pressure: float | str | None = None,
    to_stretch: float | None = None,
) -> Curve:
    """The curve of one balloon under pressure from the stress-free state, over peak and valley; no voltage.

    Parameters
    ----------
    scenario : Scenario
    balloon : str, optional
        Name; default the last one (in the paper the passive, reference balloon).
    to_pressure : float or str, optional
        Pressure at which to stop, over μH/R; with [scales] also a text with a unit.
    to_stretch : float, optional
        Stretch at which to stop.

    Returns
    -------
    Curve
        It ends where asked, or where the stretch comes within 1e-6 of its limit, to 1000 where the
        elastomer has none, or to the end of its measured curve.

    Raises
    ------
    ScenarioError
        If there is no balloon of that name, or a place to stop makes no sense.
    PathError
        If the path cannot be followed.
    """
    scenario = load_scenario(scenario)
    device = Device.from_scenario(scenario)
    if balloon is not None and balloon not in device.names:
        raise ScenarioError(
            scenario.file, Problem("balloon", balloon, f"must be one of {', '.join(device.names)}")
        )
    to_drive = (
        None if to_pressure is None else dimensionless(scenario, "to_pressure", to_pressure, PRESSURE, 0.0)
    )
    _check_stretch(scenario, to_stretch)
    place = device.names.index(balloon) if balloon is not None else len(device.names) - 1
    device = device.bare(place)
    (group,) = groups.inflating(device, VoltageLine.common(0))
    return _traced(scenario, device, group, np.array([1.0, 0.0]), to_drive, to_stretch)


def _check_stretch(scenario: Scenario, to_stretch: float | None) -> None:
    if to_stretch is not None and not (math.isfinite(to_stretch) and to_stretch >= 1.0):
        raise ScenarioError(scenario.file, Problem("to_stretch", to_stretch, "must be a number >= 1"))


def _traced(
    scenario: Scenario,
    device: Device,
    group: Group,
    start: FloatArray,
    to_drive: float | None,
    to_stretch: float | None,
) -> Curve:
    """The path from a state at which v begins to rise, as a result."""
    alone, state, places = _apart(group, start)
    place = places[device.electroded[0]] if device.electroded else 0
    stop = None
    if to_stretch is not None:
        stop = stretch_stop("reached", place, to_stretch, 1.0 if to_stretch > state[place] else -1.0)
    path = whole_path(alone, state, to_drive=to_drive, stop=stop)
    return _curve(scenario, device, group, path if alone is group else path.of_all(group.equations, places))


def _apart(group: Group, start: FloatArray) -> tuple[Group, FloatArray, list[int]]:
    """The balloons that move by themselves, their state, and which unknown is which unknown of all.

    With the valve open equal balloons in one state go one way, and turn at one voltage: a path of all of them
    would be singular there in more than one direction. One of them stands for the others.
    """
    equations = group.equations
    if not (isinstance(equations, SealedBalloons) and equations.is_open):
        return group, start, list(range(start.size))
    kinds = [(m, round(float(x), 9)) for m, x in zip(equations.membranes, start, strict=False)]
    distinct = list(dict.fromkeys(kinds))
    chosen = [kinds.index(kind) for kind in distinct]
    alone = SealedBalloons(tuple(membrane for membrane, _ in distinct), equations.gas)
    return (
        Group(alone, conditions(alone, [None] * len(chosen)), tuple(group.members[i] for i in chosen)),
        np.array([*start[chosen], *start[-2:]]),
        [*(distinct.index(kind) for kind in kinds), -2, -1],
    )


def _closer(device: Device, group: Group, path: Path) -> PathPoints:
    """The points of a path, close enough for a picture."""
    equations = group.equations
    place = device.electroded[0] if device.electroded else 0

    def drive(states: FloatArray) -> FloatArray:
        return states[-1] if device.electroded else np.asarray(equations.pressure(states))

    def quantities(states: FloatArray) -> FloatArray:
        stretch = states[: len(device.names)].T
        voltage = np.repeat(states[-1:].T, len(device.electroded), axis=1)
        own = device.field(stretch, voltage), device.charge(stretch, voltage)
        return np.column_stack([stretch, equations.pressure(states), voltage, *own])

    points = path.points(equations.scales)
    marked = drive(np.array([found.state for found in path.found]).T)[:-1].tolist()
    far = farthest_shown(drive(points.states), points.states[place], marked, path.found[-1].kind)
    return closer(equations, points, quantities, 1.05 * far, drive)


def _curve(scenario: Scenario, device: Device, group: Group, path: Path) -> Curve:
    """Points and special points of a path, with everything derived from them."""
    equations, many = group.equations, len(device.electroded)
    points = _closer(device, group, path)
    stretch = points.states[: len(device.names)].T
    voltage = np.repeat(points.states[-1:].T, many, axis=1)
    pressure = np.asarray(equations.pressure(points.states))
    gas = np.asarray(device.law.amount(pressure, device.volume(stretch)))
    is_open = np.full(len(stretch), equations.is_open)
    watched = scenario.shape.on_loss != "ignore"
    special = [
        SpecialPoint(
            found.kind,
            points.ends[found.pieces - 1],
            np.full(many, found.state[-1]),
            found.state[: len(device.names)],
            float(equations.pressure(found.state)),
        )
        for found in path.found
    ]
    shapes = [
        SpecialPoint(
            found.kind.value,
            found.arclength,
            np.full(many, found.state[-1]),
            found.state[: len(device.names)],
            float(equations.pressure(found.state)),
            device.names[found.balloon],
            found.mode,
        )
        for found in (shape_points(group, points) if watched else ())
    ]
    inner = sorted([*special[:-1], *shapes], key=lambda point: point.arclength)
    return Curve(
        title=scenario.title,
        balloons=device.names,
        electroded=tuple(device.names[i] for i in device.electroded),
        arclength=points.arclength,
        voltage=voltage,
        stretch=stretch,
        pressure=pressure,
        field=device.field(stretch, voltage),
        charge=device.charge(stretch, voltage),
        energy=device.energy(stretch, pressure, voltage, gas, is_open),
        stability=device.stability(stretch, pressure, voltage, is_open),
        unstable=points.unstable,
        points=(*inner, special[-1]),
        ida_steps=path.effort.ida_steps,
        radius=device.radius,
        scales=scenario.scales,
        sphericity=device.sphericity(stretch, voltage) if watched else np.empty((0, 0)),
        lost=lost_on(group, points.states) if watched else np.zeros(len(stretch), dtype=bool),
    )
