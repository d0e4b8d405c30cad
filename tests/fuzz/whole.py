"""Many scenarios of the whole grammar: progress, counts, worst differences, and what disagreed as files.

python -m tests.fuzz.whole N --seed S
"""

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
from tempfile import TemporaryDirectory
from typing import Any

from tests.fuzz import grammar
from tests.fuzz.agreement import Verdict, examine
from tests.fuzz.keeping import keep
from tests.fuzz.running import Runner

Played = tuple[int, dict[str, Any], Verdict]

REFERENCE_LIMIT = 90.0
SLICE = 40  # scenarios in the test-suite: about 30 s
WRONG = ("disagreement", "crash", "hang")

_RUNNERS: list[Runner] = []


def numbered(number: int, folder: Path) -> Played:
    """The scenario of a number, examined; the processes that play are kept for the next one."""
    if not _RUNNERS:
        _RUNNERS.extend([Runner(), Runner(REFERENCE_LIMIT)])
    document = grammar.numbered(number, folder)
    return number, document, examine(document, *_RUNNERS)


def play(numbers: range, folder: Path, jobs: int) -> Iterator[Played]:
    """Examine many scenarios, in order."""
    if jobs == 1:
        for number in numbers:
            yield numbered(number, folder)
        return
    with ProcessPoolExecutor(jobs) as pool:
        yield from pool.map(numbered, numbers, [folder] * len(numbers), chunksize=4)


def with_progress(played: Iterator[Played], total: int) -> Iterator[Played]:
    """The same, telling on standard error how far it is: all along in a terminal, else at every tenth."""
    start = time.perf_counter()
    for count, item in enumerate(played, start=1):
        yield item
        if sys.stderr.isatty() or count * 10 // total > (count - 1) * 10 // total:
            left = (time.perf_counter() - start) * (total - count) / count
            end = "\r" if sys.stderr.isatty() and count < total else "\n"
            print(f"{count} of {total}, {left:.0f} s to go   ", end=end, file=sys.stderr, flush=True)


def fixed_slice(folder: Path) -> Iterator[Played]:
    """The scenarios that the test-suite plays."""
    return play(range(SLICE), folder, 1)


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m tests.fuzz.whole", description="Random scenarios of the whole grammar."
    )
    parser.add_argument("count", type=int, nargs="?", default=200)
    parser.add_argument("--seed", type=int, default=0, help="scenarios are number seed·10⁶ + 0 … N − 1")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes; all cores")
    parser.add_argument("--keep", type=Path, default=Path("results/fuzz"), help="folder for what disagrees")
    parser.add_argument("--report", type=Path, help="JSON file for the counts and the worst differences")
    options = parser.parse_args()
    first = options.seed * 1_000_000
    start = time.perf_counter()
    kinds: Counter[str] = Counter()
    outcomes: Counter[str] = Counter()
    totals: Counter[str] = Counter(scenarios=0, compared=0, events=0, samples=0)
    seconds: Counter[str] = Counter()
    worst: dict[str, tuple[float, int]] = {}
    with TemporaryDirectory() as folder, contextlib.suppress(KeyboardInterrupt):
        played = play(range(first, first + options.count), Path(folder), options.jobs)
        for number, document, verdict in with_progress(played, options.count):
            kinds[verdict.kind] += 1
            outcomes[verdict.outcome] += 1
            totals.update(
                scenarios=1, compared=verdict.compared, events=verdict.events, samples=verdict.samples
            )
            seconds.update(verdict.seconds)
            if verdict.kind not in WRONG:
                for what, error in verdict.worst.items():
                    worst[what] = max(worst.get(what, (-1.0, 0)), (error, number))
            if verdict.kind in WRONG or verdict.kind == "solver_error":
                file = options.keep / f"{verdict.kind}-{number}.json"
                keep(document, file, kind=verdict.kind, problems=verdict.problems, message=verdict.message)
                print(
                    f"{file}: " + "; ".join(verdict.problems[:3] or [verdict.message]),
                    file=sys.stderr,
                    flush=True,
                )
    print("  ".join(f"{name} {count}" for name, count in totals.items()))
    print("verdicts:  " + "  ".join(f"{kind} {count}" for kind, count in kinds.most_common()))
    print("outcomes:  " + "  ".join(f"{name} {count}" for name, count in outcomes.most_common()))
    print("seconds:  " + "  ".join(f"{name} {spent:.1f}" for name, spent in seconds.items()))
    for what, (error, number) in sorted(worst.items()):
        print(f"worst {what:15s} {error:.2e}   scenario {number}")
    if options.report:
        report = {
            "n": totals["scenarios"],
            "seed": options.seed,
            **{kind: kinds[kind] for kind in ("agreed", "undecided", "solver_error", *WRONG)},
            "worst": {what: error for what, (error, _) in sorted(worst.items())},
            "seconds": round(time.perf_counter() - start, 1),
        }
        options.report.write_text(json.dumps(report, indent=2) + "\n")
    return 1 if any(kinds[kind] for kind in WRONG) else 0


if __name__ == "__main__":
    sys.exit(main())
