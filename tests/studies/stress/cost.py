"""What the checks cost: their share of the time of the shipped scenarios."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any

from simulator.simulation.run import simulate
from simulator.solver import branch, certify, flow

if TYPE_CHECKING:
    from simulator.scenario import Scenario

# Checks, and where they live. A landing's includes Newton's method, which finds it.
_CHECKS: dict[str, tuple[Any, str]] = {
    "points in line (`sharp`)": (certify, "sharp"),
    "margins (`judged`)": (certify, "judged"),
    "samples (`check_between`)": (branch.Branch, "check_between"),
    "landings (`landing_from`)": (flow, "landing_from"),
}


def shares(scenarios: Sequence[Scenario], repetitions: int = 5) -> dict[str, float]:
    """Share of the run time spent in each check, medians over repetitions of all scenarios."""
    found: dict[str, list[float]] = {name: [] for name in _CHECKS}
    for scenario in scenarios:  # what is loaded and compiled once does not count
        simulate(scenario)
    for _ in range(repetitions):
        spent = dict.fromkeys(_CHECKS, 0.0)
        with ExitStack() as stack:
            for name, (owner, function) in _CHECKS.items():
                stack.enter_context(_timed(owner, function, spent, name))
            start = time.perf_counter()
            for scenario in scenarios:
                simulate(scenario)
            total = time.perf_counter() - start
        for name, seconds in spent.items():
            found[name].append(seconds / total)
    return {name: statistics.median(values) for name, values in found.items()}


@contextmanager
def _timed(owner: Any, name: str, spent: dict[str, float], key: str) -> Iterator[None]:
    """A function's time added up."""
    function: Callable[..., Any] = getattr(owner, name)

    def timed(*arguments: Any, **options: Any) -> Any:
        start = time.perf_counter()
        try:
            return function(*arguments, **options)
        finally:
            spent[key] += time.perf_counter() - start

    setattr(owner, name, timed)
    try:
        yield
    finally:
        setattr(owner, name, function)
