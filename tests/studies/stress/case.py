"""What a stress case is: a scenario, what is hard about it, and how its outcome is judged."""

from __future__ import annotations

import math
import statistics
import time
from collections import Counter
from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from simulator.results.curve import Curve
from simulator.scenario import load_scenario
from simulator.simulation.run import SolverError
from tests.pairs import run

if TYPE_CHECKING:
    from simulator.results.history import History
    from simulator.scenario import Scenario

FAILS = "solver error"


@dataclass(frozen=True)
class Finding:
    """How far a result is from what it is held against.

    Attributes
    ----------
    error, bound : float
        The largest deviation, relative where the quantity is above 1, and how large it may be. An infinite
        error is a result of another kind, which `remark` names.
    against : str
        What it was held against.
    remark : str
    """

    error: float
    bound: float
    against: str
    remark: str = ""


@dataclass(frozen=True)
class Case:
    """One scenario at the edge of what can be computed.

    Attributes
    ----------
    name, hard : str
        What it is, and what is hard about it.
    scenario : mapping
        As `load_scenario` takes it.
    check : function
        Judges the history (or curve) that came out.
    outcome : str
        What must come out: an outcome of `simulator.results.history.Outcome`, for a path the kind of its end; or
        `FAILS`, for a case known to stop with a `SolverError`, and nothing else.
    play : function
        Default the history of spheres; or another function of a scenario.
    tables : mapping
        CSV files that the scenario's `table` steps name, as functions that produce their text.
    """

    name: str
    hard: str
    scenario: Mapping[str, Any]
    check: Callable[[Any], Finding]
    outcome: str = "completed"
    play: Callable[[Scenario], History | Curve] = run
    tables: Mapping[str, Callable[[], str]] = field(default_factory=dict)

    def load(self) -> Scenario:
        """The scenario, with its tables."""
        with TemporaryDirectory() as folder:
            for name, text in self.tables.items():
                (Path(folder) / name).write_text(text(), encoding="utf-8")
            written = deepcopy(dict(self.scenario))
            for step in written["step"]:
                if "table" in step:
                    step["table"] = str(Path(folder) / step["table"])
            return load_scenario(written)


@dataclass(frozen=True)
class Row:
    """What became of a case.

    Attributes
    ----------
    case : Case
    outcome : str
        As in `Case`.
    events : str
        Events by kind.
    finding : Finding or None
        None where the solver stopped with an error.
    failure : str
        That error.
    ida_steps : int
    seconds : float
        Median over the repetitions.
    """

    case: Case
    outcome: str
    events: str
    finding: Finding | None
    failure: str
    ida_steps: int
    seconds: float

    @property
    def verdict(self) -> str:
        """One of "holds", "fails honestly" (with a solver error) and "wrong"."""
        if self.finding is None:
            return "fails honestly"
        holds = self.finding.error <= self.finding.bound and self.outcome == self.case.outcome
        return "holds" if holds else "wrong"


def examine(case: Case, repetitions: int = 1) -> Row:
    """Play a case, as often as its time is to be measured, and judge what came out."""
    scenario = case.load()
    seconds = []
    for _ in range(repetitions):
        start = time.perf_counter()
        try:
            result = case.play(scenario)
        except SolverError as error:
            history = error.history
            steps = history.statistics.ida_steps if history is not None else 0
            return Row(case, FAILS, "", None, str(error), steps, time.perf_counter() - start)
        seconds.append(time.perf_counter() - start)
    taken = statistics.median(seconds)
    finding = case.check(result)
    if math.isnan(finding.error):
        raise ArithmeticError(f"{case.name}: the error is not a number")
    if isinstance(result, Curve):
        kinds = [point.kind for point in result.points]
        return Row(case, kinds[-1], counted(kinds[:-1]), finding, "", result.ida_steps, taken)
    kinds = [event.kind.value for event in result.events]
    return Row(case, result.outcome.value, counted(kinds), finding, "", result.statistics.ida_steps, taken)


def counted(kinds: list[str]) -> str:
    """Events by kind, in order of their first."""
    return ", ".join(
        kind.replace("_", " ") + (f" × {n}" if n > 1 else "") for kind, n in Counter(kinds).items()
    )
