"""What follows when voltages or the valve change at once: the flow of balloons from where they are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tests.oracle.general import flow, points
from tests.oracle.general.equations import Equations
from tests.oracle.general.flow import Rest

FloatArray = NDArray[np.float64]

CLOSE = 1e-9  # a margin at the instant of a change that is too close to call
NEARLY_LOOSE = 1e-7

Snap = tuple[Equations, FloatArray, Rest]


def is_loose(eq: Equations, y: FloatArray) -> tuple[bool, str | None]:
    """Whether a state in equilibrium is unstable, and what is doubtful about that."""
    stability = eq.stability(y.tolist())
    doubt = "a state that is let go is only just stable or not" if abs(stability) < NEARLY_LOOSE else None
    return stability < 0.0, doubt


def slack_at_once(eq: Equations, y: FloatArray) -> tuple[bool, str | None]:
    """Whether a changed voltage takes all tension before anything has moved, and what is doubtful about that.

    The pressure of a liquid follows at once. A gas without pressure loses it where its balloons begin to
    grow.
    """
    if eq.contents is None:
        return False, None
    motion = flow.Motion(eq, float(y[-1]))
    stretch = y[: eq.size].tolist()
    if eq.contents.is_liquid:
        pressure = float(motion.state(stretch)[-2])
        doubt = "a liquid's pressure is only just lost, or not" if abs(pressure) < CLOSE else None
        return pressure < 0.0, doubt
    rates = motion.rates(stretch)
    if eq.contents.gas.ambient == eq.contents.pressure == 0.0:
        return bool(y[-2] <= 0.0 and np.any(rates > 0.0)), None  # nothing is inside: any voltage that rises
    return y[-2] <= 0.0 and float(eq.areas(stretch) @ rates) > 0.0, None


def slack_ahead(eq: Equations, y: FloatArray, v: float) -> tuple[bool, str | None]:
    """Whether at zero pressure, valve closed, it would fall on the way to v, and what is doubtful."""
    if not eq.closed or y[-2] > 0.0:
        return False, None
    ahead = points.at_drive(eq, y, float(y[-1]) + 1e-3 * (v - float(y[-1])))
    if eq.contents is not None and eq.contents.gas.ambient == eq.contents.pressure == 0.0:
        # Nothing at all is inside: the rule of the physics page, a first rise of any |φ|, is all there is.
        rates = [value * rate * (v - y[-1]) for value, rate in eq.given(float(y[-1]))]
        starts = all(value == 0.0 for value, _ in eq.given(float(y[-1])))
        if any(rate > 0.0 for rate in rates) or starts:
            return True, None
        return True, "whether tension is lost in a vacuum"
    if ahead is None or abs(ahead[-2]) < 1e-13:
        return True, "whether tension is lost at zero pressure"
    return bool(ahead[-2] < 0.0), None


def settled(eq: Equations, y: FloatArray) -> Rest:
    """The flow from stretches that are in no equilibrium; broken films break before anything moves."""
    start = np.array(flow.Motion(eq, float(y[-1])).state(y[: eq.size].tolist()))
    doubt = None
    for name in eq.margin_names()[1:]:
        margin = float(eq.margin(name, start.tolist()))
        if name[0] == "breakdown" and abs(margin) < CLOSE:
            doubt = "a film is only just broken by a jump, or not"
        if margin < 0.0 and name[0] != "loss_of_tension":
            return Rest(name[0], name[1], start, 0.0, doubt)
    rest = flow.relax(eq, float(y[-1]), y[: eq.size], y)
    return Rest(rest.kind, rest.balloon, rest.y, rest.lost, rest.doubt or doubt)


def common_flow(eq: Equations, y: FloatArray, loose: Sequence[Equations], *, only: bool) -> Rest:
    """The flow of several balloons at one pressure, those let go by the way that lowers Π more.

    `loose` are the balloons let go, each by itself; `only` says that no other balloon moves.
    """
    if not loose:
        return settled(eq, y)
    start = y[: eq.size].copy()
    doubts: list[str | None] = []
    for part in loose:
        place = eq.members.index(part.members[0])
        state = np.array([y[place], y[-1]])
        alone = flow.release(part, state)
        if len(loose) == 1 and only:
            whole = y.copy()
            whole[place] = alone.y[0]
            return Rest(alone.kind, place if alone.kind else -1, whole, alone.lost, alone.doubt)
        doubts.append(alone.doubt)
        start[place] = flow.beside(part, state, np.array([np.sign(alone.y[0] - state[0])]))[0]
    rest = flow.relax(eq, float(y[-1]), start, y, off=10.0 * flow.OFF)
    if rest.kind is not None:
        doubts.append("several balloons are let go and one of them ends the history")
    return Rest(rest.kind, rest.balloon, rest.y, rest.lost, next(filter(None, [rest.doubt, *doubts]), None))


def together(eq: Equations, snaps: Sequence[Snap]) -> list[Snap]:
    """The common flow of balloons that snap at one instant, where they are alike and begin it alike.

    `eq` are their common equations. Others are returned as they are.
    """
    y, rest = snaps[0][1:]
    at = float(y[-1])
    if len(eq.twins(at)) > 1 or any(abs(other[0] - y[0]) > 1e-12 * y[0] for _, other, _ in snaps):
        return list(snaps)
    start = flow.beside(snaps[0][0], y, np.array([np.sign(rest.y[0] - y[0])]))
    before = np.array([*[y[0]] * eq.size, at])
    return [(eq, before, flow.relax(eq, at, np.repeat(start, eq.size), before, off=10.0 * flow.OFF))]
