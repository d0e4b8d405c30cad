"""Many scenarios, on all cores: progress, counts, worst errors, and what disagreed as files."""

from __future__ import annotations

import contextlib
import json
import sys
import time
from collections import Counter
from typing import Any

from tests.fuzz import Verdict, command, examine, numpy_dice, scenario

Played = tuple[int, dict[str, Any], Verdict]


def numbered(number: int) -> Played:
    """The scenario of a number, examined."""
    written = scenario(numpy_dice(number))
    try:
        return number, written, examine(written)
    except Exception as error:
        return number, written, Verdict(problems=[f"{type(error).__name__}: {error}"])


def main() -> int:
    parser = command.parser("tests.fuzz", "Random sealed pairs against the closed form.", 1000, parallel=True)
    options = parser.parse_args()
    start = time.perf_counter()
    outcomes: Counter[str] = Counter()
    totals: Counter[str] = Counter(scenarios=0, events=0, samples=0, undecided=0, disagreements=0)
    seconds: Counter[str] = Counter()
    worst: dict[str, tuple[float, int]] = {}
    played = command.play(numbered, command.numbers(options), options.jobs)
    # What was played until Ctrl-C is reported all the same.
    with contextlib.suppress(KeyboardInterrupt):
        for number, written, verdict in command.with_progress(played, options.count):
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
    command.print_counts(totals=totals, outcomes=outcomes, seconds=seconds)
    command.print_worst(worst)
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
