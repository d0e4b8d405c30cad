"""Sweeps in one line each, and their tables."""

from __future__ import annotations

import csv
from concurrent.futures import Executor, Future
from pathlib import Path

from typer.testing import CliRunner

from simulator.cli import app
from simulator.sweep import load_table, read_sweep, run_sweep
from tests.pairs import pair

ROOT = Path(__file__).parent.parent
FIG3C, FIG5B = ROOT / "scenarios/fig3c_state_b.toml", ROOT / "scenarios/fig5b_state_b.toml"

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
    return CliRunner().invoke(app, [str(word) for word in words])
