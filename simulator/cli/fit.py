"""`balloons fit`: numbers of a scenario from measurements, their files, and what they are worth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from simulator.cli.endings import SOLVER_FAILED, errors_reported, fail, interrupted, solver_failures_reported
from simulator.cli.options import Quiet, results_option
from simulator.cli.pictures import Format, FormatOption, any_format, draw, remove_old, say_removed

PICTURE = "fit"


def fit(
    problem: Annotated[Path, typer.Argument(metavar="FIT", help="Fit file (TOML).", show_default=False)],
    out: Annotated[Path | None, results_option("results/<FIT's stem>-fit")] = None,
    plot: Annotated[bool, typer.Option("--plot/--no-plot", help=f"Draw {PICTURE}.png.")] = True,
    form: FormatOption = None,
    quiet: Quiet = False,
) -> None:
    """Fit numbers of a scenario to measurements; write fit.json, fit.csv and fitted.toml."""
    from simulator.cli.summary_sweep import count_progress
    from simulator.results.files import check_writable
    from simulator.results.fit_tables import FIT_FILES

    directory = Path("results") / f"{problem.stem}-fit" if out is None else out
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
    if not found.converged:
        fail(f"not converged: {found.message}\nwhat there is, is in {directory}", SOLVER_FAILED)
