"""Strain energies: derivatives against complex steps, and the textbook's peaks."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from simulator.elastomer import Gent, NeoHookean, tension_force, tension_stiffness

STEP = 1e-30
ELASTOMERS = [Gent(100.0), Gent(1.0), Gent(1e6), NeoHookean()]


@pytest.mark.parametrize("elastomer", ELASTOMERS, ids=str)
@given(share=st.floats(0.001, 0.999))
def test_derivatives_are_exact(elastomer, share):
    stretch = 1.0 + share * (min(elastomer.stretch_limit, 50.0) - 1.0)
    energy = elastomer.energy(stretch + 1j * STEP).imag / STEP
    assert tension_force(elastomer, stretch) == pytest.approx(energy, rel=1e-11, abs=1e-13)
    force = tension_force(elastomer, stretch + 1j * STEP).imag / STEP
    assert tension_stiffness(elastomer, stretch) == pytest.approx(force, rel=1e-11)
    for function, slope in zip(
        elastomer.pole_form(stretch + 1j * STEP), elastomer.pole_form_slope(stretch), strict=True
    ):
        assert slope == pytest.approx(np.imag(function) / STEP, rel=1e-12, abs=1e-14)


@pytest.mark.parametrize("elastomer", ELASTOMERS, ids=str)
def test_stress_free_and_of_unit_modulus_at_rest(elastomer):
    assert elastomer.energy(1.0) == 0.0
    assert tension_force(elastomer, 1.0) == 0.0
    # Equal-biaxial stiffness of an incompressible solid of shear modulus 1: ŵ″ = 12.
    assert tension_stiffness(elastomer, 1.0) == pytest.approx(12.0)


def test_functions_take_arrays():
    stretch = np.linspace(1.0, 7.0, 5)
    forces = tension_force(Gent(100.0), stretch)
    assert forces == pytest.approx([tension_force(Gent(100.0), x) for x in stretch.tolist()], rel=1e-15)


@pytest.mark.parametrize(("J_lim", "limit"), [(100.0, 7.1763369123), (1e-3, None), (1.0, None), (1e6, None)])
def test_gent_stretch_limit(J_lim, limit):
    found = Gent(J_lim).stretch_limit
    assert 2 * found**2 + found**-4 - 3 == pytest.approx(J_lim, rel=1e-12)
    assert found > 1.0
    if limit:
        assert found == pytest.approx(limit, abs=5e-11)


def test_neo_hookean_peak():
    # p = f/λ² = 2(λ⁻¹ − λ⁻⁷) has its peak at λ = 7^(1/6).
    def slope(stretch):
        return stretch * tension_stiffness(NeoHookean(), stretch) - 2 * tension_force(NeoHookean(), stretch)

    peak = brentq(slope, 1.1, 2.0, xtol=1e-15)
    assert peak == pytest.approx(7 ** (1 / 6), rel=1e-14)
    assert tension_force(NeoHookean(), peak) / peak**2 == pytest.approx(1.239463, abs=5e-7)


def test_gent_tends_to_neo_hookean():
    assert tension_force(Gent(1e9), 2.0) == pytest.approx(tension_force(NeoHookean(), 2.0), rel=1e-7)
    assert math.isinf(NeoHookean().stretch_limit)
