"""The path of one balloon under a moving pressure, which is a formula of its stretch: no DAE is needed."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.model.conditions import Condition
from simulator.model.equations import OpenBalloon
from simulator.solver.newton import NotConverged

if TYPE_CHECKING:
    from collections.abc import Sequence

FloatArray = NDArray[np.float64]

_TURN = 0.3  # by which the direction may change from one point of an inflation to the next, in radians
_MOST_STEPS = 10_000
_HALVINGS = 8


def inflated(
    equations: OpenBalloon, conditions: Sequence[Condition], start: FloatArray, target: float
) -> tuple[FloatArray, FloatArray, int]:
    """Points along the path from a state to v = `target`, or to the first condition that ends it.

    Steps are in stretch, as R is linear in the pressure, and so long that the path turns little.

    Parameters
    ----------
    equations, conditions
    start : (2,) array
        Stretch and pressure.
    target : float
        Pressure wanted.

    Returns
    -------
    points, directions : (2, n) arrays
    ended : int
        Which condition ended them; their number where the target was reached.

    Raises
    ------
    NotConverged
        If nothing ends it.
    """
    sense = 1.0 if target > start[-1] else -1.0
    scale = float(equations.scales[-1])
    linearised = equations.membrane.linearised
    limit = equations.walls[0].elastomer.stretch_limit

    def at(stretch: float) -> tuple[float, float, float]:
        """The pressure, and the unit direction in which the stretch grows, in scaled unknowns."""
        residual, _, per_pressure, _ = linearised(stretch, 0.0, 0.0)
        pressure = -residual / per_pressure
        rise = -linearised(stretch, pressure, 0.0)[1] / (per_pressure * scale)
        length = math.hypot(1.0, rise)
        return pressure, 1.0 / length, rise / length

    def ended(stretch: float, pressure: float) -> int | None:
        if sense * (target - pressure) <= 0.0:
            return len(conditions)
        margins = [condition.margin((stretch, pressure)) for condition in conditions]
        return next((place for place, margin in enumerate(margins) if margin <= 0.0), None)

    def arrays() -> tuple[FloatArray, FloatArray]:
        unit = np.array([1.0, scale])
        return np.array([row[:2] for row in rows]).T, way * np.array([row[2:] for row in rows]).T * unit[
            :, None
        ]

    stretch, step = float(start[0]), 0.1
    _, along, rise = at(stretch)
    way = sense if rise >= 0.0 else -sense  # whether it grows or shrinks from here
    rows = [(stretch, float(start[-1]), along, rise)]
    for _ in range(_MOST_STEPS):
        further = stretch + way * step * along
        turn = math.inf
        if 0.0 < further < limit:
            pressure, ahead, ahead_rise = at(further)
            turn = abs(along * ahead_rise - rise * ahead)
        if turn > 2.0 * _TURN:
            step *= 0.5
            continue
        end = ended(further, pressure)
        if end is not None:
            inside = stretch
            for _ in range(_HALVINGS):  # so that Newton's method starts close
                middle = 0.5 * (inside + further)
                pressure, ahead, ahead_rise = at(middle)
                found = ended(middle, pressure)
                if found is None:
                    inside = middle
                else:
                    further, end = middle, found
            rows.append((further, *at(further)))
            return *arrays(), end
        stretch, along, rise = further, ahead, ahead_rise
        rows.append((stretch, pressure, along, rise))
        step *= min(max(_TURN / (turn + 1e-3), 0.5), 3.0)
    raise NotConverged(f"no end within {_MOST_STEPS} steps")
