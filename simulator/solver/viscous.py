"""Balloons that take their time: the flow τᵢ dλᵢ/dt = −gᵢ in real time under a moving drive, with IDA.

With a relaxation time τ the force balances gᵢ = 0 are approached, not solved, so nothing jumps: a snap takes
as long as the flow needs. The gas law holds throughout. A balloon can also have a Maxwell branch (a spring
k_v in series with a dashpot, in parallel to its elastomer: a Zener solid), with an inner stretch ξ,

    τ dλ/dt = −g − (k_v/ξ) f_v(λ/ξ),    dξ/dt = ξ x f_v(x)/(12 t_v),  x = λ/ξ,

where f_v is the neo-Hookean force. As x f_v(x) ≈ 12 (x − 1) for small strains, t_v is the time in which the
branch then relaxes. The dissipation r²h[τ(dλ/dt)² + k_v (x f_v)²/(12 t_v)] is never negative.

Balloons that are equal in all, and start alike, stay alike: that is the solution, also where it is unstable.
Each feels the mean of its equals, so that what rounding makes of it does not grow.

Work and dissipation are integrated beside the stretches, so the books tell how well it was done.

References
----------
C. C. Foo, S. Cai, S. J. A. Koh, S. Bauer, Z. Suo, J. Appl. Phys. 111 (2012) 034102: the branch and its law.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from simulator.events import EventKind
from simulator.model.conditions import shape_conditions, stability_in_motion
from simulator.model.elastomers import NeoHookean, tension_force, tension_stiffness
from simulator.model.groups import Group
from simulator.solver.ida import Course, Effort, IntegrationError, System, integrate

FloatArray = NDArray[np.float64]

_RTOL = 1e-9
_ATOL = 1e-11
# Of the energies that rounding moves, about r²hk λ⁴: a small history has small energies.
_ATOL_ENERGY = 1e-16
# That of the energies again, where an energy passes zero while its rounding has grown with the stretch.
_ATOL_ENERGY_WIDE = 1e-13
_MOST_STEPS = 1_000_000
_ALIKE = 1e-9  # relatively: stretches of equal balloons that differ by rounding alone
_SPRING = NeoHookean()
# What a loss of sphericity does to a flow.
Shapes = Literal["record", "stop", "ignore"]


@dataclass(frozen=True)
class MaxwellBranch:
    """A Maxwell branch: its modulus, over the reference balloon's, and its relaxation time."""

    modulus: float
    time: float


@dataclass(frozen=True)
class Material:
    """How the balloons take their time: relaxation times and Maxwell branches, one or None for each."""

    relaxation: tuple[float, ...]
    branches: tuple[MaxwellBranch | None, ...]

    @property
    def creeping(self) -> tuple[int, ...]:
        """The balloons with a Maxwell branch."""
        return tuple(i for i, branch in enumerate(self.branches) if branch is not None)


@dataclass(frozen=True)
class Passed:
    """A margin that fell through zero: when, of what kind, and the stretches of all balloons then.

    Of a balloon's shape also which balloon, and what it would turn into.
    """

    time: float
    kind: str
    stretch: FloatArray
    balloon: int = -1
    mode: str = ""


@dataclass(frozen=True)
class Watched:
    """A margin of the stretches and v, what its fall through zero is, and whether that ends the history."""

    kind: str
    margin: Callable[[list[float], float], float]
    ends: bool
    balloon: int = -1
    mode: str = ""


@dataclass(frozen=True)
class Passage:
    """What became of the balloons over a stretch of time.

    Attributes
    ----------
    time : (n,) array
        The times asked for, up to the end.
    stretch : (n, n_balloons) array
    inner : (n, n_creeping) array
        Inner stretches of the Maxwell branches.
    work, dissipated : (n,) arrays
        ∫ −∂Π/∂v dv up to each time, and what was lost.
    passed : tuple of Passed
        Limit points and changes of shape in order of time; and what ended it, if anything did.
    ended : bool
    """

    time: FloatArray
    stretch: FloatArray
    inner: FloatArray
    work: FloatArray
    dissipated: FloatArray
    passed: tuple[Passed, ...]
    ended: bool


class Flow:
    """The flow of all balloons: groups that each have their own equations, under one drive v(t)."""

    def __init__(
        self, groups: Sequence[Group], material: Material, shapes: Shapes = "ignore", no_pressure: float = 0.0
    ) -> None:
        self.groups = groups
        self.no_pressure = no_pressure  # below zero by no more is rounding
        self.shapes = shapes
        self.material = material
        self.count = sum(len(group.members) for group in groups)
        self.creeping = material.creeping
        self._balloons = [i for group in groups for i in group.members]
        walls = {
            i: wall for group in groups for i, wall in zip(group.members, group.equations.walls, strict=True)
        }
        self._walls = [walls[i] for i in range(self.count)]
        # τD/k of the balances, and r²h τ of the dissipation.
        self._slow = [t / w.modulus for t, w in zip(material.relaxation, self._walls, strict=True)]
        self._loss = [t * w.weight / w.modulus for t, w in zip(material.relaxation, self._walls, strict=True)]

    def state(self, group: Group, stretch: Sequence[float], v: float) -> list[float]:
        """The unknowns of a group's equations, the pressure from the gas law."""
        own = [stretch[i] for i in group.members]
        if group.equations.has_pressure:
            return [*own, group.equations.gas_pressure(own, v), v]
        return [*own, v]

    def spring(self, stretch: float, inner: float, branch: MaxwellBranch) -> tuple[float, float]:
        """The branch's share of g, and dξ/dt."""
        ratio = stretch / inner
        force = tension_force(_SPRING, ratio)
        return branch.modulus * force / inner, inner * ratio * force / (12.0 * branch.time)

    def spring_energy(self, stretch: FloatArray, inner: FloatArray) -> float:
        """Energy stored in all Maxwell branches, over 4πR²Hμ."""
        total = 0.0
        for place, i in enumerate(self.creeping):
            branch, wall = self.material.branches[i], self._walls[i]
            assert branch is not None
            ratio = float(stretch[i] / inner[place])
            total += wall.weight / wall.modulus * branch.modulus * float(_SPRING.energy(ratio))
        return total

    def swelling(self, stretch: FloatArray, inner: FloatArray, v: float) -> tuple[float, float]:
        """How fast the balloons' volume grows, Σ r³λ² dλ/dt, and the largest |dλ/dt|."""
        values = [*stretch.tolist(), *inner.tolist(), 0.0, 0.0]
        rates = self._rates(values, v, 0.0)[: self.count]
        walls = zip(self._walls, stretch.tolist(), rates, strict=True)
        return sum(w.cube * x * x * rate for w, x, rate in walls), max(map(abs, rates))

    def _rates(self, values: Sequence[float], v: float, speed: float) -> list[float]:
        """Rates of all unknowns (stretches, inner stretches, work, dissipated energy)."""
        stretch, inner = values[: self.count], values[self.count : -2]
        rates = [0.0] * len(values)
        power = 0.0
        for group in self.groups:
            state = self.state(group, stretch, v)
            forces = group.equations.residual(state)
            for i, force in zip(group.members, forces, strict=False):
                rates[i] = -force / (self._walls[i].elastomer.pole_form(stretch[i])[1] * self._slow[i])
            power += float(group.equations.drive_power(state))
        loss = 0.0
        for place, i in enumerate(self.creeping):
            branch, wall = self.material.branches[i], self._walls[i]
            assert branch is not None
            share, rates[self.count + place] = self.spring(stretch[i], inner[place], branch)
            rates[i] -= share / self.material.relaxation[i]
            loss += wall.weight / wall.modulus * share * stretch[i] * rates[self.count + place] / inner[place]
        rates[-2] = power * speed
        rates[-1] = loss + sum(c * r * r for c, r in zip(self._loss, rates, strict=False))
        return rates

    def _residual(self, values: list[float], speeds: list[float], v: float, speed: float) -> list[float]:
        stretch, inner = values[: self.count], values[self.count : -2]
        out = [0.0] * len(values)
        power = loss = 0.0
        for group in self.groups:
            state = self.state(group, stretch, v)
            for i, force in zip(group.members, group.equations.residual(state), strict=False):
                denominator = self._walls[i].elastomer.pole_form(stretch[i])[1]
                # Beyond the stretch limit there is nothing: IDA takes it for a step too long.
                out[i] = force + denominator * self._slow[i] * speeds[i] if denominator > 0.0 else math.nan
            power += float(group.equations.drive_power(state))
        for place, i in enumerate(self.creeping):
            branch, wall = self.material.branches[i], self._walls[i]
            assert branch is not None
            share, rate = self.spring(stretch[i], inner[place], branch)
            out[i] += wall.elastomer.pole_form(stretch[i])[1] * share / wall.modulus
            out[self.count + place] = speeds[self.count + place] - rate
            loss += wall.weight / wall.modulus * share * stretch[i] * rate / inner[place]
        loss += sum(c * s * s for c, s in zip(self._loss, speeds, strict=False))
        out[-2], out[-1] = speeds[-2] - power * speed, speeds[-1] - loss
        return out

    def _jacobian(self, values: list[float], speeds: list[float], v: float, cj: float) -> list[list[float]]:
        """∂(residual)/∂y + c_j ∂(residual)/∂ẏ; work and loss, on which nothing depends, only roughly."""
        size = len(values)
        stretch, inner = values[: self.count], values[self.count : -2]
        out = [[0.0] * size for _ in range(size)]
        for group in self.groups:
            state = self.state(group, stretch, v)
            _, rows = group.equations.linearised(state)
            count = len(group.members)
            if group.equations.has_pressure:
                gas = [entry / rows[count][count] for entry in rows[count][:count]]
                rows = [
                    [entry - row[count] * g for entry, g in zip(row, gas, strict=False)]
                    for row in rows[:count]
                ]
            for i, row in zip(group.members, rows, strict=False):
                for j, entry in zip(group.members, row, strict=False):
                    out[i][j] = entry
                law, x = self._walls[i].elastomer, stretch[i]
                out[i][i] += self._slow[i] * (
                    cj * law.pole_form(x)[1] + law.pole_form_slope(x)[1] * speeds[i]
                )
        for place, i in enumerate(self.creeping):
            branch, wall = self.material.branches[i], self._walls[i]
            assert branch is not None
            k, ratio = self.count + place, stretch[i] / inner[place]
            force, slope = tension_force(_SPRING, ratio), tension_stiffness(_SPRING, ratio)
            denominator, fall = (
                wall.elastomer.pole_form(stretch[i])[1],
                wall.elastomer.pole_form_slope(stretch[i])[1],
            )
            share = branch.modulus / wall.modulus / inner[place]
            out[i][i] += share * (fall * force + denominator * slope / inner[place])
            out[i][k] = -share * denominator * (force + ratio * slope) / inner[place]
            # dξ/dt = λ f(λ/ξ)/(12 t)
            out[k][i] = -(force + ratio * slope) / (12.0 * branch.time)
            out[k][k] = cj + ratio * ratio * slope / (12.0 * branch.time)
        out[-2][-2] = out[-1][-1] = cj
        for i, c in enumerate(self._loss):
            out[-1][i] = -2.0 * c * cj * speeds[i]
        return out

    def run(
        self,
        drive: Callable[[float], tuple[float, float]],
        stretch: FloatArray,
        inner: FloatArray,
        times: FloatArray,
        effort: Effort,
    ) -> Passage:
        """Let the balloons flow from `times[0]` to `times[-1]`, or to what ends the history.

        Parameters
        ----------
        drive
            v and dv/dt at a time, smooth from the first time to the last.
        stretch : (n_balloons,) array
        inner : (n_creeping,) array
            Inner stretches of the Maxwell branches.
        times : (n,) array
            Rising; states are returned at these.
        effort : Effort
            Counters, added to.

        Raises
        ------
        IntegrationError
            If IDA fails.
        """
        watched = list(self._watched())
        equals = self._equals(stretch.tolist(), inner.tolist())

        def even(values: list[float]) -> list[float]:
            return _evened(values, equals) if equals else values

        def margins(t: float, values: list[float], speeds: list[float]) -> list[float]:
            v, values = drive(t)[0], even(values)
            return [one.margin(values, v) for one in watched]

        def jacobian(t: float, values: list[float], speeds: list[float], cj: float) -> list[list[float]]:
            v, values = drive(t)[0], even(values)
            rows = self._jacobian(values, speeds, v, cj)
            if not equals:
                return rows
            # The residual depends on the means alone: where equal balloons would part, the rest is singular.
            own = self._jacobian(values, speeds, v, 0.0)
            return [
                [entry - part + mean for entry, part, mean in zip(row, parts, even(parts), strict=True)]
                for row, parts in zip(rows, own, strict=True)
            ]

        start = np.array(even([*stretch.tolist(), *inner.tolist(), 0.0, 0.0]))
        rounding = sum(w.weight * x**4 for w, x in zip(self._walls, stretch.tolist(), strict=True))
        system = System(
            lambda t, y, yp: self._residual(even(y), yp, *drive(t)),
            jacobian,
            margins,
            [one.ends for one in watched],
        )
        rates = np.array(self._rates(start.tolist(), *drive(float(times[0]))))
        # A third time, or IDA's own steps would be returned.
        asked = times if times.size > 2 else np.array([times[0], times.mean(), times[-1]])

        def integrated(atol_energy: float) -> Course:
            atol = np.array([*[_ATOL] * (start.size - 2), *[atol_energy * rounding] * 2])
            return integrate(
                system, asked, start, rates, effort, rtol=_RTOL, atol=atol, most_steps=_MOST_STEPS
            )

        try:
            course = integrated(_ATOL_ENERGY)
        except IntegrationError:
            course = integrated(_ATOL_ENERGY_WIDE)
        passed = tuple(
            Passed(e.time, one.kind, np.array(even(e.state.tolist())[: self.count]), one.balloon, one.mode)
            for e in course.events
            for one in (watched[e.which],)
        )
        ended = bool(passed) and watched[course.events[-1].which].ends
        end = passed[-1].time if ended else float(times[-1])
        kept = np.isin(course.time, times) & (course.time < end) | (course.time == end)
        kept[-1] = True  # where it ended
        states = np.array([even(state) for state in course.states[kept].tolist()])
        return Passage(
            course.time[kept],
            states[:, : self.count],
            states[:, self.count : -2],
            states[:, -2],
            states[:, -1],
            passed,
            ended,
        )

    def _equals(self, stretch: Sequence[float], inner: Sequence[float]) -> list[list[int]]:
        """Places of unknowns that stay equal: stretches of equal balloons that are alike, and inner ones."""
        inside = {i: self.count + place for place, i in enumerate(self.creeping)}
        membranes = {
            i: (membrane, group.equations.is_open)
            for group in self.groups
            for i, membrane in zip(group.members, group.equations.membranes, strict=True)
        }

        def same(i: int, j: int) -> bool:
            pairs = [(stretch[i], stretch[j])]
            if i in inside and j in inside:
                pairs.append((inner[inside[i] - self.count], inner[inside[j] - self.count]))
            makes = ((membranes[k], self.material.relaxation[k], self.material.branches[k]) for k in (i, j))
            return next(makes) == next(makes) and all(abs(a - b) <= _ALIKE * abs(b) for a, b in pairs)

        sets: list[list[int]] = []
        for i in range(self.count):
            known = next((one for one in sets if same(i, one[0])), None)
            if known is None:
                sets.append([i])
            else:
                known.append(i)
        several = [one for one in sets if len(one) > 1]
        return several + [[inside[i] for i in one] for one in several if one[0] in inside]

    def _watched(self) -> Iterator[Watched]:
        """What is watched: stability of every group, what ends a history, and the balloons' shapes."""

        def of(
            group: Group, margin: Callable[[Any], Any], sign: float = 1.0, rounding: float = 0.0
        ) -> Callable[..., float]:
            return lambda values, v: sign * float(margin(self.state(group, values, v))) + rounding

        for group in self.groups:
            for condition in group.conditions:
                turns = condition.kind == EventKind.LIMIT_POINT
                margin = stability_in_motion(group.equations) if turns else condition.margin
                rounding = self.no_pressure * (condition.kind == EventKind.LOSS_OF_TENSION)
                yield Watched(condition.kind, of(group, margin, rounding=rounding), not turns)
            for shape in shape_conditions(group.equations) if self.shapes != "ignore" else ():
                balloon, margin = group.members[shape.place], shape.condition.margin
                stops = self.shapes == "stop"
                lost = Watched(EventKind.LOSS_OF_SPHERICITY, of(group, margin), stops, balloon, shape.mode)
                yield lost
                back = of(group, margin, -1.0)
                yield replace(lost, kind=EventKind.SPHERICITY_REGAINED, margin=back, ends=False)


def _evened(values: list[float], equals: Sequence[Sequence[int]]) -> list[float]:
    """Unknowns with the means of those that are equal."""
    out = list(values)
    for places in equals:
        mean = sum(values[i] for i in places) / len(places)
        for i in places:
            out[i] = mean
    return out
