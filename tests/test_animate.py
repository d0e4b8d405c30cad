"""Moving pictures: which states they show, and what they are written as."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from simulator import OutputError, simulate
from simulator.cli import app
from simulator.results.plot.animation import animation, frames

SCENARIO = "scenarios/fig5b_state_b.toml"
HISTORY = simulate(SCENARIO)


def test_frames_are_even_in_time_with_pauses_on_both_sides_of_snaps():
    samples = np.array(frames(HISTORY, 43, 5))
    assert samples[0] == 0
    assert samples[-1] == len(HISTORY) - 1
    snaps = np.flatnonzero(np.diff(HISTORY.branch)) + 1
    assert len(snaps) == 3
    assert samples.size == 43 + 3 * 2 * 5
    for snap in snaps:
        assert (samples == snap - 1).sum() >= 5
        assert (samples == snap).sum() >= 5
    even = np.array(frames(HISTORY, 43, 0))
    assert np.abs(HISTORY.time[even] - np.linspace(0.0, 21.0, 43)).max() <= np.diff(HISTORY.time).max()


def test_a_gif_lasts_as_long_as_was_asked_for(tmp_path):
    path = HISTORY.animate(tmp_path / "a.gif", seconds=2.0, rate=5)
    image = Image.open(path)
    durations = []
    for frame in range(image.n_frames):
        image.seek(frame)
        durations.append(image.info["duration"])
    assert sum(durations) == 1000 * (2.0 + 3 * 2 * 2 / 5)  # two frames on either side of three snaps
    image.seek(0)
    first = np.array(image.convert("RGB"), dtype=int)
    image.seek(image.n_frames - 1)
    assert np.abs(np.array(image.convert("RGB"), dtype=int) - first).max() > 100  # something moves


def test_what_cannot_be_written_is_said(tmp_path):
    with pytest.raises(OutputError, match=r"a .gif or a .mp4, not a .avi"):
        HISTORY.animate(tmp_path / "a.avi")
    assert list(tmp_path.iterdir()) == []


def test_an_mp4_needs_ffmpeg():
    if shutil.which("ffmpeg"):
        assert animation(HISTORY, "mp4", seconds=0.5, rate=4)[4:8] == b"ftyp"
    else:
        with pytest.raises(OutputError, match="needs ffmpeg"):
            animation(HISTORY, "mp4", seconds=0.5, rate=4)


def test_the_command_takes_a_scenario_or_results(tmp_path):
    HISTORY.to_csv(tmp_path / "run")
    for source in (SCENARIO, str(tmp_path / "run")):
        done = CliRunner().invoke(
            app, ["animate", source, "--out", str(tmp_path / "a.gif"), "--seconds", "0.4", "--rate", "5"]
        )
        assert done.exit_code == 0, done.output
        assert Image.open(tmp_path / "a.gif").n_frames > 1
    done = CliRunner().invoke(app, ["animate", str(tmp_path), "--out", str(tmp_path / "b.gif")])
    assert done.exit_code == 2
