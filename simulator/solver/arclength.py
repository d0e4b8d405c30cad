"""A curve residual(y) = 0, followed along its arclength s with IDA.

IDA integrates the differential-algebraic system

    residual(y) = 0,    |dy/ds|² = 1   (in scaled unknowns),

loosely: s only labels points, and every point it visits is polished later. At a fold it is as regular as
anywhere else.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from simulator.model.elastomers import Number
from simulator.solver.ida import Effort, IntegrationError, System, integrate

FloatArray = NDArray[np.float64]

_LONGEST = 1e9  # an arclength never reached
_MOST_STEPS = 50_000
_LEAST_STEP = 1e-12  # shorter ones are noise where the residual is not a number


def along(
    residual: Callable[[list[float]], Sequence[Number]],
    jacobian: Callable[[list[float]], list[list[Number]]],
    events: Callable[[list[float], list[float]], list[float]],
    start: FloatArray,
    direction: FloatArray,
    scales: FloatArray,
    rtol: float,
    longest_step: float,
    effort: Effort,
) -> tuple[FloatArray, FloatArray, int]:
    """Follow the curve residual(y) = 0 with IDA along its arclength until an event's margin falls to zero.

    Parameters
    ----------
    residual, jacobian
        Of n values, n − 1 equations and their derivatives; the jacobian's list may be added to.
    events
        Margins from values and their rates along the arclength, positive while all is well.
    start, direction : (n,) arrays
        A point on the curve and the unit tangent there.
    scales : (n,) array
        Natural sizes, that the arclength is measured in.
    rtol, longest_step : float
        IDA's tolerance and longest step (0 or inf: any).
    effort : Effort
        Counters, added to.

    Returns
    -------
    points, directions : (n, n_points) arrays
        As integrated, not polished.
    ended : int
        Which event ended it.

    Raises
    ------
    IntegrationError
        If IDA fails.
    """
    weights: list[float] = (1.0 / scales**2).tolist()
    bound = longest_step if 0.0 < longest_step < _LONGEST else _LONGEST

    def all_residuals(s: float, y: list[float], yp: list[float]) -> list[Number]:
        speed = -1.0
        for w, d in zip(weights, yp, strict=True):
            speed += w * d * d
        return [*residual(y), speed]

    def all_rows(s: float, y: list[float], yp: list[float], cj: float) -> list[list[Number]]:
        rows = jacobian(y)
        rows.append([2.0 * cj * w * d for w, d in zip(weights, yp, strict=True)])
        return rows

    count = len(events(start.tolist(), direction.tolist()))
    course = integrate(
        System(all_residuals, all_rows, lambda s, y, yp: events(y, yp), [True] * count),
        [0.0, _LONGEST],
        start,
        direction,
        effort,
        rtol=rtol,
        atol=rtol * scales,
        most_steps=_MOST_STEPS,
        # IDA starts at order one, whose error over a step h along a curve is about h²; its own guess is h.
        first_step=min(float(np.sqrt(rtol)), bound),
        min_step=_LEAST_STEP,
        max_step=bound,
        max_nonlin_iters=8,  # |dy/ds|² = 1 is quadratic: now and then the default of 4 is too few
    )
    if not course.events:
        raise IntegrationError("no end of the path", course.states[-1])
    return course.states.T, course.rates.T, course.events[-1].which
