"""Segments of the equilibrium curve between its limit points and ends; states on them at any voltage."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from simulator.model.elastomers import Number
from tests.oracle.closed_form.pair import SealedPair, State
from tests.oracle.closed_form.points import (
    bracketed_on_cells,
    constraints,
    determinant_of,
    determinant_slope,
    force_excess,
    roots_on_cells,
    voltage_square,
)
from tests.oracle.closed_form.roots import LOOSE, signs

FloatArray = NDArray[np.float64]

End = Literal["unloaded", "limit_point", "loss_of_tension", "stretch_limit", "cut"]


@dataclass(frozen=True)
class Segment:
    """A piece of the equilibrium curve between two limit points or ends; φ² is monotone on it.

    Attributes
    ----------
    nodes : (3, n) array
        Points (λ₁, λ₂, p) in order of rising φ², each to rounding.
    squares : (n,) array
        φ² at them, rising; inf at the stretch limit.
    first, last : str
        What ends it below and above: "unloaded" (φ = 0), "limit_point", "loss_of_tension", "stretch_limit"
        (φ → ∞), "cut" (an active balloon without a stretch limit, followed no further).
    unstable : int
        Number of negative eigenvalues of H on it; 0 where stable.
    """

    nodes: FloatArray
    squares: FloatArray
    first: End
    last: End
    unstable: int

    @property
    def voltages(self) -> tuple[float, float]:
        """The lowest and the highest voltage on it."""
        return float(np.sqrt(self.squares[0])), float(np.sqrt(self.squares[-1]))

    def end(self, place: Literal[0, -1]) -> State:
        """Its first or last point."""
        return State(*self.nodes[:, place].tolist())


class Point(NamedTuple):
    """A special point of the curve, and its voltage."""

    state: State
    voltage: float


def states_on(pair: SealedPair, segment: Segment, voltages: Sequence[float] | FloatArray) -> FloatArray:
    """The states (λ₁, λ₂, p) on a segment at n voltages within its range, shape (3, n).

    Voltages outside the range are brought to its ends.
    """
    squares = np.asarray(voltages, dtype=np.float64) ** 2
    cell = np.clip(np.searchsorted(segment.squares, squares, side="right") - 1, 0, segment.squares.size - 2)
    low, high = segment.nodes[:, cell], segment.nodes[:, cell + 1]
    out = np.where(squares <= segment.squares[cell], low, high)
    inside = (squares > segment.squares[cell]) & (squares < segment.squares[cell + 1])
    if np.any(inside):
        wanted = squares[inside]

        def excess(y: Number, cells: Any) -> Number:
            return force_excess(pair, y, wanted[cells])

        # More voltage than the low node needs: the excess of the elastic force is negative there.
        out[:, inside] = roots_on_cells(pair, low[:, inside], high[:, inside], excess, -np.ones(wanted.size))
    return np.asarray(out)


def cut_at_folds(
    pair: SealedPair, first: End | None, last: End | None, nodes: FloatArray
) -> tuple[list[Segment], list[Point]]:
    """A piece of curve cut into segments, and the limit points between them."""

    def determinant(y: Any, cells: Any = None) -> Any:
        return determinant_of(pair, y)

    def bend(y: Any, cells: Any = None) -> Any:
        return determinant_slope(pair, y)

    # Where |det| has a minimum between two nodes, a pair of roots may hide: that minimum becomes a node.
    sign, slope = signs(determinant(nodes)), determinant_slope(pair, nodes)
    dips = np.flatnonzero(
        (sign[:-1] == sign[1:]) & (sign[:-1] * slope[:-1] < 0.0) & (sign[1:] * slope[1:] > 0.0)
    )
    if dips.size:
        low, high = nodes[:, dips], nodes[:, dips + 1]
        bottom = bracketed_on_cells(pair, low, high, bend, np.sign(slope[dips]), LOOSE)
        nodes = np.insert(nodes, dips + 1, bottom, axis=1)
        sign = signs(determinant(nodes))
    at = np.flatnonzero(sign[:-1] != sign[1:])
    if at.size:
        folds = roots_on_cells(pair, nodes[:, at], nodes[:, at + 1], determinant, sign[at])
        nodes = np.insert(nodes, at + 1, folds, axis=1)
    cuts = [0, *(at + 1 + np.arange(at.size)).tolist(), nodes.shape[1] - 1]
    inner: list[End | None] = ["limit_point"] * at.size
    kinds = [first, *inner, last]
    segments = []
    for begin, end, kind, other in zip(cuts, cuts[1:], kinds, kinds[1:], strict=False):
        part = nodes[:, begin : end + 1]
        squares = np.asarray(voltage_square(pair, part))
        squares[0] = np.inf if kind == "stretch_limit" else squares[0]
        squares[-1] = np.inf if other == "stretch_limit" else squares[-1]
        rising = (
            determinant(part[:, np.argmax(np.abs(determinant(part)[1:-1])) + 1]) > 0.0
            if part.shape[1] > 2
            else squares[-1] > squares[0]
        )
        lower, upper = kind, other
        if not rising:
            part, squares, lower, upper = part[:, ::-1], squares[::-1], other, kind
        if not squares[-1] > 0.0:
            continue
        if lower is None or not squares[0] >= 0.0:
            part, lower = _loaded(pair, part, squares), "unloaded"
            squares = np.maximum(np.concatenate([[0.0], squares[squares.size - part.shape[1] + 1 :]]), 0.0)
        assert upper is not None
        # Next to a limit point neighbours differ by less than rounding.
        squares = np.maximum.accumulate(squares)
        segments.append(Segment(part, squares, lower, upper, _unstable(pair, part)))
    points = [
        Point(State(*nodes[:, i].tolist()), float(np.sqrt(voltage_square(pair, nodes[:, i]))))
        for i in cuts[1:-1]
        if voltage_square(pair, nodes[:, i]) >= 0.0
    ]
    return segments, points


def _loaded(pair: SealedPair, part: FloatArray, squares: FloatArray) -> FloatArray:
    """The nodes with φ² ≥ 0, the first of them at φ = 0."""
    place = int(np.argmax(squares > 0.0))
    low, high = part[:, place - 1 : place], part[:, place : place + 1]
    start = roots_on_cells(pair, low, high, lambda y, _: force_excess(pair, y, 0.0), np.array([-1.0]))
    return np.concatenate([start, part[:, place:]], axis=1)


def _unstable(pair: SealedPair, nodes: FloatArray) -> int:
    """Negative eigenvalues of H on a segment: the same at all inner points, or the curve was not resolved."""
    x, _, p = y = nodes
    n, d = pair.active.elastomer.pole_form(x)
    n1, d1 = pair.active.elastomer.pole_form_slope(x)
    _, _, _, (v1, _, v3) = constraints(pair, y)
    a = pair.active.pressure_load
    diagonal = d * n1 - n * d1 - 3.0 * n * d / x + d * d * a * p * x + d * d * a * x * x * v1 / v3
    counts = np.where(determinant_of(pair, y) < 0.0, 1, np.where(diagonal > 0.0, 0, 2))
    if counts.size == 2:
        return int(counts[0])
    inner = counts[1:-1]
    if np.any(inner != inner[0]):
        raise ArithmeticError("the stability changes between two limit points")
    return int(inner[0])
