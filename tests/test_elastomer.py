"""Strain energies: derivatives against complex steps, the textbook's peaks, and how one becomes the other."""

from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import dataclass

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from simulator.model.elastomers import (
    ArrudaBoyce,
    Fung,
    Gent,
    GentGent,
    MooneyRivlin,
    NeoHookean,
    Ogden,
    Tabulated,
    Yeoh,
    largest_stretch,
    tension_force,
    tension_stiffness,
)
from simulator.model.elastomers.checks import defect

STEP = 1e-30
TRELOAR = Ogden((6.3e5, 1.2e3, -1.0e4), (1.3, 5.0, -2.0))


def sampled(elastomer, end, rows):
    """A table of an elastomer from stretch 1 to `end`."""
    stretches = np.linspace(1.0, end, rows)
    return Tabulated.through(stretches, tension_force(elastomer, stretches))


FORMULAS = [
    Gent(100.0),
    Gent(1.0),
    Gent(1e6),
    NeoHookean(),
    MooneyRivlin(3e5, 3e4),
    MooneyRivlin(0.0, 2.0),
    TRELOAR,
    Ogden((-2.0,), (-3.5,)),
    ArrudaBoyce(5.0),
    ArrudaBoyce(1.05),
    ArrudaBoyce(1e4),
    Yeoh(2.0, -0.04, 0.001),
    Yeoh(1.0, 0.5, 0.0),
    GentGent(1.0, 0.3, 50.0),
    GentGent(0.4, 2.0, 5.0),
    Fung(0.03),
    Fung(0.1),
]
ELASTOMERS = [*FORMULAS, sampled(Gent(50.0), 4.0, 30)]
NAMES = [str(e) if len(str(e)) < 80 else type(e).__name__ for e in ELASTOMERS]


def farthest(elastomer):
    return min(elastomer.stretch_limit, largest_stretch(elastomer), 50.0)


@pytest.mark.parametrize("elastomer", ELASTOMERS, ids=NAMES)
@given(share=st.floats(0.001, 0.999))
def test_derivatives_are_exact(elastomer, share):
    stretch = 1.0 + share * (farthest(elastomer) - 1.0)
    energy = elastomer.energy(stretch + 1j * STEP).imag / STEP
    assert tension_force(elastomer, stretch) == pytest.approx(energy, rel=1e-11, abs=1e-13)
    force = tension_force(elastomer, stretch + 1j * STEP).imag / STEP
    assert tension_stiffness(elastomer, stretch) == pytest.approx(force, rel=1e-11)
    for function, slope in zip(
        elastomer.pole_form(stretch + 1j * STEP), elastomer.pole_form_slope(stretch), strict=True
    ):
        assert slope == pytest.approx(np.imag(function) / STEP, rel=1e-11, abs=1e-13)


@pytest.mark.parametrize("elastomer", FORMULAS, ids=str)
def test_stress_free_and_of_unit_modulus_at_rest(elastomer):
    assert elastomer.energy(1.0) == 0.0
    assert tension_force(elastomer, 1.0) == 0.0
    # Equal-biaxial stiffness of an incompressible solid of shear modulus 1: ŵ″ = 12.
    assert tension_stiffness(elastomer, 1.0) == pytest.approx(12.0)


@pytest.mark.parametrize("elastomer", ELASTOMERS, ids=NAMES)
def test_functions_take_floats_complex_numbers_and_arrays_alike(elastomer):
    stretch = np.linspace(1.0, 1.0 + 0.95 * (farthest(elastomer) - 1.0), 7)
    for function in (
        elastomer.energy,
        lambda x: tension_force(elastomer, x),
        lambda x: tension_stiffness(elastomer, x),
    ):
        alone = [function(x) for x in stretch.tolist()]
        size = 1e-14 * max(map(abs, alone))
        assert function(stretch) == pytest.approx(alone, rel=1e-13, abs=size)
        assert function(stretch + 0j) == pytest.approx(alone, rel=1e-13, abs=size)
        assert [function(complex(x)).real for x in stretch.tolist()] == pytest.approx(
            alone, rel=1e-13, abs=size
        )
    assert defect(elastomer) is None
    assert len({elastomer, elastomer}) == 1  # equal balloons are found by it


@pytest.mark.parametrize("elastomer", ELASTOMERS, ids=NAMES)
def test_nothing_plausible_comes_of_a_negative_stretch(elastomer):
    # Newton's method may step there; no complex number, no silent real one where there is no power.
    numerator = elastomer.pole_form(-0.5)[0]
    assert isinstance(numerator, float)
    if isinstance(elastomer, Ogden):
        assert math.isnan(numerator)
        assert math.isnan(elastomer.pole_form_slope(-0.5)[0])


@pytest.mark.parametrize(("J_lim", "limit"), [(100.0, 7.1763369123), (1e-3, None), (1.0, None), (1e6, None)])
def test_gent_stretch_limit(J_lim, limit):
    found = Gent(J_lim).stretch_limit
    assert 2 * found**2 + found**-4 - 3 == pytest.approx(J_lim, rel=1e-12)
    assert found > 1.0
    if limit:
        assert found == pytest.approx(limit, abs=5e-11)


# -- balloons --------------------------------------------------------------------------------------------


def turning(elastomer, low, high):
    """Stretch and pressure where p = f/λ² turns round."""

    def slope(stretch):
        return stretch * tension_stiffness(elastomer, stretch) - 2 * tension_force(elastomer, stretch)

    stretch = brentq(slope, low, high, xtol=1e-15)
    return stretch, tension_force(elastomer, stretch) / stretch**2


def test_neo_hookean_peak():
    peak, pressure = turning(NeoHookean(), 1.1, 2.0)
    assert peak == pytest.approx(7 ** (1 / 6), rel=1e-14)
    assert pressure == pytest.approx(1.239463, abs=5e-7)


def test_mooney_rivlin_peak_and_valley():
    # c₁ = 3e5, c₂ = 3e4 Pa, H/R = 0.01: pressures over μH/R, μ = 2(c₁ + c₂).
    unit = 2.0 * (3e5 + 3e4) * 0.01
    peak, pressure = turning(MooneyRivlin(3e5, 3e4), 1.1, 2.0)
    assert (peak, pressure * unit) == (pytest.approx(1.47607, abs=5e-6), pytest.approx(8943.7, abs=0.05))
    valley, pressure = turning(MooneyRivlin(3e5, 3e4), 2.0, 4.0)
    assert (valley, pressure * unit) == (pytest.approx(3.14262, abs=5e-6), pytest.approx(7581.7, abs=0.05))
    # The formula by itself: P = 4(H/R)(λ⁻¹ − λ⁻⁷)(c₁ + c₂λ²).
    assert 4 * 0.01 * (1 / valley - valley**-7) * (3e5 + 3e4 * valley**2) == pytest.approx(pressure * unit)


def test_gent_peak_and_valley():
    assert turning(Gent(50.0), 1.1, 2.0) == pytest.approx((1.41440, 1.269166), abs=5e-6)
    assert turning(Gent(50.0), 2.0, 4.0) == pytest.approx((2.96438, 0.951209), abs=5e-6)


# -- one as a limit or a case of another -----------------------------------------------------------------


def same(one, other, rel):
    stretch = np.linspace(1.0, 6.0, 40)
    for function in (tension_force, tension_stiffness):
        assert function(one, stretch) == pytest.approx(function(other, stretch), rel=rel, abs=1e-14)
    assert one.energy(stretch) == pytest.approx(other.energy(stretch), rel=rel, abs=1e-14)


def test_special_cases():
    same(Ogden((4.2,), (2.0,)), NeoHookean(), 1e-12)
    same(Ogden((2 * 3e5, -2 * 3e4), (2.0, -2.0)), MooneyRivlin(3e5, 3e4), 1e-12)
    same(MooneyRivlin(7.0, 0.0), NeoHookean(), 1e-14)


@pytest.mark.parametrize(("family", "sizes"), [(Gent, (1e4, 1e6)), (ArrudaBoyce, (1e2, 1e3))])
def test_long_chains_are_neo_hookean(family, sizes):
    # Both differ by O(1/J), O(1/λ_L²).
    off = [tension_force(family(size), 3.0) / tension_force(NeoHookean(), 3.0) - 1.0 for size in sizes]
    assert off[0] / off[1] == pytest.approx(1e2, rel=2e-2)
    assert 0.0 < off[1] < 1e-4
    assert math.isinf(NeoHookean().stretch_limit)


def test_the_inverse_langevin_function_is_exact():
    # f over that of neo-Hookean is (β/x)/(β₀/x₀), against 40 digits.
    with mpmath.workdps(40):

        def beta(x):
            return mpmath.findroot(lambda b: mpmath.coth(b) - 1 / b - x, 3 * x / (1 - x * x))

        for lambda_L in (1.02, 2.0, 6.0, 1e3):
            elastomer = ArrudaBoyce(lambda_L)
            for share in (0.01, 0.3, 0.9, 0.999):
                stretch = 1.0 + share * (min(elastomer.stretch_limit, 20.0) - 1.0)
                chain = mpmath.sqrt((2 * mpmath.mpf(stretch) ** 2 + mpmath.mpf(stretch) ** -4) / 3) / lambda_L
                rest = 1 / mpmath.mpf(lambda_L)
                exact = beta(chain) / chain / (beta(rest) / rest)
                stretched = mpmath.mpf(stretch)
                found = tension_force(elastomer, stretch) / (2 * (stretched - stretched**-5))
                # Near the pole the last bit of the stretch itself is much enlarged.
                assert abs(found / exact - 1) < 2e-13 / float(1 - chain)


def test_arruda_boyce_is_smooth_across_its_pole():
    elastomer = ArrudaBoyce(3.0)
    limit = elastomer.stretch_limit
    assert (2 * limit**2 + limit**-4) / 3 == pytest.approx(9.0, rel=1e-14)
    below, at, above = (elastomer.pole_form(limit + d) for d in (-1e-6, 0.0, 1e-6))
    assert at[1] == pytest.approx(0.0, abs=1e-14)
    assert below[1] > 0.0 > above[1]
    slope = elastomer.pole_form_slope(limit)
    for i in (0, 1):
        assert (above[i] - below[i]) / 2e-6 == pytest.approx(slope[i], rel=1e-6)


# -- measured curves -------------------------------------------------------------------------------------


def test_a_table_of_gent_gives_gents_limit_points():
    """Errors fall as h⁵ in the stretch and h⁶ in the pressure, or better."""
    for low, high in ((1.2, 1.8), (2.4, 3.6)):
        exact = np.array(turning(Gent(50.0), low, high))
        errors = np.abs(
            [np.array(turning(sampled(Gent(50.0), 4.5, n), low, high)) - exact for n in (41, 161)]
        )
        orders = np.log(errors[0] / errors[1]) / np.log(4.0)
        assert orders[0] > 3.0  # the coarser table is not yet in the range of its order
        assert orders[1] > 5.0
        assert errors[1] == pytest.approx([0.0, 0.0], abs=1e-9)


def test_a_table_passes_through_its_rows_smoothly():
    stretches = np.array([1.0, 1.1, 1.3, 1.7, 2.1, 2.6, 3.0, 4.0])
    forces = tension_force(NeoHookean(), stretches)
    table = Tabulated.through(stretches, forces)
    assert tension_force(table, stretches) == pytest.approx(forces, rel=1e-14)
    assert (tension_force(table, 1.0), table.energy(1.0)) == (0.0, 0.0)
    assert table.largest_stretch == 4.0
    for knot in stretches[1:-1]:
        sides = [tension_stiffness(table, knot + d + 1j * STEP) for d in (-1e-9, 1e-9)]
        assert sides[0].real == pytest.approx(sides[1].real, rel=1e-7)
        assert sides[0].imag == pytest.approx(sides[1].imag, rel=1e-5)  # f″
    for end, inside in ((1.0, 1.0), (4.0, -1.0)):  # straight on beyond the ends
        slope = tension_stiffness(table, end)
        assert tension_stiffness(table, end - inside) == pytest.approx(slope, rel=1e-12)
        assert tension_force(table, end - inside) == pytest.approx(
            tension_force(table, end) - inside * slope, rel=1e-12
        )


@pytest.mark.parametrize(
    ("stretches", "forces", "message"),
    [
        ([1, 2, 3, 4, 5], [0, 1, 2, 3, 4], "equally many, at least 6"),
        ([1, 2, 3, 4, 5, 6], [0, 1, 2, 3, 4], "equally many, at least 6"),
        ([1, 2, 3, 4, 5, np.nan], [0, 1, 2, 3, 4, 5], "must be finite"),
        ([1.1, 2, 3, 4, 5, 6], [0, 1, 2, 3, 4, 5], "first row must be stretch 1 and force 0, is 1.1 and 0"),
        ([1, 2, 3, 4, 5, 6], [0.1, 1, 2, 3, 4, 5], "first row must be stretch 1 and force 0, is 1 and 0.1"),
        ([1, 2, 3, 3, 5, 6], [0, 1, 2, 3, 4, 5], "stretches must rise"),
        ([1, 2, 3, 4, 5, 6], [0, 1, 2, -3, 4, 5], "forces be > 0"),
        ([1, 2, 3, 4, 5, 6], [0, 9, 0.1, 0.1, 9, 0.1], "falls below 0 near stretch 3.125, smooth it"),
    ],
)
def test_tables_that_make_no_sense(stretches, forces, message):
    with pytest.raises(ValueError, match=message):
        Tabulated.through(stretches, forces)


# -- objects from elsewhere ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Polynomial:
    """W = c₁(I₁ − 3) + c₃(I₁ − 3)³, over 2c₁: ŵ = ½I + ½cI³; the parts to be spoilt by `wrong`."""

    c: float = 0.01
    wrong: str = ""
    stretch_limit: float = float("inf")

    def energy(self, x):
        excess = 2 * x**2 + x**-4 - 3
        return 0.5 * excess + 0.5 * self.c * excess**3 * (1.0 if self.wrong != "energy" else 1.1)

    def pole_form(self, x):
        excess = 2 * x**2 + x**-4 - 3
        force = 2 * (x - x**-5) * (1 + 3 * self.c * excess**2)
        if self.wrong == "rest":
            force = force + 0.1
        if self.wrong == "scalar" and isinstance(x, float):
            force = force * 1.001
        if self.wrong == "arrays":
            force = math.sqrt(force) ** 2
        if self.wrong == "sign":
            return -force, -1.0
        return (force * np.nan if self.wrong == "nan" else force), 1.0

    def pole_form_slope(self, x):
        excess, rise = 2 * x**2 + x**-4 - 3, 4 * (x - x**-5)
        slope = 2 * (1 + 5 * x**-6) * (1 + 3 * self.c * excess**2)
        if self.wrong == "soft":
            return -slope, 0.0
        return slope + (0.0 if self.wrong == "slope" else 12 * self.c * (x - x**-5) * excess * rise), (
            1.0 if self.wrong == "D" else 0.0
        )


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ("", None),
        ("energy", "must have N/D = energy′ in pole_form = (N, D): it is "),
        ("rest", "must have f(1) = 0, is 0.1"),
        ("slope", "must have N′ in pole_form_slope = (N′, D′): it is"),
        ("D", "must have D′ in pole_form_slope = (N′, D′): it is 0 at stretch 1 by a complex step"),
        ("scalar", "must give the same from a float as from an array"),
        ("arrays", "must take floats, complex numbers and arrays of either: TypeError"),
        ("sign", "must have D > 0 below its stretch_limit"),
        ("nan", "must have a finite pole_form"),
        ("soft", "must stiffen from rest, f′(1) > 0, is -12"),
    ],
)
def test_objects_are_held_against_what_is_asked_of_them(wrong, message):
    found = defect(Polynomial(wrong=wrong))
    assert found is None if message is None else message in found


def test_objects_that_are_no_elastomers():
    assert defect(3) == (
        "must have energy, pole_form, pole_form_slope, stretch_limit, "
        "see simulator.model.elastomers.Elastomer"
    )
    assert defect(Polynomial(stretch_limit=0.5)) == "must have a stretch_limit > 1 (inf for none), is 0.5"

    class Unhashable(Polynomial):
        __hash__ = None

    assert defect(Unhashable()) == "must be hashable, as a frozen dataclass is"

    class Torn(Polynomial):
        largest_stretch = 2.0

        def pole_form(self, x):
            numerator, denominator = super().pole_form(x)
            return (math.nan if np.ndim(x) == 0 and x.real > 2.0 else numerator), denominator

    assert "must go on smoothly a little beyond its largest_stretch" in defect(Torn())


def test_elastomers_are_light():
    code = "import simulator.model.elastomers, sys; sys.exit('scipy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


# Peaks and valleys of p = f/λ², by root finding in 40 digits on the strain energies of the literature.
STIFFENING = {
    Fung(0.03): [(1.43340669220694282, 1.28529201673784156), (2.87386227579590195, 1.0425801751841169)],
    Yeoh(2.0, -0.04, 0.001): [
        (1.34321144475062115, 1.19174973578005108),
        (3.33152003850213563, 0.470952861787682037),
    ],
    GentGent(1.0, 0.3, 50.0): [
        (1.39272719078516687, 1.28976900534824905),
        (3.03020238790057962, 0.884891564863445155),
    ],
}


@pytest.mark.parametrize("elastomer", STIFFENING, ids=lambda e: type(e).__name__)
def test_peaks_and_valleys_of_stiffening_elastomers(elastomer):
    for stretch, pressure in STIFFENING[elastomer]:
        slope = brentq(
            lambda x: x * tension_stiffness(elastomer, x) - 2.0 * tension_force(elastomer, x),
            0.98 * stretch,
            1.02 * stretch,
            xtol=1e-15,
        )
        assert slope == pytest.approx(stretch, rel=1e-13)
        assert tension_force(elastomer, stretch) / stretch**2 == pytest.approx(pressure, rel=1e-14)


def test_the_peak_of_a_fung_balloon_vanishes_at_a_stiffening():
    critical, stretch = 0.0668506902341455827, 1.69355139433992817

    def rise(x, b):
        return x * tension_stiffness(Fung(b), x) - 2.0 * tension_force(Fung(b), x)

    assert rise(stretch, critical) == pytest.approx(0.0, abs=1e-13)
    around = np.linspace(1.0, 4.0, 3001)
    assert rise(around, 1.001 * critical).min() > 0.0
    assert rise(around, 0.999 * critical).min() < 0.0


@given(stretch=st.floats(1.0, 6.0))
def test_stiffening_elastomers_have_their_limits(stretch):
    plain = tension_force(NeoHookean(), stretch)
    assert tension_force(Yeoh(3.0, 0.0, 0.0), stretch) == pytest.approx(plain, rel=1e-14)
    assert tension_force(Fung(1e-14), stretch) == pytest.approx(plain, rel=1e-11)
    assert tension_force(GentGent(2.0, 0.0, 80.0), stretch) == pytest.approx(
        tension_force(Gent(80.0), stretch), rel=1e-13
    )
