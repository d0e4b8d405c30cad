"""Equations: derivatives against complex steps, the Hessian against the potential, composition."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simulator.model.conditions import conditions, softest_mode, stability
from simulator.model.contents import IdealGas
from simulator.model.coupling import CONSTRAINED, COUPLED
from simulator.model.device import Device
from simulator.model.drive import AffineDrive, SineDrive, VoltageCurve, VoltageLine
from simulator.model.membranes import ElectrodedMembrane, Membrane
from simulator.model.strength import ConstantStrength, PowerStrength
from simulator.scenario import load_scenario

STEP = 1e-30


def device(count: int = 3, electroded: tuple[int, ...] = (0, 2), J_lim: float = 80.0) -> Device:
    balloons = [
        {
            "name": f"b{i}",
            "radius": 1.0 - 0.2 * i,
            "thickness": 0.7 + 0.3 * i,
            "modulus": 1.3 - 0.1 * i,
            "permittivity": 0.8 + 0.2 * i,
            "electrodes": i in electroded,
            "elastomer": {"model": "gent", "J_lim": J_lim},
            **({"breakdown": {"field": 9.0}} if i in electroded else {}),
        }
        for i in range(count)
    ]
    return Device.from_scenario(
        load_scenario(
            {"title": "t", "gas": {"ambient_pressure": 0.3}, "balloon": balloons, "step": [{"inflate": 1.0}]}
        )
    )


def systems():
    three = device()
    line = VoltageLine((0.1, 0.0), (0.5, 1.0))
    return {
        "sealed three": three.sealed(IdealGas(5.0, 0.3), line),
        "sealed pair": device(2, (0,)).sealed(IdealGas(3.0, 0.3), VoltageLine.common(1)),
        "sealed one": device(1, (0,)).sealed(IdealGas(1.0, 0.3), VoltageLine.common(1)),
        "actuated": three.actuated(2, 0.6, line),
        "sealed on a curve": three.sealed(
            IdealGas(5.0, 0.3), VoltageCurve((0.1, 0.2), (0.3, -0.2), (0.1, 0.7))
        ),
        "actuated on a curve": three.actuated(2, 0.6, VoltageCurve((0.1, 0.2), (0.0, 0.4), (0.0, 0.3))),
        "inflated": three.inflated(0, [0.2, 0.1]),
    }


SYSTEMS = systems()
states = st.lists(st.floats(1.01, 5.5), min_size=3, max_size=3)


def state_of(system, stretches, pressure, v):
    count = len(system.walls)
    return [*stretches[:count], pressure, v] if system.has_pressure else [*stretches[:count], v]


def gradient(function, y):
    return np.array(
        [np.imag(function([x + 1j * STEP * (i == j) for i, x in enumerate(y)])) / STEP for j in range(len(y))]
    )


@pytest.mark.parametrize("system", SYSTEMS.values(), ids=SYSTEMS)
@given(stretches=states, pressure=st.floats(0.0, 2.0), v=st.floats(-0.5, 0.5))
def test_jacobian_by_complex_step(system, stretches, pressure, v):
    y = state_of(system, stretches, pressure, v)
    residual, rows = system.linearised(y)
    assert residual == pytest.approx(system.residual(y), abs=1e-12)
    for i, row in enumerate(rows):
        exact = gradient(lambda z, i=i: system.residual(z)[i], y)
        assert row == pytest.approx(exact, rel=1e-10, abs=1e-11)


@pytest.mark.parametrize("system", SYSTEMS.values(), ids=SYSTEMS)
@given(stretches=states, v=st.floats(-0.5, 0.5))
def test_force_is_the_slope_of_the_potential(system, stretches, v):
    """∂Π/∂λᵢ = rᵢ²hᵢkᵢ Rᵢ/Dᵢ at the pressure of the gas law; −∂Π/∂v is the drive's power."""
    pressure = 0.0
    y = state_of(system, stretches, pressure, v)
    if system.has_pressure:
        residual, rows = system.linearised(y)
        y[-2] -= residual[-1] / rows[-1][-2]
    slope = gradient(system.potential, y)
    for i, wall in enumerate(system.walls):
        force = system.residual(y)[i] / wall.elastomer.pole_form(y[i])[1]
        assert slope[i] == pytest.approx(wall.weight * force, rel=1e-9, abs=1e-9)
    assert -slope[-1] == pytest.approx(system.drive_power(y), rel=1e-10, abs=1e-12)


@pytest.mark.parametrize("system", SYSTEMS.values(), ids=SYSTEMS)
@given(stretches=states, v=st.floats(-0.5, 0.5))
def test_stability_is_the_smallest_eigenvalue_and_its_slope_exact(system, stretches, v):
    y = np.array(state_of(system, stretches, 0.7, v))
    margin = stability(system).margin(y.tolist())
    diagonal, squares = system.stiffness(y.tolist())
    arms = np.sqrt(squares)
    assert margin == pytest.approx(np.linalg.eigvalsh(np.diag(diagonal) + np.outer(arms, arms))[0], abs=1e-12)
    slope = stability(system).slope(y)
    for j in range(y.size):
        h = 1e-6
        up, down = y.copy(), y.copy()
        up[j] += h
        down[j] -= h
        difference = (stability(system).margin(up.tolist()) - stability(system).margin(down.tolist())) / (
            2 * h
        )
        assert slope[j] == pytest.approx(difference, rel=2e-5, abs=2e-6)


def test_margins_of_arrays_are_those_of_floats():
    for system in SYSTEMS.values():
        count = len(system.walls)
        y = np.array([state_of(system, [x, x + 0.3, x + 0.8], 0.5, 0.1) for x in (1.1, 2.0, 3.0)]).T
        for condition in conditions(system, [PowerStrength(9.0, 0.4)] * count):
            each = [condition.margin(column.tolist()) for column in y.T]
            assert np.asarray(condition.margin(y)) == pytest.approx(each, rel=1e-12, abs=1e-13)


def test_softest_mode_is_an_eigenvector():
    system = SYSTEMS["sealed three"]
    y = np.array([2.0, 1.5, 1.8, 0.4, 0.3])
    mode = softest_mode(system, y)
    diagonal, squares = system.stiffness(y.tolist())
    matrix = np.diag(diagonal) + np.outer(np.sqrt(squares), np.sqrt(squares))
    assert matrix @ mode == pytest.approx(stability(system).margin(y.tolist()) * mode, abs=1e-12)


def test_only_what_moves_has_electrical_terms():
    three = device()
    left_only = three.sealed(IdealGas(1.0, 0.3), VoltageLine((0.0, 0.0), (1.0, 0.0)))
    assert [type(m) for m in left_only.membranes] == [ElectrodedMembrane, Membrane, Membrane]
    held = three.sealed(IdealGas(1.0, 0.3), VoltageLine((0.0, 0.2), (1.0, 0.0)))
    assert [m.drive for m in held.membranes] == [AffineDrive(0.0, 1.0), None, AffineDrive(0.2, 0.0)]
    assert type(three.inflated(0, [0.0, 0.0]).membrane) is Membrane
    waves = three.sealed(IdealGas(1.0, 0.3), VoltageCurve((0.0, 0.2), (0.3, 0.0), (0.0, 0.0)))
    assert [m.drive for m in waves.membranes] == [SineDrive(0.0, 0.3, 0.0), None, AffineDrive(0.2, 0.0)]
    rest = three.sealed(IdealGas(1.0, 0.3), VoltageCurve((0.0, 0.2), (0.0, 0.1), (0.0, 0.0)))
    assert [m.drive for m in rest.membranes] == [None, None, SineDrive(0.2, 0.1, 0.0)]


def test_a_step_along_a_curve_is_no_longer_than_an_eighth_of_a_period():
    three = device()
    curve = VoltageCurve((0.1, 0.2), (0.3, 0.0), (0.0, 0.0))
    assert (
        three.sealed(IdealGas(1.0, 0.3), curve).longest_step
        == three.actuated(0, 0.5, curve).longest_step
        == 0.125
    )
    assert three.sealed(IdealGas(1.0, 0.3), VoltageLine.common(2)).longest_step == np.inf
    tiny = three.sealed(IdealGas(1.0, 0.3), VoltageCurve((0.1, 0.2), (1e-9, 0.0), (0.0, 0.0)))
    assert tiny.scales[-1] == 1.0


def test_conditions_are_those_that_apply():
    three = device()
    nine = ConstantStrength(9.0)
    strengths = [nine, None, None]
    line = VoltageLine.common(2)
    assert [c.kind for c in conditions(three.sealed(IdealGas(1.0, 0.3), line), strengths)] == [
        "limit_point",
        "loss_of_tension",
        "breakdown",
    ]
    assert [c.kind for c in conditions(three.inflated(0, [0.0, 0.0]), [nine])] == ["limit_point"]
    assert [c.kind for c in conditions(three.actuated(0, 0.5, line), [nine])] == ["limit_point", "breakdown"]


@given(
    st.integers(1, 4).flatmap(
        lambda n: st.tuples(
            st.lists(st.floats(-3, 3), min_size=n, max_size=n),
            st.lists(st.floats(0, 3), min_size=n, max_size=n),
        )
    ),
    st.floats(0, 3),
)
def test_smallest_eigenvalue(parts, coupling):
    diagonal, arms = (np.array(part) for part in parts)
    exact = np.linalg.eigvalsh(np.diag(diagonal) + coupling * np.outer(arms, arms))
    squares = (coupling * arms**2).tolist()
    for place, value in enumerate(exact):
        assert COUPLED.eigenvalue(diagonal.tolist(), squares, place) == pytest.approx(value, abs=1e-11)
    rows = [np.array([x, x]) for x in diagonal], [np.array([x, x]) for x in squares]
    assert COUPLED.eigenvalue(*rows, 0) == pytest.approx([exact[0]] * 2, abs=1e-11)


@pytest.mark.parametrize(
    ("diagonal", "squares"),
    [([-1.0, -8.4e-88, -1.0, -1.0], [0.0, 1.0, 0.0, 0.0]), ([-1e-140, -1.0, -2.0], [1.0, 0.5, 0.5])],
)
def test_eigenvalues_beside_a_pole_that_is_all_but_zero(diagonal, squares):
    arms = np.sqrt(squares)
    exact = np.linalg.eigvalsh(np.diag(diagonal) + np.outer(arms, arms))
    found = [COUPLED.eigenvalue(diagonal, squares, place) for place in range(len(diagonal))]
    assert found == pytest.approx(exact, abs=1e-14)


@pytest.mark.parametrize("count", range(2, 13))
@pytest.mark.parametrize("spectrum", [COUPLED, CONSTRAINED], ids=["gas", "liquid"])
def test_eigenvalues_next_to_a_stretch_limit(spectrum, count):
    """Relative accuracy and signs, though some balloons are 1e12 times as stiff as others; 60 digits."""
    random = np.random.default_rng(count)
    with mp.workdps(60):
        for _ in range(10):
            sizes = 10.0 ** random.uniform(-6, 12, count)
            diagonal = sizes * random.choice([-1.0, 1.0, 1.0, 1.0], count)
            squares = 10.0 ** random.uniform(-6, 6, count)
            if count > 3:
                diagonal[1] = diagonal[0]  # two equal balloons
            d, s = [mp.mpf(x) for x in diagonal], [mp.mpf(x) for x in squares]
            arms = mp.matrix([mp.sqrt(x) for x in s])
            if spectrum is COUPLED:
                exact = mp.eigsy(mp.diag(d) + arms * arms.T, eigvals_only=True)
            else:
                basis = mp.eigsy(arms * arms.T)[1][:, : count - 1]  # across the arms
                exact = mp.eigsy(basis.T * mp.diag(d) * basis, eigvals_only=True)
            for place, value in enumerate(sorted(exact)):
                found = spectrum.eigenvalue(diagonal.tolist(), squares.tolist(), place)
                assert found == pytest.approx(float(value), rel=1e-11)


def test_derived_quantities():
    """Volume, field and charge of `physics.md` §1, by hand for one state."""
    three = device()
    stretch, voltage = np.array([[1.5, 2.0, 1.2]]), np.array([[0.3, -0.2]])
    radius, thickness, permittivity = [1.0, 0.8, 0.6], [0.7, 1.0, 1.3], [0.8, 1.0, 1.2]
    assert three.volume(stretch)[0] == pytest.approx(
        sum(r**3 * x**3 / 3 for r, x in zip(radius, stretch[0], strict=True))
    )
    for column, i in enumerate((0, 2)):
        phi, x = voltage[0, column], stretch[0, i]
        assert three.field(stretch, voltage)[0, column] == pytest.approx(phi * x**2 / thickness[i])
        assert three.charge(stretch, voltage)[0, column] == pytest.approx(
            radius[i] ** 2 * permittivity[i] / thickness[i] * phi * x**4
        )


@given(
    stretches=states,
    pressure=st.floats(0.1, 2.0),
    voltages=st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)),
)
def test_energy_and_stability_columns(stretches, pressure, voltages):
    """The energy is Π, the stability the smallest eigenvalue of its Hessian, by finite differences of Π."""
    three = device()
    stretch, voltage = np.array([stretches]), np.array([voltages])
    gas = (pressure + three.ambient) * three.volume(stretch)
    for is_open in (False, True):
        flags = np.array([is_open])

        def potential(x, flags=flags):
            return three.energy(x[None], np.array([pressure]), voltage, gas, flags)[0]

        h = 1e-4
        hessian = np.empty((3, 3))
        for i in range(3):
            for j in range(3):
                corners = []
                for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
                    x = stretch[0].copy()
                    x[i] += a * h
                    x[j] += b * h
                    corners.append(potential(x))
                hessian[i, j] = (corners[0] - corners[1] - corners[2] + corners[3]) / (4 * h * h)
        found = three.stability(stretch, np.array([pressure]), voltage, flags)[0]
        assert found == pytest.approx(np.linalg.eigvalsh(hessian)[0], rel=1e-4, abs=1e-3)
