"""The immutable result of a trace: an equilibrium path as points in order, and its special points.

As in `history`, nothing is computed here, and `tables` and `plot` are imported when they are needed.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, overload

import numpy as np
from numpy.typing import NDArray

from simulator.events import SHAPE_EVENTS
from simulator.results.equality import same

if TYPE_CHECKING:
    from collections.abc import Sequence
    from os import PathLike
    from pathlib import Path

    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from simulator.units import Dimension, Scales

FloatArray = NDArray[np.float64]

_NEARLY = 0.95  # a path that runs off along its stretch limit is shown up to this part of it


@dataclass(frozen=True, eq=False)
class SpecialPoint:
    """A point of an equilibrium path that has a name.

    Attributes
    ----------
    kind : str
        "limit_point" (v turns round), "branch_point" (another path crosses), "loss_of_sphericity" and
        "sphericity_regained" (a balloon stops being a sphere along the path, or is one again),
        "loss_of_tension" (p = 0), "stretch_limit" (a stretch within 1e-6 of its limit), "out_of_range" (at
        the end of a measured curve), "unbounded" (a stretch of 1000 of an elastomer without a limit, or a
        pressure or voltage of a million times its natural size), "zero_voltage", "reached" (what was asked
        for), "closed" (the path is back at one of its branch points).
    arclength, voltage, stretch, pressure
        Where; voltage (n_electroded,), stretch (n_balloons,).
    balloon, mode : str or None
        Of a change of shape: which balloon, and what it would turn into, "pear" or "shear".
    """

    kind: str
    arclength: float
    voltage: FloatArray
    stretch: FloatArray
    pressure: float
    balloon: str | None = None
    mode: str | None = None

    def __eq__(self, other: object) -> bool:
        return isinstance(other, SpecialPoint) and same(self, other)

    def __hash__(self) -> int:
        return hash((self.kind, self.arclength))


def farthest_shown(drive: FloatArray, stretch: FloatArray, marked: Sequence[float], end: str) -> float:
    """The voltage or pressure up to which a path is worth showing.

    Parameters
    ----------
    drive, stretch : (n,) arrays
        Of the path.
    marked : sequence of float
        Where its special points are, but the last.
    end : str
        The kind of the last. Paths run off to any voltage along a stretch limit.
    """
    if end == "unbounded" and marked:
        return 1.2 * float(max(marked))
    if end != "stretch_limit":
        return float(drive.max())
    shown = stretch <= _NEARLY * stretch[-1]
    return float(max([drive[shown].max() if shown.any() else drive[0], *(1.2 * value for value in marked)]))


@dataclass(frozen=True, repr=False, eq=False)
class Curve:
    """An equilibrium path, stable and unstable parts alike, as points in order of arclength.

    Two curves are equal where all their points are. In a notebook a curve shows its special points and its
    picture.

    Attributes
    ----------
    title : str
    balloons, electroded : tuple of str
        Names, in the order of the columns below. The curve of one balloon's inflation names that one.
    arclength : (n,) array
        In scaled unknowns (stretches, pressure and voltage over their natural sizes).
    voltage, field, charge : (n, n_electroded) arrays
    stretch : (n, n_balloons) array
    pressure, energy, stability : (n,) arrays
        `energy` is the potential Π, `stability` the smallest eigenvalue of its Hessian.
    unstable : (n,) array of int
        Number of unstable directions; 0 is stable. Limit points belong to the part before them.
    points : tuple of SpecialPoint
        In order; the last says why the path ends.
    ida_steps : int
    radius : (n_balloons,) array
        Unstretched, over the reference balloon's.
    scales : Scales or None
        What is 1 in SI units, for a scenario with [scales].
    sphericity : (n, n_balloons) array
        How far each balloon is from turning into a pear, over μ; empty with `[shape] on_loss = "ignore"`.
    lost : (n,) array of bool
        Whether some balloon is no sphere there, whatever it would turn into.
    """

    title: str
    balloons: tuple[str, ...]
    electroded: tuple[str, ...]
    arclength: FloatArray
    voltage: FloatArray
    stretch: FloatArray
    pressure: FloatArray
    field: FloatArray
    charge: FloatArray
    energy: FloatArray
    stability: FloatArray
    unstable: NDArray[np.int64]
    points: tuple[SpecialPoint, ...]
    ida_steps: int
    radius: FloatArray
    scales: Scales | None = None
    sphericity: FloatArray = dataclasses.field(default_factory=lambda: np.empty((0, 0)))
    lost: NDArray[np.bool_] = dataclasses.field(default_factory=lambda: np.empty(0, dtype=bool))

    def __len__(self) -> int:
        return int(self.arclength.size)

    def __repr__(self) -> str:
        kinds = ", ".join(point.kind for point in self.points)
        return f"<Curve {self.title!r}: {len(self):,} points; {kinds}>"

    def _repr_html_(self) -> str:
        from simulator.results.html import curve_html

        return curve_html(self)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Curve) and same(self, other, but=("ida_steps",))

    def __hash__(self) -> int:
        return hash((self.title, len(self)))

    @property
    def end(self) -> SpecialPoint:
        """The last special point: where and why the path ends."""
        return self.points[-1]

    @property
    def mechanical(self) -> tuple[SpecialPoint, ...]:
        """The special points without those of a balloon's shape."""
        return tuple(point for point in self.points if point.kind not in SHAPE_EVENTS)

    def to_dataframe(self) -> pd.DataFrame:
        """The points as a table, one row each; columns as in `curve.csv` (`docs/results.md`)."""
        from simulator.results.tables import curve_table

        return curve_table(self)

    def points_to_dataframe(self) -> pd.DataFrame:
        """The special points as a table, one row each; columns as in `points.csv` (`docs/results.md`)."""
        from simulator.results.tables import points_table

        return points_table(self)

    def to_csv(self, directory: str | PathLike[str]) -> list[Path]:
        """Write `curve.csv`, `points.csv` and `trace.json` into a directory; return their paths.

        Raises OutputError if it cannot be made or written to.
        """
        from simulator.results.tables import write_curves

        return write_curves([self], directory)

    @overload
    def plot(self) -> Figure: ...
    @overload
    def plot(self, ax: Axes) -> Axes: ...
    def plot(self, ax: Axes | None = None) -> Figure | Axes:
        """Draw stretch against voltage, stable solid, unstable dashed, special points marked.

        Into axes of one's own, without a legend, or as a whole figure.
        """
        from simulator.results.plot import plot_curves, plot_paths

        return plot_curves([self]) if ax is None else plot_paths([self], ax)


@dataclass(frozen=True, repr=False, eq=False)
class FoldCurve:
    """A limit point, or where a balloon stops being a sphere, as one number of the scenario changes.

    Attributes
    ----------
    title, parameter : str
        The scenario's title, and the key of the number.
    balloons : tuple of str
    value : (n,) array
        Of the parameter.
    voltage : (n,) array
        Voltage of the limit point; 0 where it is one of inflation.
    stretch : (n, n_balloons) array
    pressure : (n,) array
    end : str
        Why it ends: "reached", "cusp" (two limit points meet), "loss_of_tension" (p = 0), "zero_voltage",
        "inflation_limit" (the inflated state itself ends, or the inflation leads to another one). Of a loss
        of sphericity also "turning_point" (two of them meet) and "limit_point" (it meets one: beyond it, it
        is on an unstable part of the path, or was so before).
    ida_steps : int
    dimension : Dimension or None
        What the parameter measures.
    scales : Scales or None
        What is 1 in SI units, for a scenario with [scales].
    of : str
        What is followed: "limit_point", "loss_of_sphericity" or "sphericity_regained".
    balloon : str or None
        Of a change of shape: which balloon.
    """

    title: str
    parameter: str
    balloons: tuple[str, ...]
    value: FloatArray
    voltage: FloatArray
    stretch: FloatArray
    pressure: FloatArray
    end: str
    ida_steps: int
    dimension: Dimension | None = None
    scales: Scales | None = None
    of: str = "limit_point"
    balloon: str | None = None

    def __len__(self) -> int:
        return int(self.value.size)

    def __repr__(self) -> str:
        return f"<FoldCurve {self.title!r}: {len(self):,} points over {self.parameter}; {self.end}>"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, FoldCurve) and same(self, other)

    def __hash__(self) -> int:
        return hash((self.parameter, len(self), self.end))

    def to_dataframe(self) -> pd.DataFrame:
        """The points as a table, one row each; columns as in `fold.csv` (`docs/results.md`)."""
        from simulator.results.tables import fold_table

        return fold_table(self)

    def to_csv(self, directory: str | PathLike[str]) -> list[Path]:
        """Write `fold.csv` into a directory, created if need be; return its path.

        Raises OutputError if it cannot be made or written to.
        """
        from simulator.results.tables import write_fold

        return write_fold(self, directory)

    def plot(self) -> Figure:
        """Draw the voltage of the limit point (of an inflation: its pressure) over the parameter."""
        from simulator.results.plot import plot_fold

        return plot_fold(self)
