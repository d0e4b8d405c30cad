"""The runs that a search asks for: each played once, whole populations together in lockstep."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from simulator.sweep.lockstep import chunk
from simulator.sweep.measures import in_units
from simulator.sweep.plan import Value
from simulator.sweep.rows import columns, play

if TYPE_CHECKING:
    from simulator.sweep.optimum import Question

FloatArray = NDArray[np.float64]
Place = tuple[float, ...]

_IMPOSSIBLE = -1e9  # how far a number that is not there is from its limits


@dataclass
class Evaluations:
    """The runs played, each once, by their place in the unit cube of the (scaled) intervals.

    Attributes
    ----------
    rows : dict
        In the units of their columns, what a run does not have left out.
    together : dict
        Of the runs in lockstep, what they were played with and came out as, without units.
    """

    question: Question
    progress: Callable[[int], None] | None
    rows: dict[Place, dict[str, Any]] = field(default_factory=dict)
    together: dict[Place, tuple[list[Value], dict[str, Any]]] = field(default_factory=dict)

    @cached_property
    def names(self) -> list[str]:
        return list(columns(self.question.sweep.job))

    @cached_property
    def converted(self) -> Callable[[Sequence[Value], Sequence[Any]], Sequence[Any]]:
        """What turns the cells of a row into their units."""
        return in_units(self.question.sweep.job, self.names)

    def at(self, places: FloatArray) -> list[dict[str, Any]]:
        """The rows at places (n_keys,) or (n_keys, n), played where they were not yet."""
        keys: list[Place] = [tuple(one) for one in places.reshape(len(places), -1).T.tolist()]
        fresh = [key for key in dict.fromkeys(keys) if key not in self.rows]
        if fresh:
            self._play(fresh)
        return [self.rows[key] for key in keys]

    def _play(self, keys: Sequence[Place]) -> None:
        job, start = self.question.sweep.job, len(self.rows)
        values: list[list[Value]] = [
            [float(axis.at(share)) for axis, share in zip(job.axes, key, strict=True)] for key in keys
        ]
        audited = int(np.random.default_rng(start).integers(len(keys)))
        found = chunk.rows(job, start, values, (audited,), self.names, play)
        for key, of, cells in zip(keys, values, found, strict=True):
            row = dict(zip(self.names, cells, strict=True))
            if row["way"] == chunk.LOCKSTEP:
                self.together[key] = of, row
            self.rows[key] = self._as_told(of, cells)
        if self.progress:
            self.progress(len(self.rows))

    def _as_told(self, values: Sequence[Value], cells: Sequence[Any]) -> dict[str, Any]:
        told = zip(self.names, self.converted(values, cells), strict=True)
        return {name: cell for name, cell in told if cell is not None and cell == cell}

    def objective(self, places: FloatArray) -> FloatArray:
        """What is made small, infinite where a run does not have it."""
        column, sense = self.question.column, self.question.sense
        found = np.array([sense * row.get(column, math.nan) for row in self.at(places)], dtype=np.float64)
        return np.where(np.isnan(found), np.inf, found)

    def margins(self, places: FloatArray) -> FloatArray:
        """How far each condition is fulfilled, (n_conditions,) or (n_conditions, n): below 0 it is not."""
        found = np.array([self._margins(row) for row in self.at(places)]).T
        return found if places.ndim > 1 else found[:, 0]

    def _margins(self, row: Mapping[str, Any]) -> list[float]:
        out = [0.0 if _number(row, self.question.column) is not None else -1.0]
        for column, condition in self.question.where.items():
            if isinstance(condition, tuple):
                out.append(0.0 if row.get(column) in condition else -1.0)
                continue
            value = _number(row, column)
            for limit, sign in ((condition.below, 1.0), (condition.above, -1.0)):
                if limit is not None:
                    off = math.nan if value is None else sign * (float(limit) - value)
                    size = self.question.sizes.get(column, 1.0)
                    out.append(_IMPOSSIBLE if value is None else off / size)
        return out

    def best(self) -> dict[str, Any] | None:
        """The best row that meets the conditions as `simulate` has it; None if none does.

        Raises
        ------
        DisagreementError
            If it does not come out the same both ways.
        """
        sense, column = self.question.sense, self.question.column
        fit = [key for key, row in self.rows.items() if min(self._margins(row)) >= 0.0]
        for key in sorted(fit, key=lambda one: sense * float(self.rows[one][column])):
            row = self._alone(key)
            if min(self._margins(row)) >= 0.0:  # on a limit, rounding may take it across
                return row
        return None

    def _alone(self, key: Place) -> dict[str, Any]:
        """The row at a place, played by itself if it was played in lockstep."""
        if key in self.together:
            job = self.question.sweep.job
            values, row = self.together.pop(key)
            expected = row.get(job.past.key) if job.past else None
            alone = {**play(job, row["run"] - 1, values, expected), "way": chunk.ALONE}
            chunk.compare(row["run"], row, alone)
            self.rows[key] = self._as_told(values, [alone.get(name) for name in self.names])
        return self.rows[key]


def _number(row: Mapping[str, Any], column: str) -> float | None:
    value = row.get(column)
    return None if value is None or not math.isfinite(value) else float(value)
