"""`balloons animate`: a history as a moving picture."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from simulator.cli.endings import errors_reported, solver_failures_reported
from simulator.cli.options import Quiet
from simulator.cli.summary import progress_bar

if TYPE_CHECKING:
    from simulator.scenario import Scenario


def animate(
    source: Annotated[
        Path, typer.Argument(metavar="SCENARIO|RESULTS", help="Scenario file, or a directory of results.")
    ],
    out: Annotated[Path, typer.Option(metavar="FILE", help="A .gif, or a .mp4 where ffmpeg is.")],
    seconds: Annotated[float, typer.Option(min=0.1, max=600.0, help="How long it is, but for pauses.")] = 8.0,
    rate: Annotated[int, typer.Option(min=1, max=50, help="Frames in a second.")] = 20,
    width: Annotated[float, typer.Option(min=2.0, max=24.0, help="In inches of 80 dots.")] = 8.0,
    quiet: Quiet = False,
) -> None:
    """Play a scenario and write it as a moving picture: balloons to scale, voltage and loop."""
    from simulator.simulation.run import simulate

    with errors_reported(), solver_failures_reported():
        history = simulate(_scenario(source))
        from simulator.results.plot.animation import write_animation

        with progress_bar(quiet=quiet) as progress:
            written = write_animation(
                history, out, seconds=seconds, rate=rate, width=width, progress=progress
            )
    if not quiet:
        print(f"{written}: {written.stat().st_size / 1e6:.2f} MB")


def _scenario(source: Path) -> Scenario:
    """The scenario of a file, or the one that `run.json` of a directory tells of."""
    from simulator.results.files import OutputError
    from simulator.scenario import load_scenario

    if not source.is_dir():
        return load_scenario(source)
    try:
        return load_scenario(json.loads((source / "run.json").read_text("utf-8"))["scenario"])
    except (OSError, ValueError, KeyError) as error:
        raise OutputError(f"{source} holds no results of `balloons run`: {error}") from None
