"""What a summary says of the balloons' shapes: one plain sentence for each that stops being a sphere."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from simulator import units
from simulator.events import EventKind
from simulator.scenario import Inflate

if TYPE_CHECKING:
    from simulator.results.history import Event, History
    from simulator.results.shapes import Loss, ShapeVerdict

_ENDS = {
    EventKind.LIMIT_POINT: "its limit point",
    EventKind.BRANCH_POINT: "the branch point",
    EventKind.LOSS_OF_TENSION: "the loss of tension",
    EventKind.BREAKDOWN: "breakdown",
}


def shape_lines(history: History) -> Iterator[str]:
    """Whether the balloons stay spheres, in sentences; nothing where the scenario ignores it."""
    verdicts = history.shapes
    lost = [verdict for verdict in verdicts if verdict.losses]
    for verdict in lost:
        yield _sentence(history, verdict)
    if verdicts and not lost:
        yield "all balloons stay spheres"
    elif kept := [verdict.balloon for verdict in verdicts if not verdict.losses]:
        yield f"{_listed(kept)} {'stays a sphere' if len(kept) == 1 else 'stay spheres'}"
    assumed = [verdict.balloon for verdict in verdicts if verdict.pear_only]
    if assumed:
        whose = "its elastomer is" if len(assumed) == 1 else "their elastomers are"
        yield (
            f"{_listed(assumed)}: {whose} known about equal stretches only; "
            "that no other shape comes before the pear is assumed"
        )


def _sentence(history: History, verdict: ShapeVerdict) -> str:
    """What becomes of one balloon that does not stay a sphere."""
    lasting = [loss for loss in verdict.losses if loss.place != "flow"]
    loss = lasting[0] if lasting else verdict.losses[0]
    event = loss.event
    at = _drive(history, event, verdict.balloon)
    if loss.place == "path":
        what = f"would stop being a sphere at {at} ({_state(history, loss, verdict.balloon)})"
    elif loss.place == "rest":
        what = f"would come to rest as no sphere at {at} ({_state(history, loss, verdict.balloon)})"
    else:
        what = f"would pass through shapes that are no spheres, at {at}, to land as a sphere"
    sentence = f"{verdict.balloon} {what}{_before(history, loss)}"
    if event.mode == "shear":
        sentence += "; its film would shear, not bulge to a pear"
    others = len(verdict.losses) - 1
    if others:
        again = "once more" if others == 1 else f"{others} times more"
        sentence += f"; and {again}, see events.csv"
    return sentence


def _before(history: History, loss: Loss) -> str:
    """What comes next for the spheres of the history, if that is in the same step and still no sphere."""
    event = loss.event
    if loss.place != "path":
        return ""
    end = history.time[-1] if loss.regained is None else loss.regained
    for later in history.mechanical:
        if later.step == event.step and event.time <= later.time <= end and later.kind in _ENDS:
            return f", before {_ENDS[later.kind]}"
    return ""


def _drive(history: History, event: Event, balloon: str) -> str:
    """The voltage of an event, on the balloon or the first with electrodes; in an inflation the pressure."""
    scales = history.scenario.scales
    step = next(s for number, s in enumerate(history.scenario.played_steps(), 1) if number == event.step)
    if isinstance(step, Inflate) or not history.electroded:
        pressure = event.pressure_before
        return f"p {pressure:.5g}" if scales is None else units.said(units.PRESSURE, scales, pressure)
    place = history.electroded.index(balloon) if balloon in history.electroded else 0
    voltage = float(event.voltage[place])
    return f"{voltage:.5g}" if scales is None else units.said(units.VOLTAGE, scales, voltage)


def _state(history: History, loss: Loss, balloon: str) -> str:
    """The balloon's stretch, and which way the drive was going."""
    event = loss.event
    after = event.stretch_before if event.stretch_after is None else event.stretch_after
    words = [f"λ {float(after[history.balloons.index(balloon)]):.5g}"]
    before = int(np.searchsorted(history.time, event.time)) - 1
    if loss.place == "path" and history.electroded and before >= 0:
        place = history.electroded.index(balloon) if balloon in history.electroded else 0
        change = abs(float(event.voltage[place])) - abs(float(history.voltage[before, place]))
        if change:
            words.append("rising" if change > 0.0 else "falling")
    return ", ".join(words)


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
