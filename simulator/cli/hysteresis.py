"""`balloons states`, `balloons unload`: what a voltage that comes and goes can write, and leaves behind."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from simulator.cli.endings import BAD_INPUT, errors_reported, fail, interrupted, solver_failures_reported
from simulator.cli.options import Quiet, ScenarioArgument, results_option
from simulator.cli.pictures import FormatOption, any_format, draw, remove_old, say_removed, wanted
from simulator.cli.summary_units import print_bare

if TYPE_CHECKING:
    from simulator.results.states import StateGraph
    from simulator.results.unloading import Unloading, UnloadingMap

STATES_PICTURE = "states"
UNLOADING_PICTURE = "unload"
MAP_PICTURE = "unload_map"

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
    plot: Annotated[bool, typer.Option("--plot", help=f"Also draw {STATES_PICTURE}.png.")] = False,
    form: FormatOption = None,
    quiet: Quiet = False,
) -> None:
    """Find the stable states that a voltage can write; write states.csv, transitions.csv, states.json."""
    from simulator.results.files import check_writable
    from simulator.results.state_tables import GRAPHML, STATE_FILES, write_states
    from simulator.scenario import load_scenario

    directory = Path("results") / f"{scenario.stem}-states" if out is None else out
    shares = _shares(along)
    picture = wanted(STATES_PICTURE, plot=plot, form=form)
    names = (*STATE_FILES, *((GRAPHML,) if graphml else ()), *((picture,) if picture else ()))
    paths: list[Path] = []
    with errors_reported(lambda: interrupted(paths)):
        loaded = load_scenario(scenario)
        check_writable(directory, names)
        with solver_failures_reported():
            from simulator.hysteresis.states import states as found

            graph = found(loaded, low=low, high=high, along=shares, every=every)
        paths += write_states(graph, directory, graphml=graphml)
        removed = remove_old(directory, [*any_format(STATES_PICTURE), *(() if graphml else (GRAPHML,))])
        paths += draw(directory, picture, graph.plot)
    if not quiet:
        from simulator.cli.summary_hysteresis import summarise_states

        summarise_states(graph, _remembers(graph), paths)
        print_bare(loaded)
        say_removed([name for name in removed if name != picture])


def unload(
    scenario: ScenarioArgument,
    peaks: Annotated[
        str, typer.Option(metavar="A:B:N", help="N peaks from A to B, such as 0.1:0.5:81 or 2kV:6kV:81.")
    ],
    out: Annotated[Path | None, results_option("results/<SCENARIO's stem>-unload")] = None,
    reload: Annotated[bool, typer.Option("--reload", help="Then up to the peak once more.")] = False,
    vary: Annotated[
        str | None,
        typer.Option(metavar="KEY=A:B:N", help="A map over another number too.", show_default=False),
    ] = None,
    along: Along = None,
    plot: Annotated[bool, typer.Option("--plot", help=f"Also draw {UNLOADING_PICTURE}.png.")] = False,
    form: FormatOption = None,
    quiet: Quiet = False,
) -> None:
    """Raise the voltage to each of many peaks and take it back; write unload.csv and peaks.csv."""
    from simulator.results.files import check_writable
    from simulator.results.unloading_tables import MAP_FILES, UNLOADING_FILES
    from simulator.scenario import load_scenario

    directory = Path("results") / f"{scenario.stem}-unload" if out is None else out
    shares = _shares(along)
    key, _, values = (vary or "").partition("=")
    if vary is not None and not (key and values):
        fail(f"--vary {vary}: must be a key with values, such as gas.ambient_pressure=0.05:1:20", BAD_INPUT)
    if vary is not None and reload:
        fail("--reload does not go with --vary", BAD_INPUT)
    kinds = [(UNLOADING_FILES, UNLOADING_PICTURE), (MAP_FILES, MAP_PICTURE)]
    (names, stem), (others, other_stem) = kinds if vary is None else kinds[::-1]
    picture = wanted(stem, plot=plot, form=form)
    paths: list[Path] = []
    with errors_reported(lambda: interrupted(paths)):
        loaded = load_scenario(scenario)
        check_writable(directory, (*names, picture) if picture else names)
        found: Unloading | UnloadingMap
        with solver_failures_reported():
            from simulator.hysteresis.unloading import unload, unload_map

            if vary is None:
                found = unload(loaded, peaks, reload=reload, along=shares)
            else:
                found = unload_map(loaded, peaks, key, values, along=shares)
        paths += found.to_csv(directory)
        removed = remove_old(directory, [*any_format(stem), *any_format(other_stem), *others])
        paths += draw(directory, picture, found.plot)
    if not quiet:
        from simulator.cli.summary_hysteresis import summarise_unloading

        summarise_unloading(found, paths)
        print_bare(loaded)
        say_removed([name for name in removed if name != picture])


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
