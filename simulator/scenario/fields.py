"""Kinds of fields, and the messages of broken ones, which are made from the fields' own descriptions."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Self

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    TypeAdapter,
    ValidationError,
    ValidationInfo,
    model_validator,
)
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema, ErrorDetails, InitErrorDetails, PydanticCustomError, core_schema

from simulator import units
from simulator.scenario.errors import Problem
from simulator.units import Dimension, Written, as_written


def _python_scalar(value: Any) -> Any:
    # Scenarios made in Python carry NumPy scalars out of sweeps; strict numbers would refuse them.
    return value.item() if isinstance(value, np.generic) else value


Float = Annotated[float, BeforeValidator(_python_scalar), Field(strict=True, allow_inf_nan=False)]

Int = Annotated[int, BeforeValidator(_python_scalar), Field(strict=True)]

LEAST, LARGEST = 1e-30, 1e30  # of what the equations take: their powers and products are numbers
SHORTEST, LONGEST = 1e-100, 1e100  # of times


def _between(low: float, high: float) -> AfterValidator:
    text = f"must be a number from {low:g} to {high:g}".replace("e+", "e")

    def bounded(value: float) -> float:
        if not low <= value <= high:
            raise PydanticCustomError("refused", "{text}", {"text": text})
        return value

    return AfterValidator(bounded)


_AnyPositive = Annotated[Float, Field(gt=0, description="a number > 0")]

Number = Annotated[Float, Field(description="a number"), _between(-LARGEST, LARGEST)]

Positive = Annotated[_AnyPositive, _between(LEAST, LARGEST)]

NonNegative = Annotated[Float, Field(ge=0, description="a number >= 0"), _between(0.0, LARGEST)]


@dataclass(frozen=True)
class Measured:
    """Marks a number that may also be a text with a unit of a dimension, where the scenario has [scales].

    The scales are in the validation context; the number comes out dimensionless, as a `Written`.
    """

    dimension: Dimension

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> CoreSchema:
        return core_schema.with_info_wrap_validator_function(
            self._read,
            handler(source),
            serialization=core_schema.plain_serializer_function_ser_schema(as_written),
        )

    def _read(self, value: Any, handler: Callable[[Any], float], info: ValidationInfo) -> float:
        if not isinstance(value, str):
            return handler(value)
        scales = (info.context or {}).get("scales")
        if scales is None:
            if units.has_unit(value):
                raise PydanticCustomError("no_scales", "no_scales")
            return handler(value)
        try:
            return Written(handler(units.read(value, self.dimension, scales)), value)
        except ValueError as error:
            reason = _size_in(error) if isinstance(error, ValidationError) else str(error)
            found = {"name": self.dimension.name, "example": self.dimension.example, "reason": reason}
            raise PydanticCustomError("unit", "unit", found) from None


def _size_in(error: ValidationError) -> str:
    """What is wrong with the size of a number that was read from a text; empty where it is not that."""
    first = error.errors(include_url=False)[0]
    return f"in numbers it {first['msg']}" if first["type"] == "refused" else ""


# A field declares what it measures by being one of these, or by a `Measured` of its own; nothing else is
# needed for it to accept units.
Time = Annotated[_AnyPositive, Measured(units.TIME), _between(SHORTEST, LONGEST)]

Radius = Annotated[Positive, Measured(units.RADIUS)]

Thickness = Annotated[Positive, Measured(units.THICKNESS)]

Modulus = Annotated[Positive, Measured(units.MODULUS)]

Permittivity = Annotated[Positive, Measured(units.PERMITTIVITY)]

Pressure = Annotated[NonNegative, Measured(units.PRESSURE)]

Volume = Annotated[NonNegative, Measured(units.VOLUME)]

Voltage = Annotated[Number, Measured(units.VOLTAGE)]

ElectricField = Annotated[Positive, Measured(units.FIELD)]

ElectricCharge = Annotated[Number, Measured(units.CHARGE)]

Resistance = Annotated[Positive, Measured(units.RESISTANCE)]

Current = Annotated[Positive, Measured(units.CURRENT)]

Conductivity = Annotated[Positive, Measured(units.CONDUCTIVITY)]

Viscosity = Annotated[Positive, Measured(units.VISCOSITY)]

Text = Annotated[str, Field(strict=True, pattern=r"\S", description="a non-empty text")]


def not_empty(items: Any) -> Any:
    """Refuse what has no items."""
    # Not `min_length`: pydantic counts the valid items, and complains twice where the only one is bad.
    if not items:
        raise PydanticCustomError("empty", "empty")
    return items


def absolute(path: str, info: ValidationInfo) -> str:
    """A path that a file names, made absolute: it starts at the folder of that file."""
    return os.path.abspath(os.path.join((info.context or {}).get("folder", ""), path))


@dataclass(frozen=True)
class Chosen:
    """Marks a union whose branch `function` chooses, so that only errors of that branch are reported."""

    function: Callable[[Any, ValidationInfo], Any]

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> CoreSchema:
        return core_schema.with_info_plain_validator_function(self.function)


class ByName:
    """Chooses between one number of a `kind`, and such numbers by balloon name.

    `dimension` is what the numbers measure, None where they never have a unit.
    """

    def __init__(self, kind: Any) -> None:
        self.kind = kind
        self.one: TypeAdapter[float] = TypeAdapter(kind)
        self.several: TypeAdapter[dict[str, float]] = TypeAdapter(
            Annotated[dict[str, kind], AfterValidator(not_empty)]
        )
        marks = getattr(kind, "__metadata__", ())
        self.dimension = next((mark.dimension for mark in marks if isinstance(mark, Measured)), None)

    def __call__(self, value: Any, info: ValidationInfo) -> float | dict[str, float]:
        """The number or the numbers. Raises ValidationError."""
        chosen: TypeAdapter[Any] = self.several if isinstance(value, Mapping) else self.one
        found: float | dict[str, float] = chosen.validate_python(value, context=info.context)
        return found


class Frozen(BaseModel):
    """A table of the file; its problems are reported in the words of the file."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    @model_validator(mode="wrap")
    @classmethod
    def _in_our_words(cls, value: Any, handler: Callable[[Any], Self]) -> Self:
        try:
            return handler(value)
        except ValidationError as error:
            lines = [_in_our_words(line, cls) for line in error.errors(include_url=False)]
            raise ValidationError.from_exception_data(cls.__name__, lines) from None


def refused(text: str, value: object, *loc: int | str) -> ValidationError:
    """The error whose message is `text`, of a value at a place `loc` of its table."""
    return ValidationError.from_exception_data("", [_line(text, value, loc)])


def problems_of(
    error: ValidationError, key: Callable[[tuple[int | str, ...]], str] = lambda loc: ".".join(map(str, loc))
) -> list[Problem]:
    """What a validation found wrong.

    Parameters
    ----------
    error : ValidationError
        Of a `Frozen` table, in the words of the file.
    key : callable, optional
        Makes the key of a message from the place of a problem in the table. Default: its parts with dots.
    """
    return [Problem(key(line["loc"]), line["input"], line["msg"]) for line in error.errors()]


def _line(text: str, value: object, loc: tuple[int | str, ...]) -> InitErrorDetails:
    reason = PydanticCustomError("refused", "{text}", {"text": text})
    return InitErrorDetails(type=reason, loc=loc, input=value)


def _one_number(field: FieldInfo | None) -> str:
    """What is allowed for one of several numbers; numbers by name say it before their first comma."""
    allowed = (field.description if field and field.description else "").split(",")[0]
    return allowed if allowed.startswith("a number") else "a number"


def _in_our_words(error: ErrorDetails, model: type[BaseModel]) -> InitErrorDetails:
    """A pydantic error in the words of the scenario file."""
    loc, value = error["loc"], error["input"]
    fields = {field.alias or name: field for name, field in model.model_fields.items()}
    if not loc:
        text = f"must be a table of {', '.join(fields)}"
    elif len(loc) == 1 and loc[0] in fields:
        text = f"must be {fields[str(loc[0])].description}"
    else:  # a number by name
        text = f"must be {_one_number(fields.get(str(loc[0])))}"
    match error["type"]:
        case "refused":
            text = error["msg"]
        case "missing":
            value, text = None, f"is missing, {text}"
        case "extra_forbidden" | "invalid_key":
            text = f"unknown key, allowed here: {', '.join(fields)}"
        case "no_scales":
            text = f"{text}; a unit needs [scales]"
        case "unit":
            found = error["ctx"]
            if "a number" in text:
                text = f'{text.split(",")[0].replace("a number", found["name"])} such as "{found["example"]}"'
            text = f"{text}; {found['reason']}" if found["reason"] else text
        case "finite_number":
            text = text.replace("a number", "a finite number")
        case "tuple_type" if isinstance(value, Mapping) and f"[[{loc[0]}]]" in text:
            text = f"{text}; [{loc[0]}] is a single table, write [[{loc[0]}]]"
        case "value_error":  # a table that cannot be read
            loc, value, text = ("table",), value["table"], str(error["ctx"]["error"])
    return _line(text, value, loc)
