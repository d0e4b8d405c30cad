"""A whole equilibrium path, through limit points and branch points: monotone pieces one after the other.

Each piece is followed with the machinery of the histories (`solver.follow`); the singular points at which the
number of unstable directions changes by one are further conditions. At a limit point v turns round and the
path is taken up again beyond it, at a branch point it goes straight on.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from simulator.model.conditions import ENDLESS, Condition, eigenvalues, singularity
from simulator.model.elastomers import Number, largest_stretch
from simulator.model.equations import State
from simulator.model.groups import AnyEquations, Group
from simulator.solver import newton, singular
from simulator.solver.follow import PathError, follow
from simulator.solver.ida import Effort
from simulator.solver.newton import NotConverged
from simulator.solver.segment import GAUSS_INTEGRALS, GAUSS_WEIGHTS, Segment, between, straight

FloatArray = NDArray[np.float64]

STRETCH_MARGIN = 1e-6  # a stretch this close to its limit ends a path
_STEPS_OFF = (1e-6, 1e-7, 1e-8)  # scaled arclength at which a path is taken up again beyond a limit point
# The same where from there the limit point itself is found again: where the path bends little, v differs by
# rounding. Farther off than what the solver takes for beside an event.
_FARTHER_OFF = (2e-3, 5e-3, 2e-2)
_STRAIGHT = 1e-6  # scaled arclength over which the path is its chord to rounding
_FARTHEST = 1e6  # v over its scale that no path gets to
_MOST_TURNS = 200
_RTOL = 1e-4
_SAME = 1e-8  # two states closer than this are one
_RESIDUAL = 1e-9  # over the size of its terms: no state of a path


@dataclass(frozen=True)
class Piece:
    """A monotone piece of path with its number of unstable directions.

    `states` (n_unknowns, n), `dense` and `speeds` (n_unknowns, n − 1, k) are those of `segment.Segment`.
    """

    states: FloatArray
    dense: FloatArray
    speeds: FloatArray
    unstable: int


@dataclass(frozen=True)
class Found:
    """A special point: its kind, how many pieces lead up to it, and its state (n_unknowns,)."""

    kind: str
    pieces: int
    state: FloatArray


@dataclass
class Path:
    """Pieces in order, the special points between and after them, and what it cost."""

    pieces: list[Piece] = field(default_factory=list)
    found: list[Found] = field(default_factory=list)
    effort: Effort = field(default_factory=Effort)

    def of_all(self, equations: AnyEquations, places: Sequence[int]) -> Path:
        """The path in more unknowns, each of which is one of these: that at a place."""
        rows = list(places)
        pieces = []
        for piece in self.pieces:
            states = piece.states[rows]
            # Not at its ends, where it may be singular.
            inner = piece.dense[rows, 0, piece.dense.shape[2] // 2] if piece.dense.size else states[:, 0]
            unstable = int(np.count_nonzero(eigenvalues(equations, inner) < 0.0))
            pieces.append(Piece(states, piece.dense[rows], piece.speeds[rows], unstable))
        found = [Found(one.kind, one.pieces, one.state[rows]) for one in self.found]
        return Path(pieces, found, self.effort)

    def points(self, scales: FloatArray) -> PathPoints:
        """All states of the pieces, at their nodes and at the Gauss points between."""
        columns, arcs = [self.pieces[0].states[:, :1]], [np.zeros(1)]
        counts, ends = [np.array([self.pieces[0].unstable])], []
        for piece in self.pieces:
            speed = np.sqrt(np.einsum("ijk,i->jk", piece.speeds**2, 1.0 / scales**2))
            # Arclength up to the Gauss points of each interval and to its end.
            steps = np.concatenate([speed @ GAUSS_INTEGRALS.T, (speed @ GAUSS_WEIGHTS)[:, None]], axis=1)
            steps[1:] += np.cumsum(steps[:-1, -1])[:, None]
            if steps.size:
                arcs.append(arcs[-1][-1] + steps.ravel())
            states = np.concatenate([piece.dense, piece.states[:, 1:, None]], axis=2)
            columns.append(states.reshape(len(states), -1))
            counts.append(np.full(steps.size, piece.unstable))
            ends.append(float(arcs[-1][-1]))
        return PathPoints(
            np.concatenate(columns, axis=1), np.concatenate(arcs), np.concatenate(counts), tuple(ends)
        )


@dataclass(frozen=True)
class PathPoints:
    """The points of a path.

    Attributes
    ----------
    states : (n_unknowns, n) array
    arclength : (n,) array
        In scaled unknowns.
    unstable : (n,) array of int
        Number of unstable directions.
    ends : tuple of float
        Arclengths at which the pieces end.
    """

    states: FloatArray
    arclength: FloatArray
    unstable: NDArray[np.int64]
    ends: tuple[float, ...]


def whole_path(
    group: Group, start: FloatArray, *, to_drive: float | None = None, stop: Condition | None = None
) -> Path:
    """The path from a state at which v begins to rise, until something ends it.

    Parameters
    ----------
    group : Group
        The equations, and what ends a branch of theirs.
    start : (n_unknowns,) array
        A state of the path.
    to_drive : float, optional
        A v at which to stop.
    stop : Condition, optional
        Another condition at which to stop.

    Raises
    ------
    PathError
        If it cannot be followed.
    """
    equations, path = group.equations, Path()
    ends = (*_ends(group), *(() if stop is None else (stop,)))
    piece, segment = _piece(equations, ends, start, True, to_drive, path.effort)
    path.pieces.append(piece)
    while True:
        state, unstable = segment.states[:, -1], path.pieces[-1].unstable
        kind = _kind(equations, segment, to_drive)
        been = any(f.kind == kind and _same(f.state, state) for f in path.found)
        if been and kind == "limit_point":
            raise PathError(f"the path comes back to its limit point at v = {state[-1]:.12g}")
        path.found.append(Found("closed" if been else kind, len(path.pieces), state))
        if been or kind not in ("limit_point", "branch_point"):
            return path
        if len(path.pieces) > 2 * _MOST_TURNS:
            raise PathError(f"the path turns more than {_MOST_TURNS} times")
        off, piece, segment = _beyond(
            equations, ends, state, segment.tangents[:, -1], unstable, to_drive, path.effort
        )
        path.pieces += [off, piece]


def stretch_stop(kind: str, place: int, value: float, sign: float) -> Condition:
    """The condition that a stretch, the unknown at a place, gets to a value: from below (sign 1) or above."""

    def margin(y: State) -> Number:
        return sign * (value - y[place])

    def slope(y: FloatArray) -> FloatArray:
        out = np.zeros(y.size)
        out[place] = -sign
        return out

    return Condition(kind, margin, slope)


def _ends(group: Group) -> Iterator[Condition]:
    """What ends a path besides zero voltage: slack membranes, a stretch at its limit, the end of a measured
    curve.
    """
    ending = ("loss_of_tension", "out_of_range")
    yield from (condition for condition in group.conditions if condition.kind in ending)
    for place, wall in enumerate(group.equations.walls):
        limit = wall.elastomer.stretch_limit
        if np.isfinite(limit):
            yield stretch_stop("stretch_limit", place, limit - STRETCH_MARGIN, 1.0)
        elif not np.isfinite(largest_stretch(wall.elastomer)):
            yield stretch_stop("unbounded", place, ENDLESS, 1.0)


def _piece(
    equations: AnyEquations,
    ends: Sequence[Condition],
    state: FloatArray,
    rising: bool,
    to_drive: float | None,
    effort: Effort,
) -> tuple[Piece, Segment]:
    """The monotone piece from a regular state on, with v rising or falling."""
    sizes = eigenvalues(equations, state)
    unstable = int(np.count_nonzero(sizes < 0.0))
    # The singular points at which the number of unstable directions goes down or up by one.
    down = (singularity(equations, unstable - 1, -1.0),) if unstable else ()
    up = (singularity(equations, unstable, 1.0),) if unstable < sizes.size else ()
    target = _target(equations.scales[-1], float(state[-1]), rising, to_drive)
    segment = follow(equations, (*down, *up, *ends), state, target, _RTOL, effort)
    return Piece(segment.states, segment.dense, segment.speeds, unstable), segment


def _target(scale: float, v: float, rising: bool, wanted: float | None) -> float:
    """The v that ends a piece: the one asked for where it lies ahead, zero voltage, or out of reach."""
    if wanted is not None and (wanted > v) == rising and wanted != v:
        return wanted
    return _FARTHEST * scale if rising else 0.0


def _kind(equations: AnyEquations, segment: Segment, to_drive: float | None) -> str:
    """What a piece ended with. Raises PathError where its last state is none."""
    state = segment.states[:, -1]
    residual, sizes = (np.array(part) for part in (equations.residual(state), equations.term_sizes(state)))
    if not np.all(np.abs(residual) <= _RESIDUAL * np.maximum(sizes, _RESIDUAL)):
        raise PathError(f"no state of the path at v = {state[-1]:.12g}, where it ends")
    if segment.end == "limit_point":
        return "limit_point" if singular.is_fold(equations, state) else "branch_point"
    if segment.end is not None:
        return str(segment.end)
    if to_drive is not None and state[-1] == to_drive:
        return "reached"
    return "zero_voltage" if state[-1] == 0.0 else "unbounded"


def _same(one: FloatArray, other: FloatArray) -> bool:
    return bool(np.all(np.abs(one - other) < _SAME * np.maximum(np.abs(one), 1.0)))


def _beyond(
    equations: AnyEquations,
    ends: Sequence[Condition],
    point: FloatArray,
    tangent: FloatArray,
    unstable: int,
    to_drive: float | None,
    effort: Effort,
) -> tuple[Piece, Piece, Segment]:
    """The path beyond a singular point: the short piece off it, and the piece from there on."""
    failure: PathError | None = None
    for lengths in (_STEPS_OFF, *((length,) for length in _FARTHER_OFF)):
        off = next(
            (
                found
                for length in lengths
                if (found := _off(equations, ends, point, length * tangent, unstable))
            ),
            None,
        )
        if off is None:
            continue
        state = off.states[:, -1]
        try:
            piece, segment = _piece(equations, ends, state, bool(state[-1] > point[-1]), to_drive, effort)
        except PathError as error:
            failure = error
            continue
        if segment.end != "limit_point" or not _same(segment.states[:, -1], point):
            return off, piece, segment
    raise PathError(f"the path cannot be taken up again beyond v = {point[-1]:.12g}") from failure


def _off(
    equations: AnyEquations, ends: Sequence[Condition], point: FloatArray, step: FloatArray, unstable: int
) -> Piece | None:
    """The piece from a singular point to a state beyond it that is regular and breaks no condition."""
    weights = (1.0 / equations.scales**2)[:, None]
    try:
        states, rates = newton.on_planes(equations, (point + step)[:, None], weights * step[:, None])
        nodes = np.column_stack([point, states])
        if np.linalg.norm(step / equations.scales) <= 2.0 * _STRAIGHT:
            dense, speeds = straight(nodes[:, :1], nodes[:, 1:])
        else:
            tangents = newton.unit(equations, np.column_stack([step, rates]))
            dense, speeds, astray = between(equations, nodes, tangents)
            if astray.size:
                return None
    except NotConverged:
        return None
    values = states[:, 0].tolist()
    count = int(np.count_nonzero(eigenvalues(equations, states[:, 0]) < 0.0))
    if count == unstable or not all(condition.margin(values) > 0.0 for condition in ends):
        return None
    return Piece(nodes, dense, speeds, count)
