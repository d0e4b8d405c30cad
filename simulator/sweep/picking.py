"""Which rows of a sweep a map shows, and which curves go on top of it."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator.scenario.mapping import near
from simulator.sweep.loading import load_columns
from simulator.sweep.measures import quantity
from simulator.sweep.storage import read_record
from simulator.units import DIMENSIONS, prefixed, read_si

_PROBABILITY = re.compile(r"P\((\w+)=(\w+)\)")
_IN_A_CELL, _MOST_CELLS = 40, 40  # samples in a cell on the average, and cells along an axis at most


class PickError(ValueError):
    """A map that the sweep cannot give; the message names the option, its value and what is allowed."""


@dataclass(frozen=True)
class Picked:
    """The rows of a map.

    Attributes
    ----------
    title : str
    columns : mapping of str to (n,) array
        In their units, results with a prefix where that reads better.
    log : set of str
        Which of its axes are logarithmic.
    units : mapping of str to str
        Of the columns that have one.
    unfinished : str
        How much of the sweep is there, in words; "" for all of it.
    """

    title: str
    columns: Mapping[str, NDArray[Any]]
    log: frozenset[str]
    units: Mapping[str, str]
    unfinished: str


@dataclass(frozen=True)
class FoldLine:
    """A curve of `fold.csv` in the coordinates of a map; `panel` is the value of the third key, if given."""

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    label: str
    panel: float | None


def pick(
    directory: Path,
    x: str,
    y: str | None,
    color: str,
    panels: str | None = None,
    at: Sequence[tuple[str, str]] = (),
) -> Picked:
    """The rows of a sweep for a map of `color` over `x` and `y`, or without `y` for lines over `x`.

    Parameters
    ----------
    directory : Path
    x, y, color, panels : str
        Columns; on a grid all but `color` are keys that are varied. `y` and `panels` may be None. A `color`
        such as "P(behaviour=snap_stays)" is the share of runs in which a column of words holds that word:
        on a grid over all keys that are not shown, of samples in cells of x and y.
    at : sequence of (key, value)
        Keys of a grid that are held at one of their values.

    Raises
    ------
    PickError
        If there is no such column or value, or a key of a grid is neither shown nor held.
    OutputError
        If there is no sweep in the directory.
    """
    record = read_record(directory)
    kinds: dict[str, str] = record["columns"]
    asked = _PROBABILITY.fullmatch(color)
    options = {"--x": x, "--y": y, "--color": asked[1] if asked else color, "--panels": panels}
    wanted = {option: name for option, name in options.items() if name is not None}
    for option, name in wanted.items():
        if name not in kinds:
            raise PickError(
                f"{option} {name}: no such column in {directory}; {near(name, dict.fromkeys(kinds, 0))}"
            )
        if option in ("--x", "--y") and kinds[name] not in ("number", "whole"):
            raise PickError(f"{option} {name}: must be a column of numbers, holds {kinds[name]}")
    table = load_columns(directory)
    grid: dict[str, list[Any]] | None = record["grid"]
    if grid is not None:
        for option, name in wanted.items():
            if option != "--color" and name not in grid:
                raise PickError(f"{option} {name}: must be varied on the grid, which has {', '.join(grid)}")
        for key, text in at:
            held = _value_of(key, text, grid)
            table = table[table[key] == held]
        left = [k for k, v in grid.items() if len(v) > 1 and k not in wanted.values() and k not in dict(at)]
        if left and not asked:
            raise PickError(
                f"--at: {left[0]} has {len(grid[left[0]])} values; choose one with --at {left[0]}=VALUE, "
                f"or show all with --panels {left[0]}"
            )
    elif at:
        raise PickError(f"--at {at[0][0]}: goes with a grid, {directory} holds samples")
    vary = record["definition"]["vary"]
    columns = {name: table[name].to_numpy() for name in dict.fromkeys(wanted.values())}
    if asked:
        if kinds[asked[1]] != "text":
            raise PickError(
                f"--color {color}: must be of a column of words, {asked[1]} holds {kinds[asked[1]]}"
            )
        by = [name for name in (x, y, panels) if name is not None]
        logs = [_is_log(vary.get(name)) for name in by]
        binned = [grid is None and name != panels for name in by]
        columns = _shares(columns, by, binned, logs, columns[asked[1]] == asked[2], color)
    units = {name: unit for name, unit in record["units"].items() if name in columns}
    for name in columns:
        dimension = quantity(name)
        if dimension is not None and name in units:
            sizes = np.abs(columns[name][np.isfinite(columns[name])])
            size, units[name] = prefixed(dimension, float(np.median(sizes)) if sizes.size else 0.0)
            columns[name] = columns[name] / size
    there = len(load_columns(directory))
    unfinished = f"{there:,} of {record['runs']:,} runs" if there < record["runs"] else ""
    log = frozenset(name for name in (x, y) if name is not None and _is_log(vary.get(name)))
    return Picked(record["title"], columns, log, units, unfinished)


def _shares(
    columns: Mapping[str, NDArray[Any]],
    by: Sequence[str],
    binned: Sequence[bool],
    logs: Sequence[bool],
    true: NDArray[np.bool_],
    name: str,
) -> dict[str, NDArray[Any]]:
    """The share of rows in which something is true, by some columns or their cells; NaN without rows."""
    count = int(np.clip(np.sqrt(true.size / _IN_A_CELL), 2, _MOST_CELLS))
    kinds, codes = [], []
    for column, cells, log in zip(by, binned, logs, strict=True):
        values = _middles(columns[column], count, log) if cells else columns[column]
        kind, code = np.unique(values, return_inverse=True)
        kinds.append(kind)
        codes.append(code.ravel())
    shape = tuple(kind.size for kind in kinds)
    which = np.ravel_multi_index(codes, shape)
    runs = np.bincount(which, minlength=int(np.prod(shape)))
    with np.errstate(invalid="ignore"):
        share = np.bincount(which, weights=true, minlength=runs.size) / runs
    places = np.unravel_index(np.arange(runs.size), shape)
    return {**{n: k[place] for n, k, place in zip(by, kinds, places, strict=True)}, name: share}


def _middles(values: NDArray[Any], count: int, log: bool) -> NDArray[np.float64]:
    """Numbers as the middles of the equally wide cells that they lie in."""
    place = np.log(values) if log else np.asarray(values, dtype=np.float64)
    low, high = float(place.min()), float(place.max())
    width = (high - low) / count or 1.0
    middle = low + width * (np.clip(np.floor((place - low) / width), 0, count - 1) + 0.5)
    return np.asarray(np.exp(middle) if log else middle)


def _value_of(key: str, text: str, grid: Mapping[str, list[Any]]) -> Any:
    if key not in grid:
        raise PickError(f"--at {key}: must be varied on the grid, which has {', '.join(grid)}")
    for value in grid[key]:
        try:
            if value == text or (isinstance(value, float) and np.isclose(float(text), value, rtol=1e-9)):
                return value
        except ValueError:
            break
    some = ", ".join(f"{value}" for value in grid[key][:8])
    raise PickError(f"--at {key}={text}: must be one of {some}{', …' if len(grid[key]) > 8 else ''}")


def _is_log(axis: Any) -> bool:
    """Whether a key's values are spaced in the logarithm."""
    if isinstance(axis, dict):
        return bool(axis.get("spacing") == "log")  # a distribution has none
    values = [v for v in axis or [] if isinstance(v, float)]
    if len(values) < 3 or min(values) <= 0.0:
        return False
    return bool(np.ptp(np.diff(np.log(values))) < 1e-6)


def fold_line(text: str, x: str, y: str, units: Mapping[str, str] | None = None) -> FoldLine:
    """A curve of `balloons fold` over a map.

    Parameters
    ----------
    text : str
        Path of a `fold.csv`, with `VALUE=` in front where it belongs to one panel only.
    x, y : str
        The map's keys: one is the key that was varied, the other what drives: a voltage or the inflation.
    units : mapping of str to str
        Of the map's keys that have one.

    Raises
    ------
    PickError
        If the file is no such table, or of other keys.
    """
    found = re.fullmatch(r"([-+.\deE]+)=(.+)", text)
    panel, path = (float(found[1]), Path(found[2])) if found else (None, Path(text))
    try:
        with open(path, newline="", encoding="utf-8") as stream:
            header, *rows = csv.reader(stream)
        columns = dict(zip(header, np.array(rows, dtype=np.float64).T, strict=True))
        voltage, pressure = columns["voltage"], columns["pressure"]
    except OSError as error:
        raise PickError(f"--fold {path}: cannot be read, {(error.strerror or str(error)).lower()}") from None
    except (ValueError, KeyError, csv.Error):
        raise PickError(f"--fold {path}: must be a fold.csv as `balloons fold` writes it") from None
    varied = header[0]
    drive = pressure if not voltage.any() else voltage
    kind = "inflate" if not voltage.any() else "ramp|jump"
    other = {x: y, y: x}.get(varied)
    if other is None or not re.fullmatch(rf"step\.\d+\.({kind})", other):
        has = f"{varied} and step.N.{kind.replace('|', ' or step.N.')}"
        raise PickError(f"--fold {path}: is a curve over {has}, the map is over {x} and {y}")
    inflated = not voltage.any()
    value = _in_unit(path, columns, varied, (units or {}).get(varied, ""))
    drive = _in_unit(path, columns, "pressure" if inflated else "voltage", (units or {}).get(other, ""))
    at_x, at_y = (value, drive) if varied == x else (drive, value)
    lost = next((word for word in ("loss_of_sphericity", "sphericity_regained") if word in columns), None)
    label = lost.replace("_", " ") if lost else "limit point"
    label += " of the inflation" if not voltage.any() else ""
    return FoldLine(at_x, at_y, label, panel)


def _in_unit(path: Path, columns: Mapping[str, NDArray[Any]], name: str, unit: str) -> NDArray[np.float64]:
    """A column of a fold.csv in the unit of a map's axis. Raises PickError."""
    symbols = {dimension.symbol for dimension in DIMENSIONS}
    if not unit or unit in symbols - {"s"}:
        return np.asarray(columns[name])
    for title, values in columns.items():
        for dimension in DIMENSIONS:
            if title == f"{name} [{dimension.unit}]":
                with suppress(ValueError):
                    return np.asarray(values / read_si(f"1 {unit}", dimension))
    raise PickError(f"--fold {path}: has {name} without a unit, the map has it in {unit}")


def mark(text: str) -> tuple[float, float, str, float | None]:
    """A point to mark on a map: `X,Y,TEXT`, with `VALUE=` in front where it belongs to one panel only.

    Raises
    ------
    PickError
        If it is no such text.
    """
    found = re.fullmatch(r"(?:([^,=]+)=)?([^,]+),([^,]+),(.*)", text)
    try:
        if found is None:
            raise ValueError
        return float(found[2]), float(found[3]), found[4], float(found[1]) if found[1] else None
    except ValueError:
        raise PickError(f"--mark {text}: must be X,Y,TEXT or VALUE=X,Y,TEXT, such as 0.015,1.2,B") from None
