"""What else is asked of a scenario: traces, folds, sensitivities, sweeps and optima of random scenarios.

    python -m tests.fuzz.verbs N --seed S

Nothing may crash, and what comes out is held against the equations by the reference's own code: each point
of a path is an equilibrium of the same gas, each limit point has a singular Hessian, each derivative (of
limit points and of losses of sphericity) is that of the reference's events, each row of a sweep is a run of
its own.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator import (
    all_sensitivities,
    fold,
    load_scenario,
    load_sweep,
    optimize,
    read_question,
    read_sweep,
    run_sweep,
    trace,
    trace_all,
    trace_inflation,
)
from tests.fuzz import command, derivatives, grammar
from tests.fuzz.chances import chance, log_uniform
from tests.fuzz.keeping import keep
from tests.fuzz.paths import curve_problems, fold_problems
from tests.fuzz.running import Ran, Runner
from tests.pairs import run

FloatArray = NDArray[np.float64]
Document = dict[str, Any]
Rng = np.random.Generator


# ------------------------------------------------------------------ played in a process of their own


def traced(document: Document) -> tuple[Any, ...]:
    return (trace(load_scenario(document)),)


def all_traced(document: Document) -> tuple[Any, ...]:
    return trace_all(load_scenario(document))


def inflation_traced(document: Document) -> tuple[Any, ...]:
    return (trace_inflation(load_scenario(document)),)


def folded(document: Document, key: str, to: float) -> Any:
    return fold(load_scenario(document), key, to)


def with_sensitivities(document: Document) -> tuple[Any, tuple[Any, ...]]:
    history = run(load_scenario(document))
    return history, all_sensitivities(history)


def swept(document: Document, vary: dict[str, list[float]], folder: str) -> list[dict[str, Any]]:
    with ThreadPoolExecutor(1) as executor:
        run_sweep(read_sweep({"scenario": document, "vary": vary}), folder, executor=executor)
    table: Any = load_sweep(folder)
    table = table.to_dataframe().reset_index()
    return [{str(key): value for key, value in row.items()} for row in table.to_dict("records")]


def optimized(document: Document, vary: dict[str, Any], column: str) -> tuple[float, list[Any], Any]:
    asked = {"scenario": document, "vary": vary, "maximize": column}
    found = optimize(read_question({**asked, "search": {"population": 2, "generations": 1}}))
    return found.value, [dict(row) for row in found.runs], found.row


def played(document: Document, values: dict[str, float]) -> Any:
    return run(load_scenario(document).with_values(values))


# ------------------------------------------------------------------------------------ what is asked


def plain(document: Document) -> Document:
    """The scenario without units, whose numbers can be changed as numbers."""
    return document if "scales" not in document else {}


def numbers(document: Document) -> dict[str, float]:
    """Some numbers of a device by their keys."""
    out = {"gas.ambient_pressure": document["gas"]["ambient_pressure"]}
    if document["gas"].get("chamber"):
        out["gas.chamber"] = document["gas"]["chamber"]
    for balloon in document["balloon"]:
        for key in ("radius", "thickness", "modulus", "permittivity"):
            out[f"balloon.{balloon['name']}.{key}"] = balloon.get(key, 1.0)
        if balloon["elastomer"].get("model") == "gent":
            out[f"balloon.{balloon['name']}.elastomer.J_lim"] = balloon["elastomer"]["J_lim"]
    return {key: float(value) for key, value in out.items() if value > 0.0}


def examine(
    document: Document, rng: Rng, folder: Path, runner: Runner
) -> Iterator[tuple[str, str, list[str]]]:
    """Ask everything of a scenario.

    Yields
    ------
    verb : str
    end : str
        As in `Ran`.
    problems : list of str
    """
    scenario = load_scenario(document)
    for verb in (traced, all_traced, inflation_traced):
        ran = runner.call(verb, document)
        yield from _told(verb.__name__, ran, lambda curves: curve_problems(scenario, curves))
    if not (document := plain(document)):
        return
    keys = numbers(document)
    if keys:
        key = str(rng.choice(list(keys)))
        to = keys[key] * log_uniform(rng, 0.2, 5.0)
        ran = runner.call(folded, document, key, to)
        yield from _told(f"folded {key} to {to!r}", ran, lambda found: fold_problems(document, key, found))
    shaped = {**document, "shape": {"on_loss": "record"}}
    ran = runner.call(with_sensitivities, shaped)
    yield from _told("sensitivities", ran, lambda value: derivative_problems(shaped, value, rng))
    if not keys or ("dynamics" in document and chance(rng, 0.7)):
        return
    key = str(rng.choice(list(keys)))
    vary = {key: [keys[key] * share for share in (0.9, 1.0, 1.1)]}
    with TemporaryDirectory(dir=folder) as directory:
        ran = runner.call(swept, document, vary, directory)
    yield from _told(f"swept {vary}", ran, lambda rows: _row_problems(document, rows, key, runner))
    span = {key: {"from": 0.9 * keys[key], "to": 1.1 * keys[key]}}
    column = f"largest_stretch_{document['balloon'][0]['name']}"
    ran = runner.call(optimized, document, span, column)
    yield from _told(f"optimized {column} over {span}", ran, lambda found: _optimum_problems(found, column))


def _told(verb: str, ran: Ran, judge: Callable[[Any], list[str]]) -> Iterator[tuple[str, str, list[str]]]:
    problems = [f"printed {ran.printed[:200]!r}"] if ran.printed else []
    if ran.end in ("crash", "hang"):
        problems.append(ran.error)
    elif ran.end == "returned":
        problems += judge(ran.value)
    yield verb, ran.end if ran.end != "raised" else ran.error.split(":")[0], problems


def derivative_problems(document: Document, value: Any, rng: Rng) -> list[str]:
    """What is wrong with two of the derivatives; played in a process of its own."""
    history, found = value
    chosen = [one for one in derivatives.two_of(found, rng) if derivatives.can_be_checked(one, history)]
    problems = (derivatives.problem_of(document, one, history) for one in chosen)
    return [problem for problem in problems if problem]


def _row_problems(document: Document, rows: list[dict[str, Any]], key: str, runner: Runner) -> list[str]:
    out = []
    for row in rows:
        ran = runner.call(played, document, {key: row[key]})
        wanted = "failed" if ran.end == "raised" else ran.value.outcome.value if ran.value else "?"
        if row["outcome"] != wanted:
            out.append(f"a row with {key} = {row[key]!r} is {row['outcome']}, alone it is {wanted}")
    return out


def _optimum_problems(found: tuple[float, list[Any], Any], column: str) -> list[str]:
    value, runs, row = found
    values = [run[column] for run in runs if run.get(column) is not None and np.isfinite(run[column])]
    if not values:
        return [] if row is None else ["an optimum without runs"]
    return [] if value == max(values) else [f"the optimum is {value!r}, a run has {max(values)!r}"]


def main() -> int:
    options = command.parser("tests.fuzz.verbs", __doc__.split("\n")[0], 100).parse_args()
    ends: Counter[str] = Counter()
    wrong = 0
    with TemporaryDirectory() as folder, Runner() as runner:
        for count, number in enumerate(command.numbers(options), start=1):
            document = grammar.numbered(number, Path(folder))
            rng = np.random.default_rng([number, 11])
            for verb, end, problems in examine(document, rng, Path(folder), runner):
                ends[f"{verb.split()[0]} {end}"] += 1
                for problem in problems:
                    wrong += 1
                    print(f"{number} {verb}: {problem}", flush=True)
                if problems:
                    file = options.keep / f"{number}-{verb.split()[0]}.json"
                    keep(document, file, verb=verb, problems=problems)
            if options.report:
                report = {"scenarios": count, "verbs": ends, "problems": wrong}
                command.write_report(options.report, options.seed, report)
    print("  ".join(f"{end} {count}" for end, count in sorted(ends.items())))
    print(f"scenarios {options.count}  problems {wrong}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
