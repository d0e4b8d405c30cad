"""Twins: scenarios that are written in another way and must do the same."""

from __future__ import annotations

import copy
import csv
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tests.fuzz.chances import table_file
from tests.fuzz.si_units import with_units

Document = dict[str, Any]
Rng = np.random.Generator


@dataclass(frozen=True)
class Twin:
    """A scenario that must do the same, but for what is told here.

    Attributes
    ----------
    document : dict
    sign : float
        Of its voltages over the first one's.
    pace : float
        Its times over the first one's.
    numbered : bool
        Whether steps have the same numbers.
    sampled : bool
        Whether samples are taken at the same times.
    """

    document: Document
    sign: float = 1.0
    pace: float = 1.0
    numbered: bool = True
    sampled: bool = True


def _is_equal_pair(document: Document) -> bool:
    makes = [{k: v for k, v in b.items() if k not in ("name", "breakdown")} for b in document["balloon"]]
    return any(a == b for i, a in enumerate(makes) for b in makes[:i])


def permuted(document: Document, rng: Rng, folder: Path) -> Twin | None:
    """Balloons in another order; which of two equal ones leaves first is the order's choice."""
    count = len(document["balloon"])
    if count < 2 or _is_equal_pair(document):
        return None
    order = rng.permutation(count)
    if np.array_equal(order, np.arange(count)):
        order = order[::-1]
    return Twin({**document, "balloon": [document["balloon"][i] for i in order]})


def negated(document: Document, rng: Rng, folder: Path) -> Twin | None:
    """All voltages and charges of the other sign."""

    def minus(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: minus(part) for key, part in value.items()}
        if isinstance(value, str):
            return value[1:] if value.startswith("-") else f"-{value}"
        return -value

    def turned(step: Document) -> Document:
        out = dict(step)
        for kind in ("ramp", "jump", "charge"):
            if kind in step:
                out[kind] = minus(step[kind])
        for kind in ("sine", "triangle"):
            if kind in step:
                out[kind] = _waves(step[kind], ("mean", "amplitude", "low", "high"), minus)
        if "table" in step:
            out["table"] = _other_table(step["table"], folder, lambda t, v: (t, -v))
        return out

    return Twin(_with_steps(document, turned), sign=-1.0)


def paced(document: Document, rng: Rng, folder: Path) -> Twin | None:
    """All times longer by a factor, which is no power of two."""
    factor = float(rng.choice([3.0, 0.1, 60.0]))

    def times(value: Any, factor: float = factor) -> Any:
        if isinstance(value, dict):
            return {key: times(part, factor) for key, part in value.items()}
        if isinstance(value, str):
            number, unit = value.split()
            return f"{float(number) * factor!r} {unit}"
        return value * factor

    def slower(step: Document) -> Document:
        out = dict(step)
        for key in ("over", "hold"):
            if key in step:
                out[key] = times(step[key])
        if "over" not in step and any(kind in step for kind in ("inflate", "ramp", "charge")):
            out["over"] = factor
        for kind in ("sine", "triangle"):
            if kind in step:
                out[kind] = _waves(step[kind], ("period",), times)
        if "table" in step:
            out["table"] = _other_table(step["table"], folder, lambda t, v: (t * factor, v))
        return out

    twin = _with_steps(document, slower)
    if "dynamics" in twin:
        twin["dynamics"] = {key: times(value) for key, value in twin["dynamics"].items()}
        for balloon in twin["balloon"]:
            if "maxwell" in balloon:
                named = balloon["maxwell"]
                slow = [
                    {**one, "time": times(one["time"])} for one in ([named] if "time" in named else named)
                ]
                balloon["maxwell"] = slow[0] if "time" in named else slow
        for balloon in twin["balloon"]:
            if "leak" in balloon:
                leak = balloon["leak"]
                leak["conductivity"] = times(leak["conductivity"], 1.0 / factor)
        if "supply" in twin:
            supply = twin["supply"]
            supply["resistance"] = times(supply["resistance"])
            if "current_limit" in supply:
                supply["current_limit"] = times(supply["current_limit"], 1.0 / factor)
    if "every" in twin.get("output", {}):
        twin["output"] = {"every": times(twin["output"]["every"])}
    return Twin(twin, pace=factor)


def in_si_units(document: Document, rng: Rng, folder: Path) -> Twin | None:
    """Every quantity with a unit."""
    if "scales" in document:
        return None
    scales = {
        "shear_modulus": f"{rng.uniform(10.0, 500.0)!r} kPa",
        "thickness": f"{rng.uniform(0.1, 2.0)!r} mm",
        "radius": f"{rng.uniform(5.0, 50.0)!r} mm",
        "permittivity": float(rng.uniform(2.5, 8.0)),
    }
    return Twin(with_units(rng, {**document, "scales": scales}, share=1.0))


def unrolled(document: Document, rng: Rng, folder: Path) -> Twin | None:
    """Cycles written out."""
    if not any("cycle" in step for step in document["step"]):
        return None
    return Twin({**document, "step": written_out(document["step"])})


def written_out(steps: list[Document]) -> list[Document]:
    out: list[Document] = []
    for step in steps:
        out += step["cycle"] * written_out(step["steps"]) if "cycle" in step else [step]
    return out


def halved(document: Document, rng: Rng, folder: Path) -> Twin | None:
    """The ramps in two parts each."""
    if "scales" in document:
        return None
    share = float(rng.uniform(0.1, 0.9))
    out: list[Document] = []
    changed = False
    for step, known in _with_voltages(document):
        if "ramp" not in step or known is None or "until" in step:
            out.append(step)
            continue
        target = _by_name(step["ramp"], known)
        middle = {name: v + share * (target[name] - v) for name, v in known.items()}
        over = step.get("over", 1.0)
        out.append({**step, "ramp": middle, "over": share * over})
        out.append({**step, "over": over - share * over})
        changed = True
    twin = {**document, "step": out}
    return Twin(twin, numbered=False, sampled=False) if changed else None


def tabled(document: Document, rng: Rng, folder: Path) -> Twin | None:
    """A table in the place of each ramp of all voltages from one common value."""
    if "scales" in document:
        return None
    out: list[Document] = []
    changed = False
    for step, known in _with_voltages(document):
        values = set(known.values()) if known is not None else set()
        if "ramp" not in step or isinstance(step["ramp"], dict) or len(values) != 1:
            out.append(step)
            continue
        rows = f"0,{values.pop()!r}\n{step.get('over', 1.0)!r},{step['ramp']!r}\n"
        rest = {key: value for key, value in step.items() if key not in ("ramp", "over")}
        out.append({"table": table_file(folder, "time,voltage\n" + rows), **rest})
        changed = True
    return Twin({**document, "step": out}) if changed else None


def recorded(document: Document, rng: Rng, folder: Path) -> Twin | None:
    """Recordings by name, as an instrument writes them, in the place of each ramp from known voltages."""
    if "scales" in document:
        return None
    out: list[Document] = []
    changed = False
    for step, known in _with_voltages(document):
        if "ramp" not in step or known is None:
            out.append(step)
            continue
        ends = step["ramp"] if isinstance(step["ramp"], dict) else dict.fromkeys(known, step["ramp"])
        lasts = step.get("over", 1.0)
        recordings = {
            name: {
                "file": table_file(
                    folder, f"amplifier\nt;U\n0;{known[name]!r}\n{lasts!r};{end!r}\n".replace(".", ",")
                ),
                **{"time": "t", "voltage": "U", "separator": ";", "decimal": ",", "skip": 1},
            }
            for name, end in ends.items()
        }
        rest = {key: value for key, value in step.items() if key not in ("ramp", "over")}
        out.append({"table": recordings, **rest})
        changed = True
    return Twin({**document, "step": out}) if changed else None


def without_chamber(document: Document, rng: Rng, folder: Path) -> Twin | None:
    """A chamber of no volume."""
    if "chamber" in document["gas"]:
        return None
    return Twin({**document, "gas": {**document["gas"], "chamber": 0.0}})


def with_strength(document: Document, rng: Rng, folder: Path) -> Twin | None:
    """A strength that no field reaches, on the films that have none."""
    if not any(b.get("electrodes") and "breakdown" not in b for b in document["balloon"]):
        return None
    far = {"field": 1e12}
    balloons = [{**({"breakdown": far} if b.get("electrodes") else {}), **b} for b in document["balloon"]]
    return Twin({**document, "balloon": balloons})


def tighter(document: Document, rng: Rng, folder: Path) -> Twin | None:
    """Another tolerance of the integrator."""
    return Twin({**document, "solver": {"rtol": 1e-6}})


def resampled(document: Document, rng: Rng, folder: Path) -> Twin | None:
    """Other samples."""
    return Twin({**document, "output": {"points": 33}}, sampled=False)


TWINS: dict[str, Callable[[Document, Rng, Path], Twin | None]] = {
    twin.__name__: twin
    for twin in (
        permuted,
        negated,
        paced,
        in_si_units,
        unrolled,
        halved,
        tabled,
        recorded,
        without_chamber,
        with_strength,
        tighter,
        resampled,
    )
}


def _with_steps(document: Document, change: Callable[[Document], Document]) -> Document:
    def changed(step: Document) -> Document:
        if "cycle" in step:
            return {**step, "steps": [changed(inner) for inner in step["steps"]]}
        return change(step)

    out = copy.deepcopy(document)
    out["step"] = [changed(step) for step in out["step"]]
    return out


def _waves(wave: Document, keys: tuple[str, ...], change: Callable[[Any], Any]) -> Document:
    return {
        key: _waves(value, keys, change)
        if isinstance(value, dict)
        else change(value)
        if key in keys
        else value
        for key, value in wave.items()
    }


def _other_table(path: str, folder: Path, change: Callable[[float, float], tuple[float, float]]) -> str:
    with open(path) as stream:
        header, *rows = list(csv.reader(stream))
    changed = [change(float(t), float(v)) for t, v in rows]
    return table_file(folder, "\n".join([",".join(header), *(f"{t!r},{v!r}" for t, v in changed)]) + "\n")


def _by_name(value: Any, known: dict[str, float]) -> dict[str, float]:
    return {**known, **value} if isinstance(value, dict) else dict.fromkeys(known, value)


def _with_voltages(document: Document) -> list[tuple[Document, dict[str, float] | None]]:
    """The top-level steps, each with the voltages at its start, None where they are not known beforehand."""
    known: dict[str, float] | None = {b["name"]: 0.0 for b in document["balloon"] if b.get("electrodes")}
    out = []
    for step in document["step"]:
        out.append((step, known))
        if "ramp" in step or "jump" in step:
            given = step.get("ramp", step.get("jump"))
            if "until" in step or (known is None and isinstance(given, dict)):
                known = None
            else:
                names = [b["name"] for b in document["balloon"] if b.get("electrodes")]
                known = _by_name(given, known or dict.fromkeys(names, 0.0))
        elif not ("inflate" in step or "hold" in step):
            known = None
    return out
