"""Scenarios that failed once, each with the right value from a second method.

The files are in `tests/cases`; each is the smallest one of its kind.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from simulator import EventKind, History, Outcome, load_scenario, simulate

CASES = Path(__file__).parent / "cases"


def played(name: str) -> History:
    return simulate(load_scenario(CASES / f"{name}.toml"))


def kinds(history: History) -> list[EventKind]:
    return [event.kind for event in history.events]


# -- jumps ---------------------------------------------------------------------------------------------------


def test_balloons_that_jump_with_the_valve_open_stop_when_the_first_breaks():
    history = played("jump-open-valve-breakdown")
    assert kinds(history) == [EventKind.JUMP, EventKind.BREAKDOWN]
    assert history.outcome is Outcome.BREAKDOWN
    assert history.stretch[-1, 0] == pytest.approx(1.09602, abs=1e-5)
    assert abs(history.field[-1, 1]) == pytest.approx(2.0, rel=1e-9)
    assert history.energy_balance.relative_imbalance < 1e-12


def test_a_film_that_is_broken_at_once_moves_no_balloon():
    steps = [{"inflate": 1.25}, {"jump": {"b0": 0.5, "b1": 1.9}, "valve": "open"}]
    scenario = load_scenario(CASES / "jump-open-valve-breakdown.toml").to_dict()
    history = simulate(load_scenario(scenario | {"step": steps}))
    assert kinds(history) == [EventKind.JUMP, EventKind.BREAKDOWN]
    assert np.array_equal(history.events[0].stretch_before, history.stretch[-1])


def test_valve_and_voltage_change_together():
    history = played("jump-opens-valve")
    assert history.outcome is Outcome.COMPLETED
    assert kinds(history) == [EventKind.JUMP]
    assert history.stretch[-1, 0] == pytest.approx(1.08393, abs=1e-5)


def test_the_pressure_of_a_liquid_follows_a_voltage_that_breaks_the_film():
    history = played("jump-liquid-breaks")
    (jump, breakdown) = history.events
    right = 0.6 - 2.0 * 0.5**2 * jump.stretch_before[0]
    assert jump.pressure_before == pytest.approx(0.6, rel=1e-12)
    assert jump.pressure_after == pytest.approx(right, rel=1e-12)
    assert breakdown.kind is EventKind.BREAKDOWN
    assert breakdown.pressure_before == pytest.approx(right, rel=1e-12)


def test_what_charges_held_leaves_to_the_side_where_the_potential_falls_more():
    history = played("charge-to-voltage-way")
    assert history.outcome is Outcome.COMPLETED
    (jump,) = history.events
    assert jump.stretch_after[0] == pytest.approx(1.07471, abs=1e-5)
    assert jump.dissipated == pytest.approx(1.4037, abs=1e-4)


def test_voltages_switched_off_are_off():
    history = played("jump-spurious")
    assert [event.step for event in history.events] == [2, 3]
    assert np.all(history.voltage[history.step == 3] == 0.0)
