"""Many scenarios of the whole grammar: progress, counts, worst differences, and what disagreed as files.

python -m tests.fuzz.whole N --seed S
"""

from __future__ import annotations

import contextlib
import json
import sys
import time
from collections import Counter
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from tests.fuzz import command, grammar
from tests.fuzz.agreement import Verdict, examine
from tests.fuzz.keeping import keep
from tests.fuzz.running import Runner

Played = tuple[int, dict[str, Any], Verdict]

REFERENCE_LIMIT = 90.0
SLICE = 24  # scenarios in the test-suite: about 30 s
WRONG = ("disagreement", "crash", "hang")

_RUNNERS: list[Runner] = []


def numbered(number: int, folder: Path) -> Played:
    """The scenario of a number, examined; the processes that play are kept for the next one."""
    if not _RUNNERS:
        _RUNNERS.extend([Runner(), Runner(REFERENCE_LIMIT)])
    document = grammar.numbered(number, folder)
    return number, document, examine(document, *_RUNNERS, landings=number % 10 == 0)


def fixed_slice(folder: Path) -> Iterator[Played]:
    """The scenarios that the test-suite plays."""
    return command.play(partial(numbered, folder=folder), range(SLICE), 1)


def main() -> int:
    parser = command.parser("tests.fuzz.whole", "Random scenarios of the whole grammar.", 200, parallel=True)
    parser.add_argument("--report", type=Path, help="JSON file for the counts and the worst differences")
    options = parser.parse_args()
    start = time.perf_counter()
    kinds: Counter[str] = Counter()
    outcomes: Counter[str] = Counter()
    totals: Counter[str] = Counter(scenarios=0, compared=0, events=0, samples=0)
    seconds: Counter[str] = Counter()
    worst: dict[str, tuple[float, int]] = {}
    with TemporaryDirectory() as folder, contextlib.suppress(KeyboardInterrupt):
        one = partial(numbered, folder=Path(folder))
        played = command.play(one, command.numbers(options), options.jobs)
        for number, document, verdict in command.with_progress(played, options.count):
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
    command.print_counts(totals=totals, verdicts=kinds, outcomes=outcomes, seconds=seconds)
    command.print_worst(worst)
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
