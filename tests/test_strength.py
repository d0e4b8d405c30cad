"""Dielectric strength: the laws, where films break under them, and what is told of those that do not."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simulator.cli.summary import summarise_run
from simulator.model.conditions import intactness
from simulator.model.device import Device
from simulator.model.drive import VoltageLine
from simulator.model.strength import ConstantStrength, PowerStrength
from simulator.results.columns import history_columns
from simulator.results.history import Outcome
from simulator.results.record import run_record
from simulator.scenario import load_scenario
from simulator.simulation.explanation import explain
from tests.oracle.closed_form import SealedPair
from tests.pairs import kinds, pair, run, single

UP = {"ramp": 0.4, "over": 10}
ACRYLIC = {"law": "power", "stretch_exponent": 0.63, "thickness_exponent": -0.25}


def acrylic(field, **more):
    return {"breakdown": {**ACRYLIC, "field": field}, **more}


@given(
    stretch=st.floats(1.0, 7.0),
    thickness=st.floats(0.1, 10.0),
    a=st.floats(-2.0, 2.0),
    b=st.floats(-1.0, 1.0),
)
def test_the_power_law_is_one_of_stretch_and_present_thickness(stretch, thickness, a, b):
    law = PowerStrength.from_thickness(2.0, a, b, thickness)
    present = thickness / stretch**2
    assert law.at(stretch) == pytest.approx(2.0 * stretch**a * present**b, rel=1e-12)


@pytest.mark.parametrize(
    ("stretch", "thickness", "strength"), [(1.0, 1.0, 51.0), (5.0, 1.0, 314.4), (3.0, 0.5, 209.7)]
)
def test_huang_et_al_in_their_own_units(stretch, thickness, strength):
    """51 h^-0.25 λ^0.63 MV/m, h in mm after stretching; μ, ε of docs/scenario-format.md."""
    unit = np.sqrt(50e3 / 4e-11) / 1e6  # MV/m
    reference = 0.2  # mm
    law = PowerStrength.from_thickness(51.0 * reference**-0.25 / unit, 0.63, -0.25, thickness / reference)
    assert law.at(stretch) * unit == pytest.approx(strength, rel=1e-3)


def test_the_strength_of_no_stretch_at_all_is_not_a_number():
    assert np.isnan(PowerStrength(1.0, 0.5).at(-1.0))


@given(stretch=st.floats(1.01, 6.5), v=st.floats(-0.5, 0.5), exponent=st.floats(-2.0, 3.0))
def test_the_margin_and_its_slope(stretch, v, exponent):
    device = Device.from_scenario(pair(1.0, radius=0.5))
    membrane = device.membrane(0, VoltageLine.common(1))
    condition = intactness(membrane, 0, PowerStrength(3.0, exponent))

    def margin(x, v):
        return 1.0 - (v * x**2 / (3.0 * x**exponent)) ** 2

    y = np.array([stretch, 1.0, 0.3, v])
    assert condition.margin(y.tolist()) == pytest.approx(margin(stretch, v), rel=1e-12, abs=1e-12)
    h = 1e-6
    slope = condition.slope(y)
    along = (margin(stretch + h, v) - margin(stretch - h, v)) / (2 * h)
    across = (margin(stretch, v + h) - margin(stretch, v - h)) / (2 * h)
    assert slope == pytest.approx([along, 0.0, 0.0, across], rel=1e-5, abs=1e-6)


# -- where films break -----------------------------------------------------------------------------------


@pytest.mark.parametrize("thickness", [1.0, 0.6])
def test_breakdown_on_the_path_under_the_power_law(thickness):
    history = run(pair(0.6, UP, ambient=0.015, active=acrylic(0.3, thickness=thickness)))
    assert history.outcome is Outcome.BREAKDOWN
    assert kinds(history) == ["breakdown"]
    (stretch,), voltage = history.stretch[-1, :1], history.voltage[-1, 0]
    strength = 0.3 * stretch**0.63 * (thickness / stretch**2) ** -0.25
    assert voltage * stretch**2 / thickness == pytest.approx(strength, rel=1e-13)
    assert history.strength[-1, 0] == pytest.approx(strength, rel=1e-13)
    assert np.all(history.margin[:-1, 0] > 0.0)
    assert abs(history.margin[-1, 0]) < 1e-13


def test_breakdown_in_the_snap_under_the_power_law():
    history = run(load_scenario("scenarios/breakdown_acrylic.toml"))
    assert kinds(history) == ["limit_point", "breakdown"]
    event = history.events[0]
    stretch = event.stretch_after[0]
    assert event.voltage[0] == pytest.approx(0.36044087, abs=5e-9)
    assert event.stretch_before[0] == pytest.approx(2.05451214, abs=5e-9)
    assert event.voltage[0] * stretch**2 == pytest.approx(1.75 * stretch**1.13, rel=1e-12)
    assert stretch < 6.51514013
    (verdict,) = history.verdicts
    assert (verdict.broke, verdict.balloon, verdict.time) == ("snap", "active", event.time)
    assert verdict.field == pytest.approx(verdict.strength, rel=1e-12)
    assert history.energy_balance.relative_imbalance < 1e-8


def test_a_film_that_only_just_survives_the_snap():
    """The strength at the landing, λ = 6.51514013, decides; a hair above it nothing breaks."""
    landing = 0.36044087 * 6.51514013**2 / 6.51514013**1.13
    up = {"ramp": 0.361, "over": 1}
    for share, expected in ((0.9999, ["limit_point", "breakdown"]), (1.01, ["limit_point"])):
        assert kinds(run(pair(1.2, up, ambient=0.015, active=acrylic(share * landing)))) == expected


def test_no_exponents_are_the_constant_law():
    for field in (0.9, 8.0, 30.0):
        flat = {"law": "power", "field": field, "stretch_exponent": 0.0, "thickness_exponent": 0.0}
        by_power, constant, named = (
            run(pair(1.2, UP, ambient=0.015, active={"breakdown": law}))
            for law in (flat, {"field": field}, {"law": "constant", "field": field})
        )
        assert kinds(by_power) == kinds(constant) == kinds(named)
        assert by_power.stretch == pytest.approx(constant.stretch, abs=1e-12)
        assert named.margin.tolist() == constant.margin.tolist()


def test_a_strong_law_changes_nothing():
    plain = run(pair(1.2, UP, {"ramp": 0.0}, ambient=0.015))
    strong = run(pair(1.2, UP, {"ramp": 0.0}, ambient=0.015, active=acrylic(50.0)))
    assert strong.stretch == pytest.approx(plain.stretch, abs=1e-11)
    assert strong.energy_balance.relative_imbalance < 1e-8


def test_an_open_valve_and_a_jump_know_the_law_too():
    steps = [{"inflate": 0.5}, {"ramp": 0.5, "valve": "open"}]
    scenario = single(*steps).to_dict()
    scenario["balloon"][0]["breakdown"] = {**ACRYLIC, "field": 0.4}
    history = run(load_scenario(scenario))
    assert kinds(history) == ["breakdown"]
    stretch = history.stretch[-1, 0]
    assert history.field[-1, 0] == pytest.approx(0.4 * stretch**1.13, rel=1e-13)
    jumped = run(pair(0.6, {"jump": 3.0}, active=acrylic(2.0)))
    assert kinds(jumped) == ["jump", "breakdown"]
    assert jumped.verdicts[0].broke == "jump"
    assert jumped.verdicts[0].margin < 0.0


# -- what is told ----------------------------------------------------------------------------------------


def test_margins_are_columns_where_they_are_named():
    history = run(pair(1.2, {"ramp": 0.3}, active=acrylic(3.0)))
    columns = history_columns(history)
    assert list(columns)[-1] == "margin_active"
    expected = 1.0 - history.field[:, 0] / (3.0 * history.stretch[:, 0] ** 1.13)
    assert columns["margin_active"] == pytest.approx(expected, abs=1e-14)
    negative = run(pair(1.2, {"ramp": -0.3}, active=acrylic(3.0)))
    assert negative.margin == pytest.approx(history.margin, abs=1e-12)
    plain = run(pair(1.2, {"ramp": 0.3}))
    assert not any("margin" in name for name in history_columns(plain))
    assert plain.verdicts == ()
    assert "films" not in run_record(plain)


def test_of_several_films_each_has_its_own_margin():
    gent = {"model": "gent", "J_lim": 100.0}
    made = {
        "title": "three",
        "gas": {"ambient_pressure": 1.0},
        "balloon": [
            {"name": "plain", "electrodes": True, "elastomer": gent},
            {"name": "weak", "electrodes": True, "elastomer": gent, "breakdown": {"field": 0.4}},
            {"name": "strong", "radius": 0.9, "electrodes": True, "elastomer": gent, **acrylic(9.0)},
        ],
        "step": [{"inflate": 0.6}, {"ramp": {"plain": 0.2, "weak": 0.5, "strong": 0.3}}],
    }
    history = run(load_scenario(made))
    assert history.rated == ("weak", "strong")
    assert list(history_columns(history))[-2:] == ["margin_weak", "margin_strong"]
    weak, strong = history.verdicts
    assert (weak.broke, strong.broke) == ("path", None)
    assert weak.field == pytest.approx(0.4, rel=1e-13)
    assert strong.margin == pytest.approx(history.margin[:, 1].min())


@pytest.mark.parametrize("weakest", [0, 1])
@pytest.mark.parametrize("other", [None, 0.6])
def test_films_that_differ_in_strength_alone_break_each_at_its_own(weakest, other):
    fields = [other, other]
    fields[weakest] = 0.5
    gent = {"model": "gent", "J_lim": 100}
    balloons = [
        {
            "name": name,
            "electrodes": True,
            "elastomer": gent,
            **({"breakdown": {"field": field}} if field else {}),
        }
        for name, field in zip("ab", fields, strict=True)
    ]
    steps = [{"inflate": 0.6}, {"ramp": 0.5, "valve": "open"}]
    made = {"title": "two films", "gas": {"ambient_pressure": 1.0}, "balloon": balloons, "step": steps}
    history = run(load_scenario(made))
    assert kinds(history) == ["breakdown"]
    assert history.field[-1] == pytest.approx([0.5, 0.5], rel=1e-12)
    assert history.outcome is Outcome.BREAKDOWN


def test_the_summary_says_what_became_of_each_film(tmp_path, capsys):
    told = {}
    for name, field in (("broken", 1.75), ("whole", 2.2)):
        history = run(pair(1.2, UP, ambient=0.015, active=acrylic(field)))
        summarise_run(history, history.to_csv(tmp_path / name))
        told[name] = " ".join(capsys.readouterr().out.split())
    assert (
        "film active: broke in the snap at time 10.01102, step 2: field 13.6243, strength 13.6243"
        in told["broken"]
    )
    assert "film active: survived; closest at time 11, step 2: field 17.7915, " in told["whole"]
    assert "strength 18.7771, margin 0.0525 " in told["whole"]
    record = json.loads((tmp_path / "whole" / "run.json").read_text("utf-8"))
    assert record["films"][0]["broke"] is None
    assert record["films"][0]["margin"] == pytest.approx(0.0525, abs=1e-4)


def test_explain_names_the_law():
    text = explain(pair(1.2, UP, active=acrylic(2.0, thickness=0.5)))
    assert "its film breaks down at φλ²/h = 2 λ^0.63 (h λ⁻²)^-0.25 = 2.37841 λ^1.13" in text
    assert "limit_point, loss_of_tension, breakdown" in text
    assert "its film breaks down at φλ²/h = 2\n" in explain(
        pair(1.2, UP, active={"breakdown": {"field": 2.0}})
    )


def test_the_closed_form_refuses_the_law_it_does_not_know():
    with pytest.raises(ValueError, match="a constant breakdown field alone"):
        SealedPair.from_scenario(pair(1.2, UP, active=acrylic(2.0)))


def test_strengths_are_data():
    device = Device.from_scenario(pair(1.2, UP, active=acrylic(2.0)))
    assert device.strength == (PowerStrength(2.0, 0.63 + 0.5),)
    assert device.rated == (0,)
    assert Device.from_scenario(pair(1.2, active={"breakdown": {"field": 2}})).strength == (
        ConstantStrength(2.0),
    )
