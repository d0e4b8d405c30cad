"""Whether the balloons stay spheres: where each would turn into a pear.

Every history is that of spheres. Beside it, this module looks at the margin of sphericity of each balloon
(`model.conditions.shape_conditions`). Along the branches it is looked at on the path in outline. A change of
sign is bracketed by points of the branch, and the state where it vanishes is Newton's on
[residual, margin] = 0. A branch is looked at once, however often a history passes along it.
"""

from __future__ import annotations

import contextlib
import math
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from simulator.events import EventKind
from simulator.model.conditions import Condition, ShapeCondition, shape_conditions
from simulator.model.drive import Waveform
from simulator.model.equations import Equations
from simulator.model.groups import AnyEquations, Group
from simulator.simulation.atlas import Exit, Response
from simulator.simulation.parts import parts_of
from simulator.solver import newton
from simulator.solver.branch import Branch
from simulator.solver.flow import Rest

FloatArray = NDArray[np.float64]

_BETWEEN = 3  # states between two points of a branch at which a margin is looked at first
_CLOSER = 33  # and in a dip
_WITHIN = 129  # stretches between the smallest and the largest of a flow
_MOST_HALVINGS = 50
_SAME = 1e-9  # of the voltage, or whatever moves, over its natural size: crossings that are one


@dataclass(frozen=True)
class ShapeChange:
    """A balloon that would stop being a sphere in a state, or be one again.

    Attributes
    ----------
    kind : EventKind
    balloon : int
    mode : {"pear", "shear"}
    before : (n_unknowns,) array
        The state y of its equations in which it happens, on a branch.
    fraction : float
        Of the leg.
    place : int
        Of its group.
    """

    kind: EventKind
    balloon: int
    mode: str
    before: FloatArray = field(default_factory=lambda: np.empty(0))
    fraction: float = 0.0
    place: int = 0


@dataclass(frozen=True)
class _Crossing:
    """Where a margin vanishes on a branch, and whether it falls there as v rises."""

    v: float
    state: FloatArray
    falls: bool


@dataclass
class ShapeWatch:
    """What is known of the balloons' shapes in a run: which are spheres now, and where branches lose it."""

    lost: set[tuple[int, str]] = field(default_factory=set)
    charged: frozenset[int] = frozenset()  # balloons that have a charge which is not in their equations
    _crossings: dict[tuple[Branch, int, int, str], list[_Crossing]] = field(default_factory=dict)
    _conditions: dict[AnyEquations, tuple[ShapeCondition, ...]] = field(default_factory=dict)

    def conditions(self, group: Group) -> tuple[ShapeCondition, ...]:
        """What keeps the balloons of a group spheres."""
        if group.equations not in self._conditions:
            charged = [place for place, i in enumerate(group.members) if i in self.charged]
            self._conditions[group.equations] = shape_conditions(group.equations, charged)
        return self._conditions[group.equations]

    def on_the_way(self, responses: Sequence[Response], waveform: Waveform) -> list[ShapeChange]:
        """All changes on the branches of some responses, in order of time.

        Which of them are changes for the present device, `takes` says.

        Raises
        ------
        NotConverged
            Where a margin changes its sign and no state is found.
        """
        found = [
            change
            for place, response in enumerate(responses)
            for one in self.conditions(response.group)
            for change in self._along(place, response, waveform, one)
        ]
        return sorted(found, key=lambda change: change.fraction)

    def _along(
        self, place: int, response: Response, waveform: Waveform, one: ShapeCondition
    ) -> Iterator[ShapeChange]:
        balloon = response.group.members[one.place]
        for part in parts_of(response, waveform):
            crossings = self._on_branch(part.branch, one)
            for piece, start, end in part.pieces if crossings else ():
                rises = end > start
                low, high = min(start, end), max(start, end)
                passed = [c for c in crossings if low <= c.v <= high]
                for crossing in passed if rises else reversed(passed):
                    kind = (
                        EventKind.LOSS_OF_SPHERICITY
                        if crossing.falls == rises
                        else EventKind.SPHERICITY_REGAINED
                    )
                    fraction = waveform.when(piece, crossing.v)
                    yield ShapeChange(kind, balloon, one.mode, crossing.state, fraction, place)

    def _on_branch(self, branch: Branch, one: ShapeCondition) -> list[_Crossing]:
        """Where a margin vanishes on what is known of a branch, in order of rising v."""
        key = (branch, branch.states.shape[1], one.place, one.mode)
        if key not in self._crossings:
            known = branch.states.shape[1] > 1
            self._crossings[key] = _crossings(branch, one.condition) if known else []
        return self._crossings[key]

    def in_exit(self, group: Group, exit: Exit) -> Iterator[ShapeChange]:
        """What a flow changes: shapes that are lost or regained on its way.

        Where in between that is depends on the flow, which is followed only as well as its end needs it. That
        it happens does not: at a given drive a margin is a function of one stretch, which passes all values
        between those it has.
        """
        if exit.rest is None or exit.runs_away:
            return
        for one in self.conditions(group):
            balloon, margin = group.members[one.place], one.condition.margin
            gone = (balloon, one.mode) in self.lost
            ends_lost = float(margin(exit.rest.state.tolist())) < 0.0
            if not gone and not ends_lost and _vanishes_between(one, exit.start, exit.rest):
                yield ShapeChange(EventKind.LOSS_OF_SPHERICITY, balloon, one.mode)
                gone = True
            if gone != ends_lost:
                kind = EventKind.LOSS_OF_SPHERICITY if ends_lost else EventKind.SPHERICITY_REGAINED
                yield ShapeChange(kind, balloon, one.mode)

    def ahead(self) -> ShapeWatch:
        """The same as it is now, to look ahead with."""
        return ShapeWatch(set(self.lost), self.charged, self._crossings, self._conditions)

    def first_loss(self, responses: Sequence[Response], waveform: Waveform) -> tuple[ShapeChange, int] | None:
        """The first loss in some responses, and how many exits of its response come before or with it.

        In a flow its state is empty. What is known of the shapes is brought to there.
        """
        changes = deque(self.on_the_way(responses, waveform))
        exits = sorted(
            (exit.fraction, place, number)
            for place, response in enumerate(responses)
            for number, exit in enumerate(response.exits)
        )
        for until, place, number in [*exits, (math.inf, -1, 0)]:
            while changes and changes[0].fraction <= until:
                change = changes.popleft()
                if self.takes(change) and change.kind is EventKind.LOSS_OF_SPHERICITY:
                    passed = responses[change.place].exits
                    return change, sum(exit.fraction < change.fraction for exit in passed)
            if place < 0:
                continue
            for change in self.in_exit(responses[place].group, responses[place].exits[number]):
                if self.takes(change) and change.kind is EventKind.LOSS_OF_SPHERICITY:
                    return replace(change, fraction=until, place=place), number + 1
        return None

    def in_state(
        self, group: Group, state: FloatArray, added: Callable[[ShapeCondition], float] = lambda one: 0.0
    ) -> Iterator[ShapeChange]:
        """What the shapes of a group's balloons are in a state, where they were something else before.

        A balloon that nothing can take its shape, without a voltage, is a sphere. `added` is what other parts
        of the balloons add to a margin.
        """
        kept = {(group.members[one.place], one.mode) for one in self.conditions(group)}
        for balloon, mode in sorted(self.lost - kept):
            if balloon in group.members:
                yield ShapeChange(EventKind.SPHERICITY_REGAINED, balloon, mode)
        for one in self.conditions(group):
            balloon = group.members[one.place]
            margin = float(one.condition.margin(state.tolist())) + added(one)
            if (balloon, one.mode) in self.lost:
                if margin > 0.0:
                    yield ShapeChange(EventKind.SPHERICITY_REGAINED, balloon, one.mode)
            elif margin < 0.0:
                yield ShapeChange(EventKind.LOSS_OF_SPHERICITY, balloon, one.mode)

    def takes(self, change: ShapeChange) -> bool:
        """Whether a change is one for the device as it is; from then on it is as the change says."""
        key = (change.balloon, change.mode)
        loses = change.kind is EventKind.LOSS_OF_SPHERICITY
        if loses == (key in self.lost):
            return False
        self.lost.symmetric_difference_update({key})
        return True


def _vanishes_between(one: ShapeCondition, start: FloatArray, rest: Rest) -> bool:
    """Whether a margin falls below zero at any of the stretches that a flow passes."""
    seen = np.append(
        rest.path[one.place] if rest.path.size else (), (start[one.place], rest.state[one.place])
    )
    states = np.repeat(rest.state[:, None], _WITHIN, axis=1)
    states[one.place] = np.linspace(seen.min(), seen.max(), _WITHIN)
    return bool(np.min(one.condition.margin(states)) < 0.0)


def _crossings(branch: Branch, condition: Condition) -> list[_Crossing]:
    """Where a margin vanishes on a branch, in order of rising v.

    The points of the branch are exact: between two of unlike signs it does. The outline between them only
    says where to look.
    """
    outline = branch.outline(_BETWEEN)
    margins = np.broadcast_to(np.asarray(condition.margin(outline), dtype=np.float64), outline.shape[1:])
    changes = np.flatnonzero(margins[:-1] * margins[1:] < 0.0)
    found: list[_Crossing] = []
    for interval in np.unique(changes // (_BETWEEN + 1)).tolist():
        here = changes[changes // (_BETWEEN + 1) == interval]
        first = interval * (_BETWEEN + 1)
        ends = outline[:, first], outline[:, first + _BETWEEN + 1]
        if here.size == 1:
            k = int(here[0])
            found.append(_polished(branch, condition, outline[:, k], outline[:, k + 1], ends))
        else:
            found += _looked_closer(branch, condition, *ends, (_BETWEEN + 1) * _CLOSER)
    for k in _dips(margins):
        found += _looked_closer(branch, condition, outline[:, k - 1], outline[:, k + 1], _CLOSER)
    found.sort(key=lambda crossing: crossing.v)
    same = _SAME * float(branch.equations.scales[-1])
    return [
        c for c, before in zip(found, [None, *found], strict=False) if before is None or c.v - before.v > same
    ]


def _looked_closer(
    branch: Branch, condition: Condition, left: FloatArray, right: FloatArray, count: int
) -> Iterator[_Crossing]:
    """Where a margin vanishes between two states of a branch, as far as polished states between them tell."""
    states = branch.at(np.linspace(left[-1], right[-1], count))
    margins = np.broadcast_to(np.asarray(condition.margin(states), dtype=np.float64), states.shape[1:])
    for i in np.flatnonzero(margins[:-1] * margins[1:] < 0.0):
        ends = states[:, i], states[:, i + 1]
        yield _polished(branch, condition, *ends, ends)


def _dips(margins: FloatArray) -> list[int]:
    """Places of samples at which a margin dips so far that it may vanish, without a change of sign."""
    size = np.abs(margins)
    inner = size[1:-1]
    dips = 1 + np.flatnonzero((inner < size[:-2]) & (inner <= size[2:]))
    near: list[int] = []
    for k in dips.tolist():
        left, here, right = margins[k - 1 : k + 2]
        if left * here <= 0.0 or here * right <= 0.0:
            continue
        slope, bend = 0.5 * (right - left), right - 2.0 * here + left
        # The bottom of the parabola through three samples, and as much again.
        if bend * here > 0.0 and (here - slope * slope / bend) * here <= 0.0:
            near.append(k)
    return near


def _polished(
    branch: Branch,
    condition: Condition,
    left: FloatArray,
    right: FloatArray,
    ends: tuple[FloatArray, FloatArray],
) -> _Crossing:
    """The state of a branch in which a margin vanishes.

    It is between two states, the `ends`, at which the margin has unlike signs, and as far as is known between
    `left` and `right`.
    """
    nodes = branch.states[-1]
    low, high = (float(end[-1]) for end in ends)
    before, after = (float(condition.margin(y.tolist())) for y in (left, right))
    falls = float(condition.margin(ends[0].tolist())) > 0.0
    guess = left + before / (before - after) * (right - left)
    for _ in range(_MOST_HALVINGS):
        found = _state(branch.equations, condition, guess)
        if found is not None and _is_between(branch.equations, found, guess, (left, right), (low, high)):
            return _Crossing(float(np.clip(found[-1], nodes[0], nodes[-1])), found, falls)
        middle = branch.at(np.array([0.5 * (low + high)]))[:, 0]
        if (float(condition.margin(middle.tolist())) > 0.0) == falls:
            ends = middle, ends[1]
        else:
            ends = ends[0], middle
        left, right = ends
        low, high = float(left[-1]), float(right[-1])
        guess = middle
    raise newton.NotConverged("the state in which a balloon stops being a sphere was not found")


def _is_between(
    equations: Equations,
    found: FloatArray,
    guess: FloatArray,
    around: tuple[FloatArray, FloatArray],
    v: tuple[float, float],
) -> bool:
    """Whether a state is in a range of v, and as near to where it was sought as two states are apart."""
    slack = _SAME * float(equations.scales[-1])
    apart = np.max(np.abs(found - guess) / equations.scales)
    near = 2.0 * np.max(np.abs(around[1] - around[0]) / equations.scales) + _SAME
    return bool(v[0] - slack <= found[-1] <= v[1] + slack and apart <= near)


def _state(equations: Equations, condition: Condition, guess: FloatArray) -> FloatArray | None:
    """The state near a guess in which a margin vanishes; None where Newton's method finds none."""
    for method in (newton.at_crossing, newton.at_event):
        with contextlib.suppress(newton.NotConverged):
            return method(equations, condition, guess)
    return None
