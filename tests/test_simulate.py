"""Histories: what a run does, step by step, checked on physics."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simulator.results.history import EventKind, Outcome
from simulator.scenario import load_scenario
from tests.pairs import gent_force, kinds, pair, run, single

RAMP = {"ramp": 0.4, "over": 10}


def states(history):
    return np.column_stack([history.stretch, history.pressure, history.voltage])


# -- samples and rows -----------------------------------------------------------------------------------


def test_samples_are_on_the_grid_and_joins_are_not_repeated():
    history = run(
        pair(0.6, {"ramp": 0.2, "over": 4}, {"hold": 3}, {"ramp": 0.0, "over": 1}, output={"points": 5})
    )
    expected = [0, 0.25, 0.5, 0.75, 1, 2, 3, 4, 5, 5.75, 6.5, 7.25, 8, 8.25, 8.5, 8.75, 9]
    assert history.time.tolist() == expected
    assert history.step.tolist() == [1] * 5 + [2] * 4 + [3] * 4 + [4] * 4
    assert history.voltage[5:9, 0] == pytest.approx([0.05, 0.1, 0.15, 0.2], abs=1e-16)
    assert history.branch.tolist() == [0] * 17


def test_every_samples_from_the_start_of_a_step_and_at_its_end():
    history = run(pair(0.6, {"ramp": 0.2, "over": 1}, output={"every": 0.4}))
    assert history.time.tolist() == pytest.approx([0, 0.4, 0.8, 1.0, 1.4, 1.8, 2.0])


def test_events_have_two_rows_of_equal_time():
    history = run(pair(1.2, RAMP, {"ramp": 0.0, "over": 10}, ambient=0.015))
    assert kinds(history) == ["limit_point", "limit_point"]
    for count, event in enumerate(history.events, start=1):
        rows = np.flatnonzero(history.time == event.time)
        assert len(rows) == 2
        before, after = rows
        assert history.stretch[before].tolist() == event.stretch_before.tolist()
        assert history.stretch[after].tolist() == event.stretch_after.tolist()
        assert history.branch[before] == count - 1
        assert history.branch[after] == count
    assert np.all(np.diff(history.time) >= 0.0)


def test_samples_satisfy_the_equations():
    history = run(pair(1.2, RAMP, {"ramp": 0.0, "over": 10}, ambient=0.015))
    rows = history.step > 1
    for stretch, pressure, (voltage,) in zip(
        history.stretch[rows], history.pressure[rows], history.voltage[rows], strict=True
    ):
        active, passive = stretch
        assert gent_force(active) == pytest.approx(
            pressure * active**2 + 2 * voltage**2 * active**3, abs=1e-11
        )
        assert gent_force(passive) == pytest.approx(pressure * passive**2, abs=1e-11)
    assert (history.pressure + 0.015) * history.volume == pytest.approx(history.gas, rel=1e-14)
    assert np.ptp(history.gas[rows]) == 0.0


def test_a_hold_copies_its_state():
    history = run(pair(0.6, {"ramp": 0.3}, {"hold": 5}, output={"points": 11}))
    held = states(history)[history.step == 3]
    assert np.all(held == states(history)[history.step == 2][-1])


# -- drive ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("factor", [1e-9, 1e9])
def test_rate_independence(factor):
    steps = [{"ramp": 0.4, "over": 3}, {"hold": 2}, {"ramp": 0.0, "over": 5}]
    slow = [
        {key: value * factor if key in ("over", "hold") else value for key, value in s.items()} for s in steps
    ]
    reference, scaled = run(pair(1.2, *steps, ambient=0.015)), run(pair(1.2, *slow, ambient=0.015))
    assert states(scaled) == pytest.approx(states(reference), abs=1e-12)
    assert kinds(scaled) == kinds(reference)
    for one, other in zip(reference.events, scaled.events, strict=True):
        assert other.time - 1 == pytest.approx(factor * (one.time - 1), rel=1e-6)


def test_durations_far_apart_in_one_scenario():
    history = run(
        pair(0.6, {"ramp": 0.3, "over": 1e-12}, {"ramp": 0.1, "over": 1e12}, {"ramp": 0.2, "over": 1e-12})
    )
    assert history.outcome is Outcome.COMPLETED
    assert history.voltage[-1, 0] == 0.2
    direct = run(pair(0.6, {"ramp": 0.2}))
    assert states(history)[-1] == pytest.approx(states(direct)[-1], abs=1e-13)


def test_only_the_square_of_the_voltage_acts():
    up, down = (run(pair(1.2, {"ramp": s * 0.4}, {"ramp": 0.0}, ambient=0.015)) for s in (1, -1))
    assert kinds(up) == kinds(down)
    assert up.stretch == pytest.approx(down.stretch, abs=1e-12)
    assert up.voltage == pytest.approx(-down.voltage, abs=0)
    through = run(pair(0.6, {"ramp": -0.3}, {"ramp": 0.3}))
    assert states(through)[-1][:3] == pytest.approx(states(run(pair(0.6, {"ramp": 0.3})))[-1][:3], abs=1e-13)


def test_waves_follow_one_curve():
    """A sine, a triangle and a table of the same range visit the states of a plain ramp."""
    table = {"sine": {"mean": 0.15, "amplitude": 0.15, "period": 2, "cycles": 1.5}}
    triangle = {"triangle": {"low": 0.0, "high": 0.3, "period": 1, "cycles": 2}}
    history = run(pair(0.6, {"ramp": 0.15}, table, {"ramp": 0.0}, triangle))
    assert history.outcome is Outcome.COMPLETED
    for stretch, pressure, (voltage,) in list(
        zip(history.stretch, history.pressure, history.voltage, strict=True)
    )[101::7]:
        exact = run(pair(0.6, {"ramp": float(voltage)}, output={"points": 2})) if voltage else None
        if exact:
            assert stretch == pytest.approx(exact.stretch[-1], abs=1e-11)
            assert pressure == pytest.approx(exact.pressure[-1], abs=1e-11)


def test_a_wave_that_starts_elsewhere_jumps_there():
    history = run(pair(0.6, {"ramp": 0.1}, {"triangle": {"low": 0.3, "high": 0.4, "period": 1, "cycles": 1}}))
    assert kinds(history) == ["jump"]
    event = history.events[0]
    assert (event.time, event.step) == (2.0, 3)
    assert event.voltage.tolist() == [0.3]
    assert event.stretch_after == pytest.approx(run(pair(0.6, {"ramp": 0.3})).stretch[-1], abs=1e-12)


def test_table(tmp_path):
    path = tmp_path / "wave.csv"
    path.write_text("time,voltage\n0,0\n2,0.4\n3,0.4\n5,0.0\n")
    history = run(pair(1.2, {"table": str(path)}, ambient=0.015))
    by_ramps = run(pair(1.2, {"ramp": 0.4, "over": 2}, {"hold": 1}, {"ramp": 0.0, "over": 2}, ambient=0.015))
    assert [e.time for e in history.events] == pytest.approx([e.time for e in by_ramps.events], rel=1e-12)
    assert states(history)[-1] == pytest.approx(states(by_ramps)[-1], abs=1e-12)


def test_noisy_table_costs_no_more_integration_than_a_ramp(tmp_path):
    rng = np.random.default_rng(1)
    voltage = 0.2 + 0.1 * np.cumsum(rng.standard_normal(3000)) / 60
    voltage = np.clip(np.abs(voltage), 0.0, 0.34)
    voltage[0] = 0.0
    path = tmp_path / "noise.csv"
    path.write_text("time,voltage\n" + "\n".join(f"{i},{v!r}" for i, v in enumerate(voltage.tolist())))
    history = run(pair(1.2, {"table": str(path)}, ambient=0.015, output={"points": 3000}))
    assert history.outcome is Outcome.COMPLETED
    assert history.statistics.ida_solves <= 4
    rows = history.step == 2
    assert history.voltage[rows, 0] == pytest.approx(voltage[1:], abs=1e-12)


# -- jumps ----------------------------------------------------------------------------------------------


def test_switch_off_keeps_the_snapped_state():
    history = run(pair(2.4, {"ramp": 0.2}, {"jump": 0.0}, {"hold": 1}, radius=0.5))
    assert kinds(history) == ["limit_point", "limit_point", "jump"]
    assert history.stretch[-1] == pytest.approx([6.0264317742, 6.6823586634], abs=1e-9)
    assert history.events[-1].dissipated > 0.0


def test_a_jump_across_the_limit_point_snaps():
    ramp, jump = (run(pair(1.2, {kind: 0.4}, ambient=0.015)) for kind in ("ramp", "jump"))
    assert kinds(ramp) == ["limit_point"]
    assert kinds(jump) == ["jump"]
    assert jump.stretch[-1] == pytest.approx(ramp.stretch[-1], abs=1e-11)


def test_a_jump_short_of_the_limit_point_does_not():
    history = run(pair(1.2, {"jump": 0.36}, ambient=0.015))
    assert history.stretch[-1] == pytest.approx(
        run(pair(1.2, {"ramp": 0.36}, ambient=0.015)).stretch[-1], abs=1e-11
    )


def test_a_jump_back_and_forth_shows_hysteresis():
    history = run(pair(1.2, {"jump": 0.4}, {"jump": 0.3}, {"jump": 0.2}, {"jump": 0.3}, ambient=0.015))
    upper, lower = history.events[1], history.events[3]
    assert upper.voltage.tolist() == lower.voltage.tolist() == [0.3]
    assert upper.stretch_after[0] > 5.0
    assert lower.stretch_after[0] < 1.6


def test_a_jump_at_time_zero_has_both_rows():
    history = run(single({"jump": 0.1, "valve": "open"}, {"hold": 1}))
    assert history.time[:2].tolist() == [0.0, 0.0]
    assert history.voltage[:2, 0].tolist() == [0.0, 0.1]


# -- limit points, turned back at and passed by a hair -----------------------------------------------------


def test_a_ramp_up_to_the_limit_point_and_back():
    peak = run(pair(1.2, RAMP, ambient=0.015)).events[0].voltage[0]
    for short in (0.0, 1e-12, 1e-9, 1e-6):
        history = run(pair(1.2, {"ramp": peak - short}, {"hold": 1}, {"ramp": 0.0}, ambient=0.015))
        assert kinds(history) == []
        assert history.stretch[-1] == pytest.approx(history.stretch[100], abs=1e-11)
        assert history.energy_balance.relative_imbalance < 1e-8
    for past in (1e-12, 1e-9, 1e-6):
        history = run(pair(1.2, {"ramp": peak + past}, {"ramp": 0.0}, ambient=0.015))
        assert kinds(history) == ["limit_point", "limit_point"]


def test_samples_close_to_a_limit_point():
    """The state beside a fold moves with the root of the distance to it."""
    peak = run(pair(1.2, RAMP, ambient=0.015)).events[0]
    for short in (1e-4, 1e-8, 1e-12):
        history = run(pair(1.2, {"ramp": peak.voltage[0] - short}, ambient=0.015))
        active, _ = history.stretch[-1]
        pressure, voltage = history.pressure[-1], history.voltage[-1, 0]
        assert gent_force(active) == pytest.approx(
            pressure * active**2 + 2 * voltage**2 * active**3, abs=1e-12
        )
        gap = peak.stretch_before[0] - active
        assert 0.0 < gap < 20 * np.sqrt(short)


# -- tension, breakdown, runaway -------------------------------------------------------------------------


def test_sealed_at_no_pressure_loses_tension_at_once():
    for first in (
        {"ramp": 0.1},
        {"jump": 0.1},
        {"sine": {"mean": 0.0, "amplitude": 0.1, "period": 1, "cycles": 1}},
    ):
        for ambient in (0.0, 1.0):
            history = run(single(first, {"hold": 1}, ambient=ambient))
            assert history.outcome is Outcome.LOSS_OF_TENSION
            assert kinds(history) == ["loss_of_tension"]
            assert history.events[0].time == 0.0
            assert history.stretch.tolist() == [[1.0]]
    assert run(single({"hold": 1}, {"ramp": 0.0})).outcome is Outcome.COMPLETED


def test_deflation_to_no_pressure_is_no_event():
    history = run(single({"inflate": 1.0}, {"inflate": 0.0}, {"hold": 1}))
    assert kinds(history) == []
    assert history.stretch[-1].tolist() == pytest.approx([1.0], abs=1e-14)


def test_a_snap_that_loses_tension_is_two_events_at_one_time():
    history = run(pair(1.2, {"ramp": 0.5}, {"hold": 1}, ambient=0.2))
    assert history.outcome is Outcome.LOSS_OF_TENSION
    snap, loss = history.events
    assert (snap.kind, loss.kind) == (EventKind.LIMIT_POINT, EventKind.LOSS_OF_TENSION)
    assert snap.time == loss.time == history.time[-1]
    assert snap.pressure_after == pytest.approx(0.0, abs=1e-10)
    assert loss.stretch_before.tolist() == snap.stretch_after.tolist()
    assert loss.stretch_after is None
    assert loss.pressure_after is None
    assert loss.dissipated is None
    assert np.count_nonzero(history.time == loss.time) == 2


def test_breakdown_on_the_path():
    plain = run(pair(0.6, {"ramp": 0.3}))
    strength = 0.7 * plain.field[-1, 0]
    history = run(pair(0.6, {"ramp": 0.3}, {"hold": 1}, active={"breakdown": {"field": strength}}))
    assert history.outcome is Outcome.BREAKDOWN
    event = history.events[-1]
    assert event.field_before[0] == pytest.approx(strength, rel=1e-13)
    assert history.time[-1] == event.time
    assert np.all(history.field[:-1, 0] < strength)


def test_breakdown_in_a_snap():
    plain = run(pair(1.2, RAMP, ambient=0.015))
    landing = plain.events[0].field_after[0]
    history = run(pair(1.2, RAMP, ambient=0.015, active={"breakdown": {"field": 0.5 * landing}}))
    assert kinds(history) == ["limit_point", "breakdown"]
    assert history.events[0].field_after[0] == pytest.approx(0.5 * landing, rel=1e-9)
    survivor = run(pair(1.2, {"ramp": 0.361}, ambient=0.015, active={"breakdown": {"field": 1.1 * landing}}))
    assert survivor.outcome is Outcome.COMPLETED


def test_breakdown_at_a_jump_before_anything_moves():
    history = run(pair(0.6, {"jump": 3.0}, active={"breakdown": {"field": 2.0}}))
    assert kinds(history) == ["jump", "breakdown"]
    assert history.events[0].stretch_after.tolist() == history.events[0].stretch_before.tolist()


def test_breakdown_under_a_negative_voltage():
    for sign in (1, -1):
        history = run(pair(0.6, {"ramp": sign * 0.5}, active={"breakdown": {"field": 0.5}}))
        assert history.outcome is Outcome.BREAKDOWN
        assert abs(history.events[-1].field_before[0]) == pytest.approx(0.5, rel=1e-13)


@pytest.mark.parametrize(
    ("pressure", "voltage", "stretch"),
    [(0.4, 0.56168, 1.28924), (0.8, 0.40305, 1.32634), (1.0, 0.29612, 1.34936)],
)
def test_constant_pressure_actuator(pressure, voltage, stretch):
    """One balloon that hardly stiffens, valve open: limit points of the neo-Hookean balloon, to 1e-4."""
    ramp = {"ramp": 0.7, "valve": "open"}
    history = run(single({"inflate": pressure}, ramp, elastomer={"model": "gent", "J_lim": 1e6}))
    event = history.events[0]
    assert event.kind is EventKind.LIMIT_POINT
    assert event.voltage[0] == pytest.approx(voltage, abs=1e-4)
    assert event.stretch_before[0] == pytest.approx(stretch, abs=1e-4)
    # It stiffens at last: λ_lim = 707.1.
    assert event.stretch_after[0] == pytest.approx(707.1, abs=0.2)
    assert history.outcome is Outcome.COMPLETED
    endless = run(single({"inflate": pressure}, ramp, elastomer={"model": "neo-hookean"}))
    assert kinds(endless) == ["limit_point", "runaway"]
    assert endless.outcome is Outcome.RUNAWAY
    assert endless.events[0].voltage[0] == pytest.approx(voltage, abs=1e-4)
    assert endless.events[0].stretch_after is None


def test_inflating_a_neo_hookean_balloon_runs_away():
    history = run(single({"inflate": 2.0}, elastomer={"model": "neo-hookean"}))
    assert kinds(history) == ["limit_point", "runaway"]
    event = history.events[0]
    assert event.stretch_before[0] == pytest.approx(7 ** (1 / 6), rel=1e-12)
    assert event.pressure_before == pytest.approx(1.239463, abs=5e-7)


# -- inflation and the valve -----------------------------------------------------------------------------


def test_inflation_snaps_and_deflates_with_hysteresis():
    history = run(load_scenario("scenarios/fig2_inflation.toml"))
    assert kinds(history) == ["limit_point", "limit_point"]
    up, down = history.events
    assert up.pressure_before == pytest.approx(1.2536545513298676, abs=1e-12)
    assert up.stretch_before == pytest.approx([1.3972265514868307] * 2, abs=1e-10)
    assert down.pressure_before == pytest.approx(0.7028725314932649, abs=1e-12)
    assert down.stretch_before == pytest.approx([4.141830185481718] * 2, abs=1e-10)
    assert history.stretch[-1] == pytest.approx([1.0, 1.0], abs=1e-13)


def test_balloons_of_different_size_snap_one_after_the_other():
    history = run(pair(2.6, radius=0.5))
    assert kinds(history) == ["limit_point", "limit_point"]
    first, second = history.events
    assert first.pressure_before == pytest.approx(1.2536545513298676, abs=1e-11)
    assert second.pressure_before == pytest.approx(2 * 1.2536545513298676, abs=1e-11)
    assert first.stretch_before[0] == first.stretch_after[0]
    assert second.stretch_before[1] == second.stretch_after[1]


def test_valve_steps_change_the_gas_and_nothing_else():
    history = run(pair(0.6, {"ramp": 0.2}, {"hold": 1, "valve": "open"}, {"ramp": 0.0}))
    amounts = [history.gas[history.step == step] for step in (2, 3, 4)]
    assert np.ptp(amounts[0]) == np.ptp(amounts[2]) == 0.0
    assert amounts[0][0] == pytest.approx(amounts[2][0], rel=1e-14)
    held = states(history)[history.step == 3]
    assert np.all(held == held[0])


def test_refilling_under_voltage():
    history = run(pair(0.6, {"ramp": 0.2}, {"inflate": 0.6}, {"ramp": 0.0}))
    step3 = history.step == 3
    assert history.pressure[step3][-1] == pytest.approx(0.6, abs=1e-15)
    assert np.all(np.diff(history.gas[step3]) > 0.0)
    active = history.stretch[step3][-1, 0]
    assert gent_force(active) == pytest.approx(0.6 * active**2 + 2 * 0.2**2 * active**3, abs=1e-12)


def test_opening_the_valve_on_a_state_that_only_the_gas_held():
    """On the falling part of its own pressure curve a balloon stays only while the gas is shared."""
    history = run(pair(1.2, {"ramp": 0.5}, {"hold": 1, "valve": "open"}, ambient=1.0))
    before = history.stretch[history.step == 2][-1, 0]
    assert before > 1.4
    if history.events:
        assert kinds(history) == ["jump"]
        assert history.events[0].dissipated > 0.0
        after = history.stretch[-1, 0]
        pressure = history.pressure[-1]
        assert gent_force(after) == pytest.approx(pressure * after**2 + 2 * 0.25 * after**3, abs=1e-10)


# -- several balloons -------------------------------------------------------------------------------------


def several(count, electroded, steps, ambient=0.05, radii=None, **sections):
    gent = {"model": "gent", "J_lim": 100.0}
    balloons = [
        {
            "name": f"b{i}",
            "radius": (radii or [1.0] * count)[i],
            "electrodes": i in electroded,
            "elastomer": gent,
        }
        for i in range(count)
    ]
    return load_scenario(
        {
            "title": "several",
            "gas": {"ambient_pressure": ambient},
            "balloon": balloons,
            "step": steps,
            **sections,
        }
    )


def test_many_balloons_on_one_gas():
    """Twelve balloons, one electroded: eleven equal passive ones move as one."""
    history = run(several(12, (0,), [{"inflate": 0.8}, {"ramp": 0.35}, {"ramp": 0.0}], ambient=1.0))
    assert history.outcome is Outcome.COMPLETED
    assert np.ptp(history.stretch[:, 1:], axis=1).max() < 1e-12
    assert history.energy_balance.relative_imbalance < 1e-8
    assert history.stretch[-1] == pytest.approx(history.stretch[100], abs=1e-11)


def test_voltages_by_name():
    steps = [{"inflate": 0.6}, {"ramp": {"b0": 0.2, "b2": 0.1}}, {"ramp": {"b2": 0.3}}, {"ramp": 0.1}]
    history = run(several(3, (0, 2), steps, ambient=1.0))
    ends = [history.voltage[history.step == step][-1].tolist() for step in (2, 3, 4)]
    assert np.array(ends) == pytest.approx(np.array([[0.2, 0.1], [0.2, 0.3], [0.1, 0.1]]), abs=1e-16)
    other_way = run(several(3, (0, 2), [{"inflate": 0.6}, {"ramp": 0.1}], ambient=1.0))
    assert history.stretch[-1] == pytest.approx(other_way.stretch[-1], abs=1e-12)


def test_open_valve_balloons_do_not_feel_each_other():
    steps = [{"inflate": 0.6}, {"ramp": {"b0": 0.3}, "valve": "open"}, {"ramp": {"b1": 0.2}, "valve": "open"}]
    history = run(several(2, (0, 1), steps))
    assert np.ptp(history.stretch[history.step == 2][:, 1]) == 0.0
    assert np.ptp(history.stretch[history.step == 3][:, 0]) == 0.0
    assert np.ptp(history.pressure[history.step > 1]) == 0.0


def test_two_equal_actuators_part_at_a_branch_point():
    """Equal balloons under one voltage: the symmetric state loses stability without a fold."""
    history = run(several(2, (0, 1), [{"inflate": 1.2}, {"ramp": 0.6}], ambient=1.0))
    parted = [event for event in history.events if event.kind is EventKind.BRANCH_POINT]
    assert len(parted) == 1
    event = parted[0]
    assert event.stretch_before[0] == pytest.approx(event.stretch_before[1], abs=1e-9)
    after = history.stretch[history.time > event.time]
    assert np.all(after[:, 0] > after[:, 1])
    symmetric = history.time < event.time
    assert history.stretch[symmetric, 0] == pytest.approx(history.stretch[symmetric, 1], abs=1e-10)


# -- books and cycles -------------------------------------------------------------------------------------


@settings(max_examples=25, deadline=None)
@given(
    inflate=st.floats(0.1, 3.0),
    ambient=st.floats(0.0, 2.0),
    radius=st.floats(0.3, 2.0),
    legs=st.lists(st.floats(-0.5, 0.5), min_size=1, max_size=4),
)
def test_energy_is_conserved(inflate, ambient, radius, legs):
    history = run(pair(inflate, *[{"ramp": v} for v in legs], ambient=ambient, radius=radius))
    assert history.energy_balance.relative_imbalance < 1e-8
    assert all(event.dissipated is None or event.dissipated >= -1e-12 for event in history.events)
    assert np.all(history.pressure > -1e-9)


def test_a_loop_loses_what_its_snaps_lose():
    history = run(pair(1.2, RAMP, {"ramp": 0.0, "over": 10}, ambient=0.015))
    books = history.energy_balance
    assert books.electrical_work == pytest.approx(40.830526, abs=5e-7)
    assert [event.dissipated for event in history.events] == pytest.approx([37.383002, 3.447524], abs=5e-7)
    assert books.electrical_work == pytest.approx(books.dissipated, rel=1e-10)


def test_a_thousand_cycles():
    loop = [{"ramp": 0.4, "over": 1}, {"ramp": 0.0, "over": 1}]
    history = run(pair(1.2, {"cycle": 1000, "steps": loop}, ambient=0.015, output={"points": 11}))
    assert kinds(history) == ["limit_point"] * 2000
    assert history.step[-1] == 2001
    loops = states(history)[11:].reshape(1000, -1, 4)
    assert np.ptp(loops, axis=0).max() < 1e-9
    assert history.statistics.ida_solves < 10


# -- what went wrong once ---------------------------------------------------------------------------------


def test_a_ramp_by_name_to_the_present_value_changes_nothing_else():
    steps = [
        {"inflate": 1.0},
        {"ramp": {"b0": 0.1, "b1": 0.05}},
        {"ramp": {"b0": 0.1}},
        {"jump": {"b0": 0.1}},
    ]
    history = run(several(2, (0, 1), steps))
    assert kinds(history) == []
    assert history.voltage[-1].tolist() == [0.1, 0.05]


@pytest.mark.parametrize(("inflate", "voltage"), [(0.05, 0.36), (0.02, 0.3), (0.1, 0.45)])
def test_a_flow_that_would_rest_without_tension_loses_it(inflate, voltage):
    history = run(single({"inflate": inflate}, {"jump": voltage}, {"hold": 1}))
    assert kinds(history) == ["jump", "loss_of_tension"]
    assert history.pressure[-1] == pytest.approx(0.0, abs=1e-14)
    assert (history.pressure[-1] + 1.0) * history.volume[-1] == pytest.approx(history.gas[-1], rel=1e-13)


def test_a_flow_that_would_rest_beyond_breakdown_breaks():
    history = run(pair(0.6, {"jump": 0.35}, {"hold": 1}, active={"breakdown": {"field": 0.4}}))
    assert kinds(history) == ["jump", "breakdown"]
    assert history.field[-1, 0] == pytest.approx(0.4, rel=1e-12)


def test_a_voltage_far_beyond_all_scales():
    history = run(pair(2.4, {"ramp": 3000.0}, radius=0.5))
    assert history.outcome is Outcome.COMPLETED
    limit = 7.176336912341698
    assert 0.0 < limit - history.stretch[-1, 0] < 1e-8


def test_equal_actuators_beside_a_passive_balloon():
    """Their branch point is subcritical: the branch that leaves it goes back in voltage, so it snaps."""
    history = run(several(3, (0, 1), [{"inflate": 0.5}, {"ramp": 0.6}], ambient=1.0, radii=[0.9, 0.9, 1.0]))
    for event in history.events:
        assert event.kind is not EventKind.LIMIT_POINT or event.dissipated >= 0.0
    assert history.outcome in (Outcome.COMPLETED, Outcome.LOSS_OF_TENSION)
    assert history.energy_balance.relative_imbalance < 1e-8


@pytest.mark.parametrize("imperfection", [1e-9, 1e-8, 1e-7, 1e-5])
def test_an_imperfection_decides_which_actuator_grows(imperfection):
    """The branch point of equal balloons unfolds: no event, the larger one grows, smoothly and fast."""
    radii = [1.0, 1.0 + imperfection]
    history = run(several(2, (0, 1), [{"inflate": 1.2}, {"ramp": 0.5}], ambient=1.0, radii=radii))
    assert kinds(history) == []
    assert history.stretch[-1, 1] > history.stretch[-1, 0] + 0.5
    assert history.energy_balance.relative_imbalance < 1e-8


@pytest.mark.parametrize(
    ("J_lim", "snaps"), [(17.638, 0), (17.638081, 2), (17.63809, 2), (17.6381, 2), (17.64, 2), (17.6, 0)]
)
def test_snaps_about_to_vanish(J_lim, snaps):
    """Peak and valley of inflation meet at J = 17.63808: two limit points 5e-12 apart are seen."""
    history = run(pair(3.0, {"inflate": 0.0}, J_lim=J_lim))
    assert len(history.events) == snaps


def test_a_failed_step_keeps_what_it_reached(monkeypatch):
    from simulator.simulation.run import SolverError
    from simulator.solver import flow
    from tests.pairs import run

    def fail(*_, **__):
        raise flow.FlowError("for the test")

    monkeypatch.setattr(flow, "snap", fail)
    scenario = pair(1.2, {"ramp": 0.4, "over": 10}, ambient=0.015)
    with pytest.raises(SolverError, match="step 2, time 10: for the test") as error:
        run(scenario)
    history = error.value.history
    assert history.outcome is Outcome.FAILED
    assert history.voltage[-1, 0] == pytest.approx(0.36, abs=0.004)
    assert history.step[-1] == 2


@pytest.mark.parametrize(
    ("count", "ambient"), [(2, 1.0), (3, 1.0), (3, 0.2), (3, 0.015), (4, 1.0), (12, 1.0)]
)
def test_equal_actuators_part_one_against_all_others(count, ambient):
    """However many directions turn unstable at once, the branch is one balloon against the equal rest."""
    everyone = tuple(range(count))
    history = run(several(count, everyone, [{"inflate": 1.2}, {"ramp": 0.5}], ambient=ambient))
    first = history.events[0]
    assert first.kind is EventKind.BRANCH_POINT
    assert np.ptp(first.stretch_before) < 1e-12
    after = history.stretch[history.branch == 1]
    assert np.all(after[1:, 0] > after[1:, 1])
    assert np.ptp(after[:, 1:], axis=1).max() < 1e-9
    assert history.energy_balance.relative_imbalance < 1e-8


@pytest.mark.parametrize("low", [1e-6, 1e-9, 1e-12])
@pytest.mark.parametrize("step", ["ramp", "jump"])
def test_however_low_a_voltage_it_is_applied(step, low):
    history = run(pair(1.2, {step: low}, {"ramp": 0.0}, ambient=0.015))
    assert history.voltage.max() == low
    assert history.voltage[-1, 0] == 0.0


def test_equal_actuators_part_alike_under_voltages_of_either_sign():
    """The stress goes with φ²: all that differs is that the branch they leave on is followed downwards."""
    up, down = (
        run(several(2, (0, 1), [{"inflate": 1.2}, {"ramp": v}, {"ramp": 0.0}], ambient=1.0))
        for v in (0.6, -0.6)
    )
    assert kinds(down) == kinds(up)
    assert EventKind.BRANCH_POINT in {event.kind for event in down.events}
    assert down.voltage == pytest.approx(-up.voltage, abs=1e-15)
    assert down.stretch == pytest.approx(up.stretch, abs=1e-9)
    assert down.energy_balance.relative_imbalance < 1e-8


@pytest.mark.parametrize("sign", [1, -1])
def test_sealed_under_a_voltage_without_pressure_only_more_of_it_loses_tension(sign):
    """Whichever its sign: a larger φ² wants more volume than the gas fills at p = 0, a smaller one less."""
    before = [{"ramp": sign * 0.1, "valve": "open"}]
    more = run(pair(0.0, *before, {"ramp": sign * 0.2}))
    assert kinds(more) == ["loss_of_tension"]
    assert more.events[0].time == more.time[more.step == 2][-1]
    assert more.events[0].voltage == pytest.approx([sign * 0.1], abs=1e-15)
    less = run(pair(0.0, *before, {"ramp": sign * 0.05}))
    assert kinds(less) == []
    assert less.pressure[-1] > 0.0
