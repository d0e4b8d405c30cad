"""How balloons take their time, and what became of them over a stretch of it: the data of `viscous`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from simulator.model.parts import Numbers, Part

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class Friction:
    """What slows a balloon down, c λⁿ dλ/dt = −g: the coefficient c and the exponent n."""

    coefficient: float
    exponent: float = 0.0

    def at(self, stretch: float) -> float:
        """cλⁿ."""
        return float(self.coefficient * stretch**self.exponent)


class Slot(NamedTuple):
    """A part, its balloon and number in it (from 0), and the places of its unknowns and of its books."""

    balloon: int
    number: int
    part: Part
    own: slice
    books: slice


@dataclass(frozen=True)
class Material:
    """How the balloons take their time: the friction and the parts of each."""

    friction: tuple[Friction, ...]
    parts: tuple[tuple[Part, ...], ...]

    @classmethod
    def alike(cls, count: int) -> Material:
        """So many balloons at the pace dλ/dt = −g."""
        return cls((Friction(1.0),) * count, ((),) * count)

    @cached_property
    def slots(self) -> tuple[Slot, ...]:
        """All parts, the places counted from 0 among the unknowns, and among the books, of all parts."""
        found: list[Slot] = []
        own = books = 0
        for i, parts in enumerate(self.parts):
            for number, part in enumerate(parts):
                after, kept = own + len(part.at_rest), books + len(part.books)
                found.append(Slot(i, number, part, slice(own, after), slice(books, kept)))
                own, books = after, kept
        return tuple(found)

    def at_rest(self) -> FloatArray:
        """The unknowns of all parts in unstretched balloons, (n_own,)."""
        return np.array([value for slot in self.slots for value in slot.part.at_rest])

    def stiffening(self, stretch: Numbers, own: Numbers) -> list[Any]:
        """Σ ∂S/∂λ of the parts of each balloon, (n_balloons,), their own unknowns as they are."""
        found: list[Any] = [0.0] * len(self.parts)
        for slot in self.slots:
            found[slot.balloon] += slot.part.stiffness(stretch[slot.balloon], own[slot.own])
        return found

    def roundness(self, mode: str, balloon: int, stretch: float, own: Sequence[float]) -> float:
        """What a balloon's parts add to the margin of its shape: of a pear, or of shear in its surface."""
        mine = [slot for slot in self.slots if slot.balloon == balloon]
        if mode == "pear":
            return float(sum(slot.part.sphericity(stretch, own[slot.own]) for slot in mine))
        return float(sum(slot.part.shear_stiffness(stretch, own[slot.own]) for slot in mine))

    def stored(self, stretch: Numbers, own: Numbers) -> Any:
        """The energy in all parts, over 4πR²Hμ."""
        return sum(slot.part.energy(stretch[slot.balloon], own[slot.own]) for slot in self.slots)


@dataclass(frozen=True)
class Passed:
    """A margin that fell through zero: when, of what kind, and the stretches and own unknowns then.

    Of a balloon's shape also which balloon, and what it would turn into.
    """

    time: float
    kind: str
    stretch: FloatArray
    own: FloatArray
    balloon: int = -1
    mode: str = ""


class Steps(NamedTuple):
    """What the integrator went through between the times that it was asked for, m steps.

    `time` (m,) and the rest as in `Passage`.
    """

    time: FloatArray
    stretch: FloatArray
    own: FloatArray
    books: FloatArray
    work: FloatArray
    friction: FloatArray


@dataclass(frozen=True)
class Passage:
    """What became of the balloons over a stretch of time.

    Attributes
    ----------
    time : (n,) array
        The times asked for, up to the end.
    stretch : (n, n_balloons) array
    own : (n, n_own) array
        The unknowns of all parts.
    books : (n, n_books) array
        What the parts have exchanged up to each time.
    work, friction : (n,) arrays
        ∫ −∂Π/∂v dv up to each time, and what friction has dissipated.
    passed : tuple of Passed
        Limit points and changes of shape in order of time; and what ended it, if anything did.
    ended : bool
    steps : Steps
        Of the integrator, which do not depend on the times asked for.
    """

    time: FloatArray
    stretch: FloatArray
    own: FloatArray
    books: FloatArray
    work: FloatArray
    friction: FloatArray
    passed: tuple[Passed, ...]
    ended: bool
    steps: Steps

    def with_steps(self, places: IntArray) -> Passage:
        """The same with some steps of the integrator among its times."""
        steps = self.steps
        at = np.searchsorted(self.time, steps.time[places])
        return replace(
            self,
            **{
                name: np.insert(getattr(self, name), at, getattr(steps, name)[places], axis=0)
                for name in steps._fields
            },
        )
