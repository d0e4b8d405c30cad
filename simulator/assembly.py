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
from simulator.drive import Quantity, VoltageLine, Waveform
from simulator.events import Condition, conditions
from simulator.gas import Contents
from simulator.model import OpenBalloon, SealedBalloons
from simulator.scenario import Charge, Hold, Inflate, Jump, Ramp, Sine, Table, Triangle

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
) -> tuple[VoltageLine, Waveform]:
    """The line that a step's voltages (or charges) move along from the present ones, and how v moves.

    While inflating they stand still and v is the pressure.
    """
    match step:
        case Inflate():
            return electrodes.line, drive.ramp(pressure, step.inflate)
        case Hold():
            return electrodes.line, drive.ramp(0.0, 0.0)
        case Ramp():
            return _towards(step.ramp, electroded, electrodes.voltage, "voltage")
        case Charge():
            return _towards(step.charge, electroded, electrodes.charge, "charge")
        case Jump():
            line, waveform = _towards(step.jump, electroded, electrodes.voltage, "voltage")
            return line, drive.ramp(waveform.values[-1], waveform.values[-1])
        case Sine():
            wave = drive.sine(step.sine.mean, step.sine.amplitude, step.sine.cycles)
        case Triangle():
            wave = drive.triangle(step.triangle.low, step.triangle.high, step.triangle.cycles)
        case Table():
            wave = drive.table(step.times, step.voltages)
    return VoltageLine.common(len(electroded)), wave


def _towards(
    wanted: float | dict[str, float], electroded: Sequence[str], present: Sequence[float], quantity: Quantity
) -> tuple[VoltageLine, Waveform]:
    """The line from present voltages or charges to those wanted, and a ramp along it."""
    target = [
        wanted.get(name, now) if isinstance(wanted, dict) else float(wanted)
        for name, now in zip(electroded, present, strict=True)
    ]
    line = VoltageLine.through(present, target, quantity)
    return line, drive.ramp(line.coordinate(present), line.coordinate(target))


def inflating(device: Device, held: VoltageLine) -> list[Group]:
    """Every balloon by itself, under a moving pressure, voltages or charges held."""
    return [
        _group(device, device.inflated(i, held.offset, held.quantity), [i]) for i in range(len(device.names))
    ]


def actuated(device: Device, line: VoltageLine, *, gas: Contents) -> list[Group]:
    """Valve closed: all balloons on their gas (or liquid), if any voltage or charge moves."""
    return [held(device, line, gas=gas)] if any(line.rate) else []


def held(device: Device, line: VoltageLine, *, gas: Contents) -> Group:
    """Valve closed: all balloons on their gas (or liquid)."""
    return _group(device, device.sealed(gas, line), range(len(device.names)))


def actuated_open(device: Device, line: VoltageLine, *, pressure: float) -> list[Group]:
    """Valve open: each balloon whose voltage or charge moves, by itself."""
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
