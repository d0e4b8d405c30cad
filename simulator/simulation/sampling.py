"""At which moments of a step samples are taken."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.model.drive import Leg, VoltageCurve
from simulator.scenario import RecordingByName, Table
from simulator.scenario.steps import periods_of

if TYPE_CHECKING:
    from simulator.scenario import Output, PlayedStep

FloatArray = NDArray[np.float64]

_ONE = 1e-12  # of a period, or a step: moments closer than this are one


def sample_fractions(
    output: Output, step: PlayedStep, legs: Sequence[Leg], lasts: float, last: float = 1.0
) -> FloatArray:
    """Fractions of a step at which samples are taken if all of it would last so long.

    They are those that a scenario asks for, and the corners of the drive: the extremes of sines and
    triangles, the ends of their cycles, and of a table its rows, or, where these are more than `points`,
    the highest and the lowest.

    Parameters
    ----------
    output : Output
    step : PlayedStep
    legs : sequence of Leg
        Those of the whole step.
    lasts : float
        How long all of it would take.
    last : float
        The fraction at which it ends early, if it does.

    Returns
    -------
    (n,) array
        Rising, from 0 to `last`.
    """
    periods = max(periods_of(step), 1.0)
    corners = [np.array([0.0, 1.0]), np.arange(1, math.ceil(periods)) / periods]
    if isinstance(step, Table):
        corners.append(_rows(step, output))
        grid = np.empty(0) if output.rows else _grid(output, 1.0, lasts, last)
    else:
        corners += [leg.start + (leg.end - leg.start) * corners_of(leg) for leg in legs]
        grid = _grid(output, periods_of(step), lasts, last)
    fixed = np.unique(np.concatenate(corners))
    fixed = np.append(fixed[fixed < last - _ONE / periods], last)
    fixed = fixed[np.append(True, np.diff(fixed) > _ONE / periods)]
    grid = grid[grid < last]
    after = np.searchsorted(fixed, grid)
    below, above = fixed[np.maximum(after - 1, 0)], fixed[np.minimum(after, fixed.size - 1)]
    apart = np.minimum(np.abs(grid - below), np.abs(above - grid)) > _ONE / periods
    return np.sort(np.concatenate([fixed, grid[apart]]))


def _grid(output: Output, periods: float, lasts: float, last: float) -> FloatArray:
    """What `[output]` asks for: points of every cycle of a wave, or spread over what is played of a step."""
    if output.every is not None:
        return np.arange(math.floor(last * lasts / output.every * (1.0 + _ONE)) + 1.0) * (
            output.every / lasts
        )
    if periods <= 1.0:
        return np.linspace(0.0, last, output.points)
    intervals = (output.points - 1) * periods
    return np.arange(math.floor(last * intervals * (1.0 + _ONE)) + 1.0) / intervals


def corners_of(leg: Leg) -> FloatArray:
    """Fractions of a leg at which a voltage turns round, or at which it begins and ends."""
    if not isinstance(leg.way, VoltageCurve):
        return leg.waveform.fractions
    way, end = leg.way, float(leg.waveform.values[-1])
    turns = [(quarter - phase) % 1.0 for phase in way.phase for quarter in (0.25, 0.75)]
    moving = np.repeat(way.moves, 2)
    found = np.array(turns)[moving] / end
    return np.asarray(np.concatenate([[0.0], found[found < 1.0], [1.0]]))


def _rows(table: Table, output: Output) -> FloatArray:
    times, given = table.times, table.table
    fractions = times / times[-1]
    if output.rows or (output.every is None and times.size <= output.points):
        return np.asarray(fractions)
    voltages = given.voltages.values() if isinstance(given, RecordingByName) else [table.voltages]
    ends = [place for values in voltages for place in (np.argmax(values), np.argmin(values))]
    return np.asarray(fractions[ends])
