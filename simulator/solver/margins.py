"""What is watched while balloons flow in real time: stability, what ends a history, and their shapes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, NamedTuple

from simulator.events import EventKind
from simulator.model.conditions import shape_conditions, stability_in_motion
from simulator.model.supply import SuppliedFilm

if TYPE_CHECKING:
    from simulator.model.conditions import ShapeCondition
    from simulator.model.groups import Group
    from simulator.solver.passage import Material, Slot
    from simulator.solver.viscous import Flow

# What a loss of sphericity does to a flow.
Shapes = Literal["record", "stop", "ignore"]


@dataclass(frozen=True)
class Watched:
    """A margin of all unknowns and v, what its fall through zero is, and whether that ends the history."""

    kind: str
    margin: Callable[[list[float], float], float]
    ends: bool
    balloon: int = -1
    mode: str = ""


class Stopping(NamedTuple):
    """What ends a passage besides what ends a history: values that are taken, and events of some kinds."""

    values: tuple[Watched, ...] = ()
    kinds: frozenset[str] = frozenset()

    def among(self, known: Iterable[Watched]) -> list[Watched]:
        """All that is watched, with what ends the passage."""
        return [*(replace(one, ends=True) if one.kind in self.kinds else one for one in known), *self.values]


def watched(flow: Flow) -> Iterator[Watched]:
    """What is watched in a flow, group by group.

    Parts count as they are at once: their own unknowns, such as inner strains, are too slow to follow a snap.
    """
    for group in flow.groups:
        for condition in group.conditions:
            if condition.kind == EventKind.LIMIT_POINT:
                yield Watched(condition.kind, _stability(flow, group), ends=False)
                continue
            rounding = flow.no_pressure * (condition.kind == EventKind.LOSS_OF_TENSION)
            yield Watched(condition.kind, _of(flow, group, condition.margin, rounding=rounding), ends=True)
        charged = [
            group.members.index(slot.balloon)
            for slot in flow.slots
            if slot.part.electrical and slot.balloon in group.members
        ]
        for shape in shape_conditions(group.equations, charged) if flow.shapes != "ignore" else ():
            balloon, stops = group.members[shape.place], flow.shapes == "stop"
            margin = _of_shape(flow, group, shape)
            lost = Watched(EventKind.LOSS_OF_SPHERICITY, margin, stops, balloon, shape.mode)
            yield lost
            yield replace(lost, kind=EventKind.SPHERICITY_REGAINED, margin=_opposite(margin), ends=False)
    for slot in flow.slots:
        if isinstance(slot.part, SuppliedFilm) and slot.part.strength is not None:
            yield Watched(EventKind.BREAKDOWN, _intactness(slot.part, slot), ends=True)


def _intactness(film: SuppliedFilm, slot: Slot) -> Callable[[list[float], float], float]:
    return lambda values, v: film.intactness(values[slot.balloon], values[slot.own])


def _of(
    flow: Flow, group: Group, margin: Callable[..., float], rounding: float = 0.0
) -> Callable[[list[float], float], float]:
    return lambda values, v: float(margin(flow.state(group, values, v))) + rounding


def _opposite(margin: Callable[[list[float], float], float]) -> Callable[[list[float], float], float]:
    return lambda values, v: -margin(values, v)


def _stability(flow: Flow, group: Group) -> Callable[[list[float], float], float]:
    """The smallest eigenvalue of a group's scaled Hessian, its parts as they are."""
    margin, material = stability_in_motion(group.equations), flow.material
    if not any(material.parts[i] for i in group.members):
        return _of(flow, group, margin)

    def with_parts(values: list[float], v: float) -> float:
        added = material.stiffening(values, flow.own(values))
        return float(margin(flow.state(group, values, v), [added[i] for i in group.members]))

    return with_parts


def _of_shape(flow: Flow, group: Group, shape: ShapeCondition) -> Callable[[list[float], float], float]:
    margin, material = shape.condition.margin, flow.material
    if not material.parts[group.members[shape.place]]:
        return _of(flow, group, margin)
    return lambda values, v: (
        float(margin(flow.state(group, values, v)))
        + added_to_shape(material, group, shape, values, flow.own(values))
    )


def added_to_shape(
    material: Material, group: Group, shape: ShapeCondition, stretch: Sequence[float], own: Sequence[float]
) -> float:
    """What the parts of a balloon add to the margin of its shape, in the units of that margin."""
    balloon, wall = group.members[shape.place], group.equations.walls[shape.place]
    added = material.roundness(shape.mode, balloon, stretch[balloon], own) / wall.modulus
    # The margin of a pear is multiplied by D².
    scale = wall.elastomer.pole_form(stretch[balloon])[1] ** 2 if shape.mode == "pear" else 1.0
    return float(added * scale)
