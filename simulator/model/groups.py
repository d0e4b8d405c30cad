"""The sets of equations that move: all balloons on one gas, or, with the valve open, each by itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from simulator.model.conditions import Condition, conditions
from simulator.model.contents import Contents
from simulator.model.device import Device
from simulator.model.drive import Way
from simulator.model.equations import OpenBalloon, SealedBalloons
from simulator.model.strength import Strength

AnyEquations = SealedBalloons | OpenBalloon
Alike = tuple[AnyEquations, tuple[Strength | None, ...]]


@dataclass(frozen=True)
class Group:
    """Balloons that move together: their equations, what can end a branch of theirs, and which they are.

    `strengths` are those of the films that a voltage drives, None where there is none. Two groups have the
    same branches, with the same ends, where they are equal in them and in the equations; `alike` is both.
    """

    equations: AnyEquations
    conditions: tuple[Condition, ...]
    members: tuple[int, ...]
    strengths: tuple[Strength | None, ...] = ()

    @property
    def alike(self) -> Alike:
        """What groups with the same branches have in common, to be compared."""
        return self.equations, self.strengths


def inflating(device: Device, held: Way) -> list[Group]:
    """Every balloon by itself, under a moving pressure, voltages or charges held."""
    values = held.at(0.0).tolist()
    return [_group(device, device.inflated(i, values, held.quantity), [i]) for i in range(len(device.names))]


def actuated(device: Device, way: Way, *, gas: Contents) -> list[Group]:
    """Valve closed: all balloons on their gas (or liquid), if any voltage or charge moves."""
    return [held(device, way, gas=gas)] if any(way.moves) else []


def held(device: Device, way: Way, *, gas: Contents) -> Group:
    """Valve closed: all balloons on their gas (or liquid)."""
    return _group(device, device.sealed(gas, way), range(len(device.names)))


def actuated_open(device: Device, way: Way, *, pressure: float) -> list[Group]:
    """Valve open: each balloon whose voltage or charge moves, by itself."""
    return [
        _group(device, device.actuated(i, pressure, way), [i])
        for i, moves in zip(device.electroded, way.moves, strict=True)
        if moves
    ]


def held_open(device: Device, way: Way, *, pressure: float) -> list[Group]:
    """Valve open: every balloon by itself, whether its voltage moves or not."""
    return [_group(device, device.actuated(i, pressure, way), [i]) for i in range(len(device.names))]


def _group(device: Device, equations: AnyEquations, members: Sequence[int]) -> Group:
    strength = dict(zip(device.electroded, device.strength, strict=True))
    strengths = tuple(
        None if membrane.drive is None else strength.get(i)
        for i, membrane in zip(members, equations.membranes, strict=True)
    )
    return Group(equations, conditions(equations, strengths), tuple(members), strengths)
