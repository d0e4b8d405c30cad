"""How a step moves the drive: its legs, from the present voltages, charges and pressure on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from simulator.model import drive
from simulator.model.drive import Leg, Quantity, VoltageLine
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
