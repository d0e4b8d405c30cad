"""The second variation about a sphere as a 2×2 matrix, and the elastomers' coefficients in it, by formulas.

docs/shape.md has the derivation. A displacement W Y n + U ∇Y, with Y a spherical harmonic of degree n and
N = n(n + 1), changes the energy of a balloon (per 4πR²Hμ) by half of

    (W, U) A (W, U)ᵀ · mean Y²,      A = [4K + T(N − 2)    −2KN                    ]
                                         [−2KN             KN² + (G + T) N (N − 2)]

T is the tension w₁/λ, K the modulus of a change of area and G that of shear in the plane of the film. In the
balloon's own units (k = h = r = e = 1).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh

from tests.oracle.shape.jets import Array


@dataclass(frozen=True)
class Coefficients:
    """T, K and G of a film under equal stretches."""

    tension: float
    area: float
    shear: float

    @property
    def margin(self) -> float:
        """s = 4K: positive as long as the sphere holds against the pear."""
        return 4.0 * self.area

    @property
    def baker_ericksen(self) -> float:
        """G + T; no voltage changes it. Where it is negative the film shears in its own plane."""
        return self.shear + self.tension


@dataclass(frozen=True)
class Ogden:
    """Σ (mᵢ/αᵢ)(λ₁^αᵢ + λ₂^αᵢ + λ₃^αᵢ − 3), ½Σmᵢαᵢ = 1 after scaling; also neo-Hookean and Mooney–Rivlin."""

    moduli: tuple[float, ...]
    exponents: tuple[float, ...]

    def coefficients(self, stretch: float) -> Coefficients:
        """Without a voltage."""
        x = np.array(self.exponents)
        m = np.array(self.moduli) / (0.5 * np.dot(self.moduli, self.exponents))
        rising, falling = stretch ** (x - 2.0), stretch ** (-2.0 * x - 2.0)
        tension = float(m @ (rising - falling))
        area = 0.5 * float(m @ ((x - 2.0) * rising + (2.0 * x + 2.0) * falling))
        return Coefficients(tension, area, 0.5 * float(m @ (x * rising)) - tension)


@dataclass(frozen=True)
class Gent:
    """−(J/2) ln(1 − (I₁ − 3)/J)."""

    limit: float

    def coefficients(self, stretch: float) -> Coefficients:
        """Without a voltage."""
        left = 1.0 - (2.0 * stretch**2 + stretch**-4 - 3.0) / self.limit
        slope = 4.0 * (stretch - stretch**-5)  # of I₁
        tension = (1.0 - stretch**-6) / left
        area = 0.5 * stretch * (6.0 * stretch**-7 / left + tension * slope / (self.limit * left))
        return Coefficients(tension, area, stretch**-6 / left)


def neo_hookean() -> Ogden:
    """(I₁ − 3)/2."""
    return Ogden((1.0,), (2.0,))


def mooney_rivlin(first: float) -> Ogden:
    """C₁(I₁ − 3)/2 + C₂(I₂ − 3)/2 with C₁ + C₂ = 1."""
    return Ogden((first, first - 1.0), (2.0, -2.0))


def under_voltage(film: Coefficients, stretch: float, voltage: float) -> Coefficients:
    """The same film under a voltage: T − φ²λ², K − φ²λ², G + φ²λ²."""
    square = (voltage * stretch) ** 2
    return Coefficients(film.tension - square, film.area - square, film.shear + square)


def matrix(film: Coefficients, degree: int) -> Array:
    """A of a degree; of degree 0 its 1×1 part, since U does not exist."""
    N = degree * (degree + 1)
    T, K, G = film.tension, film.area, film.shear
    normal = 4.0 * K + T * (N - 2)
    if degree == 0:
        return np.array([[normal]])
    return np.array([[normal, -2.0 * K * N], [-2.0 * K * N, K * N**2 + (G + T) * N * (N - 2)]])


def eigenvalues(film: Coefficients, degree: int, radial: float = 0.0) -> Array:
    """Eigenvalues of A over the mean square of the displacement, (W² + N U²) mean Y²; ascending.

    Parameters
    ----------
    film : Coefficients
        Under its voltage.
    degree : int
    radial : float
        What gas and charge add to the stiffness of degree 0 (`held`).
    """
    A = matrix(film, degree)
    if degree == 0:
        return np.array([A[0, 0] + radial])
    values: Array = eigh(A, np.diag([1.0, degree * (degree + 1.0)]), eigvals_only=True)
    return values


def held(stretch: float, voltage: float, gas: float, charge: bool) -> float:
    """Stiffness that a sealed content (−dp/dV) and a given charge add to degree 0: γλ⁴ + 16φ²λ²."""
    return gas * stretch**4 + (16.0 * (voltage * stretch) ** 2 if charge else 0.0)


def lost_at(film: Coefficients, degree: int) -> float:
    """K at which a degree n ≥ 2 is lost, all else the same: negative while T > 0 and G + T > 0."""
    N = degree * (degree + 1)
    T, B = film.tension, film.baker_ericksen
    return -(N - 2) * T * B / (4.0 * B + N * T)
