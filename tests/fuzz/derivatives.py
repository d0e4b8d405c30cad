"""Whether a sensitivity is the derivative that it says it is: by differences of events of the reference.

The reference plays the scenario with the number a little larger and a little smaller. Its limit points are
polished. It knows nothing of shapes, but has the state at every time: where a balloon's k(f′ − f/λ) −
4(e/h²)φ²λ² vanishes is found along its history.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.optimize import brentq

from simulator import Event, History, ScenarioError, Sensitivity, load_scenario
from simulator.events import SHAPE_EVENTS
from tests.oracle.general import Device, Reference, State, play

Document = dict[str, Any]

DERIVATIVE = 1e-5
STEP = 1e-4  # of a number; a central difference of fourth order
_ASIDE = 1e-3  # of an event's history: where its moved self is looked for
_WEIGHTS = {-2: 1.0 / 12.0, -1: -2.0 / 3.0, 1: 2.0 / 3.0, 2: -1.0 / 12.0}


def event_of(one: Sensitivity, history: History) -> Event:
    """The event whose derivative it is."""
    return next(e for e in history.events if e.time == one.time and e.kind.value == one.kind)


def can_be_checked(one: Sensitivity, history: History) -> bool:
    """Whether the event has a derivative that a difference can show.

    What equal balloons do changes with the sign of a change. A shear has no formula in the reference.
    """
    wall = ("radius", "thickness", "modulus", "elastomer")
    makes = [[getattr(balloon, key) for key in wall] for balloon in history.scenario.balloons]
    equal = any(a == b for i, a in enumerate(makes) for b in makes[:i])
    return not equal and event_of(one, history).mode != "shear"


def problem_of(document: Document, one: Sensitivity, history: History) -> str | None:
    """What is wrong with a derivative; None where nothing is, or where it cannot be told."""
    size = max(abs(one.parameter), 1e-3) * STEP
    moved: dict[int, float] = {}
    for place in _WEIGHTS:
        value = moved_to(document, one, history, one.parameter + place * size)
        if value is None:
            return None
        moved[place] = value
    slope = sum(weight * moved[place] for place, weight in _WEIGHTS.items()) / size
    # A coarser one says how far to trust it.
    trust = abs((moved[1] - moved[-1]) / (2.0 * size) - slope)
    scale = max(abs(one.derivative), 1e-3 * abs(one.value) / max(abs(one.parameter), 1e-3))
    if abs(slope - one.derivative) > DERIVATIVE * scale + trust + 1e-11 * max(1.0, abs(one.value)) / size:
        return (
            f"d({one.of})/d({one.key}) of {one.kind} at time {one.time!r}: {one.derivative!r}, not {slope!r}"
        )
    return None


def moved_to(document: Document, one: Sensitivity, history: History, value: float) -> float | None:
    """The voltage or pressure of the event where a number has a value; None where the event is not there."""
    event = event_of(one, history)
    try:
        changed = load_scenario(document).with_values({one.key: value}).to_dict()
    except ScenarioError:
        return None  # beyond the end of what is allowed
    found = play(changed, integrators=1)
    if event.kind in SHAPE_EVENTS:
        state = _change_of_shape(Device.from_scenario(changed), found, event, history)
    else:
        state = _same_event(found, event, history)
    if state is None:
        return None
    if one.of == "pressure":
        return state.pressure
    return float(state.voltage[history.electroded.index(one.of.removeprefix("voltage_"))])


def _same_event(found: Reference, event: Event, history: History) -> State | None:
    """The state before the event of the same number, where all up to it are the same ones."""
    played = [other for other in history.events if other.kind not in SHAPE_EVENTS]
    number = played.index(event)
    wanted = [(other.kind.value, other.step) for other in played[: number + 1]]
    if [(other.kind, other.step) for other in found.events[: number + 1]] != wanted:
        return None
    return found.events[number].before


def _change_of_shape(device: Device, found: Reference, event: Event, history: History) -> State | None:
    """The state in which the balloon's margin vanishes near the time of the event, in the same step."""
    place = history.balloons.index(str(event.balloon))
    times = history.time[history.step == event.step]
    aside = _ASIDE * float(times[-1] - times[0])
    low, high = max(event.time - aside, float(times[0])), min(event.time + aside, float(times[-1]))
    between = [other.time for other in found.events if low <= other.time <= high]
    if between or found.course is None or high > (found.end.time if found.end else 0.0):
        return None
    at = found.course.at

    def margin(time: float) -> float:
        (state,) = at([time])
        return float(device.sphericity(state.stretch, state.voltage)[place])

    ends = margin(low), margin(high)
    if not ends[0] * ends[1] < 0.0:
        return None
    time = float(brentq(margin, low, high, xtol=1e-15 * max(high, 1e-300), rtol=8.9e-16))
    return at([time])[0]


def two_of(found: tuple[Sensitivity, ...], rng: np.random.Generator) -> list[Sensitivity]:
    """Two of some derivatives, of two events where there are so many."""
    shuffled = [found[int(place)] for place in rng.permutation(len(found))]
    first = shuffled[:1]
    return first + ([one for one in shuffled[1:] if one.time != first[0].time] or shuffled[1:])[:1]
