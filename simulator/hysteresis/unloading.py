"""Unloading from every peak: a drive that rises to each of many voltages, and goes back to zero.

All ways are read off the same states (`landscape`), so that a further peak costs a few interpolations, and a
step in what remains is found at its threshold, wherever the peaks are.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simulator.analysis.path import whole_path
from simulator.events import EventKind
from simulator.hysteresis.landscape import Landscape, Passage, Stay
from simulator.hysteresis.setting import setting
from simulator.hysteresis.states import first_state
from simulator.results.unloading import Leg, UnloadedPath, Unloading, UnloadingMap
from simulator.scenario import Problem, ScenarioError, dimension_of, dimensionless, load_scenario
from simulator.scenario.keys import all_keys
from simulator.scenario.mapping import near
from simulator.simulation.atlas import Atlas
from simulator.simulation.books import Books
from simulator.solver.follow import PathError
from simulator.units import VOLTAGE, Dimension

if TYPE_CHECKING:
    from simulator.scenario import Scenario, ScenarioLike

FloatArray = NDArray[np.float64]

_MOST = 100_000  # peaks, or values


@dataclass
class _Rows:
    """What a drive passes, row by row, in several columns that end up as one each."""

    peak: list[FloatArray]
    leg: list[NDArray[np.object_]]
    drive: list[FloatArray]
    stretch: list[FloatArray]
    pressure: list[FloatArray]
    event: list[NDArray[np.object_]]

    def add(
        self, peak: float, leg: str, v: FloatArray, states: tuple[FloatArray, FloatArray], event: str
    ) -> None:
        """Rows of one stay; the event is that of the last."""
        events = np.full(v.size, "", dtype=object)
        events[-1] = event
        columns = (np.full(v.size, peak), np.full(v.size, leg, dtype=object), v, *states, events)
        names = (self.peak, self.leg, self.drive, self.stretch, self.pressure, self.event)
        for column, values in zip(names, columns, strict=True):
            column.append(values)  # type: ignore[attr-defined]


@dataclass(frozen=True)
class _Ends:
    """What became of a peak."""

    stretch: FloatArray
    pressure: float
    area: float
    dissipated: float
    closed: bool
    reloaded: bool
    outcome: str
    steps: tuple[tuple[float, Leg], ...]


def unload(
    scenario: ScenarioLike,
    peaks: Sequence[float | str] | ArrayLike | str,
    *,
    reload: bool = False,
    along: Mapping[str, float] | None = None,
    points: int = 51,
) -> Unloading:
    """Raise the voltage from the sealed state to each of many peaks, and take it back to zero.

    Parameters
    ----------
    scenario : Scenario, path or mapping
    peaks : sequence of float or str, or str
        Over H√(μ/ε); with [scales] also texts with a unit. A text "0.1:0.5:81" means 81 of them from 0.1 to
        0.5, "2 kV:6 kV:81" the same with units.
    reload : bool
        Whether the voltage then rises to the peak once more.
    along : mapping of str to float, optional
        As of `states`.
    points : int
        Rows of each stay in one state, closer together at both of its ends.

    Returns
    -------
    Unloading

    Raises
    ------
    ScenarioError
        If the scenario has no such drive (`docs/hysteresis.md`), or the peaks make no sense.
    ArithmeticError
        If the solver fails.

    Examples
    --------
    >>> found = unload("scenarios/fig5b_state_b.toml", "0.13:0.15:3")
    >>> found.remanent_stretch[:, 0].round(4).tolist(), found.closed.tolist()
    ([1.2626, 6.0264, 6.0264], [True, False, False])
    """
    scenario = load_scenario(scenario)
    wanted = voltages(scenario, peaks)
    if points < 2:
        raise ScenarioError(scenario.file, Problem("points", points, "must be a whole number >= 2"))
    found, landscape = _unloaded(scenario, wanted, points, along, reload=reload)
    return replace(found, path=_path(landscape))


def _unloaded(
    scenario: Scenario, wanted: FloatArray, points: int, along: Mapping[str, float] | None, *, reload: bool
) -> tuple[Unloading, Landscape]:
    """As `unload`, without the whole path; and the states that were found."""
    begin = setting(scenario, along)
    landscape = Landscape(begin, Atlas(scenario.solver.rtol), 0.0, float(wanted.max()))
    first = first_state(scenario, landscape)
    rows = _Rows([], [], [], [], [], [])
    ends = [_one(landscape, first, peak, rows, points, reload=reload) for peak in wanted.tolist()]
    names = begin.device.names
    steps = sorted({step for end in ends for step in end.steps})
    found = Unloading(
        title=scenario.title,
        balloons=names,
        electroded=tuple(names[i] for i in begin.device.electroded),
        share=np.array(begin.line.rate),
        peaks=wanted,
        remanent_stretch=np.array([end.stretch for end in ends]),
        remanent_pressure=np.array([end.pressure for end in ends]),
        area=np.array([end.area for end in ends]),
        dissipated=np.array([end.dissipated for end in ends]),
        closed=np.array([end.closed for end in ends]),
        reloaded=np.array([end.reloaded for end in ends]) if reload else np.empty(0, dtype=bool),
        outcome=tuple(end.outcome for end in ends),
        peak=np.concatenate(rows.peak),
        leg=np.concatenate(rows.leg),
        drive=np.concatenate(rows.drive),
        stretch=np.concatenate(rows.stretch),
        pressure=np.concatenate(rows.pressure),
        event=np.concatenate(rows.event),
        thresholds=tuple(steps),
        path=_no_path(len(names)),
        radius=begin.device.radius,
        scales=scenario.scales,
    )
    return found, landscape


def unload_map(
    scenario: ScenarioLike,
    peaks: Sequence[float | str] | ArrayLike | str,
    key: str,
    values: Sequence[float | str] | ArrayLike | str,
    *,
    along: Mapping[str, float] | None = None,
) -> UnloadingMap:
    """What remains after each peak, for many values of another number of the scenario.

    Parameters
    ----------
    scenario, peaks, along
        As of `unload`.
    key : str
        Of the number, such as "gas.ambient_pressure".
    values : sequence of float or str, or str
        As the peaks.

    Returns
    -------
    UnloadingMap
        A value that makes no scenario, or from which the inflation leads to no state, has the outcome
        "refused" at every peak.

    Raises
    ------
    ScenarioError
        As `unload`, or if there is no such number.
    ArithmeticError
        If the solver fails.

    Examples
    --------
    >>> found = unload_map("scenarios/fig5c_state_a.toml", [0.4, 0.6], "gas.ambient_pressure", [0.05, 1.0])
    >>> found.outcome
    (('completed', 'completed'), ('completed', 'loss_of_tension'))
    """
    scenario = load_scenario(scenario)
    wanted = voltages(scenario, peaks)
    known = all_keys(scenario)
    if key not in known:
        raise ScenarioError(scenario.file, Problem(key, None, f"no such key, {near(key, known)}"))
    dimension = dimension_of(scenario, key)
    varied = _numbers(scenario, key, values, dimension, -math.inf)
    setting(scenario, along)
    found = [_at(scenario, key, float(value), wanted, along) for value in varied]
    device = tuple(balloon.name for balloon in scenario.balloons)
    nothing = np.full((wanted.size, len(device)), np.nan)
    return UnloadingMap(
        title=scenario.title,
        balloons=device,
        electroded=scenario.electroded,
        key=key,
        dimension=dimension,
        values=varied,
        peaks=wanted,
        remanent_stretch=np.array([nothing if one is None else one.remanent_stretch for one in found]),
        area=np.array([nothing[:, 0] if one is None else one.area for one in found]),
        dissipated=np.array([nothing[:, 0] if one is None else one.dissipated for one in found]),
        closed=np.array([np.zeros(wanted.size, bool) if one is None else one.closed for one in found]),
        outcome=tuple(("refused",) * wanted.size if one is None else one.outcome for one in found),
        share=next((one.share for one in found if one is not None), np.ones(len(scenario.electroded))),
        scales=scenario.scales,
    )


def _at(
    scenario: Scenario, key: str, value: float, peaks: FloatArray, along: Mapping[str, float] | None
) -> Unloading | None:
    try:
        return _unloaded(scenario.with_values({key: value}), peaks, 2, along, reload=False)[0]
    except ScenarioError:
        return None


def voltages(scenario: Scenario, peaks: Sequence[float | str] | ArrayLike | str) -> FloatArray:
    """Peaks as dimensionless voltages. Raises ScenarioError where they make no sense."""
    found = _numbers(scenario, "peaks", peaks, VOLTAGE, 0.0)
    if not np.all(found > 0.0):
        raise ScenarioError(scenario.file, Problem("peaks", float(found.min()), "must be > 0"))
    return found


def _numbers(
    scenario: Scenario,
    key: str,
    given: Sequence[float | str] | ArrayLike | str,
    dimension: Dimension | None,
    least: float,
) -> FloatArray:
    """Numbers of a sequence, or of a text such as "0.1:0.5:81"."""
    allowed = f'must be numbers, or "first:last:count" with at most {_MOST} of them'
    if isinstance(given, str):
        parts = given.split(":")
        count = int(parts[2]) if len(parts) == 3 and parts[2].strip().isdecimal() else 0
        if not 1 <= count <= _MOST:
            raise ScenarioError(scenario.file, Problem(key, given, allowed))
        first, last = (dimensionless(scenario, key, part.strip(), dimension, least) for part in parts[:2])
        return np.linspace(first, last, count)
    items: list[float | str] = list(given) if np.ndim(given) == 1 else []  # type: ignore[arg-type]
    if not 1 <= len(items) <= _MOST:
        raise ScenarioError(scenario.file, Problem(key, str(given), allowed))
    texts = [item if isinstance(item, str) else float(item) for item in items]
    return np.array([dimensionless(scenario, key, item, dimension, least) for item in texts])


def _one(landscape: Landscape, first: Stay, peak: float, rows: _Rows, points: int, *, reload: bool) -> _Ends:
    """Play one peak, and add its rows."""
    books = Books()
    play = _Legs(landscape, rows, peak, points, [])
    there, ending = play.leg("load", first, 0.0, peak, books)
    back = there
    if ending is None:
        back, ending = play.leg("unload", there, peak, 0.0, books)
    if ending is not None:
        nothing = np.full(len(landscape.setting.device.names), math.nan)
        lost = books.dissipated
        return _Ends(nothing, math.nan, math.nan, lost, False, False, ending.value, tuple(play.steps))
    stretch, pressure = landscape.at(back, np.zeros(1))
    reloaded = False
    if reload:
        again, ending = play.leg("reload", back, 0.0, peak, Books())
        reloaded = ending is None and again is there
    work, lost = books.electrical_work, books.dissipated
    closed = back is first
    return _Ends(stretch[0], float(pressure[0]), work, lost, closed, reloaded, "completed", tuple(play.steps))


@dataclass(frozen=True)
class _Legs:
    """The legs of one peak, with their rows and the thresholds passed."""

    landscape: Landscape
    rows: _Rows
    peak: float
    points: int
    steps: list[tuple[float, Leg]]

    def leg(
        self, leg: Leg, stay: Stay, start: float, end: float, books: Books
    ) -> tuple[Stay, EventKind | None]:
        """The state that a leg leads to, and what ends the device on the way, if anything does."""
        # Closer together at both ends, where stretches may run away from the voltage.
        shares = 0.5 - 0.5 * np.cos(np.linspace(0.0, math.pi, self.points))
        for passage in self.landscape.way(stay, start, end):
            stay = passage.stay
            _add(self.landscape, self.rows, passage, self.peak, leg, shares)
            _book(self.landscape, books, passage)
            if passage.departure is not None:
                self.steps.append((passage.departure.v, leg))
                if passage.departure.target is None:
                    return stay, passage.departure.ending
        return stay, None


def _add(
    landscape: Landscape, rows: _Rows, passage: Passage, peak: float, leg: Leg, shares: FloatArray
) -> None:
    """Add the rows of one stay, at shares of its way."""
    v = passage.start + shares * (passage.end - passage.start)
    v[-1] = passage.end
    departure = passage.departure
    event = "" if departure is None else departure.kind.value
    rows.add(peak, leg, v, landscape.at(passage.stay, v), event)


def _book(landscape: Landscape, books: Books, passage: Passage) -> None:
    """Book the work of a stay, and what is lost as it is left."""
    departure = passage.departure
    for place, (group, branch) in enumerate(
        zip(landscape.setting.groups, passage.stay.branches, strict=True)
    ):
        books.along_branch(group, branch, passage.start, passage.end)
        exit = None if departure is None else departure.exits.get(place)
        if exit is not None and exit.rest is not None and not exit.runs_away:
            books.at_once(group, exit.before, exit.rest.state, exit.dissipated)


def _no_path(balloons: int) -> UnloadedPath:
    return UnloadedPath(np.empty(0), np.empty((0, balloons)), np.empty(0, dtype=np.int64), "")


def _path(landscape: Landscape) -> UnloadedPath:
    """The whole equilibrium path along the same line, for the picture; with the valve open there is none."""
    begin = landscape.setting
    group, count = begin.groups[0], len(begin.device.names)
    if group.equations.is_open:
        return _no_path(count)
    try:
        points = whole_path(group, begin.unknowns()[0]).points(group.equations.scales)
    except PathError as failure:
        return replace(_no_path(count), failure=str(failure))
    stretch, _ = begin.states([points.states])
    return UnloadedPath(points.states[-1], stretch, points.unstable, "")
