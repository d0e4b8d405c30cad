"""The flow of several balloons with the valve open, up to what first ends it.

They do not feel each other, so each can be followed by itself to where it comes to rest. But the history ends
for all of them when one breaks its film, and the others are then still on their way.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from simulator.events import EventKind
from simulator.model.groups import Group
from simulator.solver.flow import FlowError
from simulator.solver.ida import Effort
from simulator.solver.passage import Material
from simulator.solver.viscous import Flow

FloatArray = NDArray[np.float64]

_LONGEST = 1e12  # of the flow's own time: never reached


def first_end(
    groups: Sequence[Group], stretch: FloatArray, v: float, effort: Effort
) -> tuple[EventKind, FloatArray]:
    """What first ends the flow dλᵢ/dt = −gᵢ of all balloons, and their stretches (n_balloons,) then.

    Parameters
    ----------
    groups : sequence of Group
        All balloons.
    stretch : (n_balloons,) array
        Where they start.
    v : float
        The drive, frozen.
    effort : Effort
        Counters, added to.

    Raises
    ------
    FlowError
        If nothing ends it.
    """
    count = stretch.size
    flow = Flow(groups, Material.alike(count))
    for group in groups:
        state = flow.state(group, stretch.tolist(), v)
        for condition in group.conditions[1:]:
            if condition.margin(state) < 0.0:
                return EventKind(condition.kind), stretch
    lasts = 1.0
    while lasts < _LONGEST:
        passage = flow.run(lambda t: (v, 0.0), stretch, np.empty(0), np.array([0.0, lasts]), effort)
        if passage.ended:
            end = passage.passed[-1]
            return EventKind(end.kind), end.stretch
        stretch, lasts = passage.stretch[-1], 10.0 * lasts
    raise FlowError("what ends the flow of one balloon does not end that of all")
