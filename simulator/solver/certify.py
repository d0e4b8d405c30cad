"""A piece of path: points that were passed are put on the curve by Newton's method, all at once, and checked.

What does not form one smooth path, on which every condition holds up to its end, is not a piece: it has to
be followed again in shorter steps, or cut where a condition was passed unseen.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.model.conditions import Condition
from simulator.model.equations import Equations
from simulator.solver import newton
from simulator.solver.newton import NotConverged

if TYPE_CHECKING:
    from collections.abc import Sequence

FloatArray = NDArray[np.float64]

_COUNT = 9
# Gauss–Legendre points on [0, 1]: checks and work integrals within each interval between points.
GAUSS_POINTS = 0.5 + 0.5 * np.polynomial.legendre.leggauss(_COUNT)[0]
GAUSS_WEIGHTS = 0.5 * np.polynomial.legendre.leggauss(_COUNT)[1]
# Integrals from 0 to each Gauss point of what is given at all of them.
GAUSS_INTEGRALS = np.linalg.solve(
    np.vander(GAUSS_POINTS, increasing=True).T,
    (GAUSS_POINTS[:, None] ** np.arange(1, _COUNT + 1) / np.arange(1, _COUNT + 1)).T,
).T
# The last two Legendre coefficients of what is given at all of them.
_LAST_COEFFICIENTS = np.stack(
    [
        (2 * k + 1) * GAUSS_WEIGHTS * np.polynomial.legendre.Legendre.basis(k)(2.0 * GAUSS_POINTS - 1.0)
        for k in (_COUNT - 2, _COUNT - 1)
    ],
    axis=1,
)
_WORK_ERROR = 1e-10  # of the work of an interval, over that of the piece
_MOST_HALVINGS = 6
_ASIDE = 0.2  # over the length of an interval: how far the curve may be from the cubic through its ends
NOISE = 1e-12  # of margins: no event is told from less
_MOST_CUTS = 4
_MOST_CLOSER = 24
SHORT = 1e-7  # in v over its scale: too short a piece to be followed
ULPS = 4.0 * np.finfo(float).eps  # two values of v closer than this, relatively, are one


@dataclass(frozen=True)
class Segment:
    """One piece of path, followed and polished.

    Attributes
    ----------
    states, tangents : (n_unknowns, n) arrays
        In the order they were passed; tangents of unit length in scaled unknowns, pointing ahead.
    dense, speeds : (n_unknowns, n − 1, k) arrays
        States at the Gauss points between each two of them, and how fast they pass; see `between`.
    work : (n − 1,) array
        ∫ −∂Π/∂v dv over the interval between each two of them.
    end : str or None
        Kind of the condition that ended it; None where it reached its target.
    """

    states: FloatArray
    tangents: FloatArray
    dense: FloatArray
    speeds: FloatArray
    work: FloatArray
    end: str | None


class _PassedUnseen(NotConverged):
    """A condition was passed between IDA's points; `points` lead up to just beyond where."""

    def __init__(self, kind: str, place: int, points: FloatArray, directions: FloatArray) -> None:
        super().__init__(f"a {kind} was passed unseen")
        self.place, self.points, self.directions = place, points, directions


class _TurnsAtEnd(NotConverged):
    """The path turns sharply just before the event that ends it; the nodes before that are right."""

    def __init__(self, nodes: FloatArray, tangents: FloatArray) -> None:
        super().__init__("the path turns too sharply before its end")
        self.nodes, self.tangents = nodes, tangents


def polished(
    equations: Equations,
    conditions: Sequence[Condition],
    points: FloatArray,
    directions: FloatArray,
    ended: int,
    target: float,
) -> Segment:
    """The points put on the curve, checked; cut where a condition was passed unseen, to end with it.

    Parameters
    ----------
    equations, conditions
    points, directions : (n_unknowns, n) arrays
        As they were passed, with the direction ahead at each.
    ended : int
        Which condition ended them; their number where `target` was reached.
    target : float
        The v wanted.

    Raises
    ------
    NotConverged
        Where they do not form one smooth path.
    """
    for _ in range(_MOST_CUTS):
        try:
            return _polished(equations, conditions, points, directions, ended, target)
        except _PassedUnseen as passed:
            points, directions, ended = passed.points, passed.directions, passed.place
        except _TurnsAtEnd as sharp:
            points, directions = _approaching(equations, conditions, sharp.nodes, sharp.tangents)
    raise NotConverged(f"several {conditions[ended].kind} were passed unseen")


def _polished(
    equations: Equations,
    conditions: Sequence[Condition],
    points: FloatArray,
    directions: FloatArray,
    ended: int,
    target: float,
) -> Segment:
    """As `polished`; raises _PassedUnseen where the piece is to be cut."""
    last, end = _polished_end(equations, conditions, points, ended, target)
    weights = 1.0 / equations.scales[:, None] ** 2
    moved = float(np.sqrt(weights[:, 0] @ (last - points[:, -1]) ** 2))
    points[:, -1] = last
    directions[:, -1] = newton.tangent_at_end(equations, last, directions[:, -1])
    # The points, and the Gauss points of the cubics through them, in one call of Newton's method. The planes
    # at the ends of a cubic are those of its points, so that an integral along it is one from node to node.
    inner = slice(1, -1)
    count = points.shape[1] - 2
    guesses, slopes, bends = Cubics.through(weights, points, directions).at_gauss_points()
    states, rates = newton.on_planes(
        equations,
        np.concatenate([points[:, inner], guesses], axis=1),
        weights * np.concatenate([directions[:, inner], slopes], axis=1),
        accuracy=1e-12,
    )
    nodes, tangents = points.copy(), directions
    nodes[:, inner], tangents[:, inner] = states[:, :count], newton.unit(equations, rates[:, :count])
    _check_smooth(weights, points, nodes, tangents, moved)
    try:
        dense, speeds = _passing(weights, guesses, slopes, bends, states[:, count:], rates[:, count:])
    except NotConverged:  # the cubics through unpolished points can be crooked where these lie close
        dense, speeds = between(equations, nodes, tangents)
    _check_end(equations, conditions, nodes, tangents, end)
    _check_margins(equations, conditions, nodes, tangents, dense, end)
    return resolved(equations, nodes, tangents, dense, speeds, end)


def resolved(
    equations: Equations,
    nodes: FloatArray,
    tangents: FloatArray,
    dense: FloatArray,
    speeds: FloatArray,
    end: str | None,
) -> Segment:
    """A piece of path whose work integrals are right: intervals too long for them are halved."""
    for _ in range(_MOST_HALVINGS):
        done = work(equations, dense, speeds)
        # The last two Legendre coefficients of the integrand say how fast all of them fall; what the rule
        # misses is of the order of number 2 × _COUNT.
        integrand = np.asarray(equations.drive_power(dense)) * speeds[-1]
        largest = np.max(np.abs(integrand), axis=1) + np.finfo(float).tiny
        shares = np.abs(integrand @ _LAST_COEFFICIENTS) / largest[:, None]
        falls = np.max(shares ** (1.0 / np.array([_COUNT - 2, _COUNT - 1])), axis=1)
        coarse = np.flatnonzero(largest * falls ** (2 * _COUNT) > _WORK_ERROR * np.abs(done).sum())
        if not coarse.size:
            break
        # The middle Gauss point is on the curve already.
        middle = GAUSS_POINTS.size // 2
        nodes = np.insert(nodes, coarse + 1, dense[:, coarse, middle], axis=1)
        tangents = np.insert(tangents, coarse + 1, newton.unit(equations, speeds[:, coarse, middle]), axis=1)
        dense, speeds = between(equations, nodes, tangents)
    return Segment(nodes, tangents, dense, speeds, done, end)


def _approaching(
    equations: Equations, conditions: Sequence[Condition], nodes: FloatArray, tangents: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Nodes with more of them before the last, ever closer to it, and tangents.

    Where an imperfection breaks up a branch point the path turns off within a length that only its own end
    tells. Beyond the bend the distance to the fold goes as the root of the distance in v.
    """
    inside, event = nodes[:, -2], nodes[:, -1]
    state = inside
    more: list[FloatArray] = []
    past_bend = 0
    for k in range(1, _MOST_CLOSER):
        left = (event[-1] - inside[-1]) * 4.0**-k
        if abs(left) <= rounding(equations, float(event[-1])):
            break
        for guess in (0.5 * (state + event), state.copy()):
            guess[-1] = event[-1] - left
            try:
                found = newton.one_at_drive(equations, guess)
            except NotConverged:
                continue
            if float(conditions[0].margin(found.tolist())) > 0.0:
                break
        else:
            raise NotConverged("the path turns too sharply before its end")
        closer_by = float(np.linalg.norm(found - event) / np.linalg.norm(state - event))
        past_bend = past_bend + 1 if closer_by > 0.4 else 0
        state = found
        more.append(state)
        if past_bend == 3:
            break
    if not more:
        raise NotConverged("the path turns too sharply before its end")
    closer = np.stack(more, axis=1)
    towards = np.diff(np.concatenate([inside[:, None], closer], axis=1), axis=1)
    return (
        np.concatenate([nodes[:, :-1], closer, event[:, None]], axis=1),
        np.concatenate(
            [tangents[:, :-1], newton.tangents(equations, closer, towards), tangents[:, -1:]], axis=1
        ),
    )


def between(equations: Equations, nodes: FloatArray, tangents: FloatArray) -> tuple[FloatArray, FloatArray]:
    """States at the Gauss points between nodes, and how fast they pass, (n_unknowns, n − 1, k) both.

    The speeds are dy/dξ, with ξ ∈ [0, 1] the parameter of the cubic through each two nodes.
    """
    weights = 1.0 / equations.scales[:, None] ** 2
    guesses, slopes, bends = Cubics.through(weights, nodes, tangents).at_gauss_points()
    states, rates = newton.on_planes(equations, guesses, weights * slopes, accuracy=1e-12)
    return _passing(weights, guesses, slopes, bends, states, rates)


def _passing(
    weights: FloatArray,
    guesses: FloatArray,
    slopes: FloatArray,
    bends: FloatArray,
    states: FloatArray,
    rates: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """What `between` returns, from a cubic c(ξ), c′, c″ at Gauss points and the states on its planes.

    Raises NotConverged where these are far from the cubic, over its speed: they may not be in order.
    """
    aside = np.sum(weights * (states - guesses) ** 2, axis=0)
    if np.any(aside > _ASIDE**2 * np.sum(weights * slopes * slopes, axis=0)):
        raise NotConverged("states between two points are far from the cubic through them")
    # On planes across the cubic the state moves at dy/dξ = rate (|c′|² − c″·(y − c)).
    speeds = rates * np.sum(weights * (slopes * slopes - bends * (states - guesses)), axis=0)
    shape = (len(guesses), -1, GAUSS_POINTS.size)
    return states.reshape(shape), speeds.reshape(shape)


def straight(nodes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """What `between` returns, on the straight lines between nodes that are very close to each other."""
    chords = nodes[:, 1:] - nodes[:, :-1]
    dense = nodes[:, :-1, None] + chords[:, :, None] * GAUSS_POINTS
    return dense, np.repeat(chords[:, :, None], GAUSS_POINTS.size, axis=2)


def work(equations: Equations, states: FloatArray, speeds: FloatArray) -> FloatArray:
    """∫ −∂Π/∂v dv over every interval, (n − 1,), from what `between` returns."""
    return np.asarray((np.asarray(equations.drive_power(states)) * speeds[-1]) @ GAUSS_WEIGHTS)


@dataclass(frozen=True)
class Cubics:
    """Cubics y0 + ξ(m0 + ξ(a + ξb)), ξ ∈ [0, 1], one for each interval; arrays (n_unknowns, n)."""

    y0: FloatArray
    m0: FloatArray
    a: FloatArray
    b: FloatArray

    @classmethod
    def through(cls, weights: FloatArray, points: FloatArray, directions: FloatArray) -> Cubics:
        """Through points (n_unknowns, n + 1) along unit directions."""
        chords = points[:, 1:] - points[:, :-1]
        first, second = directions[:, :-1], directions[:, 1:]
        scaled = weights * chords
        length = np.sqrt(np.einsum("ij,ij->j", scaled, chords))
        # Arc over chord, exact to fourth order: the cosines between directions and chord tell the turn.
        cosines = np.einsum("ij,ij->j", scaled, first + second) / length
        m0, m1 = (d * (length * 3.0 / (2.0 + 0.5 * cosines)) for d in (first, second))
        return cls(points[:, :-1], m0, 3.0 * chords - 2.0 * m0 - m1, m0 + m1 - 2.0 * chords)

    def at_gauss_points(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Values, first and second derivatives at the Gauss points, (n_unknowns, n k)."""
        x = GAUSS_POINTS
        y0, m0, a, b = (part[:, :, None] for part in (self.y0, self.m0, self.a, self.b))
        flat = (len(self.y0), -1)
        return (
            (y0 + x * (m0 + x * (a + x * b))).reshape(flat),
            (m0 + x * (2.0 * a + x * 3.0 * b)).reshape(flat),
            (2.0 * a + x * 6.0 * b).reshape(flat),
        )


def _polished_end(
    equations: Equations, conditions: Sequence[Condition], points: FloatArray, ended: int, target: float
) -> tuple[FloatArray, str | None]:
    """The last point, polished: at the target, or at the event that comes before it, and its kind."""
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
    # Polished, the event lies beyond the target.
    return before_event(equations, points[:, -2], event, target), None


def before_event(equations: Equations, inside: FloatArray, event: FloatArray, target: float) -> FloatArray:
    """The state at v = `target` between a state of the path and an event beyond. Raises NotConverged."""
    # Near a fold v is quadratic in the distance to it.
    share = (target - inside[-1]) / (event[-1] - inside[-1])
    found = event + (inside - event) * np.sqrt(max(1.0 - share, 0.0))
    found[-1] = target
    return newton.one_at_drive(equations, found)


def rounding(equations: Equations, v: float) -> float:
    """How far apart two values of v near this one must be to differ."""
    return ULPS * max(abs(v), float(equations.scales[-1]))


def _check_smooth(
    weights: FloatArray, points: FloatArray, states: FloatArray, tangents: FloatArray, moved_last: float
) -> None:
    """Polishing moved no point far, v is monotone, and neighbours see each other straight ahead."""
    chords = states[:, 1:] - states[:, :-1]
    scaled = weights * chords
    lengths = np.sqrt(np.einsum("ij,ij->j", scaled, chords))
    if not lengths.min() > 0.0:
        raise NotConverged("two points of the path coincide")
    moves = states - points
    moved = np.sqrt(np.einsum("ij,ij->j", weights * moves, moves))[1:]
    if np.any(moved > 0.2 * lengths) or moved_last > lengths[-1]:
        raise NotConverged("polishing moved a point too far")
    turns = np.minimum(
        np.einsum("ij,ij->j", scaled, tangents[:, 1:]), np.einsum("ij,ij->j", scaled, tangents[:, :-1])
    )
    if np.any(turns[:-1] < 0.7 * lengths[:-1]):
        raise NotConverged("the path turns too sharply between two points")
    if turns[-1] < 0.7 * lengths[-1]:
        raise _TurnsAtEnd(states, tangents)
    if chords[-1].min() * chords[-1].max() <= 0.0:
        raise NotConverged("v is not monotone")


def _check_end(
    equations: Equations,
    conditions: Sequence[Condition],
    states: FloatArray,
    tangents: FloatArray,
    end: str | None,
) -> None:
    """The margin that ended a piece falls there. Where it rises, a root just before it was overlooked."""
    last = states[:, -1].tolist()
    # Of several of one kind (limit points, as a trace knows them) the one that is zero there.
    ended = [i for i, condition in enumerate(conditions) if condition.kind == end]
    place = min(ended, key=lambda i: abs(float(conditions[i].margin(last))), default=None)
    if place is None or float(conditions[place].slope(states[:, -1]) @ tangents[:, -1]) <= 1e-9:
        return
    weights = 1.0 / equations.scales**2
    inside, chord = states[:, -2], states[:, -1] - states[:, -2]
    low, high = 0.0, 1.0
    beyond = states[:, -1]
    for _ in range(40):
        middle = 0.5 * (low + high) if high < 1.0 else 1.0 - 0.25 * (1.0 - low)
        guess = (inside + middle * chord)[:, None]
        found = newton.on_planes(equations, guess, (weights * chord)[:, None])[0][:, 0]
        if float(conditions[place].margin(found.tolist())) < 0.0:
            high, beyond = middle, found
        else:
            low = middle
        if high - low < 1e-6:
            break
    raise _PassedUnseen(
        conditions[place].kind,
        place,
        np.concatenate([states[:, :-1], beyond[:, None]], axis=1),
        tangents.copy(),
    )


def _check_margins(
    equations: Equations,
    conditions: Sequence[Condition],
    states: FloatArray,
    tangents: FloatArray,
    dense: FloatArray,
    end: str | None,
) -> None:
    """No condition was passed on the way: at the points, between them, and where a margin dips."""
    columns = np.concatenate([states[:, :-1, None], dense], axis=2).reshape(states.shape[0], -1)
    columns = np.concatenate([columns, states[:, -1:]], axis=1)
    for place, condition in enumerate(conditions):
        margin = np.asarray(condition.margin(columns))
        inner = margin[1:] if condition.kind != end else margin[1:-1]
        beyond: FloatArray | None = None
        first = 0
        if np.any(inner < -NOISE):
            first = 1 + int(np.argmax(inner < -NOISE))
            beyond = columns[:, first]
        elif margin[0] < min(margin[1], 0.1 * margin.max()):
            first = 1
            beyond = _below_zero_at_start(equations, condition, columns[:, :2], tangents[:, 0])
        if beyond is None and end is None and margin[-1] < min(margin[-2], 0.1 * margin.max()):
            first = columns.shape[1] - 1
            beyond = _below_zero_at_start(equations, condition, columns[:, :-3:-1], -tangents[:, -1])
        if beyond is None:
            dips = (margin[1:-1] < margin[:-2]) & (margin[1:-1] < margin[2:])
            for first in (1 + np.flatnonzero(dips)).tolist():
                beyond = _below_zero(equations, condition, columns[:, first - 1 : first + 2])
                if beyond is not None:
                    break
        if beyond is not None:
            # The points before it, and a state beyond the event.
            count = (first - 1) // (dense.shape[2] + 1) + 1
            raise _PassedUnseen(
                condition.kind,
                place,
                np.concatenate([states[:, :count], beyond[:, None]], axis=1),
                np.concatenate([tangents[:, :count], tangents[:, count : count + 1]], axis=1),
            )


def _below_zero_at_start(
    equations: Equations, condition: Condition, states: FloatArray, tangent: FloatArray
) -> FloatArray | None:
    """As `_below_zero`, where a margin dips between the first state and the second."""
    weights = 1.0 / equations.scales**2
    slope = float(condition.slope(states[:, 0]) @ tangent)
    if slope >= 0.0:
        return None
    low, high = (float(condition.margin(column.tolist())) for column in states.T)
    length = float(np.sqrt(weights @ (states[:, 1] - states[:, 0]) ** 2))
    bottom = -0.5 * slope * length**2 / (high - low - slope * length)
    guess = (states[:, 0] + bottom * tangent)[:, None]
    middle = newton.on_planes(equations, guess, (weights * tangent)[:, None])[0]
    if float(condition.margin(middle[:, 0].tolist())) < -NOISE:
        return middle[:, 0]
    return _below_zero(equations, condition, np.stack([states[:, 0], middle[:, 0], states[:, 1]], axis=1))


def _below_zero(equations: Equations, condition: Condition, states: FloatArray) -> FloatArray | None:
    """A state just beyond the first of two roots that a margin may have in a dip between three states.

    A parabola through the three says where the dip is deepest; its bottom is looked at, not guessed.
    """
    weights = 1.0 / equations.scales**2
    chord = states[:, 2] - states[:, 0]
    for _ in range(8):
        x = (weights * chord) @ (states - states[:, :1])
        left, mid, right = (float(condition.margin(column.tolist())) for column in states.T)
        first, second = (mid - left) / (x[1] - x[0]), (right - mid) / (x[2] - x[1])
        curve = (second - first) / (x[2] - x[0])
        slope = first + curve * (x[1] - x[0])
        bottom = x[1] - 0.5 * slope / curve
        depth = mid - 0.25 * slope * slope / curve
        if not curve > 0.0 or not x[0] < bottom < x[2] or depth > 0.5 * min(left, right):
            return None
        # The first root where there is one, else the bottom.
        wanted = bottom - 0.9 * np.sqrt(max(-depth, 0.0) / curve)
        share = (wanted - x[0]) / (x[2] - x[0])
        guess = states[:, :1] + share * chord[:, None]
        found = newton.on_planes(equations, guess, (weights * chord)[:, None])[0]
        if float(condition.margin(found[:, 0].tolist())) < -NOISE:
            return found[:, 0]
        if abs(wanted - x[1]) <= 1e-9 * (x[2] - x[0]):
            return None
        middle = sorted([(x[1], states[:, 1]), (wanted, found[:, 0])], key=lambda pair: pair[0])
        lower = condition.margin(middle[0][1].tolist()) < condition.margin(middle[1][1].tolist())
        triple = (states[:, 0], *(m[1] for m in middle)) if lower else (*(m[1] for m in middle), states[:, 2])
        states = np.stack(triple, axis=1)
        chord = states[:, 2] - states[:, 0]
    return None
