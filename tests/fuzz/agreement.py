"""One scenario of the whole grammar: the simulator against the general reference, and against the equations.

What "agree" means:

- The same outcome, and the same events in the same steps and order.
- Voltages of events within 1e-6 of the film's unit voltage, times within 1e-6 of the history.
- States on both sides of events, and at the end of each step, within 1e-5; what was dissipated, likewise.
- Every sample is an equilibrium to rounding, or in real time the state of the reference within 1e-5; its
  voltages, charges and pressures are those of the drive at its time, and the sealed gas keeps its constant.
- The energy balance closes within 1e-8 of the work exchanged, in real time within 1e-7.
- Nothing reaches standard output or standard error, and a run ends within 20 s, in a history or an error
  that is documented.

The reference integrates each flow once. Where it agrees with the simulator, two integrators do. Where it does
not, or is in doubt, it is played again with a second one of its own, and that counts.

Where the reference itself cannot decide, what is certain is compared and the scenario counted as undecided.
There, and in one of ten of the others, each snap and jump is integrated once more from the event alone.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator import History, load_scenario
from tests.fuzz import happenings
from tests.fuzz.running import Ran, Runner
from tests.fuzz.soundness import problems_of
from tests.oracle.general.record import Reference, State
from tests.pairs import run

FloatArray = NDArray[np.float64]
Document = dict[str, Any]

VOLTAGE = 1e-6
TIME = 1e-6
STATE = 1e-5
ROUNDING = 1e-15
AMPLIFIED = 100.0  # an unstable flow amplifies errors of 1e-9 by as much as the reference's of 1e-11
SAME_TIME = 1e-9  # events closer than this part of a history may come in either order


@dataclass
class Verdict:
    """What became of one scenario.

    Attributes
    ----------
    kind : {"agreed", "undecided", "solver_error", "disagreement", "crash", "hang"}
    problems : list of str
    message : str
        Of the error that the run ended with.
    outcome : str
        Of the simulator.
    compared : bool
        Whether there was a reference to compare with.
    worst : dict
        Largest differences by what they are of.
    spread : float
        That of the reference.
    """

    kind: str = "agreed"
    problems: list[str] = field(default_factory=list)
    message: str = ""
    outcome: str = "?"
    compared: bool = False
    events: int = 0
    samples: int = 0
    worst: dict[str, float] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    spread: float = 0.0

    def check(self, what: str, error: float, allowed: float, where: str) -> None:
        """Remember a difference, and name it where it is larger than allowed."""
        self.worst[what] = max(self.worst.get(what, 0.0), float(error))
        allowed = max(allowed, AMPLIFIED * self.spread)
        if not error <= allowed:
            self.problems.append(f"{what}: {error:.3g} > {allowed:.0e} {where}")


def history_of(document: Document) -> History:
    """The simulator's history."""
    return run(load_scenario(document))


def reference_of(
    document: Document, times: FloatArray, steps: NDArray[np.int64], integrators: int
) -> Reference:
    """The reference's history."""
    if "dynamics" in document:
        from tests.oracle.general.real_time import play_real_time

        return play_real_time(document, (times, steps), integrators=integrators)
    from tests.oracle.general import play

    return play(document, integrators=integrators)


def examine(
    document: Document, runner: Runner, reference_runner: Runner, *, landings: bool = False
) -> Verdict:
    """Simulate a scenario in a process of its own and compare it with the reference.

    Parameters
    ----------
    document : dict
    runner, reference_runner : Runner
        Where the simulator and the reference are called.
    landings : bool
        Whether flows are integrated anew even where the reference agrees with where they lead.
    """
    ran = runner.call(history_of, document)
    verdict = Verdict(seconds={"simulator": ran.seconds}, message=ran.error)
    history: History | None = ran.value
    if history is not None:
        verdict.outcome = history.outcome.value
        verdict.samples = len(history)
        verdict.problems += problems_of(history)
    if ran.printed:
        verdict.problems.append(f"printed: {ran.printed[:200]!r}")
    _judge_end(verdict, ran)
    if verdict.kind in ("crash", "hang") or history is None:
        return verdict
    quasi_static = "dynamics" not in document
    if quasi_static and not verdict.problems:
        _judge(verdict, reference_runner, happenings.problems_of, history)
    failed = ran.end == "raised"
    # Two integrators that agree are enough, and the simulator's is one of them.
    compared = _with_reference(verdict, reference_runner, document, history, 1, failed=failed)
    if compared.kind in ("undecided", "disagreement"):
        compared = _with_reference(verdict, reference_runner, document, history, 2, failed=failed)
    if quasi_static and (landings or compared.kind != "agreed") and not compared.problems:
        _judge(compared, reference_runner, happenings.landing_problems_of, history)
    if compared.problems:
        compared.kind = "disagreement"
    return compared


def _judge(verdict: Verdict, runner: Runner, judge: Callable[[History], list[str]], history: History) -> None:
    """Add what the equations alone say against a history."""
    judged = runner.call(judge, history)
    verdict.seconds["equations"] = verdict.seconds.get("equations", 0.0) + judged.seconds
    if judged.end == "returned":
        verdict.problems += judged.value
    elif judged.end == "crash":
        verdict.problems.append(f"judging the events: {judged.error}")


def _with_reference(
    before: Verdict, runner: Runner, document: Document, history: History, integrators: int, *, failed: bool
) -> Verdict:
    """The verdict after a comparison with a reference that has so many integrators."""
    verdict = deepcopy(before)
    found = runner.call(reference_of, document, history.time, history.step, integrators)
    before.seconds["reference"] = before.seconds.get("reference", 0.0) + found.seconds
    verdict.seconds["reference"] = before.seconds["reference"]
    if found.end == "hang":
        verdict.kind = "disagreement" if verdict.problems else "undecided"
    elif found.end != "returned":
        verdict.problems.append(f"reference: {found.end}: {found.error}")
        verdict.kind = "disagreement"
    else:
        verdict.compared = True
        verdict.spread = found.value.spread
        _compare(verdict, history, found.value, failed=failed)
        if verdict.problems:
            verdict.kind = "disagreement"
        elif verdict.kind == "agreed" and found.value.undecided:
            verdict.kind = "undecided"
    return verdict


def _judge_end(verdict: Verdict, ran: Ran) -> None:
    if ran.end in ("crash", "hang"):
        verdict.kind = ran.end
        verdict.problems.append(ran.error)
    elif ran.error.startswith("SolverError"):
        verdict.kind = "solver_error"
        if ran.value is None:
            verdict.kind = "crash"
            verdict.problems.append(f"without a history: {ran.error}")
    elif ran.end == "raised":
        verdict.kind = "disagreement"
        verdict.problems.append(ran.error)


def _compare(verdict: Verdict, history: History, reference: Reference, *, failed: bool) -> None:
    """What the simulator says against what the reference says, as far as both are sure."""
    doubtful = bool(reference.undecided)
    found, expected = _in_order(history, reference)
    kinds, wanted = [e.kind.value for e in found], [e.kind for e in expected]
    certain = reference.certain if doubtful else len(wanted)
    if failed:
        certain = min(certain, len(kinds))
    if kinds[:certain] != wanted[:certain] or (not doubtful and not failed and kinds != wanted):
        verdict.problems.append(f"events: {kinds}, expected {wanted}{' (in doubt)' if doubtful else ''}")
        return
    if not doubtful and not failed and history.outcome.value != reference.outcome:
        verdict.problems.append(f"outcome: {history.outcome.value}, expected {reference.outcome}")
        return
    units = _voltage_units(history)
    lasts = float(history.time[-1]) or 1.0
    # What is lost is a difference of potentials, which may be very large ones.
    rounding = ROUNDING * float(np.max(np.abs(history.energy)))
    for number, (event, exact) in enumerate(zip(found[:certain], expected[:certain], strict=False)):
        where = f"event {number}, {exact.kind} in step {exact.step} at time {exact.time!r}"
        if event.step != exact.step:
            verdict.problems.append(f"{where}: in step {event.step}")
            return
        verdict.events += 1
        verdict.check("event_time", abs(event.time - exact.time) / lasts, TIME, where)
        verdict.check("event_voltage", _largest((event.voltage - exact.voltage) / units), VOLTAGE, where)
        if exact.kind != "runaway":
            verdict.check("state_before", _apart(event.stretch_before, exact.before), STATE, where)
            pressures = event.pressure_before, exact.before.pressure
            verdict.check("pressure_before", _relative(*pressures), STATE, where)
        if (event.stretch_after is None) != (exact.after is None):
            verdict.problems.append(f"{where}: after {event.stretch_after}, expected {exact.after}")
        elif exact.after is not None and event.stretch_after is not None:
            runaway = number + 1 < len(expected) and expected[number + 1].kind == "runaway"
            if not runaway:
                verdict.check("state_after", _apart(event.stretch_after, exact.after), STATE, where)
            if exact.dissipated is not None and event.dissipated is not None and not runaway:
                apart = max(abs(event.dissipated - exact.dissipated) - rounding, 0.0)
                verdict.check("dissipated", apart / max(1.0, abs(exact.dissipated)), STATE, where)
    if not doubtful and not failed:
        _compare_states(verdict, history, reference)


def _compare_states(verdict: Verdict, history: History, reference: Reference) -> None:
    """Ends of steps, samples of a run in real time, and all that was dissipated."""
    last = np.flatnonzero(np.diff(history.step, append=history.step[-1] + 1))
    ends = {int(history.step[row]): int(row) for row in last}
    for state in reference.step_ends:
        if state.step not in ends:
            continue  # a step without rows of its own, as a jump to where the voltage was
        row = ends[state.step]
        where = f"end of step {state.step}"
        verdict.check("step_end", _apart(history.stretch[row], state), STATE, where)
        verdict.check("step_end", _relative(float(history.pressure[row]), state.pressure), STATE, where)
    if reference.samples is not None and reference.outcome != "runaway":
        verdict.check("samples", _samples_apart(history, reference), STATE, "of a run in real time")
    if np.isfinite(reference.dissipated) and reference.outcome != "runaway":
        exact, found = reference.dissipated, history.energy_balance.dissipated
        verdict.check(
            "heat", abs(found - exact) / max(1e-3, abs(exact)), STATE, f"{found!r}, expected {exact!r}"
        )


def _samples_apart(history: History, reference: Reference) -> float:
    """How far the samples of a run in real time are from the reference's states at their times."""
    assert reference.samples is not None
    assert reference.sample_times is not None
    assert reference.sample_steps is not None
    near = 1e-12 * (float(history.time[-1]) or 1.0)
    worst = 0.0
    for time, step, state in zip(
        reference.sample_times, reference.sample_steps, reference.samples, strict=True
    ):
        rows = (history.step == step) & (np.abs(history.time - time) <= near)
        if np.any(rows):
            apart = np.max(np.abs(history.stretch[rows] - state) / np.maximum(1.0, state), axis=1)
            worst = max(worst, float(np.min(apart)))
    return worst


def _in_order(history: History, reference: Reference) -> tuple[list[Any], list[Any]]:
    """Events of both; in real time those of one instant by kind."""
    found, expected = list(history.events), list(reference.events)
    if history.scenario.dynamics is None:
        return found, expected
    near = SAME_TIME * (float(history.time[-1]) or 1.0)
    ends = ("loss_of_tension", "breakdown", "runaway", "out_of_range")

    def key(event: Any) -> tuple[float, bool, str]:
        return round(event.time / near), event.kind in ends, str(event.kind)

    return sorted(found, key=key), sorted(expected, key=key)


def _voltage_units(history: History) -> FloatArray:
    films = [b for b in history.scenario.balloons if b.electrodes]
    return np.array([max(1.0, b.thickness * np.sqrt(b.modulus / b.permittivity)) for b in films])


def _largest(values: FloatArray) -> float:
    return float(np.max(np.abs(values), initial=0.0))


def _relative(found: float, exact: float) -> float:
    return abs(found - exact) / max(1.0, abs(exact))


def _apart(stretch: FloatArray, state: State) -> float:
    return _largest((stretch - state.stretch) / np.maximum(1.0, state.stretch))
