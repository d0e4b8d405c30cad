"""The command `balloons`: words in, words out, no physics.

Exit codes: 0 for a run that ended in any physical way; 2 for a scenario, an option or an output
directory that makes no sense, with nothing written; 3 for a solver failure, with the part of the
history that was reached written and labelled partial; 130 after Ctrl-C, with nothing written.

Everything heavy is imported inside the commands: `--help` and a mistyped file name answer at once.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import TextIOWrapper
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

if TYPE_CHECKING:
    from rich.table import Table

    from simulator.history import Event, FloatArray, History

app = typer.Typer(
    name="balloons",
    help="Voltage histories of interconnected dielectric-elastomer balloons.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)

EVENTS_SHOWN = 20

_PATIENCE = 1.0  # seconds a run may take before it shows a progress bar
_REFRESH = 0.1  # seconds between two updates of the bar

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
    """Voltage histories of interconnected dielectric-elastomer balloons."""
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
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")] = False,
) -> None:
    """Play a scenario; write history.csv, events.csv and run.json, and say what happened."""
    from simulator.export import RUN_FILES, OutputError, check_writable
    from simulator.scenario import ScenarioError, load_scenario

    directory = Path("results") / scenario.stem if out is None else out
    names = (*RUN_FILES, "history.png") if plot else RUN_FILES
    try:
        loaded = load_scenario(scenario)
        check_writable(directory, names)

        from simulator.simulation import SolverError, simulate

        try:
            with _progress_bar(quiet=quiet) as progress:
                history = simulate(loaded, progress=progress)
        except SolverError as error:
            _keep_partial(error, error.history, directory, plot=plot)
        paths = _write(history, directory, plot=plot)
    except (ScenarioError, OutputError) as error:
        _fail(str(error), 2)
    except KeyboardInterrupt:
        _fail("interrupted, nothing written", 130)
    if not quiet:
        _summarise(history, paths)


@app.command()
def explain(scenario: ScenarioArgument) -> None:
    """Say which unknowns, equations, events and smooth pieces a scenario leads to, and what is left out."""
    from simulator.explanation import explain as explanation
    from simulator.scenario import ScenarioError, load_scenario

    try:
        print(explanation(load_scenario(scenario)))
    except ScenarioError as error:
        _fail(str(error), 2)


def _fail(message: str, code: int) -> NoReturn:
    print(f"balloons: {message}", file=sys.stderr)
    raise typer.Exit(code)


def _write(history: History, directory: Path, *, plot: bool, failure: str | None = None) -> list[Path]:
    from simulator.export import write_files, write_run

    if not plot:
        return write_run(history, directory, failure=failure)
    from simulator.plot import draw_png

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
    from simulator.export import OutputError

    message = f"the solver failed: {error}"
    if history is None or not len(history):
        _fail(f"{message}\nnothing was computed before that, nothing written", 3)
    reached = f"step {history.step[-1]}, time {history.time[-1]:.10g}"
    try:
        _write(history, directory, plot=plot, failure=str(error))
    except OutputError as unwritten:
        _fail(f"{message}\nit had reached {reached}, but {unwritten}", 3)
    _fail(f"{message}\nthe partial history, up to {reached}, is in {directory}", 3)


@contextmanager
def _progress_bar(*, quiet: bool) -> Iterator[Callable[[float], None] | None]:
    """A function to report progress to; a bar appears once it has been at work for a second."""
    if quiet or not sys.stderr.isatty():
        yield None
        return

    started = time.monotonic()
    due = started + _PATIENCE
    bar = None

    def report(fraction: float) -> None:
        nonlocal due, bar
        now = time.monotonic()
        if now < due:
            return
        due = now + _REFRESH
        if bar is None:
            from rich.console import Console
            from rich.progress import BarColumn, Progress, TaskProgressColumn, TimeRemainingColumn

            # No refresh thread: it would compete with the solver for the interpreter.
            bar = Progress(
                BarColumn(),
                TaskProgressColumn(),
                TimeRemainingColumn(),
                console=Console(stderr=True),
                transient=True,
                auto_refresh=False,
            )
            bar.add_task("playing", total=1.0)
            bar.start()
        bar.update(bar.task_ids[0], completed=fraction, refresh=True)

    try:
        yield report
    finally:
        if bar is not None:
            bar.stop()


def _summarise(history: History, paths: list[Path]) -> None:
    # Titles come from files: no control characters reach the terminal, and no markup is read in them.
    print("".join(letter if letter.isprintable() else " " for letter in history.scenario.title))
    end = f" at time {history.time[-1]:.10g}" if len(history) else ""
    print(f"\noutcome  {history.outcome.value}{end}")
    if history.events:
        print(f"events   {len(history.events)}")
        _print_table(_event_table(history))
        hidden = len(history.events) - EVENTS_SHOWN
        if hidden > 0:
            print(f"         … and {hidden} more, in events.csv")
    else:
        print("events   none")
    balance, statistics = history.energy_balance, history.statistics
    print(f"energy   closes to {balance.relative_imbalance:.1e} of the work exchanged")
    print(f"cost     {statistics.seconds:.3f} s, {statistics.ida_steps} IDA steps, {len(history)} samples")
    print(f"files    {paths[0].parent}: {', '.join(path.name for path in paths)}")


def _event_table(history: History) -> Table:
    """The first events, each on two lines: the state before, and under it the state after."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False, padding=(0, 1, 0, 0))
    table.add_column("time", justify="right", no_wrap=True)
    table.add_column("step", justify="right", no_wrap=True)
    table.add_column("event", no_wrap=True)
    headings = [
        *(f"voltage\n{name}" for name in history.electroded),
        *(f"stretch\n{name}" for name in history.balloons),
        "pressure",
        "dissipated",
    ]
    for heading in headings:
        table.add_column(heading, justify="right", no_wrap=True)
    for event in history.events[:EVENTS_SHOWN]:
        table.add_row(
            f"{event.time:.7g}",
            f"{event.step}",
            event.kind.value if event.stretch_after is None else f"{event.kind.value}\n  to",
            *(_short(value) for value in event.voltage),
            *_both_sides(event.stretch_before, event.stretch_after),
            *_both_sides(event.pressure_before, event.pressure_after),
            _dissipated(event),
        )
    return table


def _both_sides(before: FloatArray | float, after: FloatArray | float | None) -> list[str]:
    sides = [before] if after is None else [before, after]
    columns = zip(*([side] if isinstance(side, float) else side for side in sides), strict=True)
    return ["\n".join(_short(value) for value in column) for column in columns]


def _dissipated(event: Event) -> str:
    return "" if event.dissipated is None else f"\n{_short(event.dissipated)}"


def _short(value: float) -> str:
    # Rounding errors about zero are noise to a reader; the files keep every digit.
    return f"{value:.6g}" if abs(value) > 1e-11 else "0"


def _print_table(table: Table) -> None:
    from rich.console import Console
    from rich.padding import Padding

    console = Console()
    shown = Padding(table, (0, 0, 1, 2), expand=False)
    # A window too narrow, or a pipe, must not turn digits into an ellipsis: lines may rather run over.
    needed = console.measure(shown, options=console.options.update(max_width=100_000)).maximum
    Console(width=max(console.width, needed)).print(shown)
