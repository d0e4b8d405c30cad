"""Scenarios that failed once, each with the right value from a second method.

The files are in `tests/cases`; each is the smallest one of its kind.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from simulator import EventKind, History, Outcome, SolverError, load_scenario, simulate
from simulator.analysis.sensitivity import sensitivities
from simulator.scenario.keys import changed_scenario, number_at
from tests.pairs import run

CASES = Path(__file__).parent / "cases"


def played(name: str) -> History:
    return run(load_scenario(CASES / f"{name}.toml"))


def kinds(history: History) -> list[EventKind]:
    return [event.kind for event in history.events]


# -- jumps ---------------------------------------------------------------------------------------------------


def test_balloons_that_jump_with_the_valve_open_stop_when_the_first_breaks():
    history = played("jump-open-valve-breakdown")
    assert kinds(history) == [EventKind.JUMP, EventKind.BREAKDOWN]
    assert history.outcome is Outcome.BREAKDOWN
    assert history.stretch[-1, 0] == pytest.approx(1.09602, abs=1e-5)
    assert abs(history.field[-1, 1]) == pytest.approx(2.0, rel=1e-9)
    assert history.energy_balance.relative_imbalance < 1e-12


def test_a_film_that_is_broken_at_once_moves_no_balloon():
    steps = [{"inflate": 1.25}, {"jump": {"b0": 0.5, "b1": 1.9}, "valve": "open"}]
    scenario = load_scenario(CASES / "jump-open-valve-breakdown.toml").to_dict()
    history = run(load_scenario(scenario | {"step": steps}))
    assert kinds(history) == [EventKind.JUMP, EventKind.BREAKDOWN]
    assert np.array_equal(history.events[0].stretch_before, history.stretch[-1])


def test_valve_and_voltage_change_together():
    history = played("jump-opens-valve")
    assert history.outcome is Outcome.COMPLETED
    assert kinds(history) == [EventKind.JUMP]
    assert history.stretch[-1, 0] == pytest.approx(1.08393, abs=1e-5)


def test_the_pressure_of_a_liquid_follows_a_voltage_that_breaks_the_film():
    history = played("jump-liquid-breaks")
    (jump, breakdown) = history.events
    right = 0.6 - 2.0 * 0.5**2 * jump.stretch_before[0]
    assert jump.pressure_before == pytest.approx(0.6, rel=1e-12)
    assert jump.pressure_after == pytest.approx(right, rel=1e-12)
    assert breakdown.kind is EventKind.BREAKDOWN
    assert breakdown.pressure_before == pytest.approx(right, rel=1e-12)


def test_what_charges_held_leaves_to_the_side_where_the_potential_falls_more():
    history = played("charge-to-voltage-way")
    assert history.outcome is Outcome.COMPLETED
    (jump,) = history.events
    assert jump.stretch_after[0] == pytest.approx(1.07471, abs=1e-5)
    assert jump.dissipated == pytest.approx(1.4037, abs=1e-4)


def test_where_a_state_that_is_let_go_loses_its_tension_does_not_depend_on_how_it_is_let_go():
    """By SciPy's LSODA, Radau and BDF, from ever nearer to where it stood."""
    history = played("let-go-loses-tension")
    assert history.outcome is Outcome.LOSS_OF_TENSION
    (jump,) = (event for event in history.events if event.kind is EventKind.JUMP)
    assert jump.stretch_after == pytest.approx([4.40981933, 1.47778754, 1.00145469], abs=1e-6)


def test_voltages_switched_off_are_off():
    history = played("jump-spurious")
    assert [event.step for event in history.events] == [2, 3]
    assert np.all(history.voltage[history.step == 3] == 0.0)


def test_voltages_switched_off_one_after_the_other_are_off():
    scenario = load_scenario(CASES / "jump-spurious.toml").to_dict()
    wave = {"low": 0.0, "high": 0.1, "period": 1.0, "cycles": 1}
    off = [{"jump": {"a": 0.2, "b": 0.0}}, {"jump": {"a": 0.0}}, {"triangle": wave}]
    steps = [{"inflate": 0.2}, {"ramp": {"a": 0.3, "b": 0.1}}, *off]
    history = run(load_scenario(scenario | {"step": steps}))
    assert [event.step for event in history.events] == [3, 4]
    assert np.all(history.voltage[history.step == 4][-1] == 0.0)


# -- no pressure ---------------------------------------------------------------------------------------------


def test_sealed_without_gas_a_voltage_that_falls_and_rises_takes_the_tension_where_it_rises() -> None:
    history = played("vacuum-rises-unseen")
    assert history.outcome is Outcome.LOSS_OF_TENSION
    (event,) = history.events
    assert (event.step, event.time) == (3, 2.0)


@pytest.mark.parametrize("gas", [{}, {"chamber": 1.0}, {"law": "adiabatic"}], ids=str)
def test_sealed_without_gas_a_voltage_may_jump_down_and_only_its_rise_takes_the_tension(
    gas: dict[str, Any],
) -> None:
    scenario = load_scenario(CASES / "vacuum-jump.toml").to_dict()
    scenario["gas"] |= gas
    history = simulate(load_scenario(scenario))
    jump, loss = history.events
    assert (jump.kind, loss.kind) == (EventKind.JUMP, EventKind.LOSS_OF_TENSION)
    assert jump.stretch_after is not None
    stretch = float(jump.stretch_after[0])
    # f(λ) = 2φ²λ³
    rest = 100.0 - (2.0 * stretch**2 + stretch**-4 - 3.0)
    assert 200.0 * (stretch - stretch**-5) / rest == pytest.approx(2.0 * 0.2**2 * stretch**3, rel=1e-12)
    assert loss.time == pytest.approx(3.0)
    assert (loss.stretch_before[0], loss.pressure_before) == (1.0, 0.0)


@pytest.mark.parametrize(
    ("step", "time"),
    [
        ({"ramp": -0.2}, 1.0 + 2.0 / 3.0),
        ({"triangle": {"low": 0.4, "high": -0.2, "period": 1.0, "cycles": 2}}, 1.0 + 1.0 / 3.0),
        ({"sine": {"mean": 0.4, "amplitude": -0.2, "period": 1.0, "cycles": 2}}, 1.25),
        # 0.1 + 0.3 cos 2πt = 0
        (
            {"sine": {"a": {"mean": 0.1, "amplitude": 0.3, "phase": 0.25}, "period": 1.0, "cycles": 2}},
            1.0 + np.arccos(-1.0 / 3.0) / (2.0 * np.pi),
        ),
    ],
)
def test_sealed_without_gas_tension_is_lost_where_the_magnitude_of_a_voltage_rises(
    step: dict[str, Any], time: float
) -> None:
    scenario = load_scenario(CASES / "vacuum-jump.toml").to_dict()
    history = simulate(load_scenario(scenario | {"step": [scenario["step"][0], step]}))
    (event,) = history.events
    assert event.kind is EventKind.LOSS_OF_TENSION
    assert event.time == pytest.approx(time, abs=1e-12)


def test_a_pressure_that_is_rounding_is_none() -> None:
    scenario = load_scenario(CASES / "vacuum-jump.toml").to_dict()
    history = simulate(load_scenario(scenario | {"step": [{"inflate": 1e-17}, {"hold": 1.0}]}))
    assert history.outcome is Outcome.COMPLETED


@pytest.mark.parametrize(("name", "time"), [("slack-again", 7.0 / 3.0), ("slack-again-b", 2.2)])
def test_a_voltage_that_comes_back_to_where_there_was_no_pressure_takes_the_tension(
    name: str, time: float
) -> None:
    history = played(name)
    assert history.outcome is Outcome.LOSS_OF_TENSION
    (event,) = history.events
    assert event.time == pytest.approx(time, rel=1e-12)
    assert event.voltage[0] == pytest.approx(0.1, rel=1e-12)
    assert event.stretch_before[0] == pytest.approx(1.0016821372, abs=1e-10)


# -- real time -----------------------------------------------------------------------------------------------


def test_a_ramp_after_a_rest_far_beyond_the_snap():
    history = played("dynamics-ramp-after-rest")
    assert history.outcome is Outcome.COMPLETED
    assert history.stretch[-1, 0] == pytest.approx(6.6621186, abs=1e-7)
    assert history.pressure[-1] == pytest.approx(0.9102074, abs=1e-7)
    assert history.energy_balance.relative_imbalance < 1e-6


def test_a_jump_beyond_the_strength_breaks_the_film_at_once():
    history = played("dynamics-jump-beyond-strength")
    assert history.outcome is Outcome.BREAKDOWN
    (breakdown,) = history.events
    assert (breakdown.time, breakdown.step) == (1.0, 2)
    assert abs(breakdown.field_before[0]) == pytest.approx(0.569, abs=1e-3)


def test_a_limit_point_in_motion_is_where_the_force_stops_rising():
    history = played("dynamics-limit-point-late")
    (turn,) = history.events
    assert turn.kind is EventKind.LIMIT_POINT
    assert turn.time == pytest.approx(1.658694, abs=1e-6)
    assert history.stability[history.time == turn.time] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("name", "rows"), [("dynamics-sample-beside-corner", 601), ("dynamics-row-at-sample", 21)]
)
def test_corners_beside_samples_are_those_samples(name, rows):
    history = played(name)
    assert history.outcome is Outcome.COMPLETED
    assert len(history) == rows
    last = history.time[history.step == 2]
    assert np.diff(last) == pytest.approx(np.full(last.size - 1, last[1] - last[0]), rel=1e-9)


def test_corners_of_a_ramp_add_no_samples_and_those_of_a_wave_are_its_extremes():
    scenario = load_scenario(CASES / "dynamics-sample-beside-corner.toml").to_dict()
    wave = {"a": {"low": 0.0, "high": 0.2, "phase": 0.3}, "period": 1.0, "cycles": 2}
    steps = [{"inflate": 1.0}, {"ramp": 0.12}, {"triangle": wave}]
    history = run(load_scenario(scenario | {"step": steps, "output": {"points": 10}}))
    assert [int((history.step == number).sum()) for number in (1, 2, 3)] == [10, 9, 2 * 9 + 4]


def test_an_edge_of_a_nanosecond_is_an_edge():
    """As steep as it is, it is the jump that it stands for."""
    history = played("dynamics-steep-edge")
    scenario = load_scenario(CASES / "dynamics-steep-edge.toml").to_dict()
    steps = [{"inflate": 1.0}, {"hold": 1.0}, {"jump": 0.2}, {"hold": 1.0}]
    jumped = run(load_scenario(scenario | {"step": steps}))
    for time in (2.02, 2.1, 3.0):
        one = history.stretch[np.argmin(np.abs(history.time - time)), 0]
        other = jumped.stretch[np.argmin(np.abs(jumped.time - time)), 0]
        assert one == pytest.approx(other, abs=1e-7)


def test_whatever_the_integrator_raises_is_a_solver_error_with_the_history(monkeypatch):
    def refuse(*_, **__):
        raise KeyError(-60)

    monkeypatch.setattr("sksundae.ida.IDA.solve", refuse)
    with pytest.raises(SolverError, match=r"step 1, time 0: .*-60") as caught:
        played("dynamics-steep-edge")
    assert caught.value.history.outcome is Outcome.FAILED


# -- sensitivities -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "key", ["step.1.inflate", "balloon.b1.radius", "balloon.b0.thickness", "gas.ambient_pressure"]
)
def test_the_pressure_held_is_the_one_at_which_the_valve_was_opened(key):
    scenario = load_scenario(CASES / "sensitivities-open-valve.toml")
    history = run(scenario)
    (turn,) = (event for event in history.events if event.kind is EventKind.LIMIT_POINT)
    at = number_at(scenario, key)
    h = 1e-3 * at

    def voltage(i):
        events = run(changed_scenario(scenario, key, at + i * h)).events
        return next(event.voltage[0] for event in events if event.kind is EventKind.LIMIT_POINT)

    slope = (8.0 * (voltage(1) - voltage(-1)) - (voltage(2) - voltage(-2))) / (12.0 * h)
    found = sensitivities(history, turn, [key])[0]
    assert found.of == "voltage_b0"
    assert found.derivative == pytest.approx(slope, rel=2e-6, abs=1e-10)


# -- real time: what a change at once does -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "step", "time"),
    [
        ("dynamics-jump-destabilises", 2, 1.0),
        ("dynamics-wave-destabilises", 2, 1.0),
        ("dynamics-valve-destabilises", 3, 110.0),
    ],
)
def test_a_change_at_once_that_takes_the_stability_is_a_limit_point(
    name: str, step: int, time: float
) -> None:
    history = played(name)
    (event,) = history.events
    assert (event.kind, event.step) == (EventKind.LIMIT_POINT, step)
    assert event.time == pytest.approx(time, rel=1e-12)
    assert event.stretch_after is not None
    assert np.array_equal(event.stretch_before, event.stretch_after)
    assert history.outcome is Outcome.COMPLETED


def test_in_real_time_too_a_voltage_slackens_what_was_sealed_without_pressure() -> None:
    history = played("dynamics-sealed-without-pressure")
    (event,) = history.events
    assert (event.kind, event.step) == (EventKind.LOSS_OF_TENSION, 2)
    assert event.time == pytest.approx(7.399, rel=1e-12)
    assert history.pressure.min() >= 0.0


# -- equal balloons ------------------------------------------------------------------------------------------


def test_an_equal_pair_that_jumps_parts_where_it_comes_to_rest_together() -> None:
    history = played("equal-pair-jump")
    assert kinds(history) == [EventKind.JUMP, EventKind.LOSS_OF_TENSION]
    assert history.stretch[-1] == pytest.approx([1.68299, 1.11319], abs=1e-5)
    scenario = load_scenario(CASES / "equal-pair-jump.toml").to_dict()
    scenario["balloon"][0]["radius"] = 1.0 + 1e-6
    nearly = simulate(load_scenario(scenario))
    assert nearly.stretch[-1] == pytest.approx(history.stretch[-1], abs=1e-4)


@pytest.mark.parametrize("rtol", [1e-3, 1e-6])
def test_of_equal_balloons_that_charges_held_the_first_grows_at_any_tolerance(rtol: float) -> None:
    scenario = load_scenario(CASES / "equal-three-released.toml").to_dict()
    history = simulate(load_scenario(scenario | {"solver": {"rtol": rtol}}))
    jump = history.events[0]
    assert jump.kind is EventKind.JUMP
    assert jump.stretch_after == pytest.approx([1.58302173, 1.22775761, 1.22775761], abs=1e-8)


def test_a_pair_that_comes_together_again_goes_on_together() -> None:
    """There the equations are singular: what the balloons are apart enters with its third power."""
    history = played("work-check-equal-pair")
    assert history.outcome is Outcome.COMPLETED
    together = history.events[-1]
    assert together.kind is EventKind.BRANCH_POINT
    assert together.stretch_before == pytest.approx([1.3378460418942124] * 2, abs=1e-12)
    assert together.voltage[0] == pytest.approx(0.3699734431891463, abs=1e-13)
    assert np.ptp(history.stretch[-1]) < 1e-12
    assert history.pressure[-1] == pytest.approx(1.1914993129241995, rel=1e-12)


@pytest.mark.parametrize(
    ("ambient", "stretch"),
    [(0.0, (5.06019526, 1.09413055)), (0.2, (5.08398153, 1.09482494)), (1.0, (5.13087804, 1.09628623))],
)
def test_a_pair_sealed_exactly_at_its_valley_parts_as_soon_as_a_voltage_comes(
    ambient: float, stretch: tuple[float, float]
) -> None:
    """No branch leaves there: at the valley the fourth power of the parting leads down already."""
    balloon = {"electrodes": True, "elastomer": {"model": "gent", "J_lim": 100.0}}
    scenario = {
        "title": "valley",
        "gas": {"ambient_pressure": ambient},
        "balloon": [balloon | {"name": name} for name in ("a", "b")],
        "step": [{"inflate": 1.4}, {"inflate": 0.7028725314932649}, {"ramp": 0.2}, {"ramp": 0.0}],
    }
    history = simulate(load_scenario(scenario))
    assert history.outcome is Outcome.COMPLETED
    assert kinds(history) == [EventKind.LIMIT_POINT, EventKind.BRANCH_POINT]
    assert history.events[1].time == pytest.approx(2.0, abs=1e-9)
    assert history.stretch[-1] == pytest.approx(stretch, abs=1e-8)
    assert history.energy_balance.relative_imbalance < 1e-12


@pytest.mark.parametrize("rated", [0, 1])
def test_of_an_equal_pair_that_snaps_with_the_valve_open_neither_moves_on_once_a_film_breaks(
    rated: int,
) -> None:
    balloon = {"electrodes": True, "elastomer": {"model": "gent", "J_lim": 100.0}}
    balloons = [balloon | {"name": name} for name in ("a", "b")]
    balloons[rated]["breakdown"] = {"field": 2.0}
    steps = [{"inflate": 1.2}, {"ramp": 0.5, "valve": "open"}]
    history = simulate(
        load_scenario({"title": "pair", "gas": {"ambient_pressure": 1.0}, "balloon": balloons, "step": steps})
    )
    assert kinds(history) == [EventKind.LIMIT_POINT, EventKind.BREAKDOWN]
    broken = np.sqrt(2.0 / history.voltage[-1, 0])  # |E| = φλ² = 2
    assert history.stretch[-1] == pytest.approx([broken, broken], rel=1e-9)
    assert history.energy_balance.relative_imbalance < 1e-12


def test_a_snap_at_a_large_stretch_sets_out_beyond_the_rounding_of_its_forces() -> None:
    """SciPy's Radau and LSODA too find no rest from its limit point on."""
    history = played("potential-rises")
    assert history.outcome is Outcome.RUNAWAY
    assert history.stretch[-1, 1] == pytest.approx(228.887716, abs=1e-5)


# -- charges far larger than those of an unstretched film ---------------------------------------------------


def test_charges_on_a_liquid() -> None:
    history = played("charge-liquid")
    turn = history.events[-1]
    assert turn.kind is EventKind.LIMIT_POINT
    assert turn.time == pytest.approx(1.72987, abs=1e-5)
    assert history.stretch[-1] == pytest.approx([6.47917, 4.50070, 5.90705], abs=1e-5)
    assert history.statistics.ida_steps < 1000


def test_a_charge_taken_off_over_ten_decades() -> None:
    """A gas in a vacuum and a charge that is small beside it: the film is as large as without."""
    history = played("charge-from-far")
    assert history.outcome is Outcome.COMPLETED
    uncharged = history.stretch[history.step == 1][-1]
    assert history.stretch[history.step == 3][-1] == pytest.approx(uncharged, rel=1e-5)
    assert history.statistics.ida_steps < 2000


def test_in_real_time_too_nothing_is_taut_without_gas() -> None:
    history = played("dynamics-sealed-in-vacuum")
    (event,) = history.events
    assert (event.kind, event.step, event.time) == (EventKind.LOSS_OF_TENSION, 1, 0.0)


def test_what_was_unstable_already_has_no_second_limit_point() -> None:
    history = played("dynamics-valve-and-jump")
    assert kinds(history) == [EventKind.LIMIT_POINT, EventKind.LOSS_OF_TENSION]
    assert [event.step for event in history.events] == [1, 3]
    assert [event.time for event in history.events] == pytest.approx([0.459234354, 0.725846086], abs=1e-8)
