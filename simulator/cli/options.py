"""Arguments and options that several commands have."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

ScenarioArgument = Annotated[
    Path, typer.Argument(metavar="SCENARIO", help="Scenario file (TOML).", show_default=False)
]
SweepArgument = Annotated[
    Path, typer.Argument(metavar="SWEEP", help="Sweep file (TOML).", show_default=False)
]
Quiet = Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")]


def results_option(default: str) -> typer.models.OptionInfo:
    """The option `--out`, with what the help calls its default."""
    found: typer.models.OptionInfo = typer.Option(
        metavar="DIR", help="Where the results go.", show_default=default
    )
    return found
