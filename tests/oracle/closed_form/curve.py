"""The whole equilibrium curve of a sealed pair, and all equilibria at a voltage."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

from tests.oracle.closed_form.pair import SealedPair, State
from tests.oracle.closed_form.pieces import connected_pieces, resolved
from tests.oracle.closed_form.segments import Point, Segment, cut_at_folds, states_on


class Equilibrium(NamedTuple):
    """An equilibrium at some voltage; `unstable` counts the negative eigenvalues of H there."""

    state: State
    voltage: float
    unstable: int


@dataclass(frozen=True)
class Curve:
    """All equilibria of a pair with p ≥ 0.

    Attributes
    ----------
    pair : SealedPair
    segments : tuple of Segment
        By falling λ₂ along each connected piece of the curve.
    limit_points : tuple of Point
        All of them, between stable or unstable parts.
    loss_of_tension : Point or None
        Where p = 0. There is at most one such point.
    """

    pair: SealedPair
    segments: tuple[Segment, ...]
    limit_points: tuple[Point, ...]
    loss_of_tension: Point | None


def equilibrium_curve(pair: SealedPair) -> Curve:
    """The whole equilibrium curve of a pair.

    Raises
    ------
    ValueError
        If there is no gas.
    ArithmeticError
        If the curve could not be resolved. Seen only where p < 1e-5 and the passive balloon is a thousand
        times larger, so that its stretch hardly differs from 1 and hardly changes.
    """
    if not pair.amount > 0.0:
        raise ValueError("a pair without gas has no equilibrium curve")
    segments: list[Segment] = []
    limit_points: list[Point] = []
    for first, last, nodes in connected_pieces(pair):
        found, folds = cut_at_folds(pair, first, last, resolved(pair, nodes))
        segments += found
        limit_points += folds
    if not segments and pair.sealed.pressure > 0.0:
        raise ArithmeticError("the whole curve is within the rounding of the passive balloon's stretch")
    lost = next((_end_point(s) for s in segments if "loss_of_tension" in (s.first, s.last)), None)
    return Curve(pair, tuple(segments), tuple(limit_points), lost)


def _end_point(segment: Segment) -> Point:
    place: Literal[0, -1] = 0 if segment.first == "loss_of_tension" else -1
    return Point(segment.end(place), segment.voltages[place])


def equilibria(curve: Curve, voltage: float) -> tuple[Equilibrium, ...]:
    """All equilibria at a voltage, stable or not, by rising stretch of the active balloon.

    At a limit point's own voltage that point is among them twice, once for each of the two that merge in it.
    """
    square = voltage * voltage
    found = [
        Equilibrium(State(*states_on(curve.pair, s, [voltage])[:, 0].tolist()), voltage, s.unstable)
        for s in curve.segments
        if s.squares[0] <= square <= s.squares[-1]
    ]
    return tuple(sorted(found))
