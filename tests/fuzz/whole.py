"""Many scenarios of the whole grammar: progress, counts, worst differences, and what disagreed as files.

python -m tests.fuzz.whole N --seed S
"""

from __future__ import annotations

import contextlib
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
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
KINDS = ("agreed", "undecided", "solver_error", *WRONG)

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


@dataclass
class _Counts:
    """What has been found so far."""

    start: float = field(default_factory=time.perf_counter)
    totals: Counter[str] = field(default_factory=Counter)
    kinds: Counter[str] = field(default_factory=Counter)
    outcomes: Counter[str] = field(default_factory=Counter)
    seconds: Counter[str] = field(default_factory=Counter)
    worst: dict[str, tuple[float, int]] = field(default_factory=dict)

    def add(self, number: int, verdict: Verdict) -> None:
        self.kinds[verdict.kind] += 1
        self.outcomes[verdict.outcome] += 1
        self.totals.update(
            scenarios=1, compared=verdict.compared, events=verdict.events, samples=verdict.samples
        )
        self.seconds.update(verdict.seconds)
        if verdict.kind not in WRONG:
            for what, error in verdict.worst.items():
                self.worst[what] = max(self.worst.get(what, (-1.0, 0)), (error, number))

    def report(self) -> dict[str, Any]:
        return {
            **self.totals,
            **{kind: self.kinds[kind] for kind in KINDS},
            "worst": {what: error for what, (error, _) in sorted(self.worst.items())},
            "seconds": round(time.perf_counter() - self.start, 1),
        }


def main() -> int:
    parser = command.parser("tests.fuzz.whole", "Random scenarios of the whole grammar.", 200, parallel=True)
    options = parser.parse_args()
    counts = _Counts()
    with TemporaryDirectory() as folder, contextlib.suppress(KeyboardInterrupt):
        one = partial(numbered, folder=Path(folder))
        played = command.play(one, command.numbers(options), options.jobs)
        for number, document, verdict in command.with_progress(played, options.count):
            counts.add(number, verdict)
            if verdict.kind in WRONG or verdict.kind == "solver_error":
                file = options.keep / f"{verdict.kind}-{number}.json"
                keep(document, file, kind=verdict.kind, problems=verdict.problems, message=verdict.message)
                told = "; ".join(verdict.problems[:3] or [verdict.message])
                print(f"{file}: {told}", file=sys.stderr, flush=True)
            if options.report:
                command.write_report(options.report, options.seed, counts.report())
    command.print_counts(
        totals=counts.totals, verdicts=counts.kinds, outcomes=counts.outcomes, seconds=counts.seconds
    )
    command.print_worst(counts.worst)
    return 1 if any(counts.kinds[kind] for kind in WRONG) else 0


if __name__ == "__main__":
    sys.exit(main())
