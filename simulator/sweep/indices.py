"""Sobol indices: which of the numbers that are drawn a column owes its variance to."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator.scenario import Problem, ScenarioError
from simulator.sweep.lockstep import chunk
from simulator.sweep.measures import in_units
from simulator.sweep.plan import Axis, Sweep
from simulator.sweep.rows import columns, play

FloatArray = NDArray[np.float64]

_RESAMPLED = 200  # times, for the intervals
_AUDITED = 200  # one run in so many is played both ways


@dataclass(frozen=True)
class Indices:
    """Sobol indices of one column, an entry for each key.

    Attributes
    ----------
    column : str
    keys : tuple of str
    first_order, total_order : (n_keys,) arrays
        The share of the variance that a key has by itself, and together with all others.
    first_low, first_high, total_low, total_high : (n_keys,) arrays
        95 % intervals by bootstrap.
    """

    column: str
    keys: tuple[str, ...]
    first_order: FloatArray
    total_order: FloatArray
    first_low: FloatArray
    first_high: FloatArray
    total_low: FloatArray
    total_high: FloatArray


def indices_of(
    function: Callable[[FloatArray], FloatArray],
    axes: Sequence[Axis],
    names: Sequence[str],
    size: int,
    seed: int = 0,
) -> tuple[Indices, ...]:
    """Sobol indices of a function of independent numbers, by `scipy.stats.sobol_indices`.

    Parameters
    ----------
    function : callable
        From points (n_points, n_axes) to values (n_points, n_names).
    axes : sequence of Axis
        What the numbers are drawn from.
    names : sequence of str
        What the values are called.
    size : int
        A power of 2; the function is called for size (n_axes + 2) points.
    seed : int

    Returns
    -------
    tuple of Indices
        One for each name.
    """
    from scipy.stats import sobol_indices

    def values(points: FloatArray) -> FloatArray:
        return np.asarray(function(points.T)).T

    found = sobol_indices(
        func=values, n=size, dists=[_Drawn(axis) for axis in axes], random_state=np.random.default_rng(seed)
    )
    sure = found.bootstrap(confidence_level=0.95, n_resamples=_RESAMPLED)
    ends = {
        "first_low": sure.first_order.confidence_interval.low,
        "first_high": sure.first_order.confidence_interval.high,
        "total_low": sure.total_order.confidence_interval.low,
        "total_high": sure.total_order.confidence_interval.high,
    }
    orders = {"first_order": found.first_order, "total_order": found.total_order}
    shaped = {key: np.reshape(value, (len(names), len(axes))) for key, value in {**orders, **ends}.items()}
    keys = tuple(axis.key for axis in axes)
    return tuple(
        Indices(name, keys, **{key: value[i] for key, value in shaped.items()})
        for i, name in enumerate(names)
    )


class _Drawn:
    """What an axis is drawn from, as SciPy asks for it."""

    def __init__(self, axis: Axis) -> None:
        self.axis = axis

    def ppf(self, share: FloatArray) -> FloatArray:
        return self.axis.at(share)


def sobol_indices_of(sweep: Sweep) -> tuple[Indices, ...]:
    """Sobol indices of the columns that a sweep asks for, from runs of their own.

    Raises
    ------
    ScenarioError
        If some runs have no such column: then it has no variance that could be shared out.
    """
    sample = sweep.sample
    if sample is None or not sample.indices:
        return ()
    job, names = sweep.job, list(sample.indices)
    kinds = columns(job)
    known = list(kinds)
    converted = in_units(job, known)

    def played(points: FloatArray) -> FloatArray:
        runs = [tuple(row) for row in points.tolist()]
        audited = list(range(_AUDITED // 2, len(runs), _AUDITED))
        rows = chunk.rows(job, 0, runs, audited, known, play)
        table = [converted(run, list(row)) for run, row in zip(runs, rows, strict=True)]
        found = np.array([[_number(row[known.index(name)]) for name in names] for row in table])
        for place, name in enumerate(names):
            lack = int(np.isnan(found[:, place]).sum())
            if lack:
                said = f"{lack:,} of {len(runs):,} runs have none, so its variance cannot be shared out"
                raise ScenarioError(sweep.file, Problem("sample.indices", name, said))
        return found

    size = 1 << (sample.size.bit_length() - 1)
    return indices_of(played, sweep.axes, names, size, sample.seed)


def _number(cell: Any) -> float:
    return np.nan if cell is None else float(cell)
