"""What a sample of runs says: quantiles, probabilities with their intervals, and how both settle with N."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator.results.csv_text import Columns, write_csv
from simulator.results.files import OutputError, write_files
from simulator.sweep.indices import Indices
from simulator.sweep.loading import load_columns
from simulator.sweep.storage import read_record

FloatArray = NDArray[np.float64]

QUANTILES = (0.025, 0.05, 0.25, 0.5, 0.75, 0.95, 0.975)
UNCERTAINTY_FILES = ("quantiles.csv", "probabilities.csv", "convergence.csv")
INDICES_FILE = "indices.csv"

_NOT_SPREAD = ("run", "seconds", "energy_imbalance")
_PARTS = (0.125, 0.25, 0.5, 1.0)  # of a sample, from its start


@dataclass(frozen=True)
class Probability:
    """How likely an outcome is: counted, and Wilson's interval of a confidence."""

    count: int
    runs: int
    low: float
    high: float

    @classmethod
    def of(cls, count: int, runs: int, confidence: float = 0.95) -> Probability:
        """The probability of something that was seen in some of the runs."""
        from scipy.stats import binomtest

        found = binomtest(count, runs).proportion_ci(confidence, method="wilson")
        return cls(count, runs, float(found.low), float(found.high))

    @property
    def value(self) -> float:
        """The share of the runs."""
        return self.count / self.runs


@dataclass(frozen=True, repr=False)
class Uncertainty:
    """What a sample of runs says.

    Attributes
    ----------
    title : str
    runs : int
    quantiles : mapping of str to (n_quantiles,) array
        Of each column of numbers, at `QUANTILES`; over the runs that have it.
    means, deviations : mapping of str to float
        Likewise.
    counts : mapping of str to int
        How many runs have it.
    probabilities : mapping of str to Probability
        Of each behaviour, the likeliest first.
    settling : tuple of (int, str, str, float, float, float)
        Runs, "probability" or "mean", of what, the value and its 95 % interval: of ever larger parts.
    units : mapping of str to str
        Of the columns that have one.
    indices : tuple of Indices
        Sobol indices, of columns that were asked for.
    """

    title: str
    runs: int
    quantiles: Mapping[str, FloatArray]
    means: Mapping[str, float]
    deviations: Mapping[str, float]
    counts: Mapping[str, int]
    probabilities: Mapping[str, Probability]
    settling: tuple[tuple[int, str, str, float, float, float], ...]
    units: Mapping[str, str] = field(default_factory=dict)
    indices: tuple[Indices, ...] = ()

    def __repr__(self) -> str:
        shares = ", ".join(f"{name} {p.value:.3g}" for name, p in self.probabilities.items())
        return f"<Uncertainty {self.title!r}: {self.runs:,} runs, {shares}>"

    def quantile(self, column: str, share: float) -> float:
        """One of the quantiles of a column. Raises KeyError where it was not computed."""
        if column not in self.quantiles or share not in QUANTILES:
            raise KeyError(f"{column!r} at {share}: has {', '.join(self.quantiles)} at {QUANTILES}")
        return float(self.quantiles[column][QUANTILES.index(share)])

    def to_csv(self, directory: str | os.PathLike[str]) -> list[Path]:
        """Write `quantiles.csv`, `probabilities.csv`, `convergence.csv`; `indices.csv` where there are any.

        Raises OutputError.
        """
        parts = (_quantiles(self), _probabilities(self), _settling(self))
        tables = dict(zip(UNCERTAINTY_FILES, parts, strict=True))
        if self.indices:
            tables[INDICES_FILE] = _indices(self)
        return write_files(directory, {name: partial(write_csv, table) for name, table in tables.items()})


def uncertainty(directory: str | os.PathLike[str]) -> Uncertainty:
    """What the runs of a sample say, which `balloons sweep` or `run_sweep` has written.

    Parameters
    ----------
    directory : path
        Of a sweep with `sample`; one that is not finished will do.

    Returns
    -------
    Uncertainty

    Raises
    ------
    OutputError
        If there is no sweep, or it is a grid, whose points are not drawn.
    """
    record = read_record(Path(directory))
    if record["grid"] is not None:
        raise OutputError(f"{str(directory)!r} has a grid, which is not drawn: uncertainty needs a sample")
    table = load_columns(directory)
    columns = {str(name): table[name].to_numpy() for name in table.columns}
    if not len(table):
        raise OutputError(f"{str(directory)!r} has no runs yet")
    return of_columns(columns, record["title"], record["units"])


def of_columns(columns: Mapping[str, NDArray[Any]], title: str, units: Mapping[str, str]) -> Uncertainty:
    """As `uncertainty`, of the columns of a sweep's table, in the order the runs were drawn in."""
    runs = len(columns["run"])
    numbers: dict[str, FloatArray] = {}
    for name, values in columns.items():
        if values.dtype.kind in "fiu" and name not in _NOT_SPREAD:
            there = np.asarray(values, dtype=np.float64)
            if np.isfinite(there).any():
                numbers[name] = there
    what = behaviours(columns)
    finite = {name: values[np.isfinite(values)] for name, values in numbers.items()}
    return Uncertainty(
        title=title,
        runs=runs,
        quantiles={name: np.quantile(values, QUANTILES) for name, values in finite.items()},
        means={name: float(values.mean()) for name, values in finite.items()},
        deviations={name: float(values.std(ddof=values.size > 1)) for name, values in finite.items()},
        counts={name: int(values.size) for name, values in finite.items()},
        probabilities={name: Probability.of(k, runs) for name, k in Counter(what).most_common()},
        settling=tuple(_parts(what, numbers)),
        units=dict(units),
    )


def behaviours(columns: Mapping[str, NDArray[Any]]) -> list[str]:
    """What each run amounts to; of one without a behaviour its outcome: failed, or refused."""
    pairs = zip(columns["behaviour"].tolist(), columns["outcome"].tolist(), strict=True)
    return [str(behaviour or outcome) for behaviour, outcome in pairs]


def _parts(
    what: list[str], numbers: Mapping[str, FloatArray]
) -> list[tuple[int, str, str, float, float, float]]:
    """Probabilities and means of ever larger parts of a sample, with intervals."""
    found: list[tuple[int, str, str, float, float, float]] = []
    names = [name for name, _ in Counter(what).most_common()]
    for count in dict.fromkeys(max(int(part * len(what)), 1) for part in _PARTS):
        for name in names:
            one = Probability.of(what[:count].count(name), count)
            found.append((count, "probability", name, one.value, one.low, one.high))
        for name, values in numbers.items():
            part = values[:count][np.isfinite(values[:count])]
            if part.size > 1:
                error = 1.959964 * float(part.std(ddof=1)) / np.sqrt(part.size)
                mean = float(part.mean())
                found.append((count, "mean", name, mean, mean - error, mean + error))
    return found


def _quantiles(found: Uncertainty) -> Columns:
    names = list(found.quantiles)
    return {
        "column": np.array(names, dtype=object),
        "unit": np.array([found.units.get(name, "") for name in names], dtype=object),
        "runs": np.array([found.counts[name] for name in names], dtype=np.int64),
        "mean": np.array([found.means[name] for name in names]),
        "standard_deviation": np.array([found.deviations[name] for name in names]),
        **{
            f"quantile_{share:g}": np.array([found.quantiles[name][i] for name in names])
            for i, share in enumerate(QUANTILES)
        },
    }


def _probabilities(found: Uncertainty) -> Columns:
    each = found.probabilities
    return {
        "behaviour": np.array(list(each), dtype=object),
        "runs": np.array([one.count for one in each.values()], dtype=np.int64),
        "probability": np.array([one.value for one in each.values()]),
        "low": np.array([one.low for one in each.values()]),
        "high": np.array([one.high for one in each.values()]),
    }


def _settling(found: Uncertainty) -> Columns:
    runs, kind, of, value, low, high = zip(*found.settling, strict=True)
    return {
        "runs": np.array(runs, dtype=np.int64),
        "kind": np.array(kind, dtype=object),
        "of": np.array(of, dtype=object),
        "value": np.array(value),
        "low": np.array(low),
        "high": np.array(high),
    }


def _indices(found: Uncertainty) -> Columns:
    rows = [(one, i) for one in found.indices for i in range(len(one.keys))]
    return {
        "column": np.array([one.column for one, _ in rows], dtype=object),
        "key": np.array([one.keys[i] for one, i in rows], dtype=object),
        **{
            name: np.array([getattr(one, name)[i] for one, i in rows])
            for name in ("first_order", "first_low", "first_high", "total_order", "total_low", "total_high")
        },
    }
