"""One scenario, simulated and compared with the closed form; what "agree" means is in `tests.fuzz`."""

from __future__ import annotations

import time
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from simulator import SolverError, load_scenario
from simulator.results.history import History
from tests.oracle.closed_form import (
    Balloon,
    Jump,
    ReferenceEvent,
    ReferenceHistory,
    SealedPair,
    inflation_history,
    reference_history,
    states_on,
)
from tests.pairs import run

EVENT_VOLTAGE = 1e-9
STATE = 1e-8
LOST_STATE = 1e-6
ENERGY = 1e-8
SAME_VOLTAGE = 1e-13
BESIDE = 1e-10
UNDECIDED = {"turn": 1e-11, "tension": 1e-8, "breakdown": 1e-8}


@dataclass
class Verdict:
    """What became of one scenario."""

    outcome: str = "?"
    undecided: bool = False
    problems: list[str] = field(default_factory=list)
    worst: dict[str, float] = field(default_factory=dict)
    events: int = 0
    samples: int = 0
    seconds: dict[str, float] = field(default_factory=dict)

    def check(self, what: str, error: float, allowed: float, where: str = "") -> None:
        self.worst[what] = max(self.worst.get(what, 0.0), float(error))
        if not error <= allowed:
            self.problems.append(f"{what}: {error:.3g} > {allowed:.0e} {where}".rstrip())


def examine(written: dict[str, Any]) -> Verdict:
    """Simulate a scenario and compare it with the closed form."""
    verdict = Verdict()
    asked = load_scenario(written)
    start = time.perf_counter()
    try:
        history = run(asked)
    except SolverError as error:
        verdict.problems.append(f"SolverError: {error}")
        history = None
    middle = time.perf_counter()
    try:
        pair = SealedPair.from_scenario(asked)
        turns: list[float | Jump] = [
            Jump(step["jump"]) if "jump" in step else step["ramp"]
            for step in written["step"]
            if "inflate" not in step
        ]
        reference = reference_history(pair, turns)
    except (ArithmeticError, ValueError, AssertionError) as error:
        verdict.problems.append(f"reference: {type(error).__name__}: {error}")
        return verdict
    verdict.seconds = {"simulator": middle - start, "reference": time.perf_counter() - middle}
    verdict.outcome = reference.outcome
    if history is None:
        return verdict
    order = [asked.balloons.index(b) for b in sorted(asked.balloons, key=lambda b: not b.electrodes)]
    inflations = _compare_inflation(verdict, written, history, pair, order)
    verdict.samples = len(history)
    # Each with the legs that were moved a little.
    candidates = [(reference, frozenset[int]()), *_other_turns(pair, turns, reference)]
    verdict.undecided = len(candidates) > 1 or bool(_doubtful_flows(reference))
    compared = []
    for candidate, moved in candidates[1:] or candidates:
        compared.append(deepcopy(verdict))
        _compare_voltages(compared[-1], history, candidate, moved, pair, order, inflations)
        _compare_samples(compared[-1], history, candidate, pair, order, inflations)
    return min(compared, key=lambda found: len(found.problems))


def _other_turns(
    pair: SealedPair,
    turns: list[float | Jump],
    reference: ReferenceHistory,
    moved: frozenset[int] = frozenset(),
) -> Iterator[tuple[ReferenceHistory, frozenset[int]]]:
    """Where ramps turn round at the voltage of an event: references just before, at and beyond it.

    A turn that one of these brings within reach is moved in its place; `moved` are the legs done already.
    """
    unit = _voltage_unit(pair)
    doubtful = _doubtful_turns(reference, unit, moved)
    if not doubtful:
        if moved:
            yield reference, moved
        return
    leg, voltage = next(iter(doubtful.items()))
    for offset in (-BESIDE * unit, 0.0, BESIDE * unit):
        other = list(turns)
        turn = other[leg]
        if isinstance(turn, Jump):
            other[leg] = Jump(float(np.copysign(voltage + offset, turn.voltage)))
        else:
            other[leg] = float(np.copysign(voltage + offset, turn))
        try:
            yield from _other_turns(pair, other, reference_history(pair, other), moved | {leg})
        except ArithmeticError:  # a jump to the very voltage of a limit point has no end
            continue


def _doubtful_turns(reference: ReferenceHistory, unit: float, moved: frozenset[int]) -> dict[int, float]:
    """The legs that end at the voltage of an event, and that voltage."""
    near = UNDECIDED["turn"] * unit
    return {
        m.leg: m.voltage
        for m in reference.margins
        if m.what == "turn" and m.size < near and m.leg not in moved
    }


def _voltage_unit(pair: SealedPair) -> float:
    """The voltage h√(k/e) of the active balloon's film, in which its voltages are of order 1; at least 1."""
    active = pair.active
    return max(1.0, active.thickness * float(np.sqrt(active.modulus / active.permittivity)))


def _doubtful_flows(reference: ReferenceHistory) -> list[int]:
    """How many events there were before each flow that might have ended otherwise."""
    return [m.events for m in reference.margins if m.what != "turn" and m.size < UNDECIDED[m.what]]


def _compare_inflation(
    verdict: Verdict, written: dict[str, Any], history: History, pair: SealedPair, order: list[int]
) -> int:
    """Compare the snaps of the inflation; return how many there were."""
    pressures = [step["inflate"] for step in written["step"] if "inflate" in step]
    balloons = (pair.active, pair.passive)
    expected = _inflation_snaps(balloons, pressures)
    found = [event for event in history.events if event.step <= len(pressures)]
    if len(found) != len(expected) or any(event.kind != "limit_point" for event in found):
        kinds = [(event.kind.value, event.pressure_before) for event in found]
        verdict.problems.append(f"inflation: events {kinds}, expected {expected}")
        return len(found)
    for event, (leg, pressure, snapping) in zip(found, expected, strict=True):
        where = f"inflation to {pressures[leg]!r}, at {pressure!r}"
        verdict.check("event_pressure", abs(event.pressure_before - pressure), EVENT_VOLTAGE, where)
        assert event.stretch_after is not None
        for balloon, place in zip(balloons, order, strict=True):
            if balloon in snapping:
                before, after = snapping[balloon]
            else:
                before = after = inflation_history(balloon, [*pressures[:leg], pressure])[0]
            verdict.check("state_before", abs(event.stretch_before[place] - before), STATE, where)
            verdict.check("state_after", abs(event.stretch_after[place] - after), STATE, where)
    verdict.events += len(found)
    return len(found)


def _inflation_snaps(
    balloons: tuple[Balloon, Balloon], pressures: list[float]
) -> list[tuple[int, float, dict[Balloon, tuple[float, float | None]]]]:
    """Snaps of both balloons in order, those of one instant together."""
    snaps = []
    for balloon in dict.fromkeys(balloons):
        for snap in inflation_history(balloon, pressures)[1]:
            rising = pressures[snap.leg] > ([0.0, *pressures])[snap.leg]
            snaps.append((snap.leg, snap.pressure if rising else -snap.pressure, balloon, snap))
    snaps.sort(key=lambda item: item[:2])
    out: list[tuple[int, float, dict[Balloon, tuple[float, float | None]]]] = []
    last: tuple[int, float] | None = None
    for leg, pressure, balloon, snap in snaps:
        change = abs(pressures[leg] - ([0.0, *pressures])[leg])
        # Of one instant, as the simulator takes it: 1e-12 of a step.
        if last is not None and leg == last[0] and pressure - last[1] <= 1e-12 * change:
            out[-1][2][balloon] = (snap.before, snap.after)
        else:
            last = leg, pressure
            out.append((leg, abs(pressure), {balloon: (snap.before, snap.after)}))
    return out


def _compare_voltages(
    verdict: Verdict,
    history: History,
    reference: ReferenceHistory,
    moved: frozenset[int],
    pair: SealedPair,
    order: list[int],
    inflations: int,
) -> None:
    inflation_steps = _inflation_steps(history)
    doubts = _doubtful_flows(reference)
    certain = min(doubts, default=len(reference.events))
    found, expected = history.events[inflations:], reference.events
    kinds, wanted = [event.kind.value for event in found], [event.kind for event in expected]
    if not doubts:
        if history.outcome.value != reference.outcome:
            verdict.problems.append(f"outcome: {history.outcome.value}, expected {reference.outcome}")
        if kinds != wanted:
            verdict.problems.append(f"events: {kinds}, expected {wanted}")
    elif kinds[:certain] != wanted[:certain]:
        verdict.problems.append(f"events: {kinds}, expected {wanted[:certain]} and then in doubt")
    for number, (event, exact) in enumerate(zip(found[:certain], expected[:certain], strict=False)):
        if event.kind != exact.kind or event.step - inflation_steps - 1 != exact.leg:
            verdict.problems.append(f"event {number}: {event.kind} in step {event.step}, expected {exact}")
            break
        where = f"event {number}, {exact.kind} at {exact.voltage!r}"
        verdict.check("event_voltage", abs(event.voltage[0] - exact.voltage), EVENT_VOLTAGE, where)
        lost = _ends_in_flow(expected, number - 1)
        # Where it jumps from is a sample too, and compared as such.
        elsewhere = exact.kind == "jump" and exact.leg - 1 in moved
        before = [*event.stretch_before[order], event.pressure_before]
        name, allowed = ("lost_state", LOST_STATE) if lost else ("state_before", STATE)
        if not elsewhere:
            verdict.check(name, np.max(np.abs(np.subtract(before, exact.before))), allowed, where)
        if (event.stretch_after is None) != (exact.after is None):
            verdict.problems.append(f"event {number}: after {event.stretch_after}, expected {exact.after}")
        elif exact.after is not None and event.stretch_after is not None:
            lost = _ends_in_flow(expected, number)
            name, allowed = ("lost_state", LOST_STATE) if lost else ("state_after", STATE)
            # So is where it jumps to, at the voltage that was written.
            elsewhere |= not lost and exact.kind == "jump" and exact.leg in moved
            after = [*event.stretch_after[order], event.pressure_after]
            if not elsewhere:
                verdict.check(name, np.max(np.abs(np.subtract(after, exact.after))), allowed, where)
            if not lost and not elsewhere:
                assert event.dissipated is not None
                assert exact.dissipated is not None
                size = abs(event.dissipated - exact.dissipated) / max(1.0, abs(exact.dissipated))
                verdict.check("dissipated", size, ENERGY, where)
        verdict.events += 1
    books = history.energy_balance
    rounding = 1e-14 * sum(b.radius**2 * b.thickness * b.modulus for b in (pair.active, pair.passive))
    if books.exchanged:
        verdict.check("energy", max(abs(books.imbalance) - rounding, 0.0) / books.exchanged, ENERGY)


def _ends_in_flow(events: tuple[ReferenceEvent, ...], number: int) -> bool:
    """Whether the flow of an event ends the history on the way to a rest, which is the next event."""
    if not 0 <= number < len(events) - 1:
        return False
    this, following = events[number : number + 2]
    return following.after is None and following.before == this.after


def _inflation_steps(history: History) -> int:
    return sum(1 for step in history.scenario.played_steps() if hasattr(step, "inflate"))


def _compare_samples(
    verdict: Verdict,
    history: History,
    reference: ReferenceHistory,
    pair: SealedPair,
    order: list[int],
    inflations: int,
) -> None:
    """Every sample taken with the valve closed against the exact state on the segment it should be on."""
    at = history.step > _inflation_steps(history)
    states = np.column_stack([history.stretch[:, order], history.pressure])
    doubts = _doubtful_flows(reference)
    certain = min(doubts) + 1 if doubts else len(reference.segments)
    for place, segment in enumerate(reference.segments[:certain]):
        rows = np.flatnonzero(at & (history.branch == inflations + place))
        if not rows.size:
            continue
        voltages = np.abs(history.voltage[rows, 0])
        low, high = segment.voltages
        outside = np.max(np.maximum(low - voltages, voltages - high))
        near = UNDECIDED["turn"] * _voltage_unit(pair)
        verdict.check("sample_voltage", max(outside, 0.0), near, f"branch {inflations + place}")
        exact = states_on(pair, segment, voltages)
        apart = np.abs(states[rows].T - exact)
        errors = np.max(apart, axis=0)
        for beside in (voltages - SAME_VOLTAGE, voltages + SAME_VOLTAGE):
            span = np.abs(states_on(pair, segment, np.maximum(beside, 0.0)) - exact)
            errors = np.minimum(errors, np.max(np.maximum(apart - span, 0.0), axis=0))
        worst = int(np.argmax(errors))
        where = f"branch {inflations + place}, voltage {voltages[worst]!r}"
        verdict.check("sample", errors[worst], STATE, where)
    if not doubts:
        lost = _ends_in_flow(reference.events, len(reference.events) - 2)
        branches, wanted = int(history.branch[-1]) - inflations + 1, len(reference.segments) + lost
        if reference.segments and branches != wanted:
            verdict.problems.append(f"branches: {branches}, expected {wanted}")
        verdict.check("end_voltage", abs(history.voltage[-1, 0] - reference.voltage), EVENT_VOLTAGE)
