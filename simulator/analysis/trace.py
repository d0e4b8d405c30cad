"""The whole equilibrium path with the drive free: through limit points, stable and unstable alike.

A history shows what happens; the path shows why. It is followed with the machinery of the histories
(`follow`), one monotone piece after the other: at each limit point v turns round and the number of
unstable directions changes by one. Where the path ends is said, and why.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.model import groups
from simulator.model.conditions import ENDLESS, Condition, eigenvalues, singularity
from simulator.model.contents import Contents
from simulator.model.device import Device
from simulator.model.drive import VoltageLine
from simulator.model.elastomers import Number, largest_stretch
from simulator.model.equations import OpenBalloon, SealedBalloons, State
from simulator.model.groups import AnyEquations, Group
from simulator.model.membranes import ElectrodedMembrane
from simulator.results.curve import Curve, SpecialPoint
from simulator.scenario import Inflate, Problem, ScenarioError
from simulator.simulation.run import simulate
from simulator.solver import newton, singular
from simulator.solver.follow import PathError, follow
from simulator.solver.ida import Effort
from simulator.solver.newton import NotConverged
from simulator.solver.segment import GAUSS_INTEGRALS, GAUSS_WEIGHTS, straight

if TYPE_CHECKING:
    from simulator.scenario import Scenario

FloatArray = NDArray[np.float64]

STRETCH_MARGIN = 1e-6  # a stretch this close to its limit ends a path
_STEP_OFF = 1e-6  # scaled arclength at which a path is taken up again beyond a limit point
_FARTHEST = 1e6  # v over its scale that no path gets to
_MOST_TURNS = 200
_RTOL = 1e-4


@dataclass(frozen=True)
class Until:
    """Where a path is to be left: at a v (voltage, or pressure while inflating), or a stretch of the first
    electroded balloon (the inflated one while inflating).
    """

    v: float | None = None
    stretch: float | None = None


@dataclass(frozen=True)
class _Piece:
    """A monotone piece of path with its number of unstable directions."""

    states: FloatArray
    dense: FloatArray
    speeds: FloatArray
    unstable: int


def trace(scenario: Scenario, until: Until | None = None) -> Curve:
    """The equilibrium path from a scenario's sealed state, with the common voltage free.

    Parameters
    ----------
    scenario : Scenario
        Played through the inflations that it begins with.
    until : Until, optional
        Where to stop; else where tension is lost, a stretch comes within 1e-6 of its limit, to 1000 where
        the elastomer has none or to the end of its measured curve, or the path comes back to zero voltage
        (where it meets its mirror image) or to where it has been.

    Raises
    ------
    ScenarioError
        If no balloon has electrodes, or the scenario does not begin by inflating.
    PathError
        If the path cannot be followed.
    """
    device, group, start = sealed_state(scenario)
    return _traced(scenario, device, group, start, until or Until())


def trace_all(scenario: Scenario) -> tuple[Curve, ...]:
    """The path from the sealed state, and those detached from it at the same amount of gas.

    The detached ones are those through any other equilibrium at zero voltage. Raises as `trace`.
    """
    device, group, start = sealed_state(scenario)
    curves = [_traced(scenario, device, group, start, Until())]
    for rest in rests(device, group.equations.gas):  # type: ignore[union-attr]
        met = np.array([curve.stretch[i] for curve in curves for i in (0, -1)])
        if np.min(np.max(np.abs(met - rest[: met.shape[1]]), axis=1)) > 1e-7:
            curves.append(_traced(scenario, device, group, rest, Until()))
    return tuple(curves)


def trace_inflation(scenario: Scenario, balloon: str | None = None, until: Until | None = None) -> Curve:
    """One balloon's pressure-controlled curve from the stress-free state, over peak and valley.

    Parameters
    ----------
    scenario : Scenario
    balloon : str, optional
        Name; default the last one (in the paper the passive, reference balloon).
    until : Until, optional
        Where to stop; default where the stretch comes within 1e-6 of its limit, or gets to 1000 where the
        elastomer has none.

    Raises
    ------
    ScenarioError
        If there is no balloon of that name.
    PathError
        If the path cannot be followed.
    """
    device = Device.from_scenario(scenario)
    if balloon is not None and balloon not in device.names:
        raise ScenarioError(
            scenario.file, Problem("balloon", balloon, f"must be one of {', '.join(device.names)}")
        )
    place = device.names.index(balloon) if balloon is not None else len(device.names) - 1
    device = device.bare(place)
    (group,) = groups.inflating(device, VoltageLine.common(0))
    return _traced(scenario, device, group, np.array([1.0, 0.0]), until or Until())


def sealed_state(scenario: Scenario) -> tuple[Device, Group, FloatArray]:
    """The device, its equations under a common voltage, and the state in which the gas was sealed."""
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
    history = simulate(scenario.model_copy(update={"steps": tuple(steps[:count])}))
    if history.pressure[-1] <= 0.0:
        raise ScenarioError(
            scenario.file, Problem(f"step.{count}.inflate", 0.0, "must be > 0 for a path in voltage")
        )
    device = Device.from_scenario(scenario)
    line = VoltageLine.common(len(device.electroded))
    swelling = float(device.swelling(history.stretch[-1:])[0])
    gas = device.law.sealed(float(history.pressure[-1]), swelling)
    (group,) = groups.actuated(device, line, gas=gas)
    start = np.array([*history.stretch[-1], history.pressure[-1], 0.0])
    return device, group, newton.one_at_drive(group.equations, start)


def rests(device: Device, gas: Contents) -> list[FloatArray]:
    """All equilibria (stretches…, p, 0) of the sealed device at zero voltage, stable or not.

    Every balloon lies on its own inflation curve p(λ), at one common pressure p; on the monotone parts of
    these curves λ is a function of p, and the gas law one equation for p in each combination of parts.
    """
    parts = [_monotone_parts(device, i) for i in range(len(device.names))]
    (group,) = groups.actuated(device, VoltageLine.common(len(device.electroded)), gas=gas)
    found: list[FloatArray] = []
    for combination in itertools.product(*parts):
        low = max(part[1][0] for part in combination)
        high = min(part[1][-1] for part in combination)
        if low >= high:
            continue
        pressures = np.unique(np.concatenate([part[1] for part in combination]))
        pressures = np.concatenate([[low], pressures[(pressures > low) & (pressures < high)], [high]])
        stretches = np.array([np.interp(pressures, part[1], part[0]) for part in combination])
        excess = np.asarray(gas.defect(pressures, device.radius**3 @ stretches**3))
        for i in np.flatnonzero(excess[:-1] * excess[1:] <= 0.0):
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
    numerator, denominator = wall.elastomer.pole_form(stretches)
    pressures = numerator / denominator / (wall.pressure_load * stretches**2)
    turns = np.flatnonzero(np.diff(np.sign(np.diff(pressures)))) + 1
    pieces = zip([0, *turns], [*turns, stretches.size - 1], strict=True)
    parts = [(stretches[i : j + 1], pressures[i : j + 1]) for i, j in pieces]
    return [part if part[1][0] < part[1][-1] else (part[0][::-1], part[1][::-1]) for part in parts]


def _traced(scenario: Scenario, device: Device, group: Group, start: FloatArray, until: Until) -> Curve:
    """The path from a state at which v begins to rise, until something ends it."""
    equations, effort = group.equations, Effort()
    pieces: list[_Piece] = []
    found: list[tuple[str, int, FloatArray]] = []  # kind, pieces before it, state
    ends = tuple(_ends(group, start, until))
    state, rising = start, True
    while True:
        if len(pieces) > 2 * _MOST_TURNS:
            raise PathError(f"the path turns more than {_MOST_TURNS} times")
        sizes = eigenvalues(equations, state)
        unstable, modes = int(np.count_nonzero(sizes < 0.0)), sizes.size
        target = _target(equations.scales[-1], float(state[-1]), rising, until.v)
        turns = _turns(group, unstable, modes)
        segment = follow(equations, (*turns, *ends), state, target, _RTOL, effort)
        pieces.append(_Piece(segment.states, segment.dense, segment.speeds, unstable))
        state = segment.states[:, -1]
        end = "unbounded" if rising else "zero_voltage"
        kind = segment.end or ("reached" if target == until.v else end)
        if kind == "limit_point" and not singular.is_fold(equations, state):
            kind = "branch_point"
        been = any(k == kind and np.abs(s - state).max() < 1e-8 for k, _, s in found)
        found.append(("closed" if been else kind, len(pieces), state))
        if been or kind not in ("limit_point", "branch_point"):
            break
        piece = _beyond(equations, ends, state, segment.tangents[:, -1], unstable)
        pieces.append(piece)
        rising = bool(piece.states[-1, -1] > state[-1])
        state = piece.states[:, -1]
    return _curve(scenario, device, group, pieces, found, effort)


def _ends(group: Group, start: FloatArray, until: Until) -> Iterator[Condition]:
    """What ends a path besides zero voltage: slack membranes, a stretch at its limit, a stretch asked for, or
    the end of a measured curve.
    """
    ending = ("loss_of_tension", "out_of_range")
    yield from (condition for condition in group.conditions if condition.kind in ending)
    for place, wall in enumerate(group.equations.walls):
        if np.isfinite(wall.elastomer.stretch_limit):
            yield _stretch_condition(
                "stretch_limit", place, wall.elastomer.stretch_limit - STRETCH_MARGIN, 1.0
            )
        elif not np.isfinite(largest_stretch(wall.elastomer)):
            yield _stretch_condition("unbounded", place, ENDLESS, 1.0)
    if until.stretch is not None:
        place = next((i for i, m in enumerate(_membranes(group)) if isinstance(m, ElectrodedMembrane)), 0)
        yield _stretch_condition(
            "reached", place, until.stretch, 1.0 if until.stretch > start[place] else -1.0
        )


def _membranes(group: Group) -> Sequence[object]:
    equations = group.equations
    return equations.membranes if isinstance(equations, SealedBalloons) else (equations.membrane,)


def _stretch_condition(kind: str, place: int, value: float, sign: float) -> Condition:
    def margin(y: State) -> Number:
        return sign * (value - y[place])

    def slope(y: FloatArray) -> FloatArray:
        out = np.zeros(y.size)
        out[place] = -sign
        return out

    return Condition(kind, margin, slope)


def _turns(group: Group, unstable: int, modes: int) -> tuple[Condition, ...]:
    """The singular points at which the number of unstable directions goes down or up by one."""
    down = (singularity(group.equations, unstable - 1, -1.0),) if unstable else ()
    up = (singularity(group.equations, unstable, 1.0),) if unstable < modes else ()
    return (*down, *up)


def _target(scale: float, v: float, rising: bool, wanted: float | None) -> float:
    """The v that ends a piece: the one asked for where it lies ahead, zero voltage, or out of reach."""
    if wanted is not None and (wanted > v) == rising and wanted != v:
        return wanted
    return _FARTHEST * scale if rising else 0.0


def _beyond(
    equations: AnyEquations, ends: Sequence[Condition], point: FloatArray, tangent: FloatArray, unstable: int
) -> _Piece:
    """The short piece from a singular point to a state beyond it that is regular and breaks no condition."""
    weights = 1.0 / equations.scales**2
    for length in (_STEP_OFF, 0.1 * _STEP_OFF, 0.01 * _STEP_OFF):
        guess = point + length * tangent
        try:
            states, _ = newton.on_planes(equations, guess[:, None], (weights * tangent)[:, None])
        except NotConverged:
            continue
        values = states[:, 0].tolist()
        count = int(np.count_nonzero(eigenvalues(equations, states[:, 0]) < 0.0))
        if count != unstable and all(condition.margin(values) > 0.0 for condition in ends):
            nodes = np.column_stack([point, states])
            return _Piece(nodes, *straight(nodes[:, :1], nodes[:, 1:]), count)
    raise PathError(f"the path cannot be taken up again beyond v = {point[-1]:.12g}")


def _curve(
    scenario: Scenario,
    device: Device,
    group: Group,
    pieces: Sequence[_Piece],
    found: Sequence[tuple[str, int, FloatArray]],
    effort: Effort,
) -> Curve:
    """Points and special points of the pieces, with everything derived from them."""
    columns, arcs = [pieces[0].states[:, :1]], [np.zeros(1)]
    counts, ends = [np.array([pieces[0].unstable])], []
    for piece in pieces:
        speed = np.sqrt(np.einsum("ijk,i->jk", piece.speeds**2, 1.0 / group.equations.scales**2))
        # Arclength up to the Gauss points of each interval and to its end.
        steps = np.concatenate([speed @ GAUSS_INTEGRALS.T, (speed @ GAUSS_WEIGHTS)[:, None]], axis=1)
        steps[1:] += np.cumsum(steps[:-1, -1])[:, None]
        arcs.append(arcs[-1][-1] + steps.ravel())
        states = np.concatenate([piece.dense, piece.states[:, 1:, None]], axis=2)
        columns.append(states.reshape(len(states), -1))
        counts.append(np.full(steps.size, piece.unstable))
        ends.append(arcs[-1][-1])
    states = np.concatenate(columns, axis=1)
    stretch = states[: len(device.names)].T
    voltage = np.repeat(states[-1:].T, len(device.electroded), axis=1)
    pressure = np.asarray(group.equations.pressure(states))
    gas = np.asarray(device.law.amount(pressure, device.volume(stretch)))
    is_open = np.full(len(stretch), isinstance(group.equations, OpenBalloon))
    return Curve(
        title=scenario.title,
        balloons=device.names,
        electroded=tuple(device.names[i] for i in device.electroded),
        arclength=np.concatenate(arcs),
        voltage=voltage,
        stretch=stretch,
        pressure=pressure,
        field=device.field(stretch, voltage),
        charge=device.charge(stretch, voltage),
        energy=device.energy(stretch, pressure, voltage, gas, is_open),
        stability=device.stability(stretch, pressure, voltage, gas, is_open),
        unstable=np.concatenate(counts),
        points=tuple(
            SpecialPoint(
                kind,
                float(ends[count - 1]),
                np.full(len(device.electroded), state[-1]),
                state[: len(device.names)],
                float(group.equations.pressure(state)),
            )
            for kind, count, state in found
        ),
        ida_steps=effort.ida_steps,
        radius=device.radius,
        scales=scenario.scales,
    )
