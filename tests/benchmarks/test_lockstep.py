"""Histories a second in lockstep: `python -m pytest tests/benchmarks/test_lockstep.py --benchmark-only -s`.

The unit is a history of the paper's map: inflated, driven 0.1 % past its limit point and back. Medians, in
one process, of CPU time: what other work on the machine does least to.
"""

from __future__ import annotations

import math
import time

import numpy as np
import pytest

from simulator.sweep import read_sweep
from simulator.sweep.lockstep import chunk
from simulator.sweep.lockstep.play import play as play_stack
from simulator.sweep.lockstep.stacking import Stack, stacks
from simulator.sweep.lockstep.table import certain
from simulator.sweep.rows import columns, play

MAP = read_sweep("scenarios/sweeps/paper_map.toml")
GENT = {"model": "gent", "J_lim": 100}


def drawn(count):
    """Values of runs of the map, drawn."""
    runs = np.random.default_rng(count).choice(MAP.size, count, replace=False)
    return [MAP.values(k, k + 1)[0] for k in runs.tolist()]


def played(values):
    """Rows of a chunk as a sweep has them played, without an audit; runs given up are not played again."""
    return chunk.rows(MAP.job, 0, values, (), list(columns(MAP.job)), lambda *_: {})


def a_second(size, benchmark):
    """Histories a second; NaN where nothing is measured (--benchmark-disable)."""
    return size / benchmark.stats["median"] if benchmark.stats else math.nan


@pytest.mark.benchmark(timer=time.process_time, group="histories of the paper's map, by the size of a chunk")
@pytest.mark.parametrize("size", [50, 200, 1000, 5000, 20_000])
def test_chunks(benchmark, size):
    values = drawn(size)
    benchmark.pedantic(played, args=(values,), rounds=3, warmup_rounds=1)
    print(f"\n{size} runs: {a_second(size, benchmark):.0f} histories a second")


@pytest.mark.benchmark(timer=time.process_time, group="1000 histories, by the number of balloons")
@pytest.mark.parametrize("count", [1, 2, 3, 4, 6, 8, 12])
def test_balloons(benchmark, count):
    balloons = [
        {"name": f"b{i}", "elastomer": GENT, "radius": 1.0 - 0.03 * i, "electrodes": i == 0}
        for i in range(count)
    ]
    sweep = read_sweep(
        {
            "scenario": {
                "title": f"{count} balloons",
                "gas": {"ambient_pressure": 0.3},
                "balloon": balloons,
                "step": [{"inflate": 1.0}, {"ramp": 0.75}, {"ramp": 0.0}],
            },
            "vary": {
                "gas.ambient_pressure": {"from": 0.02, "to": 2.0},
                "step.1.inflate": {"from": 0.4, "to": 1.2},
            },
            "sample": {"method": "random", "size": 1000, "seed": 1},
        }
    )
    values = sweep.values(0, sweep.size)
    given_up = 0

    def both():
        nonlocal given_up
        for stack in stacks(sweep.job, values):
            assert isinstance(stack, Stack)
            given_up = int((~certain(play_stack(stack.device, stack.moves, stack.runs.size, None))).sum())

    benchmark.pedantic(both, rounds=3, warmup_rounds=1)
    print(f"\n{count} balloons: {a_second(1000, benchmark):.0f} histories a second, {given_up} given up")


@pytest.mark.benchmark(timer=time.process_time)
def test_against_a_loop(benchmark):
    """At least eighty times a loop over `simulate`, on one core."""
    values = drawn(5000)
    played(values[:200])
    began = time.process_time()
    for k, point in enumerate(values[:100]):
        play(MAP.job, k, point)
    alone = (time.process_time() - began) / 100
    benchmark.pedantic(played, args=(values,), rounds=3)
    began = time.process_time()
    played(values)
    together = (time.process_time() - began) / len(values)
    print(
        f"\nby itself {1e3 * alone:.1f} ms, in lockstep {1e6 * together:.0f} us: {alone / together:.0f} times"
    )
