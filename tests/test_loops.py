"""Loops of a history: against the closed form of the pair, and against the energy books of the run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from simulator import loops, simulate, unload
from simulator.cli import app
from simulator.hysteresis.loops import turning_points
from tests.oracle.closed_form import SealedPair, reference_history
from tests.pairs import pair, run

SCENARIOS = Path(__file__).parent.parent / "scenarios"


def ramps(*voltages: float) -> list[dict[str, float]]:
    return [{"ramp": v} for v in voltages]


@pytest.mark.parametrize(
    ("name", "width", "closed"),
    [("fig3c_state_b", 0.36044087 - 0.27029133, True), ("fig5b_state_b", None, False)],
)
def test_a_loop_has_the_thresholds_and_the_area_of_the_closed_form(name, width, closed):
    history = simulate(SCENARIOS / f"{name}.toml")
    (loop, *_) = loops(history)
    exact = reference_history(SealedPair.from_scenario(history.scenario), [loop.peak, 0.0])
    assert [one.voltage for one in (*loop.up, *loop.down)] == pytest.approx(
        [event.voltage for event in exact.events], rel=1e-12
    )
    snaps = (*loop.up, *loop.down)
    assert sum(one.dissipated for one in snaps) == pytest.approx(
        sum(event.dissipated for event in exact.events), rel=1e-9
    )
    assert loop.up[0].balloons == ("active",)
    assert loop.closed is closed
    if width is not None:
        assert loop.width == pytest.approx(width, abs=1e-8)
        assert loop.area == pytest.approx(40.830526, abs=1e-6)
    else:
        assert np.isnan(loop.width)
        assert loop.stretch[0] == pytest.approx(6.02643177, abs=1e-8)
        assert loop.pressure == pytest.approx(2.18594438, abs=1e-8)


@pytest.mark.parametrize("valve", ["closed", "open"])
def test_the_area_is_what_the_books_of_the_run_have_of_the_work(valve):
    steps = [{"ramp": v, "valve": valve} for v in (0.16, 0.0)]
    history = run(pair(2.4, *steps, radius=0.5))
    (loop,) = loops(history)
    assert loop.area == pytest.approx(history.energy_balance.electrical_work, rel=1e-8)
    assert loop.closed is False
    (found,) = unload(pair(2.4, *steps, radius=0.5), [0.16]).area
    assert loop.area == pytest.approx(found, rel=1e-8)


def test_losses_are_the_area_of_every_closed_loop():
    history = run(pair(1.2, *ramps(0.55, 0.0, 0.6, 0.3, 0.5, 0.3, 0.0), radius=0.5, ambient=0.05))
    found = loops(history)
    assert [(one.low, one.peak, one.back) for one in found] == [
        (0.0, 0.55, 0.0),
        (0.0, 0.6, 0.3),
        (0.3, 0.5, 0.0),
    ]
    closed = [one for one in found if one.closed]
    assert len(closed) == 1
    for one in closed:
        assert abs(one.area - one.dissipated) <= 1e-8 * one.area
    # At another voltage than it began at, no loop is closed, and none says so.
    assert [one.closed for one in found] == [True, None, None]


def test_actuators_have_a_loop_each():
    document = {
        "gas": {"ambient_pressure": 0.015},
        "balloon": [
            {"name": name, "electrodes": True, "elastomer": {"model": "gent", "J_lim": 100}}
            for name in ("a", "b")
        ],
        "step": [
            {"inflate": 1.2},
            {"ramp": {"a": 0.2}},
            {"ramp": {"a": 0.0, "b": 0.3}},
            {"ramp": 0.0},
        ],
    }
    found = loops(simulate({"title": "two", **document}))
    assert [(one.balloon, one.peak) for one in found] == [("a", 0.2), ("b", 0.3)]


WAVES = [
    {"sine": {"mean": 0.2, "amplitude": 0.2, "period": 1, "cycles": 3}},
    {"triangle": {"low": 0.0, "high": 0.4, "period": 1, "cycles": 3}},
]


@pytest.mark.parametrize("wave", WAVES)
def test_each_period_of_a_wave_is_a_loop(wave):
    """With the thresholds and the area of ramps, in 40-digit arithmetic 40.830526."""
    history = run(pair(1.2, wave, ambient=0.015, output={"points": 11}))
    found = history.loops
    assert found == loops(history)
    whole = [one for one in found if one.closed and (one.low, one.peak, one.back) == (0.0, 0.4, 0.0)]
    assert len(whole) >= 2
    (ramped,) = loops(run(pair(1.2, *ramps(0.4, 0.0), ambient=0.015)))
    for one in whole:
        assert one.width == pytest.approx(ramped.width, rel=1e-12)
    for one in whole[1:]:  # the first wave sets out by a jump
        assert one.area == pytest.approx(ramped.area, rel=1e-9)
        assert one.area == pytest.approx(one.dissipated, rel=1e-8)
    # Cycles begin where the wave does, loops where the voltage turns; what is lost is the same.
    lost = sum(event.dissipated or 0.0 for event in history.events)
    assert sum(one.dissipated for one in found) == pytest.approx(lost, rel=1e-12)


def test_a_table_has_loops_if_its_rows_are_samples_and_noise_is_none(tmp_path):
    times = np.arange(201.0)
    voltage = 0.2 - 0.2 * np.cos(times / 100.0 * 2.0 * np.pi)
    voltage[1:-1] = np.abs(voltage[1:-1] + 1e-3 * np.sin(37.0 * times[1:-1]))
    path = tmp_path / "table.csv"
    rows = "\n".join(f"{t!r},{v!r}" for t, v in zip(times.tolist(), voltage.tolist(), strict=True))
    path.write_text(f"time,voltage\n{rows}\n")
    history = run(pair(1.2, {"table": str(path)}, ambient=0.015, output={"rows": True}))
    assert [len(one.up) + len(one.down) for one in history.loops] == [2, 2]
    assert all(one.area == pytest.approx(40.830526, rel=2e-3) for one in history.loops)
    assert not loops(run(pair(1.2, {"table": str(path)}, ambient=0.015, output={"points": 50})))


def test_a_voltage_that_changes_its_sign_has_no_loop():
    wave = {"sine": {"mean": 0.0, "amplitude": 0.2, "period": 1, "cycles": 3}}
    assert run(pair(1.2, wave, ambient=0.015)).loops == ()


@pytest.mark.parametrize(
    ("sizes", "found"),
    [
        ([0, 1, 2, 1, 0], [2]),
        ([0, 1, 0.95, 1.2, 0, 0.05, 0, 2], [3, 4]),
        ([2, 1, 0, 1], [2]),
        ([1, 1, 1], []),
        ([], []),
    ],
)
def test_turning_points_are_turns_by_more_than_noise(sizes, found):
    assert turning_points(np.array(sizes, dtype=float), 0.1) == found


def test_a_history_that_ends_on_the_way_says_so():
    history = run(pair(1.2, *ramps(0.1, 0.0, 0.52)))
    (loop,) = loops(history)
    assert (loop.peak, loop.ended, loop.closed) == (0.1, "", True)
    assert history.outcome.value == "loss_of_tension"


SLOW = {"dynamics": {"relaxation_time": 0.05}}


def test_in_motion_the_film_takes_what_the_source_gives():
    wave = {"sine": {"mean": 0.15, "amplitude": 0.15, "period": 1, "cycles": 4}}
    history = run(pair(0.9, wave, ambient=0.015, output={"points": 21}, **SLOW))
    found = history.loops
    assert [one.closed for one in found[1:4]] == [True] * 3  # it has forgotten how it began
    for one in found[1:4]:
        assert one.area == pytest.approx(one.viscous, rel=1e-6)
        assert (one.own_area, one.dissipated) == (one.area, one.viscous)
    # A cycle begins elsewhere on the same way round.
    assert found[2].area == pytest.approx(history.cycles[2].total_work, rel=1e-6)


def test_in_motion_a_ramp_and_its_way_back_have_the_work_of_the_books():
    steps = [{"ramp": v, "over": 1} for v in (0.3, 0.0)]
    history = run(pair(1.2, *steps, ambient=0.015, **SLOW))
    (loop,) = loops(history)
    balance = history.energy_balance
    assert loop.area == pytest.approx(balance.electrical_work, rel=1e-12)
    assert 0.0 < loop.viscous < balance.dissipated  # the inflation has lost something too
    assert loop.closed is False


def test_each_source_has_its_own_area():
    """Against the work over the samples, which are close together."""
    both = {"passive": {"electrodes": True, "radius": 1.1}}
    waves = {
        "active": {"mean": 0.2, "amplitude": 0.2, "phase": 0.0},
        "passive": {"mean": 0.1, "amplitude": 0.1, "phase": 0.2},
    }
    wave = {"sine": {"period": 1, "cycles": 2, **waves}}
    for step in ({"ramp": {"active": 0.4, "passive": 0.2}}, wave):
        history = run(pair(0.9, step, {"ramp": 0.0}, ambient=0.015, output={"points": 2001}, **both))
        jumps = [event.time for event in history.events if event.kind.value == "jump"]
        whole = [one for one in history.loops if one.start not in jumps]  # not the way of a jump by its ends
        assert whole
        for one in whole:
            place = history.electroded.index(one.balloon)
            inside = (history.time >= one.start) & (history.time <= one.end)
            v, q = history.voltage[inside, place], history.charge[inside, place]
            assert one.own_area == pytest.approx(np.trapezoid(v, q), abs=1e-4)
        if "ramp" in step:
            each = {one.balloon: one for one in history.loops}
            assert sum(one.own_area for one in each.values()) == pytest.approx(each["active"].area, abs=1e-9)


def test_the_command_writes_loops_beside_the_history(tmp_path):
    result = CliRunner().invoke(app, ["run", str(SCENARIOS / "vhb_snap.toml"), "--out", str(tmp_path)])
    assert result.exit_code == 0
    header, row = (tmp_path / "loops.csv").read_text().splitlines()
    values = dict(zip(header.split(","), row.split(","), strict=True))
    assert float(values["voltage_up [V]"]) == pytest.approx(4414.67, rel=1e-5)
    assert float(values["width [V]"]) == pytest.approx(4414.67 - 2827.31, rel=1e-4)
    assert values["closed"] == "true"
    CliRunner().invoke(app, ["run", str(SCENARIOS / "fig3a_state_a.toml"), "--out", str(tmp_path)])
    assert not (tmp_path / "loops.csv").exists()
