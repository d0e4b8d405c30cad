"""Does the sphere stay a sphere: the finite-element membrane against the closed form of docs/shape.md."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from tests.oracle.shape import closed_form as formulas
from tests.oracle.shape import energies
from tests.oracle.shape.elements import Mesh, film, volume
from tests.oracle.shape.jets import Energy, variables
from tests.oracle.shape.modes import Sphere, eigenvalues
from tests.oracle.shape.pair import Loss, Pair
from tests.oracle.shape.pear import pear
from tests.oracle.shape.torsion import stiffness

# Ogden (1972), kg/cm²; both sides scale them to ½Σmᵢαᵢ = 1.
RUBBER = (6.3, 0.012, -0.1), (1.3, 5.0, -2.0)

# Film as an energy and as formulas, stretch, voltage.
STATES: dict[str, tuple[Any, Any, float, float]] = {
    "O of Fig. 4": (energies.gent(100.0), formulas.Gent(100.0), 2.05451214, 0.36044087),
    "lost, 3c B": (energies.gent(100.0), formulas.Gent(100.0), 1.5763852261248, 0.31406083493709),
    "O′ of Fig. 4": (energies.gent(100.0), formulas.Gent(100.0), 6.51514013, 0.36044087),
    "rubber": (energies.ogden(*RUBBER), formulas.Ogden(*RUBBER), 2.2, 0.0),
    "neo-Hookean": (energies.neo_hookean(), formulas.neo_hookean(), 1.4, 1.05 * (3 * 1.4**-8) ** 0.5),
    "Mooney–Rivlin": (energies.mooney_rivlin(0.8), formulas.mooney_rivlin(0.8), 1.5, 0.3),
}
STIFF = "O′ of Fig. 4"
DEGREES = range(5)
GAS = 0.7  # −dp/dV of what is sealed in


def sphere(state: str, gas: float = 0.0, charge: bool = False) -> Sphere:
    energy, _, stretch, voltage = STATES[state]
    return Sphere(energy, stretch, voltage, gas, charge)


def coefficients(state: str) -> formulas.Coefficients:
    _, elastomer, stretch, voltage = STATES[state]
    return formulas.under_voltage(elastomer.coefficients(stretch), stretch, voltage)


def errors(mesh: Mesh, state: str) -> np.ndarray:
    """Finite elements less closed form, of all eigenvalues of degrees 1 to 4 (degree 0 has no error)."""
    found, film = eigenvalues(mesh, sphere(state), DEGREES), coefficients(state)
    return np.concatenate([found[n] - formulas.eigenvalues(film, n) for n in DEGREES if n])


# -- the two agree -------------------------------------------------------------------------------------


@pytest.mark.parametrize("state", [state for state in STATES if state != STIFF])
def test_finite_elements_converge_to_the_closed_form_at_fourth_order(state):
    coarse, middle, fine = (errors(Mesh(count), state) for count in (20, 40, 80))
    assert np.log2(coarse / middle) == pytest.approx(np.full(8, 4.0), abs=0.05)
    assert np.log2(middle / fine) == pytest.approx(np.full(8, 4.0), abs=0.015)
    assert abs(fine).max() < 2e-5


def test_finite_elements_converge_where_area_is_2400_times_as_stiff_as_the_film_is_taut():
    film = coefficients(STIFF)
    assert film.area / film.tension == pytest.approx(2387, abs=1)
    # The order is between 3 and 4 on these meshes, and differs from mode to mode.
    sizes = [abs(errors(Mesh(count), STIFF)) for count in (40, 80, 160)]
    assert sizes[1].max() < sizes[0].max() / 8
    assert sizes[2].max() < sizes[1].max() / 8
    largest = max(formulas.eigenvalues(film, n)[-1] for n in DEGREES)
    assert sizes[2].max() < 5e-8 * largest


def test_linear_elements_converge_at_second_order():
    coarse, middle, fine = (errors(Mesh(count, degree=1), "O of Fig. 4") for count in (100, 200, 400))
    assert np.log2(coarse / middle) == pytest.approx(np.full(8, 2.0), abs=0.02)
    assert np.log2(middle / fine) == pytest.approx(np.full(8, 2.0), abs=0.01)
    assert abs(fine).max() < 1e-3


def test_state_o_of_fig_4_is_a_sphere_no_longer():
    film, (energy, _, stretch, voltage) = coefficients("O of Fig. 4"), STATES["O of Fig. 4"]
    assert Sphere(energy, stretch, voltage).pressure == pytest.approx(0.48257219, abs=2e-8)
    assert film.margin == pytest.approx(-1.656565, abs=1e-6)
    assert formulas.eigenvalues(film, 1) == pytest.approx([6 * film.area, 0.0], abs=1e-14)
    lowest = [formulas.eigenvalues(film, n)[0] for n in (1, 2, 3)]
    assert lowest == pytest.approx([-2.484848, -1.112664, 1.363132], abs=1e-6)


def test_the_elastomers_of_both_sides_are_the_same():
    for energy, elastomer, stretch, _ in STATES.values():
        film = elastomer.coefficients(stretch)
        jet = energy(*variables(np.array([stretch]), np.array([stretch])))
        (first, _), ((first_first, first_second), _) = jet.gradient[0], jet.hessian[0]
        tension = first / stretch
        expected = (
            tension,
            (first_first + first_second - tension) / 2,
            (first_first - first_second - tension) / 2,
        )
        assert (film.tension, film.area, film.shear) == pytest.approx(expected, rel=1e-13)


def test_the_sphere_is_an_equilibrium_of_the_elements():
    mesh, state = Mesh(40), sphere("O of Fig. 4")
    rest = np.zeros(mesh.free.size)
    energy = energies.under_voltage(state.energy, state.voltage)
    pull = film(mesh, energy, state.stretch, rest).gradient
    push = state.pressure * volume(mesh, state.stretch, rest).gradient
    assert volume(mesh, state.stretch, rest).value == pytest.approx(state.stretch**3 / 3, rel=1e-14)
    assert abs(pull - push).max() < 1e-12


# -- what gas and charge do ----------------------------------------------------------------------------


@pytest.mark.parametrize("state", STATES)
def test_gas_and_charge_hold_the_breathing_mode_alone(state):
    mesh, film, (_, _, stretch, voltage) = Mesh(16), coefficients(state), STATES[state]
    free = eigenvalues(mesh, sphere(state), DEGREES)
    for gas, charge in ((GAS, False), (0.0, True), (GAS, True)):
        held = eigenvalues(mesh, sphere(state, gas, charge), DEGREES)
        stiffness = formulas.held(stretch, voltage, gas, charge)
        assert held[0] == pytest.approx(formulas.eigenvalues(film, 0, stiffness), rel=1e-10, abs=1e-10)
        for n in DEGREES[1:]:
            assert held[n] == pytest.approx(free[n], abs=1e-10 * (1.0 + stiffness))


# -- who loses the sphere ------------------------------------------------------------------------------


def test_without_a_voltage_neo_hookean_mooney_rivlin_and_gent_hold_at_every_stretch():
    stretches = np.linspace(1.0, 30.0, 3000)
    for elastomer in (formulas.neo_hookean(), formulas.mooney_rivlin(0.8), formulas.mooney_rivlin(0.0)):
        assert all(elastomer.coefficients(x).margin > 0 for x in stretches)
    for limit in (0.5, 5.0, 100.0):
        end = brentq(lambda x, J=limit: 2 * x**2 + x**-4 - 3 - J, 1.0, 20.0)
        film = formulas.Gent(limit)
        assert all(film.coefficients(x).margin > 0 for x in np.linspace(1.0, 0.999 * end, 1000))


def test_ogdens_rubber_loses_the_sphere_inside_its_falling_branch():
    def margin(x: float) -> float:
        return formulas.Ogden(*RUBBER).coefficients(x).margin

    ends = brentq(margin, 1.5, 2.0, xtol=1e-13), brentq(margin, 2.2, 3.0, xtol=1e-13)
    assert ends == pytest.approx((1.771879, 2.545318), abs=1e-6)
    assert [margin(x) > 0 for x in (1.2, 2.0, 3.0, 8.0)] == [True, False, True, True]
    mesh = Mesh(40)
    for stretch in ends:
        lowest = eigenvalues(mesh, Sphere(energies.ogden(*RUBBER), stretch), range(1, 2))[1]
        assert lowest == pytest.approx([0.0, 0.0], abs=2e-7)
        # p = 2T/λ still falls there: dp/dλ has the sign of 2K − T.
        film = formulas.Ogden(*RUBBER).coefficients(stretch)
        assert 2 * film.area - film.tension < 0


@pytest.mark.parametrize("stretch", [1.27, 1.6, 2.5])
def test_a_neo_hookean_film_loses_the_sphere_at_a_voltage_of_three_over_the_eighth_power(stretch):
    voltage = (3.0 * stretch**-8) ** 0.5
    at = formulas.under_voltage(formulas.neo_hookean().coefficients(stretch), stretch, voltage)
    assert at.tension > 0  # else, below λ = 4^(1/6), the film is slack before
    assert at.margin == pytest.approx(0.0, abs=1e-14)
    mesh, signs = Mesh(40), []
    for factor in (0.999, 1.001):
        found = eigenvalues(mesh, Sphere(energies.neo_hookean(), stretch, factor * voltage), range(1, 2))[1]
        signs.append(found[np.argmax(abs(found))] > 0)
    assert signs == [True, False]


# -- that the pear comes first -------------------------------------------------------------------------


@pytest.mark.parametrize("state", STATES)
def test_every_other_shape_is_lost_later_while_the_film_is_taut_and_resists_shear(state):
    film = coefficients(state)
    assert film.tension > 0
    assert film.baker_ericksen > 0
    for n in range(2, 40):
        lost = formulas.lost_at(film, n)
        at = formulas.Coefficients(film.tension, lost, film.shear)
        assert lost < 0
        assert formulas.eigenvalues(at, n)[0] == pytest.approx(0.0, abs=1e-9 * n**4)


def test_a_voltage_leaves_the_shear_at_constant_area_alone():
    elastomer = formulas.Gent(100.0)
    bare = elastomer.coefficients(1.7)
    loaded = formulas.under_voltage(bare, 1.7, 0.3)
    assert loaded.baker_ericksen == pytest.approx(bare.baker_ericksen, rel=1e-15)


def shear_stiffness(energy: Energy, stretch: float) -> float:
    """d²w/dε² of the stretches λe^ε, λe^−ε over 4λ²."""
    (strain,) = variables(np.zeros(1))
    up = strain.through(*(np.full(1, x) for x in (stretch, stretch, stretch)))
    down = (-strain).through(*(np.full(1, x) for x in (stretch, stretch, stretch)))
    return float(energy(up, down).hessian[0, 0, 0]) / (4 * stretch**2)


def test_an_ogden_film_can_break_the_condition_while_the_pear_holds():
    moduli, exponents = (0.2, -1.2, -1.4), (2.0, 1.0, -2.0)  # m₂α₂ < 0
    film = formulas.Ogden(moduli, exponents).coefficients(2.0)
    assert film.margin > 0
    assert film.tension > 0
    assert film.baker_ericksen == pytest.approx(-0.0125, abs=1e-12)
    assert shear_stiffness(energies.ogden(moduli, exponents), 2.0) == pytest.approx(-0.0125, abs=1e-12)
    assert shear_stiffness(energies.gent(100.0), 2.0) == pytest.approx(
        formulas.Gent(100.0).coefficients(2.0).baker_ericksen, rel=1e-12
    )


@pytest.mark.parametrize("set_", [RUBBER, ((0.2, -1.2, -1.4), (2.0, 1.0, -2.0))])
@pytest.mark.parametrize("degree", range(1, 5))
def test_shear_within_the_surface_costs_the_tension_and_the_shear_modulus(set_, degree):
    film, stretch, N = formulas.Ogden(*set_).coefficients(2.0), 2.0, degree * (degree + 1)
    found = stiffness(energies.ogden(*set_), stretch, 2 * film.tension / stretch, degree)
    assert found == pytest.approx(film.baker_ericksen * N * (N - 2), rel=1e-4, abs=1e-6)


@pytest.mark.parametrize(
    ("stretch", "value"), [(1.79, 1.1735e-3), (1.81, -1.0508e-3), (2.59, -5.48e-4), (2.62, 7.04e-4)]
)
def test_on_either_side_of_both_zeros_the_energy_has_the_sign_of_the_shear_stiffness(stretch, value):
    set_ = (0.2, -1.2, -1.4), (2.0, 1.0, -2.0)
    film = formulas.Ogden(*set_).coefficients(stretch)
    for degree, N in ((2, 6), (3, 12), (4, 20)):
        found = stiffness(energies.ogden(*set_), stretch, 2 * film.tension / stretch, degree) / (N * (N - 2))
        assert found == pytest.approx(film.baker_ericksen, abs=2e-7)
        assert found == pytest.approx(value, abs=1e-6)


# -- the paper's states --------------------------------------------------------------------------------

PAIRS = {
    "3a A": Pair("1", "1", "0.6"),
    "3a B": Pair("1", "1", "1.2"),
    "3a C": Pair("1", "1", "1.3"),
    "3b A": Pair("1", "0.2", "0.6"),
    "3b B": Pair("1", "0.2", "1.2"),
    "3b C": Pair("1", "0.2", "1.3"),
    "3c A": Pair("1", "0.015", "0.6"),
    "3c B": Pair("1", "0.015", "1.2"),
    "3c C": Pair("1", "0.015", "1.3"),
    "5b A": Pair("0.5", "1", "1.2"),
    "5b B": Pair("0.5", "1", "2.4"),
    "5b C": Pair("0.5", "1", "2.6"),
    "5c A": Pair("0.5", "0.05", "1.2"),
    "5c B": Pair("0.5", "0.05", "2.4"),
    "5c C": Pair("0.5", "0.05", "2.6"),
}
# Pair, which of its losses, φ, λ₁, p, with the voltage rising; then φ″/2 of the pears by their amplitude.
LOST = [
    ("3a A", 0, 0.628545608066, 1.294792588245, 0.202453926591, True, -9.38),
    ("3a B", 0, 0.361083312913, 1.509940865903, 0.840683089165, True, -1.086),
    ("3b A", 0, 0.575169299828, 1.325610046402, 0.364020070286, True, -3.33),
    ("3b B", 0, 0.326498432516, 1.557131577584, 0.886937991401, True, -0.7134),
    ("3c A", 0, 0.559024218846, 1.335731408648, 0.409806662295, True, -2.52),
    ("3c B", 0, 0.314060834937, 1.576385226125, 0.900912095618, True, -0.6182),
    ("3c B", 1, 0.270440045026, 5.035058848981, 0.023015306605, False, 0.0803),
    ("5c A", 0, 0.264089520888, 4.972203411780, 0.114995005037, False, 0.0657),
]


@cache
def losses(pair: str) -> list[Loss]:
    return PAIRS[pair].losses()


def test_number_of_losses_on_stable_parts():
    assert {pair: len(losses(pair)) for pair in PAIRS} == {
        pair: sum(row[0] == pair for row in LOST) for pair in PAIRS
    }


@pytest.mark.parametrize(("pair", "which", "voltage", "stretch", "pressure", "rising", "_"), LOST)
def test_where_the_paper_s_states_lose_the_sphere(pair, which, voltage, stretch, pressure, rising, _):
    loss = losses(pair)[which]
    found = [float(x) for x in (loss.voltage, loss.active, loss.pressure)]
    assert found == pytest.approx([voltage, stretch, pressure], abs=1e-12)
    assert loss.rising is rising
    # The same number by the other closed form, at the radius of the active balloon.
    at = formulas.Gent(100.0).coefficients(found[1])
    assert formulas.under_voltage(at, found[1], found[0]).margin == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(("pair", "which", "voltage", "stretch", "pressure", "rising", "bend"), LOST)
def test_the_pears_leave_towards_voltages_at_which_the_sphere_still_holds(
    pair, which, voltage, stretch, pressure, rising, bend
):
    mesh, loss, amplitudes = Mesh(40), losses(pair)[which], (0.0025, 0.005)
    small, large = (
        (pear(PAIRS[pair], loss, mesh, a).voltage - float(loss.voltage)) / a**2 for a in amplitudes
    )
    assert (4 * small - large) / 3 == pytest.approx(bend, rel=5e-3)
    assert (bend < 0) is rising
