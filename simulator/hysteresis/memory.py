"""Return-point memory: whether a drive that comes back to where it turned finds the state that it left there.

Independent bistable parts remember so (Preisach's model), and parts that pull each other along, as the spins
of a ferromagnet do. Balloons on one gas take it from each other, and may forget.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulator.results.states import Direction, StateGraph

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class MemoryLost:
    """The shortest history in which the memory of a turning point is lost.

    Attributes
    ----------
    turns : tuple of float
        Where the drive turns on its way from the start: the last three are a turning point, the end of an
        excursion from it that passes no earlier turning point, and the first one again.
    left : int
        The state that was left there.
    found : int or None
        The state that was found there again; None where the device ended on the way.
    """

    turns: tuple[float, ...]
    left: int
    found: int | None


def return_point_memory(graph: StateGraph) -> MemoryLost | None:
    """Whether a graph has return-point memory: None if it has, else the history that shows that it has not.

    A drive comes from one turning point to another one, makes an excursion back that does not pass the
    former, and returns. With return-point memory it finds the state that it left. That is tried from each
    state that the drive can reach, with turning points between each two neighbouring thresholds. Longer
    excursions are made of such ones.

    Parameters
    ----------
    graph : StateGraph

    Returns
    -------
    MemoryLost or None
        Of all that lose it, one with the fewest turns.

    Examples
    --------
    >>> from simulator import states
    >>> return_point_memory(states("scenarios/fig5c_state_a.toml")) is None
    True
    """
    levels = _levels(graph)
    seen: set[tuple[int, int, Direction]] = set()
    # States at turning points, with the turns that lead to them; a drive turns to go on in a direction.
    front: list[tuple[int, int, Direction, tuple[float, ...]]] = [(graph.start, 0, "up", ())]
    while front:
        following: list[tuple[int, int, Direction, tuple[float, ...]]] = []
        for state, place, direction, turns in front:
            if (state, place, direction) in seen:
                continue
            seen.add((state, place, direction))
            back: Direction = "down" if direction == "up" else "up"
            for there in _ahead(place, direction, levels.size):
                left = _after(graph, state, float(levels[there]), direction)
                if left is None:
                    break
                for end in _ahead(there, back, levels.size):
                    if _ahead_of(end, place, direction):
                        break
                    found = _after(graph, left, float(levels[end]), back)
                    if found is not None:
                        found = _after(graph, found, float(levels[there]), direction)
                    if found != left:
                        way = (*turns, float(levels[there]), float(levels[end]), float(levels[there]))
                        return MemoryLost(way, left, found)
                following.append((left, there, back, (*turns, float(levels[there]))))
        front = following
    return None


def _levels(graph: StateGraph) -> FloatArray:
    """One voltage between each two neighbouring thresholds, and the ends of the range."""
    edges = np.unique([graph.low, *(one.drive for one in graph.transitions), graph.high])
    return np.array([graph.low, *(0.5 * (edges[1:] + edges[:-1])).tolist(), graph.high])


def _ahead(place: int, direction: Direction, count: int) -> Iterator[int]:
    yield from range(place + 1, count) if direction == "up" else range(place - 1, -1, -1)


def _ahead_of(end: int, place: int, direction: Direction) -> bool:
    """Whether an excursion back passes the former turning point."""
    return end < place if direction == "up" else end > place


def _after(graph: StateGraph, state: int, end: float, direction: Direction) -> int | None:
    """The state after a way of the drive; None where the device ends."""
    passed = graph.way(state, end, direction)
    return passed[-1].target if passed else state
