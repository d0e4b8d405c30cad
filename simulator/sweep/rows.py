"""One run of a sweep as one row of numbers, and chunks of rows as text.

What a worker does, and all that it does: no files, no state between runs.
"""

from __future__ import annotations

import contextlib
import csv
import io
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import takewhile
from typing import TYPE_CHECKING, Any

import numpy as np

from simulator import __version__
from simulator.events import EventKind, Outcome
from simulator.results.shapes import shape_word
from simulator.scenario import Inflate, Scenario, ScenarioError, load_scenario
from simulator.scenario.mapping import with_values
from simulator.simulation.run import SolverError, simulate
from simulator.sweep.lockstep import chunk
from simulator.sweep.measures import in_units
from simulator.sweep.plan import AT_REST, Job, Past, Value

if TYPE_CHECKING:
    from simulator.results.history import Event, History

_ENDS = (
    Outcome.LOSS_OF_TENSION,
    Outcome.BREAKDOWN,
    Outcome.RUNAWAY,
    Outcome.OUT_OF_RANGE,
    Outcome.LOSS_OF_SPHERICITY,
)

OUTCOMES = (*(outcome.value for outcome in Outcome), "refused")
"""What the column `outcome` may say: how a history ended, or "refused" where the scenario makes no sense."""

BEHAVIOURS = (
    "continuous",
    "snap",
    "snap_returns",
    "snap_stays",
    *(f"{before}{end.value}" for end in _ENDS for before in ("", "snap_to_", "snap_then_")),
    "refused",
    "failed",
)
"""What the column `behaviour` may say; see `behaviour`."""

_SAME = 1e-11  # two targets of a ramp, relatively, that are one

SENSITIVITY = "d(limit_point_1_{of})/d({key})"


@dataclass(frozen=True)
class Task:
    """Runs `start` to `start + len(values)` − 1 of a sweep, the values of each by axis.

    `audited` are the places among them of runs that are played in lockstep and by themselves, and compared.
    """

    number: int
    start: int
    values: tuple[tuple[Value, ...], ...]
    audited: tuple[int, ...] = ()


def columns(job: Job) -> dict[str, str]:
    """The columns of a sweep's table in order, each with its kind: number, whole, text or truth."""
    voltages = {
        f"limit_point_{i}_voltage_{name}": "number"
        for i in range(1, job.recorded.limit_points + 1)
        for name in job.electroded
    }
    return {
        "run": "whole",
        **{axis.key: axis.kind for axis in job.axes},
        **({job.past.key: "number"} if job.past else {}),
        "outcome": "text",
        "behaviour": "text",
        **({"shape": "text"} if job.recorded.shapes else {}),
        "limit_points": "whole",
        **voltages,
        "branch_points": "whole",
        "inflation_snaps": "whole",
        **{f"landing_stretch_{name}": "number" for name in job.balloons},
        "landing_pressure": "number",
        **{f"sealed_stretch_{name}": "number" for name in job.balloons},
        **{f"largest_stretch_{name}": "number" for name in job.balloons},
        **{f"residual_stretch_{name}": "number" for name in job.balloons},
        **{f"largest_field_{name}": "number" for name in job.electroded},
        **{f"least_margin_{name}": "number" for name in job.recorded.margins},
        **(_of_shapes(job) if job.recorded.shapes else {}),
        "loop_work": "number",
        "dissipated": "number",
        "energy_imbalance": "number",
        **{
            SENSITIVITY.format(of=f"voltage_{name}", key=key): "number"
            for key in job.recorded.sensitivities
            for name in job.electroded
        },
        "way": "text",
        "seconds": "number",
        "error": "text",
    }


def _of_shapes(job: Job) -> dict[str, str]:
    return {
        **{f"sphericity_voltage_{name}": "number" for name in job.electroded},
        **{f"least_sphericity_{name}": "number" for name in job.balloons},
    }


def play_chunk(job: Job, task: Task) -> str:
    """Play the runs of a task; this is what a worker process calls.

    Parameters
    ----------
    job : Job
    task : Task

    Returns
    -------
    str
        The rows as CSV text without a header, columns as in `columns`.

    Raises
    ------
    RuntimeError
        If this process has another version of the package than the one that asks.
    DisagreementError
        If an audited run does not come out the same both ways.
    """
    if job.version != __version__:
        raise RuntimeError(
            f"a worker has dielectric-balloons {__version__}, the sweep was started by {job.version}; "
            "install the same version everywhere"
        )
    names = list(columns(job))
    rows = chunk.rows(job, task.start, task.values, task.audited, names, play)
    converted = in_units(job, names)
    return as_text(converted(values, row) for values, row in zip(task.values, rows, strict=True))


def as_text(rows: Iterable[Sequence[object]]) -> str:
    """Rows as CSV: numbers with as many digits as give the same double back, NaN and None empty."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    for row in rows:
        writer.writerow([_cell(value) for value in row])
    return stream.getvalue()


def _cell(value: object) -> str | int | float:
    if type(value) is float:  # most are
        return value if value == value else ""
    if value is None or value != value:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, np.generic):
        value = value.item()
    return value if isinstance(value, int | float) else " ".join(str(value).split())


def play(job: Job, index: int, values: Sequence[Value], expected: float | None = None) -> dict[str, Any]:
    """Play one run.

    Parameters
    ----------
    job : Job
    index : int
        From 0.
    values : sequence
        One for each axis.
    expected : float, optional
        How far a ramp past its limit point probably goes. Where that is so, one history tells; else it is
        found out as without.

    Returns
    -------
    dict
        The row by column, what was varied as it is written and the rest dimensionless. What went wrong is in
        `error`; what the run does not have is left out.
    """
    started = time.perf_counter()
    row: dict[str, Any] = {"run": index + 1, **{a.key: v for a, v in zip(job.axes, values, strict=True)}}
    written = {axis.key: axis.written(value) for axis, value in zip(job.axes, values, strict=True)}
    try:
        history = _played(job, with_values(job.scenario, written), row, expected)
        row |= facts(history, job.recorded.limit_points)
        row |= {f"least_margin_{one.balloon}": one.margin for one in history.verdicts}
        if job.recorded.sensitivities:
            row |= _sensitivities(history, job)  # what they lack is said in `error`; the rest stands
    except ScenarioError as error:
        row |= {"outcome": "refused", "behaviour": "refused", "error": str(error).removeprefix("<dict>: ")}
    except SolverError as error:
        row |= failure(str(error).removeprefix("<dict>: "))
    except Exception as error:  # whatever it is, it is this run's alone
        row |= failure(f"{type(error).__name__}: {error}")
    row["seconds"] = time.perf_counter() - started
    return row


def failure(message: str) -> dict[str, Any]:
    """What a row says of a run that gave no history."""
    return {"outcome": Outcome.FAILED.value, "behaviour": Outcome.FAILED.value, "error": message}


def _played(job: Job, mapping: Mapping[str, Any], row: dict[str, Any], expected: float | None) -> History:
    """The history of a scenario, its ramp cut short past the limit point where that is asked for."""
    scenario = _on_grid(mapping)
    past = job.past
    if past is None:
        return simulate(scenario)
    written = float(scenario.steps[past.step - 1].ramp)  # type: ignore[union-attr, arg-type]
    if expected is not None:
        with contextlib.suppress(SolverError, ScenarioError):
            history = simulate(_on_grid(with_values(mapping, {past.key: expected})))
            if abs(_target(history, past, written) - expected) <= _SAME * abs(expected):
                row[past.key] = expected
                return history
    try:
        whole = simulate(scenario)
    except SolverError as error:
        # What fails beyond the limit point need not be gone through.
        if error.history is None or not _turned(error.history.mechanical, past.step):
            raise
        whole = error.history
    row[past.key] = _target(whole, past, written)
    if not _turned(whole.mechanical, past.step):
        return whole
    return simulate(_on_grid(with_values(mapping, {past.key: row[past.key]})))


def _on_grid(mapping: Mapping[str, Any]) -> Scenario:
    """A scenario without samples for pictures: nothing in a row depends on samples."""
    scenario = load_scenario(mapping)
    return scenario.model_copy(update={"output": scenario.output.model_copy(update={"chord": 1.0})})


def _target(history: History, past: Past, written: float) -> float:
    """How far a ramp is to go: past the first limit point of a history, else as written."""
    turn = _turned(history.mechanical, past.step)
    if turn is None:
        return written
    before = history.voltage[history.step < past.step, 0]
    start = float(before[-1]) if before.size else 0.0
    return start + past.times * (float(turn.voltage[0]) - start)


def _turned(events: Sequence[Event], step: int) -> Event | None:
    """The first limit point of a step, if that is the first thing to happen in it."""
    first = next((event for event in events if event.step == step), None)
    return first if first is not None and first.kind is EventKind.LIMIT_POINT else None


def facts(history: History, limit_points: int) -> dict[str, Any]:
    """What a row says of a history, by column.

    Parameters
    ----------
    history : History
    limit_points : int
        The voltages of at most so many of them.
    """
    opening = sum(
        1 for _ in takewhile(lambda step: isinstance(step, Inflate), history.scenario.played_steps())
    )
    inflating = _inflating(history)
    turns = [e for e in history.events if e.kind is EventKind.LIMIT_POINT and e.step not in inflating]
    snaps = [e for e in history.snaps if e.step not in inflating and _moved(e)]
    sealed = int(np.searchsorted(history.step, opening, side="right")) - 1 if opening else 0
    complete = history.outcome is Outcome.COMPLETED
    row: dict[str, Any] = {
        "outcome": history.outcome.value,
        "behaviour": behaviour(history, snaps, sealed),
        "shape": shape_word(history, snaps),
        "limit_points": len(turns),
        "branch_points": sum(
            e.kind is EventKind.BRANCH_POINT and e.step not in inflating for e in history.events
        ),
        "inflation_snaps": sum(e.step in inflating for e in history.snaps),
        "dissipated": history.energy_balance.dissipated,
        "energy_imbalance": history.energy_balance.relative_imbalance,
        "exchanged": history.energy_balance.exchanged,  # no column
    }
    for i, turn in enumerate(turns[:limit_points], start=1):
        row |= {
            f"limit_point_{i}_voltage_{n}": v for n, v in zip(history.electroded, turn.voltage, strict=True)
        }
    if snaps:
        landed = snaps[0]
        assert landed.stretch_after is not None
        row |= _named("landing_stretch", history.balloons, landed.stretch_after)
        row["landing_pressure"] = landed.pressure_after
    row |= _named("sealed_stretch", history.balloons, history.stretch[sealed])
    row |= _named("largest_stretch", history.balloons, history.extremes.largest_stretch)
    if complete:
        row["loop_work"] = history.energy_balance.electrical_work
        row |= _named("residual_stretch", history.balloons, history.stretch[-1])
    if history.sphericity.size:
        row |= _named("least_sphericity", history.balloons, history.sphericity.min(axis=0))
    lost = next((e for e in history.events if e.kind is EventKind.LOSS_OF_SPHERICITY), None)
    if lost is not None:
        row |= _named("sphericity_voltage", history.electroded, lost.voltage)
    return row | _named("largest_field", history.electroded, history.extremes.largest_field)


def _inflating(history: History) -> set[int]:
    """The steps with events in which the pressure is what moves."""
    wanted = {event.step for event in history.events}
    last = max(wanted, default=0)
    steps = zip(range(1, last + 1), history.scenario.played_steps(), strict=False)
    return {number for number, step in steps if number in wanted and isinstance(step, Inflate)}


def _moved(event: Event) -> bool:
    after = event.stretch_after
    return after is not None and float(np.abs(after - event.stretch_before).max()) > AT_REST


def _named(quantity: str, names: Sequence[str], values: Iterable[float]) -> dict[str, float]:
    return {f"{quantity}_{name}": value for name, value in zip(names, values, strict=True)}


def behaviour(history: History, snaps: Sequence[Event], sealed: int) -> str:
    """What a history amounts to, in one word.

    Parameters
    ----------
    history : History
    snaps : sequence of Event
        Voltage-driven snaps with a landing.
    sealed : int
        The sample at which the gas was sealed for the first time.

    Returns
    -------
    str
        "continuous" (no snap); "snap_returns", "snap_stays" (back in the sealed state at the end, or not),
        "snap" where voltage is left at the end; or the outcome, as "snap_to_…" where a snap ended so
        before it landed, as "snap_then_…" where it ended so later.
    """
    if history.outcome is Outcome.COMPLETED:
        if not snaps:
            return "continuous"
        if np.any(history.voltage[-1] != 0.0):
            return "snap"
        back = np.abs(history.stretch[-1] - history.stretch[sealed]).max() < AT_REST
        return "snap_returns" if back else "snap_stays"
    end = history.outcome.value
    last = history.events[-1]
    before = next((event for event in reversed(history.mechanical) if event is not last), None)
    inflated = isinstance(_played_step(history, last.step), Inflate)
    at_once = before is not None and before.time == last.time and not inflated
    at_once &= last.kind is not EventKind.LOSS_OF_SPHERICITY  # a snap has landed then
    if at_once and before is not None and before.kind in (EventKind.LIMIT_POINT, EventKind.BRANCH_POINT):
        return f"snap_to_{end}"
    return f"snap_then_{end}" if snaps else end


def _played_step(history: History, number: int) -> object:
    return next(step for i, step in enumerate(history.scenario.played_steps(), start=1) if i == number)


def _sensitivities(history: History, job: Job) -> dict[str, Any]:
    from simulator.analysis.sensitivity import sensitivities

    inflating = _inflating(history)
    turns = [e for e in history.events if e.kind is EventKind.LIMIT_POINT and e.step not in inflating]
    try:
        found = sensitivities(history, turns[0], job.recorded.sensitivities) if turns else ()
    except (ArithmeticError, ScenarioError) as error:
        return {"error": f"no sensitivities: {error}"}
    return {SENSITIVITY.format(of=one.of, key=one.key): one.derivative for one in found}
