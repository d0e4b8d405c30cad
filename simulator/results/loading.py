"""Results read back from the files that were written of them: exactly what they were."""

from __future__ import annotations

import dataclasses
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator.events import EventKind
from simulator.results.curve import Curve
from simulator.results.files import OutputError
from simulator.results.history import Event, History
from simulator.results.plain_data import decoded, hints_of
from simulator.results.tables import TRACE_RECORD
from simulator.results.unloading import Unloading, UnloadingMap
from simulator.results.unloading_tables import MAP_RECORD, UNLOADING_RECORD
from simulator.scenario import load_scenario

# The arrays of a history that have a column for each of some balloons.
_BY_NAME = {
    "voltage": "electroded",
    "stretch": "balloons",
    "field": "electroded",
    "charge": "electroded",
    "strength": "rated",
    "margin": "rated",
    "sphericity": "balloons",
    "supply": "electroded",
    "inner": "inner_of",
}


def load_history(directory: str | os.PathLike[str]) -> History:
    """Read a history back from the folder that `balloons run` or `History.to_csv` wrote.

    Parameters
    ----------
    directory : path
        With `history.csv`, `events.csv` and `run.json`.

    Returns
    -------
    History
        Equal to the one that was written.

    Raises
    ------
    OutputError
        If the files are not there, or are no such files.
    ScenarioError
        If the scenario in `run.json` cannot be read, as one with an elastomer made in Python, or whose
        recordings are gone.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> folder, history = TemporaryDirectory(), simulate(scenario)
    >>> files = history.to_csv(folder.name)
    >>> load_history(folder.name) == history
    True
    """
    folder = Path(directory)
    record = _record(folder / "run.json")
    try:
        kept, written = record["result"], record["scenario"]
    except (KeyError, TypeError):
        raise OutputError(f"no history in {str(folder)!r}: run.json has no result") from None
    scenario = load_scenario(written)
    names = {"balloons": tuple(b.name for b in scenario.balloons), "electroded": scenario.electroded}
    try:
        hints = hints_of(History)
        rest = {name: decoded(hints[name], value) for name, value in kept.items()}
        columns = _columns(folder / "history.csv")
        names["rated"], names["inner_of"] = rest["rated"], rest.get("inner_of", ())
        arrays = {
            field.name: _array(field.name, names, columns)
            for field in dataclasses.fields(History)
            if field.name in columns or field.name in _BY_NAME
        }
        events = _events(_columns(folder / "events.csv"), names)
        return History(scenario=scenario, events=events, **{**names, **arrays, **rest})
    except (KeyError, TypeError, ValueError) as error:
        raise OutputError(f"no history in {str(folder)!r}: {error!r}") from error


def load_curve(directory: str | os.PathLike[str]) -> Curve:
    """Read an equilibrium path back from the folder that `balloons trace` or `Curve.to_csv` wrote.

    Raises
    ------
    OutputError
        If there is none, or several (`balloons trace --all`): see `load_curves`.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> folder, curve = TemporaryDirectory(), trace(scenario)
    >>> files = curve.to_csv(folder.name)
    >>> load_curve(folder.name) == curve
    True
    """
    curves = load_curves(directory)
    if len(curves) != 1:
        raise OutputError(f"{str(directory)!r} holds {len(curves)} paths, load_curves reads them")
    return curves[0]


def load_curves(directory: str | os.PathLike[str]) -> tuple[Curve, ...]:
    """Read all equilibrium paths of a folder. Raises OutputError if there are none."""
    record = _record(Path(directory) / TRACE_RECORD)
    try:
        return tuple(decoded(Curve, curve) for curve in record["curves"])
    except (KeyError, TypeError, ValueError) as error:
        raise OutputError(f"no path in {str(directory)!r}: {error!r}") from error


def load_unloading(directory: str | os.PathLike[str]) -> Unloading | UnloadingMap:
    """Read back what `balloons unload` or `Unloading.to_csv` wrote, a map or not.

    Raises
    ------
    OutputError
        If there is none.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> folder, found = TemporaryDirectory(), unload("scenarios/fig5b_state_b.toml", "0.13:0.15:3")
    >>> files = found.to_csv(folder.name)
    >>> load_unloading(folder.name) == found
    True
    """
    folder = Path(directory)
    kind, name = (
        (UnloadingMap, MAP_RECORD) if (folder / MAP_RECORD).exists() else (Unloading, UNLOADING_RECORD)
    )
    record = _record(folder / name)
    try:
        found: Unloading | UnloadingMap = decoded(kind, record)
    except (KeyError, TypeError, ValueError) as error:
        raise OutputError(f"no unloading in {str(folder)!r}: {error!r}") from error
    return found


def _record(path: Path) -> dict[str, Any]:
    try:
        found: dict[str, Any] = json.loads(path.read_bytes())
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise OutputError(f"cannot read {str(path)!r}: {reason}") from None
    except ValueError as error:
        raise OutputError(f"cannot read {str(path)!r}: {error}") from None
    return found


def _columns(path: Path) -> dict[str, NDArray[Any]]:
    """The columns of a table by their titles. Raises OutputError."""
    import pandas as pd

    # From 3.1 on pandas reads every number exactly, and warns of the word that older ones need for it.
    old = tuple(int(part) for part in pd.__version__.split(".")[:2]) < (3, 1)
    exactly: dict[str, Any] = {"float_precision": "round_trip"} if old else {}
    try:
        table = pd.read_csv(path, na_values=[""], keep_default_na=False, **exactly)
    except OSError as error:
        raise OutputError(f"cannot read {str(path)!r}: {(error.strerror or str(error)).lower()}") from None
    return {str(name): table[name].to_numpy() for name in table.columns}


def _events(columns: dict[str, NDArray[Any]], names: dict[str, tuple[str, ...]]) -> tuple[Event, ...]:
    """Events, from their table."""

    def stacked(titles: list[str]) -> NDArray[np.float64]:
        found = [columns[title] for title in titles]
        return np.column_stack(found) if found else np.empty((columns["time"].size, 0))

    arrays = {"voltage": stacked([f"voltage_{name}" for name in names["electroded"]])}
    for quantity, whose in (("stretch", "balloons"), ("field", "electroded")):
        for side in ("before", "after"):
            titles = [f"{quantity}_{name}_{side}" for name in names[whose]]
            arrays[f"{quantity}_{side}"] = stacked(titles)
    fields = [field.name for field in dataclasses.fields(Event) if field.name in columns]
    return tuple(_event(row, fields, columns, arrays) for row in range(columns["time"].size))


def _event(
    row: int, fields: list[str], columns: dict[str, NDArray[Any]], arrays: dict[str, NDArray[np.float64]]
) -> Event:
    hints = {"time": float, "step": int, "cycle": int, "kind": EventKind, "pressure_before": float}
    cells: dict[str, Any] = {}
    for name in fields:
        value = columns[name][row]
        cells[name] = hints[name](value) if name in hints else None if value != value else value
        if isinstance(cells[name], np.floating):
            cells[name] = float(cells[name])
    ended = bool(np.isnan(arrays["stretch_after"][row]).any())
    for name, values in arrays.items():
        cells[name] = None if ended and name.endswith("_after") else np.array(values[row], dtype=np.float64)
    return Event(**cells)


def _array(name: str, names: dict[str, tuple[str, ...]], columns: dict[str, NDArray[Any]]) -> NDArray[Any]:
    if name not in _BY_NAME:
        return columns[name]
    balloons = names[_BY_NAME[name]]
    optional = name in ("sphericity", "supply", "inner")
    if optional and not (balloons and all(f"{name}_{balloon}" in columns for balloon in balloons)):
        return np.empty((0, 0))
    size = columns["time"].size
    found = [np.asarray(columns[f"{name}_{balloon}"], dtype=np.float64) for balloon in balloons]
    return np.column_stack(found) if found else np.empty((size, 0))
