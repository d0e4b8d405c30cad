"""f(λ) and f′(λ) of all elastomers of the grammar, from their formulas in docs/physics.md."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.optimize import brentq


@dataclass(frozen=True)
class Wall:
    """An elastomer: `limit` is where it locks, `largest` the end of a measured curve."""

    force: Callable[[float], float]
    stiffness: Callable[[float], float]
    limit: float = math.inf
    largest: float = math.inf


def wall_of(elastomer: Any) -> Wall:
    """The elastomer of a balloon of a `Scenario`."""
    law = getattr(elastomer, "law", elastomer)
    match law.model:
        case "gent":
            return gent(law.J_lim)
        case "neo-hookean":
            return mooney_rivlin(1.0, 0.0)
        case "mooney-rivlin":
            return mooney_rivlin(law.C1, law.C2)
        case "ogden":
            return ogden(law.mu, law.alpha)
        case "arruda-boyce":
            return arruda_boyce(law.lambda_L)
        case "tabulated":
            return tabulated(law.stretches, law.forces)
    raise ValueError(f"no reference for the elastomer {law.model}")


def invariant(x: float) -> float:
    """I₁ − 3 = 2λ² + λ⁻⁴ − 3."""
    return 2.0 * x * x + x**-4 - 3.0


def _limit(invariant_at_lock: float) -> float:
    top = math.sqrt((invariant_at_lock + 3.0) / 2.0) + 1.0
    return float(brentq(lambda x: invariant(x) - invariant_at_lock, 1.0, top, xtol=1e-15, rtol=1e-15))


def gent(limit: float) -> Wall:
    def force(x: float) -> float:
        return 2.0 * (x - x**-5) / (1.0 - invariant(x) / limit)

    def stiffness(x: float) -> float:
        room = 1.0 - invariant(x) / limit
        return (2.0 + 10.0 * x**-6) / room + 8.0 * (x - x**-5) ** 2 / (limit * room * room)

    return Wall(force, stiffness, _limit(limit))


def mooney_rivlin(c1: float, c2: float) -> Wall:
    a, b = c1 / (c1 + c2), c2 / (c1 + c2)

    def force(x: float) -> float:
        return 2.0 * (x - x**-5) * (a + b * x * x)

    def stiffness(x: float) -> float:
        return (2.0 + 10.0 * x**-6) * (a + b * x * x) + 4.0 * b * x * (x - x**-5)

    return Wall(force, stiffness)


def ogden(mu: Sequence[float], alpha: Sequence[float]) -> Wall:
    size = 0.5 * sum(m * a for m, a in zip(mu, alpha, strict=True))
    terms = [(m / size, a) for m, a in zip(mu, alpha, strict=True)]

    def force(x: float) -> float:
        return 2.0 * math.fsum(m * (x ** (a - 1.0) - x ** (-2.0 * a - 1.0)) for m, a in terms)

    def stiffness(x: float) -> float:
        return 2.0 * math.fsum(
            m * ((a - 1.0) * x ** (a - 2.0) + (2.0 * a + 1.0) * x ** (-2.0 * a - 2.0)) for m, a in terms
        )

    return Wall(force, stiffness)


def inverse_langevin(y: float) -> float:
    """β with coth β − 1/β = y, by Newton's method from Cohen's formula."""
    if abs(y) < 1e-6:
        return 3.0 * y + 1.8 * y**3
    beta = y * (3.0 - y * y) / (1.0 - y * y)
    for _ in range(60):
        step = (langevin(beta) - y) / langevin_slope(beta)
        beta -= step
        if abs(step) <= 1e-15 * abs(beta):
            break
    return beta


def langevin(beta: float) -> float:
    if abs(beta) < 0.05:
        return beta / 3.0 - beta**3 / 45.0 + 2.0 * beta**5 / 945.0 - beta**7 / 4725.0
    return 1.0 / math.tanh(beta) - 1.0 / beta


def langevin_slope(beta: float) -> float:
    if abs(beta) < 0.05:
        return 1.0 / 3.0 - beta**2 / 15.0 + 2.0 * beta**4 / 189.0 - beta**6 / 675.0
    if abs(beta) > 300.0:
        return beta**-2
    return beta**-2 - math.sinh(beta) ** -2


def arruda_boyce(lock: float) -> Wall:
    def chain(x: float) -> float:
        return math.sqrt((invariant(x) + 3.0) / 3.0) / lock

    first = chain(1.0)
    unit = inverse_langevin(first) / first

    def force(x: float) -> float:
        y = chain(x)
        return 2.0 * (x - x**-5) * inverse_langevin(y) / y / unit

    def stiffness(x: float) -> float:
        y = chain(x)
        beta = inverse_langevin(y)
        # dI/dλ = 4(λ − λ⁻⁵), dy/dλ = (dI/dλ)/(6 λ_L² y).
        slope = 4.0 * (x - x**-5) / (6.0 * lock * lock * y)
        ratio = beta / y
        ratio_slope = (1.0 / langevin_slope(beta) - ratio) / y * slope
        return ((2.0 + 10.0 * x**-6) * ratio + 2.0 * (x - x**-5) * ratio_slope) / unit

    return Wall(force, stiffness, _limit(3.0 * lock * lock - 3.0))


def tabulated(stretches: Any, forces: Any) -> Wall:
    """The quintic not-a-knot spline through the rows, straight on beyond them."""
    spline = make_interp_spline(np.asarray(stretches), np.asarray(forces), k=5)
    slope = spline.derivative()
    low, high = float(stretches[0]), float(stretches[-1])

    def force(x: float) -> float:
        end = min(max(x, low), high)
        return float(spline(end) + slope(end) * (x - end))

    def stiffness(x: float) -> float:
        return float(slope(min(max(x, low), high)))

    return Wall(force, stiffness, largest=high)
