"""How a limit point moves when a number of the scenario changes.

At a limit point the equations R(x, v; q) = 0 have a singular ∂R/∂x. With z its left null vector,
zᵀ∂R/∂x = 0, the change of the drive v at which the branch folds is explicit, with nothing to solve for:

    dv*/dq = −(zᵀ ∂R/∂q) / (zᵀ ∂R/∂v).

∂R/∂q is total: the amount of gas sealed depends on q too, and on the inflated state, which moves as
dλ⁰/dq = −(∂g/∂q)/(∂g/∂λ). Derivatives in q are differences of R, not of limit points: of a smooth function
at one state, with central differences of fourth order good to ten digits or more. So any number that the
scenario's grammar has can be q.
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
        that an `until` ended: where that is moves with the numbers too.
    ArithmeticError
        If its state is not one to rounding.
    """
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
class _Here:
    """A limit point, the step in which it is met, and the state in which its gas was sealed.

    `number` is the step that the valve was open in last, None where it never was; `inflated` and
    `held` are stretches and voltages at its end.
    """

    scenario: Scenario
    step: PlayedStep
    line: VoltageLine
    state: FloatArray
    is_open: bool
    number: int | None
    inflated: FloatArray
    held: tuple[float, ...]

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
        is_open = _opens(step)
        if isinstance(step, Inflate):
            line, v = VoltageLine(tuple(voltage.tolist()), (0.0,) * voltage.size), event.pressure_before
        else:
            v = line.coordinate(event.voltage.tolist())
        state = np.array([*event.stretch_before, event.pressure_before, v])
        last = next((i for i in range(event.step - is_open, 0, -1) if _opens(steps[i - 1])), None)
        if is_open or last is None:
            number = event.step if is_open else None
            return cls(
                history.scenario, step, line, state, is_open, number, np.ones(len(history.balloons)), ()
            )
        sealed = np.flatnonzero(history.step <= last)[-1]
        return cls(
            history.scenario,
            step,
            line,
            state,
            is_open,
            last,
            history.stretch[sealed],
            tuple(history.voltage[sealed].tolist()),
        )

    def rate(self, key: str, value: float) -> float:
        """dv*/dq."""
        matrix, place = self._jacobian()
        # Rows and columns of one size, so that a small singular value means a singular matrix.
        sizes = np.sqrt(np.einsum("ij,ij->i", matrix, matrix))
        left, singular, _ = np.linalg.svd(matrix[:, :-1] / sizes[:, None])
        if singular[-1] > _SINGULAR:
            raise ArithmeticError(f"the state is no limit point, singular value {singular[-1]:.1e}")
        z = left[:, -1] / sizes
        moved = _derivative(self._residual(key, value, place), value)
        return float(-(z @ moved) / (z @ matrix[:, -1]))

    def _jacobian(self) -> tuple[FloatArray, int]:
        """∂R/∂(x, v), and with the valve open the balloon that folds."""
        device = Device.from_scenario(self.scenario)
        if not self.is_open:
            gas = self._gas(self.scenario, device, self.inflated)
            equations: AnyEquations = device.sealed(gas, self.line)
            return np.array(equations.linearised(self.state.tolist())[1], dtype=np.float64), -1
        rows = [
            np.array(self._open(device, i).linearised([self.state[i], self.state[-1]])[1], dtype=np.float64)
            for i in range(len(device.names))
        ]
        place = min(range(len(rows)), key=lambda i: abs(rows[i][0, 0]))
        # One equation: ∂R/∂λ itself vanishes, beside ∂R/∂v.
        return rows[place], place

    def _open(self, device: Device, balloon: int, scenario: Scenario | None = None) -> AnyEquations:
        """One balloon with the valve open, in this step."""
        if isinstance(self.step, Inflate):
            return device.inflated(balloon, self.line.offset)
        pressure = _pressure(scenario or self.scenario, self.number)
        return device.actuated(balloon, pressure, self.line)

    def _residual(self, key: str, value: float, place: int) -> Callable[[float], FloatArray]:
        """R at this state as a function of q, the inflated state moving with it to first order."""
        if self.is_open:

            def alone(q: float) -> FloatArray:
                scenario = changed_scenario(self.scenario, key, q)
                equations = self._open(Device.from_scenario(scenario), place, scenario)
                return np.array(equations.residual([self.state[place], self.state[-1]]), dtype=np.float64)

            return alone
        along = self._inflated_rate(key, value)

        def together(q: float) -> FloatArray:
            scenario = changed_scenario(self.scenario, key, q)
            device = Device.from_scenario(scenario)
            gas = self._gas(scenario, device, self.inflated + (q - value) * along)
            return np.array(device.sealed(gas, self.line).residual(self.state.tolist()), dtype=np.float64)

        return together

    def _inflated_rate(self, key: str, value: float) -> FloatArray:
        """dλ⁰/dq of the state in which the gas was sealed; a device never inflated stays stress free."""
        if self.number is None:
            return np.zeros_like(self.inflated)

        def balances(q: float) -> FloatArray:
            scenario = changed_scenario(self.scenario, key, q)
            device = Device.from_scenario(scenario)
            return np.array(
                [w.residual([x, 0.0])[0] for w, x in self._walls(scenario, device)], dtype=np.float64
            )

        base = Device.from_scenario(self.scenario)
        slopes = [w.linearised([x, 0.0])[1][0][0] for w, x in self._walls(self.scenario, base)]
        return -_derivative(balances, value) / np.array(slopes, dtype=np.float64)

    def _walls(self, scenario: Scenario, device: Device) -> list[tuple[AnyEquations, float]]:
        """Each balloon as it was when the valve closed, and its stretch."""
        held = VoltageLine(self.held, (0.0,) * len(self.held))
        pressure = _pressure(scenario, self.number)
        return [(device.actuated(i, pressure, held), float(x)) for i, x in enumerate(self.inflated)]

    def _gas(self, scenario: Scenario, device: Device, inflated: FloatArray) -> Contents:
        return device.law.sealed(_pressure(scenario, self.number), float(device.swelling(inflated[None])[0]))


def _ended_early(history: History, event: Event) -> bool:
    return any(stop.reached and stop.step < event.step for stop in history.stops)


def _opens(step: PlayedStep) -> bool:
    return isinstance(step, Inflate) or step.valve == "open"


def _pressure(scenario: Scenario, number: int | None) -> float:
    """What the last `inflate` up to a step, as played, sets the pressure to."""
    last = 0.0
    for place, step in enumerate(scenario.played_steps(), start=1):
        if number is None or place > number:
            break
        last = step.inflate if isinstance(step, Inflate) else last
    return last


def _derivative(function: Callable[[float], FloatArray], at: float) -> FloatArray:
    """f′ by differences of fourth order; from one side at 0, which many numbers must not fall below."""
    weights, step = (_CENTRAL, _STEP * abs(at)) if at else (_FORWARD, 0.1 * _STEP)
    here = function(at)  # taken off first: what does not depend on q then has a derivative of exactly 0
    return np.asarray(sum(w * (function(at + i * step) - here) for i, w in weights.items()) / step)
