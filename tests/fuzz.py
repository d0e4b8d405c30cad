"""Random scenarios of a sealed pair, simulated and compared with the closed form (`simulator.exact`).

    python -m tests.fuzz 10000 [--seed 1] [--jobs 2] [--keep DIR]

plays N scenarios, prints how they ended and the worst errors, and keeps each scenario on which the two
disagree as a JSON file; what is under its "scenario" goes into `load_scenario`. What "agree" means:

- The same outcome and the same sequence of events, in the same steps, inflation included.
- Event voltages (inflation: pressures) within 1e-9. The states before an event, and after it where they are
  at rest, within 1e-8.
- The state in which a snap loses its tension, or breaks, depends on the whole trajectory. Both flows are
  integrated with an error of about 1e-10 a step, the reference's ends good to a few 1e-9: within 1e-6.
- Every sample within 1e-8 of the exact state at its voltage, on the segment that the reference is on. Next to
  a limit point the state moves like the square root of the voltage: a rounding of the voltage by 1e-16 moves
  it by 1e-8. How far the exact state moves under a change of the voltage by `SAME_VOLTAGE` (1e-13) is
  therefore taken off the distance; elsewhere that is nothing.
- Energy imbalance within 1e-8 of the work exchanged, but for the rounding of energies of order r²hk (a pair
  that hardly moves exchanges less than that); what each event dissipated within 1e-8.

A scenario can be undecidable: a ramp turns round at the very voltage of an event, or a snap only just keeps
its tension. `Margin` in `simulator.exact` says how near each such decision was; below `UNDECIDED` (1e-11 of
the film's voltage, as margins of events are solved to 1e-12; the error of a flow) the two may go different
ways and both be right. Where it is a turn, the simulator must agree in everything with the reference of a
turn just before the event, or at it, or just beyond it. Where it is a flow, it is compared up to there. Such
scenarios are counted as undecided.

Pressures are 0 or at least `LEAST_PRESSURE`. At a lower one the stretch is 1 + p/12 and has few digits left:
what happens then is a matter of rounding (an inflation to 1e-16 cannot be told from none).
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from copy import deepcopy
from dataclasses import dataclass, field
from itertools import groupby, product
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st

from simulator import SolverError, load_scenario, simulate
from simulator.exact import (
    Balloon,
    Jump,
    ReferenceEvent,
    ReferenceHistory,
    SealedPair,
    equilibrium_curve,
    inflation_history,
    reference_history,
    states_on,
)
from simulator.history import History

EVENT_VOLTAGE = 1e-9
STATE = 1e-8
LOST_STATE = 1e-6
ENERGY = 1e-8
SAME_VOLTAGE = 1e-13
BESIDE = 1e-10
LEAST_PRESSURE = 1e-4
UNDECIDED = {"turn": 1e-11, "tension": 1e-8, "breakdown": 1e-8}


# -- scenarios -----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Dice:
    """Where random numbers come from: a NumPy generator, or Hypothesis."""

    number: Callable[[float, float], float]
    whole: Callable[[int, int], int]


def numpy_dice(seed: int) -> Dice:
    rng = np.random.default_rng(seed)
    return Dice(lambda a, b: float(rng.uniform(a, b)), lambda a, b: int(rng.integers(a, b + 1)))


def scenario(dice: Dice) -> dict[str, Any]:
    """A random pair, inflated, sealed, and led through one to six voltage ramps and jumps."""

    def ratio(low: float, high: float) -> float:
        return float(np.exp(dice.number(np.log(low), np.log(high))))

    def balloon(name: str, **more: Any) -> dict[str, Any]:
        ratios = {key: ratio(0.3, 3.0) for key in ("thickness", "modulus", "permittivity")}
        return {
            "name": name,
            **more,
            **ratios,
            "elastomer": {"model": "gent", "J_lim": dice.number(20.0, 500.0)},
        }

    active = balloon("active", radius=ratio(0.1, 5.0), electrodes=True)
    passive = balloon("passive")
    if dice.whole(0, 1):  # as in the paper: two balloons of one film
        passive = {"name": "passive", "elastomer": active["elastomer"]}
        active = {key: active[key] for key in ("name", "radius", "electrodes", "elastomer")}

    def pressure() -> float:
        return dice.number(LEAST_PRESSURE, 3.0) if dice.whole(0, 20) else 0.0

    # Half of them at the load at which that balloon is about to snap open.
    last = pressure()
    if dice.whole(0, 1):
        load = active["radius"] / (active.get("thickness", 1.0) * active.get("modulus", 1.0))
        last = min(3.0, dice.number(0.2, 1.35) / load)
    pressures = [pressure() for _ in range(max(0, dice.whole(0, 6) - 4))] + [last]
    ambient = dice.number(0.0, 5.0) ** 3 / 25.0
    # The voltage that a film of this thickness and stiffness takes: limit points are at 0.1 to 0.7 of it.
    unit = active.get("thickness", 1.0) * np.sqrt(
        active.get("modulus", 1.0) / active.get("permittivity", 1.0)
    )
    legs = [float(unit * dice.number(-0.1, 1.0)) for _ in range(dice.whole(1, 6))]

    def step(leg: float) -> dict[str, Any]:
        return {"ramp": leg, "over": dice.number(0.1, 10.0)} if dice.whole(0, 5) else {"jump": leg}

    legs = [0.0 if dice.whole(0, 5) == 0 else leg for leg in legs]
    written = {
        "title": "fuzz",
        "gas": {"ambient_pressure": ambient},
        "balloon": [active, passive] if dice.whole(0, 1) else [passive, active],
        "step": [{"inflate": p} for p in pressures] + [step(leg) for leg in legs],
        "output": {"points": dice.whole(2, 40)},
    }
    if dice.whole(0, 4) == 0:
        _turn_near_events(written, dice)
    return written


def _turn_near_events(written: dict[str, Any], dice: Dice) -> None:
    """Turn some ramps round, and end some jumps, a hair beside a limit point or where p = 0.

    A jump that just fails to land on a limit point creeps past it, at speeds that are the rounding of forces
    below 1e-12; so jumps keep 1e-9 away, ramps 1e-14.
    """
    pair = SealedPair.from_scenario(load_scenario(written))
    if not pair.sealed.pressure > 0.0:
        return
    curve = equilibrium_curve(pair)
    points = [*curve.limit_points, *([curve.loss_of_tension] if curve.loss_of_tension else [])]
    for step in written["step"]:
        if "inflate" not in step and points and dice.whole(0, 1):
            kind, nearest = ("jump", -9.0) if "jump" in step else ("ramp", -14.0)
            offset = 10.0 ** dice.number(nearest, -3.0) * (1 if dice.whole(0, 1) else -1)
            step[kind] = float(points[dice.whole(0, len(points) - 1)].voltage + offset)


@st.composite
def scenarios(draw: st.DrawFn) -> dict[str, Any]:
    """The same as a Hypothesis strategy, which likes the ends of the ranges, and shrinks."""
    return scenario(Dice(lambda a, b: draw(st.floats(a, b)), lambda a, b: draw(st.integers(a, b))))


# -- comparison ----------------------------------------------------------------------------------------


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
        history = simulate(asked)
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
    """Snaps of both balloons in order, those at one pressure together."""
    snaps = []
    for balloon in dict.fromkeys(balloons):
        for snap in inflation_history(balloon, pressures)[1]:
            rising = pressures[snap.leg] > ([0.0, *pressures])[snap.leg]
            snaps.append((snap.leg, snap.pressure if rising else -snap.pressure, balloon, snap))
    snaps.sort(key=lambda item: item[:2])
    out = []
    for (leg, pressure), group in groupby(snaps, key=lambda item: item[:2]):
        out.append(
            (leg, abs(pressure), {balloon: (snap.before, snap.after) for _, _, balloon, snap in group})
        )
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
            after = [*event.stretch_after[order], event.pressure_after]
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


# -- many ----------------------------------------------------------------------------------------------


def _numbered(seed: int) -> tuple[int, dict[str, Any], Verdict]:
    written = scenario(numpy_dice(seed))
    try:
        return seed, written, examine(written)
    except Exception as error:
        return seed, written, Verdict(problems=[f"{type(error).__name__}: {error}"])


def play(seeds: range, jobs: int) -> Iterator[tuple[int, dict[str, Any], Verdict]]:
    """Examine the scenarios of many seeds, in order."""
    if jobs == 1:
        yield from map(_numbered, seeds)
        return
    with ProcessPoolExecutor(jobs) as pool:
        yield from pool.map(_numbered, seeds, chunksize=8)


def main() -> int:
    parser = argparse.ArgumentParser(description="Random sealed pairs against the closed form.")
    parser.add_argument("count", type=int, nargs="?", default=1000)
    parser.add_argument("--seed", type=int, default=0, help="scenarios are seed·10⁶ + 0 … N − 1")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--keep", type=Path, default=Path("results/fuzz"), help="folder for what disagrees")
    options = parser.parse_args()
    first = options.seed * 1_000_000
    outcomes: Counter[str] = Counter()
    worst: dict[str, tuple[float, int]] = {}
    totals: Counter[str] = Counter()
    seconds: Counter[str] = Counter()
    for seed, written, verdict in play(range(first, first + options.count), options.jobs):
        outcomes[verdict.outcome] += 1
        totals.update(scenarios=1, events=verdict.events, samples=verdict.samples)
        totals.update(undecided=int(verdict.undecided), disagreements=int(bool(verdict.problems)))
        seconds.update(verdict.seconds)
        for what, error in verdict.worst.items():
            if error >= worst.get(what, (-1.0, 0))[0]:
                worst[what] = (error, seed)
        if verdict.problems:
            options.keep.mkdir(parents=True, exist_ok=True)
            kept = options.keep / f"{seed}.json"
            kept.write_text(json.dumps({"problems": verdict.problems, "scenario": written}, indent=1))
            print(f"{kept}: " + "; ".join(verdict.problems[:3]), file=sys.stderr)
    print("  ".join(f"{name} {count}" for name, count in totals.items()))
    print("outcomes:  " + "  ".join(f"{name} {count}" for name, count in outcomes.most_common()))
    print("seconds:  " + "  ".join(f"{name} {spent:.1f}" for name, spent in seconds.items()))
    for what, (error, seed) in worst.items():
        print(f"worst {what:15s} {error:.2e}   scenario {seed}")
    return 1 if totals["disagreements"] else 0


if __name__ == "__main__":
    sys.exit(main())
