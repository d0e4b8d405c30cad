"""Every method at every tolerance on every task, one row each; and the table of rows as CSV."""

from __future__ import annotations

import csv
import io
import math
import statistics
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, fields
from importlib.util import find_spec
from typing import Any

from simulator.scenario import Solver
from tests.studies.accuracy import arclength, viscous
from tests.studies.accuracy.problem import Errors, Solution, Task, errors

TOLERANCES = tuple(10.0**-k for k in range(2, 11))
DELAYS = (1e-3, 1e-5, 1e-7)
REPETITIONS = 5
DEFAULT = Solver().rtol

SIMULATOR = "simulator"
UNPOLISHED = "IDA, not polished"
SCIPY_DAE = "scipy_dae Radau, not polished"
VISCOUS: tuple[viscous.Method, ...] = ("LSODA", "BDF", "Radau")

_MOST_SECONDS = 3.0  # of one case, over all its repetitions


@dataclass(frozen=True)
class Row:
    """One scenario, method and tolerance.

    Attributes
    ----------
    scenario, method : str
    delay : float
        Relaxation time τ of the viscous equations over the duration of the scenario's first ramp; NaN
        for a method without one.
    rtol : float
        The method's own.
    limit_voltage_error, limit_state_error, landing_error, state_error, work_error : float
        See `problem.Errors`; NaN where the method has no such state, or failed.
    milliseconds : float
        Median processor time of the whole history; NaN where the method failed.
    repetitions : int
        That it is the median of.
    solves, steps, calls : int
        Pieces handed to the solver, its steps in them, and its calls of the residual or right-hand side.
    failure : str
        Why there is no solution, or none with the right events; empty where there is.
    """

    scenario: str
    method: str
    delay: float
    rtol: float
    limit_voltage_error: float
    limit_state_error: float
    landing_error: float
    state_error: float
    work_error: float
    milliseconds: float
    repetitions: int
    solves: int
    steps: int
    calls: int
    failure: str


COLUMNS = tuple(field.name for field in fields(Row))


@dataclass
class _Case:
    """A method on a task: `solve` is timed, `read` makes a solution of what it returns."""

    task: Task
    method: str
    delay: float
    rtol: float
    solve: Callable[[], Any]
    read: Callable[[Any], Solution]
    errors: Errors | None = None
    solves: int = 0
    steps: int = 0
    calls: int = 0
    failure: str = ""

    def __post_init__(self) -> None:
        self.seconds: list[float] = []

    def run(self) -> None:
        """Solve once more; the first time also look at what comes out."""
        begun = time.process_time()
        try:
            # What a solver thinks of itself is not asked here: its result is compared.
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                found = self.solve()
            self.seconds.append(time.process_time() - begun)
            if self.errors is None:
                solution = self.read(found)
                self.solves, self.steps, self.calls = solution.solves, solution.steps, solution.calls
                self.errors = errors(self.task, solution)
        except (ArithmeticError, ValueError, RuntimeError) as failure:
            self.failure = " ".join(str(failure).split()) or type(failure).__name__

    @property
    def is_done(self) -> bool:
        return bool(self.failure) or sum(self.seconds) > _MOST_SECONDS

    def row(self) -> Row:
        found = self.errors if self.errors is not None and not self.failure else Errors(*[math.nan] * 5)
        return Row(
            self.task.name,
            self.method,
            self.delay,
            self.rtol,
            found.limit_voltage,
            found.limit_state,
            found.landing,
            found.state,
            found.work,
            math.nan if self.failure else 1e3 * statistics.median(self.seconds),
            0 if self.failure else len(self.seconds),
            self.solves,
            self.steps,
            self.calls,
            self.failure,
        )


def has_scipy_dae() -> bool:
    """Whether the optional package scipy_dae is there."""
    return find_spec("scipy_dae") is not None


def measure(
    tasks: Sequence[Task],
    tolerances: Sequence[float] = TOLERANCES,
    delays: Sequence[float] = DELAYS,
    repetitions: int = REPETITIONS,
    progress: Callable[[float], None] | None = None,
) -> list[Row]:
    """Run all methods on all tasks and compare with the exact histories.

    The repetitions are interleaved: all cases are run once before any is run again, so that a machine that
    slows down for a while slows all of them.

    Parameters
    ----------
    tasks : sequence of Task
    tolerances : sequence of float
        Relative tolerances; the viscous equations take every other one of them.
    delays : sequence of float
        Relaxation times of the viscous equations over the duration of the first ramp.
    repetitions : int
        At most; a case that has taken three seconds is repeated no more.
    progress : callable, optional
        Called with the fraction of repetitions done.
    """
    cases = [case for task in tasks for case in _cases(task, tolerances, delays)]
    if cases:  # loads what is loaded once
        cases[0].solve()
    for repetition in range(repetitions):
        for number, case in enumerate(cases, start=1):
            if not case.is_done:
                case.run()
            if progress:
                progress((repetition + number / len(cases)) / repetitions)
    return [case.row() for case in cases]


def _cases(task: Task, tolerances: Sequence[float], delays: Sequence[float]) -> list[_Case]:
    def read_simulated(found: Any) -> Solution:
        return arclength.read_history(task, found)

    def read_viscous(found: Any) -> Solution:
        return viscous.read(task, found)

    def solved(solve: Callable[..., Any], *words: Any) -> Callable[[], Any]:
        return lambda: solve(task, *words)

    def itself(found: Any) -> Solution:
        solution: Solution = found
        return solution

    cases = []
    for rtol in tolerances:
        cases.append(
            _Case(task, SIMULATOR, math.nan, rtol, solved(arclength.simulated, rtol), read_simulated)
        )
        cases.append(_Case(task, UNPOLISHED, math.nan, rtol, solved(arclength.unpolished_ida, rtol), itself))
        if has_scipy_dae():
            solve = solved(arclength.unpolished_scipy_dae, rtol)
            cases.append(_Case(task, SCIPY_DAE, math.nan, rtol, solve, itself))
    for rtol in tolerances[::2]:
        for delay in delays:
            for method in VISCOUS:
                solve = solved(viscous.integrated, method, delay, rtol)
                cases.append(_Case(task, method, delay, rtol, solve, read_viscous))
    return cases


def to_csv(rows: Sequence[Row]) -> str:
    """The rows as CSV with a header; what is not a number is left empty."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(COLUMNS)
    for row in rows:
        writer.writerow(["" if isinstance(v, float) and math.isnan(v) else v for v in astuple(row)])
    return stream.getvalue()


def from_csv(text: str) -> list[Row]:
    """The rows of a CSV written by `to_csv`, to the last digit.

    Raises
    ------
    ValueError
        If its columns are others.
    """
    reader = csv.reader(io.StringIO(text))
    header = tuple(next(reader, []))
    if header != COLUMNS:
        raise ValueError(f"the columns must be {', '.join(COLUMNS)}, are {', '.join(header) or 'none'}")
    kinds: dict[str, Callable[[str], Any]] = {
        "str": str,
        "int": int,
        "float": lambda word: float(word) if word else math.nan,
    }
    made = [kinds[str(field.type)] for field in fields(Row)]
    return [Row(*(make(word) for make, word in zip(made, words, strict=True))) for words in reader]
