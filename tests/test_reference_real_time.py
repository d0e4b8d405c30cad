"""The reference for histories in real time, against closed forms and published right values."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import trapezoid
from scipy.linalg import expm

from tests.oracle.general.real_time import play_real_time
from tests.oracle.general.record import Reference

CASES = Path(__file__).parent / "cases"
PEAK = 1.2536545513298676  # of the inflation of a Gent balloon with J = 100


def balloon(**more: Any) -> dict[str, Any]:
    return {"name": "a", "elastomer": {"model": "gent", "J_lim": 100.0}, **more}


def scenario(steps: list[Any], relaxation: float, *balloons: dict[str, Any], ambient: float = 1.0) -> Any:
    return {
        "title": "t",
        "gas": {"ambient_pressure": ambient},
        "balloon": list(balloons) or [balloon(electrodes=True)],
        "step": steps,
        "dynamics": {"relaxation_time": relaxation},
    }


def case(name: str) -> Reference:
    content = tomllib.loads((CASES / f"{name}.toml").read_text())
    for step in content["step"]:
        if "table" in step:
            step["table"] = str(CASES / step["table"])
    return play_real_time(content)


SMALL = 1e-6  # a pressure at which strains are 1e-7


def stretched(time: float, relaxation: float, **more: Any) -> float:
    """λ − 1 a time after a small pressure is put on at once, valve open, over its value at rest."""
    steps: list[Any] = [{"inflate": SMALL, "over": 1e-9 * relaxation}, {"hold": time, "valve": "open"}]
    found = play_real_time(scenario(steps, relaxation, balloon(**more)))
    assert not found.undecided
    assert found.end is not None
    return float(found.end.stretch[0] - 1.0) / (SMALL / 12.0)


@pytest.mark.parametrize("share", [0.3, 1.0, 3.0])
def test_small_strains_relax_exponentially(share: float) -> None:
    relaxation = 0.7
    time = share * relaxation / 12.0
    assert stretched(time, relaxation) == pytest.approx(1.0 - np.exp(-share), rel=1e-5)


@pytest.mark.parametrize("time", [0.05, 1.0, 4.0])
def test_small_strains_with_a_maxwell_branch(time: float) -> None:
    """τu̇ = −12u + p − 12k_v(u − w), ẇ = (u − w)/t_v."""
    relaxation, modulus, lasts = 0.3, 0.8, 2.0
    matrix = np.array(
        [[-12.0 * (1.0 + modulus) / relaxation, 12.0 * modulus / relaxation], [1.0 / lasts, -1.0 / lasts]]
    )
    rest = np.linalg.solve(matrix, [-12.0 / relaxation, 0.0])
    exact = (rest - expm(matrix * time) @ rest)[0]
    found = stretched(time, relaxation, maxwell={"modulus": modulus, "time": lasts})
    assert found == pytest.approx(exact, rel=1e-5)


def test_zener_creep() -> None:
    """Without friction of its own the strain jumps to 1/(1 + k_v) and creeps to 1 in t_v(1 + k_v)."""
    modulus, lasts, time = 0.8, 2.0, 3.0
    found = stretched(time, 1e-6, maxwell={"modulus": modulus, "time": lasts})
    creep = np.exp(-time / (lasts * (1.0 + modulus)))
    assert found == pytest.approx(1.0 - modulus / (1.0 + modulus) * creep, rel=1e-4)


def test_a_limit_point_comes_late_by_the_two_thirds_power_of_the_relaxation_time() -> None:
    times = np.array([1e-3, 1e-4, 1e-5])
    late = []
    for relaxation in times.tolist():
        found = play_real_time(scenario([{"inflate": 1.3, "over": 1.3}], relaxation))
        assert [event.kind for event in found.events] == ["limit_point"]
        late.append(found.events[0].time - PEAK)
    powers = np.diff(np.log(late)) / np.diff(np.log(times))
    assert np.all((powers > 0.6) & (powers < 0.72))
    assert abs(powers[1] - 2.0 / 3.0) < abs(powers[0] - 2.0 / 3.0) < 0.05


def test_the_quasi_static_history_is_the_limit_of_fast_balloons() -> None:
    pair = [balloon(electrodes=True), {**balloon(), "name": "b"}]
    steps: list[Any] = [{"inflate": 1.2, "over": 10.0}, {"ramp": 0.3, "over": 100.0}]
    found = play_real_time(scenario(steps, 1e-5, *pair, ambient=0.015))
    assert not found.events
    assert found.end is not None
    # The closed form of the sealed pair: the passive stretch gives pressure, active stretch and voltage.
    passive = float(found.end.stretch[1])
    room = 1.0 - (2.0 * passive**2 + passive**-4 - 3.0) / 100.0
    pressure = 2.0 * (passive - passive**-5) / room / passive**2
    gas = 1.215 * 2.0 * 1.2625778856**3
    active = (gas / (pressure + 0.015) - passive**3) ** (1.0 / 3.0)
    room = 1.0 - (2.0 * active**2 + active**-4 - 3.0) / 100.0
    square = (2.0 * (active - active**-5) / room - pressure * active**2) / (2.0 * active**3)
    assert found.end.stretch[0] == pytest.approx(active, rel=1e-5)
    assert np.sqrt(square) == pytest.approx(0.3, rel=1e-5)


def test_a_ramp_after_rest() -> None:
    found = case("dynamics-ramp-after-rest")
    assert not found.undecided
    assert found.outcome == "completed"
    assert found.end is not None
    assert found.end.stretch[0] == pytest.approx(6.6621186, abs=1e-7)
    assert found.end.pressure == pytest.approx(0.9102074, abs=1e-7)


def test_a_jump_beyond_the_strength_breaks_the_film_at_once() -> None:
    found = case("dynamics-jump-beyond-strength")
    assert found.outcome == "breakdown"
    (event,) = found.events
    assert (event.time, event.step) == (1.0, 2)
    assert event.before.voltage[0] * event.before.stretch[0] ** 2 == pytest.approx(0.569, abs=1e-3)


def test_a_limit_point_is_where_the_potential_loses_its_minimum() -> None:
    (event,) = case("dynamics-limit-point-late").events
    assert event.kind == "limit_point"
    assert event.time == pytest.approx(1.658694, abs=1e-6)


@pytest.mark.parametrize(
    "name", ["dynamics-sample-beside-corner", "dynamics-row-at-sample", "dynamics-steep-edge"]
)
def test_corners_of_any_kind_are_passed(name: str) -> None:
    found = case(name)
    assert not found.undecided
    assert found.outcome == "completed"
    assert len(found.step_ends) == 2


def test_tension_is_lost_where_a_gas_without_pressure_is_sealed() -> None:
    found = play_real_time(scenario([{"inflate": 0.0}, {"hold": 1.0}, {"ramp": 0.1}], 0.1))
    assert [(event.kind, event.step, event.time) for event in found.events] == [("loss_of_tension", 3, 2.0)]


def test_heat_is_what_the_supply_did_and_nothing_stored() -> None:
    """Inflated and deflated: all of the work became heat."""
    steps: list[Any] = [
        {"inflate": 1.0, "over": 0.5},
        {"inflate": 0.0, "over": 0.5},
        {"hold": 50.0, "valve": "open"},
    ]
    found = play_real_time(scenario(steps, 1.0))
    times = np.linspace(0.0, 1.0, 2001)[1:]
    sampled = play_real_time(scenario(steps[:2], 1.0), (times, np.where(times <= 0.5, 1, 2)))
    assert sampled.samples is not None
    stretch = np.concatenate([[1.0], sampled.samples[:, 0]])
    pressure = np.interp(np.concatenate([[0.0], times]), [0.0, 0.5, 1.0], [0.0, 1.0, 0.0])
    # ∫p dV by parts, as the pressure is known exactly: V over 4πR³ is λ³/3.
    work = -trapezoid(stretch**3 / 3.0 * np.gradient(pressure, 1.0 / 2000), dx=1.0 / 2000)
    assert found.dissipated == pytest.approx(work, rel=2e-3)
