"""The search for the numbers that agree best with the data, by lmfit; and what the data say of them.

Residuals are divided by the standard deviations of the values. Where a column has none, it is estimated from
its residuals, and the search goes on with it until it does not change. Derivatives are differences of
histories, which are exact to rounding: one-sided on the way, central where what they say is reported.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from simulator.identification.prediction import Model, Predicted, Unplayable
from simulator.identification.problem import FitProblem, FreeNumber, MeasuredCurve
from simulator.results.extras import MissingExtra
from simulator.scenario import Problem, ScenarioError

if TYPE_CHECKING:
    import lmfit

FloatArray = NDArray[np.float64]

_STEP = 1e-4  # of a number, for derivatives: the error of central differences is about its square
_ROUGH_STEP = 1e-5  # of a number, for derivatives from one side, which are as good as that
_OFF_BOUND = 1e-4  # of the width between the bounds
_TRIED = 0.01  # by which a number is changed to see whether it changes anything
_NOTHING = 1e-9  # of the size of the values: a smaller change is none
_MOST_ROUNDS, _SETTLED = 12, 1e-4  # of estimating standard deviations; a relative change of them that is none
_FIRST_GUESS = 0.05  # of the range of a column: its standard deviation before anything is known
_FAR = 1e3  # times the residuals at the start: those of values without a history
_OF_MEDIAN = 1.4826  # standard deviation over median amount, of normal residuals
_TOLERANCE = 1e-7
_MOST_CALLS = 200  # of the model for each free number


def lmfit_module() -> Any:
    """The package lmfit. Raises MissingExtra."""
    try:
        import lmfit
    except ImportError:
        raise MissingExtra("a fit needs lmfit: pip install 'dielectric-balloons[fit]'") from None
    return lmfit


@dataclass
class Residuals:
    """Weighted residuals of a fit as functions of lmfit's parameters, which are named p0, p1, ….

    Attributes
    ----------
    problem : FitProblem
    model : Model
    sigma : list of (n_y,) arrays
        Of each table of data, given or estimated.
    """

    problem: FitProblem
    model: Model
    sigma: list[FloatArray]
    progress: Callable[[int], None] | None = None
    far: FloatArray | None = None
    known: dict[tuple[float, ...], list[Predicted]] = field(default_factory=dict)

    @classmethod
    def of(cls, problem: FitProblem, progress: Callable[[int], None] | None = None) -> Residuals:
        """Those of a fit, with a first guess of the standard deviations that are not given."""
        return cls(problem, Model(problem), [_first_guess(one) for one in problem.measured], progress)

    def values(self, parameters: Any) -> dict[str, float]:
        """Parameters as values of the free numbers, by key."""
        return {one.key: float(parameters[f"p{i}"].value) for i, one in enumerate(self.problem.free)}

    def predicted(self, values: Mapping[str, float]) -> list[Predicted]:
        """What is compared with the data. Raises Unplayable."""
        place = tuple(values.values())
        if place not in self.known:
            if self.progress is not None:
                self.progress(self.model.played)
            self.known[place] = self.model.predict(values, [1.0 / sigma for sigma in self.sigma])
        return self.known[place]

    def at(self, values: Mapping[str, float]) -> FloatArray:
        """(data − model)/sigma of all values in one array. Raises Unplayable."""
        parts = zip(self.problem.measured, self.predicted(values), self.sigma, strict=True)
        return np.concatenate([((one.values - found.values) / sigma).ravel() for one, found, sigma in parts])

    def __call__(self, parameters: Any) -> FloatArray:
        """Residuals for lmfit; large ones where there is no history."""
        try:
            found = self.at(self.values(parameters))
        except Unplayable:
            found = np.full(self.problem.size, np.nan)
        if not np.isfinite(found).all():
            assert self.far is not None
            return self.far
        return found

    def jacobian(self, parameters: Any) -> FloatArray:
        """Derivatives of the residuals in the parameters that vary, (n_values, n_varying)."""
        values = self.values(parameters)
        varying = [one for i, one in enumerate(self.problem.free) if parameters[f"p{i}"].vary]
        return np.column_stack([self._rough_slope(values, one) for one in varying])

    def _rough_slope(self, values: Mapping[str, float], free: FreeNumber) -> FloatArray:
        """The derivative of the residuals in one number from one side, where there is a history."""
        step = _ROUGH_STEP / _STEP * step_of(free, values[free.key])
        for move in (step, -step):
            place = values[free.key] + move
            if not free.low <= place <= free.high:
                continue
            try:
                return (self.at({**values, free.key: place}) - self.at(values)) / (place - values[free.key])
            except Unplayable:
                continue
        return np.zeros(self.problem.size)

    def slope(self, values: Mapping[str, float], free: FreeNumber) -> FloatArray:
        """The derivative of the residuals in one number, (n_values,); zeros where there is none."""
        ends = []
        for sign in (1.0, -1.0):
            place = values[free.key] + sign * step_of(free, values[free.key])
            place = min(max(place, free.low), free.high)
            try:
                ends.append((place, self.at({**values, free.key: place})))
            except Unplayable:
                ends.append((values[free.key], self.at(values)))
        (high, above), (low, below) = ends
        return np.asarray((above - below) / (high - low)) if high != low else np.zeros(self.problem.size)

    def weighed_by(self, sigma: list[FloatArray]) -> None:
        """Go on with other standard deviations."""
        self.sigma = sigma
        if any(len(one.y) > 1 for one in self.problem.measured):  # by which rows are put on branches
            self.known.clear()


def step_of(free: FreeNumber, value: float) -> float:
    """How far a number is changed for a derivative."""
    width = free.high - free.low if free.is_bounded else 0.0
    return _STEP * (max(abs(value), 1e-3 * width) or 1.0)


def _first_guess(one: Any) -> FloatArray:
    """Standard deviations as given, or a part of the range of the values."""
    if not isinstance(one, MeasuredCurve):
        return np.asarray(one.sigma)
    span = np.ptp(one.values, axis=0)
    span = np.where(span > 0.0, span, np.maximum(np.abs(one.values).max(axis=0), 1e-300))
    return np.where(np.isnan(one.sigma), _FIRST_GUESS * span, one.sigma)


def estimated_sigma(residuals: Residuals, found: Sequence[Predicted]) -> list[FloatArray]:
    """Standard deviations as given, or those of the residuals with the degrees of freedom that are theirs."""
    size, numbers = residuals.problem.size, len(residuals.problem.free)
    sigma = []
    for one, predicted in zip(residuals.problem.measured, found, strict=True):
        off = np.atleast_2d(one.values - predicted.values)
        degrees = len(off) * max(1.0 - numbers / size, 1.0 / size)
        least = 1e-12 * np.abs(np.atleast_2d(one.values)).max(axis=0) + 1e-300
        rms = np.sqrt((off**2).sum(axis=0) / degrees)
        if residuals.problem.search.loss != "linear":  # outliers are not to widen it
            rms = _OF_MEDIAN * np.median(np.abs(off), axis=0)
        rms = np.maximum(rms, least)
        sigma.append(np.where(np.isnan(one.sigma), rms, one.sigma))
    return sigma


def all_known(problem: FitProblem) -> bool:
    """Whether all standard deviations are given."""
    return all(bool(np.isfinite(one.sigma).all()) for one in problem.measured)


@dataclass(frozen=True)
class Searched:
    """Where a search ended: lmfit's minimiser and result, and Σ(residual/sigma)²."""

    minimizer: Any
    result: lmfit.minimizer.MinimizerResult
    chi2: float

    @property
    def values(self) -> tuple[float, ...]:
        """The parameters, in order."""
        return tuple(float(one.value) for one in self.result.params.values())


def search_from(residuals: Residuals, start: Sequence[float]) -> Searched:
    """The nearest minimum from a point, at which the history must be computable. Raises Unplayable."""
    lmfit = lmfit_module()
    problem = residuals.problem
    values = {one.key: value for one, value in zip(problem.free, start, strict=True)}
    residuals.far = None
    first = residuals.at(values)
    residuals.far = np.full(problem.size, _FAR * (1.0 + float(np.sqrt(np.mean(first**2)))))
    searched = _minimised(lmfit, residuals, start)
    for _ in range(0 if all_known(problem) else _MOST_ROUNDS):
        sigma = estimated_sigma(residuals, residuals.predicted(residuals.values(searched.result.params)))
        changes = [np.abs(a / b - 1.0).max() for a, b in zip(sigma, residuals.sigma, strict=True)]
        residuals.weighed_by(sigma)
        residuals.far = np.full(problem.size, _FAR * np.sqrt(problem.size))
        if max(changes) < _SETTLED:
            break
        searched = _minimised(lmfit, residuals, searched.values)
    return searched


def _minimised(lmfit: Any, residuals: Residuals, start: Sequence[float]) -> Searched:
    problem = residuals.problem
    parameters = lmfit.Parameters()
    for i, (one, value) in enumerate(zip(problem.free, start, strict=True)):
        parameters.add(f"p{i}", value=_inside(one, value), min=one.low, max=one.high)
    calls = _MOST_CALLS * (len(problem.free) + 1)
    linear = problem.search.loss == "linear"
    options: dict[str, Any] = {"Dfun": residuals.jacobian, "ftol": _TOLERANCE, "xtol": _TOLERANCE}
    if not linear:
        options |= {"loss": problem.search.loss, "x_scale": "jac"}
    minimizer = lmfit.Minimizer(residuals, parameters, scale_covar=False, max_nfev=calls, **options)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of uncertainties that cannot be given; the result says so
        result = minimizer.minimize(method="leastsq" if linear else "least_squares")
    return Searched(minimizer, result, float((np.asarray(result.residual) ** 2).sum()))


def _inside(free: FreeNumber, value: float) -> float:
    """A value off its bounds: at a bound itself lmfit's variables have no slope, and a search would stay."""
    width = free.high - free.low if free.is_bounded else max(abs(value), 1.0)
    return min(max(value, free.low + _OFF_BOUND * width), free.high - _OFF_BOUND * width)


def starting_points(problem: FitProblem) -> list[tuple[float, ...]]:
    """The given start, and others between the bounds: Latin hypercube, logarithmic over a decade or more."""
    given = tuple(one.start for one in problem.free)
    if problem.search.starts == 1:
        return [given]
    return [given, *drawn_points(problem, problem.search.starts - 1)]


def drawn_points(problem: FitProblem, count: int) -> list[tuple[float, ...]]:
    """Points between the bounds, drawn with the seed of the fit; without bounds, within a factor of two."""
    from scipy.stats import qmc

    shares = qmc.LatinHypercube(len(problem.free), seed=problem.search.seed).random(count)
    return [
        tuple(_between(one, share) for one, share in zip(problem.free, row, strict=True))
        for row in shares.tolist()
    ]


def _between(free: FreeNumber, share: float) -> float:
    if not free.is_bounded:
        place = free.start * 2.0 ** (2.0 * share - 1.0) if free.start else 2.0 * share - 1.0
        return min(max(place, free.low), free.high)
    if free.low > 0.0 and free.high >= 10.0 * free.low:
        return float(free.low * (free.high / free.low) ** share)
    return free.low + share * (free.high - free.low)


def check_free(residuals: Residuals) -> None:
    """Raise ScenarioError where a free number changes none of the computed values."""
    problem = residuals.problem
    values = {one.key: one.start for one in problem.free}
    here = residuals.at(values)
    still = []
    for one in problem.free:
        tried = [one.start * (1.0 + _TRIED), one.start * (1.0 - _TRIED), one.start + step_of(one, one.start)]
        tried += [bound for bound in (one.low, one.high) if np.isfinite(bound)]
        if not any(
            _changes(residuals, {**values, one.key: v}, here) for v in tried if one.low <= v <= one.high
        ):
            still.append(Problem(f'free."{one.key}"', None, "changes nothing that was measured"))
    if still:
        raise ScenarioError(problem.file, *still)


def _changes(residuals: Residuals, values: Mapping[str, float], here: FloatArray) -> bool:
    try:
        there = residuals.at(values)
    except Unplayable:  # a change all the same
        return True
    return bool((np.abs(there - here) > _NOTHING * (1.0 + np.abs(here))).any())
