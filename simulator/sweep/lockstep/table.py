"""What was played as columns of the sweep's table."""

from __future__ import annotations

from typing import Any

import numpy as np

from simulator.events import OUTCOMES, Outcome
from simulator.sweep.lockstep.play import Played
from simulator.sweep.lockstep.ride import ENDS, GAVE_UP, THERE
from simulator.sweep.plan import AT_REST, Job


def columns_of(job: Job, played: Played) -> dict[str, list[Any]]:
    """The columns of all runs but those that vary, as lists; of a run that was given up they mean nothing."""
    end = played.end
    complete = end == THERE
    nothing = np.where(complete, 0.0, np.nan)
    names, electroded = job.balloons, job.electroded
    outcomes = np.array([Outcome.COMPLETED.value, *(OUTCOMES[kind].value for kind in ENDS)], dtype=object)
    outcome = outcomes[np.maximum(end, 0)]
    found: dict[str, Any] = {}
    if job.past:
        found[job.past.key] = played.past
    found |= {
        "outcome": outcome,
        "behaviour": _behaviour(played, outcome),
        "limit_points": played.limit_points,
        "branch_points": np.zeros_like(played.limit_points),
        "inflation_snaps": played.inflation_snaps,
        "landing_pressure": played.landing_pressure,
        "loop_work": played.electrical + nothing,
        "dissipated": played.dissipated,
        "energy_imbalance": np.abs(played.defect)
        / np.maximum(
            np.maximum(played.exchanged, np.abs(played.electrical) + np.abs(played.gas) + played.dissipated),
            1e-300,
        ),
    }
    for i in range(job.recorded.limit_points):
        for name in electroded:
            found[f"limit_point_{i + 1}_voltage_{name}"] = np.full(end.size, np.nan)
    seen = np.zeros(end.size, dtype=int)
    for voltage, runs in played.turns:
        for i in range(job.recorded.limit_points):
            mine = seen[runs] == i
            for name, values in zip(electroded, voltage, strict=True):
                found[f"limit_point_{i + 1}_voltage_{name}"][runs[mine]] = values[mine]
        seen[runs] += 1
    for i, name in enumerate(names):
        found[f"landing_stretch_{name}"] = played.landing[i]
        found[f"sealed_stretch_{name}"] = played.sealed[i]
        found[f"largest_stretch_{name}"] = played.largest[i]
        found[f"residual_stretch_{name}"] = played.stretch[i] + nothing
    for name, i in zip(electroded, played.device.electroded, strict=True):
        found[f"largest_field_{name}"] = played.largest_field[i]
    if played.shapes is not None:
        found["shape"] = played.shapes.words(played.snaps)
        for i, name in enumerate(names):
            found[f"least_sphericity_{name}"] = played.shapes.least[i]
        for name, values in zip(electroded, played.shapes.voltage, strict=True):
            found[f"sphericity_voltage_{name}"] = values
    return {name: np.asarray(values).tolist() for name, values in found.items()}


def _behaviour(played: Played, outcome: Any) -> Any:
    complete, snapped = played.end == THERE, played.snaps > 0
    on = np.any(played.voltage != 0.0, axis=0)
    back = np.abs(played.stretch - played.sealed).max(axis=0) < AT_REST
    words = np.where(back, "snap_returns", "snap_stays")
    words = np.where(on, "snap", words)
    words = np.where(snapped, words, "continuous").astype(object)
    ends = np.where(played.at_once, "snap_to_", np.where(snapped, "snap_then_", "")).astype(object) + outcome
    return np.where(complete, words, ends)


def certain(played: Played) -> Any:
    """Which runs were not given up."""
    return played.end != GAVE_UP
