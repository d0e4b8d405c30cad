"""A scenario of the paper with all that is computed from it, and what a statement is."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from simulator.analysis.trace import trace, trace_all
from simulator.scenario import load_scenario
from simulator.simulation.run import simulate
from tests.pairs import run

if TYPE_CHECKING:
    from simulator.results.curve import Curve, SpecialPoint
    from simulator.results.history import Event, FloatArray, History
    from simulator.scenario import Scenario

VERDICTS = ("agrees", "agrees under the reading", "does not agree")
PANELS = ("3a", "3b", "3c", "5b", "5c")


@dataclass(frozen=True)
class Real:
    """What becomes of a statement with real balloons, which need not stay spheres: `holds` is None if that is open."""

    words: str
    holds: bool | None


@dataclass(frozen=True)
class Statement:
    """A statement of the paper and what comes out here.

    Attributes
    ----------
    place, says, here : str
        Where in the paper, its words, and the numbers found.
    holds : bool
        Whether it holds as it stands.
    reading : str
        Under which other reading it might hold.
    holds_as_read : bool
        Whether it does.
    real : Real or None
        The same of real balloons; None where it says nothing that depends on shapes.
    """

    place: str
    says: str
    here: str
    holds: bool
    reading: str = ""
    holds_as_read: bool = False
    real: Real | None = None

    @property
    def verdict(self) -> str:
        """One of `VERDICTS`."""
        if self.holds:
            return VERDICTS[0]
        return VERDICTS[1] if self.holds_as_read else VERDICTS[2]


@dataclass(frozen=True)
class Misprint:
    """What is printed, what must be meant, and the computed evidence; `is_proved` says whether it is any."""

    place: str
    printed: str
    meant: str
    evidence: str
    is_proved: bool


@dataclass(frozen=True)
class Case:
    """A scenario with its equilibrium paths (the first from the sealed state) and its history."""

    scenario: Scenario
    curves: tuple[Curve, ...]
    history: History

    @cached_property
    def shaped(self) -> History:
        """The history with the balloons' shapes looked at."""
        return simulate(self.scenario)

    @property
    def curve(self) -> Curve:
        """The path from the sealed state."""
        return self.curves[0]

    @property
    def peak(self) -> SpecialPoint | None:
        """The limit point at which the voltage first turns, the paper's EMI."""
        return next((point for point in self.curve.points if point.kind == "limit_point"), None)

    @property
    def rising(self) -> int:
        """Number of points of the path up to its first limit point, or its end."""
        turned = np.flatnonzero(self.curve.unstable > 0)
        return int(turned[0]) if turned.size else len(self.curve)

    @property
    def actuated(self) -> tuple[Event, ...]:
        """Events after the inflation, the first step."""
        return tuple(event for event in self.history.events if event.step > 1)

    @property
    def snaps(self) -> tuple[Event, ...]:
        """Snaps of the history that come to rest, after the inflation."""
        return tuple(event for event in self.history.snaps if event.step > 1)

    @property
    def loses_tension(self) -> bool:
        """Whether the history ends slack."""
        return self.history.outcome == "loss_of_tension"

    def stretch_at(self, voltages: FloatArray) -> FloatArray:
        """Active stretches where the path first comes to voltages."""
        return np.array([trace(self.scenario, to_voltage=v).end.stretch[0] for v in voltages.tolist()])


def load_cases(scenarios: Path) -> dict[str, Case]:
    """The cases of Figs. 3 and 5, "3a A" to "5c C". Raises ScenarioError if a file is missing."""
    return {
        f"{panel} {letter}": case_of(load_scenario(scenarios / f"fig{panel}_state_{letter.lower()}.toml"))
        for panel in PANELS
        for letter in "ABC"
    }


def case_of(scenario: Scenario) -> Case:
    """A scenario, traced and played."""
    return Case(scenario, trace_all(scenario), run(scenario))


def rises(values: FloatArray) -> bool:
    """Whether values rise from one to the next."""
    return bool((np.diff(values) > 0.0).all())


def falls(values: FloatArray) -> bool:
    """Whether values fall from one to the next."""
    return bool((np.diff(values) < 0.0).all())
