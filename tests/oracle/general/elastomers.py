"""Strain energies of the elastomers, written from the table in docs/physics.md.

A `Law` is three functions of the stretch (a float, or a complex number with a tiny imaginary part): the
energy ŵ over the shear modulus, f = ŵ′ and f′. Values outside a law's range are NaN, which every solver
here takes for "not this way".
"""

from __future__ import annotations

import cmath
import math
from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

Function = Callable[[Any], Any]

PRESETS: Mapping[str, Mapping[str, Any]] = {
    "VHB-4910": {"model": "arruda-boyce", "lambda_L": 5.99},
    "Sylgard-186": {"model": "gent", "J_lim": 30.04},
    "natural-rubber": {"model": "ogden", "mu": [6.3e5, 1.2e3, -1.0e4], "alpha": [1.3, 5.0, -2.0]},
}


@dataclass(frozen=True)
class Law:
    """One elastomer.

    Attributes
    ----------
    energy, force, slope : callable
        ŵ, f = ŵ′ and f′ of the stretch.
    limit : float
        Stretch at which the wall locks; infinite where it never does.
    end : float
        Last stretch of a measured curve; infinite for a formula.
    """

    energy: Function
    force: Function
    slope: Function
    limit: float = math.inf
    end: float = math.inf

    @property
    def may_run_away(self) -> bool:
        """Whether nothing bounds the stretch."""
        return math.isinf(self.limit) and math.isinf(self.end)


def _invariant(x: Any) -> Any:
    """I₁ − 3 = 2λ² + λ⁻⁴ − 3, without cancellation beside λ = 1."""
    d = (x - 1.0) * (x + 1.0)  # with s = λ²: 2s + s⁻² − 3 = (s − 1)²(2s + 1)/s²
    s = x * x
    return d * d * (2.0 * s + 1.0) / (s * s)


def _rise(x: Any) -> Any:
    """λ − λ⁻⁵, without cancellation beside λ = 1."""
    s = x * x
    return (x - 1.0) * (x + 1.0) * (s * s + s + 1.0) / (s * s * x)


def _log(x: Any) -> Any:
    if isinstance(x, complex):
        return cmath.log(x)
    return math.log(x) if x > 0.0 else math.nan


def gent(J: float) -> Law:
    """Gent: ŵ = −(J/2) ln(1 − I/J)."""
    # The stretch limit is the root of 2s³ − (3 + J)s² + 1 above 1, s = λ².
    s = float(max(np.roots([2.0, -(3.0 + J), 0.0, 1.0]).real))
    for _ in range(4):
        s -= (2.0 * s**3 - (3.0 + J) * s**2 + 1.0) / (6.0 * s**2 - 2.0 * (3.0 + J) * s)
    limit = math.sqrt(s)

    def room(x: Any) -> Any:
        out = 1.0 - _invariant(x) / J
        return out if out.real > 0.0 and x.real > 0.0 else math.nan

    def force(x: Any) -> Any:
        return 2.0 * _rise(x) / room(x)

    def slope(x: Any) -> Any:
        left = room(x)
        rise = _rise(x)
        return 2.0 * (1.0 + 5.0 / x**6) / left + 8.0 * rise * rise / (J * left * left)

    return Law(lambda x: -0.5 * J * _log(room(x)), force, slope, limit=limit)


def neo_hookean() -> Law:
    """Neo-Hookean: ŵ = I/2."""
    return mooney_rivlin(1.0, 0.0)


def mooney_rivlin(C1: float, C2: float) -> Law:
    """Mooney–Rivlin: ŵ = ½[c₁(2λ² + λ⁻⁴ − 3) + c₂(λ⁴ + 2λ⁻² − 3)] with c₁ + c₂ = 1."""
    a, b = C1 / (C1 + C2), C2 / (C1 + C2)

    def energy(x: Any) -> Any:
        s = x * x
        d = s - 1.0
        return 0.5 * (a * _invariant(x) + b * d * d * (s + 2.0) / s)

    def force(x: Any) -> Any:
        return 2.0 * _rise(x) * (a + b * x * x) if x.real > 0.0 else math.nan

    def slope(x: Any) -> Any:
        return 2.0 * (1.0 + 5.0 / x**6) * (a + b * x * x) + 4.0 * b * x * _rise(x)

    return Law(energy, force, slope)


def ogden(mu: Sequence[float], alpha: Sequence[float]) -> Law:
    """Ogden: ŵ = Σ mᵢ/αᵢ (2λ^αᵢ + λ^(−2αᵢ) − 3), ½ Σ mᵢαᵢ = 1."""
    modulus = 0.5 * math.fsum(m * a for m, a in zip(mu, alpha, strict=True))
    terms = [(m / modulus, float(a)) for m, a in zip(mu, alpha, strict=True)]

    def total(x: Any, term: Callable[[float, float, Any], Any]) -> Any:
        if not x.real > 0.0:
            return math.nan
        try:
            return sum((term(m, a, _log(x)) for m, a in terms), start=0.0)
        except OverflowError:
            return math.nan

    def energy(x: Any) -> Any:
        return total(x, lambda m, a, u: m / a * (2.0 * _expm1(a * u) + _expm1(-2.0 * a * u)))

    def force(x: Any) -> Any:
        return 2.0 / x * total(x, lambda m, a, u: m * _exp(-2.0 * a * u) * _expm1(3.0 * a * u))

    def slope(x: Any) -> Any:
        return (2.0 / (x * x)) * total(
            x, lambda m, a, u: m * ((a - 1.0) * _exp(a * u) + (2.0 * a + 1.0) * _exp(-2.0 * a * u))
        )

    return Law(energy, force, slope)


def _exp(u: Any) -> Any:
    return cmath.exp(u) if isinstance(u, complex) else math.exp(u)


def _expm1(u: Any) -> Any:
    if isinstance(u, complex):  # only with a tiny imaginary part
        return complex(math.expm1(u.real), math.exp(u.real) * u.imag)
    return math.expm1(u)


# Taylor coefficients of the Langevin function, β/3 − β³/45 + …: 2^(2k) B_2k/(2k)! for k = 1, 2, …
_LANGEVIN = (1 / 3, -1 / 45, 2 / 945, -1 / 4725, 2 / 93555, -1382 / 638512875, 4 / 18243225)
_LANGEVIN_SMALL = 0.25


def langevin(b: float) -> float:
    """L(β) = coth β − 1/β."""
    if b < _LANGEVIN_SMALL:
        return sum(c * b ** (2 * k + 1) for k, c in enumerate(_LANGEVIN))
    return 1.0 + 2.0 / math.expm1(2.0 * b) - 1.0 / b if b < 350.0 else 1.0 - 1.0 / b


def langevin_slope(b: float) -> float:
    """L′(β) = 1/β² − 1/sinh²β."""
    if b < _LANGEVIN_SMALL:
        return sum((2 * k + 1) * c * b ** (2 * k) for k, c in enumerate(_LANGEVIN))
    return 1.0 / (b * b) - (1.0 / math.sinh(b) ** 2 if b < 350.0 else 0.0)


def inverse_langevin(x: float) -> float:
    """β with L(β) = x, for 0 < x < 1: Newton's method from Cohen's approximation, on 1 − L close to 1."""
    if not 0.0 < x < 1.0:
        return math.nan
    b = x * (3.0 - x * x) / (1.0 - x * x)
    for _ in range(60):
        if b > 20.0:  # 1 − x = 1/β − 2/(e^2β − 1), well conditioned in 1/β
            new = 1.0 / ((1.0 - x) + (2.0 / math.expm1(2.0 * b) if b < 350.0 else 0.0))
        else:
            new = b - (langevin(b) - x) / langevin_slope(b)
        if not abs(new - b) > 1e-9 * b:  # the next step would be the square of this one
            return new
        b = new
    return b


def arruda_boyce(lambda_L: float) -> Law:
    """Arruda–Boyce with the inverse Langevin function itself."""
    x0 = 1.0 / lambda_L
    unit = inverse_langevin(x0) / x0
    # 2λ² + λ⁻⁴ = 3λ_L² where the chains are straight; the same cubic as for Gent.
    limit = gent(3.0 * lambda_L**2 - 3.0).limit

    def chain(x: Any) -> tuple[Any, Any]:
        """Chain stretch over its limit, and β there."""
        if not x.real > 0.0:
            return math.nan, math.nan
        share = (1.0 + _invariant(x) / 3.0) ** 0.5 / lambda_L
        b = inverse_langevin(share.real)
        if isinstance(share, complex) and not math.isnan(b):
            return share, b + 1j * share.imag / langevin_slope(b)
        return share, b

    def energy(x: Any) -> float:
        def raw(share: float, b: float) -> float:
            ratio = math.log(b / math.sinh(b)) if b < 350.0 else math.log(2.0 * b) - b
            return share * b + ratio

        share, b = chain(float(x))
        if math.isnan(b):
            return math.nan
        return 3.0 / (x0 * x0 * unit) * (raw(share, b) - raw(x0, x0 * unit))

    def force(x: Any) -> Any:
        share, b = chain(x)
        return 2.0 * _rise(x) * (b / share) / unit

    def slope(x: Any) -> Any:
        share, b = chain(x)
        if isinstance(b, complex):
            steepness = 1.0 / _complex_langevin_slope(b)
        else:
            steepness = 1.0 / langevin_slope(b) if not math.isnan(b) else math.nan
        rise = _rise(x)
        dshare = 2.0 * rise * x0 * x0 / (3.0 * share)
        change = (steepness * share - b) / (share * share) * dshare
        return (2.0 * (1.0 + 5.0 / x**6) * (b / share) + 2.0 * rise * change) / unit

    return Law(energy, force, slope, limit=limit)


def _complex_langevin_slope(b: complex) -> complex:
    """L′ beside the real axis: L′ + i L″ Im β."""
    r = b.real
    if r < _LANGEVIN_SMALL:
        second = sum((2 * k + 1) * 2 * k * c * r ** (2 * k - 1) for k, c in enumerate(_LANGEVIN) if k)
    else:
        second = -2.0 / r**3 + (2.0 / (math.sinh(r) ** 2 * math.tanh(r)) if r < 350.0 else 0.0)
    return complex(langevin_slope(r), second * b.imag)


def _of_invariant(energy: Function, rate: Function, second: Function) -> Law:
    """ŵ = w(I), from w, 2w′ and 2w″ of I = I₁ − 3."""

    def force(x: Any) -> Any:
        return 2.0 * _rise(x) * rate(_invariant(x)) if x.real > 0.0 else math.nan

    def slope(x: Any) -> Any:
        i, rise = _invariant(x), _rise(x)
        return 2.0 * (1.0 + 5.0 / x**6) * rate(i) + 8.0 * rise * rise * second(i)

    return Law(lambda x: energy(_invariant(x)), force, slope)


def yeoh(C1: float, C2: float, C3: float = 0.0) -> Law:
    """Yeoh: ŵ = ½(I + c₂I² + c₃I³), cᵢ = Cᵢ/C₁."""
    a, b = C2 / C1, C3 / C1
    return _of_invariant(
        lambda i: 0.5 * i * (1.0 + i * (a + i * b)),
        lambda i: 1.0 + i * (2.0 * a + 3.0 * b * i),
        lambda i: 2.0 * a + 6.0 * b * i,
    )


def fung(b: float) -> Law:
    """Fung: ŵ = (e^bI − 1)/2b."""

    def rate(i: Any) -> Any:
        try:
            return _exp(b * i)
        except OverflowError:
            return math.nan

    return _of_invariant(lambda i: 0.5 * _expm1(b * i) / b, rate, lambda i: b * rate(i))


def gent_gent(C1: float, C2: float, J_lim: float) -> Law:
    """Gent–Gent: ŵ = −(m₁/2) J ln(1 − I/J) + (3/2) m₂ ln(I₂/3), of W = −c₁J ln(1 − I/J) + c₂ ln(I₂/3)."""
    modulus = 2.0 * C1 + 2.0 * C2 / 3.0
    first, second = 2.0 * C1 / modulus, 2.0 * C2 / 3.0 / modulus
    locking = gent(J_lim)

    def energy(x: Any) -> Any:
        s = x * x
        rest = (s - 1.0) ** 2 * (s + 2.0) / s  # I₂ − 3
        return first * locking.energy(x) + 1.5 * second * _log(1.0 + rest / 3.0)

    def force(x: Any) -> Any:
        return first * locking.force(x) + 6.0 * second * _rise(x) * x**4 / (x**6 + 2.0)

    def slope(x: Any) -> Any:
        softer = 2.0 * (1.0 + 5.0 / x**6) * x**4 / (x**6 + 2.0)
        softer += 2.0 * _rise(x) * (8.0 * x**3 - 2.0 * x**9) / (x**6 + 2.0) ** 2
        return first * locking.slope(x) + 3.0 * second * softer

    return Law(energy, force, slope, limit=locking.limit)


def tabulated(stretch: Sequence[float], force: Sequence[float]) -> Law:
    """The quintic spline (not-a-knot) through the rows (λ, f); straight outside them."""
    from scipy.interpolate import PPoly, make_interp_spline

    x, f = np.asarray(stretch, dtype=float), np.asarray(force, dtype=float)
    spline = PPoly.from_spline(make_interp_spline(x, f, k=5))
    long = np.diff(spline.x) > 0.0
    starts = spline.x[:-1][long].tolist()
    rows = [tuple(reversed(c)) for c in spline.c[:, long].T.tolist()]
    energies = spline.antiderivative()(starts).tolist()
    first, last = float(spline(x[0], 1)), float(spline(x[-1], 1))
    starts = [-math.inf, *starts, float(x[-1])]
    origin = [float(x[0]), *starts[1:]]
    rows = [(0.0, first), *rows, (float(f[-1]), last)]
    energies = [0.0, *energies, float(spline.antiderivative()(x[-1]))]

    def piece(u: Any) -> tuple[Any, float, tuple[float, ...]]:
        i = bisect_right(starts, u.real) - 1
        return u - origin[i], energies[i], rows[i]

    def energy(u: Any) -> Any:
        d, start, c = piece(u)
        return start + sum(a * d ** (k + 1) / (k + 1) for k, a in enumerate(c))

    def curve(u: Any) -> Any:
        d, _, c = piece(u)
        return sum(a * d**k for k, a in enumerate(c))

    def slope(u: Any) -> Any:
        d, _, c = piece(u)
        return sum(k * a * d ** (k - 1) for k, a in enumerate(c) if k)

    return Law(energy, curve, slope, end=float(x[-1]))


def law_of(written: Mapping[str, Any], curve: Callable[[str], tuple[Any, Any]]) -> Law:
    """The law that a scenario's `elastomer` table names; `curve` reads the rows (λ, f) of a measured one."""
    if "preset" in written:
        written = PRESETS[written["preset"]]
    match written["model"]:
        case "gent":
            return gent(float(written["J_lim"]))
        case "neo-hookean":
            return neo_hookean()
        case "mooney-rivlin":
            return mooney_rivlin(float(written["C1"]), float(written["C2"]))
        case "ogden":
            return ogden([float(m) for m in written["mu"]], [float(a) for a in written["alpha"]])
        case "arruda-boyce":
            return arruda_boyce(float(written["lambda_L"]))
        case "yeoh":
            return yeoh(float(written["C1"]), float(written["C2"]), float(written.get("C3", 0.0)))
        case "gent-gent":
            return gent_gent(float(written["C1"]), float(written["C2"]), float(written["J_lim"]))
        case "fung":
            return fung(float(written["b"]))
        case "tabulated":
            return tabulated(*curve(written["table"]))
        case other:
            raise ValueError(f"no such elastomer: {other}")


def loaded_law(elastomer: Any) -> Law:
    """The law of an elastomer of a scenario that is loaded already."""
    law = getattr(elastomer, "law", elastomer)
    return law_of(law.model_dump(), lambda _: (law.stretches, law.forces))
