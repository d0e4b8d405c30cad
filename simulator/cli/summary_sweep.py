"""What a reader sees of a sweep in the terminal: how far it is, and what came out."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from simulator.cli.summary import print_files, printable

if TYPE_CHECKING:
    from collections import Counter
    from pathlib import Path

    from simulator.sweep import SweepResult
    from simulator.sweep.optimum import Optimum, Question

_ERRORS_SHOWN = 3
_BETWEEN_LINES = 60.0  # seconds between two lines where there is no terminal to draw a bar in


@contextmanager
def sweep_progress(*, quiet: bool) -> Iterator[Callable[[int, int], None] | None]:
    """A function to report runs done, and all, to: a bar with rate and time left; in a log, lines."""
    if quiet:
        yield None
    elif sys.stderr.isatty():
        with _bar() as report:
            yield report
    else:
        yield _lines()


@contextmanager
def _bar() -> Iterator[Callable[[int, int], None]]:
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

    bar = Progress(
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        transient=True,
        auto_refresh=False,
        speed_estimate_period=120.0,
    )
    pace = _Pace()
    task: TaskID | None = None

    def report(done: int, total: int) -> None:
        nonlocal task
        if task is None:
            task = bar.add_task("", total=total, completed=done, rate="")
        bar.update(task, completed=done, rate=pace.rate(done), refresh=True)

    with bar:
        yield report


@contextmanager
def count_progress(*, quiet: bool) -> Iterator[Callable[[int], None] | None]:
    """A function to report the number of runs played to, where nobody knows how many it will be."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console

    with Console(stderr=True).status("") as status:
        yield lambda done: status.update(f"{done:,} runs")


def _lines() -> Callable[[int, int], None]:
    pace = _Pace()
    due = time.monotonic() + _BETWEEN_LINES

    def report(done: int, total: int) -> None:
        nonlocal due
        rate = pace.rate(done)
        if time.monotonic() >= due:
            due = time.monotonic() + _BETWEEN_LINES
            print(f"{done:,} of {total:,} runs, {rate}, {pace.left(done, total)} left", file=sys.stderr)

    return report


class _Pace:
    """Runs per second since the first report: those that were there before do not count."""

    def __init__(self) -> None:
        self.first: tuple[float, int] | None = None

    def _speed(self, done: int) -> float:
        now = time.monotonic()
        if self.first is None:
            self.first = now, done
        started, before = self.first
        return (done - before) / (now - started) if now > started else 0.0

    def rate(self, done: int) -> str:
        speed = self._speed(done)
        return f"{speed:.3g} runs/s" if speed else ""

    def left(self, done: int, total: int) -> str:
        speed = self._speed(done)
        seconds = int((total - done) / speed) if speed else 0
        return f"{seconds // 3600}:{seconds // 60 % 60:02d}:{seconds % 60:02d}" if speed else "?"


def summarise_sweep(
    title: str, result: SweepResult, counts: Counter[str], errors: Sequence[tuple[int, str]]
) -> None:
    """Say what the runs of a sweep came to, how long it took and where the files are."""
    print(printable(title))
    print(f"\nruns     {result.runs:,}")
    for name, count in counts.most_common():
        print(f"         {count:>9,}  {name}")
    for number, error in errors[:_ERRORS_SHOWN]:
        print(f"         run {number}: {error}")
    if len(errors) > _ERRORS_SHOWN:
        print(
            f"         … and {len(errors) - _ERRORS_SHOWN:,} more with an error, in the column of that name"
        )
    pace = f", {result.played / result.seconds:.3g} runs/s" if result.played else ""
    before = f", {result.runs - result.played:,} were there before" if result.played < result.runs else ""
    print(f"cost     {result.seconds:.1f} s for {result.played:,} runs{pace}{before}")
    print_files(result.files)


def summarise_optimum(found: Optimum, paths: list[Path]) -> None:
    """Say what the best run is, what it does, and how sure that is."""
    question, row = found.question, found.row
    assert row is not None
    print(printable(question.sweep.title))
    word = "largest" if question.sense < 0.0 else "smallest"
    print(f"\n{word:8} {question.column} = {_with_unit(question, question.column, found.value)}")
    names = [axis.key for axis in question.sweep.axes]
    names += [question.sweep.job.past.key] if question.sweep.job.past else []
    for i, name in enumerate(names):
        print(f"{'at' if not i else '':8} {name} = {_with_unit(question, name, row[name])}")
    for i, name in enumerate(question.where):
        value = row[name]
        said = value if isinstance(value, str) else _with_unit(question, name, value)
        print(f"{'where' if not i else '':8} {name} = {said}")
    settled = "converged" if found.converged else "not converged, more generations may find better"
    print(f"cost     {len(found.runs):,} runs, {settled}")
    print_files(paths)


def _with_unit(question: Question, column: str, value: float) -> str:
    """A value of a column, with its unit where it has one."""
    from simulator.sweep.measures import quantity
    from simulator.units import with_prefix

    dimension, unit = quantity(column), question.units.get(column, "")
    if dimension is not None and unit:
        return with_prefix(dimension, value, 10)
    return f"{value:.10g} {unit}".rstrip()
