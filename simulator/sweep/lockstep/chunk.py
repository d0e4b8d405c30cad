"""A chunk of a sweep: in lockstep what can be, the rest run by run, and some runs both ways."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from simulator.sweep.lockstep.play import play as play_stack
from simulator.sweep.lockstep.stacking import Stack, stacks
from simulator.sweep.lockstep.table import certain, columns_of
from simulator.sweep.plan import Job, Value

LOCKSTEP, ALONE = "lockstep", "simulate"

FEWEST = 12  # runs of a chunk: fewer are played faster one by one
_VOLTAGES = 1e-11  # of limit points, relatively: how well both ways must agree
_STATES = 1e-8  # of everything else
# Of the work exchanged: how well `simulate` integrates work; the rounding of a difference of energies.
_OF_WORK = {"loop_work": 1e-10, "dissipated": 1e-12}
_NOT_COMPARED = ("run", "seconds", "energy_imbalance", "error", "way")

Row = Mapping[str, Any]


class DisagreementError(RuntimeError):
    """A run played both ways came out differently; nothing of the sweep is to be trusted."""


def rows(
    job: Job,
    start: int,
    values: Sequence[Sequence[Value]],
    audited: Sequence[int],
    names: Sequence[str],
    play: Callable[..., Row],
) -> list[Sequence[object]]:
    """The rows of runs `start` …, cells in the order of `names`.

    Parameters
    ----------
    job : Job
    start : int
        Number of the first run, from 0.
    values : sequence
        Those of each run, by axis.
    audited : sequence of int
        Places of the runs that are played both ways.
    names : sequence of str
        Of the columns.
    play : callable
        Plays one run by itself; see `rows.play`.

    Raises
    ------
    DisagreementError
        If an audited run does not come out the same.
    """
    found: list[Sequence[object] | None] = [None] * len(values)
    one_by_one = job.recorded.sensitivities or job.recorded.margins
    if len(values) >= FEWEST and not one_by_one:
        for stack in stacks(job, values):
            if isinstance(stack, Stack) and stack.runs.size >= FEWEST:
                _fill(job, start, values, stack, names, found)
    for place in audited:
        row = found[place]
        if row is not None:
            together = dict(zip(names, row, strict=True))
            expected = together.get(job.past.key) if job.past else None
            compare(start + place + 1, together, play(job, start + place, values[place], expected))
    out: list[Sequence[object]] = []
    for place, row in enumerate(found):
        if row is None:
            alone = {**play(job, start + place, values[place]), "way": ALONE}
            row = [alone.get(name) for name in names]
        out.append(row)
    return out


def _fill(
    job: Job, start: int, values: Sequence[Sequence[Value]], stack: Stack, names: Sequence[str],
    found: list[Sequence[object] | None],
) -> None:  # fmt: skip
    """Put the rows of a stack where they belong, but for those of runs that were given up."""
    began = time.perf_counter()
    runs = stack.runs.tolist()
    played = play_stack(stack.device, stack.moves, len(runs), job.past, watched=job.recorded.shapes)
    columns = columns_of(job, played)
    columns["run"] = [start + run + 1 for run in runs]
    columns["way"] = [LOCKSTEP] * len(runs)
    for place, axis in enumerate(job.axes):
        columns[axis.key] = [values[run][place] for run in runs]
    columns["seconds"] = [(time.perf_counter() - began) / len(runs)] * len(runs)
    nothing = [None] * len(runs)
    good = certain(played).tolist()
    for run, fit, row in zip(
        runs, good, zip(*(columns.get(n, nothing) for n in names), strict=True), strict=True
    ):
        if fit:
            found[run] = row


def compare(run: int, together: Row, alone: Row) -> None:
    """Raise where a run does not come out the same both ways; by itself it says what work was exchanged."""
    for name, here in together.items():
        if name in _NOT_COMPARED:
            continue
        there = alone.get(name)
        if isinstance(here, float) or isinstance(there, float):
            here = math.nan if here is None else float(here)
            there = math.nan if there is None else float(there)
            exact = name.startswith(("limit_point_", "sphericity_voltage_"))
            allowed = (_VOLTAGES if exact else _STATES) * (1.0 + abs(there))
            allowed += _OF_WORK.get(name, 0.0) * alone.get("exchanged", 0.0)
            # The smallest margins of a run by itself are those of its samples.
            off = here - there if name.startswith("least_") else abs(there - here)
            same = (math.isnan(here) and math.isnan(there)) or off <= allowed
        else:
            same = here == there
        if not same:
            raise DisagreementError(
                f"run {run}: {name} is {here!r} in lockstep and {there!r} by itself; please report this"
            )
