"""The response of one set of equations to a waveform: along a branch, off its end, along the next.

All branches met in a run are kept in an `Atlas`. A branch is followed once, however often a history
comes back to it, and so is the way out at each of its ends.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from simulator.events import EventKind
from simulator.model.drive import Waveform
from simulator.model.equations import Equations
from simulator.model.first_rise import first_rise
from simulator.model.groups import Alike, AnyEquations, Group
from simulator.solver import flow
from simulator.solver.branch import Branch, BranchEnd
from simulator.solver.follow import PathError
from simulator.solver.ida import Effort
from simulator.solver.overdamped import consistent
from simulator.solver.singular import escape_direction, is_fold, parting_directions, sets_off

FloatArray = NDArray[np.float64]

_ROUNDING = 1e-9  # of what the potential loses: no difference between two ways
_OFF = 1e-4  # stretch by which snaps of one instant are started off their limit points
_CANCELS = 1e-9  # of the shares of dp/dv: together they are none
_NO_PRESSURE = 1e-16  # below it a pressure is the rounding of the forces of a wall


@dataclass(frozen=True)
class Exit:
    """How a set of equations leaves a state, at one instant.

    Attributes
    ----------
    kind : EventKind
        What makes it leave.
    before : (n_unknowns,) array
        The state y that it leaves.
    rest : flow.Rest or None
        Where the flow from there comes to rest or ends; None where the history ends in the state itself.
    dissipated : float
        What the potential loses up to there.
    onward : Branch or None
        The branch that it goes on with.
    fraction : float
        When, as a fraction of the leg.
    set_out : (n_unknowns,) array or None
        Where its flow begins, if not in the state that it leaves.
    """

    kind: EventKind
    before: FloatArray
    rest: flow.Rest | None = None
    dissipated: float = 0.0
    onward: Branch | None = None
    fraction: float = 0.0
    set_out: FloatArray | None = None

    @property
    def runs_away(self) -> bool:
        """Whether the flow has no end."""
        return self.rest is not None and self.rest.end == EventKind.RUNAWAY

    @property
    def start(self) -> FloatArray:
        """The state y in which its flow begins."""
        return self.before if self.set_out is None else self.set_out

    def ending(self, group: Group, rest: flow.Rest) -> Exit:
        """The same flow of a group where it ends elsewhere."""
        return replace(self, rest=rest, dissipated=_lost(group.equations, self.before, rest))

    def falls_further_than(self, other: Exit) -> bool:
        """Whether the potential falls further here, and not by rounding alone."""
        here, there = (math.inf if exit.runs_away else exit.dissipated for exit in (self, other))
        return here > there + _ROUNDING * abs(there)

    @property
    def landing(self) -> FloatArray | None:
        """The state y in which it comes to rest; None where the history ends before."""
        return None if self.rest is None or self.rest.end is not None else self.rest.state


@dataclass(frozen=True)
class Response:
    """A group's response to a leg of the drive: the branch it starts on, and its exits.

    `branch` is None where it cannot start. `failure` is why the response could not be found to its end; the
    exits before that are right.
    """

    group: Group
    branch: Branch | None
    exits: tuple[Exit, ...]
    failure: Exception | None = None


@dataclass
class Atlas:
    """The branches known in a run, by what groups have alike, and what it cost to find them."""

    rtol: float
    effort: Effort = field(default_factory=Effort)
    branches: dict[Alike, list[Branch]] = field(default_factory=dict)
    exits: dict[tuple[Branch, float], Exit] = field(default_factory=dict)

    def branch_at(self, group: Group, state: FloatArray) -> Branch:
        """The branch through a stable state: a known one if it is on one."""
        known = self.branches.setdefault(group.alike, [])
        v = float(state[-1])
        for branch in known:
            low, high = branch.known_range()
            if low <= v <= high:
                gap = np.abs(branch.state_at(v) - state) / group.equations.scales
                if gap.max() < 1e-8:
                    return branch
        known.append(Branch.through(group.equations, group.conditions, state))
        return known[-1]

    def response(self, group: Group, state: FloatArray, waveform: Waveform) -> Response:
        """Follow a group's branches through a waveform from a state at its start."""
        values = waveform.values
        moves = int(np.argmax(values != values[0]))
        if loses_tension(group.equations, state, float(values[moves])):
            begins = float(waveform.fractions[moves - 1])
            waits = self.branch_at(group, state) if begins > 0.0 else None
            return Response(group, waits, (Exit(EventKind.LOSS_OF_TENSION, state, fraction=begins),))
        rise = _first_rise(group.equations, state, values)
        if rise is not None:
            values = np.append(values[: rise[0] + 1], rise[1])
        highest = np.maximum.accumulate(values[::-1])[::-1]
        lowest = np.minimum.accumulate(values[::-1])[::-1]
        first = self.branch_at(group, state)
        branch: Branch | None = first
        exits: list[Exit] = []
        part = 0
        try:
            while branch is not None:
                low, high = branch.known_range()
                outside = (values[part + 1 :] < low) | (values[part + 1 :] > high)
                if not outside.any():
                    break
                part += int(np.argmax(outside))
                target = float(values[part + 1])
                rising = target > high
                end = self.reach(branch, target, float(highest[part + 1] if rising else lowest[part + 1]))
                if end is not None:
                    found = self.leave(group, branch, end, 1.0 if rising else -1.0)
                    exits.append(replace(found, fraction=waveform.when(part, float(end.state[-1]))))
                    branch = found.onward
            if rise is not None and branch is not None:
                there = branch.state_at(rise[1])
                exits.append(Exit(EventKind.LOSS_OF_TENSION, there, fraction=waveform.when(*rise)))
        except (ArithmeticError, np.linalg.LinAlgError) as failure:
            return Response(group, first, tuple(exits), failure)
        return Response(group, first, tuple(exits))

    def reach(self, branch: Branch, target: float, furthest: float) -> BranchEnd | None:
        """Follow a branch as far as the waveform needs it; return its end if that comes before `target`."""
        _end_where_slack(branch, furthest)
        try:
            branch.reach(furthest, self.rtol, self.effort)
        except PathError:
            # What lies beyond the target may never be needed.
            if furthest == target:
                raise
        return branch.reach(target, self.rtol, self.effort)

    def leave(self, group: Group, branch: Branch, end: BranchEnd, direction: float) -> Exit:
        """How the end of a branch is left, found once."""
        key = (branch, direction)
        if key not in self.exits:
            self.exits[key] = self._way_out(group, end, direction)
        return self.exits[key]

    def _way_out(self, group: Group, end: BranchEnd, direction: float) -> Exit:
        equations, others = group.equations, group.conditions[1:]
        if end.kind != EventKind.LIMIT_POINT:
            return Exit(EventKind(end.kind), end.state)
        if is_fold(equations, end.state):
            escape = escape_direction(equations, end.state, direction)
            rest = flow.snap(equations, others, end.state, escape, self.effort)
            return self._arriving(group, EventKind.LIMIT_POINT, end.state, rest)
        return self._past_branch_point(group, end.state, direction)

    def _arriving(self, group: Group, kind: EventKind, before: FloatArray, rest: flow.Rest) -> Exit:
        """Off a branch and, where the flow comes to rest, onto another."""
        onward = None if rest.end is not None else self.branch_at(group, rest.state)
        return Exit(kind, before, rest, _lost(group.equations, before, rest), onward)

    def _past_branch_point(self, group: Group, point: FloatArray, direction: float) -> Exit:
        """How it goes on from a branch point: gradually along another branch, or by a snap.

        Of the unstable directions, equal by symmetry, the one in which the first balloon concerned grows.
        """
        equations, others = group.equations, group.conditions[1:]
        here = Exit(EventKind.BRANCH_POINT, point, flow.Rest(point, None))
        known = self.branches[group.alike]
        for branch in known:
            # Where the history came from when it passed here in the other sense.
            end = branch.upper if direction < 0.0 else branch.lower
            if end is not None and np.abs(end.state - point).max() < 1e-7 and branch.states.shape[1] > 1:
                return replace(here, onward=branch)
        escapes = parting_directions(equations, point, direction)
        for gradual in self._gradual(group, point, escapes, direction):
            if gradual is not None:
                known.append(gradual)
                return replace(here, onward=gradual)
        rest = flow.parted(equations, others, point, escapes, self.effort)
        pushed = sets_off(equations, point, direction)
        kind = EventKind.LIMIT_POINT if pushed else EventKind.BRANCH_POINT
        return self._arriving(group, kind, point, rest)

    @staticmethod
    def _gradual(
        group: Group, point: FloatArray, escapes: Sequence[FloatArray], direction: float
    ) -> Iterator[Branch | None]:
        """Branches on which it may go on gradually: what parted comes together, or parts."""
        yield Branch.straight_on(group.equations, group.conditions, point, direction)
        for escape in escapes:
            yield Branch.leaving(group.equations, group.conditions, point, escape, direction)

    def settle(self, group: Group, start: FloatArray, before: FloatArray, *, tight: bool = False) -> Exit:
        """A change at once, by the flow from `start`, which is no equilibrium.

        Parameters
        ----------
        group : Group
        start, before : (n_unknowns,) arrays
            Where the flow starts, and the state that is recorded.
        tight : bool
            Integrate tightly from the start.
        """
        equations, others = group.equations, group.conditions[1:]
        broken = [c.kind for c in others if c.margin(start.tolist()) < 0.0]
        if broken:
            # The pressure of a liquid has changed with the voltage.
            at_once = flow.Rest(np.array(equations.admitted(start.tolist())), broken[0])
            return Exit(EventKind.JUMP, before, at_once, _lost(equations, before, at_once), set_out=start)
        rest = flow.relax(equations, others, start, self.effort, tight=tight)
        return Exit(EventKind.JUMP, before, rest, _lost(equations, before, rest), set_out=start)


def _lost(equations: AnyEquations, before: FloatArray, rest: flow.Rest) -> float:
    """What the potential loses in a flow; of one without an end, nothing is booked."""
    if rest.end == EventKind.RUNAWAY:
        return 0.0
    return float(equations.potential(before.tolist())) - float(equations.potential(rest.state.tolist()))


def loses_tension(equations: Equations, state: FloatArray, target: float) -> bool:
    """Whether tension is lost at once: valve closed, no pressure, and it would fall towards `target`."""
    if not is_empty(equations, state):
        return False
    v = float(state[-1])
    if equations.can_go_slack:
        shares = _pressure_shares(equations, state)
        if abs(shares.sum()) > _CANCELS * np.abs(shares).sum():
            return bool(shares.sum() * (target - v) < 0.0)
    # Voltages that are off do not count at first order; in a vacuum no pressure could fall.
    return any(m.drive is not None and m.drive.grows(v, target) for m in equations.membranes)


def jumps_slack(equations: Equations, state: FloatArray, old: float) -> bool:
    """Whether the pressure falls from none as stretches set off from `state`, where v has jumped from `old`.

    That of a liquid changes at once.
    """
    if not equations.has_pressure:
        return False
    at_once = float(equations.admitted(state.tolist())[-2])
    if at_once != state[-2] or not is_empty(equations, state):
        return at_once < 0.0
    if not equations.can_go_slack:
        drives = [m.drive for m in equations.membranes if m.drive is not None]
        return any(abs(drive.at(float(state[-1]))) > abs(drive.at(old)) for drive in drives)
    return bool(consistent(equations, state)[1][-1] < 0.0)


def is_empty(equations: Equations, state: FloatArray) -> bool:
    """Whether the valve is closed and there is no pressure."""
    return equations.has_pressure and not equations.is_open and bool(state[-2] <= _NO_PRESSURE)


def _pressure_shares(equations: Equations, state: FloatArray) -> FloatArray:
    """What each equation contributes to dp/dv along the path."""
    rows = np.array(equations.linearised(state.tolist())[1], dtype=float)
    only_pressure = np.zeros(len(rows))
    only_pressure[-1] = 1.0
    shares: FloatArray = -np.linalg.solve(rows[:, :-1].T, only_pressure) * rows[:, -1]
    return shares


def _first_rise(equations: Equations, state: FloatArray, values: FloatArray) -> tuple[int, float] | None:
    """In which part of a waveform, and at which v, a drive first rises of balloons in which there is nothing.

    Sealed at no pressure in a vacuum they stay without pressure, and lose their tension there.
    """
    if not equations.has_pressure or equations.is_open or equations.can_go_slack or state[-2] > _NO_PRESSURE:
        return None
    return first_rise((m.drive for m in equations.membranes if m.drive is not None), values)


def _end_where_slack(branch: Branch, target: float) -> None:
    """End a branch that was begun without pressure, on the side on which it would lose its tension."""
    low, high = branch.known_range()
    first, last = branch.states[:, 0], branch.states[:, -1]
    if target > high and branch.upper is None and loses_tension(branch.equations, last, target):
        branch.upper = BranchEnd(EventKind.LOSS_OF_TENSION, last.copy())
    if target < low and branch.lower is None and loses_tension(branch.equations, first, target):
        branch.lower = BranchEnd(EventKind.LOSS_OF_TENSION, first.copy())


def by_time(responses: Sequence[Response], resolution: float) -> list[tuple[float, dict[int, Exit]]]:
    """All exits in order of time, those of one instant together, keyed by the place of their response.

    Parameters
    ----------
    responses : sequence of Response
    resolution : float
        Fractions of the leg closer than this are one instant.
    """
    merged: list[tuple[float, dict[int, Exit]]] = []
    found = [(exit.fraction, place, exit) for place, one in enumerate(responses) for exit in one.exits]
    for fraction, place, exit in sorted(found, key=lambda item: item[0]):
        if merged and fraction - merged[-1][0] <= resolution and place not in merged[-1][1]:
            merged[-1][1][place] = exit
        else:
            merged.append((fraction, {place: exit}))
    return [(fraction, _at_once(responses, exits)) for fraction, exits in merged]


def _at_once(responses: Sequence[Response], exits: dict[int, Exit]) -> dict[int, Exit]:
    """Exits of one instant: where the flow of one ends the history, the others are on their way still."""
    stays = any(exit.rest is None for exit in exits.values())
    if len(exits) == 1 or stays or all(exit.landing is not None for exit in exits.values()):
        return exits
    if all(exit.runs_away for exit in exits.values()):
        return exits  # none of them arrives anywhere
    return _snaps_together({place: responses[place].group for place in exits}, exits)


def _snaps_together(groups: Mapping[int, Group], exits: Mapping[int, Exit]) -> dict[int, Exit]:
    """Snaps of single balloons that begin at one instant, up to where the first of them ends the history."""
    from simulator.simulation.common_flow import first_end  # few histories end so

    flowing = [replace(groups[place], members=(number,)) for number, place in enumerate(exits)]
    starts = []
    for exit in exits.values():
        assert exit.rest is not None
        starts.append(exit.before[0] + _OFF * np.sign(exit.rest.state[0] - exit.before[0]))
    v = float(next(iter(exits.values())).before[-1])
    kind, stretch = first_end(flowing, np.array(starts), v, Effort())
    return {
        place: replace(exit.ending(groups[place], flow.Rest(np.array([x, v]), kind)), onward=None)
        for (place, exit), x in zip(exits.items(), stretch.tolist(), strict=True)
    }
