"""Where spheres are lost on equilibrium paths, as a second number changes, and its sensitivities."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from simulator import Event, History, Scenario, ScenarioError, load_scenario, simulate
from simulator.analysis.fold import fold
from simulator.analysis.sensitivity import all_sensitivities, sensitivities
from simulator.analysis.shapes import shape_points
from simulator.analysis.trace import trace, trace_inflation
from simulator.events import SHAPE_EVENTS
from simulator.results.curve import Curve, SpecialPoint
from simulator.results.plot import plot_curves, plot_fold
from simulator.scenario.keys import changed_scenario
from simulator.sweep.picking import fold_line
from tests.pairs import pair
from tests.test_shape import LOST_AT

FIG3C = load_scenario("scenarios/fig3c_state_b.toml")
RUBBER = pair(0.3, {"ramp": 0.1}, passive={"elastomer": {"preset": "natural-rubber"}})


def changes(curve: Curve) -> list[SpecialPoint]:
    return [point for point in curve.points if point.kind in SHAPE_EVENTS]


def on_branches(history: History) -> list[Event]:
    return [
        e
        for e in history.events
        if e.balloon and np.array_equal(e.stretch_before, np.asarray(e.stretch_after))
    ]


def test_a_path_has_the_points_of_the_paper_s_histories() -> None:
    lost, regained = changes(trace(FIG3C))
    assert (lost.kind, lost.balloon, lost.mode) == ("loss_of_sphericity", "active", "pear")
    # Along the path the sphere is regained where, voltage falling, a history loses it.
    assert regained.kind == "sphericity_regained"
    for point, (voltage, stretch, pressure) in zip((lost, regained), LOST_AT["fig3c_state_b"], strict=True):
        assert point.voltage[0] == pytest.approx(voltage, abs=1e-11)
        assert point.stretch[0] == pytest.approx(stretch, abs=1e-9)
        assert point.pressure == pytest.approx(pressure, abs=1e-10)


@pytest.mark.parametrize("name", ["fig3c_state_b", "fig5c_state_a", "fig5b_state_a", "ring", "vhb_snap"])
def test_margins_change_their_sign_at_these_points_and_nowhere_else(name: str) -> None:
    curve = trace(load_scenario(f"scenarios/{name}.toml"))
    for i, balloon in enumerate(curve.balloons):
        margins = curve.sphericity[:, i]
        at = np.flatnonzero(margins[:-1] * margins[1:] < 0.0)
        points = [point for point in changes(curve) if point.balloon == balloon]
        assert len(points) == at.size
        for point, k in zip(points, at.tolist(), strict=True):
            assert curve.arclength[k] <= point.arclength <= curve.arclength[k + 1]
            assert (point.kind == "loss_of_sphericity") == (margins[k] > 0.0)
    assert np.array_equal(curve.lost, (curve.sphericity < 0.0).any(axis=1))
    arcs = [point.arclength for point in curve.points]
    assert arcs == sorted(arcs)


def test_an_inflation_of_rubber_has_the_range_that_haughton_and_ogden_gave() -> None:
    curve = trace_inflation(RUBBER, "passive")
    assert [point.stretch[0] for point in changes(curve)] == pytest.approx([1.771879, 2.545318], abs=1e-6)


def test_a_margin_that_dips_below_zero_between_two_points_is_seen() -> None:
    """Beside its turning point in J_lim two losses of one balloon are as close as one likes."""
    end = fold(FIG3C, "balloon.*.elastomer.J_lim", 10.0, of="loss_of_sphericity")
    assert end.end == "turning_point"
    q = float(end.value[-1])
    for beyond, many in ((1e-6, 2), (-1e-6, 0)):
        curve = trace(changed_scenario(FIG3C, "balloon.*.elastomer.J_lim", q * (1.0 + beyond)))
        assert len(changes(curve)) == many


def test_ignored_there_is_nothing() -> None:
    written = FIG3C.to_dict() | {"shape": {"on_loss": "ignore"}}
    curve = trace(load_scenario(written))
    assert changes(curve) == []
    assert curve.sphericity.size == 0
    assert not curve.lost.any()
    assert "spheres" not in curve.to_dataframe()


def test_the_picture_has_three_styles() -> None:
    (ax,) = plot_curves([trace(FIG3C)]).axes
    parts = [line for line in ax.get_lines() if line.get_marker() == "None"]
    assert [line.get_linestyle() for line in parts] == ["-", "-", "--", "-", "-"]
    assert [line.get_alpha() for line in parts] == [None, 0.5, None, 0.5, None]


@pytest.mark.parametrize(
    ("vary", "to", "name"),
    [
        ("gas.ambient_pressure", 0.2, "fig3b_state_b"),
        ("gas.ambient_pressure", 1.0, "fig3a_state_b"),
        ("step.1.inflate", 0.6, "fig3c_state_a"),
    ],
)
def test_followed_it_leads_to_those_of_other_scenarios(vary: str, to: float, name: str) -> None:
    curve = fold(FIG3C, vary, to, of="loss_of_sphericity")
    assert (curve.of, curve.balloon, curve.end) == ("loss_of_sphericity", "active", "reached")
    ((voltage, stretch, pressure),) = LOST_AT[name]
    assert curve.voltage[-1] == pytest.approx(voltage, abs=1e-11)
    assert curve.stretch[-1, 0] == pytest.approx(stretch, abs=1e-9)
    assert curve.pressure[-1] == pytest.approx(pressure, abs=1e-10)


def test_it_ends_where_it_meets_a_limit_point() -> None:
    """5a A loses its sphere beyond its limit point, 3b A before: in between they meet."""
    start = load_scenario("scenarios/fig5c_state_a.toml")
    curve = fold(start, "balloon.active.radius", 2.0, of="loss_of_sphericity")
    assert curve.end == "limit_point"
    q = float(curve.value[-1])
    for inside, first in ((1.0 - 1e-3, "limit_point"), (1.0 + 1e-3, "loss_of_sphericity")):
        path = trace(changed_scenario(start, "balloon.active.radius", q * inside))
        assert path.points[0].kind == first


def test_the_loss_of_an_inflation_is_followed_as_well() -> None:
    curve = fold(RUBBER, "balloon.passive.thickness", 2.0, of="loss_of_sphericity", inflation="passive")
    assert curve.end == "reached"
    assert curve.stretch[:, 0] == pytest.approx(1.771879, abs=1e-6)
    assert curve.pressure[-1] == pytest.approx(2.0 * curve.pressure[0], rel=1e-10)


def test_what_cannot_be_followed_is_said() -> None:
    with pytest.raises(ScenarioError, match="there are 1 of loss of sphericity"):
        fold(FIG3C, "gas.ambient_pressure", 0.2, of="loss_of_sphericity", point=2)
    with pytest.raises(ScenarioError, match="must be one of limit_point, loss_of_sphericity"):
        fold(FIG3C, "gas.ambient_pressure", 0.2, of="breakdown")


def test_files_and_pictures_say_what_is_followed(tmp_path: Path) -> None:
    curve = fold(FIG3C, "step.1.inflate", 1.25, of="loss_of_sphericity")
    (path,) = curve.to_csv(tmp_path)
    assert set(curve.to_dataframe()["loss_of_sphericity"]) == {1}
    assert fold_line(str(path), "step.1.inflate", "step.2.ramp").label == "loss of sphericity"
    assert "loss of sphericity of active" in plot_fold(curve).axes[0].get_ylabel()


def derivative(scenario: Scenario, key: str, value: float, number: int) -> float:
    """dφ/dq of a loss by central differences of fourth order of whole histories."""
    step = 1e-3 * abs(value)

    def voltage(times: int) -> float:
        history = simulate(changed_scenario(scenario, key, value + times * step))
        return float(on_branches(history)[number].voltage[0])

    return (voltage(-2) - 8.0 * voltage(-1) + 8.0 * voltage(1) - voltage(2)) / (12.0 * step)


@pytest.mark.parametrize(
    "key", ["gas.ambient_pressure", "balloon.active.radius", "balloon.passive.modulus", "step.1.inflate"]
)
def test_sensitivities_are_those_of_histories(key: str) -> None:
    history = simulate(FIG3C)
    for number, event in enumerate(on_branches(history)):
        (one,) = sensitivities(history, event, [key])
        assert (one.kind, one.of) == ("loss_of_sphericity", "voltage_active")
        assert one.derivative == pytest.approx(derivative(FIG3C, key, one.parameter, number), rel=1e-6)


def test_sensitivities_with_the_valve_open() -> None:
    """In an inflation that follows a voltage the pressure of the loss moves."""
    scenario = pair(
        0.2,
        {"ramp": 0.5, "valve": "open"},
        {"inflate": 0.5},
        J_lim=60.0,
        passive={"elastomer": {"preset": "natural-rubber"}},
    )
    history = simulate(scenario)
    for event in on_branches(history):
        for one in sensitivities(history, event, ["balloon.active.modulus"]):
            assert np.isfinite(one.derivative)


def test_what_happens_in_a_snap_has_none() -> None:
    history = simulate(FIG3C)
    landed = next(e for e in history.events if e.balloon and e not in on_branches(history))
    with pytest.raises(ValueError, match="on a branch"):
        sensitivities(history, landed)
    kinds = {one.kind for one in all_sensitivities(history)}
    assert kinds == {"limit_point", "loss_of_sphericity"}


def test_points_of_a_path_are_states_of_it() -> None:
    from simulator.analysis.path import whole_path
    from simulator.analysis.trace import sealed_state
    from simulator.model.conditions import shape_conditions

    _, group, start = sealed_state(FIG3C)
    equations = group.equations
    points = whole_path(group, start).points(equations.scales)
    (one,) = shape_conditions(equations)
    for point in shape_points(group, points):
        assert one.condition.margin(point.state.tolist()) == pytest.approx(0.0, abs=1e-10)
        assert np.max(np.abs(equations.residual(point.state))) < 1e-11
