"""The Jacobian of a path with a plane across it, solved for all runs at once.

It is an arrow: a balloon feels only its own stretch, the pressure and the drive. All balloons but the
softest are eliminated, which leaves three rows, solved by cofactors. What is left of the softest balloon's
own stiffness, its last pivot, has the sign of the determinant: it says whether the state is stable.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator.solver.batch.stacked import Parts

Array = NDArray[Any]


def softest(parts: Parts) -> NDArray[np.int64]:
    """Which balloon has the smallest ∂R/∂λ, (n_runs,)."""
    return np.asarray(np.argmin(parts.along, axis=0))


def _pick(rows: Array, place: NDArray[np.int64]) -> Array:
    """The entry of one balloon of each run."""
    if len(rows) == 1:
        return np.asarray(rows[0])
    if len(rows) == 2:
        return np.asarray(np.where(place == 0, rows[0], rows[1]))
    at = np.broadcast_to(place, rows.shape[1:])
    return np.asarray(np.take_along_axis(rows, at[None], axis=0)[0])


class Bordered:
    """The parts of a Jacobian and a plane with a normal, reduced to the softest balloon.

    `pivot` is what is left of the softest balloon's stiffness, `others` the smallest ∂R/∂λ of all others: a
    state is stable where both are positive.
    """

    def __init__(self, parts: Parts, normal: Array, place: NDArray[np.int64]) -> None:
        self.parts, self.place = parts, place
        along = parts.along
        self.count = len(along)
        chosen = np.arange(self.count).reshape(-1, *[1] * place.ndim) == place
        chosen = np.broadcast_to(chosen[:, None] if chosen.ndim < along.ndim else chosen, along.shape)
        self.chosen = chosen
        with np.errstate(divide="ignore", invalid="ignore"):
            self.inverse = np.where(chosen, 0.0, 1.0 / np.where(chosen, 1.0, along))
        self.others = (
            np.min(np.where(chosen, np.inf, along.real), axis=0)
            if self.count > 1
            else np.full(along.shape[1:], np.inf)
        )
        self.stretch_normal = normal[: self.count]
        self.c1, self.c3 = _pick(along, place), _pick(parts.per_v, place)
        self.turned_v = self.inverse * parts.per_v
        self.b1 = _pick(np.broadcast_to(self.stretch_normal, along.shape), place)
        self.b3 = normal[-1] - (self.stretch_normal * self.turned_v).sum(axis=0)
        if parts.area is None:
            self.pivot = self.c1
            self.x1, self.x3 = -self.c3, self.c1
            self.determinant = self.b1 * self.x1 + self.b3 * self.x3
            return
        self.turned = self.inverse * parts.per_pressure
        self.c2, self.a1 = _pick(parts.per_pressure, place), _pick(parts.area, place)
        self.a2 = parts.gas_pressure - (parts.area * self.turned).sum(axis=0)
        self.a3 = -(parts.area * self.turned_v).sum(axis=0)
        self.b2 = normal[-2] - (self.stretch_normal * self.turned).sum(axis=0)
        self.x1 = self.c2 * self.a3 - self.c3 * self.a2
        self.x2 = self.c3 * self.a1 - self.c1 * self.a3
        self.x3 = self.c1 * self.a2 - self.c2 * self.a1
        self.pivot = self.x3
        self.determinant = self.b1 * self.x1 + self.b2 * self.x2 + self.b3 * self.x3

    def rates(self) -> Array:
        """How the state moves as the plane moves: tangent to the path, normal · rate = 1."""
        shape = np.broadcast_shapes(self.determinant.shape, self.c1.shape)
        out = np.empty((self.count + 1 + (self.parts.area is not None), *shape), self.c1.dtype)
        scale = 1.0 / self.determinant
        out[-1] = self.x3 * scale
        out[: self.count] = -self.turned_v * out[-1]
        if self.parts.area is not None:
            out[-2] = self.x2 * scale
            out[: self.count] -= self.turned * out[-2]
        self._put(out, self.x1 * scale)
        return out

    def correction(self) -> Array:
        """Newton's step within the plane."""
        parts = self.parts
        force = parts.force
        r, scale = -_pick(force, self.place), 1.0 / self.determinant
        eliminated = -self.inverse * force
        plane = -(self.stretch_normal * eliminated).sum(axis=0)
        shape = np.broadcast_shapes(self.determinant.shape, self.c1.shape)
        out = np.empty((self.count + 1 + (parts.area is not None), *shape), self.c1.dtype)
        if parts.area is None:
            out[-1] = (self.c1 * plane - self.b1 * r) * scale
            out[: self.count] = eliminated - self.turned_v * out[-1]
            self._put(out, (r * self.b3 - self.c3 * plane) * scale)
            return out
        g = -parts.gas - (parts.area * eliminated).sum(axis=0)
        # r (a × b) + g (b × c) + plane (c × a), over the determinant.
        a1, a2, a3, b1, b2, b3 = self.a1, self.a2, self.a3, self.b1, self.b2, self.b3
        c1, c2, c3 = self.c1, self.c2, self.c3
        first = r * (a2 * b3 - a3 * b2) + g * (b2 * c3 - b3 * c2) + plane * self.x1
        out[-2] = (r * (a3 * b1 - a1 * b3) + g * (b3 * c1 - b1 * c3) + plane * self.x2) * scale
        out[-1] = (r * (a1 * b2 - a2 * b1) + g * (b1 * c2 - b2 * c1) + plane * self.x3) * scale
        out[: self.count] = eliminated - self.turned * out[-2] - self.turned_v * out[-1]
        self._put(out, first * scale)
        return out

    def _put(self, out: Array, value: Array) -> None:
        """Set the stretch of the softest balloon."""
        if self.count == 1:
            out[0] = value
        else:
            np.copyto(out[: self.count], value, where=self.chosen)


def pivots(parts: Parts, place: NDArray[np.int64]) -> tuple[Array, Array]:
    """`pivot` and `others` without a plane."""
    normal = np.zeros((len(parts.along) + 1 + (parts.area is not None), *[1] * (parts.along.ndim - 1)))
    normal[-1] = 1.0
    made = Bordered(parts, normal, place)
    return made.pivot, made.others
