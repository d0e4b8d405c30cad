"""Equations whose numbers are arrays, one entry for each run, and the parts of their Jacobian."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, is_dataclass
from functools import cached_property
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from simulator.events import EventKind
from simulator.model.conditions import ENDLESS, intactness
from simulator.model.drive import AffineDrive
from simulator.model.elastomers import ArrudaBoyce, Gent, largest_stretch
from simulator.model.equations import OpenBalloon, SealedBalloons, State
from simulator.model.membranes import AnyMembrane, ElectrodedMembrane
from simulator.model.strength import Strength

FloatArray = NDArray[np.float64]
Index = NDArray[np.int64] | NDArray[np.bool_]
_Value = TypeVar("_Value")


class Parts(NamedTuple):
    """Residuals and the entries of their Jacobian that are not zero.

    Each balloon's row has three: `along` ∂R/∂λ, `per_pressure` and `per_v`, all (n_balloons, …, n_runs). The
    gas law's has `area` ∂/∂λ, (n_balloons, …, n_runs), and `gas_pressure`; None with the valve open.
    """

    force: FloatArray
    along: FloatArray
    per_v: FloatArray
    gas: Any
    per_pressure: Any
    area: Any
    gas_pressure: Any


class Margin(NamedTuple):
    """What ends a branch besides instability: its kind, and what falls through zero there."""

    kind: EventKind
    at: Callable[[State], Any]


def taken(value: _Value, index: Index) -> _Value:
    """A nest of dataclasses and tuples with all arrays in it reduced to some runs (their last axis)."""
    if isinstance(value, np.ndarray):
        return value[..., index]  # type: ignore[return-value]
    if isinstance(value, tuple):
        items = [taken(item, index) for item in value]
        if all(a is b for a, b in zip(items, value, strict=True)):
            return value
        return tuple(items)  # type: ignore[return-value]
    if is_dataclass(value) and not isinstance(value, type):
        old = {f.name: getattr(value, f.name) for f in fields(value)}
        new = {name: taken(item, index) for name, item in old.items()}
        if all(new[name] is item for name, item in old.items()):
            return value
        return type(value)(**new)
    return value


def arrays(value: Any) -> Iterator[NDArray[Any]]:
    """All arrays in a nest of dataclasses and tuples."""
    if isinstance(value, np.ndarray):
        yield value
    elif isinstance(value, tuple):
        for item in value:
            yield from arrays(item)
    elif is_dataclass(value):
        for field in fields(value):
            yield from arrays(getattr(value, field.name))


@dataclass(frozen=True)
class Stacked:
    """The equations of many runs, with arrays (n_runs,) for some or all of their numbers.

    `strengths` are those of the balloons' films, None where there is none; `watched` is whether it is looked
    at where the balloons stop being spheres.
    """

    equations: SealedBalloons | OpenBalloon
    strengths: tuple[Strength | None, ...]
    watched: bool = False

    def take(self, index: Index) -> Stacked:
        """Those of some runs."""
        return Stacked(taken(self.equations, index), taken(self.strengths, index), self.watched)

    @property
    def count(self) -> int:
        """Number of balloons."""
        return len(self.equations.walls)

    @property
    def membranes(self) -> tuple[AnyMembrane, ...]:
        """The balloons' walls, with their voltages."""
        equations = self.equations
        return equations.membranes if isinstance(equations, SealedBalloons) else (equations.membrane,)

    @property
    def sealed(self) -> bool:
        """Whether the pressure is an unknown."""
        return self.equations.has_pressure

    @cached_property
    def margins(self) -> tuple[Margin, ...]:
        """What ends a branch besides instability."""
        equations = self.equations
        found = [Margin(EventKind.LOSS_OF_TENSION, lambda y: y[-2])] if self.sealed else []
        for place, (membrane, strength) in enumerate(zip(self.membranes, self.strengths, strict=True)):
            if strength is not None and isinstance(membrane, ElectrodedMembrane):
                found.append(Margin(EventKind.BREAKDOWN, intactness(membrane, place, strength).margin))
        for place, wall in enumerate(equations.walls):
            if isinstance(wall.elastomer, Gent | ArrudaBoyce):
                continue  # it has a stretch limit
            largest = largest_stretch(wall.elastomer)
            known = np.isfinite(largest)
            kind = EventKind.OUT_OF_RANGE if known else EventKind.RUNAWAY
            found.append(Margin(kind, _below(place, largest if known else ENDLESS)))
        return tuple(found)

    def scales(self, runs: int) -> FloatArray:
        """Natural sizes of the unknowns, (n_unknowns, n_runs), as those of the equations of one run."""
        walls, equations = self.equations.walls, self.equations
        softest = np.min(np.stack(np.broadcast_arrays(*(1.0 / w.pressure_load for w in walls))), axis=0)
        last: Any = softest if isinstance(equations, OpenBalloon) and equations.pressure_rate else None
        if last is None:
            sizes = [
                np.sqrt(2.0 / m.electric_load) / np.where(drive.rate == 0.0, 1e-300, np.abs(drive.rate))
                for m in self.membranes
                if isinstance(m, ElectrodedMembrane) and isinstance(drive := m.drive, AffineDrive)
            ]
            last = np.min(np.stack(np.broadcast_arrays(*sizes)), axis=0) if sizes else 1.0
            last = np.where(last > 1e200, 1.0, last)
        out = np.ones((len(walls) + 1 + self.sealed, runs))
        if self.sealed:
            out[-2] = softest
        out[-1] = last
        return out

    def parts(self, y: NDArray[Any]) -> Parts:
        """The residuals and the entries of their Jacobian at states (n_unknowns, …, n_runs)."""
        residual, rows = self.equations.linearised(list(y))
        count, shape, kind = self.count, y.shape[1:], y.dtype
        force = np.empty((count, *shape), kind)
        along, per_v = np.empty_like(force), np.empty_like(force)
        for i in range(count):
            force[i], along[i], per_v[i] = residual[i], rows[i][i], rows[i][-1]
        if not self.sealed:
            return Parts(force, along, per_v, None, None, None, None)
        per_pressure, area = np.empty_like(force), np.empty_like(force)
        for i in range(count):
            per_pressure[i], area[i] = rows[i][-2], rows[-1][i]
        law = np.broadcast_to(np.asarray(rows[-1][-2], dtype=kind), shape)
        return Parts(force, along, per_v, np.asarray(residual[-1]), per_pressure, area, law)

    def denominators(self, y: Sequence[Any]) -> list[Any]:
        """D of each balloon's elastomer."""
        return [w.elastomer.pole_form(x)[1] for w, x in zip(self.equations.walls, y, strict=False)]


def _below(place: int, largest: float) -> Callable[[State], Any]:
    return lambda y: largest - y[place]
