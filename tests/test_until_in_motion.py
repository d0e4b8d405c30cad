"""`until` with [dynamics]: steps that end in motion, against a reference that knows no `until`."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from simulator import EventKind, History, load_scenario, simulate
from tests.oracle.general.real_time import play_real_time
from tests.pairs import pair

UP: dict[str, Any] = {"ramp": 0.4, "over": 10.0}


def written(*steps: dict[str, Any], **more: Any) -> dict[str, Any]:
    document: dict[str, Any] = pair(1.2, *steps, ambient=0.015).to_dict()
    return {**document, "dynamics": {"relaxation_time": 1e-3}, **more}


def played(*steps: dict[str, Any], **more: Any) -> History:
    return simulate(load_scenario(written(*steps, **more)))


QUANTITIES = {"stretch": "stretch_active", "field": "field_active", "pressure": "pressure"}


@pytest.mark.parametrize("supply", [{}, {"supply": {"resistance": 0.1}}])
@pytest.mark.parametrize(("kind", "value"), [("stretch", 1.5), ("field", 0.8), ("pressure", 0.9)])
def test_a_step_ends_where_a_quantity_passes_its_value(kind: str, value: float, supply: Any) -> None:
    """The reference, which plays the whole step, has that value at that time."""
    history = played({**UP, "until": {kind: value}}, {"hold": 0.5}, **supply)
    (stop,) = history.stops
    assert stop.reached == f"{QUANTITIES[kind]} = {value:g}"
    assert history.at(stop.time)[QUANTITIES[kind]] == pytest.approx(value, rel=1e-9)
    when = np.array([stop.time]), np.array([2])
    whole = play_real_time(written(UP, **supply), when, integrators=1)
    assert whole.samples is not None
    end = np.flatnonzero(history.step == 2)[-1]
    assert history.time[end] == stop.time
    assert history.stretch[end] == pytest.approx(whole.samples[0], abs=2e-7)
    assert history.time[-1] == pytest.approx(stop.time + 0.5)
    assert history.energy_balance.relative_imbalance < 1e-8


def test_the_next_step_goes_on_from_the_voltage_that_was_reached() -> None:
    history = played({**UP, "until": {"stretch": 1.5}}, {"ramp": 0.0, "over": 10.0})
    at = history.stops[0].time
    reached = history.at(at)["voltage_active"]
    assert reached == pytest.approx(0.4 * (at - 1.0) / 10.0, rel=1e-12)
    assert history.at(at + 5.0)["voltage_active"] == pytest.approx(0.5 * reached, rel=1e-3)


def test_a_value_that_holds_at_the_start_is_left_first_and_counts_when_it_is_taken_again() -> None:
    until = {"until": {"stretch": 1.5}}
    wave = {"sine": {"mean": 0.29, "amplitude": 0.03, "period": 4.0, "cycles": 1}}
    history = played({**UP, **until}, {"hold": 0.0005}, {**UP, **until}, {**wave, "valve": "closed", **until})
    first, second, third = history.stops
    assert (first.reached, second.reached) == ("stretch_active = 1.5", None)
    assert third.reached is None or third.time > second.time + 1e-3
    down = played({**UP, **until}, {"ramp": 0.0, "over": 10.0, **until})
    # The stretch lags behind: it rises a little more, and is there again right after.
    assert down.stops[1].reached == "stretch_active = 1.5"
    assert 1e-4 < down.stops[1].time - down.stops[0].time < 0.1


def test_a_step_ends_where_the_state_stops_being_stable() -> None:
    history = played({**UP, "until": {"event": "limit_point"}}, {"ramp": 0.0, "over": 1.0})
    (event,) = [event for event in history.events if event.kind is EventKind.LIMIT_POINT]
    assert history.stops[0].reached == "limit_point"
    assert type(history.stops[0].reached) is str
    assert history.stops[0].time == event.time
    # Switched off in time the balloon has not gone anywhere.
    assert history.stretch.max() < 2.3


def test_a_step_ends_where_a_sphere_is_lost() -> None:
    history = played({**UP, "until": {"event": "loss_of_sphericity"}}, {"hold": 1.0})
    assert history.stops[0].reached == "loss_of_sphericity"
    assert history.at(history.stops[0].time)["sphericity_active"] == pytest.approx(0.0, abs=1e-7)


def test_what_is_not_reached_changes_nothing() -> None:
    plain, asked = played(UP), played({**UP, "until": {"stretch": 20.0}})
    assert asked.stops[0].reached is None
    assert asked.stretch[-1] == pytest.approx(plain.stretch[-1], rel=1e-9)
