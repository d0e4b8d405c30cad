"""Distributions and correlations of a sweep file: what samples are drawn from, and what is wrong with it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from simulator.scenario import Problem, Scenario
from simulator.scenario.keys import all_keys
from simulator.scenario.mapping import near, number_and_unit
from simulator.sweep.grammar import CorrelationTable, SampleTable, SpreadTable
from simulator.sweep.plan import Axis
from simulator.sweep.spread import Spread

FloatArray = NDArray[np.float64]


def spread_axis(key: str, table: SpreadTable, scenario: Scenario) -> Axis:
    """What a key is drawn from; where the scenario has to say the mean, that is what it says.

    Of a table with which something is wrong, an axis that nobody uses.
    """
    given = table.mode if table.distribution == "triangular" else table.mean
    written = given or number_and_unit(_value(key, scenario)) or (math.nan, "")
    centre, unit = written
    deviation = table.sd[0] if table.sd is not None else abs(centre) * (table.rel or math.nan)
    low = table.low[0] if table.low is not None else -math.inf
    high = table.high[0] if table.high is not None else math.inf
    spread = Spread(table.distribution, centre, deviation, low, high)
    if not _is_whole(spread):
        return Axis(key, (math.nan, math.nan), unit, spread=spread)
    return Axis(key, spread.ends, unit, spread=spread)


def _value(key: str, scenario: Scenario) -> object:
    """The value of a key; of `balloon.*` that of the first one."""
    known = all_keys(scenario)
    names = [balloon.name for balloon in scenario.balloons]
    return known.get(key, known.get(key.replace(".*.", f".{names[0]}.", 1)))


def _is_whole(spread: Spread) -> bool:
    """Whether numbers can be drawn from a spread."""
    if spread.distribution == "triangular":
        return math.isfinite(spread.high - spread.low) and spread.low <= spread.centre <= spread.high
    positive = spread.distribution == "normal" or spread.centre > 0.0
    return positive and spread.deviation > 0.0 and spread.low < spread.high and math.isfinite(spread.centre)


def wrong_spread(name: str, table: SpreadTable, *, sampled: bool) -> Iterator[Problem]:
    """What is wrong with a distribution by itself; `name` is its key."""
    if not sampled:
        yield Problem(name, None, "is a distribution, which goes with sample")
    quantities = {w: getattr(table, w) for w in ("mean", "sd", "mode", "low", "high")}
    given = {word: value for word, value in quantities.items() if value is not None}
    units = {value[1].strip() for value in given.values()}
    if len(units) > 1:
        yield Problem(name, sorted(units), "must have all its numbers in one unit")
    if table.distribution == "triangular":
        for word in ("low", "high"):
            if word not in given:
                yield Problem(f"{name}.{word}", None, "is missing, a triangular distribution has two ends")
        for word in [word for word in ("mean", "sd") if word in given] + (["rel"] if table.rel else []):
            yield Problem(
                f"{name}.{word}", None, "goes with normal and lognormal; triangular has low, mode, high"
            )
    else:
        if "mode" in given:
            yield Problem(f"{name}.mode", given["mode"][0], "goes with triangular")
        if ("sd" in given) == (table.rel is not None):
            yield Problem(f"{name}.sd", None, "must be given, or rel, and not both")
        if "sd" in given and given["sd"][0] <= 0.0:
            yield Problem(f"{name}.sd", given["sd"][0], "must be > 0")
    if "low" in given and "high" in given and given["low"][0] >= given["high"][0]:
        yield Problem(f"{name}.high", given["high"][0], f"must be larger than low, {given['low'][0]!r}")


def wrong_axis(name: str, axis: Axis, table: SpreadTable) -> Iterator[Problem]:
    """What is wrong with a distribution beside the scenario."""
    spread = axis.spread
    assert spread is not None
    word = "mode" if table.distribution == "triangular" else "mean"
    if math.isnan(spread.centre):
        yield Problem(f"{name}.{word}", None, "is missing: the scenario has no number there")
        return
    units = {v[1].strip() for v in (table.sd, table.low, table.high) if v is not None}
    if units and units != {axis.unit.strip()}:
        yield Problem(
            name, sorted(units), f"must be in the unit of its {word}, {axis.unit.strip() or 'none'}"
        )
    elif not _is_whole(spread):
        what = {
            "triangular": f"must have its {word} between low and high",
            "lognormal": "must have a mean > 0",
        }.get(table.distribution, "must have a mean other than 0 with rel")
        yield Problem(name, spread.centre, what)
    elif table.distribution != "triangular" and not spread.ends[0] < spread.ends[1]:
        yield Problem(name, spread.centre, "is truncated where there is nothing of it")


def wrong_sample(table: SampleTable, keys: Sequence[str], names: Sequence[str]) -> Iterator[Problem]:
    """What is wrong with the correlations and indices of a sample; `names` are the keys in messages."""
    seen = set()
    for number, one in enumerate(table.correlations, start=1):
        for key in one.of:
            if key not in keys:
                said = f"must be varied; {near(key, dict.fromkeys(keys, 0.0))}"
                yield Problem(f"sample.correlations.{number}.of", key, said)
        pair = frozenset(one.of)
        if len(pair) < 2 or pair in seen:
            yield Problem(
                f"sample.correlations.{number}.of", list(one.of), "must be two keys, each pair once"
            )
        seen.add(pair)
    if table.correlations and all(key in keys for one in table.correlations for key in one.of):
        least = float(np.linalg.eigvalsh(_matrix(table.correlations, keys)).min())
        if least <= 1e-12:
            said = f"cannot all be true together: the matrix has an eigenvalue {least:.3g}, must be > 0"
            yield Problem("sample.correlations", None, said)
    if table.correlations and table.indices:
        yield Problem("sample.indices", list(table.indices), "go with independent keys, without correlations")


def matrix_of(correlations: Sequence[CorrelationTable], axes: Sequence[Axis]) -> FloatArray:
    """The correlation matrix of some axes, (n_axes, n_axes)."""
    return _matrix(correlations, [axis.key for axis in axes])


def _matrix(correlations: Sequence[CorrelationTable], keys: Sequence[str]) -> FloatArray:
    found = np.eye(len(keys))
    for one in correlations:
        i, j = (keys.index(key) for key in one.of)
        found[i, j] = found[j, i] = one.value
    return found
