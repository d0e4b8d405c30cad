"""Viscoelastic branches: springs in series with dashpots, beside a balloon's elastomer.

A branch carries a share S of the force balance g and has inner strains that relax. Two laws exist.

`LinearBranch`: the metric in which the branch is stress free follows the film at a rate linear in both, with
inner strains a in the film's plane and b across it,

    S = 2k(aλ − bλ⁻⁵),    da/dt = (λ⁻² − a)/t,    db/dt = (λ⁴ − b)/t.

With x = aλ² and y = bλ⁻⁴ its energy is (k/2)[2(x − 1 − ln x) + (y − 1 − ln y)], and what it dissipates,
(k/t)[(x − 1)²/x + (y − 1)²/2y], is never negative.

`NewtonianBranch`: a neo-Hookean spring on a Newtonian dashpot, with an inner stretch ξ,

    S = (k/ξ) f(x),    dξ/dt = ξ x f(x)/(12 t),    x = λ/ξ,    f(x) = 2(x − x⁻⁵).

Small strains of both are those of a Maxwell element of modulus 12k that relaxes in the time t. Energies are
per unstretched volume and over μ here; `weight` r²h makes them those of a balloon, over 4πR²Hμ.

References
----------
S. Wang, M. Decker, D. L. Henann, S. A. Chester, J. Mech. Phys. Solids 95 (2016) 213–229: the linear flow.
C. C. Foo, S. Cai, S. J. A. Koh, S. Bauer, Z. Suo, J. Appl. Phys. 111 (2012) 034102: the Newtonian one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulator.model.elastomers import NeoHookean, Number, tension_force, tension_stiffness
from simulator.model.parts import Numbers, Tangent

FloatArray = NDArray[np.float64]

_SPRING = NeoHookean()


@dataclass(frozen=True)
class LinearBranch:
    """A branch whose inner strains relax linearly; see the head of this module.

    Attributes
    ----------
    modulus, time : float
        k over the reference balloon's, and t.
    weight : float
        r²h of its balloon.

    Examples
    --------
    >>> fresh = LinearBranch(modulus=0.5, time=10.0, weight=1.0)
    >>> share, rates, heat = fresh.moves(2.0, fresh.at_rest, v=0.0)
    >>> share, rates
    (1.96875, (-0.075, 1.5))
    """

    modulus: float
    time: float
    weight: float

    at_rest = (1.0, 1.0)
    books = ("heat",)
    electrical = False

    def moves(
        self, stretch: float, own: Sequence[float], v: float
    ) -> tuple[float, Sequence[float], Sequence[float]]:
        plane, across = own
        square = stretch * stretch
        x, y = plane * square, across / (square * square)
        per_time = 1.0 / self.time
        return (
            2.0 * self.modulus * (x - y) / stretch,
            ((1.0 / square - plane) * per_time, (square * square - across) * per_time),
            (self.weight * self.modulus * per_time * ((x - 1.0) ** 2 / x + 0.5 * (y - 1.0) ** 2 / y),),
        )

    def tangent(self, stretch: float, own: Sequence[float], v: float) -> Tangent:
        plane, across = own
        square = stretch * stretch
        fourth = square * square
        x, y = plane * square, across / fourth
        k, per_time = 2.0 * self.modulus, 1.0 / self.time
        heat = self.weight * self.modulus * per_time
        per_x, per_y = heat * (1.0 - 1.0 / (x * x)), 0.5 * heat * (1.0 - 1.0 / (y * y))
        return Tangent(
            k * (x + 5.0 * y) / square,
            (k * stretch, -k / (fourth * stretch)),
            (-2.0 * per_time / (square * stretch), 4.0 * per_time * square * stretch),
            (-per_time, -per_time),
            ((2.0 * x * per_x - 4.0 * y * per_y) / stretch,),
            ((per_x * square, per_y / fourth),),
        )

    def stiffness(self, stretch: Number, own: Numbers) -> Number:
        return 2.0 * self.modulus * (own[0] + 5.0 * own[1] * stretch**-6)

    def sphericity(self, stretch: Number, own: Numbers) -> Number:
        return 12.0 * self.modulus * own[1] * stretch**-6

    def shear_stiffness(self, stretch: Number, own: Numbers) -> Number:
        return self.modulus * own[0]

    def energy(self, stretch: Number, own: Numbers) -> Number:
        x, y = own[0] * stretch**2, own[1] / stretch**4
        return 0.5 * self.weight * self.modulus * (2.0 * _above_log(x) + _above_log(y))

    def columns(self, own: FloatArray) -> dict[str, FloatArray]:
        return {"": own[:, 0] ** -0.5, "thickness": own[:, 1] ** -0.5}


@dataclass(frozen=True)
class NewtonianBranch:
    """A neo-Hookean spring on a Newtonian dashpot; see the head of this module.

    Attributes
    ----------
    modulus, time : float
        k over the reference balloon's, and t.
    weight : float
        r²h of its balloon.
    """

    modulus: float
    time: float
    weight: float

    at_rest = (1.0,)
    books = ("heat",)
    electrical = False

    def moves(
        self, stretch: float, own: Sequence[float], v: float
    ) -> tuple[float, Sequence[float], Sequence[float]]:
        (inner,) = own
        ratio = stretch / inner
        force = tension_force(_SPRING, ratio)
        share, rate = self.modulus * force / inner, inner * ratio * force / (12.0 * self.time)
        return share, (rate,), (self.weight * share * stretch * rate / inner,)

    def tangent(self, stretch: float, own: Sequence[float], v: float) -> Tangent:
        (inner,) = own
        ratio = stretch / inner
        force, slope = tension_force(_SPRING, ratio), tension_stiffness(_SPRING, ratio)
        bent, per_time = force + ratio * slope, 1.0 / (12.0 * self.time)
        heat = 2.0 * self.weight * self.modulus * per_time * ratio * force * bent / inner
        return Tangent(
            self.modulus * slope / (inner * inner),
            (-self.modulus * bent / (inner * inner),),
            (bent * per_time,),
            (-ratio * ratio * slope * per_time,),
            (heat,),
            ((-heat * ratio,),),
        )

    def stiffness(self, stretch: Number, own: Numbers) -> Number:
        return self.modulus * tension_stiffness(_SPRING, stretch / own[0]) / own[0] ** 2

    def sphericity(self, stretch: Number, own: Numbers) -> Number:
        return 12.0 * self.modulus * own[0] ** 4 * stretch**-6

    def shear_stiffness(self, stretch: Number, own: Numbers) -> Number:
        return self.modulus * own[0] ** -2

    def energy(self, stretch: Number, own: Numbers) -> Number:
        # ½(2x² + x⁻⁴ − 3), without cancellation at small strains.
        x = stretch / own[0]
        square = x * x
        grown = (x - 1.0) * (x + 1.0) / square
        return 0.5 * self.weight * self.modulus * grown * grown * (2.0 * square + 1.0)

    def columns(self, own: FloatArray) -> dict[str, FloatArray]:
        return {"": own[:, 0]}


AnyBranch = LinearBranch | NewtonianBranch


def _above_log(x: Number) -> Number:
    """x − 1 − ln x, which is never negative."""
    return (x - 1.0) - np.log1p(x - 1.0)
