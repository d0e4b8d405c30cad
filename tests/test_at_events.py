"""Turns, jumps and seals at an event, a hair before it and a hair beyond, against the closed form."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from simulator.model.elastomers import Gent
from simulator.results.history import History
from simulator.scenario import load_scenario
from tests.oracle.closed_form import (
    Balloon,
    Jump,
    SealedPair,
    State,
    equilibrium_curve,
    inflation_extrema,
    reference_history,
    states_on,
)
from tests.pairs import kinds, pair, run

GENT = Balloon(Gent(100.0))
SNAPPING = equilibrium_curve(SealedPair.inflated(GENT, GENT, 0.015, 1.2))  # the paper's 3c B
SLACKENING = equilibrium_curve(SealedPair.inflated(GENT, GENT, 1.0, 0.6))  # 3a A
UP, DOWN = sorted((point.voltage for point in SNAPPING.limit_points), reverse=True)
assert SLACKENING.loss_of_tension is not None
SLACK = SLACKENING.loss_of_tension.voltage
PEAK, _ = inflation_extrema(GENT)


def played(curve: Any, *turns: float | Jump) -> History:
    """A history of one of the two pairs through voltages ramped or jumped to."""
    steps = [{"jump": t.voltage} if isinstance(t, Jump) else {"ramp": t, "over": 1} for t in turns]
    sealed = curve.pair.sealed.pressure
    return run(pair(sealed, *steps, ambient=curve.pair.ambient, output={"points": 5}))


def last(history: History) -> list[float]:
    return [*history.stretch[-1].tolist(), float(history.pressure[-1])]


# -- where a step ends --------------------------------------------------------------------------------


@pytest.mark.parametrize("beyond", [4e-14, 1e-12, 1e-9])
def test_a_step_ends_at_its_voltage_however_close_to_its_end_an_event_is(beyond):
    history = played(SNAPPING, UP + beyond, Jump(0.45))
    assert kinds(history) == ["limit_point", "jump"]
    ramp, jump = (np.flatnonzero(history.step == step) for step in (2, 3))
    assert history.voltage[ramp[-1], 0] == UP + beyond
    # No row has the state of before the jump beside the voltage of after it.
    assert history.voltage[jump, 0].tolist() == [0.45]
    assert history.stretch[ramp[-1]].tolist() == history.events[1].stretch_before.tolist()


# -- ramps --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("beyond", [1e-14, 5e-14, 5e-13, 1e-11])
def test_tension_is_lost_however_little_beyond_its_loss_a_ramp_goes(beyond):
    for history in (played(SLACKENING, SLACK + beyond), played(SLACKENING, SLACK - 1e-14, SLACK + beyond)):
        assert kinds(history) == ["loss_of_tension"]
        assert history.voltage[-1, 0] == pytest.approx(SLACK, abs=2e-15)
        assert np.all(history.pressure >= -1e-15)


@pytest.mark.parametrize("before", [1e-15, 1e-14, 1e-13, 1e-12, 1e-10, 1e-8, 1e-6])
def test_a_ramp_taken_up_again_beside_an_event_meets_it(before):
    history = played(SNAPPING, UP - before, UP - 0.1 * before, 0.4)
    assert kinds(history) == ["limit_point"]
    assert history.events[0].voltage[0] == pytest.approx(UP, abs=1e-15)
    assert history.events[0].stretch_before == pytest.approx([2.05451214, 1.04987476], abs=1e-8)
    assert history.energy_balance.relative_imbalance < 1e-10
    history = played(SLACKENING, SLACK - before, SLACK - 0.1 * before, 0.7)
    assert kinds(history) == ["loss_of_tension"]
    assert history.events[0].voltage[0] == pytest.approx(SLACK, abs=1e-15)


@pytest.mark.parametrize("before", [0.0, 1e-16, 1e-14, 1e-12, 1e-9])
def test_a_ramp_turned_round_at_a_limit_point_goes_back_as_it_came(before):
    lower = next(s for s in SNAPPING.segments if s.first == "unloaded" and not s.unstable)
    upper = next(s for s in SNAPPING.segments if s.first == "limit_point" and not s.unstable)
    up, down = played(SNAPPING, UP - before, 0.1), played(SNAPPING, 0.4, DOWN + before, 0.45)
    assert kinds(up) == []
    assert kinds(down) == ["limit_point"]
    assert last(up) == pytest.approx(states_on(SNAPPING.pair, lower, [0.1])[:, 0], abs=1e-12)
    assert last(down) == pytest.approx(states_on(SNAPPING.pair, upper, [0.45])[:, 0], abs=1e-12)


# -- jumps --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("beyond", [2e-14, 1e-12, 1e-11, 1e-10, 1e-8, 1e-6])
def test_a_jump_just_beyond_a_limit_point_creeps_past_it(beyond):
    """The passage takes a time like 1/√beyond, up to 10⁸ of the balloon's own."""
    up = played(SNAPPING, Jump(UP + beyond))
    assert up.stretch[-1] == pytest.approx([6.51514013, 1.00021867], abs=1e-5)
    down = played(SNAPPING, 0.4, Jump(DOWN - beyond))
    assert down.stretch[-1] == pytest.approx([1.45301845, 1.16620131], abs=1e-4)
    assert up.statistics.ida_steps < 1000
    assert up.energy_balance.relative_imbalance < 1e-10


@pytest.mark.parametrize("before", [2e-14, 1e-12, 1e-10, 1e-6])
def test_a_jump_just_short_of_a_limit_point_rests_before_it(before):
    lower = next(s for s in SNAPPING.segments if s.first == "unloaded" and not s.unstable)
    history = played(SNAPPING, Jump(UP - before))
    exact = states_on(SNAPPING.pair, lower, [UP - before])[:, 0]
    assert last(history) == pytest.approx(exact, abs=1e-8)


def uneven(J_lim: float, ambient: float, steps: list[dict[str, Any]], **active: Any) -> dict[str, Any]:
    gent = {"model": "gent", "J_lim": J_lim}
    return {
        "title": "uneven",
        "gas": {"ambient_pressure": ambient},
        "balloon": [
            {"name": "active", "electrodes": True, "elastomer": gent, **active},
            {"name": "passive", "elastomer": gent},
        ],
        "step": steps,
    }


def reference(written: dict[str, Any]) -> Any:
    turns = [Jump(s["jump"]) if "jump" in s else s["ramp"] for s in written["step"] if "inflate" not in s]
    return reference_history(SealedPair.from_scenario(load_scenario(written)), turns)


def test_tension_lost_while_the_slow_balloon_shrinks_is_seen():
    """The jump ends a hair before p = 0: the large balloon is at rest at once, the small one is not."""
    written = uneven(100.0, 3.0, [{"inflate": 0.3375}], radius=4.0)
    curve = equilibrium_curve(SealedPair.from_scenario(load_scenario(written)))
    assert curve.loss_of_tension is not None
    written["step"].append({"jump": curve.loss_of_tension.voltage - 1e-8})
    exact, history = reference(written), run(load_scenario(written))
    assert exact.outcome == history.outcome == "loss_of_tension"
    assert kinds(history)[1:] == ["jump", "loss_of_tension"]
    assert last(history) == pytest.approx(list(exact.state), abs=1e-7)


def test_where_a_short_snap_loses_its_tension():
    """From a limit point at p = 0.014 it is 0.01 to the loss of tension: the start of the flow shows."""
    film = {"radius": 0.7074, "thickness": 0.602, "modulus": 2.677, "permittivity": 0.4414}
    inflation = [{"inflate": 2.2273}, {"inflate": 1.2495}, {"inflate": 0.3423}]
    written = uneven(440.0, 1.3968, [*inflation, {"ramp": 1.1}], **film)
    written["balloon"][1] |= {"thickness": 2.9328, "modulus": 0.3415, "permittivity": 1.2686}
    history, exact = run(load_scenario(written)), reference(written)
    assert kinds(history)[2:] == [event.kind for event in exact.events] == ["limit_point", "loss_of_tension"]
    assert last(history) == pytest.approx(list(exact.state), abs=1e-8)


# -- seals --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("short", [0.0, 1e-15, 1e-12, 1e-9])
def test_a_pair_sealed_at_the_pressure_of_its_snap_parts_gradually(short):
    """H is singular at φ = 0 and λ₁ − λ₂ rises like φ^⅔; a hair below the peak the closed form is regular."""
    history = run(pair(PEAK.pressure - short, {"ramp": 0.3, "over": 1}))
    assert kinds(history) == []
    sealed = SealedPair(GENT, GENT, 1.0, State(PEAK.stretch, PEAK.stretch, PEAK.pressure))
    exact = reference_history(SealedPair.inflated(GENT, GENT, 1.0, PEAK.pressure - 1e-12), [0.3]).state
    assert last(history) == pytest.approx(list(exact), abs=1e-4 if short == 1e-9 else 3e-6)
    assert history.gas[-1] == pytest.approx(sealed.amount, rel=1e-4)
    assert history.energy_balance.relative_imbalance < 1e-8


@pytest.mark.parametrize("short", [0.0, 1e-15, 1e-12, 1e-9, 1e-6])
def test_a_balloon_held_at_the_pressure_of_its_snap_snaps_at_the_first_voltage(short):
    """With the valve open, near the peak: φ² = (peak − p) r/h λ² over 2e/h² λ³."""
    history = run(pair(PEAK.pressure - short, {"ramp": 0.3, "over": 1, "valve": "open"}))
    assert kinds(history) == ["limit_point"]
    expected = np.sqrt(short / (2.0 * PEAK.stretch))
    assert history.events[0].voltage[0] == pytest.approx(expected, rel=1e-3, abs=2e-8)
    assert history.stretch[-1, 0] == pytest.approx(6.74475237, abs=1e-5)


@pytest.mark.parametrize("J_lim", [17.638081, 17.63809, 17.6381, 17.7])
def test_both_snaps_are_met_down_to_a_millionth_from_where_they_merge(J_lim):
    history = run(pair(3.0, {"inflate": 0.0}, J_lim=J_lim))
    peak, valley = inflation_extrema(Balloon(Gent(J_lim)))
    assert kinds(history) == ["limit_point", "limit_point"]
    for event, extremum in zip(history.events, (peak, valley), strict=True):
        assert event.pressure_before == pytest.approx(extremum.pressure, abs=1e-14)
        assert event.stretch_before[0] == pytest.approx(extremum.stretch, abs=1e-11)


@pytest.mark.parametrize("short", [1e-15, 1e-12, 1e-9, 1e-6])
def test_a_film_that_breaks_only_where_it_would_rest_breaks(short):
    """A jump creeps to its rest, and the field passes the strength in the last digits of the way."""
    jump = {"jump": 0.3}
    rest = float(run(pair(1.2, jump, ambient=0.015)).stretch[-1, 0])
    for strength, outcome in ((1.0 - short, "breakdown"), (1.0 + short, "completed")):
        scenario = pair(1.2, jump, ambient=0.015, active={"breakdown": {"field": 0.3 * rest**2 * strength}})
        assert run(scenario).outcome.value == outcome
