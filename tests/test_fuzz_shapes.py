"""Losses of sphericity of random scenarios against an evaluation of their own; see `tests.fuzz.shapes`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from simulator import load_scenario, simulate
from simulator.events import SHAPE_EVENTS
from tests.fuzz import shapes


@pytest.mark.parametrize("whole", [False, True], ids=["pairs", "whole grammar"])
def test_losses_are_those_of_the_samples(whole: bool, tmp_path: Path) -> None:
    found = list(shapes.play(range(40), tmp_path, 1, whole=whole))
    assert not [problems for *_, problems, _ in found if problems]
    assert sum(count for *_, count in found) > 20


def test_what_is_wrong_is_seen() -> None:
    document = load_scenario("scenarios/fig3c_state_b.toml").to_dict() | {"output": {"points": shapes.POINTS}}
    history = simulate(load_scenario(document))
    assert shapes.problems_of(history) == []
    of_shape = [event for event in history.events if event.kind in SHAPE_EVENTS]
    for left_out in of_shape:
        events = tuple(event for event in history.events if event is not left_out)
        assert shapes.problems_of(replace(history, events=events))
    moved = replace(of_shape[0], stretch_before=of_shape[0].stretch_before * (1.0 + 1e-8))
    moved = replace(moved, stretch_after=moved.stretch_before)
    assert shapes.problems_of(replace(history, events=(moved, *history.events[1:])))
