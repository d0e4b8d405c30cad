"""A sweep as data: the base scenario, what is varied, and the values of every run, by the run's number."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator.scenario import Scenario, until_of
from simulator.sweep.spread import Spread, correlated

FloatArray = NDArray[np.float64]

AT_REST = 1e-6  # stretches closer than this are the same state of rest
Value = float | str | bool

_FEWEST_AUDITED, _MOST_AUDITED = 20, 200


@dataclass(frozen=True)
class Axis:
    """One key and the values it takes, or for samples the interval it is drawn from.

    Attributes
    ----------
    key : str
        Dotted key of the scenario.
    values : tuple
        Numbers, texts or truth values; of an interval its two ends.
    unit : str
        Written behind each number in the scenario; "" for none.
    log : bool
        Whether an interval is drawn from evenly in the logarithm.
    folder : str
        Where the values, which are paths, start; "" for the current directory and for what is no path.
    spread : Spread or None
        What samples are drawn from, where that is no interval; `values` then are two of its quantiles.
    """

    key: str
    values: tuple[Value, ...]
    unit: str = ""
    log: bool = False
    folder: str = ""
    spread: Spread | None = None

    @property
    def kind(self) -> str:
        """What the values are: "number", "text" or "truth"."""
        if any(isinstance(value, str) for value in self.values):
            return "text"
        return "truth" if any(isinstance(value, bool) for value in self.values) else "number"

    def at(self, share: FloatArray | float) -> FloatArray:
        """The values at some shares of an interval or a spread, from 0 at its start to 1 at its end.

        The same shape.
        """
        if self.spread is not None:
            return self.spread.at(share)
        low, high = (float(value) for value in self.values)
        if self.log:
            low, high = np.log(low), np.log(high)
        place = np.asarray(low + share * (high - low))
        return np.exp(place) if self.log else place

    def written(self, value: Value) -> Value:
        """A value as it stands in the scenario."""
        if isinstance(value, str) and self.folder:
            return os.path.join(self.folder, value)
        return f"{value!r}{self.unit}" if self.unit else value


@dataclass(frozen=True)
class Sample:
    """Points drawn from the axes' intervals or spreads.

    Attributes
    ----------
    method : str
        "sobol", "latin-hypercube" or "random".
    size, seed : int
    correlation : tuple of tuples of float
        Of the axes; none where they are independent.
    indices : tuple of str
        The columns of which Sobol indices are wanted.
    """

    method: str
    size: int
    seed: int
    correlation: tuple[tuple[float, ...], ...] = ()
    indices: tuple[str, ...] = ()


@dataclass(frozen=True)
class Past:
    """A ramp that goes a factor `times` past the first limit point that it meets, and no further."""

    key: str
    step: int
    times: float


@dataclass(frozen=True)
class Recorded:
    """What a row records besides what every row has.

    Attributes
    ----------
    limit_points : int
        The voltages of so many limit points.
    sensitivities : tuple of str
        The keys of numbers in which the first of them is differentiated.
    shapes : bool
        Whether balloons stay spheres.
    margins : tuple of str
        The balloons of which the least margin to breakdown is recorded.
    """

    limit_points: int = 2
    sensitivities: tuple[str, ...] = ()
    shapes: bool = False
    margins: tuple[str, ...] = ()


def as_recorded(scenario: Scenario, *, shapes: bool) -> dict[str, Any]:
    """A scenario as a mapping, in which shapes are looked at only where a row or the history needs them."""
    mapping = scenario.to_dict()
    ends = any(until.event == "loss_of_sphericity" for s in scenario.played_steps() if (until := until_of(s)))
    if shapes and scenario.shape.on_loss == "ignore":
        mapping["shape"] = {"on_loss": "record"}
    elif not shapes and scenario.shape.on_loss == "record" and not ends:
        mapping["shape"] = {"on_loss": "ignore"}
    return mapping


@dataclass(frozen=True)
class Job:
    """What every run of a sweep shares, and all that a worker needs to know.

    Attributes
    ----------
    scenario : mapping
        The base scenario, tables by absolute path.
    axes : tuple of Axis
    past : Past or None
    recorded : Recorded
    balloons, electroded : tuple of str
    version : str
        Of this package: a worker of another one refuses, its numbers might differ.
    units : mapping of str to str
        Of the columns that have one.
    """

    scenario: Mapping[str, Any]
    axes: tuple[Axis, ...]
    past: Past | None
    recorded: Recorded
    balloons: tuple[str, ...]
    electroded: tuple[str, ...]
    version: str
    units: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, repr=False)
class Sweep:
    """A whole sweep, as returned by `read_sweep`.

    Attributes
    ----------
    file, title : str
    job : Job
    sample : Sample or None
        None for a grid, the product of the axes, the last one changing fastest.
    definition : mapping
        Everything that the rows depend on, in plain values; what a directory of results is compared with.
    """

    file: str
    title: str
    job: Job
    sample: Sample | None
    definition: Mapping[str, Any]

    def __repr__(self) -> str:
        keys = " × ".join(axis.key for axis in self.axes)
        kind = f"{self.sample.method} sample" if self.sample else "grid"
        return f"<Sweep {self.title!r}: {self.size:,} runs, {kind} over {keys}>"

    @property
    def axes(self) -> tuple[Axis, ...]:
        """What is varied, in the order of the file."""
        return self.job.axes

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values of each axis of a grid; for samples (size,)."""
        return (self.sample.size,) if self.sample else tuple(len(axis.values) for axis in self.axes)

    @property
    def size(self) -> int:
        """Number of runs."""
        size = 1
        for count in self.shape:
            size *= count
        return size

    @cached_property
    def audited(self) -> tuple[int, ...]:
        """The runs, from 0, that are played both in lockstep and by themselves: one in a hundred, drawn."""
        count = min(max(self.size // 100, _FEWEST_AUDITED), _MOST_AUDITED, self.size)
        drawn_runs = np.random.default_rng(self.size).choice(self.size, count, replace=False)
        return tuple(sorted(drawn_runs.tolist()))

    def values(self, start: int, stop: int) -> list[tuple[Value, ...]]:
        """The values of runs `start` to `stop` − 1, each a tuple with one for each axis; from 0."""
        if self.sample:
            return [tuple(row) for row in self._points[start:stop].tolist()]
        places = np.unravel_index(np.arange(start, stop), self.shape)
        columns = [[axis.values[i] for i in place] for axis, place in zip(self.axes, places, strict=True)]
        return list(zip(*columns, strict=True))

    @cached_property
    def _points(self) -> FloatArray:
        """All sample points, (size, n_axes)."""
        assert self.sample is not None
        return drawn(self.sample, self.axes)


def drawn(sample: Sample, axes: tuple[Axis, ...]) -> FloatArray:
    """Sample points in the axes' intervals and spreads. The same seed gives the same points.

    Parameters
    ----------
    sample : Sample
    axes : tuple of Axis
        Intervals or spreads.

    Returns
    -------
    (size, n_axes) array
    """
    rng = np.random.default_rng(sample.seed)
    if sample.method == "random":
        unit = rng.random((sample.size, len(axes)))
    else:
        from scipy.stats import qmc

        method = qmc.Sobol if sample.method == "sobol" else qmc.LatinHypercube
        unit = method(len(axes), seed=rng).random(sample.size)
    if sample.correlation:
        unit = correlated(unit, np.array(sample.correlation))
    return np.column_stack([axis.at(unit[:, i]) for i, axis in enumerate(axes)])
