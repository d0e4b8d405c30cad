"""The columns of every table of results, and what they mean.

A column is named after its quantity: `pressure`, `voltage_<name>` of one balloon, `pressure_before` on one
side of an event. `COLUMNS` says once what each quantity is; the functions say which columns a table has, in
which order. With [scales] the same quantities in SI units follow, see `simulator.units.in_si`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from simulator.results.csv_text import Columns
from simulator.units import ENERGY, VOLUME, in_si

if TYPE_CHECKING:
    from simulator.results.curve import Curve, FoldCurve, SpecialPoint
    from simulator.results.cycles import Cycle
    from simulator.results.history import Event, FloatArray, History
    from simulator.results.sensitivity import Sensitivity


class Meaning(NamedTuple):
    """What a quantity is, and what it is in units of; "" for what has no unit."""

    words: str
    unit: str = ""


COLUMNS: Mapping[str, Meaning] = MappingProxyType(
    {
        "time": Meaning("time", "s, or whatever the scenario means by 1"),
        "step": Meaning("number of the step, from 1, cycles unrolled"),
        "branch": Meaning("number of jumps and snaps so far, from 0"),
        "cycle": Meaning("number of the cycle, from 1; 0 outside of cycles"),
        "kind": Meaning("what happened, or what the point of a path is"),
        "curve": Meaning("number of the path, from 1, where a file holds several"),
        "arclength": Meaning("length of the path up to here, in unknowns over their natural sizes"),
        "voltage": Meaning("voltage of a balloon; in fold.csv of the limit point", "H√(μ/ε)"),
        "stretch": Meaning("present over unstretched radius of a balloon"),
        "pressure": Meaning("excess pressure", "μH/R"),
        "volume": Meaning("volume of all balloons and the chamber", "4πR³"),
        "gas": Meaning("amount of gas, (p + pₑ)V; of a liquid its volume", "4πR²Hμ; 4πR³"),
        "field": Meaning("true electric field in the film of a balloon", "√(μ/ε)"),
        "charge": Meaning("charge on the electrodes of a balloon", "4πR²√(εμ)"),
        "energy": Meaning("the potential Π, that of viscoelastic branches included", "4πR²Hμ"),
        "stability": Meaning("smallest eigenvalue of the Hessian of Π; negative is unstable", "4πR²Hμ"),
        "stable": Meaning("whether no direction is unstable; a limit point belongs to the part before it"),
        "strength": Meaning("dielectric strength E_b of the film of a balloon", "√(μ/ε)"),
        "margin": Meaning("1 − |E|/E_b of a film with a strength; 0 is breakdown"),
        "sphericity": Meaning("how far a balloon is from turning into a pear, s of docs/shape.md", "μ"),
        "supply": Meaning("voltage of a balloon's source behind its resistance", "H√(μ/ε)"),
        "inner": Meaning(
            "stretch in which a viscoelastic branch is free of stress; `_thickness` across the film"
        ),
        "spheres": Meaning("whether every balloon is a sphere, or would stay one"),
        "balloon": Meaning("which balloon a change of shape concerns"),
        "mode": Meaning("what it would turn into: pear, or shear"),
        "loss_of_sphericity": Meaning(
            "number of the balloon, from 1, whose loss of sphericity fold.csv follows"
        ),
        "sphericity_regained": Meaning("the same of a sphere that is regained"),
        "dissipated": Meaning("potential lost in a jump", "4πR²Hμ"),
        "start": Meaning("when a cycle begins", "as time"),
        "end": Meaning("when it ends, or the history does", "as time"),
        "complete": Meaning("whether a cycle went to its end"),
        "loop_work": Meaning("∫φ dq over a cycle, of a balloon's source and of all together", "4πR²Hμ"),
        "supply_work": Meaning("∫p dV of the supply over a cycle, while the valve is open", "4πR²Hμ"),
        "largest": Meaning("largest value in a cycle, between samples too; of a field its size"),
        "smallest": Meaning("smallest value in a cycle, likewise"),
    }
)
"""Quantities by the name that their columns begin with."""


def history_columns(history: History) -> Columns:
    """The samples of a history by column, in the order of `history.csv`.

    Parameters
    ----------
    history : History

    Returns
    -------
    dict of str to (n_samples,) array
        `<quantity>` or, for each balloon that has it, `<quantity>_<name>`, as in `COLUMNS`.
    """
    columns = {
        "time": history.time,
        "step": history.step,
        "branch": history.branch,
        "cycle": history.cycle,
        **_by_name("voltage", history.electroded, history.voltage),
        **_by_name("stretch", history.balloons, history.stretch),
        "pressure": history.pressure,
        "volume": history.volume,
        "gas": history.gas,
        **_by_name("field", history.electroded, history.field),
        **_by_name("charge", history.electroded, history.charge),
        "energy": history.energy,
        "stability": history.stability,
        **_by_name("strength", history.rated, history.strength),
        **_by_name("margin", history.rated, history.margin),
        **(_by_name("sphericity", history.balloons, history.sphericity) if history.sphericity.size else {}),
        **(_by_name("supply", history.electroded, history.supply) if history.supply.size else {}),
        **_by_name("inner", history.inner_of, history.inner),
    }
    return _with_si(columns, history)


def columns_at(history: History, time: float) -> dict[str, float]:
    """The columns of `history.csv` at one time, see `History.at`."""
    reached = history.time
    if not len(history) or not reached[0] <= time <= reached[-1]:
        span = f"from {reached[0]:g} to {reached[-1]:g}" if len(history) else "nothing"
        raise ValueError(f"time {time:g} is not in the history, which has {span}")
    after = int(np.searchsorted(reached, time, side="right"))
    first, last = after - 1, min(after, len(history) - 1)
    width = reached[last] - reached[first]
    share = (time - reached[first]) / width if width > 0.0 else 0.0
    found = {
        name: float(
            values[first] + (share * (values[last] - values[first]) if values.dtype.kind == "f" else 0)
        )
        for name, values in history_columns(history).items()
    }
    return {**found, "time": float(time)}


def event_columns(history: History) -> Columns:
    """The events of a history by column, in the order of `events.csv`.

    Parameters
    ----------
    history : History

    Returns
    -------
    dict of str to (n_events,) array
        As in `COLUMNS`; what differs on the two sides of an event is `<quantity>_before` and
        `<quantity>_after`, next to each other. NaN on the after side where a history ends.
    """
    events = history.events
    balloons, electroded = history.balloons, history.electroded

    def sides(quantity: str, names: tuple[str, ...]) -> Columns:
        before = _stacked(events, f"{quantity}_before", len(names))
        after = _stacked(events, f"{quantity}_after", len(names))
        return {
            f"{quantity}_{name}_{side}": values[:, i]
            for i, name in enumerate(names)
            for side, values in (("before", before), ("after", after))
        }

    columns = {
        "time": np.array([event.time for event in events], dtype=float),
        "step": np.array([event.step for event in events], dtype=np.int64),
        "cycle": np.array([event.cycle for event in events], dtype=np.int64),
        "kind": np.array([event.kind.value for event in events], dtype=object),
        **(_shapes(events) if history.sphericity.size else {}),
        **_by_name("voltage", electroded, _stacked(events, "voltage", len(electroded))),
        **sides("stretch", balloons),
        "pressure_before": _stacked(events, "pressure_before", 1)[:, 0],
        "pressure_after": _stacked(events, "pressure_after", 1)[:, 0],
        **sides("field", electroded),
        "dissipated": _stacked(events, "dissipated", 1)[:, 0],
    }
    return _with_si(columns, history)


def cycle_columns(history: History) -> Columns:
    """The cycles of a history by column, in the order of `cycles.csv`.

    Parameters
    ----------
    history : History

    Returns
    -------
    dict of str to (n_cycles,) array
        As in `COLUMNS`; `largest_<quantity>_<name>` and `smallest_…` of stretches and fields, and
        `dissipated_<kind>` for every kind of loss that the history has.
    """
    cycles = history.cycles
    balloons, electroded = history.balloons, history.electroded
    kinds = dict.fromkeys(kind for cycle in cycles for kind in cycle.losses)

    def extremes(which: str) -> Columns:
        return {
            **_by_name("stretch", balloons, _of_extremes(cycles, f"{which}_stretch", len(balloons))),
            **_by_name("field", electroded, _of_extremes(cycles, f"{which}_field", len(electroded))),
        }

    works = np.array([cycle.loop_work for cycle in cycles]).reshape(len(cycles), len(electroded))
    columns = {
        "cycle": np.array([cycle.number for cycle in cycles], dtype=np.int64),
        "start": np.array([cycle.start for cycle in cycles]),
        "end": np.array([cycle.end for cycle in cycles]),
        "complete": np.array([cycle.complete for cycle in cycles], dtype=bool),
        **_by_name("loop_work", electroded, works),
        "loop_work": np.array([cycle.total_work for cycle in cycles]),
        "supply_work": np.array([cycle.gas_work for cycle in cycles]),
        "dissipated": np.array([cycle.dissipated for cycle in cycles]),
        **{
            f"dissipated_{kind}": np.array([cycle.losses.get(kind, 0.0) for cycle in cycles])
            for kind in kinds
        },
    }
    found = {which: extremes(which) for which in ("largest", "smallest")}
    named = {f"{which}_{name}": values for which, part in found.items() for name, values in part.items()}
    scales = history.scenario.scales
    if scales is None:
        return {**columns, **named}
    radii = {b.name: b.radius for b in history.scenario.balloons}
    energies = in_si(columns, scales, {}, {"loop": ENERGY, "supply": ENERGY})
    in_units = {
        f"{which}_{name}": values
        for which, part in found.items()
        for name, values in in_si(part, scales, radii).items()
    }
    return {**columns, **named, **energies, **in_units}


def _of_extremes(cycles: Sequence[Cycle], attribute: str, width: int) -> FloatArray:
    rows = [getattr(cycle.extremes, attribute) for cycle in cycles]
    return np.array(rows, dtype=np.float64).reshape(len(cycles), width)


def curve_columns(curves: Sequence[Curve]) -> Columns:
    """The points of equilibrium paths by column, in the order of `curve.csv`.

    Parameters
    ----------
    curves : sequence of Curve
        Of the same balloons.

    Returns
    -------
    dict of str to (n_points,) array
        As in `COLUMNS`; `curve` comes first, and only where there are several.
    """
    return _joined(curves, [_of_curve(curve) for curve in curves])


def point_columns(curves: Sequence[Curve]) -> Columns:
    """The special points of equilibrium paths by column, in the order of `points.csv`.

    Parameters
    ----------
    curves : sequence of Curve
        Of the same balloons.

    Returns
    -------
    dict of str to (n_points,) array
        As in `COLUMNS`; `curve` comes first, and only where there are several.
    """
    return _joined(curves, [_of_points(curve) for curve in curves])


def fold_columns(curve: FoldCurve) -> Columns:
    """A limit point, or a loss of sphericity, as one number changes, by column, in the order of `fold.csv`.

    Parameters
    ----------
    curve : FoldCurve

    Returns
    -------
    dict of str to (n_points,) array
        First the number, under its key; then as in `COLUMNS`.
    """
    columns = {
        curve.parameter: curve.value,
        "voltage": curve.voltage,
        **_by_name("stretch", curve.balloons, curve.stretch),
        "pressure": curve.pressure,
    }
    if curve.balloon is not None:
        # Which balloon it is, counted from 1; by this column a file is known from that of a limit point.
        columns[curve.of] = np.full(len(curve), curve.balloons.index(curve.balloon) + 1)
    if curve.scales is None:
        return columns
    varied = {}
    if curve.dimension is not None:
        varied[f"{curve.parameter} [{curve.dimension.unit}]"] = curve.value * curve.scales.of(curve.dimension)
    return columns | varied | in_si(columns, curve.scales, {})


def sensitivity_columns(found: Sequence[Sensitivity]) -> Columns:
    """Sensitivities by column, in the order of `sensitivities.csv`; each is an attribute of `Sensitivity`.

    Where they have units, each number has a column with its unit behind it.
    """
    names = ["time", "step", "kind", "of", "value", "key", "parameter", "derivative"]
    if any(one.unit for one in found):
        names = ["time", "step", "kind", "of", "value", "unit", "key", "parameter", "parameter_unit"]
        names += ["derivative", "derivative_unit"]
    columns = {name: np.array([getattr(one, name) for one in found]) for name in names}
    return {"time [s]" if name == "time" and "unit" in names else name: columns[name] for name in names}


def _with_si(columns: Columns, history: History) -> Columns:
    scales = history.scenario.scales
    if scales is None:
        return columns
    radii = {b.name: b.radius for b in history.scenario.balloons}
    # The amount of a liquid is a volume.
    others = {"gas": VOLUME} if history.scenario.gas.law == "liquid" else {}
    return columns | in_si(columns, scales, radii, others)


def _of_curve(curve: Curve) -> Columns:
    return {
        "arclength": curve.arclength,
        **_by_name("voltage", curve.electroded, curve.voltage),
        **_by_name("stretch", curve.balloons, curve.stretch),
        "pressure": curve.pressure,
        **_by_name("field", curve.electroded, curve.field),
        **_by_name("charge", curve.electroded, curve.charge),
        "energy": curve.energy,
        "stability": curve.stability,
        "stable": curve.unstable == 0,
        **_of_shapes(curve),
    }


def _of_shapes(curve: Curve) -> Columns:
    """Margins of sphericity, and whether all balloons are spheres; nothing where that is ignored."""
    if not curve.sphericity.size:
        return {}
    return {**_by_name("sphericity", curve.balloons, curve.sphericity), "spheres": ~curve.lost}


def _of_points(curve: Curve) -> Columns:
    points, electroded, balloons = curve.points, curve.electroded, curve.balloons
    return {
        "kind": np.array([point.kind for point in points], dtype=object),
        **(_shapes(points) if curve.sphericity.size else {}),
        "arclength": _stacked(points, "arclength", 1)[:, 0],
        **_by_name("voltage", electroded, _stacked(points, "voltage", len(electroded))),
        **_by_name("stretch", balloons, _stacked(points, "stretch", len(balloons))),
        "pressure": _stacked(points, "pressure", 1)[:, 0],
    }


def _shapes(records: Sequence[Event] | Sequence[SpecialPoint]) -> Columns:
    """Which balloon a change of shape concerns, and what it would turn into; empty for others."""
    return {
        "balloon": np.array([record.balloon or "" for record in records], dtype=object),
        "mode": np.array([record.mode or "" for record in records], dtype=object),
    }


def _joined(curves: Sequence[Curve], parts: Sequence[Columns]) -> Columns:
    """Tables of equal columns under one another, numbered from 1 where there are several."""
    parts = [
        part | in_si(part, curve.scales, dict(zip(curve.balloons, curve.radius, strict=True)))
        if curve.scales
        else part
        for curve, part in zip(curves, parts, strict=True)
    ]
    if len(parts) == 1:
        return parts[0]
    sizes = [next(iter(part.values())).size for part in parts]
    return {
        "curve": np.repeat(np.arange(1, len(parts) + 1), sizes),
        **{name: np.concatenate([part[name] for part in parts]) for name in parts[0]},
    }


def _by_name(quantity: str, names: tuple[str, ...], values: FloatArray) -> Columns:
    return {f"{quantity}_{name}": values[:, i] for i, name in enumerate(names)}


def _stacked(records: tuple[Event, ...] | tuple[SpecialPoint, ...], attribute: str, width: int) -> FloatArray:
    """One row per event or point, NaN where an event has no such side."""
    rows = np.full((len(records), width), math.nan)
    for row, record in zip(rows, records, strict=True):
        value = getattr(record, attribute)
        if value is not None:
            row[:] = value
    return rows
