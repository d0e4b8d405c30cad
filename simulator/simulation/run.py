"""Playing a scenario: its steps one after the other, each from where the one before has ended.

A step first changes at once what its valve and its sources change, then moves the drive through its legs
(`motion`). How the balloons follow is one of two kinds of `Kinetics`: at once (`quasi_static`), or in their
own time (`real_time`). What is seen goes to the record (`recorder`), energies to the books (`books`).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from itertools import islice
from typing import TYPE_CHECKING, Protocol

import numpy as np

from simulator.events import Outcome
from simulator.model.device import Device
from simulator.model.drive import Leg, Way
from simulator.results.history import History, Stop
from simulator.scenario import duration, load_scenario, until_of
from simulator.scenario.cycles import counted
from simulator.simulation import motion
from simulator.simulation.books import Books
from simulator.simulation.present import Present
from simulator.simulation.quasi_static import QuasiStatic
from simulator.simulation.recorder import Recorder

if TYPE_CHECKING:
    from simulator.scenario import PlayedStep, Scenario, ScenarioLike
    from simulator.scenario.cycles import Count
    from simulator.simulation.replay import Replay
    from simulator.simulation.until import Watch
    from simulator.solver.ida import Effort


class SolverError(RuntimeError):
    """The solver failed; `history` holds everything computed up to there, its outcome `failed`."""

    def __init__(self, message: str, history: History | None = None) -> None:
        super().__init__(message)
        self.history = history


class Kinetics(Protocol):
    """How balloons follow the drive; it adds to the record and the books that it was made with."""

    @property
    def effort(self) -> Effort:
        """What it has cost so far."""
        ...

    @property
    def branches(self) -> int:
        """How many branches of equilibria are known."""
        ...

    def release(self) -> None:
        """Let the balloons leave that were held by what is no longer there: shared gas, or given charges."""
        ...

    def jump(self, way: Way, v: float, *, loosened: bool) -> bool:
        """Change the voltages at once to those at a place of a way, and say whether they differ.

        `loosened` says whether something that held the balloons went at the same time; see `release`.
        """
        ...

    def travel(
        self, step: PlayedStep, legs: Sequence[Leg], start: float, lasts: float, watch: Watch | None
    ) -> str | None:
        """Play the legs of a step from time `start` on; return what ended it early, if anything did."""
        ...


def simulate(
    scenario: ScenarioLike,
    *,
    progress: Callable[[float], None] | None = None,
    replay: Replay | None = None,
) -> History:
    """Play a scenario's steps and return what happened.

    Parameters
    ----------
    scenario : Scenario, path or mapping
        From `load_scenario`, or what that takes.
    progress : callable, optional
        Called with the fraction of steps done, after each.
    replay : Replay, optional
        Steps that the last run with it began with are not played again.

    Returns
    -------
    History
        Physical ends (tension lost, film broken, runaway) are outcomes of a history, not errors.

    Raises
    ------
    ScenarioError
        If the scenario makes no sense.
    SolverError
        If the solver failed; with the history up to there.

    Examples
    --------
    >>> history = simulate("scenarios/fig5b_state_b.toml")
    >>> [event.kind.value for event in history.events]
    ['limit_point', 'limit_point', 'jump']
    """
    scenario = load_scenario(scenario)
    known, begun = replay.begin(scenario) if replay else (None, 0)
    run = known or Run(scenario)
    run.started = time.perf_counter()
    total = sum(1 for _ in scenario.played_steps()) if progress else 0
    for number, (step, count) in islice(enumerate(counted(scenario.steps), start=1), begun, None):
        if run.record.ended:
            break
        try:
            run.play(number, step, count)
        except (ArithmeticError, np.linalg.LinAlgError) as failure:
            now = run.record.present
            raise SolverError(
                f"{scenario.file}: step {number}, time {now.time:.12g}: {failure}; last stretches "
                f"{now.stretch.tolist()}, pressure {now.pressure:.12g}, voltages {now.voltage.tolist()}; "
                "the history up to there is kept; a small change of the scenario may help",
                run.history(Outcome.FAILED),
            ) from failure
        if replay:
            replay.keep(run, step)
        if progress:
            progress(number / total)
    return run.history(run.record.outcome)


class Run:
    """One scenario being played.

    Attributes
    ----------
    record : Recorder
        With the present state of the device.
    books : Books
    kinetics : Kinetics
        How the balloons follow.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.started = time.perf_counter()
        self.record = Recorder(
            Present.unstretched(Device.from_scenario(scenario)),
            stops_at_shape=scenario.shape.on_loss == "stop",
        )
        self.books = Books(self.record.present.device.electroded)
        self.kinetics = _kinetics(scenario, self.record, self.books)

    def play(self, number: int, step: PlayedStep, count: Count) -> None:
        """Play one step: first what changes at once, then what moves.

        Parameters
        ----------
        number : int
            From 1.
        step : PlayedStep
        count : Count
            The cycles that it belongs to.

        Raises
        ------
        ArithmeticError, LinAlgError
            If the solver fails.
        """
        present, record = self.record.present, self.record
        present.step = number
        start, lasts = present.time, duration(step)
        record.cycles.step_begins(count, start, lasts, self.books)
        watch = _watch(step, present.device)
        before = watch.distances(present) if watch else []
        legs = self._change_at_once(step)
        record.account(start, self.books)
        reached = None
        if not record.ended:
            reached = watch.passed(before, watch.distances(present)) if watch else None
            if lasts > 0.0 and reached is None:
                reached = self.kinetics.travel(step, legs, start, lasts, watch)
        if watch:
            record.stops.append(Stop(number, present.time, reached))
        record.account(present.time, self.books)
        record.cycles.step_ends(present.time, self.books, played=reached is None and not record.ended)
        if motion.opens_valve(step):
            present.seal()

    def _change_at_once(self, step: PlayedStep) -> tuple[Leg, ...]:
        """What a step's valve, its sources and its first voltages change, and the legs that follow."""
        present, record = self.record.present, self.record
        opens = motion.opens_valve(step)
        if not record.rows.time:
            present.valve_open = opens
            record.sample_now()
        loosened = present.connect(motion.given_by(step) or present.given) or (
            opens and not present.valve_open
        )
        present.valve_open = opens
        legs = motion.motion(step, self.scenario.electroded, present.electrodes, present.pressure)
        first = legs[0]
        begins = float(first.waveform.values[0])
        # All that a step changes at once changes together, and the balloons leave by one flow.
        jumped = motion.begins_by_jump(step) and self.kinetics.jump(first.way, begins, loosened=loosened)
        if loosened and not jumped:
            self.kinetics.release()
        return legs

    def history(self, outcome: Outcome) -> History:
        """The history so far."""
        kinetics = self.kinetics
        cost = self.record.statistics(kinetics.effort, kinetics.branches, time.perf_counter() - self.started)
        return self.record.history(self.scenario, self.books, cost, outcome)


def _kinetics(scenario: Scenario, record: Recorder, books: Books) -> Kinetics:
    if scenario.dynamics is None:
        return QuasiStatic(scenario, record, books)
    from simulator.simulation.real_time import RealTime  # a scenario without [dynamics] does without

    return RealTime(scenario, record, books)


def _watch(step: PlayedStep, device: Device) -> Watch | None:
    ends = until_of(step)
    if ends is None:
        return None
    from simulator.simulation.until import Watch  # a run without `until` does without

    return Watch.over(ends, device)
