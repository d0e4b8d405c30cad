"""How a history goes on from a branch point: balloons under equal loads part.

Of the ways that are equal by symmetry, the one on which the first balloon concerned grows. If one of the
branches goes on in the sense of the drive, the state goes over to it gradually; else it is carried away by
the flow.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tests.oracle.general import flow, points
from tests.oracle.general.branch import Branch, End
from tests.oracle.general.equations import Equations
from tests.oracle.general.flow import Rest
from tests.oracle.general.points import PathError

FloatArray = NDArray[np.float64]

ASIDE = 1e-3  # relative distance at which the branches are told apart


def past_branch_point(eq: Equations, end: End, sense: float) -> tuple[Rest, Branch | None]:
    """What happens at a branch point, and the branch that it gradually goes over to, if any."""
    assert end.mode is not None
    y = end.y
    values = eq.modes(y.tolist())[0]
    several = values.size > 1 and abs(values[1]) < 1e-7
    doubt = end.doubt or ("several modes soften at once" if several else None)
    mode = end.mode
    leader = int(np.argmax(np.abs(mode) > 1e-6 * np.max(np.abs(mode))))
    mode = mode * np.sign(mode[leader])
    here = Rest(None, -1, y, 0.0, doubt)
    straight = _ahead(eq, y, mode, sense)
    if straight is not None:
        return here, straight
    for side in (mode, -mode):
        parted = _aside(eq, y, side)
        if sense * (parted[-1] - y[-1]) > 0.0 and eq.stability(parted.tolist()) > 0.0:
            return here, _from_the_point(eq, y, parted)
    rest = flow.relax(eq, float(y[-1]), flow.beside(eq, y, mode), y, off=10.0 * flow.OFF)
    return replace(rest, doubt=rest.doubt or doubt), None


def _ahead(eq: Equations, y: FloatArray, mode: FloatArray, sense: float) -> Branch | None:
    """The branch that goes straight on without parting, if it is stable there."""
    scales = eq.scales(y)
    matrix = np.vstack(
        [eq.jacobian(y.tolist()) * scales, [*(mode * scales[: eq.size]), *[0.0] * (y.size - eq.size)]]
    )
    matrix = np.vstack([matrix, [0.0] * (y.size - 1) + [1.0]])
    rhs = np.zeros(len(matrix))
    rhs[-1] = sense
    t = np.linalg.lstsq(matrix, rhs, rcond=1e-10)[0] * scales
    guess = y + ASIDE * t / np.linalg.norm(t / scales)
    found = points.at_drive(eq, guess, float(guess[-1]))
    if found is None or not eq.stability(found.tolist()) > 0.0:
        return None
    if np.linalg.norm((found - guess) / scales) > 0.3 * ASIDE:
        return None
    return _from_the_point(eq, y, found)


def _aside(eq: Equations, y: FloatArray, mode: FloatArray) -> FloatArray:
    """An equilibrium off the branch point along the soft mode."""
    scales = eq.scales(y)
    normal = np.concatenate([mode, np.zeros(y.size - eq.size)]) / scales**2
    guess = y.copy()
    guess[: eq.size] += ASIDE * mode / float(np.max(np.abs(mode) / scales[: eq.size]))
    found = points.on_plane(eq, guess, normal)
    if found is None:
        raise PathError(f"no way aside from the branch point {y.tolist()}")
    return found


def _from_the_point(eq: Equations, y: FloatArray, found: FloatArray) -> Branch:
    """A branch through a state beside the branch point, known up to the point itself."""
    branch = Branch.through(eq, found)
    branch.extend(float(y[-1]))
    return branch
