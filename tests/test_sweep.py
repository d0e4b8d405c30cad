"""Sweeps: what a row says, what survives which death, and what is refused."""

from __future__ import annotations

import csv
import errno
import math
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from simulator import cli, files, load_scenario, simulate
from simulator.files import OutputError
from simulator.scenario import ScenarioError
from simulator.sweep import ExecutorError, load_sweep, load_table, read_sweep, run_sweep
from simulator.sweep import rows as rows_room
from simulator.sweep.plan import Axis
from simulator.sweep.reading import Range, _as_axis
from simulator.sweep.rows import Task, play, play_chunk
from simulator.trace import trace
from tests.pairs import pair

ROOT = Path(__file__).parent.parent
FIG3C, FIG5B = ROOT / "scenarios/fig3c_state_b.toml", ROOT / "scenarios/fig5b_state_b.toml"
SWITCHED = ROOT / "scenarios/sweeps/switched_pair.toml"

# A run of two milliseconds.
CHEAP = pair(0.6, {"ramp": 0.2}, ambient=0.5, output={"points": 2}).to_dict()


class Here(Executor):
    """Plays at once and in this process."""

    def submit(self, function, /, *words, **more):
        future = Future()
        try:
            future.set_result(function(*words, **more))
        except Exception as error:
            future.set_exception(error)
        return future


def swept(tmp_path, definition, **how):
    run_sweep(read_sweep(definition), tmp_path, executor=Here(), **how)
    return load_table(tmp_path)


def lines(directory):
    """The table as text, but for the column of run times."""
    with open(Path(directory) / "sweep.csv", newline="") as stream:
        table = list(csv.reader(stream))
    place = table[0].index("seconds")
    return [row[:place] + row[place + 1 :] for row in table]


def balloons(*words):
    return CliRunner().invoke(cli.app, [str(word) for word in words])


def refusal(**definition):
    base = {"scenario": CHEAP, "vary": {"gas.ambient_pressure": [1.0]}}
    with pytest.raises(ScenarioError) as caught:
        read_sweep({**base, **definition})
    return str(caught.value)


# --- what a row says ---


@pytest.mark.parametrize(
    ("radius", "ambient", "inflation", "behaviour", "voltage"),
    [  # the table of docs/physics.md, 40 digits rounded to eight
        (1.0, 1.0, 0.6, "loss_of_tension", None),
        (1.0, 1.0, 1.3, "continuous", None),
        (1.0, 0.2, 0.6, "snap_to_loss_of_tension", 0.58183674),
        (1.0, 0.015, 1.2, "snap_returns", 0.36044087),
        (0.5, 1.0, 1.2, "snap_to_loss_of_tension", 0.49689270),
        (0.5, 1.0, 2.4, "snap_stays", 0.13925397),
        (0.5, 1.0, 2.6, "continuous", None),
        (0.5, 0.05, 1.2, "snap_returns", 0.49619765),
        (0.5, 0.05, 2.4, "snap_stays", 0.13914986),
    ],
)
def test_what_the_paper_finds_is_what_the_rows_say(radius, ambient, inflation, behaviour, voltage):
    sweep = read_sweep(ROOT / "scenarios/sweeps/paper_map.toml")
    row = play(sweep.job, 0, (radius, ambient, inflation))
    assert row["behaviour"] == behaviour
    if voltage is None:
        assert row["limit_points"] == 0
        assert row["step.2.ramp"] == 0.75
    else:
        assert row["limit_point_1_voltage_active"] == pytest.approx(voltage, abs=5e-9)
        assert row["step.2.ramp"] == 1.001 * row["limit_point_1_voltage_active"]
    assert row["energy_imbalance"] < 1e-8


def test_a_row_has_the_numbers_of_the_history(tmp_path):
    (_, row), *_ = swept(tmp_path, {"scenario": str(FIG3C), "vary": {"step.1.inflate": [1.2]}}).iterrows()
    history = simulate(load_scenario(FIG3C))
    up, down = history.events
    assert row["limit_points"] == 2
    assert row["limit_point_1_voltage_active"] == up.voltage[0] == pytest.approx(0.36044087, abs=5e-9)
    assert row["limit_point_2_voltage_active"] == down.voltage[0] == pytest.approx(0.27029133, abs=5e-9)
    assert row["landing_stretch_active"] == up.stretch_after[0] == pytest.approx(6.51514013, abs=5e-9)
    assert row["landing_pressure"] == up.pressure_after
    assert row["largest_stretch_passive"] == history.stretch[:, 1].max()
    assert row["largest_field_active"] == np.abs(history.field).max()
    assert row["residual_stretch_active"] == pytest.approx(1.2625778856, abs=1e-10)
    assert row["sealed_stretch_passive"] == pytest.approx(1.2625778856, abs=1e-10)
    assert row["loop_work"] == pytest.approx(40.830526, abs=5e-7)
    assert row["dissipated"] == pytest.approx(40.830526, abs=5e-7)


def test_snaps_of_the_inflation_are_told_apart_from_those_of_the_voltage(tmp_path):
    table = swept(tmp_path, {"scenario": str(FIG5B), "vary": {"step.1.inflate": [1.2, 2.4, 2.6]}})
    assert table["inflation_snaps"].tolist() == [0, 1, 2]
    assert table["limit_points"].tolist() == [0, 1, 0]
    assert table["behaviour"].tolist() == ["continuous", "snap_stays", "continuous"]
    assert table["residual_stretch_active"][1] == pytest.approx(6.02643177, abs=5e-9)
    assert math.isnan(table["landing_pressure"][0])


def test_breakdown_and_voltage_left_on(tmp_path):
    strong = {**load_scenario(FIG3C).to_dict()}
    strong["step"] = strong["step"][:2]
    table = swept(
        tmp_path, {"scenario": strong, "vary": {"balloon.active.breakdown.field": [0.5, 12.0, 50.0]}}
    )
    assert table["behaviour"].tolist() == ["breakdown", "snap_to_breakdown", "snap"]
    assert table["outcome"].tolist() == ["breakdown", "breakdown", "completed"]
    assert table["largest_field_active"][0] == pytest.approx(0.5, abs=1e-9)


def test_a_run_that_fails_is_a_row(tmp_path, monkeypatch):
    def broken(scenario):
        if scenario.gas.ambient_pressure == 2.0:
            raise ZeroDivisionError("a bug,\nsomewhere")
        return simulate(scenario)

    monkeypatch.setattr(rows_room, "simulate", broken)
    definition = {"scenario": CHEAP, "vary": {"gas.ambient_pressure": [1.0, 2.0, 3.0]}}
    table = swept(tmp_path, definition)
    assert table["outcome"].tolist() == ["completed", "failed", "completed"]
    assert table["error"].tolist() == ["", "ZeroDivisionError: a bug, somewhere", ""]
    assert math.isnan(table["limit_points"][1])
    grid = load_sweep(tmp_path)
    assert np.isnan(grid["loop_work"].to_numpy()).tolist() == [False, True, False]


def test_values_that_do_not_go_together_are_rows(tmp_path):
    scenario = {**CHEAP, "output": {"every": 1e6}}
    table = swept(
        tmp_path, {"scenario": scenario, "vary": {"step.2.over": [1.0, 1e7], "output.every": [0.5, 1e6]}}
    )
    assert table["outcome"].tolist() == ["completed", "completed", "refused", "completed"]
    assert table["error"][2].startswith("output.every = 0.5: must ask for at most 10,000,000 samples")


def test_sensitivities_as_columns(tmp_path):
    keys = ["gas.ambient_pressure", "step.1.inflate"]
    definition = {
        "scenario": str(FIG3C),
        "vary": {"step.1.inflate": [1.2, 1.3]},
        "record": {"sensitivities": keys},
    }
    table = swept(tmp_path, definition)
    found = table["d(limit_point_1_voltage_active)/d(step.1.inflate)"]
    h = 1e-5
    ends = [trace(pair(1.2 + e, {"ramp": 0.1}, ambient=0.015)).points[0].voltage[0] for e in (h, -h)]
    assert found[0] == pytest.approx((ends[0] - ends[1]) / (2 * h), rel=1e-7)
    assert math.isnan(found[1])  # state C has no limit point


# --- what is played ---


def test_the_last_axis_changes_fastest_and_all_balloons_go_by_a_star():
    sweep = read_sweep(
        {
            "scenario": CHEAP,
            "vary": {"gas.ambient_pressure": [1, 2], "balloon.*.elastomer.J_lim": [50, 60, 70]},
        }
    )
    assert (sweep.shape, sweep.size) == ((2, 3), 6)
    assert sweep.values(2, 5) == [(1.0, 70.0), (2.0, 50.0), (2.0, 60.0)]
    row = play(sweep.job, 0, (1.0, 50.0))
    alone = simulate(pair(0.6, {"ramp": 0.2}, J_lim=50.0))
    assert row["largest_stretch_passive"] == pytest.approx(alone.stretch[:, 1].max(), abs=1e-14)


def test_spacings_reach_their_ends():
    span = {"from": 0.01, "to": 1.0, "points": 5}
    values = {
        spacing: read_sweep({"scenario": CHEAP, "vary": {"step.1.inflate": {**span, "spacing": spacing}}})
        for spacing in ("linear", "log")
    }
    for spacing, sweep in values.items():
        (axis,) = sweep.axes
        steps = np.diff(np.log(axis.values) if spacing == "log" else axis.values)
        assert (axis.values[0], axis.values[-1]) == (0.01, 1.0)
        assert np.ptp(steps) < 1e-14


@pytest.mark.parametrize("method", ["sobol", "latin-hypercube", "random"])
def test_samples_fill_their_intervals_and_come_again(method):
    definition = {
        "scenario": CHEAP,
        "sample": {"method": method, "size": 256, "seed": 3},
        "vary": {
            "gas.ambient_pressure": {"from": 0.01, "to": 1.0, "spacing": "log"},
            "step.1.inflate": {"from": 1.0, "to": 0.5},
        },
    }
    sweep, again = read_sweep(definition), read_sweep(definition)
    points = np.array(sweep.values(0, 256))
    assert points.tolist() == np.array(again.values(0, 256)).tolist()
    assert points[100:103].tolist() == [list(row) for row in sweep.values(100, 103)]
    assert (points.min(0) >= [0.01, 0.5]).all()
    assert (points.max(0) <= [1.0, 1.0]).all()
    tenths = np.histogram(np.log(points[:, 0]), 8, (math.log(0.01), 0.0))[0]
    assert (tenths == 32).all() if method != "random" else (tenths > 10).all()
    other = read_sweep({**definition, "sample": {"method": method, "size": 256, "seed": 4}})
    assert other.values(0, 1) != sweep.values(0, 1)


def test_whole_numbers_stay_whole_and_texts_are_values(tmp_path):
    scenario = {**CHEAP, "step": [CHEAP["step"][0], {"cycle": 1, "steps": [{"ramp": 0.1}, {"ramp": 0.0}]}]}
    definition = {
        "scenario": scenario,
        "vary": {"step.2.cycle": [1, 3], "step.2.steps.1.valve": ["open", "closed"]},
    }
    table = swept(tmp_path, definition)
    assert (table["outcome"] == "completed").all()
    grid = load_sweep(tmp_path)
    assert grid["step.2.steps.1.valve"].to_numpy().tolist() == ["open", "closed"]
    assert (
        grid["loop_work"].sel({"step.2.cycle": 3.0, "step.2.steps.1.valve": "closed"}).item()
        == table["loop_work"][3]
    )


def test_numbers_in_units_keep_them():
    axis = _as_axis(
        "gas.ambient_pressure", Range.model_validate({"from": "1 kPa", "to": "3 kPa", "points": 3})
    )
    assert axis == Axis("gas.ambient_pressure", (1.0, 2.0, 3.0), " kPa")
    assert [axis.written(value) for value in axis.values] == ["1.0 kPa", "2.0 kPa", "3.0 kPa"]


# --- what is on disk ---


def test_table_parquet_and_grid_agree_to_the_last_bit(tmp_path):
    pq = pytest.importorskip("pyarrow.parquet")
    definition = {
        "scenario": str(FIG3C),
        "vary": {"gas.ambient_pressure": [0.015, 0.2], "step.1.inflate": [0.6, 1.2, 1.3]},
    }
    whole = swept(tmp_path / "a", definition)
    swept(tmp_path / "b", definition, chunk=4)
    assert lines(tmp_path / "a") == lines(tmp_path / "b")
    assert sorted(path.name for path in (tmp_path / "a").iterdir()) == [
        "sweep.csv",
        "sweep.json",
        "sweep.parquet",
    ]
    parquet = pq.read_table(tmp_path / "a/sweep.parquet")
    (tmp_path / "a/sweep.parquet").unlink()
    assert load_table(tmp_path / "a").equals(whole)
    assert parquet["loop_work"].to_pylist() == whole["loop_work"].tolist()
    assert parquet["landing_pressure"].null_count == 5
    grid = load_sweep(tmp_path / "a")
    assert dict(grid.sizes) == {"gas.ambient_pressure": 2, "step.1.inflate": 3}
    assert (
        grid["behaviour"].sel({"gas.ambient_pressure": 0.015, "step.1.inflate": 1.2}).item() == "snap_returns"
    )
    assert grid["loop_work"].to_numpy().ravel().tolist() == whole["loop_work"].tolist()


def test_samples_load_as_a_table_and_half_a_grid_with_gaps(tmp_path):
    sample = {
        "scenario": CHEAP,
        "sample": {"method": "sobol", "size": 4},
        "vary": {"step.1.inflate": {"from": 0.1, "to": 0.6}},
    }
    swept(tmp_path / "sample", sample)
    table = load_sweep(tmp_path / "sample")
    assert table["run"].tolist() == [1, 2, 3, 4]

    class Stop(Exception):
        pass

    def stop(done, total):
        if done == 2:
            raise Stop

    with pytest.raises(Stop):
        swept(
            tmp_path / "half",
            {"scenario": CHEAP, "vary": {"step.1.inflate": [0.1, 0.2, 0.3, 0.4]}},
            progress=stop,
        )
    grid = load_sweep(tmp_path / "half")
    assert np.isnan(grid["loop_work"].to_numpy()).sum() == 2
    assert sorted(grid["outcome"].to_numpy()) == ["", "", "completed", "completed"]


def test_without_the_extra_the_message_names_it(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.setitem(sys.modules, "xarray", None)
    monkeypatch.setitem(sys.modules, "distributed", None)
    table = swept(tmp_path, {"scenario": CHEAP, "vary": {"step.1.inflate": [0.1, 0.2]}})
    assert len(table) == 2
    with pytest.raises(ImportError, match=r"pip install 'dielectric-balloons\[sweep\]'"):
        load_sweep(tmp_path)
    (tmp_path / "sweep.toml").write_text(f'scenario = "{FIG3C}"\n[vary]\n"step.1.inflate" = [0.1]\n')
    result = balloons(
        "sweep", tmp_path / "sweep.toml", "--dask", "tcp://127.0.0.1:1", "--out", tmp_path / "x"
    )
    assert result.exit_code == 2
    assert "pip install 'dielectric-balloons[dask]'" in result.stderr


def test_a_full_disk_loses_nothing(tmp_path, monkeypatch):
    definition = {"scenario": CHEAP, "vary": {"step.1.inflate": [0.1, 0.2, 0.3, 0.4, 0.5]}}
    swept(tmp_path / "whole", definition)
    sync, left = os.fsync, [4]

    def full(descriptor):
        left[0] -= 1
        if left[0] < 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        sync(descriptor)

    monkeypatch.setattr(files.os, "fsync", full)
    with pytest.raises(OutputError, match="No space left on device"):
        swept(tmp_path / "full", definition)
    assert len(list((tmp_path / "full/chunks").iterdir())) == 3
    monkeypatch.setattr(files.os, "fsync", sync)
    swept(tmp_path / "full", definition, resume=True)
    assert lines(tmp_path / "full") == lines(tmp_path / "whole")


# --- resuming ---


@pytest.fixture
def begun(tmp_path):
    """Files of a sweep with a table, of which some runs are there."""
    (tmp_path / "wave.csv").write_text("time,voltage\n0,0\n1,0.1\n")
    (tmp_path / "pair.toml").write_text(
        'title = "a pair"\n[gas]\nambient_pressure = 1.0\n[[balloon]]\nname = "a"\nelectrodes = true\n'
        'elastomer = { model = "gent", J_lim = 100 }\n[[step]]\ninflate = 0.5\n[[step]]\ntable = "wave.csv"\n'
    )
    file = tmp_path / "sweep.toml"
    file.write_text(
        'scenario = "pair.toml"\n[vary]\n"gas.ambient_pressure" = { from = 1, to = 2, points = 3 }\n'
    )
    run_sweep(read_sweep(file), tmp_path / "out", executor=Here())
    return file


def edit(file, old, new):
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))


@pytest.mark.parametrize(
    ("name", "old", "new", "told"),
    [
        (
            "sweep.toml",
            "points = 3",
            "points = 4",
            'vary."gas.ambient_pressure".points: is 4, but the sweep in',
        ),
        ("sweep.toml", "to = 2", "to = 3", 'vary."gas.ambient_pressure".to.1: is 3.0'),
        ("pair.toml", "inflate = 0.5", "inflate = 0.6", "scenario.step.1.inflate: is 0.6"),
        ("pair.toml", "J_lim = 100", "J_lim = 90", "scenario.balloon.1.elastomer.J_lim: is 90.0"),
        ("wave.csv", "1,0.1", "1,0.2", "wave.csv"),
    ],
)
def test_another_sweep_is_not_gone_on_with(begun, name, old, new, told):
    edit(begun.parent / name, old, new)
    result = balloons("sweep", begun, "--out", begun.parent / "out", "--resume")
    assert result.exit_code == 2
    assert f"balloons: {begun}: " in result.stderr
    assert told in result.stderr
    assert "was begun with" in result.stderr


def test_a_comment_changes_nothing(begun):
    edit(begun, "[vary]", "[vary]  # ambient pressure alone")
    result = balloons("sweep", begun, "--out", begun.parent / "out", "--resume")
    assert (result.exit_code, result.stderr) == (0, "")
    assert "for 0 runs, 3 were there before" in result.stdout


def test_a_directory_is_not_written_over(begun):
    result = balloons("sweep", begun, "--out", begun.parent / "out")
    assert result.exit_code == 2
    assert "holds a sweep already, 3 of 3 runs; go on with it by --resume" in result.stderr
    (begun.parent / "out/sweep.json").unlink()
    result = balloons("sweep", begun, "--out", begun.parent / "out", "--resume")
    assert result.exit_code == 2
    assert "has results of a sweep but no sweep.json" in result.stderr


def test_killed_without_warning_and_resumed_nothing_is_lost_or_played_twice(tmp_path):
    file = tmp_path / "sweep.toml"
    file.write_text(
        f'scenario = "{FIG5B}"\n[vary]\n"gas.ambient_pressure" = {{ from = 0.05, to = 1, points = 12 }}\n'
        '"step.1.inflate" = [1.2, 2.4]\n'
    )
    out = tmp_path / "out"
    words = [
        sys.executable,
        "-m",
        "simulator",
        "sweep",
        str(file),
        "--out",
        str(out),
        "--workers",
        "2",
        "--chunk",
        "2",
    ]
    process = subprocess.Popen(words, env={**os.environ, "PYTHONPATH": str(ROOT)}, start_new_session=True)
    chunks = out / "chunks"
    while not chunks.is_dir() or len(list(chunks.glob("[0-9]*.csv"))) < 3:
        assert process.poll() is None
        time.sleep(0.005)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    (chunks / ".0000009.csv.abcdef.tmp").write_text("half a li")
    safe = {line for path in chunks.glob("[0-9]*.csv") for line in path.read_text().splitlines()}
    assert 6 <= len(safe) < 24
    result = balloons("sweep", file, "--out", out, "--resume", "--workers", 1)
    assert result.exit_code == 0
    assert f"{len(safe)} were there before" in result.stdout
    # Rows with their run times: none of those that were safe has been played again.
    assert safe <= set((out / "sweep.csv").read_text().splitlines())
    assert sorted(path.name for path in out.iterdir()) == ["sweep.csv", "sweep.json", "sweep.parquet"]
    run_sweep(read_sweep(file), tmp_path / "whole", executor=Here())
    assert lines(out) == lines(tmp_path / "whole")
    deadline = time.monotonic() + 10.0
    while _members(process.pid) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not _members(process.pid)  # its workers do not outlive it


def _members(group):
    """Living processes of a process group."""
    found = []
    for entry in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, member = entry.read_text().rpartition(")")[2].split()[:3]
        except OSError:
            continue
        if int(member) == group and state != "Z":
            found.append(int(entry.parent.name))
    return found


# --- who plays it ---

GRID = {
    "scenario": str(FIG3C),
    "vary": {"gas.ambient_pressure": [0.01, 0.015, 0.03, 0.1, 0.2], "step.1.inflate": [0.6, 1.1, 1.2, 1.3]},
}


class Murder:
    """A progress report that kills a process once some runs are back."""

    def __init__(self, victim):
        self.victim, self.done = victim, False

    def __call__(self, done, total):
        if 0 < done < total and not self.done:
            self.done = True
            os.kill(self.victim(), signal.SIGKILL)


def test_dask_and_processes_give_the_same_rows_though_workers_are_killed(tmp_path):
    distributed = pytest.importorskip("distributed")
    sweep = read_sweep(GRID)
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        pids = list(client.run(os.getpid).values())
        murder = Murder(lambda: pids[0])
        run_sweep(
            sweep,
            tmp_path / "dask",
            executor=client.get_executor(pure=False),
            workers=2,
            chunk=2,
            progress=murder,
        )
        assert murder.done
        (tmp_path / "sweep.toml").write_text(f'scenario = "{FIG3C}"\n[vary]\n"step.1.inflate" = [0.6, 1.2]\n')
        result = balloons(
            "sweep", tmp_path / "sweep.toml", "--dask", cluster.scheduler_address, "--out", tmp_path / "cli"
        )
        assert result.exit_code == 0, result.stderr
        assert "snap_returns" in result.stdout
    murder = Murder(lambda: multiprocessing.active_children()[0].pid)
    run_sweep(sweep, tmp_path / "processes", workers=2, chunk=2, progress=murder)
    assert murder.done
    run_sweep(sweep, tmp_path / "here", executor=Here())
    assert len(lines(tmp_path / "here")) == 21
    assert lines(tmp_path / "dask") == lines(tmp_path / "processes") == lines(tmp_path / "here")


def test_any_executor_will_do(tmp_path):
    with ThreadPoolExecutor(1) as executor:
        run_sweep(
            read_sweep({"scenario": CHEAP, "vary": {"step.1.inflate": [0.1, 0.2]}}),
            tmp_path,
            executor=executor,
        )
    assert len(load_table(tmp_path)) == 2


def test_a_run_that_kills_its_worker_each_time_is_a_row(tmp_path):
    """As a crash in compiled code would; dask says KilledWorker."""

    class KilledWorker(Exception):
        pass

    class Deadly(Here):
        def submit(self, function, job, task):
            if any(0.25 < value[0] < 0.35 for value in task.values):
                future = Future()
                future.set_exception(KilledWorker())
                return future
            return super().submit(function, job, task)

    values = [0.1, 0.2, 0.3, 0.4, 0.5]
    run_sweep(
        read_sweep({"scenario": CHEAP, "vary": {"step.1.inflate": values}}),
        tmp_path,
        executor=Deadly(),
        chunk=3,
    )
    table = load_table(tmp_path)
    assert table["step.1.inflate"].tolist() == values
    assert table["outcome"].tolist() == ["completed", "completed", "failed", "completed", "completed"]
    assert table["error"][2] == "the worker process died in this run, each time"


def test_an_executor_that_fails_is_told_and_what_is_back_is_kept(tmp_path):
    class Lost(Here):
        def submit(self, function, job, task):
            future = Future()
            if task.number == 2:
                future.cancel()
                future.set_running_or_notify_cancel()
                return future
            return super().submit(function, job, task)

    sweep = read_sweep({"scenario": CHEAP, "vary": {"step.1.inflate": [0.1, 0.2, 0.3, 0.4]}})
    with pytest.raises(ExecutorError, match="the executor failed, CancelledError"):
        run_sweep(sweep, tmp_path, executor=Lost(), workers=1)
    assert len(load_table(tmp_path)) == 2
    run_sweep(sweep, tmp_path, executor=Here(), resume=True)
    assert len(load_table(tmp_path)) == 4


def test_a_worker_of_another_version_is_refused():
    job = read_sweep({"scenario": CHEAP, "vary": {"step.1.inflate": [0.1]}}).job
    other = type(job)(**{**vars(job), "version": "0.0.1"})
    with pytest.raises(
        RuntimeError, match=r"the sweep was started by 0\.0\.1; install the same version everywhere"
    ):
        play_chunk(other, Task(0, 0, ((0.1,),)))


# --- what is refused ---


@pytest.mark.parametrize(
    ("definition", "told"),
    [
        ({"vary": {"gas.ambient_presure": [1.0]}}, 'vary."gas.ambient_presure": no such key in the scenario, did you mean gas.ambient_pressure?'),
        ({"vary": {"balloon.activ.radius": [1.0]}}, "did you mean balloon.active.radius or"),
        ({"vary": {"step.3.ramp": [1.0]}}, "did you mean step.2.ramp"),
        ({"vary": {"gas": [1.0]}}, "vary.gas: no such key"),
        ({"vary": {}}, "vary = {}: must be a table with one or more keys of the scenario"),
        ({"vary": {"step.1.inflate": []}}, 'vary."step.1.inflate" = []: must have one or more values'),
        ({"vary": {"step.1.inflate": 3}}, "must be a list of values, or a table such as"),
        ({"vary": {"step.1.inflate": [1, "a"]}}, "must be all numbers, all texts or all true or false"),
        ({"vary": {"step.1.inflate": [1, 1.0]}}, "must not have a value twice"),
        ({"vary": {"step.1.inflate": [math.inf]}}, "must be finite numbers"),
        ({"vary": {"step.1.inflate": [0.5, -1.0]}}, 'vary."step.1.inflate" = -1.0: must be a number >= 0'),
        ({"vary": {"step.1.inflate": {"from": 1, "to": 2, "points": 3, "spacing": "cubic"}}}, 'vary."step.1.inflate".spacing = "cubic": must be "linear" or "log"'),
        ({"vary": {"step.1.inflate": {"from": 0, "to": 2, "points": 3, "spacing": "log"}}}, 'vary."step.1.inflate".from = 0.0: must be > 0 with log spacing'),
        ({"vary": {"step.1.inflate": {"from": 1, "to": 1, "points": 3}}}, 'vary."step.1.inflate".to = 1.0: must differ from from'),
        ({"vary": {"step.1.inflate": {"from": 1, "to": 2}}}, 'vary."step.1.inflate".points: is missing, must be a whole number >= 2'),
        ({"vary": {"step.1.inflate": {"from": 1, "to": 2, "points": 1}}}, "points = 1: must be a whole number >= 2"),
        ({"vary": {"step.1.inflate": {"from": "1 kPa", "to": "2 Pa", "points": 2}}}, "must be in the unit of from, kPa"),
        ({"vary": {"step.1.inflate": {"from": [], "to": 2, "points": 2}}}, "must be a finite number, or a text such as"),
        ({"vary": {"balloon.active.name": ["a"]}}, "cannot be varied, results have columns by name"),
        ({"vary": {"step.1.inflate": {"from": 0, "to": 1, "points": 20_000_000}}}, "must ask for at most 10,000,000 runs, asks for 20,000,000"),
        ({"sample": {"method": "sobl", "size": 4}}, 'sample.method = "sobl": must be "sobol", "latin-hypercube" or "random"'),
        ({"sample": {"method": "sobol", "size": 4}}, "must be an interval such as { from = 0.1, to = 1 }"),
        ({"sample": {"method": "sobol", "size": 100}, "vary": {"step.1.inflate": {"from": 0.1, "to": 1}}}, "sample.size = 100: must be a power of 2 for sobol, such as 128"),
        ({"sample": {"method": "random", "size": 4}, "vary": {"step.1.inflate": {"from": 0.1, "to": 1, "points": 3}}}, "points = 3: does not go with sample"),
        ({"past_limit_point": {"step.1.inflate": {"times": 1.1}}}, "must be a ramp of the scenario, step.2.ramp"),
        ({"past_limit_point": {"step.2.ramp": {"times": 1.0}}}, 'past_limit_point."step.2.ramp".times = 1.0: must be a number > 1'),
        ({"past_limit_point": {"step.2.ramp": {"times": 1.1}}, "vary": {"step.2.ramp": [1.0]}}, "is varied, too"),
        ({"record": {"sensitivities": ["gas.pressure"]}}, 'record.sensitivities = "gas.pressure": no number of the device; did you mean gas.ambient_pressure'),
        ({"record": {"limit_points": -1}}, "record.limit_points = -1: must be a whole number from 0 to 100"),
        ({"out": "x"}, 'out = "x": unknown key, allowed here: title, scenario, sample, vary, past_limit_point, record'),
    ],
)  # fmt: skip
def test_refused(definition, told):
    message = refusal(**definition)
    assert message.startswith("<dict>: ")
    assert told in message


def test_files_that_are_not_there_or_not_toml(tmp_path):
    result = balloons("sweep", tmp_path / "none.toml")
    assert (result.exit_code, "none.toml: cannot be read, no such file" in result.stderr) == (2, True)
    (tmp_path / "bad.toml").write_text("scenario = ")
    assert "bad.toml: must be TOML" in balloons("sweep", tmp_path / "bad.toml").stderr
    (tmp_path / "lost.toml").write_text('scenario = "lost_pair.toml"\n[vary]\n"a.b" = [1]\n')
    assert "lost_pair.toml: cannot be read" in balloons("sweep", tmp_path / "lost.toml").stderr
    with pytest.raises(OutputError, match=r"no sweep in .*sweep\.json cannot be read, no such file"):
        load_sweep(tmp_path)


def test_a_scheduler_that_is_not_there(tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    from simulator.sweep import cluster

    monkeypatch.setattr(cluster, "_PATIENCE", 0.5)
    (tmp_path / "sweep.toml").write_text(f'scenario = "{FIG3C}"\n[vary]\n"step.1.inflate" = [0.1]\n')
    for address in ("tcp://127.0.0.1:1", "nowhere"):
        result = balloons("sweep", tmp_path / "sweep.toml", "--dask", address, "--out", tmp_path / "x")
        assert result.exit_code == 2
        assert f"--dask {address}: no scheduler answers there" in result.stderr
    assert not (tmp_path / "x").exists()
