"""The loops of a history as data and as a table; `hysteresis.loops` finds them."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.results.csv_text import Columns, write_csv
from simulator.results.equality import same
from simulator.results.files import write_files
from simulator.units import ENERGY, VOLTAGE, in_si

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from simulator.results.history import History

FloatArray = NDArray[np.float64]

LOOPS_FILE = "loops.csv"

_FACTOR = 1e-6  # factors by which two stretches change that are one


@dataclass(frozen=True)
class Threshold:
    """A snap on the way up or back: the size of the voltage, the balloons that snap, and what is lost."""

    voltage: float
    balloons: tuple[str, ...]
    dissipated: float


@dataclass(frozen=True, eq=False)
class Loop:
    """A voltage that rises from a turning point to a peak and comes back to the next turning point.

    Attributes
    ----------
    balloon : str
        Whose voltage. Actuators that are driven together have a loop each.
    start, end : float
        Times.
    low, peak, back : float
        The size of the voltage where it begins, at its peak, and where it ends.
    up, down : tuple of Threshold
        The snaps on the way up and back.
    stretch : (n_balloons,) array
        What remains at the end if the voltages are off there; else NaN.
    pressure : float
        The same.
    area : float
        ∮Σφ dq of all sources, over 4πR²Hμ.
    own_area : float
        ∮φ dq of the source of this balloon alone. NaN under `[dynamics]` with several sources, of which only
        the sum is known, and in recordings of thousands of rows.
    dissipated : float
        All that is lost: in the snaps, in the flow after jumps of the voltage, and under `[dynamics]` in the
        film.
    viscous : float
        What of that is lost in the film, between events.
    closed : bool or None
        Whether it ends in the state that it began in; None where it ends at another voltage, or where other
        voltages have changed.
    ended : str
        What ended the history on the way; "" for most.
    """

    balloon: str
    start: float
    end: float
    low: float
    peak: float
    back: float
    up: tuple[Threshold, ...]
    down: tuple[Threshold, ...]
    stretch: FloatArray
    pressure: float
    area: float
    own_area: float
    dissipated: float
    viscous: float
    closed: bool | None
    ended: str

    @property
    def width(self) -> float:
        """From the first snap on the way back to the first on the way up; NaN without both."""
        return self.up[0].voltage - self.down[0].voltage if self.up and self.down else float("nan")

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Loop) and same(self, other)

    def __hash__(self) -> int:
        return hash((self.balloon, self.start, self.end))


def loop_columns(history: History, loops: Sequence[Loop]) -> Columns:
    """Loops of a history by column, in the order of `loops.csv`, each (n_loops,).

    The first threshold of each way, with the balloons that snap there joined by +; empty where nothing snaps.
    """
    nothing = float("nan")

    def first(side: tuple[Threshold, ...]) -> float:
        return side[0].voltage if side else nothing

    columns: Columns = {
        "balloon": np.array([one.balloon for one in loops], dtype=object),
        "time_start": np.array([one.start for one in loops], dtype=float),
        "time_end": np.array([one.end for one in loops], dtype=float),
        **{f"voltage_{at}": np.array([getattr(one, at) for one in loops]) for at in ("low", "peak", "back")},
        "snaps_up": np.array([len(one.up) for one in loops], dtype=np.int64),
        "snaps_down": np.array([len(one.down) for one in loops], dtype=np.int64),
        "balloon_up": np.array(
            ["+".join(one.up[0].balloons) if one.up else "" for one in loops], dtype=object
        ),
        "balloon_down": np.array(
            ["+".join(one.down[0].balloons) if one.down else "" for one in loops], dtype=object
        ),
        "voltage_up": np.array([first(one.up) for one in loops]),
        "voltage_down": np.array([first(one.down) for one in loops]),
        "width": np.array([one.width for one in loops]),
        **{
            f"stretch_{n}": np.array([one.stretch[i] for one in loops])
            for i, n in enumerate(history.balloons)
        },
        "pressure": np.array([one.pressure for one in loops]),
        "area": np.array([one.area for one in loops]),
        "own_area": np.array([one.own_area for one in loops]),
        "dissipated": np.array([one.dissipated for one in loops]),
        "viscous": np.array([one.viscous for one in loops]),
        "closed": np.array(
            ["" if one.closed is None else str(one.closed).lower() for one in loops], dtype=object
        ),
        "ended": np.array([one.ended for one in loops], dtype=object),
    }
    scales = history.scenario.scales
    if scales is None:
        return columns
    radii = {balloon.name: balloon.radius for balloon in history.scenario.balloons}
    return columns | in_si(
        columns, scales, radii, {"width": VOLTAGE, "area": ENERGY, "own_area": ENERGY, "viscous": ENERGY}
    )


def write_loops(history: History, loops: Sequence[Loop], directory: str | os.PathLike[str]) -> list[Path]:
    """Write `loops.csv` into a directory, created if need be. Raises OutputError as `write_files`."""
    return write_files(directory, {LOOPS_FILE: partial(write_csv, loop_columns(history, loops))})


def snapping(names: tuple[str, ...], before: FloatArray, after: FloatArray) -> tuple[str, ...]:
    """The balloons whose stretches change by the largest factor in a snap; none where nothing jumps."""
    factors = np.abs(np.log(after / before))
    largest = float(factors.max())
    if largest < _FACTOR:
        return ()
    return tuple(name for name, factor in zip(names, factors, strict=True) if factor > largest - _FACTOR)
