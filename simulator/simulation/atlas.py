"""One set of equations walks through a waveform: along a branch, off its end, along the next.

All branches met in a run are kept in an `Atlas`. A branch is followed once, however often a history
comes back to it, and so is the way out at each of its ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from simulator.model.drive import Waveform
from simulator.model.equations import SealedBalloons
from simulator.model.groups import AnyEquations, Group
from simulator.model.membranes import ChargedMembrane, ElectrodedMembrane, OscillatingMembrane
from simulator.solver import flow
from simulator.solver.branch import Branch, BranchEnd, beside
from simulator.solver.follow import PathError
from simulator.solver.ida import Effort
from simulator.solver.singular import escape_direction, is_fold, parting_direction

FloatArray = NDArray[np.float64]

_SOON = 1e-4  # of a period: where it is seen whether a voltage rises

LOSS_OF_TENSION = "loss_of_tension"


@dataclass(frozen=True)
class Happening:
    """An event of one set of equations, both sides as states y; `after` is None where the history ends."""

    kind: str
    before: FloatArray
    after: FloatArray | None = None
    dissipated: float | None = None


@dataclass(frozen=True)
class Turn:
    """What happens to a group at one instant: one or two happenings, and the branch it goes on with."""

    fraction: float
    happenings: tuple[Happening, ...]
    onward: Branch | None


@dataclass(frozen=True)
class Walk:
    """A group's way through one step: the branch it starts on (None where it cannot), and its turns.

    `failure` is why it could not be walked to its end; the turns before that are right.
    """

    group: Group
    branch: Branch | None
    turns: tuple[Turn, ...]
    failure: Exception | None = None


@dataclass
class Atlas:
    """The branches known in a run, by their equations, and what it cost to find them."""

    rtol: float
    effort: Effort = field(default_factory=Effort)
    branches: dict[AnyEquations, list[Branch]] = field(default_factory=dict)
    exits: dict[tuple[int, float], tuple[tuple[Happening, ...], Branch | None]] = field(default_factory=dict)

    def branch_at(self, group: Group, state: FloatArray) -> Branch:
        """The branch through a stable state: a known one if it is on one."""
        known = self.branches.setdefault(group.equations, [])
        v = float(state[-1])
        for branch in known:
            low, high = branch.known_range()
            if low <= v <= high:
                gap = np.abs(branch.state_at(v) - state) / group.equations.scales
                if gap.max() < 1e-8:
                    return branch
        known.append(Branch.through(group.equations, group.conditions, state))
        return known[-1]

    def walk(self, group: Group, state: FloatArray, waveform: Waveform) -> Walk:
        """Follow a group's branches through a waveform from a state at its start."""
        values = waveform.values
        if loses_tension(group.equations, state, float(values[np.argmax(values != values[0])])):
            return Walk(group, None, (Turn(0.0, (Happening(LOSS_OF_TENSION, state),), None),))
        highest = np.maximum.accumulate(values[::-1])[::-1]
        lowest = np.minimum.accumulate(values[::-1])[::-1]
        first = self.branch_at(group, state)
        branch: Branch | None = first
        turns: list[Turn] = []
        leg = 0
        try:
            while branch is not None:
                low, high = branch.known_range()
                outside = (values[leg + 1 :] < low) | (values[leg + 1 :] > high)
                if not outside.any():
                    break
                leg += int(np.argmax(outside))
                target = float(values[leg + 1])
                rising = target > high
                end = self._reach(branch, target, float(highest[leg + 1] if rising else lowest[leg + 1]))
                if end is not None:
                    found, onward = self._leave(group, branch, end, 1.0 if rising else -1.0)
                    turns.append(Turn(waveform.when(leg, float(end.state[-1])), found, onward))
                    branch = onward
        except (ArithmeticError, np.linalg.LinAlgError) as failure:
            return Walk(group, first, tuple(turns), failure)
        return Walk(group, first, tuple(turns))

    def _reach(self, branch: Branch, target: float, furthest: float) -> BranchEnd | None:
        """Follow a branch as far as the waveform needs it; return its end if that comes before `target`."""
        try:
            branch.reach(furthest, self.rtol, self.effort)
        except PathError:
            # What lies beyond the target may never be needed.
            if furthest == target:
                raise
        return branch.reach(target, self.rtol, self.effort)

    def _leave(
        self, group: Group, branch: Branch, end: BranchEnd, direction: float
    ) -> tuple[tuple[Happening, ...], Branch | None]:
        """What happens at the end of a branch, and the branch it goes on with."""
        key = (id(branch), direction)
        if key not in self.exits:
            self.exits[key] = self._way_out(group, end, direction)
        return self.exits[key]

    def _way_out(
        self, group: Group, end: BranchEnd, direction: float
    ) -> tuple[tuple[Happening, ...], Branch | None]:
        equations, others = group.equations, group.conditions[1:]
        if end.kind != "limit_point":
            return (Happening(end.kind, end.state),), None
        if is_fold(equations, end.state):
            escape = escape_direction(equations, end.state, direction)
            rest = flow.snap(equations, others, end.state, escape, self.effort)
            found = arrivals(equations, "limit_point", end.state, rest)
            return found, None if rest.end is not None else self.branch_at(group, rest.state)
        return self._past_branch_point(group, end.state, direction)

    def _past_branch_point(
        self, group: Group, point: FloatArray, direction: float
    ) -> tuple[tuple[Happening, ...], Branch | None]:
        """How it goes on from a branch point: gradually along another branch, or by a snap.

        Of the unstable directions, equal by symmetry, the one in which the first balloon concerned grows.
        """
        equations, others = group.equations, group.conditions[1:]
        here = (Happening("branch_point", point, point, 0.0),)
        known = self.branches[equations]
        for branch in known:
            # Where the history came from when it passed here in the other sense.
            end = branch.upper if direction < 0.0 else branch.lower
            if end is not None and np.abs(end.state - point).max() < 1e-7 and branch.states.shape[1] > 1:
                return here, branch
        escape = parting_direction(equations, point)
        for sense in (escape, -escape):
            gradual = Branch.leaving(equations, group.conditions, point, sense, direction)
            if gradual is not None:
                known.append(gradual)
                return here, gradual
        # The branch goes back in v and is unstable; seen from there the state at this v is carried away.
        start = beside(equations, point, escape)[0][:, 0]
        start[-1] = point[-1]
        rest = flow.relax(equations, others, start, self.effort, tight=True)
        found = arrivals(equations, "branch_point", point, rest)
        return found, None if rest.end is not None else self.branch_at(group, rest.state)

    def settle(
        self, group: Group, kind: str, start: FloatArray, before: FloatArray, *, tight: bool = False
    ) -> Turn:
        """A change at once: the flow from `start`, no equilibrium; `before` is the state recorded."""
        equations, others = group.equations, group.conditions[1:]
        broken = [c.kind for c in others if c.margin(start.tolist()) < 0.0]
        if broken:
            return Turn(0.0, (Happening(kind, before, start, 0.0), Happening(broken[0], start)), None)
        rest = flow.relax(equations, others, start, self.effort, tight=tight)
        return Turn(0.0, arrivals(equations, kind, before, rest), None)


def arrivals(
    equations: AnyEquations, kind: str, before: FloatArray, rest: flow.Rest
) -> tuple[Happening, ...]:
    """A flow as happenings: the jump, and what ended it on the way, if anything did."""
    if rest.end == "runaway":
        return (Happening(kind, before), Happening("runaway", before))
    lost = float(equations.potential(before.tolist())) - float(equations.potential(rest.state.tolist()))
    jump = Happening(kind, before, rest.state, lost)
    return (jump,) if rest.end is None else (jump, Happening(rest.end, rest.state))


def loses_tension(equations: AnyEquations, state: FloatArray, target: float) -> bool:
    """Whether tension is lost at once: no pressure, valve closed, a drive rising towards `target`."""
    if not isinstance(equations, SealedBalloons) or state[-2] > 0.0:
        return False
    v = float(state[-1])
    for membrane in equations.membranes:
        if isinstance(membrane, ElectrodedMembrane | ChargedMembrane):
            now, change = membrane.offset + membrane.rate * v, membrane.rate * (target - v)
        elif isinstance(membrane, OscillatingMembrane):
            now = membrane.voltage(v)
            change = membrane.voltage(v + _SOON * (target - v)) - now
        else:
            continue
        if now * change > 0.0 or (now == 0.0 and change != 0.0):
            return True
    return False


def is_slack(equations: AnyEquations, state: FloatArray) -> bool:
    """Whether stretches under a changed drive need a pressure below zero: of a liquid it changes at once."""
    return equations.has_pressure and float(equations.admitted(state.tolist())[-2]) < 0.0


def by_time(walks: Sequence[Walk], resolution: float) -> list[tuple[float, dict[int, Turn]]]:
    """The turns of all walks in order of time, those of one instant together, keyed by the walk's place."""
    merged: list[tuple[float, dict[int, Turn]]] = []
    turns = [(turn.fraction, place, turn) for place, walk in enumerate(walks) for turn in walk.turns]
    for fraction, place, turn in sorted(turns, key=lambda item: item[0]):
        if merged and fraction - merged[-1][0] <= resolution and place not in merged[-1][1]:
            merged[-1][1][place] = turn
        else:
            merged.append((fraction, {place: turn}))
    return merged
