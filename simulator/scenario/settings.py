"""Tables of a scenario beside its device and steps: samples, real time, integrator."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, PlainSerializer

from simulator.scenario.fields import ByName, Chosen, Current, Float, Frozen, Int, Resistance, Time, Viscosity
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


_FOR_EACH = "a number > 0, or a table with one for every balloon by name"


class Dynamics(Frozen):
    """Balloons that take their time: τ dλ/dt = −g with the relaxation time τ, for all or by balloon name.

    Or with the `viscosity` of the film, 12η λ⁻² dλ/dt = −g.
    """

    relaxation_time: Annotated[
        float | dict[str, float] | None,
        Chosen(ByName(Time)),
        PlainSerializer(as_written),
        Field(description=_FOR_EACH),
    ] = None
    viscosity: Annotated[
        float | dict[str, float] | None,
        Chosen(ByName(Viscosity)),
        PlainSerializer(as_written),
        Field(description=_FOR_EACH),
    ] = None

    def friction_of(self, name: str) -> tuple[float, float]:
        """What slows a balloon down, c λⁿ dλ/dt = −g: c and n."""
        if self.relaxation_time is not None:
            return _of(self.relaxation_time, name), 0.0
        assert self.viscosity is not None
        return 12.0 * _of(self.viscosity, name), -2.0


def _of(given: float | dict[str, float], name: str) -> float:
    """The number of a balloon, of one for all or one for each."""
    return given[name] if isinstance(given, dict) else given


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
        return _of(self.resistance, name)

    def current_limit_of(self, name: str) -> float:
        """The largest current of a balloon's source; inf for none."""
        return math.inf if self.current_limit is None else _of(self.current_limit, name)


class Shape(Frozen):
    """What is done where a balloon would no longer stay a sphere."""

    on_loss: Annotated[
        Literal["record", "stop", "ignore"], Field(description='"record", "stop" or "ignore"')
    ] = "record"


class Solver(Frozen):
    """Settings of the integrator."""

    rtol: Annotated[Float, Field(ge=1e-12, le=1e-1, description="a number from 1e-12 to 0.1")] = 1e-3
