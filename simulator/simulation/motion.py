"""How a step moves the drive, and which sets of equations move with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from simulator.model import drive, groups
from simulator.model.drive import Leg, Quantity, VoltageLine, Way
from simulator.scenario import (
    Charge,
    Hold,
    Inflate,
    Jump,
    Ramp,
    RecordingByName,
    Sine,
    SineByName,
    SineWave,
    Table,
    Triangle,
    TriangleByName,
    TriangleWave,
)

if TYPE_CHECKING:
    from simulator.model.contents import Contents
    from simulator.model.device import Device
    from simulator.model.groups import Group
    from simulator.scenario import PlayedStep, Scenario


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


def left_alone(step: PlayedStep, electroded: Sequence[str]) -> list[str]:
    """The electroded balloons that a step gives nothing: they keep their voltage, or their charge."""
    match step:
        case Inflate() | Hold():
            return list(electroded)
        case Ramp(ramp=dict() as given) | Jump(jump=dict() as given) | Charge(charge=dict() as given):
            return [name for name in electroded if name not in given]
        case Sine(sine=SineByName(balloons=waves)):
            return [name for name in electroded if name not in waves]
        case Triangle(triangle=TriangleByName(balloons=sides)):
            return [name for name in electroded if name not in sides]
        case Table(table=RecordingByName(voltages=found)):
            return [name for name in electroded if name not in found]
    return []


def opens_valve(step: PlayedStep) -> bool:
    """Whether the valve is open during a step."""
    return isinstance(step, Inflate) or step.valve == "open"


def begins_by_jump(step: PlayedStep) -> bool:
    """Whether a step sets the voltages to its first value at once; ramps begin where they are."""
    return not isinstance(step, Inflate | Hold | Ramp | Charge)


def moving(
    scenario: Scenario, device: Device, step: PlayedStep, leg: Leg, pressure: float, contents: Contents | None
) -> list[Group]:
    """The sets of equations that move along a leg of a step; none where nothing moves.

    Parameters
    ----------
    scenario : Scenario
        With `[dynamics]` all balloons move, whatever the drive does.
    device : Device
    step : PlayedStep
    leg : Leg
    pressure : float
        The one that is kept where the valve is open.
    contents : Contents or None
        The gas or liquid that the balloons share; None where the valve is open.
    """
    values = leg.waveform.values
    in_real_time = scenario.dynamics is not None
    if not in_real_time and not isinstance(step, Jump) and (values == values[0]).all():
        return []
    if isinstance(step, Inflate):
        return groups.inflating(device, leg.way)
    return (all_balloons if in_real_time else driven)(device, leg.way, pressure, contents)


def driven(device: Device, way: Way, pressure: float, contents: Contents | None) -> list[Group]:
    """The sets of equations that voltages (or charges) along a way move; see `moving`."""
    if contents is None:
        return groups.actuated_open(device, way, pressure=pressure)
    return groups.actuated(device, way, gas=contents)


def all_balloons(device: Device, way: Way, pressure: float, contents: Contents | None) -> list[Group]:
    """The sets of equations of all balloons, whether their voltages move or not; see `moving`."""
    if contents is None:
        return groups.held_open(device, way, pressure=pressure)
    return [groups.held(device, way, gas=contents)]


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
        case Table(table=RecordingByName() as recordings):
            found = recordings.voltages
            rows = [found.get(name, now) for name, now in zip(electroded, voltage, strict=True)]
            return drive.polygon(step.times, np.stack(np.broadcast_arrays(*rows, step.times)[:-1], axis=1))
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
