"""Bands on the loop: where many runs are, against single histories and first-order errors."""

from __future__ import annotations

import csv

import numpy as np
import pytest

from simulator import ScenarioError, load_scenario, simulate
from simulator.sweep.bands import bands, film_spreads, in_parts
from tests.sweeps import FIG3C, balloons

VHB = load_scenario("scenarios/vhb_snap.toml")


def test_a_scenario_in_parts_is_the_same_history():
    parted, numbers = in_parts(VHB, 7)
    assert numbers == [1, *[2] * 7, *[3] * 7]
    whole, parts = simulate(VHB), simulate(parted)
    assert [e.kind for e in parts.mechanical] == [e.kind for e in whole.mechanical]
    for here, there in zip(parts.mechanical, whole.mechanical, strict=True):
        assert here.voltage == pytest.approx(there.voltage, rel=1e-9)
        assert here.time == pytest.approx(there.time, rel=1e-9)
    assert parts.voltage[-1] == 0.0
    assert parts.stretch[-1] == pytest.approx(whole.stretch[-1], rel=1e-9)


def test_numbers_that_hardly_differ_are_all_on_the_history_itself():
    found = bands(FIG3C, {"balloon.active.modulus": 1e-9}, size=32)
    history = simulate(in_parts(load_scenario(FIG3C))[0])
    ends = [np.flatnonzero(history.step == number)[-1] for number in range(1, int(history.step[-1]) + 1)]
    assert found.stretch[:, :, 1] == pytest.approx(history.stretch[ends], rel=1e-6)
    assert found.voltage == pytest.approx(history.voltage[ends], abs=1e-12)
    assert found.runs.tolist() == [32] * len(ends)
    assert found.uncertainty.probabilities["snap_returns"].value == 1.0


def test_a_band_is_as_wide_as_first_order_errors_say():
    key, rel = "balloon.active.permittivity", 0.002
    found = bands(VHB, {key: rel}, size=512)
    row = int(np.flatnonzero((found.step == 2) & (found.snaps == 0))[5])
    ends = []
    for value in (1.0 - rel, 1.0 + rel):
        history = simulate(in_parts(VHB.with_values({key: value}))[0])
        ends.append(history.stretch[history.step == 7][-1, 0])  # the sixth part of the second step
    low, _, high = found.stretch[row, 0]
    assert high - low == pytest.approx(1.959964 * (ends[1] - ends[0]), rel=0.02)
    # Of one film voltage and permittivity enter as eφ²: the limit point is normal, with half the error.
    limit = found.uncertainty.deviations["limit_point_1_voltage_active"]
    assert limit == pytest.approx(0.5 * rel * 4414.67, rel=0.02)


def test_runs_that_have_snapped_are_a_band_of_their_own():
    found = bands(VHB, {"balloon.active.modulus": 0.02}, size=128)
    both = [
        v
        for v in np.unique(found.voltage[found.step == 2])
        if (found.voltage[found.step == 2] == v).sum() == 2
    ]
    assert both
    for voltage in both:
        rows = (found.step == 2) & (found.voltage[:, 0] == voltage)
        assert found.runs[rows].sum() == 128
        closed, opened = found.stretch[rows, 0]
        assert found.snaps[rows].tolist() == [0, 1]
        assert closed[2] < 1.6 < 2.2 < opened[0]


def test_without_a_word_every_film_is_known_to_five_percent():
    assert film_spreads(VHB) == {
        "balloon.active.thickness": 0.05,
        "balloon.active.modulus": 0.05,
        "balloon.active.permittivity": 0.05,
        "balloon.passive.thickness": 0.05,
        "balloon.passive.modulus": 0.05,
    }


def test_the_command_writes_bands_and_draws_them(tmp_path):
    words = ["--uncertainty", "--spread", "balloon.active.modulus=0.001"]
    done = balloons("run", FIG3C, "--out", tmp_path, *words)
    assert done.exit_code == 0, done.output
    with open(tmp_path / "bands.csv", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert list(rows[0])[:5] == ["step", "snaps", "runs", "voltage_active", "stretch_active_0.025"]
    assert (tmp_path / "bands.png").stat().st_size > 10_000
    assert "snap_returns" in (tmp_path / "probabilities.csv").read_text()
    assert balloons("run", FIG3C, "--out", tmp_path, "--quiet").exit_code == 0
    assert not (tmp_path / "bands.csv").exists()


@pytest.mark.parametrize(
    ("spreads", "said"),
    [
        ({"balloon.active.moduls": 0.1}, "no number of the scenario, did you mean balloon.active.modulus"),
        ({"balloon.active.modulus": 0.0}, "must be > 0, of a number that is not 0"),
    ],
)
def test_what_makes_no_sense_is_said(spreads, said):
    with pytest.raises(ScenarioError, match=said):
        bands(VHB, spreads, size=32)


def test_what_is_not_played_in_lockstep_is_refused():
    with pytest.raises(ScenarioError, match="cannot be played in lockstep: real time"):
        bands("scenarios/delayed_snap.toml", size=32)
    assert balloons("run", FIG3C, "--uncertainty", "--spread", "gas").exit_code == 2
