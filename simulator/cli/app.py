"""The command `balloons`: words in, words out, no physics.

Exit codes: 0 for a run or a path that ended in any physical way; 2 for a scenario, an option or an
output directory that makes no sense, with nothing written; 3 for a solver failure, with the part of a
history that was reached written and labelled partial; 130 after Ctrl-C, with nothing written.

Everything heavy is imported inside the commands: `--help` and a mistyped file name answer at once.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from functools import partial
from io import TextIOWrapper
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, BinaryIO, NoReturn

import typer

from simulator.cli import check_table, sweep
from simulator.cli.summary import progress_bar, summarise_fold, summarise_run, summarise_trace

if TYPE_CHECKING:
    from collections.abc import Sequence

    from simulator.results.curve import Curve
    from simulator.results.history import History
    from simulator.scenario import Scenario

app = typer.Typer(
    name="balloons",
    help="Voltage histories and equilibrium paths of interconnected dielectric-elastomer balloons.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


ScenarioArgument = Annotated[
    Path, typer.Argument(metavar="SCENARIO", help="Scenario file (TOML).", show_default=False)
]


def _print_version(wanted: bool) -> None:
    if wanted:
        from simulator import __version__

        print(f"balloons {__version__}")
        raise typer.Exit


@app.callback()
def balloons(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Voltage histories and equilibrium paths of interconnected dielectric-elastomer balloons."""
    # A terminal that lacks a letter shows another one instead of stopping the run.
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")


@app.command()
def run(
    scenario: ScenarioArgument,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Where the results go.", show_default="results/<SCENARIO's stem>"),
    ] = None,
    plot: Annotated[bool, typer.Option("--plot", help="Also draw history.png.")] = False,
    sensitivities: Annotated[
        bool, typer.Option("--sensitivities", help="Also how each limit point moves with each number.")
    ] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")] = False,
) -> None:
    """Play a scenario; write history.csv, events.csv and run.json, and say what happened."""
    from simulator.results.files import OutputError, check_writable
    from simulator.results.tables import RUN_FILES, SENSITIVITIES_FILE, write_sensitivities
    from simulator.scenario import ScenarioError, load_scenario

    directory = Path("results") / scenario.stem if out is None else out
    names = (*RUN_FILES, "history.png") if plot else RUN_FILES
    try:
        loaded = load_scenario(scenario)
        check_writable(directory, (*names, SENSITIVITIES_FILE) if sensitivities else names)

        from simulator.simulation.run import SolverError, simulate

        try:
            with progress_bar(quiet=quiet) as progress:
                history = simulate(loaded, progress=progress)
        except SolverError as error:
            _keep_partial(error, error.history, directory, plot=plot)
        paths = _write(history, directory, plot=plot)
        if sensitivities:
            from simulator.analysis.sensitivity import all_sensitivities

            try:
                paths += write_sensitivities(all_sensitivities(history), directory)
            except ArithmeticError as error:
                _fail(f"{error}; the history is in {directory}, without sensitivities", 3)
    except (ScenarioError, OutputError) as error:
        _fail(str(error), 2)
    except KeyboardInterrupt:
        _fail("interrupted, nothing written", 130)
    if not quiet:
        summarise_run(history, paths)


@app.command()
def trace(
    scenario: ScenarioArgument,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Where the results go.", show_default="results/<SCENARIO's stem>-trace"
        ),
    ] = None,
    plot: Annotated[bool, typer.Option("--plot", help="Also draw curve.png.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")] = False,
    every: Annotated[
        bool, typer.Option("--all", help="Also the paths detached from it at the same amount of gas.")
    ] = False,
    inflation: Annotated[
        bool, typer.Option("--inflation", help="Trace one balloon's inflation instead, in pressure.")
    ] = False,
    balloon: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="The balloon that --inflation inflates.", show_default="the last"),
    ] = None,
    to_voltage: Annotated[
        str | None, typer.Option(metavar="V", help="Stop at this voltage.", show_default=False)
    ] = None,
    to_pressure: Annotated[
        str | None,
        typer.Option(metavar="P", help="Stop at this pressure (with --inflation).", show_default=False),
    ] = None,
    to_stretch: Annotated[
        float | None,
        typer.Option(
            metavar="X", help="Stop at this stretch of the first electroded (or the inflated) balloon."
        ),
    ] = None,
) -> None:
    """Trace the equilibrium path in voltage, unstable parts too; write curve.csv and points.csv."""
    from simulator.results.files import OutputError, check_writable, write_files
    from simulator.results.tables import TRACE_FILES, write_curves
    from simulator.scenario import ScenarioError, load_scenario

    _check_wishes(every, inflation, balloon, to_voltage, to_pressure, to_stretch)
    directory = Path("results") / f"{scenario.stem}-trace" if out is None else out
    names = (*TRACE_FILES, "curve.png") if plot else TRACE_FILES
    try:
        loaded = load_scenario(scenario)
        check_writable(directory, names)
        to_drive = _drive(loaded, to_voltage, to_pressure)
        curves = _traced(loaded, every, inflation, balloon, to_drive, to_stretch)
        pictures = _pictures(curves) if plot else {}
        paths = write_curves(curves, directory)
        if pictures:
            paths += write_files(directory, pictures)
    except (ScenarioError, OutputError) as error:
        _fail(str(error), 2)
    except KeyboardInterrupt:
        _fail("interrupted, nothing written", 130)
    if not quiet:
        asked = any(wish is not None for wish in (to_voltage, to_pressure, to_stretch))
        summarise_trace(curves, paths, asked=asked)


@app.command()
def fold(
    scenario: ScenarioArgument,
    vary: Annotated[
        str, typer.Option(metavar="KEY", help="The number to change, such as gas.ambient_pressure.")
    ],
    to: Annotated[str, typer.Option(metavar="X", help="Its last value.")],
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Where the results go.", show_default="results/<SCENARIO's stem>-fold"
        ),
    ] = None,
    point: Annotated[int, typer.Option(metavar="N", help="Which limit point of the path, from 1.")] = 1,
    inflation: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="A limit point of this balloon's inflation.", show_default=False),
    ] = None,
    plot: Annotated[bool, typer.Option("--plot", help="Also draw fold.png.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")] = False,
) -> None:
    """Follow a limit point while one number of the scenario changes; write fold.csv."""
    from simulator.analysis.fold import fold as follow
    from simulator.results.files import OutputError, check_writable, write_files
    from simulator.results.tables import FOLD_FILE, write_fold
    from simulator.scenario import ScenarioError, load_scenario
    from simulator.simulation.run import SolverError

    directory = Path("results") / f"{scenario.stem}-fold" if out is None else out
    try:
        loaded = load_scenario(scenario)
        check_writable(directory, (FOLD_FILE, "fold.png") if plot else (FOLD_FILE,))
        curve = follow(loaded, vary, to, point=point, inflation=inflation)
        pictures: dict[str, Callable[[BinaryIO], object]] = {}
        if plot:
            from simulator.results.plot import draw_fold_png

            pictures = {"fold.png": partial(_write_bytes, draw_fold_png(curve))}
        paths = write_fold(curve, directory)
        if pictures:
            paths += write_files(directory, pictures)
    except (ScenarioError, OutputError) as error:
        _fail(str(error), 2)
    except (SolverError, ArithmeticError) as error:
        _fail(f"the solver failed: {error}\nnothing written", 3)
    except KeyboardInterrupt:
        _fail("interrupted, nothing written", 130)
    if not quiet:
        summarise_fold(curve, to, paths)


@app.command()
def explain(scenario: ScenarioArgument) -> None:
    """Say which unknowns, equations, events and smooth pieces a scenario leads to, and what is left out."""
    from simulator.scenario import ScenarioError, load_scenario
    from simulator.simulation.explanation import explain as explanation

    try:
        print(explanation(load_scenario(scenario)))
    except ScenarioError as error:
        _fail(str(error), 2)


@app.command()
def presets() -> None:
    """List the elastomers that a scenario may name by their material, with their constants and sources."""
    from simulator.cli.summary import list_presets
    from simulator.scenario import PRESETS, Preset

    list_presets({name: (Preset(preset=name).law.words, material) for name, material in PRESETS.items()})


def _check_wishes(
    every: bool,
    inflation: bool,
    balloon: str | None,
    to_voltage: str | None,
    to_pressure: str | None,
    to_stretch: float | None,
) -> None:
    """Leave with exit code 2 where the options of `trace` contradict each other."""
    limits = {"--to-voltage": to_voltage, "--to-pressure": to_pressure, "--to-stretch": to_stretch}
    asked = [name for name, value in limits.items() if value is not None]
    if every and (asked or inflation):
        _fail(f"--all traces whole paths in voltage; it does not go with {(asked or ['--inflation'])[0]}", 2)
    if inflation and to_voltage is not None:
        _fail("--to-voltage does not go with --inflation; use --to-pressure", 2)
    if not inflation and to_pressure is not None:
        _fail("--to-pressure goes with --inflation; use --to-voltage", 2)
    if not inflation and balloon is not None:
        _fail("--balloon goes with --inflation", 2)
    if to_stretch is not None and not (math.isfinite(to_stretch) and to_stretch >= 1.0):
        _fail(f"--to-stretch {to_stretch}: must be a number >= 1", 2)


def _drive(scenario: Scenario, to_voltage: str | None, to_pressure: str | None) -> float | None:
    """The voltage or pressure to stop at, dimensionless. Raises ScenarioError."""
    from simulator.scenario import dimensionless
    from simulator.units import PRESSURE, VOLTAGE

    if to_voltage is not None:
        return dimensionless(scenario, "--to-voltage", to_voltage, VOLTAGE, 0.0)
    return (
        None if to_pressure is None else dimensionless(scenario, "--to-pressure", to_pressure, PRESSURE, 0.0)
    )


def _traced(
    scenario: Scenario,
    every: bool,
    inflation: bool,
    balloon: str | None,
    to_drive: float | None,
    to_stretch: float | None,
) -> tuple[Curve, ...]:
    """The paths asked for; leaves with exit code 3 where one cannot be followed."""
    from simulator.analysis import trace as room
    from simulator.simulation.run import SolverError

    try:
        if inflation:
            return (room.trace_inflation(scenario, balloon, to_pressure=to_drive, to_stretch=to_stretch),)
        if every:
            return room.trace_all(scenario)
        return (room.trace(scenario, to_voltage=to_drive, to_stretch=to_stretch),)
    except (SolverError, ArithmeticError) as error:
        _fail(f"the solver failed: {error}\nnothing written", 3)


def _pictures(curves: Sequence[Curve]) -> dict[str, Callable[[BinaryIO], object]]:
    from simulator.results.plot import draw_curves_png

    # Drawn before anything is written: see `_write`.
    picture = draw_curves_png(curves)
    return {"curve.png": lambda stream: stream.write(picture)}


def _write_bytes(content: bytes, stream: BinaryIO) -> None:
    stream.write(content)


def _fail(message: str, code: int) -> NoReturn:
    print(f"balloons: {message}", file=sys.stderr)
    raise typer.Exit(code)


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
    return paths + write_files(directory, {"history.png": lambda stream: stream.write(picture)})


def _keep_partial(error: RuntimeError, history: History | None, directory: Path, *, plot: bool) -> NoReturn:
    """Save what a failed solver had reached, and leave with exit code 3."""
    from simulator.results.files import OutputError

    message = f"the solver failed: {error}"
    if history is None or not len(history):
        _fail(f"{message}\nnothing was computed before that, nothing written", 3)
    reached = f"step {history.step[-1]}, time {history.time[-1]:.10g}"
    try:
        _write(history, directory, plot=plot, failure=str(error))
    except OutputError as unwritten:
        _fail(f"{message}\nit had reached {reached}, but {unwritten}", 3)
    _fail(f"{message}\nthe partial history, up to {reached}, is in {directory}", 3)


sweep.register(app)  # last, so that the help begins with `run`
check_table.register(app)
