"""What a history amounts to, in a few numbers: for the summary in the terminal and `run.json`."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from simulator import units
from simulator.events import Outcome
from simulator.scenario.steps import Cycle as RepeatedSteps

if TYPE_CHECKING:
    from simulator.results.history import FloatArray, History
    from simulator.scenario.steps import Step
    from simulator.units import Dimension

_ONE_NUMBER = 1e-9  # of the largest loop work: what differs by less is the same in all cycles


@dataclass(frozen=True)
class Residual:
    """What a voltage leaves behind once it is back at zero.

    Attributes
    ----------
    before, after : (n_balloons,) arrays
        Stretches at the last sample before the first voltage, and at the end of the history.
    """

    before: FloatArray
    after: FloatArray


def residual(history: History) -> Residual | None:
    """The stretches before any voltage and at the end; None unless there was one and it is back at zero.

    Only a history that was completed has come to its end.
    """
    if history.outcome is not Outcome.COMPLETED or not history.voltage.size:
        return None
    on = np.flatnonzero((np.abs(history.voltage) > units.NOISE).any(axis=1))
    if not on.size or on[0] == 0 or on[-1] == len(history) - 1:
        return None
    return Residual(history.stretch[on[0] - 1], history.stretch[-1])


def not_played(history: History) -> tuple[int, int] | None:
    """The first and the last of the steps that were not begun, from 1, cycles unrolled; None if all were."""
    if history.outcome is Outcome.COMPLETED:
        return None
    last = int(history.step[-1]) if len(history) else 0
    total = _count(history.scenario.steps)
    return (last + 1, total) if last < total else None


def _count(steps: Iterable[Step]) -> int:
    """How many steps there are with cycles unrolled, without unrolling them."""
    return sum(step.cycle * _count(step.steps) if isinstance(step, RepeatedSteps) else 1 for step in steps)


def loop_works(history: History) -> tuple[float, ...]:
    """Loop work ∫φ dq of the complete cycles, of all sources together.

    One number if it is the same in all of them; the first and the last if not; none without a cycle.
    """
    works = [cycle.total_work for cycle in history.cycles if cycle.complete]
    if not works:
        return ()
    same = max(works) - min(works) <= _ONE_NUMBER * max(abs(work) for work in works)
    return (works[0],) if same else (works[0], works[-1])


def summary_record(history: History) -> dict[str, Any]:
    """The numbers of a summary by name, with their SI twins where the scenario has [scales]."""
    scales = history.scenario.scales

    def with_si(name: str, dimension: Dimension, values: Any) -> dict[str, Any]:
        both = {name: values}
        if scales is not None:
            factor = scales.of(dimension)
            both[f"{name} [{dimension.unit}]"] = (
                {key: value * factor for key, value in values.items()}
                if isinstance(values, dict)
                else [value * factor for value in values]
            )
        return both

    def by_name(names: Iterable[str], values: FloatArray) -> dict[str, float]:
        return dict(zip(names, values.tolist(), strict=True))

    record: dict[str, Any] = {}
    if len(history):
        record["largest_stretch"] = by_name(history.balloons, history.extremes.largest_stretch)
        fields = by_name(history.electroded, history.extremes.largest_field)
        record |= with_si("largest_field", units.FIELD, fields)
    if works := loop_works(history):
        record["complete_cycles"] = sum(cycle.complete for cycle in history.cycles)
        record |= with_si("loop_work", units.ENERGY, works)
    if (left := residual(history)) is not None:
        record["stretch_before_voltage"] = by_name(history.balloons, left.before)
        record["residual_stretch"] = by_name(history.balloons, left.after)
    if (rest := not_played(history)) is not None:
        record["steps_not_played"] = rest
    return record
