"""Random devices played in lockstep and one by one: both ways must come out the same.

    python -m tests.fuzz.lockstep N --seed S

N scenarios are drawn from the grammar, each as a sweep of runs in which up to three numbers of the device
vary by a third. What lockstep does not cover is drawn and left out, and does not count.
"""

from __future__ import annotations

import itertools
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from simulator.scenario import ScenarioError, load_scenario
from simulator.sweep import read_sweep
from simulator.sweep.lockstep import chunk
from simulator.sweep.lockstep.programme import NotCovered
from simulator.sweep.lockstep.stacking import Stack, known, stacks, subject
from simulator.sweep.plan import Sweep
from simulator.sweep.rows import columns, play
from tests.fuzz import command, devices
from tests.fuzz.chances import Rng, chance
from tests.fuzz.courses import Course
from tests.fuzz.keeping import keep
from tests.fuzz.verbs import numbers

Document = dict[str, Any]

RUNS = 40
SLICE = 3  # scenarios in the test-suite
_SPREAD = 1.3


@dataclass
class Outcome:
    """What became of the runs of one scenario, and where the two ways differ."""

    document: Document
    counts: Counter[str] = field(default_factory=Counter)
    problems: list[str] = field(default_factory=list)


def scenario(rng: Rng, folder: Path) -> Document:
    """A random scenario of the grammar, at rest and without units."""
    wild = chance(rng, 0.2)
    gas = devices.gas(rng, wild)
    balloons = devices.balloons(rng, wild, folder)
    steps = Course(rng, balloons, gas, 1.0, False, folder).steps()
    return {"title": "drawn", "gas": gas, "balloon": balloons, "step": steps, "output": {"points": 5}}


def sweep(rng: Rng, folder: Path) -> Sweep | None:
    """A random sweep; None where lockstep does not cover it."""
    document = scenario(rng, folder)
    keys = numbers(document)
    chosen = rng.permutation(list(keys))[: int(rng.integers(1, 4))].tolist()
    vary = {key: {"from": keys[key] / _SPREAD, "to": keys[key] * _SPREAD} for key in chosen}
    if not vary:
        return None
    sample = {"method": "random", "size": RUNS, "seed": int(rng.integers(1 << 30))}
    try:
        load_scenario(document)
        found = read_sweep({"scenario": document, "vary": vary, "sample": sample})
        device, _ = subject(found.job, found.values(0, 1)[0])
        whole = all(isinstance(one, Stack) for one in stacks(found.job, found.values(0, RUNS)))
    except (ScenarioError, NotCovered):
        return None
    return found if whole and known(device) else None


def numbered(number: int, folder: Path) -> Outcome:
    """The runs of the first covered sweep of a number, both ways."""
    drawn = (sweep(np.random.default_rng([number, again, 14]), folder) for again in itertools.count())
    one = next(found for found in drawn if found is not None)
    out = Outcome(dict(one.definition))
    names, values = list(columns(one.job)), one.values(0, RUNS)
    for k, row in enumerate(chunk.rows(one.job, 0, values, (), names, lambda *_: {})):
        together = dict(zip(names, row, strict=True))
        if together["way"] != chunk.LOCKSTEP:
            out.counts["handed back"] += 1
            continue
        alone = play(one.job, k, values[k])
        if alone["outcome"] == "failed":
            out.counts["failed alone"] += 1
            continue
        out.counts["compared"] += 1
        out.counts[str(together["behaviour"])] += 1
        try:
            chunk.compare(k + 1, together, alone)
        except chunk.DisagreementError as error:
            out.problems.append(f"{error}; behaviour alone {alone['behaviour']}; values {values[k]}")
    return out


def fixed_slice(folder: Path) -> Iterator[Outcome]:
    """The sweeps that the test-suite plays."""
    return command.play(partial(numbered, folder=folder), range(SLICE), 1)


def main() -> int:
    parser = command.parser("tests.fuzz.lockstep", __doc__.split("\n")[0], 100, parallel=True)
    options = parser.parse_args()
    totals: Counter[str] = Counter()
    wrong = 0
    with TemporaryDirectory() as folder:
        wanted = command.numbers(options)
        played = command.play(partial(numbered, folder=Path(folder)), wanted, options.jobs)
        for number, out in zip(wanted, command.with_progress(played, options.count), strict=True):
            totals += out.counts
            wrong += len(out.problems)
            if out.problems:
                print(f"{number}: {len(out.problems)} runs, {out.problems[0]}", file=sys.stderr, flush=True)
                keep(out.document, options.keep / f"lockstep-{number}.json", problems=out.problems)
    print("  ".join(f"{what} {count}" for what, count in totals.most_common()))
    print(f"disagreements {wrong}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
