"""Actuators with waves of their own: sines and triangles out of step, on one gas or each by itself."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simulator.model import drive
from simulator.model.drive import VoltageCurve, VoltageLine, sine_of_turns
from simulator.results.history import Outcome
from simulator.scenario import SineByName, load_scenario
from simulator.simulation.explanation import explain
from tests.pairs import gent_force, kinds, run
from tests.test_until import actuators, ends

A = {"mean": 0.2, "amplitude": 0.15}
SIDES = {"low": 0.05, "high": 0.35}
START = [{"inflate": 0.9}, {"ramp": 0.2}]


def sine(period=2.0, cycles=3.0, **waves):
    return {"sine": {**waves, "period": period, "cycles": cycles}}


def triangle(period=2.0, cycles=3.0, **waves):
    return {"triangle": {**waves, "period": period, "cycles": cycles}}


def apart(wave, *phases):
    return {name: {**wave, "phase": phase} for name, phase in zip("abcdef", phases, strict=False)}


def pressed(history):
    """Largest residual of the force balances and the gas law over the samples with the valve closed."""
    stretch, pressure, voltage = history.stretch, history.pressure[:, None], history.voltage
    square = np.zeros_like(stretch)
    square[:, : voltage.shape[1]] = voltage**2
    balance = gent_force(stretch) - pressure * stretch**2 - 2 * square * stretch**3
    return np.abs(balance)


# -- the drive -------------------------------------------------------------------------------------------


@given(st.floats(-50, 50))
def test_the_sine_of_turns(turns):
    assert sine_of_turns(turns) == pytest.approx(np.sin(2 * np.pi * turns), abs=1e-13)
    assert sine_of_turns(np.array([turns]))[0] == pytest.approx(sine_of_turns(turns), abs=1e-15)
    slope = sine_of_turns(np.array([turns + 1e-30j])).imag[0] / 1e-30
    assert slope == pytest.approx(2 * np.pi * np.cos(2 * np.pi * turns), abs=1e-11)


def test_the_sine_of_turns_is_exact_at_quarters():
    quarters = np.arange(-8, 9) / 4
    assert sine_of_turns(quarters).tolist() == [0, 1, 0, -1] * 4 + [0]
    assert [sine_of_turns(x) for x in quarters.tolist()] == [0, 1, 0, -1] * 4 + [0]


def test_a_curve_is_closed_to_the_last_digit():
    curve = VoltageCurve((0.1, 0.2, 0.0), (0.3, 0.1, 0.5), (1 / 3, 0.77, 0.5))
    assert curve.at(1.0).tolist() == curve.at(0.0).tolist()
    assert curve.at(np.array([0.0, 0.3, 1.0]))[[0, 2]].tolist() == [curve.at(0.0).tolist()] * 2
    assert curve.at(0.0)[2] == 0.0
    assert curve.at(0.25) == pytest.approx(
        [0.1 + 0.3 * np.sin(2 * np.pi * (1 / 3 + 0.25)), *curve.at(0.25)[1:]]
    )
    assert VoltageCurve((0.1, 0.2), (0.0, 0.1), (0.0, 0.0)).moves == (False, True)


def test_a_sine_has_one_leg_for_each_period():
    legs = drive.sines([0.1], [0.2], [0.0], 2.4)
    assert [leg.start for leg in legs] == pytest.approx([0.0, 1 / 2.4, 2 / 2.4])
    assert [leg.waveform.values.tolist() for leg in legs[:2]] == [[0.0, 1.0]] * 2
    assert legs[-1].waveform.values == pytest.approx([0.0, 0.4])
    assert (legs[-1].end, len({leg.way for leg in legs})) == (1.0, 1)


@given(
    phases=st.lists(st.floats(-2, 2), min_size=1, max_size=4),
    cycles=st.floats(0.05, 3.2),
    share=st.floats(0, 1),
)
def test_triangles_are_polygons_of_their_corners(phases, cycles, share):
    low, high = [0.1 * i for i in range(len(phases))], [0.5] * len(phases)
    legs = drive.triangles(low, high, phases, cycles)
    assert (legs[0].start, legs[-1].end) == (0.0, 1.0)
    for one, other in itertools.pairwise(legs):
        assert one.end == other.start
        assert one.way.at(one.waveform.values[-1]) == pytest.approx(
            other.way.at(other.waveform.values[0]), abs=1e-11
        )
    leg = next(leg for leg in legs if leg.start <= share <= leg.end)
    voltages = leg.way.at(float(leg.waveform.at(leg.within(np.array([share])))[0]))
    turns = np.mod(cycles * share + np.array(phases), 1.0)
    assert voltages == pytest.approx(low + (np.array(high) - low) * (1 - np.abs(1 - 2 * turns)), abs=1e-9)


def test_triangles_come_back_along_the_lines_they_went():
    legs = drive.triangles([0.0, 0.1], [0.4, 0.3], [0.0, 0.5], 50.0)
    assert len({leg.way for leg in legs}) <= 2
    assert legs[0].way.at(legs[0].waveform.values[-1]).tolist() == [0.4, 0.1]


# -- ramps by name ---------------------------------------------------------------------------------------


def test_ramps_by_name_from_and_to_different_voltages():
    there, back = {"a": 0.1, "b": 0.35}, {"a": 0.3, "b": 0.1}
    steps = [{"inflate": 0.9}, {"ramp": back}, {"ramp": there, "over": 4}, {"ramp": back, "over": 4}]
    history = run(actuators(*steps, passive=1))
    rows = history.step == 3
    share = (history.time[rows] - 2.0) / 4.0
    assert history.voltage[rows, 0] == pytest.approx(0.3 - 0.2 * share, abs=1e-15)
    assert history.voltage[rows, 1] == pytest.approx(0.1 + 0.25 * share, abs=1e-15)
    assert pressed(history)[history.step > 1].max() < 1e-11
    middle = run(actuators({"inflate": 0.9}, {"ramp": {"a": 0.2, "b": 0.225}}, passive=1))
    assert history.stretch[rows][49] == pytest.approx(middle.stretch[-1], abs=1e-12)
    assert history.stretch[history.step == 4][-1] == pytest.approx(
        history.stretch[history.step == 2][-1], abs=1e-12
    )
    assert history.energy_balance.relative_imbalance < 1e-8
    assert history.statistics.ida_solves <= 4


@pytest.mark.parametrize("voltages", [(0.3, 0.1), (0.7 / 3, 0.1 / 3), (0.1, 0.123456789)])
def test_the_end_of_a_ramp_by_name_is_where_a_jump_or_wave_begins(voltages):
    """Voltages along a line are good to rounding; what differs by rounding is no jump."""
    target = dict(zip("ab", voltages, strict=True))
    wave = {name: {"mean": v, "amplitude": 0.05} for name, v in target.items()}
    steps = [{"inflate": 0.9}, {"ramp": {"a": 0.05, "b": 0.31}}, {"ramp": target}]
    assert kinds(run(actuators(*steps, {"jump": target}, sine(**wave), passive=1))) == []


# -- the same drive in other words -------------------------------------------------------------------------


def same(one, other, abs=1e-12):
    assert kinds(one) == kinds(other)
    assert one.time == pytest.approx(other.time, abs=1e-12)
    for quantity in ("voltage", "stretch", "pressure", "energy"):
        assert getattr(one, quantity) == pytest.approx(getattr(other, quantity), abs=abs)
    for a, b in zip(one.events, other.events, strict=True):
        assert a.time == pytest.approx(b.time, abs=1e-12)
        assert a.voltage == pytest.approx(b.voltage, abs=1e-12)
        assert a.stretch_after == pytest.approx(b.stretch_after, abs=1e-9)
        assert a.dissipated == pytest.approx(b.dissipated, abs=1e-9)
    works = [history.energy_balance.electrical_work for history in (one, other)]
    assert works[0] == pytest.approx(works[1], rel=1e-9)


@pytest.mark.parametrize(
    ("inflate", "mean", "amplitude", "snaps"), [(0.9, 0.2, 0.15, 0), (1.2, 0.25, 0.2, 4)]
)
@pytest.mark.parametrize("cycles", [2.0, 1.6])
def test_a_wave_in_step_is_the_common_wave(inflate, mean, amplitude, snaps, cycles):
    """With snaps: the pair of Fig. 3c, its one actuator by name."""
    count = 1 if snaps else 2
    start = [{"inflate": inflate}, {"ramp": mean}]
    wave = {"mean": mean, "amplitude": amplitude}
    setting = {"count": count, "passive": 1, "ambient": 0.015 if snaps else 1.0}
    by_name = sine(cycles=cycles, **apart(wave, *[0.0] * count))
    one, other = (run(actuators(*start, step, **setting)) for step in (by_name, sine(cycles=cycles, **wave)))
    same(one, other)
    assert len(one.events) == snaps
    sides = {"low": mean - amplitude, "high": mean + amplitude}
    start = [{"inflate": inflate}, {"ramp": sides["low"]}]
    by_name = triangle(cycles=cycles, **apart(sides, *[0.0] * count))
    same(*(run(actuators(*start, step, **setting)) for step in (by_name, triangle(cycles=cycles, **sides))))


def test_half_a_period_apart_all_waves_go_along_one_straight_line():
    """Sines, triangles and ramps there and back: the same snaps, at the same voltages."""
    wave, low, high = {"mean": 0.25, "amplitude": 0.2}, 0.05, 0.45
    start = [{"inflate": 1.2}, {"ramp": 0.25}]
    waves = [
        sine(cycles=2.0, **apart(wave, 0.0, 0.5)),
        triangle(cycles=2.0, **apart({"low": low, "high": high}, 0.25, 0.75)),
        {
            "cycle": 2,
            "steps": [
                {"ramp": {"a": high, "b": low}, "over": 0.5},
                {"ramp": {"a": low, "b": high}, "over": 1},
                {"ramp": 0.25, "over": 0.5},
            ],
        },
    ]
    sines, triangles, ramps = (run(actuators(*start, step, ambient=0.015)) for step in waves)
    assert len(sines.events) == 8
    for other in (triangles, ramps):
        assert kinds(other) == kinds(sines)
        for a, b in zip(sines.events, other.events, strict=True):
            assert a.voltage == pytest.approx(b.voltage, abs=1e-11)
            assert a.stretch_before == pytest.approx(b.stretch_before, abs=1e-9)
            assert a.stretch_after == pytest.approx(b.stretch_after, abs=1e-9)
            assert a.dissipated == pytest.approx(b.dissipated, abs=1e-9)
    for a, b in zip(triangles.events, ramps.events, strict=True):
        assert a.time == pytest.approx(b.time, abs=1e-11)


@settings(max_examples=10)
@given(fraction=st.floats(0.01, 0.99), phase=st.floats(-1, 1))
def test_without_a_snap_only_the_voltages_matter(fraction, phase):
    history = run(actuators(*START, sine(cycles=fraction, **apart(A, 0.0, phase)), passive=1))
    straight = run(
        actuators(
            {"inflate": 0.9}, {"ramp": dict(zip("ab", history.voltage[-1].tolist(), strict=True))}, passive=1
        )
    )
    assert history.stretch[-1] == pytest.approx(straight.stretch[-1], abs=1e-11)
    assert history.pressure[-1] == pytest.approx(straight.pressure[-1], abs=1e-11)


# -- symmetry --------------------------------------------------------------------------------------------


def test_push_and_pull_are_each_other_half_a_period_later():
    history = run(load_scenario("scenarios/push_pull.toml"))
    assert kinds(history) == ["limit_point"] * 12
    assert history.outcome is Outcome.COMPLETED
    assert history.energy_balance.relative_imbalance < 1e-8
    later = [e for e in history.events if e.time > 6.0]
    earlier = [e for e in history.events if 4.0 < e.time < 12.0]
    for a, b in zip(earlier, later, strict=True):
        assert b.time - a.time == pytest.approx(2.0, abs=1e-10)
        assert b.stretch_before == pytest.approx(a.stretch_before[::-1], abs=1e-10)
        assert b.stretch_after == pytest.approx(a.stretch_after[::-1], abs=1e-9)
    # 300 intervals over three periods of 4: 50 of them are half a period.
    grid = np.flatnonzero((history.step == 3) & ~np.isin(history.time, [e.time for e in history.events]))
    stretch, pressure = history.stretch[grid], history.pressure[grid]
    assert stretch[100:-50, 0] == pytest.approx(stretch[150:, 1], abs=1e-9)
    assert stretch[100:-50, 1] == pytest.approx(stretch[150:, 0], abs=1e-9)
    assert pressure[100:-50] == pytest.approx(pressure[150:], abs=1e-9)
    assert history.stretch[:, 0].max() > 6.5
    assert history.stretch[:, 1].max() > 6.5


def test_round_a_ring_the_inflation_goes():
    history = run(load_scenario("scenarios/ring.toml"))
    assert kinds(history) == ["limit_point"] * 9
    assert [int(np.argmax(event.stretch_after)) for event in history.events] == [0, 1, 2] * 3
    assert np.diff([event.time for event in history.events]) == pytest.approx([1.0] * 8, abs=1e-9)
    assert history.energy_balance.relative_imbalance < 1e-8
    grid = np.flatnonzero((history.step == 3) & ~np.isin(history.time, [e.time for e in history.events]))
    stretch = history.stretch[grid]
    # A third of a period is 32 samples.
    for start, follower in ((0, 1), (1, 2), (2, 0)):
        assert stretch[64:-32, start] == pytest.approx(stretch[96:, follower], abs=1e-9)
    assert history.statistics.ida_solves < 40


def test_permuted_phases_permute_histories():
    radii = [1.0, 1.0, 1.0]
    phases, waves = [0.1, 0.45, 0.8], {"mean": 0.2, "amplitude": 0.2}
    start = {n: float(0.2 + 0.2 * np.sin(2 * np.pi * p)) for n, p in zip("abc", phases, strict=True)}
    reference = run(actuators({"inflate": 1.2}, {"ramp": start}, sine(cycles=2.0, **apart(waves, *phases)),
                              count=3, ambient=0.5, radii=radii))  # fmt: skip
    assert len(reference.events) > 2
    for order in ([1, 2, 0], [1, 0, 2]):
        mixed = [phases[i] for i in order]
        begin = {n: start["abc"[i]] for n, i in zip("abc", order, strict=True)}
        permuted = run(actuators({"inflate": 1.2}, {"ramp": begin}, sine(cycles=2.0, **apart(waves, *mixed)),
                                 count=3, ambient=0.5, radii=radii))  # fmt: skip
        assert permuted.time == pytest.approx(reference.time, abs=1e-10)
        assert permuted.stretch == pytest.approx(reference.stretch[:, order], abs=1e-9)
        assert permuted.pressure == pytest.approx(reference.pressure, abs=1e-9)
        assert permuted.energy_balance.dissipated == pytest.approx(
            reference.energy_balance.dissipated, abs=1e-9
        )


# -- samples, books, cycles --------------------------------------------------------------------------------


def test_samples_decide_nothing():
    step = sine(cycles=2.3, **apart({"mean": 0.2, "amplitude": 0.2}, 0.0, 0.3))
    runs = [
        run(actuators({"inflate": 1.2}, {"ramp": 0.2}, step, ambient=0.2, passive=1, output=output))
        for output in ({"points": 11}, {"points": 173}, {"every": 0.37})
    ]
    assert runs[0].events
    for other in runs[1:]:
        assert kinds(other) == kinds(runs[0])
        for a, b in zip(runs[0].events, other.events, strict=True):
            assert a.time == b.time
            assert a.stretch_after is b.stretch_after or np.array_equal(a.stretch_after, b.stretch_after)
        books, others = runs[0].energy_balance, other.energy_balance
        assert books.electrical_work == others.electrical_work
    if runs[0].outcome is Outcome.COMPLETED:
        assert runs[0].stretch[-1].tolist() == runs[1].stretch[-1].tolist()


def test_samples_satisfy_the_equations_and_the_sines():
    wave = sine(period=5.0, cycles=2.5, **apart(A, 0.0, 0.2, 0.7))
    history = run(actuators(*START, wave, count=3, passive=1, output={"points": 77}))
    rows = history.step == 3
    turns = (history.time[rows] - 2.0) / 5.0
    grid, quarters = np.arange(1, 191) / 76, np.arange(1, 10, 2) / 4
    extremes = [q - p for p in (0.2, 0.7) for q in np.arange(1, 14, 2) / 4 if 0 < q - p < 2.5]
    assert set(quarters) <= set(grid)
    # All but the first begin by a jump, which has two rows.
    assert turns == pytest.approx(np.sort([0.0, *grid, *np.unique(np.round(extremes, 12))]), abs=1e-12)
    for i, phase in enumerate((0.0, 0.2, 0.7)):
        assert history.voltage[rows, i] == pytest.approx(
            0.2 + 0.15 * np.sin(2 * np.pi * (turns + phase)), abs=1e-13
        )
    assert pressed(history)[rows].max() < 1e-11
    assert (history.pressure + 1.0) * history.volume == pytest.approx(history.gas, rel=1e-13)


@settings(max_examples=15)
@given(
    mean=st.floats(-0.3, 0.3),
    amplitude=st.sampled_from([1e-7, 1e-3, 0.05, 0.3]),
    phases=st.lists(st.floats(0, 1), min_size=2, max_size=3),
    inflate=st.floats(0.3, 2.5),
    ambient=st.sampled_from([0.015, 0.3, 2.0]),
)
def test_energy_is_conserved(mean, amplitude, phases, inflate, ambient):
    waves = apart({"mean": mean, "amplitude": amplitude}, *phases)
    setting = {"count": len(phases), "ambient": ambient, "radii": [1.0, 0.93, 1.08][: len(phases)]}
    history = run(actuators({"inflate": inflate}, sine(cycles=1.7, **waves), **setting))
    assert history.energy_balance.relative_imbalance < 1e-8
    assert all(event.dissipated is None or event.dissipated >= -1e-12 for event in history.events)


def test_a_small_wave_alone_closes_its_books():
    """The work of a wave of 1e-4 about a constant voltage, against charge and stretch of the samples."""
    wave = sine(cycles=1.0, **apart({"mean": 0.2, "amplitude": 1e-4}, 0.0, 0.25))
    still, moved = (run(actuators(*START, step, passive=1)) for step in ({"hold": 1}, wave))
    work = moved.energy_balance.electrical_work - still.energy_balance.electrical_work
    jump = moved.events[0]
    assert jump.kind.value == "jump"
    back = float(moved.voltage[-1, 1] - 0.2)
    assert back == pytest.approx(1e-4, rel=1e-9)
    charge = moved.charge[-1, 1] - still.charge[-1, 1]
    assert work == pytest.approx(0.2 * (charge + moved.charge[-1, 0] - still.charge[-1, 0]), rel=1e-2)
    assert abs(moved.energy_balance.imbalance - still.energy_balance.imbalance) < 1e-14


def test_a_hundred_periods_cost_no_more_integration_than_two():
    waves = apart({"mean": 0.25, "amplitude": 0.2}, 0.0, 0.5)
    few, many = (
        run(
            actuators(
                {"inflate": 1.2},
                {"ramp": 0.25},
                sine(cycles=n, **waves),
                ambient=0.015,
                output={"points": int(20 * n) + 1},
            )
        )
        for n in (2.0, 100.0)
    )
    assert many.statistics.ida_solves == few.statistics.ida_solves
    assert kinds(many) == ["limit_point"] * 400
    times = np.array([event.time for event in many.events]).reshape(100, 4)
    assert np.ptp(times[1:] - 2.0 * np.arange(1, 100)[:, None], axis=0).max() < 1e-9


def test_the_pace_does_not_matter():
    slow, fast = (
        run(actuators(*START, sine(period=period, **apart(A, 0.0, 0.4)), passive=1)) for period in (1e-9, 1e6)
    )
    assert slow.stretch == pytest.approx(fast.stretch, abs=1e-12)


def test_who_is_not_named_keeps_the_voltage():
    steps = [{"inflate": 0.9}, {"ramp": {"a": 0.2, "b": 0.1}}, sine(a=A), triangle(b={**SIDES, "low": 0.1})]
    history = run(actuators(*steps, passive=1))
    assert np.ptp(history.voltage[history.step == 3, 1]) == 0.0
    assert np.ptp(history.voltage[history.step == 4, 0]) == 0.0
    assert kinds(history) == []
    still = run(actuators(*START, sine(a={"mean": 0.2, "amplitude": 0.0}), passive=1))
    assert np.ptp(still.stretch[still.step == 3], axis=0).tolist() == [0.0, 0.0, 0.0]


def test_sines_follow_one_another_without_a_jump():
    waves = apart(A, 1 / 3, 0.5)
    start = {"a": 0.2 + 0.15 * np.sin(2 * np.pi / 3), "b": 0.2}
    history = run(
        actuators(
            {"inflate": 0.9}, {"ramp": start}, {"cycle": 3, "steps": [sine(cycles=1.0, **waves)]}, passive=1
        )
    )
    assert kinds(history) == []
    whole = run(actuators({"inflate": 0.9}, {"ramp": start}, sine(cycles=3.0, **waves), passive=1))
    assert history.stretch[-1] == pytest.approx(whole.stretch[-1], abs=1e-13)


# -- with everything else ----------------------------------------------------------------------------------


def test_with_the_valve_open_each_is_by_itself():
    waves = apart({"mean": 0.2, "amplitude": 0.2}, 0.0, 0.35)
    step = {**sine(cycles=1.2, **waves), "valve": "open"}
    both = run(actuators({"inflate": 0.6}, {"ramp": 0.2, "valve": "open"}, step))
    alone = run(
        actuators(
            {"inflate": 0.6},
            {"ramp": 0.2, "valve": "open"},
            {**sine(cycles=1.2, a=waves["a"]), "valve": "open"},
        )
    )
    rows = both.step == 3
    assert both.stretch[rows][1:, 0] == pytest.approx(alone.stretch[alone.step == 3][:, 0], abs=1e-12)
    assert np.ptp(both.pressure[rows]) == 0.0
    assert both.energy_balance.relative_imbalance < 1e-8
    bent = {**triangle(cycles=1.3, a=SIDES, b={**SIDES, "low": 0.35, "phase": 0.2}), "valve": "open"}
    history = run(
        actuators(
            {"inflate": 0.6}, {"ramp": {"a": 0.05, "b": 0.35}, "valve": "open"}, bent, output={"points": 9}
        )
    )
    rows = history.step == 3
    for i in (0, 1):
        voltage, stretch = history.voltage[rows, i], history.stretch[rows, i]
        assert gent_force(stretch) == pytest.approx(0.6 * stretch**2 + 2 * voltage**2 * stretch**3, abs=1e-11)


@pytest.mark.parametrize("wave", ["sine", "triangle"])
@pytest.mark.parametrize("value", [1.14, 1.16])
def test_until_stops_a_wave(wave, value):
    start = [{"inflate": 0.9}, {"ramp": {"a": 0.2, "b": 0.35}}]
    waves = {
        "sine": sine(cycles=3.0, **apart(A, 0.0, 0.25)),
        "triangle": triangle(cycles=3.0, **apart(SIDES, 0.25, 0.5)),
    }
    full = run(actuators(*start, waves[wave], passive=1))
    step = {**waves[wave], "until": {"stretch": {"b": value}}}
    history = run(actuators(*start, step, {"hold": 1}, passive=1, output={"points": 11}))
    assert ends(history) == [f"stretch_b = {value:g}"]
    assert history.stretch[-1, 1] == pytest.approx(value, rel=1e-12)
    (stop,) = history.stops
    turns = (stop.time - 2.0) / 2.0
    share = 1 - abs(1 - 2 * ((turns + 0.5) % 1))
    expected = 0.2 + 0.15 * np.cos(2 * np.pi * turns) if wave == "sine" else 0.05 + 0.3 * share
    assert history.voltage[-1, 1] == pytest.approx(expected, abs=1e-13)
    times = history.time[history.step == 3]
    grid = 2.0 + 0.2 * np.arange(1, 10 * turns)
    assert np.abs(times[:, None] - grid).min(axis=0).max(initial=0.0) < 1e-12
    passed = full.stretch[(full.step == 3) & (full.time > 2.0) & (full.time < stop.time), 1] - value
    assert np.all(passed > 0.0) or np.all(passed < 0.0)
    unreached = run(actuators(*start, {**waves[wave], "until": {"stretch": {"a": 3.0}}}, passive=1))
    assert ends(unreached) == [None]
    assert unreached.stretch.tolist() == full.stretch.tolist()


def test_until_the_value_of_the_start_is_touched_again_a_period_later():
    """It is the smallest of the period, and sits where one period ends and the next begins."""
    waves = {"a": {**A, "phase": -0.25}}
    start = [{"inflate": 0.9}, {"ramp": {"a": 0.05, "b": 0.1}}]
    value = float(run(actuators(*start, passive=1)).stretch[-1, 0])
    history = run(
        actuators(*start, {**sine(cycles=2.0, **waves), "until": {"stretch": {"a": value}}}, passive=1)
    )
    assert history.stops[0].reached
    assert history.stops[0].time == pytest.approx(4.0, abs=1e-5)
    assert history.stretch[-1, 0] == pytest.approx(value, rel=1e-12)


def test_until_the_snap_of_a_wave():
    wave = sine(cycles=3.0, **apart({"mean": 0.25, "amplitude": 0.2}, 0.0, 0.5))
    start = [{"inflate": 1.2}, {"ramp": 0.25}]
    whole = run(actuators(*start, wave, ambient=0.015))
    history = run(actuators(*start, {**wave, "until": {"event": "limit_point"}}, ambient=0.015))
    assert (kinds(history), ends(history)) == (["limit_point"], ["limit_point"])
    assert history.time[-1] == pytest.approx(whole.events[0].time, abs=1e-12)
    assert history.stretch[-1].tolist() == history.events[0].stretch_after.tolist()
    other = run(actuators(*start, {**wave, "until": {"stretch": {"b": 4.0}}}, ambient=0.015))
    assert ends(other) == ["stretch_b = 4"]
    assert kinds(other) == ["limit_point"] * 3
    assert other.stretch[-1, 1] > 6.0


def test_a_film_breaks_on_a_wave():
    scenario = actuators(*START, sine(**apart(A, 0.0, 0.5)), passive=1).to_dict()
    scenario["balloon"][1]["breakdown"] = {"field": 0.4}
    history = run(load_scenario(scenario))
    assert kinds(history) == ["breakdown"]
    assert history.field[-1, 1] == pytest.approx(0.4, rel=1e-13)
    assert 3.0 < history.time[-1] < 4.0


@pytest.mark.parametrize("phase", [0.0, 0.75])
def test_sealed_at_no_pressure_a_wave_loses_tension_at_once(phase):
    wave = {"mean": 0.0 if phase == 0.0 else 0.1, "amplitude": 0.1, "phase": phase}
    history = run(actuators(sine(a=wave), ambient=1.0))
    assert kinds(history) == ["loss_of_tension"]
    assert history.events[0].time == 0.0


def test_a_failed_leg_keeps_what_it_reached(monkeypatch):
    from simulator.simulation.run import SolverError
    from simulator.solver import flow

    snap, calls = flow.snap, []

    def fail(*arguments):
        calls.append(1)
        if len(calls) > 3:
            raise flow.FlowError("for the test")
        return snap(*arguments)

    monkeypatch.setattr(flow, "snap", fail)
    wave = sine(cycles=3.0, **apart({"mean": 0.25, "amplitude": 0.2}, 0.0, 0.5))
    with pytest.raises(SolverError, match=r"step 3, time 3\.9") as error:
        run(actuators({"inflate": 1.2}, {"ramp": 0.25}, wave, ambient=0.015))
    history = error.value.history
    assert history.outcome is Outcome.FAILED
    assert len(history.events) == 3


# -- what is told ----------------------------------------------------------------------------------------


def test_explain_tells_the_waves():
    text = explain(actuators(*START, sine(cycles=2.5, **apart(A, 0.0, 0.25)), passive=1))
    assert "3 smooth pieces" in text
    assert "θ, the time in periods (driven)" in text
    assert "− 2 φ² λ³ = 0, φ = 0.2 + 0.15 sin 2π(θ + 0.25)" in text
    assert "begins by a jump of the voltage to 0.2, 0.35, as a jump step does" in text
    text = explain(actuators(*START, triangle(cycles=1.0, **apart(SIDES, 0.0, 0.25))))
    assert "voltage (driven)" in text
    assert "4 smooth pieces" in text


def test_waves_by_name_are_what_was_written():
    scenario = actuators(*START, sine(a=A, b={**A, "phase": 0.5}))
    (wave,) = [step.sine for step in scenario.steps if hasattr(step, "sine")]
    assert isinstance(wave, SineByName)
    assert list(wave.balloons) == ["a", "b"]
    assert (wave.balloons["a"].phase, wave.balloons["b"].phase) == (0.0, 0.5)
    assert load_scenario(scenario.to_dict()) == scenario
    other = actuators(*START, sine(a=A, b={**A, "phase": 0.25}))
    assert other != scenario


def test_lines_and_curves_say_which_voltages_move():
    assert VoltageLine((0.0, 0.1), (1.0, 0.0)).moves == (True, False)
