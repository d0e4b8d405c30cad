"""A step as exactly what it needs: the drive's motion, and the sets of equations that move with it.

A hold assembles nothing. With the valve closed all balloons and their gas are one set; with it open each
balloon that the drive moves is its own. What a scenario does not name is in none of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from simulator import drive
from simulator.device import Device
from simulator.drive import Leg, VoltageLine, Way
from simulator.events import Condition, conditions
from simulator.model import OpenBalloon, SealedBalloons
from simulator.scenario import (
    Hold,
    Inflate,
    Jump,
    Ramp,
    Sine,
    SineByName,
    SineWave,
    Table,
    Triangle,
    TriangleByName,
    TriangleWave,
)

if TYPE_CHECKING:
    from simulator.scenario import PlayedStep

AnyEquations = SealedBalloons | OpenBalloon


@dataclass(frozen=True)
class Group:
    """Balloons that move together: their equations, what can end a branch of theirs, and which they are."""

    equations: AnyEquations
    conditions: tuple[Condition, ...]
    members: tuple[int, ...]


def motion(
    step: PlayedStep, electroded: Sequence[str], voltage: Sequence[float], pressure: float
) -> tuple[Leg, ...]:
    """The legs in which a step's voltages move on from the present ones; mostly one.

    While inflating the voltages stand still and v is the pressure.
    """
    count = len(voltage)
    still = VoltageLine(tuple(voltage), (0.0,) * count)
    match step:
        case Inflate():
            return (Leg(still, drive.ramp(pressure, step.inflate)),)
        case Hold():
            return (Leg(still, drive.ramp(0.0, 0.0)),)
        case Ramp() | Jump():
            wanted = step.ramp if isinstance(step, Ramp) else step.jump
            target = [
                wanted.get(name, now) if isinstance(wanted, dict) else float(wanted)
                for name, now in zip(electroded, voltage, strict=True)
            ]
            line = VoltageLine.through(voltage, target)
            first = voltage if isinstance(step, Ramp) else target
            return (Leg(line, drive.ramp(line.coordinate(first), line.coordinate(target))),)
        case Sine(sine=SineWave() as one):
            wave = drive.sine(one.mean, one.amplitude, one.cycles)
        case Triangle(triangle=TriangleWave() as one_triangle):
            wave = drive.triangle(one_triangle.low, one_triangle.high, one_triangle.cycles)
        case Sine(sine=SineByName() as sines):
            # Who is not named keeps the present voltage.
            parts = [sines.balloons.get(name) for name in electroded]
            return drive.sines(
                [p.mean if p else now for p, now in zip(parts, voltage, strict=True)],
                [p.amplitude if p else 0.0 for p in parts],
                [p.phase if p else 0.0 for p in parts],
                sines.cycles,
            )
        case Triangle(triangle=TriangleByName() as triangles):
            sides = [triangles.balloons.get(name) for name in electroded]
            return drive.triangles(
                [p.low if p else now for p, now in zip(sides, voltage, strict=True)],
                [p.high if p else now for p, now in zip(sides, voltage, strict=True)],
                [p.phase if p else 0.0 for p in sides],
                triangles.cycles,
            )
        case Table():
            wave = drive.table(step.times, step.voltages)
    return (Leg(VoltageLine.common(count), wave),)


def inflating(device: Device, voltage: Sequence[float]) -> list[Group]:
    """Every balloon by itself, under a moving pressure."""
    return [_group(device, device.inflated(i, voltage), [i]) for i in range(len(device.names))]


def actuated(device: Device, way: Way, *, amount: float) -> list[Group]:
    """Valve closed: all balloons on their gas, if any voltage moves."""
    if not any(way.moves):
        return []
    return [_group(device, device.sealed(amount, way), range(len(device.names)))]


def actuated_open(device: Device, way: Way, *, pressure: float) -> list[Group]:
    """Valve open: each balloon whose voltage moves, by itself."""
    return [
        _group(device, device.actuated(i, pressure, way), [i])
        for i, moves in zip(device.electroded, way.moves, strict=True)
        if moves
    ]


def held_open(device: Device, voltage: Sequence[float], *, pressure: float) -> list[Group]:
    """Valve just opened, nothing moving: every balloon by itself."""
    line = VoltageLine(tuple(voltage), (0.0,) * len(voltage))
    return [_group(device, device.actuated(i, pressure, line), [i]) for i in range(len(device.names))]


def _group(device: Device, equations: AnyEquations, members: Sequence[int]) -> Group:
    strength = dict(zip(device.electroded, device.strength, strict=True))
    return Group(equations, conditions(equations, [strength.get(i) for i in members]), tuple(members))
