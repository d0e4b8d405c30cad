"""Where the balloons of an equilibrium path stop being spheres, or are spheres again."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulator.analysis.path import PathPoints
from simulator.events import EventKind
from simulator.model.conditions import Condition, shape_conditions
from simulator.model.groups import AnyEquations, Group
from simulator.solver import newton
from simulator.solver.follow import PathError
from simulator.solver.newton import NotConverged

FloatArray = NDArray[np.float64]

_CLOSER = 17  # states on each side of a dip at which a margin is looked at again
_MOST_HALVINGS = 40


@dataclass(frozen=True)
class ShapePoint:
    """A state (n_unknowns,) of a path in which a balloon's margin vanishes, and what that is along it."""

    kind: EventKind
    arclength: float
    state: FloatArray
    balloon: int
    mode: str


def lost_on(group: Group, states: FloatArray) -> NDArray[np.bool_]:
    """In which of n states (n_unknowns, n) some balloon of a group is no sphere, (n,)."""
    lost = np.zeros(states.shape[1], dtype=bool)
    for one in shape_conditions(group.equations):
        lost |= np.broadcast_to(np.asarray(one.condition.margin(states)) < 0.0, lost.shape)
    return lost


def shape_points(group: Group, points: PathPoints) -> list[ShapePoint]:
    """All changes of shape on a path, in order of arclength.

    Raises
    ------
    PathError
        Where a margin changes its sign and no state is found.
    """
    found = [
        ShapePoint(kind, arclength, state, group.members[one.place], one.mode)
        for one in shape_conditions(group.equations)
        for kind, arclength, state in _changes(group.equations, one.condition, points)
    ]
    return sorted(found, key=lambda point: point.arclength)


def _changes(
    equations: AnyEquations, condition: Condition, points: PathPoints
) -> Iterator[tuple[EventKind, float, FloatArray]]:
    """Where one margin vanishes: what that is, at which arclength, and the state."""
    states, arcs = _looked_at(equations, condition, points)
    margins = _margins(condition, states)
    for k in np.flatnonzero(margins[:-1] * margins[1:] < 0.0).tolist():
        state = _polished(equations, condition, states[:, k], states[:, k + 1])
        ends = (states[:, k], states[:, k + 1])
        before, after = (np.linalg.norm((state - end) / equations.scales) for end in ends)
        share = float(before / (before + after))
        lost = margins[k + 1] < 0.0
        kind = EventKind.LOSS_OF_SPHERICITY if lost else EventKind.SPHERICITY_REGAINED
        yield kind, float(arcs[k] + share * (arcs[k + 1] - arcs[k])), state


def _looked_at(
    equations: AnyEquations, condition: Condition, points: PathPoints
) -> tuple[FloatArray, FloatArray]:
    """The states of a path with their arclengths, and more of them where a margin dips towards zero."""
    states, arcs = points.states, points.arclength
    margins = _margins(condition, states)
    size = np.abs(margins)
    dips = 1 + np.flatnonzero((size[1:-1] < size[:-2]) & (size[1:-1] <= size[2:]))
    pieces, lengths, since = [], [], 0
    for k in dips.tolist():
        left, here, right = margins[k - 1 : k + 2]
        slope, bend = 0.5 * (right - left), right - 2.0 * here + left
        same = left * here > 0.0 and here * right > 0.0
        # The bottom of the parabola through three samples, and as much again.
        if not (same and bend * here > 0.0 and (here - slope * slope / bend) * here <= 0.0):
            continue
        for low in (k - 1, k):
            share = np.arange(1, _CLOSER + 1) / (_CLOSER + 1.0)
            step = states[:, low + 1] - states[:, low]
            guesses = states[:, low, None] + share * step[:, None]
            normals = np.repeat((step / equations.scales**2)[:, None], _CLOSER, axis=1)
            try:
                between = newton.on_planes(equations, guesses, normals)[0]
            except NotConverged as failure:
                raise PathError(f"a margin of shape near v = {states[-1, k]:.12g}") from failure
            pieces += [states[:, since : low + 1], between]
            lengths += [arcs[since : low + 1], arcs[low] + share * (arcs[low + 1] - arcs[low])]
            since = low + 1
    return np.concatenate([*pieces, states[:, since:]], axis=1), np.concatenate([*lengths, arcs[since:]])


def _margins(condition: Condition, states: FloatArray) -> FloatArray:
    values = np.asarray(condition.margin(states), dtype=np.float64)
    return np.array(np.broadcast_to(values, states.shape[1:]))


def _polished(
    equations: AnyEquations, condition: Condition, left: FloatArray, right: FloatArray
) -> FloatArray:
    """The state between two of a path, at which a margin has unlike signs, at which it vanishes."""
    for _ in range(_MOST_HALVINGS):
        before, after = (float(condition.margin(y.tolist())) for y in (left, right))
        guess = left + before / (before - after) * (right - left)
        width = float(np.linalg.norm((right - left) / equations.scales))
        try:
            found = newton.at_event(equations, condition, guess)
        except NotConverged:
            pass  # from closer by
        else:
            if np.linalg.norm((found - guess) / equations.scales) <= width + 1e-9:
                return found
        chord = (right - left) / equations.scales**2
        try:
            middle = newton.on_planes(equations, 0.5 * (left + right)[:, None], chord[:, None])[0][:, 0]
        except NotConverged:
            break
        if before * float(condition.margin(middle.tolist())) > 0.0:
            left = middle
        else:
            right = middle
    raise PathError(f"the state at a {condition.kind} was not found near v = {left[-1]:.12g}")
