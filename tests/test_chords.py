"""Samples and points are so close that no chord shows in print, whatever grid is asked for."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from simulator import load_scenario, simulate, trace
from simulator.results.curve import farthest_shown
from simulator.scenario import ScenarioError
from simulator.scenario.settings import CHORD
from simulator.simulation.chords import needed
from tests.oracle.closed_form import SealedPair, equilibrium_curve, states_on
from tests.pairs import pair

UP, DOWN = {"ramp": 0.4, "over": 1}, {"ramp": 0.0, "over": 1}
WAVE = {"sine": {"mean": 0.2, "amplitude": 0.2, "period": 1, "cycles": 2}}
INSIDE = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, 8) / 8)  # shares of a chord, closer at its ends


def columns(stretch, pressure, voltage):
    """What pictures show of the pair, (n, n_quantities), the voltage first."""
    return np.column_stack([voltage, *stretch.T, pressure, voltage * stretch[:, 0] ** 4])


def off_the_curve(scenario, voltage, stretch, pressure, joined):
    """How far the chords between joined rows are from the closed form's curve, over ranges of quantities."""
    sealed = SealedPair.from_scenario(scenario)
    segments = equilibrium_curve(sealed).segments
    rows = columns(stretch, pressure, voltage)
    spans = np.ptp(rows, axis=0)
    worst, seen = 0.0, 0
    for k in np.flatnonzero(joined & (np.abs(np.diff(voltage)) > 1e-12)).tolist():
        v0, v1 = voltage[k], voltage[k + 1]
        between = v0 + INSIDE * (v1 - v0)
        for segment in segments:
            low, high = sorted(segment.voltages)
            if not low - 1e-9 <= min(v0, v1) <= max(v0, v1) <= high + 1e-9:
                continue
            ends = states_on(sealed, segment, np.clip([v0, v1], low, high))
            if np.abs(ends[:2].T - stretch[k : k + 2]).max() > 1e-6:
                continue
            found = states_on(sealed, segment, np.clip(between, low, high))
            curve = columns(found[:2].T, found[2], between) / spans
            start, end = rows[k] / spans, rows[k + 1] / spans
            for place in range(1, curve.shape[1]):
                plane = [0, place]
                chord, ahead = (end - start)[plane], (curve - start)[:, plane]
                aside = ahead[:, 0] * chord[1] - ahead[:, 1] * chord[0]
                worst = max(worst, float(np.abs(aside).max() / np.hypot(*chord)))
            seen += 1
    return worst, seen


@pytest.mark.parametrize(
    ("radius", "step", "points"), [(1.0, [UP, DOWN], 2), (1.0, [WAVE], 30), (1.6, [UP, DOWN], 2)]
)
def test_chords_of_a_history_are_on_the_curve_of_the_closed_form(radius, step, points):
    scenario = pair(1.2 / radius, *step, ambient=0.015, radius=radius, output={"points": points})
    history = simulate(scenario)
    begun = history.step > 1
    voltage, stretch = history.voltage[begun, 0], history.stretch[begun]
    joined = np.diff(history.branch[begun]) == 0
    worst, seen = off_the_curve(scenario, voltage, stretch, history.pressure[begun], joined)
    assert worst < CHORD
    assert seen > 0.9 * np.count_nonzero(joined)


@pytest.mark.parametrize("radius", [1.0, 1.6])
def test_chords_of_a_path_are_on_the_curve_of_the_closed_form(radius):
    scenario = pair(1.2 / radius, UP, ambient=0.015, radius=radius)
    curve = trace(scenario)
    # In the range that the histories above have; up there the voltage rises without bound.
    kept = curve.stretch[:, 0] < 7.0
    some = np.arange(np.count_nonzero(kept) - 1) % 4 == 0
    worst, seen = off_the_curve(
        scenario, curve.voltage[kept, 0], curve.stretch[kept], curve.pressure[kept], some
    )
    assert worst < CHORD
    assert seen > 0.9 * np.count_nonzero(some)


def test_a_path_of_few_steps_has_points_between_them():
    """A soft pair, whose path the solver follows in steps that would be seen."""
    curve = trace("tests/cases/trace-soft.toml")
    marked = [float(point.voltage[0]) for point in curve.points[:-1]]
    far = farthest_shown(curve.voltage[:, 0], curve.stretch[:, 0], marked, curve.end.kind)
    seen = curve.voltage[:, 0] <= far
    shown = (curve.voltage, curve.stretch, curve.pressure, curve.field, curve.charge)
    rows = np.column_stack([values[seen] for values in shown])
    rows = rows[:, np.ptp(rows, axis=0) > 0.0]
    steps = np.diff(rows / np.ptp(rows, axis=0), axis=0)
    length = np.linalg.norm(steps, axis=1)
    ahead = steps[length > 1e-6] / length[length > 1e-6, None]
    turn = np.linalg.norm(np.diff(ahead, axis=0), axis=1)
    # Chord times turn over eight is how far a circle is from its chord.
    assert np.max(0.5 * (length[length > 1e-6][1:] + length[length > 1e-6][:-1]) * turn / 8.0) < CHORD
    assert np.all(np.diff(curve.arclength) > 0.0)


def test_a_noisy_recording_has_chords_on_the_curve(tmp_path):
    rng = np.random.default_rng(3)
    times = np.arange(40.0)
    voltage = np.abs(0.4 * np.sin(times / 6.0) + 0.01 * rng.normal(size=times.size))
    voltage[0] = 0.0
    path = tmp_path / "noisy.csv"
    rows = zip(times.tolist(), voltage.tolist(), strict=True)
    path.write_text("time,voltage\n" + "\n".join(f"{t!r},{v!r}" for t, v in rows))
    scenario = pair(1.2, {"table": str(path)}, ambient=0.015, output={"points": 1000})
    history = simulate(scenario)
    begun = history.step > 1
    joined = np.diff(history.branch[begun]) == 0
    worst, _ = off_the_curve(
        scenario, history.voltage[begun, 0], history.stretch[begun], history.pressure[begun], joined
    )
    assert worst < CHORD


def test_a_delayed_snap_has_chords_on_its_curve():
    """Over time and over voltage, against five thousand samples."""
    slow = {"ambient": 0.015, "dynamics": {"relaxation_time": 0.002}, "shape": {"on_loss": "ignore"}}
    few, many = (simulate(pair(1.2, UP, DOWN, **slow, output={"points": n})) for n in (2, 5001))
    rows = [np.column_stack([h.time, h.voltage, h.stretch, h.pressure, h.charge]) for h in (few, many)]
    spans = np.ptp(rows[1], axis=0)
    for along in (0, 1):
        for what in range(2, rows[0].shape[1]):
            coarse, fine = (one[:, [along, what]] / spans[[along, what]] for one in rows)
            assert _apart(coarse, few.time, fine, many.time) < CHORD


def _apart(coarse, times, fine, when):
    """How far points of a curve are from a polyline, in the pieces that have their times."""
    piece = np.clip(np.searchsorted(times, when, side="right") - 1, 0, times.size - 2)
    start, chord = coarse[piece], coarse[piece + 1] - coarse[piece]
    ahead = fine - start
    length = np.maximum(np.einsum("ij,ij->i", chord, chord), 1e-30)
    share = np.clip(np.einsum("ij,ij->i", ahead, chord) / length, 0.0, 1.0)
    return float(np.linalg.norm(ahead - share[:, None] * chord, axis=1).max())


def test_how_many_chords_a_circle_needs():
    angle = np.linspace(0.0, 2.0 * np.pi, 2001)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    for chord in (1e-2, 1e-3, 1e-4):
        count = needed(circle, np.ones(2), chord)
        assert count[-1] == pytest.approx(np.pi / np.arccos(1.0 - 0.5 * chord), rel=2e-2)
        assert np.ptp(np.diff(count)) < 1e-6  # evenly


def test_a_coarser_chord_takes_fewer_samples_and_one_takes_none():
    def history(**output):
        return simulate(pair(1.2, UP, DOWN, ambient=0.015, output=output, shape={"on_loss": "ignore"}))

    played = [history(points=11, chord=chord) for chord in (1e-5, 2e-4, 1e-2, 1.0)]
    assert all(len(finer) > len(coarser) for finer, coarser in pairwise(played))
    grid = played[-1]
    assert len(grid) == 11 + 10 + 10 + 2 * len(grid.events)  # three steps and both sides of the events
    assert len(history(every=0.1)) == len(grid)  # a grid of one's own is kept


@pytest.mark.parametrize("chord", [0, 2, "fine"])
def test_a_chord_that_makes_no_sense_is_refused(chord):
    with pytest.raises(ScenarioError, match=r"output\.chord.*a number from 1e-5 to 1"):
        pair(1.2, UP, output={"chord": chord})


def test_samples_between_are_states_of_the_grid_s_curve():
    """Where the grid is finer they change nothing, and rows of the grid stay."""
    scenario = load_scenario("scenarios/fig3c_state_b.toml")
    history = simulate(scenario)
    grid = simulate(scenario.with_values({"output.chord": 1}))
    kept = np.isin(history.time, grid.time)
    assert history.time[kept].tolist() == grid.time.tolist()
    assert np.array_equal(history.stretch[kept], grid.stretch)
    assert history.events == grid.events
