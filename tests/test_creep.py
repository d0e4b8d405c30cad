"""Balloons that take their time: limits, orders, relaxation laws, energy, and what ends a history."""

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from simulator import EventKind, Outcome, ScenarioError, explain, load_scenario
from tests.pairs import pair, run

UP, DOWN = {"ramp": 0.4, "over": 1}, {"ramp": 0.0, "over": 1}


def creeping(scenario, relaxation_time, **maxwell):
    written = scenario.to_dict()
    written["dynamics"] = {"relaxation_time": relaxation_time}
    for balloon in written["balloon"]:
        if balloon["name"] in maxwell:
            balloon["maxwell"] = maxwell[balloon["name"]]
    return load_scenario(written)


def one_balloon(*steps, relaxation_time=1e-6, maxwell=None, **words):
    balloon = {"name": "one", "elastomer": {"model": "neo-hookean"}, **words}
    if maxwell:
        balloon["maxwell"] = maxwell
    return load_scenario(
        {
            "title": "one balloon",
            "gas": {"ambient_pressure": 1.0},
            "balloon": [balloon],
            "step": list(steps),
            "dynamics": {"relaxation_time": relaxation_time},
        }
    )


def test_limit_points_are_late_by_the_two_thirds_power_of_the_relaxation_time():
    """Passing a saddle-node at a finite rate: the delay in the drive scales as τ^(2/3)."""
    times = np.array([1e-4, 1e-5, 1e-6])
    up, down = (event.voltage[0] for event in run(pair(1.2, UP, DOWN, ambient=0.015)).events)
    late = []
    for tau in times:
        history = run(creeping(pair(1.2, UP, DOWN, ambient=0.015), tau))
        first, second = history.events
        assert first.kind is second.kind is EventKind.LIMIT_POINT
        late.append([first.voltage[0] - up, down - second.voltage[0]])
        assert history.energy_balance.relative_imbalance < 1e-7
    orders = np.diff(np.log(late), axis=0) / np.diff(np.log(times))[:, None]
    assert orders == pytest.approx(2 / 3, abs=0.03)


def test_slow_enough_it_is_the_quasi_static_history():
    """Away from the snaps the distance falls as τ; what is dissipated tends to what the snaps lost."""
    scenario = pair(1.2, UP, DOWN, ambient=0.015, output={"points": 11})
    quasi_static = run(scenario)
    at = np.isin(quasi_static.time, [1.3, 1.5, 2.1, 2.2, 2.5, 2.8, 3.0])
    errors, losses = [], []
    for tau in (1e-4, 1e-5, 1e-6):
        history = run(creeping(scenario, tau))
        same = np.isin(history.time.round(9), quasi_static.time[at].round(9))
        errors.append(np.abs(history.stretch[same] - quasi_static.stretch[at]).max())
        losses.append(abs(history.energy_balance.dissipated / quasi_static.energy_balance.dissipated - 1.0))
    assert np.log10(np.array(errors[:-1]) / errors[1:]) == pytest.approx(1.0, abs=0.05)
    assert losses[0] > losses[1] > losses[2]
    assert losses[2] < 1e-3


@pytest.mark.parametrize("modulus", [0.3, 2.0])
def test_a_maxwell_branch_creeps_as_a_zener_solid(modulus):
    """Small strains under a held pressure: from ε/(1 + m) to ε with the retardation time t(1 + m)."""
    pressure, time = 1e-3, 2.0
    history = run(
        one_balloon(
            {"inflate": pressure, "over": 1e-4},
            {"hold": 10.0, "valve": "open"},
            maxwell={"modulus": modulus, "time": time},
        )
    )
    held = history.step == 2
    t, strain = history.time[held] - 1e-4, history.stretch[held, 0] - 1.0
    settled = pressure / 12.0
    start = settled / (1.0 + modulus)
    expected = settled + (start - settled) * np.exp(-t / (time * (1.0 + modulus)))
    assert strain == pytest.approx(expected, rel=2e-3)
    assert history.energy_balance.relative_imbalance < 1e-6


def test_without_a_branch_a_step_of_pressure_is_followed_exponentially():
    pressure, tau = 1e-4, 0.5
    history = run(
        one_balloon({"inflate": pressure, "over": 1e-6}, {"hold": 0.2, "valve": "open"}, relaxation_time=tau)
    )
    t, strain = history.time - 1e-6, history.stretch[:, 0] - 1.0
    expected = pressure / 12.0 * (1.0 - np.exp(-12.0 * t / tau))
    assert strain[history.step == 2] == pytest.approx(expected[history.step == 2], rel=1e-3)


def test_a_hold_can_snap_and_sooner_the_further_beyond():
    """A spring that relaxes carries less and less: the snap comes during the hold."""
    waits = []
    for voltage in (0.365, 0.38, 0.40):
        # Filled slowly, so that it is sealed at rest.
        steps = {"hold": 200.0, "valve": "open"}, {"ramp": voltage, "over": 0.1}, {"hold": 400.0}
        stiff = {"modulus": 0.5, "time": 5.0}
        scenario = creeping(pair(1.2, *steps, ambient=0.015), 1e-3, active=stiff, passive=stiff)
        history = run(scenario)
        ramped = history.step == 3
        assert history.stretch[ramped].max() < 2.0  # it has not snapped yet
        held = history.step == 4
        assert history.stretch[held, 0].max() > 4.0
        waits.append(history.time[held][np.argmax(history.stretch[held, 0] > 3.0)])
        assert history.energy_balance.relative_imbalance < 1e-6
    assert waits[0] > waits[1] > waits[2]


def test_each_balloon_has_its_own_time():
    """Only the voltage of one moves; the slow one lags behind."""
    scenario = pair(1.0, {"ramp": 0.2, "over": 1e-3})
    ends = [
        run(creeping(scenario, {"active": a, "passive": p})).stretch[-1]
        for a, p in ((1e-6, 1e-6), (1e-6, 10.0), (10.0, 1e-6))
    ]
    at_rest = run(scenario).stretch[-1]
    assert ends[0] == pytest.approx(at_rest, abs=1e-3)
    assert abs(ends[1][1] - at_rest[1]) > 10 * abs(ends[0][1] - at_rest[1])
    assert abs(ends[2][0] - at_rest[0]) > 10 * abs(ends[0][0] - at_rest[0])


def test_equal_balloons_stay_equal():
    scenario = creeping(pair(1.0, {"inflate": 0.3}, {"hold": 1.0}), 0.1)
    history = run(scenario)
    assert history.stretch[:, 0] == pytest.approx(history.stretch[:, 1], abs=1e-12)


def test_a_jump_moves_nothing_at_once():
    rest = {"hold": 5.0, "valve": "open"}, {"jump": 0.2}, {"hold": 5.0}
    history = run(creeping(pair(1.0, *rest), 1e-3))
    before, after = np.flatnonzero(history.time == 6.0)[-2:]
    assert (history.voltage[before, 0], history.voltage[after, 0]) == (0.0, 0.2)
    assert np.array_equal(history.stretch[before], history.stretch[after])
    assert not history.events
    assert history.stretch[-1] == pytest.approx(run(pair(1.0, {"jump": 0.2})).stretch[-1], abs=1e-6)
    assert history.energy_balance.relative_imbalance < 1e-7


def test_samples_do_not_change_the_history():
    few, many = (run(creeping(pair(1.2, UP, ambient=0.015, output={"points": n}), 1e-3)) for n in (2, 501))
    assert few.stretch[-1] == pytest.approx(many.stretch[-1], abs=1e-7)
    assert few.events[0].time == pytest.approx(many.events[0].time, abs=1e-8)
    assert few.energy_balance.dissipated == pytest.approx(many.energy_balance.dissipated, rel=1e-6)


def test_a_sine_is_followed_through_its_extremes():
    wave = {"sine": {"mean": 0.15, "amplitude": 0.15, "period": 2.0, "cycles": 3}}
    history = run(creeping(pair(1.0, wave, output={"points": 121}), 0.05))
    last, one_before = (np.isclose(history.time, t) for t in (7.0, 5.0))
    assert history.stretch[last][0] == pytest.approx(history.stretch[one_before][0], abs=1e-4)
    assert history.outcome is Outcome.COMPLETED


def test_loss_of_tension_and_breakdown_end_it():
    lost = run(creeping(pair(0.3, {"ramp": 1.0, "over": 1}, ambient=0.015), 1e-3))
    assert lost.outcome is Outcome.LOSS_OF_TENSION
    assert lost.pressure[-1] == pytest.approx(0.0, abs=1e-9)
    at_once = run(creeping(pair(0.0, {"ramp": 0.5, "over": 1}), 1e-3))
    assert at_once.outcome is Outcome.LOSS_OF_TENSION
    broken = run(creeping(pair(1.2, UP, ambient=0.015, active={"breakdown": {"field": 2.0}}), 1e-3))
    assert broken.outcome is Outcome.BREAKDOWN
    assert broken.field[-1, 0] == pytest.approx(2.0, rel=1e-8)
    assert broken.time[-1] < 2.0


def test_without_a_limit_it_runs_away():
    steps = {"inflate": 1.5, "over": 1.0}, {"hold": 1e3, "valve": "open"}
    history = run(one_balloon(*steps, relaxation_time=0.1))
    assert history.outcome is Outcome.RUNAWAY


@settings(max_examples=10, deadline=None)
@given(
    inflate=st.floats(0.1, 2.0),
    tau=st.floats(1e-5, 1.0),
    legs=st.lists(st.floats(-0.4, 0.4), min_size=1, max_size=3),
    modulus=st.floats(0.1, 2.0),
)
# A margin that touches zero, at which IDA's root finder gives up.
@example(inflate=1.9140625, tau=0.2265625, legs=[0.0], modulus=1.05859375)
def test_energy_is_conserved(inflate, tau, legs, modulus):
    scenario = pair(inflate, *[{"ramp": v} for v in legs], ambient=0.5)
    history = run(creeping(scenario, tau, passive={"modulus": modulus, "time": 0.3}))
    assert history.energy_balance.relative_imbalance < 1e-6
    assert history.energy_balance.dissipated >= 0.0


@pytest.mark.parametrize(
    ("dynamics", "message"),
    [
        ({}, "dynamics.relaxation_time: is missing, must be a number > 0, or a table"),
        ({"relaxation_time": 0}, "dynamics.relaxation_time = 0: must be a number > 0, or a table"),
        ({"relaxation_time": {}}, "dynamics.relaxation_time = {}: must be a number > 0, or a table"),
        (
            {"relaxation_time": {"active": 1.0}},
            "dynamics.relaxation_time.passive: is missing, must be a number > 0",
        ),
        (
            {"relaxation_time": {"active": 1.0, "passive": 1.0, "other": 2.0}},
            "dynamics.relaxation_time.other = 2.0: no such balloon, must be one of active, passive",
        ),
        (
            {"relaxation_time": 1.0, "speed": 2},
            "dynamics.speed = 2: unknown key, allowed here: relaxation_time",
        ),
    ],
)
def test_what_makes_no_sense_is_said(dynamics, message):
    written = pair(1.0, UP).to_dict() | {"dynamics": dynamics}
    with pytest.raises(ScenarioError, match="dynamics") as error:
        load_scenario(written)
    assert message in str(error.value)


def test_what_does_not_go_with_dynamics():
    written = pair(1.0, {"charge": 0.1}).to_dict() | {"dynamics": {"relaxation_time": 1.0}}
    with pytest.raises(ScenarioError, match=r"step.2.charge = 0.1: does not go with \[dynamics\]"):
        load_scenario(written)


def test_a_chamber_of_gas_is_felt():
    """Slow enough it is the quasi-static history, on a chamber and an adiabatic gas too."""
    written = pair(1.0, {"ramp": 0.2, "over": 10}).to_dict()
    written["gas"] = {"ambient_pressure": 0.5, "chamber": 3.0, "law": "adiabatic"}
    scenario = load_scenario(written)
    history = run(creeping(scenario, 1e-5))
    assert history.stretch[-1] == pytest.approx(run(scenario).stretch[-1], abs=1e-5)
    assert history.energy_balance.relative_imbalance < 1e-7


def test_a_maxwell_branch_needs_dynamics():
    written = pair(1.0, UP).to_dict()
    written["balloon"][0]["maxwell"] = {"modulus": 0.5, "time": 1.0}
    with pytest.raises(ScenarioError, match=r"maxwell = .*: needs \[dynamics\] with a relaxation_time"):
        load_scenario(written)


def test_who_does_not_name_it_does_not_load_it():
    code = (
        "import sys; from simulator import load_scenario, simulate;"
        "simulate(load_scenario('scenarios/fig3c_state_b.toml'));"
        "assert not {'simulator.solver.viscous', 'simulator.simulation.real_time'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_what_equal_balloons_run_into_together_ends_a_history_once():
    """Two neo-Hookean balloons, driven alike, grow without bound at the same instant."""
    balloons = [
        {"name": name, "electrodes": True, "elastomer": {"model": "neo-hookean"}} for name in ("a", "b")
    ]
    scenario = {
        "title": "t",
        "balloon": balloons,
        "gas": {"ambient_pressure": 0.0},
        "step": [{"inflate": 0.4}, {"ramp": 2.5, "over": 1.0}],
        "dynamics": {"relaxation_time": 0.29},
    }
    history = run(load_scenario(scenario))
    assert [event.kind for event in history.events] == [EventKind.LIMIT_POINT, EventKind.RUNAWAY]
    assert history.stretch[-1, 0] == history.stretch[-1, 1]


def test_a_newtonian_film_relaxes_as_its_viscosity_says():
    """12η λ⁻² dλ/dt = −2(λ − λ⁻⁵) in closed form: t = 3η[F(λ₀²) − F(λ²)] with F′(u) = u/(u³ − 1)."""
    viscosity = 0.7
    steps = {"jump": 0.6, "valve": "open"}, {"hold": 200.0, "valve": "open"}, {"jump": 0.0, "valve": "open"}
    written = one_balloon(*steps, {"hold": 3.0, "valve": "open"}, electrodes=True).to_dict()
    history = run(load_scenario({**written, "dynamics": {"viscosity": viscosity}}))

    def antiderivative(stretch):
        u = stretch**2
        angle = np.arctan((2.0 * u + 1.0) / np.sqrt(3.0)) / np.sqrt(3.0)
        return np.log(u - 1.0) / 3.0 - np.log(u * u + u + 1.0) / 6.0 + angle

    left = history.step == 4
    start, stretch = history.stretch[np.flatnonzero(left)[0] - 1, 0], history.stretch[left, 0]
    assert start > 1.1
    passed = 3.0 * viscosity * (antiderivative(start) - antiderivative(stretch))
    assert history.time[left] - 200.0 == pytest.approx(passed, rel=1e-7)
    assert history.energy_balance.relative_imbalance < 1e-7
    assert "flow of one: 8.4 λ⁻² dλ/dt = −[" in explain(history.scenario)


def test_a_viscosity_may_be_written_in_pascal_seconds():
    scales = {"shear_modulus": "50 kPa", "thickness": "1 mm", "radius": "20 mm", "permittivity": 4.7}
    written = pair(1.0, UP).to_dict() | {"dynamics": {"viscosity": "25 kPa*s"}, "scales": scales}
    assert load_scenario(written).dynamics.friction_of("active") == (6.0, -2.0)


@pytest.mark.parametrize(
    ("dynamics", "message"),
    [
        ({"viscosity": 0}, "dynamics.viscosity = 0: must be a number > 0, or a table"),
        ({"viscosity": {"active": 1.0}}, "dynamics.viscosity.passive: is missing, must be a number > 0"),
        (
            {"viscosity": 1.0, "relaxation_time": 2.0},
            'dynamics = {"relaxation_time": 2.0, "viscosity": 1.0}: must have relaxation_time or viscosity, '
            "not both",
        ),
        ({}, "or a table with one for every balloon by name; or give viscosity"),
    ],
)
def test_what_makes_no_sense_of_a_viscosity_is_said(dynamics, message):
    with pytest.raises(ScenarioError) as error:
        load_scenario(pair(1.0, UP).to_dict() | {"dynamics": dynamics})
    assert message in str(error.value)
