"""Whether a history is one: its rows against the equations and the drive, whatever should have happened."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator import History
from tests.oracle.general.elastomers import Law, loaded_law
from tests.oracle.general.waveforms import parts_of

FloatArray = NDArray[np.float64]

BALANCE = 1e-9  # of the terms of a force balance
GAS = 1e-9
PRESSURE = 3e-15
DRIVE = 1e-9
ENERGY = 1e-8
ENERGY_IN_REAL_TIME = 1e-7  # an integrator's 1e-9 in each of its steps
ROUNDING = 1e-13  # of energies of order r²hk
EPSILON = 2.2e-16


def problems_of(history: History) -> list[str]:
    """What is wrong with a history by itself; empty where nothing is."""
    if not len(history):
        return ["no samples"]
    found = _columns(history)
    if found:
        return found
    found += _ends(history)
    found += _gas(history)
    found += _drive(history)
    if history.scenario.dynamics is None:
        found += _balance(history)
    return found + _energy(history)


def _columns(history: History) -> list[str]:
    out = []
    for name in ("time", "voltage", "stretch", "pressure", "volume", "gas", "field", "charge", "energy"):
        if not np.all(np.isfinite(getattr(history, name))):
            out.append(f"column {name} is not finite")
    if np.any(np.diff(history.time) < 0.0):
        out.append("time falls")
    if np.any(np.diff(history.step) < 0):
        out.append("steps fall")
    return out


def _ends(history: History) -> list[str]:
    """An end that is no completion is the last event, and no event is an end before it."""
    ends = ("loss_of_tension", "breakdown", "runaway", "out_of_range")
    kinds = [event.kind.value for event in history.events]
    early = [kind for kind in kinds[:-1] if kind in ends]
    out = [f"{kind} is not the last event" for kind in early]
    outcome = history.outcome.value
    if outcome in ends and (not kinds or kinds[-1] != outcome):
        out.append(f"outcome {outcome}, the last event is {kinds[-1:]}")
    if outcome == "completed" and kinds and kinds[-1] in ends:
        out.append(f"completed after {kinds[-1]}")
    return out


def balance(
    walls: list[Law], balloons: Any, stretch: FloatArray, pressure: float, voltage: FloatArray
) -> FloatArray:
    """gᵢ over the size of its terms, and of what the rounding of a stretch does to them."""
    out = np.zeros(len(walls))
    for i, (wall, b) in enumerate(zip(walls, balloons, strict=True)):
        x = float(stretch[i])
        terms = (
            b.modulus * wall.force(x),
            -b.radius / b.thickness * pressure * x * x,
            -2.0 * b.permittivity / b.thickness**2 * float(voltage[i]) ** 2 * x**3,
        )
        # The digits of a stretch beside a limit, and of one beside 1, are few.
        rounding = 8.0 * EPSILON * x * b.modulus * abs(wall.slope(x)) / BALANCE
        out[i] = sum(terms) / max(sum(map(abs, terms)) + rounding, 1e-300)
    return out


@functools.lru_cache(maxsize=64)
def walls_of(history: Any) -> list[Law]:
    """The reference's elastomers of the balloons of a scenario."""
    return [loaded_law(balloon.elastomer) for balloon in history.scenario.balloons]


def _balance(history: History) -> list[str]:
    """Every sample is an equilibrium, but for where a flow ends the history."""
    walls, balloons = walls_of(history), history.scenario.balloons
    places = [history.balloons.index(name) for name in history.electroded]
    rows = len(history)
    if history.outcome.value not in ("completed", "failed"):
        rows = int(np.searchsorted(history.time, history.time[-1])) or 1
    worst, at = 0.0, 0
    for row in range(rows):
        voltage = np.zeros(len(balloons))
        voltage[places] = history.voltage[row]
        apart = float(
            np.max(
                np.abs(balance(walls, balloons, history.stretch[row], float(history.pressure[row]), voltage))
            )
        )
        if apart > worst:
            worst, at = apart, row
    if worst > BALANCE:
        return [
            f"sample {at} at time {float(history.time[at])!r} is out of balance by {worst:.2g} of its terms"
        ]
    return []


def _is_open(history: History) -> dict[int, bool]:
    return {
        number: hasattr(step, "inflate") or step.valve == "open"
        for number, step in enumerate(history.scenario.played_steps(), start=1)
    }


def _gas(history: History) -> list[str]:
    """The constant of the gas, while the valve stays closed."""
    gas = history.scenario.gas
    radius = np.array([b.radius for b in history.scenario.balloons])
    volume = gas.chamber + (radius**3 * history.stretch**3).sum(axis=1) / 3.0
    gamma = 1.0
    if gas.law == "liquid":
        constant = volume
    else:
        gamma = gas.exponent if gas.law == "adiabatic" else 1.0
        constant = (history.pressure + gas.ambient_pressure) * volume**gamma
    opened = _is_open(history)
    is_open = np.array([opened[int(step)] for step in history.step])
    out = []
    start: int | None = None
    ended = history.outcome.value not in ("completed", "failed")
    for row in range(len(history)):
        if is_open[row]:
            start = None
        elif start is None:
            start = row
        else:
            # A liquid keeps its volume in the flow that ends a history only as well as the flow does.
            last = ended and history.time[row] == history.time[-1]
            allowed = 1e-7 if last or history.scenario.dynamics is not None else GAS
            size = abs(constant[start]) if constant[start] else 1.0
            # In a vacuum the pressure of a large volume has few digits.
            rounding = 1e-15 + PRESSURE * (1.0 if gas.law == "liquid" else float(volume[row]) ** gamma)
            if abs(constant[row] - constant[start]) > allowed * size + rounding:
                change = float(constant[row] - constant[start]) / size
                out.append(
                    f"sample {row} at time {float(history.time[row])!r}: the gas has changed by {change:.2g}"
                )
                break
    return out


def _drive(history: History) -> list[str]:
    """Voltages, charges and pressures are those that the steps prescribe at their times."""
    names, films = list(history.balloons), list(history.electroded)
    places = [names.index(name) for name in films]
    steps: list[Any] = list(history.scenario.played_steps())
    driven = history.supply if history.supply.size else history.voltage
    unit = max([1.0, *np.max(np.abs(driven), axis=0, initial=0.0)])
    clock = 0.0
    before = np.zeros(len(names))
    pressure = 0.0
    given = "voltage"
    for number, step in enumerate(steps, start=1):
        rows = np.flatnonzero(history.step == number)
        charges = hasattr(step, "charge")
        if rows.size and charges:
            given = "charge"
        elif rows.size and not (hasattr(step, "hold") or hasattr(step, "inflate")):
            given = "voltage"
        if rows.size and hasattr(step, "inflate"):
            share = np.clip((history.time[rows] - clock) / step.over, 0.0, 1.0)
            apart = np.abs(history.pressure[rows] - (pressure + share * (step.inflate - pressure)))
            if np.max(apart) > DRIVE * max(1.0, step.inflate, pressure):
                return [f"step {number}: the pressure is off the ramp by {np.max(apart):.2g}"]
        if rows.size and given == "voltage" and films:
            parts = parts_of(step, names, films, before)
            for row in rows:
                wanted = _voltages(parts, float(history.time[row]) - clock)
                off = min(
                    float(np.max(np.abs(driven[row] - candidate[places]))) for candidate in (*wanted, before)
                )
                if off > DRIVE * unit:
                    return [f"step {number}, sample {row}: the voltage is off the drive by {off:.2g}"]
            before = np.zeros(len(names))
            before[places] = driven[rows[-1]]
        elif rows.size and films:
            if charges:
                problem = _charges(history, step, number, rows, clock)
                if problem:
                    return [problem]
            before[places] = driven[rows[-1]]
        if rows.size:
            clock = float(history.time[rows[-1]])
            pressure = float(history.pressure[rows[-1]])
    return []


def _voltages(parts: list[Any], t: float) -> list[FloatArray]:
    """What the drive has at a time, from both sides of a corner."""
    last = parts[-1].begin + parts[-1].lasts
    # Clocks have the rounding of the sum of all steps.
    near = 1e-9 * max(last, 1e-300)
    inside = [p for p in parts if p.begin - near <= t <= p.begin + p.lasts + near]
    return [p.voltages(min(max(t - p.begin, 0.0), p.lasts)) for p in (inside or parts[-1:])]


def _charges(history: History, step: Any, number: int, rows: NDArray[np.int64], clock: float) -> str | None:
    """A charge ramp, from what was there before."""
    if rows[0] == 0:
        return None
    first, lasts = history.charge[rows[0] - 1], step.over
    for column, name in enumerate(history.electroded):
        target = step.charge.get(name, first[column]) if isinstance(step.charge, dict) else step.charge
        share = np.clip((history.time[rows] - clock) / lasts, 0.0, 1.0)
        wanted = first[column] + share * (target - first[column])
        apart = np.max(np.abs(history.charge[rows, column] - wanted), initial=0.0)
        if apart > 1e-8 * max(1.0, abs(target), abs(float(first[column]))):
            return f"step {number}: the charge of {name} is off the ramp by {apart:.2g}"
    return None


def _energy(history: History) -> list[str]:
    books = history.energy_balance
    size = sum(b.radius**2 * b.thickness * b.modulus for b in history.scenario.balloons)
    stored = np.max(np.abs(history.energy))
    left = max(abs(books.imbalance) - ROUNDING * (size + float(stored)), 0.0)
    if history.outcome.value == "failed":
        return []
    allowed = ENERGY if history.scenario.dynamics is None else ENERGY_IN_REAL_TIME
    if left > allowed * books.exchanged:
        return [f"energy imbalance {books.imbalance:.2g} of {books.exchanged:.2g} exchanged"]
    return []
