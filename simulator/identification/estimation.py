"""`fit`: numbers of a scenario from measurements, with what they are worth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from simulator.identification.fitting import (
    Residuals,
    Searched,
    check_free,
    drawn_points,
    search_from,
    starting_points,
)
from simulator.identification.prediction import Predicted, Unplayable
from simulator.identification.problem import FitProblem, FreeNumber, MeasuredCurve
from simulator.identification.reading import FitLike, read_fit
from simulator.identification.worth import curves, profiled, quantile, undetermined
from simulator.results.fit import Estimate, Fit, FittedColumn
from simulator.scenario import Problem, ScenarioError

FloatArray = NDArray[np.float64]

_AT_BOUND = 1e-6  # of the width between the bounds
_DRAWN, _SEARCHED = (
    16,
    3,
)  # points that are tried where the starts lead nowhere, and those that are gone on from
_GAIN = 0.01  # in Σ(residual/sigma)²: what one more step may still gain where a search has converged


def fit(problem: FitLike, *, progress: Callable[[int], None] | None = None) -> Fit:
    """Find the numbers of a scenario with which its histories agree best with measurements.

    Parameters
    ----------
    problem : FitProblem, path or mapping
        From `read_fit`, or what that takes: a fit file, or its content.
    progress : callable, optional
        Called with the number of histories played, before each.

    Returns
    -------
    Fit
        Also where the search did not converge: look at `converged`.

    Raises
    ------
    ScenarioError
        If the fit makes no sense: see `read_fit`; or if a free number changes nothing that was measured, or
        the scenario cannot be played at the start.
    MissingExtra
        Without the extra `fit`.

    Examples
    --------
    >>> found = fit("scenarios/fits/vhb_inflation.toml")
    >>> found.converged, round(found["balloon.active.elastomer.J_lim"].value)
    (True, 273)
    """
    problem = read_fit(problem)
    residuals = Residuals.of(problem, progress)
    try:
        check_free(residuals)
    except Unplayable as error:
        start = ", ".join(f"{one.key} = {one.written(one.start)}" for one in problem.free)
        said = f"{start}: {error}"
        raise ScenarioError(
            problem.file, Problem("free", None, f"cannot be played at the start: {said}")
        ) from None
    searched, all_chi2 = _best(residuals, problem)
    return _made(residuals, searched, all_chi2)


def _best(residuals: Residuals, problem: FitProblem) -> tuple[Searched, tuple[float, ...]]:
    """The best of the searches from all starts, and Σ(residual/sigma)² of all, the best first.

    Where none of them leads to a minimum in which all rows are on their branches, there is another valley:
    the device snaps at another place, or into another state. It is looked for among points that are drawn.
    """
    given = residuals.sigma
    found = [one for start in starting_points(problem) if (one := _from(residuals, start, given))]
    if not any(_is_good(residuals, *one) for one in found):
        for start in _promising(residuals, given):
            if one := _from(residuals, start, given):
                found.append(one)
                if _is_good(residuals, *one):
                    break
    ranked = sorted(found, key=lambda one: _score(problem, *one))
    best, sigma = ranked[0]
    residuals.weighed_by(sigma)
    return best, tuple(one.chi2 for one, _ in ranked)


def _from(
    residuals: Residuals, start: tuple[float, ...], given: list[FloatArray]
) -> tuple[Searched, list[FloatArray]] | None:
    """The search from one point, and the sigma that it ended with; None where there is no history."""
    residuals.weighed_by(given)
    try:
        return search_from(residuals, start), residuals.sigma
    except Unplayable:
        return None


def _promising(residuals: Residuals, given: list[FloatArray]) -> list[tuple[float, ...]]:
    """Those of some drawn points from which a search seems worth while, the best first."""
    residuals.weighed_by(given)
    scored = []
    for place in drawn_points(residuals.problem, _DRAWN):
        try:
            values = dict(zip([one.key for one in residuals.problem.free], place, strict=True))
            scored.append((float((residuals.at(values) ** 2).sum()), place))
        except Unplayable:
            continue
    return [place for _, place in sorted(scored)[:_SEARCHED]]


def _is_good(residuals: Residuals, searched: Searched, sigma: list[FloatArray]) -> bool:
    """Whether a search ended in a minimum in which all rows are on their branches."""
    residuals.weighed_by(sigma)
    values = residuals.values(searched.result.params)
    on = all(one.compared is None or not one.compared.beyond.any() for one in residuals.predicted(values))
    return on and _verdict(residuals, searched)[0]


def _score(problem: FitProblem, searched: Searched, sigma: list[FloatArray]) -> float:
    """−2 ln(likelihood), but for a constant, by which minima compare whose sigma are their own."""
    score = searched.chi2
    for one, deviations in zip(problem.measured, sigma, strict=True):
        rows = one.values.size // deviations.size
        score += float(2.0 * rows * np.log(deviations[np.isnan(one.sigma)]).sum())
    return score


def _made(residuals: Residuals, searched: Searched, all_chi2: tuple[float, ...]) -> Fit:
    problem = residuals.problem
    values = {one.key: value for one, value in zip(problem.free, searched.values, strict=True)}
    found = residuals.predicted(values)
    degrees = problem.size - len(problem.free)
    wide = quantile(residuals, problem.search.confidence)
    bounds = tuple(one.key for one in problem.free if _at_bound(one, values[one.key]))
    errors = np.array([_error(searched, i) for i in range(len(problem.free))])
    errors[[one.key in bounds for one in problem.free]] = np.nan
    intervals = _intervals(residuals, searched, errors, wide)
    converged, message = _verdict(residuals, searched)
    return Fit(
        file=problem.file,
        title=problem.title,
        scenario=problem.scenario.with_values(
            {one.key: one.written(values[one.key]) for one in problem.free}
        ),
        estimates=tuple(
            Estimate(one.key, values[one.key], one.unit, float(error), *ends)
            for one, error, ends in zip(problem.free, errors, intervals, strict=True)
        ),
        correlation=_correlation(searched, errors),
        reduced_chi2=searched.chi2 / degrees if degrees else float("nan"),
        converged=converged,
        message=message,
        columns=_columns(residuals, searched, found, wide),
        undetermined=undetermined(residuals, searched),
        aicc=_aicc(residuals, found),
        degrees=degrees,
        loss=problem.search.loss,
        confidence=problem.search.confidence,
        intervals="profile likelihood" if problem.search.profile else "standard errors",
        starts=all_chi2,
        played=residuals.model.played,
        at_bounds=bounds,
    )


def _error(searched: Searched, place: int) -> float:
    error = searched.result.params[f"p{place}"].stderr
    return float("nan") if error is None or not np.isfinite(error) else float(error)


def _at_bound(free: FreeNumber, value: float) -> bool:
    width = free.high - free.low if free.is_bounded else abs(value)
    return min(value - free.low, free.high - value) <= _AT_BOUND * width


def _intervals(
    residuals: Residuals, searched: Searched, errors: FloatArray, wide: float
) -> list[tuple[float, float]]:
    """The interval of each number, within its bounds; NaN where the data do not say."""
    problem = residuals.problem
    ellipse = [
        (max(value - wide * error, one.low), min(value + wide * error, one.high))
        if np.isfinite(error)
        else (np.nan, np.nan)
        for one, value, error in zip(problem.free, searched.values, errors.tolist(), strict=True)
    ]
    if not problem.search.profile or not np.isfinite(errors).all():
        return ellipse
    found = profiled(residuals, searched)
    return [
        (max(low, one.low), min(high, one.high)) for one, (low, high) in zip(problem.free, found, strict=True)
    ]


def _correlation(searched: Searched, errors: FloatArray) -> FloatArray:
    covariance = getattr(searched.result, "covar", None)
    size = errors.size
    if covariance is None or not np.isfinite(errors).all():
        found = np.full((size, size), np.nan)
        np.fill_diagonal(found, 1.0)
        return found
    root = np.sqrt(np.diag(covariance))
    return np.asarray(covariance / np.outer(root, root))


def _verdict(residuals: Residuals, searched: Searched) -> tuple[bool, str]:
    """Whether a search has converged, and in words how it ended.

    lmfit's word alone is not enough: a search also stops in front of a jump of the sum of squares. What one
    more step of Gauss and Newton would gain says whether it ended in a minimum.
    """
    result = searched.result
    ended = bool(result.success) or getattr(result, "ier", 0) in (6, 7, 8)  # no more digits to be had
    message = " ".join(str(result.message).split())
    if not ended or residuals.problem.search.loss != "linear":
        return ended, message
    try:
        residual, slopes = residuals(result.params), residuals.jacobian(result.params)
    except Unplayable:
        return False, "the search ended where histories cannot be computed"
    free = [not _at_bound(one, v) for one, v in zip(residuals.problem.free, searched.values, strict=True)]
    slopes = slopes[:, free]
    gain = 0.0
    if slopes.size:
        left, singular, _ = np.linalg.svd(slopes, full_matrices=False)
        gain = float(((left.T @ residual)[singular > 1e-9 * singular[0]] ** 2).sum())
    if gain > _GAIN + 1e-3 * searched.chi2 / residuals.problem.size:
        return (
            False,
            f"the search ended off a minimum: one more step should gain {gain:.3g} in Σ(residual/sigma)²",
        )
    return True, "converged"


def _aicc(residuals: Residuals, found: list[Predicted]) -> float:
    """−2 ln(largest likelihood) + 2k + 2k(k + 1)/(n − k − 1); k counts estimated sigma, too."""
    problem, numbers, likelihood = residuals.problem, len(residuals.problem.free), 0.0
    for one, predicted in zip(problem.measured, found, strict=True):
        off = np.atleast_2d(one.values - predicted.values)
        for column, sigma in zip(off.T, one.sigma.tolist(), strict=True):
            count = column.size
            if np.isnan(sigma):
                variance, numbers = max(float(np.mean(column**2)), 1e-300), numbers + 1
                likelihood += count * (np.log(2.0 * np.pi * variance) + 1.0)
            else:
                likelihood += count * np.log(2.0 * np.pi * sigma**2) + float(((column / sigma) ** 2).sum())
    left = problem.size - numbers - 1
    if left <= 0:
        return float("nan")
    return float(likelihood + 2.0 * numbers + 2.0 * numbers * (numbers + 1) / left)


def _columns(
    residuals: Residuals, searched: Searched, found: list[Predicted], wide: float
) -> tuple[FittedColumn, ...]:
    """Measured beside computed values, quantity by quantity, in the units they were measured in."""
    drawn = curves(residuals, searched, found, wide)
    columns = []
    for number, (one, predicted) in enumerate(zip(residuals.problem.measured, found, strict=True)):
        data, model = np.atleast_2d(one.values), np.atleast_2d(predicted.values)
        for k, column in enumerate(one.y):
            rows = len(data)
            made = FittedColumn(
                table=number + 1,
                label=one.label,
                x_name="",
                x_unit="",
                y_name=column.name,
                y_unit=column.unit,
                rows=np.zeros(rows, dtype=np.int64),
                x=np.full(rows, np.nan),
                data=data[:, k] / column.factor,
                model=model[:, k] / column.factor,
                sigma=np.full(rows, residuals.sigma[number][k] / column.factor),
                branch=np.ones(rows, dtype=np.int64),
                beyond=np.zeros(rows, dtype=bool),
            )
            if isinstance(one, MeasuredCurve):
                made = _with_curve(made, one, predicted, k, drawn[number])
            columns.append(made)
    return tuple(columns)


def _with_curve(
    made: FittedColumn,
    one: MeasuredCurve,
    predicted: Predicted,
    k: int,
    drawn: list[tuple[FloatArray, FloatArray, FloatArray]],
) -> FittedColumn:
    """The same with what a curve has beside its values; `k` is its place among the y of its file."""
    compared, unit, of_x = predicted.compared, one.y[k].factor, one.x.factor
    curve = tuple((x / of_x, y[:, k] / unit, half[:, k] / unit) for x, y, half in drawn if x.size)
    made = replace(made, x_name=one.x.name, x_unit=one.x.unit, rows=one.rows, x=one.at / of_x, curve=curve)
    if compared is None:
        return made
    return replace(made, branch=compared.branch + 1, beyond=compared.beyond)
