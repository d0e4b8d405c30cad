"""`balloons run`: one scenario played, its files, and what is kept where the solver fails."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from simulator.cli.endings import BAD_INPUT, SOLVER_FAILED, errors_reported, fail, interrupted
from simulator.cli.options import Quiet, ScenarioArgument, results_option
from simulator.cli.pictures import Format, FormatOption, any_format, draw, remove_old, say_removed, wanted
from simulator.cli.summary import progress_bar, summarise_run

if TYPE_CHECKING:
    from simulator.results.history import History
    from simulator.scenario import Scenario
    from simulator.sweep.bands import Bands

PICTURE, BANDS = "history", "bands"


def run(
    scenario: ScenarioArgument,
    out: Annotated[Path | None, results_option("results/<SCENARIO's stem>")] = None,
    plot: Annotated[bool, typer.Option("--plot", help=f"Also draw {PICTURE}.png.")] = False,
    form: FormatOption = None,
    panels: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="What the picture shows: some of voltage, pressure, stretch, field, margin, loop, charge.",
            show_default="what the scenario has",
        ),
    ] = None,
    sensitivities: Annotated[
        bool, typer.Option("--sensitivities", help="Also how each limit point moves with each number.")
    ] = False,
    uncertainty: Annotated[
        bool,
        typer.Option("--uncertainty", help="Also 2,048 runs with films known to 5 %: bands on the loop."),
    ] = False,
    spread: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=SHARE",
            help="With --uncertainty: what is known to which share of it, instead.",
            show_default=False,
        ),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Play a scenario; write history.csv, events.csv and run.json, and say what happened."""
    from simulator.results.files import check_writable
    from simulator.results.tables import CYCLES_FILE, RUN_FILES, SENSITIVITIES_FILE, write_run
    from simulator.scenario import load_scenario

    directory = Path("results") / scenario.stem if out is None else out
    shown = _panels(panels)
    picture = wanted(PICTURE, plot=plot or shown is not None, form=form)
    more = (CYCLES_FILE, *([SENSITIVITIES_FILE] if sensitivities else []))
    paths: list[Path] = []
    with errors_reported(lambda: interrupted(paths)):
        loaded = load_scenario(scenario)
        check_writable(directory, (*RUN_FILES, *([picture] if picture else []), *more))
        history = _played(loaded, directory, picture, quiet=quiet)
        paths += write_run(history, directory)
        paths += _write_loops(history, directory)
        removed = remove_old(directory, _old(paths))
        if sensitivities:
            paths += _write_sensitivities(history, directory)
        paths += draw(directory, picture, lambda: history.plot(panels=shown))
        bands = _bands(loaded, spread) if uncertainty or spread else None
        more_paths = [] if bands is None else bands.to_csv(directory)
        if bands is not None:
            more_paths += draw(directory, f"{BANDS}.{form or Format.PNG}", partial(_drawn, history, bands))
    if not quiet:
        summarise_run(history, paths)
        if bands is not None:
            from simulator.cli.summary_uncertainty import summarise_uncertainty

            summarise_uncertainty(bands.uncertainty, more_paths)
        say_removed([name for name in removed if name not in [path.name for path in paths]])


def _bands(scenario: Scenario, spread: list[str] | None) -> Bands:
    """Where many runs with other numbers are; leaves with exit code 2 where `--spread` makes no sense."""
    from simulator.sweep.bands import bands

    shares: dict[str, float] = {}
    for text in spread or ():
        key, _, share = text.partition("=")
        try:
            shares[key] = float(share)
        except ValueError:
            fail(f"--spread {text}: must be a key of the scenario and a number, KEY=0.05", BAD_INPUT)
    return bands(scenario, shares or None)


def _drawn(history: History, bands: Bands) -> object:
    from simulator.results.plot.bands import plot_bands

    return plot_bands(history, bands.step, bands.snaps, bands.runs, bands.voltage, bands.stretch)


def _panels(names: str | None) -> tuple[str, ...] | None:
    """The panels of `--panels`; leaves with exit code 2 where there is no such panel."""
    if names is None:
        return None
    from simulator.results.history import PANELS

    found = tuple(name.strip() for name in names.split(","))
    for name in found:
        if name not in PANELS:
            fail(f"--panels {name}: must be some of {', '.join(PANELS)}, with commas between them", BAD_INPUT)
    return found


def _write_loops(history: History, directory: Path) -> list[Path]:
    """Write the loops of a history, if it has any."""
    if not history.electroded:
        return []
    from simulator.hysteresis.loops import loops
    from simulator.results.loops import write_loops

    found = loops(history)
    return write_loops(history, found, directory) if found else []


def _old(written: list[Path]) -> list[str]:
    """What an earlier run may have left where a history has been written."""
    from simulator.results.loops import LOOPS_FILE
    from simulator.results.tables import CYCLES_FILE, SENSITIVITIES_FILE

    there = {path.name for path in written}
    of_sample = ("bands.csv", "quantiles.csv", "probabilities.csv", "convergence.csv", *any_format(BANDS))
    known = (SENSITIVITIES_FILE, CYCLES_FILE, LOOPS_FILE, *any_format(PICTURE), *of_sample)
    return [name for name in known if name not in there]


def _played(scenario: Scenario, directory: Path, picture: str | None, *, quiet: bool) -> History:
    """The history; where the solver fails, what it had reached is written, and the exit code is 3."""
    from simulator.simulation.run import SolverError, simulate

    try:
        with progress_bar(quiet=quiet) as progress:
            return simulate(scenario, progress=progress)
    except SolverError as error:
        _keep_partial(error, error.history, directory, picture)


def _write_sensitivities(history: History, directory: Path) -> list[Path]:
    from simulator.analysis.sensitivity import all_sensitivities
    from simulator.results.tables import write_sensitivities

    try:
        return write_sensitivities(all_sensitivities(history), directory)
    except ArithmeticError as error:
        fail(f"{error}; the history is in {directory}, without sensitivities", SOLVER_FAILED)


def _keep_partial(
    error: RuntimeError, history: History | None, directory: Path, picture: str | None
) -> NoReturn:
    """Write what a failed solver had reached, and leave with exit code 3."""
    from simulator.results.files import OutputError
    from simulator.results.tables import write_run

    message = f"the solver failed: {error}"
    if history is None or not len(history):
        fail(f"{message}\nnothing was computed before that, nothing written", SOLVER_FAILED)
    reached = f"step {history.step[-1]}, time {history.time[-1]:.10g}"
    try:
        remove_old(directory, _old(write_run(history, directory, failure=str(error))))
        draw(directory, picture, history.plot)
    except OutputError as unwritten:
        fail(f"{message}\nit had reached {reached}, but {unwritten}", SOLVER_FAILED)
    fail(f"{message}\nthe partial history, up to {reached}, is in {directory}", SOLVER_FAILED)
