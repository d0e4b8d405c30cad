"""How a limit point, or where a balloon stops being a sphere, moves when a number of the scenario changes.

At a limit point the equations R(x, v; q) = 0 have a singular ∂R/∂x. With z its left null vector,
zᵀ∂R/∂x = 0, the change of the drive v at which the branch folds is explicit, with nothing to solve for:

    dv*/dq = −(zᵀ ∂R/∂q) / (zᵀ ∂R/∂v).

∂R/∂q is total: the amount of gas sealed depends on q too, and on the inflated state, which moves as
dλ⁰/dq = −(∂g/∂q)/(∂g/∂λ). With the valve open the pressure is the one at which the valve was opened, and
moves with the sealed state of that moment. Derivatives in q are differences of R, not of limit points: of a
smooth function at one state, with central differences of sixth order good to ten digits or more. So any
number that the scenario's grammar has can be q.

A loss of sphericity is a regular point of R = 0, s = 0: (x, v) moves by the implicit function theorem.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.analysis.limit_points import margin_of
from simulator.analysis.past import (
    Moving,
    OpenState,
    derivative,
    is_converted,
    last_open,
    opened,
    sealed_gas,
    sources,
)
from simulator.events import SHAPE_EVENTS, EventKind
from simulator.model.conditions import gradient
from simulator.model.device import Device
from simulator.model.drive import VoltageLine
from simulator.results.history import Event, History
from simulator.results.sensitivity import Sensitivity
from simulator.scenario import Charge, Inflate, Sine, SineByName, duration
from simulator.scenario.dimensions import unit_of
from simulator.scenario.keys import number_at, physical_keys
from simulator.simulation import motion
from simulator.simulation.motion import Electrodes
from simulator.units import PRESSURE, VOLTAGE

if TYPE_CHECKING:
    from simulator.model.groups import AnyEquations
    from simulator.scenario import PlayedStep, Scenario

FloatArray = NDArray[np.float64]

_SINGULAR = 1e-6  # of rows of unit length


def sensitivities(
    history: History, event: Event, keys: Sequence[str] | None = None
) -> tuple[Sensitivity, ...]:
    """Derivatives of a limit point, or a loss of sphericity, of a history in numbers of its scenario.

    Parameters
    ----------
    history : History
    event : Event
        A limit point of it; or a balloon's loss of sphericity, or its end, on a branch.
    keys : sequence of str, optional
        Which numbers, by dotted key. Default: all that the device, its gas and its inflation have,
        see `keys.physical_keys`.

    Returns
    -------
    tuple of Sensitivity
        By key, and for each by balloon with electrodes whose voltage moves in that step. In units where the
        scenario has [scales].

    Raises
    ------
    ValueError
        If the event is none of these, is one of given charges or of sines by name, or comes after a step
        that an `until` ended: where that is moves with the numbers too. So does a voltage that follows from
        a charge given before, or a charge from a voltage. Also if the scenario has `[dynamics]`, with which a
        limit point is passed late.
    ArithmeticError
        If its state is not one to rounding.

    Examples
    --------
    >>> from simulator import load_scenario, simulate
    >>> history = simulate(load_scenario("scenarios/fig3c_state_b.toml"))
    >>> (one,) = sensitivities(history, history.mechanical[0], ["gas.ambient_pressure"])
    >>> one.of, round(one.derivative, 4)
    ('voltage_active', 0.1951)
    """
    if history.scenario.dynamics is not None:
        raise ValueError("with [dynamics] a limit point is passed late: it has no sensitivities")
    if not _moves_smoothly(event):
        raise ValueError(
            f"{event.kind.value} at time {event.time}: only a limit point, "
            "or a change of shape on a branch, moves smoothly"
        )
    scenario = history.scenario
    here = _Here.of(history, event)
    found = []
    for key in physical_keys(scenario) if keys is None else keys:
        value = number_at(scenario, key)
        rate = here.rate(key, value)
        if isinstance(here.step, Inflate):
            moved = [("pressure", event.pressure_before, rate)]
            dimension = PRESSURE
        else:
            dimension = VOLTAGE
            moved = [
                (f"voltage_{name}", float(voltage), rate * share)
                for name, voltage, share in zip(
                    history.electroded, event.voltage, here.line.rate, strict=True
                )
                if share
            ]
        scale, units = 1.0, ("", "")
        if scenario.scales is not None:
            scale, units = scenario.scales.of(dimension), (dimension.unit, unit_of(scenario, key))
        found += [
            Sensitivity(
                event.time, event.step, of, at * scale, key, value, slope * scale, event.kind.value, *units
            )
            for of, at, slope in moved
        ]
    return tuple(found)


def all_sensitivities(history: History) -> tuple[Sensitivity, ...]:
    """`sensitivities` of all limit points and changes of shape of a history, in all numbers of its device.

    Those in voltage or pressure, along a line, and not where what was before moves with the numbers in a way
    that `sensitivities` refuses; with `[dynamics]` a limit point is passed late, and there are none.
    """
    if history.scenario.dynamics is not None:
        return ()
    curved = [
        isinstance(step, Charge) or (isinstance(step, Sine) and isinstance(step.sine, SineByName))
        for step in history.scenario.played_steps()
    ]
    steps = list(history.scenario.played_steps())
    turns = [
        event
        for event in history.events
        if _moves_smoothly(event)
        and not curved[event.step - 1]
        and not _ended_early(history, event)
        and not is_converted(history, steps[: event.step])
    ]
    return tuple(one for event in turns for one in sensitivities(history, event))


def _moves_smoothly(event: Event) -> bool:
    """Whether an event is a limit point, or a change of shape on a branch."""
    if event.kind is EventKind.LIMIT_POINT:
        return True
    return event.kind in SHAPE_EVENTS and np.array_equal(
        event.stretch_before, np.asarray(event.stretch_after)
    )


@dataclass(frozen=True)
class _Here:
    """A limit point, the step in which it is met, and the state in which the valve was opened or closed last.

    `line` is the way that the voltages go there, `state` its unknowns (stretches…, p, v). Of a change of
    shape, which balloon's, and its mode.
    """

    scenario: Scenario
    step: PlayedStep
    line: VoltageLine
    state: FloatArray
    since: OpenState | None
    opened: OpenState | None
    balloon: int = -1
    mode: str | None = None

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
        if is_converted(history, steps):
            raise ValueError(
                f"limit point at time {event.time}: a charge before it makes a voltage, which moves too"
            )
        if isinstance(step, Inflate):
            line, v = sources(history, steps, event.step - 1), event.pressure_before
        else:
            v = line.coordinate(event.voltage.tolist())
        state = np.array([*event.stretch_before, event.pressure_before, v])
        which = (history.balloons.index(event.balloon), event.mode) if event.balloon else (-1, None)
        if motion.opens_valve(step):
            return cls(history.scenario, step, line, state, None, opened(history, steps, event.step), *which)
        return cls(
            history.scenario, step, line, state, last_open(history, steps, event.step - 1), None, *which
        )

    def rate(self, key: str, value: float) -> float:
        """dv*/dq."""
        if self.mode is not None:
            return self._rate_of_shape(key, value)
        matrix, place = self._jacobian()
        # Rows and columns of one size, so that a small singular value means a singular matrix.
        sizes = np.sqrt(np.einsum("ij,ij->i", matrix, matrix))
        left, singular, _ = np.linalg.svd(matrix[:, :-1] / sizes[:, None])
        if singular[-1] > _SINGULAR:
            raise ArithmeticError(f"the state is no limit point, singular value {singular[-1]:.1e}")
        z = left[:, -1] / sizes
        moved = derivative(self._residual(Moving(self.scenario, key, value), place), value)
        return float(-(z @ moved) / (z @ matrix[:, -1]))

    def _rate_of_shape(self, key: str, value: float) -> float:
        """dv*/dq of a change of shape, where [R, margin] is regular in (x, v)."""
        device = Device.from_scenario(self.scenario)
        if self.since is not None:
            gas = sealed_gas(device, self.since.stretch, self.since.pressure)
            equations: AnyEquations = device.sealed(gas, self.line)
            state, place = self.state, self.balloon
        else:
            equations = self._alone(device, self.balloon, float(self.state[-2]))
            state, place = self.state[[self.balloon, -1]], 0
        slope = gradient(lambda y: margin_of(equations, place, str(self.mode), list(y)), state)
        matrix = np.array([*equations.linearised(state.tolist())[1], slope], dtype=np.float64)
        moved = derivative(self._residual(Moving(self.scenario, key, value), self.balloon), value)
        try:
            return -float(np.linalg.solve(matrix, moved)[-1])
        except np.linalg.LinAlgError:
            raise ArithmeticError("where the sphere is lost the state does not move smoothly") from None

    def _jacobian(self) -> tuple[FloatArray, int]:
        """∂R/∂(x, v), and with the valve open the balloon that folds."""
        device = Device.from_scenario(self.scenario)
        if self.since is not None:
            gas = sealed_gas(device, self.since.stretch, self.since.pressure)
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
            return device.inflated(balloon, self.line.offset, self.line.quantity)
        return device.actuated(balloon, pressure, self.line)

    def _residual(self, moving: Moving, place: int) -> Callable[[float], FloatArray]:
        """R at this state as a function of q, with what was sealed, or the pressure held, moving with it."""
        if self.since is None:
            assert self.opened is not None
            held = moving.pressure(self.opened)

            def alone(q: float) -> FloatArray:
                equations = self._alone(moving.device(q), place, held(q))
                return self._defect(equations, 0, [self.state[place], self.state[-1]])

            return alone
        gas = moving.gas(self.since)

        def together(q: float) -> FloatArray:
            equations = moving.device(q).sealed(gas(q), self.line)
            return self._defect(equations, place, self.state.tolist())

        return together

    def _defect(self, equations: AnyEquations, place: int, state: list[float]) -> FloatArray:
        """R, and of a change of shape its margin."""
        margin = [] if self.mode is None else [margin_of(equations, place, self.mode, state)]
        return np.array([*equations.residual(state), *margin], dtype=np.float64)


def _ended_early(history: History, event: Event) -> bool:
    return any(stop.reached and stop.step < event.step for stop in history.stops)
