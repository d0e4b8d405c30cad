"""The steps of a history: what each kind takes, how long it lasts, and cycles unrolled."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, ConfigDict, Field, PlainSerializer, PrivateAttr, ValidationInfo

from simulator import units
from simulator.scenario.fields import (
    ByName,
    Chosen,
    ElectricCharge,
    ElectricField,
    Frozen,
    Int,
    Measured,
    Number,
    Positive,
    Pressure,
    Time,
    Voltage,
    not_empty,
    refused,
)
from simulator.scenario.reading import column, read_table
from simulator.scenario.recordings import Recording, RecordingByName, recorded
from simulator.units import as_written

Valve = Annotated[Literal["closed", "open"], Field(description='"closed" or "open"')]


Voltages = Annotated[
    float | dict[str, float],
    Chosen(ByName(Voltage)),
    PlainSerializer(as_written),
    Field(description="a number, or a table of one or more numbers by balloon name"),
]


Charges = Annotated[
    float | dict[str, float],
    Chosen(ByName(ElectricCharge)),
    PlainSerializer(as_written),
    Field(description="a number, or a table of one or more numbers by balloon name"),
]


Stretches = Annotated[
    float | dict[str, float] | None,
    Chosen(ByName(Positive)),
    Field(description="a number > 0, or a table of one or more numbers > 0 by balloon name"),
]


Fields = Annotated[
    float | dict[str, float] | None,
    Chosen(ByName(ElectricField)),
    PlainSerializer(as_written),
    Field(description="a number > 0, or a table of one or more numbers > 0 by balloon name"),
]


PositivePressure = Annotated[Positive, Measured(units.PRESSURE)]


class Until(Frozen):
    """What ends a step before its time, whichever comes first.

    A limit point (once its snap has landed), the loss of a balloon's sphericity, or a quantity that takes a
    value: the stretch or the true field of a balloon, or the excess pressure.
    """

    event: Annotated[
        Literal["limit_point", "loss_of_sphericity"] | None,
        Field(description='"limit_point" or "loss_of_sphericity"'),
    ] = None
    stretch: Stretches = None
    pressure: Annotated[PositivePressure | None, Field(description="a number > 0")] = None
    field: Fields = None


def _until(value: Any, info: ValidationInfo) -> Until | None:
    if value is None:
        return None
    if not isinstance(value, Mapping) or not value:
        raise refused(f"must be {_ENDS_STEP}", value)
    return Until.model_validate(value, context=info.context)


_ENDS_STEP = "a table with one or more of event, stretch, pressure, field"

OptionalUntil = Annotated[Until | None, Chosen(_until), Field(description=_ENDS_STEP)]


class Inflate(Frozen):
    """Excess pressure ramped to `inflate`, valve open."""

    inflate: Pressure
    over: Time = 1.0


class Ramp(Frozen):
    """Voltage ramped linearly to `ramp`: one number for all electrodes, or a number by balloon name."""

    ramp: Voltages
    over: Time = 1.0
    valve: Valve = "closed"
    until: OptionalUntil = None


class Charge(Frozen):
    """Charge ramped linearly to `charge`: one number for all electrodes, or a number by balloon name.

    The voltage follows. Electrodes not named keep the charge they have.
    """

    charge: Charges
    over: Time = 1.0
    valve: Valve = "closed"
    until: OptionalUntil = None


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


class BalloonSine(Frozen):
    """mean + amplitude·sin 2π(t/period + phase) on one balloon; `phase` in periods."""

    mean: Voltage
    amplitude: Voltage
    phase: Number = 0.0


class SineByName(Frozen):
    """Sines of one period, each of the named balloons with its own `BalloonSine`."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, BalloonSine] = Field(init=False)

    period: Time
    cycles: Positive

    @property
    def balloons(self) -> dict[str, BalloonSine]:
        """The sines by balloon name."""
        return self.__pydantic_extra__


def _has_tables(value: Any) -> bool:
    return isinstance(value, Mapping) and any(isinstance(part, Mapping) for part in value.values())


def _sine(value: Any, info: ValidationInfo) -> SineWave | SineByName:
    kind: type[SineWave | SineByName] = SineByName if _has_tables(value) else SineWave
    return kind.model_validate(value, context=info.context)


class Sine(Frozen):
    """Voltages along sines: one for all electrodes, or one by balloon name."""

    sine: Annotated[
        SineWave | SineByName,
        Chosen(_sine),
        Field(description="a table of mean, amplitude, period, cycles, or of period, cycles and balloons"),
    ]
    valve: Valve = "closed"
    until: OptionalUntil = None


class TriangleWave(Frozen):
    """From `low` to `high` in half a period and back in the other half, for `cycles` periods."""

    low: Voltage
    high: Voltage
    period: Time
    cycles: Positive


class BalloonTriangle(Frozen):
    """From `low` to `high` and back on one balloon, ahead by `phase` periods."""

    low: Voltage
    high: Voltage
    phase: Number = 0.0


class TriangleByName(Frozen):
    """Triangle waves of one period, each of the named balloons with its own `BalloonTriangle`."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, BalloonTriangle] = Field(init=False)

    period: Time
    cycles: Positive

    @property
    def balloons(self) -> dict[str, BalloonTriangle]:
        """The triangles by balloon name."""
        return self.__pydantic_extra__


def _triangle(value: Any, info: ValidationInfo) -> TriangleWave | TriangleByName:
    kind: type[TriangleWave | TriangleByName] = TriangleByName if _has_tables(value) else TriangleWave
    return kind.model_validate(value, context=info.context)


class Triangle(Frozen):
    """Voltages along triangle waves: one for all electrodes, or one by balloon name."""

    triangle: Annotated[
        TriangleWave | TriangleByName,
        Chosen(_triangle),
        Field(description="a table of low, high, period, cycles, or of period, cycles and balloons"),
    ]
    valve: Valve = "closed"
    until: OptionalUntil = None


class Table(Frozen):
    """Voltages from CSV files, linear between rows: one for all electrodes, or recordings by balloon name.

    The file is read once, when the scenario is loaded; a path in `table` is absolute from then on.
    """

    table: Annotated[
        str | Recording | RecordingByName,
        Chosen(recorded),
        Field(description="the path of a CSV file with columns time,voltage, or a table with its file"),
    ]
    valve: Valve = "closed"
    until: OptionalUntil = None
    _samples: bytes = PrivateAttr(default=b"")

    def model_post_init(self, context: Any, /) -> None:
        """Read the file."""
        if isinstance(self.table, str):
            self._samples = read_table(self.table, (context or {}).get("scales"))

    @property
    def times(self) -> NDArray[np.float64]:
        """Times of the rows from the start of the step, (n,) read-only; the first is 0.

        Of recordings by name the times of all their rows.
        """
        return column(self._samples, 0) if isinstance(self.table, str) else self.table.times

    @property
    def voltages(self) -> NDArray[np.float64]:
        """Voltages of the rows, (n,) read-only.

        Raises
        ------
        TypeError
            Of recordings by name: each has its own, `table.voltages`.
        """
        if isinstance(self.table, RecordingByName):
            raise TypeError("recordings by name have voltages of their own, see table.voltages")
        return self.table.voltages if isinstance(self.table, Recording) else column(self._samples, 1)


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


def until_of(step: PlayedStep) -> Until | None:
    """What ends a step before its time, if it names anything."""
    return step.until if isinstance(step, Ramp | Charge | Sine | Triangle | Table) else None


def duration(step: PlayedStep) -> float:
    """How long a step lasts, unless its `until` ends it before; a jump takes no time."""
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


def periods_of(step: PlayedStep) -> float:
    """How many periods a sine or triangle has; 0 for any other step."""
    match step:
        case Sine():
            return step.sine.cycles
        case Triangle():
            return step.triangle.cycles
    return 0.0


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
