"""The simulator in a process of its own: with a time limit, and with all that it prints caught."""

from __future__ import annotations

import multiprocessing
import os
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

LIMIT = 20.0  # seconds for one run, of the processor's time: the machine may have other things to do
_SLOWER = 20.0  # times as long at most by the clock, for a run that waits for something


@dataclass(frozen=True)
class Ran:
    """What became of one call.

    Attributes
    ----------
    end : {"returned", "raised", "crash", "hang"}
        "crash" is an exception that is none of the documented ones, or a process that died.
    value : object
        What it returned, or the history of a `SolverError`.
    error : str
        Type and message of what was raised; the traceback of a crash.
    printed : str
        All that reached the file descriptors of standard output and standard error.
    """

    end: str
    value: Any
    error: str
    printed: str
    seconds: float


class Runner:
    """Calls functions in a child process, which is replaced when a call hangs or kills it."""

    def __init__(self, limit: float = LIMIT) -> None:
        self.limit = limit
        self._child: Any = None
        self._door: Connection | None = None

    def __enter__(self) -> Runner:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def call(self, function: Callable[..., Any], *arguments: Any) -> Ran:
        """Call a function of a module in the child process.

        Documented errors (`ScenarioError`, `SolverError`, `PathError`) are "raised", all others a "crash".
        """
        start = time.perf_counter()
        door = self._open()
        door.send((function, arguments))
        if not self._comes_back(door):
            self.close()
            return Ran("hang", None, f"no end within {self.limit:g} s", "", time.perf_counter() - start)
        try:
            ran: Ran = door.recv()
        except EOFError:
            code = self.close()
            return Ran("crash", None, f"the process died, exit code {code}", "", time.perf_counter() - start)
        return ran

    def _comes_back(self, door: Connection) -> bool:
        """Wait for the child as long as it is allowed to take."""
        start, before = time.perf_counter(), _worked(self._child.pid)
        while time.perf_counter() - start < _SLOWER * self.limit:
            if door.poll(0.05 * self.limit):
                return True
            if _worked(self._child.pid) - before > self.limit:
                return False
        return False

    def close(self) -> int | None:
        """End the child process, and give its exit code."""
        if self._child is None:
            return None
        self._child.join(0.2)
        if self._child.is_alive():
            self._child.kill()
            self._child.join()
        code: int | None = self._child.exitcode
        assert self._door is not None
        self._door.close()
        self._child = self._door = None
        return code

    def _open(self) -> Connection:
        if self._door is None:
            context: Any = multiprocessing.get_context(
                "fork" if sys.platform.startswith("linux") else "spawn"
            )
            self._door, theirs = context.Pipe()
            self._child = context.Process(target=_serve, args=(theirs,), daemon=True)
            self._child.start()
            theirs.close()
        return self._door


def _worked(process: int) -> float:
    """The processor's time that a process has taken, in s; the clock's where the system does not tell."""
    try:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return time.perf_counter()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _serve(door: Connection) -> None:
    while True:
        try:
            function, arguments = door.recv()
        except EOFError:
            return
        door.send(_caught(function, arguments))


def _caught(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Ran:
    from simulator import PathError, ScenarioError, SolverError

    with tempfile.TemporaryFile() as file:
        sys.stdout.flush()
        sys.stderr.flush()
        kept = [os.dup(1), os.dup(2)]
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
        start = time.perf_counter()
        value, error = None, ""
        try:
            value, end = function(*arguments), "returned"
        except (ScenarioError, SolverError, PathError) as raised:
            end, error = "raised", f"{type(raised).__name__}: {raised}"
            value = getattr(raised, "history", None)
        except BaseException as raised:
            place = traceback.extract_tb(raised.__traceback__)[-1]
            where = f"{os.path.basename(place.filename)}:{place.lineno}"
            end, error = "crash", f"{type(raised).__name__} in {where}: {raised}"
        seconds = time.perf_counter() - start
        sys.stdout.flush()
        sys.stderr.flush()
        for descriptor, copy in zip((1, 2), kept, strict=True):
            os.dup2(copy, descriptor)
            os.close(copy)
        file.seek(0)
        printed = file.read().decode(errors="replace")
    return Ran(end, value, error, printed, seconds)
