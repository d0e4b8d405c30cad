"""Results as pandas tables, and as files: CSV and `run.json`.

Both have the columns of `columns`. The text of a file does not pass through pandas: formatting rows here
takes less time than `DataFrame.to_csv`, and a run from the command line loads no pandas.

Numbers are written with as many digits as it takes to read the same double back, and NaN as an empty cell.
(Before 3.1, pandas reads them back exactly only with ``float_precision="round_trip"``.)
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from simulator.results.columns import (
    curve_columns,
    cycle_columns,
    event_columns,
    fold_columns,
    history_columns,
    point_columns,
    sensitivity_columns,
)
from simulator.results.csv_text import Columns, write_csv
from simulator.results.files import write_files
from simulator.results.plain_data import encoded
from simulator.results.record import run_record

if TYPE_CHECKING:
    import pandas as pd

    from simulator.results.curve import Curve, FoldCurve
    from simulator.results.history import History
    from simulator.results.sensitivity import Sensitivity

RUN_FILES = ("history.csv", "events.csv", "run.json")
CYCLES_FILE = "cycles.csv"
TRACE_RECORD = "trace.json"
TRACE_FILES = ("curve.csv", "points.csv", TRACE_RECORD)
FOLD_FILE = "fold.csv"
SENSITIVITIES_FILE = "sensitivities.csv"


def history_table(history: History) -> pd.DataFrame:
    """The samples of a history as a pandas table, one row each; columns as in `history_columns`."""
    return table(history_columns(history))


def events_table(history: History) -> pd.DataFrame:
    """The events of a history as a pandas table, one row each; columns as in `event_columns`."""
    return table(event_columns(history))


def cycles_table(history: History) -> pd.DataFrame:
    """The cycles of a history as a pandas table, one row each; columns as in `cycle_columns`."""
    return table(cycle_columns(history))


def curve_table(curve: Curve) -> pd.DataFrame:
    """The points of an equilibrium path as a pandas table, one row each; columns as in `curve_columns`."""
    return table(curve_columns([curve]))


def points_table(curve: Curve) -> pd.DataFrame:
    """The special points of an equilibrium path as a pandas table; columns as in `point_columns`."""
    return table(point_columns([curve]))


def fold_table(curve: FoldCurve) -> pd.DataFrame:
    """A limit point as one number changes as a pandas table; columns as in `fold_columns`."""
    return table(fold_columns(curve))


def write_run(
    history: History, directory: str | os.PathLike[str], *, failure: str | None = None
) -> list[Path]:
    """Write `history.csv`, `events.csv` and `run.json` of a history into a directory, all or none.

    A history with cycles has `cycles.csv` besides.

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
        As `write_files`.
    """
    text = json.dumps(run_record(history, failure), indent=2, ensure_ascii=False, allow_nan=False)
    columns = {"history.csv": history_columns(history), "events.csv": event_columns(history)}
    if history.cycles:
        columns[CYCLES_FILE] = cycle_columns(history)
    tables = _as_csv(columns)
    # run.json goes last: a reader who sees it sees the tables it belongs to.
    return write_files(directory, {**tables, "run.json": f"{text}\n".encode()})


def write_curves(curves: Sequence[Curve], directory: str | os.PathLike[str]) -> list[Path]:
    """Write `curve.csv`, `points.csv` and `trace.json` of equilibrium paths into a directory, all or none.

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
        As `write_files`.
    """
    tables = _as_csv({"curve.csv": curve_columns(curves), "points.csv": point_columns(curves)})
    text = json.dumps({"curves": encoded(list(curves))}, ensure_ascii=False, allow_nan=False)
    return write_files(directory, {**tables, TRACE_RECORD: f"{text}\n".encode()})


def write_fold(curve: FoldCurve, directory: str | os.PathLike[str]) -> list[Path]:
    """Write `fold.csv` into a directory, created if need be. Raises OutputError as `write_files`."""
    return write_files(directory, _as_csv({FOLD_FILE: fold_columns(curve)}))


def write_sensitivities(found: Sequence[Sensitivity], directory: str | os.PathLike[str]) -> list[Path]:
    """Write `sensitivities.csv` into a directory, created if need be. Raises OutputError as `write_files`."""
    return write_files(directory, _as_csv({SENSITIVITIES_FILE: sensitivity_columns(found)}))


def table(columns: Columns) -> pd.DataFrame:
    """Columns as a pandas table."""
    import pandas as pd

    return pd.DataFrame(columns)


def _as_csv(tables: Mapping[str, Columns]) -> dict[str, partial[None]]:
    """What writes each table, by the name of its file."""
    return {name: partial(write_csv, columns) for name, columns in tables.items()}
