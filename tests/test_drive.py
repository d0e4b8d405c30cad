"""Waveforms: corners, values and the time at which a value is taken."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simulator.model import drive
from simulator.model.drive import VoltageLine

WAVES = {
    "ramp": drive.ramp(0.1, -0.4),
    "sine": drive.sine(0.1, 0.2, 2.0),
    "sine downwards": drive.sine(0.1, -0.2, 1.0),
    "broken sine": drive.sine(0.0, 1.0, 1.6),
    "short sine": drive.sine(0.0, 1.0, 0.1),
    "triangle": drive.triangle(0.0, 0.4, 3.0),
    "broken triangle": drive.triangle(0.4, 0.0, 1.3),
    "table": drive.table(np.array([0.0, 1.0, 1.5, 4.0]), np.array([0.0, 0.3, 0.3, -0.2])),
}


@pytest.mark.parametrize("wave", WAVES.values(), ids=WAVES)
def test_corners_are_the_turning_points(wave):
    assert wave.fractions[0] == 0.0
    assert wave.fractions[-1] == 1.0
    assert np.all(np.diff(wave.fractions) > 0.0)
    assert wave.at(wave.fractions) == pytest.approx(wave.values, abs=1e-15)
    for leg in range(wave.values.size - 1):
        inside = np.linspace(wave.fractions[leg], wave.fractions[leg + 1], 50)
        steps = np.diff(wave.at(inside))
        assert np.all(steps >= -1e-15) or np.all(steps <= 1e-15)


@pytest.mark.parametrize("wave", WAVES.values(), ids=WAVES)
@given(share=st.floats(0.0, 1.0))
def test_when_inverts_at(wave, share):
    for leg in range(wave.values.size - 1):
        v0, v1 = wave.values[leg], wave.values[leg + 1]
        v = v0 + share * (v1 - v0)
        fraction = wave.when(leg, v)
        assert wave.fractions[leg] <= fraction <= wave.fractions[leg + 1]
        assert wave.at(np.array([fraction]))[0] == pytest.approx(v, abs=1e-14)


def test_sine_against_its_formula():
    fractions = np.linspace(0.0, 1.0, 301)
    assert WAVES["sine"].at(fractions) == pytest.approx(0.1 + 0.2 * np.sin(4 * np.pi * fractions), abs=1e-15)
    assert WAVES["sine"].values.tolist() == pytest.approx([0.1, 0.3, -0.1, 0.3, -0.1, 0.1])


def test_triangle_stops_where_a_broken_cycle_ends():
    assert WAVES["broken triangle"].values.tolist() == pytest.approx([0.4, 0.0, 0.4, 0.16])


@given(st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)), min_size=1, max_size=4))
def test_line_passes_through_both_ends(ends):
    start, end = [a for a, _ in ends], [b for _, b in ends]
    line = VoltageLine.through(start, end)
    if start == end:
        assert line.at(line.coordinate(start)).tolist() == start
        return
    for voltages in (start, end):
        assert line.at(line.coordinate(voltages)) == pytest.approx(voltages, abs=1e-14)
    assert max(line.rate, key=abs) == 1.0


def test_what_rounding_leaves_of_a_ramp_is_no_change():
    line = VoltageLine.through((-0.9299999999999999, 1.044), (-0.93, -0.93))
    assert (line.moves, line.offset[0]) == ((False, True), -0.9299999999999999)


def test_line_there_and_back_is_one_line():
    assert VoltageLine.through([0.1, 0.0], [0.1, 0.4]) == VoltageLine.through([0.1, 0.4], [0.1, 0.0])
    assert VoltageLine.through([0.0], [0.4]) == VoltageLine.common(1)
    assert VoltageLine.through([0.2, 0.2], [0.4, 0.4]) == VoltageLine.common(2)
