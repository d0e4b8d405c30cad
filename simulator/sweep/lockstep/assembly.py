"""The equations of devices whose numbers are arrays; `model.device` and `model.groups` make those of one."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator.model.contents import Contents, Gas, IdealGas, Incompressible, SealedGas
from simulator.model.device import Device
from simulator.model.drive import AffineDrive
from simulator.model.equations import OpenBalloon, SealedBalloons
from simulator.model.expansion import Isotherm
from simulator.model.liquid import Liquid
from simulator.model.membranes import ElectrodedMembrane, Membrane
from simulator.model.strength import Strength
from simulator.solver.batch.stacked import Stacked

FloatArray = NDArray[np.float64]


def wall(device: Device, i: int) -> Membrane:
    """A balloon's wall without a voltage."""
    return Membrane.of(device.elastomers[i], device.radius[i], device.thickness[i], device.modulus[i])


def membrane(device: Device, i: int, offset: FloatArray, rate: FloatArray) -> Membrane | ElectrodedMembrane:
    """A balloon's wall under its voltage, offset and rate (n_electroded, n_runs)."""
    bare = wall(device, i)
    if i not in device.electroded:
        return bare
    place = device.electroded.index(i)
    if not offset[place].any() and not rate[place].any():
        return bare
    h, k, e = device.thickness[i], device.modulus[i], device.permittivity[i]
    given: Any = offset[place], rate[place]
    return ElectrodedMembrane.of(bare, device.radius[i], h, k, e, AffineDrive(*given))


def strength(device: Device, i: int) -> Strength | None:
    """That of a balloon's film, None where there is none."""
    return device.strength[device.electroded.index(i)] if i in device.electroded else None


def sealed(
    device: Device, gas: Contents, offset: FloatArray, rate: FloatArray, *, watched: bool = False
) -> Stacked:
    """Valve closed: all balloons on what they share."""
    places = range(len(device.names))
    membranes = tuple(membrane(device, i, offset, rate) for i in places)
    return Stacked(SealedBalloons(membranes, gas), tuple(strength(device, i) for i in places), watched)


def opened(
    device: Device,
    i: int,
    offset: FloatArray,
    rate: FloatArray,
    pressure: FloatArray | None,
    *,
    watched: bool = False,
) -> Stacked:
    """Valve open: one balloon at a pressure, or with None inflated by a moving one."""
    wall_of_it = membrane(device, i, offset, rate)
    given: Any = pressure if pressure is not None else 0.0
    equations = OpenBalloon(wall_of_it, given, 1.0 if pressure is None else 0.0)
    return Stacked(equations, (strength(device, i),), watched)


def contents(device: Device, stretch: FloatArray, pressure: FloatArray) -> Contents:
    """The valve closed in states (n_balloons, n_runs)."""
    swelling = (device.radius**3 / 3.0 * stretch**3).sum(axis=0)
    law = device.law
    if isinstance(law, Incompressible):
        return Liquid(swelling)
    assert isinstance(law, Gas)
    if np.any(law.chamber != 0.0) or not isinstance(law.expansion, Isotherm):
        return SealedGas(pressure, swelling, law.ambient, law.chamber, law.expansion)
    return IdealGas(law.amount(pressure, swelling), law.ambient)


def line_through(
    start: FloatArray, target: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """As `VoltageLine.through` for many: offsets, rates, and the coordinates of start and target."""
    change = target - start
    leader = np.argmax(np.abs(change), axis=0)[None]
    largest = np.take_along_axis(change, leader, axis=0)
    moves = largest != 0.0
    rate = np.where(moves, change / np.where(moves, largest, 1.0), 0.0)
    first = np.take_along_axis(start, leader, axis=0)
    offset = np.where(moves, start - rate * first, start)
    offset[np.abs(offset) <= 4e-16 * np.maximum(np.abs(start), np.abs(rate * first))] = 0.0
    np.put_along_axis(offset, leader, np.where(moves, 0.0, np.take_along_axis(start, leader, axis=0)), axis=0)
    last = np.take_along_axis(target, leader, axis=0)
    return offset, rate, np.where(moves, first, 0.0)[0], np.where(moves, last, 0.0)[0]
