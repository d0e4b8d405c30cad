"""A sealed pair driven by voltage, its exact history, and how far a computed one is from it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.scenario import Hold, Inflate, Problem, Ramp, ScenarioError, duration
from simulator.scenario import Jump as JumpStep
from tests.oracle.closed_form import Jump, SealedPair, reference_history, states_on

if TYPE_CHECKING:
    from collections.abc import Sequence

    from simulator.scenario import PlayedStep, Scenario
    from tests.oracle.closed_form import ReferenceEvent, ReferenceHistory

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Leg:
    """A step with the valve closed: the voltage from `start` to `end` during `lasts`; 0 for a jump.

    `fractions` (n,) of its duration are where samples are wanted.
    """

    start: float
    end: float
    lasts: float
    fractions: FloatArray

    @property
    def is_ramp(self) -> bool:
        """Whether the voltage moves, and not at once."""
        return self.lasts > 0.0 and self.start != self.end

    def voltages(self) -> FloatArray:
        """The voltages of the samples, (n,)."""
        return np.asarray(self.start + (self.end - self.start) * self.fractions)


@dataclass(frozen=True)
class Task:
    """A scenario with its exact history.

    Attributes
    ----------
    name : str
        Stem of the scenario's file, or its title.
    scenario : Scenario
    inflations : int
        Number of `inflate` steps before the valve is closed.
    legs : tuple of Leg
    pair : SealedPair
    reference : ReferenceHistory
    work : float
        ∫φ dq over the whole history, over 4πR²Hμ.
    """

    name: str
    scenario: Scenario
    inflations: int
    legs: tuple[Leg, ...]
    pair: SealedPair
    reference: ReferenceHistory
    work: float

    @property
    def limit_points(self) -> tuple[ReferenceEvent, ...]:
        """The reference's limit points in order."""
        return tuple(e for e in self.reference.events if e.kind == "limit_point")

    @property
    def loses_tension(self) -> bool:
        """Whether the history ends by a loss of tension."""
        return self.reference.outcome == "loss_of_tension"

    @property
    def active(self) -> int:
        """Place of the balloon with electrodes in the scenario."""
        return next(i for i, balloon in enumerate(self.scenario.balloons) if balloon.electrodes)

    def position(self, leg: int, voltage: float) -> float:
        """A place in the history as leg plus fraction of it."""
        there = self.legs[leg]
        return leg + ((voltage - there.start) / (there.end - there.start) if there.is_ramp else 0.0)


@dataclass(frozen=True)
class LimitPoint:
    """A limit point as a method found it: where, and the states (λ₁, λ₂, p) on both sides of the snap.

    `before` is None from a method that has no such state, `after` where none was reached.
    """

    leg: int
    voltage: float
    before: FloatArray | None
    after: FloatArray | None


@dataclass(frozen=True)
class Samples:
    """States read off a history: their positions (n,), see `Task.position`, and voltages (n,); the states
    (3, n); and how many jumps lie before each (n,).
    """

    position: FloatArray
    voltage: FloatArray
    states: FloatArray
    jumps: NDArray[np.int64]


@dataclass(frozen=True)
class Solution:
    """What a method found; and the pieces that its solver was handed, its steps in them, and its calls of the
    right-hand side or residual.
    """

    limit_points: tuple[LimitPoint, ...]
    samples: Samples
    work: float
    loses_tension: bool
    solves: int
    steps: int
    calls: int


@dataclass(frozen=True)
class Errors:
    """How far a solution is from the exact one, at most; NaN from a method that has no such state.

    Attributes
    ----------
    limit_voltage : float
        |φ − φ_exact|/|φ_exact| of the limit points.
    limit_state, landing, state : float
        Of the states at the limit points, of those they snap to, and of the samples: the largest of
        |λᵢ − λᵢ,exact|/λᵢ,exact and |p − p_exact| (in μH/R).
    work : float
        |W − W_exact|/|W_exact|, W = ∫φ dq over the whole history.
    """

    limit_voltage: float
    limit_state: float
    landing: float
    state: float
    work: float


class WrongHistory(ArithmeticError):
    """A solution whose events are not those of the exact history: no errors can be told."""


def load_task(scenario: Scenario) -> Task:
    """A scenario with its exact history.

    Raises
    ------
    ScenarioError
        If it is not a pair sealed after inflation, driven by ramps, holds and jumps over a limit point.
    """
    steps = list(scenario.played_steps())
    inflations = next((i for i, s in enumerate(steps) if not isinstance(s, Inflate)), len(steps))
    _check(scenario, steps, inflations)
    legs: list[Leg] = []
    now = 0.0
    for step in steps[inflations:]:
        target = now
        if isinstance(step, Ramp | JumpStep):
            wanted = step.ramp if isinstance(step, Ramp) else step.jump
            target = next(iter(wanted.values())) if isinstance(wanted, dict) else wanted
        lasts = duration(step)
        legs.append(Leg(now, target, lasts, _fractions(scenario, lasts)))
        now = target
    turns = [Jump(leg.end) if leg.lasts == 0.0 else leg.end for leg in legs]
    try:
        pair = SealedPair.from_scenario(scenario)
        reference = reference_history(pair, turns)
    except ValueError as error:
        raise ScenarioError(scenario.file, Problem("", None, f"no exact history: {error}")) from None
    name = scenario.title if scenario.file == "<dict>" else Path(scenario.file).stem
    task = Task(name, scenario, inflations, tuple(legs), pair, reference, _work(pair, reference))
    if not task.limit_points:
        problem = Problem("step", None, "must take the voltage over a limit point; there is none on the way")
        raise ScenarioError(scenario.file, problem)
    return task


def _check(scenario: Scenario, steps: list[PlayedStep], inflations: int) -> None:
    """Refuse what the closed form, or one of the methods compared, cannot treat."""
    problems = []
    if [b.electrodes for b in sorted(scenario.balloons, key=lambda b: not b.electrodes)] != [True, False]:
        found = f"{len(scenario.balloons)} balloons, {len(scenario.electroded)} of them with electrodes"
        allowed = "the closed form needs two balloons, one of them with electrodes"
        problems.append(Problem("balloon", found, allowed))
    problems += [
        Problem(
            f"balloon.{b.name}.breakdown", b.breakdown.model_dump(), "the methods compared have no breakdown"
        )
        for b in scenario.balloons
        if b.breakdown
    ]
    if not inflations:
        problems.append(Problem("step.1", None, "must be an inflate step, the exact history begins with one"))
    for number, step in enumerate(steps[inflations:], start=inflations + 1):
        if not isinstance(step, Ramp | Hold | JumpStep) or step.valve == "open":
            kind = type(step).__name__.lower()
            allowed = "must be a ramp, hold or jump with the valve closed, the exact history has no others"
            problems.append(Problem(f"step.{number}", kind, allowed))
    if problems:
        raise ScenarioError(scenario.file, *problems)


def _fractions(scenario: Scenario, lasts: float) -> FloatArray:
    every = scenario.output.every
    count = scenario.output.points if every is None else max(2, round(lasts / every) + 1)
    return np.linspace(0.0, 1.0, count)[1:] if lasts > 0.0 else np.empty(0)


def _work(pair: SealedPair, reference: ReferenceHistory) -> float:
    """∫φ dq without a quadrature: what is stored at the end more than at the start, and what was lost."""
    start, end = reference.segments[0].end(0), reference.state
    supplied = pair.active.radius**2 * pair.active.permittivity / pair.active.thickness
    supplied *= reference.voltage**2 * end.active**4
    stored = float(pair.potential(end, reference.voltage)) - float(pair.potential(start, 0.0)) + supplied
    return stored + sum(event.dissipated or 0.0 for event in reference.events)


def errors(task: Task, solution: Solution) -> Errors:
    """How far a solution is from the exact one.

    Raises
    ------
    WrongHistory
        If its limit points are others, or it ends otherwise.
    """
    exact, found = task.limit_points, solution.limit_points
    if [e.leg for e in exact] != [f.leg for f in found]:
        raise WrongHistory(f"limit points in steps {_steps(task, found)}, not {_steps(task, exact)}")
    if task.loses_tension != solution.loses_tension:
        raise WrongHistory(f"tension is {'kept' if task.loses_tension else 'lost'}")
    pairs = list(zip(exact, found, strict=True))
    return Errors(
        limit_voltage=_largest([abs(f.voltage - e.voltage) / abs(e.voltage) for e, f in pairs]),
        limit_state=_largest([_distance(f.before, e.before) for e, f in pairs]),
        landing=_largest([_distance(f.after, e.after) for e, f in pairs]),
        state=_state_error(task, solution.samples),
        work=abs(solution.work - task.work) / abs(task.work),
    )


def _largest(found: Sequence[float]) -> float:
    """The largest; NaN if one is NaN (the built-in `max` would pass it over) or there is none."""
    return float(np.max(found)) if found else np.nan


def _steps(task: Task, events: tuple[ReferenceEvent, ...] | tuple[LimitPoint, ...]) -> str:
    return ", ".join(str(task.inflations + e.leg + 1) for e in events) or "none"


def _distance(found: FloatArray | None, exact: tuple[float, ...] | FloatArray | None) -> float:
    if found is None or exact is None:
        return np.nan
    return float(np.max(_deviation(found, np.asarray(exact))))


def _deviation(found: FloatArray, exact: FloatArray) -> FloatArray:
    difference = np.abs(found - exact)
    difference[:2] /= exact[:2]
    return np.asarray(difference)


def _state_error(task: Task, samples: Samples) -> float:
    """Of the samples that lie on the same stay in both histories.

    Between the limit point and where a method puts it, a sample is on the other side of the snap: that
    error is the limit point's, and told there.
    """
    reference = task.reference
    turns = [e for e in reference.events if e.after is not None]
    begins = [0.0, *(task.position(e.leg, e.voltage) for e in turns)]
    ends = [*begins[1:], float(len(task.legs))]
    found = []
    for stay, segment in enumerate(reference.segments):
        on = (samples.jumps == stay) & (samples.position > begins[stay]) & (samples.position < ends[stay])
        if np.any(on):
            exact = states_on(task.pair, segment, np.abs(samples.voltage[on]))
            found.append(float(np.max(_deviation(samples.states[:, on], exact))))
    return _largest(found)
