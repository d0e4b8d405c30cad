"""Unloading from many peaks as labelled arrays."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from simulator.results.extras import MissingExtra
from simulator.units import ENERGY, PRESSURE, VOLTAGE, Dimension

if TYPE_CHECKING:
    import xarray as xr

    from simulator.results.unloading import Unloading, UnloadingMap


def unloading_dataset(found: Unloading) -> xr.Dataset:
    """What became of each peak, over `peak` and `balloon`. Raises MissingExtra without xarray."""
    reloaded = {"reloaded": (("peak",), found.reloaded)} if found.reloaded.size else {}
    return _dataset(
        found,
        {
            "remanent_stretch": (("peak", "balloon"), found.remanent_stretch),
            "remanent_pressure": (("peak",), found.remanent_pressure),
            "area": (("peak",), found.area),
            "dissipated": (("peak",), found.dissipated),
            "closed": (("peak",), found.closed),
            **reloaded,
            "outcome": (("peak",), np.array(found.outcome, dtype=str)),
        },
        {"peak": found.peaks},
        {"peak": VOLTAGE},
    )


def map_dataset(found: UnloadingMap) -> xr.Dataset:
    """What became of each value and peak, over the key, `peak` and `balloon`."""
    over = (found.key, "peak")
    return _dataset(
        found,
        {
            "remanent_stretch": ((*over, "balloon"), found.remanent_stretch),
            "area": (over, found.area),
            "dissipated": (over, found.dissipated),
            "closed": (over, found.closed),
            "outcome": (over, np.array(found.outcome, dtype=str)),
        },
        {found.key: found.values, "peak": found.peaks},
        {found.key: found.dimension, "peak": VOLTAGE},
    )


def _dataset(
    found: Unloading | UnloadingMap,
    variables: dict[str, tuple[tuple[str, ...], np.ndarray[Any, Any]]],
    axes: dict[str, np.ndarray[Any, Any]],
    dimensions: dict[str, Dimension | None],
) -> xr.Dataset:
    """A dataset in SI units, each as the attribute ``units``, where there are scales."""
    try:
        import xarray as xr
    except ImportError as error:
        raise MissingExtra(
            "to_xarray needs xarray: pip install 'dielectric-balloons[sweep]'; to_dataframe gives a table"
        ) from error
    known = {"remanent_pressure": PRESSURE, "area": ENERGY, "dissipated": ENERGY, **dimensions}
    scales, attributes = found.scales, {}
    if scales is not None:
        for name, dimension in known.items():
            if dimension is None:
                continue
            factor, attributes[name] = scales.of(dimension), dimension.unit
            if name in axes:
                axes = {**axes, name: axes[name] * factor}
            elif name in variables:
                over, values = variables[name]
                variables = {**variables, name: (over, values * factor)}
    coordinates = {**axes, "balloon": list(found.balloons)}
    dataset = xr.Dataset(variables, coords=coordinates, attrs={"title": found.title})
    for name, unit in attributes.items():
        if name in dataset.variables:
            dataset[name].attrs["units"] = unit
    return dataset
