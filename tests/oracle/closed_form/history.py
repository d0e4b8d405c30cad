"""What a sealed pair does under a voltage history: the reference for simulated histories."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tests.oracle.closed_form.curve import Curve, equilibria, equilibrium_curve
from tests.oracle.closed_form.flow import Flow, overdamped_flow
from tests.oracle.closed_form.pair import SealedPair, State
from tests.oracle.closed_form.roots import bracketed
from tests.oracle.closed_form.segments import Segment, states_on

FloatArray = NDArray[np.float64]


class Jump(NamedTuple):
    """A turning point that the voltage jumps to, in place of a ramp."""

    voltage: float


EventKind = Literal["limit_point", "jump", "loss_of_tension", "breakdown", "runaway"]


@dataclass(frozen=True)
class ReferenceEvent:
    """One event, with both sides of its jump; `after` and `dissipated` are None where the history ends.

    `leg` counts the turning points from 0. `dissipated` is Π before − Π after at the voltage of the event.
    """

    kind: EventKind
    leg: int
    voltage: float
    before: State
    after: State | None
    dissipated: float | None


class Margin(NamedTuple):
    """How near a decision of the history was to falling the other way.

    `what` is "turn" (a voltage beside the end of a segment, or of any if it was jumped to), "tension" (the
    lowest pressure of a flow that came to rest), or "breakdown" (the same of 1 − E/E_b); `size` is in units
    of that quantity, `leg` counts the turning points from 0, `events` is how many events there were before.
    `voltage` is that of the decision, without its sign.
    """

    what: Literal["turn", "tension", "breakdown"]
    size: float
    leg: int
    events: int
    voltage: float


@dataclass(frozen=True)
class ReferenceHistory:
    """What a sealed pair does under a voltage history.

    Attributes
    ----------
    outcome : str
        "completed", or the kind of the event that ended it.
    events : tuple of ReferenceEvent
    state, voltage
        At its end.
    segments : tuple of Segment
        Those it stayed on, in order; every event with an `after` at rest begins another.
    margins : tuple of Margin
    """

    outcome: Literal["completed", "loss_of_tension", "breakdown", "runaway"]
    events: tuple[ReferenceEvent, ...]
    state: State
    voltage: float
    segments: tuple[Segment, ...]
    margins: tuple[Margin, ...]


def reference_history(
    pair: SealedPair, turns: Sequence[float | Jump], curve: Curve | None = None
) -> ReferenceHistory:
    """Play voltage ramps (and jumps) from no voltage through turning points, valve closed.

    Between events the state is read off the exact curve. A snap runs along the overdamped flow, integrated
    tightly by SciPy, until it is about to rest at one of the exact equilibria, or ends on the way.

    Parameters
    ----------
    pair : SealedPair
        It starts at the stable equilibrium without voltage that is nearest to `pair.sealed`.
    turns : sequence of float or Jump
        Voltages ramped to, one after the other; negative ones are allowed.
    curve : Curve, optional
        Of the pair, where it is known already.

    Raises
    ------
    ValueError
        If the pair has no stable equilibrium without voltage.
    """
    if pair.sealed.pressure == 0.0:
        return _sealed_without_pressure(pair, turns)
    curve = curve or equilibrium_curve(pair)
    rests = [s for s in curve.segments if s.first == "unloaded" and not s.unstable]
    if not rests:
        raise ValueError("the pair has no stable equilibrium without voltage")
    walk = _Walk(curve, min(rests, key=lambda s: abs(s.nodes[0, 0] - pair.sealed.active)))
    for leg, turn in enumerate(turns):
        if isinstance(turn, Jump):
            walk.jump(leg, turn.voltage)
        elif walk.voltage * turn < 0.0:
            walk.ramp(leg, 0.0, walk.voltage)
            walk.ramp(leg, float(turn), float(turn))
        else:
            walk.ramp(leg, float(turn), float(turn) or walk.voltage)
        if walk.outcome != "completed":
            break
    return ReferenceHistory(
        walk.outcome, tuple(walk.events), walk.state, walk.voltage, tuple(walk.segments), tuple(walk.margins)
    )


def _sealed_without_pressure(pair: SealedPair, turns: Sequence[float | Jump]) -> ReferenceHistory:
    """Sealed at p = 0, tension is lost at the first rise of the voltage."""
    start = State(1.0, 1.0, 0.0)
    for leg, turn in enumerate(turns):
        if (turn.voltage if isinstance(turn, Jump) else turn) != 0.0:
            event = ReferenceEvent("loss_of_tension", leg, 0.0, start, None, None)
            return ReferenceHistory("loss_of_tension", (event,), start, 0.0, (), ())
    return ReferenceHistory("completed", (), start, 0.0, (), ())


class _Walk:
    """Where a reference history is now, and its record."""

    def __init__(self, curve: Curve, segment: Segment) -> None:
        self.curve = curve
        self.pair = curve.pair
        self.segments = [segment]
        self.state = segment.end(0)
        self.voltage = 0.0
        self.events: list[ReferenceEvent] = []
        self.margins: list[Margin] = []
        self.flows: dict[tuple[State, float, EventKind], Flow] = {}
        self.outcome: Literal["completed", "loss_of_tension", "breakdown", "runaway"] = "completed"

    def ramp(self, leg: int, target: float, side: float) -> None:
        """Ramp |φ| to that of `target`; `side` has the sign of the voltages on the way."""
        sign = -1.0 if side < 0.0 else 1.0
        goal = abs(target)
        while self.outcome == "completed":
            segment, now = self.segments[-1], abs(self.voltage)
            lowest, highest = segment.voltages
            if goal == now:
                self.voltage = sign * goal
                return
            rising = goal > now
            end = highest if rising else lowest
            kind = segment.last if rising else segment.first
            breaks = self._breaks(segment, min(goal, highest)) if rising else None
            if breaks is not None:
                self._stop("breakdown", leg, sign * breaks, self._at(segment, breaks))
                return
            if kind not in ("unloaded", "stretch_limit"):
                self.margins.append(Margin("turn", abs(goal - end), leg, len(self.events), end))
            point = segment.end(-1 if rising else 0)
            if (goal <= end) if rising else (goal >= end):
                self.voltage = sign * goal
                self.state = point if goal == end else self._at(segment, goal)
                return
            if kind == "loss_of_tension":
                self._stop("loss_of_tension", leg, sign * end, point)
            elif kind == "cut":
                self._stop("runaway", leg, sign * end, point)
            else:
                self._snap(leg, sign * end, point, rising)

    def jump(self, leg: int, target: float) -> None:
        """Change the voltage at once, and let the state flow."""
        if target == self.voltage:
            return
        special = [
            *self.curve.limit_points,
            *([self.curve.loss_of_tension] if self.curve.loss_of_tension else []),
        ]
        for point in special:
            size = abs(abs(target) - point.voltage)
            self.margins.append(Margin("turn", size, leg, len(self.events), point.voltage))
        if self.state.pressure <= 0.0 and abs(target) > abs(self.voltage):
            self._stop("loss_of_tension", leg, self.voltage, self.state)  # as at the first rise from p = 0
            return
        before, self.voltage = self.state, target
        self._flow("jump", leg, before, np.array(before[:2]), ())

    def _at(self, segment: Segment, voltage: float) -> State:
        return State(*states_on(self.pair, segment, [voltage])[:, 0].tolist())

    def _breaks(self, segment: Segment, highest: float) -> float | None:
        """The voltage, at most `highest`, at which the active film breaks on a stable segment."""
        active = self.pair.active
        if active.breakdown is None:
            return None
        strength = active.breakdown

        def margin(voltages: FloatArray) -> FloatArray:
            stretch = states_on(self.pair, segment, voltages)[0]
            return np.asarray(strength - voltages * stretch * stretch / active.thickness)

        # λ₁ and with it the field rise with the voltage wherever H is positive definite.
        bounds = np.array([abs(self.voltage), min(highest, segment.voltages[1])])
        if not np.isfinite(bounds[1]):
            bounds[1] = strength * active.thickness
        if margin(bounds[1:])[0] > 0.0:
            return None
        return float(bracketed(margin, bounds[:1], bounds[1:], np.array([1.0]))[0])

    def _snap(self, leg: int, voltage: float, fold: State, rising: bool) -> None:
        """Leave a limit point along the null vector of H, downhill: λ₁ goes the way the voltage pushes it."""
        self.voltage = voltage
        values, vectors = np.linalg.eigh(self.pair.hessian(fold, voltage))
        mode = vectors[:, np.argmin(np.abs(values))]
        mode = mode * (np.sign(mode[0]) * (1.0 if rising else -1.0))
        others = [e.state for e in equilibria(self.curve, voltage)]
        gaps = [math.hypot(e.active - fold.active, e.passive - fold.passive) for e in others]
        distance = 1e-3 * min([1.0, *(gap for gap in gaps if gap > 1e-6)])
        # So near that no margin has changed much yet.
        at_fold = self._margins(np.array(fold[:2]))
        while (
            np.any(self._margins(np.array(fold[:2]) + distance * mode) < 0.99 * at_fold) and distance > 1e-9
        ):
            distance *= 0.1
        self._flow("limit_point", leg, fold, np.array(fold[:2]) + distance * mode, (fold,))

    def _margins(self, stretches: FloatArray) -> FloatArray:
        """The pressure and, where there is a strength, 1 − E/E_b."""
        active = self.pair.active
        field = abs(self.voltage) * stretches[0] ** 2 / active.thickness
        strength = 1.0 - field / active.breakdown if active.breakdown else 1.0
        return np.array([self.pair.pressure(*stretches.tolist()), strength])

    def _flow(
        self, kind: EventKind, leg: int, before: State, start: FloatArray, excluded: tuple[State, ...]
    ) -> None:
        """Record a jump along the flow from `start`, and go on from where it ends."""
        segments = {
            self._at(s, abs(self.voltage)): s
            for s in self.curve.segments
            if s.voltages[0] <= abs(self.voltage) <= s.voltages[1]
        }
        stable = [
            state
            for state, s in segments.items()
            if not s.unstable and all(max(map(abs, np.subtract(state, e))) > 1e-6 for e in excluded)
        ]
        key = (before, self.voltage, kind)
        if key not in self.flows:
            self.flows[key] = overdamped_flow(self.pair, self.voltage, start, stable, list(segments))
        flow = self.flows[key]
        if flow.end == "runaway":
            self.events.append(ReferenceEvent(kind, leg, self.voltage, before, None, None))
            self._stop("runaway", leg, self.voltage, before)
            return
        lost = float(
            self.pair.potential(before, self.voltage) - self.pair.potential(flow.state, self.voltage)
        )
        self.events.append(ReferenceEvent(kind, leg, self.voltage, before, flow.state, lost))
        if flow.end is None:
            here = (leg, len(self.events) - 1, abs(self.voltage))
            self.margins.append(Margin("tension", flow.lowest_pressure, *here))
            if self.pair.active.breakdown is not None:
                self.margins.append(Margin("breakdown", flow.lowest_strength, *here))
            self.state = flow.state
            self.segments.append(segments[flow.state])
        else:
            self._stop(flow.end, leg, self.voltage, flow.state)

    def _stop(
        self, kind: Literal["loss_of_tension", "breakdown", "runaway"], leg: int, voltage: float, state: State
    ) -> None:
        self.events.append(ReferenceEvent(kind, leg, voltage, state, None, None))
        self.outcome, self.voltage, self.state = kind, voltage, state
