"""Whether the balloons of a history stay spheres: what its events say of each of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from simulator.events import SHAPE_EVENTS, EventKind

if TYPE_CHECKING:
    from simulator.results.history import Event, History

Place = Literal["path", "flow", "rest"]

SHAPES = (
    "sphere",
    "snap_of_a_sphere",
    *(
        f"{mode}_{where}"
        for mode in ("pear", "shear")
        for where in ("without_snap", "before_snap", "at_landing", "after_snap", "in_snap")
    ),
)
"""What `shape_word` may say."""

# A curve, or functions of one stretch, say nothing of how a film resists shear.
_ABOUT_EQUAL_STRETCHES = ("tabulated", "python")


@dataclass(frozen=True)
class Loss:
    """Where a balloon would stop being a sphere.

    Attributes
    ----------
    event : Event
    place : {"path", "flow", "rest"}
        On a branch, or in real time; on the way of a snap or jump that ends in a sphere again; or where a
        snap or jump comes to rest.
    regained : float or None
        The time at which it would be a sphere again.
    """

    event: Event
    place: Place
    regained: float | None


@dataclass(frozen=True)
class ShapeVerdict:
    """What becomes of the shape of a balloon.

    Attributes
    ----------
    balloon : str
    losses : tuple of Loss
        In order of time; none of a balloon that stays a sphere.
    least : float
        The smallest margin s of all samples, over μ.
    pear_only : bool
        Whether its elastomer is known about equal stretches only. That no other shape comes before the pear
        is then an assumption.
    """

    balloon: str
    losses: tuple[Loss, ...]
    least: float
    pear_only: bool

    def record(self) -> dict[str, object]:
        """What `run.json` says of it: plain values."""
        return {
            "balloon": self.balloon,
            "sphere": not self.losses,
            "least_sphericity": self.least,
            "pear_only": self.pear_only,
            "losses": [
                {
                    "time": loss.event.time,
                    "step": loss.event.step,
                    "mode": loss.event.mode,
                    "place": loss.place,
                    "voltage": loss.event.voltage,
                    "regained": loss.regained,
                }
                for loss in self.losses
            ],
        }


def verdicts(history: History) -> tuple[ShapeVerdict, ...]:
    """What becomes of the shape of every balloon; none where the scenario ignores it."""
    if not history.sphericity.size:
        return ()
    return tuple(
        ShapeVerdict(
            balloon.name,
            tuple(_losses([e for e in history.events if e.balloon == balloon.name])),
            float(history.sphericity[:, i].min()),
            balloon.elastomer.model in _ABOUT_EQUAL_STRETCHES,
        )
        for i, balloon in enumerate(history.scenario.balloons)
    )


def _losses(events: Sequence[Event]) -> Iterator[Loss]:
    """The losses of one balloon, of its events of shape."""
    for number, event in enumerate(events):
        if event.kind is not EventKind.LOSS_OF_SPHERICITY:
            continue
        back = next(
            (e for e in events[number + 1 :] if e.mode == event.mode and e.kind is not event.kind), None
        )
        place: Place = "path"
        if _in_flow(event):
            through = back is not None and back.time == event.time and _in_flow(back)
            place = "flow" if through else "rest"
        yield Loss(event, place, None if back is None else back.time)


def _in_flow(event: Event) -> bool:
    """Whether an event of shape happens in a snap or a jump, between two states."""
    return event.stretch_after is not None and not np.array_equal(event.stretch_before, event.stretch_after)


def row_of(history: History, event: Event, since: int = 0) -> int:
    """The sample from which on what an event of shape says holds: that of its side after.

    It is none before `since`: a voltage may jump up and back at one instant.
    """
    # Times rise: a search, where a recording has a million rows and a thousand events.
    first, last = np.searchsorted(history.time, [event.time, np.nextafter(event.time, np.inf)])
    rows = np.arange(first, last)
    rows = rows[rows >= since] if rows[-1] >= since else rows[-1:]
    # Several events may share an instant; the state after this one is told by stretches and voltages.
    there = (history.stretch[rows] == event.stretch_after).all(axis=1)
    there &= (history.voltage[rows] == event.voltage).all(axis=1)
    return int(rows[there][0] if there.any() else rows[-1])


def lost_rows(history: History) -> NDArray[np.bool_]:
    """Which samples, (n_samples,), no real balloons would be in: some balloon has lost its sphere by then.

    A sample that is spherical again counts as one of spheres.
    """
    changes = np.zeros(len(history) + 1, dtype=np.int64)
    row = 0
    for event in history.events:
        if event.kind in SHAPE_EVENTS:
            row = row_of(history, event, row)
            changes[row] += 1 if event.kind is EventKind.LOSS_OF_SPHERICITY else -1
    return np.asarray(np.cumsum(changes)[:-1] > 0)


def shape_word(history: History, snaps: Sequence[Event]) -> str | None:
    """What becomes of the shapes in a history with some snaps, in one word.

    Parameters
    ----------
    history : History
    snaps : sequence of Event
        Voltage-driven snaps with a landing.

    Returns
    -------
    str or None
        Without a loss "sphere", or with a snap "snap_of_a_sphere". Else "pear_" (or "shear_", after what is
        first) and "without_snap", "before_snap", "at_landing" of the first snap, "after_snap", or "in_snap",
        where all shapes that are lost are regained in the same snap. None where shapes are ignored.
    """
    if not history.sphericity.size:
        return None
    losses = [loss for verdict in verdicts(history) for loss in verdict.losses]
    if not losses:
        return "snap_of_a_sphere" if snaps else "sphere"
    order = {id(event): number for number, event in enumerate(history.events)}
    lasting = sorted((one for one in losses if one.place != "flow"), key=lambda one: order[id(one.event)])
    if not lasting:
        first = min(losses, key=lambda one: order[id(one.event)])
        return f"{first.event.mode}_in_snap"
    first = lasting[0]
    if not snaps:
        where = "without_snap"
    elif order[id(first.event)] < order[id(snaps[0])]:
        where = "before_snap"
    elif first.place == "rest" and first.event.time == snaps[0].time:
        where = "at_landing"
    else:
        where = "after_snap"
    return f"{first.event.mode}_{where}"
