"""Recordings of voltages: files as amplifiers and oscilloscopes write them, read as the scenario says."""

import json
import tomllib
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from simulator import load_scenario, simulate
from simulator.cli import app
from simulator.model import drive
from simulator.model.drive import VoltageLine
from simulator.scenario import RecordingByName, ScenarioError, Table
from simulator.sweep import load_table, read_sweep, run_sweep

SCALES = {"shear_modulus": "45 kPa", "thickness": "0.5 mm", "radius": "20 mm", "permittivity": 4.7}
AMPLIFIER = """Amplifier 609E
rate;1000
time_s;CH1;CH2;note
-2,0;0,0;0,5;armed
-1,0;0,1;0,5;

0,0;0,0;0,2;go
1,5;"0,25";0,1;
4;0,1;0,0
"""
ASKED = {"time": "time_s", "voltage": "CH1", "separator": ";", "decimal": ",", "skip": 2, "offset": 0}


def scenario(table, *, names=("left", "right"), scales=False, **others):
    mapping = {
        "title": "Recorded",
        "gas": {"ambient_pressure": 0.5},
        "balloon": [
            {"name": name, "electrodes": True, "elastomer": {"model": "gent", "J_lim": 100}} for name in names
        ],
        "step": [{"inflate": 0.3}, {"table": table}],
        **others,
    }
    return load_scenario({**mapping, "scales": SCALES} if scales else mapping)


def step_of(loaded) -> Table:
    step = loaded.steps[1]
    assert isinstance(step, Table)
    return step


@pytest.fixture
def amplifier(tmp_path):
    path = tmp_path / "amp.csv"
    path.write_text(AMPLIFIER)
    return {"file": str(path), **ASKED}


def written(tmp_path, text, **asked):
    path = tmp_path / "rec.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return {"file": str(path), **asked}


# -- reading -------------------------------------------------------------------------------------------


def test_an_amplifiers_file_is_read(amplifier):
    step = step_of(scenario(amplifier))
    assert step.times.tolist() == [0.0, 1.5, 4.0]
    assert step.voltages.tolist() == [0.0, 0.25, 0.1]
    assert not step.times.flags.writeable


def test_an_offset_begins_elsewhere(amplifier):
    step = step_of(scenario(amplifier | {"offset": 2}))
    assert step.times.tolist() == [0.0, 1.0, 2.0, 3.5, 6.0]


def test_an_offset_that_leaves_rounding_begins_at_0(tmp_path):
    asked = written(tmp_path, "time [ms],voltage [kV]\n0,0\n2000.1,1\n2000.4,2\n", offset="-2000.1 ms")
    step = step_of(scenario(asked, scales=True))
    assert step.times[0] == 0.0
    assert step.times[1] == pytest.approx(3e-4, rel=1e-9)


def test_units_are_those_that_are_said_or_in_the_header(amplifier, tmp_path):
    plain = step_of(scenario(amplifier)).voltages
    for unit, size in (("kV", 1e3), ("V", 1.0), ("2 kV", 2e3)):
        loaded = scenario(amplifier | {"units": {"CH1": unit}}, scales=True)
        assert step_of(loaded).voltages * loaded.scales.voltage == pytest.approx(plain * size, rel=1e-14)
    assert step_of(scenario(amplifier | {"units": {"CH1": "1"}})).voltages.tolist() == plain.tolist()
    asked = written(tmp_path, "t [ms],U (kV)\n0,0\n500,2\n", time="t", voltage="U")
    loaded = scenario(asked, scales=True)
    assert step_of(loaded).times.tolist() == [0.0, 0.5]
    assert step_of(loaded).voltages[1] * loaded.scales.voltage == pytest.approx(2e3)
    # A monitor that gives 1 V for 1 kV: what the scenario says goes before the header.
    monitor = scenario(asked | {"units": {"U": "MV"}}, scales=True)
    assert step_of(monitor).voltages[1] * monitor.scales.voltage == pytest.approx(2e6)


@pytest.mark.parametrize(
    ("text", "asked"),
    [
        ("time,voltage\n0,0.5\n1,0.25\n", {}),
        ("\ufeffvoltage,time\r\n0.5,0\r\n\r\n0.25,1\r\n", {}),
        ("  time   voltage\n  0      0.5\n  1\t0.25 \n", {"separator": " "}),
        ("time\tvoltage\n0\t5e-1\n1\t+.25\n", {"separator": "\t"}),
        ("when,time,voltage\nnoon,0,0.5\n\n,1,0.25\n", {"voltage": "voltage"}),
        ("time,voltage,\n0,0.5,\n1,0.25,\n", {}),
        ("# of 3 May\n# °C 21\ntime,voltage\n0,0.5\n1,0.25\n".encode("latin-1"), {"skip": 2}),
    ],
    ids=["strict", "BOM", "white", "tab", "text", "trailing", "latin-1"],
)
def test_ways_to_write_the_same(tmp_path, text, asked):
    step = step_of(scenario(written(tmp_path, text, **asked)))
    assert (step.times.tolist(), step.voltages.tolist()) == ([0.0, 1.0], [0.5, 0.25])


def test_a_recording_reads_the_same_doubles_as_the_strict_table(tmp_path):
    rows = np.random.default_rng(1).random((500, 2))
    rows[:, 0] = np.append(0.0, np.cumsum(rows[1:, 0]))
    lines = "".join(f"{t!r},{v!r}\n" for t, v in rows.tolist())
    asked = written(tmp_path, f"time,voltage\n{lines}")
    strict, recorded = step_of(scenario(asked["file"])), step_of(scenario(asked))
    assert np.array_equal(strict.times, recorded.times)
    assert np.array_equal(strict.voltages, recorded.voltages)
    comma = written(tmp_path, "time;voltage\n" + lines.replace(",", ";").replace(".", ","))
    step = step_of(scenario(comma | {"separator": ";", "decimal": ","}))
    assert np.array_equal(strict.voltages, step.voltages)


def test_a_scenario_gives_its_recordings_back(amplifier):
    both = {"left": amplifier, "right": amplifier | {"voltage": "CH2", "units": {"CH2": "V"}}}
    for asked in (amplifier | {"units": {"CH1": "kV"}, "offset": "2 s"}, both):
        loaded = scenario(asked, scales=True)
        again = load_scenario(loaded.to_dict())
        assert again == loaded
        assert again.to_dict() == loaded.to_dict()
        assert json.loads(json.dumps(loaded.to_dict())) == loaded.to_dict()
    assert loaded.to_dict()["step"][1]["table"] == both | {
        name: one | {"offset": 0.0} for name, one in both.items()
    }


def test_paths_start_at_the_folder_of_the_scenario(tmp_path, amplifier, monkeypatch):
    text = """
        title = "By file"
        gas = { ambient_pressure = 1 }
        [[balloon]]
        name = "a"
        electrodes = true
        elastomer = { model = "neo-hookean" }
        [[step]]
        [step.table]
        file = "amp.csv"
        time = "time_s"
        voltage = "CH1"
        separator = ";"
        decimal = ","
        skip = 2
        offset = 2
    """
    (tmp_path / "s.toml").write_text(text)
    loaded = load_scenario(tmp_path / "s.toml")
    assert loaded.to_dict()["step"][0]["table"]["file"] == amplifier["file"]
    (tmp_path / "other.csv").write_text(AMPLIFIER.replace("0,25", "0,5"))
    monkeypatch.chdir("/")
    assert loaded.with_values({"step.1.table.file": "other.csv"}).steps[0].voltages[3] == 0.5


# -- playing -------------------------------------------------------------------------------------------


def test_a_recording_plays_as_the_strict_table(tmp_path, amplifier):
    strict = tmp_path / "w.csv"
    strict.write_text("time,voltage\n0,0\n1.5,0.25\n4,0.1\n")
    one, other = simulate(scenario(str(strict))), simulate(scenario(amplifier))
    assert np.array_equal(one.stretch, other.stretch)
    assert np.array_equal(one.voltage, other.voltage)


def test_recordings_by_name_play_as_waves_by_name(tmp_path):
    wave = {
        "period": 4,
        "cycles": 1,
        "left": {"low": 0, "high": 0.3},
        "right": {"low": 0.1, "high": 0.3, "phase": 0.25},
    }
    for name, rows in (
        ("left", "0,0\n2,0.3\n4,0\n"),
        ("right", "0,0.2\n1,0.3\n3,0.1\n4,0.2\n"),
    ):
        (tmp_path / f"{name}.csv").write_text(f"time,voltage\n{rows}")
    loaded = scenario({name: {"file": str(tmp_path / f"{name}.csv")} for name in ("left", "right")})
    mapping = loaded.to_dict()
    mapping["step"][1] = {"triangle": wave}
    recorded, waves = simulate(loaded), simulate(load_scenario(mapping))
    assert step_of(loaded).times.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    np.testing.assert_allclose(recorded.voltage, waves.voltage, atol=1e-15)
    np.testing.assert_allclose(recorded.stretch, waves.stretch, rtol=1e-12)
    np.testing.assert_allclose(recorded.pressure, waves.pressure, rtol=1e-12)


def test_who_is_not_named_keeps_its_voltage(tmp_path):
    asked = written(tmp_path, "time,voltage\n0,0\n1,0.2\n2,0.1\n3,0.1\n")
    mapping = scenario({"left": asked}).to_dict()
    mapping["step"].insert(1, {"ramp": {"right": 0.15}})
    history = simulate(load_scenario(mapping))
    played = history.step == 3
    assert (history.voltage[played, 1] == 0.15).all()
    rows = np.interp(history.time[played] - 2.0, [0, 1, 2], [0, 0.2, 0.1])
    np.testing.assert_allclose(history.voltage[played, 0], rows, atol=1e-15)


def test_times_that_differ_by_rounding_are_one(tmp_path):
    (tmp_path / "a.csv").write_text("time,voltage\n0,0\n0.3,1\n1,0\n")
    (tmp_path / "b.csv").write_text(f"time,voltage\n0,0\n{0.1 * 3!r},2\n1,0\n")
    table = step_of(
        scenario({n: {"file": str(tmp_path / f)} for n, f in (("left", "a.csv"), ("right", "b.csv"))})
    )
    assert isinstance(table.table, RecordingByName)
    assert table.times.tolist() == [0.0, 0.3, 1.0]
    assert table.table.voltages["right"].tolist() == [0.0, 2.0, 0.0]
    with pytest.raises(TypeError, match="of their own"):
        _ = table.voltages


def test_a_polygon_passes_through_its_rows():
    rng = np.random.default_rng(3)
    times = np.append(0.0, np.cumsum(rng.random(60)))
    voltages = rng.integers(-2, 3, (61, 2)) * 0.25
    legs = drive.polygon(times, voltages)
    assert (legs[0].start, legs[-1].end) == (0.0, 1.0)
    assert all(a.end == b.start for a, b in pairwise(legs))
    found = np.vstack([leg.way.at(leg.waveform.values)[1:] for leg in legs])
    np.testing.assert_allclose(found, voltages[1:], atol=1e-15)
    corners = np.concatenate([leg.of_step(leg.waveform.fractions)[1:] for leg in legs])
    np.testing.assert_allclose(corners * times[-1], times[1:], rtol=1e-14)
    for leg in legs:
        start, end = leg.way.at(leg.waveform.values)[[0, -1]]
        if not np.array_equal(start, end):
            assert leg.way == VoltageLine.through(start, end)


@pytest.mark.parametrize("other", [0.0, 0.3])
def test_rows_along_one_line_are_one_leg(other):
    times, wave = np.arange(5.0), np.array([0.0, 0.5, 0.5, 0.25, 0.75])
    (leg,) = drive.polygon(times, np.stack([wave, np.full(5, other)], axis=1))
    assert leg.way == VoltageLine((0.0, other), (1.0, 0.0))
    assert leg.waveform.values.tolist() == wave.tolist()
    (still,) = drive.polygon(times, np.full((5, 2), other))
    assert still.way == VoltageLine.still((other, other))


# -- what is refused -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        (
            {"voltage": "CH9"},
            'voltage = "CH9": must be a column of the header in row 3: time_s, CH1, CH2, note',
        ),
        ({"voltage": None}, "voltage: is missing, must be a column of the header in row 3: time_s, CH1"),
        ({"voltage": "time_s"}, 'voltage = "time_s": must be another column than that of the time'),
        ({"voltage": "note"}, 'file = "amp.csv": row 4: must be a finite number in column note, is armed'),
        ({"decimal": None}, 'column time_s, is -2,0; it needs decimal = ","'),
        ({"separator": None, "decimal": None}, 'separator = ";"'),
        ({"separator": None}, 'decimal = ",": must differ from the separator'),
        ({"separator": ";;"}, 'separator = ";;": must be one character such as ";"'),
        ({"separator": "5"}, 'separator = "5": must be one character such as ";"'),
        ({"decimal": "'"}, 'decimal = "\'": must be "." or ","'),
        ({"skip": -1}, "skip = -1: must be a whole number >= 0"),
        ({"skip": 100}, "skip = 100: must be less than the 9 lines of the file"),
        ({"skip": 5}, "skip = 5: the header must be in line 6, that is blank; skip = 6"),
        (
            {"offset": None},
            "row 4: time must start at 0, it is at -2.0; offset = 2.0 puts it there; offset = 0",
        ),
        (
            {"offset": 0.5},
            "offset = 0.5: row 7: a row must be at time 0, it is at 0.5 after the offset of 0.5",
        ),
        (
            {"offset": -9},
            "offset = -9.0: row 4: a row must be at time 0, it is at -11.0 after the offset of -9",
        ),
        ({"offset": -4}, "must have at least two rows from time 0 on, has 1"),
        ({"offset": "-2 s"}, 'offset = "-2 s": must be a number; a unit needs [scales]'),
        ({"units": {"CH1": "kV"}}, 'units.CH1 = "kV": a unit needs [scales]'),
        ({"units": {"CH2": "kV"}}, 'units.CH2 = "kV": must be of a column that is read, time_s and CH1'),
        ({"units": {"CH1": 3}}, 'units.CH1 = 3: must be a text such as "kV"'),
        ({"units": "kV"}, 'units = "kV": must be a table of units by column'),
        ({"file": "none.csv"}, 'file = "none.csv": cannot be read, no such file or directory'),
        ({"file": ""}, 'file = "": must be the path of a CSV file'),
        ({"file": None}, "file: is missing, must be the path of a CSV file"),
        ({"column": 1}, "column = 1: unknown key, allowed here: file, time, voltage, separator"),
    ],
)
def test_what_a_recording_cannot_have(amplifier, monkeypatch, changed, expected):
    monkeypatch.chdir(Path(amplifier["file"]).parent)
    asked = {k: v for k, v in (amplifier | changed).items() if v is not None}
    for table, key in ((asked, "step.2.table"), ({"left": asked}, "step.2.table.left")):
        if table is not asked and "file" not in asked:
            continue
        with pytest.raises(ScenarioError) as caught:
            scenario(table)
        assert expected in str(caught.value)
        assert caught.value.key.startswith(f"{key}.")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "must have a header and rows below it, is empty"),
        ("time,voltage\n", "must have at least two rows below the header, has 0"),
        ("time,voltage\n0,1\n", "must have at least two rows below the header, has 1"),
        ("time,voltage\n0,0\n\n1,\n", "row 4: must be a finite number in column voltage, is empty"),
        ("time,voltage\n0,0\n1\n", "row 3: must be a finite number in column voltage, is empty"),
        ("time,voltage\n0,0\n1,nan\n", "row 3: must be a finite number in column voltage, is nan"),
        ("time,voltage\n0,0\n1,1e999\n", "row 3: must be a finite number in column voltage, is 1e999"),
        ("time,voltage\n0,0\n1,True\n", "row 3: must be a finite number in column voltage, is True"),
        ("time,voltage\n0,0\n\n1,0\n1,2\n", "row 5: time must increase, is 1,2"),
        (
            "time,voltage\n0,5,0,1\n1,5,0,2\n",
            "row 2: must have at most 2 cells, as the header has, is 0,5,0,1",
        ),
        ("time,voltage\n0,1\n0,5,2\n", "row 3: must have at most 2 cells, as the header has, is 0,5,2"),
        ("time,voltage,voltage\n0,1,1\n1,1,1\n", "must be one column, the header has it 2 times"),
        ("t\0i\0m\0e\0", "must be text in UTF-8, has bytes that are 0"),
    ],
)
def test_files_that_are_refused(tmp_path, text, expected):
    with pytest.raises(ScenarioError) as caught:
        scenario(written(tmp_path, text))
    assert expected in str(caught.value)
    assert caught.value.key.startswith("step.2.table.")


@pytest.mark.parametrize(
    ("scales", "expected"),
    [
        (
            True,
            'units: is missing, column U_kV has a unit in its name: units = { "U_kV" = "kV" }, or "1" for',
        ),
        (False, "a unit needs [scales]"),
    ],
)
def test_a_unit_in_a_name_is_not_passed_over(tmp_path, scales, expected):
    asked = written(tmp_path, "time_s,U_kV\n0,0\n1,5\n", time="time_s", voltage="U_kV")
    with pytest.raises(ScenarioError) as caught:
        scenario(asked, scales=scales)
    assert expected in str(caught.value)
    assert step_of(scenario(asked | {"units": {"U_kV": "1"}}, scales=scales)).voltages[1] == 5.0


def test_units_that_measure_something_else(amplifier):
    with pytest.raises(ScenarioError) as caught:
        scenario(amplifier | {"units": {"CH1": "kPa"}}, scales=True)
    assert 'units.CH1 = "kPa": must be a unit of voltage such as "kV"' in str(caught.value)
    with pytest.raises(ScenarioError, match="the unit kv is not known"):
        scenario(amplifier | {"units": {"CH1": "kv"}}, scales=True)


def test_recordings_by_name_end_together_and_have_balloons(amplifier, tmp_path):
    other = written(tmp_path, "time,voltage\n0,0\n3,1\n")
    with pytest.raises(ScenarioError) as caught:
        scenario({"left": amplifier, "right": other})
    assert "must end together, it ends at 3.0 and left at 4.0" in str(caught.value)
    assert caught.value.key == "step.2.table.right.file"
    with pytest.raises(ScenarioError, match=r"table\.mid = .*no such balloon, must be one of left, right"):
        scenario({"mid": amplifier})


# -- sweeps --------------------------------------------------------------------------------------------


def test_varied_tables_belong_to_the_folder_of_the_scenario(tmp_path, monkeypatch):
    folder = tmp_path / "waves"
    folder.mkdir()
    for name, top in (("low", 0.1), ("high", 0.2)):
        (folder / f"{name}.csv").write_text(f"time,voltage\n0,0\n1,{top}\n")
    (folder / "s.toml").write_text(
        'title = "x"\ngas = { ambient_pressure = 1 }\n'
        '[[balloon]]\nname = "a"\nelectrodes = true\nelastomer = { model = "neo-hookean" }\n'
        '[[step]]\ninflate = 0.2\n[[step]]\ntable = "low.csv"\n[[step]]\ntable = { file = "low.csv" }\n'
    )
    monkeypatch.chdir("/")
    for key in ("step.2.table", "step.3.table.file"):
        sweep = {"scenario": "waves/s.toml", "vary": {key: ["low.csv", "high.csv"]}}
        read = read_sweep(sweep, file=str(tmp_path / "sweep.toml"))
        assert set(read.definition["tables"]) == {str(folder / "low.csv"), str(folder / "high.csv")}
        run_sweep(read, tmp_path / key, workers=1)
        table = load_table(tmp_path / key)
        assert table[key].tolist() == ["low.csv", "high.csv"]
        assert table["largest_field_a"].is_monotonic_increasing
        assert table["largest_field_a"].nunique() == 2


# -- check-table ---------------------------------------------------------------------------------------


def checked(*arguments):
    return CliRunner().invoke(app, ["check-table", *map(str, arguments)])


def test_check_table_says_what_it_would_read(tmp_path, amplifier, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = checked("amp.csv")
    assert done.exit_code == 0
    lines = done.stdout.splitlines()
    assert lines[0] == 'amp.csv: header in row 3, separator ";", decimal ","'
    assert lines[1].split() == ["time", "time_s,", "-2", "to", "4", "s"]
    assert lines[2].split() == ["voltage", "CH1,", "0", "to", "0.25"]
    assert lines[3].split(maxsplit=1) == ["rows", "5, 2 of them before time 0 and left out"]
    assert lines[4].split(maxsplit=1) == ["lasts", "4 s from time 0 on"]
    assert lines[5] == "  not read CH2, note"
    asked = tomllib.loads(lines[-1])["table"]
    assert asked == {"file": "amp.csv", **ASKED}
    assert step_of(scenario(asked)).times.tolist() == [0.0, 1.5, 4.0]


@pytest.mark.parametrize(
    ("text", "options", "line"),
    [
        ("time,voltage\n0,0\n1,1\n", (), 'table = "rec.csv"'),
        ("time [s],voltage [kV]\n0,0\n1,1\n", (), 'table = "rec.csv"'),
        (
            "time_s;kV\n3,0;0\n4,0;1\n",
            (),
            'table = { file = "rec.csv", time = "time_s", voltage = "kV", separator = ";", decimal = ",", '
            'offset = -3.0, units = { kV = "kV" } }',
        ),
        (
            "Time,Channel A\n(ms),(V)\n\n-1.5,0\n0.5,1\n",
            (),
            'table = { file = "rec.csv", time = "(ms)", voltage = "(V)", skip = 1, offset = "1.5 ms" }',
        ),
        (
            "TIME\tCH1\tCH2\n0\t1\t2\n1\t2\t3\n",
            ("--voltage", "CH2"),
            'table = { file = "rec.csv", time = "TIME", voltage = "CH2", separator = "\\t" }',
        ),
        (
            "Model,TDS\nScale,2,5\nTIME,CH1\n0.1,1\n0.2,2\n",
            ("--separator", ",", "--offset", "-0.1"),
            'table = { file = "rec.csv", time = "TIME", voltage = "CH1", skip = 2, offset = -0.1 }',
        ),
        ("t U\n0 1\n1 2\n", (), 'table = { file = "rec.csv", time = "t", voltage = "U", separator = " " }'),
    ],
    ids=["strict", "strict units", "suffix", "PicoScope", "tabs", "Tektronix", "white"],
)
def test_check_table_writes_the_line(tmp_path, monkeypatch, text, options, line):
    monkeypatch.chdir(tmp_path)
    written(tmp_path, text)
    done = checked("rec.csv", *options)
    assert done.stdout.splitlines()[-1] == line
    table = tomllib.loads(line)["table"]
    assert step_of(scenario(table, scales=True)).times[0] == 0.0


@pytest.mark.parametrize(
    ("text", "options", "expected"),
    [
        ("t [s],U [kV]\n0,0\n1,x\n2,1\n", (), "row 3: must be a finite number in column U [kV], is x"),
        ("t,U\n0,0\n1,1\n1,2\n", (), "row 4: time must increase, is 1,2"),
        ("time,voltage\n0,0,1,0\n0,5,2,1\n", (), "decimal commas need another separator"),
        ("hello\nworld\n", (), "row 2: must have two numbers below the header hello"),
        ("", (), "is empty"),
        ("t,U\n0,0\n1,1\n", ("--voltage", "V"), "must be a column of the header in row 1: t, U"),
        ("t,U\n0,0\n1,1\n", ("--separator", ",", "--decimal", ","), "must differ from the separator"),
        ("t,U\n0,0\n1,1\n", ("--decimal", "x"), "must be a point or a comma"),
        ("t,U\n0,0\n1,1\n", ("--offset", "3"), "a row must be at time 0"),
    ],
)
def test_check_table_says_what_is_wrong(tmp_path, text, options, expected):
    asked = written(tmp_path, text)
    done = checked(asked["file"], *options)
    assert done.exit_code == 2
    assert done.stdout == ""
    assert expected in done.stderr


# -- the how-to ----------------------------------------------------------------------------------------


def test_the_how_to_says_what_comes_out(tmp_path, monkeypatch):
    text = (Path(__file__).parent.parent / "docs" / "recordings.md").read_text()
    recording, check, broken, one, by_name = (part.split("```")[0] for part in text.split("```")[1::2])
    monkeypatch.chdir(tmp_path)
    Path("two.csv").write_text(recording.lstrip("\n"))
    assert check.strip() == f"$ balloons check-table two.csv\n{checked('two.csv').stdout.strip()}"
    Path("broken.csv").write_text(recording.lstrip("\n").replace("2,0;2,00", "2,0;2,0O"))
    assert broken.strip() == f"$ balloons check-table broken.csv\n{checked('broken.csv').stderr.strip()}"
    for block in (one, by_name):
        (step,) = tomllib.loads(block.removeprefix("toml"))["step"]
        loaded = scenario(step["table"], scales=True)
        assert step_of(loaded).times.tolist() == [0.0, 1.0, 2.0, 3.0]
    history = simulate(loaded)
    assert history.voltage[-1].tolist() == [0.0, 0.0]
    assert history.voltage.max() * loaded.scales.voltage == pytest.approx(2e3)


# -- speed ---------------------------------------------------------------------------------------------


def test_a_long_recording_is_read_in_one_pass(tmp_path, monkeypatch):
    # A million rows must not be a million Python objects: pandas is asked once, and no row is looked at.
    import simulator.scenario.columns as columns

    rows = 200_000
    frame = pd.DataFrame({"t": np.arange(rows) * 1e-5, "u": np.sin(np.arange(rows) * 1e-3)})
    frame.to_csv(tmp_path / "long.csv", index=False, sep=";", decimal=",")
    looked_at = []
    real = columns.rows_of

    def counted(*arguments):
        for row in real(*arguments):
            looked_at.append(row.number)
            yield row

    monkeypatch.setattr(columns, "rows_of", counted)
    asked = {
        "file": str(tmp_path / "long.csv"),
        "time": "t",
        "voltage": "u",
        "separator": ";",
        "decimal": ",",
    }
    step = step_of(scenario(asked))
    assert np.array_equal(step.voltages, frame["u"])
    assert len(looked_at) == 1
