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
from simulator.drive import VoltageLine, Waveform
from simulator.events import Condition, conditions
from simulator.model import OpenBalloon, SealedBalloons
from simulator.scenario import Hold, Inflate, Jump, Ramp, Sine, Table, Triangle

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
) -> tuple[VoltageLine, Waveform]:
    """The line that a step's voltages move along from the present ones, and how v moves.

    While inflating the voltages stand still and v is the pressure.
    """
    count = len(voltage)
    still = VoltageLine(tuple(voltage), (0.0,) * count)
    match step:
        case Inflate():
            return still, drive.ramp(pressure, step.inflate)
        case Hold():
            return still, drive.ramp(0.0, 0.0)
        case Ramp() | Jump():
            wanted = step.ramp if isinstance(step, Ramp) else step.jump
            target = [
                wanted.get(name, now) if isinstance(wanted, dict) else float(wanted)
                for name, now in zip(electroded, voltage, strict=True)
            ]
            line = VoltageLine.through(voltage, target)
            first = voltage if isinstance(step, Ramp) else target
            return line, drive.ramp(line.coordinate(first), line.coordinate(target))
        case Sine():
            wave = drive.sine(step.sine.mean, step.sine.amplitude, step.sine.cycles)
        case Triangle():
            wave = drive.triangle(step.triangle.low, step.triangle.high, step.triangle.cycles)
        case Table():
            wave = drive.table(step.times, step.voltages)
    return VoltageLine.common(count), wave


def inflating(device: Device, voltage: Sequence[float]) -> list[Group]:
    """Every balloon by itself, under a moving pressure."""
    return [_group(device, device.inflated(i, voltage), [i]) for i in range(len(device.names))]


def actuated(device: Device, line: VoltageLine, *, amount: float) -> list[Group]:
    """Valve closed: all balloons on their gas, if any voltage moves."""
    if not any(line.rate):
        return []
    return [held_closed(device, line, amount=amount)]


def held_closed(device: Device, line: VoltageLine, *, amount: float) -> Group:
    """Valve closed: all balloons on their gas, whether a voltage moves or not."""
    return _group(device, device.sealed(amount, line), range(len(device.names)))


def actuated_open(device: Device, line: VoltageLine, *, pressure: float) -> list[Group]:
    """Valve open: each balloon whose voltage moves, by itself."""
    return [
        _group(device, device.actuated(i, pressure, line), [i])
        for i, rate in zip(device.electroded, line.rate, strict=True)
        if rate
    ]


def held_open(device: Device, line: VoltageLine, *, pressure: float) -> list[Group]:
    """Valve open: every balloon by itself, whether its voltage moves or not."""
    return [_group(device, device.actuated(i, pressure, line), [i]) for i in range(len(device.names))]


def _group(device: Device, equations: AnyEquations, members: Sequence[int]) -> Group:
    strength = dict(zip(device.electroded, device.strength, strict=True))
    return Group(equations, conditions(equations, [strength.get(i) for i in members]), tuple(members))
