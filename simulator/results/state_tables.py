"""The graph of states as tables, as JSON, and for networkx."""

from __future__ import annotations

import json
import os
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from simulator.results.csv_text import Columns, write_csv
from simulator.results.extras import MissingExtra
from simulator.results.files import write_files
from simulator.units import in_si

if TYPE_CHECKING:
    import networkx

    from simulator.results.states import StateGraph

STATE_FILES = ("states.csv", "transitions.csv", "states.json")
GRAPHML = "states.graphml"


def state_columns(graph: StateGraph) -> Columns:
    """The states of a graph by column, in the order of `states.csv`.

    Parameters
    ----------
    graph : StateGraph

    Returns
    -------
    dict of str to (n_states,) array
        What differs at both ends of a state's range is `<quantity>_low` and `<quantity>_high`.
    """
    states = graph.states
    columns: Columns = {
        "state": np.array([state.number for state in states], dtype=np.int64),
        "reachable": np.array([state.reachable for state in states], dtype=bool),
        "spheres": np.array([not state.lost.any() for state in states], dtype=bool),
    }
    ends = (("low", 0), ("high", -1))
    for i, name in enumerate(graph.electroded):
        for side, at in ends:
            columns[f"voltage_{name}_{side}"] = graph.share[i] * np.array([s.drive[at] for s in states])
    for i, name in enumerate(graph.balloons):
        for side, at in ends:
            columns[f"stretch_{name}_{side}"] = np.array([s.stretch[at, i] for s in states])
    for side, at in ends:
        columns[f"pressure_{side}"] = np.array([s.pressure[at] for s in states])
    return _with_si(columns, graph)


def transition_columns(graph: StateGraph) -> Columns:
    """The transitions of a graph by column, in the order of `transitions.csv`.

    Parameters
    ----------
    graph : StateGraph

    Returns
    -------
    dict of str to (n_transitions,) array
        `target` is empty where the device ends, `ending` where it does not; several balloons are joined by +.
    """
    ways = graph.transitions
    columns: Columns = {
        "source": np.array([one.source for one in ways], dtype=np.int64),
        "target": np.array(["" if one.target is None else str(one.target) for one in ways], dtype=object),
        "direction": np.array([one.direction for one in ways], dtype=object),
        "kind": np.array([one.kind.value for one in ways], dtype=object),
        "ending": np.array(["" if one.ending is None else one.ending.value for one in ways], dtype=object),
        "balloon": np.array(["+".join(one.balloons) for one in ways], dtype=object),
    }
    for i, name in enumerate(graph.electroded):
        columns[f"voltage_{name}"] = np.array([one.voltage[i] for one in ways], dtype=float)
    for i, name in enumerate(graph.balloons):
        columns[f"stretch_{name}_before"] = np.array([one.stretch_before[i] for one in ways], dtype=float)
        columns[f"stretch_{name}_after"] = np.array(
            [np.nan if one.stretch_after is None else one.stretch_after[i] for one in ways], dtype=float
        )
    columns["pressure_before"] = np.array([one.pressure_before for one in ways], dtype=float)
    for name, values in (
        ("pressure_after", [one.pressure_after for one in ways]),
        ("dissipated", [one.dissipated for one in ways]),
    ):
        columns[name] = np.array([np.nan if value is None else value for value in values], dtype=float)
    return _with_si(columns, graph)


def write_states(
    graph: StateGraph, directory: str | os.PathLike[str], *, graphml: bool = False
) -> list[Path]:
    """Write `states.csv`, `transitions.csv` and `states.json` into a directory, all or none.

    Parameters
    ----------
    graph : StateGraph
    directory : path
        Created if need be.
    graphml : bool
        Also write `states.graphml`.

    Raises
    ------
    OutputError
        As `write_files`.
    MissingExtra
        For GraphML without networkx.
    """
    text = json.dumps(graph_record(graph), indent=2, ensure_ascii=False, allow_nan=False)
    files: dict[str, Any] = {
        "states.csv": partial(write_csv, state_columns(graph)),
        "transitions.csv": partial(write_csv, transition_columns(graph)),
    }
    if graphml:
        files[GRAPHML] = _graphml(graph)
    return write_files(directory, {**files, "states.json": f"{text}\n".encode()})


def graph_record(graph: StateGraph) -> dict[str, Any]:
    """A graph as plain lists and numbers, None for what is not there: the content of `states.json`."""
    return {
        "title": graph.title,
        "balloons": list(graph.balloons),
        "electroded": list(graph.electroded),
        "share": graph.share.tolist(),
        "low": graph.low,
        "high": graph.high,
        "start": graph.start,
        "complete": graph.complete,
        "scales": None if graph.scales is None else graph.scales.record(),
        "states": _rows(state_columns(graph)),
        "transitions": [
            {**row, "target": one.target}
            for row, one in zip(_rows(transition_columns(graph)), graph.transitions, strict=True)
        ],
    }


def as_networkx(graph: StateGraph) -> networkx.MultiDiGraph:
    """A graph for networkx, see `StateGraph.to_networkx`."""
    try:
        import networkx
    except ImportError as error:
        raise MissingExtra(
            "a graph for networkx, or as GraphML, needs networkx: pip install 'dielectric-balloons[states]'"
        ) from error
    found = networkx.MultiDiGraph(title=graph.title, low=graph.low, high=graph.high)
    for row in _rows(state_columns(graph)):
        found.add_node(row["state"], **{k: v for k, v in row.items() if k != "state"})
    for row, one in zip(_rows(transition_columns(graph)), graph.transitions, strict=True):
        target: int | str
        if one.target is not None:
            target = one.target
        else:
            assert one.ending is not None
            target = one.ending.value
            found.add_node(target)
        # GraphML knows no missing values.
        known = {key: value for key, value in row.items() if value not in (None, "")}
        found.add_edge(one.source, target, key=one.direction, **_without_ends(known))
    return found


def _without_ends(row: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in row.items() if key not in ("source", "target")}


def _graphml(graph: StateGraph) -> bytes:
    found = as_networkx(graph)
    import networkx

    return ("\n".join(networkx.generate_graphml(found)) + "\n").encode()


def _rows(columns: Columns) -> list[dict[str, Any]]:
    values = [column.tolist() for column in columns.values()]
    return [
        {name: None if value != value else value for name, value in zip(columns, row, strict=True)}
        for row in zip(*values, strict=True)
    ]


def _with_si(columns: Columns, graph: StateGraph) -> Columns:
    if graph.scales is None:
        return columns
    names = dict(zip(graph.balloons, graph.radius.tolist(), strict=True))
    sides = {f"{name}_{side}": radius for name, radius in names.items() for side in ("low", "high")}
    return columns | in_si(columns, graph.scales, names | sides)
