"""Loops of a history: against the closed form of the pair, and against the energy books of the run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from simulator import loops, simulate, unload
from simulator.cli import app
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


def test_actuators_have_a_loop_each_and_waves_have_none():
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
            {"sine": {"mean": 0.1, "amplitude": 0.1, "cycles": 2, "period": 1}},
        ],
    }
    found = loops(simulate({"title": "two", **document}))
    assert [(one.balloon, one.peak) for one in found] == [("a", 0.2), ("b", 0.3)]


def test_a_history_that_ends_on_the_way_says_so():
    history = run(pair(1.2, *ramps(0.1, 0.0, 0.52)))
    (loop,) = loops(history)
    assert (loop.peak, loop.ended, loop.closed) == (0.1, "", True)
    assert history.outcome.value == "loss_of_tension"


def test_in_motion_area_and_closing_are_not_told():
    history = run(
        pair(1.2, {"ramp": 0.1, "over": 5}, {"ramp": 0.0, "over": 5}, dynamics={"relaxation_time": 0.1})
    )
    (loop,) = loops(history)
    assert np.isnan(loop.area)
    assert loop.closed is None


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
