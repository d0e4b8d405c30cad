"""Given charges: the equilibria of given voltages, another stability, and the switch between the two."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from simulator.analysis.trace import trace
from simulator.model.conditions import conditions, stability
from simulator.model.contents import IdealGas
from simulator.model.drive import AffineDrive, VoltageLine
from simulator.model.membranes import ElectrodedMembrane
from simulator.results.columns import event_columns, history_columns
from simulator.scenario import ScenarioError, load_scenario
from simulator.simulation.explanation import explain
from tests.pairs import kinds, pair, run, single
from tests.test_gas import ClosedForm
from tests.test_model import device, gradient

THREE = device()
LINE = VoltageLine((0.1, 0.0), (0.5, 1.0), "charge")
SYSTEMS = {
    "sealed": THREE.sealed(IdealGas(5.0, 0.3), LINE),
    "open": THREE.actuated(2, 0.6, LINE),
    "inflated": THREE.inflated(0, [0.2, 0.1], "charge"),
}
stretches = st.lists(st.floats(1.01, 5.0), min_size=3, max_size=3)


# -- equations ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("system", SYSTEMS.values(), ids=SYSTEMS)
@given(stretch=stretches, pressure=st.floats(0.0, 2.0), v=st.floats(-2.0, 2.0))
def test_derivatives(system, stretch, pressure, v):
    count = len(system.walls)
    y = [*stretch[:count], pressure, v] if system.has_pressure else [*stretch[:count], v]
    residual, rows = system.linearised(y)
    assert residual == pytest.approx(system.residual(y), abs=1e-12)
    for i, row in enumerate(rows):
        assert row == pytest.approx(gradient(lambda z, i=i: system.residual(z)[i], y), rel=1e-10, abs=1e-11)
    if system.has_pressure:
        y[-2] = system.gas_pressure(y[:count], v)
    slope = gradient(system.potential, y)
    for i, wall in enumerate(system.walls):
        force = system.residual(y)[i] / wall.elastomer.pole_form(y[i])[1]
        assert slope[i] == pytest.approx(wall.weight * force, rel=1e-9, abs=1e-9)
    assert -slope[-1] == pytest.approx(system.drive_power(y), rel=1e-10, abs=1e-12)
    assert system.electric_supply(y) == 0.0


@given(stretch=st.floats(1.0, 5.0), pressure=st.floats(0.0, 2.0), voltage=st.floats(-0.5, 0.5))
def test_the_same_force_and_field_as_at_the_voltage_that_follows(stretch, pressure, voltage):
    charge = float(THREE.charge(np.array([[1.0, 1.0, stretch]]), np.array([[0.0, voltage]]))[0, 1])
    by_voltage = THREE.membrane(2, VoltageLine.common(2))
    by_charge = THREE.membrane(2, VoltageLine.common(2, "charge"))
    assert isinstance(by_voltage, ElectrodedMembrane)
    assert isinstance(by_charge, ElectrodedMembrane)
    assert by_charge.force(stretch, pressure, charge) == pytest.approx(
        by_voltage.force(stretch, pressure, voltage), rel=1e-12, abs=1e-12
    )
    assert by_charge.field(stretch, charge) == pytest.approx(by_voltage.field(stretch, voltage), rel=1e-14)
    stored = [by_charge.potential(stretch, charge), by_voltage.potential(stretch, voltage)]
    rounding = 4.0 * np.finfo(float).eps * max(map(abs, stored)) + 1e-300  # of a difference of two
    assert stored[0] - stored[1] == pytest.approx(
        by_voltage.supplied(stretch, voltage), rel=1e-12, abs=rounding
    )
    # A given charge is stiffer: what a stretch does to the voltage is not made up for by the source.
    slopes = [m.stiffness(stretch, pressure, v)[0] for m, v in ((by_charge, charge), (by_voltage, voltage))]
    assert slopes[0] >= slopes[1] - 1e-12


def test_only_what_is_charged_has_electrical_terms_and_strengths_apply():
    uncharged = THREE.sealed(IdealGas(1.0, 0.3), VoltageLine((0.0, 0.0), (1.0, 0.0), "charge"))
    assert [m.drive for m in uncharged.membranes] == [AffineDrive(0.0, 1.0, "charge"), None, None]
    assert [c.kind for c in conditions(uncharged, [9.0, None, None])] == [
        "limit_point",
        "loss_of_tension",
        "breakdown",
    ]


@given(stretch=st.tuples(st.floats(1.1, 4.0), st.floats(1.1, 4.0)), charge=st.floats(0.0, 3.0))
def test_energy_and_stability_columns(stretch, charge):
    """The energy at given charge, and the smallest eigenvalue of its Hessian by differences."""
    two = device(2, (0,))
    v0, p = float(two.volume(np.array([stretch]))[0]), 0.7
    amount = np.array([(p + two.ambient) * v0])
    flags = {"is_open": np.array([False]), "charged": np.array([True])}

    def potential(x):
        x = np.array([x])
        voltage = two.voltage(VoltageLine.common(1, "charge"), np.array([charge]), x)
        return two.energy(x, np.array([p]), voltage, amount, **flags)[0]

    h, hessian = 1e-4, np.empty((2, 2))
    for i in range(2):
        for j in range(2):
            corners = [
                potential(np.array(stretch) + a * h * np.eye(2)[i] + b * h * np.eye(2)[j])
                for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1))
            ]
            hessian[i, j] = (corners[0] - corners[1] - corners[2] + corners[3]) / (4 * h * h)
    state = np.array([stretch])
    voltage = two.voltage(VoltageLine.common(1, "charge"), np.array([charge]), state)
    found = two.stability(state, np.array([p]), voltage, **flags)[0]
    assert found == pytest.approx(np.linalg.eigvalsh(hessian)[0], rel=1e-4, abs=1e-3)


# -- histories ------------------------------------------------------------------------------------------


def test_both_ways_visit_the_same_states():
    """Up to the voltage limit point; where both are stable, at equal voltage everything is equal."""
    by_voltage = run(pair(1.2, {"ramp": 0.36}, ambient=0.015))
    for row in (120, 150, 190, 200):
        charge = float(by_voltage.charge[row, 0])
        by_charge = run(pair(1.2, {"charge": charge}, ambient=0.015, output={"points": 3}))
        assert by_charge.voltage[-1] == pytest.approx(by_voltage.voltage[row], rel=1e-10)
        assert by_charge.stretch[-1] == pytest.approx(by_voltage.stretch[row], rel=1e-10)
        assert by_charge.pressure[-1] == pytest.approx(by_voltage.pressure[row], rel=1e-10)
        assert by_charge.field[-1] == pytest.approx(by_voltage.field[row], rel=1e-10)


def test_the_voltage_limit_point_is_passed_smoothly():
    """3c B: the charge rises through it, the voltage turns round there; all on the closed form."""
    scenario = pair(1.2, {"charge": 20.0, "over": 10}, {"charge": 0.0}, ambient=0.015, output={"points": 801})
    history = run(scenario)
    assert kinds(history) == []
    form = ClosedForm(scenario)
    rising = history.step == 2
    assert history.charge[rising, 0] == pytest.approx(np.linspace(0, 20, 801)[1:], abs=1e-13)
    x, p, square = form.state(history.stretch[rising, 1])
    assert history.pressure[rising] == pytest.approx(p, abs=1e-12)
    assert history.stretch[rising, 0] == pytest.approx(x, rel=1e-8)
    assert history.voltage[rising, 0] ** 2 == pytest.approx(square, abs=1e-8)
    limit = next(q for q in trace(scenario_of_voltage()).points if q.kind == "limit_point")
    assert history.voltage.max() <= limit.voltage[0]
    assert history.voltage.max() == pytest.approx(limit.voltage[0], abs=1e-5)
    beyond = rising & (history.stretch[:, 0] > limit.stretch[0] + 1e-3)
    assert np.all(np.diff(history.voltage[beyond, 0]) < 0)
    assert np.all(history.stability[rising] > 0)
    assert history.stretch[-1] == pytest.approx(history.stretch[100 * 8], abs=1e-12)


def scenario_of_voltage():
    return pair(1.2, {"ramp": 0.1}, ambient=0.015)


@pytest.mark.parametrize("law", [{}, {"law": "adiabatic"}, {"law": "liquid"}])
def test_a_limit_point_that_moves(law):
    """5b B has one at given charge too, elsewhere: where the closed form turns in the charge."""
    filled = {"ambient_pressure": 1.0, **law}
    scenario = pair(2.4, {"charge": 300.0}, radius=0.5, gas=filled)
    history = run(scenario)
    form = ClosedForm(scenario)

    def squared_charge(y):
        x, _, square = form.state(y)
        return square * (form.radius**2 * x**4) ** 2

    event = next(e for e in history.events if e.step == 2)
    assert event.kind.value == "limit_point"
    y, width = event.stretch_before[1], 1e-4
    found = brentq(lambda z: squared_charge(z + 1e-30j).imag * 1e30, y - width, y + width, xtol=1e-14)
    row = np.flatnonzero(history.time == event.time)[0]
    assert history.charge[row, 0] == pytest.approx(np.sqrt(squared_charge(found)), rel=1e-9)
    voltage_limit = next(q for q in trace(scenario).points if q.kind == "limit_point")
    assert event.stretch_before[0] > voltage_limit.stretch[0] + 1e-2
    # The charge stays through the snap, the voltage does not: the table of events has it afterwards.
    assert history.charge[row + 1] == pytest.approx(history.charge[row], rel=1e-14)
    assert event.voltage.tolist() == history.voltage[row + 1].tolist() != history.voltage[row].tolist()
    assert event.field_before == pytest.approx(history.field[row])
    assert event.field_after == pytest.approx(history.field[row + 1])
    assert event.dissipated == pytest.approx(history.energy[row] - history.energy[row + 1], rel=1e-9)
    assert history.energy_balance.relative_imbalance < 1e-8


def test_the_switch_keeps_voltage_and_charge():
    steps = [{"ramp": 0.3}, {"charge": 10.0}, {"hold": 2}, {"ramp": 0.2}, {"charge": 1.0}, {"charge": 0.0}]
    history = run(pair(1.2, *steps, ambient=0.015))
    # The charge 10 is beyond the voltage limit point: what held the state is gone when voltages are given.
    assert kinds(history) == ["jump", "limit_point"]
    jump = history.events[0]
    assert jump.step == 5
    assert jump.voltage[0] == history.voltage[history.step == 4][-1, 0]
    assert jump.dissipated > 0.0
    for step in (3, 6, 7):
        row = np.flatnonzero(history.step == step)[0]
        for column in (history.voltage, history.charge, history.stretch):
            assert column[row] == pytest.approx(column[row - 1], abs=0.11)
    held = history.step == 4
    assert np.ptp(history.charge[held]) == np.ptp(history.voltage[held]) == 0.0
    assert history.energy_balance.relative_imbalance < 1e-8
    below = run(pair(1.2, {"charge": 0.5}, {"ramp": 0.2}, ambient=0.015))
    assert kinds(below) == []
    assert below.stretch[-1] == pytest.approx(
        run(pair(1.2, {"ramp": 0.2}, ambient=0.015)).stretch[-1], rel=1e-12
    )


def test_a_state_beyond_the_limit_point_leaves_at_its_voltage():
    """Also when the first voltage asked for is the one it has, and with the valve open."""
    charged = {"charge": 10.0}
    first = run(pair(1.2, charged, ambient=0.015)).voltage[-1, 0]
    for step in ({"jump": first}, {"ramp": first}):
        history = run(pair(1.2, charged, step, ambient=0.015))
        assert kinds(history) == ["jump"]
        assert history.stability[-1] > 0.0
        assert history.stretch[-1, 0] != pytest.approx(history.events[0].stretch_before[0], abs=0.1)
    opened = [{"inflate": 1.2}, {"charge": 2.0, "valve": "open"}, {"ramp": 0.1, "valve": "open"}]
    history = run(single(*opened))
    assert all(stability_of >= -1e-9 for stability_of in history.stability)


def test_isolated_electrodes_keep_their_charge_while_the_balloons_are_inflated():
    steps = [{"ramp": 0.3}, {"charge": 0.4}, {"inflate": 0.9}, {"hold": 1}, {"charge": 0.5}]
    history = run(pair(0.6, *steps, ambient=0.5))
    alone = (history.step == 4) | (history.step == 5)
    assert history.charge[alone, 0] == pytest.approx(0.4, rel=1e-14)
    assert np.ptp(history.voltage[alone]) > 0.05
    assert history.energy_balance.relative_imbalance < 1e-8
    x, p, phi = history.stretch[alone, 0], history.pressure[alone], history.voltage[alone, 0]
    assert ClosedForm.force(x) == pytest.approx(p * x**2 + 2 * phi**2 * x**3, abs=1e-11)


def test_charges_by_name_and_those_not_named():
    both = {"electrodes": True}
    steps = [{"charge": {"active": 0.3, "passive": 0.5}}, {"charge": {"active": 0.4}}, {"ramp": 0.3}]
    history = run(pair(1.0, *steps, passive=both))
    assert history.charge[history.step == 2][-1] == pytest.approx([0.3, 0.5], rel=1e-14)
    third = history.charge[history.step == 3]
    assert third[:, 1] == pytest.approx(0.5, rel=1e-14)
    assert third[-1, 0] == pytest.approx(0.4, rel=1e-14)
    assert history.voltage[-1] == pytest.approx([0.3, 0.3], rel=1e-15)
    assert kinds(history) == []
    assert history.energy_balance.relative_imbalance < 1e-8


@settings(max_examples=40)
@given(
    first=st.tuples(st.integers(0, 30), st.integers(0, 30)),
    then=st.tuples(st.integers(0, 30), st.integers(0, 30)),
)
def test_ramps_by_name_begin_where_they_are(first, then):
    """No jump by a last digit where two voltages move along one line."""
    steps = [{"ramp": {"active": a / 100, "passive": b / 100}} for a, b in (first, then)]
    history = run(pair(0.8, *steps, passive={"electrodes": True}, output={"points": 2}))
    assert kinds(history) == []


def test_energy_of_a_loop_with_snaps():
    """Work of the current source by the samples' own ∫φ dq, and the books."""
    steps = [{"charge": 30.0, "over": 10}, {"charge": 0.0, "over": 10}]
    history = run(pair(2.4, *steps, radius=0.5, ambient=0.05, output={"points": 4001}))
    balance = history.energy_balance
    assert kinds(history).count("limit_point") >= 1
    phi, q = history.voltage[:, 0], history.charge[:, 0]
    work = float(np.sum(0.5 * (phi[1:] + phi[:-1]) * np.diff(q)))
    assert balance.electrical_work == pytest.approx(work, abs=1e-4 * balance.exchanged)
    assert balance.relative_imbalance < 1e-8
    assert balance.dissipated > 0.0


def test_breakdown_and_loss_of_tension():
    strong = {"breakdown": {"field": 1.0}}
    history = run(pair(1.2, {"charge": 20.0}, ambient=0.015, active=strong))
    assert kinds(history) == ["breakdown"]
    assert history.field[-1, 0] == pytest.approx(1.0, rel=1e-12)
    slack = run(single({"inflate": 1.2}, {"charge": 40.0}))
    assert kinds(slack) == ["loss_of_tension"]
    assert slack.pressure[-1] == pytest.approx(0.0, abs=1e-12)
    assert kinds(run(single({"charge": 0.1}))) == ["loss_of_tension"]


def test_the_sign_of_a_charge_does_not_matter():
    up, down = (run(pair(1.2, {"charge": s * 6.0}, ambient=0.015)) for s in (1, -1))
    assert up.stretch == pytest.approx(down.stretch, abs=1e-12)
    assert up.voltage == pytest.approx(-down.voltage, abs=1e-12)


def test_columns_are_the_same():
    by_charge, by_voltage = run(pair(1.0, {"charge": 0.2})), run(pair(1.0, {"ramp": 0.2}))
    assert list(history_columns(by_charge)) == list(history_columns(by_voltage))
    assert list(event_columns(by_charge)) == list(event_columns(by_voltage))


# -- what is told ---------------------------------------------------------------------------------------


def test_explanation():
    text = explain(
        pair(0.6, {"ramp": 0.1}, {"charge": 0.3, "over": 4}, {"ramp": 0.3}, {"jump": 0.1}, radius=0.5)
    )
    assert "3. charge, 4 long, valve closed: 1 smooth piece" in text
    assert "unknowns   stretch_active, stretch_passive, pressure, charge (driven)" in text
    assert "force balance of active: f(λ) − 0.5 p λ² − 32 q² λ⁻⁵ = 0" in text
    assert "4. ramp, 1 long, valve closed: 1 smooth piece" in text
    assert "begins by a jump" not in text


@pytest.mark.parametrize(
    ("step", "message"),
    [
        ({"charge": "full"}, 'step.2.charge = "full": must be a number, or a table of one or more numbers'),
        ({"charge": {}}, "step.2.charge = {}: must be a number, or a table of one or more numbers"),
        ({"charge": np.nan}, "step.2.charge = nan: must be a finite number, or a table"),
        ({"charge": {"b": 1.0}}, "step.2.charge.b = 1.0: has no electrodes, must be one of a"),
        ({"charge": {"c": 1.0}}, "step.2.charge.c = 1.0: no such balloon, must be one of a"),
        ({"charge": 1, "over": 0}, "step.2.over = 0: must be a number > 0"),
        ({"charge": 1, "ovr": 1}, "step.2.ovr = 1: unknown key, allowed here: charge, over, valve"),
        ({"charge": 1, "ramp": 1}, "exactly one of inflate, ramp, charge, hold"),
    ],
)
def test_refusals(step, message):
    gent = {"model": "gent", "J_lim": 100}
    written = {
        "title": "t",
        "gas": {"ambient_pressure": 1.0},
        "balloon": [{"name": "a", "electrodes": True, "elastomer": gent}, {"name": "b", "elastomer": gent}],
        "step": [{"inflate": 1.0}, step],
    }
    with pytest.raises(ScenarioError) as caught:
        load_scenario(written)
    assert message in str(caught.value)
    bare = {**written, "balloon": [written["balloon"][1]], "step": [{"inflate": 1.0}, {"charge": 1.0}]}
    with pytest.raises(ScenarioError, match="needs a balloon with electrodes = true, there is none"):
        load_scenario(bare)


def test_round_trip():
    made = pair(1.0, {"charge": {"active": 0.2}, "over": 3, "valve": "open"})
    assert load_scenario(made.to_dict()) == made
    assert made.to_dict()["step"][1] == {"charge": {"active": 0.2}, "over": 3.0, "valve": "open"}


def test_stability_condition_has_an_exact_slope():
    system = SYSTEMS["sealed"]
    y = np.array([1.8, 1.4, 2.1, 0.5, 0.9])
    slope, h = stability(system).slope(y), 1e-6
    for j, step in enumerate(h * np.eye(y.size)):
        ends = [float(stability(system).margin((y + s * step).tolist())) for s in (1, -1)]
        assert slope[j] == pytest.approx((ends[0] - ends[1]) / (2 * h), rel=1e-5, abs=1e-6)


def test_a_wave_that_begins_where_a_ramp_by_name_ended_does_not_jump():
    wave = {"sine": {"mean": 0.3, "amplitude": 0.05, "period": 1, "cycles": 1}}
    for first in ({"active": 0.36, "passive": 0.17}, {"active": 0.1, "passive": 0.23}):
        history = run(pair(0.8, {"ramp": first}, {"ramp": 0.3}, wave, passive={"electrodes": True}))
        assert kinds(history) == []


def test_the_work_of_a_long_way_back_to_no_charge_closes() -> None:
    """A long way is followed by longer steps: where it is left in between, its cubic is that of these."""
    gent = {"model": "gent", "J_lim": 100.0}
    scenario = load_scenario(
        {
            "title": "a charge taken off",
            "gas": {"ambient_pressure": 0.3348, "law": "adiabatic"},
            "balloon": [
                {"name": "b0", "elastomer": gent},
                {"name": "b1", "modulus": 0.5743, "electrodes": True, "elastomer": gent},
            ],
            "step": [
                {"inflate": 0.72},
                {"jump": 0.4255},
                {"jump": 0.20123437542166034},
                {"charge": {"b1": 0.0}, "until": {"field": 1.549}},
            ],
        }
    )
    history = run(scenario)
    assert history.outcome == "completed"
    assert abs(history.energy_balance.imbalance) < 1e-8 * history.energy_balance.exchanged
