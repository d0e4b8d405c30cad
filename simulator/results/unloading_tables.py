"""Unloading from many peaks as tables and files."""

from __future__ import annotations

import json
import os
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from simulator.results.csv_text import Columns, write_csv
from simulator.results.files import write_files
from simulator.results.plain_data import encoded
from simulator.units import ENERGY, VOLTAGE, in_si

if TYPE_CHECKING:
    from simulator.results.unloading import FloatArray, Unloading, UnloadingMap

UNLOADING_RECORD = "unload.json"
UNLOADING_FILES = ("unload.csv", "peaks.csv", UNLOADING_RECORD)
MAP_RECORD = "unload_map.json"
MAP_FILES = ("unload_map.csv", MAP_RECORD)


def row_columns(found: Unloading) -> Columns:
    """All that the drive passed by column, in the order of `unload.csv`, each (n_rows,)."""
    columns: Columns = {
        "peak": found.peak,
        "leg": found.leg,
        **_voltages(found.electroded, found.share, found.drive),
        **{f"stretch_{name}": found.stretch[:, i] for i, name in enumerate(found.balloons)},
        "pressure": found.pressure,
        "event": found.event,
    }
    return _with_si(columns, found)


def peak_columns(found: Unloading) -> Columns:
    """What became of each peak by column, in the order of `peaks.csv`, each (n_peaks,).

    Stretches and pressure are those where the voltage is off again.
    """
    columns: Columns = {
        "peak": found.peaks,
        "outcome": np.array(found.outcome, dtype=object),
        "closed": found.closed,
        **({"reloaded": found.reloaded} if found.reloaded.size else {}),
        **{f"stretch_{name}": found.remanent_stretch[:, i] for i, name in enumerate(found.balloons)},
        "pressure": found.remanent_pressure,
        "area": found.area,
        "dissipated": found.dissipated,
    }
    return _with_si(columns, found)


def map_columns(found: UnloadingMap) -> Columns:
    """One row for each value and peak by column, in the order of `unload_map.csv`."""
    values, peaks = (part.ravel() for part in np.meshgrid(found.values, found.peaks, indexing="ij"))
    columns: Columns = {
        found.key: values,
        "peak": peaks,
        "outcome": np.array([word for row in found.outcome for word in row], dtype=object),
        "closed": found.closed.ravel(),
        **{f"stretch_{n}": found.remanent_stretch[:, :, i].ravel() for i, n in enumerate(found.balloons)},
        "area": found.area.ravel(),
        "dissipated": found.dissipated.ravel(),
    }
    if found.scales is None:
        return columns
    varied: Columns = {}
    if found.dimension is not None:
        varied[f"{found.key} [{found.dimension.unit}]"] = values * found.scales.of(found.dimension)
    return columns | varied | in_si(columns, found.scales, {}, {"peak": VOLTAGE, "area": ENERGY})


def write_unloading(found: Unloading, directory: str | os.PathLike[str]) -> list[Path]:
    """Write `unload.csv`, `peaks.csv` and `unload.json` into a directory, all or none. Raises OutputError."""
    rows, peaks, record = UNLOADING_FILES
    tables = {rows: partial(write_csv, row_columns(found)), peaks: partial(write_csv, peak_columns(found))}
    return write_files(directory, {**tables, record: _as_json(found)})


def write_map(found: UnloadingMap, directory: str | os.PathLike[str]) -> list[Path]:
    """Write `unload_map.csv` and `unload_map.json` into a directory. Raises OutputError."""
    table, record = MAP_FILES
    return write_files(directory, {table: partial(write_csv, map_columns(found)), record: _as_json(found)})


def _as_json(found: Unloading | UnloadingMap) -> bytes:
    return f"{json.dumps(encoded(found), ensure_ascii=False, allow_nan=False)}\n".encode()


def _voltages(names: tuple[str, ...], share: FloatArray, drive: FloatArray) -> Columns:
    return {f"voltage_{name}": part * drive for name, part in zip(names, share, strict=True)}


def _with_si(columns: Columns, found: Unloading) -> Columns:
    if found.scales is None:
        return columns
    radii = dict(zip(found.balloons, found.radius.tolist(), strict=True))
    return columns | in_si(columns, found.scales, radii, {"peak": VOLTAGE, "area": ENERGY})
