"""`balloons run`: one scenario played, its files, and what is kept where the solver fails."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from simulator.cli.endings import SOLVER_FAILED, errors_reported, fail
from simulator.cli.options import Quiet, ScenarioArgument, results_option
from simulator.cli.summary import progress_bar, summarise_run

if TYPE_CHECKING:
    from simulator.results.history import History
    from simulator.scenario import Scenario

PICTURE = "history.png"


def run(
    scenario: ScenarioArgument,
    out: Annotated[Path | None, results_option("results/<SCENARIO's stem>")] = None,
    plot: Annotated[bool, typer.Option("--plot", help=f"Also draw {PICTURE}.")] = False,
    sensitivities: Annotated[
        bool, typer.Option("--sensitivities", help="Also how each limit point moves with each number.")
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Play a scenario; write history.csv, events.csv and run.json, and say what happened."""
    from simulator.results.files import check_writable
    from simulator.results.tables import RUN_FILES, SENSITIVITIES_FILE
    from simulator.scenario import load_scenario

    directory = Path("results") / scenario.stem if out is None else out
    pictures = (PICTURE,) if plot else ()
    more = (SENSITIVITIES_FILE,) if sensitivities else ()
    with errors_reported():
        loaded = load_scenario(scenario)
        check_writable(directory, (*RUN_FILES, *pictures, *more))
        history = _played(loaded, directory, plot=plot, quiet=quiet)
        paths = _write(history, directory, plot=plot)
        if sensitivities:
            paths += _write_sensitivities(history, directory)
    if not quiet:
        summarise_run(history, paths)


def _played(scenario: Scenario, directory: Path, *, plot: bool, quiet: bool) -> History:
    """The history; where the solver fails, what it had reached is written, and the exit code is 3."""
    from simulator.simulation.run import SolverError, simulate

    try:
        with progress_bar(quiet=quiet) as progress:
            return simulate(scenario, progress=progress)
    except SolverError as error:
        _keep_partial(error, error.history, directory, plot=plot)


def _write(history: History, directory: Path, *, plot: bool, failure: str | None = None) -> list[Path]:
    from simulator.results.files import write_files
    from simulator.results.tables import write_run

    if not plot:
        return write_run(history, directory, failure=failure)
    from simulator.results.plot import draw_png

    # Drawn first, so that a Ctrl-C while it draws leaves nothing behind. But a picture that cannot
    # be drawn must not cost a long run its numbers.
    try:
        picture = draw_png(history)
    except Exception:
        write_run(history, directory, failure=failure)
        raise
    paths = write_run(history, directory, failure=failure)
    return paths + write_files(directory, {PICTURE: picture})


def _write_sensitivities(history: History, directory: Path) -> list[Path]:
    from simulator.analysis.sensitivity import all_sensitivities
    from simulator.results.tables import write_sensitivities

    try:
        return write_sensitivities(all_sensitivities(history), directory)
    except ArithmeticError as error:
        fail(f"{error}; the history is in {directory}, without sensitivities", SOLVER_FAILED)


def _keep_partial(error: RuntimeError, history: History | None, directory: Path, *, plot: bool) -> NoReturn:
    """Write what a failed solver had reached, and leave with exit code 3."""
    from simulator.results.files import OutputError

    message = f"the solver failed: {error}"
    if history is None or not len(history):
        fail(f"{message}\nnothing was computed before that, nothing written", SOLVER_FAILED)
    reached = f"step {history.step[-1]}, time {history.time[-1]:.10g}"
    try:
        _write(history, directory, plot=plot, failure=str(error))
    except OutputError as unwritten:
        fail(f"{message}\nit had reached {reached}, but {unwritten}", SOLVER_FAILED)
    fail(f"{message}\nthe partial history, up to {reached}, is in {directory}", SOLVER_FAILED)
