"""Shear within the surface: each parallel of latitude turns about the axis, by an angle of its own.

The displacement n × ∇P_n of the sphere, which the fields of `elements` leave out. Its second variation comes
from second differences of the energy.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tests.oracle.shape.jets import Array

POINTS = 60  # Gauss points in cos θ
AMPLITUDE = 1e-3  # of the displacement, over the radius

PlainEnergy = Callable[[Array, Array], Array]


def potential(energy: PlainEnergy, stretch: float, pressure: float, degree: int, amplitude: float) -> float:
    """Film less pressure times volume, per 4πR²Hμ, displaced by this amplitude of n × ∇P_n."""
    cosine, weights = np.polynomial.legendre.leggauss(POINTS)
    sine = np.sqrt(1.0 - cosine**2)
    polynomial = np.polynomial.legendre.Legendre.basis(degree)
    first, second = polynomial.deriv()(cosine), polynomial.deriv(2)(cosine)
    along = -amplitude * sine * first  # c(θ), azimuthal
    slope = -amplitude * (cosine * first - sine**2 * second)  # c′(θ)
    meridian, parallel = stretch**2 + slope**2, stretch**2 + (along / sine) ** 2
    mixed = stretch * (slope - along * cosine / sine)
    mean = 0.5 * (meridian + parallel)
    half = np.hypot(0.5 * (meridian - parallel), mixed)
    film = energy(np.sqrt(mean + half), np.sqrt(mean - half))
    volume = stretch**3 / 3.0 + 0.5 * stretch * (0.5 * weights @ along**2)
    return float(0.5 * weights @ film - pressure * volume)


def stiffness(energy: PlainEnergy, stretch: float, pressure: float, degree: int) -> float:
    """Twice the second variation over the mean of P_n², extrapolated from two amplitudes to none."""
    here = potential(energy, stretch, pressure, degree, 0.0)
    small, large = (
        2.0 * (potential(energy, stretch, pressure, degree, x) - here) / x**2 * (2 * degree + 1)
        for x in (AMPLITUDE, 2.0 * AMPLITUDE)
    )
    return (4.0 * small - large) / 3.0
