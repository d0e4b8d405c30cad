"""Several candidates fitted to the same data, ranked by Akaike's criterion."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from simulator.results.csv_text import write_csv
from simulator.results.files import write_files
from simulator.results.fit import Fit

RANKING_FILE = "ranking.csv"


@dataclass(frozen=True)
class Ranked:
    """A candidate, and how it compares with the best one.

    Attributes
    ----------
    fit : Fit
    delta : float
        AICc over that of the best one.
    weight : float
        Akaike's weight: exp(−delta/2) over the sum of all; how much speaks for it among these candidates.
    """

    fit: Fit
    delta: float
    weight: float


def rank_fits(fits: Sequence[Fit]) -> tuple[Ranked, ...]:
    """Rank fits to the same data by AICc, the best first.

    Parameters
    ----------
    fits : sequence of Fit
        Two or more.

    Returns
    -------
    tuple of Ranked

    Raises
    ------
    ValueError
        If they are of different data, or one has too few values for its numbers to have an AICc.
    """
    first = _data(fits[0])
    for other in fits[1:]:
        if not np.array_equal(_data(other), first, equal_nan=True):
            raise ValueError(
                f"{other.file} has other data than {fits[0].file}: AICc compares fits to the same"
            )
    for one in fits:
        if np.isnan(one.aicc):
            raise ValueError(f"{one.file} has {one.size} values: too few to compare it by AICc")
    best = min(one.aicc for one in fits)
    deltas = [one.aicc - best for one in fits]
    weights = np.exp(-0.5 * np.array(deltas))
    weights /= weights.sum()
    found = [Ranked(one, d, w) for one, d, w in zip(fits, deltas, weights.tolist(), strict=True)]
    return tuple(sorted(found, key=lambda one: one.delta))


def _data(fit: Fit) -> np.ndarray:
    """Everything that was measured, with its sigma where that was given."""
    return np.concatenate([np.concatenate([column.x, column.data]) for column in fit.columns])


def write_ranking(ranked: Sequence[Ranked], directory: str | os.PathLike[str]) -> list[Path]:
    """Write `ranking.csv`, one row for each candidate. Raises OutputError."""
    columns = {
        "fit": np.array([one.fit.file.replace(",", ";") for one in ranked], dtype=object),
        "numbers": np.array([len(one.fit.estimates) for one in ranked], dtype=np.int64),
        "aicc": np.array([one.fit.aicc for one in ranked]),
        "delta": np.array([one.delta for one in ranked]),
        "weight": np.array([one.weight for one in ranked]),
        "reduced_chi2": np.array([one.fit.reduced_chi2 for one in ranked]),
        "converged": np.array([one.fit.converged for one in ranked], dtype=bool),
    }
    return write_files(directory, {RANKING_FILE: partial(write_csv, columns)})
