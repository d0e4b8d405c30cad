"""The immutable results of unloading from many peaks: what the drive passed, and what it left behind.

As in `history`, tables and pictures are imported when they are needed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, overload

import numpy as np
from numpy.typing import NDArray

from simulator.results.equality import same

if TYPE_CHECKING:
    from os import PathLike
    from pathlib import Path

    import pandas as pd
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from simulator.units import Dimension, Scales

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Leg = Literal["load", "unload", "reload"]


@dataclass(frozen=True, eq=False)
class UnloadedPath:
    """The whole equilibrium path along the drive: drive (n,), stretch (n, n_balloons), unstable (n,).

    Empty with the valve open, and where it could not be followed; then `failure` says why.
    """

    drive: FloatArray
    stretch: FloatArray
    unstable: NDArray[np.int64]
    failure: str


@dataclass(frozen=True, repr=False, eq=False)
class Unloading:
    """A drive that rises from the sealed state to each of many peaks, and goes back to zero.

    The drive is the voltage of the balloon with the largest share; see `StateGraph`. Arrays of what became of
    each peak have its place; the others have one element for each row of `unload.csv`.

    Attributes
    ----------
    title : str
    balloons, electroded : tuple of str
    share : (n_electroded,) array
    peaks : (n_peaks,) array
    remanent_stretch : (n_peaks, n_balloons) array
        Where the voltage is off again; NaN where the device ended.
    remanent_pressure : (n_peaks,) array
    area : (n_peaks,) array
        ∮Σφ dq up and back, over 4πR²Hμ; NaN where the device ended. Of a loop that is closed it is what was
        lost, of another one also what has been stored.
    dissipated : (n_peaks,) array
        What the potential lost in the snaps up and back.
    closed : (n_peaks,) array of bool
        Whether the drive came back to the state that it set out from.
    reloaded : (n_peaks,) array of bool
        Whether a second rise came to the same state at the peak; empty if there was none.
    outcome : tuple of str
        "completed", or what ended the device on the way up or back.
    peak : (n_rows,) array
    leg : (n_rows,) array of str
        "load", "unload" or "reload".
    drive : (n_rows,) array
    stretch : (n_rows, n_balloons) array
    pressure : (n_rows,) array
    event : (n_rows,) array of str
        What happens after this row; "" for most. The next row is the other side.
    thresholds : tuple of (float, str)
        All voltages at which something happened, with the leg.
    path : UnloadedPath
    radius : (n_balloons,) array
    scales : Scales or None
    """

    title: str
    balloons: tuple[str, ...]
    electroded: tuple[str, ...]
    share: FloatArray
    peaks: FloatArray
    remanent_stretch: FloatArray
    remanent_pressure: FloatArray
    area: FloatArray
    dissipated: FloatArray
    closed: BoolArray
    reloaded: BoolArray
    outcome: tuple[str, ...]
    peak: FloatArray
    leg: NDArray[np.object_]
    drive: FloatArray
    stretch: FloatArray
    pressure: FloatArray
    event: NDArray[np.object_]
    thresholds: tuple[tuple[float, Leg], ...]
    path: UnloadedPath
    radius: FloatArray
    scales: Scales | None = None

    def __len__(self) -> int:
        return int(self.peaks.size)

    def __repr__(self) -> str:
        return f"<Unloading {self.title!r}: {len(self)} peaks, {self.closed.sum()} of the loops closed>"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Unloading) and same(self, other)

    def __hash__(self) -> int:
        return hash((self.title, len(self)))

    def to_dataframe(self) -> pd.DataFrame:
        """What became of each peak, one row each; columns as in `peaks.csv` (`docs/hysteresis.md`)."""
        from simulator.results.tables import table
        from simulator.results.unloading_tables import peak_columns

        return table(peak_columns(self))

    def rows_to_dataframe(self) -> pd.DataFrame:
        """All that the drive passed; columns as in `unload.csv` (`docs/hysteresis.md`)."""
        from simulator.results.tables import table
        from simulator.results.unloading_tables import row_columns

        return table(row_columns(self))

    def _repr_html_(self) -> str:
        from simulator.results.html import unloading_html

        return unloading_html(self)

    def to_xarray(self) -> xr.Dataset:
        """What became of each peak, over `peak` and `balloon`; with scales in SI units. Needs xarray.

        Raises MissingExtra without it.
        """
        from simulator.results.unloading_arrays import unloading_dataset

        return unloading_dataset(self)

    def to_csv(self, directory: str | PathLike[str]) -> list[Path]:
        """Write `unload.csv`, `peaks.csv` and `unload.json` into a directory, created if need be.

        Returns their paths; `load_unloading` reads them back. Raises OutputError if it cannot be made or
        written to.
        """
        from simulator.results.unloading_tables import write_unloading

        return write_unloading(self, directory)

    @overload
    def plot(self) -> Figure: ...
    @overload
    def plot(self, ax: Axes) -> Axes: ...
    def plot(self, ax: Axes | None = None) -> Figure | Axes:
        """Draw the family of curves over the whole equilibrium path, and what remains over the peak.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Draw the family alone, into these axes, and return them.
        """
        from simulator.results.plot.unloading import draw_family, plot_unloading

        return plot_unloading(self) if ax is None else draw_family(self, ax)


@dataclass(frozen=True, repr=False, eq=False)
class UnloadingMap:
    """What remains after each peak, for many values of another number of the scenario.

    Attributes
    ----------
    title : str
    balloons, electroded : tuple of str
    key : str
        Of the number that varies.
    dimension : Dimension or None
        What it measures.
    values : (n_values,) array
    peaks : (n_peaks,) array
    remanent_stretch : (n_values, n_peaks, n_balloons) array
    area, dissipated : (n_values, n_peaks) arrays
    closed : (n_values, n_peaks) array of bool
    outcome : tuple of tuple of str
        For each value and peak; "refused" where the value makes no scenario.
    share : (n_electroded,) array
    scales : Scales or None
    """

    title: str
    balloons: tuple[str, ...]
    electroded: tuple[str, ...]
    key: str
    dimension: Dimension | None
    values: FloatArray
    peaks: FloatArray
    remanent_stretch: FloatArray
    area: FloatArray
    dissipated: FloatArray
    closed: BoolArray
    outcome: tuple[tuple[str, ...], ...]
    share: FloatArray
    scales: Scales | None = None

    def __repr__(self) -> str:
        return f"<UnloadingMap {self.title!r}: {self.values.size} × {self.peaks.size}>"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, UnloadingMap) and same(self, other)

    def __hash__(self) -> int:
        return hash((self.title, self.key, self.values.size))

    def to_dataframe(self) -> pd.DataFrame:
        """One row for each value and peak; columns as in `unload_map.csv` (`docs/hysteresis.md`)."""
        from simulator.results.tables import table
        from simulator.results.unloading_tables import map_columns

        return table(map_columns(self))

    def _repr_html_(self) -> str:
        from simulator.results.html import unloading_html

        return unloading_html(self)

    def to_xarray(self) -> xr.Dataset:
        """What became of each value and peak, over the key, `peak` and `balloon`; with scales in SI units.

        Raises MissingExtra without xarray.
        """
        from simulator.results.unloading_arrays import map_dataset

        return map_dataset(self)

    def to_csv(self, directory: str | PathLike[str]) -> list[Path]:
        """Write `unload_map.csv` and `unload_map.json` into a directory, created if need be.

        Raises OutputError if it cannot be made or written to.
        """
        from simulator.results.unloading_tables import write_map

        return write_map(self, directory)

    def plot(self) -> Figure:
        """Draw what remains of the electroded balloon that changes most, over peak and value."""
        from simulator.results.plot.unloading import plot_map

        return plot_map(self)
