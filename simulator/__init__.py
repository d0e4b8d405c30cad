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
    from simulator.curve import Curve, FoldCurve
    from simulator.explanation import explain
    from simulator.files import OutputError
    from simulator.history import (
        EnergyBalance,
        Event,
        EventKind,
        History,
        Outcome,
        SolverStatistics,
        Stop,
        Verdict,
    )
    from simulator.path import PathError
    from simulator.scenario import Scenario, ScenarioError, load_scenario
    from simulator.simulation import SolverError, simulate

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
    "Curve": "curve",
    "EnergyBalance": "history",
    "Event": "history",
    "EventKind": "history",
    "FoldCurve": "curve",
    "History": "history",
    "Outcome": "history",
    "OutputError": "files",
    "PathError": "path",
    "Scenario": "scenario",
    "ScenarioError": "scenario",
    "SolverError": "simulation",
    "SolverStatistics": "history",
    "Stop": "history",
    "Verdict": "history",
    "explain": "explanation",
    "load_scenario": "scenario",
    "simulate": "simulation",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
