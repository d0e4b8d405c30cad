"""The loops of a history: each excursion of a voltage that rises from a turning point and comes back.

Their ends and peaks are samples: ends of steps, extremes of waves, and rows of tables that are samples.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from itertools import zip_longest
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.events import EventKind, Outcome
from simulator.model.device import Device
from simulator.results.loops import Loop, Threshold, snapping
from simulator.scenario import Charge, Hold, Inflate, Jump, Ramp, Sine, Table, Triangle

if TYPE_CHECKING:
    from simulator.results.cycles import Account
    from simulator.results.history import Event, History
    from simulator.scenario import PlayedStep

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_ROUNDING = 1e-9  # of the largest voltage of a wave
_NOISE = 1e-2  # of that of a table
_INSTANT = 1e-9  # two times that are one
_SAME = 1e-8  # stretches, relatively, of states that are one
_OFF = 1e-12  # of the peak: a voltage that is off
_SNAPS = (EventKind.LIMIT_POINT, EventKind.BRANCH_POINT)


def loops(history: History) -> tuple[Loop, ...]:
    """The loops of a history: each excursion of a voltage that rises from a turning point and comes back.

    Turning points are ends of ramps, jumps and holds, extremes of sines and triangles, and turns of tables
    all of whose rows are samples. A turn of a table by less than 1/100 of its largest voltage is noise.

    Parameters
    ----------
    history : History

    Returns
    -------
    tuple of Loop
        In order of time; where several actuators are driven, each has its own.

    Examples
    --------
    >>> from simulator import simulate
    >>> (loop,) = loops(simulate("scenarios/fig5c_state_a.toml"))
    >>> loop.peak, round(loop.width, 6), round(loop.area, 6), loop.closed
    (0.6, 0.232868, 40.783907, True)
    """
    excursions = [
        (place, turns, is_open)
        for nodes, is_open in _monotone(history)
        for place in range(len(history.electroded))
        for turns in _excursions(np.abs(history.voltage[nodes, place]), nodes)
    ]
    if not excursions:
        return ()
    device = Device.from_scenario(history.scenario)
    events = history.mechanical
    found = [
        _loop(device, history, events, place, turns, is_open=is_open) for place, turns, is_open in excursions
    ]
    return tuple(sorted(found, key=lambda loop: loop.start))


def _stored(device: Device, history: History, rows: Sequence[int], *, is_open: bool) -> FloatArray:
    """Π + Σφq in some samples, the valve taken as it stands in the loop: (n_rows,)."""
    at = list(rows)
    stretch, pressure, voltage = history.stretch[at], history.pressure[at], history.voltage[at]
    energy = device.energy(stretch, pressure, voltage, history.gas[at], np.full(len(at), is_open))
    return np.asarray(energy + np.sum(voltage * device.charge(stretch, voltage), axis=1))


def _monotone(history: History) -> Iterator[tuple[list[int], bool]]:
    """Samples at ends of steps that follow one another, and whether the valve is open in them.

    Between two of them each voltage is monotone.
    Whatever moves the balloons otherwise divides them.
    """
    nodes: list[int] = []
    valve = "closed"
    for number, step in enumerate(history.scenario.played_steps(), start=1):
        rows = np.flatnonzero(history.step == number)
        if not rows.size:
            break
        last = int(rows[-1])
        within = list(_turns(history, step, rows))
        if isinstance(step, Inflate):
            yield nodes, valve == "open"
            nodes = [last]
            continue
        sides = history.voltage[[*nodes[-1:], *within, last]]
        turned = bool(np.any((sides.min(axis=0) < 0.0) & (sides.max(axis=0) > 0.0)))
        known = isinstance(step, Ramp | Jump | Hold) or bool(within)
        # The state that a step begins in is that in which the one before has ended.
        if not known or turned or step.valve != valve:
            yield nodes, valve == "open"
            nodes = nodes[-1:] if known and not turned else []
        valve = step.valve
        if turned and within:
            nodes = [last]
        elif known or not isinstance(step, Charge):
            nodes += [row for row in (*within, last) if not nodes or row > nodes[-1]]
    yield nodes, valve == "open"


def _turns(history: History, step: PlayedStep, rows: IntArray) -> Iterator[int]:
    """The samples of a wave or a table at which a voltage turns, and its last; none of any other step."""
    waves = isinstance(step, Sine | Triangle)
    if not (waves or (isinstance(step, Table) and _all_rows(history, step))):
        return
    found: set[int] = {int(rows[0]), int(rows[-1])}
    for sizes in np.abs(history.voltage[rows]).T:
        # What rounding makes of the flat top of a sine is no turn.
        least = (_ROUNDING if waves else _NOISE) * float(sizes.max(initial=0.0))
        found.update(rows[turning_points(sizes, least)].tolist())
    yield from sorted(found)


def _all_rows(history: History, table: Table) -> bool:
    """Whether every row of a table is a sample."""
    output = history.scenario.output
    return output.rows or (output.every is None and table.times.size <= output.points)


def turning_points(sizes: FloatArray, least: float) -> list[int]:
    """Places at which a sequence turns round by more than so much, in order."""
    found: list[int] = []
    up: bool | None = None
    low = high = 0
    for place, size in enumerate(sizes.tolist()):
        low = place if size < sizes[low] else low
        high = place if size > sizes[high] else high
        if up is not True and size > sizes[low] + least:
            found += [low] if up is False else []
            up, high = True, place
        elif up is not False and size < sizes[high] - least:
            found += [high] if up else []
            up, low = False, place
    return found


def _excursions(sizes: FloatArray, nodes: list[int]) -> Iterator[tuple[int, int, int]]:
    """The samples where a voltage of these sizes turns, is at its peak, and turns again."""
    moves = [k for k in range(1, len(nodes)) if sizes[k] != sizes[k - 1]]
    corners = [0] if nodes else []
    for k, following in zip_longest(moves, moves[1:]):
        if following is None or (sizes[k] > sizes[k - 1]) != (sizes[following] > sizes[following - 1]):
            corners.append(k)
    for a, b, c in zip(corners, corners[1:], corners[2:], strict=False):
        if sizes[b] > sizes[a]:
            yield nodes[a], nodes[b], nodes[c]


def _loop(
    device: Device,
    history: History,
    events: Sequence[Event],
    place: int,
    turns: tuple[int, int, int],
    *,
    is_open: bool,
) -> Loop:
    a, b, c = turns
    first, middle, last_of = (
        bisect_right(events, (int(history.step[k]), float(history.time[k])), key=_when) for k in turns
    )
    up, down = events[first:middle], events[middle:last_of]
    snapped = sum(event.dissipated or 0.0 for event in (*up, *down))
    sizes = np.abs(history.voltage[[a, b, c], place])
    off = _OFF * float(sizes[1])
    stored = _stored(device, history, [a, c], is_open=is_open)
    closed = None
    if np.all(np.abs(history.voltage[c] - history.voltage[a]) <= off):
        closed = bool(np.all(np.abs(history.stretch[c] / history.stretch[a] - 1.0) <= _SAME))
        closed &= not history.inner.size or bool(np.allclose(history.inner[c], history.inner[a], _SAME, 0.0))
    nothing = float("nan")
    # Between snaps the sources deliver what is stored.
    area, own, lost = float(stored[1] - stored[0] + snapped), nothing, snapped
    began, ended = (_account(history, k) for k in (a, c))
    if began is not None and ended is not None:
        own = float(ended.works[place] - began.works[place])
    if history.scenario.dynamics is not None:
        area, lost = _in_motion(began, ended)
    last = c == len(history) - 1 and history.outcome is not Outcome.COMPLETED
    remains = bool(np.all(np.abs(history.voltage[c]) <= off)) and not last
    return Loop(
        balloon=history.electroded[place],
        start=float(history.time[a]),
        end=float(history.time[c]),
        low=float(sizes[0]),
        peak=float(sizes[1]),
        back=float(sizes[2]),
        up=_thresholds(history, place, up),
        down=_thresholds(history, place, down),
        stretch=history.stretch[c] if remains else np.full(len(history.balloons), np.nan),
        pressure=float(history.pressure[c]) if remains else nothing,
        area=nothing if last else area,
        own_area=own if not last else nothing,
        dissipated=float(lost),
        viscous=float(lost - snapped),
        closed=None if last else closed,
        ended=history.outcome.value if last else "",
    )


def _in_motion(began: Account | None, ended: Account | None) -> tuple[float, float]:
    """The work of all sources and what was lost from one account to another; NaN without both."""
    if began is None or ended is None:
        return float("nan"), float("nan")
    return ended.total - began.total, ended.dissipated - began.dissipated


def _account(history: History, row: int) -> Account | None:
    """What had been booked by a sample; None where nobody has noted it."""
    step, time = int(history.step[row]), float(history.time[row])
    place = bisect_right(history.accounts, (step, time + _INSTANT * (1.0 + time)), key=_noted)
    found = history.accounts[place - 1] if place else None
    if found is None or found.step != step or abs(found.time - time) > _INSTANT * (1.0 + time):
        return None
    return found


def _noted(account: Account) -> tuple[int, float]:
    return account.step, account.time


def _when(event: Event) -> tuple[int, float]:
    """Steps first: one may begin with an event at the instant at which the one before has ended."""
    return event.step, event.time


def _thresholds(history: History, place: int, events: Sequence[Event]) -> tuple[Threshold, ...]:
    return tuple(
        Threshold(
            abs(float(event.voltage[place])),
            snapping(history.balloons, event.stretch_before, event.stretch_after),
            event.dissipated or 0.0,
        )
        for event in events
        if event.kind in _SNAPS and event.stretch_after is not None
    )
