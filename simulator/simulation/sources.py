"""How the films are connected to their sources in real time: directly, or behind resistances."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from simulator.model.supply import Leak, SuppliedFilm
from simulator.solver.passage import Material

if TYPE_CHECKING:
    from simulator.model.device import Device
    from simulator.model.drive import Way
    from simulator.scenario import Balloon, Scenario
    from simulator.simulation.books import Books
    from simulator.simulation.present import Present

FloatArray = NDArray[np.float64]


class Sources(Protocol):
    """What stands between the drive and the films."""

    @property
    def device(self) -> Device:
        """The device that equations are made of."""
        ...

    @property
    def charged(self) -> frozenset[int]:
        """The balloons whose film has a charge of its own."""
        ...

    def material(self, way: Way | None) -> Material:
        """How the balloons take their time while the sources go along a way."""
        ...

    def change(self, present: Present, books: Books, target: FloatArray) -> None:
        """Set the sources to other voltages at once."""
        ...

    def voltage(self, given: FloatArray, stretch: FloatArray, own: FloatArray) -> FloatArray:
        """The voltages of the films in n states, those of the sources given; all (n, n_electroded)."""
        ...

    def supply(self, given: FloatArray) -> FloatArray:
        """Those of the sources, as far as they are others."""
        ...


@dataclass(frozen=True)
class IdealSources:
    """The films have the voltages of the sources."""

    device: Device
    wall: Material

    charged = frozenset[int]()

    def material(self, way: Way | None) -> Material:
        return self.wall

    def change(self, present: Present, books: Books, target: FloatArray) -> None:
        books.change_voltages(present.device, present.stretch, present.voltage, target)
        present.voltage = target

    def voltage(self, given: FloatArray, stretch: FloatArray, own: FloatArray) -> FloatArray:
        return given

    def supply(self, given: FloatArray) -> FloatArray:
        return np.empty(0)


@dataclass(frozen=True)
class ResistedSources:
    """Each film is behind a resistance, and has a charge of its own."""

    whole: Device
    wall: Material
    films: tuple[SuppliedFilm, ...]

    @cached_property
    def device(self) -> Device:
        """The walls alone."""
        return replace(self.whole, electroded=(), strength=())

    @property
    def charged(self) -> frozenset[int]:
        return frozenset(self.whole.electroded)

    def material(self, way: Way | None) -> Material:
        films = dict(zip(self.whole.electroded, self.films, strict=True))
        if way is not None:
            films = {
                i: replace(film, drive=way.drive(place)) for place, (i, film) in enumerate(films.items())
            }
        parts = ((*parts, films[i]) if i in films else parts for i, parts in enumerate(self.wall.parts))
        return Material(self.wall.friction, tuple(parts))

    def change(self, present: Present, books: Books, target: FloatArray) -> None:
        present.supply = target

    def voltage(self, given: FloatArray, stretch: FloatArray, own: FloatArray) -> FloatArray:
        films = [slot for slot in self.material(None).slots if isinstance(slot.part, SuppliedFilm)]
        found = np.empty((len(stretch), len(films)))
        for column, (i, _, part, places, _) in enumerate(films):
            assert isinstance(part, SuppliedFilm)
            found[:, column] = part.voltage(stretch[:, i], own[:, places].T)
        return found

    def supply(self, given: FloatArray) -> FloatArray:
        return given


def sources_of(scenario: Scenario, device: Device, wall: Material) -> Sources:
    """The sources of a scenario, whose balloons take their time as `wall` says but for their films."""
    if scenario.supply is None:
        return IdealSources(device, wall)
    films = []
    for place, i in enumerate(device.electroded):
        balloon, supply = scenario.balloons[i], scenario.supply
        r, h, e = balloon.radius, balloon.thickness, balloon.permittivity
        limit = supply.current_limit_of(balloon.name)
        films.append(
            SuppliedFilm(
                capacitance=r * r * e / h,
                thickness=h,
                permittivity=e,
                pull=2.0 / (r**4 * e),
                resistance=supply.resistance_of(balloon.name),
                limit=limit,
                leak=_leak(balloon),
                drive=None,
                strength=device.strength[place],
            )
        )
    return ResistedSources(device, wall, tuple(films))


def _leak(balloon: Balloon) -> Leak | None:
    if balloon.leak is None:
        return None
    return Leak(balloon.leak.conductivity, balloon.leak.field or math.inf)
