"""Scenarios written in SI units: the same run as with dimensionless numbers, to rounding."""

from __future__ import annotations

from typing import Any

import numpy as np

Document = dict[str, Any]

_UNITS = {
    "ambient_pressure": ("Pa", "kPa", "mbar"),
    "inflate": ("Pa", "kPa"),
    "pressure": ("Pa", "kPa"),
    "ramp": ("V", "kV"),
    "jump": ("V", "kV"),
    "mean": ("V", "kV"),
    "amplitude": ("V", "kV"),
    "low": ("V", "kV"),
    "high": ("V", "kV"),
    "over": ("s", "ms", "min"),
    "hold": ("s", "ms", "min"),
    "period": ("s", "ms"),
    "relaxation_time": ("s", "ms"),
    "time": ("s", "ms"),
    "radius": ("mm", "cm"),
    "thickness": ("mm", "um"),
    "modulus": ("kPa", "MPa"),
    "field": ("MV/m", "V/um"),
    "charge": ("nC", "uC"),
    "chamber": ("cm^3", "l"),
}
_SIZES = {
    "Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "mbar": 1e2, "V": 1.0, "kV": 1e3, "s": 1.0, "ms": 1e-3, "min": 60.0,
    "mm": 1e-3, "cm": 1e-2, "um": 1e-6, "MV/m": 1e6, "V/um": 1e6, "nC": 1e-9, "uC": 1e-6,
    "cm^3": 1e-6, "l": 1e-3,
}  # fmt: skip
_VACUUM = 8.8541878128e-12


def with_units(rng: np.random.Generator, document: Document, share: float = 0.6) -> Document:
    """The same scenario with a share of its numbers in SI units, to rounding.

    Parameters
    ----------
    rng : numpy.random.Generator
    document : dict
        With `[scales]` whose first three are written as by this module.
    share : float
        Of the quantities that get a unit; 1 for all of them.
    """
    sizes = si_sizes(document["scales"])

    def measured(key: str, value: Any) -> Any:
        if isinstance(value, dict):
            return {name: measured(key, part) for name, part in value.items()}
        if not rng.random() < share:
            return value
        unit = str(rng.choice(_UNITS[key]))
        return f"{float(value * sizes[key] / _SIZES[unit])!r} {unit}"

    def walked(item: Any) -> Any:
        if isinstance(item, list):
            return [walked(part) for part in item]
        if not isinstance(item, dict):
            return item
        out = {}
        for key, value in item.items():
            plain = isinstance(value, float | int) and not isinstance(value, bool)
            by_name = isinstance(value, dict) and key in (
                "ramp",
                "jump",
                "relaxation_time",
                "charge",
                "field",
            )
            out[key] = measured(key, value) if key in _UNITS and (plain or by_name) else walked(value)
        return out

    kept: Document = {
        key: document[key] for key in ("title", "scales", "solver", "output") if key in document
    }
    return {**{key: walked(value) for key, value in document.items() if key not in kept}, **kept}


def si_sizes(scales: Document) -> dict[str, float]:
    """What 1 of each key's quantity is in SI units, by arithmetic of its own."""
    modulus, thickness, radius = (
        float(str(scales[key]).split()[0]) * _SIZES[str(scales[key]).split()[1]]
        for key in ("shear_modulus", "thickness", "radius")
    )
    given = scales["permittivity"]
    permittivity = float(given.split()[0]) * 1e-12 if isinstance(given, str) else given * _VACUUM
    pressure = modulus * thickness / radius
    voltage = thickness * np.sqrt(modulus / permittivity)
    sizes = {
        "modulus": modulus, "thickness": thickness, "radius": radius,
        **dict.fromkeys(("ambient_pressure", "inflate", "pressure"), pressure),
        **dict.fromkeys(("ramp", "jump", "mean", "amplitude", "low", "high"), voltage),
        "field": voltage / thickness,
        "charge": 4.0 * np.pi * radius**2 * np.sqrt(permittivity * modulus),
        "chamber": 4.0 * np.pi * radius**3,
        **dict.fromkeys(("over", "hold", "period", "relaxation_time", "time"), 1.0),
    }  # fmt: skip
    return {key: float(size) for key, size in sizes.items()}
