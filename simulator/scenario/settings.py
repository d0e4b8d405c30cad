"""Tables of a scenario beside its device and steps: samples, real time, integrator."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, PlainSerializer

from simulator.scenario.fields import ByName, Chosen, Current, Float, Frozen, Int, Resistance, Time
from simulator.units import as_written

CHORD = 2e-4
"""How far a chord between two samples may be from the curve, over the range of each quantity."""


class Output(Frozen):
    """Samples wanted: `points` for each step, or for each cycle of a wave, and as many more as keep each
    `chord` on the curve; or one `every` so much time; or those at the `rows` of a table.
    """

    points: Annotated[Int, Field(ge=2, description="a whole number >= 2")] = 101
    every: Annotated[Time | None, Field(description="a number > 0")] = None
    rows: Annotated[bool, Field(strict=True, description="true or false")] = False
    chord: Annotated[Float, Field(ge=1e-5, le=1.0, description="a number from 1e-5 to 1")] = CHORD

    @property
    def on_grid(self) -> bool:
        """Whether no samples are wanted but those of the grid, and corners."""
        return self.every is not None or self.rows or self.chord == 1.0


class Dynamics(Frozen):
    """Balloons that take their time: τ dλ/dt = −g with the relaxation time τ, for all or by balloon name."""

    relaxation_time: Annotated[
        float | dict[str, float],
        Chosen(ByName(Time)),
        PlainSerializer(as_written),
        Field(description="a number > 0, or a table with one for every balloon by name"),
    ]

    def relaxation_of(self, name: str) -> float:
        """The relaxation time of a balloon."""
        return self.relaxation_time[name] if isinstance(self.relaxation_time, dict) else self.relaxation_time


class Supply(Frozen):
    """What is between the sources and the films: a resistance, and the largest current that a source gives.

    For all balloons with electrodes, or by name.
    """

    resistance: Annotated[
        float | dict[str, float],
        Chosen(ByName(Resistance)),
        PlainSerializer(as_written),
        Field(description="a number > 0, or a table with one for every balloon with electrodes by name"),
    ]
    current_limit: Annotated[
        float | dict[str, float] | None,
        Chosen(ByName(Current)),
        PlainSerializer(as_written),
        Field(description="a number > 0, or a table with one for every balloon with electrodes by name"),
    ] = None

    def resistance_of(self, name: str) -> float:
        """The resistance between a balloon's film and its source."""
        return self.resistance[name] if isinstance(self.resistance, dict) else self.resistance

    def current_limit_of(self, name: str) -> float:
        """The largest current of a balloon's source; inf for none."""
        if self.current_limit is None:
            return math.inf
        return self.current_limit[name] if isinstance(self.current_limit, dict) else self.current_limit


class Shape(Frozen):
    """What is done where a balloon would no longer stay a sphere."""

    on_loss: Annotated[
        Literal["record", "stop", "ignore"], Field(description='"record", "stop" or "ignore"')
    ] = "record"


class Solver(Frozen):
    """Settings of the integrator."""

    rtol: Annotated[Float, Field(ge=1e-12, le=1e-1, description="a number from 1e-12 to 0.1")] = 1e-3
