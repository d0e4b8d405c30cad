"""The page on the paper: every verdict, every misprint, and that the committed page is the one produced."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

from simulator.events import EventKind
from tests.studies.figures import FIGURES, MORE, draw_figures
from tests.studies.figures.__main__ import main as figures
from tests.studies.paper import paper_page, statements
from tests.studies.paper.__main__ import main as paper
from tests.studies.paper.case import VERDICTS, Statement, load_cases
from tests.studies.paper.formulation import misprints as misprints_of_the_equations
from tests.studies.paper.inflation import misprints as misprints_of_fig_2
from tests.studies.paper.real import passes_pears
from tests.studies.paper.unequal import misprints as misprints_of_fig_5

ROOT = Path(__file__).parent.parent
SCENARIOS = ROOT / "scenarios"
AGREES, AS_READ, _ = VERDICTS

# The statements that hold only under a reading; all others hold as they stand.
READ = [
    ("Fig. 3a, C", "it would fail by electrical breakdown"),
    ("Fig. 3b, A", "ramping up is limited by EMI and can not reach loss of tension"),
    ("Fig. 3b, A", "loss of tension can only be reached if the voltage is at some point decreased again"),
    ("Fig. 3b, B", "ramping up is limited by EMI and can not reach loss of tension"),
    ("Fig. 3b, B", "loss of tension can only be reached if the voltage is at some point decreased again"),
    ("Fig. 3c, A", "limited by EMI; snaps to an unstable state and eventually ruptures or breaks down"),
    ("Fig. 4a", "O and O′ are two stable states"),
    ("Fig. 5", "states A, B, C are those of Fig. 2: P₀R₂/(μH) = 0.6, 1.2, 1.3"),
]


@pytest.fixture(scope="module")
def cases():
    return load_cases(SCENARIOS)


@pytest.fixture(scope="module")
def sections():
    return statements(SCENARIOS)


def everything(sections) -> list[Statement]:
    return [statement for section in sections.values() for statement in section]


def test_every_verdict(sections):
    found = everything(sections)
    assert [(s.place, s.says) for s in found if s.verdict == AS_READ] == READ
    assert {s.verdict for s in found} == {AGREES, AS_READ}
    assert [len(section) for section in sections.values()] == [14, 18, 7, 7, 2]


def test_a_verdict_can_fail():
    assert [
        Statement("", "", "", holds, "so", read).verdict
        for holds, read in ((True, False), (False, True), (False, False))
    ] == list(VERDICTS)


@pytest.mark.parametrize(
    ("place", "number"),
    [
        ("Fig. 2", "1.2536545513"),
        ("Section 3", "7.1763369123"),
        ("Fig. 3a, A", "0.66343884"),
        ("Fig. 3a, B", "0.51182337"),
        ("Fig. 3b, A", "0.58183674"),
        ("Fig. 3b, B", "0.39531863"),
        ("Fig. 3c, A", "0.56141475"),
        ("Fig. 4a", "0.36044087"),
        ("Fig. 5b", "0.13925397"),
        ("Fig. 5c", "0.49619765"),
        ("Fig. 5b, B", "6.02643177"),
        ("Fig. 5c, B", "6.05890575"),
    ],
)
def test_numbers_of_the_reference(sections, place, number):
    assert any(number in s.here for s in everything(sections) if s.place == place)


def test_what_holds_for_real_balloons(sections):
    found = {(s.place, s.says): s.real for s in everything(sections)}
    assert [real.holds for real in found.values() if real].count(True) == 19
    # Those about a stable state after a snap.
    landed = {
        says: real.words
        for (_, says), real in found.items()
        if real and "snap" in says and real.holds is not True
    }
    assert landed["reaches EMI and snaps to a stable state"] == "**not beyond φ = 0.31406083**"
    assert "A: open" in landed["snap-through can be realised for states A or B"]
    kept = [real for (_, says), real in found.items() if says.startswith("switched off")]
    assert [real.words for real in kept] == ["holds", "holds"]


def test_snaps_pass_pears_where_histories_say_so(cases):
    """s between both sides of a snap, by formulas of their own, against the flow of the history."""
    for case in cases.values():
        for snap in case.snaps:
            if snap.kind is not EventKind.LIMIT_POINT:
                continue
            at_once = [event.kind for event in case.shaped.events if event.time == snap.time]
            # Where the sphere was lost before, it is regained in the snap.
            assert passes_pears(snap) == (EventKind.SPHERICITY_REGAINED in at_once)


def test_every_misprint_is_proved(cases):
    found = [*misprints_of_the_equations(), *misprints_of_fig_2(cases), *misprints_of_fig_5(cases)]
    assert [misprint.place for misprint in found] == ["Eq. 4", "Section 3", "Fig. 5"]
    assert all(misprint.is_proved for misprint in found)


def test_the_committed_page_is_the_one_produced():
    assert (ROOT / "docs/paper.md").read_text("utf-8") == paper_page(SCENARIOS)


@pytest.mark.parametrize(("name", "stars"), [("fig3b", 2), ("fig3c", 2), ("fig5b", 2), ("fig5c", 2)])
def test_each_instability_has_its_star(name, stars):
    (ax,) = FIGURES[name](SCENARIOS).axes
    assert sum(line.get_marker() == "*" and len(line.get_xdata()) == 1 for line in ax.lines) == stars


def test_every_figure_of_the_page_is_there():
    page = (ROOT / "docs/paper.md").read_text("utf-8")
    for name in FIGURES:
        assert f"](figures/{name}.svg)" in page
        assert (ROOT / f"docs/figures/{name}.svg").stat().st_size < 300_000
        assert (ROOT / f"docs/figures/{name}.png").stat().st_size < 150_000


def test_commands_write_page_and_figures(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(
        "tests.studies.figures.FIGURES",
        {name: FIGURES[name] for name in ("fig2", "fig4a", "fig5b", "history5b_b")},
    )
    monkeypatch.delitem(MORE, "rates")  # twenty histories of a film, which are half a minute
    options = ["--scenarios", str(SCENARIOS), "--quiet"]
    assert figures(["--out", str(tmp_path / "figures"), *options]) == 0
    content = (tmp_path / "figures/fig4a.png").read_bytes()
    assert struct.unpack(">II", content[16:24]) == (960, 720)
    again = draw_figures(SCENARIOS)
    assert {name: (tmp_path / "figures" / name).read_bytes() for name in again} == again
    assert paper(["--out", str(tmp_path / "page.md"), *options]) == 0
    assert capsys.readouterr() == ("", "")
    assert (tmp_path / "page.md").read_text("utf-8").startswith("# The paper, number by number\n")


@pytest.mark.parametrize("command", [figures, paper])
def test_a_folder_without_the_scenarios_is_said(tmp_path, command, capsys):
    assert command(["--out", str(tmp_path / "out" / "x"), "--scenarios", str(tmp_path)]) == 2
    assert "fig3a_state_" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
