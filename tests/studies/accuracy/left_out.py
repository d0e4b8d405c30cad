"""What a scenario does not name costs nothing: scenarios, each with more in it than the last, measured.

Each is run once in a fresh process, which tells what it imported, and several times in this one, which tells
what it cost.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from simulator.scenario import load_scenario
from simulator.simulation.explanation import assembled
from simulator.simulation.run import simulate

if TYPE_CHECKING:
    from simulator.scenario import Scenario

_GENT = {"model": "gent", "J_lim": 100}
_PASSIVE = {"name": "passive", "elastomer": _GENT}
_ACTIVE = {"name": "active", "electrodes": True, "elastomer": _GENT}
_BREAKABLE = _ACTIVE | {"breakdown": {"field": 50.0}}  # a field that is not reached
_CYCLE = [{"ramp": 0.4}, {"hold": 1}, {"ramp": 0.0}]
_OUTPUT = {"points": 11}


def _scenario(title: str, balloons: Sequence[Any], steps: Sequence[Any]) -> dict[str, Any]:
    return {
        "title": title,
        "gas": {"ambient_pressure": 0.015},
        "balloon": list(balloons),
        "step": list(steps),
        "output": _OUTPUT,
    }


SCENARIOS: tuple[dict[str, Any], ...] = (
    _scenario("a balloon left alone", [_PASSIVE], [{"hold": 1}]),
    _scenario("one balloon inflated", [_PASSIVE], [{"inflate": 1.2}]),
    _scenario(
        "an actuator at constant pressure, valve open",
        [_ACTIVE],
        [{"inflate": 1.2}, {"ramp": 0.1, "valve": "open"}],
    ),
    _scenario("a sealed pair, one ramp", [_ACTIVE, _PASSIVE], [{"inflate": 1.2}, {"ramp": 0.3}]),
    _scenario(
        "a sealed pair with a breakdown strength, up and down over both snaps",
        [_BREAKABLE, _PASSIVE],
        [{"inflate": 1.2}, *_CYCLE],
    ),
    _scenario(
        "the same, ten cycles",
        [_BREAKABLE, _PASSIVE],
        [{"inflate": 1.2}, {"cycle": 10, "steps": _CYCLE}],
    ),
    _scenario(
        "three balloons, two actuators with their own voltages and strengths, one cycle",
        [
            _BREAKABLE | {"name": "left"},
            _BREAKABLE | {"name": "right", "radius": 0.9},
            _PASSIVE,
        ],
        [
            {"inflate": 1.2},
            {"ramp": {"left": 0.3, "right": 0.2}},
            {"ramp": {"left": 0.0, "right": 0.0}},
        ],
    ),
)

_PROGRAM = """
import json, sys
before = set(sys.modules)
from simulator import load_scenario, simulate
simulate(load_scenario(json.load(sys.stdin)))
print(json.dumps(sorted(set(sys.modules) - before)))
"""


@dataclass(frozen=True)
class Anatomy:
    """What a scenario assembled, imported and cost.

    Attributes
    ----------
    title : str
    sets : tuple of (int, int)
        Unknowns and event functions of every different set of equations, in order of appearance. The drive is
        among the unknowns.
    equations : int
        How many different sets of equations that was.
    solves, steps, calls : int
        Pieces handed to IDA, its steps and its residual calls.
    modules : tuple of str
        Of this package, in a fresh process, without the package's name.
    libraries : tuple of str
        Other packages loaded there, the standard library excepted.
    milliseconds : float
        Median processor time of `simulate`.
    """

    title: str
    sets: tuple[tuple[int, int], ...]
    equations: int
    solves: int
    steps: int
    calls: int
    modules: tuple[str, ...]
    libraries: tuple[str, ...]
    milliseconds: float


def sets(scenario: Scenario) -> list[tuple[int, int]]:
    """Unknowns and event functions of every different set of equations of a scenario; nothing is solved."""
    groups = {group.equations: group for step in assembled(scenario) for group in step.groups}
    return [(g.equations.scales.size, len(g.conditions)) for g in groups.values()]


def anatomies(scenarios: Sequence[dict[str, Any]] = SCENARIOS, repetitions: int = 15) -> list[Anatomy]:
    """Scenarios taken apart; times are medians of interleaved repetitions."""
    loaded = [load_scenario(written) for written in scenarios]
    histories = [simulate(scenario) for scenario in loaded]
    seconds: list[list[float]] = [[] for _ in loaded]
    for _ in range(repetitions):
        for scenario, taken in zip(loaded, seconds, strict=True):
            begun = time.process_time()
            simulate(scenario)
            taken.append(time.process_time() - begun)
    found = []
    loads = imported(scenarios)
    for scenario, history, taken, (modules, libraries) in zip(loaded, histories, seconds, loads, strict=True):
        different = sets(scenario)
        counts = history.statistics
        found.append(
            Anatomy(
                scenario.title,
                tuple(dict.fromkeys(different)),
                len(different),
                counts.ida_solves,
                counts.ida_steps,
                counts.residual_calls,
                modules,
                libraries,
                1e3 * statistics.median(taken),
            )
        )
    return found


def imported(scenarios: Sequence[dict[str, Any]]) -> list[tuple[tuple[str, ...], tuple[str, ...]]]:
    """Modules of this package, and other packages, that the run of each scenario loads in a fresh process.

    Raises
    ------
    RuntimeError
        If a process fails.
    """
    home = str(Path(__file__).parents[3])
    paths = [home, *filter(None, [os.environ.get("PYTHONPATH")])]
    pipes: dict[str, Any] = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", _PROGRAM],
            text=True,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)},
            **pipes,
        )
        for _ in scenarios
    ]
    found, failures = [], []
    for written, process in zip(scenarios, processes, strict=True):
        printed, complaint = process.communicate(json.dumps(written))
        if process.returncode:
            failures.append(f"a process that runs {written['title']!r} failed: {complaint.strip()}")
            continue
        names: list[str] = json.loads(printed)
        modules = tuple(name.partition(".")[2] for name in names if name.startswith("simulator."))
        tops = {name.partition(".")[0] for name in names} - set(sys.stdlib_module_names) - {"simulator"}
        found.append((modules, tuple(sorted(name for name in tops if not name.startswith("_")))))
    if failures:
        raise RuntimeError("\n".join(failures))
    return found
