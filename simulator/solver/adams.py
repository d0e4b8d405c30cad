"""SUNDIALS' CVODE by the method of Adams, through scikit-sundae: few steps where an equation is not stiff."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator.solver.ida import Effort, Floats, IntegrationError, silence

FloatArray = NDArray[np.float64]

_NEVER = 1e12  # a time never reached


def integrate(
    rates: Callable[[Floats], Sequence[Any]],
    jacobian: Callable[[Floats], FloatArray],
    margins: Callable[[Floats], Sequence[Any]],
    start: FloatArray,
    effort: Effort,
    *,
    rtol: float,
    most_steps: int,
) -> tuple[FloatArray, int]:
    """Integrate dy/dt = f(y) until a margin falls through zero.

    Parameters
    ----------
    rates, jacobian : callable
        F of y, a list (n,), and its derivatives (n, n).
    margins : callable
        Of y: what is positive while all is well, a list.
    start : (n,) array
    effort : Effort
        Counters, added to.
    rtol : float
        Tolerance, relative and absolute.
    most_steps : int
        Steps after which it has failed: the equation is stiff.

    Returns
    -------
    states : (m, n) array
        The last of them is where the margin is zero.
    which : int
        The place of that margin.

    Raises
    ------
    IntegrationError
        Whatever the reason.
    """
    from sksundae.cvode import CVODE

    count = len(margins(start.tolist()))
    calls = 0
    looks = 0

    def right(t: float, y: FloatArray, out: FloatArray) -> None:
        nonlocal calls
        calls += 1
        out[:] = rates(y.tolist())

    def slopes(t: float, y: FloatArray, yp: FloatArray, out: FloatArray) -> None:
        effort.jacobian_calls += 1
        out[:] = jacobian(y.tolist())

    def watched(t: float, y: FloatArray, out: FloatArray) -> None:
        nonlocal looks
        looks += 1  # about one a step
        if looks > most_steps:
            raise IntegrationError(f"no end within {most_steps} steps", y.copy())
        out[:] = margins(y.tolist())

    watched.direction = [-1] * count  # type: ignore[attr-defined]
    watched.terminal = [True] * count  # type: ignore[attr-defined]
    try:
        with silence():
            solver = CVODE(
                right, method="Adams", jacfn=slopes, eventsfn=watched, num_events=count, rtol=rtol,
                atol=rtol, max_num_steps=most_steps,
            )  # fmt: skip
            result = solver.solve([0.0, _NEVER], start)
    except (KeyError, ValueError, RuntimeError) as failure:
        raise IntegrationError(f"CVODE: {type(failure).__name__}: {failure}", start) from failure
    finally:
        effort.ida_solves += 1
        effort.ida_steps += looks
        effort.residual_calls += calls
    if result.status < 0 or result.i_events is None or not len(result.i_events):
        raise IntegrationError(f"CVODE: {result.message}", np.array(result.y[-1]))
    return result.y.copy(), int(np.flatnonzero(result.i_events[-1])[0])
