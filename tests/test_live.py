"""The page of `balloons live` without a browser: numbers, links, and the process that computes."""

from __future__ import annotations

import threading
import time

import pytest

from simulator import Replay, ScenarioError, load_scenario, simulate
from simulator.live import links
from simulator.live.controls import (
    NEW_STEPS,
    check_size,
    corners,
    dimensionless,
    numbers,
    shortest,
    with_kind,
    with_step,
    without_step,
    written,
)
from simulator.live.worker import Answer, Newest, Worker, follow, play

FIG5B = load_scenario("scenarios/fig5b_state_b.toml")
VHB = load_scenario("scenarios/vhb_snap.toml")
TABLE = load_scenario("scenarios/treloar_pair.toml")


def number(scenario, key):
    return next(n for n in numbers(scenario) if n.key == key)


def test_every_number_has_a_field_defaults_too():
    keys = [n.key for n in numbers(FIG5B)]
    assert {"gas.ambient_pressure", "gas.chamber", "balloon.active.elastomer.J_lim", "step.2.over"} <= {*keys}
    assert number(FIG5B, "step.2.ramp").group == "Step 2: ramp"
    assert len(keys) == len({*keys})


def test_units_stay_as_they_are_written():
    volts = number(VHB, "step.2.ramp")
    assert (volts.text, volts.high) == ("5.5 kV", 11.0)
    assert VHB.with_values({"step.2.ramp": written("5 kV")}).to_dict()["step"][1]["ramp"] == "5 kV"


@pytest.mark.parametrize("scenario", [FIG5B, VHB, TABLE], ids=lambda s: s.title[:8])
def test_every_number_lies_on_its_slider_and_is_taken_as_it_is_shown(scenario):
    shown = numbers(scenario)
    assert all(n.low <= n.value <= n.high and 0.0 < n.step < n.high - n.low for n in shown)
    assert scenario.with_values({n.key: written(n.text) for n in shown}).balloons == scenario.balloons


@pytest.mark.parametrize(("value", "text"), [(2.0, "2"), (0.1, "0.1"), (1e-5, "1e-05"), (-3.5, "-3.5")])
def test_numbers_have_no_digits_that_say_nothing(value, text):
    assert shortest(value) == text


@pytest.mark.parametrize("kind", NEW_STEPS)
def test_any_step_is_added_and_removed_again(kind):
    longer = with_step(FIG5B, kind, 5)
    assert next(iter(longer.to_dict()["step"][5])) == kind
    assert without_step(longer, 6) == FIG5B


@pytest.mark.parametrize(
    "key", ["step.2.ramp", "step.1.inflate", "balloon.passive.radius", "gas.ambient_pressure"]
)
def test_a_number_as_it_is_computed_with_whatever_its_unit(key):
    one = number(VHB, key)
    bare = VHB.with_values({key: 0.9 * dimensionless(VHB, key)})
    units = VHB.with_values({key: f"{0.9 * one.value}{one.unit}"})
    assert dimensionless(bare, key) == pytest.approx(dimensionless(units, key), rel=1e-12)


def test_a_step_of_another_kind_keeps_its_voltage_and_time():
    jump = with_kind(VHB, 2, "jump").to_dict()["step"][1]
    assert jump == {"jump": "5.5 kV"}
    over = FIG5B.to_dict()["step"][1]["over"]
    assert with_kind(FIG5B, 2, "charge").to_dict()["step"][1] == {"charge": 0.1, "over": over}
    assert with_kind(with_kind(FIG5B, 4, "ramp"), 4, "jump") == FIG5B


def test_corners_of_the_voltage_are_where_ramps_and_jumps_end():
    found = [(c.voltage_key, c.time_key, c.begins, c.time, c.voltage) for c in corners(FIG5B)]
    assert found == [("step.2.ramp", "step.2.over", 1, 11, 0.2), ("step.4.jump", "", 16, 16, 0)]
    history = simulate(FIG5B)
    for corner in corners(FIG5B):
        assert history.at(corner.time)["voltage_active"] == corner.voltage
    assert corners(load_scenario("scenarios/until_snap.toml")) == []  # a cycle comes first
    assert corners(load_scenario("scenarios/ring.toml")) == []  # not one voltage


def test_the_last_step_stays():
    one = load_scenario({**FIG5B.to_dict(), "step": [{"inflate": 1.0}]})
    with pytest.raises(ScenarioError, match="one or more"):
        without_step(one, 1)


def test_samples_are_bounded():
    check_size(FIG5B)
    with pytest.raises(ScenarioError, match="at most 20,000 are drawn here"):
        check_size(FIG5B.with_values({"output.points": 10_000}))
    cycles = {"cycle": 1_000_000_000, "steps": [{"hold": 1.0}]}
    with pytest.raises(ScenarioError, match="samples"):
        check_size(load_scenario({**FIG5B.to_dict(), "step": [{"inflate": 1.0}, cycles]}))


def test_a_link_says_only_what_was_changed():
    assert links.link(FIG5B, FIG5B) == ""
    changed = FIG5B.with_values({"gas.ambient_pressure": 0.05, "step.2.ramp": 0.3})
    assert links.link(FIG5B, changed) == "?gas.ambient_pressure=0.05&step.2.ramp=0.3"
    assert links.opened_at(FIG5B, "?gas.ambient_pressure=0.05&step.2.ramp=0.3") == changed


def test_a_link_tells_of_units_and_steps():
    volts = VHB.with_values({"step.2.ramp": "5 kV"})
    assert links.opened_at(VHB, links.link(VHB, volts)) == volts
    longer = with_step(FIG5B, "sine", 3)
    assert links.opened_at(FIG5B, links.link(FIG5B, longer)) == longer


@pytest.mark.parametrize(
    "address",
    [
        "?gas.colour=1",
        "?gas.ambient_pressure=-1",
        "?step=nonsense",
        '?step=[{"table":"/etc/passwd"}]',
        '?step=[{"table":{"file":"/etc/passwd"}}]',
        "?balloon.active.elastomer.table=/etc/passwd",
    ],
)
def test_a_link_that_makes_no_sense_or_names_a_file_is_refused(address):
    with pytest.raises(ScenarioError) as error:
        links.opened_at(FIG5B, address)
    assert "cannot be read" not in str(error.value)  # nothing was looked for


def test_text_is_read_but_no_file_that_it_names():
    assert links.from_text(links.to_text(VHB), VHB) == VHB
    assert links.from_text(links.to_text(TABLE), TABLE) == TABLE  # the opened scenario names this one
    with pytest.raises(ScenarioError, match="must be a file that the opened scenario names"):
        links.from_text(links.to_text(TABLE), FIG5B)
    with pytest.raises(ScenarioError, match="must be TOML"):
        links.from_text("title = ", FIG5B)


def test_steps_before_the_one_that_moves_are_not_played_again():
    replay = Replay()
    moved = FIG5B.with_values({"step.4.jump": 0.05})
    assert play(FIG5B, replay) == (simulate(FIG5B), "")
    assert replay.known(moved) == 3
    assert play(moved, replay) == (simulate(moved), "")


def test_the_process_computes_and_is_ended_where_it_takes_too_long():
    worker = Worker()
    try:
        history, failure = worker(play, FIG5B).result
        assert history == simulate(FIG5B)
        assert failure == ""
        many = FIG5B.with_values({"step.3.hold": 1.0}).to_dict()
        many["step"][2] = {"sine": {"mean": 0.1, "amplitude": 0.1, "period": 1, "cycles": 50_000}}
        answer = worker(play, load_scenario(many), 0.2)
        assert answer.failure == "stopped: it takes longer than 0.2 s"
        assert [curve.end.kind for curve in worker(follow, FIG5B).result]  # by another one
    finally:
        worker.close()


def test_the_newest_waits_the_others_are_dropped_and_paths_come_last():
    begun, go_on, all_done = threading.Event(), threading.Event(), threading.Event()
    seen = []

    def compute(function, argument):
        seen.append((function, argument))
        begun.set()
        assert go_on.wait(10)
        return Answer(argument)

    newest = Newest(compute, lambda call: call())
    newest.ask(play, 1, lambda answer: None)
    assert begun.wait(10)
    newest.ask(follow, "path", lambda answer: all_done.set())
    for number in (2, 3, 4):
        newest.ask(play, number, lambda answer: None)
    go_on.set()
    assert all_done.wait(10)
    assert seen == [(play, 1), (play, 4), (follow, "path")]


def test_an_object_for_notebooks_follows_its_numbers():
    inputs = pytest.importorskip("simulator.live.inputs")
    view = load_scenario(FIG5B.to_dict()).live()
    assert view.history == simulate(FIG5B)
    number = next(one for one in view.view.select(inputs.NumberInput) if one.number.key == "step.4.jump")
    number.tell("0.05", False)
    for _ in range(400):
        if view.history.scenario == view.scenario:
            break
        time.sleep(0.05)
    assert view.history == simulate(FIG5B.with_values({"step.4.jump": 0.05}))
    assert simulate(FIG5B).explore().scenario == FIG5B
