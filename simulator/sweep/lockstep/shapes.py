"""What becomes of the balloons' shapes in runs played together, as `results.shapes` says of one history."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from simulator.model.device import Device
from simulator.model.membranes import ElectrodedMembrane
from simulator.solver.batch.shapes import Crossings, margin
from simulator.solver.batch.stacked import Stacked
from simulator.sweep.lockstep.ride import GAVE_UP, Flight, Ride

FloatArray = NDArray[np.float64]
Index = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_NOWHERE, _BEFORE, _AT_LANDING, _AFTER = range(4)
_WORDS = np.array(["pear_in_snap", "pear_before_snap", "pear_at_landing", "pear_after_snap"], dtype=object)
_NOTHING = 1e-9  # of a margin's terms: it has no sign


class Rode(NamedTuple):
    """A ride of some balloons of some runs, `voltage = offset + rate v` in it."""

    runs: Index
    members: tuple[int, ...]
    batch: Stacked
    ride: Ride
    offset: FloatArray
    rate: FloatArray


def note(
    shapes: Shapes | None,
    runs: Index,
    rides: Sequence[tuple[tuple[int, ...], Stacked, FloatArray, Ride]],
    offset: FloatArray,
    rate: FloatArray,
    snaps: Index,
    *,
    jumps: bool = False,
) -> Index:
    """Take what happened to shapes as the voltages of some runs moved.

    Parameters
    ----------
    shapes : Shapes or None
        None where shapes are not watched.
    runs : (n,) array
    rides : sequence
        Of balloons that move by themselves: their places, equations, starts and rides.
    offset, rate : (n_electroded, n) arrays
    snaps : array
        How many snaps each of all runs had before.
    jumps : bool
        Whether the voltages jump, so that flows are no snaps.

    Returns
    -------
    array of int
        Runs in which it is not certain.
    """
    if shapes is None:
        return np.zeros(0, dtype=np.int64)
    gone = np.zeros(runs.size, dtype=bool)
    for members, batch, _, ride in rides:
        rode = Rode(runs, members, batch, ride, offset, rate)
        gone |= shapes.note(rode, snaps[runs], jumps=jumps, alone=len(rides) == 1)
    return np.asarray(runs[gone])


@dataclass
class Shapes:
    """What is known of the shapes of n runs so far.

    Attributes
    ----------
    lost : (n_balloons, n) array of bool
        Whether a balloon is no sphere now.
    least : (n_balloons, n) array
        The smallest margins s.
    voltage : (n_electroded, n) array
        Where first some balloon was lost; NaN before that.
    lasting : (n,) array of int
        When first one was lost that was not regained in the same snap: before the first snap, at its landing,
        or after; 0 before that.
    events : (n,) array of bool
        Whether any was lost.
    """

    lost: BoolArray
    least: FloatArray
    voltage: FloatArray
    lasting: Index
    events: BoolArray

    @classmethod
    def spheres(cls, device: Device, runs: int) -> Shapes:
        """All spheres, at rest at λ = 1: `inflated` or `note` say how far from being none."""
        balloons = len(device.names)
        return cls(
            np.zeros((balloons, runs), dtype=bool),
            np.full((balloons, runs), np.inf),
            np.full((len(device.electroded), runs), np.nan),
            np.full(runs, _NOWHERE),
            np.zeros(runs, dtype=bool),
        )

    def inflated(self, balloon: int, runs: Index, ride: Ride) -> None:
        """Take the least margins of an inflation without a voltage, in which no sphere is lost."""
        self.least[balloon, runs] = np.minimum(self.least[balloon, runs], ride.least[0])

    def note(self, rode: Rode, snaps: Index, *, jumps: bool, alone: bool) -> BoolArray:
        """Take what happened to shapes in a ride.

        Parameters
        ----------
        rode : Rode
        snaps : (n,) array
            How many snaps each of its runs had before.
        jumps : bool
            Whether its flows are those of a voltage that jumps, and no snaps.
        alone : bool
            Whether no other balloon is driven at the same time.

        Returns
        -------
        (n,) array of bool
            Which runs are not certain.
        """
        runs, ride = rode.runs, rode.ride
        place = np.array(rode.members)
        self.least[np.ix_(place, runs)] = np.minimum(self.least[np.ix_(place, runs)], ride.least)
        gone = np.zeros(runs.size, dtype=bool)
        snaps = snaps.copy()
        for of_flows, changes in groupby(ride.changes, lambda one: isinstance(one, Flight)):
            if of_flows:
                for flight in changes:
                    assert isinstance(flight, Flight)
                    self._in_flow(rode, flight, snaps, gone, jumps=jumps)
            else:
                self._on_path(rode, [one for one in changes if isinstance(one, Crossings)], snaps)
        if not alone:
            for one in ride.changes:
                gone[one.runs] |= not isinstance(one, Flight) or one.flown.passes.any(axis=0)
        return gone | self._contradicted(rode)

    def _on_path(self, rode: Rode, found: Iterable[Crossings], snaps: Index) -> None:
        """Take the changes on one stretch of path, in order for each run."""
        runs, place, falls, when, states = (
            np.concatenate(part, axis=-1) for part in zip(*found, strict=True)
        )
        order = np.lexsort((when, runs))
        runs, place, falls, states = runs[order], place[order], falls[order], states[:, order]
        first = np.flatnonzero(np.append(True, runs[1:] != runs[:-1]))
        rank = np.arange(runs.size) - np.repeat(first, np.diff(np.append(first, runs.size)))
        for number in range(int(rank.max(initial=-1)) + 1):
            now = np.flatnonzero(rank == number)
            balloon, mine = np.array(rode.members)[place[now]], rode.runs[runs[now]]
            loses = falls[now] & ~self.lost[balloon, mine]
            self.lost[balloon, mine] = falls[now]
            some = now[loses]
            when_lost = np.where(snaps[runs[some]] == 0, _BEFORE, _AFTER)
            self._lose(rode, runs[some], states[-1, some], when_lost)

    def _in_flow(self, rode: Rode, flight: Flight, snaps: Index, gone: BoolArray, *, jumps: bool) -> None:
        """Take what flows change."""
        runs = flight.runs
        landed = flight.lands & ~np.bool_(jumps)
        before = snaps[runs]
        snaps[runs] += landed
        for i, balloon in enumerate(rode.members):
            lost, ends = self.lost[balloon, rode.runs[runs]], flight.flown.ends_lost[i]
            there_and_back = ~lost & ~ends
            gone[runs[there_and_back & ~flight.flown.certain[i]]] = True
            passes = np.flatnonzero(there_and_back & flight.flown.passes[i])
            self._lose(rode, runs[passes], flight.v[passes], np.full(passes.size, _NOWHERE))
            stays = np.flatnonzero(ends & ~lost)
            when = np.where(before > 0, _AFTER, np.where(landed, _AT_LANDING, _BEFORE))
            self._lose(rode, runs[stays], flight.v[stays], when[stays])
            self.lost[balloon, rode.runs[runs]] = ends

    def _lose(self, rode: Rode, runs: Index, v: FloatArray, when: Index) -> None:
        """Take losses of some runs, each once."""
        mine = rode.runs[runs]
        fresh = ~self.events[mine]
        voltage = rode.offset[:, runs] + rode.rate[:, runs] * v
        self.voltage[:, mine[fresh]] = voltage[:, fresh]
        self.events[mine] = True
        self.lasting[mine] = np.where(self.lasting[mine] == _NOWHERE, when, self.lasting[mine])

    def _contradicted(self, rode: Rode) -> BoolArray:
        """Whether the margins where a ride ends say something else than its changes."""
        states = rode.ride.states
        out = np.zeros(rode.runs.size, dtype=bool)
        for i, (balloon, membrane) in enumerate(zip(rode.members, rode.batch.membranes, strict=True)):
            if isinstance(membrane, ElectrodedMembrane):
                found = np.asarray(margin(i, rode.batch, states))
                out |= (found < 0.0) != self.lost[balloon, rode.runs]
        return np.asarray(out & (rode.ride.end != GAVE_UP))

    def words(self, snaps: Index) -> NDArray[np.object_]:
        """What became of the shapes in runs with so many snaps, as `results.shapes.shape_word`."""
        spheres = np.where(snaps > 0, "snap_of_a_sphere", "sphere").astype(object)
        lost = np.where((snaps == 0) & (self.lasting != _NOWHERE), "pear_without_snap", _WORDS[self.lasting])
        return np.where(self.events, lost, spheres)
