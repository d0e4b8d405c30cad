"""The page `docs/accuracy.md`: every number in it is computed from the rows of one run."""

from __future__ import annotations

import math
import os
import platform
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np

from simulator.accuracy.left_out import Anatomy
from simulator.accuracy.study import DEFAULT, SCIPY_DAE, SIMULATOR, UNPOLISHED, VISCOUS, Row

_ROUNDING = 1e-13  # errors below this tell nothing of a convergence order
_ERRORS = {
    "limit_voltage_error": "limit-point voltage",
    "limit_state_error": "limit-point states",
    "landing_error": "landing",
    "state_error": "sampled states",
    "work_error": "work",
}


@dataclass(frozen=True)
class Subject:
    """A scenario of the comparison: its name, its title, and whether its history ends by a loss of tension."""

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
    libraries = ", ".join(
        f"{name} {found}"
        for name in ("numpy", "scipy", "scikit-sundae", "scipy-dae")
        if (found := _version(name))
    )
    return (
        f"{model}, {os.cpu_count()} cores, {platform.system()}; Python {platform.python_version()}, "
        f"{libraries}, SUNDIALS {sksundae.SUNDIALS_VERSION}"
    )


def _version(name: str) -> str:
    try:
        return version(name)
    except ImportError:  # the optional one is not installed
        return ""


def page(rows: Sequence[Row], subjects: Sequence[Subject], anatomies: Sequence[Anatomy], where: str) -> str:
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
    return "\n".join(
        [
            _head(subjects, where),
            _simulator(rows, subjects),
            _unpolished(rows, subjects),
            _viscous(rows, subjects),
            _side_by_side(rows, subjects),
            _DEFINITIONS,
            _left_out(anatomies),
        ]
    )


def _head(subjects: Sequence[Subject], where: str) -> str:
    command = "balloons accuracy"
    names = ", ".join(f"`{subject.name}`" for subject in subjects)
    return f"""\
# How wrong, how slow

Errors against run time, of this simulator and of what one would write instead, on the scenarios {names}.
This page, its figure and [accuracy.csv](accuracy.csv) are written by `{command}`, which takes a few minutes; no number
here is typed by hand. The errors are the same every time. **Times compare within this one run only**: they were
taken on one shared machine, in processor time, as medians of repetitions interleaved between all methods.

Machine: {where}.

The exact solution is the closed form of the sealed pair, `simulator/exact.py`: every equilibrium to rounding, without
a solver. It shares nothing with the simulator but the elastomers' strain energies, and is itself held against
40-digit arithmetic by the tests.

![Errors over processor time](figures/accuracy.svg)

*{subjects[0].title}. Each line joins the tolerances of one method; δ is the relaxation time of the viscous equations
over the duration of the ramp. Below 1e-16 a point is drawn at 1e-16.*
"""


def _simulator(rows: Sequence[Row], subjects: Sequence[Subject]) -> str:
    found = [row for row in rows if row.method == SIMULATOR]
    failed = [row for row in found if row.failure]
    tolerances = sorted({row.rtol for row in found}, reverse=True)
    resting = {subject.name for subject in subjects if not subject.loses_tension}
    lines = [
        "| `solver.rtol` | limit-point voltage | limit-point states | landing, at rest | landing, tension lost "
        "| sampled states | work | IDA steps | residual calls | time |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for rtol in tolerances:
        here = [row for row in found if row.rtol == rtol]
        at_rest = [row for row in here if row.scenario in resting]
        slack = [row for row in here if row.scenario not in resting]
        cells = [
            _worst(here, "limit_voltage_error"),
            _worst(here, "limit_state_error"),
            _worst(at_rest, "landing_error"),
            _worst(slack, "landing_error"),
            _worst(here, "state_error"),
            _worst(here, "work_error"),
            _range(row.steps for row in here if not row.failure),
            _range(row.calls for row in here if not row.failure),
            f"{_relative_time(rows, here, subjects):.2f}",
        ]
        name = f"**{rtol:.0e}** (default)" if rtol == DEFAULT else f"{rtol:.0e}"
        lines.append(f"| {name} | {' | '.join(cells)} |")
    states = ("limit_voltage_error", "limit_state_error", "state_error")
    floor = max(_numbers(found, *states), default=math.nan)
    work = max(_numbers(found, "work_error"), default=math.nan)
    landing = max(_numbers([r for r in found if r.scenario in resting], "landing_error"), default=math.nan)
    text = f"""\
## The simulator

The largest errors over all scenarios. Time is relative to the default's, a geometric mean over the scenarios.

{_joined(lines)}

**The floor.** IDA only supplies points on the path and the neighbourhood of an event; Newton's method puts all of
them on the equations. So voltages and states of limit points, sampled states ({floor:.0e} at most) and landings at
rest ({landing:.0e}) are rounding at every tolerance, and there is no order to speak of. Two numbers are more than
a solution of equations. Work is a quadrature between IDA's points, with {work:.0e} at the loosest. And where a snap loses
its tension on the way, the state there depends on the flow, which is then integrated at 1e-11 whatever `solver.rtol`
says, and in the reference at 1e-10.

"""
    return text + _why_default(rows, found, tolerances, subjects) + _failures(failed)


def _why_default(
    rows: Sequence[Row], found: Sequence[Row], tolerances: Sequence[float], subjects: Sequence[Subject]
) -> str:
    if DEFAULT not in tolerances or len(tolerances) < 2:
        return ""
    times = {
        rtol: _relative_time(rows, [r for r in found if r.rtol == rtol], subjects) for rtol in tolerances
    }
    works = {
        rtol: max(_numbers([r for r in found if r.rtol == rtol], "work_error"), default=math.nan)
        for rtol in tolerances
    }
    loosest, tightest = tolerances[0], tolerances[-1]
    return f"""\
**The default, {DEFAULT:.0e}.** It is chosen for reliability at the least cost, not for accuracy, which it does not set.
Loosening it to {loosest:.0e} changes the time by a factor of {times[loosest]:.2f} and the error of the work from \
{works[DEFAULT]:.0e} to {works[loosest]:.0e}; tightening
it to {tightest:.0e} multiplies the time by {times[tightest]:.1f} and leaves every other error where it is.
"""


def _unpolished(rows: Sequence[Row], subjects: Sequence[Subject]) -> str:
    methods = [m for m in (UNPOLISHED, SCIPY_DAE) if any(row.method == m for row in rows)]
    parts = [
        """\
## The same equations without the polish

IDA's own states, its own root finder at the events, its own landings, on the same arclength equations; read off by
the cubics through its points. Also Radau of the package scipy_dae in place of IDA."""
        + ("" if SCIPY_DAE in methods else " (It is not installed here, and left out.)")
    ]
    for method in methods:
        found = [row for row in rows if row.method == method]
        tolerances = sorted({row.rtol for row in found}, reverse=True)
        lines = [
            f"| {method}: rtol | {' | '.join(s.name for s in subjects)} |",
            "|---" * (len(subjects) + 1) + "|",
        ]
        for rtol in tolerances:
            cells = [_cell(_one(found, subject.name, rtol)) for subject in subjects]
            lines.append(f"| {rtol:.0e} | {' | '.join(cells)} |")
        orders = [
            f"{label} {_orders(found, subjects, column)}"
            for column, label in _ERRORS.items()
            if _orders(found, subjects, column)
        ]
        lost = [row for row in found if row.failure]
        parts.append(f"""\
Relative error of the limit-point voltage:

{_joined(lines)}

Measured orders (error ∝ rtol^k, least squares over the tolerances, the range over the scenarios): {"; ".join(orders)}.
{len(lost)} of {len(found)} runs went wrong{_reasons(lost)}.
""")
    parts.append("""\
A snap that starts from a limit point known to the tolerance only may fall back, with no error from any solver: it is
found here because the exact history says otherwise. That, and not the digits, is what the polish is for.
""")
    return "\n\n".join(parts)


def _viscous(rows: Sequence[Row], subjects: Sequence[Subject]) -> str:
    found = [row for row in rows if row.method in VISCOUS]
    delays = sorted({row.delay for row in found}, reverse=True)
    tolerances = sorted({row.rtol for row in found})
    if not found:
        return ""
    lines = [
        f"| δ | {' | '.join(s.name for s in subjects)} | " + " | ".join(f"time, {m}" for m in VISCOUS) + " |",
        "|---" * (len(subjects) + 1 + len(VISCOUS)) + "|",
    ]
    for delay in delays:
        here = [row for row in found if row.delay == delay]
        cells = [_delay_error([r for r in here if r.scenario == s.name]) for s in subjects]
        times = [_cheapest(rows, [r for r in here if r.method == m], subjects) for m in VISCOUS]
        lines.append(f"| {delay:.0e} | {' | '.join([*cells, *times])} |")
    powers = [
        p for s in subjects if not math.isnan(p := _delay_power([r for r in found if r.scenario == s.name]))
    ]
    lost = [row for row in found if row.failure]
    scaling = (
        f"It grows as δ^{min(powers):.2f} to δ^{max(powers):.2f}: the passage of a fold is late by the power 2/3 of "
        "the ramp's rate (times a logarithm-free constant), and then takes its time ∝ δ."
        if powers
        else ""
    )
    return f"""\
## The viscous equations, by SciPy

    τ dλᵢ/dt = −gᵢ(λ, φ(t)),   p = n/V − pₑ,   τ = δ T

with T the duration of the scenario's first ramp and g in units of the elastic stress, as in [physics.md](physics.md);
the voltage goes through the scenario's own ramps, holds and jumps in its own time. Solved by `solve_ivp` with `rtol` from
{tolerances[-1]:.0e} to {tolerances[0]:.0e}, `atol` a hundredth of it, SciPy's finite-difference Jacobians and an event for p = 0. \
Inflation is a gift: they start
from the exact sealed state. There is no event for a limit point, so its voltage is read off where the stretch jumps: on a ramp, a
snap is a run of the solver's steps in which a stretch changes at more than 30 per ramp duration; its voltage is that in
the middle of the fastest step; it has landed where the rate has fallen below 3.

Relative error of the limit-point voltage at the tightest tolerance that came through, and the time of the cheapest run within 10 %
of it, over the simulator's at its default (geometric mean over the scenarios):

{_joined(lines)}

This error is all delay: no tolerance takes it away. {scaling}
{len(lost)} of {len(found)} runs went wrong{_reasons(lost)}. At loose tolerances these solvers are quicker than the
simulator, and a few digits of a limit point may be all that is wanted.
"""


def _side_by_side(rows: Sequence[Row], subjects: Sequence[Subject]) -> str:
    parts = ["## Side by side\n"]
    header = ["method", "rtol", *_ERRORS.values(), "steps", "calls", "ms"]
    for subject in subjects:
        here = [row for row in rows if row.scenario == subject.name]
        lines = [f"| {' | '.join(header)} |", "|---" * len(header) + "|"]
        for row in here:
            wanted = DEFAULT if row.method not in VISCOUS else 1e-6
            tight = row.method in VISCOUS and row.delay == min(r.delay for r in here if r.method in VISCOUS)
            if not math.isclose(row.rtol, wanted) or not (tight or row.method not in VISCOUS):
                continue
            name = row.method if math.isnan(row.delay) else f"viscous, {row.method}, δ = {row.delay:.0e}"
            if row.failure:
                blank = " | ".join(["–"] * (len(_ERRORS) - 1))
                lines.append(f"| {name} | {row.rtol:.0e} | {row.failure} | {blank} | – | – | – |")
                continue
            cells = [_number(getattr(row, column)) for column in _ERRORS]
            cells += [str(row.steps), str(row.calls), f"{row.milliseconds:.1f}"]
            lines.append(f"| {name} | {row.rtol:.0e} | {' | '.join(cells)} |")
        parts.append(f"`{subject.name}`: {subject.title}\n\n{_joined(lines)}\n")
    return "\n".join(parts)


_DEFINITIONS = """\
## What the numbers are

- *Limit-point voltage*: |φ − φ_exact|/|φ_exact|, the largest over the history's limit points.
- *Limit-point states, landing, sampled states*: the largest of |λᵢ − λᵢ,exact|/λᵢ,exact and |p − p_exact| in μH/R, over the states at
  which a branch ends, those the snaps come to, and the samples that the scenario asks for (101 a step). A landing at
  rest is an equilibrium; where tension is lost on the way, it is the state at p = 0. Samples between the exact limit point and
  where a method puts it are on the other side of the snap and are left out: that error is told by the voltage.
- *Work*: ∫φ dq over the whole history, relative. The reference needs no quadrature: it is what is stored, plus Π before
  less Π after each jump.
- *Time*: processor time from the scenario to the whole history with its samples. The simulator's includes the inflation, the
  energy books and the stability of every sample, and so do the unpolished ones' their inflation (by the simulator).
- *Steps, calls*: of the integrators, and of their residuals or right-hand sides. Newton's method in the polish is not among
  them; its time is.
- A run *goes wrong* where its solver gives up or its limit points are not those of the exact history, one for one.
"""


def _left_out(anatomies: Sequence[Anatomy]) -> str:
    if not anatomies:
        return ""
    lines = [
        "| scenario | sets of equations | unknowns / event functions | IDA solves | steps | residual calls | libraries loaded | time |",
        "|---|---|---|---|---|---|---|---|",
    ]
    unit = next((a.milliseconds for a in anatomies if a.solves), anatomies[0].milliseconds)
    for a in anatomies:
        sizes = ", ".join(f"{unknowns} / {events}" for unknowns, events in a.sets) or "none"
        lines.append(
            f"| {a.title} | {a.equations} | {sizes} | {a.solves} | {a.steps} | {a.calls} "
            f"| {', '.join(_principal(a.libraries))} | {a.milliseconds / unit:.2f} |"
        )
    common = set(anatomies[0].modules).intersection(*(a.modules for a in anatomies))
    rooms = sorted({name.partition(".")[0] for name in common})
    others = sorted({name for a in anatomies for name in a.modules} - common)
    differ = f"besides, in some: {', '.join(others)}" if others else "the same for all of them"
    return f"""\
## What is left out, measured

Each scenario has more in it than the one before. What is assembled is what is named: unknowns (the drive among them) and event functions of each
different set of equations, and what IDA then did. Time is that of `simulate`, over the first scenario with
anything to integrate.

{_joined(lines)}

A balloon by itself has no gas law and no pressure among its unknowns, and no loss of tension to look for; without a
strength there is no breakdown to look for; equal balloons share one set of equations while the valve is open; a hold
assembles nothing, and where nothing moves the integrator is not even loaded. Ten cycles cost the integration of one: they run on
branches that are known already, and a sample is an interpolation and Newton's method.

Modules of the package loaded by `simulate` in a fresh process, {differ}: {", ".join(rooms)}.
Not among them: `exact`, `accuracy`, `trace`, `fold`, `export`, `plot`, `figures`, `paper`, `explanation`, `terminal`, `cli`; of libraries,
pandas, matplotlib, typer and rich. scipy comes with scikit-sundae. The tests hold these sets, name by name.
"""


def _principal(libraries: Iterable[str]) -> list[str]:
    """Libraries without those that only their own dependants import."""
    own = {"annotated_types", "pydantic_core", "typing_extensions", "typing_inspection", "cython_runtime"}
    return sorted(set(libraries) - own)


# -- numbers ---------------------------------------------------------------------------------------------


def _joined(lines: Sequence[str]) -> str:
    return "\n".join(lines)


def _number(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:.1e}"


def _numbers(rows: Iterable[Row], *columns: str) -> list[float]:
    values = [float(getattr(row, column)) for row in rows for column in columns]
    return [value for value in values if not math.isnan(value)]


def _worst(rows: Iterable[Row], column: str) -> str:
    return _number(max(_numbers(rows, column), default=math.nan))


def _range(values: Iterable[int]) -> str:
    found = sorted(values)
    if not found:
        return "–"
    return str(found[0]) if found[0] == found[-1] else f"{found[0]}–{found[-1]}"


def _one(rows: Iterable[Row], scenario: str, rtol: float) -> Row | None:
    return next((row for row in rows if row.scenario == scenario and row.rtol == rtol), None)


def _cell(row: Row | None) -> str:
    if row is None:
        return "–"
    return (
        "falls back"
        if "falls back" in row.failure
        else "fails"
        if row.failure
        else _number(row.limit_voltage_error)
    )


def _relative_time(rows: Sequence[Row], chosen: Sequence[Row], subjects: Sequence[Subject]) -> float:
    """Geometric mean over the scenarios of the times over the simulator's at its default (or at its nearest)."""
    ratios = []
    for subject in subjects:
        own = [r for r in rows if r.method == SIMULATOR and r.scenario == subject.name and not r.failure]
        times = [r.milliseconds for r in chosen if r.scenario == subject.name and not r.failure]
        if own and times:
            default = min(own, key=lambda r: abs(math.log(r.rtol / DEFAULT)))
            ratios.append(min(times) / default.milliseconds)
    return statistics.geometric_mean(ratios) if ratios else math.nan


def order(rtols: Sequence[float], found: Sequence[float]) -> float:
    """k in error ∝ rtol^k by least squares; NaN from fewer than three errors above rounding."""
    points = [(math.log(r), math.log(e)) for r, e in zip(rtols, found, strict=True) if e > _ROUNDING]
    if len(points) < 3:
        return math.nan
    x, y = np.array(points).T
    return float(np.polyfit(x, y, 1)[0])


def _orders(rows: Sequence[Row], subjects: Sequence[Subject], column: str) -> str:
    orders = []
    for subject in subjects:
        here = [r for r in rows if r.scenario == subject.name and not math.isnan(getattr(r, column))]
        found = order([r.rtol for r in here], [getattr(r, column) for r in here])
        if not math.isnan(found):
            orders.append(found)
    return f"{min(orders):.2f} to {max(orders):.2f}" if orders else ""


def _tightest(rows: Sequence[Row]) -> list[Row]:
    """Of each method, the run at the tightest tolerance that came through."""
    good = [row for row in rows if not row.failure]
    methods = dict.fromkeys(row.method for row in good)
    return [min((r for r in good if r.method == m), key=lambda r: r.rtol) for m in methods]


def _delay_error(rows: Sequence[Row]) -> str:
    found = _numbers(_tightest(rows), "limit_voltage_error")
    return _number(statistics.median(found)) if found else "–"


def _delay_power(rows: Sequence[Row]) -> float:
    """k in error ∝ δ^k of one scenario, between the smallest and the largest δ."""
    delays = sorted({row.delay for row in rows})
    found = [
        (delay, statistics.median(errors))
        for delay in delays
        if (errors := _numbers(_tightest([r for r in rows if r.delay == delay]), "limit_voltage_error"))
    ]
    if len(found) < 2:
        return math.nan
    (d0, e0), (d1, e1) = found[0], found[-1]
    return math.log(e1 / e0) / math.log(d1 / d0)


def _cheapest(rows: Sequence[Row], chosen: Sequence[Row], subjects: Sequence[Subject]) -> str:
    """Time of the cheapest runs of a method whose limit-point error is within 10 % of its tightest run's."""
    best = []
    for subject in subjects:
        here = [row for row in chosen if row.scenario == subject.name and not row.failure]
        if here:
            limit = min(here, key=lambda r: r.rtol).limit_voltage_error
            close = [row for row in here if abs(row.limit_voltage_error - limit) <= 0.1 * limit]
            best.append(min(close, key=lambda r: r.milliseconds))
    ratio = _relative_time(rows, best, subjects)
    return "–" if math.isnan(ratio) else f"{ratio:.2f}"


def _reasons(rows: Sequence[Row]) -> str:
    if not rows:
        return ""
    counts: dict[str, int] = {}
    for row in rows:
        reason = (
            "other limit points than the exact ones"
            if row.failure.startswith("limit points")
            else row.failure
        )
        counts[reason] = counts.get(reason, 0) + 1
    return ": " + "; ".join(f"{count} × {reason.rstrip('.')}" for reason, count in counts.items())


def _failures(rows: Sequence[Row]) -> str:
    if not rows:
        return "No run of the simulator failed, and none took another history than the exact one.\n"
    lines = [f"- `{row.scenario}` at {row.rtol:.0e}: {row.failure}" for row in rows]
    return "\n**Runs of the simulator that went wrong:**\n\n" + "\n".join(lines) + "\n"
