"""Along the arclength: the simulator, and the same equations integrated without any polishing.

Unpolished, a solver's own points are the states, its own root finder places the limit points, and a snap
starts and a branch goes on from what it left behind. Only the inflation is the simulator's, in both.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator.model import groups
from simulator.model.conditions import stability
from simulator.model.device import Device
from simulator.model.drive import VoltageLine
from simulator.model.equations import State
from simulator.model.groups import Group
from simulator.results.history import EventKind, History, Outcome
from simulator.scenario import Output, Scenario, Solver
from simulator.solver import newton, overdamped, singular
from simulator.solver.arclength import along
from simulator.solver.ida import Effort
from simulator.solver.segment import Cubics, work
from tests.pairs import run
from tests.studies.accuracy.problem import Leg, LimitPoint, Samples, Solution, Task, WrongHistory

FloatArray = NDArray[np.float64]
Residual = Callable[[list[float]], list[float]]
Jacobian = Callable[[list[float]], list[list[float]]]
Events = Callable[[list[float], list[float]], list[float]]
# `along` without its longest step: points, directions and which event ended them.
Integrator = Callable[..., tuple[FloatArray, FloatArray, int]]

# Stretch by which a snap is started off its limit point: the simulator's first try; and as the limit point is
# off by the tolerance in the voltage, the unstable state it must get past is off by the root of that.
_NUDGE = 1e-2


def simulated(task: Task, rtol: float) -> History:
    """The simulator's history at a tolerance."""
    return run(_at(task.scenario, rtol))


def read_history(task: Task, history: History) -> Solution:
    """The simulator's history as a solution."""
    first = task.inflations
    order = [task.active, 1 - task.active]
    states = np.vstack([history.stretch[:, order].T, history.pressure])
    closed = history.step > first
    begins = np.cumsum([history.time[~closed][-1], *(leg.lasts for leg in task.legs)])
    leg = history.step - first - 1
    lasts = np.array([leg.lasts for leg in task.legs])[np.maximum(leg, 0)]
    wanted = closed & (lasts > 0.0) & ~np.isin(history.time, [event.time for event in history.events])
    position = leg[wanted] + (history.time - begins[np.maximum(leg, 0)])[wanted] / lasts[wanted]
    jumps = history.branch - history.branch[~closed][-1]
    found = []
    for event in history.events:
        if event.kind is EventKind.LIMIT_POINT and event.step > first:
            before = np.array([*event.stretch_before[order], event.pressure_before])
            after = None
            if event.stretch_after is not None and event.pressure_after is not None:
                after = np.array([*event.stretch_after[order], event.pressure_after])
            found.append(LimitPoint(event.step - first - 1, float(event.voltage[0]), before, after))
    return Solution(
        tuple(found),
        Samples(position, history.voltage[wanted, 0], states[:, wanted], jumps[wanted]),
        history.energy_balance.electrical_work,
        history.outcome is Outcome.LOSS_OF_TENSION,
        history.statistics.ida_solves,
        history.statistics.ida_steps,
        history.statistics.residual_calls,
    )


def unpolished_ida(task: Task, rtol: float) -> Solution:
    """IDA's own points and events, on the equations that the simulator follows."""
    return _Unpolished(task, rtol, _ida).solution()


def unpolished_scipy_dae(task: Task, rtol: float) -> Solution:
    """The same with Radau of the package scipy_dae in place of IDA along the path; snaps are IDA's."""
    return _Unpolished(task, rtol, _scipy_dae).solution()


def _at(scenario: Scenario, rtol: float) -> Scenario:
    return scenario.model_copy(update={"solver": Solver(rtol=rtol)})


def _ida(
    residual: Residual,
    jacobian: Jacobian,
    events: Events,
    start: FloatArray,
    direction: FloatArray,
    scales: FloatArray,
    rtol: float,
    effort: Effort,
) -> tuple[FloatArray, FloatArray, int]:
    return along(residual, jacobian, events, start, direction, scales, rtol, 0.0, effort)


def _scipy_dae(
    residual: Residual,
    jacobian: Jacobian,
    events: Events,
    start: FloatArray,
    direction: FloatArray,
    scales: FloatArray,
    rtol: float,
    effort: Effort,
) -> tuple[FloatArray, FloatArray, int]:
    from scipy_dae.integrate import solve_dae

    weights = 1.0 / scales**2
    size = start.size

    def function(s: float, y: FloatArray, yp: FloatArray) -> FloatArray:
        return np.array([*residual(y.tolist()), float(weights @ (yp * yp)) - 1.0])

    def slopes(s: float, y: FloatArray, yp: FloatArray) -> tuple[FloatArray, FloatArray]:
        values, rates = np.zeros((size, size)), np.zeros((size, size))
        values[:-1] = jacobian(y.tolist())
        rates[-1] = 2.0 * weights * yp
        return values, rates

    def margin(place: int) -> Any:
        def event(s: float, y: FloatArray, yp: FloatArray) -> float:
            return events(y.tolist(), yp.tolist())[place]

        event.terminal, event.direction = True, -1.0  # type: ignore[attr-defined]
        return event

    count = len(events(start.tolist(), direction.tolist()))
    result = solve_dae(
        function,
        (0.0, 1e3),
        start,
        direction,
        method="Radau",
        rtol=rtol,
        atol=rtol * scales,
        jac=slopes,
        events=[margin(place) for place in range(count)],
    )
    effort.ida_solves += 1
    effort.ida_steps += len(result.t) - 1
    effort.residual_calls += int(result.nfev)
    if result.status != 1:
        raise newton.NotConverged(f"scipy_dae: {result.message}")
    ended = next(place for place, times in enumerate(result.t_events) if len(times))
    return np.array(result.y), np.array(result.yp), ended


@dataclass
class _Unpolished:
    """Where an unpolished history is now, and its record."""

    task: Task
    rtol: float
    integrate: Integrator
    effort: Effort = field(default_factory=Effort)
    found: list[LimitPoint] = field(default_factory=list)
    samples: list[tuple[FloatArray, FloatArray, FloatArray, int]] = field(default_factory=list)
    jumps: int = 0
    moved: float = 0.0  # ∫q dφ so far
    slack: bool = False

    def solution(self) -> Solution:
        """Play the history."""
        task = self.task
        self.group, state = _sealed(task)
        start = state
        for number, leg in enumerate(task.legs):
            if leg.is_ramp:
                state = self._ramp(number, leg, state)
            elif leg.lasts == 0.0:
                if leg.start != leg.end:
                    state = self._jump(state, leg.end)
            else:
                self._note(
                    number, leg.fractions, leg.voltages(), np.repeat(state[:, None], leg.fractions.size, 1)
                )
            if self.slack:
                break
        supplied = self.group.equations.electric_supply
        work = float(supplied(state.tolist()) - supplied(start.tolist())) - self.moved
        position, voltage, states = (np.concatenate([s[k] for s in self.samples], axis=-1) for k in range(3))
        jumps = np.concatenate([np.full(s[0].size, s[3]) for s in self.samples])
        return Solution(
            tuple(self.found),
            Samples(position, voltage, states, jumps),
            work,
            self.slack,
            self.effort.ida_solves,
            self.effort.ida_steps,
            self.effort.residual_calls,
        )

    def _ramp(self, number: int, leg: Leg, state: FloatArray) -> FloatArray:
        equations, conditions = self.group.equations, self.group.conditions
        sense = 1.0 if leg.end > leg.start else -1.0
        margins = [condition.margin for condition in conditions]

        def events(values: list[float], rates: list[float]) -> list[float]:
            return [*(float(margin(values)) for margin in margins), sense * (leg.end - values[-1])]

        passed = 0.0
        while True:
            ahead = np.zeros_like(state)
            ahead[-1] = sense
            direction = newton.tangents(equations, state[:, None], ahead[:, None])[:, 0]
            points, directions, ended = self.integrate(
                equations.residual,
                lambda values: equations.linearised(values)[1],
                events,
                state,
                direction,
                equations.scales,
                self.rtol,
                self.effort,
            )
            state = points[:, -1]
            reached = min((state[-1] - leg.start) / (leg.end - leg.start), 1.0)
            self._stay(number, leg, points, directions, passed, reached if ended < len(conditions) else 1.0)
            passed = reached
            if ended == len(conditions):
                return state
            if conditions[ended].kind != "limit_point":
                self.slack = True
                return state
            before, v = self._told(state), float(state[-1])
            state = self._snap(state, sense)
            self.found.append(LimitPoint(number, v, before, self._told(state)))
            if self.slack:
                return state

    def _stay(
        self, number: int, leg: Leg, points: FloatArray, directions: FloatArray, start: float, end: float
    ) -> None:
        """Samples and ∫q dφ of a stay, on the cubics through the points along their directions."""
        equations = self.group.equations
        cubics = Cubics.through(1.0 / equations.scales[:, None] ** 2, points, directions)
        guesses, slopes, _ = cubics.at_gauss_points()
        shape = (len(points), points.shape[1] - 1, -1)
        self.moved += float(np.sum(work(equations, guesses.reshape(shape), slopes.reshape(shape))))
        wanted = (leg.fractions > start) & (leg.fractions <= end)
        voltages = leg.voltages()[wanted]
        if voltages.size:
            self._note(number, leg.fractions[wanted], voltages, _on_cubics(cubics, points[-1], voltages))

    def _snap(self, state: FloatArray, sense: float) -> FloatArray:
        equations = self.group.equations
        escape = singular.escape_direction(equations, state, sense)
        start = state.copy()
        distance = max(_NUDGE, float(np.sqrt(self.rtol)))
        start[: escape.size] += distance * escape
        rest = self._flow(start)
        if np.max(np.abs(rest - state)) < 5.0 * distance:
            raise WrongHistory("a snap falls back onto the branch it left")
        return rest

    def _jump(self, state: FloatArray, target: float) -> FloatArray:
        equations = self.group.equations
        start = state.copy()
        start[-1] = target
        supplied = equations.electric_supply
        self.moved += 0.5 * float(supplied(start.tolist()) - supplied(state.tolist()))
        return self._flow(start)

    def _flow(self, start: FloatArray) -> FloatArray:
        """Where IDA's flow comes to rest to within the tolerance, or loses its tension."""
        equations, others = self.group.equations, self.group.conditions[1:]
        stable = stability(equations).margin

        def resting(y: State) -> float:
            softest = float(stable(y))
            if softest <= 0.0:
                return 1.0
            return float(min(max(map(abs, equations.residual(y))) / softest - self.rtol, 1.0))

        margins = [*(condition.margin for condition in others), resting]
        states, ended = overdamped.integrate(equations, margins, start, self.rtol, self.effort)
        self.jumps += 1
        self.slack = ended < len(others)
        return np.asarray(states[:, -1])

    def _note(self, number: int, fractions: FloatArray, voltages: FloatArray, states: FloatArray) -> None:
        self.samples.append((number + fractions, voltages, self._told(states), self.jumps))

    def _told(self, states: FloatArray) -> FloatArray:
        """(λ₁, λ₂, p) of states, active balloon first."""
        return states[[self.task.active, 1 - self.task.active, 2]]


def _sealed(task: Task) -> tuple[Group, FloatArray]:
    """The pair's equations, and its state when the valve is closed."""
    scenario = task.scenario
    steps: Sequence[Any] = list(scenario.played_steps())[: task.inflations]
    inflated = run(scenario.model_copy(update={"steps": tuple(steps), "output": Output(points=2)}))
    line = VoltageLine.common(1)
    device = Device.from_scenario(scenario)
    gas = device.law.sealed(float(inflated.pressure[-1]), float(inflated.volume[-1]))
    (group,) = groups.actuated(device, line, gas=gas)
    return group, np.array([*inflated.stretch[-1], inflated.pressure[-1], 0.0])


def _on_cubics(cubics: Cubics, v: FloatArray, voltages: FloatArray) -> FloatArray:
    """States at given voltages on cubics along which v is monotone, (n_unknowns, n); by bisection."""
    rising = v if v[-1] > v[0] else -v
    wanted = voltages if v[-1] > v[0] else -voltages
    cell = np.clip(np.searchsorted(rising, wanted) - 1, 0, v.size - 2)
    y0, m0, a, b = (part[:, cell] for part in (cubics.y0, cubics.m0, cubics.a, cubics.b))
    sense = 1.0 if v[-1] > v[0] else -1.0
    low, high = np.zeros(voltages.size), np.ones(voltages.size)
    for _ in range(53):
        x = 0.5 * (low + high)
        below = sense * (y0[-1] + x * (m0[-1] + x * (a[-1] + x * b[-1]))) < wanted
        low, high = np.where(below, x, low), np.where(below, high, x)
    x = 0.5 * (low + high)
    return np.asarray(y0 + x * (m0 + x * (a + x * b)))
