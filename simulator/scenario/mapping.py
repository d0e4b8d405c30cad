"""The nested mapping of a scenario file: its values by dotted key, as in error messages.

In `gas.ambient_pressure` or `step.2.ramp`, balloons go by name (`balloon.*` is all of them) and steps by
number from 1. The mapping is taken as it is, so a key that the grammar gains needs nothing here.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator, Mapping
from typing import Any

_QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)(\s*[^\d\s.].*)?")


def quantity(value: object) -> tuple[float, str] | None:
    """The number and the unit of a value such as 2.5 or "2.5 kPa"; None for what is no number."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return float(value), ""
    found = _QUANTITY.fullmatch(value) if isinstance(value, str) else None
    return (float(found[1]), found[2] or "") if found else None


def with_values(scenario: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """A scenario's mapping with some keys set to other values; the given one is left as it is.

    Raises
    ------
    KeyError
        If a key leads nowhere; its argument is the key.
    """
    changed: dict[str, Any] = _copied(scenario)
    for key, value in values.items():
        for table, name in _places(changed, key):
            table[name] = _whole(value) if _may_be_whole(_in(table, name)) else value
    return changed


def _may_be_whole(old: Any) -> bool:
    """Whether a key may hold a whole number that may not become a float: `cycle = 3`, not 3.0."""
    return old is None or (isinstance(old, int) and not isinstance(old, bool))


def _whole(value: Any) -> Any:
    """A float without a fraction as a whole number; a key that holds a float takes either."""
    exact = isinstance(value, float) and value.is_integer() and abs(value) < 2.0**53
    return int(value) if exact else value


def _copied(value: Any) -> Any:
    """Tables and lists of a mapping, anew; what they hold, as it is."""
    if isinstance(value, Mapping):
        return {key: _copied(item) for key, item in value.items()}
    return [_copied(item) for item in value] if isinstance(value, list | tuple) else value


def value_at(scenario: Mapping[str, Any], key: str) -> Any:
    """The value of a key in a scenario's mapping, None where it is not written. Raises KeyError."""
    return _in(*next(_places(_copied(scenario), key)))


def _in(table: Any, name: Any) -> Any:
    return table[name] if isinstance(table, list) else table.get(name)


def _places(scenario: dict[str, Any], key: str) -> Iterator[tuple[Any, Any]]:
    """The tables (or lists of numbers) that hold a key, and its name (or place) in them."""
    *way, name = key.split(".")
    if not way or not all([*way, name]):
        raise KeyError(key)
    for table in _tables(scenario, way, key):
        place: str | int = name
        if isinstance(table, list):
            if not (name.isdecimal() and 1 <= int(name) <= len(table)):
                raise KeyError(key)
            place = int(name) - 1
        if isinstance(_in(table, place), dict | list):
            raise KeyError(key)
        yield table, place


def _tables(table: Any, way: list[str], key: str) -> Iterator[Any]:
    if not isinstance(table, dict | list):
        raise KeyError(key)
    if not way:
        yield table
        return
    first, *rest = way
    if isinstance(table, list):
        for item in _items(table, first, key):
            yield from _tables(item, rest, key)
    else:
        # A table that is not written may be made: `breakdown.field` of a balloon without one.
        yield from _tables(table.setdefault(first, {}), rest, key)


def _items(items: list[Any], name: str, key: str) -> list[Any]:
    if name.isdecimal() and 1 <= int(name) <= len(items):
        return [items[int(name) - 1]]
    named = [item for item in items if isinstance(item, dict) and "name" in item]
    chosen = [item for item in named if name in (item["name"], "*")]
    if not chosen:
        raise KeyError(key)
    return chosen


def quantities(scenario: Mapping[str, Any]) -> dict[str, Any]:
    """Every dotted key of a mapping that holds one value, with that value."""
    found: dict[str, Any] = {}
    collect(scenario, "", found)
    return found


def collect(value: Any, prefix: str, found: dict[str, Any]) -> None:
    """Add the dotted keys below a value, each with its own value."""
    if isinstance(value, Mapping):
        for name, item in value.items():
            collect(item, f"{prefix}.{name}" if prefix else str(name), found)
    elif isinstance(value, list | tuple):
        for number, item in enumerate(value, start=1):
            name = item.get("name", number) if isinstance(item, Mapping) else number
            collect(item, f"{prefix}.{name}", found)
    elif value is not None:
        found[prefix] = value


def near(key: str, known: Mapping[str, Any]) -> str:
    """The known keys most like an unknown one, as words for a message."""
    others = [other for other in known if other != key]
    like = difflib.get_close_matches(key, others, n=3, cutoff=0.6)
    if not like:
        last = key.rpartition(".")[2]
        like = [other for other in others if other.rpartition(".")[2] == last][:3]
    return (
        f"did you mean {' or '.join(like)}?"
        if like
        else f"has {', '.join(k for k, v in known.items() if quantity(v))}"
    )
