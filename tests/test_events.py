"""Kinds of events: one table says which end a history, one what they are called."""

from __future__ import annotations

import pytest

from simulator.events import OUTCOMES, SHAPE_EVENTS, WORDS, EventKind, Outcome
from simulator.simulation.sampling import sample_fractions
from tests.pairs import pair, run

GO_ON = {EventKind.LIMIT_POINT, EventKind.BRANCH_POINT, EventKind.JUMP}


def test_every_kind_ends_a_history_or_goes_on():
    assert set(OUTCOMES) == set(EventKind) - GO_ON - SHAPE_EVENTS
    assert all(outcome.value == kind.value for kind, outcome in OUTCOMES.items())
    assert set(Outcome) == {
        *OUTCOMES.values(),
        Outcome.LOSS_OF_SPHERICITY,
        Outcome.COMPLETED,
        Outcome.FAILED,
    }


def test_every_kind_has_words():
    assert set(WORDS) == set(EventKind)
    assert len(set(WORDS.values())) == len(EventKind)


def test_the_outcome_is_that_of_the_last_event():
    history = run(pair(0.6, {"ramp": 0.75}, {"hold": 1}))
    assert history.events[-1].kind is EventKind.LOSS_OF_TENSION
    assert history.outcome is Outcome.LOSS_OF_TENSION
    assert history.step[-1] == 2  # nothing is played after that


@pytest.mark.parametrize(
    ("output", "lasts", "fractions"),
    [
        ({"points": 3}, 7.0, [0.0, 0.5, 1.0]),
        ({"every": 0.5}, 2.0, [0.0, 0.25, 0.5, 0.75, 1.0]),
        ({"every": 0.75}, 2.0, [0.0, 0.375, 0.75, 1.0]),
        ({"every": 5.0}, 2.0, [0.0, 1.0]),
        ({"every": 0.1}, 0.3, [0.0, 1 / 3, 2 / 3, 1.0]),
    ],
)
def test_samples_are_where_a_scenario_asks_for_them(output, lasts, fractions):
    scenario = pair(0.6, {"hold": lasts}, output=output)
    assert sample_fractions(scenario.output, scenario.steps[0], (), lasts) == pytest.approx(
        fractions, abs=1e-12
    )
