"""`balloons fit`: numbers of a scenario from measurements, their files, and what they are worth."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from simulator.cli.endings import (
    BAD_INPUT,
    SOLVER_FAILED,
    errors_reported,
    fail,
    interrupted,
    solver_failures_reported,
)
from simulator.cli.options import Quiet, results_option
from simulator.cli.pictures import Format, FormatOption, any_format, draw, remove_old, say_removed

if TYPE_CHECKING:
    from simulator.results.fit import Fit

PICTURE = "fit"


def fit(
    problems: Annotated[
        list[Path],
        typer.Argument(
            metavar="FIT", help="Fit file (TOML); several of the same data are compared.", show_default=False
        ),
    ],
    out: Annotated[Path | None, results_option("results/<FIT's stem>-fit")] = None,
    plot: Annotated[bool, typer.Option("--plot/--no-plot", help=f"Draw {PICTURE}.png.")] = True,
    form: FormatOption = None,
    quiet: Quiet = False,
) -> None:
    """Fit numbers of a scenario to measurements; write fit.json, fit.csv and fitted.toml."""
    if len(problems) == 1:
        directory = Path("results") / f"{problems[0].stem}-fit" if out is None else out
        _ended([_fitted(problems[0], directory, plot=plot, form=form, quiet=quiet)], directory)
        return
    directory = Path("results") / f"{problems[0].stem}-fits" if out is None else out
    stems = [problem.stem for problem in problems]
    if len(set(stems)) < len(stems):
        fail("the names of several fits must differ: each has a folder of its own", BAD_INPUT)
    found = [_fitted(one, directory / one.stem, plot=plot, form=form, quiet=quiet) for one in problems]
    with errors_reported():
        from simulator.results.fit_ranking import rank_fits, write_ranking

        try:
            ranked = rank_fits(found)
        except ValueError as error:
            fail(str(error), BAD_INPUT)
        paths = write_ranking(ranked, directory)
    if not quiet:
        from simulator.cli.summary_fit import summarise_ranking

        summarise_ranking(ranked, paths)
    _ended(found, directory)


def _ended(found: list[Fit], directory: Path) -> None:
    """Leave with exit code 3 where a search did not converge."""
    for one in found:
        if not one.converged:
            fail(f"{one.file}: not converged: {one.message}\nwhat there is, is in {directory}", SOLVER_FAILED)


def _fitted(problem: Path, directory: Path, *, plot: bool, form: Format | None, quiet: bool) -> Fit:
    """One fit with its files."""
    from simulator.cli.summary_sweep import count_progress
    from simulator.results.files import check_writable
    from simulator.results.fit_tables import FIT_FILES

    picture = f"{PICTURE}.{form or Format.PNG}" if plot or form else None
    paths: list[Path] = []
    with errors_reported(lambda: interrupted(paths)):
        from simulator.identification.estimation import fit as fitted
        from simulator.identification.reading import read_fit

        asked = read_fit(problem)
        check_writable(directory, (*FIT_FILES, *([picture] if picture else [])))
        with solver_failures_reported(), count_progress(quiet=quiet) as progress:
            found = fitted(asked, progress=progress)
        paths += found.to_csv(directory)
        removed = remove_old(directory, any_format(PICTURE))
        paths += draw(directory, picture, found.plot)
    if not quiet:
        from simulator.cli.summary_fit import summarise_fit

        summarise_fit(found, paths)
        say_removed([name for name in removed if name != picture])
    return found
