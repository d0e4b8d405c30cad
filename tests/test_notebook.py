"""Results as they are used in Python and shown in a notebook."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

from simulator import load_scenario, simulate, trace
from simulator.results.html import curve_html, history_html
from simulator.results.plot import plot_histories
from tests.histories import cycled_pair
from tests.pairs import pair

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
