"""A limit point followed as a second parameter of the scenario changes: the border between snap and no snap.

With the parameter q as one more unknown, the conditions of a limit point,

    inflated state,    force balances,    gas law,    det S = 0,

define a curve again, and it is followed like any other: IDA along its arclength, every point polished.
Derivatives in all unknowns, q included, are by complex step, exact for any number of the scenario.

For a loss of sphericity the last equation is s = 0 of one balloon instead.

The curve ends at `to`, or earlier: at a cusp, where two limit points meet and annihilate; where the limit
point meets the loss of tension (p = 0) or zero voltage; or where the inflated state itself ends, or the
inflation leads to another one, as a peak has come to lie above or below its pressure. A loss of sphericity
ends also where it meets a limit point, and in place of a cusp has a turning point, where two of them meet.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from simulator.analysis.limit_points import SOFT, Alone, LimitPoint, Sealed
from simulator.analysis.start import sealed_state
from simulator.analysis.trace import trace, trace_inflation
from simulator.analysis.varied import Varied, check_value
from simulator.model.conditions import COMPLEX_STEP
from simulator.model.drive import VoltageLine
from simulator.model.elastomers import Number, largest_stretch
from simulator.model.membranes import Membrane
from simulator.results.curve import Curve, FoldCurve, SpecialPoint
from simulator.scenario import Problem, ScenarioError, dimension_of, dimensionless, load_scenario
from simulator.solver import arclength, newton
from simulator.solver.follow import PathError
from simulator.solver.ida import Effort, IntegrationError
from simulator.solver.newton import NotConverged

if TYPE_CHECKING:
    from simulator.scenario import Scenario, ScenarioLike

FloatArray = NDArray[np.float64]

_RTOL = 1e-5
_HALVINGS = 36
FOLLOWED = ("limit_point", "loss_of_sphericity", "sphericity_regained")
_NO_VOLTAGE = 1e-4  # a voltage this small where the parameter turns round is zero


def fold(
    scenario: ScenarioLike,
    vary: str,
    to: float | str,
    *,
    of: str = "limit_point",
    point: int = 1,
    inflation: str | None = None,
) -> FoldCurve:
    """Follow a limit point of a scenario's equilibrium path while one of its numbers changes.

    Or where a balloon stops being a sphere on it.

    Parameters
    ----------
    scenario : Scenario
        Where it starts; must have the limit point.
    vary : str
        Key of the number, as in error messages: `gas.ambient_pressure`, `step.1.inflate` (the pressure at
        which the gas is sealed), `balloon.<name>.radius` (thickness, modulus, permittivity),
        `balloon.<name>.elastomer.J_lim`; `balloon.*.…` changes all balloons together.
    to : float or str
        Value at which to stop, dimensionless; with [scales] also a text with a unit.
    of : {"limit_point", "loss_of_sphericity", "sphericity_regained"}
        What to follow.
    point : int
        Which one of the path, from 1.
    inflation : str, optional
        Name of a balloon: follow a limit point of its pressure-controlled inflation instead.

    Returns
    -------
    FoldCurve
        Of the balloons of the path; where the valve is open, or of an inflation, of the one balloon that has
        the limit point. A change that makes equal balloons unequal can take the limit point to a path that
        is detached from the sealed state.

    Raises
    ------
    ScenarioError
        If the key is no number of the scenario, `to` no other value of it, or there is no such point.
    PathError
        If the curve cannot be followed.

    Examples
    --------
    >>> from simulator import load_scenario
    >>> scenario = load_scenario("scenarios/fig3c_state_b.toml")
    >>> curve = fold(scenario, "gas.ambient_pressure", 0.2)
    >>> curve.end, round(float(curve.voltage[-1]), 6)
    ('reached', 0.395319)
    """
    scenario = load_scenario(scenario)
    if of not in FOLLOWED:
        raise ScenarioError(scenario.file, Problem("of", of, f"must be one of {', '.join(FOLLOWED)}"))
    varied = Varied.of(scenario, vary)
    dimension = dimension_of(scenario, vary)
    to = dimensionless(scenario, "to", to, dimension)
    check_value(scenario, vary, to, varied.value)
    curve = trace_inflation(scenario, inflation) if inflation is not None else trace(scenario)
    turns = [p for p in curve.points if p.kind == of]
    if not 1 <= point <= len(turns):
        many = f"there are {len(turns)} of {of.replace('_', ' ')}, counted from 1"
        if of == "limit_point":
            many = f"there are {len(turns)} limit points, counted from 1"
        raise ScenarioError(scenario.file, Problem("point", point, many))
    problem, start = _problem(scenario, varied, curve, turns[point - 1], inflation)
    effort = Effort()
    try:
        states, end = _followed(problem, start, to, effort)
        states, end = _as_inflated(problem, states, end)
    except (NotConverged, IntegrationError) as failure:
        raise PathError(f"{vary} from {varied.value:g} to {to:g}: {failure}") from failure
    found = [problem.reading(states[:, i]) for i in range(states.shape[1])]
    stretch = np.array([reading[0] for reading in found])
    names = problem.balloons
    known = [largest_stretch(varied.device.elastomers[varied.device.names.index(name)]) for name in names]
    if (stretch.max(axis=0) > known).any():
        raise PathError(f"{vary}: the limit point leaves the measured curve of an elastomer")
    return FoldCurve(
        title=scenario.title,
        parameter=vary,
        balloons=names,
        value=states[-1],
        voltage=np.array([reading[2] for reading in found]),
        stretch=stretch,
        pressure=np.array([reading[1] for reading in found]),
        end=end,
        ida_steps=effort.ida_steps,
        dimension=dimension,
        scales=scenario.scales,
        of=of,
        balloon=turns[point - 1].balloon,
    )


def _problem(
    scenario: Scenario, varied: Varied, curve: Curve, turn: SpecialPoint, inflation: str | None
) -> tuple[LimitPoint, FloatArray]:
    """The equations of a limit point, and the limit point of the scenario itself."""
    names = varied.device.names
    if inflation is not None:
        alone = Alone(varied, names.index(inflation), inflates=True, mode=turn.mode)
        return alone, np.array([*turn.stretch, turn.pressure, varied.value])
    device, group, start = sealed_state(scenario)
    if group.equations.is_open:
        # With the valve open the balloons do not feel each other: it is one of them that turns.
        line = VoltageLine.common(len(device.electroded))
        place = (
            names.index(turn.balloon)
            if turn.balloon
            else min(
                device.electroded,
                key=lambda i: abs(
                    device.membrane(i, line).stiffness(turn.stretch[i], turn.pressure, turn.voltage[0])[0]
                ),
            )
        )
        alone = Alone(varied, place, inflates=False, mode=turn.mode)
        return alone, np.array([turn.stretch[place], turn.voltage[0], varied.value])
    state = [*start[: len(names)], *turn.stretch, turn.pressure, turn.voltage[0], varied.value]
    return Sealed(varied, names.index(turn.balloon) if turn.balloon else -1, turn.mode), np.array(state)


_Function = Callable[[Sequence[Number]], list[Number]]


def _jacobian(function: _Function, z: Sequence[float]) -> list[list[float]]:
    """Derivatives of a function by complex steps, rows of (n)."""
    columns = []
    for j in range(len(z)):
        stepped: list[Number] = list(z)
        stepped[j] += 1j * COMPLEX_STEP
        columns.append([complex(value).imag / COMPLEX_STEP for value in function(stepped)])
    return [list(row) for row in zip(*columns, strict=True)]


def _solved(function: _Function, guess: FloatArray, scales: FloatArray) -> FloatArray:
    """The root of as many equations as unknowns, by Newton's method. Raises NotConverged."""

    def step(z: list[float]) -> tuple[list[float], Callable[[], bool]]:
        residual, rows = np.array(function(z), dtype=np.float64), np.array(_jacobian(function, z))
        changes = np.linalg.solve(rows * scales, residual) * scales
        rounding = newton.NOISE * np.abs(rows) @ np.abs(z)
        return changes.tolist(), lambda: bool(np.all(np.abs(residual) <= rounding))

    return newton.solved_one(step, guess, scales, "limit point at a changed parameter")


def _corrected(problem: LimitPoint, guess: FloatArray, normal: FloatArray) -> FloatArray:
    """The point of the curve on the plane through a guess. Raises NotConverged."""

    def function(z: Sequence[Number]) -> list[Number]:
        ahead = sum(n * (x - x0) for n, x, x0 in zip(normal.tolist(), z, guess.tolist(), strict=True))
        return [*problem.residual(z), ahead]

    return _solved(function, guess, problem.scales)


def _tangent(problem: LimitPoint, z: FloatArray, towards: FloatArray) -> FloatArray:
    """Unit tangent of the curve in scaled unknowns."""
    scales = problem.scales
    null = np.linalg.svd(np.array(_jacobian(problem.residual, z.tolist())) * scales)[2][-1]
    return np.asarray(scales * null * (1.0 if null @ (towards / scales) > 0.0 else -1.0))


def _followed(problem: LimitPoint, start: FloatArray, to: float, effort: Effort) -> tuple[FloatArray, str]:
    """Polished points of the curve, columns, and why it ends."""
    sense = 1.0 if to > start[-1] else -1.0
    ahead = np.zeros(start.size)
    ahead[-1] = sense
    scales = problem.scales
    start = _corrected(problem, start, ahead)
    direction = _tangent(problem, start, ahead)

    # A loss of sphericity ends where it meets a limit point, from whichever side.
    side = np.sign(problem.singularity(start.tolist()))

    def events(values: list[float], rates: list[float]) -> list[float]:
        return [
            sense * (to - values[-1]),
            sense * rates[-1],
            *([] if problem.mode is None else [side * problem.singularity(values)]),
            *(margin for *_, margin in problem.margins(values)),
        ]

    points, directions, ended = arclength.along(
        problem.residual,
        lambda values: _jacobian(problem.residual, values),
        events,
        start,
        direction,
        scales,
        _RTOL,
        0.25,
        effort,
    )
    states = [start]
    for point, along in zip(points.T[1:-1], directions.T[1:-1], strict=True):
        states.append(_corrected(problem, point, along / scales**2))
    last, end = _end(problem, points[:, -1], directions[:, -1], to, ended)
    # IDA's last step before an event can end on it.
    states = [state for state in states if np.max(np.abs(state - last) / scales) > 1e-6]
    return np.column_stack([*states, last]), end


def _end(
    problem: LimitPoint, found: FloatArray, towards: FloatArray, to: float, ended: int
) -> tuple[FloatArray, str]:
    """The last point, polished, and what it is."""
    turns = "cusp" if problem.mode is None else "turning_point"
    kinds: list[tuple[str, int | None, float]] = [("reached", -1, 0.0), (turns, None, 0.0)]
    if problem.mode is not None:
        kinds.append(("limit_point", None, 0.0))
    margins = problem.margins(found.tolist())
    kind, place, _ = [*kinds, *margins][ended]
    if kind == "limit_point":
        both = _solved(lambda z: [*problem.residual(z), problem.singularity(z)], found, problem.scales)
        return both, kind
    if kind == turns:
        # The equations are even in the voltage: where it is zero the parameter turns round as well.
        beside = (margin for margin in margins if margin[0] == "zero_voltage" and margin[2] < _NO_VOLTAGE)
        kind, place, _ = next(beside, (kind, place, 0.0))
    if place is not None:
        guess, normal = found.copy(), np.zeros(found.size)
        guess[place] = to if kind == "reached" else 0.0
        normal[place] = 1.0
        return _corrected(problem, guess, normal), kind
    if isinstance(problem, Sealed) and min(problem.softnesses(found.tolist())) < SOFT:
        return _inflation_limit(problem, found), "inflation_limit"
    # The parameter turns round: where dq/ds = 0, by bisection in s.
    scales = problem.scales
    tangent = _tangent(problem, found, towards)

    def point(length: float) -> FloatArray:
        return _corrected(problem, found + length * tangent, tangent / scales**2)

    def turning(length: float) -> float:
        return float(_tangent(problem, point(length), towards)[-1] / scales[-1])

    width = next((w for w in (1e-3, 1e-2, 5e-2) if turning(-w) * turning(w) < 0.0), None)
    if width is None:
        raise NotConverged("where the parameter turns round")
    return point(optimize.brentq(turning, -width, width, xtol=1e-14)), turns


def _as_inflated(problem: LimitPoint, states: FloatArray, end: str) -> tuple[FloatArray, str]:
    """The curve as far as the scenario, played with the other number, is inflated to the state on it."""
    if isinstance(problem, Alone) or problem.leads_to(states[:, -1], end):
        return states, end
    good, bad = 0, states.shape[1] - 1
    while bad - good > 1:
        middle = (good + bad) // 2
        good, bad = (middle, bad) if problem.leads_to(states[:, middle], end) else (good, middle)
    last, beyond = states[:, good], states[:, bad]
    chord = beyond - last
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        share = 0.5 * (low + high)
        state = _corrected(problem, states[:, good] + share * chord, chord / problem.scales**2)
        if problem.leads_to(state, end):
            low, last = share, state
        else:
            high = share
    return np.column_stack([states[:, :good], last]), "inflation_limit"


def _inflation_limit(problem: Sealed, found: FloatArray) -> FloatArray:
    """Where the inflated state of the softest balloon ends in a limit point of its own.

    Equal balloons end together and the whole set of equations is singular there, so first that balloon's
    limit point, then the inflated states of the others, then the sealed state on their gas.
    """
    n = len(problem.balloons)
    softnesses = problem.softnesses(found.tolist())
    soft = softnesses.index(min(softnesses))

    def own(z: Sequence[Number]) -> list[Number]:
        device, inflation = problem.varied.at(z[1])
        wall = device.walls[soft]
        return [wall.force(z[0], inflation, 0.0), wall.stiffness(z[0], inflation, 0.0)[0]]

    stretch, q = _solved(own, np.array([found[soft], found[-1]]), np.ones(2)).tolist()
    device, inflation = problem.varied.at(q)
    inflated = np.full(n, stretch)
    for i, wall in enumerate(device.walls):
        if abs(found[i] - found[soft]) > 1e-2:
            inflated[i] = _inflated(wall, inflation, found[i])
    rest = _solved(lambda z: problem.residual([*inflated, *z, q])[n:], found[n:-1], problem.scales[n:-1])
    return np.array([*inflated, *rest, q])


def _inflated(wall: Membrane, pressure: Number, guess: float) -> float:
    """The stretch of a balloon under a pressure."""
    return float(_solved(lambda z: [wall.force(z[0], pressure, 0.0)], np.array([guess]), np.ones(1))[0])
