"""Whether paths and folds are what they say: equilibria of one gas, Hessians singular at limit points."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator import load_scenario
from tests.fuzz.soundness import balance
from tests.oracle.general.elastomers import Law, loaded_law

FloatArray = NDArray[np.float64]
Document = dict[str, Any]

BALANCE = 1e-8
GAS = 1e-8
PRESSURE = 1e-14
SINGULAR = 1e-6
STRETCH_MARGIN = 1e-6  # how near a limit a path goes
ENDLESS = 1e3
FARTHEST = 1e5  # a pressure or voltage that is as good as infinite


def hessian(
    gas: Any,
    balloons: Any,
    walls: list[Law],
    stretch: FloatArray,
    pressure: float,
    voltage: FloatArray,
    more: FloatArray | float = 0.0,
) -> tuple[FloatArray, float]:
    """The Hessian of Π in the stretches scaled by √(r²hk), and the size of its terms; no `gas`, valve open.

    That of a liquid is restricted to the surface of constant volume. `more` is added to its diagonal.
    """
    count = len(walls)
    held = gas is None
    volume = (
        0.0
        if held
        else gas.chamber + sum(b.radius**3 * x**3 / 3.0 for b, x in zip(balloons, stretch, strict=True))
    )
    root = np.array([np.sqrt(b.radius**2 * b.thickness * b.modulus) for b in balloons])
    area = np.array([b.radius**3 * x * x for b, x in zip(balloons, stretch, strict=True)]) / root
    terms = np.array(
        [
            (
                wall.slope(float(x)),
                -2.0 * b.radius / (b.thickness * b.modulus) * pressure * x,
                -6.0 * b.permittivity / (b.thickness**2 * b.modulus) * float(v) ** 2 * x * x,
            )
            for wall, b, x, v in zip(walls, balloons, stretch, voltage, strict=True)
        ]
    )
    out = np.diag(terms.sum(axis=1) + more)
    size = float(np.max(np.abs(terms)))
    if held:
        return out, size
    if gas.law == "liquid":
        if count == 1:
            return np.ones((1, 1)), 1.0
        surface = np.linalg.svd(area[None])[2][1:]
        return surface @ out @ surface.T, size
    gamma = gas.exponent if gas.law == "adiabatic" else 1.0
    rise = gamma * (pressure + gas.ambient_pressure) / volume
    return out + rise * np.outer(area, area), max(size, rise * float(np.max(area)) ** 2)


def curve_problems(scenario: Any, curves: Iterable[Any]) -> list[str]:
    """What is wrong with the paths of a scenario."""
    out = []
    for number, curve in enumerate(curves):
        out += [f"path {number}: {problem}" for problem in _curve_problems(scenario, curve)]
    return out


def _curve_problems(scenario: Any, curve: Any) -> list[str]:
    names = [b.name for b in scenario.balloons]
    inflation = len(curve.balloons) < len(names) or not curve.electroded
    balloons = [scenario.balloons[names.index(name)] for name in curve.balloons]
    walls = [loaded_law(balloon.elastomer) for balloon in balloons]
    rows = len(curve)
    if rows < 2:
        return ["fewer than two points"]
    if not (np.all(np.isfinite(curve.stretch)) and np.all(np.isfinite(curve.pressure))):
        return ["not finite"]
    for row in range(rows):
        voltage = _voltages(curve, curve.voltage[row])
        apart = np.max(
            np.abs(balance(walls, balloons, curve.stretch[row], float(curve.pressure[row]), voltage))
        )
        if apart > BALANCE:
            return [f"point {row} is out of balance by {apart:.2g} of its terms"]
    is_open = _is_open(curve.pressure)
    if not inflation and not is_open and scenario.gas.law != "liquid":
        gas = scenario.gas
        gamma = gas.exponent if gas.law == "adiabatic" else 1.0
        volume = gas.chamber + sum(
            b.radius**3 * curve.stretch[:, i] ** 3 / 3.0 for i, b in enumerate(balloons)
        )
        constant = (curve.pressure + gas.ambient_pressure) * volume**gamma
        # In a vacuum the pressure of a large volume has few digits.
        apart = np.maximum(np.abs(constant - constant[0]) - PRESSURE * volume**gamma, 0.0)
        if np.max(apart) > GAS * constant[0]:
            row = int(np.argmax(apart))
            return [f"point {row} of {rows}: the gas has changed by {apart[row] / constant[0]:.2g}"]
    out = []
    for point in curve.points:
        problem = _point_problem(scenario, curve, point, balloons, walls, inflation)
        if problem:
            out.append(f"{point.kind} at stretch {point.stretch.tolist()}: {problem}")
    return out


def _is_open(pressure: FloatArray) -> bool:
    """Whether a path keeps its pressure, as the scenario keeps the valve open."""
    return bool(np.ptp(pressure) <= 1e-12 * max(1.0, float(np.max(np.abs(pressure)))))


def _voltages(curve: Any, voltage: FloatArray) -> FloatArray:
    out = np.zeros(len(curve.balloons))
    for name, v in zip(curve.electroded, voltage, strict=True):
        out[curve.balloons.index(name)] = v
    return out


def _point_problem(
    scenario: Any, curve: Any, point: Any, balloons: Any, walls: list[Law], inflation: bool
) -> str | None:
    voltage = _voltages(curve, point.voltage)
    stretch = np.asarray(point.stretch)
    apart = np.max(np.abs(balance(walls, balloons, stretch, float(point.pressure), voltage)))
    if apart > BALANCE:
        return f"out of balance by {apart:.2g} of its terms"
    match point.kind:
        case "limit_point" | "branch_point":
            if inflation:
                b, x = balloons[0], float(stretch[0])
                terms = b.modulus * walls[0].slope(x), 2.0 * b.radius / b.thickness * point.pressure * x
                singular = abs(terms[0] - terms[1]) / max(abs(terms[0]), abs(terms[1]))
            else:
                gas = None if _is_open(curve.pressure) else scenario.gas
                matrix, size = hessian(gas, balloons, walls, stretch, float(point.pressure), voltage)
                singular = float(np.min(np.abs(np.linalg.eigvalsh(matrix)))) / size
            return f"the Hessian is {singular:.2g} from singular" if singular > SINGULAR else None
        case "loss_of_tension":
            return f"pressure {point.pressure:.2g}" if abs(point.pressure) > 1e-9 else None
        case "zero_voltage":
            return f"voltage {point.voltage}" if np.any(np.abs(point.voltage) > 1e-9) else None
        case "stretch_limit":
            room = min(wall.limit - float(x) for wall, x in zip(walls, stretch, strict=True))
            return None if 0.0 < room < 3.0 * STRETCH_MARGIN else f"{room:.2g} from the limit"
        case "out_of_range":
            room = min(abs(wall.end - float(x)) for wall, x in zip(walls, stretch, strict=True))
            return None if room < 1e-8 else f"{room:.2g} from the end of the table"
        case "unbounded":
            size = max(b.radius / (b.thickness * b.modulus) for b in balloons)
            far = float(np.max(np.abs([size * point.pressure, *point.voltage]))) > FARTHEST
            return None if far or abs(float(np.max(stretch)) - ENDLESS) < 1e-3 else "not at a stretch of 1000"
    return None


def fold_problems(document: Document, key: str, found: Any) -> list[str]:
    """What is wrong with a limit point followed in one number: some of its points against the equations."""
    if len(found) < 1:
        return ["no points"]
    for row in np.unique(np.linspace(0, len(found) - 1, 9).astype(int)):
        value = float(found.value[row])
        scenario = load_scenario(_with(document, key, value))
        # With the valve open a fold is that of one balloon. A permittivity may leave any pressure as it is.
        balloons = [b for b in scenario.balloons if b.name in found.balloons]
        alone = len(balloons) < len(scenario.balloons)
        held = alone or (len(found) > 2 and _is_open(found.pressure))
        walls = [loaded_law(balloon.elastomer) for balloon in balloons]
        voltage = np.array([float(found.voltage[row]) if b.electrodes else 0.0 for b in balloons])
        stretch = np.array([found.stretch[row, found.balloons.index(b.name)] for b in balloons])
        pressure = float(found.pressure[row])
        apart = np.max(np.abs(balance(walls, balloons, stretch, pressure, voltage)))
        if apart > BALANCE:
            return [f"{key} = {value!r}: out of balance by {apart:.2g} of its terms"]
        shared = [*([None] if held else []), *([] if alone else [scenario.gas])]
        found_matrices = [hessian(gas, balloons, walls, stretch, pressure, voltage) for gas in shared]
        singular = min(float(np.abs(np.linalg.eigvalsh(m)).min()) / size for m, size in found_matrices)
        if singular > SINGULAR:
            return [f"{key} = {value!r}: the Hessian is {singular:.2g} from singular"]
    return []


def _with(document: Document, key: str, value: float) -> Document:
    """A scenario with one number of its gas or of a balloon changed."""
    first, name, *rest = key.split(".")
    if first == "gas":
        return {**document, "gas": {**document["gas"], name: value}}
    balloons = []
    for balloon in document["balloon"]:
        if balloon["name"] != name:
            balloons.append(balloon)
        elif rest == ["elastomer", "J_lim"]:
            balloons.append({**balloon, "elastomer": {**balloon["elastomer"], "J_lim": value}})
        else:
            balloons.append({**balloon, rest[0]: value})
    return {**document, "balloon": balloons}
