"""An axisymmetric membrane balloon in finite elements of the meridian angle: energy, gradient, Hessian.

The unstretched balloon is the unit sphere with meridian angle θ. A point of it goes to (Λ + a) n + b t, with
n the outward normal, t the unit tangent in the direction of θ, and Λ the stretch of the sphere from which
the fields a(θ), b(θ) are measured. Then

    λ₁² = (Λ + a + b′)² + (a′ − b)²,      λ₂ = Λ + a + b cot θ.

The fields are polynomials of degree 1 or 2 in each of equal elements; b is zero at the poles. So the sphere
is exactly a member, with a = b = 0. Energies are per 4πR²Hμ and volumes per 4πR³: a mean over the sphere.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tests.oracle.shape.jets import Array, Energy, Jet, variables

POINTS = 6  # Gauss points an element: quadrature errs far less than the elements do


@dataclass(frozen=True)
class Mesh:
    """Equal elements on 0 ≤ θ ≤ π.

    Parameters
    ----------
    count : int
        Elements.
    degree : {1, 2}
        Of the polynomials.
    """

    count: int
    degree: int = 2

    @property
    def nodes(self) -> int:
        """Nodes of each of the two fields."""
        return self.count * self.degree + 1

    @cached_property
    def node_angles(self) -> Array:
        """θ of the nodes."""
        return np.linspace(0.0, np.pi, self.nodes)

    @cached_property
    def free(self) -> Array:
        """Indices of the unknowns (a of all nodes, then b of all nodes) that are not held at zero."""
        return np.delete(np.arange(2 * self.nodes), [self.nodes, 2 * self.nodes - 1])

    @cached_property
    def angles(self) -> Array:
        """θ of the quadrature points, shape (q,)."""
        x, _ = np.polynomial.legendre.leggauss(POINTS)
        width = np.pi / self.count
        return (width * (np.arange(self.count)[:, None] + 0.5 * (x + 1.0))).ravel()

    @cached_property
    def weights(self) -> Array:
        """Weights of a mean over the sphere, shape (q,): they add up to 1."""
        _, w = np.polynomial.legendre.leggauss(POINTS)
        width = np.pi / self.count
        return 0.5 * np.tile(0.5 * width * w, self.count) * np.sin(self.angles)

    @cached_property
    def interpolation(self) -> Array:
        """From an element's unknowns to (a, a′, b, b′) at its points, shape (POINTS, 4, 2 degree + 2)."""
        x, _ = np.polynomial.legendre.leggauss(POINTS)
        local = np.linspace(-1.0, 1.0, self.degree + 1)
        slope = 2.0 * self.count / np.pi
        matrix = np.zeros((POINTS, 4, 2, self.degree + 1))
        for i, row in enumerate(np.eye(self.degree + 1)):
            lagrange = np.poly1d(np.polyfit(local, row, self.degree))
            for field in (0, 1):
                matrix[:, 2 * field, field, i] = lagrange(x)
                matrix[:, 2 * field + 1, field, i] = slope * lagrange.deriv()(x)
        return matrix.reshape(POINTS, 4, -1)

    @cached_property
    def members(self) -> NDArray[np.intp]:
        """Indices of the unknowns of each element, held ones included, shape (count, 2 degree + 2)."""
        node = self.degree * np.arange(self.count)[:, None] + np.arange(self.degree + 1)
        return np.hstack([node, self.nodes + node])

    @cached_property
    def mass(self) -> Array:
        """Matrix of the mean of a² + b² over the sphere, by the free unknowns."""
        a, _, b, _ = local_fields(self, np.zeros(self.free.size))
        return 0.5 * integral(self, a**2 + b**2).hessian


@dataclass(frozen=True, eq=False)
class Integral:
    """A functional of the shape, with its derivatives by the free unknowns."""

    value: float
    gradient: Array
    hessian: Array


def integral(mesh: Mesh, density: Jet) -> Integral:
    """The mean over the sphere of a density that is a function of (a, a′, b, b′)."""
    B, w = mesh.interpolation, mesh.weights.reshape(mesh.count, POINTS)
    slopes = w[:, :, None] * density.gradient.reshape(mesh.count, POINTS, 4)
    bends = w[:, :, None, None] * density.hessian.reshape(mesh.count, POINTS, 4, 4)
    gradient = np.zeros(2 * mesh.nodes)
    hessian = np.zeros((2 * mesh.nodes, 2 * mesh.nodes))
    np.add.at(gradient, mesh.members, np.einsum("eqi,qiu->eu", slopes, B))
    local = np.einsum("qiu,eqij,qjv->euv", B, bends, B, optimize=True)
    np.add.at(hessian, (mesh.members[:, :, None], mesh.members[:, None, :]), local)
    return Integral(
        float(mesh.weights @ density.value), gradient[mesh.free], hessian[np.ix_(mesh.free, mesh.free)]
    )


def local_fields(mesh: Mesh, unknowns: Array) -> tuple[Jet, ...]:
    """(a, a′, b, b′) at the quadrature points, as independent variables."""
    full = np.zeros(2 * mesh.nodes)
    full[mesh.free] = unknowns
    fields = np.einsum("qiu,eu->ieq", mesh.interpolation, full[mesh.members])
    return variables(*fields.reshape(4, -1))


def stretches(mesh: Mesh, sphere: float, unknowns: Array) -> tuple[Jet, Jet]:
    """(λ₁, λ₂), along the meridian and around the axis."""
    a, da, b, db = local_fields(mesh, unknowns)
    along = ((a + db + sphere) ** 2 + (da - b) ** 2) ** 0.5
    around = a + b * (1.0 / np.tan(mesh.angles)) + sphere
    return along, around


def film(mesh: Mesh, energy: Energy, sphere: float, unknowns: Array) -> Integral:
    """The energy of the film."""
    return integral(mesh, energy(*stretches(mesh, sphere, unknowns)))


def volume(mesh: Mesh, sphere: float, unknowns: Array) -> Integral:
    """The enclosed volume −¼∫ρ² z′ dθ; Λ³/3 of the sphere."""
    a, da, b, db = local_fields(mesh, unknowns)
    sine, cosine = np.sin(mesh.angles), np.cos(mesh.angles)
    rho = (a + sphere) * sine + b * cosine
    dz = (da - b) * cosine - (a + db + sphere) * sine
    return integral(mesh, rho**2 * dz * (-0.5 / sine))


def capacitance(mesh: Mesh, sphere: float, unknowns: Array) -> Integral:
    """The mean of λ₁²λ₂², the capacitance over the one of the unstretched balloon."""
    along, around = stretches(mesh, sphere, unknowns)
    return integral(mesh, (along * around) ** 2)
