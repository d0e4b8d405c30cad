"""The flow of several balloons with the valve open, up to what first ends it.

They do not feel each other, so each can be followed by itself to where it comes to rest. But the history ends
for all of them when one breaks its film, and the others are then still on their way.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.events import EventKind
from simulator.model.groups import Group
from simulator.solver.flow import FlowError, Rest
from simulator.solver.ida import Effort
from simulator.solver.viscous import Flow, Material

if TYPE_CHECKING:
    from simulator.simulation.atlas import Exit

FloatArray = NDArray[np.float64]

_LONGEST = 1e12  # of the flow's own time: never reached
_OFF = 1e-4  # stretch by which a snap is started off its limit point


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
    flow = Flow(groups, Material((1.0,) * count, (None,) * count))
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


def snaps_together(groups: Mapping[int, Group], exits: Mapping[int, Exit]) -> dict[int, Exit]:
    """Snaps of single balloons that begin at one instant, up to where the first of them ends the history.

    Parameters
    ----------
    groups : mapping of int to Group
    exits : mapping of int to Exit
        How each of them goes by itself.

    Raises
    ------
    FlowError
        If none ends it.
    """
    flowing = [replace(groups[place], members=(number,)) for number, place in enumerate(exits)]
    starts = []
    for exit in exits.values():
        assert exit.rest is not None
        starts.append(exit.before[0] + _OFF * np.sign(exit.rest.state[0] - exit.before[0]))
    v = float(next(iter(exits.values())).before[-1])
    kind, stretch = first_end(flowing, np.array(starts), v, Effort())
    return {
        place: replace(exit.ending(groups[place], Rest(np.array([x, v]), kind)), onward=None)
        for (place, exit), x in zip(exits.items(), stretch.tolist(), strict=True)
    }
