"""Plays the runs of a sweep, chunk by chunk, on processes of this machine or on any executor.

Only as many chunks are handed out as keep the workers busy, and each is written as soon as it is back:
memory does not grow with the number of runs. A run that fails is a row that says so. A run that takes its
process with it (out of memory, a crash in compiled code) is found by playing its chunk run by run, and is
such a row, too.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from simulator.scenario import Problem, ScenarioError
from simulator.sweep.lockstep.chunk import DisagreementError
from simulator.sweep.lockstep.stacking import covered
from simulator.sweep.reading import read_sweep
from simulator.sweep.rows import Task, as_text, columns, failure, play_chunk
from simulator.sweep.storage import Store, alone, fair_chunk, large_chunk, open_store

if TYPE_CHECKING:
    from simulator.sweep.plan import Job, Sweep
    from simulator.sweep.reading import SweepLike

Progress = Callable[[int, int], None]

_DEATHS = 2  # a chunk during which so many pools broke is played run by run
_AHEAD = 2  # chunks handed out for each worker: one at work, one waiting


class ExecutorError(RuntimeError):
    """The executor failed, not a run; the chunks that were back are kept, and the sweep can be resumed."""


@dataclass(frozen=True)
class SweepResult:
    """What a sweep left behind.

    Attributes
    ----------
    directory : Path
    files : tuple of Path
    runs, played : int
        Runs of the sweep, and how many of them were played now, not before.
    seconds : float
    """

    directory: Path
    files: tuple[Path, ...]
    runs: int
    played: int
    seconds: float


def run_sweep(
    sweep: SweepLike,
    directory: str | os.PathLike[str],
    *,
    workers: int | None = None,
    executor: Executor | None = None,
    resume: bool = False,
    chunk: int | None = None,
    progress: Progress | None = None,
) -> SweepResult:
    """Play all runs of a sweep and write them into a directory.

    Parameters
    ----------
    sweep : Sweep, path or mapping
        From `read_sweep`, or what that takes.
    directory : path
        Created if need be.
    workers : int, optional
        Processes, or with an executor, how many chunks it is to have at work. Default: the cores that this
        process may use.
    executor : concurrent.futures.Executor, optional
        Where the chunks are played instead of on processes of this machine. It must be able to import
        this package, in the same version, and see the tables of the scenario under the same paths.
        It is left open.
    resume : bool
        Go on with a sweep that is in the directory already; the runs that are there are not played again.
    chunk : int, optional
        Runs to hand out and to write at a time; what is resumed keeps its own.
    progress : callable, optional
        Called with the number of runs that are there and of all, after each chunk.

    Returns
    -------
    SweepResult
        `load_sweep` reads the rows from its directory.

    Raises
    ------
    OutputError
        If something cannot be written. Chunks written before stay.
    ScenarioError
        If the sweep makes no sense, the directory holds another one, or a table changes while it is played.
    ExecutorError
        If the executor fails, or a run played both ways comes out differently. Chunks written before stay.
    """
    sweep = read_sweep(sweep)
    started = time.perf_counter()
    count = workers or usable_cores()
    size = chunk or (large_chunk if covered(sweep) else fair_chunk)(sweep.size, count)
    store = open_store(sweep, Path(directory), resume=resume, chunk=size)
    with alone(store.directory):
        ready = store.done()
        before = store.rows_of(ready)
        if progress:
            progress(before, sweep.size)
        if len(ready) < store.count:
            left = store.count - len(ready)
            crew = _Given(executor) if executor is not None else _Processes(min(count, left))
            try:
                _Campaign(sweep, store, crew, count, progress).play(ready)
            finally:
                crew.close()
        files = store.finish()
    return SweepResult(
        directory=store.directory,
        files=tuple(files),
        runs=sweep.size,
        played=sweep.size - before,
        seconds=time.perf_counter() - started,
    )


def usable_cores() -> int:
    """The cores that this process may use."""
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else os.cpu_count() or 1


@dataclass
class _Campaign:
    """The chunks of one sweep on their way out and back."""

    sweep: Sweep
    store: Store
    crew: _Given | _Processes
    workers: int
    progress: Progress | None
    flying: dict[Future[str], Task] = field(default_factory=dict)
    deaths: dict[int, int] = field(default_factory=dict)

    def play(self, ready: set[int]) -> None:
        """Play every chunk that is not there yet."""
        tables = _signatures(self.sweep)
        waiting = deque(number for number in range(self.store.count) if number not in ready)
        again: deque[Task] = deque()
        there = self.store.rows_of(ready)
        while waiting or again or self.flying:
            while (waiting or again) and len(self.flying) < _AHEAD * self.workers:
                task = again.popleft() if again else self._task(waiting.popleft())
                self.flying[self.crew.submit(self.sweep.job, task)] = task
            back, _ = wait(self.flying, return_when=FIRST_COMPLETED)
            broken = False
            # Those that are back first: one that failed must not cost them.
            for future in sorted(back, key=lambda one: _error(one) is not None):
                task = self.flying[future]
                error = _error(future)
                if error is None:
                    del self.flying[future]
                    if _signatures(self.sweep) != tables:
                        self._changed(tables)
                    self.store.write(task.number, future.result())
                    there += len(task.values)
                    if self.progress:
                        self.progress(there, self.sweep.size)
                elif is_death(error):
                    broken = True
                elif isinstance(error, DisagreementError):
                    raise ExecutorError(str(error)) from error
                else:
                    raise _executor_error(error)
            if broken:
                done = self._after_a_death(again)
                there += done
                if done and self.progress:
                    self.progress(there, self.sweep.size)

    def _changed(self, tables: dict[str, tuple[int, int]]) -> NoReturn:
        """A table was written to while it was being read: which rows saw what cannot be told."""
        now = _signatures(self.sweep)
        path = next(path for path, was in tables.items() if now.get(path) != was)
        text = "was changed while the sweep ran; rows written before are of the table as it was"
        raise ScenarioError(self.sweep.file, Problem(f'tables."{path}"', None, text))

    def _task(self, number: int) -> Task:
        start, stop = self.store.bounds(number)
        audited = tuple(run - start for run in self.sweep.audited if start <= run < stop)
        return Task(number, start, tuple(self.sweep.values(start, stop)), audited)

    def _after_a_death(self, again: deque[Task]) -> int:
        """Hand out again what was under way; what saw too many deaths is played run by run. Rows written."""
        suspects = self.crew.after_a_death(self.flying)
        done = 0
        for future, task in suspects.items():
            del self.flying[future]
            self.deaths[task.number] = self.deaths.get(task.number, 0) + 1
            if self.deaths[task.number] < _DEATHS:
                again.append(task)
            else:
                self.store.write(task.number, "".join(self._alone(task, i) for i in range(len(task.values))))
                done += len(task.values)
        return done

    def _alone(self, task: Task, place: int) -> str:
        """One run by itself; where that kills its worker, too, the row says so."""
        job, one = self.sweep.job, Task(task.number, task.start + place, task.values[place : place + 1])
        for _ in range(_DEATHS):
            future = self.crew.submit(job, one)
            error = _error(future)
            if error is None:
                return future.result()
            if not is_death(error):
                raise _executor_error(error)
            self.crew.after_a_death({future: one})
        return _dead_row(job, one)


def _signatures(sweep: Sweep) -> dict[str, tuple[int, int]]:
    """Time and size of the tables that runs read."""
    found = {}
    for path in sweep.definition["tables"]:
        try:
            status = os.stat(path)
        except OSError:
            continue
        found[path] = (status.st_mtime_ns, status.st_size)
    return found


def _dead_row(job: Job, task: Task) -> str:
    row = {"run": task.start + 1, **{a.key: v for a, v in zip(job.axes, task.values[0], strict=True)}}
    row |= failure("the worker process died in this run, each time")
    return as_text([[row.get(name) for name in columns(job)]])


def _error(future: Future[str]) -> BaseException | None:
    """What a future ended with, None where it has a result; waits for it."""
    try:
        return future.exception()
    except CancelledError as cancelled:
        return cancelled


def is_death(error: BaseException) -> bool:
    """Whether an error says that a worker died, rather than that something is wrong."""
    # dask's own, by name: it needs not be installed.
    return isinstance(error, BrokenExecutor) or type(error).__name__ == "KilledWorker"


def _executor_error(error: BaseException) -> ExecutorError:
    failed = ExecutorError(f"the executor failed, {type(error).__name__}: {error or 'no reason given'}")
    failed.__cause__ = error
    return failed


@dataclass
class _Given:
    """An executor of the caller's."""

    executor: Executor

    def submit(self, job: Job, task: Task) -> Future[str]:
        try:
            return self.executor.submit(play_chunk, job, task)
        except BrokenExecutor as error:
            raise _executor_error(error) from error

    def after_a_death(self, flying: dict[Future[str], Task]) -> dict[Future[str], Task]:
        """What was lost: here, what says so."""
        lost = {f: t for f, t in flying.items() if f.done() and (e := _error(f)) and is_death(e)}
        broken = next((e for f in lost if isinstance(e := _error(f), BrokenExecutor)), None)
        if broken is not None:
            raise _executor_error(broken)
        return lost

    def close(self) -> None:
        """Leave it open: it is not ours."""


class _Processes:
    """Processes of this machine, replaced when one of them dies."""

    def __init__(self, workers: int) -> None:
        self.workers = workers
        self.pool = self._pool()

    def _pool(self) -> ProcessPoolExecutor:
        # A forked copy of a process with threads may hang, and a fresh one costs half a second.
        return ProcessPoolExecutor(
            self.workers, mp_context=multiprocessing.get_context("spawn"), initializer=_settle_in
        )

    def submit(self, job: Job, task: Task) -> Future[str]:
        try:
            return self.pool.submit(play_chunk, job, task)
        except BrokenExecutor as error:
            # It broke since the last look; the future says so, as those under way do.
            future: Future[str] = Future()
            future.set_exception(error)
            return future

    def after_a_death(self, flying: dict[Future[str], Task]) -> dict[Future[str], Task]:
        """What was lost: with one process of a pool all that was under way, but for what was just back."""
        wait(flying)
        lost = {future: task for future, task in flying.items() if _error(future) is not None}
        self.pool.shutdown(wait=True)
        self.pool = self._pool()
        return lost

    def close(self) -> None:
        """Stop, without waiting for chunks that nobody will take."""
        processes = list((getattr(self.pool, "_processes", None) or {}).values())
        self.pool.shutdown(wait=False, cancel_futures=True)
        for process in processes:
            process.terminate()
        for process in processes:
            process.join()


def _settle_in() -> None:
    """What a worker does first: leave Ctrl-C to its parent, and not outlive it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:

        def follow() -> None:
            parent.join()
            os._exit(1)

        threading.Thread(target=follow, daemon=True).start()
