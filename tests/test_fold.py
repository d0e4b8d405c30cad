"""Limit points followed in a second parameter: against traces, and the ends that have names."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest

from simulator.analysis.fold import fold
from simulator.analysis.trace import trace
from simulator.scenario import ScenarioError, load_scenario
from simulator.solver.follow import PathError
from simulator.solver.ida import IntegrationError
from tests.closed_form import Pair, force
from tests.pairs import pair

FIG3C = "scenarios/fig3c_state_b.toml"
FIG2 = "scenarios/fig2_inflation.toml"


def limit_points(scenario):
    return [point for point in trace(scenario).points if point.kind == "limit_point"]


def test_against_traces_at_ten_values():
    curve = fold(load_scenario(FIG3C), "gas.ambient_pressure", 0.2)
    assert curve.end == "reached"
    for i in np.linspace(0, len(curve) - 1, 10).astype(int):
        (point, *_) = limit_points(pair(1.2, {"ramp": 0.1}, ambient=float(curve.value[i])))
        assert curve.voltage[i] == pytest.approx(point.voltage[0], abs=1e-10)
        assert curve.stretch[i] == pytest.approx(point.stretch, abs=1e-8)
        assert curve.pressure[i] == pytest.approx(point.pressure, abs=1e-8)
    # At its end it is the limit point of Fig. 3b, state B.
    voltage, active, *_ = Pair("1", "0.2", "1.2").limit_point(2.1204, 1.03)
    assert curve.voltage[-1] == pytest.approx(float(voltage), abs=1e-12)
    assert curve.stretch[-1, 0] == pytest.approx(float(active), abs=1e-10)


@pytest.mark.parametrize(
    ("key", "to", "made"),
    [
        ("step.1.inflate", 0.9, lambda q: pair(q, {"ramp": 0.1}, ambient=0.015)),
        ("balloon.active.radius", 0.5, lambda q: pair(1.2, {"ramp": 0.1}, ambient=0.015, radius=q)),
        ("balloon.*.elastomer.J_lim", 60.0, lambda q: pair(1.2, {"ramp": 0.1}, ambient=0.015, J_lim=q)),
        (
            "balloon.passive.thickness",
            2.0,
            lambda q: pair(1.2, {"ramp": 0.1}, ambient=0.015, passive={"thickness": q}),
        ),
    ],
)
def test_any_number_can_be_varied(key, to, made):
    curve = fold(load_scenario(FIG3C), key, to)
    assert curve.end == "reached"
    assert curve.value[-1] == to
    for i in (len(curve) // 2, -1):
        voltages = [point.voltage[0] for point in limit_points(made(float(curve.value[i])))]
        assert min(abs(v - curve.voltage[i]) for v in voltages) < 1e-10


def test_permittivity_only_scales_the_voltage():
    curve = fold(load_scenario(FIG3C), "balloon.active.permittivity", 4.0)
    assert curve.voltage * np.sqrt(curve.value) == pytest.approx(
        np.full(len(curve), curve.voltage[0]), rel=1e-12
    )
    assert np.ptp(curve.stretch, axis=0).max() < 1e-10


def test_peak_and_valley_meet_in_a_cusp():
    """At the cusp p′(λ) = p″(λ) = 0: J = 17.638, in 40 digits."""

    def slopes(stretch, J):
        def pressure(x):
            return force(x, J) / x**2

        return mp.diff(pressure, stretch), mp.diff(pressure, stretch, 2)

    stretch, J = mp.findroot(slopes, (mp.mpf("1.64"), mp.mpf("17.64")))
    for point in (1, 2):
        curve = fold(load_scenario(FIG2), "balloon.*.elastomer.J_lim", 1.0, point=point, inflation="first")
        assert curve.end == "cusp"
        assert curve.value[-1] == pytest.approx(float(J), abs=1e-9)
        assert curve.value[-1] == pytest.approx(17.638, abs=5e-4)
        assert curve.stretch[-1, 0] == pytest.approx(float(stretch), abs=1e-6)


def test_both_limit_points_end_at_the_loss_of_tension():
    """3c B under rising ambient pressure: the border of snaps that have somewhere to land."""
    ends = [fold(load_scenario(FIG3C), "gas.ambient_pressure", 5.0, point=point) for point in (1, 2)]
    assert [curve.end for curve in ends] == ["loss_of_tension"] * 2
    for curve in ends:
        assert curve.pressure[-1] == pytest.approx(0.0, abs=1e-13)
        assert curve.stretch[-1, 1] == pytest.approx(1.0, abs=1e-12)


def test_the_inflated_state_ends_at_the_snap_pressure():
    curve = fold(load_scenario(FIG3C), "step.1.inflate", 2.0)
    assert curve.end == "inflation_limit"
    assert curve.value[-1] == pytest.approx(1.2536545513298676, abs=1e-13)


@pytest.mark.parametrize(
    ("key", "message"),
    [
        ("gas.temperature", "cannot be varied; can be: gas.ambient_pressure"),
        ("balloon.nobody.radius", "cannot be varied"),
        ("balloon.active.name", "cannot be varied"),
        ("step.2.ramp", "cannot be varied"),
    ],
)
def test_what_cannot_be_varied(key, message):
    with pytest.raises(ScenarioError, match=message) as error:
        fold(load_scenario(FIG3C), key, 1.0)
    assert error.value.key == key


def test_a_limit_point_that_is_not_there():
    with pytest.raises(ScenarioError, match="there are 0 limit points"):
        fold(load_scenario("scenarios/fig3a_state_a.toml"), "gas.ambient_pressure", 2.0)
    with pytest.raises(ScenarioError, match="there are 2 limit points"):
        fold(load_scenario(FIG3C), "gas.ambient_pressure", 2.0, point=3)


def test_command(tmp_path):
    from typer.testing import CliRunner

    from simulator.cli import app

    def balloons(*words):
        return CliRunner().invoke(app, ["fold", FIG3C, *words, "--out", str(tmp_path)])

    result = balloons("--vary", "gas.ambient_pressure", "--to", "0.2", "--plot")
    assert result.exit_code == 0
    assert "voltage 0.3953186297" in result.output
    assert (tmp_path / "fold.png").read_bytes().startswith(b"\x89PNG")
    rows = np.genfromtxt(tmp_path / "fold.csv", delimiter=",", names=True, deletechars="")
    assert rows.dtype.names == (
        "gas.ambient_pressure",
        "voltage",
        "stretch_active",
        "stretch_passive",
        "pressure",
    )
    curve = fold(load_scenario(FIG3C), "gas.ambient_pressure", 0.2)
    assert rows["voltage"].tolist() == curve.to_dataframe()["voltage"].tolist()
    assert "9 not reached: loss of tension" in balloons("--vary", "gas.ambient_pressure", "--to", "9").output
    wrong = balloons("--vary", "gas.weight", "--to", "1")
    assert wrong.exit_code == 2


def test_a_curve_that_cannot_be_integrated_is_no_plausible_one(monkeypatch):
    def fails(*_: object) -> None:
        raise IntegrationError("IDA: no step is small enough", np.zeros(1))

    monkeypatch.setattr("simulator.solver.arclength.along", fails)
    with pytest.raises(PathError, match=r"^gas.ambient_pressure from 0.015 to 0.2: IDA: no step is"):
        fold(FIG3C, "gas.ambient_pressure", 0.2)
