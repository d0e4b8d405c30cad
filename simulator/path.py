"""Follows the quasi-static equilibrium path with IDA, along its arclength, and keeps it as branches.

With the drive as independent variable the path ends at a fold; along its arclength s a fold is a regular
point. So IDA integrates the DAE

    residual(y) = 0,    |dy/ds|² = 1   (in scaled unknowns),

loosely: s only labels points, and every point it visits is then polished by Newton's method, all at once.
What is kept of a stable stretch of path between two events is a `Branch`: polished points, in order of v,
from which the state at any v is one interpolation and a few Newton steps away. Walking along a known
branch, back and forth and again, costs no integration.
"""

from __future__ import annotations

import contextlib
import io
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from simulator import equilibrium
from simulator.equilibrium import NotConverged
from simulator.events import Condition
from simulator.model import Equations

if TYPE_CHECKING:
    from collections.abc import Sequence

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
# Tolerance, over the one asked for, and longest step (0: any) of each attempt to follow a piece.
_ATTEMPTS = ((1.0, 0.0), (0.1, 0.0), (1e-2, 0.25), (1e-3, 0.05), (1e-4, 0.01), (1e-5, 2e-3))
_MOST_SAMPLES = 16  # sets of samples that a branch remembers
_LEAVE = 1e-3  # stretch by which a branch is started off the branch point that it leaves
_SHORT = 1e-7  # in v over its scale: too short a piece to be integrated
_ULPS = 4.0 * np.finfo(float).eps  # two values of v closer than this, relatively, are one


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
    work : (n − 1,) array
        ∫ −∂Π/∂v dv over the interval between each two of them.
    end : str or None
        Kind of the condition that ended it; None where it reached its target.
    """

    states: FloatArray
    tangents: FloatArray
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
    if abs(target - start[-1]) < _SHORT * equations.scales[-1]:
        short = _short(equations, conditions, start, target)
        if short is not None:
            return short
    failure = None
    for tighter, largest_step in _ATTEMPTS:
        try:
            points, directions, ended = _integrate(
                equations, conditions, start, target, max(rtol * tighter, _TIGHTEST), largest_step, effort
            )
            return _polished(equations, conditions, points, directions, ended, target)
        except NotConverged as not_converged:
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
    if np.max(np.abs(nodes[:, 1] - start) / equations.scales) > 1e3 * _SHORT:
        return None
    if any(float(c.margin(nodes[:, k].tolist())) < 1e3 * _SHORT for c in conditions for k in (0, 1)):
        return None
    power = 0.5 * np.sum(np.asarray(equations.drive_power(nodes)))
    return Segment(nodes, tangents, np.array([power * (target - start[-1])]), None)


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
    from sksundae.ida import IDA

    sense = 1.0 if target > start[-1] else -1.0
    scales = equations.scales
    weights: list[float] = (1.0 / scales**2).tolist()
    margins = [condition.margin for condition in conditions]

    def residual(s: float, y: FloatArray, yp: FloatArray, out: FloatArray) -> None:
        values = equations.residual(y.tolist())
        speed = -1.0
        for w, d in zip(weights, yp.tolist(), strict=True):
            speed += w * d * d
        values.append(speed)
        out[:] = values

    def jacobian(
        s: float, y: FloatArray, yp: FloatArray, res: FloatArray, cj: float, out: FloatArray
    ) -> None:
        _, rows = equations.linearised(y.tolist())
        rows.append([2.0 * cj * w * d for w, d in zip(weights, yp.tolist(), strict=True)])
        out[:] = rows

    def events(s: float, y: FloatArray, yp: FloatArray, out: FloatArray) -> None:
        values = y.tolist()
        found = [margin(values) for margin in margins]
        found.append(sense * (target - values[-1]))
        out[:] = found

    events.direction = [-1] * (len(margins) + 1)  # type: ignore[attr-defined]
    ahead = np.zeros_like(start)
    ahead[-1] = sense
    direction = equilibrium.tangents(equations, start[:, None], ahead[:, None])[:, 0]
    solver: Any = IDA(
        residual,
        jacfn=jacobian,
        eventsfn=events,
        num_events=len(margins) + 1,
        rtol=rtol,
        atol=rtol * scales,
        # IDA starts at order one, whose error over a step h along a curve is about h²; its own guess is h.
        first_step=min(float(np.sqrt(rtol)), largest_step or _LONGEST),
        min_step=1e-12,
        max_nonlin_iters=8,  # |dy/ds|² = 1 is quadratic: now and then the default of 4 is too few
        max_step=largest_step or _LONGEST,
    )
    with contextlib.redirect_stdout(
        io.StringIO()
    ):  # where scikit-sundae prints failures that are mended here
        result = solver.solve([0.0, _LONGEST], start, direction)
    effort.ida_solves += 1
    effort.ida_steps += len(result.t) - 1
    effort.residual_calls += int(result.nfev)
    effort.jacobian_calls += int(result.njev)
    if result.status != 2:
        raise NotConverged(f"IDA: {result.message}")
    return result.y.T.copy(), result.yp.T.copy(), int(np.flatnonzero(result.i_events[-1])[0])


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
    dense, speeds = between(equations, nodes, tangents)
    _check_margins(conditions, nodes, dense, end)
    return Segment(nodes, tangents, work(equations, dense, speeds), end)


def between(equations: Equations, nodes: FloatArray, tangents: FloatArray) -> tuple[FloatArray, FloatArray]:
    """States at the Gauss points between nodes, and how fast they pass, (n_unknowns, n − 1, k) both.

    The speeds are dy/dξ, with ξ ∈ [0, 1] the parameter of the cubic through each two nodes.
    """
    weights = 1.0 / equations.scales[:, None] ** 2
    guesses, slopes, bends = _Cubics.through(weights, nodes, tangents).at_gauss_points()
    states, rates = equilibrium.on_planes(equations, guesses, weights * slopes, accuracy=1e-9)
    # On planes across the cubic c(ξ) the state moves at dy/dξ = rate (|c′|² − c″·(y − c)).
    speeds = rates * np.sum(weights * (slopes * slopes - bends * (states - guesses)), axis=0)
    shape = (len(nodes), nodes.shape[1] - 1, -1)
    return states.reshape(shape), speeds.reshape(shape)


def work(equations: Equations, states: FloatArray, speeds: FloatArray) -> FloatArray:
    """∫ −∂Π/∂v dv over every interval, (n − 1,), from what `between` returns."""
    return np.asarray((np.asarray(equations.drive_power(states)) * speeds[-1]) @ GAUSS_WEIGHTS)


@dataclass(frozen=True)
class _Cubics:
    """Cubics y0 + ξ(m0 + ξ(a + ξb)), ξ ∈ [0, 1], one for each interval; arrays (n_unknowns, n)."""

    y0: FloatArray
    m0: FloatArray
    a: FloatArray
    b: FloatArray

    @classmethod
    def through(cls, weights: FloatArray, points: FloatArray, directions: FloatArray) -> _Cubics:
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
    return _ULPS * max(abs(v), float(equations.scales[-1]))


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


def _check_margins(
    conditions: Sequence[Condition], states: FloatArray, dense: FloatArray, end: str | None
) -> None:
    """No condition was passed on the way: at the points, and between them where a margin dips."""
    columns = np.concatenate([states[:, :-1, None], dense], axis=2).reshape(states.shape[0], -1)
    columns = np.concatenate([columns, states[:, -1:]], axis=1)
    for condition in conditions:
        margin = np.asarray(condition.margin(columns))
        inner = margin[1:] if condition.kind != end else margin[1:-1]
        if np.any(inner < -1e-12):
            raise NotConverged(f"a {condition.kind} was passed unseen")
        # A dip whose parabola goes below zero between three points may hide a pair of roots.
        if margin.size > 2:
            left, mid, right = margin[:-2], margin[1:-1], margin[2:]
            curve = left - 2.0 * mid + right
            dips = (mid < left) & (mid < right)
            with np.errstate(divide="ignore", invalid="ignore"):
                bottom = mid - (right - left) ** 2 / (8.0 * curve)
            if np.any(dips & (bottom < 0.0)):
                raise NotConverged(f"a pair of {condition.kind} may hide between two points")


@dataclass(frozen=True)
class BranchEnd:
    """Where a branch ends for good: the kind of event and its state."""

    kind: str
    state: FloatArray


@dataclass
class Branch:
    """A stable stretch of equilibrium path, known from `states[-1, 0]` to `states[-1, -1]` so far.

    Attributes
    ----------
    states, tangents : (n_unknowns, n) arrays
        Polished points in order of rising v, and tangents towards rising v.
    work : (n − 1,) array
        ∫ −∂Π/∂v dv over the interval between each two points.
    lower, upper : BranchEnd or None
        The event that ends it below and above, once met.
    """

    equations: Equations
    conditions: tuple[Condition, ...]
    states: FloatArray
    tangents: FloatArray
    work: FloatArray
    lower: BranchEnd | None = None
    upper: BranchEnd | None = None
    _works: dict[tuple[float, float], float] = field(default_factory=dict, repr=False)
    _corners: dict[float, FloatArray] = field(default_factory=dict, repr=False)
    _samples: dict[bytes, FloatArray] = field(default_factory=dict, repr=False)
    _cubics: _Cubics | None = field(default=None, repr=False)

    @classmethod
    def through(cls, equations: Equations, conditions: tuple[Condition, ...], state: FloatArray) -> Branch:
        """The branch through a polished state, nothing else of it known yet."""
        return cls(equations, conditions, state[:, None].copy(), np.zeros((state.size, 1)), np.zeros(0))

    @classmethod
    def leaving(
        cls,
        equations: Equations,
        conditions: tuple[Condition, ...],
        point: FloatArray,
        escape: FloatArray,
        direction: float,
    ) -> Branch | None:
        """The stable branch that leaves a branch point along `escape` as v goes on; None if v turns back.

        Parameters
        ----------
        equations, conditions
        point : (n_unknowns,) array
            The branch point, which becomes an end of the new branch.
        escape : (n_balloons,) array
            Unit change of the stretches.
        direction : ±1
            Sense in which v goes on.
        """
        out = np.zeros((point.size, 1))
        out[: escape.size, 0] = escape
        weights = 1.0 / equations.scales[:, None] ** 2
        near, rates = equilibrium.on_planes(equations, point[:, None] + _LEAVE * out, weights * out)
        if (near[-1, 0] - point[-1]) * direction <= 0.0 or conditions[0].margin(near[:, 0].tolist()) <= 0.0:
            return None
        nodes = np.concatenate([point[:, None], near], axis=1)
        tangents = np.concatenate([equilibrium.unit(equations, d) for d in (out, rates)], axis=1)
        done = work(equations, *between(equations, nodes, tangents))
        end = BranchEnd(conditions[0].kind, point)
        if direction > 0.0:
            return cls(equations, conditions, nodes, tangents, done, lower=end)
        return cls(equations, conditions, nodes[:, ::-1], -tangents[:, ::-1], -done, upper=end)

    def reach(self, v: float, rtol: float, effort: Effort) -> BranchEnd | None:
        """Follow the branch until it is known at `v`; return the end that comes before it, if one does."""
        low, high = self.known_range()
        if v > high and self.upper is None:
            segment = follow(self.equations, self.conditions, self.states[:, -1], v, rtol, effort)
            self.states = np.concatenate([self.states[:, :-1], segment.states], axis=1)
            self.tangents = np.concatenate([self.tangents[:, :-1], segment.tangents], axis=1)
            self.work = np.concatenate([self.work, segment.work])
            self._cubics = None
            if segment.end is not None:
                self.upper = BranchEnd(segment.end, segment.states[:, -1].copy())
        elif v < low and self.lower is None:
            segment = follow(self.equations, self.conditions, self.states[:, 0], v, rtol, effort)
            self.states = np.concatenate([segment.states[:, ::-1], self.states[:, 1:]], axis=1)
            self.tangents = np.concatenate([-segment.tangents[:, ::-1], self.tangents[:, 1:]], axis=1)
            self.work = np.concatenate([-segment.work[::-1], self.work])
            self._cubics = None
            if segment.end is not None:
                self.lower = BranchEnd(segment.end, segment.states[:, -1].copy())
        low, high = self.known_range()
        if v > high:
            return self.upper
        return self.lower if v < low else None

    def known_range(self) -> tuple[float, float]:
        """The v between which the branch is known, widened by rounding."""
        low, high = float(self.states[-1, 0]), float(self.states[-1, -1])
        return low - rounding(self.equations, low), high + rounding(self.equations, high)

    def state_at(self, v: float) -> FloatArray:
        """The state at one v within the known range, shape (n_unknowns,). Raises NotConverged."""
        if v not in self._corners:
            self._corners[v] = self._solved_one(v)
        return self._corners[v]

    def at(self, v: FloatArray) -> FloatArray:
        """States at n values of v within the known range, shape (n_unknowns, n). Raises NotConverged."""
        # Cycles ask for the same samples again and again.
        key = v.tobytes()
        if key not in self._samples:
            if len(self._samples) >= _MOST_SAMPLES:
                self._samples.clear()
            self._samples[key] = self._solved(v)
        return self._samples[key]

    def _solved(self, v: FloatArray) -> FloatArray:
        nodes = self.states[-1]
        if nodes.size == 1:
            return np.repeat(self.states, v.size, axis=1)
        place = np.clip(np.searchsorted(nodes, v, side="right") - 1, 0, nodes.size - 2)
        # Points of the branch are taken as they are: at a fold, Newton at fixed v cannot do better.
        states = self.states[:, np.where(v >= nodes[place + 1], place + 1, place)]
        between = (v > nodes[place]) & (v < nodes[place + 1])
        if between.any():
            guesses = self._guess(place[between], v[between])
            states[:, between] = equilibrium.at_drive(self.equations, guesses)
        return states

    def _solved_one(self, v: float) -> FloatArray:
        nodes = self.states[-1]
        if nodes.size == 1 or v >= nodes[-1]:
            return self.states[:, -1]
        if v <= nodes[0]:
            return self.states[:, 0]
        place = int(np.searchsorted(nodes, v, side="right")) - 1
        if nodes[place] == v:
            return self.states[:, place]
        return equilibrium.one_at_drive(self.equations, self._guess(np.array([place]), np.array([v]))[:, 0])

    def _guess(self, place: NDArray[np.int64], v: FloatArray) -> FloatArray:
        """Interpolated states at v, each in its interval."""
        if self._cubics is None:
            weights = 1.0 / self.equations.scales[:, None] ** 2
            self._cubics = _Cubics.through(weights, self.states, self.tangents)
        c = self._cubics
        y0, m0, a, b = c.y0[:, place], c.m0[:, place], c.a[:, place], c.b[:, place]
        x = _where(v - y0[-1], m0[-1], a[-1], b[-1])
        states: FloatArray = y0 + x * (m0 + x * (a + x * b))
        states[-1] = v
        return states

    def work_between(self, start: float, end: float) -> float:
        """∫ −∂Π/∂v dv along the branch from one v to another, both within the known range."""
        if start > end:
            return -self.work_between(end, start)
        if start == end:
            return 0.0
        if (start, end) not in self._works:
            self._works[start, end] = self._quadrature(start, end)
        return self._works[start, end]

    def _quadrature(self, start: float, end: float) -> float:
        nodes = self.states[-1]
        first, last = (
            np.searchsorted(nodes, start, side="left"),
            np.searchsorted(nodes, end, side="right") - 1,
        )
        if first > last:
            return self._part(start, end)
        total = float(self.work[first:last].sum())
        return total + self._part(start, float(nodes[first])) + self._part(float(nodes[last]), end)

    def _part(self, start: float, end: float) -> float:
        """Work over a part of one interval."""
        if start == end:
            return 0.0
        points = np.stack([self.state_at(start), self.state_at(end)], axis=1)
        if end - start < _SHORT * self.equations.scales[-1]:
            return float(0.5 * np.sum(np.asarray(self.equations.drive_power(points))) * (end - start))
        chord = np.repeat(np.diff(points, axis=1), 2, axis=1)
        directions = equilibrium.tangents(self.equations, points, chord)
        return float(work(self.equations, *between(self.equations, points, directions))[0])


def _where(ahead: FloatArray, m0: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """The ξ in [0, 1] at which a rising cubic ξ(m0 + ξ(a + ξb)) takes a value."""
    change, m1 = m0 + a + b, m0 + 2.0 * a + 3.0 * b
    # A parabola with the smaller of the end slopes starts right even where a fold makes that slope zero.
    from_first = m0 <= m1
    slope = np.where(from_first, m0, m1)
    part = np.where(from_first, ahead, change - ahead)
    root = slope + np.sqrt(np.maximum(slope * slope + 4.0 * (change - slope) * part, 0.0))
    x = np.divide(2.0 * part, root, out=np.zeros_like(part), where=root > 0.0)
    x = np.clip(np.where(from_first, x, 1.0 - x), 0.0, 1.0)
    for _ in range(2):
        value = x * (m0 + x * (a + x * b)) - ahead
        slope = m0 + x * (2.0 * a + x * 3.0 * b)
        x = np.clip(x - np.divide(value, slope, out=np.zeros_like(x), where=slope > 0.0), 0.0, 1.0)
    return np.asarray(x)
