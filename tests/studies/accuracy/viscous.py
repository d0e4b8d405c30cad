"""What one would write today without this package: the viscous equations, with SciPy's solvers.

    τ dλᵢ/dt = −gᵢ(λ, φ(t)),    p = n/V − pₑ,

the gas law eliminated, the voltage ramped, held and switched as the scenario says. τ is a share δ of the
duration of the scenario's first ramp. There is no event for a limit point: the stretch simply runs, and its
place is where it runs fastest.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tests.studies.accuracy.problem import Leg, LimitPoint, Samples, Solution, Task

FloatArray = NDArray[np.float64]
Method = Literal["LSODA", "BDF", "Radau"]

# A stretch that would change by this much in the time of the whole leg, and does change by so much, snaps.
_FAST = 30.0
_FAR = 0.1
_SLOW = 3.0  # so slow, and it has landed
_GAUSS, _WEIGHTS = np.polynomial.legendre.leggauss(5)


@dataclass(frozen=True)
class Run:
    """SciPy's solutions, one for each leg that was played; None for a jump."""

    equations: _Equations
    results: tuple[Any, ...]


class ViscousFailure(ArithmeticError):
    """SciPy's solver gave up."""


class _Equations:
    """Right-hand side in Python's own floats, which are faster than arrays of two."""

    def __init__(self, task: Task, delay: float) -> None:
        pair = task.pair
        ramp = next(leg for leg in task.legs if leg.is_ramp)
        self.tau = delay * ramp.lasts
        self.walls = [
            (b.elastomer.pole_form, b.modulus, b.modulus * b.pressure_load, b.cube / 3.0)
            for b in (pair.active, pair.passive)
        ]
        active = pair.active
        self.electric = active.modulus * active.electric_load
        self.capacitance = active.radius**2 * active.permittivity / active.thickness
        self.amount, self.ambient = pair.amount, pair.ambient

    def pressure(self, x: Any) -> Any:
        """p = n/V − pₑ of stretches (2,) or (2, n)."""
        (_, _, _, first), (_, _, _, second) = self.walls
        return self.amount / (first * x[0] ** 3 + second * x[1] ** 3) - self.ambient

    def rates(self, a: Any, b: Any, voltage: Any) -> tuple[Any, Any]:
        """dλᵢ/dt."""
        (form, k, load, _), (other_form, other_k, other_load, _) = self.walls
        p = self.pressure((a, b))
        n, d = form(a)
        m, e = other_form(b)
        return (
            ((load * p + self.electric * voltage * voltage * a) * a * a - k * n / d) / self.tau,
            (other_load * p * b * b - other_k * m / e) / self.tau,
        )

    def right_hand_side(self, leg: Leg) -> Callable[[float, FloatArray], tuple[float, float]]:
        """Over the time of a leg, from 0."""
        start, rate = leg.start, (leg.end - leg.start) / leg.lasts

        def function(t: float, x: FloatArray) -> tuple[float, float]:
            a, b = x.tolist()
            return self.rates(a, b, start + rate * t)

        return function


def integrated(task: Task, method: Method, delay: float, rtol: float) -> Run:
    """Integrate the viscous equations through a history.

    Parameters
    ----------
    task : Task
        The inflated state is taken from its pair: inflation costs these methods nothing.
    method : {"LSODA", "BDF", "Radau"}
        Jacobians by SciPy's finite differences, as by default.
    delay : float
        Relaxation time τ over the duration of the first ramp.
    rtol : float
        SciPy's; atol is a hundredth of it.

    Raises
    ------
    ViscousFailure
    """
    from scipy.integrate import solve_ivp

    equations = _Equations(task, delay)

    def tension(t: float, x: FloatArray) -> float:
        return float(equations.pressure(x.tolist()))

    tension.terminal, tension.direction = True, -1.0  # type: ignore[attr-defined]
    state: FloatArray = np.array(task.pair.sealed[:2])
    results: list[Any] = []
    for leg in task.legs:
        if leg.lasts == 0.0:
            results.append(None)
            continue
        result = solve_ivp(
            equations.right_hand_side(leg),
            (0.0, leg.lasts),
            state,
            method=method,
            rtol=rtol,
            atol=0.01 * rtol,
            events=tension,
            dense_output=True,
        )
        if not result.success:
            raise ViscousFailure(f"SciPy: {result.message}")
        times = leg.lasts * leg.fractions
        result.samples = result.sol(times[times <= result.t[-1]])
        results.append(result)
        state = result.y[:, -1]
        if result.status == 1:
            break
    return Run(equations, tuple(results))


def read(task: Task, run: Run) -> Solution:
    """A viscous history as a solution, with its snaps where the active stretch runs fastest.

    On a ramp a snap is a run of steps in which the larger |Δλᵢ|/Δt times the ramp's duration is above 30, and
    in which λ₁ moves by more than 0.1. Its voltage is that in the middle of the fastest of them; it has
    landed where that rate has fallen below 3, or falls no more. There is no state of rest before it to
    compare with.
    """
    equations = run.equations
    found: list[LimitPoint] = []
    samples: list[tuple[FloatArray, FloatArray, FloatArray, NDArray[np.int64]]] = []
    steps = calls = jumps = 0
    moved, slack = 0.0, False
    for number, (leg, result) in enumerate(zip(task.legs, run.results, strict=False)):
        if result is None:
            if leg.start != leg.end:
                jumps += 1
                stretch = run.results[number - 1].y[0, -1] if number else task.pair.sealed.active
                moved += 0.5 * equations.capacitance * (leg.end**2 - leg.start**2) * float(stretch) ** 4
            continue
        steps += result.t.size - 1
        calls += int(result.nfev)
        slack = result.status == 1
        snaps = _snaps(leg, result) if leg.is_ramp else []
        for at, after in snaps:
            landed = None if after is None else _state(equations, result.y[:, after])
            found.append(LimitPoint(number, _voltage(leg, at), None, landed))
        fractions = leg.fractions[: result.samples.shape[1]]
        passed = jumps + np.searchsorted([at / leg.lasts for at, _ in snaps], fractions)
        states = _state(equations, result.samples)
        samples.append(
            (number + fractions, leg.voltages()[: fractions.size], states, passed.astype(np.int64))
        )
        jumps += len(snaps)
        moved += _moved(equations, leg, result) if leg.is_ramp else 0.0
    last = next(r for r in reversed(run.results) if r is not None)
    leg = task.legs[len(run.results) - 1]
    end = _voltage(leg, last.t[-1]) if leg.is_ramp else leg.end
    return Solution(
        tuple(found),
        Samples(*(np.concatenate([s[k] for s in samples], axis=-1) for k in range(4))),
        float(equations.capacitance * end**2 * last.y[0, -1] ** 4) - moved,
        slack,
        sum(result is not None for result in run.results),
        steps,
        calls,
    )


def _snaps(leg: Leg, result: Any) -> list[tuple[float, int | None]]:
    """When each snap on a ramp is fastest, and the point where it lands; None where the ramp ends before."""
    stretch, times = result.y[0], result.t
    speed = np.max(np.abs(np.diff(result.y)), axis=0) / np.diff(times) * leg.lasts
    fast = np.concatenate([[False], speed > _FAST, [False]])
    begins, ends = np.flatnonzero(fast[1:] & ~fast[:-1]), np.flatnonzero(fast[:-1] & ~fast[1:])
    snaps: list[tuple[float, int | None]] = []
    for begin, end in zip(begins.tolist(), ends.tolist(), strict=True):
        if begin == 0 or abs(stretch[end] - stretch[begin]) < _FAR:
            continue  # still under way from a jump before the ramp, or nothing to speak of
        fastest = begin + int(np.argmax(speed[begin:end]))
        while end < speed.size and _SLOW < speed[end] < speed[end - 1]:
            end += 1
        lands = end < speed.size or result.status == 1
        snaps.append((float(0.5 * (times[fastest] + times[fastest + 1])), end if lands else None))
    return snaps


def _voltage(leg: Leg, t: Any) -> Any:
    return leg.start + (leg.end - leg.start) * (t / leg.lasts)


def _state(equations: _Equations, stretches: FloatArray) -> FloatArray:
    return np.vstack([stretches.reshape(2, -1), equations.pressure(stretches).reshape(1, -1)]).reshape(
        3, *stretches.shape[1:]
    )


def _moved(equations: _Equations, leg: Leg, result: Any) -> float:
    """∫q dφ of a ramp, by Gauss's rule in every step of the solver."""
    half = 0.5 * np.diff(result.t)
    times = (result.t[:-1] + half)[:, None] + half[:, None] * _GAUSS
    stretch = result.sol(times.ravel())[0].reshape(times.shape)
    charge = equations.capacitance * _voltage(leg, times) * stretch**4
    return float((leg.end - leg.start) / leg.lasts * np.sum(half * (charge @ _WEIGHTS)))
