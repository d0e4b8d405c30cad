"""Follows the quasi-static equilibrium path: what is proposed is certified, and halved where in doubt.

With the drive as independent variable the path ends at a fold; along its arclength a fold is a regular
point. Points along the path are proposed, cheaply at first (`proposals`), polished and certified (`certify`);
the first proposal that can be certified is the segment.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from simulator.model.conditions import Condition
from simulator.model.equations import Equations, OpenBalloon
from simulator.solver import singular
from simulator.solver.certify import NOISE, certified
from simulator.solver.ida import Effort
from simulator.solver.proposals import off_singular, proposals
from simulator.solver.segment import Segment, joined, straight

FloatArray = NDArray[np.float64]

_FAR = 8.0  # over its scale: a v beyond that is measured by itself
_FACTOR = 4.0  # by which v may change until it is measured anew


class PathError(ArithmeticError):
    """The path could not be followed or certified, however it was proposed."""


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
        The curve, and what ends it; stability first.
    start : (n_unknowns,) array
        A state on the curve, with all margins positive.
    target : float
        Where v should get to; v moves monotonically.
    rtol : float
        IDA's tolerance; tightened here where the outcome cannot be certified.
    effort : Effort
        Counters, added to.

    Raises
    ------
    PathError
        If no proposal could be certified.
    """
    pieces: list[Segment] = []
    while True:
        v = float(start[-1])
        onward = _onward(equations, v, target)
        measured = equations.measured_by(abs(v) / _FAR)
        pieces.append(_followed(measured, conditions, start, onward, rtol, effort))
        if onward == target or pieces[-1].end is not None:
            return joined(pieces)
        start = pieces[-1].states[:, -1]


def _onward(equations: Equations, v: float, target: float) -> float:
    """How far towards a target the scale of v can stay that of a v now: to a multiple or a part of it.

    The charge of a film grows with the fourth power of its stretch. Measured by that of an unstretched film
    it would be all of the arclength, and the stretches, however they turn, none of it.
    """
    if isinstance(equations, OpenBalloon) and equations.pressure_rate:
        return target
    far = _FAR * float(equations.scales[-1])
    low, high = sorted((v / _FACTOR, v * _FACTOR)) if abs(v) > far else (-_FACTOR * far, _FACTOR * far)
    return min(max(target, low), high)


def _followed(
    equations: Equations,
    conditions: Sequence[Condition],
    start: FloatArray,
    target: float,
    rtol: float,
    effort: Effort,
) -> Segment:
    """As `follow`, with one scale of v."""
    crossing = float(conditions[0].margin(start.tolist())) < NOISE and not singular.is_fold(equations, start)
    if crossing:
        off = _off_singular(equations, conditions, start, target, rtol, effort)
        if off is not None:
            return off
    failure: Exception | None = None
    for propose in proposals(equations, conditions, start, target, rtol, effort):
        try:
            proposal = propose()
            if proposal is not None:
                return certified(equations, conditions, proposal, target)
        except (ArithmeticError, np.linalg.LinAlgError) as not_certain:
            failure = not_certain
    off = _off_singular(equations, conditions, start, target, rtol, effort)
    if off is not None:
        return off
    if crossing:
        # No path goes on: what the drive pushes is driven away at once.
        ahead = np.zeros_like(start)
        ahead[-1] = equations.scales[-1] * (1.0 if target > start[-1] else -1.0)
        return Segment.at_once(start, ahead, conditions[0].kind)
    raise PathError(f"{failure} from v = {start[-1]:.12g} to {target:.12g}") from failure


def _off_singular(
    equations: Equations,
    conditions: Sequence[Condition],
    start: FloatArray,
    target: float,
    rtol: float,
    effort: Effort,
) -> Segment | None:
    """As `follow`, off a singular state that is no limit point; None if no path sets out from there."""
    off = off_singular(equations, conditions, start, target)
    if off is None:
        return None
    nodes, tangents = off
    dense, speeds = straight(nodes[:, :1], nodes[:, 1:])
    first = Segment(nodes, tangents, dense, speeds, None)
    return joined([first, _followed(equations, conditions, nodes[:, 1], target, rtol, effort)])
