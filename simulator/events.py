"""What can happen to the balloons: the kinds of events, how they end a history, and their words.

Every package names events by `EventKind`: a condition of the model that falls through zero, the end of a
branch or of a flow in the solver, and the `Event` of a history, its row in a table and its mark in a picture.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from types import MappingProxyType


class EventKind(StrEnum):
    """What can happen on the way.

    From the first three the balloons go on: with a snap, along another branch, or after a flow. The next four
    end a history. The last two change nothing, unless a scenario asks to stop there.
    """

    LIMIT_POINT = "limit_point"
    BRANCH_POINT = "branch_point"
    JUMP = "jump"
    LOSS_OF_TENSION = "loss_of_tension"
    BREAKDOWN = "breakdown"
    RUNAWAY = "runaway"
    OUT_OF_RANGE = "out_of_range"  # a stretch beyond the curve that its elastomer was measured on
    LOSS_OF_SPHERICITY = "loss_of_sphericity"  # a balloon would no longer stay a sphere
    SPHERICITY_REGAINED = "sphericity_regained"


class Outcome(StrEnum):
    """How a history ended. Everything but `Outcome.FAILED` is physics, and a result."""

    COMPLETED = "completed"
    LOSS_OF_TENSION = "loss_of_tension"
    BREAKDOWN = "breakdown"
    RUNAWAY = "runaway"
    OUT_OF_RANGE = "out_of_range"
    LOSS_OF_SPHERICITY = "loss_of_sphericity"  # where `[shape] on_loss = "stop"`
    FAILED = "failed"  # the solver gave up; the history up to there is kept, as partial


OUTCOMES: Mapping[EventKind, Outcome] = MappingProxyType(
    {
        EventKind.LOSS_OF_TENSION: Outcome.LOSS_OF_TENSION,
        EventKind.BREAKDOWN: Outcome.BREAKDOWN,
        EventKind.RUNAWAY: Outcome.RUNAWAY,
        EventKind.OUT_OF_RANGE: Outcome.OUT_OF_RANGE,
    }
)
"""The events that end a history, and the outcome that it then has."""

SHAPE_EVENTS = frozenset({EventKind.LOSS_OF_SPHERICITY, EventKind.SPHERICITY_REGAINED})
"""Events that are recorded beside a history, which goes on as if the balloons were spheres."""

WORDS: Mapping[EventKind, str] = MappingProxyType(
    {
        EventKind.LIMIT_POINT: "limit point",
        EventKind.BRANCH_POINT: "branch point",
        EventKind.JUMP: "voltage jump",
        EventKind.LOSS_OF_TENSION: "loss of tension",
        EventKind.BREAKDOWN: "breakdown",
        EventKind.RUNAWAY: "runaway",
        EventKind.OUT_OF_RANGE: "out of range",
        EventKind.LOSS_OF_SPHERICITY: "loss of sphericity",
        EventKind.SPHERICITY_REGAINED: "sphericity regained",
    }
)
"""What each kind is called where it is read, in legends and sentences."""
