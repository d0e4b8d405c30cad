"""What the fuzz has found, as sections of the stability page; read from the result files beside it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

_PAIRS = """## Fuzz

Random sealed pairs, each history compared with the closed form in every event and sample.

"""

_WHOLE = """
## Fuzz over the whole grammar

*What is drawn* (`tests/fuzz/grammar.py`): one to six balloons of all elastomers, presets and measured curves; gas,
adiabatic gas, liquid, vacuum and chambers; films with strengths; inflation, ramps, jumps, holds, charges, sines,
triangles, tables and cycles, for all electrodes or by name, with the valve open or closed and with `until`; a
quarter in real time, with viscoelastic branches, supplies and leaks. One scenario in five is extreme.

*What is compared* (`tests/fuzz/agreement.py`): every row of a history with the equations, the drive, the gas and the
energy books; events with their order, times, voltages, both sides and losses with an independent reference
(`tests/oracle/general`), by which each flow is integrated with SciPy. Where it agrees with the simulator, two
integrators do. Else it is played again with a second one of its own. Flows are integrated a third time from the
event alone where the reference is in doubt, and in one of ten scenarios. *Undecided* are scenarios in which rounding
may decide, as where a ramp turns at the very voltage of an event; there what is certain is compared.

The one disagreement was the reference's: a jump in real time lost its tension before any time had passed. Of the three
solver errors two are mended: a flow that took more than 50,000 steps, and equal balloons full of liquid, whose
stretches no voltage changes. The third stays: two balloons whose moduli differ in the sixteenth digit, at the voltage
where they would part. Seed 3003 was played before the viscoelastic branches and supplies that 3004 draws. Three
thousand scenarios do not show that fewer than one in a thousand fails.

"""

_TWINS = """
*Twins* (`python -m tests.fuzz.metamorphic N --seed S --twins 3`): the scenario written in another way must have the
same history. Pairs played, and how many of them differed:

"""

_VERBS = """
*The other verbs* (`python -m tests.fuzz.verbs N --seed S`): every point of a path is in balance on the same gas, the
Hessian is singular at limit points, derivatives (those of losses of sphericity too) are those of the reference's
events, rows of sweeps are runs of their own. The one that was wrong printed a warning of NumPy, and is mended. How
the calls ended; errors are those that are documented:

"""

_MUTATIONS = """
## Mutations

Operators, comparisons and constants of `model`, `solver` and `simulation` (but for what is told or runs in lockstep)
changed at random, one at a time. Those count that change a result: for the second draw, one of sixteen histories and
paths in five digits. Of them the tests see:

| draw | changed | a result changes | seen by tests |
|---|---|---|---|
| first | 101 | 78 | 78 |
| second | 32 | 16 | 16 |
| both | 133 | 94 | 94 |
"""


def fuzz_sections(pairs: Path) -> str:
    """Sections of all fuzzes, from the result file of that of pairs and those beside it.

    A file that is not there is said to be missing.
    """
    return "".join(
        [
            _PAIRS,
            _of_pairs(pairs),
            _WHOLE,
            _of_seeds(pairs.with_name("fuzz-whole.json"), "make fuzz-whole"),
            _TWINS,
            _of_kinds(pairs.with_name("fuzz-twins.json"), "pairs", "pair"),
            _VERBS,
            _of_kinds(pairs.with_name("fuzz-verbs.json"), "verbs", "call and its end"),
            _MUTATIONS,
        ]
    )


def _of_pairs(file: Path) -> str:
    if not file.exists():
        return f"No `{file.name}` beside this page yet: `make fuzz` produces it, `make stress` reads it.\n"
    lines = ["| | |", "|---|---|"]
    for key, value in _read(file).items():
        if isinstance(value, dict):
            lines += [f"| {_words(key)}: {_words(name)} | {_number(part)} |" for name, part in value.items()]
        else:
            lines.append(f"| {_words(key)} | {_number(value)} |")
    return f"Written by `make fuzz` to `{file.name}`.\n\n" + "\n".join(lines) + "\n"


def _of_seeds(file: Path, command: str) -> str:
    """One column for each seed."""
    if not file.exists():
        return f"No `{file.name}` beside this page yet: `{command}` produces it.\n"
    seeds = _read(file)
    counts = ("scenarios", "agreed", "undecided", "solver_error", "disagreement", "crash", "hang", "events")
    lines = ["| seed | " + " | ".join(seeds) + " |", "|---" * (len(seeds) + 1) + "|"]
    for key in counts:
        row = " | ".join(_number(found[key]) for found in seeds.values())
        lines.append(f"| {_words(key)} | {row} |")
    for what in sorted({what for found in seeds.values() for what in found["worst"]}):
        row = " | ".join(_number(found["worst"].get(what, 0.0)) for found in seeds.values())
        lines.append(f"| worst: {_words(what)} | {row} |")
    return f"Written by `{command}` to `{file.name}`.\n\n" + "\n".join(lines) + "\n"


def _of_kinds(file: Path, part: str, title: str) -> str:
    """The counts of all seeds together."""
    if not file.exists():
        return f"No `{file.name}` beside this page yet.\n"
    found = _read(file).values()
    kinds = sorted({kind for one in found for kind in one[part]})
    lines = [f"| {title} | |", "|---|---|"]
    lines += [f"| {_words(kind)} | {sum(one[part].get(kind, 0) for one in found)} |" for kind in kinds]
    wrong = sum(sum(one["wrong"].values()) if "wrong" in one else one["problems"] for one in found)
    scenarios = sum(one["scenarios"] for one in found)
    return "\n".join([*lines, "", f"{scenarios} scenarios, {wrong} wrong.", ""])


def _read(file: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    return found


def _words(key: str) -> str:
    return key.replace("_", " ")


def _number(value: object) -> str:
    if isinstance(value, list):
        return ", ".join(map(_number, value))
    return f"{value:.1e}" if isinstance(value, float) else str(value)
