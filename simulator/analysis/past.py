"""How the past of a history moves, to first order, with one number of the scenario.

What a later state depends on is what was sealed, or held, before: the amount of gas sealed depends on the
number and on the inflated state, the pressure of a valve that was opened on the sealed state of that moment.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.model.device import Device
from simulator.model.drive import VoltageLine
from simulator.results.history import History
from simulator.scenario import Inflate, Ramp
from simulator.scenario.keys import changed_scenario
from simulator.simulation import motion

if TYPE_CHECKING:
    from simulator.model.contents import Contents
    from simulator.model.groups import AnyEquations
    from simulator.scenario import PlayedStep, Scenario

FloatArray = NDArray[np.float64]

_STEP = 1e-3  # of q; the differences' error is about its sixth power, rounding one over it
_CENTRAL = {-3: -1 / 60, -2: 3 / 20, -1: -3 / 4, 1: 3 / 4, 2: -3 / 20, 3: 1 / 60}
_FORWARD = {0: -25.0 / 12.0, 1: 4.0, 2: -3.0, 3: 4.0 / 3.0, 4: -0.25}


@dataclass(frozen=True)
class OpenState:
    """The valve open: the state at the end of a step, or at a limit point in it.

    `number` is that step, 0 where the valve was never open; `sources` are what the electrodes are given. The
    pressure is that of an inflation, unless `before` is the sealed state in which the valve was opened.
    """

    number: int
    stretch: FloatArray
    pressure: float
    sources: VoltageLine
    before: SealedState | None


@dataclass(frozen=True)
class SealedState:
    """The valve closed: a state, and the one in which the valve was closed."""

    stretch: FloatArray
    pressure: float
    sources: VoltageLine
    since: OpenState


@dataclass(frozen=True)
class Moving:
    """How past states move, to first order, with the number `key` of a scenario, about its `value`."""

    scenario: Scenario
    key: str
    value: float

    def device(self, q: float) -> Device:
        """The device where the number is q."""
        return Device.from_scenario(changed_scenario(self.scenario, self.key, q))

    def pressure(self, state: OpenState) -> Callable[[float], float]:
        """The pressure of an open valve."""
        if state.before is None:
            return lambda q: _inflated(changed_scenario(self.scenario, self.key, q), state.number)
        rate = float(self._sealed_rate(state.before)[-1])
        return lambda q: state.pressure + (q - self.value) * rate

    def gas(self, state: OpenState) -> Callable[[float], Contents]:
        """What is inside when the valve is closed."""
        pressure, rate = self.pressure(state), self._open_rate(state)
        return lambda q: sealed_gas(self.device(q), state.stretch + (q - self.value) * rate, pressure(q))

    def _open_rate(self, state: OpenState) -> FloatArray:
        """dλ/dq of the balloons under an open valve; never inflated, they stay stress free."""
        if state.number == 0:
            return np.zeros_like(state.stretch)
        pressure = self.pressure(state)

        def balloons(q: float) -> list[tuple[AnyEquations, list[float]]]:
            device = self.device(q)
            return [
                (device.actuated(i, pressure(q), state.sources), [float(x), 0.0])
                for i, x in enumerate(state.stretch)
            ]

        def balances(q: float) -> FloatArray:
            return np.array([one.residual(y)[0] for one, y in balloons(q)], dtype=np.float64)

        slopes = [one.linearised(y)[1][0][0] for one, y in balloons(self.value)]
        return -derivative(balances, self.value) / np.array(slopes, dtype=np.float64)

    def _sealed_rate(self, state: SealedState) -> FloatArray:
        """d(λ, p)/dq of the balloons on their gas."""
        gas, y = self.gas(state.since), [*state.stretch.tolist(), state.pressure, 0.0]

        def equations(q: float) -> AnyEquations:
            return self.device(q).sealed(gas(q), state.sources)

        def balances(q: float) -> FloatArray:
            return np.array(equations(q).residual(y), dtype=np.float64)

        matrix = np.array(equations(self.value).linearised(y)[1], dtype=np.float64)[:, :-1]
        return np.asarray(-np.linalg.solve(matrix, derivative(balances, self.value)))


def last_open(history: History, steps: Sequence[PlayedStep], number: int) -> OpenState:
    """The state at the end of the last step up to `number` that the valve was open in."""
    last = next((i for i in range(number, 0, -1) if motion.opens_valve(steps[i - 1])), 0)
    return opened(history, steps, last)


def opened(history: History, steps: Sequence[PlayedStep], number: int) -> OpenState:
    """The state at the end of a step that the valve is open in."""
    if number == 0:
        return OpenState(0, np.ones(len(history.balloons)), 0.0, sources(history, steps, 0), None)
    first = number
    while first > 1 and motion.opens_valve(steps[first - 2]):
        first -= 1
    row = _end(history, number)
    stretch, pressure = history.stretch[row], float(history.pressure[row])
    inflated = any(isinstance(step, Inflate) for step in steps[first - 1 : number])
    before = None if inflated or first == 1 else _closed(history, steps, first - 1)
    return OpenState(number, stretch, pressure, sources(history, steps, number), before)


def _closed(history: History, steps: Sequence[PlayedStep], number: int) -> SealedState:
    """The state at the end of a step that the valve is closed in."""
    row = _end(history, number)
    since = last_open(history, steps, number)
    held = sources(history, steps, number)
    return SealedState(history.stretch[row], float(history.pressure[row]), held, since)


def _end(history: History, number: int) -> int:
    return int(np.flatnonzero(history.step <= number)[-1])


def sources(history: History, steps: Sequence[PlayedStep], number: int) -> VoltageLine:
    """What the electrodes are given at the end of a step, held there."""
    if number == 0:
        return VoltageLine.still([0.0] * len(history.electroded))
    given = [quantity for step in steps[:number] if (quantity := motion.given_by(step)) is not None]
    row = _end(history, number)
    if given and given[-1] == "charge":
        return VoltageLine.still(history.charge[row].tolist(), "charge")
    return VoltageLine.still(history.voltage[row].tolist())


def is_converted(history: History, steps: Sequence[PlayedStep]) -> bool:
    """Whether some film has a voltage in the last of some steps because of a charge before, or the reverse.

    It kept what it had as the other of the two was given, or the last step ramps it from there. That moves
    with every number, through the state of that moment.
    """
    given = "voltage"
    for number, step in enumerate(steps, start=1):
        now = motion.given_by(step)
        if now is None or now == given:
            continue
        given = now
        if number == 1:
            continue
        charge = history.charge[_end(history, number - 1)]
        charged = [name for name, value in zip(history.electroded, charge, strict=True) if value]
        if set(charged) & set(motion.left_alone(step, history.electroded)):
            return True
        # One film alone has but one line of voltages, wherever on it a ramp begins.
        if number == len(steps) and isinstance(step, Ramp) and charged and len(charge) > 1:
            return True
    return False


def sealed_gas(device: Device, stretch: FloatArray, pressure: float) -> Contents:
    """What is sealed in balloons of some stretches at a pressure."""
    return device.law.sealed(pressure, float(device.swelling(stretch[None])[0]))


def _inflated(scenario: Scenario, number: int) -> float:
    """What the last `inflate` up to a step, as played, sets the pressure to."""
    last = 0.0
    for place, step in enumerate(scenario.played_steps(), start=1):
        if place > number:
            break
        last = step.inflate if isinstance(step, Inflate) else last
    return last


def derivative(function: Callable[[float], FloatArray], at: float) -> FloatArray:
    """f′ by differences of sixth order; at 0, which many numbers must not fall below, from one side."""
    weights, step = (_CENTRAL, _STEP * abs(at)) if at else (_FORWARD, 0.1 * _STEP)
    here = function(at)  # taken off first: what does not depend on q then has a derivative of exactly 0
    return np.asarray(sum(w * (function(at + i * step) - here) for i, w in weights.items()) / step)
