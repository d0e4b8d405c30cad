"""How a limit point moves when a number of the scenario changes.

At a limit point the equations R(x, v; q) = 0 have a singular ∂R/∂x. With z its left null vector,
zᵀ∂R/∂x = 0, the change of the drive v at which the branch folds is explicit, with nothing to solve for:

    dv*/dq = −(zᵀ ∂R/∂q) / (zᵀ ∂R/∂v).

∂R/∂q is total: the amount of gas sealed depends on q too, and on the inflated state, which moves as
dλ⁰/dq = −(∂g/∂q)/(∂g/∂λ). With the valve open the pressure is the one at which the valve was opened, and
moves with the sealed state of that moment. Derivatives in q are differences of R, not of limit points: of a
smooth function at one state, with central differences of fourth order good to ten digits or more. So any
number that the scenario's grammar has can be q.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.events import EventKind
from simulator.model.device import Device
from simulator.model.drive import VoltageLine
from simulator.results.history import Event, History
from simulator.results.sensitivity import Sensitivity
from simulator.scenario import Charge, Inflate, Sine, SineByName, duration
from simulator.scenario.keys import changed_scenario, number_at, physical_keys
from simulator.simulation import motion
from simulator.simulation.motion import Electrodes

if TYPE_CHECKING:
    from simulator.model.contents import Contents
    from simulator.model.groups import AnyEquations
    from simulator.scenario import PlayedStep, Scenario

FloatArray = NDArray[np.float64]

_STEP = 1e-3  # of q; the differences' error is about its fourth power, rounding one over it
_CENTRAL = {-2: 1.0 / 12.0, -1: -2.0 / 3.0, 1: 2.0 / 3.0, 2: -1.0 / 12.0}
_FORWARD = {0: -25.0 / 12.0, 1: 4.0, 2: -3.0, 3: 4.0 / 3.0, 4: -0.25}
_SINGULAR = 1e-6  # of rows of unit length


def sensitivities(
    history: History, event: Event, keys: Sequence[str] | None = None
) -> tuple[Sensitivity, ...]:
    """Derivatives of a limit point of a history in numbers of its scenario.

    Parameters
    ----------
    history : History
    event : Event
        A limit point of it.
    keys : sequence of str, optional
        Which numbers, by dotted key. Default: all that the device, its gas and its inflation have,
        see `keys.physical_keys`.

    Returns
    -------
    tuple of Sensitivity
        By key, and for each by balloon with electrodes whose voltage moves in that step.

    Raises
    ------
    ValueError
        If the event is no limit point, is one of given charges or of sines by name, or comes after a step
        that an `until` ended: where that is moves with the numbers too. Also if the scenario has
        `[dynamics]`, with which a limit point is passed late.
    ArithmeticError
        If its state is not one to rounding.

    Examples
    --------
    >>> from simulator import load_scenario, simulate
    >>> history = simulate(load_scenario("scenarios/fig3c_state_b.toml"))
    >>> (one,) = sensitivities(history, history.events[0], ["gas.ambient_pressure"])
    >>> one.of, round(one.derivative, 4)
    ('voltage_active', 0.1951)
    """
    if history.scenario.dynamics is not None:
        raise ValueError("with [dynamics] a limit point is passed late: it has no sensitivities")
    if event.kind is not EventKind.LIMIT_POINT:
        raise ValueError(f"{event.kind.value} at time {event.time}: only a limit point moves smoothly")
    scenario = history.scenario
    here = _Here.of(history, event)
    found = []
    for key in physical_keys(scenario) if keys is None else keys:
        value = number_at(scenario, key)
        rate = here.rate(key, value)
        if isinstance(here.step, Inflate):
            moved = [("pressure", event.pressure_before, rate)]
        else:
            moved = [
                (f"voltage_{name}", float(voltage), rate * share)
                for name, voltage, share in zip(
                    history.electroded, event.voltage, here.line.rate, strict=True
                )
                if share
            ]
        found += [Sensitivity(event.time, event.step, of, at, key, value, slope) for of, at, slope in moved]
    return tuple(found)


def all_sensitivities(history: History) -> tuple[Sensitivity, ...]:
    """`sensitivities` of all limit points of a history, in all numbers of its device.

    Those in voltage or pressure, along a line and not after a step that an `until` ended; with
    `[dynamics]` a limit point is passed late, and there are none.
    """
    if history.scenario.dynamics is not None:
        return ()
    curved = [
        isinstance(step, Charge) or (isinstance(step, Sine) and isinstance(step.sine, SineByName))
        for step in history.scenario.played_steps()
    ]
    turns = [
        event
        for event in history.events
        if event.kind is EventKind.LIMIT_POINT
        and not curved[event.step - 1]
        and not _ended_early(history, event)
    ]
    return tuple(one for event in turns for one in sensitivities(history, event))


@dataclass(frozen=True)
class _Open:
    """The valve open: the state at the end of a step, or at a limit point in it.

    `number` is that step, 0 where the valve was never open; `sources` are what the electrodes are given. The
    pressure is that of an inflation, unless `before` is the sealed state in which the valve was opened.
    """

    number: int
    stretch: FloatArray
    pressure: float
    sources: VoltageLine
    before: _Sealed | None


@dataclass(frozen=True)
class _Sealed:
    """The valve closed: a state, and the one in which the valve was closed."""

    stretch: FloatArray
    pressure: float
    sources: VoltageLine
    since: _Open


@dataclass(frozen=True)
class _Here:
    """A limit point, the step in which it is met, and the state in which the valve was opened or closed last.

    `line` is the way that the voltages go there, `state` its unknowns (stretches…, p, v).
    """

    scenario: Scenario
    step: PlayedStep
    line: VoltageLine
    state: FloatArray
    since: _Open | None
    opened: _Open | None

    @classmethod
    def of(cls, history: History, event: Event) -> _Here:
        steps = [step for step, _ in zip(history.scenario.played_steps(), range(event.step), strict=False)]
        step = steps[-1]
        rows = np.flatnonzero(history.step < event.step)
        voltage = history.voltage[rows[-1]] if rows.size else np.zeros(len(history.electroded))
        pressure = float(history.pressure[rows[-1]]) if rows.size else 0.0
        charge = history.charge[rows[-1]] if rows.size else np.zeros(len(history.electroded))
        electrodes = Electrodes(voltage.tolist(), charge.tolist(), motion.given_by(step) or "voltage")
        legs = motion.motion(step, history.electroded, electrodes, pressure)
        begun = float(history.time[rows[-1]]) if rows.size else 0.0
        share = (event.time - begun) / duration(step)
        line = next((leg for leg in legs if share <= leg.end), legs[-1]).way
        if line.quantity == "charge":
            raise ValueError(f"limit point at time {event.time}: of a charge, not of a voltage")
        if not isinstance(line, VoltageLine):
            raise ValueError(f"limit point at time {event.time}: of sines by name, not of a voltage")
        if _ended_early(history, event):
            raise ValueError(f"limit point at time {event.time}: an until before it moves too")
        if isinstance(step, Inflate):
            line, v = VoltageLine(tuple(voltage.tolist()), (0.0,) * voltage.size), event.pressure_before
        else:
            v = line.coordinate(event.voltage.tolist())
        state = np.array([*event.stretch_before, event.pressure_before, v])
        if motion.opens_valve(step):
            return cls(history.scenario, step, line, state, None, _opened(history, steps, event.step))
        return cls(history.scenario, step, line, state, _last_open(history, steps, event.step - 1), None)

    def rate(self, key: str, value: float) -> float:
        """dv*/dq."""
        matrix, place = self._jacobian()
        # Rows and columns of one size, so that a small singular value means a singular matrix.
        sizes = np.sqrt(np.einsum("ij,ij->i", matrix, matrix))
        left, singular, _ = np.linalg.svd(matrix[:, :-1] / sizes[:, None])
        if singular[-1] > _SINGULAR:
            raise ArithmeticError(f"the state is no limit point, singular value {singular[-1]:.1e}")
        z = left[:, -1] / sizes
        moved = _derivative(self._residual(_Moving(self.scenario, key, value), place), value)
        return float(-(z @ moved) / (z @ matrix[:, -1]))

    def _jacobian(self) -> tuple[FloatArray, int]:
        """∂R/∂(x, v), and with the valve open the balloon that folds."""
        device = Device.from_scenario(self.scenario)
        if self.since is not None:
            gas = _gas(device, self.since.stretch, self.since.pressure)
            equations: AnyEquations = device.sealed(gas, self.line)
            return np.array(equations.linearised(self.state.tolist())[1], dtype=np.float64), -1
        pressure = float(self.state[-2])
        rows = [
            np.array(
                self._alone(device, i, pressure).linearised([self.state[i], self.state[-1]])[1],
                dtype=np.float64,
            )
            for i in range(len(device.names))
        ]
        place = min(range(len(rows)), key=lambda i: abs(rows[i][0, 0]))
        # One equation: ∂R/∂λ itself vanishes, beside ∂R/∂v.
        return rows[place], place

    def _alone(self, device: Device, balloon: int, pressure: float) -> AnyEquations:
        """One balloon with the valve open, in this step."""
        if isinstance(self.step, Inflate):
            return device.inflated(balloon, self.line.offset)
        return device.actuated(balloon, pressure, self.line)

    def _residual(self, moving: _Moving, place: int) -> Callable[[float], FloatArray]:
        """R at this state as a function of q, with what was sealed, or the pressure held, moving with it."""
        if self.since is None:
            assert self.opened is not None
            held = moving.pressure(self.opened)

            def alone(q: float) -> FloatArray:
                equations = self._alone(moving.device(q), place, held(q))
                return np.array(equations.residual([self.state[place], self.state[-1]]), dtype=np.float64)

            return alone
        gas = moving.gas(self.since)

        def together(q: float) -> FloatArray:
            equations = moving.device(q).sealed(gas(q), self.line)
            return np.array(equations.residual(self.state.tolist()), dtype=np.float64)

        return together


@dataclass(frozen=True)
class _Moving:
    """How past states move, to first order, with the number `key` of a scenario, about its `value`."""

    scenario: Scenario
    key: str
    value: float

    def device(self, q: float) -> Device:
        """The device where the number is q."""
        return Device.from_scenario(changed_scenario(self.scenario, self.key, q))

    def pressure(self, state: _Open) -> Callable[[float], float]:
        """The pressure of an open valve."""
        if state.before is None:
            return lambda q: _inflated(changed_scenario(self.scenario, self.key, q), state.number)
        rate = float(self._sealed_rate(state.before)[-1])
        return lambda q: state.pressure + (q - self.value) * rate

    def gas(self, state: _Open) -> Callable[[float], Contents]:
        """What is inside when the valve is closed."""
        pressure, rate = self.pressure(state), self._open_rate(state)
        return lambda q: _gas(self.device(q), state.stretch + (q - self.value) * rate, pressure(q))

    def _open_rate(self, state: _Open) -> FloatArray:
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
        return -_derivative(balances, self.value) / np.array(slopes, dtype=np.float64)

    def _sealed_rate(self, state: _Sealed) -> FloatArray:
        """d(λ, p)/dq of the balloons on their gas."""
        gas, y = self.gas(state.since), [*state.stretch.tolist(), state.pressure, 0.0]

        def equations(q: float) -> AnyEquations:
            return self.device(q).sealed(gas(q), state.sources)

        def balances(q: float) -> FloatArray:
            return np.array(equations(q).residual(y), dtype=np.float64)

        matrix = np.array(equations(self.value).linearised(y)[1], dtype=np.float64)[:, :-1]
        return np.asarray(-np.linalg.solve(matrix, _derivative(balances, self.value)))


def _last_open(history: History, steps: Sequence[PlayedStep], number: int) -> _Open:
    """The state at the end of the last step up to `number` that the valve was open in."""
    last = next((i for i in range(number, 0, -1) if motion.opens_valve(steps[i - 1])), 0)
    return _opened(history, steps, last)


def _opened(history: History, steps: Sequence[PlayedStep], number: int) -> _Open:
    """The state at the end of a step that the valve is open in."""
    if number == 0:
        return _Open(0, np.ones(len(history.balloons)), 0.0, _sources(history, steps, 0), None)
    first = number
    while first > 1 and motion.opens_valve(steps[first - 2]):
        first -= 1
    row = _end(history, number)
    stretch, pressure = history.stretch[row], float(history.pressure[row])
    inflated = any(isinstance(step, Inflate) for step in steps[first - 1 : number])
    before = None if inflated or first == 1 else _closed(history, steps, first - 1)
    return _Open(number, stretch, pressure, _sources(history, steps, number), before)


def _closed(history: History, steps: Sequence[PlayedStep], number: int) -> _Sealed:
    """The state at the end of a step that the valve is closed in."""
    row = _end(history, number)
    since = _last_open(history, steps, number)
    sources = _sources(history, steps, number)
    return _Sealed(history.stretch[row], float(history.pressure[row]), sources, since)


def _end(history: History, number: int) -> int:
    return int(np.flatnonzero(history.step <= number)[-1])


def _sources(history: History, steps: Sequence[PlayedStep], number: int) -> VoltageLine:
    """What the electrodes are given at the end of a step, held there."""
    if number == 0:
        return VoltageLine.still([0.0] * len(history.electroded))
    given = [quantity for step in steps[:number] if (quantity := motion.given_by(step)) is not None]
    row = _end(history, number)
    if given and given[-1] == "charge":
        return VoltageLine.still(history.charge[row].tolist(), "charge")
    return VoltageLine.still(history.voltage[row].tolist())


def _gas(device: Device, stretch: FloatArray, pressure: float) -> Contents:
    return device.law.sealed(pressure, float(device.swelling(stretch[None])[0]))


def _ended_early(history: History, event: Event) -> bool:
    return any(stop.reached and stop.step < event.step for stop in history.stops)


def _inflated(scenario: Scenario, number: int) -> float:
    """What the last `inflate` up to a step, as played, sets the pressure to."""
    last = 0.0
    for place, step in enumerate(scenario.played_steps(), start=1):
        if place > number:
            break
        last = step.inflate if isinstance(step, Inflate) else last
    return last


def _derivative(function: Callable[[float], FloatArray], at: float) -> FloatArray:
    """f′ by differences of fourth order; from one side at 0, which many numbers must not fall below."""
    weights, step = (_CENTRAL, _STEP * abs(at)) if at else (_FORWARD, 0.1 * _STEP)
    here = function(at)  # taken off first: what does not depend on q then has a derivative of exactly 0
    return np.asarray(sum(w * (function(at + i * step) - here) for i, w in weights.items()) / step)
