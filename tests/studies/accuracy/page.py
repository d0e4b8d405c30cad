"""The page `docs/accuracy.md`: every number in it is computed from the rows of one run."""

from __future__ import annotations

import math
import os
import platform
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from tests.studies.accuracy import digest
from tests.studies.accuracy.left_out import Anatomy
from tests.studies.accuracy.study import DEFAULT, SCIPY_DAE, SIMULATOR, UNPOLISHED, VISCOUS, Row

_ERRORS = {
    "limit_voltage_error": "limit-point voltage",
    "limit_state_error": "limit-point states",
    "landing_error": "landing",
    "state_error": "sampled states",
    "work_error": "work",
}
_SHOWN = 1e-6  # tolerance of the viscous runs in the tables side by side


@dataclass(frozen=True)
class Subject:
    """A scenario of the comparison: its name, its title, and whether its history ends by losing tension."""

    name: str
    title: str
    loses_tension: bool


def machine() -> str:
    """Processor, cores and versions, one line."""
    import sksundae

    model = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text("utf-8").splitlines()
        model = next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        pass
    packages = ("numpy", "scipy", "scikit-sundae", "scipy-dae")
    libraries = ", ".join(f"{name} {found}" for name in packages if (found := _version(name)))
    return (
        f"{model}, {os.cpu_count()} cores, {platform.system()}; Python {platform.python_version()}, "
        f"{libraries}, SUNDIALS {sksundae.SUNDIALS_VERSION}"
    )


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:  # the optional one
        return ""


def accuracy_page(
    rows: Sequence[Row], subjects: Sequence[Subject], anatomies: Sequence[Anatomy], where: str
) -> str:
    """The page.

    Parameters
    ----------
    rows : sequence of Row
        From `study.measure`.
    subjects : sequence of Subject
        The scenarios, in the order of the tables; the figure is of the first.
    anatomies : sequence of Anatomy
        From `left_out.anatomies`.
    where : str
        The machine and versions.
    """
    parts = [
        _head(subjects, where),
        _simulator(rows, subjects),
        _unpolished(rows, subjects),
        _viscous(rows, subjects),
        _side_by_side(rows, subjects),
        _DEFINITIONS,
        _left_out(anatomies),
    ]
    return _wrapped("\n".join(part for part in parts if part))


def _head(subjects: Sequence[Subject], where: str) -> str:
    names = ", ".join(f"`{subject.name}`" for subject in subjects)
    return f"""\
# How wrong, how slow

Errors against run time, of this simulator and of what one would write instead, on the scenarios {names}.
This page, its figure and [accuracy.csv](accuracy.csv) are written by `make accuracy`; no number here is typed by
hand. The errors are the same in every run. **Times compare within this one run only**: it was taken on one shared
machine, in processor time, as medians of repetitions interleaved between all methods.

Machine: {where}.

The exact solution is the closed form of the sealed pair, `tests.oracle.closed_form`: every equilibrium to rounding, without a
path to follow. It shares nothing with the simulator but the elastomers' strain energies, and the tests hold it against
40-digit arithmetic.

![Errors over processor time](figures/accuracy.svg)

*{subjects[0].title}. Each line joins the tolerances of one method; δ is the relaxation time of the viscous equations
over the duration of the first ramp. An error below 1e-16 is drawn at 1e-16. A line is broken where a run went wrong.*
"""


def _simulator(rows: Sequence[Row], subjects: Sequence[Subject]) -> str:
    own = [row for row in rows if row.method == SIMULATOR]
    resting = {subject.name for subject in subjects if not subject.loses_tension}
    at_rest = [row for row in own if row.scenario in resting]
    again = digest.followed_again(own)
    body = []
    for rtol in _falling(own):
        here, there = _at(own, rtol), _at(at_rest, rtol)
        slack = [row for row in here if row.scenario not in resting]
        body.append(
            [
                f"**{rtol:.0e}** (default)" if rtol == DEFAULT else f"{rtol:.0e}",
                _number(digest.worst(here, "limit_voltage_error")),
                _number(digest.worst(here, "limit_state_error")),
                _number(digest.worst(there, "landing_error")),
                _number(digest.worst(slack, "landing_error")),
                _number(digest.worst(here, "state_error")),
                _number(digest.worst(here, "work_error")),
                _range(row.steps for row in here if not row.failure),
                _range(row.calls for row in here if not row.failure),
                str(again.get(rtol, "–")),
                _ratio(digest.relative_time(rows, here)),
            ]
        )
    header = [
        "`solver.rtol`",
        *list(_ERRORS.values())[:2],
        "landing, at rest",
        "landing, tension lost",
        *list(_ERRORS.values())[3:],
        "IDA steps",
        "residual calls",
        "pieces followed again",
        "time",
    ]
    polished = digest.worst(own, "limit_voltage_error", "limit_state_error", "state_error")
    landing = digest.worst(at_rest, "landing_error")
    return f"""\
## The simulator

The largest errors over all scenarios. Time is over that at the default, a geometric mean over the scenarios.

{_table(header, body)}

**The floor.** IDA only supplies points near the path and the neighbourhoods of its events; Newton's method puts them on
the equations. So the limit points and the sampled states ({_number(polished)} at most), and the landings at rest
({_number(landing)}), are at rounding at every tolerance, and there is no order to speak of. Two numbers are more than
solutions of equations. The work is a quadrature between the points of the path, {_number(digest.worst(own, "work_error"))} at most.
And where a snap loses its tension on the way, that state depends on the flow. The simulator integrates it at 1e-12 whatever
`solver.rtol` says, the reference at 1e-10; their difference is the column *tension lost*.

{_why_default(rows, own, again)}{_failed(own)}"""


def _why_default(rows: Sequence[Row], own: Sequence[Row], again: dict[float, int]) -> str:
    tolerances = _falling(own)
    if DEFAULT not in tolerances or len(tolerances) < 2:
        return ""
    times = {rtol: digest.relative_time(rows, _at(own, rtol)) for rtol in tolerances}
    works = {rtol: digest.worst(_at(own, rtol), "work_error") for rtol in tolerances}
    loosest, tightest = tolerances[0], tolerances[-1]
    clean = [rtol for rtol in tolerances if not any(again.get(r, 0) for r in tolerances if r <= rtol)]
    retried = (
        f"From {max(clean):.0e} on no piece of path of these scenarios has to be followed a second time, tighter, because "
        "its points do not pass the checks."
        if clean
        else "At every tolerance some piece of path had to be followed a second time."
    )
    return f"""\
**The default, {DEFAULT:.0e},** does not set the accuracy. It is the loosest round number with room to spare in the path's
checks: {retried[0].lower()}{retried[1:]} At {loosest:.0e} the time is {_ratio(times[loosest])} of the default's and the error of the work
{_number(works[loosest])} in place of {_number(works[DEFAULT])}; at {tightest:.0e} the time is {_ratio(times[tightest])} times as long, for errors that were at their floor before.

"""


def _failed(own: Sequence[Row]) -> str:
    lines = [f"- `{row.scenario}` at {row.rtol:.0e}: {row.failure}" for row in own if row.failure]
    if not lines:
        return f"None of these {len(own)} runs failed or took another history than the exact one.\n"
    return "**Runs that went wrong:**\n\n" + "\n".join(lines) + "\n"


def _unpolished(rows: Sequence[Row], subjects: Sequence[Subject]) -> str:
    methods = [m for m in (UNPOLISHED, SCIPY_DAE) if any(row.method == m for row in rows)]
    also = (
        "Also Radau of the package scipy_dae in IDA's place along the path (its snaps are IDA's)."
        if SCIPY_DAE in methods
        else "(The package scipy_dae, which would be another integrator, is not installed here.)"
    )
    parts = [
        f"""\
## The same equations, not polished

IDA's own states, its own root finder at the events, its own landings, on the same arclength equations; states in between
are read off the cubics through its points. A snap is started off its limit point along the soft mode, by a stretch of 0.01 or
√rtol if that is more. {also}
"""
    ]
    for method in methods:
        found = [row for row in rows if row.method == method]
        body = []
        for rtol in _falling(found):
            cells = [_cell(_at([r for r in found if r.scenario == s.name], rtol)) for s in subjects]
            body.append([f"{rtol:.0e}", *cells, _ratio(digest.relative_time(rows, _at(found, rtol)))])
        table = _table(["rtol", *(s.name for s in subjects), "time"], body)
        measured = {label: digest.orders(found, column) for column, label in _ERRORS.items()}
        orders = "; ".join(f"{label} {_span(ks)}" for label, ks in measured.items() if ks)
        parts.append(f"""\
*{method}.* Relative error of the limit-point voltage, and time over the simulator's at its default:

{table}

Measured orders k, error ∝ rtol^k, over the scenarios: {orders or "too few errors above rounding"}.
{_went_wrong(found)}
""")
    parts.append("""\
Where it says *falls back*, a snap that started from a limit point known only to the tolerance came to rest on the branch
that it had just left. No solver reports an error there; whether a snap has left its branch must be looked at, as it is here and in the simulator. That,
more than the digits, is what the polish is for.
""")
    return "\n".join(parts)


def _viscous(rows: Sequence[Row], subjects: Sequence[Subject]) -> str:
    found = [row for row in rows if row.method in VISCOUS]
    if not found:
        return ""
    body = []
    for delay in sorted({row.delay for row in found}, reverse=True):
        here = [row for row in found if row.delay == delay]
        errors = [digest.delay_error([r for r in here if r.scenario == s.name]) for s in subjects]
        times = [
            digest.relative_time(rows, digest.cheapest([r for r in here if r.method == m])) for m in VISCOUS
        ]
        body.append([f"{delay:.0e}", *map(_number, errors), *map(_ratio, times)])
    table = _table(["δ", *(s.name for s in subjects), *(f"time, {m}" for m in VISCOUS)], body)
    powers = [digest.delay_power([r for r in found if r.scenario == s.name]) for s in subjects]
    powers = sorted(k for k in powers if not math.isnan(k))
    scaling = (
        f"It goes as δ^k with k = {_span(powers)} over the scenarios; 2/3 is what passing a fold slowly makes of it, and the "
        "time of the snap itself adds a part ∝ δ."
        if powers
        else ""
    )
    quickest = min(VISCOUS, key=lambda m: digest.mean_time([row for row in found if row.method == m]))
    tolerances = _falling(found)
    return f"""\
## The viscous equations, by SciPy

    τ dλᵢ/dt = −gᵢ(λ, φ(t)),   p = n/V − pₑ,   τ = δ T

T is the duration of the scenario's first ramp, t its time, g as in [physics.md](physics.md). The voltage takes the scenario's
own ramps, holds and jumps at its own rate. Solved by SciPy's `solve_ivp` with `rtol` from {tolerances[0]:.0e} to {tolerances[-1]:.0e}, `atol` a
hundredth of it, its finite-difference Jacobians, dense output, and an event for p = 0. Inflation is a gift: the runs start
from the exact sealed state. There is no event for a limit point, so it is read off where the stretch jumps: on a ramp,
a snap is a run of steps in which a stretch changes faster than 30 per duration of the ramp. Its voltage is that in the
middle of the fastest step, and it has landed where the rate has fallen below 3.

Relative error of the limit-point voltage at the tightest tolerance that came through (median of the three solvers), and the time of
the cheapest runs within 10 % of it, over the simulator's at its default:

{table}

This error is all delay; no tolerance takes it away. {scaling}
{_went_wrong(found)} Where a delay of this size is good enough, {quickest} is the quickest way to it.
"""


def _side_by_side(rows: Sequence[Row], subjects: Sequence[Subject]) -> str:
    viscous = [row.delay for row in rows if row.method in VISCOUS]
    header = ["method", "rtol", *_ERRORS.values(), "steps", "calls", "ms"]
    parts = [
        f"""\
## Side by side

At `rtol` {DEFAULT:.0e}, the viscous equations at {_SHOWN:.0e} and the smallest δ.
"""
    ]
    for subject in subjects:
        body = []
        for row in (row for row in rows if row.scenario == subject.name):
            if row.method in VISCOUS:
                wanted = math.isclose(row.rtol, _SHOWN) and row.delay == min(viscous)
                name = f"viscous, {row.method}, δ = {row.delay:.0e}"
            else:
                wanted, name = math.isclose(row.rtol, DEFAULT), row.method
            if wanted and row.failure:
                body.append([name, f"{row.rtol:.0e}", row.failure, *["–"] * (len(header) - 3)])
            elif wanted:
                errors = [_number(getattr(row, column)) for column in _ERRORS]
                cost = [str(row.steps), str(row.calls), f"{row.milliseconds:.1f}"]
                body.append([name, f"{row.rtol:.0e}", *errors, *cost])
        parts.append(f"\n`{subject.name}`: {subject.title}\n\n{_table(header, body)}\n")
    return "\n".join(parts)


_DEFINITIONS = """\
## What the numbers are

- *Limit-point voltage*: |φ − φ_exact|/|φ_exact|, the largest over the history's limit points.
- *Limit-point states, landing, sampled states*: the largest of |λᵢ − λᵢ,exact|/λᵢ,exact and |p − p_exact| (in μH/R), over the
  states at which a branch ends, those that the snaps come to, and the samples that the scenario asks for. A landing at rest is
  an equilibrium; where tension is lost on the way, it is the state at p = 0. Samples between the exact limit point and
  where a method puts it are on the other side of the snap, and left out: that error is told by the voltage. The viscous
  equations have no state of rest at a limit point to compare with.
- *Work*: ∫φ dq over the whole history, relative. The reference needs no quadrature: it is the change of Π + φq, plus Π
  before less Π after each jump.
- *Time*: processor time from the scenario to the whole history with its samples. The simulator's includes inflation, energy
  books, and the stability of every sample; the unpolished runs' includes inflation (by the simulator).
- *Steps, calls*: of the integrators, and of their residuals or right-hand sides. Newton's method in the polish is not
  among the calls; its time is.
- *Pieces followed again*: IDA solves beyond the fewest that the scenario was followed in at any tolerance.
- A run *went wrong* where its solver gave up, or its limit points are not those of the exact history one for one.
"""


def _left_out(anatomies: Sequence[Anatomy]) -> str:
    if not anatomies:
        return ""
    unit = next((a.milliseconds for a in anatomies if a.solves), anatomies[0].milliseconds)
    body = [
        [
            a.title,
            str(a.equations),
            ", ".join(f"{unknowns} / {events}" for unknowns, events in a.sets) or "none",
            str(a.solves),
            str(a.steps),
            str(a.calls),
            ", ".join(_principal(a.libraries)),
            _ratio(a.milliseconds / unit),
        ]
        for a in anatomies
    ]
    header = ["scenario", "sets of equations", "unknowns / event functions", "IDA solves", "steps"]
    table = _table([*header, "residual calls", "libraries loaded", "time"], body)
    common = set(anatomies[0].modules).intersection(*(a.modules for a in anatomies))
    others = sorted({name for a in anatomies for name in a.modules} - common)
    also = (
        f", and in some of them {', '.join(f'`{name}`' for name in others)}"
        if others
        else ", in all of them alike"
    )
    rooms = ", ".join(f"`{name}`" for name in sorted({name.partition(".")[0] for name in common}))
    return f"""\
## What is left out, measured

Each scenario has more in it than the one before. Unknowns (the drive among them) and event functions are those of each
different set of equations; IDA's counts are those of one run; time is that of `simulate`, over the first scenario with
anything to integrate.

{table}

A balloon by itself has no pressure among its unknowns, no gas law, and no loss of tension to watch for; without a strength there is
no breakdown to watch for; with the valve open, equal balloons share one set of equations. A hold assembles nothing, and where nothing moves the
integrator is not even loaded. Cycles run on branches that are known already: ten of them integrate what one does, and the rest
is reading samples off.

Modules of the package that `load_scenario` and `simulate` load in a fresh process{also}: {rooms}. Not among them: `exact`,
`accuracy`, `trace`, `fold`, `explanation`, `export`, `plot`, `figures`, `paper`, `terminal`, `cli`; nor are pandas, matplotlib, typer
and rich. scipy is loaded by scikit-sundae. The tests hold these sets name by name.
"""


def _principal(libraries: Iterable[str]) -> list[str]:
    """Libraries without those that only other libraries import."""
    inner = {"annotated_types", "pydantic_core", "typing_extensions", "typing_inspection", "cython_runtime"}
    return sorted(set(libraries) - inner)


# -- words ---------------------------------------------------------------------------------------------


def _wrapped(text: str) -> str:
    """Paragraphs filled to the width of the other pages; numbers have no fixed length."""
    blocks = []
    for block in text.strip("\n").split("\n\n"):
        if block.startswith("- "):
            items = block.removeprefix("- ").split("\n- ")
            blocks.append("\n".join(f"- {_fill(item, '  ')}" for item in items))
        else:
            blocks.append(block if block.startswith(("|", "#", "!", "    ")) else _fill(block, ""))
    return "\n\n".join(blocks) + "\n"


def _fill(words: str, indent: str) -> str:
    return textwrap.fill(
        " ".join(words.split()), 118, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
    )


def _table(header: Sequence[str], body: Iterable[Sequence[str]]) -> str:
    lines = [header, ["---"] * len(header), *body]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def _falling(rows: Iterable[Row]) -> list[float]:
    return sorted({row.rtol for row in rows}, reverse=True)


def _at(rows: Iterable[Row], rtol: float) -> list[Row]:
    return [row for row in rows if row.rtol == rtol]


def _number(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:.1e}"


def _ratio(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:.2f}"


def _span(found: Sequence[float]) -> str:
    low, high = f"{found[0]:.2f}", f"{found[-1]:.2f}"
    return low if low == high else f"{low} to {high}"


def _range(found: Iterable[int]) -> str:
    ordered = sorted(found)
    if not ordered:
        return "–"
    return str(ordered[0]) if ordered[0] == ordered[-1] else f"{ordered[0]}–{ordered[-1]}"


def _cell(rows: Sequence[Row]) -> str:
    if not rows:
        return "–"
    if rows[0].failure:
        return "falls back" if "falls back" in rows[0].failure else "fails"
    return _number(rows[0].limit_voltage_error)


def _went_wrong(rows: Sequence[Row]) -> str:
    lost = sum(bool(row.failure) for row in rows)
    why = "; ".join(f"{count} × {reason}" for reason, count in digest.reasons(rows).items())
    return f"{lost} of {len(rows)} runs went wrong{': ' + why if why else ''}."
