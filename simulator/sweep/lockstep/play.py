"""The runs of a stack played together, step by step, to what a row of the sweep says of each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator.model.contents import Contents
from simulator.model.device import Device
from simulator.solver.batch import flow
from simulator.solver.batch.bordered import pivots, softest
from simulator.solver.batch.stacked import Stacked, taken
from simulator.solver.segment import ULPS
from simulator.sweep.lockstep.assembly import contents, line_through, opened, sealed
from simulator.sweep.lockstep.programme import Move
from simulator.sweep.lockstep.ride import GAVE_UP, THERE, Ride, arrived, drive, drive_each_once, lands, settle
from simulator.sweep.lockstep.shapes import Shapes, note
from simulator.sweep.plan import Past

FloatArray = NDArray[np.float64]
Index = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_ONE_INSTANT = 1e-9  # of a step: events closer than this may be one
_AT_ONCE = 1e-12  # closer than this they are one


@dataclass
class Played:
    """What is known of n runs so far; arrays end in (n,).

    Attributes
    ----------
    end : (n,) array
        GAVE_UP, THERE while a run goes on (or has completed), or 1 + the place of what ended it in `ENDS`.
    at_once : (n,) array of bool
        Whether a voltage-driven snap ended it.
    turns : list of (FloatArray, Index) pairs
        Voltages (n_electroded, k) and runs (k,) of limit points, in order for each run.
    """

    device: Device
    stretch: FloatArray
    pressure: FloatArray
    voltage: FloatArray
    contents: Contents
    valve_open: bool
    end: Index
    at_once: BoolArray
    limit_points: Index
    inflation_snaps: Index
    snaps: Index
    landing: FloatArray
    landing_pressure: FloatArray
    sealed: FloatArray
    largest: FloatArray
    largest_field: FloatArray
    electrical: FloatArray
    gas: FloatArray
    dissipated: FloatArray
    defect: FloatArray
    exchanged: FloatArray
    past: FloatArray
    shapes: Shapes | None
    turns: list[tuple[FloatArray, Index]] = field(default_factory=list)

    @classmethod
    def unstretched(cls, device: Device, runs: int, *, watched: bool) -> Played:
        """Stress free at p = 0, the valve closed over whatever gas that is; shapes may be watched."""
        balloons = len(device.names)

        def zeros() -> FloatArray:
            return np.zeros(runs)

        def whole() -> Index:
            return np.zeros(runs, dtype=np.int64)

        ones = np.ones((balloons, runs))
        return cls(
            device=device,
            stretch=ones,
            pressure=zeros(),
            voltage=np.zeros((len(device.electroded), runs)),
            contents=contents(device, ones, zeros()),
            valve_open=False,
            end=np.full(runs, THERE),
            at_once=np.zeros(runs, dtype=bool),
            limit_points=whole(),
            inflation_snaps=whole(),
            snaps=whole(),
            landing=np.full((balloons, runs), np.nan),
            landing_pressure=np.full(runs, np.nan),
            sealed=ones.copy(),
            largest=ones.copy(),
            largest_field=np.zeros((balloons, runs)),
            electrical=zeros(),
            gas=zeros(),
            dissipated=zeros(),
            defect=zeros(),
            exchanged=zeros(),
            past=np.full(runs, np.nan),
            shapes=Shapes.spheres(device, runs) if watched else None,
        )

    @property
    def going(self) -> Index:
        """The runs that go on."""
        return np.flatnonzero(self.end == THERE)


def play(
    device: Device,
    moves: tuple[Move, ...],
    runs: int,
    past: Past | None,
    *,
    watched: bool = False,
    after: Callable[[Played], None] | None = None,
) -> Played:
    """Play the programme of n runs.

    Parameters
    ----------
    device : Device
        With arrays (n_balloons, n), or (n,), in place of its numbers.
    moves : tuple of Move
        The same with their targets.
    runs : int
    past : Past or None
        See `sweep.plan`.
    watched : bool
        Whether it is looked at where the balloons stop being spheres.
    after : callable, optional
        Called with what is known after each move.
    """
    state = Played.unstretched(device, runs, watched=watched)
    for move in moves:
        if past is not None and past.step == move.number:
            state.past[:] = move.targets[0]  # as written, where it is not gone
    opening = True
    with np.errstate(all="ignore"):
        for place, move in enumerate(moves):
            if move.valve_open and not state.valve_open and place:
                _release(state)
            state.valve_open = move.valve_open
            opening &= move.kind == "inflate"
            before = state.end.copy()
            _step(state, move, past)
            if move.valve_open:
                state.contents = contents(device, state.stretch, state.pressure.copy())
            if opening:
                still = before == THERE
                state.sealed[:, still] = state.stretch[:, still]
            if after is not None:
                after(state)
    return state


def _step(state: Played, move: Move, past: Past | None) -> None:
    going = state.going
    if not going.size or move.kind == "hold":
        return
    if move.kind == "inflate":
        _inflate(state, going, _spread(move.targets[0], state)[going])
        return
    shape = state.voltage[:, going].shape
    if move.kind == "wave":
        corners: list[Any] = [np.broadcast_to(_spread(t, state)[going], shape) for t in move.targets]
    else:
        now = state.voltage[:, going]
        corners = [
            np.array(
                [n if t is None else _spread(t, state)[going] for t, n in zip(move.targets, now, strict=True)]
            ).reshape(shape)
        ]
    times = past.times if past is not None and past.step == move.number else None
    for place, corner in enumerate(corners):
        left = np.flatnonzero(state.end[going] == THERE)
        if place == 0 and move.kind in ("jump", "wave"):
            _jump(state, going[left], corner[:, left])
        else:
            _ramp(state, going[left], corner[:, left], times)


def _spread(value: Any, state: Played) -> FloatArray:
    return np.broadcast_to(np.asarray(value, dtype=np.float64), state.end.shape)


def _release(state: Played) -> None:
    """Give up runs with balloons that leave as the valve opens."""
    going = state.going
    still = state.voltage[:, going]
    device = taken(state.device, going)
    for i in range(len(device.names)):
        batch = opened(device, i, still, np.zeros_like(still), state.pressure[going])
        parts = batch.parts(np.stack([state.stretch[i, going], np.zeros(going.size)]))
        state.end[going[~(pivots(parts, softest(parts))[0] > 0.0)]] = GAVE_UP


def _inflate(state: Played, runs: Index, target: FloatArray) -> None:
    device, still = taken(state.device, runs), state.voltage[:, runs]
    rides: list[tuple[int, Stacked, FloatArray, Ride]] = []
    for i in range(len(device.names)):
        batch = opened(device, i, still, np.zeros_like(still), None, watched=bool(state.shapes))
        start = np.stack([state.stretch[i, runs], state.pressure[runs]])
        rides.append((i, batch, start, drive_each_once(batch, start, target)))
    _apart(state, runs, rides, target - state.pressure[runs], inflates=True)
    for i, batch, start, ride in rides:
        _book(state, runs, batch, start, ride, (i,), inflates=True)
        for turn in ride.turns:
            mine = runs[turn.runs]
            state.inflation_snaps[mine[arrived(turn, state.end[mine])]] += 1
        if state.shapes is not None:
            state.shapes.inflated(i, runs, ride)
            state.end[runs[still.any(axis=0)]] = GAVE_UP  # several balloons may change at once
    state.pressure[runs] = np.where(state.end[runs] == THERE, target, state.pressure[runs])


def _ramp(state: Played, runs: Index, target: FloatArray, times: float | None) -> None:
    moved = (target != state.voltage[:, runs]).any(axis=0)
    runs, target = runs[moved], target[:, moved]
    if not runs.size:
        return
    device = taken(state.device, runs)
    offset, rate, v, there = line_through(state.voltage[:, runs], target)
    pressure = state.pressure[runs]
    everything = tuple(range(len(device.names)))
    rides: list[tuple[tuple[int, ...], Stacked, FloatArray, Ride]] = []
    if not state.valve_open:
        batch = sealed(device, taken(state.contents, runs), offset, rate, watched=bool(state.shapes))
        start = np.concatenate([state.stretch[:, runs], pressure[None], v[None]])
        rides.append((everything, batch, start, drive(batch, start, there, times)))
    else:
        for i, moves in zip(device.electroded, rate, strict=True):
            if not moves.any():
                continue
            batch = opened(device, i, offset, rate, pressure, watched=bool(state.shapes))
            start = np.stack([state.stretch[i, runs], v])
            rides.append(((i,), batch, start, drive(batch, start, there, times if len(rate) == 1 else None)))
    _apart(state, runs, rides, there - v)
    for members, batch, start, ride in rides:
        _book(state, runs, batch, start, ride, members)
        if not state.valve_open:
            state.pressure[runs] = ride.states[-2]
    state.end[note(state.shapes, runs, rides, offset, rate, state.snaps)] = GAVE_UP
    _turned(state, runs, rides, offset, rate)
    going = state.end[runs] == THERE
    if times is not None:
        # Of one electrode, so v is its voltage.
        target = np.where(rate != 0.0, rides[0][3].states[-1], target)
        state.past[runs[going]] = target[0, going]
        ended = ~going
        turned = _first_turns(rides[0][3], runs.size)
        beyond = v + times * (turned - v)
        state.past[runs[ended & np.isfinite(turned)]] = beyond[ended & np.isfinite(turned)]
    state.voltage[:, runs[going]] = target[:, going]
    for _, _, _, ride in rides:
        stopped = (ride.end != THERE) & (ride.end != GAVE_UP)
        state.voltage[:, runs[stopped]] = (offset + rate * ride.states[-1])[:, stopped]


def _first_turns(ride: Ride, count: int) -> FloatArray:
    found = np.full(count, np.nan)
    for turn in reversed(ride.turns):
        found[turn.runs] = turn.before[-1]
    return found


def _jump(state: Played, runs: Index, target: FloatArray) -> None:
    """Change voltages at once; what moves flows to rest from where it is."""
    now = state.voltage[:, runs]
    largest = np.maximum(np.abs(target).max(axis=0), np.abs(now).max(axis=0))
    moved = np.abs(target - now).max(axis=0) > ULPS * largest
    runs, target = runs[moved], target[:, moved]
    if not runs.size:
        return
    device = taken(state.device, runs)
    offset, rate, _, there = line_through(state.voltage[:, runs], target)
    pressure, stretch = state.pressure[runs], state.stretch[:, runs]
    groups: list[tuple[tuple[int, ...], Stacked, FloatArray]] = []
    if not state.valve_open:
        batch = sealed(device, taken(state.contents, runs), offset, rate, watched=bool(state.shapes))
        groups.append((tuple(range(len(stretch))), batch, np.stack([*stretch, pressure, there])))
        state.end[runs[~(pressure > 0.0)]] = GAVE_UP  # nothing holds a balloon that is slack
    else:
        for i, moves in zip(device.electroded, rate, strict=True):
            if moves.any():
                batch = opened(device, i, offset, rate, pressure, watched=bool(state.shapes))
                groups.append(((i,), batch, np.stack([stretch[i], there])))
    unit = np.array([
        device.radius[i] ** 2 * device.permittivity[i] / device.thickness[i] * stretch[i] ** 4
        for i in device.electroded
    ])  # fmt: skip
    work = 0.5 * (unit * (target**2 - state.voltage[:, runs] ** 2)).sum(axis=0)
    state.electrical[runs] += work
    state.exchanged[runs] += np.abs(work)
    rides: list[tuple[tuple[int, ...], Stacked, FloatArray, Ride]] = []
    for members, batch, start in groups:
        ride = Ride.at(batch, start)
        ride.largest_field[:] = 0.0  # the new voltage on the old films is within the flow
        settle(batch, ride, np.arange(runs.size), start, flow.relax(batch, start))
        ride.snapped[:] = False  # a jump is no snap
        rides.append((members, batch, start, ride))
    ends = np.array([ride.end for *_, ride in rides])
    state.end[runs[(ends == GAVE_UP).any(axis=0)]] = GAVE_UP
    if len(rides) > 1:
        state.end[runs[(ends != THERE).any(axis=0)]] = GAVE_UP
    for members, batch, start, ride in rides:
        _book(state, runs, batch, start, ride, members)
        if not state.valve_open:
            state.pressure[runs] = ride.states[-2]
    state.end[note(state.shapes, runs, rides, offset, rate, state.snaps, jumps=True)] = GAVE_UP
    state.voltage[:, runs] = target


def _apart(state: Played, runs: Index, rides: list[Any], span: FloatArray, *, inflates: bool = False) -> None:
    """Give up runs in which balloons that do not feel each other end, or snap, about at the same time."""
    ends = np.array([ride.end for *_, ride in rides])
    state.end[runs[(ends == GAVE_UP).any(axis=0)]] = GAVE_UP
    if len(rides) == 1:
        return
    state.end[runs[(ends != THERE).any(axis=0)]] = GAVE_UP
    turns = [(turn.runs, turn.before[-1]) for *_, ride in rides for turn in ride.turns if turn.runs.size]
    if len(turns) < 2:
        return
    index, v = np.concatenate([t[0] for t in turns]), np.concatenate([t[1] for t in turns])
    order = np.lexsort((v, index))
    index, v = index[order], v[order]
    apart = np.where(index[1:] == index[:-1], np.abs(np.diff(v) / span[index[1:]]), np.inf)
    at_once = apart <= _AT_ONCE
    if inflates:
        np.subtract.at(state.inflation_snaps, runs[index[1:][at_once]], 1)  # one event of several balloons
        at_once = np.zeros_like(at_once)
    state.end[runs[index[1:][at_once | ((apart > _AT_ONCE) & (apart <= _ONE_INSTANT))]]] = GAVE_UP


def _book(
    state: Played, runs: Index, batch: Stacked, start: FloatArray, ride: Ride, members: tuple[int, ...],
    *, inflates: bool = False,
) -> None:  # fmt: skip
    """Take the state at the end of a ride, and note what happened."""
    place = np.array(members)
    ended = ride.end > THERE
    ended &= state.end[runs] != GAVE_UP
    state.end[runs[ended]] = ride.end[ended]
    state.at_once[runs[ended & ride.snapped]] = not inflates
    state.stretch[np.ix_(place, runs)] = ride.states[: len(place)]
    for name in ("largest", "largest_field"):
        whole, part = getattr(state, name), getattr(ride, name)
        whole[np.ix_(place, runs)] = np.maximum(whole[np.ix_(place, runs)], part)
    equations = batch.equations
    electric, supplied = (
        np.asarray(of(list(ride.states))) - np.asarray(of(list(start)))
        for of in (equations.electric_supply, equations.gas_supply)
    )
    lost = np.zeros(runs.size)
    for turn in ride.turns:
        lost[turn.runs] += turn.dissipated
    # By difference of states; the quadrature along the path, `ride.work`, is what it is held against.
    work = np.asarray(equations.potential(list(start))) - np.asarray(equations.potential(list(ride.states)))
    work = work - lost
    gas = work if inflates else 0.0
    state.electrical[runs] += electric - (work - gas)
    state.gas[runs] += supplied - gas
    state.dissipated[runs] += lost
    state.defect[runs] += ride.defect
    state.exchanged[runs] += np.abs(electric - (work - gas)) + np.abs(supplied - gas)


def _turned(state: Played, runs: Index, rides: list[Any], offset: FloatArray, rate: FloatArray) -> None:
    """Note limit points with the voltage moving, and where the first snap comes to rest."""
    found = [(members, turn) for members, _, _, ride in rides for turn in ride.turns if turn.runs.size]
    for members, turn in found:
        mine = runs[turn.runs]
        state.limit_points[mine] += 1
        voltage = offset[:, turn.runs] + rate[:, turn.runs] * turn.before[-1]
        state.turns.append((voltage, mine))
        count = len(members)
        kept = lands(turn, state.end[mine], count)
        fresh = kept & (state.snaps[mine] == 0)
        first = mine[fresh]
        if len(rides) > 1:
            state.end[mine[kept]] = GAVE_UP  # which of several came first is not kept
        state.landing[np.ix_(np.array(members), first)] = turn.after[:count, fresh]
        others = [i for i in range(len(state.stretch)) if i not in members]
        state.landing[np.ix_(np.array(others, dtype=int), first)] = state.stretch[
            np.ix_(np.array(others, dtype=int), first)
        ]
        state.landing_pressure[first] = turn.after[-2, fresh] if count > 1 or not state.valve_open else (
            state.pressure[first])  # fmt: skip
        state.snaps[mine[kept]] += 1
