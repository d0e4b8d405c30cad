"""The steps of a history: what each kind takes, how long it lasts, and cycles unrolled."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, PlainSerializer, PrivateAttr, ValidationInfo

from simulator.scenario.fields import (
    Chosen,
    ElectricCharge,
    Frozen,
    Int,
    Positive,
    Pressure,
    Time,
    Voltage,
    absolute,
    by_name,
    not_empty,
    refused,
)
from simulator.scenario.reading import read_table
from simulator.units import as_written

Valve = Annotated[Literal["closed", "open"], Field(description='"closed" or "open"')]


Voltages = Annotated[
    float | dict[str, float],
    Chosen(by_name(Voltage)),
    PlainSerializer(as_written),
    Field(description="a number, or a table of one or more numbers by balloon name"),
]


Charges = Annotated[
    float | dict[str, float],
    Chosen(by_name(ElectricCharge)),
    PlainSerializer(as_written),
    Field(description="a number, or a table of one or more numbers by balloon name"),
]


class Inflate(Frozen):
    """Excess pressure ramped to `inflate`, valve open."""

    inflate: Pressure
    over: Time = 1.0


class Ramp(Frozen):
    """Voltage ramped linearly to `ramp`: one number for all electrodes, or a number by balloon name."""

    ramp: Voltages
    over: Time = 1.0
    valve: Valve = "closed"


class Charge(Frozen):
    """Charge ramped linearly to `charge`: one number for all electrodes, or a number by balloon name.

    The voltage follows. Electrodes not named keep the charge they have.
    """

    charge: Charges
    over: Time = 1.0
    valve: Valve = "closed"


class Hold(Frozen):
    """Everything kept for the time `hold`."""

    hold: Time
    valve: Valve = "closed"


class Jump(Frozen):
    """Voltage changed to `jump` at once: one number for all electrodes, or a number by balloon name."""

    jump: Voltages
    valve: Valve = "closed"


class SineWave(Frozen):
    """mean + amplitude·sin(2πt/period), for `cycles` periods."""

    mean: Voltage
    amplitude: Voltage
    period: Time
    cycles: Positive


class Sine(Frozen):
    """Voltage of all electrodes along a sine."""

    sine: Annotated[SineWave, Field(description="a table of mean, amplitude, period, cycles")]
    valve: Valve = "closed"


class TriangleWave(Frozen):
    """From `low` to `high` in half a period and back in the other half, for `cycles` periods."""

    low: Voltage
    high: Voltage
    period: Time
    cycles: Positive


class Triangle(Frozen):
    """Voltage of all electrodes along a triangle wave."""

    triangle: Annotated[TriangleWave, Field(description="a table of low, high, period, cycles")]
    valve: Valve = "closed"


class Table(Frozen):
    """Voltage of all electrodes from a CSV file, linear between its rows.

    The file is read once, when the scenario is loaded; `table` is its absolute path from then on.
    """

    table: Annotated[str, AfterValidator(absolute)] = Field(
        strict=True, min_length=1, description="the path of a CSV file with columns time,voltage"
    )
    valve: Valve = "closed"
    # Bytes, because an array comes out of a pickle writeable and has no plain equality.
    _samples: bytes = PrivateAttr(default=b"")

    def model_post_init(self, context: Any, /) -> None:
        """Read the file."""
        self._samples = read_table(self.table, (context or {}).get("scales"))

    @property
    def times(self) -> NDArray[np.float64]:
        """Times of the rows from the start of the step, (n,) read-only; the first is 0."""
        times: NDArray[np.float64] = np.frombuffer(self._samples).reshape(2, -1)[0]
        return times

    @property
    def voltages(self) -> NDArray[np.float64]:
        """Voltages of the rows, (n,) read-only."""
        voltages: NDArray[np.float64] = np.frombuffer(self._samples).reshape(2, -1)[1]
        return voltages


class Cycle(Frozen):
    """The nested `steps` played `cycle` times."""

    cycle: Annotated[Int, Field(ge=1, description="a whole number >= 1")]
    steps: Annotated[tuple[Step, ...], AfterValidator(not_empty), Field(description="one or more steps")]


PlayedStep = Inflate | Ramp | Charge | Hold | Jump | Sine | Triangle | Table

_STEPS: dict[str, type[PlayedStep | Cycle]] = {
    next(iter(kind.model_fields)): kind
    for kind in (Inflate, Ramp, Charge, Hold, Jump, Sine, Triangle, Table, Cycle)
}


def _step(value: Any, info: ValidationInfo) -> PlayedStep | Cycle:
    found = [kind for kind in _STEPS if isinstance(value, Mapping) and kind in value]
    if len(found) == 1:
        return _STEPS[found[0]].model_validate(value, context=info.context)
    has = f", has {' and '.join(found) or 'none'}" if isinstance(value, Mapping) else ""
    raise refused(f"must be a table with exactly one of {', '.join(_STEPS)}{has}", value)


Step = Annotated[PlayedStep | Cycle, Chosen(_step)]


def duration(step: PlayedStep) -> float:
    """How long a step lasts; a jump takes no time."""
    match step:
        case Inflate() | Ramp() | Charge():
            return step.over
        case Hold():
            return step.hold
        case Jump():
            return 0.0
        case Sine():
            return step.sine.period * step.sine.cycles
        case Triangle():
            return step.triangle.period * step.triangle.cycles
        case Table():
            return float(step.times[-1])


def unrolled(steps: Iterable[Step]) -> Iterator[PlayedStep]:
    """Steps in the order they are played, one at a time."""
    for step in steps:
        if isinstance(step, Cycle):
            for _ in range(step.cycle):
                yield from unrolled(step.steps)
        else:
            yield step


def numbered(steps: Iterable[Step], prefix: str) -> Iterator[tuple[str, Step]]:
    """Steps as written, nested ones too, with their dotted keys."""
    for number, step in enumerate(steps, start=1):
        key = f"{prefix}.{number}"
        yield key, step
        if isinstance(step, Cycle):
            yield from numbered(step.steps, f"{key}.steps")
