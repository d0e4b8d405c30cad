"""Certifying a path: what was proposed is put on the curve, and taken only where it is certain.

Proposed points are polished by Newton's method. Then every margin is judged on every interval between two
of them. It is the polynomial through its values at both ends and at the nine Gauss points, with an error of
about its last coefficients. Where its minimum exceeds that error the margin is *clear*; where it is below
minus that error the margin was *passed*, and the segment ends there; else the interval is *halved*. An
interval is also halved where the path turns too sharply to be seen from its ends, and where Newton's method
does not find the curve.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulator.model.conditions import Condition
from simulator.model.equations import Equations
from simulator.solver import newton, singular
from simulator.solver.newton import NotConverged
from simulator.solver.segment import (
    GAUSS_POINTS,
    RATES,
    STRAIGHT,
    Cubics,
    Places,
    Segment,
    across,
    rounding,
)

FloatArray = NDArray[np.float64]

NOISE = 1e-12  # of margins: what is smaller may be rounding
_SEEN = 0.7  # cosine, between a chord and the tangents at its ends, that is straight ahead
_MOVED = 0.2  # over the length of an interval: how far polishing may move a point
_MOST_ROUNDS = 60  # an interval halved as often is shorter than rounding
_MOST_POINTS = 100_000
_FINE = np.linspace(0.0, 1.0, 65)
_AT = np.concatenate([[0.0], GAUSS_POINTS, [1.0]])


@dataclass(frozen=True)
class Proposal:
    """Points along a path that may be right.

    Attributes
    ----------
    points, directions : (n_unknowns, n) arrays
        In the order they were passed, with the direction ahead at each; the first is on the curve. One
        point alone is an event that the start cannot be told from.
    ended : int
        Which condition ended them; the number of conditions where the target was reached.
    """

    points: FloatArray
    directions: FloatArray
    ended: int


def certified(
    equations: Equations, conditions: Sequence[Condition], proposal: Proposal, target: float
) -> Segment:
    """The segment that was proposed, put on the curve, as far as it is certain that no condition ends it.

    Parameters
    ----------
    equations, conditions
        The curve, and what ends it.
    proposal : Proposal
    target : float
        The v wanted.

    Raises
    ------
    NotConverged
        Where the points do not form one smooth path on which v is monotone.
    """
    if proposal.points.shape[1] == 1:
        kind = conditions[proposal.ended].kind
        return Segment.at_once(proposal.points[:, 0], proposal.directions[:, 0], kind)
    segment, astray = _polished(equations, conditions, proposal, target)
    sense = np.sign(target - proposal.points[-1, 0])
    for _ in range(_MOST_ROUNDS):
        if segment.states.shape[1] > _MOST_POINTS:
            break
        turning = astray if astray.size else sharp(equations, segment.states, segment.tangents)
        if turning.size:
            middles = _middles(equations, segment.states, turning)
            segment, astray = segment.with_points(equations, turning, *middles)
            continue
        if np.any(sense * np.diff(segment.states[-1]) <= 0.0):
            raise NotConverged("v is not monotone")
        doubtful, passed = judged(equations, conditions, segment)
        if passed is not None:
            place, condition, event = passed
            ahead = singular.tangent_at_end(equations, event, event - segment.states[:, place])
            segment, astray = segment.ending(equations, place, event, ahead, condition.kind)
        elif doubtful.size:
            segment, astray = segment.halved(equations, doubtful)
        else:
            return segment.resolved(equations)
    raise NotConverged("no smooth path")


def _polished(
    equations: Equations, conditions: Sequence[Condition], proposal: Proposal, target: float
) -> tuple[Segment, Places]:
    """Proposed points put on the curve, and the intervals in which it strays from the cubic through them."""
    points, directions = proposal.points.copy(), proposal.directions.copy()
    last, end = polished_end(equations, conditions, proposal, target)
    chord, moved = ((last - other) / equations.scales for other in (points[:, -2], points[:, -1]))
    if not 0.0 < chord @ chord >= moved @ moved:
        raise NotConverged("polishing moved the end too far")
    points[:, -1] = last
    directions[:, -1] = singular.tangent_at_end(equations, last, directions[:, -1])
    at_once = _all_at_once(equations, points, directions, end)
    if at_once is not None:
        return at_once, np.zeros(0, dtype=np.int64)
    nodes, tangents = _put_on_curve(equations, points, directions)
    for _ in range(_MOST_ROUNDS):
        turning = sharp(equations, nodes, tangents)
        if not turning.size:
            return Segment.through(equations, nodes, tangents, end)
        middles = _middles(equations, nodes, turning)
        nodes, tangents = (
            np.insert(old, turning + 1, new, axis=1)
            for old, new in zip((nodes, tangents), middles, strict=True)
        )
    raise NotConverged("the path turns too sharply")


def _all_at_once(
    equations: Equations, points: FloatArray, directions: FloatArray, end: str | None
) -> Segment | None:
    """The segment through points, polished in one call with the Gauss points between; None if that fails.

    The planes at the ends of a cubic are those of its points, so that an integral along it is one from point
    to point.
    """
    count = points.shape[1] - 2
    if count == 0:
        return None
    weights = 1.0 / equations.scales[:, None] ** 2
    cubic = Cubics.through(weights, points, directions).at_gauss_points()
    guesses = np.concatenate([points[:, 1:-1], cubic[0]], axis=1)
    normals = weights * np.concatenate([directions[:, 1:-1], cubic[1]], axis=1)
    try:
        states, rates = newton.on_planes(equations, guesses, normals, accuracy=RATES)
    except NotConverged:
        return None
    nodes, tangents = points.copy(), directions.copy()
    nodes[:, 1:-1], tangents[:, 1:-1] = states[:, :count], newton.unit(equations, rates[:, :count])
    dense, speeds, astray = across(weights, cubic, states[:, count:], rates[:, count:])
    if astray.size or not _stayed(equations, points, nodes).all():
        return None
    return Segment(nodes, tangents, dense, speeds, end)


def _put_on_curve(
    equations: Equations, points: FloatArray, directions: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Points and directions, the inner points polished; those that do not stay where they are left out."""
    inner = np.arange(1, points.shape[1] - 1)
    normals = directions / equations.scales[:, None] ** 2
    nodes, tangents = points.copy(), directions.copy()
    while inner.size:
        try:
            states, rates = newton.on_planes(equations, points[:, inner], normals[:, inner], accuracy=RATES)
        except NotConverged as failure:
            if failure.failed is None:
                raise
            inner = inner[~failure.failed]
            continue
        nodes[:, inner], tangents[:, inner] = states, newton.unit(equations, rates)
        break
    kept = np.concatenate([[0], inner, [points.shape[1] - 1]])
    points, nodes, tangents = points[:, kept], nodes[:, kept], tangents[:, kept]
    stayed = np.append(_stayed(equations, points, nodes), True)
    stayed[0] = True
    return nodes[:, stayed], tangents[:, stayed]


def _stayed(equations: Equations, points: FloatArray, nodes: FloatArray) -> NDArray[np.bool_]:
    """Which points polishing moved little, of the length to their neighbours; all but the last, (n − 1,)."""
    weights = 1.0 / equations.scales[:, None] ** 2
    chords, moves = nodes[:, 1:] - nodes[:, :-1], (nodes - points)[:, :-1]
    lengths = np.einsum("ij,ij->j", weights * chords, chords)
    nearer = lengths.copy()
    nearer[1:] = np.minimum(lengths[1:], lengths[:-1])
    return np.asarray(np.einsum("ij,ij->j", weights * moves, moves) <= _MOVED**2 * nearer)


def polished_end(
    equations: Equations, conditions: Sequence[Condition], proposal: Proposal, target: float
) -> tuple[FloatArray, str | None]:
    """The last point, polished: at the target, or at the event that comes before it, and its kind."""
    points, ended = proposal.points, proposal.ended
    found = points[:, -1].copy()
    if ended == len(conditions):
        found[-1] = target
        try:
            found = newton.one_at_drive(equations, found)
            values = found.tolist()
            passed = [place for place, c in enumerate(conditions) if float(c.margin(values)) < 0.0]
            if not passed:
                return found, None
            # IDA takes two margins that fall to zero within its tolerance in any order.
            ended = passed[0]
        except NotConverged:
            # At a fixed v Newton's method fails right beside a fold; the fold itself can be found.
            ended = 0
    event = newton.at_event(equations, conditions[ended], points[:, -1])
    beyond = (event[-1] - target) * np.sign(target - points[-1, 0])
    if beyond <= rounding(equations, target):
        return event, conditions[ended].kind
    # Polished, the event lies beyond the target. Near a fold v is quadratic in the distance to it.
    inside = points[:, -2]
    share = (target - inside[-1]) / (event[-1] - inside[-1])
    found = event + (inside - event) * np.sqrt(max(1.0 - share, 0.0))
    found[-1] = target
    return newton.one_at_drive(equations, found), None


def sharp(equations: Equations, nodes: FloatArray, tangents: FloatArray) -> Places:
    """Intervals whose ends do not see each other straight ahead."""
    chords = nodes[:, 1:] - nodes[:, :-1]
    scaled = chords / equations.scales[:, None] ** 2
    lengths = np.sqrt(np.einsum("ij,ij->j", scaled, chords))
    ahead = np.minimum(
        np.einsum("ij,ij->j", scaled, tangents[:, 1:]), np.einsum("ij,ij->j", scaled, tangents[:, :-1])
    )
    return np.flatnonzero((ahead < _SEEN * lengths) & (lengths > STRAIGHT))


def _middles(equations: Equations, nodes: FloatArray, places: Places) -> tuple[FloatArray, FloatArray]:
    """States half way along some chords, and tangents there."""
    weights = 1.0 / equations.scales[:, None] ** 2
    chords = nodes[:, places + 1] - nodes[:, places]
    states, rates = newton.on_planes(
        equations, nodes[:, places] + 0.5 * chords, weights * chords, accuracy=RATES
    )
    return states, newton.unit(equations, rates)


def _reader(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Matrices from values at points of [0, 1] to those on a fine grid and the last Legendre coefficients."""
    vander = np.polynomial.legendre.legvander
    coefficients = np.linalg.inv(vander(2.0 * points - 1.0, points.size - 1))
    on_grid = vander(2.0 * _FINE - 1.0, points.size - 1) @ coefficients
    return np.asarray(on_grid, dtype=np.float64), np.asarray(coefficients[-2:], dtype=np.float64)


# Of what is given at both ends and the Gauss points; without the first of them, the last, or both.
_READERS = {(a, b): _reader(_AT[a : _AT.size - b]) for a in (0, 1) for b in (0, 1)}

_LEBESGUE = float(np.abs(_READERS[0, 0][0]).sum(axis=1).max())

Passed = tuple[int, Condition, FloatArray]  # interval, condition, event


def judged(
    equations: Equations, conditions: Sequence[Condition], segment: Segment
) -> tuple[Places, Passed | None]:
    """Intervals on which it is not certain that every margin stays positive; else the first it fell on.

    Where two fell on the same interval it is either of them: what is cut off there is judged once more.
    """
    states = segment.states
    columns = np.concatenate([states[:, :-1, None], segment.dense, states[:, 1:, None]], axis=2)
    flat = columns.reshape(len(states), -1)
    ended = _ended(conditions, states[:, -1], segment.end)
    doubtful: set[int] = set()
    first: Passed | None = None
    for place, condition in enumerate(conditions):
        values = np.asarray(condition.margin(flat)).reshape(columns.shape[1:])
        near, fine, errors = _read(values, ends_at_zero=place == ended)
        for i, row, error in zip(near.tolist(), fine, errors.tolist(), strict=True):
            lowest = float(row.min())
            if lowest > error + NOISE:
                continue
            if first is not None and i > first[0]:
                break
            if lowest < -error - NOISE:
                event = _root(equations, condition, columns[:, i], row)
                if event is None:
                    doubtful.add(i)
                elif first is None or i < first[0]:
                    first = i, condition, event
            elif error > NOISE + 1e-13 * np.abs(values[i]).max():  # else it is as certain as it can be
                doubtful.add(i)
    if first is not None and not any(i <= first[0] for i in doubtful):
        return np.zeros(0, dtype=np.int64), first
    # What is in doubt before the first event comes first.
    return np.array(sorted(i for i in doubtful if first is None or i <= first[0]), dtype=np.int64), None


def _ended(conditions: Sequence[Condition], last: FloatArray, end: str | None) -> int | None:
    """Which condition ended a segment: of several of one kind the one that is zero there."""
    same = [i for i, condition in enumerate(conditions) if condition.kind == end]
    values = last.tolist()
    return min(same, key=lambda i: abs(float(conditions[i].margin(values))), default=None)


def _read(values: FloatArray, *, ends_at_zero: bool) -> tuple[Places, FloatArray, FloatArray]:
    """Intervals on which a margin may vanish, (m,), the margin there on a fine grid, and the error of that.

    It is divided by the distance to an end where it vanishes: what is left is positive up to there where the
    margin is.
    """
    grid, last = _READERS[0, 0]
    error = np.abs(values @ last.T).sum(axis=1)
    low, high = values.min(axis=1), values.max(axis=1)
    # The polynomial strays from the middle of its values by no more than they do, times Lebesgue's constant.
    near = 0.5 * (high + low) - _LEBESGUE * 0.5 * (high - low) <= error + NOISE
    divided = {}
    for i in {0, len(values) - 1}:
        first = int(i == 0 and abs(values[0, 0]) <= NOISE)
        stop = _AT.size - int(i == len(values) - 1 and ends_at_zero)
        if stop - first < _AT.size and high[i] > NOISE:  # else it is too small to be judged
            divided[i] = first, stop
            near[i] = True
    places = np.flatnonzero(near)
    fine, error = values[places] @ grid.T, error[places]
    for i, (first, stop) in divided.items():
        row = int(np.searchsorted(places, i))
        at = _AT[first:stop]
        distance = (at if first else 1.0) * (1.0 - at if stop < _AT.size else 1.0)
        grid, last = _READERS[first, _AT.size - stop]
        part = values[i, first:stop] / distance
        fine[row], error[row] = grid @ part, np.abs(last @ part).sum()
    # Between two points of the grid it may be lower by an eighth of the second difference.
    dips = fine.min(axis=1) < 0.25 * fine.max(axis=1)
    error[dips] += 0.125 * np.abs(np.diff(fine[dips], 2, axis=1)).max(axis=1, initial=0.0)
    return places, fine, error


def _root(
    equations: Equations, condition: Condition, columns: FloatArray, fine: FloatArray
) -> FloatArray | None:
    """The event where the polynomial of a margin first falls through zero; None if it is not found there."""
    k = int(np.argmax(fine < 0.0))
    share = _FINE[k]
    if k:
        share = _FINE[k - 1] + (_FINE[k] - _FINE[k - 1]) * fine[k - 1] / (fine[k - 1] - fine[k])
    guess = np.array([np.interp(share, _AT, row) for row in columns])
    try:
        event = newton.at_event(equations, condition, guess)
    except NotConverged:
        return None
    chord = (columns[:, -1] - columns[:, 0]) / equations.scales
    along = float(chord @ ((event - columns[:, 0]) / equations.scales) / (chord @ chord))
    near = np.max(np.abs(event - guess) / equations.scales) <= np.max(np.abs(chord))
    return event if near and 0.0 <= along <= 1.0 else None
