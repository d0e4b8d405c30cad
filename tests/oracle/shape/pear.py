"""The pear-shaped equilibria that branch off the sphere where s = 0, followed a little way.

Unknowns are the shape of the active balloon, λ₂ of the passive sphere and φ²; the amplitude of the pear is
given. Small amplitudes say to which side the new branch leaves, and nothing about where a balloon goes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.oracle.shape.elements import Integral, Mesh, capacitance, film, volume
from tests.oracle.shape.energies import gent
from tests.oracle.shape.jets import Array
from tests.oracle.shape.modes import harmonics
from tests.oracle.shape.pair import Loss, Pair

STEPS = 12
RESIDUAL = 1e-10


@dataclass(frozen=True, eq=False)
class Pear:
    """An equilibrium of the pair with a pear-shaped active balloon.

    Parameters
    ----------
    voltage, passive, pressure : float
        φ, λ₂, p.
    unknowns : array
        a and b at the nodes, measured from the sphere that is lost.
    """

    voltage: float
    passive: float
    pressure: float
    unknowns: Array


def shapes(mesh: Mesh) -> tuple[Array, Array]:
    """The translation (W = U) and the pear (W = −2U) of unit mean square, orthogonal to each other."""
    normal, tangential = harmonics(mesh, 1).T
    translation = normal / np.sqrt(3.0) + tangential * np.sqrt(2.0 / 3.0)
    pear = normal * np.sqrt(2.0 / 3.0) - tangential / np.sqrt(3.0)
    return translation, pear


def pear(pair: Pair, loss: Loss, mesh: Mesh, amplitude: float) -> Pear:
    """The equilibrium whose pear has this amplitude, the square root of its mean square.

    Raises
    ------
    RuntimeError
        If Newton's method finds none.
    """
    m, ambient, gas = (float(x) for x in pair.content)
    sphere, elastic = float(loss.active), gent(float(pair.limit))
    constraints = np.array([mesh.mass @ x for x in shapes(mesh)])
    n = mesh.free.size
    x, passive, square, multiplier = (
        amplitude * shapes(mesh)[1],
        float(loss.passive),
        float(loss.voltage) ** 2,
        0.0,
    )
    for _ in range(STEPS):
        w, V, C = (
            film(mesh, elastic, sphere, x),
            volume(mesh, sphere, x),
            capacitance(mesh, sphere, x),
        )
        force, slope = float(pair.force(passive)), float(pair.slope(passive))
        pressure = force / passive**2
        stiffness = slope / passive**2 - 2.0 * force / passive**3
        total = m**3 * V.value + passive**3 / 3.0
        residual = np.concatenate(
            [
                _balance(w, V, C, m * pressure, square) + multiplier * constraints[0],
                constraints @ x - [0.0, amplitude],
                [(pressure + ambient) * total - gas],
            ]
        )
        if np.abs(residual).max() < RESIDUAL:
            return Pear(float(np.sqrt(square)), passive, pressure, x)
        J = np.zeros((n + 3, n + 3))
        J[:n, :n] = w.hessian - 0.5 * square * C.hessian - m * pressure * V.hessian
        J[:n, n] = -m * stiffness * V.gradient
        J[:n, n + 1] = -0.5 * C.gradient
        J[:n, n + 2] = constraints[0]
        J[n : n + 2, :n] = constraints
        J[n + 2, :n] = (pressure + ambient) * m**3 * V.gradient
        J[n + 2, n] = stiffness * total + (pressure + ambient) * passive**2
        step = np.linalg.solve(J, -residual)
        x, passive, square, multiplier = (
            x + step[:n],
            passive + float(step[n]),
            square + float(step[n + 1]),
            multiplier + float(step[n + 2]),
        )
    raise RuntimeError(f"no pear of amplitude {amplitude} was found beside the sphere of stretch {sphere}")


def _balance(w: Integral, V: Integral, C: Integral, pressure: float, square: float) -> Array:
    return w.gradient - 0.5 * square * C.gradient - pressure * V.gradient
