"""Maps of sweeps: which cells and curves they show, and what they cannot."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest

from simulator import load_scenario, load_table
from simulator.analysis.fold import fold
from simulator.results.history import EventKind, Outcome
from simulator.results.plot.map import BEHAVIOURS, MapCurve, MapMark, plot_lines, plot_map
from simulator.sweep import read_sweep, run_sweep
from simulator.sweep.picking import PickError, fold_line, mark, pick
from tests.pairs import pair
from tests.sweeps import CHEAP, Here, balloons

STATE_B = pair(1.2, {"ramp": 0.4}, {"ramp": 0.0}, ambient=0.015, output={"points": 3}).to_dict()


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """A grid over ambient pressure, voltage and radius of the passive balloon."""
    directory = tmp_path_factory.mktemp("swept")
    vary = {
        "gas.ambient_pressure": {"from": 0.015, "to": 0.12, "points": 4, "spacing": "log"},
        "step.2.ramp": [0.34, 0.36, 0.38, 0.4],
        "balloon.passive.radius": [1.0, 2.0],
    }
    run_sweep(read_sweep({"scenario": STATE_B, "vary": vary}), directory, executor=Here())
    return directory


X, Y, Z = "gas.ambient_pressure", "step.2.ramp", "balloon.passive.radius"


@pytest.fixture(scope="module")
def folded(tmp_path_factory):
    directory = tmp_path_factory.mktemp("folded")
    fold(pair(1.2, {"ramp": 0.4}, ambient=0.015), X, 0.2).to_csv(directory)
    return directory / "fold.csv"


def test_the_fold_is_the_border_of_the_snaps(swept, folded):
    """Two computations that know nothing of each other: cells snap exactly where they lie above the curve."""
    picked = pick(swept, X, Y, "limit_points", at=[(Z, "1")])
    line = fold_line(str(folded), X, Y)
    border = np.interp(picked.columns[X], line.x, line.y)
    snapped = picked.columns["limit_points"] > 0
    assert snapped.tolist() == (picked.columns[Y] > border).tolist()
    assert 0 < snapped.sum() < snapped.size
    assert picked.log == {X}


def test_the_border_of_the_pear_is_where_shapes_are_lost(tmp_path):
    """As above: the word of a run changes exactly where its voltage passes the curve."""
    vary = {X: {"from": 0.015, "to": 0.12, "points": 3, "spacing": "log"}, Y: [0.305, 0.313, 0.315, 0.325]}
    run_sweep(
        read_sweep({"scenario": STATE_B, "vary": vary, "record": {"shapes": True}}), tmp_path, executor=Here()
    )
    fold(pair(1.2, {"ramp": 0.4}, ambient=0.015), X, 0.2, of="loss_of_sphericity").to_csv(tmp_path)
    picked = pick(tmp_path, X, Y, "shape")
    line = fold_line(str(tmp_path / "fold.csv"), X, Y)
    lost = picked.columns[Y] > np.interp(picked.columns[X], line.x, line.y)
    assert picked.columns["shape"].tolist() == [("sphere", "pear_without_snap")[i] for i in lost.tolist()]
    assert 0 < lost.sum() < lost.size
    legend = plot_map(picked.columns, X, Y, "shape", curves=[MapCurve(line.x, line.y, line.label)]).legends[0]
    assert [text.get_text() for text in legend.get_texts()] == [
        "pear without snap",
        "sphere",
        "loss of sphericity",
    ]


def test_cells_stand_where_their_values_are(swept):
    picked = pick(swept, X, Y, "residual_stretch_active", Z)
    figure = plot_map(
        picked.columns, X, Y, "residual_stretch_active", panels=Z, log=picked.log, title="a $5 map"
    )
    first, second, bar = figure.axes
    assert (first.get_title(), second.get_title()) == ("radius of passive = 1", "radius of passive = 2")
    assert first.get_xscale() == "log"
    assert bar.get_ylabel() == "residual stretch active"
    cells = np.ma.getdata(first.collections[0].get_array()).reshape(4, 4)
    chosen = picked.columns[Z] == 1.0
    table = picked.columns["residual_stretch_active"][chosen].reshape(4, 4)  # the voltage changes faster
    assert np.array_equal(cells, table.T, equal_nan=True)
    centres = np.sqrt(np.prod(first.collections[0].get_coordinates()[0, [0, 1], 0]))
    assert centres == pytest.approx(0.015)


def test_categories_have_their_colours_and_words(swept, folded):
    picked = pick(swept, X, Y, "behaviour", Z)
    line = fold_line(f"1={folded}", X, Y)
    curves = [MapCurve(line.x, line.y, line.label, line.panel)]
    figure = plot_map(picked.columns, X, Y, "behaviour", panels=Z, curves=curves, log=picked.log)
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    there = set(picked.columns["behaviour"].tolist())
    assert words == [BEHAVIOURS[name][1] for name in BEHAVIOURS if name in there] + ["limit point"]
    assert [len(ax.lines) for ax in figure.axes] == [1, 0]
    colours = figure.axes[0].collections[0].cmap.colors
    assert len(set(colours)) == len(colours) == len(there) + 1


def test_points_are_marked_in_their_panel(swept):
    picked = pick(swept, X, Y, "behaviour", Z)
    marks = [MapMark(*mark("0.03,0.38,B")), MapMark(*mark("2=0.05,0.35,$C"))]
    figure = plot_map(picked.columns, X, Y, "behaviour", panels=Z, marks=marks, log=picked.log)
    assert [[text.get_text() for text in ax.texts] for ax in figure.axes] == [["B"], ["B", "$C"]]
    assert figure.axes[0].get_xlim() == figure.axes[1].get_xlim()


def test_every_end_of_a_history_has_a_colour_of_its_own():
    ends = [Outcome.LOSS_OF_TENSION, Outcome.BREAKDOWN, Outcome.RUNAWAY]
    for end in ends:
        assert end.value in BEHAVIOURS
        assert f"snap_to_{end.value}" in BEHAVIOURS
    assert EventKind.LIMIT_POINT not in BEHAVIOURS
    assert len({colour for colour, _ in BEHAVIOURS.values()}) == len(BEHAVIOURS)


def test_samples_are_dots_and_words_of_any_column_categories(tmp_path):
    vary = {"step.1.inflate": {"from": 0.1, "to": 0.6}, X: {"from": 0.1, "to": 1.0}}
    definition = {"scenario": CHEAP, "sample": {"method": "sobol", "size": 8}, "vary": vary}
    run_sweep(read_sweep(definition), tmp_path, executor=Here())
    picked = pick(tmp_path, X, "step.1.inflate", "outcome")
    figure = plot_map(picked.columns, X, "step.1.inflate", "outcome")
    assert len(figure.axes[0].collections[0].get_offsets()) == 8
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["completed"]
    with pytest.raises(PickError, match="goes with a grid"):
        pick(tmp_path, X, "step.1.inflate", "outcome", at=[(X, "1")])


def test_the_command_draws_it(swept, folded, tmp_path):
    words = [
        "map",
        swept,
        "--x",
        X,
        "--y",
        Y,
        "--panels",
        Z,
        "--fold",
        folded,
        "--out",
        tmp_path / "new/map.png",
    ]
    result = balloons(*words)
    assert (result.exit_code, result.stderr) == (0, "")
    content = (tmp_path / "new/map.png").read_bytes()
    assert content.startswith(b"\x89PNG")
    assert balloons(*words).exit_code == 0
    assert (tmp_path / "new/map.png").read_bytes() == content


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--x", "gas.ambient", "--y", Y], "--x gas.ambient: no such column in"),
        (["--x", "gas.ambient", "--y", Y], "did you mean gas.ambient_pressure?"),
        (["--x", X, "--y", "outcome"], "--y outcome: must be a column of numbers, holds text"),
        (
            ["--x", X, "--y", "loop_work"],
            "--y loop_work: must be varied on the grid, which has gas.ambient_pressure, ",
        ),
        (
            ["--x", X, "--y", Y],
            f"--at: {Z} has 2 values; choose one with --at {Z}=VALUE, or show all with --panels",
        ),
        (["--x", X, "--y", Y, "--at", f"{Z}=3"], f"--at {Z}=3: must be one of 1.0, 2.0"),
        (["--x", X, "--y", Y, "--at", "radius=1"], "--at radius: must be varied on the grid"),
        (
            ["--x", X, "--y", Y, "--panels", Z, "--mark", "1;2"],
            "--mark 1;2: must be X,Y,TEXT or VALUE=X,Y,TEXT",
        ),
        (["--x", X, "--y", Y, "--color", "stretch", "--panels", Z], "--color stretch: no such column"),
        (
            ["--x", X, "--y", Y, "--panels", Z, "--fold", "none.csv"],
            "--fold none.csv: cannot be read, no such file",
        ),
    ],
)
def test_refused(swept, words, told):
    result = balloons("map", swept, *words)
    assert result.exit_code == 2
    assert told in result.stderr


def test_curves_of_other_keys_are_refused(folded, tmp_path):
    with pytest.raises(
        PickError, match=r"is a curve over gas\.ambient_pressure and step\.N\.ramp or step\.N\.jump"
    ):
        fold_line(str(folded), "step.1.inflate", Y)
    with pytest.raises(PickError, match="the map is over"):
        fold_line(str(folded), X, "step.1.inflate")
    (tmp_path / "fold.csv").write_text("a,b\n1,2\n")
    with pytest.raises(PickError, match=r"must be a fold\.csv as `balloons fold` writes it"):
        fold_line(str(tmp_path / "fold.csv"), X, Y)
    assert balloons("map", tmp_path, "--x", X, "--y", Y).exit_code == 2


def test_a_limit_point_of_inflation_lies_over_the_inflation_pressure(tmp_path):
    scenario = pair(1.1, {"ramp": 0.1})
    fold(scenario, "balloon.active.radius", 0.5, inflation="active").to_csv(tmp_path)
    line = fold_line(str(tmp_path / "fold.csv"), "step.1.inflate", "balloon.active.radius")
    assert line.label == "limit point of the inflation"
    assert line.x * line.y == pytest.approx(np.full(line.x.size, 1.2536545513), abs=1e-9)


VHB = "scenarios/vhb_snap.toml"


@pytest.fixture(scope="module")
def in_units(tmp_path_factory):
    vary = {
        "gas.ambient_pressure": ["100 kPa", "120 kPa"],
        "step.2.ramp": ["3 kV", "5.5 kV"],
    }
    folder = tmp_path_factory.mktemp("in units")
    scenario = {**load_scenario(VHB).to_dict(), "output": {"points": 2}}
    run_sweep(read_sweep({"scenario": scenario, "vary": vary}), folder, executor=Here())
    return folder


def test_axes_and_scale_have_their_units(in_units):
    picked = pick(in_units, X, "step.2.ramp", "landing_pressure")
    figure = plot_map(picked.columns, X, "step.2.ramp", "landing_pressure", units=picked.units)
    ax, bar = figure.axes
    assert ax.get_xlabel() == "ambient pressure  [kPa]"
    assert ax.get_ylabel() == "voltage  [kV]"
    assert bar.get_ylabel() == "landing pressure [Pa]"
    landings = load_table(in_units)["landing_pressure [Pa]"]
    (cells,) = ax.collections
    assert np.nanmax(cells.get_array()) == landings.max()
    # At 3 kV nothing snaps: the legend says what those blank cells are.
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "blank: the run has no landing pressure"
    ]


def test_a_number_has_the_prefix_that_reads_best(in_units):
    picked = pick(in_units, X, "step.2.ramp", "largest_field_active")
    fields = load_table(in_units)["largest_field_active [V/m]"]
    assert picked.units["largest_field_active"] == "MV/m"
    np.testing.assert_allclose(picked.columns["largest_field_active"], fields / 1e6, rtol=1e-15)


def test_a_fold_is_drawn_in_the_units_of_the_axes(in_units, tmp_path):
    curve = fold(load_scenario(VHB), X, "120 kPa")
    curve.to_csv(tmp_path)
    picked = pick(in_units, X, "step.2.ramp", "behaviour")
    line = fold_line(str(tmp_path / "fold.csv"), X, "step.2.ramp", picked.units)
    scales = load_scenario(VHB).scales
    np.testing.assert_allclose(line.x, curve.value * scales.pressure / 1e3, rtol=1e-14)
    np.testing.assert_allclose(line.y, curve.voltage * scales.voltage / 1e3, rtol=1e-14)
    assert line.x[-1] == pytest.approx(120.0)


def test_one_parameter_is_drawn_as_a_line(in_units):
    picked = pick(in_units, "step.2.ramp", None, "largest_field_active", X)
    figure = plot_lines(picked.columns, "step.2.ramp", "largest_field_active", lines=X, units=picked.units)
    (ax,) = figure.axes
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("voltage  [kV]", "largest field active [MV/m]")
    assert [line.get_xdata().tolist() for line in ax.get_lines()] == [[3.0, 5.5], [3.0, 5.5]]
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert words == ["ambient pressure = 100 kPa", "ambient pressure = 120 kPa"]


def test_words_over_one_parameter_are_dots_in_their_rows(in_units):
    picked = pick(in_units, "step.2.ramp", None, "behaviour", at=[(X, "100")])
    (ax,) = plot_lines(picked.columns, "step.2.ramp", "behaviour").axes
    assert [text.get_text() for text in ax.get_yticklabels()] == [
        "continuous actuation",
        "stable snap, goes back when off",
    ]
    assert ax.get_lines()[0].get_ydata().tolist() == [0.0, 1.0]


def test_an_unfinished_sweep_is_named_on_its_map(in_units, tmp_path):
    shutil.copy(in_units / "sweep.json", tmp_path)
    record = json.loads((tmp_path / "sweep.json").read_text())
    (tmp_path / "sweep.json").write_text(json.dumps({**record, "chunk": 1}))
    (tmp_path / "chunks").mkdir()
    rows = (in_units / "sweep.csv").read_text().splitlines()
    (tmp_path / "chunks/0000000.csv").write_text(f"{rows[1]}\n")
    said = balloons("map", tmp_path, "--x", X, "--y", "step.2.ramp", "--format", "svg")
    assert "unfinished: 1 of 4 runs are drawn" in said.stdout
    assert pick(tmp_path, X, "step.2.ramp", "behaviour").unfinished == "1 of 4 runs"
    assert [path.name for path in tmp_path.glob("map.*")] == ["map.svg"]
    assert "unfinished" not in balloons("map", in_units, "--x", X, "--y", "step.2.ramp").stdout


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--x", X, "--fold", "fold.csv"], "--fold: goes with --y"),
        (["--x", X, "--y", "step.2.ramp", "--out", "map.gif"], "--out map.gif: must end in .png, .svg, .pdf"),
        (["--x", X, "--y", "step.2.ramp", "--out", "map.png", "--format", "pdf"], "must end in .pdf"),
    ],
)
def test_options_that_do_not_go_together(in_units, words, told):
    result = balloons("map", in_units, "--at", "step.2.ramp=3", *words)
    assert (result.exit_code, told in result.stderr) == (2, True), result.stderr
