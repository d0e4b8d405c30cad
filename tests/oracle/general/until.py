"""Where a quantity first takes the value at which a step ends early."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize_scalar

from tests.oracle.general import points
from tests.oracle.general.branch import INSIDE, Branch, Piece
from tests.oracle.general.device import Device
from tests.oracle.general.equations import Equations
from tests.oracle.general.points import PathError

FloatArray = NDArray[np.float64]

AT = 1e-12  # a relative distance from a value that is none
CLOSE = 1e-9  # one that is too close to call


@dataclass
class Watched:
    """A quantity that ends a step; `side` is on which side of its value it has been, 0 while it is at it."""

    kind: str
    balloon: int
    value: float
    side: float = 0.0
    doubt: str | None = None

    def distance(self, device: Device, stretch: FloatArray, pressure: float, voltage: FloatArray) -> float:
        """How far the device is from the value, relatively and with a sign."""
        if self.kind == "pressure":
            return pressure / self.value - 1.0
        if self.kind == "stretch":
            return float(stretch[self.balloon]) / self.value - 1.0
        field = device.field(stretch, voltage)[device.electroded.index(self.balloon)]
        return float((field / self.value) ** 2 - 1.0)

    def note(self, distance: float) -> bool:
        """Take down a distance after something that happened at once; whether the value was passed over."""
        passed = self.side * distance < 0.0
        if abs(distance) > AT and not passed:
            self.side = float(np.sign(distance))
        if AT < abs(distance) < CLOSE:
            self.doubt = f"a {self.kind} only just left or reached, {distance:.2g}"
        return passed

    def of(self, eq: Equations) -> Callable[[Sequence[Any]], Any] | None:
        """The same distance of a set of equations; None where it has no part in it."""
        value = self.value
        if self.kind == "pressure":
            return (lambda y: y[-2] / value - 1.0) if eq.closed else None
        if self.balloon not in eq.members:
            return None
        place = eq.members.index(self.balloon)
        if self.kind == "stretch":
            return lambda y: y[place] / value - 1.0
        thickness = eq.walls[place].thickness
        return lambda y: (eq.voltages(y)[place] * y[place] ** 2 / (thickness * value)) ** 2 - 1.0

    def met(self, eq: Equations, branch: Branch, first: float, last: float) -> FloatArray | None:
        """The first state from one v to another of a branch that has the value."""
        margin = self.of(eq)
        if margin is None or first == last:
            return None
        for piece in branch.pieces(first, last):
            found = self._met_on(eq, piece, margin)
            if found is not None:
                return found
        return None

    def _met_on(
        self, eq: Equations, piece: Piece, margin: Callable[[Sequence[Any]], Any]
    ) -> FloatArray | None:
        def ahead(share: float) -> float:
            return self.side * float(margin(piece.at(share).tolist()))

        shares = [0.0, *INSIDE, 1.0]
        if not self.side:
            # It is left first, to the side that is seen a little further on.
            shares = [1e-3, *INSIDE, 1.0]
            distance = float(margin(piece.at(shares[0]).tolist()))
            if abs(distance) <= AT:
                shares = [1.0]
                distance = float(margin(piece.b.tolist()))
            self.side = float(np.sign(distance)) if abs(distance) > AT else 0.0
            if not self.side:
                return None
        values = [ahead(share) for share in shares]
        for i in range(len(shares) - 1):
            if values[i + 1] <= AT:
                return self._polished(eq, piece, margin, ahead, shares[i], shares[i + 1])
            if _may_dip(ahead, shares, values, i):
                around = shares[max(i - 1, 0)], shares[i + 1]
                low = minimize_scalar(ahead, bounds=around, method="bounded", options={"xatol": 1e-10})
                if abs(low.fun) < CLOSE:
                    self.doubt = f"a {self.kind} is only just touched or not, {low.fun:.2g}"
                if low.fun <= AT:
                    return self._polished(eq, piece, margin, ahead, around[0], float(low.x))
        return None

    def _polished(
        self,
        eq: Equations,
        piece: Piece,
        margin: Callable[[Sequence[Any]], Any],
        ahead: Callable[[float], float],
        low: float,
        high: float,
    ) -> FloatArray:
        if ahead(high) >= 0.0:
            return piece.at(high)
        if ahead(low) <= 0.0:
            return piece.at(low)
        guess = piece.at(float(brentq(ahead, low, high, xtol=1e-14, rtol=1e-14)))
        found = points.where(eq, guess, margin)
        if found is None or np.max(np.abs(found - guess) / eq.scales(guess)) > 1e-7:
            raise PathError(f"the state with a {self.kind} of {self.value} could not be polished")
        return found


def _may_dip(
    ahead: Callable[[float], float], shares: Sequence[float], values: Sequence[float], i: int
) -> bool:
    """Whether a distance may be smallest beside the sample i of a piece, where both neighbours are larger.

    At the ends of a piece, which have one neighbour, its slope there decides.
    """
    beside = 1e-6
    if i == 0:
        return values[0] <= values[1] and ahead(shares[0] + beside) < values[0]
    if i == len(shares) - 2 and values[i + 1] <= values[i] and ahead(shares[-1] - beside) < values[-1]:
        return True
    return values[i - 1] > values[i] <= values[i + 1] and values[i] < 0.5 * (values[i - 1] + values[i + 1])
