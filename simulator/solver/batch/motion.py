"""States of the overdamped flow dλᵢ/dt = −gᵢ at a frozen drive, their rates and the Jacobian of these."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulator.solver.batch.stacked import Parts, Stacked

FloatArray = NDArray[np.float64]


def full_state(batch: Stacked, stretches: FloatArray, v: FloatArray) -> FloatArray:
    """States with the pressure that goes with stretches in motion."""
    if not batch.sealed:
        return np.concatenate([stretches, v[None]])
    pressure = np.asarray(batch.equations.gas_pressure(list(stretches), v))
    return np.concatenate([stretches, pressure[None], v[None]])


def is_possible(batch: Stacked, stretches: FloatArray) -> NDArray[np.bool_]:
    """Whether no stretch is beyond the limit of its elastomer, or none at all."""
    inside = np.broadcast_arrays(*batch.denominators(list(stretches)), stretches[0])[:-1]
    return np.asarray((np.array(inside) > 0.0).all(axis=0) & (stretches > 0.0).all(axis=0))


def rates_at(batch: Stacked, y: FloatArray) -> FloatArray:
    """Dλ/dt of full states."""
    residual = batch.equations.residual(list(y))
    return np.stack(
        [
            -wall.modulus * r / wall.elastomer.pole_form(x)[1]
            for wall, r, x in zip(batch.equations.walls, residual, y, strict=False)
        ]
    )


def margins_at(batch: Stacked, y: FloatArray) -> FloatArray:
    """All margins of full states, (n_margins, …, n_runs)."""
    found = [np.broadcast_to(np.asarray(m.at(y)), y.shape[1:]) for m in batch.margins]
    return np.array(found).reshape(len(found), *y.shape[1:])


class Jacobian:
    """−∂(dλ/dt)/∂λ = diag(q) + u wᵀ of the flow, and the weights in which it is symmetric."""

    def __init__(self, batch: Stacked, y: FloatArray, parts: Parts) -> None:
        walls = batch.equations.walls
        self.rates, self.q, self.u = (np.empty_like(parts.force) for _ in range(3))
        self.w = np.zeros_like(parts.force)
        self.pull = np.empty_like(parts.force)
        for i, (wall, x) in enumerate(zip(walls, y, strict=False)):
            denominator = wall.elastomer.pole_form(x)[1]
            pace = wall.modulus / denominator
            slope = wall.elastomer.pole_form_slope(x)[1]
            self.rates[i] = -pace * parts.force[i]
            self.q[i] = pace * (parts.along[i] - parts.force[i] * slope / denominator)
            self.u[i] = -pace * parts.per_pressure[i] if parts.per_pressure is not None else 0.0
            self.pull[i] = wall.weight / wall.modulus
        if parts.area is not None:
            self.w = parts.area / parts.gas_pressure

    def solver(self, step: FloatArray) -> Callable[[FloatArray], FloatArray]:
        """Solves (1 + step (diag(q) + u wᵀ)) z = r."""
        inverse = 1.0 / (1.0 + step * self.q)
        turned = inverse * self.u
        share = step / (1.0 + step * (self.w * turned).sum(axis=0))

        def solve(right: FloatArray) -> FloatArray:
            z = inverse * right
            return np.asarray(z - turned * (share * (self.w * z).sum(axis=0)))

        return solve

    def softest(self) -> FloatArray:
        """The smallest eigenvalue, (n_runs,): below zero, what is off the trajectory grows."""
        if len(self.q) == 1:
            return np.asarray(self.q[0] + self.u[0] * self.w[0])
        if len(self.q) == 2:
            (a, b), (s, t) = self.q, self.u * self.w
            half = 0.5 * (a + s - b - t)
            return np.asarray(0.5 * (a + s + b + t) - np.sqrt(np.maximum(half * half + s * t, 0.0)))
        matrices = self._symmetric()
        values = np.full(len(matrices), np.nan)
        good = np.isfinite(matrices).all(axis=(1, 2))
        values[good] = np.linalg.eigvalsh(matrices[good])[:, 0]
        return values

    def _symmetric(self) -> FloatArray:
        """The Jacobian in the weights in which it is symmetric, (n_runs, n_balloons, n_balloons)."""
        arms = np.sqrt(np.maximum(self.u * self.w, 0.0))
        matrices = arms.T[:, :, None] * arms.T[:, None, :]
        index = np.arange(len(self.q))
        matrices[:, index, index] += self.q.T
        return np.asarray(matrices)

    def forgets(self) -> FloatArray:
        """The slowest rate at which what is off the trajectory decays, (n_runs,)."""
        count, f = len(self.q), self.rates
        along = (self.pull * f * f).sum(axis=0)
        if count == 1:
            return np.zeros(f.shape[1])  # on a line there is nothing off the trajectory
        if count == 2:
            turned = self.q * f + self.u * (self.w * f).sum(axis=0)
            own = (self.pull * f * turned).sum(axis=0) / along
            return np.asarray((self.q + self.u * self.w).sum(axis=0) - own)
        # In the weights in which the Jacobian is symmetric, projected across the flow.
        root = np.sqrt(self.pull)
        matrices = self._symmetric()
        across = (
            np.eye(count) - (root * f / np.sqrt(along)).T[:, :, None] * (root * f / np.sqrt(along)).T[:, None]
        )
        projected = across @ matrices @ across
        good = np.isfinite(projected).all(axis=(1, 2))
        values = np.full(f.shape[1], -np.inf)
        # The direction of the flow itself is put above all others.
        lift = np.abs(projected).sum(axis=(1, 2))[:, None, None] * (np.eye(count) - across)
        values[good] = np.linalg.eigvalsh((projected + lift)[good])[:, 0]
        return values


@dataclass
class Trail:
    """The states that loose flows passed, and what they had forgotten there, step by step for all runs."""

    states: list[FloatArray]
    memory: list[FloatArray]
    margin: list[FloatArray]
