"""Pairs of scenarios that must have the same history: the simulator is compared with itself alone.

    python -m tests.fuzz.metamorphic N --seed S [--twins 3]

What a twin is written like differs, what happens does not: balloons in another order, voltages of the other
sign, other units, a cycle written out, a ramp in two halves or as a table, a chamber of no volume, a
strength that is never reached, another tolerance, other samples.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from simulator import History, load_scenario
from tests.fuzz import command, grammar
from tests.fuzz.keeping import keep
from tests.fuzz.running import Runner
from tests.fuzz.twins import TWINS, Twin
from tests.pairs import run

Document = dict[str, Any]
Rng = np.random.Generator
Judged = tuple[str, Document]

EVENT = 1e-8  # relative to the film's unit voltage, or to the largest pressure
STATE = 1e-6
LOST_STATE = 1e-5  # where a flow ends on its way to a rest
REAL_TIME = 1e-6  # IDA follows a flow to 1e-9 a step


def difference(one: History, other: History, twin: Twin) -> str | None:
    """What differs between two histories that must be the same; None where nothing does."""
    kinds = [e.kind.value for e in one.events], [e.kind.value for e in other.events]
    if one.outcome != other.outcome:
        return f"outcome {one.outcome.value}, then {other.outcome.value}; events {kinds[0]}, then {kinds[1]}"
    if kinds[0] != kinds[1]:
        return f"events {kinds[0]}, then {kinds[1]}"
    order = [other.balloons.index(name) for name in one.balloons]
    films = [other.electroded.index(name) for name in one.electroded]
    real = one.scenario.dynamics is not None
    unit = max([1.0, *(float(np.max(np.abs(one.voltage))) if one.voltage.size else 0.0,)])
    lasts = float(one.time[-1]) or 1.0
    checks: list[tuple[str, Any, Any, float]] = []
    for number, (a, b) in enumerate(zip(one.events, other.events, strict=True)):
        lost = number > 0 and a.stretch_after is None and one.events[number - 1].time == a.time
        leaves = number + 1 < len(one.events) and one.events[number + 1].time == a.time
        where = f"event {number} ({a.kind.value})"
        if twin.numbered and a.step != b.step:
            return f"{where}: step {a.step}, then {b.step}"
        checks += [
            (f"{where}: time", a.time / lasts, b.time / twin.pace / lasts, REAL_TIME if real else STATE),
            (f"{where}: voltage", a.voltage / unit, twin.sign * b.voltage[films] / unit, EVENT),
            (f"{where}: before", a.stretch_before, b.stretch_before[order], LOST_STATE if lost else STATE),
        ]
        if a.stretch_after is not None and b.stretch_after is not None:
            allowed = LOST_STATE if leaves else STATE
            checks.append((f"{where}: after", a.stretch_after, b.stretch_after[order], allowed))
    checks += [
        ("end: time", one.time[-1] / lasts, other.time[-1] / twin.pace / lasts, REAL_TIME if real else STATE),
        ("end: stretch", one.stretch[-1], other.stretch[-1][order], LOST_STATE),
        ("end: pressure", one.pressure[-1], other.pressure[-1], LOST_STATE),
    ]
    counts = one.time.size, other.time.size
    if twin.sampled and counts[0] == counts[1]:
        checks.append(("samples: stretch", one.stretch, other.stretch[:, order], LOST_STATE))
    for what, a, b, allowed in checks:
        size = np.maximum(1.0, np.abs(a))
        apart = float(np.max(np.abs(np.subtract(a, b)) / size, initial=0.0))
        if not apart <= (max(allowed, REAL_TIME) if real else allowed):
            return f"{what} differs by {apart:.2g}"
    if twin.sampled and counts[0] != counts[1]:
        return f"{counts[0]} samples, then {counts[1]}"
    return None


def history_of(document: Document) -> History:
    return run(load_scenario(document))


def examine(
    document: Document, rng: Rng, folder: Path, runner: Runner, kinds: Iterable[str] = tuple(TWINS)
) -> dict[str, Judged]:
    """What is wrong with the twins of a scenario, by kind, "" where nothing is; none where it has no twin."""
    first = runner.call(history_of, document)
    if first.end != "returned":
        return {}  # how runs end is the affair of `tests.fuzz.whole`
    found: dict[str, Judged] = {}
    for kind in kinds:
        if (twin := TWINS[kind](document, rng, folder)) is None:
            continue
        second = runner.call(history_of, twin.document)
        if second.end != "returned":
            found[kind] = f"{second.end}: {second.error}", twin.document
        else:
            found[kind] = difference(first.value, second.value, twin) or "", twin.document
    return found


def in_turn(number: int, count: int) -> list[str]:
    """So many of the kinds, and others for the next number."""
    kinds = list(TWINS)
    return [kinds[(number * count + place) % len(kinds)] for place in range(min(count, len(kinds)))]


def main() -> int:
    parser = command.parser("tests.fuzz.metamorphic", __doc__.split("\n")[0], 100)
    parser.add_argument("--twins", type=int, default=len(TWINS), help="of each scenario, in turn; all")
    options = parser.parse_args()
    played: Counter[str] = Counter()
    wrong: Counter[str] = Counter()
    with TemporaryDirectory() as folder, Runner() as runner:
        for count, number in enumerate(command.numbers(options), start=1):
            document = grammar.numbered(number, Path(folder))
            rng = np.random.default_rng([number, 7])
            found = examine(document, rng, Path(folder), runner, in_turn(number, options.twins))
            for kind, (problem, twin) in found.items():
                motion = "in real time" if "dynamics" in document else "quasi-static"
                played[f"{kind}, {motion}"] += 1
                if problem:
                    wrong[kind] += 1
                    print(f"{number} {kind}: {problem}", flush=True)
                    keep(document, options.keep / f"{number}-{kind}.json", problem=problem, twin=twin)
            if options.report:
                report = {"scenarios": count, "pairs": played, "wrong": wrong}
                command.write_report(options.report, options.seed, report)
    print(f"scenarios {options.count}  pairs {played.total()}  " + "  ".join(map(str, wrong.most_common())))
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
