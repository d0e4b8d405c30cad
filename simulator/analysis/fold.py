"""A limit point followed as a second parameter of the scenario changes: the border between snap and no snap.

With the parameter q as one more unknown, the conditions of a limit point,

    inflated state,    force balances,    gas law,    det S = 0,

define a curve again, and it is followed like any other: IDA along its arclength, every point polished.
Derivatives in all unknowns, q included, are by complex step, exact for any number of the scenario.

The curve ends at `to`, or earlier: at a cusp, where two limit points meet and annihilate; where the limit
point meets the loss of tension (p = 0) or zero voltage; or where the inflated state itself ends.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from simulator.analysis.trace import sealed_state, trace, trace_inflation
from simulator.model.contents import Law
from simulator.model.device import Device
from simulator.model.elastomers import Elastomer, Gent, Number, largest_stretch
from simulator.model.equations import SealedBalloons
from simulator.model.membranes import ElectrodedMembrane, Membrane
from simulator.results.curve import FoldCurve
from simulator.scenario import Inflate, Problem, ScenarioError, dimension_of, dimensionless
from simulator.solver import arclength
from simulator.solver.follow import PathError
from simulator.solver.ida import Effort
from simulator.solver.newton import NotConverged

if TYPE_CHECKING:
    from simulator.scenario import Scenario

FloatArray = NDArray[np.float64]

_STEP = 1e-30
_RTOL = 1e-5


def fold(
    scenario: Scenario, vary: str, to: float | str, *, point: int = 1, inflation: str | None = None
) -> FoldCurve:
    """Follow a limit point of a scenario's equilibrium path while one of its numbers changes.

    Parameters
    ----------
    scenario : Scenario
        Where it starts; must have the limit point.
    vary : str
        Key of the number, as in error messages: `gas.ambient_pressure`, `step.1.inflate` (the pressure at
        which the gas is sealed), `balloon.<name>.radius` (thickness, modulus, permittivity),
        `balloon.<name>.elastomer.J_lim`; `balloon.*.…` changes all balloons together.
    to : float or str
        Value at which to stop; with [scales] also a text with a unit.
    point : int
        Which limit point of the path, from 1.
    inflation : str, optional
        Name of a balloon: follow a limit point of its pressure-controlled inflation instead.

    Raises
    ------
    ScenarioError
        If the key is not a number of the scenario, or there is no such limit point.
    PathError
        If the curve cannot be followed.
    """
    parameters = _Parameters.of(scenario, vary)
    dimension = dimension_of(scenario, vary)
    to = dimensionless(scenario, "to", to, dimension)
    device = Device.from_scenario(scenario)
    if inflation is not None:
        curve = trace_inflation(scenario, inflation)
        problem: _Inflated | _Sealed = _Inflated(parameters, device.names.index(inflation))
    else:
        inflated = sealed_state(scenario)[2][: len(device.names)]
        curve = trace(scenario)
        problem = _Sealed(parameters, device.electroded, len(device.names))
    turns = [p for p in curve.points if p.kind == "limit_point"]
    if not 1 <= point <= len(turns):
        raise ScenarioError(
            scenario.file, Problem("point", point, f"there are {len(turns)} limit points, counted from 1")
        )
    turn = turns[point - 1]
    drive = (
        [turn.pressure]
        if inflation is not None
        else [*inflated, *turn.stretch, turn.pressure, turn.voltage[0]]
    )
    stretch = list(turn.stretch) if inflation is not None else []
    effort = Effort()
    try:
        states, end = _followed(problem, np.array([*stretch, *drive, parameters.value]), to, effort)
    except NotConverged as failure:
        raise PathError(f"{vary} from {parameters.value:g} to {to:g}: {failure}") from failure
    count = len(curve.balloons)
    own = slice(0, 1) if inflation is not None else slice(count, 2 * count)
    places = [device.names.index(name) for name in curve.balloons]
    known = [largest_stretch(device.elastomers[i]) for i in places]
    if (states[own].max(axis=1) > known).any():
        raise PathError(f"{vary}: the limit point leaves the measured curve of an elastomer")
    return FoldCurve(
        title=scenario.title,
        parameter=vary,
        balloons=curve.balloons,
        value=states[-1],
        voltage=np.zeros(states.shape[1]) if inflation is not None else states[-2],
        stretch=states[own].T,
        pressure=states[-2] if inflation is not None else states[-3],
        end=end,
        ida_steps=effort.ida_steps,
        dimension=dimension,
        scales=scenario.scales,
    )


@dataclass(frozen=True)
class _Parameters:
    """The numbers of a scenario as lists over its balloons, and which of them q replaces."""

    radius: list[Number]
    thickness: list[Number]
    modulus: list[Number]
    permittivity: list[Number]
    elastomers: list[Elastomer]
    law: Law
    inflation: Number
    value: float
    replace: Callable[[_Parameters, Number], _Parameters]

    @classmethod
    def of(cls, scenario: Scenario, vary: str) -> _Parameters:
        balloons = scenario.balloons
        steps = list(scenario.played_steps())
        count = next((i for i, step in enumerate(steps) if not isinstance(step, Inflate)), len(steps))
        sealed_at = steps[count - 1] if count else None
        device = Device.from_scenario(scenario)
        known = cls(
            [b.radius for b in balloons],
            [b.thickness for b in balloons],
            [b.modulus for b in balloons],
            [b.permittivity for b in balloons],
            list(device.elastomers),
            device.law,
            sealed_at.inflate if isinstance(sealed_at, Inflate) else 0.0,
            0.0,
            lambda same, q: same,
        )
        names = [b.name for b in balloons]
        if vary == "gas.ambient_pressure":
            return replace(known, value=device.ambient, replace=partial(_changed_law, "ambient"))
        if vary == "gas.chamber" and device.law.chamber:
            return replace(known, value=float(device.law.chamber), replace=partial(_changed_law, "chamber"))
        if count and vary == f"step.{count}.inflate":
            return replace(known, value=float(known.inflation), replace=lambda p, q: replace(p, inflation=q))
        found = re.fullmatch(
            r"balloon\.([^.]+)\.(radius|thickness|modulus|permittivity|elastomer\.J_lim)", vary
        )
        chosen = [i for i, name in enumerate(names) if found and found[1] in (name, "*")]
        if found is None or not chosen:
            chamber = ["gas.chamber"] if device.law.chamber else []
            raise ScenarioError(
                scenario.file, Problem(vary, None, f"cannot be varied; {_allowed(names, count, chamber)}")
            )
        if found[2] == "elastomer.J_lim":
            limits = {getattr(known.elastomers[i], "J_lim", None) for i in chosen}
            if None in limits or len(limits) > 1:
                raise ScenarioError(
                    scenario.file, Problem(vary, None, "must be one J_lim that all these share")
                )

            def stiffer(p: _Parameters, q: Number) -> _Parameters:
                return replace(
                    p, elastomers=[Gent(q) if i in chosen else e for i, e in enumerate(p.elastomers)]
                )

            return replace(known, value=float(limits.pop()), replace=stiffer)  # type: ignore[arg-type]
        sizes = {getattr(known, found[2])[i] for i in chosen}
        if len(sizes) > 1:
            raise ScenarioError(scenario.file, Problem(vary, None, "must be one value that all these share"))

        def resized(p: _Parameters, q: Number) -> _Parameters:
            changed: dict[str, Any] = {
                found[2]: [q if i in chosen else x for i, x in enumerate(getattr(p, found[2]))]
            }
            return replace(p, **changed)

        return replace(known, value=float(sizes.pop()), replace=resized)

    def at(self, q: Number) -> _Parameters:
        return self.replace(self, q)

    def walls(self) -> tuple[Membrane, ...]:
        return tuple(
            Membrane(elastomer, r / (h * k), k, r * r * h * k, r * r * r)
            for elastomer, r, h, k in zip(
                self.elastomers, self.radius, self.thickness, self.modulus, strict=True
            )
        )


def _changed_law(key: str, parameters: _Parameters, q: Number) -> _Parameters:
    changed: dict[str, Any] = {key: q}
    return replace(parameters, law=replace(parameters.law, **changed))  # type: ignore[type-var]


def _allowed(names: Sequence[str], inflations: int, chamber: Sequence[str]) -> str:
    step = [f"step.{inflations}.inflate"] if inflations else []
    balloon = (
        f"balloon.<{' or '.join([*names, '*'])}>.radius, thickness, modulus, permittivity, elastomer.J_lim"
    )
    return "can be: " + ", ".join(["gas.ambient_pressure", *chamber, *step, balloon])


@dataclass(frozen=True)
class _Inflated:
    """Limit points of one balloon's inflation: unknowns (λ, p, q), equations R = 0, ∂R/∂λ = 0."""

    parameters: _Parameters
    place: int

    @property
    def scales(self) -> FloatArray:
        wall = self.parameters.walls()[self.place]
        return np.array([1.0, 1.0 / wall.pressure_load, abs(self.parameters.value) or 1.0])

    def residual(self, z: Sequence[Number]) -> list[Number]:
        wall = self.parameters.at(z[-1]).walls()[self.place]
        return [wall.force(z[0], z[1], 0.0), wall.stiffness(z[0], z[1], 0.0)[0]]

    def margins(self, z: Sequence[float]) -> list[float]:
        return []


@dataclass(frozen=True)
class _Sealed:
    """Limit points of the sealed device: unknowns (λ inflated…, λ…, p, v, q)."""

    parameters: _Parameters
    electroded: tuple[int, ...]
    count: int

    @property
    def scales(self) -> FloatArray:
        walls = self.parameters.walls()
        softest = min(1.0 / float(wall.pressure_load) for wall in walls)
        return np.array([1.0] * (2 * self.count) + [softest, 1.0, abs(self.parameters.value) or 1.0])

    def residual(self, z: Sequence[Number]) -> list[Number]:
        numbers = self.parameters.at(z[-1])
        walls = numbers.walls()
        inflated, stretches = z[: self.count], z[self.count : 2 * self.count]
        volume: Number = 0.0
        for wall, x in zip(walls, inflated, strict=True):
            volume = volume + wall.cube * x * x * x / 3.0
        membranes = tuple(self._membrane(numbers, walls, i) for i in range(self.count))
        sealed = SealedBalloons(membranes, numbers.law.sealed(numbers.inflation, volume))
        y = [*stretches, z[-3], z[-2]]
        out = [wall.force(x, numbers.inflation, 0.0) for wall, x in zip(walls, inflated, strict=True)]
        return [*out, *sealed.residual(y), sealed.spectrum.determinant(*sealed.stiffness(y))]

    def _membrane(
        self, numbers: _Parameters, walls: Sequence[Membrane], i: int
    ) -> Membrane | ElectrodedMembrane:
        if i not in self.electroded:
            return walls[i]
        e, h, k, r = (
            part[i] for part in (numbers.permittivity, numbers.thickness, numbers.modulus, numbers.radius)
        )
        return ElectrodedMembrane(walls[i], 2.0 * e / (h * h * k), r * r * e / h, h, 0.0, 1.0)

    def margins(self, z: Sequence[float]) -> list[float]:
        """Pressure, voltage, and the softest inflated balloon's stiffness."""
        numbers = self.parameters.at(z[-1])
        inflated = [
            wall.stiffness(x, numbers.inflation, 0.0)[0]
            for wall, x in zip(numbers.walls(), z[: self.count], strict=True)
        ]
        return [z[-3], z[-2], min(inflated)]


_Problem = _Inflated | _Sealed
_MARGINS = ("loss_of_tension", "zero_voltage", "inflation_limit")


def _jacobian(problem: _Problem, z: Sequence[float]) -> list[list[float]]:
    """Derivatives of the residual by complex steps, rows of (n)."""
    columns = []
    for j in range(len(z)):
        stepped: list[Number] = list(z)
        stepped[j] += 1j * _STEP
        columns.append([complex(value).imag / _STEP for value in problem.residual(stepped)])
    return [list(row) for row in zip(*columns, strict=True)]


def _corrected(problem: _Problem, guess: FloatArray, normal: FloatArray) -> FloatArray:
    """The point of the curve on the plane through a guess. Raises NotConverged."""
    z, scales = guess.copy(), problem.scales
    before = np.nan
    for _ in range(20):
        values = z.tolist()
        residual = np.array([*problem.residual(values), normal @ (z - guess)], dtype=np.float64)
        matrix = np.array([*_jacobian(problem, values), normal]) * scales
        step = np.linalg.solve(matrix, residual)
        z = z - scales * step
        size = float(np.max(np.abs(step) / np.maximum(np.abs(z / scales), 1.0)))
        if not size < 1e3:
            break
        if size <= 1e-13 or size**3 <= 1e-15 * before**2 or (size <= 1e-11 and size > 0.5 * before):
            return z
        before = size
    raise NotConverged("limit point at a changed parameter")


def _tangent(problem: _Problem, z: FloatArray, towards: FloatArray) -> FloatArray:
    """Unit tangent of the curve in scaled unknowns."""
    scales = problem.scales
    null = np.linalg.svd(np.array(_jacobian(problem, z.tolist())) * scales)[2][-1]
    return np.asarray(scales * null * (1.0 if null @ (towards / scales) > 0.0 else -1.0))


def _followed(problem: _Problem, start: FloatArray, to: float, effort: Effort) -> tuple[FloatArray, str]:
    """Polished points of the curve, columns, and why it ends."""
    sense = 1.0 if to > start[-1] else -1.0
    ahead = np.zeros(start.size)
    ahead[-1] = sense
    scales = problem.scales
    start = _corrected(problem, start, ahead)
    direction = _tangent(problem, start, ahead)

    def events(values: list[float], rates: list[float]) -> list[float]:
        return [sense * (to - values[-1]), sense * rates[-1], *problem.margins(values)]

    points, directions, ended = arclength.along(
        problem.residual,
        lambda values: _jacobian(problem, values),
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
    last, end = _end(problem, points[:, -1], directions[:, -1], sense, to, ended)
    # IDA's last step before an event can end on it.
    states = [state for state in states if np.max(np.abs(state - last) / scales) > 1e-6]
    return np.column_stack([*states, last]), end


def _end(
    problem: _Problem, found: FloatArray, towards: FloatArray, sense: float, to: float, ended: int
) -> tuple[FloatArray, str]:
    """The last point, polished, and what it is."""
    place = {0: -1, 2: -3, 3: -2}.get(ended)
    if place is not None:
        guess, normal = found.copy(), np.zeros(found.size)
        guess[place] = to if ended == 0 else 0.0
        normal[place] = 1.0
        return _corrected(problem, guess, normal), "reached" if ended == 0 else _MARGINS[ended - 2]
    if isinstance(problem, _Sealed) and problem.margins(found.tolist())[2] < 1e-2:
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
    return point(optimize.brentq(turning, -width, width, xtol=1e-14)), "cusp"


def _inflation_limit(problem: _Sealed, found: FloatArray) -> FloatArray:
    """Where the inflated state of the softest balloon ends in a limit point of its own.

    Equal balloons end together and the whole set of equations is singular there, so first that balloon's
    limit point, then the inflated states of the others, then the sealed state on their gas.
    """
    numbers, n = problem.parameters, problem.count
    soft = min(range(n), key=lambda i: _softness(numbers.at(found[-1]), i, float(found[i])))

    def own(z: Sequence[Number]) -> list[Number]:
        at = numbers.at(z[1])
        wall = at.walls()[soft]
        return [wall.force(z[0], at.inflation, 0.0), wall.stiffness(z[0], at.inflation, 0.0)[0]]

    stretch, q = _root(own, np.array([found[soft], found[-1]]))
    at = numbers.at(q)
    inflated = np.full(n, stretch)
    for i, wall in enumerate(at.walls()):
        if abs(found[i] - found[soft]) > 1e-2:
            inflated[i] = _root(partial(_inflated_force, wall, at.inflation), found[i : i + 1])[0]
    rest = _root(lambda z: problem.residual([*inflated, *z, q])[n:], found[n:-1])
    return np.array([*inflated, *rest, q])


def _inflated_force(wall: Membrane, pressure: Number, z: Sequence[Number]) -> list[Number]:
    return [wall.force(z[0], pressure, 0.0)]


def _softness(numbers: _Parameters, balloon: int, stretch: float) -> float:
    return float(numbers.walls()[balloon].stiffness(stretch, numbers.inflation, 0.0)[0])


def _root(function: Callable[[Sequence[Number]], list[Number]], guess: FloatArray) -> FloatArray:
    """Root of as many equations as unknowns, by Newton with complex steps. Raises NotConverged."""
    z = guess.copy()
    for _ in range(30):
        columns = []
        for j in range(z.size):
            stepped: list[Number] = z.tolist()
            stepped[j] += 1j * _STEP
            columns.append([complex(value).imag / _STEP for value in function(stepped)])
        step = np.linalg.solve(np.array(columns).T, np.array(function(z.tolist()), dtype=np.float64))
        z = z - step
        if float(np.max(np.abs(step) / np.maximum(np.abs(z), 1.0))) <= 1e-13:
            return z
    raise NotConverged("limit of the inflated state")
