"""Whether what the spherical model says of each state holds for a real balloon, too."""

from __future__ import annotations

from simulator.events import EventKind
from simulator.simulation.run import simulate
from tests.studies.paper.case import Case

_WORDS = {"limit_point": "limit point", "loss_of_tension": "tension lost", "stretch_limit": "stretch limit"}

HEAD = """\
All of the above is about spheres, in the paper as here. A real balloon turns into a pear where its tension stops
rising with its stretch ([shape.md](shape.md)). What the paper says of a rising voltage holds for a real balloon up to
there. The last two columns are of the history of the scenario; s is the smaller one of the two balloons.

"""


def shape_table(cases: dict[str, Case]) -> str:
    """A table with one row for each state of Figs. 3 and 5; Fig. 4 is that of 3c B."""
    lines = [
        "| state | spheres, voltage rising | real balloon, voltage rising | after its snap | switched off |",
        "|---|---|---|---|---|",
    ]
    return "\n".join([*lines, *(_row(name, case) for name, case in cases.items())]) + "\n"


def _row(name: str, case: Case) -> str:
    end = case.peak or case.curve.end
    spheres = f"{_WORDS.get(end.kind, end.kind)} at φ = {end.voltage[0]:.8f}"
    inner = case.curve.points[: case.curve.points.index(end)]
    lost = next((point for point in inner if point.kind == "loss_of_sphericity"), None)
    if lost is None:
        real = "holds: a sphere up to there"
    else:
        real = f"**does not hold: sphere lost at φ = {lost.voltage[0]:.8f}, λ₁ = {lost.stretch[0]:.8f}**"
    history = simulate(case.scenario)
    snap = next((event for event in case.snaps if event.kind is EventKind.LIMIT_POINT), None)
    landing = "no snap that comes to rest"
    if snap is not None:
        row = int((history.time <= snap.time).sum()) - 1
        margin = history.sphericity[row].min()
        landing = f"rests as {'spheres' if margin > 0.0 else 'no sphere'}, s = {margin:.2f}"
    left = "the history has ended"
    if history.outcome == "completed":
        margin = history.sphericity[-1].min()
        falling = [
            event
            for event in history.events
            if event.kind is EventKind.LOSS_OF_SPHERICITY and snap is not None and event.time > snap.time
        ]
        left = f"{'spheres' if margin > 0.0 else 'no sphere'}, s = {margin:.2f}"
        if falling:
            left += f"; on the way sphere lost at φ = {falling[0].voltage[0]:.8f}"
    return f"| {name} | {spheres} | {real} | {landing} | {left} |"
