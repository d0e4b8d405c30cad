"""What the commands of the studies share: their options, their exit codes, and how they write."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import BinaryIO

from simulator.results.files import OutputError, check_writable, write_files
from simulator.scenario import ScenarioError
from simulator.simulation.run import SolverError

__all__ = ["at_least_one", "between", "parser", "write_documents"]


def parser(study: str, description: str) -> argparse.ArgumentParser:
    """A parser with the option that all studies share.

    Parameters
    ----------
    study : str
        The study's package below `tests.studies`.
    description : str
        What it does, for `--help`.
    """
    made = argparse.ArgumentParser(
        prog=f"python -m tests.studies.{study}",
        description=description,
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    made.add_argument("--quiet", action="store_true", help="print nothing but errors")
    return made


def between(lowest: float, highest: float) -> Callable[[str], float]:
    """A type of option: a number within bounds, which belong to it."""

    def number(text: str) -> float:
        value = float(text)
        if not lowest <= value <= highest:  # NaN as well
            raise argparse.ArgumentTypeError(f"{text}: must be from {lowest:g} to {highest:g}")
        return value

    number.__name__ = "number"
    return number


def at_least_one(text: str) -> int:
    """A type of option: a whole number from 1."""
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text}: must be at least 1")
    return value


at_least_one.__name__ = "whole number"  # argparse: invalid whole number value


def write_documents(
    directory: Path, names: tuple[str, ...], produce: Callable[[], dict[str, bytes]], *, quiet: bool
) -> int:
    """Write the files of a study, all of them or none.

    Parameters
    ----------
    directory : Path
        Where they go; created if need be.
    names : tuple of str
        The files, to find out before a long computation that they cannot be written.
    produce : callable
        Computes them: file name to content.
    quiet : bool
        Whether to keep silent about success.

    Returns
    -------
    int
        The exit code: 0; 2 for a scenario or a place that makes no sense; 3 for a solver failure;
        130 after Ctrl-C. Nothing is written unless it is 0.
    """
    try:
        check_writable(directory, names)
        documents = produce()
        paths = write_files(
            directory, {name: partial(_write_bytes, content) for name, content in documents.items()}
        )
    except (ScenarioError, OutputError) as error:
        return _failed(str(error), 2)
    except (SolverError, ArithmeticError) as error:
        return _failed(f"the solver failed: {error}\nnothing written", 3)
    except KeyboardInterrupt:
        return _failed("interrupted, nothing written", 130)
    if not quiet:
        print(f"files    {directory}: {', '.join(path.name for path in paths)}")
    return 0


def _write_bytes(content: bytes, stream: BinaryIO) -> None:
    stream.write(content)


def _failed(message: str, code: int) -> int:
    print(message, file=sys.stderr)
    return code
