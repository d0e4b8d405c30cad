"""How a command ends where something is wrong: one message on stderr, and an exit code.

Input that makes no sense, or an output directory that cannot be written to, is exit code 2; a solver (of a
sweep: an executor) that failed is 3; Ctrl-C is 130. A run or a path that ended in any physical way is 0.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn

import typer

BAD_INPUT = 2
SOLVER_FAILED = 3
INTERRUPTED = 130


def fail(message: str, code: int) -> NoReturn:
    """Print a message on stderr and leave with an exit code."""
    print(f"balloons: {message}", file=sys.stderr)
    raise typer.Exit(code)


def _nothing_written() -> str:
    return "interrupted, nothing written"


def interrupted(written: Sequence[Path]) -> str:
    """What is said after Ctrl-C, with the files that were written before it."""
    if not written:
        return _nothing_written()
    return f"interrupted; {', '.join(path.name for path in written)} are in {written[0].parent}"


@contextmanager
def errors_reported(interrupted: Callable[[], str] = _nothing_written) -> Iterator[None]:
    """Leave with exit code 2 where a scenario, an option or a directory is wrong, with 130 after Ctrl-C.

    Parameters
    ----------
    interrupted : callable
        Called after Ctrl-C; returns the message.
    """
    try:
        yield
    except (ValueError, OSError, ImportError) as error:
        if not _is_input(error):
            raise
        fail(str(error), BAD_INPUT)
    except KeyboardInterrupt:
        fail(interrupted(), INTERRUPTED)


@contextmanager
def solver_failures_reported() -> Iterator[None]:
    """Leave with exit code 3 where equilibria could not be followed; nothing has been written by then."""
    try:
        yield
    except (RuntimeError, ArithmeticError) as error:
        from simulator.simulation.run import SolverError

        if not isinstance(error, SolverError | ArithmeticError):
            raise
        fail(f"the solver failed: {error}\nnothing written", SOLVER_FAILED)


def _is_input(error: Exception) -> bool:
    """Whether an error says what is wrong with the input; what else fails is a fault of the program."""
    from simulator.results.extras import MissingExtra
    from simulator.results.files import OutputError
    from simulator.scenario import ScenarioError

    if isinstance(error, ScenarioError | OutputError | MissingExtra):
        return True
    # Only a sweep or a map raises it, and by then it is loaded.
    from simulator.sweep.picking import PickError

    return isinstance(error, PickError)
