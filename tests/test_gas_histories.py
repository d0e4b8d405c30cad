"""Histories on gases, chambers and liquids: conservation, the valve, limit points, and how they are told."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import null_space
from scipy.optimize import brentq

from simulator import simulate
from simulator.analysis.fold import fold
from simulator.analysis.trace import trace
from simulator.model.device import Device
from simulator.model.drive import VoltageLine
from simulator.scenario import ScenarioError, load_scenario
from simulator.simulation.explanation import explain
from tests.pairs import kinds, pair, run, single
from tests.test_gas import LAWS, UP_AND_DOWN, ClosedForm, gas, last

# -- conservation ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
@pytest.mark.parametrize(
    ("inflate", "radius", "ambient"), [(1.2, 1.0, 0.015), (2.4, 0.5, 1.0), (1.2, 0.5, 0.05)]
)
def test_what_is_sealed_in_stays_and_the_energy_closes(law, inflate, radius, ambient):
    steps = [*UP_AND_DOWN, {"jump": 0.15}, {"jump": 0.0}]
    history = run(pair(inflate, *steps, radius=radius, **gas(ambient, **law)))
    assert history.energy_balance.relative_imbalance < 1e-8
    for event in history.events:
        if event.kind.value == "limit_point" and event.stretch_after is not None:
            before = np.flatnonzero(history.time == event.time)[0]
            lost = history.energy[before] - history.energy[before + 1]
            assert event.dissipated == pytest.approx(lost, rel=1e-9, abs=1e-9)
            assert lost > 0.0
    closed = history.step > 1
    p, volume = history.pressure[closed], history.volume[closed]
    match law.get("law"):
        case "liquid":
            constant = volume
        case "adiabatic":
            constant = (p + ambient) * volume ** law.get("exponent", 1.4)
        case _:
            constant = (p + ambient) * volume
            assert constant == pytest.approx(history.gas[closed], rel=1e-14)
    assert constant == pytest.approx(constant[0], rel=1e-14)
    assert np.ptp(history.gas[closed]) == 0.0
    balloons = (radius**3 * history.stretch[:, 0] ** 3 + history.stretch[:, 1] ** 3) / 3
    assert history.volume == pytest.approx(balloons + law.get("chamber", 0.0), rel=1e-15)


def test_snaps_on_a_liquid():
    """The snap of 5b B under a liquid: no volume is lost on the way, and Π falls by what is told."""
    history = run(pair(2.4, {"ramp": 0.2}, {"ramp": 0.0}, radius=0.5, **gas(law="liquid")))
    snap = next(e for e in history.events if e.step == 2)
    assert snap.stretch_after[0] > 5.0
    volumes = [(0.125 * s[0] ** 3 + s[1] ** 3) / 3 for s in (snap.stretch_before, snap.stretch_after)]
    assert volumes[0] == pytest.approx(volumes[1], rel=1e-15)
    rows = np.flatnonzero(history.time == snap.time)
    assert snap.dissipated == pytest.approx(history.energy[rows[0]] - history.energy[rows[1]], rel=1e-10)
    assert snap.dissipated > 0.0


def test_a_snap_on_a_liquid_that_loses_its_tension_keeps_its_volume():
    history = run(pair(2.4, {"ramp": 0.2}, {"jump": 1.0}, radius=0.5, **gas(law="liquid")))
    assert history.outcome.value == "loss_of_tension"
    assert history.pressure[-1] == pytest.approx(0.0, abs=1e-12)
    closed = history.volume[history.step > 1]
    assert closed == pytest.approx(closed[0], rel=1e-14)


def test_the_stability_column_is_the_curvature_of_the_energy():
    """Along constant volume for a liquid, at constant entropy for an adiabatic gas; by differences."""
    made = {name: load_scenario({**_minimal(), **gas(0.3, **law)}) for name, law in LAWS.items()}
    for name, scenario in made.items():
        balloons = Device.from_scenario(scenario)
        stretch, voltage = np.array([[1.6, 1.3]]), np.array([[0.2]])
        pressure = np.array([0.4])
        contents = balloons.law.sealed(0.4, float(balloons.swelling(stretch)[0]))
        sealed = balloons.sealed(contents, VoltageLine.common(1))

        def potential(x, sealed=sealed):
            return float(sealed.potential([*x, 0.0, 0.2]))

        # At an equilibrium of a liquid −pV would be stationary; the multiplier is the pressure.
        h, hessian = 1e-4, np.empty((2, 2))
        for i in range(2):
            for j in range(2):
                corners = [
                    potential(stretch[0] + a * h * np.eye(2)[i] + b * h * np.eye(2)[j])
                    for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1))
                ]
                hessian[i, j] = (corners[0] - corners[1] - corners[2] + corners[3]) / (4 * h * h)
        if name == "liquid":
            arms = stretch[0] ** 2
            hessian -= 0.4 * np.diag(2 * stretch[0])
            across = null_space(arms[None, :])
            hessian = across.T @ hessian @ across
        found = balloons.stability(stretch, pressure, voltage, np.array([False]))[0]
        assert found == pytest.approx(np.linalg.eigvalsh(hessian)[0], rel=1e-4, abs=1e-4)


def _minimal():
    gent = {"model": "gent", "J_lim": 100}
    return {
        "title": "t",
        "balloon": [{"name": "a", "electrodes": True, "elastomer": gent}, {"name": "b", "elastomer": gent}],
        "step": [{"inflate": 1.0}],
    }


@pytest.mark.parametrize("law", ["isothermal", "adiabatic", "liquid"])
def test_opening_and_closing_the_valve(law):
    """A valve that opens and closes where nothing moves changes nothing that follows."""
    idle = {"hold": 1, "valve": "open"}
    through, with_idle = (
        run(pair(1.1, {"ramp": 0.2}, *between, {"ramp": 0.3}, **gas(0.5, law=law)))
        for between in ([], [idle])
    )
    assert last(with_idle) == pytest.approx(last(through), abs=1e-12)
    amounts = [with_idle.gas[with_idle.step == k][-1] for k in (2, 4)]
    if law == "adiabatic":
        # Cooled by its expansion the gas takes in more at the supply's temperature.
        row = np.flatnonzero(with_idle.step == 3)[-1]
        amount = (with_idle.pressure[row] + 0.5) * with_idle.volume[row]
        assert amounts[1] == pytest.approx(amount, rel=1e-14)
        assert amounts[1] < amounts[0]
    else:
        assert amounts[1] == pytest.approx(amounts[0], rel=1e-14)


# -- a limit point in a second number -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("vary", "to"), [("gas.chamber", 2.0), ("balloon.active.radius", 0.45), ("gas.ambient_pressure", 0.2)]
)
@pytest.mark.parametrize("law", [{"law": "adiabatic", "chamber": 1.0}, {"law": "liquid", "chamber": 1.0}])
def test_folds(vary, to, law):
    """Where a limit point has got to is where the path of the changed scenario has it."""
    made = {"chamber": law["chamber"], "ambient": 0.1, "radius": 0.5}

    def scenario(**changes):
        now = {**made, **changes}
        filled = gas(now["ambient"], law=law["law"], chamber=now["chamber"])
        return pair(2.4, {"ramp": 0.1}, radius=now["radius"], **filled)

    followed = fold(scenario(), vary, to)
    assert followed.end == "reached"
    key = {"gas.chamber": "chamber", "gas.ambient_pressure": "ambient"}.get(vary, "radius")
    turns = [p for p in trace(scenario(**{key: to})).points if p.kind == "limit_point"]
    assert followed.voltage[-1] == pytest.approx(turns[0].voltage[0], rel=1e-10)


# -- what is told ---------------------------------------------------------------------------------------


def test_explanations():
    def text(**filled):
        return explain(pair(0.6, {"ramp": 0.1}, **gas(1.0, **filled)))

    assert "gas: (p + 1) (2.5 + Σ r³λ³/3) = n" in text(chamber=2.5)
    assert "gas: (p + 1) (Σ r³λ³/3)^1.4 = constant" in text(law="adiabatic")
    assert "gas: (p + 1) (2 + Σ r³λ³/3)^1.67 = constant" in text(law="adiabatic", exponent=1.67, chamber=2)
    assert "liquid: Σ r³λ³/3 = constant" in text(law="liquid", chamber=2)


@pytest.mark.parametrize(
    ("filled", "message"),
    [
        ({"chamber": -1}, "gas.chamber = -1: must be a number >= 0"),
        ({"chamber": np.inf}, "gas.chamber = inf: must be a finite number >= 0"),
        ({"law": "real"}, 'gas.law = "real": must be "isothermal", "adiabatic" or "liquid"'),
        ({"law": "adiabatic", "exponent": 1}, "gas.exponent = 1: must be a number > 1"),
        ({"law": "adiabatic", "exponent": "air"}, 'gas.exponent = "air": must be a number > 1'),
        ({"exponent": 1.3}, 'gas.exponent = 1.3: needs law = "adiabatic", is isothermal'),
        ({"law": "liquid", "exponent": 1.3}, 'gas.exponent = 1.3: needs law = "adiabatic", is liquid'),
    ],
)
def test_refusals(filled, message):
    with pytest.raises(ScenarioError) as caught:
        single({"inflate": 1}, **gas(1.0, **filled))
    assert str(caught.value) == f"<dict>: {message}"


@pytest.mark.parametrize("chamber", [1e3, 1e5, 1e8])
def test_large_chambers_under_high_ambient_pressure(chamber):
    """Beside them (p + pₑ)V hardly changes: p is right to rounding all the same."""
    steps = [{"inflate": 1.2}, {"ramp": 0.16, "over": 10}, {"ramp": 0.0, "over": 10}]
    history = run(single(*steps, **gas(60.0, chamber=chamber)))
    assert kinds(history) == ["limit_point"]
    x, p, phi = history.stretch[101:, 0], history.pressure[101:], history.voltage[101:, 0]
    assert p == pytest.approx(ClosedForm.force(x) / x**2 - 2 * phi**2 * x, abs=1e-12)
    swelling = x**3 / 3
    start = history.stretch[100, 0] ** 3 / 3
    fall = 61.2 * (swelling - start) / (chamber + swelling)
    assert p == pytest.approx(1.2 - fall, abs=1e-12)
    assert history.energy_balance.relative_imbalance < 1e-8


def test_the_figure_of_chambers_ends_in_the_open_valve():
    """The limit curve of the figure is the equilibrium of the history with the valve open."""
    from tests.studies.figures.chamber import open_valve

    scenario = load_scenario("scenarios/keplinger_chamber.toml")
    stretch, voltage, stable = open_valve(scenario)
    opened = run(single({"inflate": 1.2}, {"ramp": 0.16, "valve": "open"}, **gas(60.0)))
    for row in (120, 150, -1):
        place = int(np.argmin(np.abs(stretch - opened.stretch[row, 0])))
        assert voltage[place] == pytest.approx(opened.voltage[row, 0], abs=1e-2)
        assert stable[place]
    rise = np.diff(voltage) > 0
    valid = np.isfinite(voltage[1:]) & np.isfinite(voltage[:-1]) & (stable[1:] == stable[:-1])
    assert (rise == stable[1:])[valid].all()


def test_a_jump_that_would_need_a_liquid_below_zero_pressure_loses_the_tension_at_once():
    """A gas keeps its pressure while the stretches stand; that of a liquid follows the voltage at once."""
    history = run(single({"inflate": 0.5}, {"jump": 0.9}, **gas(law="liquid")))
    assert kinds(history) == ["loss_of_tension"]
    assert history.events[0].stretch_after is None
    assert history.pressure[-1] == pytest.approx(0.5)
    assert history.voltage[-1, 0] == 0.0
    assert kinds(run(single({"inflate": 0.5}, {"jump": 0.3}, **gas(law="liquid")))) == ["jump"]


def test_the_smallest_chamber_on_which_a_balloon_snaps():
    """There the limit point ends in a cusp: on a smaller one the voltage rises throughout."""
    scenario = load_scenario("scenarios/keplinger_chamber.toml")
    end = fold(scenario, "gas.chamber", 100.0)
    assert end.end == "cusp"
    start = brentq(lambda x: ClosedForm.force(x) / x**2 - 1.2, 1.1, 1.39, xtol=1e-15)

    def least_rise(chamber):
        x = np.linspace(start, 3.0, 20_001) + 1e-30j
        swelling = (x**3 - start**3) / 3
        p = 1.2 - 61.2 * swelling / (chamber + x**3 / 3)
        return float(np.min(((ClosedForm.force(x) - p * x**2) / (2 * x**3)).imag))

    assert brentq(least_rise, 300.0, 360.0, rtol=1e-12) == pytest.approx(end.value[-1], rel=1e-6)


@pytest.mark.parametrize(("gas", "gamma"), [({"law": "adiabatic"}, 1.4), ({"chamber": 1.0}, 1.0)], ids=str)
def test_far_from_where_it_was_sealed_a_gas_has_all_its_digits(gas, gamma):
    """(p + pₑ)V^γ stays: of p where the volume has grown by 10⁷, and of the stretch where p is lost."""
    wall = {"model": "ogden", "mu": [2.5, -0.139, 0.001567], "alpha": [1.493, -1.712, 5.171]}
    scenario = {
        "title": "far",
        "gas": {"ambient_pressure": 0.0, **gas},
        "balloon": [{"name": "a", "electrodes": True, "elastomer": wall}],
        "step": [{"inflate": 0.1}, {"ramp": 0.95}],
        "shape": {"on_loss": "ignore"},
    }
    chamber = gas.get("chamber", 0.0)
    history = run(load_scenario(scenario))
    volume = chamber + history.stretch[history.step > 0, 0] ** 3 / 3.0
    sealed = np.flatnonzero(history.step == 1)[-1]
    right = 0.1 * (volume[sealed] / volume[-1]) ** gamma
    assert volume[-1] > 1e7 * volume[sealed]
    assert history.pressure[-1] == pytest.approx(right, rel=1e-13)
    scenario["gas"]["ambient_pressure"] = 1e-6
    lost = run(load_scenario(scenario))
    assert lost.outcome == "loss_of_tension"
    right = (0.1 / 1e-6 + 1.0) ** (1.0 / gamma) * volume[sealed]
    assert chamber + lost.stretch[-1, 0] ** 3 / 3.0 == pytest.approx(right, rel=1e-13)


def sealed_without_pressure(*steps, **more):
    """A small balloon and a large one, actuated, and sealed at no excess pressure."""
    balloons = [
        {"name": name, "radius": radius, "electrodes": True, "elastomer": {"model": "gent", "J_lim": 100}}
        for name, radius in (("small", 0.3), ("large", 1.0))
    ]
    opened = {"ramp": 0.2, "over": 1.0, "valve": "open"}
    return simulate(
        {
            "title": "t",
            "gas": {"ambient_pressure": 2.0},
            "balloon": balloons,
            "step": [opened, *steps],
            **more,
        }
    )


def test_sealed_without_pressure_tension_is_lost_where_the_volume_would_grow():
    """Where one voltage rises and the other falls, the large balloon decides."""
    on = sealed_without_pressure({"ramp": {"small": 0.5, "large": 0.0}, "over": 1.0})
    assert on.outcome == "completed"
    assert on.pressure[-1] > 1e-3
    lost = sealed_without_pressure({"ramp": {"small": 0.0, "large": 0.5}, "over": 1.0})
    assert (kinds(lost), lost.events[0].time) == (["loss_of_tension"], 1.0)
    at_once = sealed_without_pressure({"jump": {"small": 0.5, "large": 0.0}})
    assert (kinds(at_once), at_once.outcome) == (["jump"], "completed")
    assert kinds(sealed_without_pressure({"jump": {"small": 0.0, "large": 0.5}})) == ["loss_of_tension"]


def test_in_real_time_a_jump_loses_no_tension_before_time_passes():
    moving = {"dynamics": {"relaxation_time": 0.1}}
    assert sealed_without_pressure({"jump": 0.5}, **moving).outcome == "completed"
    lost = sealed_without_pressure({"jump": 0.5}, {"hold": 0.1}, **moving)
    assert [(event.kind.value, event.time) for event in lost.events] == [("loss_of_tension", 1.0)]


def test_in_a_vacuum_a_jump_through_zero_to_a_larger_voltage_loses_the_tension():
    empty = {"gas": {"ambient_pressure": 0.0}}
    assert kinds(sealed_without_pressure({"jump": -0.3}, **empty)) == ["loss_of_tension"]
    assert kinds(sealed_without_pressure({"jump": -0.1}, **empty)) == ["jump"]


def test_sealed_without_pressure_nothing_happens_before_a_voltage_moves(tmp_path):
    (tmp_path / "late.csv").write_text("time,voltage\n0,0.2\n3,0.2\n4,0.4\n")
    lost = sealed_without_pressure({"table": str(tmp_path / "late.csv")})
    assert (kinds(lost), lost.events[0].time) == (["loss_of_tension"], 4.0)


def test_in_motion_tension_is_lost_where_the_valve_is_closed_on_growing_balloons():
    slow = {"dynamics": {"relaxation_time": 5.0}}
    lost = sealed_without_pressure({"ramp": 0.0, "over": 1.0}, **slow)
    assert (kinds(lost), lost.events[0].time) == (["loss_of_tension"], 1.0)
    off = sealed_without_pressure({"jump": 0.0}, {"hold": 1.0}, **slow)
    assert (kinds(off), off.outcome) == ([], "completed")


def test_an_event_has_the_voltage_that_it_happens_at_though_another_one_moves_by_rounding():
    """With the valve open each balloon has a limit point of its own, whatever the other one does."""
    gent = {"model": "gent", "J_lim": 100}
    balloons = [
        {"name": n, "radius": r, "electrodes": True, "elastomer": gent} for n, r in (("a", 1), ("b", 1.1))
    ]

    def snap(last: float) -> float:
        opened = {"valve": "open", "over": 1.0}
        steps = [
            {"inflate": 1.0},
            {"ramp": {"a": -0.1, "b": 0.1}, **opened},
            {"ramp": {"a": last, "b": 0.6}, **opened},
        ]
        gas = {"ambient_pressure": 0.0}
        history = run(load_scenario({"title": "t", "gas": gas, "balloon": balloons, "step": steps}))
        assert kinds(history) == ["limit_point"]
        return float(history.events[0].voltage[1])

    assert snap(math.nextafter(-0.1, 0.0)) == pytest.approx(snap(-0.1), rel=1e-12)
    assert snap(-0.1) == pytest.approx(0.2355806, abs=1e-7)
