"""The stress cases, each as a test; that disturbed runs are never silently wrong; the page about both."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from simulator import load_scenario
from simulator.solver import certify, flow, landing, newton, proposals
from tests import fuzz
from tests.pairs import pair, run
from tests.studies.stress import FAILS, Case, Finding, Row, cases, examine
from tests.studies.stress.__main__ import main
from tests.studies.stress.case import counted
from tests.studies.stress.cost import shares
from tests.studies.stress.fuzz import fuzz_sections
from tests.studies.stress.page import Effort, stability_page
from tests.studies.stress.sabotage import Disturbance, Tally, difference, disturbances, random_pairs, tallies
from tests.studies.stress.voltages import coincidence

ROOT = Path(__file__).parents[1]
SHIPPED = sorted((ROOT / "scenarios").glob("*.toml"))
CASES = {case.name: case for case in cases(rows=500, cycles=8)}
DISTURBANCES = {disturbance.name: disturbance for disturbance in disturbances()}


@cache
def row(name: str) -> Row:
    return examine(CASES[name])


# -- cases ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", CASES)
def test_case(name: str) -> None:
    found = row(name)
    if CASES[name].outcome == FAILS:
        # Known to fail, and it says so; one that no longer does is to be marked as such.
        assert found.verdict == "fails honestly"
        assert "last stretches" in found.failure
        return
    assert found.finding is not None, found.failure
    assert found.outcome == CASES[name].outcome
    assert found.finding.error <= found.finding.bound, found.finding.remark


def test_nothing_is_known_to_fail() -> None:
    assert [name for name, case in CASES.items() if case.outcome == FAILS] == []


def test_the_stretch_comes_within_1e_9_of_its_limit() -> None:
    history = run(CASES["φ up to 1e4"].load())
    limit = np.sqrt(0.5 * 103.0)  # 2λ² + λ⁻⁴ = J + 3
    for _ in range(20):
        limit -= (2 * limit**2 + limit**-4 - 103.0) / (4 * limit - 4 * limit**-5)
    assert 0.0 < limit - history.stretch[:, 0].max() < 1e-9


def test_limit_point_and_loss_of_tension_coincide() -> None:
    """Below that pressure there is a limit point before p = 0, above it there is none."""
    ambient = coincidence()
    kinds = [
        [e.kind.value for e in run(pair(1.2, {"ramp": 0.6}, ambient=ambient * (1.0 + d))).events]
        for d in (-1e-4, 1e-4)
    ]
    assert kinds == [["limit_point", "loss_of_tension"], ["loss_of_tension"]]


# What a check that cannot fail would let through.


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("pₑ = 0", {"ramp": 0.4 - 1e-7}),
        ("turn 1e-12 before a limit point", {"ramp": 0.37}),
        ("jumps across limit points", {"ramp": 0.5}),
        ("12 balloons, one driven", {"ramp": 0.1}),
    ],
)
def test_checks_see_another_history(name: str, change: dict[str, float]) -> None:
    case = CASES[name]
    written = case.load().to_dict()
    written["step"] = [written["step"][0], change, *written["step"][2:]]
    other = run(load_scenario(written))
    history = run(case.load())
    wrong = replace(other, scenario=history.scenario)
    if name == "12 balloons, one driven":  # nothing to compare with but itself
        wrong = replace(history, stretch=history.stretch + 1e-7)
    finding = case.check(wrong)
    assert finding.error > finding.bound


def test_verdicts() -> None:
    case = Case("x", "", {}, lambda _: Finding(0.0, 1.0, ""))
    made = Row(case, "completed", "", Finding(0.5, 1.0, ""), "", 1, 0.0)
    assert made.verdict == "holds"
    assert replace(made, outcome="breakdown").verdict == "wrong"
    assert replace(made, finding=Finding(1.5, 1.0, "")).verdict == "wrong"
    assert replace(made, finding=None).verdict == "fails honestly"
    assert counted(["limit_point", "jump", "limit_point"]) == "limit point × 2, jump"


def test_an_error_that_is_no_number_is_none() -> None:
    case = replace(CASES["P₀ = 0"], check=lambda _: Finding(float("nan"), 1.0, ""))
    with pytest.raises(ArithmeticError, match="P₀ = 0: the error is not a number"):
        examine(case)


# -- never silently wrong ------------------------------------------------------------------------------


def disturbed(name: str, scenarios: list[dict[str, Any]]) -> Tally:
    (tally,) = tallies(scenarios, [DISTURBANCES[name]])
    return tally


SNAPPING = [
    load_scenario(ROOT / f"scenarios/{name}.toml").to_dict()
    for name in ("fig2_inflation", "fig3b_state_a", "fig3c_state_b", "fig5c_state_a")
]
# Jumps to where there is another stable state.
SNAPPING.append(pair(1.2, *({"jump": v} for v in (0.3, 0.31, 0.4, 0.3, 0.29)), ambient=0.015).to_dict())


@pytest.fixture(scope="module")
def tallied() -> dict[str, Tally]:
    found = tallies([*SNAPPING, *random_pairs(8)], DISTURBANCES.values())
    return {tally.disturbance.name: tally for tally in found}


@pytest.mark.parametrize("name", DISTURBANCES)
def test_disturbed_runs_are_repaired_or_raise(name: str, tallied: dict[str, Tally]) -> None:
    tally = tallied[name]
    assert tally.wrong == []
    assert tally.runs >= 1  # it struck
    assert tally.worst < 1e-9


@pytest.mark.parametrize("number", [109, 190])
def test_a_flow_put_into_another_valley(number: int) -> None:
    strikes = 16 + number  # the seed under which the page found it
    scenarios = [CASES["P₀ = 0"].load().to_dict()] * strikes + [random_pairs(number + 1)[number]]
    assert disturbed("a flow stopped 0.3 aside", scenarios).wrong == []


def test_loose_tolerance_on_all_shipped_scenarios_and_a_slice_of_the_fuzz() -> None:
    written = [load_scenario(file).to_dict() for file in SHIPPED]
    written += [fuzz.scenario(fuzz.numpy_dice(seed)) for seed in range(5_000_000, 5_000_030)]
    tally = disturbed("`solver.rtol = 1e-1`", written)
    assert (tally.repaired, tally.raised, tally.wrong) == (len(written), 0, [])
    assert tally.worst < 1e-9


def test_a_silent_error_would_be_counted() -> None:
    """The tally is no ornament: a path whose checks are gone comes out wrong."""
    blind = DISTURBANCES["IDA's root finder blind for all events"]
    slack = pair(0.6, {"ramp": 0.67}, ambient=1.0).to_dict()  # tension is lost just before its end
    (tally,) = tallies([slack] * 4, [replace(blind, during=lambda strikes: _unchecked(blind, strikes))])
    assert tally.wrong


def _unchecked(disturbance: Disturbance, strikes):
    from contextlib import ExitStack

    stack = ExitStack()
    nothing = np.zeros(0, dtype=np.int64)

    polished_end = certify.polished_end

    def at_target(equations, conditions, proposal, target):
        if proposal.ended < len(conditions):
            return polished_end(equations, conditions, proposal, target)
        end = proposal.points[:, -1].copy()
        end[-1] = target
        return newton.one_at_drive(equations, end), None

    patch = stack.enter_context(pytest.MonkeyPatch.context())
    patch.setattr(certify, "judged", lambda *_: (nothing, None))
    patch.setattr(certify, "polished_end", at_target)
    stack.enter_context(disturbance.during(strikes))
    return stack


def test_difference() -> None:
    one, other = (run(pair(1.2, {"ramp": v}, ambient=0.015)) for v in (0.3, 0.3 + 1e-7))
    assert difference(one, one) == 0.0
    assert 1e-9 < difference(one, other) < 1e-5
    snapped = run(pair(1.2, {"ramp": 0.4}, ambient=0.015))
    assert difference(one, snapped) == float("inf")


def test_disturbances_leave_nothing_behind():
    def seen():
        return proposals.by_ida, proposals.ATTEMPTS, certify.newton, flow.integrate, landing.newton

    before = seen()
    tallies(SNAPPING[:1], disturbances())
    assert seen() == before


# -- cost and page -------------------------------------------------------------------------------------


def test_shares_of_the_checks() -> None:
    before = certify.judged
    found = shares([load_scenario(file) for file in SHIPPED[:2]], repetitions=1)
    assert certify.judged is before
    assert len(found) == 4
    assert all(0.0 <= share < 1.0 for share in found.values())
    assert found["margins (`judged`)"] > 0.0


@pytest.fixture(scope="module")
def committed() -> str:
    return (ROOT / "docs/stability.md").read_text("utf-8")


def test_the_committed_page_has_every_case_with_its_outcome(committed: str) -> None:
    lines = {
        line.split(" | ")[0].removeprefix("| "): line for line in committed.splitlines() if " | " in line
    }
    for case in cases():
        assert case.hard in lines[case.name]
        expected = "**fails honestly**" if case.outcome == FAILS else case.outcome.replace("_", " ")
        assert lines[case.name].split(" | ")[2].startswith(expected)
    for name in set(CASES) & {case.name for case in cases()}:
        found = row(name)
        assert found.events in lines[name]
    assert f"{len(cases())} cases: {len(cases())} hold" in committed
    for disturbance in disturbances():
        assert disturbance.name in lines


def test_the_page_has_the_counts_of_the_result_files_beside_it() -> None:
    page = Path("docs/stability.md").read_text(encoding="utf-8")
    assert page.endswith(fuzz_sections(Path("docs/fuzz.json")))


def test_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    some = {"Some": [CASES["P₀ = 0"], CASES["P₀ at the snap, radius 1"]]}
    monkeypatch.setattr("tests.studies.stress.page.groups", lambda *_: some)
    monkeypatch.setattr("tests.studies.stress.page.random_pairs", lambda _: [])
    monkeypatch.setattr("tests.studies.stress.page.shipped_scenarios", lambda _: [load_scenario(SHIPPED[0])])
    monkeypatch.setattr("tests.studies.stress.page.disturbances", lambda: disturbances()[:2])
    page = stability_page(tmp_path, tmp_path / "fuzz.json")
    assert "2 cases: 2 hold" in page
    assert "| P₀ = 0 | no pressure: tension is lost at once | loss of tension; loss of tension | 0 |" in page
    assert "1 disturbed runs, 0 silently wrong" in page or "2 disturbed runs, 0 silently wrong" in page
    assert "`make fuzz` produces it" in page
    result = {
        "n": 10000,
        "seed": 1,
        "disagreements": 0,
        "worst": {"sample": 2.5e-9, "lost_state": [1e-7, 12]},
    }
    (tmp_path / "fuzz.json").write_text(json.dumps(result))
    kinds = ("scenarios", "agreed", "undecided", "solver_error", "disagreement", "crash", "hang", "events")
    whole = {**dict.fromkeys(kinds, 3), "worst": {"step_end": 1.5e-7}}
    (tmp_path / "fuzz-whole.json").write_text(json.dumps({"1": whole, "2": {**whole, "agreed": 2}}))
    twins = {"scenarios": 7, "pairs": {"negated, quasi-static": 5}, "wrong": {}}
    (tmp_path / "fuzz-twins.json").write_text(json.dumps({"1": twins, "2": twins}))
    verbs = {"scenarios": 7, "verbs": {"traced returned": 6}, "problems": 1}
    (tmp_path / "fuzz-verbs.json").write_text(json.dumps({"1": verbs}))
    page = stability_page(tmp_path, tmp_path / "fuzz.json")
    for line in ("| agreed | 3 | 2 |", "| worst: step end | 1.5e-07 | 1.5e-07 |"):
        assert line in page
    assert "| negated, quasi-static | 10 |\n\n14 scenarios, 0 wrong." in page
    assert "| traced returned | 6 |\n\n7 scenarios, 1 wrong." in page
    assert "| n | 10000 |" in page
    assert "| worst: sample | 2.5e-09 |" in page
    assert "| worst: lost state | 1.0e-07, 12 |" in page


def test_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("tests.studies.stress.__main__.stability_page", lambda *given: f"{given}")
    options = ["--repeat", "1", "--rows", "50", "--cycles", "2", "--pairs", "4"]
    assert main(["--out", str(tmp_path), "--scenarios", "there", *options]) == 0
    assert capsys.readouterr() == (f"files    {tmp_path}: stability.md\n", "")
    asked = (Path("there"), tmp_path / "fuzz.json", Effort(1, 50, 2, 4))
    assert (tmp_path / "stability.md").read_text() == f"{asked}"


def test_a_folder_without_scenarios_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--out", str(tmp_path / "x"), "--scenarios", str(tmp_path)]) == 2
    assert f"{tmp_path}: scenarios: must hold the paper's fig*.toml" in capsys.readouterr().err
    assert not (tmp_path / "x").exists()
