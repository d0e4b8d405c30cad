"""The immutable result of a run: samples, events and how it ended.

Nothing is computed here. `to_dataframe`, `to_csv` and `plot` import `tables` and `plot` when they are called,
so that a run which needs no table loads no pandas, and one without a picture no matplotlib.
All quantities are dimensionless, see `docs/physics.md`.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import NDArray

from simulator.events import SHAPE_EVENTS, EventKind, Outcome
from simulator.results.balance import EnergyBalance, SolverStatistics
from simulator.results.cycles import Account, Closest, Cycle, Extremes
from simulator.results.equality import same
from simulator.results.event import Event

if TYPE_CHECKING:
    from collections.abc import Sequence
    from os import PathLike
    from pathlib import Path

    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from simulator import Explorer
    from simulator.results.loops import Loop
    from simulator.results.shapes import ShapeVerdict
    from simulator.scenario import Scenario

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

__all__ = ["EnergyBalance", "Event", "EventKind", "History", "Outcome", "SolverStatistics", "Stop", "Verdict"]

PANELS = ("voltage", "pressure", "stretch", "field", "margin", "loop", "charge")
"""What a picture of a history may show, see `History.plot`."""

_BROKEN = 1e-9  # a margin that is zero to the accuracy of a flow


@dataclass(frozen=True)
class Verdict:
    """How close a film with a dielectric strength came to breakdown.

    Attributes
    ----------
    balloon : str
    broke : str or None
        "path", "snap" or "jump", during which it broke; None for a film that survived.
    time, step
        Where the margin is smallest, between samples too; where it broke, if it did.
    field, strength, margin : float
        ``|E|``, E_b and ``1 − |E|/E_b`` there.
    """

    balloon: str
    broke: str | None
    time: float
    step: int
    field: float
    strength: float
    margin: float


@dataclass(frozen=True)
class Stop:
    """How a step with `until` ended: `reached` says what ended it, None if nothing did before its time."""

    step: int
    time: float
    reached: str | None


@dataclass(frozen=True, repr=False, eq=False)
class History:
    """Samples, events and outcome of one run.

    Two histories are equal where their scenarios, samples and events are, whatever they cost. In a notebook a
    history shows its events and its picture.

    Attributes
    ----------
    scenario : Scenario
    balloons, electroded : tuple of str
        Names of all balloons and of those with electrodes, in the order of the columns below.
    time, step, branch : (n_samples,) arrays
        `step` counts from 1 with cycles unrolled, `branch` counts jumps from 0.
    cycle : (n_samples,) array
        The cycle of each sample, from 1; 0 outside of cycles. A sample between two belongs to the first.
    voltage, field, charge : (n_samples, n_electroded) arrays
    stretch : (n_samples, n_balloons) array
    pressure, volume, gas, energy, stability : (n_samples,) arrays
        `gas` is the amount (p + pₑ)V, of a liquid its volume; `energy` the potential Π (with −pV for its gas
        terms while the valve is open, with +½φq where charges are given), `stability` the smallest
        eigenvalue of its Hessian (NaN for one balloon on a liquid, which cannot move).
    events : tuple of Event
    outcome : Outcome
    energy_balance : EnergyBalance
    statistics : SolverStatistics
    stops : tuple of Stop
        Of the steps with `until`.
    rated : tuple of str
        Names of the balloons whose film has a dielectric strength, in the order of the columns below.
    strength, margin : (n_samples, n_rated) arrays
        The strength E_b of each film, and ``1 − |E|/E_b``, how far it is from breakdown.
    sphericity : (n_samples, n_balloons) array
        How far each balloon is from turning into a pear, over μ; empty with `[shape] on_loss = "ignore"`.
    supply : (n_samples, n_electroded) array
        The voltages of the sources where [supply] stands between them and the films; empty without it.
    inner_of : tuple of str
        The viscoelastic branches, `<balloon>_<number>` and `<balloon>_<number>_thickness`, in the order of
        the columns below.
    inner : (n_samples, n_inner) array
        The stretches in which each branch is free of stress, in the film's plane and across it.
    extremes : Extremes
        The largest and smallest stretches and fields, between samples too.
    closest : tuple of Closest
        Where each film with a strength comes closest to breakdown, between samples too.
    cycles : tuple of Cycle
        What each cycle amounts to.
    accounts : tuple of Account
        What had been booked by the ends of steps and the turns of waves.
    """

    scenario: Scenario
    balloons: tuple[str, ...]
    electroded: tuple[str, ...]
    time: FloatArray
    step: IntArray
    branch: IntArray
    voltage: FloatArray
    stretch: FloatArray
    pressure: FloatArray
    volume: FloatArray
    gas: FloatArray
    field: FloatArray
    charge: FloatArray
    energy: FloatArray
    stability: FloatArray
    events: tuple[Event, ...]
    outcome: Outcome
    energy_balance: EnergyBalance
    statistics: SolverStatistics
    stops: tuple[Stop, ...] = ()
    rated: tuple[str, ...] = ()
    strength: FloatArray = dataclasses.field(default_factory=lambda: np.empty((0, 0)))
    margin: FloatArray = dataclasses.field(default_factory=lambda: np.empty((0, 0)))
    sphericity: FloatArray = dataclasses.field(default_factory=lambda: np.empty((0, 0)))
    supply: FloatArray = dataclasses.field(default_factory=lambda: np.empty((0, 0)))
    inner_of: tuple[str, ...] = ()
    inner: FloatArray = dataclasses.field(default_factory=lambda: np.empty((0, 0)))
    cycle: IntArray = dataclasses.field(default_factory=lambda: np.empty(0, dtype=np.int64))
    extremes: Extremes = dataclasses.field(
        default_factory=lambda: Extremes.of(np.empty((0, 0)), np.empty((0, 0)))
    )
    closest: tuple[Closest, ...] = ()
    cycles: tuple[Cycle, ...] = ()
    accounts: tuple[Account, ...] = ()

    def __post_init__(self) -> None:
        """Tell the events what their numbers are multiples of."""
        scales = self.scenario.scales
        if scales is not None and any(event.scales is None for event in self.events):
            told = tuple(dataclasses.replace(event, scales=scales) for event in self.events)
            object.__setattr__(self, "events", told)

    def __len__(self) -> int:
        return int(self.time.size)

    def __repr__(self) -> str:
        count = len(self.events)
        return (
            f"<History {self.scenario.title!r}: {self.outcome.value}, {len(self):,} samples, "
            f"{count} event{'' if count == 1 else 's'}>"
        )

    def _repr_html_(self) -> str:
        from simulator.results.html import history_html

        return history_html(self)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, History) and same(self, other, but=("statistics",))

    def __hash__(self) -> int:
        return hash((self.outcome, len(self), self.events))

    def __getitem__(self, column: str) -> NDArray[Any]:
        """One column of `history.csv` by its name, (n_samples,): `history["stretch_active"]`.

        Raises
        ------
        KeyError
            If there is no such column.
        """
        from simulator.results.columns import history_columns

        columns = history_columns(self)
        if column not in columns:
            raise KeyError(f"{column!r} is no column, has {', '.join(columns)}")
        return columns[column]

    def si(self, quantity: str) -> NDArray[Any]:
        """A column in its SI unit, (n_samples,): `history.si("pressure")` in Pa.

        Raises
        ------
        KeyError
            If the scenario has no [scales], or the column no unit.
        """
        from simulator.results.columns import history_columns

        columns = history_columns(self)
        for name, values in columns.items():
            if name.startswith(f"{quantity} ["):
                return values
        known = [name.partition(" [")[0] for name in columns if " [" in name]
        raise KeyError(
            f"{quantity!r} has no SI unit here, " + (f"have {', '.join(known)}" if known else "no [scales]")
        )

    def at(self, time: float) -> dict[str, float]:
        """The columns of `history.csv` at one time, linear between samples.

        At the time of an event it is the state after it.

        Parameters
        ----------
        time : float
            From the first to the last sample.

        Returns
        -------
        dict of str to float

        Raises
        ------
        ValueError
            If the history does not reach so far.
        """
        from simulator.results.columns import columns_at

        return columns_at(self, time)

    @property
    def elastomers(self) -> dict[str, str]:
        """Each balloon's elastomer in plain words, by the balloon's name."""
        return {balloon.name: balloon.elastomer.words for balloon in self.scenario.balloons}

    @property
    def mechanical(self) -> tuple[Event, ...]:
        """The events but those of shape: what happens to spheres."""
        return tuple(event for event in self.events if event.kind not in SHAPE_EVENTS)

    @property
    def loops(self) -> tuple[Loop, ...]:
        """Each excursion of a voltage that rises from a turning point and comes back, as `loops(history)`."""
        from simulator.hysteresis.loops import loops

        return loops(self)

    @property
    def shapes(self) -> tuple[ShapeVerdict, ...]:
        """What becomes of the shape of every balloon; none where the scenario ignores it."""
        from simulator.results.shapes import verdicts

        return verdicts(self)

    @property
    def snaps(self) -> tuple[Event, ...]:
        """Limit and branch points from which the balloons came to rest elsewhere, tension kept."""
        kinds = (EventKind.LIMIT_POINT, EventKind.BRANCH_POINT)
        lost = {event.time for event in self.events if event.kind is EventKind.LOSS_OF_TENSION}
        return tuple(
            event
            for event in self.events
            if event.kind in kinds and event.stretch_after is not None and event.time not in lost
        )

    @property
    def verdicts(self) -> tuple[Verdict, ...]:
        """Of every film with a strength, whether it survived and how close it came to breakdown."""
        return tuple(self._verdict(i) for i in range(len(self.rated))) if len(self) else ()

    def _verdict(self, film: int) -> Verdict:
        margin, closest, broke = self.margin[:, film], self.closest[film], None
        if self.outcome is Outcome.BREAKDOWN and margin[-1] <= _BROKEN:
            last = self.events[-1].time
            before = [event.kind for event in self.mechanical[:-1] if event.time == last]
            broke = "path"
            if before:
                broke = "jump" if before[-1] is EventKind.JUMP else "snap"
            size = abs(float(self.field[-1, self.electroded.index(self.rated[film])]))
            closest = Closest(
                float(self.time[-1]),
                int(self.step[-1]),
                size,
                float(self.strength[-1, film]),
                float(margin[-1]),
            )
        return Verdict(self.rated[film], broke, *dataclasses.astuple(closest))

    def to_dataframe(self) -> pd.DataFrame:
        """The samples as a table, one row each; columns as in `history.csv` (`docs/results.md`)."""
        from simulator.results.tables import history_table

        return history_table(self)

    def events_to_dataframe(self) -> pd.DataFrame:
        """The events as a table, one row each; columns as in `events.csv` (`docs/results.md`)."""
        from simulator.results.tables import events_table

        return events_table(self)

    def cycles_to_dataframe(self) -> pd.DataFrame:
        """The cycles as a table, one row each; columns as in `cycles.csv` (`docs/results.md`)."""
        from simulator.results.tables import cycles_table

        return cycles_table(self)

    def to_csv(self, directory: str | PathLike[str]) -> list[Path]:
        """Write `history.csv`, `events.csv` and `run.json` into a directory, and `cycles.csv` if there are
        cycles; all or none.

        Parameters
        ----------
        directory : path
            Created if need be. Files of the same names are replaced.

        Returns
        -------
        list of Path

        Raises
        ------
        OutputError
            If the directory cannot be made or written to.
        """
        from simulator.results.tables import write_run

        return write_run(self, directory)

    @overload
    def plot(self, *, panels: Sequence[str] | None = None) -> Figure: ...
    @overload
    def plot(self, ax: Axes) -> Axes: ...
    def plot(self, ax: Axes | None = None, *, panels: Sequence[str] | None = None) -> Figure | Axes:
        """Draw the drive and stretches in time, and the stretch–voltage loop of each actuator.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Draw the first loop alone, into these axes, and return them.
        panels : sequence of str, optional
            Some of voltage, pressure, stretch, field, margin, loop, charge; by default those that say
            something of this history.

        Returns
        -------
        matplotlib.figure.Figure or matplotlib.axes.Axes
            The figure is not registered with pyplot: save it with ``figure.savefig(path)``.
        """
        from simulator.results.plot import plot_history, plot_loop

        return plot_history(self, panels) if ax is None else plot_loop(self, ax)

    def animate(self, path: str | PathLike[str], *, seconds: float = 8.0, rate: int = 20) -> Path:
        """Write a moving picture of so many seconds and frames in each: a .gif, or a .mp4 where ffmpeg is.

        Raises OutputError.
        """
        from simulator.results.plot.animation import write_animation

        return write_animation(self, path, seconds=seconds, rate=rate)

    def explore(self) -> Explorer:
        """The scenario of this history with its numbers to be moved; see `Scenario.live`."""
        from simulator import explore

        return explore(self)
