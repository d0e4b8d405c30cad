"""Parts that a balloon in real time may have besides its wall, each with unknowns of its own.

A part carries a share S of the force balance g = 0 and says how fast its own unknowns move: the inner strains
of a viscoelastic branch, the charge of a film behind a resistance. It keeps books of what it exchanges. A
balloon without parts has no such terms at all.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Number = Any
# Unknowns in order: numbers, or rows of arrays.
Numbers = Sequence[Any] | NDArray[Any]


class Tangent(NamedTuple):
    """Derivatives of a part's share S, of its rates and of its books, in the stretch and in its own unknowns.

    No unknown of a part moves another one: `rates_per_own` has one number for each. The books have one row
    for each book.
    """

    share_per_stretch: float
    share_per_own: Sequence[float]
    rates_per_stretch: Sequence[float]
    rates_per_own: Sequence[float]
    books_per_stretch: Sequence[float]
    books_per_own: Sequence[Sequence[float]]


class Part(Protocol):
    """A part of one balloon. `own` are its unknowns, v is the coordinate of the drive.

    `at_rest` are the unknowns in an unstretched balloon that has rested without a voltage, `books` the names
    of what it keeps books of, as powers over 4πR²Hμ: work that is done on it is "work", all else is lost.
    `electrical` says whether its share is that of a voltage, which a state shows besides.
    """

    @property
    def at_rest(self) -> tuple[float, ...]: ...
    @property
    def books(self) -> tuple[str, ...]: ...
    @property
    def electrical(self) -> bool: ...

    def moves(
        self, stretch: float, own: Sequence[float], v: float
    ) -> tuple[float, Sequence[float], Sequence[float]]:
        """S, the rates of the own unknowns, and the powers of the books."""
        ...

    def tangent(self, stretch: float, own: Sequence[float], v: float) -> Tangent:
        """Derivatives of what `moves` gives."""
        ...

    def stiffness(self, stretch: Number, own: Numbers) -> Number:
        """∂S/∂λ of changes that are too quick for the part's own unknowns."""
        ...

    def sphericity(self, stretch: Number, own: Numbers) -> Number:
        """∂S/∂λ − S/λ, the share of the margin of sphericity; see `docs/shape.md`."""
        ...

    def shear_stiffness(self, stretch: Number, own: Numbers) -> Number:
        """The share of what resists shear in the film's surface, over μ."""
        ...

    def energy(self, stretch: Number, own: Numbers) -> Number:
        """The energy stored in it, over 4πR²Hμ."""
        ...

    def columns(self, own: FloatArray) -> dict[str, FloatArray]:
        """What is told of n rows of unknowns (n, m): arrays (n,) by the end of their names."""
        ...
