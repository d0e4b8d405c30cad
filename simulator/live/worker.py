"""Computations in a process of their own, which is ended where they take too long; the newest comes first.

The page answers meanwhile, and no scenario, however long, can hold it up.
"""

from __future__ import annotations

import multiprocessing
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from simulator.results.history import History
    from simulator.scenario import Scenario
    from simulator.simulation.replay import Replay

LIMIT = 30.0  # seconds that a computation may take
_QUIET = 0.15  # seconds without a newer history before something slower is begun


@dataclass(frozen=True)
class Answer:
    """What became of a computation: its result, or what is to be said of its failure; seconds it took."""

    result: Any = None
    failure: str = ""
    seconds: float = 0.0


def play(scenario: Any, replay: Replay | None = None) -> tuple[History | None, str]:
    """The history of a scenario; where the solver failed, what it had reached and why it failed."""
    from simulator.simulation.run import SolverError, simulate

    try:
        return simulate(scenario, replay=replay), ""
    except SolverError as error:
        return error.history, str(error)


def follow(scenario: Any, _: Replay | None = None) -> Any:
    """The equilibrium paths of a scenario, detached ones too; () where it has none."""
    from simulator.analysis.trace import trace_all
    from simulator.scenario import ScenarioError

    try:
        return trace_all(scenario)
    except (ScenarioError, ArithmeticError):
        return ()  # without electrodes, or with an inflation that ends in an event


def phases(asked: Any, _: Replay | None = None) -> Any:
    """The behaviour of every point of a map; see `phase_map`."""
    from simulator.sweep import simulate_many

    scenario, values = asked
    return simulate_many(scenario, values)["behaviour"]


def path_key(scenario: Scenario) -> str:
    """What the equilibrium path depends on: the device, its inflation, and whether the valve is closed."""
    document = scenario.to_dict()
    steps = [step if "inflate" in step else step.get("valve", "closed") for step in document["step"]]
    return repr([document["gas"], document["balloon"], document.get("scales"), document.get("shape"), steps])


def answered(function: Callable[..., Any], argument: Any, replay: Replay) -> Answer:
    """What becomes of `function(argument, replay)`, computed here."""
    start = time.thread_time()
    try:
        result, failure = function(argument, replay), ""
    except Exception as error:
        result, failure = None, f"{type(error).__name__}: {error}"
    return Answer(result, failure, time.thread_time() - start)


def _serve(pipe: Connection) -> None:
    """In the process: answer until the pipe is closed."""
    from simulator.simulation.replay import Replay

    replay = Replay()  # of the last history: steps before the one that changes are not played again
    with suppress(EOFError, OSError, KeyboardInterrupt):  # the page is closed
        while True:
            function, argument = pipe.recv()
            pipe.send(answered(function, argument, replay))


class Worker:
    """A process that computes one thing after the other."""

    def __init__(self) -> None:
        self._turn = threading.Lock()
        self._process: Any = None
        self._pipe: Connection | None = None

    def __call__(self, function: Callable[[Any], Any], argument: Any, limit: float = LIMIT) -> Answer:
        """Compute `function(argument, replay)`; a failure, or more than `limit` seconds, is an answer too."""
        with self._turn:
            pipe = self._running()
            try:
                pipe.send((function, argument))
                if pipe.poll(limit):
                    answer: Answer = pipe.recv()
                    return answer
                failure = f"stopped: it takes longer than {limit:g} s"
            except (EOFError, OSError) as error:
                failure = f"the process that computes has ended: {error}"
            self.close()
            return Answer(failure=failure, seconds=limit)

    def _running(self) -> Connection:
        if self._pipe is None or not self._process.is_alive():
            context = multiprocessing.get_context("spawn")
            self._pipe, other = context.Pipe()
            self._process = context.Process(target=_serve, args=(other,), daemon=True)
            self._process.start()
            other.close()
        return self._pipe

    def close(self) -> None:
        """End the process; the next computation starts another one."""
        if self._pipe is not None:
            self._pipe.close()
            self._process.kill()
            self._process.join()
            self._pipe = None


class Newest:
    """One computation under way; of each kind the newest request waits, and the others are dropped.

    Parameters
    ----------
    compute : callable
        Of a function and its argument, such as a `Worker`.
    post : callable
        Takes a function without arguments and calls it where the page may be changed.
    """

    def __init__(self, compute: Callable[..., Answer], post: Callable[[Callable[[], None]], None]) -> None:
        self._compute, self._post = compute, post
        self._waiting: dict[Callable[[Any], Any], tuple[Any, Callable[[Answer], None]]] = {}
        self._change = threading.Condition()
        self._is_running = False

    def ask(self, function: Callable[[Any], Any], argument: Any, done: Callable[[Answer], None]) -> None:
        """Compute `function(argument)` when its turn comes, and give the answer to `done`."""
        with self._change:
            self._waiting[function] = (argument, done)
            self._change.notify()
            if self._is_running:
                return
            self._is_running = True
        threading.Thread(target=self._work, daemon=True).start()

    def _work(self) -> None:
        while True:
            with self._change:
                if self._waiting and play not in self._waiting:
                    self._change.wait(_QUIET)
                if not self._waiting:
                    self._is_running = False
                    return
                function = play if play in self._waiting else next(iter(self._waiting))
                argument, done = self._waiting.pop(function)
            answer = self._compute(function, argument)
            self._post(lambda done=done, answer=answer: done(answer))  # type: ignore[misc]
