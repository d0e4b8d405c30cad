"""Many scenarios, on all cores: progress, counts, worst errors, and what disagreed as files."""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import sys
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from tests.fuzz import Verdict, examine, numpy_dice, scenario

Played = tuple[int, dict[str, Any], Verdict]


def numbered(number: int) -> Played:
    """The scenario of a number, examined."""
    written = scenario(numpy_dice(number))
    try:
        return number, written, examine(written)
    except Exception as error:
        return number, written, Verdict(problems=[f"{type(error).__name__}: {error}"])


def play(numbers: range, jobs: int) -> Iterator[Played]:
    """Examine many scenarios, in order."""
    if jobs == 1:
        yield from map(numbered, numbers)
        return
    with ProcessPoolExecutor(jobs) as pool:
        yield from pool.map(numbered, numbers, chunksize=8)


def with_progress(played: Iterator[Played], total: int) -> Iterator[Played]:
    """The same, telling on standard error how far it is: all along in a terminal, else at every tenth."""
    start = time.perf_counter()
    for count, item in enumerate(played, start=1):
        yield item
        if sys.stderr.isatty() or count * 10 // total > (count - 1) * 10 // total:
            left = (time.perf_counter() - start) * (total - count) / count
            end = "\r" if sys.stderr.isatty() and count < total else "\n"
            print(f"{count} of {total}, {left:.0f} s to go   ", end=end, file=sys.stderr, flush=True)


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m tests.fuzz", description="Random sealed pairs against the closed form."
    )
    parser.add_argument("count", type=int, nargs="?", default=1000)
    parser.add_argument("--seed", type=int, default=0, help="scenarios are number seed·10⁶ + 0 … N − 1")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes; all cores")
    parser.add_argument("--keep", type=Path, default=Path("results/fuzz"), help="folder for what disagrees")
    parser.add_argument("--report", type=Path, help="JSON file for the counts and the worst errors")
    options = parser.parse_args()
    first = options.seed * 1_000_000
    start = time.perf_counter()
    outcomes: Counter[str] = Counter()
    totals: Counter[str] = Counter(scenarios=0, events=0, samples=0, undecided=0, disagreements=0)
    seconds: Counter[str] = Counter()
    worst: dict[str, tuple[float, int]] = {}
    played = play(range(first, first + options.count), options.jobs)
    # What was played until Ctrl-C is reported all the same.
    with contextlib.suppress(KeyboardInterrupt):
        for number, written, verdict in with_progress(played, options.count):
            outcomes[verdict.outcome] += 1
            totals.update(scenarios=1, events=verdict.events, samples=verdict.samples)
            totals["undecided"] += int(verdict.undecided and not verdict.problems)
            totals["disagreements"] += int(bool(verdict.problems))
            seconds.update(verdict.seconds)
            for what, error in verdict.worst.items():
                if error >= worst.get(what, (-1.0, 0))[0]:
                    worst[what] = (error, number)
            if verdict.problems:
                options.keep.mkdir(parents=True, exist_ok=True)
                kept = options.keep / f"{number}.json"
                kept.write_text(json.dumps({"problems": verdict.problems, "scenario": written}, indent=1))
                print(f"{kept}: " + "; ".join(verdict.problems[:3]), file=sys.stderr, flush=True)
    print("  ".join(f"{name} {count}" for name, count in totals.items()))
    print("outcomes:  " + "  ".join(f"{name} {count}" for name, count in outcomes.most_common()))
    print("seconds:  " + "  ".join(f"{name} {spent:.1f}" for name, spent in seconds.items()))
    for what, (error, number) in sorted(worst.items()):
        print(f"worst {what:15s} {error:.2e}   scenario {number}")
    if options.report:
        report = {
            "n": totals["scenarios"],
            "seed": options.seed,
            "agreed": totals["scenarios"] - totals["undecided"] - totals["disagreements"],
            "undecided": totals["undecided"],
            "disagreements": totals["disagreements"],
            "worst": {what: error for what, (error, _) in sorted(worst.items())},
            "seconds": round(time.perf_counter() - start, 1),
        }
        options.report.write_text(json.dumps(report, indent=2) + "\n")
    return 1 if totals["disagreements"] else 0


if __name__ == "__main__":
    sys.exit(main())
