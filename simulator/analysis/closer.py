"""More points of a path where those of the solver are too far apart for a picture."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from simulator.analysis.path import PathPoints
from simulator.model.groups import AnyEquations
from simulator.scenario.settings import CHORD
from simulator.simulation.chords import Ranges, needed
from simulator.solver import newton
from simulator.solver.follow import PathError
from simulator.solver.newton import NotConverged

FloatArray = NDArray[np.float64]

_ROUNDS = 8


def closer(
    equations: AnyEquations,
    points: PathPoints,
    quantities: Callable[[FloatArray], FloatArray],
    farthest: float,
    drive: Callable[[FloatArray], FloatArray],
) -> PathPoints:
    """The points of a path, and as many more as keep each chord on it.

    Parameters
    ----------
    equations
    points : PathPoints
    quantities : callable
        All that a picture may show, (n, n_quantities), in states (n_unknowns, n).
    farthest : float
        How far the path is shown.
    drive : callable
        What that is measured by, (n,), in states.

    Raises
    ------
    PathError
        If a point is not found.
    """
    for _ in range(_ROUNDS):
        states, columns = points.states, quantities(points.states)
        seen = drive(states) <= farthest
        ranges = Ranges()
        ranges.widen(columns[seen])
        chords = np.diff(needed(columns, ranges.spans, CHORD))
        wide = np.flatnonzero((chords > 1.0) & seen[:-1] & seen[1:])
        if not wide.size:
            break
        steps = states[:, wide + 1] - states[:, wide]
        try:
            middle, _ = newton.on_planes(
                equations, states[:, wide] + 0.5 * steps, steps / equations.scales[:, None] ** 2
            )
        except NotConverged as failure:
            raise PathError(f"a point between two near v = {states[-1, wide[0]]:.12g}") from failure
        arcs = points.arclength
        points = replace(
            points,
            states=np.insert(states, wide + 1, middle, axis=1),
            arclength=np.insert(arcs, wide + 1, 0.5 * (arcs[wide] + arcs[wide + 1])),
            unstable=np.insert(points.unstable, wide + 1, points.unstable[wide + 1]),
        )
    return points
