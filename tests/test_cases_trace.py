"""Paths, folds and sensitivities that failed once, each with the right value from a second method.

The files are in `tests/cases`; each is the smallest one of its kind.
"""

from __future__ import annotations

from pathlib import Path

import mpmath as mp
import numpy as np
import pytest
from typer.testing import CliRunner

from simulator import EventKind, load_scenario
from simulator.analysis.fold import fold
from simulator.analysis.sensitivity import sensitivities
from simulator.analysis.start import sealed_state
from simulator.analysis.trace import trace, trace_all, trace_inflation
from simulator.cli import app
from simulator.scenario import ScenarioError
from tests.pairs import pair, run

CASES = Path(__file__).parent / "cases"
FIG3C = "scenarios/fig3c_state_b.toml"


def case(name):
    return load_scenario(CASES / f"{name}.toml")


def limit_points(curve):
    return [point for point in curve.points if point.kind == "limit_point"]


def holds(scenario, curve, tolerance=1e-12):
    """Every point solves the equations, to the size of their terms."""
    equations = sealed_state(scenario)[1].equations
    for stretch, pressure, voltage in zip(curve.stretch, curve.pressure, curve.voltage, strict=True):
        y = [*stretch, pressure, voltage[0]]
        residual, rows = equations.linearised(y)
        sizes = np.abs(np.array(rows, dtype=float)) @ np.abs(y)
        walls = zip(equations.walls, stretch, strict=True)
        sizes += [*(abs(wall.elastomer.pole_form(x)[0]) for wall, x in walls), 1.0]
        assert np.all(np.abs(residual) <= tolerance * sizes)


# -- a limit point that is found again ----------------------------------------------------------------------


def gent(J):
    return lambda x: 2 * (x - x**-5) / (1 - (2 * x * x + x**-4 - 3) / J)


def mooney_rivlin(c1, c2):
    return lambda x: 2 * (x - x**-5) * (c1 + c2 * x * x) / (c1 + c2)


def exact_limit_point(balloons, amount, ambient, guess):
    """λ… and φ at a limit point of balloons (f, k, driven) of equal size on a gas, in 30 digits."""
    count = len(balloons)

    def forces(*z):
        volume = sum(x**3 for x in z[:count]) / 3
        pressure = amount / volume - ambient
        return [
            k * f(x) - pressure * x**2 - 2 * driven * z[-1] ** 2 * x**3
            for (f, k, driven), x in zip(balloons, z, strict=False)
        ]

    def system(*z):
        slopes = mp.matrix(count, count)
        for j in range(count):
            for i in range(count):
                slopes[i, j] = mp.diff(lambda x, i=i, j=j: forces(*z[:j], x, *z[j + 1 :])[i], z[j])
        return [*forces(*z), mp.det(slopes)]

    with mp.workdps(30):
        return [float(x) for x in mp.findroot(system, [mp.mpf(float(x)) for x in guess])]


@pytest.mark.parametrize(
    ("name", "balloons", "count", "end"),
    [
        ("trace-soft", [(mooney_rivlin(1, mp.mpf("0.21")), 1, 1)], 1, "unbounded"),
        (
            "trace-same-point-again",
            [(gent(100), mp.mpf("0.6"), 0), (mooney_rivlin(2, mp.mpf("0.3")), 1, 1)],
            5,
            "loss_of_tension",
        ),
    ],
)
def test_the_path_goes_on_beyond_a_limit_point_at_which_the_voltage_hardly_turns(name, balloons, count, end):
    scenario = case(name)
    curve = trace(scenario)
    holds(scenario, curve)
    assert curve.end.kind == end
    turns = limit_points(curve)
    assert len(turns) == count
    ambient = scenario.gas.ambient_pressure
    amount = (curve.pressure[0] + ambient) * np.sum(curve.stretch[0] ** 3) / 3
    for turn in turns:
        *stretch, voltage = exact_limit_point(balloons, amount, ambient, [*turn.stretch, turn.voltage[0]])
        assert turn.voltage[0] == pytest.approx(voltage, rel=1e-12)
        assert turn.stretch == pytest.approx(stretch, rel=1e-8)
    # v turns at each of them, and the number of unstable directions changes by one.
    rising = np.sign(np.diff(curve.voltage[:, 0]))
    assert np.count_nonzero(rising[1:] * rising[:-1] < 0) == count
    assert set(np.abs(np.diff(curve.unstable))) == {0, 1}


def test_a_gas_in_a_vacuum_never_loses_its_pressure():
    scenario = case("trace-soft")
    curve = trace(scenario)
    assert curve.end.stretch[0] == pytest.approx(1e3, rel=1e-12)
    assert curve.end.pressure == pytest.approx(
        curve.pressure[0] * (curve.stretch[0, 0] / 1e3) ** 3, rel=1e-12
    )


# -- where a path begins, and where it ends -----------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("trace-after-runaway", "the inflation ends in a runaway at p = 1.23946"),
        ("trace-tabulated", "the inflation ends in out of range at p = 0.381734"),
    ],
)
def test_there_is_no_path_from_an_inflation_that_ends(name, said):
    """The peak of a neo-Hookean balloon, and that of the measured curve, whose valley is out of reach."""
    scenario = case(name)
    assert run(scenario).outcome in ("runaway", "out_of_range")
    for verb in (trace, trace_all, lambda s: fold(s, "gas.ambient_pressure", 2.0)):
        with pytest.raises(ScenarioError, match=said) as error:
            verb(scenario)
        assert error.value.key == "step.1.inflate"
    assert CliRunner().invoke(app, ["trace", str(CASES / f"{name}.toml")]).exit_code == 2


def test_a_path_ends_at_the_end_of_a_measured_curve():
    scenario = case("trace-tabulated-sealed")
    curve = trace(scenario)
    holds(scenario, curve)
    assert curve.end.kind == "out_of_range"
    assert curve.end.stretch[0] == pytest.approx(3.7313, rel=1e-12)


def test_a_path_with_the_valve_open_is_that_of_a_balloon_at_constant_pressure():
    """φ²= (f − pλ²)/(2λ³) at p = 1.1, the passive balloon stays."""
    scenario = pair(1.1, {"ramp": 0.6, "valve": "open"})
    curve = trace(scenario)
    x = curve.stretch[:, 0]
    exact = [float((gent(100)(a) - mp.mpf("1.1") * a**2) / (2 * a**3)) for a in x.tolist()]
    assert curve.voltage[:, 0] ** 2 == pytest.approx(exact, rel=1e-10, abs=1e-13)
    assert np.ptp(curve.pressure) == 0.0
    assert np.ptp(curve.stretch[:, 1]) < 1e-14
    first = limit_points(curve)[0]
    (event,) = [e for e in run(scenario).events if e.kind is EventKind.LIMIT_POINT]
    assert first.voltage[0] == pytest.approx(event.voltage[0], rel=1e-13)
    assert first.stretch == pytest.approx(event.stretch_before, rel=1e-9)
    sealed = limit_points(trace(pair(1.1, {"ramp": 0.6})))
    assert not sealed or abs(sealed[0].voltage[0] - first.voltage[0]) > 1e-3
    # The energy, with −pV of the supply, falls along the path as ∫q dφ rises.
    mean = 0.5 * (curve.charge[1:, 0] + curve.charge[:-1, 0])
    work = float(mean @ np.diff(curve.voltage[:, 0]))
    assert curve.energy[-1] - curve.energy[0] == pytest.approx(-work, rel=1e-3)


def test_a_limit_point_with_the_valve_open_is_followed_in_a_second_number():
    scenario = pair(1.1, {"ramp": 0.6, "valve": "open"})
    curve = fold(scenario, "step.1.inflate", 1.2)
    assert (curve.end, curve.balloons) == ("reached", ("active",))
    (turn, *_) = limit_points(trace(pair(1.2, {"ramp": 0.6, "valve": "open"})))
    assert curve.voltage[-1] == pytest.approx(turn.voltage[0], rel=1e-12)
    assert curve.pressure[-1] == pytest.approx(1.2, rel=1e-15)
    # Where the voltage of the limit point is 0 the balloon snaps by its pressure alone.
    end = fold(scenario, "step.1.inflate", 2.0)
    assert end.end == "zero_voltage"
    assert end.value[-1] == pytest.approx(1.2536545513298676, rel=1e-12)


def test_a_path_is_of_one_valve():
    scenario = pair(1.1, {"ramp": 0.2, "valve": "open"}, {"ramp": 0.6})
    with pytest.raises(ScenarioError, match="must be that of the other steps") as error:
        trace(scenario)
    assert error.value.key == "step.3.valve"


def test_a_path_is_of_equilibria_whatever_the_dynamics():
    """The gas is sealed in equilibrium at the pressure reached, not in the state of a late balloon."""
    still = pair(1.2, {"ramp": 0.3}, ambient=0.015)
    late = load_scenario({**still.to_dict(), "dynamics": {"relaxation_time": 0.5}})
    assert trace(late).end.voltage[0] == trace(still).end.voltage[0]


# -- numbers that cannot be followed to ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("vary", "to", "said"),
    [
        ("balloon.active.radius", "-1", "must be a number > 0"),
        ("balloon.*.thickness", "0", "must be a number > 0"),
        ("gas.ambient_pressure", "-1", "must be a number >= 0"),
        ("step.1.inflate", "-0.5", "must be a number > 0"),
        ("balloon.*.elastomer.J_lim", "-3", "must be a number > 0"),
        ("gas.ambient_pressure", "0.015", "the present value"),
        ("balloon.active.radius", "1", "the present value"),
    ],
)
def test_a_fold_goes_to_another_value_of_its_key(tmp_path, vary, to, said):
    with pytest.raises(ScenarioError, match=said) as error:
        fold(load_scenario(FIG3C), vary, to)
    assert error.value.key == "to"
    done = CliRunner().invoke(
        app, ["fold", FIG3C, "--vary", vary, "--to", to, "--out", str(tmp_path / "out")]
    )
    assert done.exit_code == 2
    assert said in done.stderr
    assert not (tmp_path / "out").exists()


def test_a_fold_ends_where_the_inflation_leads_to_another_state():
    """Below its peak pressure a balloon is not inflated to the large stretch that the curve began with."""
    rubber = {"model": "mooney-rivlin", "C1": 1.0, "C2": 0.149}
    scenario = load_scenario(
        {
            "title": "three alike",
            "gas": {"ambient_pressure": 100.0},
            "balloon": [
                {"name": "a", "electrodes": True, "elastomer": rubber},
                {"name": "b", "electrodes": True, "elastomer": rubber},
                {"name": "c", "elastomer": rubber},
            ],
            "step": [{"inflate": 1.573}],
        }
    )
    curve = fold(scenario, "step.1.inflate", 1.35)
    peak = limit_points(trace_inflation(scenario))[0].pressure
    assert curve.end == "inflation_limit"
    assert curve.value[-1] == pytest.approx(peak, rel=1e-9)


# -- sensitivities ------------------------------------------------------------------------------------------


def test_with_dynamics_a_limit_point_has_no_sensitivities(tmp_path):
    scenario = load_scenario(
        {
            **pair(1.2, {"ramp": 0.4, "over": 10}, ambient=0.015).to_dict(),
            "dynamics": {"relaxation_time": 0.01},
        }
    )
    history = run(scenario)
    event = next(e for e in history.events if e.kind is EventKind.LIMIT_POINT)
    with pytest.raises(ValueError, match="passed late"):
        sensitivities(history, event)
    from simulator.sweep.reading import read_sweep

    with pytest.raises(ScenarioError, match=r"record\.sensitivities.*not with \[dynamics\]"):
        read_sweep(
            {
                "scenario": scenario.to_dict(),
                "vary": {"gas.ambient_pressure": [0.1, 0.2]},
                "record": {"sensitivities": True},
            }
        )
