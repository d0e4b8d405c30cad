"""Balloons that take their time: the flow τᵢ dλᵢ/dt = −gᵢ in real time under a moving drive, with IDA.

With a relaxation time τ the force balances gᵢ = 0 are approached, not solved, so nothing jumps: a snap takes
as long as the flow needs. The gas law holds throughout. A balloon can have parts besides, such as
viscoelastic branches (`model.viscoelastic`): each adds its share S to g and has unknowns of its own.

Balloons that are equal in all, and start alike, stay alike: that is the solution, also where it is unstable.
Each feels the mean of its equals, so that what rounding makes of it does not grow.

Work, dissipation and what the parts exchange are integrated beside the stretches, so the books tell how well
it was done. Unknowns are in this order: stretches, own unknowns of all parts, their books, work, friction.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from simulator.model.groups import Group
from simulator.solver.ida import Course, Effort, IntegrationError, System, integrate
from simulator.solver.liquid_pressure import holds_liquid, liquid_pressure, liquid_slopes
from simulator.solver.margins import Shapes, Stopping, watched
from simulator.solver.passage import Material, Passage, Passed, Slot, Steps

FloatArray = NDArray[np.float64]

_RTOL = 1e-9
_RTOL_OF_PARTS = 3e-10  # so that the energies of snaps balance within 1e-8
_ATOL = 1e-11
# Of the energies that rounding moves, about r²hk λ⁴: a small history has small energies.
_ATOL_ENERGY = 1e-16
# That of the energies again, where an energy passes zero while its rounding has grown with the stretch.
_ATOL_ENERGY_WIDE = 1e-13
_MOST_STEPS = 1_000_000
_ALIKE = 1e-9  # relatively: stretches of equal balloons that differ by rounding alone


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
        walls = {
            i: wall for group in groups for i, wall in zip(group.members, group.equations.walls, strict=True)
        }
        self._walls = [walls[i] for i in range(self.count)]
        # τD/k of the balances, and r²h τ of the dissipation, both over λⁿ.
        pairs = list(zip(material.friction, self._walls, strict=True))
        self._slow = [f.coefficient / w.modulus for f, w in pairs]
        self._loss = [f.coefficient * w.weight / w.modulus for f, w in pairs]
        self._exponent = [f.exponent for f in material.friction]
        self._own = slice(self.count, self.count + material.at_rest().size)
        self.slots = [_moved(slot, self.count, self._own.stop) for slot in material.slots]

    def state(self, group: Group, values: Sequence[float], v: float) -> list[float]:
        """The unknowns of a group's equations, the pressure from the gas law.

        `values` begin as all unknowns do; the pressure of a liquid follows from those of the parts too.
        """
        stretch = [values[i] for i in group.members]
        if holds_liquid(group):
            return [*stretch, liquid_pressure(self, group, values, v), v]
        if group.equations.has_pressure:
            return [*stretch, group.equations.gas_pressure(stretch, v), v]
        return [*stretch, v]

    def own(self, values: Sequence[float]) -> Sequence[float]:
        """The unknowns of the parts, of all unknowns."""
        return values[self._own]

    def swelling(self, stretch: FloatArray, own: FloatArray, v: float) -> tuple[float, float]:
        """How fast the balloons' volume grows, Σ r³λ² dλ/dt, and the largest |dλ/dt|."""
        rates = self.rates_at(self.unknowns(stretch, own), v)[: self.count]
        walls = zip(self._walls, stretch.tolist(), rates, strict=True)
        return sum(w.cube * x * x * rate for w, x, rate in walls), max(map(abs, rates))

    def unknowns(self, stretch: FloatArray, own: FloatArray) -> list[float]:
        """All unknowns, the books empty."""
        books = self.slots[-1].books.stop - self._own.stop if self.slots else 0
        return [*stretch.tolist(), *own.tolist(), *[0.0] * (books + 2)]

    def rates_at(self, values: Sequence[float], v: float) -> list[float]:
        """Rates of all unknowns at a drive that stands still."""
        return self._rates(values, v, 0.0)

    def _rates(self, values: Sequence[float], v: float, speed: float) -> list[float]:
        """Rates of all unknowns."""
        rates = [0.0] * len(values)
        power = 0.0
        for group in self.groups:
            state = self.state(group, values, v)
            forces = group.equations.residual(state)
            for i, force in zip(group.members, forces, strict=False):
                rates[i] = -force / (self._walls[i].elastomer.pole_form(values[i])[1] * self._slow[i])
            power += float(group.equations.drive_power(state))
        for i, _, part, own, books in self.slots:
            share, rates[own], rates[books] = part.moves(values[i], values[own], v)
            rates[i] -= share / self.material.friction[i].coefficient
        for i, exponent in enumerate(self._exponent):
            rates[i] /= values[i] ** exponent
        rates[-2] = power * speed
        rates[-1] = self._friction(values, rates)
        return rates

    def _friction(self, values: Sequence[float], speeds: Sequence[float]) -> float:
        """What friction dissipates per time."""
        terms = zip(self._loss, values, self._exponent, speeds, strict=False)
        return float(sum(c * x**n * s * s for c, x, n, s in terms))

    def _residual(self, values: list[float], speeds: list[float], v: float, speed: float) -> list[float]:
        out = [0.0] * len(values)
        power = 0.0
        denominators = [w.elastomer.pole_form(x)[1] for w, x in zip(self._walls, values, strict=False)]
        for group in self.groups:
            state = self.state(group, values, v)
            for i, force in zip(group.members, group.equations.residual(state), strict=False):
                denominator = denominators[i]
                # Beyond the stretch limit there is nothing: IDA takes it for a step too long.
                out[i] = (
                    force + denominator * self._slow[i] * values[i] ** self._exponent[i] * speeds[i]
                    if denominator > 0.0
                    else math.nan
                )
            power += float(group.equations.drive_power(state))
        for i, _, part, own, books in self.slots:
            share, moves, powers = part.moves(values[i], values[own], v)
            out[i] += denominators[i] * share / self._walls[i].modulus
            out[own] = [s - rate for s, rate in zip(speeds[own], moves, strict=True)]
            out[books] = [s - rate for s, rate in zip(speeds[books], powers, strict=True)]
        out[-2], out[-1] = speeds[-2] - power * speed, speeds[-1] - self._friction(values, speeds)
        return out

    def _jacobian(self, values: list[float], speeds: list[float], v: float, cj: float) -> list[list[float]]:
        """∂(residual)/∂y + c_j ∂(residual)/∂ẏ; work and friction, on which nothing depends, only roughly."""
        size = len(values)
        out = [[0.0] * size for _ in range(size)]
        for group in self.groups:
            state = self.state(group, values, v)
            _, rows = group.equations.linearised(state)
            count = len(group.members)
            if holds_liquid(group):
                slopes = liquid_slopes(self, group, values, state, rows)
                for i, row in zip(group.members, rows[:count], strict=True):
                    out[i] = [row[count] * slope for slope in slopes]
                rows = [row[:count] for row in rows[:count]]
            elif group.equations.has_pressure:
                gas = [entry / rows[count][count] for entry in rows[count][:count]]
                rows = [
                    [entry - row[count] * g for entry, g in zip(row, gas, strict=False)]
                    for row in rows[:count]
                ]
            for i, row in zip(group.members, rows, strict=False):
                for j, entry in zip(group.members, row, strict=False):
                    out[i][j] += entry
                law, x, n = self._walls[i].elastomer, values[i], self._exponent[i]
                denominator = law.pole_form(x)[1]
                out[i][i] += (
                    self._slow[i]
                    * x**n
                    * (cj * denominator + (law.pole_form_slope(x)[1] + denominator * n / x) * speeds[i])
                )
        for slot in self.slots:
            self._of_part(slot, values, v, cj, out)
        out[-2][-2] = out[-1][-1] = cj
        for i, c in enumerate(self._loss):
            out[-1][i] = -2.0 * c * values[i] ** self._exponent[i] * cj * speeds[i]
        return out

    def _of_part(self, slot: Slot, values: list[float], v: float, cj: float, out: list[list[float]]) -> None:
        """Add what a part is to the Jacobian."""
        i, _, part, own, books = slot
        wall, x = self._walls[i], values[i]
        share = part.moves(x, values[own], v)[0]
        slopes = part.tangent(x, values[own], v)
        denominator = wall.elastomer.pole_form(x)[1] / wall.modulus
        fall = wall.elastomer.pole_form_slope(x)[1] / wall.modulus
        out[i][i] += fall * share + denominator * slopes.share_per_stretch
        for k, slope in zip(range(own.start, own.stop), slopes.share_per_own, strict=True):
            out[i][k] += denominator * slope
        for place, k in enumerate(range(own.start, own.stop)):
            out[k][i] = -slopes.rates_per_stretch[place]
            out[k][k] = cj - slopes.rates_per_own[place]
        for place, k in enumerate(range(books.start, books.stop)):
            out[k][i] = -slopes.books_per_stretch[place]
            out[k][own] = [-slope for slope in slopes.books_per_own[place]]
            out[k][k] = cj

    def run(
        self,
        drive: Callable[[float], tuple[float, float]],
        stretch: FloatArray,
        own: FloatArray,
        times: FloatArray,
        effort: Effort,
        stopping: Stopping | None = None,
    ) -> Passage:
        """Let the balloons flow from `times[0]` to `times[-1]`, or to what ends the history.

        Parameters
        ----------
        drive
            v and dv/dt at a time, smooth from the first time to the last.
        stretch : (n_balloons,) array
        own : (n_own,) array
            The unknowns of all parts.
        times : (n,) array
            Rising; states are returned at these.
        effort : Effort
            Counters, added to.
        stopping : Stopping, optional
            What ends it besides what ends the history.

        Raises
        ------
        IntegrationError
            If IDA fails.
        """
        seen = (stopping or Stopping()).among(watched(self))
        equals = self._equals(stretch.tolist(), own.tolist())

        def even(values: list[float]) -> list[float]:
            return _evened(values, equals) if equals else values

        # IDA looks at the margins at its steps, and at the times asked for.
        gone: list[tuple[float, list[float]]] = []

        def margins(t: float, values: list[float], speeds: list[float]) -> list[float]:
            v, values = drive(t)[0], even(values)
            if t == times[0]:
                gone.clear()  # begun anew
            gone.append((t, values))
            return [one.margin(values, v) for one in seen]

        def jacobian(t: float, values: list[float], speeds: list[float], cj: float) -> list[list[float]]:
            v, values = drive(t)[0], even(values)
            rows = self._jacobian(values, speeds, v, cj)
            if not equals:
                return rows
            # The residual depends on the means alone: where equal balloons would part, the rest is singular.
            still = self._jacobian(values, speeds, v, 0.0)
            return [
                [entry - part + mean for entry, part, mean in zip(row, parts, even(parts), strict=True)]
                for row, parts in zip(rows, still, strict=True)
            ]

        start = np.array(even(self.unknowns(stretch, own)))
        rounding = sum(w.weight * x**4 for w, x in zip(self._walls, stretch.tolist(), strict=True))
        system = System(
            lambda t, y, yp: self._residual(even(y), yp, *drive(t)),
            jacobian,
            margins,
            [one.ends for one in seen],
        )
        rates = np.array(self._rates(start.tolist(), *drive(float(times[0]))))
        # A third time, or IDA's own steps would be returned.
        asked = times if times.size > 2 else np.array([times[0], times.mean(), times[-1]])
        states = self._own.stop
        rtol = _RTOL_OF_PARTS if self.slots else _RTOL

        def integrated(atol_energy: float) -> Course:
            atol = np.array([*[_ATOL] * states, *[atol_energy * rounding] * (start.size - states)])
            return integrate(
                system, asked, start, rates, effort, rtol=rtol, atol=atol, most_steps=_MOST_STEPS
            )

        try:
            course = integrated(_ATOL_ENERGY)
        except IntegrationError:
            course = integrated(_ATOL_ENERGY_WIDE)
        found = [(e.time, np.array(even(e.state.tolist())), seen[e.which]) for e in course.events]
        passed = tuple(
            Passed(time, one.kind, y[: self.count], y[self._own], one.balloon, one.mode)
            for time, y, one in found
        )
        ended = bool(found) and found[-1][2].ends
        end = passed[-1].time if ended else float(times[-1])
        kept = np.isin(course.time, times) & (course.time < end) | (course.time == end)
        kept[-1] = True  # where it ended
        y = np.array([even(state) for state in course.states[kept].tolist()])

        def split(y: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
            return y[:, : self.count], y[:, self._own], y[:, states:-2], y[:, -2], y[:, -1]

        asked_for = set(times.tolist())
        own_steps = sorted((t, y) for t, y in gone if times[0] < t < end and t not in asked_for)
        steps = np.array([y for _, y in own_steps]).reshape(-1, start.size)
        went = Steps(np.array([t for t, _ in own_steps]), *split(steps))
        return Passage(course.time[kept], *split(y), passed, ended, went)

    def _equals(self, stretch: Sequence[float], own: Sequence[float]) -> list[list[int]]:
        """Places of unknowns that stay equal: of equal balloons that are alike, and of their parts."""
        membranes = {
            i: (membrane, group.equations.is_open)
            for group in self.groups
            for i, membrane in zip(group.members, group.equations.membranes, strict=True)
        }
        inside: list[list[int]] = [[] for _ in range(self.count)]
        for slot in self.material.slots:
            inside[slot.balloon] += range(slot.own.start, slot.own.stop)

        def same(i: int, j: int) -> bool:
            makes = ((membranes[k], self.material.friction[k], self.material.parts[k]) for k in (i, j))
            if next(makes) != next(makes):
                return False
            pairs = [(stretch[i], stretch[j])]
            pairs += [(own[a], own[b]) for a, b in zip(inside[i], inside[j], strict=True)]
            return all(abs(a - b) <= _ALIKE * abs(b) for a, b in pairs)

        sets: list[list[int]] = []
        for i in range(self.count):
            known = next((one for one in sets if same(i, one[0])), None)
            if known is None:
                sets.append([i])
            else:
                known.append(i)
        several = [one for one in sets if len(one) > 1]
        of_parts = [places for one in several for places in zip(*(inside[i] for i in one), strict=True)]
        return several + [[self.count + place for place in places] for places in of_parts]


def _moved(slot: Slot, own: int, books: int) -> Slot:
    """A slot whose places are counted from others."""
    return slot._replace(
        own=slice(slot.own.start + own, slot.own.stop + own),
        books=slice(slot.books.start + books, slot.books.stop + books),
    )


def _evened(values: list[float], equals: Sequence[Sequence[int]]) -> list[float]:
    """Unknowns with the means of those that are equal."""
    out = list(values)
    for places in equals:
        mean = sum(values[i] for i in places) / len(places)
        for i in places:
            out[i] = mean
    return out
