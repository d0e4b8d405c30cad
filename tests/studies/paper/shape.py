"""Figure by figure and state by state: what holds for spheres, and what for real balloons."""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Mapping, Sequence

from tests.studies.paper.case import VERDICTS, Case, Statement
from tests.studies.paper.real import first_snap, losses_after, lost_before, passes_pears

_WORDS = {"limit_point": "limit point", "loss_of_tension": "tension lost", "stretch_limit": "stretch limit"}
_SPHERES: Mapping[Hashable, str] = dict(zip(VERDICTS, ("yes", "under a reading", "no"), strict=True))
_REAL: Mapping[Hashable, str] = {True: "yes", False: "no", None: "open"}

HEAD = """\
State by state: what the paper says of a rising voltage holds for a real balloon up to where its sphere is lost. The last
two columns are of the history of the scenario; s is the smaller one of the two balloons.

"""


def figure_table(everything: Sequence[Statement]) -> str:
    """A table with one row for each figure: how many of its statements hold for spheres, and for real balloons."""
    figures: dict[str, list[Statement]] = {}
    for statement in everything:
        if statement.place.startswith("Fig."):
            figures.setdefault(statement.place.split(",")[0], []).append(statement)
    lines = ["| figure | statements | for spheres | for real balloons |", "|---|---|---|---|"]
    for figure, found in figures.items():
        spheres = _counts([s.verdict for s in found], _SPHERES)
        real = _counts([s.real.holds for s in found if s.real is not None], _REAL)
        lines.append(f"| {figure} | {len(found)} | {spheres} | {real} |")
    return "\n".join(lines) + "\n"


def _counts(outcomes: Sequence[Hashable], words: Mapping[Hashable, str]) -> str:
    count = Counter(outcomes)
    return ", ".join(f"{count[outcome]} {word}" for outcome, word in words.items() if count[outcome]) or "–"


def shape_table(cases: dict[str, Case]) -> str:
    """A table with one row for each state of Figs. 3 and 5; Fig. 4 is that of 3c B."""
    lines = [
        "| state | spheres, voltage rising | real balloon, voltage rising | its snap | switched off |",
        "|---|---|---|---|---|",
    ]
    return "\n".join([*lines, *(_row(name, case) for name, case in cases.items())]) + "\n"


def _row(name: str, case: Case) -> str:
    end = case.peak or case.curve.end
    spheres = f"{_WORDS.get(end.kind, end.kind)} at φ = {end.voltage[0]:.8f}"
    lost = lost_before(case, end)
    if lost is None:
        real = "holds: a sphere up to there"
    else:
        real = f"**does not hold: sphere lost at φ = {lost.voltage[0]:.8f}, λ₁ = {lost.stretch[0]:.8f}**"
    history, snap = case.shaped, first_snap(case)
    landing = "none"
    if snap is not None:
        landing = "ends in loss of tension"
        if history.time[-1] > snap.time:
            margin = history.sphericity[int((history.time <= snap.time).sum()) - 1].min()
            landing = f"rests as {'spheres' if margin > 0.0 else 'no sphere'}, s = {margin:.2f}"
        if passes_pears(snap):
            landing += ", passes states that are no spheres"
    left = "the history has ended"
    if history.outcome == "completed":
        margin = history.sphericity[-1].min()
        left = f"{'spheres' if margin > 0.0 else 'no sphere'}, s = {margin:.2f}"
        if falling := losses_after(case, snap):
            left += f"; on the way sphere lost at φ = {falling[0].voltage[0]:.8f}"
    return f"| {name} | {spheres} | {real} | {landing} | {left} |"
