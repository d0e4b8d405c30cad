"""What a history may be where its device is known to some percent: bands on the loop, from runs in lockstep.

Each ramp is played in parts, and after each of them all runs are looked at together. Runs that have snapped
and runs that have not are never mixed: of each number of snaps so far there is a band of its own, with the
share of the runs that are on it.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator import __version__
from simulator.results.csv_text import Columns, write_csv
from simulator.results.files import write_files
from simulator.scenario import Problem, Ramp, Scenario, ScenarioError, ScenarioLike, load_scenario
from simulator.scenario.keys import all_keys, number_at
from simulator.scenario.mapping import near, number_and_unit
from simulator.sweep.lockstep.chunk import ALONE, LOCKSTEP
from simulator.sweep.lockstep.play import Played
from simulator.sweep.lockstep.play import play as play_stack
from simulator.sweep.lockstep.ride import THERE
from simulator.sweep.lockstep.stacking import Stack, stacks
from simulator.sweep.lockstep.table import certain, columns_of
from simulator.sweep.measures import in_units, units_of
from simulator.sweep.plan import Axis, Job, Recorded, Sample, as_recorded, drawn
from simulator.sweep.quantiles import Uncertainty, of_columns
from simulator.sweep.rows import columns, play
from simulator.sweep.spread import Spread

FloatArray = NDArray[np.float64]
Index = NDArray[np.int64]

BANDS_FILE = "bands.csv"
BAND = (0.025, 0.5, 0.975)
SIZE, PARTS = 2048, 12
FILM = ("thickness", "modulus", "permittivity")
REL = 0.05


@dataclass(frozen=True)
class Bands:
    """Where the runs are after each part of each step, runs with equally many snaps together.

    Attributes
    ----------
    step : (n_rows,) array
        As written, from 1; cycles unrolled.
    snaps, runs : (n_rows,) arrays
        So many voltage-driven snaps so far, and how many runs these are.
    voltage : (n_rows, n_electroded) array
    stretch : (n_rows, n_balloons, 3) array
        The quantiles `BAND`.
    uncertainty : Uncertainty
        Of the rows of all runs, as of a sweep.
    ways : mapping of str to int
        How many runs were played in lockstep, and how many by themselves.
    """

    balloons: tuple[str, ...]
    electroded: tuple[str, ...]
    step: Index
    snaps: Index
    runs: Index
    voltage: FloatArray
    stretch: FloatArray
    uncertainty: Uncertainty
    ways: Mapping[str, int]

    def columns(self) -> Columns:
        """The rows by column, in the order of `bands.csv`; dimensionless."""
        found: Columns = {"step": self.step, "snaps": self.snaps, "runs": self.runs}
        for i, name in enumerate(self.electroded):
            found[f"voltage_{name}"] = self.voltage[:, i]
        for i, name in enumerate(self.balloons):
            for place, share in enumerate(BAND):
                found[f"stretch_{name}_{share:g}"] = self.stretch[:, i, place]
        return found

    def to_csv(self, directory: str | os.PathLike[str]) -> list[Path]:
        """Write `bands.csv`, and what `Uncertainty.to_csv` writes. Raises OutputError."""
        paths = write_files(directory, {BANDS_FILE: partial(write_csv, self.columns())})
        return [*paths, *self.uncertainty.to_csv(directory)]


def film_spreads(scenario: Scenario, rel: float = REL) -> dict[str, float]:
    """The numbers of all films, each with a relative standard deviation."""
    return {
        f"balloon.{balloon.name}.{word}": rel
        for balloon in scenario.balloons
        for word in FILM
        if word != "permittivity" or balloon.electrodes
    }


def bands(
    scenario: ScenarioLike, spreads: Mapping[str, float] | None = None, *, size: int = SIZE, seed: int = 0
) -> Bands:
    """Play a scenario many times with normal numbers about its own, and say where the runs are on the way.

    Parameters
    ----------
    scenario : Scenario, path or mapping
    spreads : mapping of str to float, optional
        Relative standard deviations by key. Default: 5 % of thickness, modulus and permittivity of each film.
    size : int
        Number of runs, a power of 2.
    seed : int

    Raises
    ------
    ScenarioError
        If the scenario makes no sense, a key is not there or holds no number other than 0; or if its runs
        cannot be played in lockstep, see `docs/sweep.md`.
    """
    scenario = load_scenario(scenario)
    parted, numbers = in_parts(scenario)
    job = _job(scenario, parted, film_spreads(scenario) if spreads is None else spreads)
    points = drawn(Sample("sobol", size, seed), job.axes)
    runs = [tuple(row) for row in points.tolist()]
    collected = _Collected(numbers)
    rows: list[Mapping[str, Any] | None] = [None] * len(runs)
    for stack in stacks(job, runs):
        if not isinstance(stack, Stack):
            raise ScenarioError(
                scenario.file, Problem("step", None, f"cannot be played in lockstep: {stack[1]}")
            )
        collected.begin(stack)
        played = play_stack(stack.device, stack.moves, stack.runs.size, None, after=collected.after)
        found = {**columns_of(job, played), "way": [LOCKSTEP] * stack.runs.size}
        good = certain(played)
        for at, place in enumerate(stack.runs.tolist()):
            if good[at]:
                rows[place] = {name: values[at] for name, values in found.items()}
    for place, row in enumerate(rows):
        if row is None:
            rows[place] = {**play(job, place, runs[place]), "way": ALONE}
    complete = [row for row in rows if row is not None]
    ways = [str(row["way"]) for row in complete]
    return Bands(
        job.balloons,
        job.electroded,
        *collected.quantiles(),
        _uncertainty(scenario, job, runs, complete),
        {way: ways.count(way) for way in (LOCKSTEP, ALONE)},
    )


def in_parts(scenario: Scenario, parts: int = PARTS) -> tuple[Scenario, list[int]]:
    """A scenario whose ramps are split, and the step as played that each of its steps is a part of."""
    steps: list[Any] = []
    numbers: list[int] = []
    now = dict.fromkeys(scenario.electroded, 0.0)
    for number, step in enumerate(scenario.played_steps(), start=1):
        target = _target(step, now)
        if target is None or not isinstance(step, Ramp) or step.until is not None:
            steps.append(step)
            numbers.append(number)
        else:
            for part in range(1, parts + 1):
                share = part / parts  # at the end exactly 1
                there = {n: (1.0 - share) * now[n] + share * target[n] for n in now}
                ramp: Any = there if isinstance(step.ramp, dict) or len(set(there.values())) > 1 else None
                value = next(iter(there.values())) if ramp is None else ramp
                steps.append(step.model_copy(update={"ramp": value, "over": float(step.over) / parts}))
                numbers.append(number)
        if target is not None:
            now = target
    return scenario.model_copy(update={"steps": tuple(steps)}), numbers


def _target(step: Any, now: Mapping[str, float]) -> dict[str, float] | None:
    """Where a ramp or a jump leads; None for what leads somewhere else."""
    wanted = getattr(step, "ramp", getattr(step, "jump", None))
    if wanted is None:
        return None
    by_name = wanted if isinstance(wanted, dict) else dict.fromkeys(now, float(wanted))
    return {name: float(by_name.get(name, value)) for name, value in now.items()}


def _job(scenario: Scenario, parted: Scenario, spreads: Mapping[str, float]) -> Job:
    axes, known = [], all_keys(scenario)
    problems = []
    for key, rel in spreads.items():
        try:
            value = number_at(scenario, key)
        except KeyError:
            problems.append(Problem(key, None, f"no number of the scenario, {near(key, known)}"))
            continue
        if not rel > 0.0 or not value:
            problems.append(Problem(key, rel, "must be > 0, of a number that is not 0"))
            continue
        spread = Spread("normal", value, abs(value) * rel)
        unit = _unit(known[key])
        axes.append(Axis(key, spread.ends, unit, spread=spread))
    if problems:
        raise ScenarioError(scenario.file, *problems)
    job = Job(
        scenario=as_recorded(parted, shapes=False),
        axes=tuple(axes),
        past=None,
        recorded=Recorded(),
        balloons=tuple(balloon.name for balloon in scenario.balloons),
        electroded=scenario.electroded,
        version=__version__,
    )
    return job


def _unit(written: Any) -> str:
    found = number_and_unit(written)
    return found[1] if found is not None else ""


class _Collected:
    """States of runs after each move, put together over stacks."""

    def __init__(self, numbers: Sequence[int]) -> None:
        self.numbers = numbers
        self.moves: list[list[tuple[FloatArray, FloatArray, Index]]] = [[] for _ in numbers]
        self.place = 0

    def begin(self, stack: Stack) -> None:
        """Begin with another stack."""
        self.place = 0

    def after(self, state: Played) -> None:
        """Keep where the runs are that go on."""
        going = np.flatnonzero(state.end == THERE)
        kept = state.stretch[:, going].copy(), state.voltage[:, going].copy(), state.snaps[going].copy()
        self.moves[self.place].append(kept)
        self.place += 1

    def quantiles(self) -> tuple[Index, Index, Index, FloatArray, FloatArray]:
        """Steps, snaps, counts, voltages and quantiles of the stretches, see `Bands`."""
        rows = []
        for number, parts in zip(self.numbers, self.moves, strict=True):
            if not parts:
                continue
            stretch, voltage = (np.concatenate([part[i] for part in parts], axis=-1) for i in (0, 1))
            snaps = np.concatenate([part[2] for part in parts])
            for count in np.unique(snaps).tolist():
                mine = snaps == count
                band = np.quantile(stretch[:, mine], BAND, axis=1).T
                rows.append((number, count, int(mine.sum()), np.median(voltage[:, mine], axis=1), band))
        steps, passed, counts, voltages, stretches = zip(*rows, strict=True)
        whole = np.int64
        return (
            np.array(steps, dtype=whole),
            np.array(passed, dtype=whole),
            np.array(counts, dtype=whole),
            np.array(voltages),
            np.array(stretches),
        )


def _uncertainty(
    scenario: Scenario, job: Job, runs: list[tuple[float, ...]], rows: list[Mapping[str, Any]]
) -> Uncertainty:
    """What the rows say, in their units."""
    kinds = columns(job)
    names = list(kinds)
    units = units_of(scenario, job, names)
    converted = in_units(replace(job, units=units), names)
    table = []
    for number, (run, row) in enumerate(zip(runs, rows, strict=True), start=1):
        full = {**row, "run": number, **{a.key: v for a, v in zip(job.axes, run, strict=True)}}
        table.append(converted(run, [full.get(name) for name in names]))
    found: dict[str, NDArray[Any]] = {}
    for name, cells in zip(names, zip(*table, strict=True), strict=True):
        if kinds[name] == "text":
            found[name] = np.array([str(cell or "") for cell in cells])
        else:
            found[name] = np.array([np.nan if cell is None else cell for cell in cells], dtype=np.float64)
    return of_columns(found, scenario.title, units)
