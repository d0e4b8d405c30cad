"""Where a step ends before its time: the first state on its way in which a quantity takes a value.

The branches of a step are known before its samples are read (`atlas`). So nothing is integrated anew: along
each branch the quantity is looked at in polished states, its sign changes are bracketed (a dip
between samples is followed to its bottom), and the state itself is Newton's on [residual, quantity] = 0.
A value that a snap passes over ends the step when the snap has landed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from simulator.events import EventKind
from simulator.model.conditions import Condition, gradient
from simulator.model.device import Device
from simulator.model.drive import Waveform
from simulator.model.elastomers import Number
from simulator.model.equations import State
from simulator.model.groups import Group
from simulator.simulation.atlas import Response
from simulator.simulation.parts import parts_of
from simulator.simulation.present import Present
from simulator.solver import newton
from simulator.solver.branch import Branch
from simulator.solver.follow import PathError
from simulator.units import Written

if TYPE_CHECKING:
    from simulator.scenario import Until
    from simulator.simulation.shape import ShapeWatch

FloatArray = NDArray[np.float64]

_AT = 1e-12  # a relative distance from the value that is none
_BETWEEN = 6  # samples between two points of a branch
_CLOSE = 1e-4  # of the first interval: where it is seen to which side a quantity leaves its value
_MOST_HALVINGS = 60


@dataclass(frozen=True)
class WatchedValue:
    """A stretch, a true field (its size) or the pressure, and the value at which it ends a step."""

    kind: Literal["stretch", "pressure", "field"]
    balloon: int
    value: float
    label: str

    def distance(self, present: Present) -> float:
        """How far the device is from the value, relatively; the sign says on which side."""
        if self.kind == "pressure":
            return present.pressure / self.value - 1.0
        if self.kind == "stretch":
            return float(present.stretch[self.balloon]) / self.value - 1.0
        device = present.device
        place = device.electroded.index(self.balloon)
        field = device.field(present.stretch[None], present.voltage[None])[0, place]
        return float((field / self.value) ** 2 - 1.0)

    def of(self, group: Group) -> Callable[[State], Number] | None:
        """The same distance from a group's unknowns; None where the group does not move it."""
        value, equations = self.value, group.equations
        if self.kind == "pressure":
            return (lambda y: y[-2] / value - 1.0) if equations.has_pressure else None
        if self.balloon not in group.members:
            return None
        place = group.members.index(self.balloon)
        if self.kind == "stretch":
            return lambda y: y[place] / value - 1.0
        membrane = equations.membranes[place]
        if membrane.drive is None:
            return None
        return lambda y: (membrane.field(y[place], y[-1]) / value) ** 2 - 1.0


def _told(value: float) -> str:
    """A number as the scenario has it, with its unit if it has one."""
    return value.text if isinstance(value, Written) else f"{value:g}"


@dataclass(frozen=True)
class Watch:
    """What ends a step: values that are taken, and, if asked for, a limit point or a loss of sphericity."""

    values: tuple[WatchedValue, ...]
    limit_point: bool
    loss_of_sphericity: bool = False

    @classmethod
    def over(cls, until: Until, device: Device) -> Watch:
        """What a scenario's `until` names."""
        found: list[WatchedValue] = []
        kinds: tuple[tuple[Literal["stretch", "field"], float | dict[str, float] | None], ...] = (
            ("stretch", until.stretch),
            ("field", until.field),
        )
        for kind, wanted in kinds:
            if wanted is None:
                continue
            by_name = wanted if isinstance(wanted, dict) else {device.names[device.electroded[0]]: wanted}
            for name, value in by_name.items():
                label = f"{kind}_{name} = {_told(value)}"
                found.append(WatchedValue(kind, device.names.index(name), value, label))
        if until.pressure is not None:
            found.append(WatchedValue("pressure", -1, until.pressure, f"pressure = {_told(until.pressure)}"))
        turns, loses = (until.event == kind for kind in (EventKind.LIMIT_POINT, EventKind.LOSS_OF_SPHERICITY))
        return cls(tuple(found), turns, loses)

    def distances(self, present: Present) -> list[float]:
        """How far the device is from each value."""
        return [value.distance(present) for value in self.values]

    def passed(self, before: Sequence[float], after: Sequence[float]) -> str | None:
        """The first value between two sets of distances, by its label: one that a jump has passed over."""
        pairs = zip(self.values, before, after, strict=True)
        return next((value.label for value, a, b in pairs if a * b < 0.0), None)

    @property
    def labels(self) -> tuple[str, ...]:
        """What it waits for, in words."""
        turns = [EventKind.LIMIT_POINT.value] if self.limit_point else []
        loses = [EventKind.LOSS_OF_SPHERICITY.value] if self.loss_of_sphericity else []
        return (*turns, *loses, *(value.label for value in self.values))


@dataclass(frozen=True)
class EarlyEnd:
    """Where a step ends before its time.

    Attributes
    ----------
    fraction, v : float
        Of the leg, and the drive there.
    reached : str
        What was reached.
    state : (int, (n_unknowns,) array) or None
        The place of a response and its state, polished; None where the step ends after an exit.
    """

    fraction: float
    v: float
    reached: str
    state: tuple[int, FloatArray] | None


def first_end(
    watch: Watch,
    responses: Sequence[Response],
    waveform: Waveform,
    resolution: float,
    shapes: ShapeWatch | None = None,
) -> tuple[EarlyEnd | None, list[Response]]:
    """The first early end in some responses, and the responses as far as there.

    Parameters
    ----------
    watch : Watch
    responses : sequence of Response
        To the whole waveform.
    waveform : Waveform
    resolution : float
        Fractions closer than this are one.
    shapes : ShapeWatch, optional
        What is known of the balloons' shapes when the leg begins; brought to its end.

    Returns
    -------
    early_end : EarlyEnd or None
        None where the step goes on to its end, or fails before it would end early.
    responses : list of Response
    """
    found: list[tuple[float, int, int, int, EarlyEnd]] = []
    for place, response in enumerate(responses):
        if watch.limit_point:
            for number, exit in enumerate(response.exits):
                if exit.kind is EventKind.LIMIT_POINT:
                    end = EarlyEnd(exit.fraction, float(exit.before[-1]), exit.kind.value, None)
                    found.append((exit.fraction, 1, place, number + 1, end))
                    break
        for value in watch.values:
            margin = value.of(response.group)
            passage = _passage(response, waveform, margin, value.label) if margin else None
            if passage is not None:
                fraction, v, state, exits = passage
                reached = EarlyEnd(fraction, v, value.label, None if state is None else (place, state))
                found.append((fraction, 0 if state is not None else 1, place, exits, reached))
    loss = shapes.first_loss(responses, waveform) if watch.loss_of_sphericity and shapes else None
    if loss is not None:
        change, exits = loss
        place, on_branch = change.place, change.before.size > 0
        there = change.before if on_branch else responses[place].exits[exits - 1].before
        at = (place, there) if on_branch else None
        end = EarlyEnd(change.fraction, float(there[-1]), change.kind.value, at)
        found.append((change.fraction, 0 if on_branch else 1, place, exits, end))
    if not found:
        return None, list(responses)
    _, after_exit, owner, exits, early_end = min(found, key=lambda candidate: candidate[:4])
    latest = early_end.fraction + (resolution if after_exit else 0.0)
    cut = [
        _up_to(response, waveform, early_end, exits if place == owner else None, latest)
        for place, response in enumerate(responses)
    ]
    if any(response.failure is not None for response in cut):
        return None, list(responses)
    return early_end, cut


def _up_to(
    response: Response, waveform: Waveform, end: EarlyEnd, exits: int | None, latest: float
) -> Response:
    """A response as far as an early end; its failure is kept if that came before."""
    count = sum(exit.fraction <= latest for exit in response.exits) if exits is None else exits
    cut = replace(response, exits=response.exits[:count], failure=None)
    if exits is None and response.failure is not None and count == len(response.exits):
        *_, last = parts_of(response, waveform)
        low, high = last.branch.known_range()
        inside = waveform.fractions < end.fraction
        since = response.exits[-1].fraction if response.exits else 0.0
        passed = [end.v, *waveform.values[inside & (waveform.fractions > since)]]
        if not all(low <= v <= high for v in passed):
            return response
    return cut


def _passage(
    response: Response, waveform: Waveform, margin: Callable[[State], Number], label: str
) -> tuple[float, float, FloatArray | None, int] | None:
    """Where a margin first vanishes in a response.

    Fraction, v, the state (None after an exit), and the number of exits up to there.
    """
    condition = Condition(label, margin, lambda y: gradient(margin, y))
    side = 0.0
    for part in parts_of(response, waveform):
        branch = part.branch
        searched: tuple[float, float] | None = None
        for piece, start, end in part.pieces:
            known = branch.states[-1, 0], branch.states[-1, -1]
            start, target = (min(max(v, known[0]), known[1]) for v in (start, end))
            if searched is not None:
                # Nothing is met twice on one branch: only what lies beyond is looked at.
                start = min(max(target, searched[0]), searched[1])
            if start != target:
                state, side = _crossing(branch, condition, start, target, side)
                if state is not None:
                    return waveform.when(piece, float(state[-1])), float(state[-1]), state, part.number
            ends = (start, target) if searched is None else (*searched, target)
            searched = min(ends), max(ends)
        if part.exit is None or part.exit.landing is None:
            return None
        landing = part.exit.landing
        before = float(margin(part.exit.before.tolist()))
        side = side or (float(np.sign(before)) if abs(before) > _AT else 0.0)  # a branch left where it begins
        beyond = float(margin(landing.tolist()))
        if side * beyond <= 0.0 and side:
            return part.exit.fraction, float(landing[-1]), None, part.number + 1
        side = side or float(np.sign(beyond))
    return None


def _crossing(
    branch: Branch, condition: Condition, start: float, end: float, side: float
) -> tuple[FloatArray | None, float]:
    """The first state from one v to another of a branch at which a margin vanishes, and its side before.

    `side` is the sign that the margin has had so far, 0 where it has been zero.
    """
    v = _samples(branch.states[-1], start, end)
    if not side:
        v = np.insert(v, 1, v[0] + _CLOSE * (v[1] - v[0]))
    states = branch.at(v)
    margins = np.asarray(condition.margin(states), dtype=np.float64)
    if not side:
        away = np.flatnonzero(np.abs(margins) > _AT)
        if not away.size:
            return None, 0.0
        side = float(np.sign(margins[away[0]]))
        v, states, margins = v[away[0] :], states[:, away[0] :], margins[away[0] :]
    ahead = side * margins
    crossed = np.flatnonzero(ahead <= _AT)
    last = int(crossed[0]) if crossed.size else v.size - 1
    dips = 1 + np.flatnonzero((ahead[1:-1] < ahead[:-2]) & (ahead[1:-1] <= ahead[2:]))
    for middle in dips[dips < last].tolist():
        bottom = _bottom(branch, condition, side, v, states, ahead, middle)
        if bottom is None:
            continue
        value = side * float(condition.margin(bottom.tolist()))
        if value < -_AT:
            return _polished(branch, condition, states[:, middle - 1], bottom), side
        if value <= _AT:
            return bottom, side
    if not crossed.size:
        return None, side
    if last == 0 or abs(ahead[last]) <= _AT:
        return states[:, last], side
    return _polished(branch, condition, states[:, last - 1], states[:, last]), side


def _samples(nodes: FloatArray, start: float, end: float) -> FloatArray:
    """Values of v from one to another, close together at the points of a branch: v turns round at a fold."""
    low, high = min(start, end), max(start, end)
    knots = np.concatenate([[low], nodes[(nodes > low) & (nodes < high)], [high]])
    inside = 0.5 * (1.0 - np.cos(np.pi * np.arange(_BETWEEN + 1) / (_BETWEEN + 1)))
    v = np.append((knots[:-1, None] + np.diff(knots)[:, None] * inside).ravel(), high)
    return v if start < end else v[::-1]


def _bottom(
    branch: Branch,
    condition: Condition,
    side: float,
    v: FloatArray,
    states: FloatArray,
    ahead: FloatArray,
    middle: int,
) -> FloatArray | None:
    """The state at the bottom of a dip about a sample; None where a parabola says that it stays clear."""
    weights = 1.0 / branch.equations.scales[:, None]
    steps = np.linalg.norm(weights * np.diff(states[:, middle - 1 : middle + 2], axis=1), axis=0)
    first, second = np.diff(ahead[middle - 1 : middle + 2]) / steps
    curve = (second - first) / (steps[0] + steps[1])
    slope = first + curve * steps[0]
    if ahead[middle] - 0.25 * slope * slope / curve > 0.5 * ahead[middle]:
        return None
    from scipy.optimize import minimize_scalar

    def depth(at: float) -> float:
        return side * float(condition.margin(branch.at(np.array([at]))[:, 0].tolist()))

    ends = sorted((float(v[middle - 1]), float(v[middle + 1])))
    found = minimize_scalar(
        depth, bounds=ends, method="bounded", options={"xatol": 1e-10 * (ends[1] - ends[0])}
    )
    return branch.at(np.array([float(found.x)]))[:, 0]


def _polished(branch: Branch, condition: Condition, left: FloatArray, right: FloatArray) -> FloatArray:
    """The state between two of a branch at which a margin, of unlike signs at them, vanishes."""
    equations = branch.equations
    best: FloatArray | None = None
    least = np.inf
    for _ in range(_MOST_HALVINGS):
        before, after = (float(condition.margin(y.tolist())) for y in (left, right))
        guess = left + before / (before - after) * (right - left)
        width = np.max(np.abs(right - left) / equations.scales)
        try:
            found = newton.at_event(equations, condition, guess)
        except newton.NotConverged:
            pass  # from closer by
        else:
            within = (found[-1] - left[-1]) * (found[-1] - right[-1]) <= 0.0
            if within and np.max(np.abs(found - guess) / equations.scales) <= width:
                # Beside an extremum of the margin its noise is wide in v.
                size = abs(float(condition.margin(found.tolist())))
                if size < least:
                    best, least = found, size
                if size <= _AT or width <= _AT:
                    break
        middle = branch.at(np.array([0.5 * (left[-1] + right[-1])]))[:, 0]
        if before * float(condition.margin(middle.tolist())) > 0.0:
            left = middle
        else:
            right = middle
    if best is not None:
        return best
    raise PathError(f"the state at {condition.kind} was not found near v = {left[-1]:.12g}")
