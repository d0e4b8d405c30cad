"""The result of a fit: estimates, what they are worth, and measured beside computed values."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from os import PathLike
    from pathlib import Path

    from matplotlib.figure import Figure

    from simulator.scenario import Scenario

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Estimate:
    """A number that was sought.

    Attributes
    ----------
    key : str
        Of the scenario.
    value : float
        In `unit`, as the following.
    unit : str
        "" for none.
    standard_error : float
        NaN where the data do not say; the fit then names what they leave open.
    low, high : float
        The interval of the confidence that was asked for, within the bounds of the fit.
    """

    key: str
    value: float
    unit: str
    standard_error: float
    low: float
    high: float


@dataclass(frozen=True)
class FittedColumn:
    """Measured values of one quantity, with what the fitted scenario says.

    Attributes
    ----------
    table : int
        The number of its [[data]] table, from 1.
    label : str
        The file, or the event.
    x_name, x_unit, y_name, y_unit : str
        The quantities, and the units they were measured in; of an event x is nothing.
    rows : (n,) array
        Lines of the file; 0 of an event.
    x, data, model, sigma : (n,) arrays
        In these units. `sigma` is the standard deviation, as given or as estimated from the residuals.
    branch : (n,) array
        The branch of the history that a row is compared with, from 1.
    beyond : (n,) array of bool
        Whether the row lies beyond the end of that branch.
    curve : tuple of (x, y, half_width), each (n_points,) arrays
        The computed curve, branch by branch, and half the width of its confidence band.
    """

    table: int
    label: str
    x_name: str
    x_unit: str
    y_name: str
    y_unit: str
    rows: NDArray[np.int64]
    x: FloatArray
    data: FloatArray
    model: FloatArray
    sigma: FloatArray
    branch: NDArray[np.int64]
    beyond: NDArray[np.bool_]
    curve: tuple[tuple[FloatArray, FloatArray, FloatArray], ...] = ()

    @property
    def residual(self) -> FloatArray:
        """Data − model."""
        return self.data - self.model

    @property
    def is_event(self) -> bool:
        """Whether it is of an event."""
        return not self.x_name


@dataclass(frozen=True)
class Undetermined:
    """A combination of numbers that the data do not tell.

    Attributes
    ----------
    words : str
        Which of them may change together, such as "scales.thickness +1 %, scales.radius +1 % together".
    weights : mapping of str to float
        By how much each changes, over itself.
    uncertainty : float
        The standard error of a relative change along it, to first order; infinite where nothing is known.
    """

    words: str
    weights: dict[str, float]
    uncertainty: float


@dataclass(frozen=True, repr=False)
class Fit:
    """Numbers of a scenario that agree best with measurements, as returned by `fit`.

    Attributes
    ----------
    file, title : str
    scenario : Scenario
        With the fitted numbers.
    estimates : tuple of Estimate
    correlation : (n, n) array
        Of the estimates; NaN where there are no standard errors.
    reduced_chi2 : float
        Σ(residual/sigma)² over the degrees of freedom; 1 where all sigma are estimated from the residuals.
    converged : bool
    message : str
        How the search ended.
    columns : tuple of FittedColumn
    undetermined : tuple of Undetermined
    aicc : float
        Akaike's information criterion, corrected for small samples; NaN where there are too few values.
    degrees : int
        Degrees of freedom.
    loss : str
    confidence : float
    intervals : str
        "profile likelihood" or "standard errors".
    starts : tuple of float
        Σ(residual/sigma)² that each start led to, the best one first.
    played : int
        How often the scenario was played.
    at_bounds : tuple of str
        Keys whose estimates lie at a bound.
    """

    file: str
    title: str
    scenario: Scenario
    estimates: tuple[Estimate, ...]
    correlation: FloatArray
    reduced_chi2: float
    converged: bool
    message: str
    columns: tuple[FittedColumn, ...]
    undetermined: tuple[Undetermined, ...] = ()
    aicc: float = float("nan")
    degrees: int = 0
    loss: str = "linear"
    confidence: float = 0.95
    intervals: str = "standard errors"
    starts: tuple[float, ...] = field(default_factory=tuple)
    played: int = 0
    at_bounds: tuple[str, ...] = ()

    def __repr__(self) -> str:
        found = ", ".join(
            f"{one.key} = {one.value:.6g}{one.unit and ' '}{one.unit}" for one in self.estimates
        )
        return f"<Fit {self.title!r}: {found}>"

    def __getitem__(self, key: str) -> Estimate:
        """The estimate of a key. Raises KeyError."""
        for one in self.estimates:
            if one.key == key:
                return one
        raise KeyError(f"{key!r} is not free, has {', '.join(one.key for one in self.estimates)}")

    @property
    def size(self) -> int:
        """The number of measured values."""
        return sum(column.data.size for column in self.columns)

    def to_dict(self) -> dict[str, Any]:
        """What `fit.json` holds."""
        from simulator.results.fit_tables import fit_record

        return fit_record(self)

    def to_csv(self, directory: str | PathLike[str]) -> list[Path]:
        """Write `fit.json`, `fit.csv`, `fit-record.json` and `fitted.toml`; return their paths.

        Raises
        ------
        OutputError
            If the directory cannot be made or written to.
        MissingExtra
            Without the extra `fit`.
        """
        from simulator.results.fit_tables import write_fit

        return write_fit(self, directory)

    def plot(self) -> Figure:
        """Draw data over the model with its band, and the residuals below."""
        from simulator.results.plot.fit import plot_fit

        return plot_fit(self)
