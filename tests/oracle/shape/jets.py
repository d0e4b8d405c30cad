"""Automatic differentiation to second order, at many points at once: value, gradient, Hessian."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Jet:
    """A function of m variables at q points, to second order.

    Parameters
    ----------
    value : array, shape (q,)
    gradient : array, shape (q, m)
    hessian : array, shape (q, m, m)
    """

    value: Array
    gradient: Array
    hessian: Array

    def through(self, value: Array, first: Array, second: Array) -> Jet:
        """F(self) of a function F with this value and these two derivatives."""
        outer = self.gradient[:, :, None] * self.gradient[:, None, :]
        return Jet(
            value,
            first[:, None] * self.gradient,
            first[:, None, None] * self.hessian + second[:, None, None] * outer,
        )

    def __add__(self, other: Jet | Array | float) -> Jet:
        if isinstance(other, Jet):
            return Jet(self.value + other.value, self.gradient + other.gradient, self.hessian + other.hessian)
        return Jet(self.value + other, self.gradient, self.hessian)

    __radd__ = __add__

    def __neg__(self) -> Jet:
        return Jet(-self.value, -self.gradient, -self.hessian)

    def __sub__(self, other: Jet | Array | float) -> Jet:
        return self + (-other)

    def __rsub__(self, other: Array | float) -> Jet:
        return (-self) + other

    def __mul__(self, other: Jet | Array | float) -> Jet:
        if not isinstance(other, Jet):
            factor = np.broadcast_to(np.asarray(other, dtype=float), self.value.shape)
            return self.through(factor * self.value, factor, np.zeros_like(factor))
        mixed = self.gradient[:, :, None] * other.gradient[:, None, :]
        return Jet(
            self.value * other.value,
            self.value[:, None] * other.gradient + other.value[:, None] * self.gradient,
            self.value[:, None, None] * other.hessian
            + other.value[:, None, None] * self.hessian
            + mixed
            + mixed.transpose(0, 2, 1),
        )

    __rmul__ = __mul__

    def __truediv__(self, other: Jet | float) -> Jet:
        return self * other**-1

    def __rtruediv__(self, other: float) -> Jet:
        return other * self**-1

    def __pow__(self, exponent: float) -> Jet:
        x = self.value
        return self.through(
            x**exponent,
            exponent * x ** (exponent - 1.0),
            exponent * (exponent - 1.0) * x ** (exponent - 2.0),
        )


# A function of the two principal stretches in the plane of a film.
Energy = Callable[[Jet, Jet], Jet]


def log(x: Jet) -> Jet:
    """The natural logarithm of a jet."""
    return x.through(np.log(x.value), 1.0 / x.value, -1.0 / x.value**2)


def variables(*values: Array) -> tuple[Jet, ...]:
    """The independent variables themselves, each an array of shape (q,)."""
    m, q = len(values), values[0].size
    unit = np.eye(m)
    return tuple(
        Jet(np.asarray(x, dtype=float), np.tile(unit[i], (q, 1)), np.zeros((q, m, m)))
        for i, x in enumerate(values)
    )
