"""A segment of equilibrium path: points on it, the curve between each two of them, and the work along it.

Between two neighbouring points the curve is close to a cubic. The states at the nine Gauss points of that
cubic, put on the curve by Newton's method, are what margins are judged by and work is integrated with.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulator.model.equations import Equations
from simulator.solver import newton
from simulator.solver.newton import NotConverged

FloatArray = NDArray[np.float64]
Places = NDArray[np.int64]

_COUNT = 9
# Gauss–Legendre points on [0, 1]: margins and work integrals within each interval between points.
GAUSS_POINTS = 0.5 + 0.5 * np.polynomial.legendre.leggauss(_COUNT)[0]
GAUSS_WEIGHTS = 0.5 * np.polynomial.legendre.leggauss(_COUNT)[1]
# Integrals from 0 to each Gauss point of what is given at all of them.
GAUSS_INTEGRALS = np.linalg.solve(
    np.vander(GAUSS_POINTS, increasing=True).T,
    (GAUSS_POINTS[:, None] ** np.arange(1, _COUNT + 1) / np.arange(1, _COUNT + 1)).T,
).T
_MIDDLE = _COUNT // 2
# The last two Legendre coefficients of what is given at all of them.
_LAST_COEFFICIENTS = np.stack(
    [
        (2 * k + 1) * GAUSS_WEIGHTS * np.polynomial.legendre.Legendre.basis(k)(2.0 * GAUSS_POINTS - 1.0)
        for k in (_COUNT - 2, _COUNT - 1)
    ],
    axis=1,
)
_WORK_ERROR = 1e-10  # of the work of an interval, over that of the segment
_POTENTIAL_NOISE = 1e-14  # of a potential: its rounding
_FINEST = 5e-3  # in scaled unknowns: an interval not halved again for what the potential says
_MOST_HALVINGS = 6
RATES = 1e-12  # accuracy of the speeds at the Gauss points, well below that of the work
STRAIGHT = 1e-6  # in scaled unknowns: the length of a chord that is the curve to rounding
_ASIDE = 0.2  # over the length of an interval: how far the curve may be from the cubic through its ends
SHORT = 1e-7  # in v over its scale: too short to be followed in steps
ULPS = 4.0 * np.finfo(float).eps  # two values of v closer than this, relatively, are one


@dataclass(frozen=True)
class Cubics:
    """Cubics y0 + ξ(m0 + ξ(a + ξb)), ξ ∈ [0, 1], one for each interval; arrays (n_unknowns, n)."""

    y0: FloatArray
    m0: FloatArray
    a: FloatArray
    b: FloatArray

    @classmethod
    def through(cls, weights: FloatArray, points: FloatArray, directions: FloatArray) -> Cubics:
        """Through points (n_unknowns, n + 1) along unit directions; weights are (1/scale)², a column."""
        chords = points[:, 1:] - points[:, :-1]
        return cls.spanning(weights, points[:, :-1], chords, directions[:, :-1], directions[:, 1:])

    @classmethod
    def spanning(
        cls, weights: FloatArray, start: FloatArray, chords: FloatArray, first: FloatArray, last: FloatArray
    ) -> Cubics:
        """From points along chords (n_unknowns, n), with unit directions at both ends."""
        scaled = weights * chords
        length = np.sqrt(np.einsum("ij,ij->j", scaled, chords))
        # Arc over chord, exact to fourth order: the cosines between directions and chord tell the turn.
        cosines = np.einsum("ij,ij->j", scaled, first + last) / length
        m0, m1 = (d * (length * 3.0 / (2.0 + 0.5 * cosines)) for d in (first, last))
        return cls(start, m0, 3.0 * chords - 2.0 * m0 - m1, m0 + m1 - 2.0 * chords)

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


@dataclass(frozen=True)
class Segment:
    """A stretch of equilibrium path on which v is monotone.

    Attributes
    ----------
    states, tangents : (n_unknowns, n) arrays
        Points in the order they were passed; tangents of unit length in scaled unknowns, pointing ahead.
    dense, speeds : (n_unknowns, n − 1, k) arrays
        States at the Gauss points between each two of them, and dy/dξ there, with ξ ∈ [0, 1] the parameter
        of the cubic through the two.
    end : str or None
        Kind of the condition that ended it; None where it reached its target.
    """

    states: FloatArray
    tangents: FloatArray
    dense: FloatArray
    speeds: FloatArray
    end: str | None

    @classmethod
    def through(
        cls, equations: Equations, states: FloatArray, tangents: FloatArray, end: str | None = None
    ) -> tuple[Segment, Places]:
        """The segment through points on the curve, and the intervals in which it strays from its cubic.

        Raises NotConverged where the curve between two points cannot be found.
        """
        dense, speeds, astray = between(equations, states, tangents)
        return cls(states, tangents, dense, speeds, end), astray

    @classmethod
    def at_once(cls, state: FloatArray, tangent: FloatArray, end: str) -> Segment:
        """A segment that ends where it starts."""
        none = np.empty((state.size, 0, GAUSS_POINTS.size))
        return cls(state[:, None], tangent[:, None], none, none, end)

    def halved(self, equations: Equations, places: Places) -> tuple[Segment, Places]:
        """With one more point in the middle of some intervals; and which are astray, as `through` says."""
        # The middle Gauss point is on the curve already.
        new = self.dense[:, places, _MIDDLE]
        return self.with_points(
            equations, places, new, newton.unit(equations, self.speeds[:, places, _MIDDLE])
        )

    def with_points(
        self, equations: Equations, places: Places, points: FloatArray, directions: FloatArray
    ) -> tuple[Segment, Places]:
        """With a point of the curve in each of some intervals; and which are astray, as `through` says."""
        states = np.insert(self.states, places + 1, points, axis=1)
        tangents = np.insert(self.tangents, places + 1, directions, axis=1)
        first = places + np.arange(places.size)
        fresh = np.sort(np.concatenate([first, first + 1]))
        dense, speeds = (np.insert(part, places, 0.0, axis=1) for part in (self.dense, self.speeds))
        dense[:, fresh], speeds[:, fresh], astray = _inside(
            equations, states[:, fresh], states[:, fresh + 1], tangents[:, fresh], tangents[:, fresh + 1]
        )
        return Segment(states, tangents, dense, speeds, self.end), fresh[astray]

    def ending(
        self, equations: Equations, place: int, state: FloatArray, tangent: FloatArray, end: str
    ) -> tuple[Segment, Places]:
        """As far as an event in the interval at `place`; and that interval if it is astray."""
        states = np.concatenate([self.states[:, : place + 1], state[:, None]], axis=1)
        tangents = np.concatenate([self.tangents[:, : place + 1], tangent[:, None]], axis=1)
        dense, speeds, astray = between(equations, states[:, -2:], tangents[:, -2:])
        dense = np.concatenate([self.dense[:, :place], dense], axis=1)
        speeds = np.concatenate([self.speeds[:, :place], speeds], axis=1)
        return Segment(states, tangents, dense, speeds, end), astray + place

    def resolved(self, equations: Equations) -> Segment:
        """With work integrals that are right: intervals too long for them are halved."""
        segment = self
        for _ in range(_MOST_HALVINGS):
            coarse = segment._coarse(equations)
            if not coarse.size:
                break
            segment, astray = segment.halved(equations, coarse)
            if astray.size:
                raise NotConverged("states between two points are far from the cubic through them")
        return segment

    def _coarse(self, equations: Equations) -> Places:
        """Intervals over which the quadrature of the work is not right yet.

        Either the integrand's own Legendre coefficients say so, or, where it is not smooth (at the rows of a
        measured curve, beside a branch point), what the potential lost from point to point.
        """
        # The last two Legendre coefficients of the integrand say how fast all of them fall; what the rule
        # misses is of the order of number 2 × _COUNT.
        integrand = np.asarray(equations.drive_power(self.dense)) * self.speeds[-1]
        largest = np.max(np.abs(integrand), axis=1) + np.finfo(float).tiny
        shares = np.abs(integrand @ _LAST_COEFFICIENTS) / largest[:, None]
        falls = np.max(shares ** (1.0 / np.array([_COUNT - 2, _COUNT - 1])), axis=1)
        done = integrand @ GAUSS_WEIGHTS
        whole = np.abs(done).sum()
        potential = np.asarray(equations.potential(self.states))
        missed = np.abs(np.diff(potential) + done) - _POTENTIAL_NOISE * np.abs(potential).max()
        # Beside a branch point states are found the worse the closer they are to it: shorter is no better.
        lengths = np.linalg.norm(np.diff(self.states, axis=1) / equations.scales[:, None], axis=0)
        missed[lengths < _FINEST] = 0.0
        return np.flatnonzero(np.maximum(largest * falls ** (2 * _COUNT), missed) > _WORK_ERROR * whole)

    def work(self, equations: Equations) -> FloatArray:
        """∫ −∂Π/∂v dv over the interval between each two points, (n − 1,)."""
        return work(equations, self.dense, self.speeds)


def joined(segments: Sequence[Segment]) -> Segment:
    """Segments of one path, each beginning where the one before it ends, as one."""
    if len(segments) == 1:
        return segments[0]
    first, *others = segments
    return Segment(
        np.concatenate([first.states, *(one.states[:, 1:] for one in others)], axis=1),
        np.concatenate(
            [first.tangents[:, :-1], *(one.tangents[:, :-1] for one in others[:-1]), others[-1].tangents],
            axis=1,
        ),
        np.concatenate([one.dense for one in segments], axis=1),
        np.concatenate([one.speeds for one in segments], axis=1),
        segments[-1].end,
    )


def work(equations: Equations, states: FloatArray, speeds: FloatArray) -> FloatArray:
    """∫ −∂Π/∂v dv over every interval, (n − 1,), from states and speeds at its Gauss points."""
    return np.asarray((np.asarray(equations.drive_power(states)) * speeds[-1]) @ GAUSS_WEIGHTS)


def shares(equations: Equations, states: FloatArray, speeds: FloatArray) -> FloatArray:
    """What each membrane has of `work`, (n_balloons,), over all intervals together."""
    rates = speeds[-1]
    return np.array(
        [
            float((np.asarray(membrane.charge_rate(x, states[-1])) * rates @ GAUSS_WEIGHTS).sum())
            for membrane, x in zip(equations.membranes, states, strict=False)
        ]
    )


def between(
    equations: Equations, nodes: FloatArray, tangents: FloatArray
) -> tuple[FloatArray, FloatArray, Places]:
    """The curve between points on it, from the cubics through each two.

    Parameters
    ----------
    equations : Equations
    nodes, tangents : (n_unknowns, n) arrays
        Points of the curve, and unit tangents there.

    Returns
    -------
    dense, speeds : (n_unknowns, n − 1, k) arrays
        States at the Gauss points, and dy/dξ there.
    astray : array of int
        Intervals in which these are far from the cubic, so that they may not be in order.

    Raises
    ------
    NotConverged
        If Newton's method does not find them.
    """
    return _inside(equations, nodes[:, :-1], nodes[:, 1:], tangents[:, :-1], tangents[:, 1:])


def _inside(
    equations: Equations, start: FloatArray, end: FloatArray, first: FloatArray, last: FloatArray
) -> tuple[FloatArray, FloatArray, Places]:
    """As `between`, for intervals from points `start` to `end` with tangents `first` and `last` there."""
    weights = 1.0 / equations.scales[:, None] ** 2
    chords = end - start
    if np.einsum("ij,ij->j", weights * chords, chords).max(initial=0.0) < STRAIGHT**2:
        # The points of chords that short are on the curve to rounding.
        return *straight(start, end), np.zeros(0, dtype=np.int64)
    cubic = Cubics.spanning(weights, start, chords, first, last).at_gauss_points()
    try:
        states, rates = newton.on_planes(equations, cubic[0], weights * cubic[1], accuracy=RATES)
    except NotConverged as failure:
        if failure.failed is None:
            raise
        # The others are found without those that were not; what stands for the lost ones is not used.
        lost: NDArray[np.bool_] = np.any(failure.failed.reshape(-1, GAUSS_POINTS.size), axis=1)
        kept = np.flatnonzero(~lost)
        dense, speeds = straight(start, end)
        if kept.size:
            dense[:, kept], speeds[:, kept], astray = _inside(
                equations, start[:, kept], end[:, kept], first[:, kept], last[:, kept]
            )
            lost[kept[astray]] = True
        return dense, speeds, np.flatnonzero(lost)
    return across(weights, cubic, states, rates)


def across(
    weights: FloatArray,
    cubic: tuple[FloatArray, FloatArray, FloatArray],
    states: FloatArray,
    rates: FloatArray,
) -> tuple[FloatArray, FloatArray, Places]:
    """What `between` returns, from a cubic c(ξ), c′, c″ at Gauss points and the states on its planes."""
    guesses, slopes, bends = cubic
    moved = states - guesses
    squares = np.einsum("ij,ij->j", weights * slopes, slopes)
    astray = np.einsum("ij,ij->j", weights * moved, moved) > _ASIDE**2 * squares
    # On planes across the cubic the state moves at dy/dξ = rate (|c′|² − c″·(y − c)).
    speeds = rates * (squares - np.einsum("ij,ij->j", weights * bends, moved))
    shape = (len(guesses), -1, GAUSS_POINTS.size)
    return (
        states.reshape(shape),
        speeds.reshape(shape),
        np.flatnonzero(astray.reshape(-1, GAUSS_POINTS.size).any(axis=1)),
    )


def straight(start: FloatArray, end: FloatArray) -> tuple[FloatArray, FloatArray]:
    """States at the Gauss points, and speeds, on straight lines between points very close to each other."""
    chords = (end - start)[:, :, None]
    return start[:, :, None] + chords * GAUSS_POINTS, np.repeat(chords, GAUSS_POINTS.size, axis=2)


def rounding(equations: Equations, v: float) -> float:
    """How far apart two values of v near this one must be to differ."""
    return float(ULPS * max(abs(v), float(equations.scales[-1])))


def where_rising(ahead: FloatArray, m0: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
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
