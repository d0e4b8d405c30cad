"""Flows that end on their way: how much of the way matters, and the state in which they end."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from simulator.model.contents import IdealGas
from simulator.model.drive import AffineDrive
from simulator.model.elastomers import Gent
from simulator.model.equations import SealedBalloons
from simulator.model.membranes import ElectrodedMembrane, Membrane
from simulator.solver.forgetting import forgotten, jacobians, memory
from tests.pairs import gent_force, kinds, pair, run

AMOUNT, AMBIENT, VOLTAGE = 2.0, 0.3, 0.6


def rates(amount, ambient, voltage):
    """The flow of a pair of Gent balloons as docs/physics.md has it, τ = 1."""

    def of(t, stretch):
        active, passive = stretch
        pressure = 3.0 * amount / (active**3 + passive**3) - ambient
        return [
            -(gent_force(active) - pressure * active**2 - 2 * voltage**2 * active**3),
            -(gent_force(passive) - pressure * passive**2),
        ]

    return of


def equations():
    wall = Membrane.of(Gent(100.0), 1.0, 1.0, 1.0)
    driven = ElectrodedMembrane.of(wall, 1.0, 1.0, 1.0, 1.0, AffineDrive(0.0, 1.0))
    return SealedBalloons((driven, wall), IdealGas(AMOUNT, AMBIENT))


def in_motion(stretches):
    """States of the pair with the pressure that its gas has."""
    pressure = 3.0 * AMOUNT / (stretches**3).sum(axis=0) - AMBIENT
    return np.stack([*stretches, pressure, np.full(pressure.shape, VOLTAGE)])


def test_jacobians_are_those_of_the_flow():
    stretches = np.array([[1.5, 2.5], [1.2, 1.05]])
    of = rates(AMOUNT, AMBIENT, VOLTAGE)
    here, derivatives = jacobians(equations(), in_motion(stretches))
    for k, x in enumerate(stretches.T):
        assert here[k] == pytest.approx(of(0.0, x), rel=1e-12)
        for j in range(2):
            step = 1e-6 * np.eye(2)[j]
            slope = (np.array(of(0.0, x + step)) - np.array(of(0.0, x - step))) / 2e-6
            assert derivatives[k, :, j] == pytest.approx(slope, rel=1e-7)


def test_what_is_off_a_flow_decays_as_it_is_said_to():
    of = rates(AMOUNT, AMBIENT, VOLTAGE)
    start, aside, span = np.array([1.6, 1.3]), 1e-5, 0.35
    times = np.linspace(0.0, span, 400)
    on = solve_ivp(of, (0.0, span), start, method="DOP853", rtol=1e-13, atol=1e-13, t_eval=times).y
    ahead = np.array(of(0.0, on[:, 0]))
    across = np.array([-ahead[1], ahead[0]]) / np.hypot(*ahead)
    off = solve_ivp(of, (0.0, span), start + aside * across, method="DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
    last = np.array(of(0.0, on[:, -1]))
    apart = off - on[:, -1]
    left = abs(apart[0] * last[1] - apart[1] * last[0]) / np.hypot(*last)
    folds = memory(equations(), in_motion(on))
    assert folds[-1] == 0.0
    assert folds[0] == pytest.approx(-np.log(left / aside), rel=0.02)
    assert folds[0] > 2.0


def test_of_a_short_flow_nothing_is_forgotten():
    short = in_motion(np.linspace([1.6, 1.3], [1.7, 1.28], 5).T)
    assert forgotten(equations(), (), short) is None


@pytest.mark.parametrize(("ambient", "step"), [(1.0, {"jump": 0.75}), (0.2, {"ramp": 0.75})])
def test_the_state_without_tension_is_that_of_the_flow(ambient, step):
    # By SciPy, from the state before; off a limit point by a tiny step along its soft mode.
    history = run(pair(0.6, step, ambient=ambient))
    assert kinds(history)[-1] == "loss_of_tension"
    before, end = history.events[0], history.events[-1]
    start = before.stretch_before.copy()
    amount = (before.pressure_before + ambient) * (start**3).sum() / 3.0
    if before.kind.value == "limit_point":
        soft = np.linalg.svd(_derivatives(rates(amount, ambient, end.voltage[0]), start))[2][-1]
        start += 1e-5 * soft * np.sign(soft[0])
    slack = lambda t, x: 3.0 * amount / (x**3).sum() - ambient  # noqa: E731
    slack.terminal = True
    of = rates(amount, ambient, float(end.voltage[0]))
    found = solve_ivp(of, (0.0, 1e9), start, method="LSODA", rtol=1e-12, atol=1e-13, events=slack)
    assert end.stretch_before == pytest.approx(found.y_events[0][0], abs=1e-9)


def _derivatives(of, x):
    steps = 1e-6 * np.eye(2)
    return np.array([(np.array(of(0, x + s)) - np.array(of(0, x - s))) / 2e-6 for s in steps]).T
