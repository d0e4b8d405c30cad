"""Every row of the paper's voltage table, run from the shipped scenarios at the default settings."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest

from simulator.results.history import EventKind, History, Outcome
from simulator.scenario import load_scenario
from simulator.simulation.run import simulate
from tests.closed_form import Pair, inflated
from tests.pairs import run

# Voltages to 1e-10, states to 1e-9.
VOLTAGE, STATE = 1e-10, 1e-9


def played(name: str) -> History:
    return run(load_scenario(f"scenarios/{name}.toml"))


def voltage_events(history: History):
    return [event for event in history.events if event.step > 1]


def assert_state(found, pressure, exact):
    assert found == pytest.approx([float(x) for x in exact[:2]], abs=STATE)
    assert pressure == pytest.approx(float(exact[2]), abs=STATE)


def assert_limit_point(event, pair: Pair, guess) -> mp.mpf:
    voltage, *state = pair.limit_point(*guess)
    assert event.kind is EventKind.LIMIT_POINT
    assert event.voltage[0] == pytest.approx(float(voltage), abs=VOLTAGE)
    assert_state(event.stretch_before, event.pressure_before, state)
    return voltage


# Scenario, pair, where tension is lost on the path.
SLACK = {"fig3a_state_a": Pair("1", "1", "0.6"), "fig3a_state_b": Pair("1", "1", "1.2")}


@pytest.mark.parametrize("name", SLACK)
def test_tension_lost_on_the_path(name):
    history = played(name)
    voltage, active = SLACK[name].slack()
    (event,) = voltage_events(history)
    assert history.outcome is Outcome.LOSS_OF_TENSION
    assert event.kind is EventKind.LOSS_OF_TENSION
    assert event.voltage[0] == pytest.approx(float(voltage), abs=VOLTAGE)
    assert_state(event.stretch_before, event.pressure_before, (active, 1, 0))


SNAPS_SLACK = {
    "fig3b_state_a": (Pair("1", "0.2", "0.6"), (1.4115, 1.03)),
    "fig3b_state_b": (Pair("1", "0.2", "1.2"), (2.1204, 1.03)),
    "fig3c_state_a": (Pair("1", "0.015", "0.6"), (1.3852, 1.037)),
    "fig5b_state_a": (Pair("0.5", "1", "1.2"), (1.3206, 1.239)),
}


@pytest.mark.parametrize("name", SNAPS_SLACK)
def test_snap_that_loses_tension(name):
    pair, guess = SNAPS_SLACK[name]
    history = played(name)
    snap, loss = voltage_events(history)
    assert_limit_point(snap, pair, guess)
    assert history.outcome is Outcome.LOSS_OF_TENSION
    assert (loss.kind, loss.time) == (EventKind.LOSS_OF_TENSION, snap.time)
    assert snap.pressure_after == pytest.approx(0.0, abs=1e-9)
    # The gas law holds to the end, so at p = 0 the volume is that of the path's own slack state.
    assert snap.stretch_after[1] > 1.0


# Scenario, pair, limit point up and its landing, limit point down and its landing (None: stays snapped).
SNAPS = {
    "fig3c_state_b": (
        Pair("1", "0.015", "1.2"),
        (2.0545, 1.05),
        (6.515, 1.0002),
        (4.9436, 1.002),
        (1.453, 1.166),
    ),
    "fig5b_state_b": (Pair("0.5", "1", "2.4"), (1.3886, 6.7311), (6.2827, 6.6755), None, None),
    "fig5c_state_a": (
        Pair("0.5", "0.05", "1.2"),
        (1.3191, 1.242),
        (6.8708, 1.0013),
        (4.7361, 1.0122),
        (1.0917, 1.2609),
    ),
    "fig5c_state_b": (Pair("0.5", "0.05", "2.4"), (1.3885, 6.7311), (6.305, 6.6889), None, None),
}


@pytest.mark.parametrize("name", SNAPS)
def test_snap_to_a_stable_state(name):
    pair, *guesses = SNAPS[name]
    history = played(name)
    assert history.outcome is Outcome.COMPLETED
    events = voltage_events(history)
    for event, fold, landing in zip(events, guesses[::2], guesses[1::2], strict=False):
        if fold is None:
            break
        voltage = assert_limit_point(event, pair, fold)
        assert_state(event.stretch_after, event.pressure_after, pair.state(voltage, *landing))
    end = history.stretch[-1]
    if guesses[2] is None:
        residual = pair.state(mp.mpf(0), 6.03 if name == "fig5b_state_b" else 6.06, 6.69)
        assert [event.kind.value for event in events] == ["limit_point", "jump"]
        assert_state(end, history.pressure[-1], residual)
    else:
        assert len(events) == 2
        m = mp.mpf(pair.radius) * mp.mpf(pair.inflation)
        assert end == pytest.approx([float(inflated(m)), float(inflated(mp.mpf(pair.inflation)))], abs=STATE)


@pytest.mark.parametrize(("name", "stretch"), [("fig3a_state_c", 6.52865730), ("fig5b_state_c", 6.56202309)])
def test_state_c_changes_little(name, stretch):
    history = played(name)
    assert history.outcome is Outcome.COMPLETED
    assert voltage_events(history) == []
    top = np.argmax(history.voltage[:, 0])
    assert history.voltage[top, 0] == 0.2
    assert history.stretch[top, 0] == pytest.approx(stretch, abs=5e-9)
    assert history.stretch[-1] == pytest.approx(history.stretch[history.step == 1][-1], abs=STATE)


@pytest.mark.parametrize(
    "name", [*SLACK, *SNAPS_SLACK, *SNAPS, "fig3a_state_c", "fig5b_state_c", "fig5c_state_c"]
)
def test_books_balance_and_samples_are_on_the_curve(name):
    history = played(name)
    assert history.energy_balance.relative_imbalance < 1e-8
    scenario = history.scenario
    pair = Pair(
        str(scenario.balloons[0].radius), str(scenario.gas.ambient_pressure), str(scenario.steps[0].inflate)
    )
    closed = np.flatnonzero((history.step > 1) & (history.pressure > 1e-6))
    for i in closed[:: max(1, len(closed) // 12)]:
        active, passive = history.stretch[i]
        square, exact_passive, exact_pressure = pair.at(mp.mpf(active), passive)
        assert passive == pytest.approx(float(exact_passive), abs=1e-10)
        assert history.pressure[i] == pytest.approx(float(exact_pressure), abs=1e-10)
        assert history.voltage[i, 0] ** 2 == pytest.approx(float(square), abs=1e-10)


@pytest.mark.parametrize(
    ("load", "stretch"),
    [(0.6, 1.0663209767), (1.2, 1.2625778856), (1.3, 6.2622961110), (2.4, 6.731255), (2.6, 6.768878)],
)
def test_inflated_states(load, stretch):
    assert float(inflated(mp.mpf(str(load)))) == pytest.approx(stretch, abs=5e-7)
    scenario = load_scenario("scenarios/fig2_inflation.toml")
    scenario = scenario.model_copy(
        update={"steps": (scenario.steps[0].model_copy(update={"inflate": load}),)}
    )
    assert simulate(scenario).stretch[-1] == pytest.approx(
        [float(inflated(mp.mpf(str(load))))] * 2, abs=1e-10
    )
