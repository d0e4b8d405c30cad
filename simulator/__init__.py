"""Voltage histories of interconnected dielectric-elastomer balloons.

>>> from simulator import load_scenario, simulate
>>> history = simulate(load_scenario("scenarios/fig5b_state_b.toml"))
>>> history.outcome, [event.kind for event in history.events]

Names are loaded when first used, so that ``import simulator`` costs next to nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from simulator.events import EventKind, Outcome
    from simulator.results.curve import Curve, FoldCurve
    from simulator.results.files import OutputError
    from simulator.results.history import (
        EnergyBalance,
        Event,
        History,
        SolverStatistics,
        Stop,
        Verdict,
    )
    from simulator.scenario import Scenario, ScenarioError, load_scenario
    from simulator.simulation.explanation import explain
    from simulator.simulation.run import SolverError, simulate
    from simulator.solver.follow import PathError

__version__ = "0.1.0"

__all__ = [
    "Curve",
    "EnergyBalance",
    "Event",
    "EventKind",
    "FoldCurve",
    "History",
    "Outcome",
    "OutputError",
    "PathError",
    "Scenario",
    "ScenarioError",
    "SolverError",
    "SolverStatistics",
    "Stop",
    "Verdict",
    "explain",
    "load_scenario",
    "simulate",
]

_HOME = {
    "Curve": "results.curve",
    "EnergyBalance": "results.history",
    "Event": "results.history",
    "EventKind": "events",
    "FoldCurve": "results.curve",
    "History": "results.history",
    "Outcome": "events",
    "OutputError": "results.files",
    "PathError": "solver.follow",
    "Scenario": "scenario",
    "ScenarioError": "scenario",
    "SolverError": "simulation.run",
    "SolverStatistics": "results.history",
    "Stop": "results.history",
    "Verdict": "results.history",
    "explain": "simulation.explanation",
    "load_scenario": "scenario",
    "simulate": "simulation.run",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
