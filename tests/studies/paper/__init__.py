"""Every number and checkable statement of Sun, Wang & Zhou (2015) against what comes out here.

Each statement is computed from the paper's scenario files and compared in code; no verdict is written down.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from tests.studies.paper import equal, formulation, inflation, shape, snap, unequal
from tests.studies.paper.case import VERDICTS, Case, Statement, load_cases

__all__ = ["paper_page", "statements"]

_FIGURES = {
    "Section 2 and Fig. 2": ("fig2",),
    "Fig. 3: equal balloons": ("fig3a", "fig3b", "fig3c"),
    "Fig. 4: the snap of Fig. 3c, state B": ("fig4a", "fig4b", "fig4c"),
    "Fig. 5: an active balloon of half the radius": ("fig5a", "fig5b", "fig5c"),
    "Section 4: concluding remarks": (),
}
_HISTORIES = {
    "history3c_b": "Fig. 3c, state B",
    "history5b_b": "Fig. 5b, state B",
    "history5c_a": "Fig. 5c, state A",
}

_HEAD = """\
# The paper, number by number

W. Sun, H. Wang, J. Zhou, *Actuation and instability of interconnected dielectric elastomer balloons*, Applied
Physics A (2015). Left, what the paper says; right, what comes out here, from the files in `scenarios/`.

This page is written by `make paper` and its figures by `make figures`; every verdict is the outcome of a
comparison in the program, and the tests hold each of them. "Agrees under the reading …" means that the words taken
literally do not hold, and the words in italics do. Quantities are dimensionless as in the paper: pressures are
PR₂/(μH), voltages (Φ/H)√(ε/μ), fields E√(ε/μ).

The paper takes its balloons for spheres, and *for spheres* is about that. A real balloon turns into a pear where its
tension stops rising with its stretch ([shape.md](shape.md)); *for real balloons* says whether what a statement is
about comes before that. "Not beyond φ = …" is where the sphere is lost on the way there. "Open" is what passes states
that are no spheres within a snap, while both its sides are spheres: where a pear would then go is not computed. "–" are
statements that do not depend on it.

"""

_NOT_CHECKED = """\
## Not checked

Statements on the work of others (1692 % areal expansion, the four mechanisms of breakdown), and the strength of the
film: the paper gives no number for it. A scenario that names one (`breakdown`) ends where it is reached.
"""


def statements(scenarios: Path) -> dict[str, list[Statement]]:
    """All statements by section of the paper, computed from its scenario files.

    Parameters
    ----------
    scenarios : Path
        Folder of the paper's scenario files.

    Raises
    ------
    ScenarioError
        If one is missing.
    """
    cases = load_cases(scenarios)
    sections = (
        [*formulation.statements(cases), *inflation.statements(scenarios, cases)],
        equal.statements(cases),
        snap.statements(cases),
        unequal.statements(cases),
        unequal.conclusions(cases),
    )
    return dict(zip(_FIGURES, sections, strict=True))


def paper_page(scenarios: Path) -> str:
    """The page `docs/paper.md`, from the paper's scenario files. Parameters and errors as `statements`."""
    sections = statements(scenarios)
    everything = [statement for section in sections.values() for statement in section]
    parts = [_HEAD, _count(everything), "\n"]
    for title, section in sections.items():
        parts += [
            f"## {title}\n\n",
            *(f"![Fig. {name[3:]}](figures/{name}.svg)\n" for name in _FIGURES[title]),
        ]
        parts += ["\n" if _FIGURES[title] else "", _table(section), "\n"]
    parts += ["## Spheres and real balloons\n\n", shape.figure_table(everything), "\n"]
    parts += [shape.HEAD, shape.shape_table(load_cases(scenarios)), "\n"]
    parts += ["## Misprints\n\n", _misprints(load_cases(scenarios)), "\n"]
    parts += ["## What the paper does not show\n\n", "The voltage ramped up, held and taken off again.\n\n"]
    parts += [f"![{title}](figures/{name}.svg)\n" for name, title in _HISTORIES.items()]
    return "".join([*parts, "\n", _NOT_CHECKED])


def _count(everything: Sequence[Statement]) -> str:
    verdicts = [statement.verdict for statement in everything]
    agree, read, differ = (verdicts.count(verdict) for verdict in VERDICTS)
    shaped = [s.real.holds for s in everything if s.real is not None]
    holds, lost, unknown = (shaped.count(outcome) for outcome in (True, False, None))
    return (
        f"{len(everything)} statements: for spheres {agree} agree, {read} agree under a reading, {differ} do not.\n"
        f"{len(shaped)} of them depend on the balloons' shapes: for real balloons {holds} hold, {lost} do not, "
        f"{unknown} are open.\n"
    )


def _table(section: Sequence[Statement]) -> str:
    lines = ["| where | the paper says | here | for spheres | for real balloons |", "|---|---|---|---|---|"]
    lines += [
        f"| {s.place} | {s.says} | {s.here} | {_verdict(s)} | {s.real.words if s.real else '–'} |"
        for s in section
    ]
    return "\n".join(lines) + "\n"


def _verdict(statement: Statement) -> str:
    if statement.verdict == VERDICTS[1]:
        return f"{statement.verdict}: *{statement.reading}*"
    return f"**{statement.verdict}**" if statement.verdict == VERDICTS[2] else statement.verdict


def _misprints(cases: dict[str, Case]) -> str:
    lines = ["| where | printed | to be read | evidence |", "|---|---|---|---|"]
    found = [*formulation.misprints(), *inflation.misprints(cases), *unequal.misprints(cases)]
    lines += [f"| {m.place} | {m.printed} | {m.meant} | {m.evidence} |" for m in found if m.is_proved]
    return "\n".join(lines) + "\n"
