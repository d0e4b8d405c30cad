"""Results as plain data for JSON, and back, exactly: what type a value has is read from the annotations."""

from __future__ import annotations

import math
import types
import typing
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any, get_args, get_origin

import numpy as np


def encoded(value: Any) -> Any:
    """A dataclass, array, tuple or plain value as what strict JSON knows.

    NaN is None, infinities are words, and of an array without elements there is its shape.
    """
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: encoded(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, np.ndarray) and not value.size:
        return {"shape": list(value.shape)}
    if isinstance(value, np.ndarray | np.generic):
        return encoded(value.tolist())
    if isinstance(value, Mapping):
        return {str(key): encoded(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [encoded(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else str(value)
    return value


def decoded(hint: Any, value: Any) -> Any:
    """What `encoded` was given, by its annotation.

    Raises
    ------
    ValueError, TypeError, KeyError
        If the value is not of that type.
    """
    origin = get_origin(hint)
    if origin in (typing.Union, types.UnionType):
        kinds = [kind for kind in get_args(hint) if kind is not type(None)]
        return None if value is None else decoded(kinds[0], value)
    if origin is tuple:
        kinds = list(get_args(hint))
        if kinds[-1] is Ellipsis:
            kinds = kinds[:1] * len(value)
        return tuple(decoded(kind, item) for kind, item in zip(kinds, value, strict=True))
    if origin is np.ndarray:
        (kind,) = get_args(get_args(hint)[1])
        if isinstance(value, dict):
            return np.empty(value["shape"], dtype=kind)
        return np.array(_without_none(value), dtype=kind)
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return {key: decoded(get_args(hint)[1], item) for key, item in value.items()}
    if is_dataclass(hint):
        made: Any = hint
        of = hints_of(hint)
        return made(**{name: decoded(of[name], item) for name, item in value.items()})
    if isinstance(hint, type) and issubclass(hint, Enum):
        return hint(value)
    if hint is float:
        return math.nan if value is None else float(value)
    return value


def hints_of(kind: Any) -> dict[str, Any]:
    """The annotations of a dataclass's fields, as types."""
    from simulator.units import Dimension, Scales

    # What a module imports for its annotations alone.
    known = {"Scenario": Any, "Scales": Scales, "Dimension": Dimension, "ShapeVerdict": Any, "Loop": Any}
    hints = typing.get_type_hints(kind, localns=known)
    return {field.name: hints[field.name] for field in fields(kind)}


def _without_none(value: Any) -> Any:
    """Nested lists in which None is NaN again."""
    if isinstance(value, list):
        return [_without_none(item) for item in value]
    return math.nan if value is None else value
