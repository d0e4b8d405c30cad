"""Follows the quasi-static equilibrium path along its arclength: with IDA, or by formula where there is one.

With the drive as independent variable the path ends at a fold; along its arclength s a fold is a regular
point. So IDA integrates the DAE

    residual(y) = 0,    |dy/ds|² = 1   (in scaled unknowns),

loosely: s only labels points, and every point it visits is then polished and checked (`piece`). What does
not pass is followed again in shorter steps, or is an error. One balloon under a rising pressure needs no
DAE: the pressure that goes with a stretch is a formula.
"""

from __future__ import annotations

import contextlib
import io
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from simulator.model.conditions import Condition
from simulator.model.equations import Equations, OpenBalloon
from simulator.solver import newton
from simulator.solver.certify import NOISE, SHORT, Segment, polished, straight, work
from simulator.solver.inflation import inflated
from simulator.solver.newton import NotConverged
from simulator.solver.proposals import off_singular, up_to_event

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

FloatArray = NDArray[np.float64]

_LONGEST = 1e9  # an arclength never reached
_TIGHTEST = 1e-12
_MOST_LOOKS = 50_000  # of IDA at the events, about one a step
# Tolerance, over the one asked for, and longest step (0: any) of each attempt to follow a piece.
_ATTEMPTS = ((1.0, 0.0), (0.1, 0.0), (1e-2, 0.25), (1e-3, 0.05), (1e-4, 0.01), (1e-5, 2e-3))
_UPRIGHT = 1e-6  # share of v in a unit tangent, below which the state is a limit point to rounding


class PathError(ArithmeticError):
    """The path could not be followed or verified, at any tolerance."""


@dataclass
class Effort:
    """What following and relaxing have cost so far; one per run."""

    ida_solves: int = 0
    ida_steps: int = 0
    residual_calls: int = 0
    jacobian_calls: int = 0


def follow(
    equations: Equations,
    conditions: Sequence[Condition],
    start: FloatArray,
    target: float,
    rtol: float,
    effort: Effort,
) -> Segment:
    """Follow the path from a polished state to v = `target`, or to the first condition that ends it.

    Parameters
    ----------
    equations, conditions
        The curve, and what ends it.
    start : (n_unknowns,) array
        A state on the curve, with all margins positive.
    target : float
        Where v should get to; v moves monotonically.
    rtol : float
        IDA's tolerance; tightened here where the outcome does not pass its checks.
    effort : Effort
        Counters, added to.

    Raises
    ------
    PathError
        If no tolerance gave a path that passes.
    """
    if abs(target - start[-1]) < SHORT * equations.scales[-1]:
        short = _short(equations, conditions, start, target)
        if short is not None:
            return short
    if float(conditions[0].margin(start.tolist())) < NOISE and not newton.is_fold(equations, start):
        off = _off_singular(equations, conditions, start, target, rtol, effort)
        if off is not None:
            return off
    close = up_to_event(equations, conditions, start, target)
    if close is not None:
        return close
    if isinstance(equations, OpenBalloon) and equations.pressure_rate:
        with contextlib.suppress(NotConverged):
            points, directions, ended = inflated(equations, conditions, start, target)
            return polished(equations, conditions, points, directions, ended, target)
    failure: Exception | None = None
    bound = equations.longest_step / equations.scales[-1]
    for tighter, largest in _ATTEMPTS:
        largest_step = min(largest or bound, bound) if bound < _LONGEST else largest
        try:
            points, directions, ended = _integrate(
                equations, conditions, start, target, max(rtol * tighter, _TIGHTEST), largest_step, effort
            )
            return polished(equations, conditions, points, directions, ended, target)
        except (ArithmeticError, np.linalg.LinAlgError) as not_converged:
            failure = not_converged
    off = _off_singular(equations, conditions, start, target, rtol, effort)
    if off is not None:
        return off
    raise PathError(f"{failure} from v = {start[-1]:.12g} to {target:.12g}") from failure


def _off_singular(
    equations: Equations,
    conditions: Sequence[Condition],
    start: FloatArray,
    target: float,
    rtol: float,
    effort: Effort,
) -> Segment | None:
    """As `follow`, off a singular state that is no limit point; None if no path sets out from there."""
    off = off_singular(equations, conditions, start, target)
    if off is None:
        return None
    nodes, tangents = off
    rest = follow(equations, conditions, nodes[:, 1], target, rtol, effort)
    dense, speeds = straight(nodes)
    return Segment(
        np.concatenate([nodes[:, :1], rest.states], axis=1),
        np.concatenate([tangents[:, :1], rest.tangents], axis=1),
        np.concatenate([dense, rest.dense], axis=1),
        np.concatenate([speeds, rest.speeds], axis=1),
        np.concatenate([work(equations, dense, speeds), rest.work]),
        rest.end,
    )


def _short(
    equations: Equations, conditions: Sequence[Condition], start: FloatArray, target: float
) -> Segment | None:
    """A piece too short for steps, as one interval; None if it is not plainly smooth and free of events."""
    nodes = np.repeat(start[:, None], 2, axis=1)
    nodes[-1, 1] = target
    try:
        nodes[:, 1] = newton.one_at_drive(equations, nodes[:, 1])
    except NotConverged:
        return None
    ahead = np.zeros_like(nodes)
    ahead[-1] = 1.0 if target > start[-1] else -1.0
    tangents = newton.tangents(equations, nodes, ahead)
    if np.max(np.abs(nodes[:, 1] - start) / equations.scales) > 1e3 * SHORT:
        return None
    if any(float(c.margin(nodes[:, k].tolist())) < 1e3 * SHORT for c in conditions for k in (0, 1)):
        return None
    dense, speeds = straight(nodes)
    return Segment(nodes, tangents, dense, speeds, work(equations, dense, speeds), None)


def _integrate(
    equations: Equations,
    conditions: Sequence[Condition],
    start: FloatArray,
    target: float,
    rtol: float,
    largest_step: float,
    effort: Effort,
) -> tuple[FloatArray, FloatArray, int]:
    """IDA's points and directions, columns, and which condition (or the target, the last) ended them."""
    sense = 1.0 if target > start[-1] else -1.0
    margins = [condition.margin for condition in conditions]

    def events(values: list[float], rates: list[float]) -> list[float]:
        found = [margin(values) for margin in margins]
        found.append(sense * (target - values[-1]))
        return found

    ahead = np.zeros_like(start)
    ahead[-1] = sense
    direction = newton.tangents(equations, start[:, None], ahead[:, None])[:, 0]
    if abs(direction[-1]) < _UPRIGHT * equations.scales[-1]:
        # On a limit point v does not tell which way is ahead. It is where the state grows stable.
        direction = newton.tangent_at_end(equations, start, direction)
        values = start.tolist()
        # A trace knows several; it begins beside one of them.
        nearest = min(conditions, key=lambda c: (c.kind != "limit_point", abs(float(c.margin(values)))))
        direction *= np.sign(nearest.slope(start) @ direction) or 1.0
    return along(
        equations.residual,
        lambda values: equations.linearised(values)[1],
        events,
        start,
        direction,
        equations.scales,
        rtol,
        largest_step,
        effort,
    )


def along(
    residual: Callable[[list[float]], list[float]],
    jacobian: Callable[[list[float]], list[list[float]]],
    events: Callable[[list[float], list[float]], list[float]],
    start: FloatArray,
    direction: FloatArray,
    scales: FloatArray,
    rtol: float,
    largest_step: float,
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
    rtol, largest_step : float
        IDA's tolerance and longest step (0: any).
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
    NotConverged
        If IDA fails.
    """
    from sksundae.ida import IDA

    weights: list[float] = (1.0 / scales**2).tolist()
    looks = 0

    def residual_of(s: float, y: FloatArray, yp: FloatArray, out: FloatArray) -> None:
        values = residual(y.tolist())
        speed = -1.0
        for w, d in zip(weights, yp.tolist(), strict=True):
            speed += w * d * d
        values.append(speed)
        out[:] = values

    def jacobian_of(
        s: float, y: FloatArray, yp: FloatArray, res: FloatArray, cj: float, out: FloatArray
    ) -> None:
        rows = jacobian(y.tolist())
        rows.append([2.0 * cj * w * d for w, d in zip(weights, yp.tolist(), strict=True)])
        out[:] = rows

    def events_of(s: float, y: FloatArray, yp: FloatArray, out: FloatArray) -> None:
        nonlocal looks
        looks += 1
        if looks > _MOST_LOOKS:
            raise NotConverged(f"no end within {_MOST_LOOKS} steps")
        out[:] = events(y.tolist(), yp.tolist())

    count = len(events(start.tolist(), direction.tolist()))
    events_of.direction = [-1] * count  # type: ignore[attr-defined]
    solver: Any = IDA(
        residual_of,
        jacfn=jacobian_of,
        eventsfn=events_of,
        num_events=count,
        rtol=rtol,
        atol=rtol * scales,
        # IDA starts at order one, whose error over a step h along a curve is about h²; its own guess is h.
        first_step=min(float(np.sqrt(rtol)), largest_step or _LONGEST),
        min_step=1e-12,
        max_nonlin_iters=8,  # |dy/ds|² = 1 is quadratic: now and then the default of 4 is too few
        max_step=largest_step or _LONGEST,
    )
    with contextlib.redirect_stdout(io.StringIO()):  # scikit-sundae prints failures
        result = solver.solve([0.0, _LONGEST], start, direction)
    effort.ida_solves += 1
    effort.ida_steps += len(result.t) - 1
    effort.residual_calls += int(result.nfev)
    effort.jacobian_calls += int(result.njev)
    if result.status != 2:
        raise NotConverged(f"IDA: {result.message}")
    return result.y.T.copy(), result.yp.T.copy(), int(np.flatnonzero(result.i_events[-1])[0])
