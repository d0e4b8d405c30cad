"""An elastomer known by a measured curve."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simulator.elastomer.law import Number

FEWEST = 4  # rows that a cubic spline without end conditions needs


@dataclass(frozen=True)
class Tabulated:
    """Elastomer whose f(λ) is the cubic spline through a table, known up to the table's last stretch.

    The spline (not-a-knot) has a continuous second derivative, so ŵ has three. Where the table samples a
    smooth law at distances h, f is right to O(h⁴), and the limit points of a balloon to O(h³) in the stretch
    and O(h⁴) in the pressure. It passes through every row: noise of a measurement is to be smoothed before.
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
            From 1 on, rising; at least 4.
        forces : (n,) array_like
            f = ŵ′ over μ: λ² times a balloon's pressure over μH/R, or twice the nominal equal-biaxial stress
            over μ. 0 in the first row, > 0 in the others.

        Raises
        ------
        ValueError
            If they are not so.
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
        return cls(np.array([x, f]).tobytes())

    @cached_property
    def _nodes(self) -> list[float]:
        nodes: list[float] = np.frombuffer(self.rows).reshape(2, -1)[0].tolist()
        return nodes

    @cached_property
    def _pieces(self) -> tuple[list[tuple[float, ...]], NDArray[np.float64]]:
        """For each interval: where it starts, ŵ there, and f's coefficients from the constant one on.

        The first is that below λ = 1, the last that beyond the table.
        """
        from scipy.interpolate import CubicSpline

        x, f = np.frombuffer(self.rows).reshape(2, -1)
        spline = CubicSpline(x, f, bc_type="not-a-knot")
        energy = spline.antiderivative()(x)
        inner = np.column_stack([x[:-1], energy[:-1], spline.c[::-1].T])
        # Exactly 0 at λ = 1, whatever the spline's rounding.
        below, beyond = ([x[i], energy[i], f[i], float(spline(x[i], 1)), 0.0, 0.0] for i in (0, -1))
        pieces = np.vstack([below, inner, beyond])
        return [tuple(row) for row in pieces.tolist()], pieces.T

    @cached_property
    def largest_stretch(self) -> float:
        """The table's last stretch."""
        return self._nodes[-1]

    @property
    def stretch_limit(self) -> float:
        return float("inf")

    def _piece(self, stretch: Number) -> Sequence[Number]:
        """The interval that a stretch, by its real part, lies in, as in `_pieces`."""
        if isinstance(stretch, float | complex):
            return self._pieces[0][bisect_right(self._nodes, stretch.real)]
        return list(self._pieces[1][:, np.searchsorted(self._nodes, np.real(stretch), side="right")])

    def energy(self, stretch: Number) -> Number:
        start, energy, a, b, c, d = self._piece(stretch)
        x = stretch - start
        return energy + x * (a + x * (b / 2.0 + x * (c / 3.0 + x * d / 4.0)))

    def pole_form(self, stretch: Number) -> tuple[Number, Number]:
        start, _, a, b, c, d = self._piece(stretch)
        x = stretch - start
        return a + x * (b + x * (c + x * d)), 1.0

    def pole_form_slope(self, stretch: Number) -> tuple[Number, Number]:
        start, _, _, b, c, d = self._piece(stretch)
        x = stretch - start
        return b + x * (2.0 * c + x * 3.0 * d), 0.0
