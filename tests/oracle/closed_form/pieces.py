"""The connected pieces of the equilibrium curve, found over λ₂ and resolved into nodes."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from simulator.model.elastomers import Number
from tests.oracle.closed_form.balloons import GRID, UNBOUNDED, balloon_pressure
from tests.oracle.closed_form.pair import SealedPair
from tests.oracle.closed_form.points import metric, projected, tangent_of
from tests.oracle.closed_form.roots import all_roots, bracketed, clustered
from tests.oracle.closed_form.segments import End

FloatArray = NDArray[np.float64]

_LENGTH = 0.05  # longest piece of curve between two nodes, relative to λ and p
_ANGLE = 0.15  # sharpest turn between two nodes
_MOST_NODES = 50_000


def connected_pieces(pair: SealedPair) -> list[tuple[End | None, End | None, FloatArray]]:
    """Connected pieces of the curve with 1 ≤ λ₁ ≤ λ_lim, by falling λ₂: their ends and some nodes (3, n).

    An end is None where the curve leaves the region at λ₁ = 1, which takes φ² < 0 and is cut off later.
    """
    active, passive = pair.active, pair.passive
    gas = pair.sealed.pressure + pair.ambient
    limit = active.elastomer.stretch_limit
    far: End = "stretch_limit" if np.isfinite(limit) else "cut"
    highest = limit if np.isfinite(limit) else UNBOUNDED

    def lacks(x: Number) -> Callable[[Number], Number]:
        """Like (p(λ₂) + pₑ)V − n with λ₁ = x, as a smooth function of λ₂."""

        def function(z: Number) -> Number:
            n, d = passive.elastomer.pole_form(z)
            slack = n / passive.pressure_load - pair.sealed.pressure * d * z * z
            return slack * pair.volume(x, z) + d * z * z * gas * pair.swelling(x, z)

        return function

    # λ₁ > 0 takes λ₂ below the root of a monotone function; λ₁ between 1 and the limit takes two signs.
    top = passive.elastomer.stretch_limit
    if not np.isfinite(top):
        top = 2.0
        while lacks(0.0)(top) < 0.0:
            top *= 2.0
    if lacks(0.0)(1.0) >= 0.0:
        return []
    top = float(bracketed(lacks(0.0), np.array([1.0]), np.array([top]), np.array([-1.0]))[0])
    grid = 1.0 + (top - 1.0) * clustered(GRID)
    smallest, largest = lacks(1.0), lacks(highest)
    corners = [(z, 1.0) for z in all_roots(smallest, grid)] + [(z, highest) for z in all_roots(largest, grid)]
    ends = [(1.0, 0.0), *sorted(corners), (top, 0.0)]
    pieces: list[tuple[End | None, End | None, FloatArray]] = []
    for (z0, x0), (z1, x1) in pairwise(ends):
        middle = 0.5 * (z0 + z1)
        if not (smallest(middle) <= 0.0 <= largest(middle)) or z0 == z1:
            continue
        if x1 == 0.0 or (x0 == 0.0 and pair.ambient == 0.0):
            continue  # where rounding has it that λ₁ goes to 0, or p with no gas around
        names: list[End | None] = []
        points = []
        for z, x in ((z1, x1), (z0, x0)):
            if x == 0.0:  # p = 0 at λ₂ = 1
                x = (
                    (gas / pair.ambient * 3.0 * pair.volume(*pair.sealed[:2]) - passive.cube) / active.cube
                ) ** (1 / 3)
                names.append("loss_of_tension")
                points.append(projected(pair, np.array([[x], [1.0], [0.0]]), np.array([[0.0], [1.0], [0.0]])))
                points[-1][1:] = [[1.0], [0.0]]
            else:
                names.append(far if x == highest else None)
                guess = np.array([[x], [z], [float(balloon_pressure(passive, z))]])
                points.append(projected(pair, guess, np.array([[1.0], [0.0], [0.0]])))
                points[-1][0] = x
        inner = grid[(grid > z0) & (grid < z1)][::-1]
        inner = inner[(inner < points[0][1]) & (inner > points[1][1])]
        p = np.asarray(balloon_pressure(passive, inner))
        x = np.cbrt((3.0 * pair.amount / (p + pair.ambient) - passive.cube * inner**3) / active.cube)
        across = np.zeros((3, inner.size))
        across[1] = 1.0
        nodes = projected(pair, np.array([x, inner, p]), across) if inner.size else np.empty((3, 0))
        pieces.append((names[0], names[1], np.concatenate([points[0], nodes, points[1]], axis=1)))
    return pieces


def resolved(pair: SealedPair, nodes: FloatArray) -> FloatArray:
    """Nodes so dense that neighbours see each other nearly straight ahead."""
    while nodes.shape[1] < _MOST_NODES:
        weights = metric(pair, nodes)
        tangent = np.array(tangent_of(pair, nodes)) * weights
        tangent = tangent / np.sqrt(np.sum(tangent * tangent, axis=0))
        chord = np.diff(nodes, axis=1)
        length = np.sqrt(np.sum((weights[:, :-1] * chord) ** 2, axis=0))
        turn = 1.0 - np.sum(tangent[:, :-1] * tangent[:, 1:], axis=0)
        split = np.flatnonzero((length > _LENGTH) | ((turn > 0.5 * _ANGLE**2) & (length > 1e-9)))
        if not split.size:
            return nodes
        low, high = nodes[:, split], nodes[:, split + 1]
        weights = weights[:, split]
        middle = projected(pair, 0.5 * (low + high), weights * weights * (high - low))
        # The curve goes strictly towards falling λ₂; where its plane led elsewhere, λ₂ itself is halved.
        astray = ~((middle[1] <= low[1]) & (middle[1] >= high[1]) & (middle[0] > 0.0))
        if np.any(astray):
            z = 0.5 * (low[1] + high[1])[astray]
            p = np.asarray(balloon_pressure(pair.passive, z))
            cube = (3.0 * pair.amount / (p + pair.ambient) - pair.passive.cube * z**3) / pair.active.cube
            across = np.zeros((3, z.size))
            across[1] = 1.0
            middle[:, astray] = projected(pair, np.array([np.cbrt(cube), z, p]), across)
        nodes = np.insert(nodes, split + 1, middle, axis=1)
    raise ArithmeticError("the equilibrium curve takes too many nodes")
