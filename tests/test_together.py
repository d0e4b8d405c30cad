"""Waves by name, until and strengths together with gases, given charges and units."""

import copy
from pathlib import Path

import numpy as np
import pytest

from simulator import ScenarioError, explain, load_scenario
from simulator.analysis.sensitivity import all_sensitivities, sensitivities
from simulator.cli.summary import summarise_run
from tests import pairs

GENT = {"model": "gent", "J_lim": 100}
SCALES = {"shear_modulus": "45 kPa", "thickness": "0.5 mm", "radius": "20 mm", "permittivity": 4.7}
ACRYLIC = {"law": "power", "field": 2.0, "stretch_exponent": 0.63, "thickness_exponent": -0.25}


def two(*steps, gas=None, a=None, b=None, **more):
    return {
        "title": "two",
        "gas": {"ambient_pressure": 0.5, **(gas or {})},
        "balloon": [
            {"name": "a", "electrodes": True, "elastomer": GENT, **(a or {})},
            {"name": "b", "elastomer": GENT, **(b or {})},
        ],
        "step": [{"inflate": 1.0}, *steps],
        **more,
    }


def run(written):
    return pairs.run(load_scenario(written))


@pytest.mark.parametrize(
    ("until", "quantity"),
    [({"field": 0.9}, "field"), ({"stretch": 1.7}, "stretch"), ({"pressure": 0.6}, "pressure")],
)
def test_a_charge_step_ends_where_a_quantity_takes_a_value(until, quantity):
    """The next step begins with the charge that is there, and the books close."""
    history = run(two({"charge": 5.0, "until": until}, {"charge": 5.2, "over": 2}))
    (stop,) = history.stops
    assert stop.reached
    at = np.flatnonzero(history.step == 2)[-1]
    found = np.atleast_1d(getattr(history, quantity)[at])[0]
    assert found == pytest.approx(until[quantity], rel=1e-12)
    charge, passed = history.charge[at:, 0], history.time[at:] - stop.time
    assert charge == pytest.approx(charge[0] + (5.2 - charge[0]) * passed / 2, rel=1e-11)
    assert history.charge[at, 0] == pytest.approx(5.0 * (stop.time - 1.0), rel=1e-12)
    assert history.charge[-1, 0] == pytest.approx(5.2, rel=1e-12)
    assert history.energy_balance.relative_imbalance < 1e-9


def test_a_film_under_a_given_charge_breaks_at_its_strength():
    weak = two({"charge": 5.0}, a={"breakdown": {**ACRYLIC, "field": 0.5}})
    history = run(weak)
    assert history.outcome == "breakdown"
    stretch = history.stretch[-1, 0]
    assert history.field[-1, 0] == pytest.approx(0.5 * stretch**1.13, rel=1e-12)
    assert history.margin[-1, 0] == pytest.approx(0.0, abs=1e-12)
    assert history.verdicts[0].broke == "path"


@pytest.mark.parametrize("gas", [{"law": "adiabatic"}, {"law": "liquid"}, {"chamber": 3.0}], ids=str)
def test_waves_by_name_on_every_gas(gas):
    """A whole period comes back to where it began; sines in step by name are one sine."""
    wave = {"mean": 0.1, "amplitude": 0.1}
    electrodes = {"electrodes": True}
    apart = {"sine": {"period": 1, "cycles": 2, "a": wave, "b": {**wave, "phase": 0.5}}}
    history = run(two({"ramp": 0.1}, apart, gas=gas, b=electrodes))
    assert not history.events
    start = np.flatnonzero(history.step == 2)[-1]
    assert history.stretch[-1] == pytest.approx(history.stretch[start], abs=1e-9)
    assert history.energy_balance.relative_imbalance < 1e-9
    by_name = {"sine": {"period": 1, "cycles": 2, "a": wave, "b": wave}}
    common = {"sine": {**wave, "period": 1, "cycles": 2}}
    one, other = (run(two({"ramp": 0.1}, step, gas=gas, b=electrodes)) for step in (by_name, common))
    assert one.stretch == pytest.approx(other.stretch, abs=1e-8)


def test_charges_after_waves_begin_with_what_is_there():
    wave = {"sine": {"period": 1, "cycles": 1.25, "a": {"mean": 0.0, "amplitude": 0.2}}}
    history = run(two(wave, {"charge": 0.0}))
    assert not history.events
    first = np.flatnonzero(history.step == 3)[0]
    assert history.voltage[first - 1, 0] == pytest.approx(0.2, abs=1e-12)
    left = 1.0 - (history.time[first] - history.time[first - 1])
    assert history.charge[first] == pytest.approx(left * history.charge[first - 1], rel=1e-11)
    assert history.voltage[-1, 0] == pytest.approx(0.0, abs=1e-12)


def in_units(*steps):
    law = {**ACRYLIC, "field": "50 MV/m"}
    written = two(*steps, a={"breakdown": law}, b={"electrodes": True}, scales=SCALES)
    written["gas"] = {"ambient_pressure": "1 atm"}
    return written


def test_units_in_until_in_waves_by_name_and_in_a_power_law(capsys):
    written = in_units(
        {
            "ramp": {"a": "12 kV"},
            "until": {"field": {"a": "20 MV/m"}, "pressure": "900 Pa", "stretch": {"a": 1.9}},
        },
        {
            "sine": {
                "period": "10 s",
                "cycles": 1,
                "a": {"mean": "1 kV", "amplitude": "500 V"},
                "b": {"mean": 0.01, "amplitude": "1 kV", "phase": 0.5},
            }
        },
        {"triangle": {"period": "2 s", "cycles": 1, "a": {"low": "1 kV", "high": "2 kV"}}},
    )
    before = copy.deepcopy(written)
    scenario = load_scenario(written)
    assert scenario.to_dict() == before
    assert load_scenario(scenario.to_dict()) == scenario
    history = run(scenario)
    assert [stop.reached for stop in history.stops] == ["pressure = 900 Pa"]
    assert scenario.scales is not None
    at = np.flatnonzero(history.step == 2)[-1]
    assert history.pressure[at] * scenario.scales.pressure == pytest.approx(900.0, rel=1e-12)
    assert np.ptp(history.voltage[history.step == 3, 0]) * scenario.scales.voltage == pytest.approx(1e3)
    assert "stretch_a = 1.9 or field_a = 20 MV/m or pressure = 900 Pa" in explain(scenario)
    summarise_run(history, [Path("runs/two/history.csv")])
    told = " ".join(capsys.readouterr().out.split())
    assert f"ended at time {history.stops[0].time:.10g} s by pressure = 900 Pa" in told
    assert "MV/m, strength " in told
    columns = history.to_dataframe().columns
    assert "margin_a" in columns
    assert not any(name.startswith("margin") and "[" in name for name in columns)


@pytest.mark.parametrize(
    ("until", "key", "allowed"),
    [
        ({"field": {"a": "20 kV"}}, "field.a", 'must be an electric field > 0 such as "250 MV/m"'),
        ({"pressure": "9 kV"}, "pressure", 'must be a pressure > 0 such as "2 kPa"'),
        ({"pressure": "0 Pa"}, "pressure", 'must be a pressure > 0 such as "2 kPa"'),
    ],
)
def test_wrong_units_in_until(until, key, allowed):
    with pytest.raises(ScenarioError) as error:
        load_scenario(in_units({"ramp": "1 kV", "until": until}))
    assert [(problem.key, problem.allowed) for problem in error.value.problems] == [
        (f"step.2.until.{key}", allowed)
    ]


def test_units_in_until_need_scales():
    with pytest.raises(
        ScenarioError, match=r"until\.pressure = .* must be a number > 0; a unit needs \[scales\]"
    ):
        load_scenario(two({"ramp": 1, "until": {"pressure": "9 Pa"}}))


def test_explain_tells_of_charges_and_waves_as_they_move():
    text = explain(
        load_scenario(
            two(
                {"charge": 1.0, "until": {"stretch": 1.5}},
                {"sine": {"period": 1, "cycles": 1, "a": {"mean": 0.1, "amplitude": 0.1}}},
            )
        )
    )
    assert "charge (driven)" in text
    assert "q² λ⁻⁵" in text
    assert "until      stretch_a = 1.5" in text
    assert "φ = 0.1 + 0.1 sin 2π(θ + 0)" in text


def in_time(*steps, time=1e-3, **more):
    return two(*steps, dynamics={"relaxation_time": time}, b={"electrodes": True}, **more)


@pytest.mark.parametrize("kind", ["sine", "triangle"])
def test_waves_by_name_in_real_time(kind):
    """In step by name they are one wave; slow ones are nearly in equilibrium; the books close."""
    one = {"mean": 0.1, "amplitude": 0.1} if kind == "sine" else {"low": 0.0, "high": 0.2}
    common = {kind: {**one, "period": 10, "cycles": 1.25}}
    by_name = {kind: {"a": one, "b": one, "period": 10, "cycles": 1.25}}
    apart = {kind: {"a": one, "b": {**one, "phase": 0.3}, "period": 10, "cycles": 1.25}}
    histories = [run(in_time(step, output={"every": 0.5})) for step in (common, by_name, apart)]
    assert not histories[1].events
    for history in histories:
        assert history.outcome == "completed"
        assert history.energy_balance.relative_imbalance < 1e-6
    same, alike, _ = (
        dict(zip(history.time.round(9).tolist(), history.stretch, strict=True)) for history in histories
    )
    shared = same.keys() & alike.keys()
    assert len(shared) > 20
    assert max(np.abs(same[t] - alike[t]).max() for t in shared) < 1e-7
    still = run(two(apart, b={"electrodes": True}, output={"every": 0.5}))
    assert histories[2].stretch[-1] == pytest.approx(still.stretch[-1], abs=1e-4)


def test_a_film_breaks_under_a_power_law_in_real_time():
    weak = in_time({"ramp": 0.5, "over": 10}, a={"breakdown": {**ACRYLIC, "field": 0.3}})
    history = run(weak)
    assert history.outcome == "breakdown"
    assert history.field[-1, 0] == pytest.approx(0.3 * history.stretch[-1, 0] ** 1.13, rel=1e-7)


def test_no_sensitivity_is_told_where_voltages_follow_a_curve_or_an_until():
    low = {"ambient_pressure": 0.015}
    wave = {"sine": {"period": 4, "cycles": 1, "a": {"mean": 0.2, "amplitude": 0.3}}}
    ended = {"ramp": 0.1, "until": {"field": 0.08}}
    straight = two({"ramp": 0.5}, gas=low)
    curve, after = two(wave, gas=low), two(ended, {"ramp": 0.5}, gas=low)
    for written in (straight, curve, after):
        written["step"][0] = {"inflate": 1.2}
    plain, along, late = (run(written) for written in (straight, curve, after))
    assert all_sensitivities(plain)
    for history, reason in ((along, "of sines by name"), (late, "an until before it")):
        event = next(event for event in history.events if event.kind == "limit_point")
        assert all_sensitivities(history) == ()
        with pytest.raises(ValueError, match=reason):
            sensitivities(history, event)


def test_sensitivity_on_a_leg_of_triangles_by_name_is_that_of_a_ramp_along_it():
    low = {"ambient_pressure": 0.015}
    wave = {"triangle": {"period": 4, "cycles": 0.5, "a": {"low": 0.0, "high": 0.5}}}
    ramp, triangle = two({"ramp": 0.5}, gas=low), two(wave, gas=low)
    for written in (ramp, triangle):
        written["step"][0] = {"inflate": 1.2}
    one, other = (
        {s.key: s.derivative for s in all_sensitivities(run(written)) if s.of == "voltage_a"}
        for written in (ramp, triangle)
    )
    shared = [key for key in one if key.startswith(("gas.", "balloon."))]
    assert shared
    assert [other[key] for key in shared] == pytest.approx([one[key] for key in shared], rel=1e-6)
