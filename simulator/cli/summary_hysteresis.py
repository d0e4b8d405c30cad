"""What a reader sees in the terminal of states, and of unloading."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from simulator import units
from simulator.cli.summary import print_files, printable

if TYPE_CHECKING:
    from simulator.results.states import StateGraph, Transition
    from simulator.units import Scales

SHOWN = 24


def volts(scales: Scales | None, drive: float) -> str:
    """A voltage for people."""
    return f"{drive:.6g}" if scales is None else units.with_prefix(units.VOLTAGE, drive * scales.voltage)


def summarise_states(graph: StateGraph, memory: str, paths: Sequence[Path]) -> None:
    """Say which states there are and what leads from one to another.

    Parameters
    ----------
    graph : StateGraph
    memory : str
        Whether it has return-point memory.
    paths : sequence of Path
        Files written.
    """
    print(printable(graph.title))
    print(f"\ndrive    {drive_words(graph.electroded, graph.share.tolist())}")
    reached = sum(state.reachable for state in graph.states)
    others = f", and {len(graph) - reached} that no way leads to" if graph.complete else ""
    low, high = volts(graph.scales, graph.low), volts(graph.scales, graph.high)
    print(f"states   {reached} between {low} and {high}{others}")
    for state in graph.states[:SHOWN]:
        up, down = graph.leaving(state.number, "up"), graph.leaving(state.number, "down")
        print(f"  {state.number:>4}   {_end(graph, down, state.low)} … {_end(graph, up, state.high)}")
    if len(graph) > SHOWN:
        print(f"         … and {len(graph) - SHOWN} more, in states.csv")
    print(f"memory   {memory}")
    print_files(paths)


def drive_words(electroded: Sequence[str], share: Sequence[float]) -> str:
    """Along which line the voltages move, in words."""
    if set(share) == {1.0}:
        return f"one voltage on {', '.join(electroded)}"
    parts = (f"{name} {part:g}" for name, part in zip(electroded, share, strict=True))
    return f"one voltage, of which the balloons get: {', '.join(parts)}"


def _end(graph: StateGraph, one: Transition | None, at: float) -> str:
    """One end of a state's range, and where it leads."""
    where = volts(graph.scales, at)
    if one is None:
        return where
    who = f" ({', '.join(one.balloons)})" if one.balloons else ""
    if one.target is None:
        assert one.ending is not None
        return f"{where} to {one.ending.value.replace('_', ' ')}"
    return f"{where} to {one.target}{who}"
