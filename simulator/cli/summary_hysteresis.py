"""What a reader sees in the terminal of states, and of unloading."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from simulator import units
from simulator.cli.summary import print_files, printable, say
from simulator.results.unloading import Unloading, UnloadingMap

if TYPE_CHECKING:
    from simulator.results.history import FloatArray
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


def summarise_unloading(found: Unloading | UnloadingMap, paths: Sequence[Path]) -> None:
    """Say what the voltage left behind.

    Parameters
    ----------
    found : Unloading or UnloadingMap
    paths : sequence of Path
        Files written.
    """
    print(printable(found.title))
    print(f"\ndrive    {drive_words(found.electroded, found.share.tolist())}")
    low, high = (volts(found.scales, float(v)) for v in (found.peaks.min(), found.peaks.max()))
    print(f"peaks    {found.peaks.size} from {low} to {high}")
    if isinstance(found, UnloadingMap):
        print(f"values   {found.values.size} of {found.key}")
        words = Counter(word for row in found.outcome for word in row)
    else:
        words = Counter(found.outcome)
        _print_thresholds(found)
    print(f"ended    {', '.join(f'{count} {word}' for word, count in words.items())}")
    stretches = found.remanent_stretch.reshape(-1, len(found.balloons))
    stretches = stretches[np.isfinite(stretches).all(axis=1)]
    if stretches.size:
        each = zip(found.balloons, stretches.T, strict=True)
        say("remains", "stretch of " + ", ".join(f"{name} {_range(values)}" for name, values in each))
    print(f"closed   {int(found.closed.sum())} of the loops")
    areas = found.area[found.closed & np.isfinite(found.area)]
    if areas.size:
        low_area, high_area = (_energy(found.scales, area) for area in (areas.min(), areas.max()))
        print(f"area     of those, {low_area if low_area == high_area else f'{low_area} to {high_area}'}")
    if isinstance(found, Unloading) and found.path.failure:
        print(f"path     could not be followed, the picture is without it: {found.path.failure}")
    print_files(paths)


def _print_thresholds(found: Unloading) -> None:
    """The voltages at which something happens on the way up and back."""
    words = {"load": "up", "unload": "back", "reload": "again"}
    for leg, word in words.items():
        at = [volts(found.scales, v) for v, on in found.thresholds if on == leg]
        if at:
            more = f" … and {len(at) - SHOWN} more, in unload.csv" if len(at) > SHOWN else ""
            print(f"{word:8} at {', '.join(at[:SHOWN])}{more}")


def _range(values: FloatArray) -> str:
    """The smallest and the largest of some stretches, one where they are the same."""
    low, high = f"{values.min():.6g}", f"{values.max():.6g}"
    return low if low == high else f"{low} to {high}"


def _energy(scales: Scales | None, value: float) -> str:
    shown = 0.0 if abs(value) < 1e-11 else float(value)
    return f"{shown:.6g}" if scales is None else units.with_prefix(units.ENERGY, shown * scales.energy)


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
