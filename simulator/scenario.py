"""What the user wrote: a scenario file, validated and frozen. No physics happens here.

`load_scenario` is the only door. It reads the grammar of `docs/scenario-format.md` and either returns a
`Scenario` or raises one `ScenarioError` that lists every problem in the words of the file. Each field says
in its `description` what it allows; the messages are made from these, so the two cannot drift apart.
"""

from __future__ import annotations

import json
import math
import os
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PrivateAttr,
    TypeAdapter,
    ValidationError,
    ValidationInfo,
    model_validator,
)
from pydantic_core import CoreSchema, ErrorDetails, InitErrorDetails, PydanticCustomError, core_schema

MAX_SAMPLES = 10_000_000


class Problem(NamedTuple):
    """One thing that is wrong: the dotted key ("" for the whole file), its value (None where it has none),
    and what is allowed.
    """

    key: str
    value: object
    allowed: str


class ScenarioError(ValueError):
    """A scenario that makes no sense. Its text has one line for each problem.

    Attributes
    ----------
    file : str
        The scenario file as it was given, "<dict>" for a dict.
    key, value, allowed
        Of the first problem, see `Problem`.
    problems : tuple of Problem
    """

    def __init__(self, file: str, *problems: Problem) -> None:
        super().__init__(file, *problems)  # as `args`, so that the error survives pickling
        self.file = file
        self.problems = problems
        self.key, self.value, self.allowed = problems[0]

    def __str__(self) -> str:
        return "\n".join(
            _printable(": ".join(part for part in (self.file, _assignment(key, value), allowed) if part))
            for key, value, allowed in self.problems
        )


def _python_scalar(value: Any) -> Any:
    # Scenarios made in Python carry NumPy scalars out of sweeps; strict numbers would refuse them.
    return value.item() if isinstance(value, np.generic) else value


_Float = Annotated[float, BeforeValidator(_python_scalar), Field(strict=True, allow_inf_nan=False)]
_Int = Annotated[int, BeforeValidator(_python_scalar), Field(strict=True)]
Number = Annotated[_Float, Field(description="a number")]
Positive = Annotated[_Float, Field(gt=0, description="a number > 0")]
NonNegative = Annotated[_Float, Field(ge=0, description="a number >= 0")]
Text = Annotated[str, Field(strict=True, pattern=r"\S", description="a non-empty text")]
Valve = Annotated[Literal["closed", "open"], Field(description='"closed" or "open"')]


def _not_empty(items: Any) -> Any:
    # Not `min_length`: pydantic counts the valid items, and complains twice where the only one is bad.
    if not items:
        raise PydanticCustomError("empty", "empty")
    return items


@dataclass(frozen=True)
class _Chosen:
    """Marks a union whose branch `function` chooses, so that only errors of that branch are told."""

    function: Callable[[Any, ValidationInfo], Any]

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> CoreSchema:
        return core_schema.with_info_plain_validator_function(self.function)


def _voltage(value: Any, _: ValidationInfo) -> float | dict[str, float]:
    if isinstance(value, Mapping):
        return _BY_NAME.validate_python(value)
    return _NUMBER.validate_python(value)


_NUMBER: TypeAdapter[float] = TypeAdapter(Number)
_BY_NAME: TypeAdapter[dict[str, float]] = TypeAdapter(
    Annotated[dict[str, Number], AfterValidator(_not_empty)]
)
Voltage = Annotated[
    float | dict[str, float],
    _Chosen(_voltage),
    Field(description="a number, or a table of one or more numbers by balloon name"),
]


class _Frozen(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")

    @model_validator(mode="wrap")
    @classmethod
    def _in_our_words(cls, value: Any, handler: Callable[[Any], Self]) -> Self:
        try:
            return handler(value)
        except ValidationError as error:
            lines = [_in_our_words(line, cls) for line in error.errors(include_url=False)]
            raise ValidationError.from_exception_data(cls.__name__, lines) from None


class Gas(_Frozen):
    """The gas the balloons share; `ambient_pressure` in units of μH/R."""

    ambient_pressure: NonNegative


class Gent(_Frozen):
    """Gent elastomer with the stretch limit `J_lim`."""

    model: Literal["gent"]
    J_lim: Positive


class NeoHookean(_Frozen):
    """Neo-Hookean elastomer."""

    model: Literal["neo-hookean"]


def _elastomer(value: Any, _: ValidationInfo) -> Gent | NeoHookean:
    match value:
        case {"model": "gent"}:
            return Gent.model_validate(value)
        case {"model": "neo-hookean"}:
            return NeoHookean.model_validate(value)
        case {"model": model}:
            raise _refused('must be "gent" or "neo-hookean"', model, "model")
    raise _refused('must be a table such as { model = "gent", J_lim = 100 }', value)


Elastomer = Annotated[Gent | NeoHookean, _Chosen(_elastomer), Field(description="a table with the model")]


class Breakdown(_Frozen):
    """Dielectric breakdown at the true field `field`, in units of √(μ/ε)."""

    field: Positive


class Balloon(_Frozen):
    """One balloon; its numbers are ratios to the reference balloon."""

    name: Annotated[
        str,
        # Names end up in column titles and dotted keys.
        Field(
            strict=True,
            pattern=r"^[^\W\d]\w*$",
            description="a name of letters, digits and _, no digit first",
        ),
    ]
    radius: Positive = 1.0
    thickness: Positive = 1.0
    modulus: Positive = 1.0
    permittivity: Positive = 1.0
    electrodes: Annotated[bool, Field(strict=True, description="true or false")] = False
    breakdown: Annotated[Breakdown | None, Field(description="a table such as { field = 12 }")] = None
    elastomer: Elastomer


class Inflate(_Frozen):
    """Excess pressure ramped to `inflate`, valve open."""

    inflate: NonNegative
    over: Positive = 1.0


class Ramp(_Frozen):
    """Voltage ramped linearly to `ramp`: one number for all electrodes, or a number by balloon name."""

    ramp: Voltage
    over: Positive = 1.0
    valve: Valve = "closed"


class Hold(_Frozen):
    """Everything kept for the time `hold`."""

    hold: Positive
    valve: Valve = "closed"


class Jump(_Frozen):
    """Voltage changed to `jump` at once: one number for all electrodes, or a number by balloon name."""

    jump: Voltage
    valve: Valve = "closed"


class SineWave(_Frozen):
    """mean + amplitude·sin(2πt/period), for `cycles` periods."""

    mean: Number
    amplitude: Number
    period: Positive
    cycles: Positive


class Sine(_Frozen):
    """Voltage of all electrodes along a sine."""

    sine: Annotated[SineWave, Field(description="a table of mean, amplitude, period, cycles")]
    valve: Valve = "closed"


class TriangleWave(_Frozen):
    """From `low` to `high` in half a period and back in the other half, for `cycles` periods."""

    low: Number
    high: Number
    period: Positive
    cycles: Positive


class Triangle(_Frozen):
    """Voltage of all electrodes along a triangle wave."""

    triangle: Annotated[TriangleWave, Field(description="a table of low, high, period, cycles")]
    valve: Valve = "closed"


def _absolute(path: str, info: ValidationInfo) -> str:
    return os.path.abspath(os.path.join((info.context or {}).get("folder", ""), path))


class Table(_Frozen):
    """Voltage of all electrodes from a CSV file, linear between its rows.

    The file is read once, when the scenario is loaded; `table` is its absolute path from then on.
    """

    table: Annotated[str, AfterValidator(_absolute)] = Field(
        strict=True, min_length=1, description="the path of a CSV file with columns time,voltage"
    )
    valve: Valve = "closed"
    # Bytes, because an array comes out of a pickle writeable and has no plain equality.
    _samples: bytes = PrivateAttr(default=b"")

    def model_post_init(self, context: Any, /) -> None:
        """Read the file."""
        self._samples = _read_table(self.table)

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


class Cycle(_Frozen):
    """The nested `steps` played `cycle` times."""

    cycle: Annotated[_Int, Field(ge=1, description="a whole number >= 1")]
    steps: Annotated[tuple[Step, ...], AfterValidator(_not_empty), Field(description="one or more steps")]


PlayedStep = Inflate | Ramp | Hold | Jump | Sine | Triangle | Table
_STEPS: dict[str, type[PlayedStep | Cycle]] = {
    next(iter(kind.model_fields)): kind for kind in (Inflate, Ramp, Hold, Jump, Sine, Triangle, Table, Cycle)
}


def _step(value: Any, info: ValidationInfo) -> PlayedStep | Cycle:
    found = [kind for kind in _STEPS if isinstance(value, Mapping) and kind in value]
    if len(found) == 1:
        return _STEPS[found[0]].model_validate(value, context=info.context)
    has = f", has {' and '.join(found) or 'none'}" if isinstance(value, Mapping) else ""
    raise _refused(f"must be a table with exactly one of {', '.join(_STEPS)}{has}", value)


Step = Annotated[PlayedStep | Cycle, _Chosen(_step)]


class Output(_Frozen):
    """Samples wanted: `points` for each step, or one `every` so much time."""

    points: Annotated[_Int, Field(ge=2, description="a whole number >= 2")] = 101
    every: Annotated[Positive | None, Field(description="a number > 0")] = None


class Solver(_Frozen):
    """Settings of the integrator."""

    rtol: Annotated[_Float, Field(ge=1e-12, le=1e-1, description="a number from 1e-12 to 0.1")] = 1e-4


class Scenario(_Frozen):
    """A whole scenario, as returned by `load_scenario`.

    Two scenarios are equal when they ask for the same run, whatever `file` they came from.
    """

    title: Text
    source: Annotated[Text | None, Field(description="a non-empty text")] = None
    gas: Annotated[Gas, Field(description="a table with ambient_pressure")]
    balloons: Annotated[tuple[Balloon, ...], AfterValidator(_not_empty)] = Field(
        alias="balloon", description="one or more [[balloon]] tables"
    )
    steps: Annotated[tuple[Step, ...], AfterValidator(_not_empty)] = Field(
        alias="step", description="one or more [[step]] tables"
    )
    output: Annotated[Output, Field(description="a table with points or every")] = Output()
    solver: Annotated[Solver, Field(description="a table with rtol")] = Solver()
    _file: str = PrivateAttr(default="<dict>")

    def model_post_init(self, context: Any, /) -> None:
        """Remember where the scenario came from."""
        self._file = (context or {}).get("file", "<dict>")

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Scenario) and dict(self) == dict(other)

    @property
    def file(self) -> str:
        """Where the scenario came from, for messages; "<dict>" for a dict."""
        return self._file

    @property
    def electroded(self) -> tuple[str, ...]:
        """Names of the balloons with electrodes, in the order of the file."""
        return tuple(balloon.name for balloon in self.balloons if balloon.electrodes)

    def played_steps(self) -> Iterator[PlayedStep]:
        """Steps in the order they are played, cycles unrolled, one at a time."""
        return _unrolled(self.steps)

    def to_dict(self) -> dict[str, Any]:
        """The scenario in the grammar of the file, defaults left out; tables by their absolute path.

        `load_scenario(scenario.to_dict()) == scenario`.
        """
        return self.model_dump(mode="json", by_alias=True, exclude_unset=True)


def load_scenario(source: str | os.PathLike[str] | Mapping[str, Any]) -> Scenario:
    """Read and check a scenario.

    Parameters
    ----------
    source : path or mapping
        A TOML file, or its content as a mapping. Paths of tables are relative to the folder of the
        file, for a mapping to the current directory.

    Raises
    ------
    ScenarioError
        With every problem found: file, key, value and what is allowed.

    Examples
    --------
    >>> scenario = load_scenario({
    ...     "title": "One balloon",
    ...     "gas": {"ambient_pressure": 1},
    ...     "balloon": [{"name": "a", "elastomer": {"model": "neo-hookean"}}],
    ...     "step": [{"inflate": 0.5}],
    ... })
    >>> scenario.balloons[0].radius
    1.0
    """
    data: Mapping[str, Any]
    if isinstance(source, Mapping):
        file, folder, data = "<dict>", "", source
    else:
        file = os.fspath(source)
        folder = os.path.dirname(file)
        try:
            data = _read_toml(file)
        except ValueError as error:
            raise ScenarioError(file, Problem("", None, str(error))) from None
    try:
        scenario = Scenario.model_validate(data, context={"file": file, "folder": folder})
    except ValidationError as error:
        problems = [Problem(_dotted(e["loc"], data), e["input"], e["msg"]) for e in error.errors()]
    except RecursionError:
        problems = [Problem("step", None, "is nested too deeply")]
    else:
        problems = [*_disagreements(scenario)]
        if not problems:
            return scenario
    raise ScenarioError(file, *problems)


def duration(step: PlayedStep) -> float:
    """How long a step lasts; a jump takes no time."""
    match step:
        case Inflate() | Ramp():
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


def _unrolled(steps: Iterable[Step]) -> Iterator[PlayedStep]:
    for step in steps:
        if isinstance(step, Cycle):
            for _ in range(step.cycle):
                yield from _unrolled(step.steps)
        else:
            yield step


def _read_text(path: str) -> str:
    try:
        with open(path, "rb") as stream:
            return stream.read().decode("utf-8-sig")  # spreadsheets and Windows put a BOM in front
    except OSError as error:
        raise ValueError(f"cannot be read, {str(error.strerror).lower()}") from None
    except UnicodeDecodeError as error:
        raise ValueError(f"must be text in UTF-8, byte {error.start} is not") from None


def _read_toml(file: str) -> dict[str, Any]:
    text = _read_text(file)
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"must be TOML: {error}") from None


def _read_table(path: str) -> bytes:
    """Times, then voltages, as float64."""
    # Two numbers a row need no csv module, and 1e5 rows are read in half the time without it.
    rows = [(number, row) for number, row in enumerate(_read_text(path).splitlines(), start=1) if row.strip()]
    header = [cell.strip(' "') for cell in rows[0][1].split(",")] if rows else []
    if sorted(header) != ["time", "voltage"]:
        found = f"has {_short(rows[0][1])}" if rows else "is empty"
        raise ValueError(f"must have the header time,voltage, {found}")
    if len(rows := rows[1:]) < 2:
        raise ValueError(f"must have at least two rows below the header, has {len(rows)}")
    columns = np.array([_two_numbers(row) for _, row in rows]).T
    times, voltages = columns if header[0] == "time" else columns[::-1]
    starts = np.arange(times.size) == 0
    for rule, broken in (
        ("must be two finite numbers", ~np.isfinite(columns).all(axis=0)),
        ("time must start at 0", starts & (times != 0.0)),
        ("time must increase", ~starts & (times <= np.roll(times, 1))),
    ):
        if broken.any():
            number, row = rows[int(broken.argmax())]
            raise ValueError(f"row {number}: {rule}, is {_short(row.strip())}")
    return np.array([times, voltages]).tobytes()


def _two_numbers(row: str) -> tuple[float, float]:
    try:
        first, second = row.split(",")
        return float(first.strip(' "')), float(second.strip(' "'))
    except ValueError:
        return math.nan, math.nan


def _disagreements(scenario: Scenario) -> Iterator[Problem]:
    """What no single field can see."""
    names = [balloon.name for balloon in scenario.balloons]
    electroded = scenario.electroded
    for index, balloon in enumerate(scenario.balloons):
        if (first := names.index(balloon.name)) < index:
            allowed = f"must be unique, balloon {first + 1} has this name too"
            yield Problem(f"balloon.{index + 1}.name", balloon.name, allowed)
        if balloon.breakdown and not balloon.electrodes:
            key = f"balloon.{balloon.name}.breakdown"
            yield Problem(key, balloon.breakdown.model_dump(), "needs electrodes = true on this balloon")
    for key, step in _numbered(scenario.steps, "step"):
        if isinstance(step, Inflate | Hold | Cycle):
            continue
        kind = next(iter(type(step).model_fields))
        voltage = getattr(step, kind)
        if not electroded:
            value = voltage.model_dump() if isinstance(voltage, BaseModel) else voltage
            yield Problem(f"{key}.{kind}", value, "needs a balloon with electrodes = true, there is none")
        elif isinstance(voltage, dict):
            for name in (name for name in voltage if name not in electroded):
                lack = "has no electrodes" if name in names else "no such balloon"
                allowed = f"{lack}, must be one of {', '.join(electroded)}"
                yield Problem(f"{key}.{kind}.{name}", voltage[name], allowed)
    output = scenario.output
    if output.every is not None and "points" in output.model_fields_set:
        yield Problem("output", output.model_dump(), "must have points or every, not both")
    elif _samples(scenario.steps, output) > MAX_SAMPLES:
        key, value = ("points", output.points) if output.every is None else ("every", output.every)
        allowed = f"must ask for at most {MAX_SAMPLES:,} samples over the whole scenario"
        yield Problem(f"output.{key}", value, allowed)


def _numbered(steps: Iterable[Step], prefix: str) -> Iterator[tuple[str, Step]]:
    for number, step in enumerate(steps, start=1):
        key = f"{prefix}.{number}"
        yield key, step
        if isinstance(step, Cycle):
            yield from _numbered(step.steps, f"{key}.steps")


def _samples(steps: Iterable[Step], output: Output) -> float:
    total = 0.0
    for step in steps:
        if isinstance(step, Cycle):
            # More repetitions than samples allowed are too many already, and may not fit a float.
            total += min(step.cycle, MAX_SAMPLES + 1) * _samples(step.steps, output)
        elif isinstance(step, Jump):
            total += 2
        else:
            total += output.points if output.every is None else duration(step) / output.every + 1
    return total


def _refused(text: str, value: object, *loc: int | str) -> ValidationError:
    return ValidationError.from_exception_data("", [_line(text, value, loc)])


def _line(text: str, value: object, loc: tuple[int | str, ...]) -> InitErrorDetails:
    reason = PydanticCustomError("refused", "{text}", {"text": text})
    return InitErrorDetails(type=reason, loc=loc, input=value)


def _in_our_words(error: ErrorDetails, model: type[BaseModel]) -> InitErrorDetails:
    """A pydantic error in the words of the scenario file."""
    loc, value = error["loc"], error["input"]
    fields = {field.alias or name: field for name, field in model.model_fields.items()}
    if not loc:
        text = f"must be a table of {', '.join(fields)}"
    elif len(loc) == 1 and loc[0] in fields:
        text = f"must be {fields[str(loc[0])].description}"
    else:  # a voltage by name
        text = "must be a number"
    match error["type"]:
        case "refused":
            text = error["msg"]
        case "missing":
            value, text = None, f"is missing, {text}"
        case "extra_forbidden" | "invalid_key":
            text = f"unknown key, allowed here: {', '.join(fields)}"
        case "finite_number":
            text = text.replace("a number", "a finite number")
        case "value_error":  # a table that cannot be read
            loc, value, text = ("table",), value["table"], str(error["ctx"]["error"])
    return _line(text, value, loc)


def _dotted(loc: tuple[int | str, ...], data: Mapping[str, Any]) -> str:
    parts = [str(part + 1) if isinstance(part, int) else part for part in loc]
    if len(loc) > 2 and loc[0] == "balloon" and isinstance(data["balloon"], list | tuple):
        names = [balloon.get("name") if isinstance(balloon, Mapping) else None for balloon in data["balloon"]]
        name = names[int(loc[1])]
        if isinstance(name, str) and name.isidentifier() and names.count(name) == 1:
            parts[1] = name
    return ".".join(parts)


def _assignment(key: str, value: object) -> str:
    if value is None:
        return key
    number = isinstance(value, float)  # JSON has other names for nan and inf than TOML
    text = str(value) if number else json.dumps(value, ensure_ascii=False, skipkeys=True, default=str)
    return f"{key} = {_short(text)}"


def _short(text: str) -> str:
    return text if len(text) <= 80 else f"{text[:79]}…"


def _printable(line: str) -> str:
    # Line breaks and terminal codes can hide in any text of the user's.
    return "".join(letter if letter.isprintable() else f"\\u{ord(letter):04x}" for letter in line)
