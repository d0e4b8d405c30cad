"""`balloons sweep`, `map` and `optimize`: one scenario played many times.

What a sweep wrote before Ctrl-C or a failure stays, and `--resume` goes on with it.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from simulator.cli.endings import BAD_INPUT, SOLVER_FAILED, errors_reported, fail
from simulator.cli.options import Quiet, SweepArgument, results_option
from simulator.cli.pictures import Format, FormatOption, draw
from simulator.cli.summary import print_files

if TYPE_CHECKING:
    from simulator.sweep import Sweep
    from simulator.sweep.quantiles import Uncertainty


def sweep(
    sweep: SweepArgument,
    out: Annotated[Path | None, results_option("results/<SWEEP's stem>-sweep")] = None,
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
    from simulator.cli.summary_sweep import summarise_sweep, sweep_progress
    from simulator.cli.summary_uncertainty import summarise_uncertainty
    from simulator.cli.summary_units import print_bare
    from simulator.scenario import load_scenario
    from simulator.sweep import ExecutorError, read_sweep, run_sweep
    from simulator.sweep.storage import stored, tally

    directory = Path("results") / f"{sweep.stem}-sweep" if out is None else out
    with errors_reported(lambda: f"interrupted; {_kept(directory)}"):
        read = read_sweep(sweep)
        try:
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
        except ExecutorError as error:
            fail(f"{error}\n{_kept(directory)}", SOLVER_FAILED)
        spread = _uncertainty(read, directory) if read.sample else None
        if not quiet:
            summarise_sweep(read.title, result, *tally(stored(directory)))
            if spread is not None:
                summarise_uncertainty(*spread)
            print_bare(load_scenario(read.job.scenario))


def _uncertainty(sweep: Sweep, directory: Path) -> tuple[Uncertainty, list[Path]]:
    """What a sample says, and its files."""
    from simulator.sweep.indices import sobol_indices_of
    from simulator.sweep.quantiles import uncertainty

    found = replace(uncertainty(directory), indices=sobol_indices_of(sweep))
    return found, found.to_csv(directory)


def draw_map(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="Results of a sweep.", show_default=False)],
    x: Annotated[str, typer.Option("--x", metavar="KEY", help="What goes to the right.", show_default=False)],
    y: Annotated[
        str | None,
        typer.Option("--y", metavar="KEY", help="What goes up; without it: lines.", show_default=False),
    ] = None,
    color: Annotated[
        str,
        typer.Option(
            "--color",
            metavar="COLUMN",
            help="What is shown: categories, numbers, or a share such as P(behaviour=snap_stays).",
        ),
    ] = "behaviour",
    panels: Annotated[
        str | None,
        typer.Option(metavar="KEY", help="One map, or line, for each value of it.", show_default=False),
    ] = None,
    at: Annotated[
        list[str] | None,
        typer.Option(metavar="KEY=VALUE", help="Hold a key of the grid at a value.", show_default=False),
    ] = None,
    fold: Annotated[
        list[str] | None,
        typer.Option(
            metavar="[VALUE=]FILE",
            help="A fold.csv to draw on top, or in the panel of a value.",
            show_default=False,
        ),
    ] = None,
    mark: Annotated[
        list[str] | None,
        typer.Option(
            metavar="[VALUE=]X,Y,TEXT", help="A point to mark, or in one panel.", show_default=False
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="The picture.", show_default="DIR/map.png")
    ] = None,
    form: FormatOption = None,
    title: Annotated[
        str | None, typer.Option(metavar="TEXT", help="Its title.", show_default="that of the sweep")
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Draw a sweep as a map: what happens, or any other column, over two of its keys."""
    from simulator.sweep.picking import PickError, fold_line, pick
    from simulator.sweep.picking import mark as point

    picture = _picture(directory, out, form)
    with errors_reported():
        held = [(key, value) for key, _, value in (text.partition("=") for text in at or ())]
        picked = pick(directory, x, y, color, panels, held)
        if y is None and (fold or mark):
            raise PickError(f"{'--fold' if fold else '--mark'}: goes with --y")
        lines = [fold_line(text, x, str(y), picked.units) for text in fold or ()]
        points = [point(text) for text in mark or ()]

        def figure() -> object:
            from simulator.results.plot.map import MapCurve, MapMark, plot_lines, plot_map, subject

            said = f"{picked.title}\n{subject(color, x, y, panels)}" if title is None else title
            heading = f"{said}\n(unfinished: {picked.unfinished})" if picked.unfinished else said
            if y is None:
                return plot_lines(
                    picked.columns, x, color, lines=panels, log=picked.log, title=heading, units=picked.units
                )
            return plot_map(
                picked.columns,
                x,
                y,
                color,
                panels=panels,
                curves=[MapCurve(line.x, line.y, line.label, line.panel) for line in lines],
                marks=[MapMark(*words) for words in points],
                log=picked.log,
                title=heading,
                units=picked.units,
            )

        drawn = draw(picture.parent, picture.name, figure)
    if not quiet and drawn:
        print_files(drawn)
        if picked.unfinished:
            print(f"         unfinished: {picked.unfinished} are drawn")


def _picture(directory: Path, out: Path | None, form: Format | None) -> Path:
    """Where a map goes, and by its suffix as what; leaves with exit code 2 where the two disagree."""
    picture = directory / f"map.{form or Format.PNG}" if out is None else out
    known = [f".{each}" for each in Format]
    if picture.suffix not in known or (form is not None and picture.suffix != f".{form}"):
        allowed = f".{form}" if form is not None else ", ".join(known)
        fail(f"--out {picture}: must end in {allowed}", BAD_INPUT)
    return picture


def optimize(
    question: Annotated[
        Path, typer.Argument(metavar="FILE", help="What to optimise (TOML).", show_default=False)
    ],
    out: Annotated[Path | None, results_option("results/<FILE's stem>-optimum")] = None,
    quiet: Quiet = False,
) -> None:
    """Find the run that makes one column largest or smallest under conditions; write optimum.csv."""
    from simulator.cli.summary_sweep import count_progress, summarise_optimum
    from simulator.cli.summary_units import print_bare
    from simulator.results.files import check_writable
    from simulator.scenario import load_scenario
    from simulator.sweep import DisagreementError
    from simulator.sweep.optimum import OPTIMUM_FILES, read_question
    from simulator.sweep.optimum import optimize as search

    directory = Path("results") / f"{question.stem}-optimum" if out is None else out
    with errors_reported():
        asked = read_question(question)
        check_writable(directory, OPTIMUM_FILES)
        try:
            with count_progress(quiet=quiet) as progress:
                found = search(asked, progress=progress)
        except DisagreementError as error:
            fail(str(error), SOLVER_FAILED)
        paths = found.to_csv(directory)
    if found.row is None:
        fail(f"none of {len(found.runs):,} runs meets the conditions; all are in {paths[-1]}", SOLVER_FAILED)
    if not quiet:
        summarise_optimum(found, paths)
        print_bare(load_scenario(asked.sweep.job.scenario))


@contextmanager
def _cluster(address: str | None) -> Iterator[tuple[Executor | None, int | None]]:
    """The workers of a dask scheduler as an executor, and how many chunks they take at a time."""
    if address is None:
        yield None, None
        return
    from simulator.sweep.cluster import connected

    try:
        with connected(address) as found:
            yield found
    except ConnectionError as error:
        fail(str(error), BAD_INPUT)


def _kept(directory: Path) -> str:
    """How much of a sweep is safe, in words."""
    from simulator.results.files import OutputError
    from simulator.sweep.storage import stored

    try:
        store = stored(directory)
    except OutputError:
        return "nothing written"
    done = store.rows_of(store.done())
    return f"{done:,} of {store.size:,} runs are in {directory}; --resume goes on with them"
