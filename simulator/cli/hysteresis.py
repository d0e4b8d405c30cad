"""`balloons states`, `balloons unload`: what a voltage that comes and goes can write, and leaves behind."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from simulator.cli.endings import BAD_INPUT, errors_reported, fail, solver_failures_reported
from simulator.cli.options import Quiet, ScenarioArgument, results_option

if TYPE_CHECKING:
    from simulator.results.states import StateGraph

STATES_PICTURE = "states.png"

Along = Annotated[
    str | None,
    typer.Option(
        metavar="NAME=SHARE,…",
        help="Share of the voltage that each balloon gets.",
        show_default="as in the scenario",
    ),
]


def states(
    scenario: ScenarioArgument,
    out: Annotated[Path | None, results_option("results/<SCENARIO's stem>-states")] = None,
    low: Annotated[str, typer.Option(metavar="V", help="Lowest voltage.")] = "0",
    high: Annotated[
        str | None,
        typer.Option(metavar="V", help="Highest voltage.", show_default="the highest of the scenario"),
    ] = None,
    along: Along = None,
    every: Annotated[bool, typer.Option("--all", help="Also states that no such voltage leads to.")] = False,
    graphml: Annotated[
        bool, typer.Option("--graphml", help="Also write states.graphml (needs networkx).")
    ] = False,
    plot: Annotated[bool, typer.Option("--plot", help=f"Also draw {STATES_PICTURE}.")] = False,
    quiet: Quiet = False,
) -> None:
    """Find the stable states that a voltage can write; write states.csv, transitions.csv, states.json."""
    from simulator.results.files import check_writable, write_files
    from simulator.results.state_tables import GRAPHML, STATE_FILES, write_states
    from simulator.scenario import load_scenario

    directory = Path("results") / f"{scenario.stem}-states" if out is None else out
    shares = _shares(along)
    with errors_reported():
        loaded = load_scenario(scenario)
        names = (*STATE_FILES, *((GRAPHML,) if graphml else ()), *((STATES_PICTURE,) if plot else ()))
        check_writable(directory, names)
        with solver_failures_reported():
            from simulator.hysteresis.states import states as found

            graph = found(loaded, low=low, high=high, along=shares, every=every)
        pictures = {}
        if plot:
            from simulator.results.plot import png

            pictures[STATES_PICTURE] = png(graph.plot())
        paths = write_states(graph, directory, graphml=graphml)
        paths += write_files(directory, pictures) if pictures else []
    if not quiet:
        from simulator.cli.summary_hysteresis import summarise_states

        summarise_states(graph, _remembers(graph), paths)


def _remembers(graph: StateGraph) -> str:
    """Whether the graph has return-point memory, in words."""
    from simulator.cli.summary_hysteresis import volts
    from simulator.hysteresis.memory import return_point_memory

    lost = return_point_memory(graph)
    if lost is None:
        return "a turning point that the voltage comes back to finds the state that it left"
    turns = ", ".join(volts(graph.scales, turn) for turn in lost.turns)
    found = "the device's end" if lost.found is None else f"state {lost.found}"
    return f"lost: turned at {turns}, it leaves state {lost.left} and finds {found}"


def _shares(along: str | None) -> dict[str, float] | None:
    """The option --along as a mapping; leaves with exit code 2 where it is none."""
    if along is None:
        return None
    shares = {}
    for part in along.split(","):
        name, equals, text = part.partition("=")
        try:
            shares[name.strip()] = float(text)
        except ValueError:
            equals = ""
        if not equals:
            fail(f"--along {along}: must be balloons with their shares, such as left=1,right=-0.5", BAD_INPUT)
    return shares
