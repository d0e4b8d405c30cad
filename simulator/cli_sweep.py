"""The commands of `balloons` that play a scenario many times: words in, words out, no physics.

Exit codes as in `cli`: 2 for input or an output directory that makes no sense, 3 where the executor (of an
optimum: the solver) failed, 130 after Ctrl-C. What was written before stays, and `--resume` goes on with it.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, NoReturn

import typer

SweepArgument = Annotated[
    Path, typer.Argument(metavar="SWEEP", help="Sweep file (TOML).", show_default=False)
]
Quiet = Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")]


def register(app: typer.Typer) -> None:
    """Add these commands to the command line."""
    for command in (sweep,):
        app.command()(command)


def sweep(
    sweep: SweepArgument,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Where the results go.", show_default="results/<SWEEP's stem>-sweep"
        ),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(metavar="N", min=1, help="Processes.", show_default="the cores of this machine"),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with the sweep that is in the directory.")
    ] = False,
    chunk: Annotated[
        int | None,
        typer.Option(
            metavar="N", min=1, help="Runs handed out and written at a time.", show_default="1 to 1000"
        ),
    ] = None,
    dask: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS", help="Play on the workers of this dask scheduler.", show_default=False
        ),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Play a scenario once for each point of a grid or a sample; write sweep.csv and sweep.parquet."""
    from simulator.files import OutputError
    from simulator.scenario import ScenarioError
    from simulator.sweep import ExecutorError, read_sweep, run_sweep
    from simulator.sweep.storage import stored, tally
    from simulator.terminal_sweep import summarise_sweep, sweep_progress

    directory = Path("results") / f"{sweep.stem}-sweep" if out is None else out
    try:
        read = read_sweep(sweep)
        with _cluster(dask) as (executor, cores), sweep_progress(quiet=quiet) as progress:
            result = run_sweep(
                read,
                directory,
                workers=workers or cores,
                executor=executor,
                resume=resume,
                chunk=chunk,
                progress=progress,
            )
        if not quiet:
            summarise_sweep(read.title, result, *tally(stored(directory)))
    except (ScenarioError, OutputError) as error:
        _fail(str(error), 2)
    except ExecutorError as error:
        _fail(f"{error}\n{_kept(directory)}", 3)
    except KeyboardInterrupt:
        _fail(f"interrupted; {_kept(directory)}", 130)


@contextmanager
def _cluster(address: str | None) -> Iterator[tuple[Executor | None, int | None]]:
    """The workers of a dask scheduler as an executor, and how many chunks they take at a time."""
    if address is None:
        yield None, None
        return
    from simulator.sweep.cluster import MissingExtra, connected

    try:
        with connected(address) as found:
            yield found
    except (MissingExtra, ConnectionError) as error:
        _fail(str(error), 2)


def _kept(directory: Path) -> str:
    """How much of a sweep is safe, in words."""
    from simulator.files import OutputError
    from simulator.sweep.storage import stored

    try:
        store = stored(directory)
    except OutputError:
        return "nothing written"
    done = store.rows_of(store.done())
    return f"{done:,} of {store.size:,} runs are in {directory}; --resume goes on with them"


def _fail(message: str, code: int) -> NoReturn:
    print(f"balloons: {message}", file=sys.stderr)
    raise typer.Exit(code)
