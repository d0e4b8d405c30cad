"""Where stretches, fields and margins are largest or smallest on a branch, between its ends.

A quantity is largest where its slope along the path changes its sign. That is looked for between all states
of a branch that are polished, its points and the states at the Gauss points between them, and found on the
branch itself. The states are exact to rounding, and do not depend on where samples are taken. A branch is
looked at once, however often a history passes along it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from operator import attrgetter, itemgetter

import numpy as np
from numpy.typing import NDArray

from simulator.model.conditions import COMPLEX_STEP
from simulator.model.drive import AffineDrive, SineDrive, Waveform
from simulator.model.elastomers import Number
from simulator.model.equations import Equations, State
from simulator.model.groups import Group
from simulator.model.membranes import AnyMembrane
from simulator.model.strength import Strength
from simulator.simulation.atlas import Response
from simulator.simulation.parts import parts_of
from simulator.solver import newton
from simulator.solver.branch import Branch
from simulator.solver.segment import STRAIGHT

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Quantity = Callable[[State], Number]

_NOISE = 1e-12  # of the largest slope: its sign may be rounding
_ROUNDS = 60
_CLOSE = 1e-9  # of a chord: a value is off by the square of that


def quantities(group: Group) -> list[Quantity]:
    """What is largest or smallest somewhere: all stretches, all fields, and fields over strengths."""
    found: list[Quantity] = []
    films = zip(group.equations.membranes, group.strengths, strict=True)
    for place, (membrane, strength) in enumerate(films):
        found.append(itemgetter(place))
        if membrane.drive is not None:
            found.append(partial(_field, place, membrane))
            if strength is not None:
                found.append(partial(_share, place, membrane, strength))
    return found


def _field(place: int, membrane: AnyMembrane, y: State) -> Number:
    return membrane.field(y[place], y[-1])


def _share(place: int, membrane: AnyMembrane, strength: Strength, y: State) -> Number:
    return membrane.field(y[place], y[-1]) / strength.at(y[place])


def _off(group: Group, states: FloatArray) -> FloatArray:
    """The v at which a field is zero, among states (n_unknowns, n) in order: there its size is smallest."""
    found: list[float] = []
    low, high = states[-1, 0], states[-1, -1]
    for membrane in group.equations.membranes:
        drive = membrane.drive
        if isinstance(drive, AffineDrive) and drive.rate:
            found.append(-drive.offset / drive.rate)
        elif isinstance(drive, SineDrive) and abs(drive.mean) < abs(drive.amplitude):
            turn = math.asin(-drive.mean / drive.amplitude) / (2.0 * math.pi)
            found += [(turn - drive.phase) % 1.0, (0.5 - turn - drive.phase) % 1.0]
    return np.array([v for v in found if low < v < high])


@dataclass(frozen=True)
class Peak:
    """Where something is largest or smallest: a fraction of a leg, and the state of the group at a place."""

    fraction: float
    place: int
    state: FloatArray


@dataclass
class Peaks:
    """What is known of the peaks of branches in a run."""

    _known: dict[int, tuple[Branch, int, FloatArray]] = field(default_factory=dict)

    def on_the_way(
        self, responses: Sequence[Response], waveform: Waveform, numbers: Callable[[FloatArray], IntArray]
    ) -> list[Peak]:
        """Where in a leg something is largest or smallest, in order of time.

        Of the fractions in which a branch is in the same state again, the first in every cycle.

        Parameters
        ----------
        responses : sequence of Response
        waveform : Waveform
        numbers : callable
            Which cycles some fractions of the leg belong to.
        """
        found: dict[tuple[int, float, int], Peak] = {}
        for place, response in enumerate(responses):
            for part in parts_of(response, waveform):
                for state in self.of(response.group, part.branch).T:
                    v = float(state[-1])
                    pieces = part.passing(v)
                    cycles = numbers(0.5 * (waveform.fractions[pieces] + waveform.fractions[pieces + 1]))
                    for first in np.unique(cycles, return_index=True)[1].tolist():
                        peak = Peak(waveform.when(int(pieces[first]), v), place, state)
                        found.setdefault((id(part.branch), v, int(cycles[first])), peak)
        return sorted(found.values(), key=attrgetter("fraction"))

    def of(self, group: Group, branch: Branch) -> FloatArray:
        """The states of a branch, as far as it is known, in which something is largest or smallest."""
        size = branch.states.shape[1]
        known = self._known.get(id(branch))
        if known is None or known[0] is not branch or known[1] != size:  # a copy of a run has other branches
            known = branch, size, _peaks(group, branch) if size > 1 else branch.states[:, :0]
            self._known[id(branch)] = known
        return known[2]


def _peaks(group: Group, branch: Branch) -> FloatArray:
    """The states of a branch in which something is largest or smallest, in order of rising v."""
    states, ahead = branch.closely()
    places, which = [], []
    stepped = states + 1j * COMPLEX_STEP * ahead
    found = quantities(group)
    for number, quantity in enumerate(found):
        slopes = np.imag(quantity(stepped)) / COMPLEX_STEP
        size, values = np.abs(slopes).max(), np.asarray(quantity(states))
        if not min(size, np.ptp(values)) > _NOISE * np.abs(values).max():
            continue
        sure = np.flatnonzero(np.abs(slopes) > _NOISE * size)
        changes = np.flatnonzero(slopes[sure[1:]] * slopes[sure[:-1]] < 0.0)
        places += [(sure[k], sure[k + 1]) for k in changes.tolist()]
        which += [number] * changes.size
    turns = branch.at(_off(group, states))
    if places:
        ends = np.array(places).T
        polished = states[:, ends[0]]
        chords = (states[:, ends[1]] - polished) / branch.equations.scales[:, None]
        # Between states so close nothing differs by more than rounding.
        far = np.flatnonzero(np.einsum("ij,ij->j", chords, chords) > STRAIGHT**2)
        if far.size:
            chosen = [found[which[k]] for k in far.tolist()]
            ends = ends[:, far]
            polished[:, far] = _polished(branch.equations, chosen, states[:, ends], ahead[:, ends])
        turns = np.concatenate([polished, turns], axis=1)
    return turns[:, np.unique(turns[-1], return_index=True)[1]]


def _polished(
    equations: Equations, chosen: Sequence[Quantity], ends: FloatArray, ahead: FloatArray
) -> FloatArray:
    """The states in which the slopes of n quantities vanish, (n_unknowns, n).

    By regula falsi, as of Illinois, on planes across chords: v would not do, since it turns at the ends of
    branches.

    Parameters
    ----------
    equations : Equations
    chosen : sequence of callable
        The quantities.
    ends, ahead : (n_unknowns, 2, n) arrays
        The two states of the curve between which each is, and the directions in which it goes on from there.
    """
    left, chords = ends[:, 0], ends[:, 1] - ends[:, 0]
    normals = chords / (equations.scales[:, None] ** 2)
    normals /= np.einsum("ij,ij->j", normals, chords)

    def slopes(states: FloatArray, rates: FloatArray) -> FloatArray:
        stepped = states + 1j * COMPLEX_STEP * rates
        return np.array([np.imag(of(stepped[:, k])) for k, of in enumerate(chosen)]) / COMPLEX_STEP

    low, high = np.zeros(len(chosen)), np.ones(len(chosen))
    first, last = (
        slopes(ends[:, i], ahead[:, i] / np.einsum("ij,ij->j", normals, ahead[:, i])) for i in (0, 1)
    )
    before = high
    for _ in range(_ROUNDS):
        middle = (low * last - high * first) / (last - first)
        states, rates = newton.on_planes(equations, left + middle * chords, normals)
        slope = slopes(states, rates)
        if (np.abs(middle - before) <= _CLOSE).all() or not slope.any():
            break
        same = slope * first > 0.0
        low, high = np.where(same, middle, low), np.where(same, high, middle)
        first, last = np.where(same, slope, 0.5 * first), np.where(same, 0.5 * last, slope)
        before = middle
    return states
