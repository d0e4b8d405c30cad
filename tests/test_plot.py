"""The picture: jumps dashed, everything named, and no more ink than a page can take."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from simulator import trace, trace_inflation
from simulator.results.history import EventKind, History, Outcome
from simulator.results.plot import (
    COLOURS,
    MARKERS,
    plot_history,
    plot_loop,
    plot_pressure,
    plot_stretches,
    plot_voltage,
    png,
)
from simulator.results.plot.curve import plot_curves
from simulator.results.plot.lines import is_crowded, thinned
from simulator.results.plot.loop import plot_charge_loop
from simulator.results.plot.map import subject
from simulator.results.plot.style import BLACK
from simulator.scenario import load_scenario
from simulator.simulation.run import simulate
from tests.histories import cycled_pair, empty_pair, inflated_single, scenario, slack_pair
from tests.pairs import pair, run

SCENARIOS = Path(__file__).parent.parent / "scenarios"

PICTURED = [cycled_pair(), slack_pair(), inflated_single(), empty_pair(), cycled_pair(cycles=300)]


def axes() -> Axes:
    return Figure().add_subplot()


def lines(ax: Axes, style: str) -> list[Line2D]:
    return [line for line in ax.get_lines() if line.get_linestyle() == style]


def steps(line: Line2D) -> np.ndarray:
    """Changes in y along a line, over the drawn segments only."""
    change = np.abs(np.diff(np.asarray(line.get_ydata(), dtype=float)))
    return change[~np.isnan(change)]


def legend_labels(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.legends[0].get_texts()]


@pytest.mark.parametrize("history", PICTURED)
def test_a_history_becomes_a_png(history):
    assert png(plot_history(history), dots_per_inch=50).startswith(b"\x89PNG")


def test_panels_without_electrodes_are_pressure_stretch_and_loop():
    assert [ax.get_ylabel() for ax in plot_history(inflated_single()).axes] == [
        "pressure\nPR/(μH)", "stretch\nλ = r/R", "stretch of only  λ = r/R",
    ]  # fmt: skip
    assert plot_history(inflated_single()).axes[-1].get_xlabel() == "pressure  PR/(μH)"


def test_panels_with_electrodes_add_the_voltage():
    figure = plot_history(cycled_pair())
    assert figure.axes[0].get_ylabel() == "voltage\nΦ√(ε/μ)/H"
    assert figure.axes[-1].get_xlabel() == "voltage on active  Φ√(ε/μ)/H"
    assert figure.axes[0].get_shared_x_axes().joined(figure.axes[0], figure.axes[2])


@pytest.mark.parametrize("draw", [plot_voltage, plot_pressure, plot_stretches, plot_loop])
def test_drawing_functions_return_the_axes_they_were_given(draw):
    ax = axes()
    assert draw(cycled_pair(), ax) is ax


@pytest.mark.parametrize("draw", [plot_stretches, plot_loop])
@pytest.mark.parametrize("history", [cycled_pair(), cycled_pair(cycles=20), inflated_single()])
def test_no_solid_line_crosses_a_jump(draw, history):
    ax = draw(history, axes())
    assert max(steps(line).max(initial=0.0) for line in lines(ax, "-")) < 1.0
    assert max(steps(line).max(initial=0.0) for line in lines(ax, "--")) > 3.0


def test_snaps_of_the_loop_are_vertical_at_the_voltage_of_the_event():
    history = cycled_pair()
    dashed = lines(plot_loop(history, axes()), "--")
    assert [set(line.get_xdata()) for line in dashed] == [{event.voltage[0]} for event in history.events]
    for line, event in zip(dashed, history.events, strict=True):
        assert line.get_ydata()[0] == event.stretch_before[0]
        assert line.get_ydata()[-1] == event.stretch_after[0]


def test_a_voltage_jump_moves_the_voltage_before_the_state():
    history = cycled_pair()
    jumps = tuple(replace(event, kind=EventKind.JUMP) for event in history.events)
    history = replace(history, events=jumps)
    first = int(np.flatnonzero(np.diff(history.branch))[0])
    history.voltage[: first + 1] *= 0.5
    x, y = lines(plot_loop(history, axes()), "--")[0].get_data()
    assert list(x) == [
        history.voltage[first, 0],
        history.voltage[first + 1, 0],
        history.voltage[first + 1, 0],
    ]
    assert list(y) == [history.stretch[first, 0], history.stretch[first, 0], history.stretch[first + 1, 0]]


def test_a_snap_at_given_charge_moves_both_at_once():
    history = cycled_pair()
    first = int(np.flatnonzero(np.diff(history.branch))[0])
    history.voltage[: first + 1] *= 0.5
    ax = plot_loop(history, axes())
    x, y = lines(ax, "--")[0].get_data()
    assert set(zip(x, y, strict=True)) == {
        (history.voltage[i, 0], history.stretch[i, 0]) for i in (first, first + 1)
    }
    marks = {(line.get_xdata()[0], line.get_ydata()[0]) for line in ax.lines if len(line.get_xdata()) == 1}
    assert (history.voltage[first, 0], history.stretch[first, 0]) in marks


def test_events_carry_the_marker_of_their_kind():
    assert set(MARKERS) >= set(EventKind)
    assert len(set(MARKERS.values())) == len(MARKERS)
    for history, kind in ((cycled_pair(), EventKind.LIMIT_POINT), (slack_pair(), EventKind.LOSS_OF_TENSION)):
        for draw in (plot_stretches, plot_loop):
            marked = [
                line for line in draw(history, axes()).get_lines() if line.get_marker() == MARKERS[kind]
            ]
            assert [line.get_ydata()[0] for line in marked] == [e.stretch_before[0] for e in history.events]


def test_an_event_that_leaves_the_shown_balloon_alone_is_not_on_its_loop():
    history = cycled_pair()
    event = history.events[0]
    elsewhere = replace(event, stretch_before=np.array([event.stretch_after[0], 1.1]))
    ax = plot_loop(replace(history, events=(elsewhere,)), axes())
    assert not [line for line in ax.get_lines() if line.get_marker() == "*"]
    stars = [
        line
        for line in plot_stretches(replace(history, events=(elsewhere,)), axes()).get_lines()
        if line.get_marker() == "*"
    ]
    assert [line.get_ydata()[0] for line in stars] == [1.1]


def test_legend_names_balloons_snaps_and_events_with_their_number():
    assert legend_labels(plot_history(cycled_pair())) == [
        "balloon active", "balloon passive", "snap", "limit point  (2×)", "end",
    ]  # fmt: skip
    assert legend_labels(plot_history(slack_pair()))[-1] == "loss of tension"


def test_the_end_is_marked_unless_an_event_is():
    def ends(history):
        marked = [line for line in plot_loop(history, axes()).get_lines() if line.get_marker() == "o"]
        return [(line.get_xdata()[0], line.get_ydata()[0]) for line in marked]

    history = cycled_pair()
    assert ends(history) == [(history.voltage[-1, 0], history.stretch[-1, 0])]
    assert ends(slack_pair()) == []
    assert legend_labels(plot_history(history))[-1] == "end"


def test_a_line_that_does_not_jump_is_not_broken_by_the_jump_of_another():
    ax = plot_voltage(cycled_pair(), axes())
    (solid,) = lines(ax, "-")
    assert not np.isnan(solid.get_ydata()).any()
    assert not [line for line in lines(ax, "--") if len(line.get_xdata())]


def test_title_is_taken_literally():
    title = r"costs $5 and $6, [bold]100 %[/bold] \frac"
    figure = plot_history(replace(cycled_pair(), scenario=scenario(title)))
    assert figure.get_suptitle() == title
    figure.draw_without_rendering()


def test_ending_is_told_where_it_is_not_the_end_of_the_scenario():
    def ending(history):
        return plot_history(history).axes[-1].get_title(loc="right")

    assert ending(cycled_pair()) == ""
    assert ending(slack_pair()) == "ended by loss of tension at time 0.7"
    assert ending(slack_pair(Outcome.FAILED)) == "partial: the solver failed after time 0.7"
    assert ending(empty_pair()) == "nothing was computed"


def test_a_thousand_cycles_are_drawn_like_one():
    once, often = plot_history(cycled_pair()), plot_history(cycled_pair(cycles=1000))
    loops = [figure.axes[-1] for figure in (once, often)]
    assert len(loops[0].get_lines()) == len(loops[1].get_lines())
    points = [sum(len(line.get_xdata()) for line in loop.get_lines()) for loop in loops]
    assert points[1] < points[0] + 10
    for panel in often.axes[:-1]:
        assert sum(len(line.get_xdata()) for line in panel.get_lines()) < 20_000
        assert len(panel.get_lines()) < 50
    assert "limit point  (2000×)" in legend_labels(often)
    assert "range over many cycles" in legend_labels(often)


def test_the_band_of_many_cycles_reaches_from_the_lowest_to_the_highest():
    history = cycled_pair(cycles=1000)
    ax = plot_stretches(history, axes())
    bands = [band.get_datalim(ax.transData) for band in ax.collections]
    for band, stretch in zip(bands, history.stretch.T, strict=True):
        assert (band.y0, band.y1) == pytest.approx((stretch.min(), stretch.max()))
        assert (band.x0, band.x1) == pytest.approx((history.time[0], history.time[-1]))


def test_a_long_smooth_history_keeps_its_extremes_when_thinned():
    base = slack_pair()
    n = 100_000
    time = np.linspace(0, 1, n)
    stretch = 1.5 + 0.3 * np.sin(40 * time)
    stretch[54_321] = 3.0
    history = replace(
        base, time=time, branch=np.zeros(n, int), stretch=np.column_stack([stretch, stretch]), events=()
    )
    drawn = lines(plot_stretches(history, axes()), "-")[0]
    assert len(drawn.get_xdata()) < 10_000
    assert max(drawn.get_ydata()) == 3.0
    assert min(drawn.get_ydata()) == stretch.min()


def test_balloons_have_different_colours():
    first, second = lines(plot_stretches(slack_pair(), axes()), "-")[:2]
    assert [first.get_color(), second.get_color()] == list(COLOURS[:2])


def test_nothing_overlaps_the_legend():
    figure = plot_history(cycled_pair())
    figure.draw_without_rendering()
    legend = figure.legends[0].get_window_extent()
    for ax in figure.axes:
        assert not legend.overlaps(ax.get_tightbbox())


def test_pyplot_is_not_loaded():
    program = (
        "import sys;"
        "from tests.histories import cycled_pair; from simulator.results.plot import plot_history, png;"
        "png(plot_history(cycled_pair())); sys.exit('matplotlib.pyplot' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", program], cwd=Path(__file__).parent.parent, check=False)
    assert done.returncode == 0


def test_every_actuator_has_its_loop():
    history = run(load_scenario(SCENARIOS / "push_pull.toml"))
    figure = plot_history(history)
    loops = [ax for ax in figure.axes if ax.get_xlabel().startswith("voltage on")]
    assert [ax.get_xlabel() for ax in loops] == ["voltage on left  Φ√(ε/μ)/H", "voltage on right  Φ√(ε/μ)/H"]
    for i, ax in enumerate(loops):
        drawn = np.concatenate([line.get_ydata() for line in lines(ax, "-")])
        assert np.nanmax(drawn) == history.stretch[:, i].max()


def test_where_charges_are_given_the_charge_loop_shows_the_work():
    history = run(load_scenario(SCENARIOS / "charge_control.toml"))
    (ax,) = (ax for ax in plot_history(history).axes if ax.get_ylabel().startswith("charge"))
    assert ax.get_title(loc="left") == (
        f"work of the source, ∫Φ dq = {history.energy_balance.electrical_work:.4g} × 4πR²Hμ"
    )
    assert np.nanmax(np.concatenate([line.get_ydata() for line in ax.get_lines()])) == history.charge.max()


def test_the_area_of_the_charge_loop_that_is_drawn_is_the_loop_work_of_cycles_csv(tmp_path):
    steps = [{"ramp": 0.4, "over": 1}, {"ramp": 0.0, "over": 1}]
    history = simulate(pair(1.2, {"cycle": 1, "steps": steps}, ambient=0.015))
    history.to_csv(tmp_path)
    (written,) = pd.read_csv(tmp_path / "cycles.csv")["loop_work_active"]
    ax = plot_charge_loop(history, axes())
    drawn = 0.0
    for line in ax.get_lines():
        x, y = (np.asarray(part, dtype=float) for part in (line.get_xdata(), line.get_ydata()))
        drawn += np.nansum(0.5 * (x[1:] + x[:-1]) * np.diff(y))
    assert drawn == pytest.approx(written, rel=2e-4)  # chords are on the curve to that


def test_cycles_that_do_not_repeat_are_told_apart():
    creeps = {"maxwell": {"modulus": 0.6, "time": 3.0}}
    wave = {"triangle": {"low": 0.0, "high": 0.35, "period": 1.5, "cycles": 4}}
    slow = {"dynamics": {"relaxation_time": 0.05}, "output": {"points": 21}}
    history = run(pair(0.9, wave, ambient=0.015, active=creeps, **slow))
    figure = plot_history(history)
    assert {"first cycle", "cycles between", "last cycle"} <= set(legend_labels(figure))
    ax = plot_loop(history, axes())
    (first,) = (line for line in ax.get_lines() if line.get_color() == BLACK)
    *_, last = (line for line in lines(ax, "-") if line.get_linewidth() == 1.8)
    ends = [history.stretch[history.cycle == number, 0].max() for number in (1, 4)]
    assert [np.nanmax(line.get_ydata()) for line in (first, last)] == ends
    again = run(pair(0.9, wave, ambient=0.015, output={"points": 21}))  # nothing creeps: all look alike
    assert "first cycle" not in legend_labels(plot_history(again))


def test_paths_and_maps_say_what_is_seen():
    def title(curves):
        return plot_curves(curves).axes[0].get_title()

    curve = trace(SCENARIOS / "fig3c_state_b.toml")
    assert title([curve]).endswith("\nequilibria: stretch of active over its voltage")
    assert "\n2 paths of equilibria: " in title([curve, curve])
    assert title([trace(SCENARIOS / "push_pull.toml")]).endswith("over the voltage on all films")
    assert title([trace_inflation(SCENARIOS / "vhb_snap.toml")]).endswith(
        "inflation of passive: radius over pressure"
    )
    assert subject("behaviour", "step.1.inflate", "balloon.*.radius", "gas.ambient_pressure") == (
        "behaviour over inflation pressure and radius of all, a panel for each ambient pressure"
    )
    assert subject("landing_pressure", "step.2.ramp", None, None) == "landing pressure over voltage"


def test_a_film_with_a_strength_shows_its_field_and_margin():
    history = run(load_scenario(SCENARIOS / "breakdown_acrylic.toml"))
    panels = {ax.get_ylabel(): ax for ax in plot_history(history).axes}
    field, margin = panels["field\n|E|√(ε/μ)"], panels["margin to\nbreakdown"]
    np.testing.assert_array_equal(lines(field, ":")[0].get_ydata(), history.strength[:, 0])
    assert np.nanmax(np.concatenate([line.get_ydata() for line in lines(field, "--")])) == history.field.max()
    assert np.nanmin(np.concatenate([line.get_ydata() for line in lines(margin, "--")])) < 1e-9


def test_a_snap_in_real_time_is_marked_on_the_loop_and_promised_as_nothing_else():
    """In real time a limit point is passed slowly: the path itself is the snap, nothing is dashed."""
    history = run(load_scenario(SCENARIOS / "delayed_snap.toml"))
    figure = plot_history(history)
    stars = [line for line in figure.axes[-1].get_lines() if line.get_marker() == "*"]
    turns = [event for event in history.events if event.kind is EventKind.LIMIT_POINT]
    assert [(line.get_xdata()[0], line.get_ydata()[0]) for line in stars] == [
        (event.voltage[0], event.stretch_before[0]) for event in turns
    ]
    assert "snap" not in legend_labels(figure)
    assert not any(np.isfinite(line.get_ydata()).any() for ax in figure.axes for line in lines(ax, "--"))


def test_panels_are_chosen_by_name():
    history = cycled_pair()
    assert [ax.get_ylabel().split()[0] for ax in history.plot(panels=["loop", "pressure"]).axes] == [
        "pressure", "stretch",
    ]  # fmt: skip
    with pytest.raises(ValueError, match="panel 'volts': must be one of voltage"):
        history.plot(panels=["volts"])
    with pytest.raises(ValueError, match="no film has a dielectric strength"):
        history.plot(panels=["margin"])


def noisy() -> History:
    """A made-up history on a noisy voltage: no cycles, though it turns at every other sample."""
    quiet, samples = cycled_pair(), 20_000
    time = np.linspace(0.0, 2.0, samples)
    noise = 1e-3 * np.random.default_rng(1).standard_normal(samples)
    voltage = (0.2 * np.minimum(time, 1.0) + noise)[:, None]
    nothing = np.zeros(samples, dtype=np.int64)
    return replace(
        quiet,
        time=time,
        step=nothing + 1,
        branch=nothing,
        voltage=voltage,
        stretch=np.column_stack([1.2 + voltage[:, 0], 1.2 - voltage[:, 0]]),
        pressure=1.0 - voltage[:, 0],
        events=(),
    )


def test_noise_is_a_line_and_no_range_of_cycles():
    history = noisy()
    figure = plot_history(history)
    assert "range over many cycles" not in legend_labels(figure)
    assert not any(ax.collections for ax in figure.axes)
    drawn = np.concatenate([line.get_ydata() for line in lines(figure.axes[0], "-")])
    assert np.nanmax(drawn) == history.voltage.max()
    assert np.nanmin(drawn) == history.voltage.min()
    assert drawn.size < 3100


def test_a_few_cycles_with_noise_are_a_line_too():
    time = np.linspace(0.0, 1.0, 50_000)
    wave = np.sin(8 * np.pi * time) + 0.01 * np.random.default_rng(2).standard_normal(time.size)
    assert not is_crowded(wave)
    assert is_crowded(np.sin(400 * np.pi * time))
    assert not is_crowded(np.ones(10_000) + 1e-16 * wave[:10_000])


def test_long_records_are_thinned_to_the_extremes_of_each_pixel():
    values = np.random.default_rng(3).standard_normal(100_000)
    kept = thinned(values)
    assert kept.size <= 3000
    assert np.all(np.diff(kept) > 0)
    for start in range(0, values.size, 20_000):  # however it bins them, no pixel loses its extremes
        part = values[start : start + 20_000]
        inside = values[kept[(kept >= start) & (kept < start + 20_000)]]
        assert (inside.max(), inside.min()) == (part.max(), part.min())
