"""`balloons live`: a scenario on a page in the browser."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from simulator.cli.endings import errors_reported

_LOOPBACK = ("127.0.0.1", "localhost")


def live(
    scenario: Annotated[
        Path | None,
        typer.Argument(metavar="[SCENARIO]", help="Scenario file (TOML).", show_default="Fig. 5b, state B"),
    ] = None,
    host: Annotated[str, typer.Option(metavar="ADDRESS", help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port; 0 for one that is free.")] = 0,
    show: Annotated[bool, typer.Option("--show/--no-show", help="Open the page in the browser.")] = True,
) -> None:
    """Open a page in the browser that plays a scenario anew while its numbers are moved."""
    with errors_reported(lambda: "the page is closed"):
        from simulator.scenario import load_scenario

        loaded = None if scenario is None else load_scenario(scenario)
        try:
            from simulator.live.server import serve
        except ImportError as error:
            from simulator.live import MISSING
            from simulator.results.extras import MissingExtra

            raise MissingExtra(MISSING) from error
        if host not in _LOOPBACK:
            print(f"balloons: at {host} other machines can open this page and compute here", file=sys.stderr)
        serve(loaded, host=host, port=port, show=show)
