"""Error against run time, beside the closed form and what one would write instead: `make accuracy`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from simulator.scenario import load_scenario
from tests.studies.accuracy.left_out import anatomies
from tests.studies.accuracy.page import Subject, accuracy_page, machine
from tests.studies.accuracy.problem import load_task
from tests.studies.accuracy.study import DELAYS, REPETITIONS, TOLERANCES, measure, to_csv

__all__ = ["FILES", "SCENARIOS", "accuracy_files"]

SCENARIOS = ("fig3c_state_b", "fig5b_state_b", "fig5c_state_a", "fig3b_state_b")
FILES = ("accuracy.md", "accuracy.csv", "figures/accuracy.svg", "figures/accuracy.png")


def accuracy_files(
    scenarios: Sequence[Path],
    tolerances: Sequence[float] = TOLERANCES,
    delays: Sequence[float] = DELAYS,
    repetitions: int = REPETITIONS,
    progress: Callable[[float], None] | None = None,
) -> dict[str, bytes]:
    """Measure everything; write the page, its figure and its table.

    Parameters
    ----------
    scenarios : sequence of Path
        Scenario files: a sealed pair driven over a limit point. The figure is of the first.
    tolerances : sequence of float
        Relative tolerances of every method, each within what `solver.rtol` allows; the viscous equations
        take every other one.
    delays : sequence of float
        Relaxation times of the viscous equations over the duration of a scenario's first ramp.
    repetitions : int
        Of every run; times are medians.
    progress : callable, optional
        Called with the fraction done.

    Returns
    -------
    dict of str to bytes
        File name to content, the names of `FILES`.

    Raises
    ------
    ScenarioError
        If a scenario is missing or wrong, or has no closed form.
    """
    from tests.studies.accuracy.picture import picture

    tasks = [load_task(load_scenario(file)) for file in scenarios]
    rows = measure(tasks, tolerances, delays, repetitions, progress)
    subjects = [Subject(task.name, task.scenario.title, task.loses_tension) for task in tasks]
    text = accuracy_page(rows, subjects, anatomies(), machine())
    pictures = picture(rows, subjects[0].name, subjects[0].title, "accuracy")
    contents = (text.encode(), to_csv(rows).encode(), pictures["accuracy.svg"], pictures["accuracy.png"])
    return dict(zip(FILES, contents, strict=True))
