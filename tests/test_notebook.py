"""Results as they are used in Python and shown in a notebook."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from simulator import (
    OutputError,
    fold,
    load_curve,
    load_curves,
    load_history,
    load_scenario,
    plot_histories,
    read_sweep,
    simulate,
    trace,
    trace_inflation,
)
from simulator.results.history import Stop
from simulator.results.html import curve_html, history_html
from simulator.results.tables import write_curves
from simulator.scenario.document import scenario_html
from tests.histories import cycled_pair
from tests.pairs import pair

SCENARIOS = Path("scenarios")
SNAP = "scenarios/fig3c_state_b.toml"


@pytest.fixture(scope="module")
def history():
    return simulate(SNAP)


def test_a_history_is_one_line(history):
    assert repr(history).startswith("<History 'Fig. 3c, state B: a snap and its way back': completed, ")
    assert len(repr(history)) < 120
    assert repr(history.events[0]).startswith("<Event ")


def test_a_history_shows_its_events_and_its_picture(history):
    shown = history_html(history)
    assert "limit point" in shown
    assert "completed at time 26" in shown
    assert 'src="data:image/png;base64,' in shown
    assert len(shown) < 200_000


def test_titles_are_text_in_a_notebook():
    history = simulate(pair(0.5, {"ramp": 0.1}).model_copy(update={"title": "<b>bold</b>"}))
    assert "&lt;b&gt;bold" in history_html(history)


def test_columns_by_name(history):
    assert np.array_equal(history["stretch_active"], history.stretch[:, 0])
    assert np.array_equal(history["pressure"], history.pressure)
    with pytest.raises(KeyError, match="'stretch' is no column, has time, step, branch"):
        history["stretch"]


def test_quantities_in_si_units():
    history = simulate("scenarios/vhb_snap.toml")
    scales = history.scenario.scales
    assert history.si("pressure") == pytest.approx(history.pressure * scales.pressure, rel=1e-15)
    assert history.si("voltage_active").max() == pytest.approx(5500.0)
    with pytest.raises(KeyError, match="'stability' has no SI unit here, have time, voltage_active"):
        history.si("stability")
    with pytest.raises(KeyError, match="no \\[scales\\]"):
        simulate(SNAP).si("pressure")


def test_a_state_at_any_time(history):
    row = 150
    here = history.at(float(history.time[row]))
    assert here["stretch_active"] == history.stretch[row, 0]
    between = history.at(0.5 * (history.time[row] + history.time[row + 1]))
    assert between["pressure"] == pytest.approx(history.pressure[row : row + 2].mean(), rel=1e-14)
    snap = next(event for event in history.events if event.kind == "limit_point")
    assert history.at(snap.time)["stretch_active"] == snap.stretch_after[0]
    assert history.at(26.0)["time"] == 26.0
    with pytest.raises(ValueError, match="time 27 is not in the history, which has from 0 to 26"):
        history.at(27.0)


def test_histories_are_equal_where_what_happened_is(history):
    assert history == simulate(SNAP)
    assert history != simulate(load_scenario(SNAP).with_values({"step.2.ramp": 0.39}))
    assert history.events[0] == simulate(SNAP).events[0]
    assert history.events[0] != history.events[1]
    assert history != 3
    assert len({history, simulate(SNAP)}) == 1


def test_curves_are_equal_and_show_themselves():
    curve = trace(SNAP)
    assert curve == trace(SNAP)
    assert repr(curve).startswith("<Curve ")
    assert "limit_point" in repr(curve)
    assert "loss of tension" in curve_html(curve)


def test_a_loop_in_axes_of_ones_own(history):
    ax = Figure().add_subplot()
    assert history.plot(ax=ax) is ax
    assert ax.get_lines()


def test_several_histories_in_one_panel(history):
    other = cycled_pair()
    ax = plot_histories([history, other], labels=["one", "two $x"])
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["one", "two \\$x"]
    colours = {line.get_color() for line in ax.get_lines()}
    assert {"#0072B2", "#D55E00"} <= colours
    with pytest.raises(ValueError, match="1 labels for 2 histories"):
        plot_histories([history, other], labels=["one"])


@pytest.mark.parametrize(
    "name",
    [
        "vhb_snap",
        "breakdown_acrylic",
        "fig2_inflation",
        "delayed_snap",
        "until_snap",
        "push_pull",
        "liquid_pair",
    ],
)
def test_a_history_that_was_written_is_read_back_exactly(name, tmp_path):
    history = simulate(SCENARIOS / f"{name}.toml")
    history.to_csv(tmp_path)
    again = load_history(tmp_path)
    assert again == history
    assert again.statistics == history.statistics
    for field in dataclasses.fields(history):  # down to the last type
        one, other = getattr(history, field.name), getattr(again, field.name)
        assert type(one) is type(other), field.name
        if isinstance(one, np.ndarray):
            assert (one.dtype, one.shape) == (other.dtype, other.shape), field.name


def test_numbers_that_do_not_exist_are_read_back_as_such(tmp_path):
    """NaN is no JSON: whatever scalar is one must come back as it was."""
    whole = simulate(SCENARIOS / "breakdown_acrylic.toml")

    def without(value):
        numbers = [f.name for f in dataclasses.fields(value) if type(getattr(value, f.name)) is float]
        assert numbers
        return dataclasses.replace(value, **dict.fromkeys(numbers, math.nan))

    wave = {"sine": {"mean": 0.05, "amplitude": 0.05, "period": 1, "cycles": 2}}
    cycled = simulate(pair(1.0, wave, output={"points": 5}))
    history = dataclasses.replace(
        whole,
        energy_balance=without(whole.energy_balance),
        statistics=without(whole.statistics),
        closest=tuple(without(one) for one in whole.closest),
        cycles=tuple(without(one) for one in cycled.cycles),
        stops=(Stop(2, math.nan, None),),
    )
    assert history.closest
    assert history.cycles
    history.to_csv(tmp_path)
    again = load_history(tmp_path)
    assert again == history
    assert again != whole
    assert math.isnan(again.energy_balance.dissipated)
    assert math.isnan(again.cycles[1].dissipated)


def test_histories_that_are_not_there(tmp_path, history):
    with pytest.raises(OutputError, match=r"cannot read .*run\.json.*: no such file"):
        load_history(tmp_path)
    history.to_csv(tmp_path)
    (tmp_path / "history.csv").write_text("time,step\n0,1\n")
    with pytest.raises(OutputError, match="no history in"):
        load_history(tmp_path)
    (tmp_path / "run.json").write_text("{")
    with pytest.raises(OutputError, match="cannot read"):
        load_history(tmp_path)
    with pytest.raises(OutputError, match=r"cannot read .*trace\.json"):
        load_curve(tmp_path)


def test_paths_are_read_back_exactly(tmp_path):
    scenario = load_scenario(SCENARIOS / "vhb_snap.toml")
    for curve in (trace(scenario), trace_inflation(scenario)):
        curve.to_csv(tmp_path)
        assert load_curve(tmp_path) == curve
        assert (load_curve(tmp_path).scales, load_curve(tmp_path).ida_steps) == (
            curve.scales,
            curve.ida_steps,
        )
    write_curves([curve, curve], tmp_path)
    assert load_curves(tmp_path) == (curve, curve)
    with pytest.raises(OutputError, match="holds 2 paths"):
        load_curve(tmp_path)


def test_events_have_si_values():
    history = simulate(SCENARIOS / "vhb_snap.toml")
    snap, scales = history.mechanical[0], history.scenario.scales
    assert snap.si("voltage") == pytest.approx(snap.voltage * scales.voltage, rel=1e-15)
    assert snap.si("pressure_after") == pytest.approx(snap.pressure_after * scales.pressure, rel=1e-15)
    assert snap.si("dissipated") == pytest.approx(snap.dissipated * scales.energy, rel=1e-15)
    assert repr(snap) == "<Event limit_point at time 34.08 s, voltage [4.41467 kV]>"
    for quantity in ("stretch_before", "nothing", "kind"):
        with pytest.raises(KeyError):
            snap.si(quantity)
    with pytest.raises(KeyError, match="no \\[scales\\]"):
        dataclasses.replace(snap, scales=None).si("voltage")


def test_everything_has_one_line_of_its_own():
    scenario = load_scenario(SCENARIOS / "fig3c_state_b.toml")
    title = "'Fig. 3c, state B: a snap and its way back'"
    assert repr(scenario) == f"<Scenario {title}: balloons active, passive; 4 steps>"
    assert "<li>inflate = 1.2</li>" in scenario_html(scenario)
    sweep = read_sweep({"scenario": scenario.to_dict(), "vary": {"step.1.inflate": [1.0, 1.1]}})
    assert repr(sweep) == f"<Sweep {title}: 2 runs, grid over step.1.inflate>"
    limit = fold(scenario, "gas.ambient_pressure", 0.02)
    assert repr(limit).startswith(f"<FoldCurve {title}: ")
    assert limit == fold(scenario, "gas.ambient_pressure", 0.02)


def test_a_path_in_axes_of_ones_own():
    curve, ax = trace(SCENARIOS / "fig3c_state_b.toml"), Figure().add_subplot()
    assert curve.plot(ax=ax) is ax
    assert ax.get_xlabel() == "voltage on active  Φ√(ε/μ)/H"
