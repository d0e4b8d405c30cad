"""Whether what a statement is about would be seen with real balloons, too: they turn into pears where s falls to zero.

What is judged is the stretch of the way that a statement needs: the path under the rising voltage, the whole path,
the way up to where the first snap comes to rest, or the way back to no voltage.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from simulator.events import EventKind
from tests.oracle.shape import closed_form
from tests.studies.paper.case import Case, Real

if TYPE_CHECKING:
    from simulator.results.curve import Curve, SpecialPoint
    from simulator.results.history import Event

_WITHIN = 2001  # stretches between both sides of a snap
_HOLDS = Real("holds", True)

UNREALISABLE = Real("holds: what spheres can not stay in, real balloons can not either", True)
"""Of states that are unstable among spheres: further shapes only add ways to leave them."""


def inflations(curves: Iterable[Curve]) -> Real:
    """Of inflation curves, whole."""
    least = min(float(curve.sphericity.min()) for curve in curves)
    return Real(f"holds: spheres throughout, s ≥ {least:.4f}", True) if least > 0.0 else Real("no", False)


def rising(cases: Mapping[str, Case]) -> Real:
    """Of paths up to their first limit point, or to their end where there is none."""
    return _together({name: _up_to(case, case.peak or case.curve.end) for name, case in cases.items()})


def whole(cases: Mapping[str, Case]) -> Real:
    """Of whole paths, unstable parts too."""
    return _together({name: _up_to(case, case.curve.end) for name, case in cases.items()})


def snapping(cases: Mapping[str, Case]) -> Real:
    """Of paths and of what their first snap ends in."""
    return _together({name: _snapped(case) for name, case in cases.items()})


def switched_off(cases: Mapping[str, Case]) -> Real:
    """Of whole histories, in which the voltage rises and is taken off again."""
    return _together({name: _switched_off(case) for name, case in cases.items()})


def lost_before(case: Case, end: SpecialPoint) -> SpecialPoint | None:
    """Where a path first stops being one of spheres, before one of its points."""
    before = case.curve.points[: case.curve.points.index(end)]
    return next((point for point in before if point.kind == "loss_of_sphericity"), None)


def first_snap(case: Case) -> Event | None:
    """The first snap of the actuation, whether it comes to rest or ends on its way."""
    return next((event for event in case.actuated if event.kind is EventKind.LIMIT_POINT), None)


def passes_pears(event: Event) -> bool:
    """Whether the active balloon's stretch passes states of s < 0 on the way of a snap.

    s depends on its own stretch and voltage alone, and the stretch passes all values between both sides.
    """
    if event.stretch_after is None:
        return False
    between = np.linspace(event.stretch_before[0], event.stretch_after[0], _WITHIN)[1:-1].tolist()
    gent, voltage = closed_form.Gent(100.0), float(event.voltage[0])
    return any(closed_form.under_voltage(gent.coefficients(x), x, voltage).margin < 0.0 for x in between)


def losses_after(case: Case, snap: Event | None) -> list[Event]:
    """The losses of a history after its first snap, on its way back."""
    lost = [event for event in case.shaped.events if event.kind is EventKind.LOSS_OF_SPHERICITY]
    return [event for event in lost if snap is not None and event.time > snap.time]


def _up_to(case: Case, end: SpecialPoint) -> Real:
    lost = lost_before(case, end)
    return _HOLDS if lost is None else Real(f"**not beyond φ = {lost.voltage[0]:.8f}**", False)


def _snapped(case: Case) -> Real:
    found, snap = rising({"": case}), first_snap(case)
    if not found.holds or snap is None:
        return found
    rests = case.history.time > snap.time
    if rests.any():
        row = int(np.flatnonzero(case.shaped.time == snap.time)[-1])
        if case.shaped.sphericity[row].min() < 0.0:
            return Real("**does not hold: rests as no sphere**", False)
    if passes_pears(snap):
        return Real("open: a sphere up to the snap, which passes states that are none", None)
    return found


def _switched_off(case: Case) -> Real:
    found, falling = _snapped(case), losses_after(case, first_snap(case))
    if found.holds is False:
        return found
    if falling:
        return Real(f"**not below φ = {falling[0].voltage[0]:.8f}, falling**", False)
    if case.shaped.sphericity[-1].min() < 0.0:
        return Real("**does not hold: left as no sphere**", False)
    return found


def _together(found: Mapping[str, Real]) -> Real:
    """What is to be said of several, those that say the same together."""
    words: dict[str, list[str]] = {}
    for name, real in found.items():
        words.setdefault(real.words, []).append(name)
    states = [real.holds for real in found.values()]
    holds = False if False in states else None if None in states else True
    if len(words) == 1:
        return Real(next(iter(words)), holds)
    return Real("; ".join(f"{', '.join(names)}: {text}" for text, names in words.items()), holds)
