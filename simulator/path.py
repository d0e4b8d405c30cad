"""Follows the quasi-static equilibrium path with IDA, along its arclength.

With the drive as independent variable the path ends at a fold; along its arclength s a fold is a regular
point. So IDA integrates the DAE

    residual(y) = 0,    |dy/ds|² = 1   (in scaled unknowns),

loosely: s only labels points, and every point it visits is then polished by Newton's method, all at once,
and checked. What does not pass is followed again in shorter steps, or is an error.
"""

from __future__ import annotations

import contextlib
import io
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from simulator import equilibrium
from simulator.equilibrium import NotConverged
from simulator.events import Condition
from simulator.model import Equations

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

FloatArray = NDArray[np.float64]

# Gauss–Legendre points on [0, 1]: checks and work integrals within each interval between points.
GAUSS_POINTS = 0.5 + 0.5 * np.polynomial.legendre.leggauss(5)[0]
GAUSS_WEIGHTS = 0.5 * np.polynomial.legendre.leggauss(5)[1]
# Integrals from 0 to each Gauss point of what is given at all of them.
GAUSS_INTEGRALS = np.linalg.solve(
    np.vander(GAUSS_POINTS, increasing=True).T,
    (GAUSS_POINTS[:, None] ** np.arange(1, 6) / np.arange(1, 6)).T,
).T
_LONGEST = 1e9  # an arclength never reached
_TIGHTEST = 1e-12
_MOST_CUTS = 4
_MOST_LOOKS = 50_000  # of IDA at the events, about one a step
# Tolerance, over the one asked for, and longest step (0: any) of each attempt to follow a piece.
_ATTEMPTS = ((1.0, 0.0), (0.1, 0.0), (1e-2, 0.25), (1e-3, 0.05), (1e-4, 0.01), (1e-5, 2e-3))
SHORT = 1e-7  # in v over its scale: too short a piece to be integrated
ULPS = 4.0 * np.finfo(float).eps  # two values of v closer than this, relatively, are one


class PathError(ArithmeticError):
    """The path could not be followed or verified, at any tolerance."""


@dataclass
class Effort:
    """What following and relaxing have cost so far; one per run."""

    ida_solves: int = 0
    ida_steps: int = 0
    residual_calls: int = 0
    jacobian_calls: int = 0


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


def follow(
    equations: Equations,
    conditions: Sequence[Condition],
    start: FloatArray,
    target: float,
    rtol: float,
    effort: Effort,
) -> Segment:
    """Follow the path from a polished state to v = `target`, or to the first condition that ends it.

    Parameters
    ----------
    equations, conditions
        The curve, and what ends it.
    start : (n_unknowns,) array
        A state on the curve, with all margins positive.
    target : float
        Where v should get to; v moves monotonically.
    rtol : float
        IDA's tolerance; tightened here where the outcome does not pass its checks.
    effort : Effort
        Counters, added to.

    Raises
    ------
    PathError
        If no tolerance gave a path that passes.
    """
    if abs(target - start[-1]) < SHORT * equations.scales[-1]:
        short = _short(equations, conditions, start, target)
        if short is not None:
            return short
    failure: Exception | None = None
    bound = equations.longest_step / equations.scales[-1]
    for tighter, largest in _ATTEMPTS:
        largest_step = min(largest or bound, bound) if bound < _LONGEST else largest
        try:
            points, directions, ended = _integrate(
                equations, conditions, start, target, max(rtol * tighter, _TIGHTEST), largest_step, effort
            )
            return _mended(equations, conditions, points, directions, ended, target)
        except (ArithmeticError, np.linalg.LinAlgError) as not_converged:
            failure = not_converged
    raise PathError(f"{failure} from v = {start[-1]:.12g} to {target:.12g}") from failure


def _short(
    equations: Equations, conditions: Sequence[Condition], start: FloatArray, target: float
) -> Segment | None:
    """A piece too short for steps, as one interval; None if it is not plainly smooth and free of events."""
    nodes = np.repeat(start[:, None], 2, axis=1)
    nodes[-1, 1] = target
    try:
        nodes[:, 1] = equilibrium.one_at_drive(equations, nodes[:, 1])
    except NotConverged:
        return None
    ahead = np.zeros_like(nodes)
    ahead[-1] = 1.0 if target > start[-1] else -1.0
    tangents = equilibrium.tangents(equations, nodes, ahead)
    if np.max(np.abs(nodes[:, 1] - start) / equations.scales) > 1e3 * SHORT:
        return None
    if any(float(c.margin(nodes[:, k].tolist())) < 1e3 * SHORT for c in conditions for k in (0, 1)):
        return None
    dense, speeds = straight(nodes)
    return Segment(nodes, tangents, dense, speeds, work(equations, dense, speeds), None)


def _integrate(
    equations: Equations,
    conditions: Sequence[Condition],
    start: FloatArray,
    target: float,
    rtol: float,
    largest_step: float,
    effort: Effort,
) -> tuple[FloatArray, FloatArray, int]:
    """IDA's points and directions, columns, and which condition (or the target, the last) ended them."""
    sense = 1.0 if target > start[-1] else -1.0
    margins = [condition.margin for condition in conditions]

    def events(values: list[float], rates: list[float]) -> list[float]:
        found = [margin(values) for margin in margins]
        found.append(sense * (target - values[-1]))
        return found

    ahead = np.zeros_like(start)
    ahead[-1] = sense
    direction = equilibrium.tangents(equations, start[:, None], ahead[:, None])[:, 0]
    return along(
        equations.residual,
        lambda values: equations.linearised(values)[1],
        events,
        start,
        direction,
        equations.scales,
        rtol,
        largest_step,
        effort,
    )


def along(
    residual: Callable[[list[float]], list[float]],
    jacobian: Callable[[list[float]], list[list[float]]],
    events: Callable[[list[float], list[float]], list[float]],
    start: FloatArray,
    direction: FloatArray,
    scales: FloatArray,
    rtol: float,
    largest_step: float,
    effort: Effort,
) -> tuple[FloatArray, FloatArray, int]:
    """Follow the curve residual(y) = 0 with IDA along its arclength until an event's margin falls to zero.

    Parameters
    ----------
    residual, jacobian
        Of n values, n − 1 equations and their derivatives; the jacobian's list may be added to.
    events
        Margins from values and their rates along the arclength, positive while all is well.
    start, direction : (n,) arrays
        A point on the curve and the unit tangent there.
    scales : (n,) array
        Natural sizes, that the arclength is measured in.
    rtol, largest_step : float
        IDA's tolerance and longest step (0: any).
    effort : Effort
        Counters, added to.

    Returns
    -------
    points, directions : (n, n_points) arrays
        As integrated, not polished.
    ended : int
        Which event ended it.

    Raises
    ------
    NotConverged
        If IDA fails.
    """
    from sksundae.ida import IDA

    weights: list[float] = (1.0 / scales**2).tolist()
    looks = 0

    def residual_of(s: float, y: FloatArray, yp: FloatArray, out: FloatArray) -> None:
        values = residual(y.tolist())
        speed = -1.0
        for w, d in zip(weights, yp.tolist(), strict=True):
            speed += w * d * d
        values.append(speed)
        out[:] = values

    def jacobian_of(
        s: float, y: FloatArray, yp: FloatArray, res: FloatArray, cj: float, out: FloatArray
    ) -> None:
        rows = jacobian(y.tolist())
        rows.append([2.0 * cj * w * d for w, d in zip(weights, yp.tolist(), strict=True)])
        out[:] = rows

    def events_of(s: float, y: FloatArray, yp: FloatArray, out: FloatArray) -> None:
        nonlocal looks
        looks += 1
        if looks > _MOST_LOOKS:
            raise NotConverged(f"no end within {_MOST_LOOKS} steps")
        out[:] = events(y.tolist(), yp.tolist())

    count = len(events(start.tolist(), direction.tolist()))
    events_of.direction = [-1] * count  # type: ignore[attr-defined]
    solver: Any = IDA(
        residual_of,
        jacfn=jacobian_of,
        eventsfn=events_of,
        num_events=count,
        rtol=rtol,
        atol=rtol * scales,
        # IDA starts at order one, whose error over a step h along a curve is about h²; its own guess is h.
        first_step=min(float(np.sqrt(rtol)), largest_step or _LONGEST),
        min_step=1e-12,
        max_nonlin_iters=8,  # |dy/ds|² = 1 is quadratic: now and then the default of 4 is too few
        max_step=largest_step or _LONGEST,
    )
    with contextlib.redirect_stdout(io.StringIO()):  # scikit-sundae prints failures
        result = solver.solve([0.0, _LONGEST], start, direction)
    effort.ida_solves += 1
    effort.ida_steps += len(result.t) - 1
    effort.residual_calls += int(result.nfev)
    effort.jacobian_calls += int(result.njev)
    if result.status != 2:
        raise NotConverged(f"IDA: {result.message}")
    return result.y.T.copy(), result.yp.T.copy(), int(np.flatnonzero(result.i_events[-1])[0])


class _PassedUnseen(NotConverged):
    """A condition was passed between IDA's points; `points` lead up to just beyond where."""

    def __init__(self, kind: str, place: int, points: FloatArray, directions: FloatArray) -> None:
        super().__init__(f"a {kind} was passed unseen")
        self.place, self.points, self.directions = place, points, directions


def _mended(
    equations: Equations,
    conditions: Sequence[Condition],
    points: FloatArray,
    directions: FloatArray,
    ended: int,
    target: float,
) -> Segment:
    """As `_polished`; where a condition was passed unseen, the piece is cut there and ends with it."""
    for _ in range(_MOST_CUTS):
        try:
            return _polished(equations, conditions, points, directions, ended, target)
        except _PassedUnseen as passed:
            points, directions, ended = passed.points, passed.directions, passed.place
    raise NotConverged(f"several {conditions[ended].kind} were passed unseen")


def _polished(
    equations: Equations,
    conditions: Sequence[Condition],
    points: FloatArray,
    directions: FloatArray,
    ended: int,
    target: float,
) -> Segment:
    """The points put on the curve, checked. Raises NotConverged where they do not form one smooth path."""
    last, end = _polished_end(equations, conditions, points, ended, target)
    weights = 1.0 / equations.scales[:, None] ** 2
    moved = float(np.sqrt(weights[:, 0] @ (last - points[:, -1]) ** 2))
    points[:, -1] = last
    directions[:, -1] = equilibrium.tangent_at_end(equations, last, directions[:, -1])
    nodes, tangents = points.copy(), directions
    if points.shape[1] > 2:
        inner = slice(1, -1)
        nodes[:, inner], rates = equilibrium.on_planes(
            equations, points[:, inner], weights * directions[:, inner]
        )
        tangents[:, inner] = equilibrium.unit(equations, rates)
    _check_smooth(weights, points, nodes, tangents, moved)
    _check_end(equations, conditions, nodes, tangents, end)
    dense, speeds = between(equations, nodes, tangents)
    _check_margins(equations, conditions, nodes, tangents, dense, end)
    return Segment(nodes, tangents, dense, speeds, work(equations, dense, speeds), end)


def between(equations: Equations, nodes: FloatArray, tangents: FloatArray) -> tuple[FloatArray, FloatArray]:
    """States at the Gauss points between nodes, and how fast they pass, (n_unknowns, n − 1, k) both.

    The speeds are dy/dξ, with ξ ∈ [0, 1] the parameter of the cubic through each two nodes.
    """
    weights = 1.0 / equations.scales[:, None] ** 2
    guesses, slopes, bends = Cubics.through(weights, nodes, tangents).at_gauss_points()
    states, rates = equilibrium.on_planes(equations, guesses, weights * slopes, accuracy=1e-9)
    # On planes across the cubic c(ξ) the state moves at dy/dξ = rate (|c′|² − c″·(y − c)).
    speeds = rates * np.sum(weights * (slopes * slopes - bends * (states - guesses)), axis=0)
    shape = (len(nodes), nodes.shape[1] - 1, -1)
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
            return equilibrium.one_at_drive(equations, found), None
        except NotConverged:
            # At a fixed v Newton's method fails right beside a fold; the fold itself can be found.
            ended = 0
    event = equilibrium.at_event(equations, conditions[ended], points[:, -1])
    beyond = (event[-1] - target) * np.sign(target - points[-1, 0])
    if beyond <= rounding(equations, target):
        return event, conditions[ended].kind
    # Polished, the event lies beyond the target. Near a fold v is quadratic in the distance to it.
    inside = points[:, -2]
    share = (target - inside[-1]) / (event[-1] - inside[-1])
    found = event + (inside - event) * np.sqrt(max(1.0 - share, 0.0))
    found[-1] = target
    return equilibrium.one_at_drive(equations, found), None


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
    if np.any(turns < 0.7 * lengths):
        raise NotConverged("the path turns too sharply between two points")
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
        found = equilibrium.on_planes(equations, guess, (weights * chord)[:, None])[0][:, 0]
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
        if np.any(inner < -1e-12):
            first = 1 + int(np.argmax(inner < -1e-12))
            beyond = columns[:, first]
        else:
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


def _below_zero(equations: Equations, condition: Condition, states: FloatArray) -> FloatArray | None:
    """A state just beyond the first of two roots that a margin may have in a dip between three states.

    A parabola through the three says where the dip is deepest; its bottom is looked at, not guessed.
    """
    weights = 1.0 / equations.scales**2
    chord = states[:, 2] - states[:, 0]
    for _ in range(4):
        x = (weights * chord) @ (states - states[:, :1])
        left, mid, right = (float(condition.margin(column.tolist())) for column in states.T)
        first, second = (mid - left) / (x[1] - x[0]), (right - mid) / (x[2] - x[1])
        curve = (second - first) / (x[2] - x[0])
        slope = first + curve * (x[1] - x[0])
        bottom = x[1] - 0.5 * slope / curve
        depth = mid - 0.25 * slope * slope / curve
        if not curve > 0.0 or not x[0] < bottom < x[2] or depth > 0.1 * min(left, right):
            return None
        # The first root where there is one, else the bottom.
        wanted = bottom - 0.9 * np.sqrt(max(-depth, 0.0) / curve)
        share = (wanted - x[0]) / (x[2] - x[0])
        guess = states[:, :1] + share * chord[:, None]
        found = equilibrium.on_planes(equations, guess, (weights * chord)[:, None])[0]
        if float(condition.margin(found[:, 0].tolist())) < 0.0:
            return found[:, 0]
        if abs(wanted - x[1]) <= 1e-9 * (x[2] - x[0]):
            return None
        middle = sorted([(x[1], states[:, 1]), (wanted, found[:, 0])], key=lambda pair: pair[0])
        lower = condition.margin(middle[0][1].tolist()) < condition.margin(middle[1][1].tolist())
        triple = (states[:, 0], *(m[1] for m in middle)) if lower else (*(m[1] for m in middle), states[:, 2])
        states = np.stack(triple, axis=1)
        chord = states[:, 2] - states[:, 0]
    return None
