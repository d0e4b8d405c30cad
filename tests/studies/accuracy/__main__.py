"""Measures error against run time, beside SciPy's solvers: `make accuracy`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from simulator.cli.summary import progress_bar
from tests.studies.accuracy import FILES, SCENARIOS, accuracy_files
from tests.studies.accuracy.study import DELAYS, REPETITIONS, TOLERANCES
from tests.studies.command import at_least_one, between, parser, write_documents


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the page, its figure and its table. Returns the exit code of `write_documents`."""
    given = _options().parse_args(arguments)
    files = given.scenarios or [Path("scenarios") / f"{name}.toml" for name in SCENARIOS]
    tolerances = sorted(set(given.rtol or TOLERANCES), reverse=True)
    delays = sorted(set(given.delay or DELAYS), reverse=True)
    with progress_bar(quiet=given.quiet) as progress:
        return write_documents(
            given.out,
            FILES,
            lambda: accuracy_files(files, tolerances, delays, given.repeat, progress),
            quiet=given.quiet,
        )


def _options() -> argparse.ArgumentParser:
    options = parser(
        "accuracy",
        "Measure error against run time, beside SciPy's solvers; write accuracy.md, figure and table.",
    )
    options.add_argument(
        "scenarios",
        type=Path,
        nargs="*",
        metavar="SCENARIO",
        help=f"sealed pairs driven over a limit point; without any, {', '.join(SCENARIOS)} of scenarios/",
    )
    options.add_argument("--out", type=Path, metavar="DIR", default=Path("docs"), help="where the page goes")
    options.add_argument(
        "--rtol",
        type=between(1e-12, 0.1),
        action="append",
        metavar="X",
        help="a tolerance; may be repeated; without any, 1e-2 … 1e-10",
    )
    options.add_argument(
        "--delay",
        type=between(1e-9, 1.0),
        action="append",
        metavar="X",
        help="relaxation time of the viscous runs, over the ramp's duration; may be repeated; "
        "without any, 1e-3, 1e-5 and 1e-7",
    )
    options.add_argument(
        "--repeat", type=at_least_one, metavar="N", default=REPETITIONS, help="repetitions of every run"
    )
    return options


if __name__ == "__main__":
    sys.exit(main())
