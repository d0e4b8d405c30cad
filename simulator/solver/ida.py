"""SUNDIALS' IDA through scikit-sundae: one way to start it, and one way in which it fails.

Event records live on the events function and add up when a solver is used again, so solver and events
function are built afresh for every integration.
"""

from __future__ import annotations

import contextlib
import io
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Floats = list[float]

# IDA gives up where a margin touches zero to the last digit of a step (flag −22); other steps miss that.
_TOUCHED = -22
_OTHER_STEPS = (1.0, 0.3, 0.1)  # of the tolerance


class IntegrationError(ArithmeticError):
    """IDA could not go on.

    Attributes
    ----------
    state : (n,) array
        Where it was last.
    """

    def __init__(self, message: str, state: FloatArray) -> None:
        super().__init__(message)
        self.state = state


@dataclass
class Effort:
    """What following and relaxing have cost so far; one per run. Steps are those of IDA and CVODE."""

    ida_solves: int = 0
    ida_steps: int = 0
    residual_calls: int = 0
    jacobian_calls: int = 0


@dataclass(frozen=True)
class System:
    """A differential-algebraic system F(t, y, y′) = 0 and what is watched on its way.

    Attributes
    ----------
    residual : callable
        F of t, y and y′, a list; NaN where there is nothing, which IDA takes for a step too long.
    jacobian : callable
        Of t, y, y′ and c: the rows of ∂F/∂y + c ∂F/∂y′.
    margins : callable
        Of t, y and y′: what is positive while all is well, a list. A fall through zero is an event.
    terminal : sequence of bool
        Which of them end the integration.
    """

    residual: Callable[[float, Floats, Floats], Sequence[Any]]
    jacobian: Callable[[float, Floats, Floats, float], Sequence[Sequence[Any]]]
    margins: Callable[[float, Floats, Floats], Sequence[Any]]
    terminal: Sequence[bool]


@dataclass(frozen=True)
class Event:
    """A margin that fell through zero: when, in what state (n,), and which it was."""

    time: float
    state: FloatArray
    which: int


@dataclass(frozen=True)
class Course:
    """What IDA returned: times (m,), states and rates (m, n), and the events in order of time."""

    time: FloatArray
    states: FloatArray
    rates: FloatArray
    events: tuple[Event, ...]


def integrate(
    system: System,
    times: FloatArray | Sequence[float],
    start: FloatArray,
    rates: FloatArray,
    effort: Effort,
    *,
    rtol: float,
    atol: float | FloatArray,
    most_steps: int,
    **options: float,
) -> Course:
    """Integrate a system from a consistent start, to the last time or to a terminal event.

    Parameters
    ----------
    system : System
    times : sequence of float
        Two, between which IDA's own steps are returned, or more, at which states are returned.
    start, rates : (n,) arrays
        y and y′ at the first time.
    effort : Effort
        Counters, added to.
    rtol, atol : float
        IDA's tolerances; `atol` may be an array (n,).
    most_steps : int
        Steps after which it has failed.
    **options
        Further options of IDA.

    Raises
    ------
    IntegrationError
        Whatever the reason.
    """
    for share in _OTHER_STEPS:
        result, steps = _solved(
            system, times, start, rates, most_steps, rtol=share * rtol, atol=atol, **options
        )
        effort.ida_solves += 1
        effort.ida_steps += steps
        effort.residual_calls += int(result.nfev)
        effort.jacobian_calls += int(result.njev)
        if result.status != _TOUCHED:
            break
    if result.status < 0:
        raise IntegrationError(f"IDA: {result.message}", np.array(result.y[-1]))
    found = (
        () if result.t_events is None else zip(result.t_events, result.y_events, result.i_events, strict=True)
    )
    events = tuple(
        Event(float(t), y.copy(), int(which)) for t, y, fell in found for which in np.flatnonzero(fell)
    )
    return Course(result.t.copy(), result.y.copy(), result.yp.copy(), events)


def _solved(
    system: System,
    times: FloatArray | Sequence[float],
    start: FloatArray,
    rates: FloatArray,
    most_steps: int,
    **options: Any,
) -> tuple[Any, int]:
    """What a fresh solver makes of a system, and how many steps it took."""
    from sksundae.ida import IDA

    looks = 0
    reached = start

    def residual(t: float, y: FloatArray, yp: FloatArray, out: FloatArray) -> None:
        out[:] = system.residual(t, y.tolist(), yp.tolist())

    def jacobian(
        t: float, y: FloatArray, yp: FloatArray, res: FloatArray, cj: float, out: FloatArray
    ) -> None:
        out[:] = system.jacobian(t, y.tolist(), yp.tolist(), cj)

    def margins(t: float, y: FloatArray, yp: FloatArray, out: FloatArray) -> None:
        nonlocal looks
        looks += 1  # about one a step
        if looks > most_steps:
            raise IntegrationError(f"no end within {most_steps} steps", y.copy())
        out[:] = system.margins(t, y.tolist(), yp.tolist())

    margins.direction = [-1] * len(system.terminal)  # type: ignore[attr-defined]
    margins.terminal = list(system.terminal)  # type: ignore[attr-defined]
    try:
        with silence():
            solver = IDA(
                residual,
                jacfn=jacobian,
                eventsfn=margins,
                num_events=len(system.terminal),
                max_num_steps=most_steps,
                **options,
            )
            result = solver.solve(times, start, rates)
    except (KeyError, ValueError, RuntimeError) as failure:
        # scikit-sundae raises these for start values or times that SUNDIALS does not accept.
        raise IntegrationError(f"IDA: {type(failure).__name__}: {failure}", reached) from failure
    return result, len(result.t) - 1 if len(times) == 2 else looks


@contextlib.contextmanager
def silence() -> Iterator[None]:
    """Nothing is written to the terminal: scikit-sundae prints errors, and SUNDIALS logs warnings itself."""
    name = "SUNLOGGER_WARNING_FILENAME"
    before = os.environ.get(name)
    os.environ[name] = os.devnull
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            yield
    finally:
        if before is None:
            del os.environ[name]
        else:
            os.environ[name] = before
