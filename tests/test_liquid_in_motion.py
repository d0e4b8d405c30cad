"""Balloons on a liquid in real time: an equation of one unknown, a closed form, the quasi-static limit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from simulator import History, Outcome, load_scenario, simulate

GENT = {"model": "gent", "J_lim": 100.0}
NEO_HOOKEAN = {"model": "neo-hookean"}


def played(steps: list[dict[str, Any]], dynamics: Any, *balloons: dict[str, Any], **more: Any) -> History:
    document = {
        "title": "on a liquid",
        "gas": {"ambient_pressure": 0.0, "law": "liquid"},
        "balloon": list(balloons),
        "step": steps,
        **({"dynamics": dynamics} if dynamics else {}),
        **more,
    }
    return simulate(load_scenario(document))


A, B = (
    {"name": "a", "electrodes": True, "elastomer": GENT},
    {"name": "b", "radius": 1.2, "thickness": 0.9, "modulus": 1.3, "elastomer": GENT},
)
FILLED: list[dict[str, Any]] = [{"inflate": 1.0, "over": 10.0}, {"hold": 20.0, "valve": "open"}]


@pytest.mark.parametrize("viscous", [False, True])
def test_a_pair_moves_as_the_equation_of_one_unknown_says(viscous: bool) -> None:
    """With w = r³λ² dλ/dt of the one, −w of the other, p drops out of the two balances."""
    pace = {"a": 0.05, "b": 0.4}
    history = played(
        [*FILLED, {"ramp": 0.3, "over": 2.0}], {"viscosity" if viscous else "relaxation_time": pace}, A, B
    )
    ramped = history.step == 3
    start = history.stretch[np.flatnonzero(ramped)[0] - 1]
    volume = start[0] ** 3 + 1.2**3 * start[1] ** 3

    def force(x: float) -> float:
        return 200.0 * (x - x**-5) / (100.0 - (2.0 * x**2 + x**-4 - 3.0))

    def other(x: float) -> float:
        return float(np.cbrt((volume - x**3) / 1.2**3))

    def slow(name: str, x: float) -> float:
        return 12.0 * pace[name] / x**2 if viscous else pace[name]

    def rate(t: float, y: Any) -> list[float]:
        x, z, phi = float(y[0]), other(float(y[0])), 0.15 * t
        loads = x**2, 1.2 / 0.9 * z**2
        balances = force(x) - 2.0 * phi**2 * x**3, 1.3 * force(z)
        areas = x**2, 1.2**3 * z**2
        resistance = slow("a", x) / (areas[0] * loads[0]) + slow("b", z) / (areas[1] * loads[1])
        return [(balances[1] / loads[1] - balances[0] / loads[0]) / resistance / areas[0]]

    times = history.time[ramped] - 30.0
    found = solve_ivp(rate, (0.0, 2.0), start[:1], "Radau", times, rtol=1e-10, atol=1e-12)
    assert history.stretch[ramped, 0] == pytest.approx(found.y[0], abs=1e-8)
    assert history.volume[ramped] == pytest.approx(volume / 3.0, rel=1e-10)
    assert history.energy_balance.relative_imbalance < 1e-8


def test_alone_on_a_liquid_a_film_relaxes_at_a_given_stretch() -> None:
    """p λ² = f(λ) + Σ Sⱼ e^(−t/tⱼ), whatever the stretch: the relaxation of a generalised Maxwell solid."""
    branches = [{"modulus": 0.5, "time": 1e3}, {"modulus": 0.8, "time": 5e3}]
    one = {"name": "one", "electrodes": True, "elastomer": NEO_HOOKEAN, "maxwell": branches}
    steps: list[dict[str, Any]] = [{"inflate": 2.4, "over": 1e-3}, {"hold": 1e-4, "valve": "open"}]
    history = played([*steps, {"ramp": 0.0, "over": 1e4}], {"relaxation_time": 1e-6}, one)
    held = history.step == 3
    stretch, time = history.stretch[held, 0], history.time[held] - 0.0011
    assert stretch == pytest.approx(stretch[0], rel=1e-9)
    x = stretch[0]
    assert x > 1.15
    force = 2.0 * (x - x**-5)
    expected = force / x**2 * (1.0 + sum(b["modulus"] * np.exp(-time / b["time"]) for b in branches))
    assert history.pressure[held] == pytest.approx(expected, rel=1e-5)


def test_slow_enough_it_is_the_quasi_static_history() -> None:
    steps = [*FILLED, {"ramp": 0.25, "over": 10.0}]
    still = played(steps, None, A, B)
    errors = []
    for tau in (1e-2, 1e-3, 1e-4):
        history = played(steps, {"relaxation_time": tau}, A, B)
        middle = [found.at(37.0) for found in (history, still)]
        errors.append([abs(middle[0][name] - middle[1][name]) for name in ("stretch_a", "pressure")])
    assert np.diff(np.log10(errors), axis=0) == pytest.approx(-1.0, abs=0.02)


def test_branches_and_resistances_go_with_a_liquid() -> None:
    films = [
        {**A, "maxwell": [{"modulus": 1.0, "time": 2.0}]},
        {**B, "maxwell": {"modulus": 0.4, "time": 1.0}},
    ]
    steps = [*FILLED, {"ramp": 0.25, "over": 10.0}, {"jump": 0.0}, {"hold": 10.0}]
    supply = {"resistance": 0.2}
    history = played(steps, {"relaxation_time": {"a": 1e-2, "b": 0.3}}, *films, supply=supply)
    assert history.energy_balance.relative_imbalance < 1e-8
    assert set(history.energy_balance.dissipated_in) == {"a_1", "b_1", "a_resistance"}
    assert np.ptp(history.volume[history.step > 2]) < 1e-9


def test_a_jump_that_would_take_the_pressure_away_loses_the_tension_before_anything_moves() -> None:
    history = played([*FILLED, {"jump": 2.0}, {"hold": 1.0}], {"relaxation_time": 0.1}, A, B)
    assert history.outcome is Outcome.LOSS_OF_TENSION
    assert history.time[-1] == 30.0
    assert history.voltage[-1, 0] == 0.0
    assert history.pressure[-1] == pytest.approx(1.0)


def test_the_pressure_of_a_liquid_follows_a_jump_at_once() -> None:
    """By −2(e/h²)φ²λ³ in its balance, at the pace of each."""
    history = played([*FILLED, {"jump": 0.2}, {"hold": 50.0}], {"relaxation_time": 0.1}, A, B)
    before, after = np.flatnonzero(history.time == 30.0)[-2:]
    assert np.array_equal(history.stretch[before], history.stretch[after])
    x, z = history.stretch[before]
    mobile = np.array([x**2, 1.2**3 * z**2])
    loads = np.array([x**2, 1.2 / 0.9 * z**2])
    fall = mobile[0] * 2.0 * 0.2**2 * x**3 / (mobile @ loads)
    assert history.pressure[before] - history.pressure[after] == pytest.approx(fall, rel=1e-9)


@pytest.mark.parametrize("supply", [{}, {"supply": {"resistance": 1.0}}])
def test_sealed_without_pressure_tension_is_lost_where_a_voltage_rises(supply: Any) -> None:
    steps: list[dict[str, Any]] = [{"inflate": 0.0}, {"hold": 1.0}, {"ramp": 0.1, "over": 1.0}]
    history = played(steps, {"relaxation_time": 0.1}, A, B, **supply)
    assert history.outcome is Outcome.LOSS_OF_TENSION
    assert history.time[-1] == pytest.approx(2.0, abs=1e-9)
