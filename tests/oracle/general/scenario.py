"""A scenario file, read by docs/scenario-format.md alone: dimensionless, its cycles unrolled."""

from __future__ import annotations

import math
import os
import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from tests.oracle.general.elastomers import Law, law_of

Document = Mapping[str, Any]
VACUUM = 8.8541878128e-12  # F/m


@dataclass(frozen=True)
class Balloon:
    """One balloon; `strength` are the field E₀ and the exponent a of a breakdown field E₀λᵃ.

    `material` is the elastomer as written: what is written alike is alike.
    """

    name: str
    radius: float
    thickness: float
    modulus: float
    permittivity: float
    electrodes: bool
    law: Law
    strength: tuple[float, float] | None = None
    material: str = ""

    @property
    def mechanics(self) -> tuple[object, ...]:
        """What two balloons that move alike under equal loads have in common."""
        return self.radius, self.thickness, self.modulus, self.material


@dataclass(frozen=True)
class Gas:
    """What the balloons share."""

    ambient: float
    chamber: float = 0.0
    law: str = "isothermal"
    exponent: float = 1.4


@dataclass(frozen=True)
class Until:
    """What ends a step early: a limit point, or (kind, balloon, value) of a quantity."""

    limit_point: bool = False
    quantities: tuple[tuple[str, str, float], ...] = ()


@dataclass(frozen=True)
class Wave:
    """A sine (mean, amplitude, phase) or a triangle (low, high, phase), for all balloons or by name."""

    cycles: float
    common: tuple[float, float] | None
    by_name: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Step:
    """One step as it is played, numbered from 1; `target` is a number, or numbers by balloon."""

    number: int
    kind: str
    lasts: float
    opens: bool
    target: float | Mapping[str, float] = 0.0
    wave: Wave | None = None
    rows: tuple[tuple[float, ...], tuple[float, ...]] = ((), ())
    until: Until | None = None


@dataclass(frozen=True)
class Scenario:
    """A whole scenario."""

    balloons: tuple[Balloon, ...]
    gas: Gas
    steps: tuple[Step, ...]
    in_real_time: bool = False


def read(source: Document | str | os.PathLike[str]) -> Scenario:
    """A scenario from a dict, or from the path of a TOML file."""
    if isinstance(source, Mapping):
        return _Reader(source, Path()).scenario()
    path = Path(source)
    return _Reader(tomllib.loads(path.read_text(encoding="utf-8-sig")), path.parent).scenario()


@dataclass
class _Reader:
    document: Document
    folder: Path

    def scenario(self) -> Scenario:
        written = self.document
        gas = written["gas"]
        steps: list[Step] = []
        for step in _unrolled(written["step"]):
            steps.append(self._step(len(steps) + 1, step))
        return Scenario(
            tuple(self._balloon(b) for b in written["balloon"]),
            Gas(
                self._number(gas["ambient_pressure"], "pressure"),
                self._number(gas.get("chamber", 0.0), "volume"),
                gas.get("law", "isothermal"),
                float(gas.get("exponent", 1.4)),
            ),
            tuple(steps),
            "dynamics" in written,
        )

    def _balloon(self, written: Document) -> Balloon:
        thickness = self._number(written.get("thickness", 1.0), "thickness")
        strength = None
        if (breakdown := written.get("breakdown")) is not None:
            strength = self._number(breakdown["field"], "field"), 0.0
            if breakdown.get("law") == "power":
                a, b = float(breakdown["stretch_exponent"]), float(breakdown["thickness_exponent"])
                strength = strength[0] * thickness**b, a - 2.0 * b  # h = h₀λ⁻²
        return Balloon(
            written["name"],
            self._number(written.get("radius", 1.0), "radius"),
            thickness,
            self._number(written.get("modulus", 1.0), "modulus"),
            self._number(written.get("permittivity", 1.0), "permittivity"),
            bool(written.get("electrodes", False)),
            law_of(written["elastomer"], self._curve),
            strength,
            repr(sorted(written["elastomer"].items())),
        )

    def _step(self, number: int, written: Document) -> Step:
        kinds = ("inflate", "ramp", "charge", "hold", "jump", "sine", "triangle", "table")
        (kind,) = (kind for kind in kinds if kind in written)
        opens = kind == "inflate" or written.get("valve", "closed") == "open"
        until = self._until(written["until"]) if written.get("until") else None
        over = self._number(written.get("over", 1.0), "time")
        value = written[kind]
        match kind:
            case "inflate":
                return Step(number, kind, over, opens, self._number(value, "pressure"))
            case "hold":
                return Step(number, kind, self._number(value, "time"), opens)
            case "ramp" | "charge" | "jump":
                dimension = "charge" if kind == "charge" else "voltage"
                target = self._numbers(value, dimension)
                return Step(number, kind, 0.0 if kind == "jump" else over, opens, target, until=until)
            case "table":
                times, voltages = self._table(value)
                return Step(number, kind, times[-1], opens, rows=(times, voltages), until=until)
        wave, period = self._wave(kind, value)
        return Step(number, kind, period * wave.cycles, opens, wave=wave, until=until)

    def _wave(self, kind: str, written: Document) -> tuple[Wave, float]:
        keys = ("mean", "amplitude") if kind == "sine" else ("low", "high")
        period, cycles = self._number(written["period"], "time"), float(written["cycles"])
        if keys[0] in written and not isinstance(written[keys[0]], Mapping):
            first, second = (self._number(written[key], "voltage") for key in keys)
            return Wave(cycles, (first, second)), period
        by_name = {
            name: (
                self._number(part[keys[0]], "voltage"),
                self._number(part[keys[1]], "voltage"),
                float(part.get("phase", 0.0)),
            )
            for name, part in written.items()
            if isinstance(part, Mapping)
        }
        return Wave(cycles, None, by_name), period

    def _until(self, written: Document) -> Until:
        found: list[tuple[str, str, float]] = []
        only = [b["name"] for b in self.document["balloon"] if b.get("electrodes")]
        for kind in ("stretch", "field"):
            if (wanted := written.get(kind)) is not None:
                values = wanted if isinstance(wanted, Mapping) else {only[0]: wanted}
                dimension = "field" if kind == "field" else ""
                found += [(kind, name, self._number(value, dimension)) for name, value in values.items()]
        if (pressure := written.get("pressure")) is not None:
            found.append(("pressure", "", self._number(pressure, "pressure")))
        return Until(written.get("event") == "limit_point", tuple(found))

    def _numbers(self, value: Any, dimension: str) -> float | dict[str, float]:
        if isinstance(value, Mapping):
            return {name: self._number(one, dimension) for name, one in value.items()}
        return self._number(value, dimension)

    def _number(self, value: Any, dimension: str) -> float:
        if not isinstance(value, str):
            return float(value)
        size, unit = self._unit(dimension)
        return _in_units_of(value, unit) / size

    def _unit(self, dimension: str) -> tuple[float, str]:
        """What is 1 in the model, in which SI unit."""
        scales = self.document["scales"]
        modulus = _in_units_of(scales["shear_modulus"], "Pa")
        thickness, radius = (_in_units_of(scales[key], "m") for key in ("thickness", "radius"))
        epsilon = scales["permittivity"]
        epsilon = _in_units_of(epsilon, "F/m") if isinstance(epsilon, str) else float(epsilon) * VACUUM
        strength = math.sqrt(modulus / epsilon)
        sizes = {
            "pressure": (modulus * thickness / radius, "Pa"),
            "voltage": (thickness * strength, "V"),
            "field": (strength, "V/m"),
            "charge": (4.0 * math.pi * radius**2 * math.sqrt(epsilon * modulus), "C"),
            "volume": (4.0 * math.pi * radius**3, "m^3"),
            "time": (1.0, "s"),
            "radius": (radius, "m"),
            "thickness": (thickness, "m"),
            "modulus": (modulus, "Pa"),
            "permittivity": (epsilon, "F/m"),
        }
        return sizes[dimension]

    def _columns(self, path: str) -> tuple[list[str], list[str], np.ndarray[Any, Any]]:
        """Names and units of the two columns of a CSV file, and its numbers."""
        lines = [
            line for line in (self.folder / path).read_text(encoding="utf-8-sig").splitlines() if line.strip()
        ]
        cells = [re.fullmatch(r'\s*"?(\w+)\s*(?:\[(.*)\])?"?\s*', cell) for cell in lines[0].split(",")]
        assert all(cells)
        names = [cell[1] for cell in cells if cell]
        units = [cell[2] or "" for cell in cells if cell]
        return (
            names,
            units,
            np.array([[float(c.strip(' "')) for c in line.split(",")] for line in lines[1:]]).T,
        )

    def _table(self, path: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
        names, units, columns = self._columns(path)
        scaled = {
            name: column * (self._number(f"1 {unit}", name) if unit else 1.0)
            for name, unit, column in zip(names, units, columns, strict=True)
        }
        return tuple(scaled["time"].tolist()), tuple(scaled["voltage"].tolist())

    def _curve(self, path: str) -> tuple[Any, Any]:
        names, _, columns = self._columns(path)
        found = dict(zip(names, columns, strict=True))
        stretch = found["stretch"]
        return stretch, stretch**2 * found["pressure"] if "pressure" in found else 2.0 * found["stress"]


def _unrolled(steps: Any) -> Iterator[Document]:
    for step in steps:
        if "cycle" in step:
            for _ in range(int(step["cycle"])):
                yield from _unrolled(step["steps"])
        else:
            yield step


@cache
def _registry() -> Any:
    import pint

    return pint.UnitRegistry()


@cache
def _in_units_of(text: str, unit: str) -> float:
    return float(_registry().Quantity(text).to(unit).magnitude)
