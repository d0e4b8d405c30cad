"""The fuzz of the whole grammar itself: its scenarios are valid, and what is wrong with a history is seen."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from simulator import History, load_scenario
from tests.fuzz import grammar, happenings, metamorphic, soundness, twins, verbs, whole
from tests.fuzz.keeping import keep, kept
from tests.fuzz.running import Runner
from tests.oracle.general.elastomers import gent
from tests.pairs import run

LOOP = {
    "title": "3c B",
    "gas": {"ambient_pressure": 0.015},
    "balloon": [
        {"name": "active", "electrodes": True, "elastomer": {"model": "gent", "J_lim": 100.0}},
        {"name": "passive", "elastomer": {"model": "gent", "J_lim": 100.0}},
    ],
    "step": [{"inflate": 1.2}, {"ramp": 0.4}, {"ramp": 0.0}],
}


def test_scenarios_are_valid_and_the_same_for_the_same_number(tmp_path: Path) -> None:
    for number in range(150):
        document = grammar.numbered(number, tmp_path)
        assert document == grammar.numbered(number, tmp_path)
        load_scenario(document)


def test_scenarios_have_every_part_of_the_grammar(tmp_path: Path) -> None:
    seen: Counter[str] = Counter()
    for number in range(400):
        document = grammar.numbered(number, tmp_path)
        seen.update(list(document))
        seen.update(list(document["gas"]))
        seen[document["gas"].get("law", "isothermal")] += 1
        for balloon in document["balloon"]:
            seen.update(list(balloon))
            seen[balloon["elastomer"].get("model", "preset")] += 1
        for step in twins.written_out(document["step"]):
            seen.update(list(step))
            seen.update(list(step.get("until", {})))
        seen["cycle"] += sum("cycle" in step for step in document["step"])
    wanted = [
        "scales",
        "gas",
        "balloon",
        "step",
        "dynamics",
        "output",
        "solver",
        "chamber",
        "law",
        "exponent",
        "isothermal",
        "adiabatic",
        "liquid",
        "radius",
        "thickness",
        "modulus",
        "permittivity",
        "electrodes",
        "breakdown",
        "maxwell",
        "gent",
        "neo-hookean",
        "mooney-rivlin",
        "ogden",
        "arruda-boyce",
        "yeoh",
        "gent-gent",
        "fung",
        "tabulated",
        "preset",
        "inflate",
        "ramp",
        "charge",
        "hold",
        "jump",
        "sine",
        "triangle",
        "table",
        "cycle",
        "valve",
        "until",
        "event",
        "stretch",
        "pressure",
        "field",
    ]
    assert [word for word in wanted if seen[word] < 3] == []


def test_kept_scenarios_come_back(tmp_path: Path) -> None:
    number = next(n for n in range(200) if "table" in str(grammar.numbered(n, tmp_path / "a")))
    document = grammar.numbered(number, tmp_path / "a")
    keep(document, tmp_path / "kept.json", number=number)
    back = kept(tmp_path / "kept.json", tmp_path / "b")
    assert str(back).replace(str(tmp_path / "b"), str(tmp_path / "a")) == str(document)
    load_scenario(back)


@pytest.fixture(scope="module")
def loop() -> History:
    return run(load_scenario(LOOP))


def test_a_sound_history_has_no_problems(loop: History) -> None:
    assert not soundness.problems_of(loop)
    assert not happenings.problems_of(loop)
    assert not happenings.landing_problems_of(loop)


def _with_event(history: History, number: int, **changed: Any) -> History:
    events = list(history.events)
    events[number] = replace(events[number], **changed)
    return replace(history, events=tuple(events))


def _with_row(history: History, name: str, row: int, shift: float) -> History:
    column = np.array(getattr(history, name))
    column[row] += shift
    changed: dict[str, Any] = {name: column}
    return replace(history, **changed)


@pytest.mark.parametrize(
    ("wrong", "word"),
    [
        (lambda h: _with_row(h, "stretch", 150, 1e-7), "balance"),
        (lambda h: _with_row(h, "voltage", 150, 1e-7), "drive"),
        (lambda h: _with_row(h, "pressure", 50, 1e-7), "ramp"),
        (lambda h: _with_row(h, "pressure", 150, np.nan), "finite"),
        (lambda h: replace(h, energy_balance=replace(h.energy_balance, imbalance=1e-5)), "energy"),
        (lambda h: _with_event(h, 0, stretch_before=h.events[0].stretch_before + 1e-4), "singular"),
        (lambda h: _with_event(h, 0, stretch_after=h.events[0].stretch_after + 1e-4), "where the flow leads"),
        (lambda h: _with_event(h, 1, stretch_after=np.array([2.0, 1.1])), "where the flow leads"),
    ],
)
def test_what_is_wrong_with_a_history_is_seen(
    loop: History, wrong: Callable[[History], History], word: str
) -> None:
    history = wrong(loop)
    judges = soundness.problems_of, happenings.problems_of, happenings.landing_problems_of
    problems = next(filter(None, (judge(history) for judge in judges)), [])
    assert any(word in problem for problem in problems)


def test_an_unstable_sample_is_seen(loop: History) -> None:
    """An equilibrium between the two limit points, from the closed form of the sealed pair."""
    force = gent(100.0).force
    passive = 1.01
    pressure = force(passive) / passive**2
    active = (3.0 * float(loop.gas[150]) / (pressure + 0.015) - passive**3) ** (1.0 / 3.0)
    assert 2.1 < active < 4.9
    voltage = np.sqrt((force(active) - pressure * active**2) / (2.0 * active**3))
    columns = {"stretch": [active, passive], "pressure": pressure, "voltage": voltage}
    wrong = loop
    for name, value in columns.items():
        column = np.array(getattr(wrong, name))
        column[150] = value
        changed: dict[str, Any] = {name: column}
        wrong = replace(wrong, **changed)
    assert any("unstable" in problem for problem in happenings.problems_of(wrong))


def test_random_scenarios_agree_with_the_references(tmp_path: Path) -> None:
    found = list(whole.fixed_slice(tmp_path))
    wrong = {number: verdict.problems for number, _, verdict in found if verdict.kind in whole.WRONG}
    assert wrong == {}
    kinds = Counter(verdict.kind for _, _, verdict in found)
    assert kinds["agreed"] >= 0.9 * whole.SLICE


def test_paths_sweeps_and_optima_of_random_scenarios_satisfy_the_equations(tmp_path: Path) -> None:
    ends: Counter[str] = Counter()
    with Runner() as runner:
        for number in range(5_000_000, 5_000_005):
            document = grammar.numbered(number, tmp_path)
            rng = np.random.default_rng([number, 11])
            for verb, end, problems in verbs.examine(document, rng, tmp_path, runner):
                assert problems == [], f"{number} {verb}"
                ends[end] += 1
    assert ends["returned"] > 10


BACK = {"cycle": 2, "steps": [{"ramp": 0.2}, {"ramp": 0.4}]}
CYCLED = {**LOOP, "step": [{"inflate": 1.2}, {"ramp": 0.4}, BACK]}
SLOW = {**CYCLED, "dynamics": {"relaxation_time": 0.05}, "output": {"points": 7}}


@pytest.mark.parametrize("document", [CYCLED, SLOW], ids=["quasi-static", "in real time"])
def test_twins_have_the_same_history_and_others_do_not(document: dict[str, Any], tmp_path: Path) -> None:
    """Each kind of twin, and the same twin with a little more gas."""
    rng = np.random.default_rng(0)
    first = run(load_scenario(document))
    for name, make in twins.TWINS.items():
        twin = make(document, rng, tmp_path)
        assert twin is not None, name
        same = load_scenario(twin.document)
        assert metamorphic.difference(first, run(same), twin) is None, name
        other = run(same.with_values({"gas.ambient_pressure": same.gas.ambient_pressure * 1.01}))
        assert metamorphic.difference(first, other, twin) is not None, name


def test_twins_that_hardly_differ_are_seen() -> None:
    first = run(load_scenario(LOOP))
    second = run(load_scenario({**LOOP, "gas": {"ambient_pressure": 0.0150001}}))
    assert metamorphic.difference(first, second, twins.Twin(LOOP)) is not None


def test_all_kinds_of_twins_come_in_turn() -> None:
    found = Counter(kind for number in range(len(twins.TWINS)) for kind in metamorphic.in_turn(number, 5))
    assert set(found.values()) == {5}
    assert set(found) == set(twins.TWINS)


def _sleeps() -> None:
    import time

    time.sleep(60.0)


def _spins() -> None:
    while True:
        pass


def _dies() -> None:
    import os

    os._exit(3)


def _prints() -> int:
    import os

    os.write(1, b"from C\n")
    return 7


def test_runs_that_hang_or_die_are_told_from_others() -> None:
    with Runner(0.05) as runner:
        assert runner.call(_sleeps).end == "hang"  # by the clock, twenty times later
    with Runner(0.5) as runner:
        assert runner.call(_spins).end == "hang"
        assert runner.call(_dies).end == "crash"
        ran = runner.call(_prints)
        assert (ran.end, ran.value, ran.printed) == ("returned", 7, "from C\n")
