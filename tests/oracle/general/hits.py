"""What comes next in a leg: the end of a branch, or a quantity that takes the value at which a step ends."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tests.oracle.general.branch import Branch, End
from tests.oracle.general.drive import Leg
from tests.oracle.general.equations import Equations
from tests.oracle.general.until import Watched

FloatArray = NDArray[np.float64]

SAME_INSTANT = 1e-12  # parts of a step
CLOSE_INSTANT = 1e-9
TURN = 1e-9  # of a drive's scale: a turn so near an event is too close to call


@dataclass(frozen=True)
class Hit:
    """An event of a group, or a quantity that takes its value, at a fraction of the step."""

    fraction: float
    v: float
    group: int
    end: End | None = None
    watched: Watched | None = None
    y: FloatArray | None = None


def first_hits(
    leg: Leg,
    groups: Sequence[Equations],
    branches: Sequence[Branch],
    v: float,
    watched: Sequence[Watched],
) -> tuple[list[Hit], list[str]]:
    """What comes first in the rest of a leg, with whatever comes at that instant, and what is doubtful."""
    sense = math.copysign(1.0, leg.last - leg.first)
    found: list[Hit] = []
    doubts: list[str] = []
    for place, (eq, branch) in enumerate(zip(groups, branches, strict=True)):
        branch.extend(leg.last)
        end, far = branch.end(sense), leg.last
        if end is not None:
            at = float(end.y[-1])
            if abs(at - leg.last) < TURN * eq.scales(end.y)[-1]:
                doubts.append(f"the drive turns, or ends, at the very place of a {end.kind}")
            if sense * (at - leg.last) <= 0.0:
                far = at
                found.append(Hit(leg.when(at), at, place, end=end))
        for w in watched:
            y = w.met(eq, branch, v, far)
            if y is not None:
                found.append(Hit(leg.when(float(y[-1])), float(y[-1]), place, watched=w, y=y))
            doubts += [w.doubt] if w.doubt else []
        doubts += branch.doubts(v, far)
    found.sort(key=lambda hit: (hit.fraction, hit.watched is None))
    for other in found[1:]:
        gap = other.fraction - found[0].fraction
        mixed = (other.watched is None) != (found[0].watched is None)
        if (gap > SAME_INSTANT or mixed) and gap < CLOSE_INSTANT and other.watched is not found[0].watched:
            doubts.append("two events in one instant, or nearly")
    if not found or found[0].watched is not None:
        return found[:1], doubts
    ends = [hit for hit in found if hit.watched is None]
    return [hit for hit in ends if hit.fraction - found[0].fraction <= SAME_INSTANT], doubts
