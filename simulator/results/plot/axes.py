"""What the axes show: dimensionless numbers, or SI units with a prefix where the scenario has [scales].

A result with scales is drawn as a copy of it whose numbers are those of the axes, with radii in place of
stretches; what draws needs to know only the words.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from simulator.results.plot.style import CHARGE, FIELD, PRESSURE, STRETCH, VOLTAGE
from simulator.units import CHARGE as CHARGES
from simulator.units import FIELD as FIELDS
from simulator.units import NOISE, prefixed
from simulator.units import PRESSURE as PRESSURES
from simulator.units import RADIUS as LENGTHS
from simulator.units import VOLTAGE as VOLTAGES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from simulator.results.curve import Curve, FoldCurve
    from simulator.results.history import Event, History
    from simulator.units import Dimension, Scales

    FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Labels:
    """Symbols and units of the axes; `extent` is what the size of a balloon is called.

    `unstretched` are the radii of the balloons in the unit of the axes, none where these show stretches.
    """

    time: str = "t"
    voltage: str = VOLTAGE
    pressure: str = PRESSURE
    extent: str = "stretch"
    size: str = STRETCH
    field: str = FIELD
    charge: str = CHARGE
    unstretched: tuple[float, ...] = ()


def shown_history(history: History) -> tuple[History, Labels]:
    """A history in the numbers of its axes, and the labels of these."""
    scales = history.scenario.scales
    if scales is None:
        return history, Labels()
    ratios = np.array([balloon.radius for balloon in history.scenario.balloons])
    volts, radii, pascals, labels = _units(scales, ratios, history.voltage, history.stretch, history.pressure)
    coulombs, coulomb = _factor(CHARGES, scales, history.charge)
    fields, field = _factor(FIELDS, scales, history.field)
    labels = replace(labels, field=f"|E| [{field}]", charge=f"q [{coulomb}]")
    scaled = replace(
        history,
        voltage=history.voltage * volts,
        stretch=history.stretch * radii,
        pressure=history.pressure * pascals,
        field=history.field * fields,
        strength=history.strength * fields,
        charge=history.charge * coulombs,
        events=tuple(_scaled(event, volts, radii, pascals) for event in history.events),
    )
    return scaled, labels


def shown_curves(curves: Sequence[Curve], farthest: float) -> tuple[Sequence[Curve], Labels]:
    """Paths of the same balloons in the numbers of their axes, and the labels of these.

    Parameters
    ----------
    curves : sequence of Curve
    farthest : float
        The largest voltage (of an inflation: pressure) that is drawn, dimensionless.

    Returns
    -------
    (sequence of Curve, Labels)
    """
    scales = curves[0].scales
    if scales is None:
        return curves, Labels()
    stretch = np.max([curve.stretch.max(axis=0) for curve in curves], axis=0)
    volts, radii, pascals, labels = _units(scales, curves[0].radius, farthest, stretch, farthest)
    scaled = [
        replace(
            curve,
            voltage=curve.voltage * volts,
            stretch=curve.stretch * radii,
            pressure=curve.pressure * pascals,
            points=tuple(
                replace(
                    p, voltage=p.voltage * volts, stretch=p.stretch * radii, pressure=p.pressure * pascals
                )
                for p in curve.points
            ),
        )
        for curve in curves
    ]
    return scaled, labels


def shown_fold(curve: FoldCurve) -> tuple[FoldCurve, Labels, str]:
    """A limit point in the numbers of its axes, the labels of these, and that of the parameter."""
    if curve.scales is None:
        return curve, Labels(), curve.parameter
    volts, _, pascals, labels = _units(curve.scales, np.ones(1), curve.voltage, curve.stretch, curve.pressure)
    factor, parameter = 1.0, curve.parameter
    if curve.dimension is not None:
        factor, unit = _factor(curve.dimension, curve.scales, curve.value)
        parameter = f"{parameter} [{unit}]"
    scaled = replace(
        curve,
        value=curve.value * factor,
        voltage=curve.voltage * volts,
        pressure=curve.pressure * pascals,
    )
    return scaled, labels, parameter


def add_stretch_axis(ax: Axes, unstretched: float) -> None:
    """Add the stretch at the right of axes that show the radius of one balloon.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
    unstretched : float
        Radius of the unstretched balloon in the unit of the axes.
    """

    def stretch(radius: FloatArray) -> FloatArray:
        return radius / unstretched

    def radius(stretch: FloatArray) -> FloatArray:
        return stretch * unstretched

    right = ax.secondary_yaxis("right", functions=(stretch, radius))  # type: ignore[arg-type]
    right.set_ylabel(f"stretch  {STRETCH}")


def _factor(dimension: Dimension, scales: Scales, values: FloatArray | float) -> tuple[float, str]:
    """What dimensionless values are to be multiplied by, and the unit they then have."""
    scale = scales.of(dimension)
    largest = float(np.max(np.abs(values), initial=0.0))
    size, unit = prefixed(dimension, largest * scale if largest > NOISE else 0.0)
    return scale / size, unit


def _units(
    scales: Scales,
    ratios: FloatArray,
    voltage: FloatArray | float,
    stretch: FloatArray | float,
    pressure: FloatArray | float,
) -> tuple[float, FloatArray, float, Labels]:
    volts, volt = _factor(VOLTAGES, scales, voltage)
    pascals, pascal = _factor(PRESSURES, scales, pressure)
    metres, metre = _factor(LENGTHS, scales, stretch * ratios)
    radii = ratios * metres
    labels = Labels(
        "t [s]", f"Φ [{volt}]", f"P [{pascal}]", "radius", f"r [{metre}]", unstretched=tuple(radii.tolist())
    )
    return volts, radii, pascals, labels


def _scaled(event: Event, volts: float, radii: FloatArray, pascals: float) -> Event:
    after, pressure_after = event.stretch_after, event.pressure_after
    return replace(
        event,
        voltage=event.voltage * volts,
        stretch_before=event.stretch_before * radii,
        stretch_after=None if after is None else after * radii,
        pressure_before=event.pressure_before * pascals,
        pressure_after=None if pressure_after is None else pressure_after * pascals,
    )
