"""The immutable graph of a device's stable states: which there are, and what leads from one to another.

As in `history`, tables, pictures and networkx are imported when they are needed.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Literal, overload

import numpy as np
from numpy.typing import NDArray

from simulator.events import EventKind
from simulator.results.equality import same

if TYPE_CHECKING:
    from os import PathLike
    from pathlib import Path

    import networkx
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from simulator.units import Scales

FloatArray = NDArray[np.float64]
Direction = Literal["up", "down"]


@dataclass(frozen=True, repr=False, eq=False)
class State:
    """A stable state: where a device stays while its drive moves from one end of a range to the other.

    Attributes
    ----------
    number : int
        From 0, which is the sealed state.
    reachable : bool
        Whether a drive within the range of the graph leads from the sealed state to it.
    drive : (n,) array
        From the lower end of its range to the upper one, closer together at both; see `StateGraph`.
    stretch : (n, n_balloons) array
    pressure : (n,) array
    lost : (n,) array of bool
        Whether some balloon is no sphere there; all False with `[shape] on_loss = "ignore"`.
    """

    number: int
    reachable: bool
    drive: FloatArray
    stretch: FloatArray
    pressure: FloatArray
    lost: NDArray[np.bool_]

    @property
    def low(self) -> float:
        """The lower end of its range."""
        return float(self.drive[0])

    @property
    def high(self) -> float:
        """The upper end of its range."""
        return float(self.drive[-1])

    def __repr__(self) -> str:
        return f"<State {self.number}: from {self.low:.6g} to {self.high:.6g}>"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, State) and same(self, other)

    def __hash__(self) -> int:
        return hash((self.number, self.low, self.high))


@dataclass(frozen=True, eq=False)
class Transition:
    """What happens at one end of a state's range.

    Attributes
    ----------
    source : int
        The state that is left.
    target : int or None
        The state that it leads to; None where the device ends.
    direction : {"up", "down"}
        Whether the drive rises or falls.
    kind : EventKind
        What happens at the threshold.
    ending : EventKind or None
        What ends the device, there or in the snap.
    drive : float
        The threshold.
    voltage : (n_electroded,) array
        The voltages there.
    balloons : tuple of str
        What snaps: the balloon whose stretch changes by the largest factor; several where they are equal.
        None where nothing jumps.
    stretch_before, stretch_after : (n_balloons,) arrays
        The side after is None where the device ends at the threshold.
    pressure_before, pressure_after : float
    dissipated : float or None
        What the potential loses, over 4πR²Hμ.
    """

    source: int
    target: int | None
    direction: Direction
    kind: EventKind
    ending: EventKind | None
    drive: float
    voltage: FloatArray
    balloons: tuple[str, ...]
    stretch_before: FloatArray
    stretch_after: FloatArray | None
    pressure_before: float
    pressure_after: float | None
    dissipated: float | None

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Transition) and same(self, other)

    def __hash__(self) -> int:
        return hash((self.source, self.direction, self.drive))


@dataclass(frozen=True, repr=False, eq=False)
class StateGraph:
    """The stable states of a device along one line of voltages, and what leads from one to another.

    The drive is the voltage of the balloon with the largest share; every other voltage is its share of it.

    Attributes
    ----------
    title : str
    balloons, electroded : tuple of str
    share : (n_electroded,) array
        The voltage of each electroded balloon over the drive.
    low, high : float
        The range of the drive.
    start : int
        The state that the drive leads to from the sealed state, on its way up to `low`.
    states : tuple of State
        By number; those that can be reached first, in the order in which a walk from the start meets them,
        then the others in order of their ranges.
    transitions : tuple of Transition
        In order of their sources; up before down.
    complete : bool
        Whether states that cannot be reached were looked for.
    radius : (n_balloons,) array
        Unstretched, over the reference balloon's.
    scales : Scales or None
        What is 1 in SI units, for a scenario with [scales].
    """

    title: str
    balloons: tuple[str, ...]
    electroded: tuple[str, ...]
    share: FloatArray
    low: float
    high: float
    start: int
    states: tuple[State, ...]
    transitions: tuple[Transition, ...]
    complete: bool
    radius: FloatArray
    scales: Scales | None = None

    def __len__(self) -> int:
        return len(self.states)

    def __repr__(self) -> str:
        return f"<StateGraph {self.title!r}: {len(self)} states, {len(self.transitions)} transitions>"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, StateGraph) and same(self, other)

    def __hash__(self) -> int:
        return hash((self.title, len(self), len(self.transitions)))

    @cached_property
    def _leaving(self) -> dict[tuple[int, Direction], Transition]:
        return {(one.source, one.direction): one for one in self.transitions}

    def leaving(self, state: int, direction: Direction) -> Transition | None:
        """What happens at one end of a state's range; None where the range of the drive ends there."""
        return self._leaving.get((state, direction))

    def way(self, state: int, end: float, direction: Direction) -> tuple[Transition, ...]:
        """The transitions that a drive passes from a state on, in one direction to a value that it turns at.

        A drive that turns at a threshold has not passed it.
        """
        passed: list[Transition] = []
        here: int | None = state
        while here is not None:
            found = self.leaving(here, direction)
            if found is None or not (found.drive < end if direction == "up" else found.drive > end):
                break
            passed.append(found)
            here = found.target
        return tuple(passed)

    def visits(self, turns: Iterable[float]) -> tuple[Transition, ...]:
        """The transitions of a history from the start, at `low`, whose drive turns at some values.

        It ends early where the device ends.

        Raises
        ------
        ValueError
            If a value is outside the range of the graph.

        Examples
        --------
        >>> from simulator import states
        >>> graph = states("scenarios/fig5c_state_a.toml")
        >>> [(one.source, one.target) for one in graph.visits([0.6, 0.3, 0.6, 0.0])]
        [(0, 1), (1, 0)]
        """
        passed: list[Transition] = []
        here, v = self.start, self.low
        for turn in turns:
            if not self.low <= turn <= self.high:
                raise ValueError(f"{turn:g} is outside the range of the graph, {self.low:g} to {self.high:g}")
            passed += self.way(here, turn, "up" if turn > v else "down")
            v = turn
            if passed and passed[-1].target is None:
                break
            here = passed[-1].target if passed else here  # type: ignore[assignment]
        return tuple(passed)

    def to_dataframe(self) -> pd.DataFrame:
        """The states as a table, one row each; columns as in `states.csv` (`docs/results.md`)."""
        from simulator.results.state_tables import state_columns
        from simulator.results.tables import table

        return table(state_columns(self))

    def transitions_to_dataframe(self) -> pd.DataFrame:
        """The transitions as a table; columns as in `transitions.csv` (`docs/results.md`)."""
        from simulator.results.state_tables import transition_columns
        from simulator.results.tables import table

        return table(transition_columns(self))

    def to_csv(self, directory: str | PathLike[str]) -> list[Path]:
        """Write `states.csv`, `transitions.csv` and `states.json` into a directory, created if need be.

        Raises OutputError if it cannot be made or written to.
        """
        from simulator.results.state_tables import write_states

        return write_states(self, directory)

    def to_networkx(self) -> networkx.MultiDiGraph:
        """The graph for networkx: states by their numbers, and one node for each kind of end.

        Raises MissingExtra without networkx.
        """
        from simulator.results.state_tables import as_networkx

        return as_networkx(self)

    @overload
    def plot(self) -> Figure: ...
    @overload
    def plot(self, ax: Axes) -> Axes: ...
    def plot(self, ax: Axes | None = None) -> Figure | Axes:
        """Draw each state over its range, and arrows where one leads to another.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Draw the graph alone, into these axes, and return them.
        """
        from simulator.results.plot.states import draw_graph, plot_states

        return plot_states(self) if ax is None else draw_graph(self, ax)
