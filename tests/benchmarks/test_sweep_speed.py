"""What the sweep layer costs and how it scales, in one session: `make bench`.

The unit is one full history of Fig. 3c, state B: inflated, snapped up and snapped back. Compare within one
session only, medians with medians; two workers need two idle cores to be worth two.
"""

from __future__ import annotations

import os
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import active_children, get_context
from pathlib import Path

import numpy as np
import pytest

from simulator import load_scenario, simulate
from simulator.scenario.mapping import with_values
from simulator.sweep import read_sweep, run_sweep
from tests.pairs import pair
from tests.sweeps import Here

HISTORIES = int(os.environ.get("BALLOONS_HISTORIES", "200"))
RUNS = int(os.environ.get("BALLOONS_RUNS", "10000"))

BASE = load_scenario("scenarios/fig3c_state_b.toml").to_dict()
KEY = "gas.ambient_pressure"
# All alike in cost: every one of them snaps up and back.
SWEEP = read_sweep({"scenario": BASE, "vary": {KEY: np.linspace(0.012, 0.016, HISTORIES).tolist()}})


def loop():
    for (value,) in SWEEP.values(0, SWEEP.size):
        simulate(load_scenario(with_values(BASE, {KEY: value})))


def warm(count, folder):
    """Workers that have loaded everything, as they have after the first second of a long sweep."""
    executor = ProcessPoolExecutor(count, mp_context=get_context("spawn"))
    run_sweep(SWEEP, folder / "warm", executor=executor, workers=count)
    return executor


@pytest.mark.benchmark(group=f"{HISTORIES} histories of 3c B: the sweep beside a loop, in one process")
@pytest.mark.parametrize("what", ["loop", "sweep"])
def test_overhead(benchmark, what, tmp_path):
    numbers = iter(range(100))
    play = {"loop": loop, "sweep": lambda: run_sweep(SWEEP, tmp_path / f"{next(numbers)}", executor=Here())}
    benchmark.pedantic(play[what], rounds=5, warmup_rounds=1)


@pytest.mark.benchmark(group=f"{HISTORIES} histories of 3c B: workers that are up")
@pytest.mark.parametrize("workers", [1, 2])
def test_scaling(benchmark, workers, tmp_path):
    numbers = iter(range(100))
    with warm(workers, tmp_path) as executor:
        benchmark.pedantic(
            lambda: run_sweep(SWEEP, tmp_path / f"{next(numbers)}", executor=executor, workers=workers),
            rounds=5,
        )


@pytest.mark.benchmark(group=f"{HISTORIES} histories of 3c B: with the start of the workers")
@pytest.mark.parametrize("workers", [1, 2])
def test_from_scratch(benchmark, workers, tmp_path):
    numbers = iter(range(100))
    benchmark.pedantic(lambda: run_sweep(SWEEP, tmp_path / f"{next(numbers)}", workers=workers), rounds=3)


def test_reach(tmp_path):
    """Loop, sweep, one worker and two in turn, so that whatever else the machine does meets all alike."""
    numbers = iter(range(1000))

    def seconds(**how):
        started = time.perf_counter()
        run_sweep(SWEEP, tmp_path / f"{next(numbers)}", **how) if how else loop()
        return time.perf_counter() - started

    with warm(1, tmp_path / "a") as one, warm(2, tmp_path / "b") as two:
        loop()
        rounds = np.array(
            [
                [
                    seconds(),
                    seconds(executor=Here()),
                    seconds(executor=one, workers=1),
                    seconds(executor=two, workers=2),
                ]
                for _ in range(5)
            ]
        )
    alone, here, single, double = rounds.T
    print(f"\noverhead {np.median(here / alone) - 1:.1%}; ", end="")
    print(
        f"two workers over one {np.median(single / double):.2f}, by round {np.round(single / double, 2)}; ",
        end="",
    )
    print(f"histories a second {HISTORIES / np.median(double):.0f}, at best {HISTORIES / double.min():.0f}")


def test_cpu_time(tmp_path):
    """CPU seconds of parent and workers: what a busy machine can still tell of cost and scaling."""
    resource = pytest.importorskip("resource")
    numbers = iter(range(100))
    two = read_sweep({"scenario": BASE, "vary": {KEY: [0.015, 0.0151]}})

    def spent(work):
        """Of this process, and of processes it started and saw end."""
        who = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
        before = [resource.getrusage(one) for one in who]
        work()
        after = [resource.getrusage(one) for one in who]
        return [b.ru_utime + b.ru_stime - a.ru_utime - a.ru_stime for a, b in zip(before, after, strict=True)]

    def sweep(what=SWEEP, **how):
        run_sweep(what, tmp_path / f"{next(numbers)}", **how)

    loop()
    rounds = []
    for _ in range(3):
        alone, here, spread, start = (
            spent(work)
            for work in (
                loop,
                lambda: sweep(executor=Here(), chunk=10),
                lambda: sweep(workers=2, chunk=10),
                lambda: sweep(two, workers=2),
            )
        )
        rounds.append([alone[0], here[0], spread[0], spread[1] - start[1], start[1]])
    alone, here, parent, workers, start = np.median(rounds, axis=0)
    per = 1e3 / HISTORIES
    print(
        f"\nCPU time of a history: {alone * per:.2f} ms in a loop, {here * per:.2f} ms in a sweep, ", end=""
    )
    print(
        f"{(parent + workers) * per:.2f} ms on two workers, of which {parent * per:.2f} ms are the parent's;"
    )
    print(
        f"overhead {here / alone - 1:.1%}, worth of two cores {2 * here / (parent + workers):.2f}; ", end=""
    )
    print(f"starting two workers {start:.2f} s")


def test_memory_of_a_sweep_is_flat(tmp_path):
    """Resident memory of parent and workers over many cheap runs; not a timing, so it asserts."""
    if not Path("/proc/self/statm").exists():
        pytest.skip("needs /proc")
    cheap = pair(0.1, ambient=0.5, output={"points": 2}).to_dict()
    definition = {"scenario": cheap, "sample": {"method": "random", "size": RUNS}}
    sweep = read_sweep({**definition, "vary": {"step.1.inflate": {"from": 0.01, "to": 0.5}}})
    seen: list[tuple[int, float, float]] = []

    def look(done: int, total: int) -> None:
        workers = [_resident(process.pid) for process in active_children()]
        seen.append((done, _resident("self"), max(workers, default=0.0)))

    run_sweep(sweep, tmp_path, workers=2, progress=look)
    table = np.array([row for row in seen if row[0] >= RUNS // 10])
    for done, parent, worker in table[:: max(1, len(table) // 10)]:
        print(f"{done:9.0f} runs: parent {parent:6.1f} MB, largest worker {worker:6.1f} MB")
    assert np.ptp(table[:, 1]) < 8.0
    assert np.ptp(table[:, 2]) < 8.0


def _resident(process: int | str | None) -> float:
    """Resident memory in MB, 0 where there is no such process."""
    try:
        pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    except OSError:
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6
