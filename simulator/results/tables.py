"""Histories and equilibrium paths on disk and as tables: CSV, `run.json`, pandas.

Columns are assembled once (`history_columns`, `event_columns`, `curve_columns`, `point_columns`) and go
two ways: into a pandas table, or as text into a file. The text does not pass through pandas: formatting
rows here takes less time than `DataFrame.to_csv` and spares a command-line run the import.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import numpy as np

from simulator.results.csv_text import Columns, write_csv
from simulator.results.files import write_files
from simulator.results.record import run_record
from simulator.units import VOLUME, in_si

if TYPE_CHECKING:
    import pandas as pd

    from simulator.results.curve import Curve, FoldCurve, SpecialPoint
    from simulator.results.history import Event, FloatArray, History
    from simulator.results.sensitivity import Sensitivity


RUN_FILES = ("history.csv", "events.csv", "run.json")
TRACE_FILES = ("curve.csv", "points.csv")
FOLD_FILE = "fold.csv"
SENSITIVITIES_FILE = "sensitivities.csv"


def history_columns(history: History) -> Columns:
    """The samples by column, in the order of `history.csv`.

    Parameters
    ----------
    history : History

    Returns
    -------
    dict of str to (n_samples,) array
        `time`, `step`, `branch`, `voltage_<name>` of each electroded balloon, `stretch_<name>` of
        each balloon, `pressure`, `volume`, `gas`, `field_<name>`, `charge_<name>`, `energy`,
        `stability`, `margin_<name>` of each film with a strength, `sphericity_<name>` of each balloon unless
        it is ignored. Dimensionless, see `History`; with
        [scales] the same in SI units after them.
    """
    columns = {
        "time": history.time,
        "step": history.step,
        "branch": history.branch,
        **_by_name("voltage", history.electroded, history.voltage),
        **_by_name("stretch", history.balloons, history.stretch),
        "pressure": history.pressure,
        "volume": history.volume,
        "gas": history.gas,
        **_by_name("field", history.electroded, history.field),
        **_by_name("charge", history.electroded, history.charge),
        "energy": history.energy,
        "stability": history.stability,
        **_by_name("margin", history.rated, history.margin),
        **(_by_name("sphericity", history.balloons, history.sphericity) if history.sphericity.size else {}),
    }
    return _with_si(columns, history)


def event_columns(history: History) -> Columns:
    """The events by column, in the order of `events.csv`; NaN on the after side where a history ends.

    Parameters
    ----------
    history : History

    Returns
    -------
    dict of str to (n_events,) array
        `time`, `step`, `kind`, `balloon` and `mode` of an event of shape, `voltage_<name>`,
        `stretch_<name>_before`, `stretch_<name>_after`,
        `pressure_before`, `pressure_after`, `field_<name>_before`, `field_<name>_after`,
        `dissipated`. The two sides of one balloon stand next to each other. With [scales] the same in
        SI units after them.
    """
    events = history.events
    balloons, electroded = history.balloons, history.electroded

    def sides(quantity: str, names: tuple[str, ...]) -> Columns:
        before = _stacked(events, f"{quantity}_before", len(names))
        after = _stacked(events, f"{quantity}_after", len(names))
        return {
            f"{quantity}_{name}_{side}": values[:, i]
            for i, name in enumerate(names)
            for side, values in (("before", before), ("after", after))
        }

    columns = {
        "time": np.array([event.time for event in events], dtype=float),
        "step": np.array([event.step for event in events], dtype=np.int64),
        "kind": np.array([event.kind.value for event in events], dtype=object),
        **(_shapes(events) if history.sphericity.size else {}),
        **_by_name("voltage", electroded, _stacked(events, "voltage", len(electroded))),
        **sides("stretch", balloons),
        "pressure_before": _stacked(events, "pressure_before", 1)[:, 0],
        "pressure_after": _stacked(events, "pressure_after", 1)[:, 0],
        **sides("field", electroded),
        "dissipated": _stacked(events, "dissipated", 1)[:, 0],
    }
    return _with_si(columns, history)


def _shapes(events: Sequence[Event] | Sequence[SpecialPoint]) -> Columns:
    """Which balloon a change of shape concerns, and what it would turn into; empty for others."""
    return {
        "balloon": np.array([event.balloon or "" for event in events], dtype=object),
        "mode": np.array([event.mode or "" for event in events], dtype=object),
    }


def _with_si(columns: Columns, history: History) -> Columns:
    scales = history.scenario.scales
    if scales is None:
        return columns
    radii = {b.name: b.radius for b in history.scenario.balloons}
    # The amount of a liquid is a volume.
    others = {"gas": VOLUME} if history.scenario.gas.law == "liquid" else {}
    return columns | in_si(columns, scales, radii, others)


def curve_columns(curves: Sequence[Curve]) -> Columns:
    """The points of equilibrium paths by column, in the order of `curve.csv`.

    Parameters
    ----------
    curves : sequence of Curve
        Of the same balloons.

    Returns
    -------
    dict of str to (n_points,) array
        `arclength`, `voltage_<name>` of each electroded balloon, `stretch_<name>` of each balloon,
        `pressure`, `field_<name>`, `charge_<name>`, `energy`, `stability`, `stable`, `sphericity_<name>` of
        each balloon and `spheres`, whether all are, unless that is ignored; before them, where there are
        several curves, the number of the `curve`, from 1. Dimensionless, see `Curve`.
    """
    return _joined(
        curves,
        [
            {
                "arclength": curve.arclength,
                **_by_name("voltage", curve.electroded, curve.voltage),
                **_by_name("stretch", curve.balloons, curve.stretch),
                "pressure": curve.pressure,
                **_by_name("field", curve.electroded, curve.field),
                **_by_name("charge", curve.electroded, curve.charge),
                "energy": curve.energy,
                "stability": curve.stability,
                "stable": curve.unstable == 0,
                **_shapes_of(curve),
            }
            for curve in curves
        ],
    )


def _shapes_of(curve: Curve) -> Columns:
    """Margins of sphericity, and whether all balloons are spheres; nothing where that is ignored."""
    if not curve.sphericity.size:
        return {}
    return {**_by_name("sphericity", curve.balloons, curve.sphericity), "spheres": ~curve.lost}


def point_columns(curves: Sequence[Curve]) -> Columns:
    """The special points of equilibrium paths by column, in the order of `points.csv`.

    Parameters
    ----------
    curves : sequence of Curve
        Of the same balloons.

    Returns
    -------
    dict of str to (n_points,) array
        `kind`, `balloon` and `mode` of a change of shape unless that is ignored, `arclength`,
        `voltage_<name>`, `stretch_<name>`, `pressure`; before them, where there are several curves, the
        number of the `curve`, from 1.
    """
    return _joined(
        curves,
        [
            {
                "kind": np.array([point.kind for point in curve.points], dtype=object),
                **(_shapes(curve.points) if curve.sphericity.size else {}),
                "arclength": _stacked(curve.points, "arclength", 1)[:, 0],
                **_by_name(
                    "voltage", curve.electroded, _stacked(curve.points, "voltage", len(curve.electroded))
                ),
                **_by_name("stretch", curve.balloons, _stacked(curve.points, "stretch", len(curve.balloons))),
                "pressure": _stacked(curve.points, "pressure", 1)[:, 0],
            }
            for curve in curves
        ],
    )


def history_table(history: History) -> pd.DataFrame:
    """The samples of a history as a pandas table, one row each; columns as in `history_columns`."""
    import pandas as pd

    return pd.DataFrame(history_columns(history))


def events_table(history: History) -> pd.DataFrame:
    """The events of a history as a pandas table, one row each; columns as in `event_columns`."""
    import pandas as pd

    return pd.DataFrame(event_columns(history))


def curve_table(curve: Curve) -> pd.DataFrame:
    """The points of an equilibrium path as a pandas table, one row each; columns as in `curve_columns`."""
    import pandas as pd

    return pd.DataFrame(curve_columns([curve]))


def points_table(curve: Curve) -> pd.DataFrame:
    """The special points of an equilibrium path as a pandas table; columns as in `point_columns`."""
    import pandas as pd

    return pd.DataFrame(point_columns([curve]))


def write_run(
    history: History, directory: str | os.PathLike[str], *, failure: str | None = None
) -> list[Path]:
    """Write `history.csv`, `events.csv` and `run.json` of a history into a directory, all or none.

    Numbers are written with as many digits as it takes to read the same double back, and NaN as an
    empty cell. (Before 3.1, pandas reads them back exactly only with ``float_precision="round_trip"``.)

    Parameters
    ----------
    history : History
    directory : path
        Created if need be. Files of the same names are replaced.
    failure : str, optional
        Message of the solver failure that ended the run early, for `run.json`.

    Returns
    -------
    list of Path
        The files written, `run.json` last.

    Raises
    ------
    OutputError
        If the directory cannot be made or written to. What was there before is then still there.
    """
    tables = {"history.csv": history_columns(history), "events.csv": event_columns(history)}
    text = json.dumps(run_record(history, failure), indent=2, ensure_ascii=False, allow_nan=False)
    writers: dict[str, Callable[[BinaryIO], object]] = {
        name: partial(write_csv, columns) for name, columns in tables.items()
    }
    # run.json goes last: a reader who sees it sees the tables it belongs to.
    writers["run.json"] = lambda stream: stream.write(f"{text}\n".encode())
    return write_files(directory, writers)


def write_curves(curves: Sequence[Curve], directory: str | os.PathLike[str]) -> list[Path]:
    """Write `curve.csv` and `points.csv` of equilibrium paths into a directory, both or none.

    Numbers as in `write_run`; `stable` is true or false.

    Parameters
    ----------
    curves : sequence of Curve
        Of the same balloons. Several share the two files, told apart by a leading column `curve`.
    directory : path
        Created if need be. Files of the same names are replaced.

    Returns
    -------
    list of Path

    Raises
    ------
    OutputError
        If the directory cannot be made or written to. What was there before is then still there.
    """
    tables = dict(zip(TRACE_FILES, (curve_columns(curves), point_columns(curves)), strict=True))
    return write_files(directory, {name: partial(write_csv, columns) for name, columns in tables.items()})


def fold_columns(curve: FoldCurve) -> Columns:
    """The columns of `fold.csv`: the parameter's value, and the limit point, or loss of sphericity, there."""
    columns = {
        curve.parameter: curve.value,
        "voltage": curve.voltage,
        **_by_name("stretch", curve.balloons, curve.stretch),
        "pressure": curve.pressure,
    }
    if curve.balloon is not None:
        # Which balloon it is, counted from 1; by this column a file is known from that of a limit point.
        columns[curve.of] = np.full(len(curve), curve.balloons.index(curve.balloon) + 1)
    if curve.scales is None:
        return columns
    varied = {}
    if curve.dimension is not None:
        varied[f"{curve.parameter} [{curve.dimension.unit}]"] = curve.value * curve.scales.of(curve.dimension)
    return columns | varied | in_si(columns, curve.scales, {})


def fold_table(curve: FoldCurve) -> pd.DataFrame:
    """`fold_columns` as a DataFrame."""
    import pandas as pd

    return pd.DataFrame(fold_columns(curve))


def write_fold(curve: FoldCurve, directory: str | os.PathLike[str]) -> list[Path]:
    """Write `fold.csv` into a directory, created if need be; numbers as in `write_run`.

    Raises
    ------
    OutputError
        If the directory cannot be made or written to.
    """
    return write_files(directory, {FOLD_FILE: partial(write_csv, fold_columns(curve))})


def write_sensitivities(found: Sequence[Sensitivity], directory: str | os.PathLike[str]) -> list[Path]:
    """Write `sensitivities.csv` into a directory, created if need be; numbers as in `write_run`.

    Raises
    ------
    OutputError
        If the directory cannot be made or written to.
    """
    names = ("time", "step", "kind", "of", "value", "key", "parameter", "derivative")
    columns = {name: np.array([getattr(one, name) for one in found]) for name in names}
    return write_files(directory, {SENSITIVITIES_FILE: partial(write_csv, columns)})


def _joined(curves: Sequence[Curve], parts: Sequence[Columns]) -> Columns:
    """Tables of equal columns under one another, numbered from 1 where there are several."""
    parts = [
        part | in_si(part, curve.scales, dict(zip(curve.balloons, curve.radius, strict=True)))
        if curve.scales
        else part
        for curve, part in zip(curves, parts, strict=True)
    ]
    if len(parts) == 1:
        return parts[0]
    sizes = [next(iter(part.values())).size for part in parts]
    return {
        "curve": np.repeat(np.arange(1, len(parts) + 1), sizes),
        **{name: np.concatenate([part[name] for part in parts]) for name in parts[0]},
    }


def _by_name(quantity: str, names: tuple[str, ...], values: FloatArray) -> Columns:
    return {f"{quantity}_{name}": values[:, i] for i, name in enumerate(names)}


def _stacked(records: tuple[Event, ...] | tuple[SpecialPoint, ...], attribute: str, width: int) -> FloatArray:
    """One row per event or point, NaN where an event has no such side."""
    rows = np.full((len(records), width), math.nan)
    for row, record in zip(rows, records, strict=True):
        value = getattr(record, attribute)
        if value is not None:
            row[:] = value
    return rows
