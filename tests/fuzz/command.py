"""What the commands of the fuzz share: options, processes, how far they are, and the counts at the end."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import TypeVar

Played = TypeVar("Played")


def parser(module: str, description: str, count: int, *, parallel: bool = False) -> argparse.ArgumentParser:
    """The options of every command: how many scenarios, which, and where to keep what is wrong."""
    found = argparse.ArgumentParser(prog=f"python -m {module}", description=description)
    found.add_argument("count", type=int, nargs="?", default=count)
    found.add_argument("--seed", type=int, default=0, help="scenarios are number seed·10⁶ + 0 … N − 1")
    found.add_argument("--report", type=Path, help="JSON file for the counts")
    found.add_argument("--keep", type=Path, default=Path("results/fuzz"), help="folder for what is wrong")
    if parallel:
        found.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes; all cores")
    return found


def numbers(options: argparse.Namespace) -> range:
    """The numbers of the scenarios asked for."""
    first = options.seed * 1_000_000
    return range(first, first + options.count)


def play(one: Callable[[int], Played], wanted: range, jobs: int) -> Iterator[Played]:
    """Examine many scenarios, in order."""
    if jobs == 1:
        yield from map(one, wanted)
        return
    with ProcessPoolExecutor(jobs) as pool:
        yield from pool.map(one, wanted, chunksize=4)


def with_progress(played: Iterator[Played], total: int) -> Iterator[Played]:
    """The same, telling on standard error how far it is: all along in a terminal, else at every tenth."""
    start = time.perf_counter()
    for count, item in enumerate(played, start=1):
        yield item
        if sys.stderr.isatty() or count * 10 // total > (count - 1) * 10 // total:
            left = (time.perf_counter() - start) * (total - count) / count
            end = "\r" if sys.stderr.isatty() and count < total else "\n"
            print(f"{count} of {total}, {left:.0f} s to go   ", end=end, file=sys.stderr, flush=True)


def write_report(file: Path, seed: int, counts: Mapping[str, object]) -> None:
    """Write what was found with a seed into a JSON file, beside what was found with others."""
    known = json.loads(file.read_text()) if file.exists() else {}
    known[str(seed)] = counts
    file.write_text(json.dumps(known, indent=2, sort_keys=True) + "\n")


def print_counts(**counts: Counter[str]) -> None:
    """One line for each; the first without its name."""
    for place, (name, counter) in enumerate(counts.items()):
        form = ".1f" if name == "seconds" else "d"
        line = "  ".join(f"{kind} {count:{form}}" for kind, count in counter.items())
        print(line if place == 0 else f"{name}:  {line}")


def print_worst(worst: Mapping[str, tuple[float, int]]) -> None:
    """The largest differences, and in which scenario they are."""
    for what, (error, number) in sorted(worst.items()):
        print(f"worst {what:15s} {error:.2e}   scenario {number}")
