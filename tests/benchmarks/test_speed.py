"""Run times beside what a user would write today, in one session: `make bench`.

The other way is the viscous ODE τ dλᵢ/dt = −gᵢ, gas law eliminated, with SciPy's LSODA and a relaxation
time of 1e-7 of the ramp. Its limit point is late by 1e-5 in φ whatever the tolerance (all of it delay).
Compare within one session only, medians with medians.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from simulator.analysis.path import whole_path
from simulator.analysis.trace import sealed_state, trace
from simulator.simulation.run import simulate
from simulator.solver import proposals
from tests.pairs import pair

RUNS = int(os.environ.get("BALLOONS_RUNS", "10000"))
AMBIENT, INFLATION, J, DELAY = 0.015, 1.2, 100.0, 1e-7
CLIMB = 0.36044  # just below the first limit point of 3c B, φ = 0.360440865
UP, DOWN = {"ramp": 0.4, "over": 1}, {"ramp": 0.0, "over": 1}


def force(stretch):
    return 2 * J * (stretch - stretch**-5) / (J - (2 * stretch * stretch + stretch**-4 - 3))


def lsoda(*ends: float, rtol: float = 1e-8, atol: float = 1e-10, until: float | None = None):
    start = brentq(lambda x: force(x) - INFLATION * x * x, 1.0001, 1.39)
    gas = (INFLATION + AMBIENT) * 2 * start**3

    def rates(t, stretch):
        active, passive = stretch
        voltage = 0.4 * t if t < 1 else 0.4 * (2 - t)
        pressure = gas / (active**3 + passive**3) - AMBIENT
        return [
            -(force(active) - pressure * active**2 - 2 * voltage**2 * active**3) / DELAY,
            -(force(passive) - pressure * passive**2) / DELAY,
        ]

    def snapped(t, stretch):
        return stretch[0] - until

    snapped.terminal = True  # type: ignore[attr-defined]
    state = [start, start]
    for begin, end in pairwise(ends):
        events = snapped if until else None
        result = solve_ivp(rates, (begin, end), state, method="LSODA", rtol=rtol, atol=atol, events=events)
        state = result.y[:, -1]
    return result


@pytest.mark.benchmark(group="climb to the first limit point of 3c B, from scenario to result")
def test_climb(benchmark):
    scenario = pair(INFLATION, {"ramp": CLIMB, "over": 1}, ambient=AMBIENT)
    benchmark(simulate, scenario)


@pytest.mark.benchmark(group="climb to the first limit point of 3c B, from scenario to result")
@pytest.mark.parametrize("rtol", [1e-8, 1e-6, 1e-3])
def test_climb_by_lsoda(benchmark, rtol):
    result = benchmark(lsoda, 0.0, 1.0, rtol=rtol, atol=0.01 * rtol, until=3.5)
    assert 0.4 * result.t_events[0][0] == pytest.approx(0.360440865, abs=2e-5)


@pytest.mark.benchmark(group="up and down 3c B")
def test_cycle(benchmark):
    benchmark(simulate, pair(INFLATION, UP, DOWN, ambient=AMBIENT))


@pytest.mark.benchmark(group="up and down 3c B")
@pytest.mark.parametrize("rtol", [1e-8, 1e-6, 1e-3])
def test_cycle_by_lsoda(benchmark, rtol):
    result = benchmark(lsoda, 0.0, 1.0, 2.0, rtol=rtol, atol=0.01 * rtol)
    assert result.y[:, -1] == pytest.approx([1.2626, 1.2626], abs=1e-3)


@pytest.mark.benchmark(group="cycles of 3c B")
@pytest.mark.parametrize("cycles", [1, 10, 100])
def test_cycles(benchmark, cycles):
    benchmark.pedantic(
        simulate, (pair(INFLATION, {"cycle": cycles, "steps": [UP, DOWN]}, ambient=AMBIENT),), rounds=5
    )


def test_a_million_rows(tmp_path):
    """A recording is read, played and drawn in at most twice the time of the run; what is imported aside."""
    from simulator.results.plot import plot_history, png  # matplotlib's start is no part of it

    rows = np.arange(1_000_000)
    noise = np.random.default_rng(1).normal(size=rows.size)
    voltage = np.abs(0.2 - 0.2 * np.cos(2.0 * np.pi * rows / 250_000) + 2e-3 * noise)
    voltage[0] = 0.0
    path = tmp_path / "recording.csv"
    pd.DataFrame({"time": 1e-3 * rows, "voltage": voltage}).to_csv(path, index=False)
    for output in ({}, {"rows": True}):
        taken = []
        for _ in range(3):
            moments = [time.process_time()]
            scenario = pair(INFLATION, {"table": str(path)}, ambient=AMBIENT, output=output)
            moments.append(time.process_time())
            history = simulate(scenario)
            moments.append(time.process_time())
            assert png(plot_history(history))
            moments.append(time.process_time())
            taken.append(np.diff(moments))
        read, played, drawn = np.min(taken, axis=0)
        print(f"{len(history)} samples: read {read:.2f} s, played {played:.2f} s, drawn {drawn:.2f} s")
        assert read + played + drawn <= 2.0 * played


@pytest.mark.benchmark(group="two noisy recordings, 300 rows")
def test_two_recordings(benchmark, tmp_path):
    rows = np.arange(300)
    noise = np.random.default_rng(1).normal(size=(2, rows.size))
    base = 0.15 - 0.15 * np.cos(2.0 * np.pi * rows / 300)
    left, right = np.abs(base + 2e-3 * noise[0]), np.abs(0.5 * base + 2e-3 * noise[1])
    left[0] = right[0] = 0.0
    path = tmp_path / "two.csv"
    pd.DataFrame({"time": rows, "left": left, "right": right}).to_csv(path, index=False)
    recording = {"file": str(path), "time": "time"}
    table = {"active": {**recording, "voltage": "left"}, "passive": {**recording, "voltage": "right"}}
    scenario = pair(INFLATION, {"table": table}, ambient=AMBIENT, passive={"electrodes": True})
    benchmark.pedantic(simulate, (scenario,), rounds=5)


@pytest.mark.benchmark(group="whole process")
@pytest.mark.parametrize("what", ["run", "imports", "81 peaks of 5c A", "states of five balloons"])
def test_process(benchmark, what, tmp_path):
    words = {
        "run": "run scenarios/fig5b_state_b.toml",
        "81 peaks of 5c A": "unload scenarios/fig5c_state_a.toml --peaks 0.1:0.6:81",
        "states of five balloons": "states scenarios/five_states.toml",
    }
    command = ["-c", "import numpy, sksundae, pandas"]
    if what in words:
        command = ["-m", "simulator", *words[what].split(), "--quiet", "--out", str(tmp_path)]
    benchmark.pedantic(subprocess.run, ([sys.executable, *command],), {"check": True}, rounds=7)


def test_memory_is_flat():
    """Resident memory over many runs; not a timing, so it asserts."""
    resource = pytest.importorskip("resource")
    scenario = pair(0.6, {"ramp": 0.2}, ambient=AMBIENT, output={"points": 5})
    sizes = []
    for count in range(1, RUNS + 1):
        simulate(scenario)
        if count % (RUNS // 10) == 0:
            sizes.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
    assert np.ptp(sizes[1:]) < 4_000  # kB


def pieces_of(scenario):
    """What IDA is asked to integrate in a trace, to be asked again without anything around it."""
    asked = []
    by_ida = proposals.by_ida

    def noted(*words):
        asked.append(words)
        return by_ida(*words)

    proposals.by_ida = noted
    try:
        trace(scenario)
    finally:
        proposals.by_ida = by_ida
    return asked


@pytest.mark.benchmark(group="the whole path of 3c B")
@pytest.mark.parametrize("what", ["trace", "IDA alone"])
def test_trace(benchmark, what):
    scenario = pair(INFLATION, UP, ambient=AMBIENT)
    if what == "trace":
        _, group, start = sealed_state(scenario)
        benchmark(whole_path, group, start)
    else:
        asked = [words for words in pieces_of(scenario) if words[0].has_pressure]
        benchmark(lambda: [proposals.by_ida(*words) for words in asked])
