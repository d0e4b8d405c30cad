"""Voltage histories of interconnected dielectric-elastomer balloons.

>>> from simulator import simulate
>>> history = simulate("scenarios/fig5b_state_b.toml")
>>> history.outcome.value, [event.kind.value for event in history.events]
('completed', ['limit_point', 'limit_point', 'jump'])

Names are loaded when first used, so that ``import simulator`` costs next to nothing. All of them are in
`docs/python.md`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from simulator.analysis.fold import fold
    from simulator.analysis.sensitivity import all_sensitivities, sensitivities
    from simulator.analysis.trace import trace, trace_all, trace_inflation
    from simulator.events import EventKind, Outcome
    from simulator.hysteresis.loops import loops
    from simulator.hysteresis.memory import MemoryLost, return_point_memory
    from simulator.hysteresis.states import states
    from simulator.hysteresis.unloading import unload, unload_map
    from simulator.identification.estimation import fit
    from simulator.identification.problem import FitProblem
    from simulator.identification.reading import read_fit
    from simulator.live.notebook import Explorer, explore
    from simulator.results.curve import Curve, FoldCurve, SpecialPoint
    from simulator.results.extras import MissingExtra
    from simulator.results.files import OutputError
    from simulator.results.fit import Estimate, Fit
    from simulator.results.fit_ranking import Ranked, rank_fits
    from simulator.results.history import EnergyBalance, Event, History, SolverStatistics, Stop, Verdict
    from simulator.results.loading import load_curve, load_curves, load_history, load_unloading
    from simulator.results.loops import Loop, Threshold
    from simulator.results.plot.history import plot_histories
    from simulator.results.sensitivity import Sensitivity
    from simulator.results.states import State, StateGraph, Transition
    from simulator.results.unloading import UnloadedPath, Unloading, UnloadingMap
    from simulator.scenario import Scenario, ScenarioError, load_scenario
    from simulator.simulation.explanation import explain
    from simulator.simulation.replay import Replay
    from simulator.simulation.run import SolverError, simulate
    from simulator.solver.follow import PathError
    from simulator.sweep import (
        DisagreementError,
        ExecutorError,
        ManyRuns,
        Optimum,
        Question,
        Sweep,
        SweepResult,
        Uncertainty,
        load_sweep,
        load_table,
        optimize,
        read_question,
        read_sweep,
        run_sweep,
        simulate_many,
        uncertainty,
    )

__version__ = "1.0.0"

__all__ = [
    "Curve",
    "DisagreementError",
    "EnergyBalance",
    "Estimate",
    "Event",
    "EventKind",
    "ExecutorError",
    "Explorer",
    "Fit",
    "FitProblem",
    "FoldCurve",
    "History",
    "Loop",
    "ManyRuns",
    "MemoryLost",
    "MissingExtra",
    "Optimum",
    "Outcome",
    "OutputError",
    "PathError",
    "Question",
    "Ranked",
    "Replay",
    "Scenario",
    "ScenarioError",
    "Sensitivity",
    "SolverError",
    "SolverStatistics",
    "SpecialPoint",
    "State",
    "StateGraph",
    "Stop",
    "Sweep",
    "SweepResult",
    "Threshold",
    "Transition",
    "Uncertainty",
    "UnloadedPath",
    "Unloading",
    "UnloadingMap",
    "Verdict",
    "all_sensitivities",
    "explain",
    "explore",
    "fit",
    "fold",
    "load_curve",
    "load_curves",
    "load_history",
    "load_scenario",
    "load_sweep",
    "load_table",
    "load_unloading",
    "loops",
    "optimize",
    "plot_histories",
    "rank_fits",
    "read_fit",
    "read_question",
    "read_sweep",
    "return_point_memory",
    "run_sweep",
    "sensitivities",
    "simulate",
    "simulate_many",
    "states",
    "trace",
    "trace_all",
    "trace_inflation",
    "uncertainty",
    "unload",
    "unload_map",
]

_NAMES = {
    "analysis.fold": ("fold",),
    "analysis.sensitivity": ("all_sensitivities", "sensitivities"),
    "analysis.trace": ("trace", "trace_all", "trace_inflation"),
    "events": ("EventKind", "Outcome"),
    "hysteresis.loops": ("loops",),
    "hysteresis.memory": ("MemoryLost", "return_point_memory"),
    "hysteresis.states": ("states",),
    "hysteresis.unloading": ("unload", "unload_map"),
    "identification.estimation": ("fit",),
    "identification.problem": ("FitProblem",),
    "identification.reading": ("read_fit",),
    "live.notebook": ("Explorer", "explore"),
    "results.curve": ("Curve", "FoldCurve", "SpecialPoint"),
    "results.loops": ("Loop", "Threshold"),
    "results.extras": ("MissingExtra",),
    "results.files": ("OutputError",),
    "results.fit": ("Estimate", "Fit"),
    "results.fit_ranking": ("Ranked", "rank_fits"),
    "results.history": ("EnergyBalance", "Event", "History", "SolverStatistics", "Stop", "Verdict"),
    "results.loading": ("load_curve", "load_curves", "load_history", "load_unloading"),
    "results.plot.history": ("plot_histories",),
    "results.states": ("State", "StateGraph", "Transition"),
    "results.unloading": ("UnloadedPath", "Unloading", "UnloadingMap"),
    "results.sensitivity": ("Sensitivity",),
    "scenario": ("Scenario", "ScenarioError", "load_scenario"),
    "simulation.explanation": ("explain",),
    "simulation.replay": ("Replay",),
    "simulation.run": ("SolverError", "simulate"),
    "solver.follow": ("PathError",),
    "sweep": (
        "DisagreementError",
        "ExecutorError",
        "ManyRuns",
        "Optimum",
        "Question",
        "Sweep",
        "SweepResult",
        "Uncertainty",
        "load_sweep",
        "load_table",
        "optimize",
        "read_question",
        "read_sweep",
        "run_sweep",
        "simulate_many",
        "uncertainty",
    ),
}
_HOME = {name: module for module, names in _NAMES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
