"""The overdamped flow of a sealed pair at a frozen voltage: where a snap comes to rest, or ends."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tests.oracle.closed_form.balloons import UNBOUNDED
from tests.oracle.closed_form.pair import SealedPair, State
from tests.oracle.closed_form.roots import STEP, bracketed

FloatArray = NDArray[np.float64]

_SLOW = 1e-3  # a speed of the flow below which it is followed in time
_MOST_CALLS = 300_000  # of the flow's right-hand side


@dataclass(frozen=True)
class Flow:
    """Where an overdamped flow ended: at rest in `state` (`end` None), or in an event on the way.

    `lowest_pressure` and `lowest_strength` (of 1 − E/E_b) are the smallest values it passed.
    """

    state: State
    end: Literal["loss_of_tension", "breakdown", "runaway"] | None
    lowest_pressure: float
    lowest_strength: float


def overdamped_flow(
    pair: SealedPair, voltage: float, start: FloatArray, rests: Sequence[State], equilibria: Sequence[State]
) -> Flow:
    """The flow dλᵢ/dt = −gᵢ at a frozen voltage, the gas law holding throughout, to the end.

    Only the way matters, so it is integrated over its length, which passes the slow start off a limit point
    in a few steps; and where it hardly moves, g ≪ 1e-3, over the time times 1e-3: there rounding blurs the
    direction of g, not where it leads.

    Parameters
    ----------
    start : (2,) array
        Stretches it starts from.
    rests : sequence of State
        The stable equilibria at this voltage: the only places where it can rest. It is there when it is
        within 1e-5 of one, and a thousand times nearer than any other equilibrium is.
    equilibria : sequence of State
        All equilibria at this voltage.

    Raises
    ------
    ArithmeticError
        If it neither rests nor ends.
    """
    from scipy.integrate import solve_ivp

    active = pair.active
    limits = [b.elastomer.stretch_limit for b in (pair.active, pair.passive)]
    balls = []
    for rest in rests:
        gaps = (math.hypot(e.active - rest.active, e.passive - rest.passive) for e in equilibria)
        balls.append((rest.active, rest.passive, min([1e-5, *(1e-3 * gap for gap in gaps if gap > 0.0)])))
    calls = 0

    # In Python's own numbers: arrays of two are slow.
    highest = [limit * (1.0 - 1e-13) for limit in limits]

    def rates(x: FloatArray) -> tuple[float, float]:
        a, b = x.tolist()
        # A trial step may lead across the stretch limit; it comes back from there.
        a, b = min(a, highest[0]), min(b, highest[1])
        g, h = pair.forces(a, b, pair.pressure(a, b), voltage)
        return -g, -h

    def direction(t: float, x: FloatArray) -> tuple[float, float]:
        nonlocal calls
        calls += 1
        if calls > _MOST_CALLS:
            raise ArithmeticError(f"the flow from {start.tolist()} at the voltage {voltage!r} does not end")
        u, v = rates(x)
        speed = math.hypot(u, v) + _SLOW
        return u / speed, v / speed

    def jacobian(t: float, x: FloatArray) -> FloatArray:
        rate = np.array(rates(x))
        speed = math.hypot(*rate)
        unit = rate / (speed or 1.0)
        out = np.empty((2, 2))
        for j in range(2):
            y: list[Any] = [min(a, top) for a, top in zip(x.tolist(), highest, strict=True)]
            y[j] += 1j * STEP
            forces = pair.forces(y[0], y[1], pair.pressure(y[0], y[1]), voltage)
            out[:, j] = [-g.imag / STEP for g in forces]
        share = speed / (speed + _SLOW)
        return np.asarray((out - share * np.outer(unit, unit @ out)) / (speed + _SLOW))

    def tension(t: float, x: FloatArray) -> float:
        return float(pair.pressure(*x.tolist()))

    def pressure_rate(t: float, x: FloatArray) -> float:
        # −dV/dt, of the sign of dp/dt: zero at the lowest pressure, which a step might pass over.
        (a, b), (u, v) = x.tolist(), rates(x)
        return float(-pair.active.cube * a * a * u - pair.passive.cube * b * b * v)

    def strength(t: float, x: FloatArray) -> float:
        if active.breakdown is None:
            return 1.0
        return 1.0 - abs(voltage) * float(x[0]) ** 2 / (active.thickness * active.breakdown)

    def distance(t: float, x: FloatArray) -> float:
        a, b = x.tolist()
        return min((math.hypot(a - c, b - d) - r for c, d, r in balls), default=1.0)

    def nearest(x: FloatArray) -> State:
        return min(rests, key=lambda rest: math.hypot(x[0] - rest.active, x[1] - rest.passive))

    def away(t: float, x: FloatArray) -> float:
        return UNBOUNDED - max(
            (a for a, top in zip(x.tolist(), limits, strict=True) if top == math.inf), default=0.0
        )

    events: list[Any] = [tension, strength, distance, away, pressure_rate]
    for event in events[:4]:
        event.terminal, event.direction = True, -1.0
    pressure_rate.direction = 1.0  # type: ignore[attr-defined]
    if distance(0.0, start) <= 0.0:
        rest = nearest(start)
        return Flow(rest, None, rest.pressure, strength(0.0, start))
    if tension(0.0, start) <= 0.0:
        return Flow(_flowing(pair, start), "loss_of_tension", tension(0.0, start), strength(0.0, start))
    if strength(0.0, start) <= 0.0:
        return Flow(_flowing(pair, start), "breakdown", tension(0.0, start), strength(0.0, start))
    result = solve_ivp(
        direction,
        (0.0, 1e9),
        start,
        method="Radau",
        rtol=1e-10,
        atol=1e-12,
        jac=jacobian,
        events=events,
        dense_output=True,
    )
    lows = [tension(0.0, x) for x in [*result.y.T, *result.y_events[4]]]
    weakest = min(strength(0.0, x) for x in result.y.T)
    crossings = result.t_events[0].tolist()
    # A dip below zero within one step shows in its lowest point alone.
    for t in [t for t in result.t_events[4] if tension(t, result.sol(t)) < 0.0][:1]:
        begin = result.t[np.searchsorted(result.t, t) - 1]
        at = bracketed(
            lambda s: np.array([tension(0.0, result.sol(x)) for x in s]),
            np.array([begin]),
            np.array([t]),
            1.0,
        )
        crossings = [float(at[0]), *crossings]
    if crossings:
        return Flow(_flowing(pair, result.sol(crossings[0])), "loss_of_tension", 0.0, weakest)
    if result.t_events[1].size:
        return Flow(_flowing(pair, result.y_events[1][0]), "breakdown", min(lows), 0.0)
    if result.t_events[2].size:
        rest = nearest(result.y[:, -1])
        return Flow(rest, None, min(min(lows), rest.pressure), weakest)
    if result.t_events[3].size:
        return Flow(_flowing(pair, result.y[:, -1]), "runaway", min(lows), weakest)
    raise ArithmeticError(f"the flow from {start.tolist()} at the voltage {voltage!r} neither rests nor ends")


def _flowing(pair: SealedPair, stretches: FloatArray) -> State:
    active, passive = (float(x) for x in stretches)
    return State(active, passive, float(pair.pressure(active, passive)))
