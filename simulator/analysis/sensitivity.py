"""How a limit point moves when a number of the scenario changes.

At a limit point the equations R(x, v; q) = 0 have a singular ∂R/∂x. With z its left null vector,
zᵀ∂R/∂x = 0, the change of the drive v at which the branch folds is explicit, with nothing to solve for:

    dv*/dq = −(zᵀ ∂R/∂q) / (zᵀ ∂R/∂v).

∂R/∂q is total: the contents sealed, or the pressure held while the valve is open, depend on the state in
which the valve was last turned. That state moves with q as well, dy/dq = −(∂R/∂y)⁻¹ ∂R/∂q, and so on back to
the stress-free state. Derivatives in q are differences of R, not of limit points: of a smooth function at one
state, with central differences of fourth order good to ten digits or more. So any number that the scenario's
grammar has can be q.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.model.device import Device
from simulator.model.drive import Quantity, VoltageLine
from simulator.results.history import Event, EventKind, History
from simulator.results.sensitivity import Sensitivity
from simulator.scenario import Charge, Inflate, Sine, SineByName, duration
from simulator.scenario.keys import changed_scenario, number_at, physical_keys
from simulator.simulation import motion
from simulator.simulation.motion import Electrodes

if TYPE_CHECKING:
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
        see `simulator.scenario.keys.physical_keys`.

    Returns
    -------
    tuple of Sensitivity
        By key, and for each by balloon with electrodes whose voltage moves in that step.

    Raises
    ------
    ValueError
        If the event is no limit point, is one of given charges or of sines by name, comes after a step
        that an `until` ended (where that is moves with the numbers too), or the scenario has `[dynamics]`,
        with which a limit point is passed late.
    ArithmeticError
        If its state is not one to rounding.

    Examples
    --------
    >>> from simulator import load_scenario, simulate
    >>> history = simulate(load_scenario("scenarios/fig3c_state_b.toml"))
    >>> (one,) = sensitivities(history, history.events[0], ["gas.ambient_pressure"])
    >>> one.of, round(one.derivative, 4)
    ('voltage_active', 0.1949)
    """
    if history.scenario.dynamics is not None:
        raise ValueError("with [dynamics] a limit point is passed late: no sensitivities")
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
class _Turned:
    """The state in which the valve was turned, or the last one of a phase with the valve in one position.

    Attributes
    ----------
    is_open : bool
        The valve's position before.
    line : VoltageLine
        The voltages, or charges, that were given then.
    pressure : float
    stretch : (n_balloons,) array
    inflation : int or None
        Number of the step that set the pressure while the valve was open; None where it was held.
    before : _Turned or None
        The state in which the valve was turned before that; None where that is the stress-free one.
    """

    is_open: bool
    line: VoltageLine
    pressure: float
    stretch: FloatArray
    inflation: int | None
    before: _Turned | None

    def rates(self, scenario: Scenario, key: str, value: float) -> tuple[float, FloatArray]:
        """dp/dq and dλ/dq."""
        if not self.is_open:
            return self._closed_rates(scenario, key, value)
        along, base = self.pressure_rate(scenario, key, value), Device.from_scenario(scenario)

        def balances(q: float) -> FloatArray:
            device = Device.from_scenario(changed_scenario(scenario, key, q))
            pressure = self.pressure + (q - value) * along
            walls = [device.actuated(i, pressure, self.line) for i in range(len(self.stretch))]
            return np.array([w.residual([x, 0.0])[0] for w, x in zip(walls, self.stretch, strict=True)])

        walls = [base.actuated(i, self.pressure, self.line) for i in range(len(self.stretch))]
        slopes = [w.linearised([x, 0.0])[1][0][0] for w, x in zip(walls, self.stretch, strict=True)]
        return along, -_derivative(balances, value) / np.array(slopes, dtype=np.float64)

    def pressure_rate(self, scenario: Scenario, key: str, value: float) -> float:
        """dp/dq of the pressure that is given while the valve is open."""
        number = self.inflation
        if number is None:
            return 0.0 if self.before is None else self.before.rates(scenario, key, value)[0]

        def set_to(q: float) -> FloatArray:
            return np.array([_inflation(changed_scenario(scenario, key, q), number)])

        return float(_derivative(set_to, value)[0])

    def _closed_rates(self, scenario: Scenario, key: str, value: float) -> tuple[float, FloatArray]:
        state = [*self.stretch.tolist(), self.pressure, 0.0]
        sealed = _sealed(scenario, key, value, self.before, self.line)
        moved = _derivative(lambda q: np.array(sealed(q).residual(state), dtype=np.float64), value)
        matrix = np.array(sealed(value).linearised(state)[1], dtype=np.float64)[:, :-1]
        rates = -np.linalg.solve(matrix, moved)
        return float(rates[-1]), np.asarray(rates[:-1])


def _sealed(
    scenario: Scenario, key: str, value: float, turned: _Turned | None, line: VoltageLine
) -> Callable[[float], AnyEquations]:
    """The equations with the valve closed as a function of q, with which the state it was closed in moves."""
    device = Device.from_scenario(scenario)
    pressure = 0.0 if turned is None else turned.pressure
    stretch = np.ones(len(device.names)) if turned is None else turned.stretch
    pressure_rate, rates = (
        (0.0, np.zeros(stretch.size)) if turned is None else turned.rates(scenario, key, value)
    )

    def at(q: float) -> AnyEquations:
        device = Device.from_scenario(changed_scenario(scenario, key, q))
        swelling = device.swelling((stretch + (q - value) * rates)[None])
        gas = device.law.sealed(pressure + (q - value) * pressure_rate, float(swelling[0]))
        return device.sealed(gas, line)

    return at


@dataclass(frozen=True)
class _Here:
    """A limit point, the step in which it is met, and the state in which the valve was turned last."""

    scenario: Scenario
    step: PlayedStep
    line: VoltageLine
    state: FloatArray
    turned: _Turned

    @classmethod
    def of(cls, history: History, event: Event) -> _Here:
        """Of an event of a history. Raises ValueError where that has no sensitivities."""
        steps = [step for step, _ in zip(history.scenario.played_steps(), range(event.step), strict=False)]
        step = steps[-1]
        rows = np.flatnonzero(history.step < event.step)
        last = _end_of(history, event.step - 1)
        electrodes = Electrodes(last.voltage, last.charge, motion.given_by(step) or "voltage")
        legs = motion.motion(step, history.electroded, electrodes, last.pressure)
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
            line, v = VoltageLine.still(last.voltage), event.pressure_before
        else:
            v = line.coordinate(event.voltage.tolist())
        state = np.array([*event.stretch_before, event.pressure_before, v])
        return cls(history.scenario, step, line, state, _phase(history, steps, line))

    def rate(self, key: str, value: float) -> float:
        """dv*/dq."""
        residual, matrix = self._alone(key, value) if self.turned.is_open else self._together(key, value)
        # Rows and columns of one size, so that a small singular value means a singular matrix.
        sizes = np.sqrt(np.einsum("ij,ij->i", matrix, matrix))
        left, singular, _ = np.linalg.svd(matrix[:, :-1] / sizes[:, None])
        if singular[-1] > _SINGULAR:
            raise ArithmeticError(f"the state is no limit point, singular value {singular[-1]:.1e}")
        z = left[:, -1] / sizes
        return float(-(z @ _derivative(residual, value)) / (z @ matrix[:, -1]))

    def _together(self, key: str, value: float) -> tuple[Callable[[float], FloatArray], FloatArray]:
        """With the valve closed: R at this state as a function of q, and ∂R/∂(λ, p, v)."""
        sealed, state = _sealed(self.scenario, key, value, self.turned.before, self.line), self.state.tolist()
        matrix = np.array(sealed(value).linearised(state)[1], dtype=np.float64)
        return lambda q: np.array(sealed(q).residual(state), dtype=np.float64), matrix

    def _alone(self, key: str, value: float) -> tuple[Callable[[float], FloatArray], FloatArray]:
        """With the valve open, of the balloon that folds: R at this state, and ∂R/∂(λ, v)."""
        inflates = isinstance(self.step, Inflate)
        along = 0.0 if inflates else self.turned.pressure_rate(self.scenario, key, value)

        def equations(device: Device, balloon: int, q: float) -> AnyEquations:
            if inflates:
                return device.inflated(balloon, self.line.offset)
            return device.actuated(balloon, self.turned.pressure + (q - value) * along, self.line)

        base = Device.from_scenario(self.scenario)
        states = [[x, self.state[-1]] for x in self.state[: len(base.names)]]
        rows = [
            np.array(equations(base, i, value).linearised(y)[1], dtype=np.float64)
            for i, y in enumerate(states)
        ]
        place = min(range(len(rows)), key=lambda i: abs(rows[i][0, 0]))

        def residual(q: float) -> FloatArray:
            device = Device.from_scenario(changed_scenario(self.scenario, key, q))
            return np.array(equations(device, place, q).residual(states[place]), dtype=np.float64)

        # One equation: ∂R/∂λ itself vanishes, beside ∂R/∂v.
        return residual, rows[place]


@dataclass(frozen=True)
class _Ended:
    """The state at the end of a step."""

    stretch: FloatArray
    pressure: float
    voltage: list[float]
    charge: list[float]


def _end_of(history: History, number: int) -> _Ended:
    """The state at the end of a step; before the first one the stress-free state."""
    rows = np.flatnonzero(history.step <= number)
    if not rows.size:
        none = [0.0] * len(history.electroded)
        return _Ended(np.ones(len(history.balloons)), 0.0, none, none)
    row = rows[-1]
    return _Ended(
        history.stretch[row],
        float(history.pressure[row]),
        history.voltage[row].tolist(),
        history.charge[row].tolist(),
    )


def _phase(history: History, steps: Sequence[PlayedStep], line: VoltageLine | None = None) -> _Turned:
    """The last of some steps of a history, with the states in which the valve was turned before it.

    `line` is the way of the drive in the last step; None for what was given at its end.
    """
    is_open, number = _opens(steps[-1]), len(steps)
    begun = number
    while begun and _opens(steps[begun - 1]) == is_open:
        begun -= 1
    inflation = next(
        (i for i in range(number, begun, -1) if isinstance(steps[i - 1], Inflate)) if is_open else iter(()),
        None,
    )
    before = _phase(history, steps[:begun]) if begun else None
    if line is not None:
        # In the course of the step, before its end.
        pressure = _end_of(history, number - 1).pressure
        return _Turned(is_open, line, pressure, np.empty(0), inflation, before)
    end = _end_of(history, number)
    given: Quantity = next((found for step in reversed(steps) if (found := motion.given_by(step))), "voltage")
    held = Electrodes(end.voltage, end.charge, given).line
    return _Turned(is_open, held, end.pressure, end.stretch, inflation, before)


def _ended_early(history: History, event: Event) -> bool:
    return any(stop.reached and stop.step < event.step for stop in history.stops)


def _opens(step: PlayedStep) -> bool:
    return isinstance(step, Inflate) or step.valve == "open"


def _inflation(scenario: Scenario, number: int) -> float:
    """The pressure that the step of a number, as played, inflates to."""
    step = next(step for i, step in enumerate(scenario.played_steps(), start=1) if i == number)
    return float(step.inflate) if isinstance(step, Inflate) else 0.0


def _derivative(function: Callable[[float], FloatArray], at: float) -> FloatArray:
    """f′ by differences of fourth order; from one side at 0, which many numbers must not fall below."""
    weights, step = (_CENTRAL, _STEP * abs(at)) if at else (_FORWARD, 0.1 * _STEP)
    here = function(at)  # taken off first: what does not depend on q then has a derivative of exactly 0
    return np.asarray(sum(w * (function(at + i * step) - here) for i, w in weights.items()) / step)
