"""The command `balloons`, put together: its verbs are in the modules beside this one.

Every command reads its options, calls the package, and prints. None computes anything. Exit codes are in
`endings`. Everything heavy is imported inside the commands, so that `--help` and a mistyped file name answer
at once.
"""

from __future__ import annotations

import sys
from io import TextIOWrapper
from typing import Annotated

import typer

from simulator.cli import animate, check_table, fit, history, hysteresis, live, materials, paths, sweep

app = typer.Typer(
    name="balloons",
    help="Voltage histories and equilibrium paths of interconnected dielectric-elastomer balloons.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


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


# In the order of the help.
app.command()(history.run)
app.command()(live.live)
app.command()(animate.animate)
app.command()(paths.trace)
app.command()(paths.fold)
app.command()(hysteresis.states)
app.command()(hysteresis.unload)
app.command()(materials.explain)
app.command()(materials.presets)
app.command()(materials.schema)
app.command("check-table")(check_table.check_table)
app.command()(sweep.sweep)
app.command("map")(sweep.draw_map)
app.command()(sweep.optimize)
app.command()(fit.fit)
