"""The results of a sweep as arrays over its grid, or as a table of its samples."""

from __future__ import annotations

import io
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from simulator.results.extras import MissingExtra
from simulator.sweep.storage import PARQUET, TABLE, read_record, stored

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


def load_sweep(directory: str | os.PathLike[str]) -> xr.Dataset | pd.DataFrame:
    """Read the results of a sweep.

    Parameters
    ----------
    directory : path
        Where `balloons sweep` or `run_sweep` wrote; a sweep that is not finished will do.

    Returns
    -------
    xarray.Dataset or pandas.DataFrame
        Of a grid the dataset: one dimension for each key that was varied, one variable for each other
        column, with its unit as the attribute ``units``. Of samples the table, one row for each run. Runs
        that are not there yet are NaN or "", or no rows.

    Raises
    ------
    OutputError
        If there is no sweep.
    MissingExtra
        If it is a grid and xarray is not installed.
    """
    record = read_record(Path(directory))
    if record["grid"] is None:
        return load_table(directory)
    table = load_columns(directory)
    try:
        import xarray as xr
    except ImportError as error:
        raise MissingExtra(
            "load_sweep of a grid needs xarray: pip install 'dielectric-balloons[sweep]'; "
            "load_table gives the same as a table"
        ) from error
    grid: dict[str, list[Any]] = record["grid"]
    shape = tuple(len(values) for values in grid.values())
    place = table["run"].to_numpy() - 1
    whole = len(table) == record["runs"]
    variables = {}
    for name in table.columns:
        if name in grid:
            continue
        values = table[name].to_numpy()
        if values.dtype.kind in "iu" and not whole:
            values = values.astype(np.float64)
        filler: Any = "" if values.dtype.kind not in "fiub" else np.nan if values.dtype.kind == "f" else 0
        full = np.full(record["runs"], filler, dtype=object if filler == "" else values.dtype)
        full[place] = values
        variables[name] = (tuple(grid), full.reshape(shape))
    found = xr.Dataset(variables, coords=grid, attrs={"title": record["title"]})
    for key, unit in record["units"].items():
        found[key].attrs["units"] = unit
    return found


def load_table(directory: str | os.PathLike[str]) -> pd.DataFrame:
    """The rows of a sweep that are there, as a table in order of the runs; columns as in `sweep.csv`.

    With [scales] these have their unit behind their name: `landing_pressure [Pa]`.

    Raises
    ------
    OutputError
        If there is no sweep.
    """
    table = load_columns(directory)
    return table.set_axis(stored(Path(directory)).titles, axis="columns")


def load_columns(directory: str | os.PathLike[str]) -> pd.DataFrame:
    """As `load_table`, the columns by their names alone; their units are in the sweep's record."""
    import pandas as pd

    store = stored(Path(directory))
    if (store.directory / PARQUET).is_file():
        try:
            table = pd.read_parquet(store.directory / PARQUET)
            return _typed(table.set_axis(list(store.kinds), axis="columns"), store.kinds)
        except ImportError:  # no pyarrow; the other file says the same
            pass
    source: Any = store.directory / TABLE if store.complete else io.BytesIO(b"".join(store.texts()))
    # From 3.1 on pandas reads every number exactly, and warns of the word that older ones need for it.
    old = tuple(int(part) for part in pd.__version__.split(".")[:2]) < (3, 1)
    exactly: dict[str, Any] = {"float_precision": "round_trip"} if old else {}
    table = pd.read_csv(
        source,
        names=list(store.kinds),
        header=0 if store.complete else None,
        dtype={name: "str" if kind == "text" else "float64" for name, kind in store.kinds.items()},
        na_values={name: [""] for name, kind in store.kinds.items() if kind != "text"},
        keep_default_na=False,
        true_values=["true"],
        false_values=["false"],
        **exactly,
    )
    return _typed(table, store.kinds)


def _typed(table: pd.DataFrame, kinds: Mapping[str, str]) -> pd.DataFrame:
    """A table with the types of its columns; counts that a failed run has not make theirs a float."""
    types: dict[str, Any] = {"number": "float64", "text": "str", "truth": "bool"}
    for name, kind in kinds.items():
        whole = "float64" if kind == "whole" and table[name].isna().any() else "int64"
        table[name] = table[name].astype(types.get(kind, whole))
    return table
