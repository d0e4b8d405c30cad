"""Stable stretches of equilibrium path, kept for a whole run.

A branch is followed once (`path`). Then the state at any v on it is one interpolation and a few Newton
steps away, for as many v as wanted at once: walking along a known branch, back and forth and again, costs
no integration.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from simulator.model.conditions import Condition
from simulator.model.equations import Equations
from simulator.model.symmetry import symmetry
from simulator.solver import newton
from simulator.solver.certify import sharp
from simulator.solver.corner import at_drive_between
from simulator.solver.follow import follow
from simulator.solver.ida import Effort
from simulator.solver.segment import (
    GAUSS_POINTS,
    SHORT,
    STRAIGHT,
    ULPS,
    Cubics,
    Segment,
    between,
    rounding,
    shares,
    straight,
    where_rising,
    work,
)

FloatArray = NDArray[np.float64]

_LEAVE = 1e-3  # stretch by which a branch is started off the branch point that it leaves
_ROUNDING = 1e-7  # in scaled unknowns: of states beside a limit point
_MOST_SAMPLES = 16  # sets of samples that a branch remembers


def beside(
    equations: Equations, point: FloatArray, escape: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The state close to a branch point on the branch that leaves it along `escape`; how it moves; the way.

    All (n_unknowns, 1). Raises NotConverged where no branch leaves that way.
    """
    out = np.zeros((point.size, 1))
    out[: escape.size, 0] = escape
    weights = 1.0 / equations.scales[:, None] ** 2
    near, rates = newton.on_planes(equations, point[:, None] + _LEAVE * out, weights * out)
    return near, rates, out


@dataclass(frozen=True)
class BranchEnd:
    """Where a branch ends for good: the kind of event and its state."""

    kind: str
    state: FloatArray


@dataclass(eq=False)
class Branch:
    """A stable stretch of equilibrium path, known from `states[-1, 0]` to `states[-1, -1]` so far.

    One that is followed further stays the same: branches are compared, and hashed, by identity.

    Attributes
    ----------
    states, tangents : (n_unknowns, n) arrays
        Polished points in order of rising v, and tangents towards rising v.
    work : (n − 1,) array
        ∫ −∂Π/∂v dv over the interval between each two points.
    dense, speeds : (n_unknowns, n − 1, k) arrays
        Polished states at the Gauss points between each two points, and directions there; see `Segment`.
    lower, upper : BranchEnd or None
        The event that ends it below and above, once met.
    """

    equations: Equations
    conditions: tuple[Condition, ...]
    states: FloatArray
    tangents: FloatArray
    work: FloatArray
    dense: FloatArray
    speeds: FloatArray
    lower: BranchEnd | None = None
    upper: BranchEnd | None = None
    _works: dict[tuple[float, float], float] = field(default_factory=dict, repr=False)
    _shares: dict[tuple[float, float], FloatArray] = field(default_factory=dict, repr=False)
    _corners: dict[float, FloatArray] = field(default_factory=dict, repr=False)
    _samples: dict[bytes, FloatArray] = field(default_factory=dict, repr=False)
    _cubics: Cubics | None = field(default=None, repr=False)

    @classmethod
    def through(cls, equations: Equations, conditions: tuple[Condition, ...], state: FloatArray) -> Branch:
        """The branch through a polished state, nothing else of it known yet."""
        none = np.zeros((state.size, 0, GAUSS_POINTS.size))
        return cls(
            equations, conditions, state[:, None].copy(), np.zeros((state.size, 1)), np.zeros(0), none, none
        )

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
        try:
            near, rates, out = beside(equations, point, escape)
        except newton.NotConverged:
            return None  # no branch leaves in that direction
        if (near[-1, 0] - point[-1]) * direction <= 0.0 or conditions[0].margin(near[:, 0].tolist()) <= 0.0:
            return None
        return cls._between(equations, conditions, point, near, (out, rates), direction)

    @classmethod
    def straight_on(
        cls, equations: Equations, conditions: tuple[Condition, ...], point: FloatArray, direction: float
    ) -> Branch | None:
        """The stable branch on which balloons alike in a branch point stay alike; parameters as of `leaving`.

        None if there is none: the state beyond is not stable.
        """
        alike = symmetry(equations, point)
        if alike is None:
            return None
        narrow = np.repeat(alike.narrowed(point)[:, None], 2, axis=1)
        narrow[-1, 1] += direction * _LEAVE * equations.scales[-1]
        way = np.zeros((len(narrow), 2))
        way[-1] = direction
        try:
            narrow[:, 1] = newton.one_at_drive(alike.equations, narrow[:, 1])
            ahead = np.array(alike.widened(newton.tangents(alike.equations, narrow, way)))
        except (newton.NotConverged, np.linalg.LinAlgError):
            return None
        near = np.array(alike.widened(narrow))[:, 1:]
        if any(condition.margin(near[:, 0].tolist()) <= 0.0 for condition in conditions):
            return None
        return cls._between(equations, conditions, point, near, (ahead[:, :1], ahead[:, 1:]), direction)

    @classmethod
    def _between(
        cls,
        equations: Equations,
        conditions: tuple[Condition, ...],
        point: FloatArray,
        near: FloatArray,
        directions: tuple[FloatArray, FloatArray],
        direction: float,
    ) -> Branch | None:
        """The branch from a branch point to a state near it, with directions there; None if it is none."""
        nodes = np.concatenate([point[:, None], near], axis=1)
        tangents = np.concatenate([newton.unit(equations, d) for d in directions], axis=1)
        if sharp(equations, nodes, tangents).size:
            return None  # Newton's method has found another state, far off
        segment, astray = Segment.through(equations, nodes, tangents)
        if astray.size:
            return None
        done = segment.work(equations)
        end = BranchEnd(conditions[0].kind, point)
        if direction > 0.0:
            return cls(equations, conditions, nodes, tangents, done, segment.dense, segment.speeds, lower=end)
        dense, speeds = segment.dense[:, ::-1, ::-1], -segment.speeds[:, ::-1, ::-1]
        return cls(equations, conditions, nodes[:, ::-1], -tangents[:, ::-1], -done, dense, speeds, upper=end)

    def reach(self, v: float, rtol: float, effort: Effort) -> BranchEnd | None:
        """Follow the branch until it is known at `v`; return the end that comes before it, if one does."""
        low, high = self.known_range()
        if v > high and self.upper is None:
            segment = follow(self.equations, self.conditions, self.states[:, -1], v, rtol, effort)
            ahead = newton.unit(self.equations, segment.tangents)  # by these scales, however it was followed
            self.states = np.concatenate([self.states[:, :-1], segment.states], axis=1)
            self.tangents = np.concatenate([self.tangents[:, :-1], ahead], axis=1)
            self.work = np.concatenate([self.work, segment.work(self.equations)])
            self.dense = np.concatenate([self.dense, segment.dense], axis=1)
            self.speeds = np.concatenate([self.speeds, segment.speeds], axis=1)
            self._cubics = None
            if segment.end is not None:
                self.upper = BranchEnd(segment.end, segment.states[:, -1].copy())
        elif v < low and self.lower is None:
            segment = follow(self.equations, self.conditions, self.states[:, 0], v, rtol, effort)
            ahead = newton.unit(self.equations, segment.tangents)
            self.states = np.concatenate([segment.states[:, ::-1], self.states[:, 1:]], axis=1)
            self.tangents = np.concatenate([-ahead[:, ::-1], self.tangents[:, 1:]], axis=1)
            self.work = np.concatenate([-segment.work(self.equations)[::-1], self.work])
            self.dense = np.concatenate([segment.dense[:, ::-1, ::-1], self.dense], axis=1)
            self.speeds = np.concatenate([-segment.speeds[:, ::-1, ::-1], self.speeds], axis=1)
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
            self._samples[key] = self.solved(v)
        return self._samples[key]

    def outline(self, count: int) -> FloatArray:
        """The branch in outline: its points, and `count` states on the cubic between each two, not polished.

        Returns
        -------
        (n_unknowns, n + (n − 1) count) array
            In order of rising v.
        """
        c = self._through_points()
        x = np.arange(count + 1) / (count + 1.0)
        y0, m0, a, b = (part[:, :, None] for part in (c.y0, c.m0, c.a, c.b))
        inner = (y0 + x * (m0 + x * (a + x * b))).reshape(len(self.states), -1)
        return np.concatenate([inner, self.states[:, -1:]], axis=1)

    def closely(self) -> tuple[FloatArray, FloatArray]:
        """All polished states that are known, and unit directions towards rising v in which the path goes on.

        Returns
        -------
        states, headings : (n_unknowns, n + (n − 1) k) arrays
            The points and the states at the Gauss points between them, in order of rising v.
        """
        inner = newton.unit(self.equations, self.speeds.reshape(len(self.states), -1))
        rows, last = len(self.states), self.states.shape[1] - 1
        parts = (self.states, self.dense), (self.tangents, inner.reshape(self.dense.shape))
        states, headings = (
            np.concatenate(
                [np.concatenate([at[:, :-1, None], on], axis=2).reshape(rows, -1), at[:, last:]], axis=1
            )
            for at, on in parts
        )
        return states, headings

    def _through_points(self) -> Cubics:
        if self._cubics is None:
            weights = 1.0 / self.equations.scales[:, None] ** 2
            self._cubics = Cubics.through(weights, self.states, self.tangents)
        return self._cubics

    def solved(self, v: FloatArray) -> FloatArray:
        """As `at`, for states that nobody will ask for again."""
        nodes = self.states[-1]
        if nodes.size == 1:
            return np.repeat(self.states, v.size, axis=1)
        place = np.clip(np.searchsorted(nodes, v, side="right") - 1, 0, nodes.size - 2)
        # Points of the branch are taken as they are: at a fold, Newton at fixed v cannot do better.
        states = self.states[:, np.where(v >= nodes[place + 1], place + 1, place)]
        inside = (v > nodes[place]) & (v < nodes[place + 1])
        if inside.any():
            states[:, inside] = self._on_curve(place[inside], v[inside])
        return states

    def _on_curve(self, place: NDArray[np.int64], v: FloatArray) -> FloatArray:
        """The states at v, each in its interval, (n_unknowns, n)."""
        states = self.interpolated(place, v)
        left, right = self.states[:, place], self.states[:, place + 1]
        # The points of chords that short are on the curve to rounding; Newton's method would not find them.
        far = np.linalg.norm((right - left) / self.equations.scales[:, None], axis=0) > STRAIGHT
        # Nor would it at the ends, where the path turns, or others cross it.
        for end in (left, right):
            beside = np.abs(v - end[-1]) <= ULPS * np.maximum(np.abs(v), self.equations.scales[-1])
            states[:-1, beside] = end[:-1, beside]
            far &= ~beside
        if far.any():
            found = at_drive_between(self.equations, states[:, far], left[:, far], right[:, far])
            self.check_between(place[far], found)
            states[:, far] = found
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
        return self._on_curve(np.array([place]), np.array([v]))[:, 0]

    def check_between(self, place: NDArray[np.int64], states: FloatArray) -> None:
        """States lie between the points of their intervals, where Newton's method may have left it.

        Tangents are within 45° of the chord, so the curve bulges by at most a fifth of it.
        """
        weights = 1.0 / self.equations.scales[:, None] ** 2
        chord = self.states[:, place + 1] - self.states[:, place]
        ahead = states - self.states[:, place]
        square = np.sum(weights * chord * chord, axis=0)
        share = np.sum(weights * chord * ahead, axis=0) / square
        aside = np.sum(weights * (ahead - share * chord) ** 2, axis=0)
        slack = _ROUNDING / np.sqrt(square)
        if np.any((share < -slack) | (share > 1.0 + slack) | (aside > 0.09 * square + _ROUNDING**2)):
            raise newton.NotConverged("a state is not between the points of its branch")

    def interpolated(self, place: NDArray[np.int64], v: FloatArray) -> FloatArray:
        """Interpolated states at v, each in its interval."""
        c = self._through_points()
        y0, m0, a, b = c.y0[:, place], c.m0[:, place], c.a[:, place], c.b[:, place]
        x = where_rising(v - y0[-1], m0[-1], a[-1], b[-1])
        states: FloatArray = y0 + x * (m0 + x * (a + x * b))
        states[-1] = v
        return states

    def work_between(self, start: float, end: float) -> float:
        """∫ −∂Π/∂v dv along the branch from one v to another, both within the known range."""
        first, last = self.states[-1, 0], self.states[-1, -1]
        start, end = (float(min(max(v, first), last)) for v in (start, end))
        if start > end:
            return -self.work_between(end, start)
        if start == end:
            return 0.0
        if (start, end) not in self._works:
            self._works[start, end] = self._quadrature(start, end)
        return self._works[start, end]

    def shares_between(self, start: float, end: float) -> FloatArray:
        """What each membrane has of `work_between`, (n_balloons,), without what the gas supply has of it."""
        if start > end:
            return -self.shares_between(end, start)
        if (start, end) not in self._shares:
            nodes = self.states[-1]
            first, last = np.searchsorted(nodes, start), np.searchsorted(nodes, end, side="right") - 1
            total = np.zeros(len(self.equations.membranes))
            if first <= last:
                parts = [(start, float(nodes[first])), (float(nodes[last]), end)]
                points, ahead = self.states[:, first : last + 1], self.tangents[:, first : last + 1]
                if first < last:
                    dense, speeds, _ = between(self.equations, points, ahead)
                    total += shares(self.equations, dense, speeds)
            else:
                parts = [(start, end)]
            for low, high in parts:
                if low < high:
                    total += shares(self.equations, *self._through(low, high))
            self._shares[start, end] = total
        return self._shares[start, end]

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
        return float(work(self.equations, *self._through(start, end)).sum())

    def _through(self, start: float, end: float) -> tuple[FloatArray, FloatArray]:
        """States at Gauss points within a part of one interval, and speeds there; see `Segment`."""
        points = np.stack([self.state_at(start), self.state_at(end)], axis=1)
        if end - start < SHORT * self.equations.scales[-1]:
            return straight(points[:, :1], points[:, 1:])
        chord = np.diff(points, axis=1)
        directions = np.concatenate(
            [self._tangent_at(v, points[:, i : i + 1], chord) for i, v in enumerate((start, end))], axis=1
        )
        segment, astray = Segment.through(self.equations, points, directions)
        if astray.size:
            raise newton.NotConverged("the curve between two states is far from the cubic through them")
        segment = segment.resolved(self.equations)
        return segment.dense, segment.speeds

    def _tangent_at(self, v: float, state: FloatArray, towards: FloatArray) -> FloatArray:
        """The tangent at the state at one v, columns; that of a point is known, also where curves cross."""
        place = np.flatnonzero(self.states[-1] == v)
        if place.size:
            return self.tangents[:, place[:1]]
        return newton.tangents(self.equations, state, towards)
