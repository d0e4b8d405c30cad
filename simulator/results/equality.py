"""Whether two results are the same: field by field, arrays by their elements."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np


def same(one: Any, other: Any, but: Collection[str] = ()) -> bool:
    """Whether two values are equal; NaN equals NaN.

    Parameters
    ----------
    one, other
        Dataclasses, tuples, arrays or plain values.
    but : collection of str
        Fields of the dataclass that do not matter.
    """
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        first, second = np.asarray(one), np.asarray(other)
        return first.shape == second.shape and np.array_equal(
            first, second, equal_nan=first.dtype.kind == "f" and second.dtype.kind == "f"
        )
    if type(one) is not type(other):
        return False
    if isinstance(one, tuple):
        return len(one) == len(other) and all(same(a, b) for a, b in zip(one, other, strict=True))
    if is_dataclass(one) and not isinstance(one, type):
        names = [field.name for field in fields(one) if field.name not in but]
        return all(same(getattr(one, name), getattr(other, name)) for name in names)
    if isinstance(one, float):
        return bool(one == other or (one != one and other != other))
    return bool(one == other)
