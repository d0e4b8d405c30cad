"""`docs/stability.md`: what stiff and extreme scenarios come to, computed when it is written."""

from __future__ import annotations

import math
import os
import platform
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from simulator.scenario import Problem, Scenario, ScenarioError, load_scenario
from tests.studies.stress import groups
from tests.studies.stress.case import Row, examine
from tests.studies.stress.cost import shares
from tests.studies.stress.fuzz import fuzz_sections
from tests.studies.stress.sabotage import Tally, disturbances, random_pairs, tallies


@dataclass(frozen=True)
class Effort:
    """How much of the page is computed.

    Attributes
    ----------
    repetitions : int
        Of every case; times are medians.
    rows, cycles : int
        Rows of the noisy table, and cycles of the sine.
    pairs : int
        Random pairs that are disturbed, beside the paper's scenarios.
    """

    repetitions: int = 3
    rows: int = 100_000
    cycles: int = 1000
    pairs: int = 200


FULL = Effort()

_HEAD = """\
# Stability: stiff and extreme scenarios

This page is written by `make stress`; every row is computed as it is written, and is a test in
`tests/test_stress.py` (there with shorter waveforms and fewer random pairs).

"""

_CASES = """\
## Extreme scenarios

*Error* is the largest deviation of any sample, event or landing, relative where the quantity is above 1;
beside a limit point, where a last digit of the voltage moves the state by 1e-8, it is the distance to the
states of all voltages within 1e-13. A case *holds* if its outcome is the one that physics has and its error
is below the bound. Times are of `simulate` alone.

What a case is held against: the *closed form* is `tests.oracle.closed_form`, all equilibria of a pair to rounding,
and its snaps by an independent flow of SciPy's at 1e-10. *Balance* is force balance, gas law and energy
books, and that a snap which comes to rest does so where SciPy's Radau flow of that device rests; where one
loses tension on its way is not compared. *Reversed* is the same device with its balloons written in reverse
order.

"""

_SABOTAGE = """\
## Never silently wrong

The paper's scenarios and {count} random pairs, run as they are and then disturbed: with loose tolerances,
and with parts of the solver made to return something else, about every other time they are called. A
disturbed run must come out with the same events and numbers (*repaired*), or stop with a `SolverError`
(*raised*). A number that differs by more than 1e-6 is *silently wrong*. Runs that a disturbance could not
strike are not counted.

"""

_COST = """\
## What the checks cost

Share of the run time of the paper's scenarios spent in the checks, medians of five runs of all of them.
That of the landings includes Newton's method, which finds them.

"""


def stability_page(scenarios: Path, fuzz: Path, effort: Effort = FULL) -> str:
    """The page, from the paper's scenario files.

    Parameters
    ----------
    scenarios : Path
        Folder of the paper's scenario files.
    fuzz : Path
        Result file of the fuzz of pairs; need not exist, as those of the others beside it.
    effort : Effort
        How much is computed.

    Raises
    ------
    ScenarioError
        If one is invalid, or there is none.
    """
    shipped = shipped_scenarios(scenarios)
    rows = {
        subject: [examine(case, effort.repetitions) for case in cases]
        for subject, cases in groups(effort.rows, effort.cycles).items()
    }
    written = [scenario.to_dict() for scenario in shipped] + random_pairs(effort.pairs)
    disturbed = tallies(written, disturbances())
    return "".join(
        [
            _HEAD,
            _machine(effort),
            _CASES,
            _count([row for part in rows.values() for row in part]),
            *(f"### {subject}\n\n{_table(part)}\n" for subject, part in rows.items()),
            _failures([row for part in rows.values() for row in part]),
            _SABOTAGE.format(count=effort.pairs),
            _disturbed(disturbed),
            _COST,
            _shares(shares(shipped)),
            fuzz_sections(fuzz),
        ]
    )


def shipped_scenarios(scenarios: Path) -> list[Scenario]:
    """The paper's scenarios of a folder. Raises ScenarioError if one is invalid, or there is none."""
    files = sorted(scenarios.glob("fig*.toml"))
    if not files:
        raise ScenarioError(str(scenarios), Problem("scenarios", None, "must hold the paper's fig*.toml"))
    return [load_scenario(file) for file in files]


def _machine(effort: Effort) -> str:
    libraries = ", ".join(f"{name} {version(name)}" for name in ("numpy", "scipy", "scikit-sundae"))
    return (
        f"Times are medians of {effort.repetitions} in one process, on {_processor()}, {os.cpu_count()} cores "
        f"shared with other work, {platform.system()}, Python {platform.python_version()}, {libraries}.\n\n"
    )


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = (line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.machine())


def _count(rows: Sequence[Row]) -> str:
    verdicts = [row.verdict for row in rows]
    counts = ", ".join(
        f"{verdicts.count(verdict)} {words}"
        for verdict, words in (
            ("holds", "hold"),
            ("fails honestly", "fail honestly, with a `SolverError`"),
            ("wrong", "are wrong"),
        )
    )
    return f"{len(rows)} cases: {counts}.\n\n"


def _table(rows: Sequence[Row]) -> str:
    lines = [
        "| case | what is hard | outcome | error | bound | against | IDA steps | ms |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        outcome = f"**{row.verdict}**: " if row.verdict != "holds" else ""
        outcome += row.outcome.replace("_", " ") + (f"; {row.events}" if row.events else "")
        cells = [row.case.name, row.case.hard, outcome, *_errors(row)]
        cells += [str(row.ida_steps), f"{1e3 * row.seconds:.3g}"]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _errors(row: Row) -> list[str]:
    if row.finding is None:
        return ["–", "–", "–"]
    error = row.finding.remark if math.isinf(row.finding.error) else _short(row.finding.error)
    return [error, _short(row.finding.bound), row.finding.against]


def _short(value: float) -> str:
    return f"{value:.0e}" if value else "0"


def _failures(rows: Sequence[Row]) -> str:
    failed = [row for row in rows if row.finding is None]
    if not failed:
        return ""
    lines = [f"- {row.case.name}: `{row.failure.removeprefix('<dict>: ')}`" for row in failed]
    return "What the solver says where it fails:\n\n" + "\n".join(lines) + "\n\n"


def _disturbed(found: Sequence[Tally]) -> str:
    lines = [
        "| disturbance | runs | repaired | worst difference | raised | silently wrong |",
        "|---|---|---|---|---|---|",
    ]
    for tally in found:
        worst = _short(tally.worst) if tally.repaired else "–"
        wrong = f"**{len(tally.wrong)}**: {'; '.join(tally.wrong)}" if tally.wrong else "0"
        cells = [
            tally.disturbance.name,
            str(tally.runs),
            str(tally.repaired),
            worst,
            str(tally.raised),
            wrong,
        ]
        lines.append("| " + " | ".join(cells) + " |")
    runs, wrong_runs = sum(t.runs for t in found), sum(len(t.wrong) for t in found)
    total = f"{runs} disturbed runs, {wrong_runs} silently wrong.\n\n"
    gaps = [f"{tally.disturbance.gap}\n\n" for tally in found if tally.wrong and tally.disturbance.gap]
    return "".join([total, "\n".join(lines), "\n\n", *gaps])


def _shares(found: dict[str, float]) -> str:
    lines = ["| check | share of the run time |", "|---|---|"]
    lines += [f"| {name} | {100.0 * share:.1f} % |" for name, share in found.items()]
    lines.append(f"| all | {100.0 * sum(found.values()):.1f} % |")
    return "\n".join(lines) + "\n\n"
