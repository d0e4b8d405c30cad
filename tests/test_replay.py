"""What a `Replay` keeps changes nothing but the time that a run takes."""

from __future__ import annotations

import dataclasses

import pytest

from simulator import History, Replay, load_scenario, simulate
from tests.pairs import pair

INFLATE, UP, DOWN = {"inflate": 1.2}, {"ramp": 0.4, "over": 1}, {"ramp": 0.0, "over": 1}
CYCLES = {"cycle": 2, "steps": [UP, DOWN]}


def written(*steps, **more):
    return {**pair(1.2, ambient=0.015, output={"points": 11}).to_dict(), "step": list(steps), **more}


def cost(history: History):
    return dataclasses.replace(history.statistics, seconds=0.0)


def played_after(replay, first, then, known):
    """A scenario played after another one: the same, cost included, as by itself."""
    simulate(first, replay=replay)
    scenario = load_scenario(then)
    assert replay.known(scenario) == known
    again, alone = simulate(scenario, replay=replay), simulate(scenario)
    assert again == alone
    assert cost(again) == cost(alone)
    assert again.scenario == alone.scenario
    return again


@pytest.mark.parametrize(
    ("then", "known"),
    [
        ([INFLATE, UP, {"ramp": 0.1, "over": 1}], 2),
        ([INFLATE, UP, DOWN, CYCLES], 3),  # what was found on the way is still known
        ([INFLATE, UP], 2),
        ([INFLATE, UP, DOWN], 3),
        ([INFLATE, {"ramp": 0.2, "over": 1}], 1),
        ([{"inflate": 1.1}, UP, DOWN], 0),
    ],
)
def test_steps_that_are_known_are_not_played_again(then, known):
    again = played_after(Replay(), written(INFLATE, UP, DOWN), written(*then), known)
    assert again.time[-1] == len(load_scenario(written(*then)).steps) + 3.0 * (CYCLES in then)


@pytest.mark.parametrize(
    "more",
    [
        {"dynamics": {"relaxation_time": 0.1}},
        {"shape": {"on_loss": "record"}},
        {
            "balloon": [
                {"name": n, "electrodes": True, "elastomer": {"model": "gent", "J_lim": 100}} for n in "ab"
            ]
        },
    ],
)
def test_runs_of_every_kind_go_on(more):
    first, then = (written(INFLATE, UP, last, **more) for last in (DOWN, {"ramp": 0.3, "over": 2}))
    played_after(Replay(), first, then, 2)


def test_a_run_that_has_ended_stays_ended():
    far = {"ramp": 0.6, "over": 1}
    first, then = (
        written(INFLATE, far, last, gas={"ambient_pressure": 0.2}) for last in (DOWN, {"hold": 1.0})
    )
    assert played_after(Replay(), first, then, 2).outcome.value == "loss_of_tension"


def test_another_device_or_other_samples_begin_anew():
    first = written(INFLATE, UP, DOWN)
    replay = Replay()
    played_after(replay, first, {**first, "gas": {"ambient_pressure": 0.02}}, 0)
    played_after(replay, first, {**first, "output": {"points": 12}}, 0)
    played_after(replay, first, first, 3)


def test_no_more_steps_are_kept_than_asked_for():
    replay, short = Replay(most=2), [INFLATE, UP, DOWN, CYCLES]
    played_after(replay, written(*short), written(*short), 2)
    with pytest.raises(ValueError, match="at least 1"):
        Replay(most=0)
