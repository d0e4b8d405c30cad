"""Sensitivities of limit points: against differences of limit points, and laws that hold exactly."""

from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simulator import load_scenario, simulate
from simulator.analysis.fold import fold
from simulator.analysis.sensitivity import all_sensitivities, sensitivities
from simulator.results.history import EventKind
from simulator.scenario.keys import changed_scenario, number_at, physical_keys
from tests.fuzz import derivatives
from tests.pairs import pair, run, single
from tests.sweeps import FIG3C, FIG5B, balloons

UP = {"ramp": 0.75}


def turns(history):
    return [event for event in history.events if event.kind is EventKind.LIMIT_POINT]


def by_key(scenario, place=0, keys=None):
    history = run(scenario)
    return {one.key: one.derivative for one in sensitivities(history, turns(history)[place], keys)}


def differences(scenario, key):
    """The slopes of the limit points' voltages by histories on both sides, error about h⁴."""
    at = number_at(scenario, key)
    h = 1e-3 * at

    def voltages(i):
        return np.array([e.voltage[0] for e in turns(run(changed_scenario(scenario, key, at + i * h)))])

    return (8.0 * (voltages(1) - voltages(-1)) - (voltages(2) - voltages(-2))) / (12.0 * h)


def difference(scenario, key):
    return differences(scenario, key)[0]


@pytest.mark.parametrize("key", physical_keys(load_scenario(FIG3C)))
def test_every_number_against_histories(key):
    scenario = pair(1.2, {"ramp": 0.4}, {"ramp": 0.0}, ambient=0.015, output={"points": 2})
    slopes = differences(scenario, key)
    history = run(scenario)
    for event, slope in zip(turns(history), slopes, strict=True):
        (found,) = sensitivities(history, event, [key])
        assert found.derivative == pytest.approx(slope, rel=2e-6, abs=1e-10)


def test_against_folds_in_a_second_parameter():
    scenario = load_scenario(FIG5B)
    found = by_key(scenario, 1)
    for key in (
        "gas.ambient_pressure",
        "balloon.active.radius",
        "step.1.inflate",
        "balloon.passive.elastomer.J_lim",
    ):
        at = number_at(scenario, key)
        ends = [fold(scenario, key, at * (1.0 + e)) for e in (1e-4, -1e-4)]
        assert found[key] == pytest.approx(
            (ends[0].voltage[-1] - ends[1].voltage[-1]) / (2e-4 * at), rel=1e-5
        )


@settings(max_examples=10)
@given(
    st.floats(0.3, 1.2), st.floats(0.3, 1.1), st.floats(0.01, 0.2), st.floats(0.6, 1.5), st.floats(0.7, 1.4),
    st.floats(40.0, 150.0),
)  # fmt: skip
def test_what_scales_together_moves_together(radius, load, ambient, stiffness, wall, J_lim):
    """Euler's identities: φ* is homogeneous in moduli and pressures, in radii, in thicknesses."""
    inflate = load * min(1.0 / radius, stiffness) * min(1.0, wall)
    active = {"thickness": wall, "permittivity": 1.7}
    scenario = pair(
        inflate,
        UP,
        ambient=ambient,
        radius=radius,
        J_lim=J_lim,
        active=active,
        passive={"modulus": stiffness},
    )
    history = run(scenario)
    if not turns(history) or turns(history)[0].step != 2:
        return
    found = by_key(scenario)
    at = float(turns(history)[0].voltage[0])

    def share(name):
        return sum(number_at(scenario, k) * v for k, v in found.items() if k.rpartition(".")[2] == name)

    pressures = share("ambient_pressure") + share("inflate")
    size = max(abs(share(name)) for name in ("radius", "modulus", "thickness", "inflate")) + at
    assert share("modulus") + pressures == pytest.approx(0.5 * at, abs=1e-8 * size)
    assert share("radius") - pressures == pytest.approx(0.0, abs=1e-8 * size)
    assert share("thickness") + pressures == pytest.approx(at, abs=1e-8 * size)
    assert share("permittivity") == pytest.approx(-0.5 * at, abs=1e-9 * size)
    assert found["balloon.passive.permittivity"] == 0.0


def test_the_peak_of_an_inflation_moves_as_its_scale():
    history = run(load_scenario(FIG5B))
    found = {one.key: one for one in sensitivities(history, turns(history)[0])}
    assert {one.of for one in found.values()} == {"pressure"}
    peak = 1.2536545513
    assert found["balloon.passive.radius"].value == pytest.approx(peak, abs=1e-10)
    assert found["balloon.passive.radius"].derivative == pytest.approx(-peak, abs=1e-9)
    assert found["balloon.passive.modulus"].derivative == pytest.approx(peak, abs=1e-9)
    for other in ("balloon.active.radius", "gas.ambient_pressure", "step.1.inflate"):
        assert found[other].derivative == 0.0


def test_valve_open():
    scenario = pair(1.1, {"ramp": 0.6, "valve": "open"})
    found = by_key(scenario)
    for key in ("step.1.inflate", "balloon.active.thickness", "balloon.active.elastomer.J_lim"):
        assert found[key] == pytest.approx(difference(scenario, key), rel=1e-6)
    assert found["gas.ambient_pressure"] == found["balloon.passive.radius"] == 0.0


def test_gas_sealed_under_voltage():
    scenario = pair(1.1, {"ramp": 0.2, "valve": "open"}, {"ramp": 0.6}, ambient=0.05)
    found = by_key(scenario)
    for key in (
        "step.1.inflate",
        "balloon.active.permittivity",
        "balloon.passive.radius",
        "gas.ambient_pressure",
    ):
        assert found[key] == pytest.approx(difference(scenario, key), rel=1e-6)


def test_voltages_by_name():
    scenario = pair(
        1.1,
        {"jump": {"passive": 0.1}},
        {"ramp": {"active": 0.6, "passive": 0.25}},
        ambient=0.05,
        passive={"electrodes": True},
    )
    history = run(scenario)
    both = sensitivities(history, turns(history)[0], ["step.1.inflate"])
    assert [one.of for one in both] == ["voltage_active", "voltage_passive"]
    assert both[0].derivative == pytest.approx(difference(scenario, "step.1.inflate"), rel=1e-6)
    assert both[1].derivative == pytest.approx(both[0].derivative * 0.15 / 0.6, rel=1e-12)


def test_a_film_never_inflated():
    """φ* = max √(f/2λ³) whatever its radius: only k, e, h and J act, as φ* ∝ h√(k/e)."""
    scenario = single({"ramp": 0.8, "valve": "open"})
    found = by_key(scenario)
    at = float(turns(run(scenario))[0].voltage[0])
    assert at == pytest.approx(0.6873, abs=3e-3)  # that of a neo-Hookean film, 3^(1/2)/2^(4/3), and J = 100
    assert found["balloon.only.thickness"] == pytest.approx(at, rel=1e-9)
    assert found["balloon.only.modulus"] == pytest.approx(at / 2, rel=1e-9)
    assert found["balloon.only.permittivity"] == pytest.approx(-at / 2, rel=1e-9)
    assert found["balloon.only.radius"] == found["gas.ambient_pressure"] == 0.0


def test_only_limit_points_have_them():
    history = run(pair(1.2, UP))
    with pytest.raises(ValueError, match=r"loss_of_tension at time .*: only a limit point, or a change"):
        sensitivities(history, history.events[0])
    history = run(load_scenario(FIG3C))
    off = replace(turns(history)[0], stretch_before=turns(history)[0].stretch_before * 1.01)
    with pytest.raises(ArithmeticError, match="the state is no limit point"):
        sensitivities(history, off)


def test_run_writes_them_when_asked(tmp_path):
    result = balloons("run", FIG3C, "--sensitivities", "--out", tmp_path)
    assert result.exit_code == 0
    assert "sensitivities.csv" in result.stdout
    with open(tmp_path / "sensitivities.csv", newline="") as stream:
        rows = list(csv.DictReader(stream))
    expected = all_sensitivities(simulate(load_scenario(FIG3C)))
    assert [float(row["derivative"]) for row in rows] == [one.derivative for one in expected]
    assert {row["key"] for row in rows} == set(physical_keys(load_scenario(FIG3C)))
    assert np.isfinite([one.derivative for one in expected]).all()
    assert balloons("run", FIG3C, "--out", tmp_path / "plain").exit_code == 0
    assert not (tmp_path / "plain/sensitivities.csv").exists()


GENT = {"elastomer": {"model": "gent", "J_lim": 100.0}}


def films(*steps):
    """Two films on one gas, inflated first."""
    balloon = [{"name": "one", "electrodes": True, **GENT}]
    balloon += [{"name": "two", "electrodes": True, "radius": 0.9, **GENT}]
    gas = {"ambient_pressure": 0.015}
    return {"title": "films", "gas": gas, "balloon": balloon, "step": [{"inflate": 0.8}, *steps]}


@pytest.mark.parametrize("key", ["balloon.one.thickness", "balloon.one.permittivity", "balloon.two.radius"])
def test_of_films_inflated_with_their_charges(key):
    document = films({"charge": {"one": 1.5, "two": 0.4}}, {"inflate": 2.0})
    history = run(load_scenario(document))
    assert len(turns(history)) == 2
    for event in turns(history):
        (one,) = sensitivities(history, event, [key])
        assert derivatives.moved_to(document, one, history, one.parameter) == pytest.approx(one.value)
        assert derivatives.problem_of(document, one, history) is None
        wrong = replace(one, derivative=one.derivative + 1e-3)
        assert derivatives.problem_of(document, wrong, history) is not None


@pytest.mark.parametrize(
    "steps",
    [
        [{"charge": {"one": 0.1, "two": 0.1}}, {"ramp": 0.6}],
        [{"charge": {"one": 0.1, "two": 0.1}}, {"ramp": {"one": 0.6}}],
        [{"ramp": 0.1}, {"charge": {"one": 0.1}}, {"inflate": 2.0}],
    ],
    ids=["from there", "beside one left alone", "a charge that was a voltage"],
)
def test_not_where_voltages_follow_from_charges(steps):
    history = run(load_scenario(films(*steps)))
    assert all_sensitivities(history) == ()
    with pytest.raises(ValueError, match="a charge before it"):
        sensitivities(history, turns(history)[0])


def test_of_an_exponent_at_a_large_stretch():
    """λ^α at λ = 25 bends so much that differences of fourth order were 14 % off; by the reference."""
    mu, alpha = [630000.0, 1200.0, -10000.0], [1.3, 5.0, -2.0]
    document = {
        "title": "soft film on a large balloon",
        "gas": {"ambient_pressure": 0.001749},
        "balloon": [
            {"name": "b0", "elastomer": {"model": "ogden", "mu": mu, "alpha": alpha}},
            {
                **{"name": "b1", "radius": 0.0742, "thickness": 0.4173, "modulus": 0.7322},
                **{"electrodes": True, "elastomer": {"model": "gent", "J_lim": 19.67}},
            },
        ],
        "step": [{"inflate": 4.605}, {"ramp": 1.585, "valve": "open"}, {"ramp": -0.1415}],
    }
    history = run(load_scenario(document))
    (one,) = sensitivities(history, turns(history)[-1], ["balloon.b0.elastomer.alpha.2"])
    slopes = [
        (derivatives.moved_to(document, one, history, 5.0 + h) or 0.0)
        - (derivatives.moved_to(document, one, history, 5.0 - h) or 0.0)
        for h in (1e-3, 2e-3)
    ]
    exact = (8.0 * slopes[0] - slopes[1]) / 12e-3
    assert one.derivative == pytest.approx(exact, rel=1e-3)
