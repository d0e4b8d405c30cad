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
from simulator.drive import Leg, Quantity, VoltageLine, Way
from simulator.events import Condition, conditions
from simulator.gas import Contents
from simulator.model import OpenBalloon, SealedBalloons
from simulator.scenario import (
    Charge,
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


@dataclass(frozen=True)
class Electrodes:
    """The present voltages and charges of the electroded balloons, and which of the two is given."""

    voltage: Sequence[float]
    charge: Sequence[float]
    given: Quantity

    @property
    def line(self) -> VoltageLine:
        """What is given, held where it is."""
        return VoltageLine.still(self.voltage if self.given == "voltage" else self.charge, self.given)


def given_by(step: PlayedStep) -> Quantity | None:
    """What a step gives its electrodes: voltages or charges; None where it leaves them as they are."""
    if isinstance(step, Inflate | Hold):
        return None
    return "charge" if isinstance(step, Charge) else "voltage"


def motion(
    step: PlayedStep, electroded: Sequence[str], electrodes: Electrodes, pressure: float
) -> tuple[Leg, ...]:
    """The legs in which a step's voltages (or charges) move on from the present ones; mostly one.

    While inflating they stand still and v is the pressure.
    """
    voltage = electrodes.voltage
    match step:
        case Inflate():
            return (Leg(electrodes.line, drive.ramp(pressure, step.inflate)),)
        case Hold():
            return (Leg(electrodes.line, drive.ramp(0.0, 0.0)),)
        case Ramp():
            return (_towards(step.ramp, electroded, voltage, "voltage"),)
        case Charge():
            return (_towards(step.charge, electroded, electrodes.charge, "charge"),)
        case Jump():
            leg = _towards(step.jump, electroded, voltage, "voltage")
            there = float(leg.waveform.values[-1])
            return (Leg(leg.way, drive.ramp(there, there)),)
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
    return (Leg(VoltageLine.common(len(electroded)), wave),)


def _towards(
    wanted: float | dict[str, float], electroded: Sequence[str], present: Sequence[float], quantity: Quantity
) -> Leg:
    """The line from present voltages or charges to those wanted, and a ramp along it."""
    target = [
        wanted.get(name, now) if isinstance(wanted, dict) else float(wanted)
        for name, now in zip(electroded, present, strict=True)
    ]
    line = VoltageLine.through(present, target, quantity)
    return Leg(line, drive.ramp(line.coordinate(present), line.coordinate(target)))


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
    return Group(equations, conditions(equations, [strength.get(i) for i in members]), tuple(members))
