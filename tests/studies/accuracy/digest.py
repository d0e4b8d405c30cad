"""What rows of a study come to: worst errors, convergence orders, powers of the delay, ratios of times."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Sequence

import numpy as np

from tests.studies.accuracy.study import DEFAULT, SIMULATOR, Row

ROUNDING = 1e-13  # errors below this tell nothing of a convergence order


def values(rows: Iterable[Row], *columns: str) -> list[float]:
    """The numbers in some columns, without those that are none."""
    found = [float(getattr(row, column)) for row in rows for column in columns]
    return [value for value in found if not math.isnan(value)]


def worst(rows: Iterable[Row], *columns: str) -> float:
    """The largest number in some columns; NaN if there is none."""
    return max(values(rows, *columns), default=math.nan)


def order(rtols: Sequence[float], errors: Sequence[float]) -> float:
    """k in error ∝ rtol^k by least squares; NaN from fewer than three errors above rounding."""
    points = [(math.log(r), math.log(e)) for r, e in zip(rtols, errors, strict=True) if e > ROUNDING]
    if len(points) < 3:
        return math.nan
    x, y = np.array(points).T
    return float(np.polyfit(x, y, 1)[0])


def orders(rows: Sequence[Row], column: str) -> list[float]:
    """Convergence orders of one method, one for each scenario that has one, rising."""
    found = []
    for scenario in dict.fromkeys(row.scenario for row in rows):
        here = [r for r in rows if r.scenario == scenario and not math.isnan(getattr(r, column))]
        found.append(order([r.rtol for r in here], [getattr(r, column) for r in here]))
    return sorted(k for k in found if not math.isnan(k))


def tightest(rows: Sequence[Row]) -> list[Row]:
    """Of each method, the run at the tightest tolerance that came through."""
    good = [row for row in rows if not row.failure]
    methods = dict.fromkeys(row.method for row in good)
    return [min((r for r in good if r.method == m), key=lambda r: r.rtol) for m in methods]


def delay_error(rows: Sequence[Row]) -> float:
    """Error of the limit-point voltage that no tolerance takes away: the median over the methods."""
    found = values(tightest(rows), "limit_voltage_error")
    return statistics.median(found) if found else math.nan


def delay_power(rows: Sequence[Row]) -> float:
    """k in error ∝ δ^k of one scenario's viscous rows, between the smallest and the largest δ."""
    found = []
    for delay in sorted({row.delay for row in rows}):
        error = delay_error([row for row in rows if row.delay == delay])
        if not math.isnan(error):
            found.append((delay, error))
    if len(found) < 2:
        return math.nan
    (d0, e0), (d1, e1) = found[0], found[-1]
    return math.log(e1 / e0) / math.log(d1 / d0)


def relative_time(rows: Sequence[Row], chosen: Sequence[Row]) -> float:
    """Geometric mean over the scenarios of the chosen rows' times over the simulator's at its default."""
    ratios = []
    for scenario in dict.fromkeys(row.scenario for row in rows):
        own = [r for r in rows if r.method == SIMULATOR and r.scenario == scenario and not r.failure]
        times = [r.milliseconds for r in chosen if r.scenario == scenario and not r.failure]
        if own and times:
            default = min(own, key=lambda r: abs(math.log(r.rtol / DEFAULT)))
            ratios.append(min(times) / default.milliseconds)
    return statistics.geometric_mean(ratios) if ratios else math.nan


def cheapest(rows: Sequence[Row]) -> list[Row]:
    """Of one method, each scenario's cheapest run with an error within 10 % of its tightest run's."""
    found = []
    for scenario in dict.fromkeys(row.scenario for row in rows):
        here = [row for row in rows if row.scenario == scenario and not row.failure]
        if here:
            limit = min(here, key=lambda r: r.rtol).limit_voltage_error
            close = [row for row in here if abs(row.limit_voltage_error - limit) <= 0.1 * limit]
            found.append(min(close, key=lambda r: r.milliseconds))
    return found


def mean_time(rows: Sequence[Row]) -> float:
    """Geometric mean of the times of the cheapest runs at each delay; inf of none."""
    delays = {row.delay for row in rows}
    times = [r.milliseconds for d in delays for r in cheapest([row for row in rows if row.delay == d])]
    return statistics.geometric_mean(times) if times else math.inf


def followed_again(rows: Sequence[Row]) -> dict[float, int]:
    """By tolerance, how many pieces the simulator followed more than once, over all scenarios.

    Counted against the fewest pieces that a scenario was ever followed in.
    """
    own = [row for row in rows if row.method == SIMULATOR and not row.failure]
    fewest: dict[str, int] = {}
    for row in own:
        fewest[row.scenario] = min(row.solves, fewest.get(row.scenario, row.solves))
    found: dict[float, int] = {}
    for row in own:
        found[row.rtol] = found.get(row.rtol, 0) + row.solves - fewest[row.scenario]
    return found


def reasons(rows: Iterable[Row]) -> dict[str, int]:
    """Why runs went wrong, and how often."""
    counts: dict[str, int] = {}
    for row in rows:
        if row.failure:
            other = row.failure.startswith("limit points")
            reason = "other limit points than the exact ones" if other else row.failure.rstrip(".")
            counts[reason] = counts.get(reason, 0) + 1
    return counts
