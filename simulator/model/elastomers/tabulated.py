"""An elastomer known by a measured curve."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simulator.model.elastomers.law import Number

_DEGREE = 5
FEWEST = _DEGREE + 1  # rows that such a spline needs without end conditions


@dataclass(frozen=True)
class Tabulated:
    """Elastomer whose f(λ) is the quintic spline through a table, known up to the table's last stretch.

    The spline (not-a-knot) has four continuous derivatives: a history's path and its work integrals do not
    notice the rows, as they do those of a cubic one. Where the table samples a smooth law at distances h, f
    is right to O(h⁶), and the limit points of a balloon to O(h⁵) in the stretch and O(h⁶) in the pressure.
    It passes through every row: noise of a measurement is to be smoothed before.
    Beyond the last row (and below λ = 1) f goes on straight, only so that a solver may look there: a history
    ends at the last row.

    Make one with `Tabulated.through(stretches, forces)`.

    Parameters
    ----------
    rows : bytes
        Stretches, then forces f, as float64.
    """

    # Bytes, because arrays have neither a plain equality nor a hash.
    rows: bytes

    @classmethod
    def through(cls, stretches: ArrayLike, forces: ArrayLike) -> Tabulated:
        """The elastomer through the points (λ, f).

        Parameters
        ----------
        stretches : (n,) array_like
            From 1 on, rising; at least 6.
        forces : (n,) array_like
            f = ŵ′ over μ: λ² times a balloon's pressure over μH/R, or twice the nominal equal-biaxial stress
            over μ. 0 in the first row, > 0 in the others.

        Raises
        ------
        ValueError
            If they are not so, or if the spline between them is not: f > 0 beyond λ = 1, f′(1) > 0.
        """
        x, f = (np.asarray(values, dtype=np.float64) for values in (stretches, forces))
        if x.ndim != 1 or x.shape != f.shape or x.size < FEWEST:
            raise ValueError(f"stretches and forces must be equally many, at least {FEWEST}")
        if not (np.isfinite(x).all() and np.isfinite(f).all()):
            raise ValueError("stretches and forces must be finite")
        if x[0] != 1.0 or f[0] != 0.0:
            raise ValueError(f"the first row must be stretch 1 and force 0, is {x[0]:g} and {f[0]:g}")
        if not ((np.diff(x) > 0.0).all() and (f[1:] > 0.0).all()):
            raise ValueError("stretches must rise, and forces be > 0 beyond the first row")
        made = cls(np.array([x, f]).tobytes())
        between = (x[:-1] + np.diff(x) * np.linspace(0.125, 0.875, 7)[:, None]).T.ravel()
        below = np.asarray(made.pole_form(between)[0]) <= 0.0
        if below.any() or not made.pole_form_slope(1.0)[0] > 0.0:
            place = float(between[np.argmax(below)]) if below.any() else 1.0
            raise ValueError(f"the curve through the rows falls below 0 near stretch {place:.4g}, smooth it")
        return made

    @cached_property
    def _pieces(self) -> tuple[list[tuple[float, ...]], NDArray[np.float64], list[float]]:
        """For each interval: where it starts, ŵ there, and f's coefficients from the constant one on.

        The first is that below λ = 1, the last that beyond the table. Once as tuples, once as an array's
        columns; and the stretches where one goes over into the next.
        """
        from scipy.interpolate import PPoly, make_interp_spline

        x, f = np.frombuffer(self.rows).reshape(2, -1)
        spline = PPoly.from_spline(make_interp_spline(x, f, k=_DEGREE))
        # The B-spline's ends are multiple knots: intervals of no length.
        long = np.diff(spline.x) > 0.0
        starts, coefficients = spline.x[:-1][long], spline.c[::-1, long]
        energy = spline.antiderivative()(starts)
        inner = np.column_stack([starts, energy, coefficients.T])
        below, beyond = (
            [x[i], spline.antiderivative()(x[i]), f[i], spline(x[i], 1), *[0.0] * (_DEGREE - 1)]
            for i in (0, -1)
        )
        pieces = np.vstack([below, inner, beyond])
        pieces[0, 1], pieces[1, 1:3] = 0.0, 0.0  # exactly 0 at λ = 1, whatever the spline's rounding
        return [tuple(row) for row in pieces.tolist()], pieces.T, [*starts.tolist(), float(x[-1])]

    @cached_property
    def largest_stretch(self) -> float:
        """The table's last stretch."""
        return self._pieces[2][-1]

    @property
    def stretch_limit(self) -> float:
        return float("inf")

    def _piece(self, stretch: Number) -> Sequence[Number]:
        """The interval that a stretch, by its real part, lies in, as in `_pieces`."""
        rows, columns, knots = self._pieces
        if isinstance(stretch, float | complex):
            return rows[bisect_right(knots, stretch.real)]
        return list(columns[:, np.searchsorted(knots, np.real(stretch), side="right")])

    def energy(self, stretch: Number) -> Number:
        start, energy, a, b, c, d, e, f = self._piece(stretch)
        x = stretch - start
        return energy + x * (a + x * (b / 2.0 + x * (c / 3.0 + x * (d / 4.0 + x * (e / 5.0 + x * f / 6.0)))))

    def pole_form(self, stretch: Number) -> tuple[Number, Number]:
        start, _, a, b, c, d, e, f = self._piece(stretch)
        x = stretch - start
        return a + x * (b + x * (c + x * (d + x * (e + x * f)))), 1.0

    def pole_form_slope(self, stretch: Number) -> tuple[Number, Number]:
        start, _, _, b, c, d, e, f = self._piece(stretch)
        x = stretch - start
        return b + x * (2.0 * c + x * (3.0 * d + x * (4.0 * e + x * 5.0 * f))), 0.0
