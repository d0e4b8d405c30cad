"""`until`: steps that end where something is reached, to the last digit, and what comes after them."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simulator.cli.summary import summarise_run
from simulator.results.history import Outcome
from simulator.scenario import load_scenario
from simulator.simulation.explanation import explain
from simulator.solver import newton
from tests.pairs import kinds, pair, run, single

LOW = 0.015  # an ambient pressure at which the pair snaps out and back: Fig. 3c


def ramp(to, until=None, over=10.0, **more):
    return {"ramp": to, "over": over, **({"until": until} if until else {}), **more}


def ends(history):
    return [stop.reached for stop in history.stops]


def last(history, step):
    """Stretches, pressure and voltages of the last sample of a step."""
    at = np.flatnonzero(history.step == step)[-1]
    return np.array([*history.stretch[at], history.pressure[at], *history.voltage[at]])


def actuators(*steps, count=2, ambient=1.0, passive=0, radii=None, **sections):
    gent = {"model": "gent", "J_lim": 100.0}
    names = [*"abcdef"[:count], *"xyz"[:passive]]
    balloons = [
        {
            "name": name,
            "radius": radii[i] if radii else 1.0,
            "electrodes": i < count,
            "elastomer": gent,
        }
        for i, name in enumerate(names)
    ]
    made = {"title": "several", "gas": {"ambient_pressure": ambient}, "balloon": balloons, "step": [*steps]}
    return load_scenario({**made, **sections})


# -- exactly there ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("until", "value"),
    [
        ({"stretch": 1.5}, lambda h: h.stretch[-1, 0] / 1.5),
        ({"stretch": {"passive": 1.2}}, lambda h: h.stretch[-1, 1] / 1.2),
        ({"pressure": 1.0}, lambda h: h.pressure[-1] / 1.0),
        ({"field": 0.5}, lambda h: h.field[-1, 0] / 0.5),
        ({"field": {"active": 0.5}}, lambda h: h.field[-1, 0] / 0.5),
    ],
)
@pytest.mark.parametrize("sign", [1, -1])
def test_a_step_ends_where_a_quantity_takes_its_value(until, value, sign):
    history = run(pair(1.2, ramp(sign * 0.4, until), ambient=LOW))
    assert abs(value(history)) == pytest.approx(1.0, abs=1e-12)
    assert history.outcome is Outcome.COMPLETED
    (stop,) = history.stops
    assert (stop.step, stop.time) == (2, history.time[-1])
    assert stop.time == pytest.approx(1 + 10 * abs(history.voltage[-1, 0]) / 0.4, rel=1e-14)
    whole = run(pair(1.2, ramp(history.voltage[-1, 0]), ambient=LOW))
    assert history.stretch[-1] == pytest.approx(whole.stretch[-1], abs=1e-12)
    assert history.energy_balance.relative_imbalance < 1e-8


@settings(max_examples=20)
@given(stretch=st.floats(1.27, 2.0545), rtol=st.floats(1e-9, 1e-3), points=st.integers(2, 9))
def test_neither_samples_nor_tolerance_matter(stretch, rtol, points):
    history = run(
        pair(
            1.2,
            ramp(0.4, {"stretch": stretch}),
            ambient=LOW,
            solver={"rtol": rtol},
            output={"points": points},
        )
    )
    assert history.stretch[-1, 0] == pytest.approx(stretch, rel=1e-12)
    reference = run(pair(1.2, ramp(0.4, {"stretch": stretch}), ambient=LOW))
    assert history.voltage[-1] == pytest.approx(reference.voltage[-1], abs=1e-12)
    assert np.count_nonzero(history.step == 2) == points - 1


def test_samples_are_spread_over_what_was_played():
    history = run(pair(1.2, ramp(0.4, {"stretch": 1.5}), {"hold": 2}, ambient=LOW, output={"points": 5}))
    (stop,) = history.stops
    assert history.time[5:9] == pytest.approx(1 + np.arange(1, 5) / 4 * (stop.time - 1), rel=1e-14)
    assert history.time[-1] == pytest.approx(stop.time + 2, rel=1e-14)
    every = run(pair(1.2, ramp(0.4, {"stretch": 1.5}), ambient=LOW, output={"every": 1.0}))
    times = every.time[every.step == 2]
    assert times.tolist() == pytest.approx([*np.arange(2.0, 9.0), stop.time])


def test_the_next_step_starts_from_there():
    history = run(pair(1.2, ramp(0.4, {"stretch": 1.5}), {"hold": 1}, ramp(0.0, over=4), ambient=LOW))
    assert last(history, 3) == pytest.approx(last(history, 2), abs=0)
    assert last(history, 4) == pytest.approx(last(history, 1), abs=1e-12)
    assert history.time[-1] == pytest.approx(history.stops[0].time + 5, rel=1e-14)


# -- limit points and snaps ------------------------------------------------------------------------------


def test_a_step_ends_when_the_snap_has_landed():
    history = run(pair(1.2, ramp(0.4, {"event": "limit_point"}), {"hold": 1}, ambient=LOW))
    assert (kinds(history), ends(history)) == (["limit_point"], ["limit_point"])
    (event,) = history.events
    assert event.voltage[0] == pytest.approx(0.36044087, abs=5e-9)
    assert last(history, 2)[:2].tolist() == event.stretch_after.tolist()
    assert history.stops[0].time == event.time
    assert history.stability[-1] > 0.0
    assert np.count_nonzero(history.time == event.time) == 2


def test_from_snap_to_snap():
    history = run(load_scenario("scenarios/until_snap.toml"))
    voltages = [event.voltage[0] for event in history.events]
    assert voltages == pytest.approx([0.36044087, 0.27029133] * 2, abs=5e-9)
    assert ends(history) == ["limit_point"] * 4 + ["stretch_active = 1.8"]
    assert history.stretch[-1, 0] == pytest.approx(1.8, rel=1e-12)
    assert history.energy_balance.relative_imbalance < 1e-8
    # Durations: ramps go on at the pace of a whole ramp.
    first, second = history.stops[0].time - 1.0, history.stops[1].time - history.stops[0].time
    assert first == pytest.approx(10 * voltages[0] / 0.5, rel=1e-12)
    assert second == pytest.approx(10 * (voltages[0] - voltages[1]) / voltages[0], rel=1e-12)


def test_a_value_short_of_the_limit_point_and_at_it():
    fold = run(pair(1.2, ramp(0.4), ambient=LOW)).events[0]
    for short in (1e-3, 1e-6, 1e-9, 0.0):
        value = float(fold.stretch_before[0]) * (1.0 - short)
        history = run(pair(1.2, ramp(0.4, {"stretch": value}), ramp(0.4), ambient=LOW))
        assert last(history, 2)[0] == pytest.approx(value, rel=1e-12)
        assert kinds(history) == ["limit_point"]
        assert history.events[0].step == 3
        back = run(pair(1.2, ramp(0.4, {"stretch": value}), ramp(0.0), ambient=LOW))
        assert kinds(back) == []
        assert last(back, 3) == pytest.approx(last(back, 1), abs=1e-11)


@pytest.mark.parametrize("value", [2.1, 4.0, 6.5])
def test_a_value_that_a_snap_passes_over_ends_the_step_at_its_landing(value):
    history = run(pair(1.2, ramp(0.4, {"stretch": value}), ambient=LOW))
    assert ends(history) == [f"stretch_active = {value:g}"]
    assert kinds(history) == ["limit_point"]
    assert history.stretch[-1, 0] == pytest.approx(6.51514013, abs=5e-9)
    assert history.time[-1] == history.events[0].time


def test_a_value_beyond_the_landing_is_reached_on_the_next_branch():
    history = run(pair(1.2, ramp(0.4, {"stretch": 6.52}), ambient=LOW))
    assert history.stretch[-1, 0] == pytest.approx(6.52, rel=1e-12)
    assert history.voltage[-1, 0] > 0.36044087


def test_whichever_comes_first():
    both = {"event": "limit_point", "stretch": 1.5, "pressure": 0.01}
    assert ends(run(pair(1.2, ramp(0.4, both), ambient=LOW))) == ["stretch_active = 1.5"]
    both["stretch"] = 6.6
    assert ends(run(pair(1.2, ramp(0.4, both), ambient=LOW))) == ["limit_point"]
    assert ends(run(pair(1.2, ramp(0.4, {"stretch": {"active": 1.9, "passive": 1.25}}), ambient=LOW))) == [
        "stretch_passive = 1.25"
    ]


def test_a_snap_that_ends_the_history():
    history = run(pair(1.2, ramp(0.5, {"event": "limit_point"}), {"hold": 1}, ambient=0.2))
    assert history.outcome is Outcome.LOSS_OF_TENSION
    assert ends(history) == ["limit_point"]
    never = run(pair(1.2, ramp(0.5, {"stretch": 6.9}), ambient=0.2))
    assert never.outcome is Outcome.LOSS_OF_TENSION
    assert ends(never) == [None]


# -- not reached, met at the start, passed twice ---------------------------------------------------------


def test_what_is_not_reached_changes_nothing():
    without = run(pair(1.2, ramp(0.4), ramp(0.0), ambient=LOW))
    with_it = run(
        pair(1.2, ramp(0.4, {"stretch": 7.0, "pressure": 3.0, "field": 90.0}), ramp(0.0), ambient=LOW)
    )
    assert ends(with_it) == [None]
    assert with_it.time.tolist() == without.time.tolist()
    assert with_it.stretch.tolist() == without.stretch.tolist()
    assert without.stops == ()


def test_a_value_at_the_start_is_not_reached_but_left():
    """From a value on, a step goes until the value is taken again."""
    up = ramp(0.4, {"stretch": 1.5})
    on = run(pair(1.2, up, ramp(0.35, {"stretch": 1.5}), ambient=LOW))
    assert ends(on) == ["stretch_active = 1.5", None]
    wave = {"mean": 0.0, "amplitude": 0.35, "period": 4, "cycles": 1}
    start = run(pair(1.2, up, ambient=LOW)).voltage[-1, 0]
    around = {**wave, "mean": start, "amplitude": 0.05}
    again = run(pair(1.2, up, {"sine": around, "until": {"stretch": 1.5}}, ambient=LOW))
    assert ends(again) == ["stretch_active = 1.5"] * 2
    assert again.stops[1].time - again.stops[0].time == pytest.approx(2.0, abs=1e-9)
    down = {**around, "amplitude": -0.05}
    below = run(pair(1.2, up, {"sine": down, "until": {"stretch": 1.5}}, ambient=LOW))
    assert below.stops[1].time - below.stops[0].time == pytest.approx(2.0, abs=1e-9)


def swap(until=None, over=10.0):
    """Two equal actuators, one charged while the other is discharged: the pressure is least in the middle."""
    return actuators(
        {"inflate": 1.0},
        {"ramp": {"a": 0.3}},
        {"ramp": {"a": 0.0, "b": 0.3}, "over": over, **({"until": until} if until else {})},
        ambient=1.0,
        passive=1,
        output={"points": 3},
    )


def test_a_quantity_with_an_extremum_on_the_way():
    """Values a hair on either side of the extremum: reached the first time, reached by touching, or not."""
    middle = run(swap())
    rows = np.flatnonzero(middle.step == 3)
    extremum, end = middle.pressure[rows]
    assert middle.voltage[rows[0]] == pytest.approx([0.15, 0.15])
    sense = 1.0 if end > extremum else -1.0
    for part in (0.3, 1e-3, 1e-6, 1e-9):
        history = run(swap({"pressure": extremum + part * (end - extremum)}))
        assert len(history.stops) == 1
        assert history.stops[0].reached
        assert history.pressure[-1] == pytest.approx(extremum + part * (end - extremum), rel=1e-12)
        assert history.voltage[-1, 0] > history.voltage[-1, 1]
    touched = run(swap({"pressure": extremum}))
    assert touched.voltage[-1] == pytest.approx([0.15, 0.15], abs=1e-5)
    assert touched.pressure[-1] == pytest.approx(extremum, rel=1e-12)
    for part in (1e-3, 1e-6, 1e-9):
        assert ends(run(swap({"pressure": extremum - sense * part}))) == [None]


@pytest.mark.parametrize("value", [1.3, 1.5, 1.9])
def test_waves_and_tables_stop_where_a_ramp_does(value, tmp_path):
    until = {"stretch": value}
    reference = run(pair(1.2, ramp(0.36, until), ambient=LOW))
    path = tmp_path / "wave.csv"
    path.write_text("time,voltage\n0,0\n1,0.1\n2,0.05\n4,0.36\n5,0\n")
    waves = {
        "sine": {"mean": 0.0, "amplitude": 0.36, "period": 8, "cycles": 1.6},
        "triangle": {"low": 0.0, "high": 0.36, "period": 8, "cycles": 2.5},
        "table": str(path),
    }
    for kind, wave in waves.items():
        history = run(pair(1.2, {kind: wave, "until": until}, {"hold": 1}, ambient=LOW))
        assert ends(history) == [f"stretch_active = {value:g}"]
        assert last(history, 2) == pytest.approx(last(reference, 2), abs=1e-12)
        v, time = last(history, 2)[-1], history.stops[0].time - 1.0
        expected = {
            "sine": 8 * np.arcsin(v / 0.36) / (2 * np.pi),
            "triangle": 4 * v / 0.36,
            "table": np.interp(v, [0.1, 0.36], [1, 4]) if v < 0.05 else 2 + 2 * (v - 0.05) / 0.31,
        }
        if not (kind == "table" and v < 0.1):
            assert time == pytest.approx(expected[kind], rel=1e-12)


def test_a_wave_that_jumps_over_the_value_at_its_start():
    wave = {"low": 0.3, "high": 0.35, "period": 2, "cycles": 1}
    history = run(pair(1.2, {"triangle": wave, "until": {"stretch": 1.4}}, {"hold": 1}, ambient=LOW))
    assert ends(history) == ["stretch_active = 1.4"]
    assert history.stops[0].time == 1.0
    assert kinds(history) == ["jump"]
    assert history.voltage[-1, 0] == 0.3


def test_a_noisy_table_stops_at_its_first_crossing(tmp_path):
    rng = np.random.default_rng(3)
    voltage = np.clip(np.abs(0.2 + 0.1 * np.cumsum(rng.standard_normal(2000)) / 20), 0.0, 0.35)
    voltage[0] = 0.0
    path = tmp_path / "noise.csv"
    path.write_text("time,voltage\n" + "\n".join(f"{i},{v!r}" for i, v in enumerate(voltage.tolist())))
    threshold = run(pair(1.2, ramp(0.35, {"stretch": 1.5}), ambient=LOW)).voltage[-1, 0]
    first = int(np.argmax(voltage > threshold))
    expected = first - 1 + (threshold - voltage[first - 1]) / (voltage[first] - voltage[first - 1])
    history = run(pair(1.2, {"table": str(path), "until": {"stretch": 1.5}}, ambient=LOW))
    assert history.stops[0].time - 1.0 == pytest.approx(expected, rel=1e-11)


# -- cycles, several balloons, the valve -----------------------------------------------------------------


def test_in_cycles_every_cycle_is_like_the_first():
    steps = [ramp(0.4, {"stretch": 5.0}), ramp(0.0, {"pressure": 0.02}), ramp(0.0, {"event": "limit_point"})]
    history = run(pair(1.2, {"cycle": 50, "steps": steps}, ambient=LOW, output={"points": 3}))
    assert ends(history)[:3] == ["stretch_active = 5", "pressure = 0.02", "limit_point"]
    assert ends(history)[3:] == ends(history)[:3] * 49
    assert last(history, 3)[2] == pytest.approx(0.02, rel=1e-12)
    loops = np.array([last(history, step) for step in range(5, 152)]).reshape(49, 3, 4)
    assert np.ptp(loops, axis=0).max() < 1e-11
    assert history.statistics.ida_solves < 12


def test_each_of_several_actuators():
    scenario = actuators(
        {"inflate": 1.0},
        {"ramp": {"a": 0.4, "b": 0.2}, "over": 4, "until": {"stretch": {"b": 1.25}, "field": {"a": 0.5}}},
        {"ramp": {"b": 0.4}, "until": {"field": {"b": 0.4}}},
        passive=1,
    )
    history = run(scenario)
    assert ends(history) == ["field_a = 0.5", "field_b = 0.4"]
    assert history.field[-1, 1] == pytest.approx(0.4, rel=1e-12)
    at = np.flatnonzero(history.step == 2)[-1]
    assert history.field[at, 0] == pytest.approx(0.5, rel=1e-12)
    assert history.voltage[at, 1] == pytest.approx(history.voltage[at, 0] / 2, rel=1e-12)
    assert np.ptp(history.voltage[history.step == 3, 0]) == 0.0


def test_with_the_valve_open_the_first_of_all_balloons_ends_the_step():
    step = {"ramp": 0.6, "valve": "open", "over": 3}
    scenario = actuators({"inflate": 0.6}, {**step, "until": {"stretch": {"a": 1.3, "b": 1.3}}}, {"hold": 1},
                         radii=[1.0, 1.1])  # fmt: skip
    history = run(scenario)
    assert ends(history) == ["stretch_b = 1.3"]
    assert history.stretch[-1, 1] == pytest.approx(1.3, rel=1e-12)
    voltage = float(history.voltage[-1, 0])
    alone = run(actuators({"inflate": 0.6}, {**step, "ramp": voltage}, radii=[1.0, 1.1]))
    assert history.stretch[-1] == pytest.approx(alone.stretch[-1], abs=1e-12)
    snapped = actuators({"inflate": 0.6}, {**step, "until": {"event": "limit_point"}}, radii=[1.0, 1.1])
    history = run(snapped)
    assert (kinds(history), ends(history)) == (["limit_point"], ["limit_point"])
    event = history.events[0]
    assert event.stretch_before[0] == event.stretch_after[0]
    assert history.time[-1] == event.time


def test_a_balloon_without_a_voltage_of_its_own_is_never_there():
    step = {"ramp": {"a": 0.3}, "valve": "open", "until": {"stretch": {"b": 1.2}, "field": {"b": 0.3}}}
    assert ends(run(actuators({"inflate": 0.6}, step))) == [None]


def test_equal_actuators_beyond_their_branch_point():
    history = run(actuators({"inflate": 1.2}, ramp(0.6, {"stretch": {"a": 1.7}}), {"hold": 1}))
    assert kinds(history) == ["branch_point"]
    assert history.stretch[-1, 0] == pytest.approx(1.7, rel=1e-12)
    assert history.stretch[-1, 1] < 1.5


def test_what_lies_beyond_the_stop_may_fail(monkeypatch):
    """The step is walked to its end first; a failure there is none of a step that ends before."""
    from simulator.solver import flow

    def fail(*_, **__):
        raise flow.FlowError("for the test")

    monkeypatch.setattr(flow, "snap", fail)
    history = run(pair(1.2, ramp(0.4, {"stretch": 1.9}), {"hold": 1}, ambient=LOW))
    assert ends(history) == ["stretch_active = 1.9"]
    radii = [1.0, 1.1]
    until = {"stretch": {"b": 1.3}}
    both = run(actuators({"inflate": 0.6}, {"ramp": 0.6, "valve": "open", "until": until}, radii=radii))
    assert ends(both) == ["stretch_b = 1.3"]


def test_a_state_that_newton_does_not_find_at_once_is_found_by_halving(monkeypatch):
    polish, calls = newton.at_event, []

    def reluctant(equations, condition, guess):
        calls.append(condition.kind)
        if condition.kind.startswith("stretch") and len(calls) < 6:
            raise newton.NotConverged("for the test")
        return polish(equations, condition, guess)

    monkeypatch.setattr(newton, "at_event", reluctant)
    history = run(pair(0.6, ramp(0.4, {"stretch": 1.12}), ambient=LOW))
    assert len(calls) >= 6
    assert history.stretch[-1, 0] == pytest.approx(1.12, rel=1e-12)


# -- what is told ----------------------------------------------------------------------------------------


def test_the_summary_and_run_json_say_how_each_step_ended(tmp_path, capsys):
    history = run(pair(1.2, ramp(0.4, {"stretch": 1.5}), ramp(0.3, {"pressure": 0.5}), ambient=LOW))
    summarise_run(history, history.to_csv(tmp_path))
    told = capsys.readouterr().out
    assert "until    step 2: ended at time 8.248494074 by stretch_active = 1.5\n" in told
    assert "until    step 3: not reached\n" in told
    record = json.loads((tmp_path / "run.json").read_text("utf-8"))
    assert [stop["reached"] for stop in record["until"]] == ["stretch_active = 1.5", None]
    assert record["until"][0]["time"] == history.stops[0].time
    cycles = run(
        pair(1.2, {"cycle": 15, "steps": [ramp(0.3, {"stretch": 1.4}), ramp(0.0, {"stretch": 1.3})]})
    )
    summarise_run(cycles, cycles.to_csv(tmp_path))
    told = capsys.readouterr().out
    assert told.count("until    step") == 20
    assert "… and 10 more, in run.json" in told


def test_explain_names_what_ends_a_step():
    text = explain(
        pair(1.2, ramp(0.4, {"event": "limit_point", "stretch": 3, "field": {"active": 2}}), ramp(0.4))
    )
    assert "until      limit_point or stretch_active = 3 or field_active = 2: the step ends there" in text
    # Where the first ramp ends is not known: the second may have a way to go.
    assert "nothing moves" not in text
    assert "until" not in explain(pair(1.2, ramp(0.4)))


def test_one_balloon_without_a_name():
    history = run(single({"inflate": 0.5}, {"ramp": 0.5, "until": {"stretch": 1.07}}))
    assert ends(history) == ["stretch_only = 1.07"]
