"""Histories of a sealed pair held against its closed form, `tests.oracle.closed_form`, samples and events."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simulator.model.drive import VoltageCurve
from simulator.results.history import Outcome
from simulator.scenario import Hold, Inflate, Ramp, until_of
from simulator.scenario import Jump as JumpStep
from simulator.simulation import motion
from tests.oracle.closed_form import (
    Balloon,
    Curve,
    Jump,
    ReferenceHistory,
    SealedPair,
    equilibrium_curve,
    inflation_history,
    reference_history,
    states_on,
)
from tests.studies.stress.case import Finding

if TYPE_CHECKING:
    from collections.abc import Callable

    from simulator.results.history import Event, History
    from simulator.scenario import PlayedStep, Scenario

FloatArray = NDArray[np.float64]

_SAME_DRIVE = 1e-13  # relative: the state of a drive is any that belongs to one no farther away
_INFLATED = 100  # samples of the inflation that are looked at, of many
AGAINST = "closed form"


def closed_form(history: History, bound: float = 1e-8) -> Finding:
    """A history's deviation from the exact one of the same scenario."""
    return _best(history, SealedPair.from_scenario(history.scenario), [_turns(history.scenario)], bound)


def closed_form_beside(history: History, leg: int, voltages: Sequence[float], bound: float = 1e-8) -> Finding:
    """The same where a turn cannot be told from an event: the best of several turns at one leg (from 0)."""
    turns = _turns(history.scenario)
    kind = Jump if isinstance(turns[leg], Jump) else float
    candidates = [[*turns[:leg], kind(v), *turns[leg + 1 :]] for v in voltages]
    return _best(history, SealedPair.from_scenario(history.scenario), candidates, bound)


def closed_form_thick(history: History, bound: float = 1e-8) -> Finding:
    """The same with the passive balloon's modulus given to its thickness.

    Its equilibria depend on the product alone, and a wall so stiff takes no part in the snaps, whether slow
    (thick) or at once (of a high modulus, which is what makes the flow stiff).
    """
    pair = SealedPair.from_scenario(history.scenario)
    passive = replace(pair.passive, thickness=pair.passive.thickness * pair.passive.modulus, modulus=1.0)
    found = _best(history, replace(pair, passive=passive), [_turns(history.scenario)], bound)
    return replace(found, against=f"{AGAINST} of a wall as stiff by its thickness")


def limit_point(scenario: Scenario, number: int = 0) -> float:
    """Voltage of a pair's limit point, in the order of the curve from the sealed state."""
    return equilibrium_curve(SealedPair.from_scenario(scenario)).limit_points[number].voltage


def _best(
    history: History, pair: SealedPair, candidates: Iterable[list[float | Jump]], bound: float
) -> Finding:
    curve = equilibrium_curve(pair) if pair.sealed.pressure > 0.0 else None
    found = [_compared(history, pair, curve, turns, bound) for turns in candidates]
    return min(found, key=lambda finding: finding.error)


def _compared(
    history: History, pair: SealedPair, curve: Curve | None, turns: list[float | Jump], bound: float
) -> Finding:
    reference = _repeated(pair, _without_idle(turns, curve), curve)
    inflations = sum(isinstance(step, Inflate) for step in history.scenario.played_steps())
    inflating = [event for event in history.events if event.step <= inflations]
    actuating = history.events[len(inflating) :]
    kinds = [event.kind.value for event in actuating]
    wanted: list[str] = [event.kind for event in reference.events]
    snaps = _snap_pressures(pair, history)
    if len(inflating) != len(snaps):
        return Finding(
            math.inf, bound, AGAINST, f"{len(inflating)} snaps of the inflation, should be {len(snaps)}"
        )
    if kinds != wanted or history.outcome.value != reference.outcome:
        return Finding(math.inf, bound, AGAINST, f"{' '.join(kinds)}, should be {' '.join(wanted)}")
    if np.any(np.diff(history.time) < 0.0):
        return Finding(math.inf, bound, AGAINST, "time goes back")
    at = [history.scenario.balloons.index(b) for b in sorted(history.scenario.balloons, key=_is_passive)]
    errors = [
        *_ends_of_steps(history),
        *(relative(event.pressure_before, p) for event, p in zip(inflating, snaps, strict=True)),
        *_inflation_samples(history, pair, at, inflations),
        *_events(actuating, reference, at),
        *_samples(history, reference, pair, at, inflations, len(inflating)),
    ]
    return Finding(max(errors, default=0.0), bound, AGAINST)


def _is_passive(balloon: object) -> bool:
    return not balloon.electrodes  # type: ignore[attr-defined]


def relative(found: ArrayLike, exact: ArrayLike) -> float:
    """Largest deviation; of what is above 1, relative."""
    return float(np.max(np.abs(np.subtract(found, exact)) / np.maximum(np.abs(exact), 1.0)))


# -- what the scenario asks for ------------------------------------------------------------------------


def _corners(step: PlayedStep, now: float) -> list[float]:
    """Voltages that a step turns or ends at, from where it begins."""
    if until_of(step):
        raise ValueError("the closed form's histories know no until")
    if isinstance(step, Inflate | Hold):
        return [now, now]
    if isinstance(step, Ramp | JumpStep):
        wanted = step.ramp if isinstance(step, Ramp) else step.jump
        target = next(iter(wanted.values())) if isinstance(wanted, dict) else wanted
        return [now, float(target)]
    electrodes = motion.Electrodes([now], [0.0], "voltage")
    legs = motion.motion(step, ("active",), electrodes, 0.0)
    leg = legs[0]
    if len(legs) > 1 or isinstance(leg.way, VoltageCurve):
        raise ValueError("the closed form's histories know no waves by name")
    return [float(v) for v in leg.waveform.values]


def _turns(scenario: Scenario) -> list[float | Jump]:
    """The corners of all voltage steps."""
    turns: list[float | Jump] = []
    now = 0.0
    for step in scenario.played_steps():
        first, *values = _corners(step, now)
        if isinstance(step, Inflate | Hold):
            continue
        if isinstance(step, JumpStep):
            turns.append(Jump(values[-1]))
        else:
            turns += [*([Jump(first)] if first != now else []), *values]
        now = values[-1]
    return turns


def _ends_of_steps(history: History) -> Iterable[float]:
    """Voltages, or pressures, at the end of every step but the last one of a history that ended in it."""
    complete = int(history.step[-1]) - (history.outcome is not Outcome.COMPLETED)
    last = np.searchsorted(history.step, np.arange(1, complete + 1), side="right") - 1
    voltage = 0.0
    for row, step in zip(last.tolist(), history.scenario.played_steps(), strict=False):
        if isinstance(step, Inflate):
            yield relative(history.pressure[row], step.inflate)
        voltage = _corners(step, voltage)[-1]
        yield relative(history.voltage[row, 0], voltage)


def _without_idle(turns: list[float | Jump], curve: Curve | None) -> list[float | Jump]:
    """Without the turns that can do nothing: those among several between the same two events' voltages."""
    if curve is None or len(turns) < 100:
        return turns
    special = sorted(
        {0.0, *(p.voltage for p in curve.limit_points)}
        | ({curve.loss_of_tension.voltage} if curve.loss_of_tension else set())
    )
    cells = np.searchsorted(special, [abs(t.voltage if isinstance(t, Jump) else t) for t in turns])
    keep = np.append(cells[1:] != cells[:-1], True)
    return [turn for turn, kept in zip(turns, keep, strict=True) if kept or isinstance(turn, Jump)]


def _repeated(pair: SealedPair, turns: list[float | Jump], curve: Curve | None) -> ReferenceHistory:
    """The exact history; of two turns that alternate, only the first two cycles are played, and repeated."""
    alternate = next((k for k in range(3, len(turns)) if turns[k] != turns[k - 2]), len(turns))
    more = (alternate - 5) // 2
    if more < 1:
        return reference_history(pair, turns, curve)
    reference = reference_history(pair, [*turns[:5], *turns[5 + 2 * more :]], curve)
    first, second = (
        [replace(e, leg=0) for e in reference.events if e.leg in legs] for legs in ((1, 2), (3, 4))
    )
    if first != second or any(event.after is None for event in second):
        return reference_history(pair, turns, curve)
    done = sum(event.leg < 5 for event in reference.events)
    stayed = reference.segments
    return replace(
        reference,
        events=(*reference.events[:done], *(second * more), *reference.events[done:]),
        segments=(
            *stayed[: done + 1],
            *(stayed[done + 1 - len(second) : done + 1] * more),
            *stayed[done + 1 :],
        ),
    )


# -- inflation -----------------------------------------------------------------------------------------


def _snap_pressures(pair: SealedPair, history: History) -> list[float]:
    """Pressures at which either balloon snaps while inflating, in order, equal ones once."""
    pressures = [s.inflate for s in history.scenario.played_steps() if isinstance(s, Inflate)]
    found = set()
    for balloon in (pair.active, pair.passive):
        for snap in inflation_history(balloon, pressures)[1]:
            rising = pressures[snap.leg] > [0.0, *pressures][snap.leg]
            found.add((snap.leg, snap.pressure if rising else -snap.pressure))
    return [abs(pressure) for _, pressure in sorted(found)]


def _inflation_samples(
    history: History, pair: SealedPair, at: Sequence[int], inflations: int
) -> Iterable[float]:
    """Some samples of the inflation, but for both sides of snaps, against p(λ)."""
    pressures = [s.inflate for s in history.scenario.played_steps() if isinstance(s, Inflate)]
    snapping = {event.time for event in history.events}
    ends = np.cumsum([s.over for s in history.scenario.played_steps() if isinstance(s, Inflate)])
    rows = np.flatnonzero(history.step <= inflations)
    for row in rows[:: max(1, rows.size // _INFLATED)].tolist():
        if history.time[row] in snapping:
            continue
        leg = int(np.searchsorted(ends, history.time[row]))
        for balloon, place in zip((pair.active, pair.passive), at, strict=True):
            exact = partial(_inflated, balloon, tuple(pressures[:leg]))
            yield _apart(history.stretch[row, place], float(history.pressure[row]), exact)


@lru_cache(maxsize=4096)
def _inflated(balloon: Balloon, before: tuple[float, ...], pressure: float) -> float:
    return inflation_history(balloon, [*before, pressure])[0]


def _apart(found: float, drive: float, exact: Callable[[float], float]) -> float:
    """Distance to the exact value of any drive within rounding."""
    here = exact(drive)
    error = relative(found, here)
    if error < 1e-12:
        return error
    near = _SAME_DRIVE * max(1.0, abs(drive))
    spans = [relative(exact(max(drive + s, 0.0)), here) for s in (near, -near)]
    return max(error - max(spans), 0.0)


# -- voltages ------------------------------------------------------------------------------------------


def _events(events: Sequence[Event], reference: ReferenceHistory, at: Sequence[int]) -> Iterable[float]:
    for number, (event, exact) in enumerate(zip(events, reference.events, strict=True)):
        yield relative(event.voltage[0], exact.voltage)
        # A jump from another voltage starts from a sample, which is compared as one.
        if exact.kind != "jump" or number == 0 or reference.events[number - 1].kind == "jump":
            yield relative([*event.stretch_before[at], event.pressure_before], exact.before)
        if (event.stretch_after is None) != (exact.after is None):
            yield math.inf
        elif event.stretch_after is not None and exact.after is not None:
            yield relative([*event.stretch_after[at], event.pressure_after], exact.after)


def _samples(
    history: History,
    reference: ReferenceHistory,
    pair: SealedPair,
    at: Sequence[int],
    inflations: int,
    snaps: int,
) -> Iterable[float]:
    """Samples with the valve closed against the exact states on the branch that they should be on."""
    states = np.column_stack([history.stretch[:, at], history.pressure]).T
    closed = np.flatnonzero(history.step > inflations)
    place = history.branch[closed] - snaps
    # A thousand cycles stay on the same few segments.
    names = {id(segment): segment for segment in reference.segments}
    owners = np.array([id(segment) for segment in reference.segments] + [0])
    owner = owners[np.minimum(place, owners.size - 1)]
    for name, segment in names.items():
        rows = closed[owner == name]
        if not rows.size:
            continue
        voltages = np.abs(history.voltage[rows, 0])
        exact = states_on(pair, segment, voltages)
        size = np.maximum(np.abs(exact), 1.0)
        apart = np.abs(states[:, rows] - exact) / size
        near = _SAME_DRIVE * np.maximum(1.0, voltages)
        spans = np.zeros_like(apart)
        for beside in (voltages - near, voltages + near):
            span = np.abs(states_on(pair, segment, np.maximum(beside, 0.0)) - exact) / size
            spans = np.maximum(spans, span)
        errors = np.where(apart < 1e-12, apart, np.maximum(apart - spans, 0.0))
        yield float(errors.max())
