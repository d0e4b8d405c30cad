"""What the data say of the estimates: intervals, directions they leave open, the band of the curve."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator.identification.branches import lean
from simulator.identification.fitting import Residuals, Searched, all_known, lmfit_module, step_of
from simulator.identification.prediction import Predicted, Unplayable
from simulator.identification.problem import MeasuredCurve
from simulator.results.fit import Undetermined

FloatArray = NDArray[np.float64]

_OPEN = 1e-6  # of the largest singular value: a direction along which the residuals do not change
_TAKES_PART = 0.05  # of the largest weight in a direction
_CURVE_POINTS = 120  # of each branch, in a picture


def quantile(residuals: Residuals, confidence: float) -> float:
    """How many standard errors an interval has on each side: Student's t where sigma is estimated."""
    from scipy import stats

    share = 0.5 * (1.0 + confidence)
    degrees = residuals.problem.size - len(residuals.problem.free)
    return float(stats.norm.ppf(share) if all_known(residuals.problem) else stats.t.ppf(share, degrees))


def profiled(residuals: Residuals, searched: Searched) -> list[tuple[float, float]]:
    """The interval of each number by profile likelihood: all others are fitted anew at each of its values.

    Where it does not end between the bounds it ends at a bound, or nowhere.
    """
    from scipy import stats

    problem, known = residuals.problem, all_known(residuals.problem)
    degrees = problem.size - len(problem.free)

    def probability(best: Any, other: Any) -> float:
        rise = max(float(other.chisqr) - searched.chi2, 0.0)
        if known:
            return float(stats.chi2.cdf(rise, 1))
        return float(stats.f.cdf(rise / searched.chi2 * degrees, 1, degrees))

    share = problem.search.confidence
    if len(problem.free) == 1:
        return [_of_one(residuals, searched, probability, share)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of bounds that are reached; the interval then ends there
        found = lmfit_module().conf_interval(
            searched.minimizer, searched.result, sigmas=[share], prob_func=probability
        )
    return [(float(row[0][1]), float(row[-1][1])) for row in found.values()]


def _of_one(residuals: Residuals, searched: Searched, probability: Any, share: float) -> tuple[float, float]:
    """The interval of a single free number, for which nothing else is to be fitted."""
    from types import SimpleNamespace

    from scipy.optimize import brentq

    (free,) = residuals.problem.free
    (best,), error = searched.values, float(searched.result.params["p0"].stderr or 0.0)

    def short(value: float) -> float:
        try:
            chi2 = float((residuals.at({free.key: value}) ** 2).sum())
        except Unplayable:
            chi2 = np.inf
        return float(probability(None, SimpleNamespace(chisqr=chi2))) - share

    ends = []
    for sign, bound in ((-1.0, free.low), (1.0, free.high)):
        end, width = bound, error or step_of(free, best)
        for _ in range(60):
            there = best + sign * width
            there = max(there, bound) if sign < 0.0 else min(there, bound)
            if short(there) > 0.0:
                end = float(brentq(short, *sorted((best, there)), xtol=1e-6 * width))
                break
            if there == bound:
                break
            width *= 1.5
        ends.append(end)
    return ends[0], ends[1]


def undetermined(residuals: Residuals, searched: Searched) -> tuple[Undetermined, ...]:
    """Combinations of the numbers along which the residuals do not change, to first order.

    Derivatives are taken in the logarithms of the numbers; of one that is zero, in itself.
    """
    problem = residuals.problem
    values = {one.key: value for one, value in zip(problem.free, searched.values, strict=True)}
    try:
        slopes = np.column_stack([residuals.slope(values, one) for one in problem.free])
    except Unplayable:
        return ()
    sizes = np.array([abs(value) or 1.0 for value in searched.values])
    _, singular, rows = np.linalg.svd(slopes * sizes, full_matrices=True)
    singular = np.append(singular, np.zeros(len(rows) - singular.size))
    found = []
    for value, row in zip(singular, rows, strict=True):
        if value <= _OPEN * max(float(singular[0]), 1e-300):
            row = row / row[np.argmax(np.abs(row))]
            weights = {
                one.key: float(w) for one, w in zip(problem.free, row, strict=True) if abs(w) > _TAKES_PART
            }
            error = 1.0 / float(value) if value > 0.0 else np.inf
            found.append(Undetermined(_words(weights), weights, error))
    return tuple(found)


def _words(weights: dict[str, float]) -> str:
    if len(weights) == 1:
        return next(iter(weights))
    parts = [f"{key} {'+' if weight > 0.0 else '−'}{abs(weight):.3g} %" for key, weight in weights.items()]
    return f"{', '.join(parts)} together"


def curves(
    residuals: Residuals, searched: Searched, found: list[Predicted], width: float
) -> list[list[tuple[FloatArray, FloatArray, FloatArray]]]:
    """Of each table the computed curve, branch by branch: x, y and half the width of the band.

    The band is that of the estimates, to first order, at the same x and branch: (n,), (n, n_y) and (n, n_y).
    """
    problem = residuals.problem
    values = {one.key: value for one, value in zip(problem.free, searched.values, strict=True)}
    grids = [_grids(one, predicted) for one, predicted in zip(problem.measured, found, strict=True)]
    here = [_drawn(residuals, values, i, grid) for i, grid in enumerate(grids)]
    covariance = getattr(searched.result, "covar", None)
    slopes: list[list[list[FloatArray]]] = [[[] for _ in part] for part in here]
    for place, one in enumerate(problem.free if covariance is not None else ()):
        # As wide as the estimate is uncertain: beside a limit point a derivative has no bound.
        assert covariance is not None
        step = float(np.sqrt(covariance[place, place])) or step_of(one, values[one.key])
        step = -step if values[one.key] + step > one.high else step
        moved = {**values, one.key: values[one.key] + step}
        for i, grid in enumerate(grids):
            there = _drawn(residuals, moved, i, grid)
            for part, (a, b) in enumerate(zip(there, here[i], strict=False)):
                slopes[i][part].append((a - b) / step)
    out = []
    for i, grid in enumerate(grids):
        bands = []
        for part, x in enumerate(grid):
            half = np.zeros_like(here[i][part])
            if covariance is not None and len(slopes[i][part]) == len(problem.free):
                rates = np.array(slopes[i][part])
                half = width * np.sqrt(np.maximum(np.einsum("inm,ij,jnm->nm", rates, covariance, rates), 0.0))
            bands.append((x, here[i][part], half))
        out.append(bands)
    return out


def _grids(one: Any, predicted: Predicted) -> list[FloatArray]:
    """The x at which each branch of a curve is drawn: where rows are compared with it."""
    if not isinstance(one, MeasuredCurve):
        return []
    if predicted.compared is None:
        return [np.linspace(one.at.min(), one.at.max(), 3 * _CURVE_POINTS)]
    grids = []
    used = set(predicted.compared.branch.tolist())
    for place, branch in enumerate(predicted.curve):
        low, high = sorted((branch.x[0], branch.x[-1]))
        inside = np.linspace(max(low, one.at.min()), min(high, one.at.max()), _CURVE_POINTS)
        grids.append(inside if place in used and inside[-1] > inside[0] else np.empty(0))
    return grids


def _drawn(
    residuals: Residuals, values: dict[str, float], place: int, grids: list[FloatArray]
) -> list[FloatArray]:
    """A curve at some x of each of its branches; nothing where there is no such branch."""
    one = residuals.problem.measured[place]
    if not isinstance(one, MeasuredCurve):
        return []
    try:
        return residuals.model.drawn(one, values, grids, lean(one.at, one.values))
    except Unplayable:
        return []
