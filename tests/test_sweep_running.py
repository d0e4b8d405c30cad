"""Sweeps on disk and on many processes: what survives which death, and that nothing depends on it."""

from __future__ import annotations

import errno
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from simulator.results import files
from simulator.results.files import OutputError
from simulator.scenario import ScenarioError
from simulator.sweep import ExecutorError, load_sweep, load_table, read_sweep, run_sweep
from simulator.sweep.rows import Task, play_chunk
from simulator.sweep.storage import fair_chunk
from tests.sweeps import CHEAP, FIG3C, FIG5B, ROOT, Here, balloons, lines, swept

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
    assert parquet["dissipated"].to_pylist() == whole["dissipated"].tolist()
    assert parquet["landing_pressure"].null_count == 5
    grid = load_sweep(tmp_path / "a")
    assert dict(grid.sizes) == {"gas.ambient_pressure": 2, "step.1.inflate": 3}
    assert (
        grid["behaviour"].sel({"gas.ambient_pressure": 0.015, "step.1.inflate": 1.2}).item() == "snap_returns"
    )
    assert grid["dissipated"].to_numpy().ravel().tolist() == whole["dissipated"].tolist()


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


def test_a_table_that_changes_meanwhile_is_noticed(begun):
    wave = begun.parent / "wave.csv"

    def meddle(done, total):
        if done == 1:
            wave.write_text("time,voltage\n0,0\n1,0.15\n")

    with pytest.raises(ScenarioError, match=r"wave\.csv\": was changed while the sweep ran"):
        run_sweep(
            read_sweep(begun), begun.parent / "other", executor=Here(), workers=1, chunk=1, progress=meddle
        )
    assert len(load_table(begun.parent / "other")) == 1


def test_two_processes_do_not_play_the_same_sweep(begun):
    fcntl = pytest.importorskip("fcntl")
    (begun.parent / "out/sweep.csv").unlink()
    with open(begun.parent / "out/.lock", "ab") as stream:
        fcntl.flock(stream, fcntl.LOCK_EX)
        with pytest.raises(OutputError, match="another process is at work on the sweep in"):
            run_sweep(read_sweep(begun), begun.parent / "out", executor=Here(), resume=True)
    run_sweep(read_sweep(begun), begun.parent / "out", executor=Here(), resume=True)
    assert len(load_table(begun.parent / "out")) == 3


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
    assert load_table(tmp_path)["run"].tolist() == [1, 2, 4]
    run_sweep(sweep, tmp_path, executor=Here(), resume=True)
    assert len(load_table(tmp_path)) == 4


def test_a_worker_of_another_version_is_refused():
    job = read_sweep({"scenario": CHEAP, "vary": {"step.1.inflate": [0.1]}}).job
    other = type(job)(**{**vars(job), "version": "0.0.1"})
    with pytest.raises(
        RuntimeError, match=r"the sweep was started by 0\.0\.1; install the same version everywhere"
    ):
        play_chunk(other, Task(0, 0, ((0.1,),)))


@pytest.mark.parametrize(
    ("size", "workers", "chunk"),
    [(1, 1, 1), (20, 2, 1), (200, 2, 4), (800, 64, 4), (20_000, 2, 100), (10**6, 512, 1000), (5, 64, 1)],
)
def test_chunks_leave_every_worker_some(size, workers, chunk):
    assert fair_chunk(size, workers) == chunk
