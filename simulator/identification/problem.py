"""A fit as data: what was measured, which numbers of the scenario are free, and how they are sought."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulator.events import SHAPE_EVENTS, EventKind
from simulator.scenario import Scenario
from simulator.units import Dimension

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class Column:
    """A quantity of a history that was measured.

    Attributes
    ----------
    name : str
        As in `history.csv`: `pressure`, `stretch_<name>`, …; or `radius_<name>`, `diameter_<name>`.
    unit : str
        What the measured numbers are in; "" for none.
    factor : float
        That unit over the SI unit; 1 without a unit.
    dimension : Dimension or None
        What it measures.
    """

    name: str
    unit: str
    factor: float
    dimension: Dimension | None


@dataclass(frozen=True)
class MeasuredCurve:
    """Some quantities over another one: the columns of a file.

    Attributes
    ----------
    label : str
        The file as the fit names it.
    x : Column
    y : tuple of Column
    at : (n_rows,) array
        The values of x; these and the following in SI units with [scales], else dimensionless.
    values : (n_rows, n_y) array
    sigma : (n_y,) array
        Standard deviations of the values; NaN where they are estimated from the residuals.
    rows : (n_rows,) array
        Lines of the file.
    step : int or None
        The step that it belongs to, from 1, cycles unrolled; None for any.
    """

    label: str
    x: Column
    y: tuple[Column, ...]
    at: FloatArray
    values: FloatArray
    sigma: FloatArray
    rows: IntArray
    step: int | None


@dataclass(frozen=True)
class MeasuredEvent:
    """Quantities of one event: the `number`th of its kind, from 1; in one step, or in all.

    `values` and `sigma` are (n_y,) arrays in the numbers that a `MeasuredCurve` has.
    """

    label: str
    kind: EventKind
    number: int
    y: tuple[Column, ...]
    values: FloatArray
    sigma: FloatArray
    step: int | None


Measured = MeasuredCurve | MeasuredEvent


@dataclass(frozen=True)
class FreeNumber:
    """A number of the scenario that is sought: where to start, and between which bounds, all in `unit`."""

    key: str
    unit: str
    start: float
    low: float = -math.inf
    high: float = math.inf

    @property
    def is_bounded(self) -> bool:
        """Whether it has both bounds."""
        return math.isfinite(self.low) and math.isfinite(self.high)

    def written(self, value: float) -> float | str:
        """A value as it stands in the scenario."""
        return f"{float(value)!r} {self.unit}" if self.unit else float(value)


@dataclass(frozen=True)
class Search:
    """How the numbers are sought.

    Attributes
    ----------
    loss : str
        What SciPy makes of large residuals: "linear" (least squares), "soft_l1", "huber", "cauchy", "arctan".
    starts : int
        From so many points: the given one, and others drawn between the bounds with `seed`.
    confidence : float
        Of the intervals.
    profile : bool
        Whether these are found by profile likelihood.
    """

    loss: str = "linear"
    starts: int = 1
    seed: int = 0
    confidence: float = 0.95
    profile: bool = False


@dataclass(frozen=True, repr=False)
class FitProblem:
    """A whole fit, as returned by `read_fit`."""

    file: str
    title: str
    scenario: Scenario
    measured: tuple[Measured, ...]
    free: tuple[FreeNumber, ...]
    search: Search

    def __repr__(self) -> str:
        keys = ", ".join(one.key for one in self.free)
        return f"<FitProblem {self.title!r}: {self.size:,} measured values, free {keys}>"

    @property
    def size(self) -> int:
        """The number of measured values."""
        return sum(one.values.size for one in self.measured)

    @property
    def needs_shapes(self) -> bool:
        """Whether an event is one of a balloon's shape."""
        return any(isinstance(one, MeasuredEvent) and one.kind in SHAPE_EVENTS for one in self.measured)
