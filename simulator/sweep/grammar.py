"""The tables of a sweep file, as pydantic reads them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationInfo

from simulator.scenario.fields import Chosen, Float, Frozen, Int, Text, refused
from simulator.scenario.mapping import number_and_unit
from simulator.sweep.plan import Value


def _bound(value: Any, _: ValidationInfo) -> tuple[float, str]:
    found = number_and_unit(value)
    if found is None or not np.isfinite(found[0]):
        raise refused('must be a finite number, or a text such as "2 kPa"', value)
    return found


Bound = Annotated[tuple[float, str], Chosen(_bound), Field(description='a number, or a text such as "2 kPa"')]


class Range(Frozen):
    """Values `from` … `to`, both included."""

    start: Annotated[Bound, Field(alias="from", description='a number, or a text such as "2 kPa"')]
    to: Bound
    points: Annotated[Int | None, Field(ge=2, description="a whole number >= 2")] = None
    spacing: Annotated[Literal["linear", "log"], Field(description='"linear" or "log"')] = "linear"


class SpreadTable(Frozen):
    """A distribution that a sample is drawn from."""

    distribution: Annotated[
        Literal["normal", "lognormal", "triangular"],
        Field(description='"normal", "lognormal" or "triangular"'),
    ] = "normal"
    mean: Annotated[Bound | None, Field(description='a number, or a text such as "2 kPa"')] = None
    sd: Annotated[Bound | None, Field(description='a number > 0, or a text such as "2 kPa"')] = None
    rel: Annotated[Float | None, Field(gt=0, description="a number > 0")] = None
    mode: Annotated[Bound | None, Field(description='a number, or a text such as "2 kPa"')] = None
    low: Annotated[Bound | None, Field(description='a number, or a text such as "2 kPa"')] = None
    high: Annotated[Bound | None, Field(description='a number, or a text such as "2 kPa"')] = None


_OF_SPREADS = ("distribution", "mean", "sd", "rel", "mode", "low", "high")


def _axis(value: Any, _: ValidationInfo) -> Range | SpreadTable | tuple[Value, ...]:
    if isinstance(value, Mapping):
        kind = SpreadTable if value and all(key in _OF_SPREADS for key in value) else Range
        if any(key in _OF_SPREADS for key in value) and not {"from", "to"} & set(value):
            kind = SpreadTable
        return kind.model_validate(value)
    if not isinstance(value, list | tuple | np.ndarray):
        raise refused(
            "must be a list of values, or a table such as { from = 0.1, to = 1, points = 10 }", value
        )
    items = [item.item() if isinstance(item, np.generic) else item for item in value]
    if not items:
        raise refused("must have one or more values", items)
    kinds = {"number" if number_and_unit(i) and not isinstance(i, str) else type(i).__name__ for i in items}
    if not kinds <= {"number"} and kinds not in ({"str"}, {"bool"}):
        raise refused("must be all numbers, all texts or all true or false", items)
    values: tuple[Value, ...] = tuple(float(i) for i in items) if kinds == {"number"} else tuple(items)
    if not all(np.isfinite(v) for v in values if isinstance(v, float)):
        raise refused("must be finite numbers", items)
    if len(set(values)) < len(values):
        raise refused("must not have a value twice", items)
    return values


Values = Annotated[
    Range | SpreadTable | tuple[Value, ...], Chosen(_axis), Field(description="a list or a table")
]


class CorrelationTable(Frozen):
    """How two keys are correlated."""

    of: Annotated[
        tuple[Text, Text], Field(description='two keys such as ["balloon.a.radius", "balloon.b.radius"]')
    ]
    value: Annotated[Float, Field(gt=-1, lt=1, description="a number between -1 and 1")]


class SampleTable(Frozen):
    """Points drawn from the intervals and distributions of `[vary]` instead of their product."""

    method: Annotated[
        Literal["sobol", "latin-hypercube", "random"],
        Field(description='"sobol", "latin-hypercube" or "random"'),
    ]
    size: Annotated[Int, Field(ge=1, description="a whole number >= 1")]
    seed: Annotated[Int, Field(ge=0, description="a whole number >= 0")] = 0
    correlations: Annotated[
        tuple[CorrelationTable, ...],
        Field(description='a list of tables such as { of = ["gas.chamber", "step.1.inflate"], value = 0.5 }'),
    ] = ()
    indices: Annotated[tuple[Text, ...], Field(description="a list of columns of numbers")] = ()


class PastTable(Frozen):
    """A ramp to `times` the voltage of the first limit point on it."""

    times: Annotated[Float, Field(gt=1, description="a number > 1")]


class RecordTable(Frozen):
    """What is recorded of each run beyond what always is."""

    limit_points: Annotated[Int, Field(ge=0, le=100, description="a whole number from 0 to 100")] = 2
    sensitivities: Annotated[
        bool | tuple[str, ...], Field(description="true, false or a list of keys of the scenario")
    ] = False
    shapes: Annotated[bool, Field(strict=True, description="true or false")] = False
    margins: Annotated[bool, Field(strict=True, description="true or false")] = False


class SweepFile(Frozen):
    """The sweep file as written."""

    title: Annotated[Text | None, Field(description="a non-empty text")] = None
    scenario: Annotated[str, Field(strict=True, min_length=1, description="the path of a scenario file")]
    sample: Annotated[
        SampleTable | None, Field(description="a table of method, size, seed, correlations, indices")
    ] = None
    vary: Annotated[
        dict[str, Values], Field(min_length=1, description="a table with one or more keys of the scenario")
    ]
    past_limit_point: Annotated[
        dict[str, PastTable] | None,
        Field(min_length=1, max_length=1, description='one key, such as "step.2.ramp" = { times = 1.001 }'),
    ] = None
    record: Annotated[
        RecordTable, Field(description="a table with limit_points, sensitivities, shapes, margins")
    ] = RecordTable()
