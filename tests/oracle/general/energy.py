"""The energy balance: works along branches by quadrature over their points, storage by differences."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from tests.oracle.general.branch import Branch, Piece
from tests.oracle.general.equations import Equations

FloatArray = NDArray[np.float64]

POINTS = 8  # intervals of the Chebyshev points on a piece of path


@dataclass(frozen=True)
class Energy:
    """Energies of a history, in units of 4πR²Hμ.

    `electrical_work` is ∫Σφ dq, `gas_work` ∫p dV of the supply while the valve is open, `stored` the change
    of Π + Σφq (+ pV, valve open), `dissipated` what jumps and snaps lost, `exchanged` ∫|φ dq| + ∫|p dV|
    along branches.
    """

    electrical_work: float = 0.0
    gas_work: float = 0.0
    stored: float = 0.0
    dissipated: float = 0.0
    exchanged: float = 0.0

    @property
    def imbalance(self) -> float:
        """Work less what it became; 0 if all is right."""
        return self.electrical_work + self.gas_work - self.stored - self.dissipated

    def plus(
        self, electrical: float = 0.0, gas: float = 0.0, stored: float = 0.0, dissipated: float = 0.0
    ) -> Energy:
        """The balance with something added."""
        return replace(
            self,
            electrical_work=self.electrical_work + electrical,
            gas_work=self.gas_work + gas,
            stored=self.stored + stored,
            dissipated=self.dissipated + dissipated,
            exchanged=self.exchanged + abs(electrical) + abs(gas),
        )


@dataclass(frozen=True)
class Stay:
    """A stay on a branch from one v to another."""

    equations: Equations
    branch: Branch
    first: float
    last: float


def stored(eq: Equations, y: FloatArray) -> float:
    """What a set of balloons and their gas store."""
    z = y.tolist()
    out = eq.potential(z)
    if not eq.charged:
        out += math.fsum(f * q for f, q in zip(eq.voltages(z), eq.charges(z), strict=True))
    return out if eq.closed else out + eq.pressure_of(z) * eq.volume(z)


def flow_work(eq: Equations, before: FloatArray, after: FloatArray) -> tuple[float, float]:
    """What the supplies deliver at a frozen drive: Σφ Δq and p ΔV."""
    a, b = before.tolist(), after.tolist()
    electrical = 0.0
    if not eq.charged:
        electrical = math.fsum(
            f * (q1 - q0) for f, q0, q1 in zip(eq.voltages(b), eq.charges(a), eq.charges(b), strict=True)
        )
    return electrical, 0.0 if eq.closed else eq.pressure_of(b) * (eq.volume(b) - eq.volume(a))


def balance_of(stays: Iterable[Stay], booked: Energy) -> Energy:
    """What jumps and snaps did, and the works along all stays on branches."""
    out = booked
    known: dict[tuple[int, float, float], tuple[float, float, float]] = {}
    for stay in stays:
        key = id(stay.branch), stay.first, stay.last
        if key not in known:
            ends = [stay.branch.state(v) for v in (stay.first, stay.last)]
            change = stored(stay.equations, ends[1]) - stored(stay.equations, ends[0])
            works = [_work(piece) for piece in stay.branch.pieces(stay.first, stay.last)]
            known[key] = sum(w[0] for w in works), sum(w[1] for w in works), change
        electrical, gas, change = known[key]
        out = out.plus(electrical, gas, change)
    return out


@cache
def _rule() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Chebyshev points on [0, 1], weights of Clenshaw and Curtis, and the matrix that differentiates."""
    k = np.arange(POINTS + 1)
    x = 0.5 * (1.0 - np.cos(np.pi * k / POINTS))
    powers = np.vander(2.0 * x - 1.0, increasing=True)
    moments = np.array([0.0 if j % 2 else 1.0 / (j + 1) for j in k])
    weights = np.linalg.solve(powers.T, moments)
    c = np.where((k == 0) | (k == POINTS), 2.0, 1.0) * (-1.0) ** k
    gaps = x[:, None] - x + np.eye(x.size)
    matrix = np.outer(c, 1.0 / c) / gaps
    matrix -= np.diag(matrix.sum(axis=1))
    return x, weights, matrix


def _work(piece: Piece) -> tuple[float, float]:
    """∫Σφ dq and, valve open, ∫p dV on a piece of path."""
    shares, weights, matrix = _rule()
    eq = piece.eq
    rows = [piece.at(float(share)).tolist() for share in shares]
    phi, q = (np.array([part(y) for y in rows]) for part in (eq.voltages, eq.charges))
    electrical = float(weights @ np.sum(phi * (matrix @ q), axis=1))
    if eq.closed:
        return electrical, 0.0
    p, volume = (np.array([part(y) for y in rows]) for part in (eq.pressure_of, eq.volume))
    return electrical, float(weights @ (p * (matrix @ volume)))
