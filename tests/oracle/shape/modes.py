"""Eigenvalues of the second variation of a balloon's energy about a sphere, degree by degree."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh

from tests.oracle.shape.elements import Mesh, capacitance, film, volume
from tests.oracle.shape.energies import under_voltage
from tests.oracle.shape.jets import Array, Energy, variables

SHARE = 0.9  # of an eigenvector's norm that lies in the fields of one degree; measured: 1 − 1e-6


@dataclass(frozen=True)
class Sphere:
    """A balloon in equilibrium as a sphere.

    Parameters
    ----------
    energy : Energy
        Of the film without a voltage.
    stretch, voltage : float
        λ and φ, in the balloon's own units (k = h = r = e = 1).
    gas : float
        −dp/dV of what is sealed in; 0 at a given pressure.
    charge : bool
        Whether the charge is given instead of the voltage.
    """

    energy: Energy
    stretch: float
    voltage: float = 0.0
    gas: float = 0.0
    charge: bool = False

    @property
    def pressure(self) -> float:
        """2w₁/λ², from the balance of forces."""
        at = np.array([self.stretch])
        slope = under_voltage(self.energy, self.voltage)(*variables(at, at)).gradient[0, 0]
        return float(2.0 * slope / self.stretch**2)


def second_variation(mesh: Mesh, sphere: Sphere) -> Array:
    """Hessian of the energy in the free unknowns of the mesh, a = b = 0."""
    rest = np.zeros(mesh.free.size)
    elastic = film(mesh, under_voltage(sphere.energy, sphere.voltage), sphere.stretch, rest)
    enclosed = volume(mesh, sphere.stretch, rest)
    hessian = elastic.hessian - sphere.pressure * enclosed.hessian
    hessian = hessian + sphere.gas * np.outer(enclosed.gradient, enclosed.gradient)
    if sphere.charge:
        held = capacitance(mesh, sphere.stretch, rest)
        hessian = hessian + sphere.voltage**2 / held.value * np.outer(held.gradient, held.gradient)
    return hessian


def harmonics(mesh: Mesh, degree: int) -> Array:
    """The normal and the tangential field of a degree, each of unit mean square, as columns.

    P_n along the normal, ∇P_n along the meridian; degree 0 has only the first.
    """
    polynomial = np.polynomial.legendre.Legendre.basis(degree)
    cosine, sine = np.cos(mesh.node_angles), np.sin(mesh.node_angles)
    normal = np.concatenate([polynomial(cosine), np.zeros(mesh.nodes)])[mesh.free]
    tangential = np.concatenate([np.zeros(mesh.nodes), -sine * polynomial.deriv()(cosine)])[mesh.free]
    fields = [normal] if degree == 0 else [normal, tangential]
    return np.column_stack([x / np.sqrt(x @ mesh.mass @ x) for x in fields])


def eigenvalues(mesh: Mesh, sphere: Sphere, degrees: range) -> dict[int, Array]:
    """Eigenvalues of the second variation over the mean of a² + b²: one of degree 0, two of every other.

    Parameters
    ----------
    mesh : Mesh
    sphere : Sphere
    degrees : range

    Returns
    -------
    dict
        Degree to its eigenvalues, ascending.

    Raises
    ------
    ValueError
        If the eigenvectors cannot be told apart by degree (the mesh is too coarse, or two eigenvalues of
        different degrees agree).
    """
    values, vectors = eigh(second_variation(mesh, sphere), mesh.mass)
    found = {}
    for degree in degrees:
        share = np.sum((harmonics(mesh, degree).T @ mesh.mass @ vectors) ** 2, axis=0)
        found[degree] = values[share > SHARE]
        if found[degree].size != (1 if degree == 0 else 2):
            raise ValueError(f"{found[degree].size} eigenvectors are of degree {degree}")
    return found
