"""A slice of the fuzz, always the same; what once disagreed; and that the fuzz sees what is wrong."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

from simulator import History, load_scenario
from tests import fuzz
from tests.fuzz import comparison
from tests.oracle.closed_form import SealedPair, equilibrium_curve
from tests.pairs import run

OUTCOMES: Counter[str] = Counter()


@settings(
    max_examples=300,
    derandomize=True,
    deadline=None,
    database=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
@given(fuzz.scenarios())
def test_simulator_agrees_with_the_closed_form(written: dict[str, Any]) -> None:
    verdict = fuzz.examine(written)
    assert not verdict.problems
    OUTCOMES[verdict.outcome] += 1


KEPT = sorted((Path(fuzz.__file__).parent / "kept").glob("*.json"))


@pytest.mark.parametrize("kept", KEPT, ids=lambda path: path.stem)
def test_what_once_disagreed_agrees(kept: Path) -> None:
    assert not fuzz.examine(json.loads(kept.read_text())["scenario"]).problems


def test_the_slice_is_not_a_trivial_one() -> None:
    if not OUTCOMES:
        pytest.skip("needs the slice")
    assert OUTCOMES["completed"] > 50
    assert OUTCOMES["loss_of_tension"] > 20


LOOP = {
    "title": "3c B",
    "gas": {"ambient_pressure": 0.015},
    "balloon": [
        {"name": "active", "electrodes": True, "elastomer": {"model": "gent", "J_lim": 100.0}},
        {"name": "passive", "elastomer": {"model": "gent", "J_lim": 100.0}},
    ],
    "step": [{"inflate": 1.2}, {"ramp": 0.4}, {"ramp": 0.0}],
}


def shifted(history: History, change: str) -> History:
    """A history with one thing wrong in it."""
    stretch, voltage = history.stretch.copy(), history.voltage.copy()
    events = list(history.events)
    match change:
        case "sample":
            stretch[150, 0] += 3e-8
        case "branch":  # a sample that is an equilibrium, but on another branch
            stretch[150], voltage[150] = stretch[250], voltage[250]
        case "event":
            events[0] = replace(events[0], voltage=events[0].voltage + 2e-9)
        case "landing":
            assert events[1].stretch_after is not None
            events[1] = replace(events[1], stretch_after=events[1].stretch_after + 2e-8)
        case "missing":
            del events[1]
        case "energy":
            wrong = replace(history.energy_balance, imbalance=1e-5)
            return replace(history, energy_balance=wrong)
    return replace(history, stretch=stretch, voltage=voltage, events=tuple(events))


@pytest.mark.parametrize("change", ["sample", "branch", "event", "landing", "missing", "energy"])
def test_what_is_wrong_is_seen(change: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert not fuzz.examine(LOOP).problems
    wrong = shifted(run(load_scenario(LOOP)), change)
    monkeypatch.setattr(comparison, "run", lambda _: wrong)
    assert fuzz.examine(LOOP).problems


def test_a_turn_at_a_limit_point_is_in_doubt_and_nowhere_else() -> None:
    fold = equilibrium_curve(SealedPair.from_scenario(load_scenario(LOOP))).limit_points[0].voltage
    for offset, doubtful in ((0.0, True), (1e-12, True), (-1e-12, True), (3e-11, False), (-3e-11, False)):
        verdict = fuzz.examine({**LOOP, "step": [{"inflate": 1.2}, {"ramp": fold + offset}, {"ramp": 0.0}]})
        assert not verdict.problems
        assert verdict.undecided == doubtful


def test_scenarios_are_the_same_for_the_same_seed() -> None:
    assert fuzz.scenario(fuzz.numpy_dice(5)) == fuzz.scenario(fuzz.numpy_dice(5))
    radii = [fuzz.scenario(fuzz.numpy_dice(seed))["balloon"][0].get("radius", 1.0) for seed in range(200)]
    assert np.min(radii) < 0.2
    assert np.max(radii) > 3.0
