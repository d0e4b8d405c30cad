"""Equal balloons in equal states: one stands for all of them.

Balloons that are equal, equally driven and equally stretched stay so in any flow. Integrated one by one,
rounding alone would part them wherever the common state is unstable, and which of them grows would be chance.
k equal balloons on one gas (or liquid) are exactly one of k times the volume, weight and capacitance, under
the same loads.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator.model.conditions import Condition
from simulator.model.drive import AffineDrive
from simulator.model.equations import Equations, SealedBalloons
from simulator.model.membranes import AnyMembrane, Membrane

FloatArray = NDArray[np.float64]

_ROUNDING = 1e-13  # voltages (or charges) closer than this, relatively, are equal
_ALIKE = 1e-9  # stretches of equal balloons closer than this, relatively, differ by rounding alone


@dataclass(frozen=True)
class Symmetry:
    """Which balloons are alike in a state, and the equations of one for each set of them.

    Attributes
    ----------
    sets : tuple of tuples of int
        Places of the balloons, those that are alike together, in order of the first of each.
    equations : SealedBalloons
        One balloon for each set.
    """

    sets: tuple[tuple[int, ...], ...]
    equations: SealedBalloons

    def narrowed(self, state: FloatArray) -> FloatArray:
        """A state (n_unknowns,) with the mean stretch of each set."""
        count = sum(map(len, self.sets))
        means = [float(np.mean(state[list(alike)])) for alike in self.sets]
        return np.array([*means, *state[count:]])

    def widened(self, values: Any) -> list[Any]:
        """The state of all balloons, of numbers or rows of arrays, from that of one for each set."""
        stretches: list[Any] = [0.0] * sum(map(len, self.sets))
        for alike, x in zip(self.sets, values, strict=False):
            for place in alike:
                stretches[place] = x
        return [*stretches, *values[len(self.sets) :]]

    def condition(self, whole: Condition) -> Condition:
        """A condition on the state of all balloons, as one on that of one for each set."""

        def slope(y: FloatArray) -> FloatArray:
            full = whole.slope(np.array(self.widened(y)))
            count = sum(map(len, self.sets))
            return np.array([*(full[list(alike)].sum() for alike in self.sets), *full[count:]])

        return Condition(whole.kind, lambda y: whole.margin(self.widened(y)), slope)


def symmetry(equations: Equations, state: FloatArray, closeness: float = _ALIKE) -> Symmetry | None:
    """Which balloons are alike in a state (n_unknowns,); None if none are.

    Stretches of equal balloons count as equal where they differ by less than `closeness`, relatively.
    """
    if not isinstance(equations, SealedBalloons):
        return None
    sets: list[list[int]] = []
    for place, membrane in enumerate(equations.membranes):
        for known in sets:
            first = known[0]
            apart = abs(state[place] - state[first])
            same = _same(equations.membranes[first], membrane, float(state[-1]))
            if same and apart <= closeness * abs(state[first]):
                known.append(place)
                break
        else:
            sets.append([place])
    if len(sets) == len(equations.membranes):
        return None
    ones = tuple(_together(equations.membranes[alike[0]], len(alike)) for alike in sets)
    return Symmetry(tuple(map(tuple, sets)), replace(equations, membranes=ones))


def _same(one: AnyMembrane, other: AnyMembrane, v: float) -> bool:
    """Whether two balloons are equal, and driven equally to rounding: voltages may follow from charges."""
    if one == other:
        return True
    if isinstance(one, Membrane) or isinstance(other, Membrane):
        return False
    return replace(one, drive=other.drive) == other and all(
        math.isclose(here, there, rel_tol=_ROUNDING)
        for here, there in (
            (one.drive.at(v), other.drive.at(v)),
            (one.drive.slope(v), other.drive.slope(v)),
        )
    )


def _together(membrane: AnyMembrane, count: int) -> AnyMembrane:
    """The one that stands for so many equal ones."""
    if count == 1:
        return membrane
    whole = membrane.wall
    wall = replace(whole, weight=count * whole.weight, cube=count * whole.cube)
    if isinstance(membrane, Membrane):
        return wall
    drive = membrane.drive
    if isinstance(drive, AffineDrive) and drive.quantity == "charge":
        drive = replace(drive, offset=count * drive.offset, rate=count * drive.rate)
    return replace(membrane, wall=wall, capacitance=count * membrane.capacitance, drive=drive)
