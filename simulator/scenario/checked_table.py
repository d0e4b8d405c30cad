"""What a CSV file would be read as, and how a scenario has to say so: for files that nobody has described.

How cells are parted and where the header is are guessed from the first lines. What is then said of rows,
times and units comes from reading the file as a scenario does.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np
from pydantic import ValidationError

from simulator.scenario.columns import (
    Layout,
    Opened,
    RecordingError,
    Row,
    decoded,
    name_and_unit,
    numbers,
    opened,
    place_of,
    rows_of,
    unit_in_name,
)
from simulator.scenario.reading import read_table
from simulator.scenario.recordings import Recording
from simulator.units import SI

_LOOKED_AT = 2000  # lines from which the layout is guessed
_SEPARATORS = (";", "\t", ",", "|", " ")
_TIME = re.compile(r"(time|zeit|temps|second|sec|t)\b.*|x-axis", re.IGNORECASE)
_VOLTAGE = re.compile(r".*(volt|spannung|tension|\bhv|ch\s?\d|channel).*|[uv]\b.*", re.IGNORECASE)
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


@dataclass(frozen=True)
class ReadColumn:
    """A column that is read: its name and unit ("" for none) in the header, least and largest value in it."""

    name: str
    unit: str
    least: float
    largest: float


@dataclass(frozen=True)
class CheckedTable:
    """What a file would be read as.

    Attributes
    ----------
    layout : Layout
    header : int
        The line of the header, from 1.
    time, voltage : ReadColumn
        As the file has them, before any offset.
    others : tuple of str
        The columns that are not read.
    rows, left_out : int
        The rows below the header, and those of them before time 0.
    duration : float
        How long the step takes, in s (or in the unit of a time without one).
    line : str
        What a step of a scenario says to read it so.
    """

    layout: Layout
    header: int
    time: ReadColumn
    voltage: ReadColumn
    others: tuple[str, ...]
    rows: int
    left_out: int
    duration: float
    line: str


def check_table(
    path: str,
    *,
    separator: str | None = None,
    decimal: str | None = None,
    skip: int | None = None,
    time: str | None = None,
    voltage: str | None = None,
    offset: float | None = None,
) -> CheckedTable:
    """What a CSV file would be read as. What is not given is found in the file.

    Raises
    ------
    RecordingError
        If it cannot be read: what is wrong, and in which row.
    """
    content, encoding = decoded(path)
    found = _layout(content, encoding, separator, decimal, skip)
    file = opened(path, found)
    first = next(iter(file.rows()), None)
    if first is None:
        raise RecordingError("must have at least two rows below the header, has 0")
    time_at = place_of(file, "time", time) if time is not None else _time_column(file, first)
    voltage_at = (
        place_of(file, "voltage", voltage) if voltage is not None else _voltage_column(file, first, time_at)
    )
    columns = numbers(file, (time_at, voltage_at))
    read = [
        ReadColumn(file.names[place], _unit(file.names[place], key) or "", float(c.min()), float(c.max()))
        for key, place, c in zip(("time", "voltage"), (time_at, voltage_at), columns, strict=True)
    ]
    written = _written(path, found, read, columns[0], offset)
    recording = _recording(written)
    return CheckedTable(
        layout=found,
        header=file.header.number,
        time=read[0],
        voltage=read[1],
        others=tuple(name for i, name in enumerate(file.names) if i not in (time_at, voltage_at)),
        rows=columns.shape[1],
        left_out=columns.shape[1] - recording.times.size,
        duration=float(recording.times[-1]),
        line=f"table = {_toml(path if _is_strict(path, recording) else written)}",
    )


def _layout(
    content: bytes, encoding: str, separator: str | None, decimal: str | None, skip: int | None
) -> Layout:
    """The layout under which most of the first lines are rows of numbers below a header."""
    best, best_score = None, (0, 0.0)
    for one in _SEPARATORS if separator is None else (separator,):
        for point in (".", ",") if decimal is None else (decimal,):
            if one == point:
                continue
            tried = Layout(one, point)
            rows = list(islice(rows_of(content, encoding, tried), _LOOKED_AT))
            header, score = _header(rows, tried, skip)
            if score > best_score:
                best, best_score = Layout(one, point, header), score
    return best or Layout(separator or ",", decimal or ".", skip or 0)


def _header(rows: Sequence[Row], layout: Layout, skip: int | None) -> tuple[int, tuple[int, float]]:
    """The lines before the likeliest header, and what speaks for it: rows below, share of numbers in them."""
    best = (0, (0, 0.0))
    counts = [sum(layout.number(cell) is not None for cell in row.cells) for row in rows]
    for place in range(1, len(rows)):
        header, first = rows[place - 1], rows[place]
        above = header.number - 1
        is_start = counts[place] >= 2 > counts[place - 1] and len(header.cells) >= len(first.cells)
        if not is_start or (skip is not None and above != skip):
            continue
        end = place
        while end < len(rows) and counts[end] and len(rows[end].cells) <= len(header.cells):
            end += 1
        score = (end - place, sum(counts[place:end]) / sum(len(row.cells) for row in rows[place:end]))
        if score > best[1]:
            best = (above, score)
    return best


def _unit(name: str, key: str) -> str | None:
    return name_and_unit(name)[1] or unit_in_name(name, key)


def _numeric(file: Opened, first: Row) -> list[int]:
    cells = first.cells[: len(file.names)]
    return [i for i, cell in enumerate(cells) if file.layout.number(cell) is not None]


def _time_column(file: Opened, first: Row) -> int:
    """The column that looks like a time, or else the first of numbers."""
    found = _numeric(file, first)
    named = [i for i in found if _TIME.fullmatch(file.names[i]) or unit_in_name(_bracketed(file, i), "time")]
    return next(iter(named or found), 0)


def _voltage_column(file: Opened, first: Row, time: int) -> int:
    """The column that looks like a voltage, or else the first other one of numbers."""
    found = [i for i in _numeric(file, first) if i != time]
    measured = [i for i in found if unit_in_name(_bracketed(file, i), "voltage")]
    named = [i for i in found if _VOLTAGE.fullmatch(file.names[i])]
    place = next(iter(measured or named or found), None)
    if place is None:
        names = ", ".join(file.names)
        raise RecordingError(f"row {first.number}: must have two numbers below the header {names}")
    return place


def _bracketed(file: Opened, place: int) -> str:
    """A name with its unit behind a blank, so that brackets make no difference."""
    name, unit = name_and_unit(file.names[place])
    return f"{name} {unit}" if unit else name


def _written(
    path: str, layout: Layout, read: Sequence[ReadColumn], times: Any, offset: float | None
) -> dict[str, Any]:
    """The recording as a scenario writes it, without what has its default."""
    time, voltage = read
    written: dict[str, Any] = {"file": path}
    written |= {key: c.name for key, c in (("time", time), ("voltage", voltage)) if c.name != key}
    defaults = Layout()
    for key in ("separator", "decimal", "skip"):
        if getattr(layout, key) != getattr(defaults, key):
            written[key] = getattr(layout, key)
    if offset is not None:
        written["offset"] = offset
    elif times[0] != 0.0:
        # A recording that passes time 0 was triggered there; another one begins with its first row.
        shift = 0 if times[0] < 0.0 and (times == 0.0).any() else float(-times[0])
        needs_unit = shift != 0 and time.unit not in ("", "-", "1", "s")
        written["offset"] = f"{shift!r} {time.unit}" if needs_unit else shift
    named = {c.name: c.unit for c in read if c.unit and name_and_unit(c.name)[1] is None}
    if units := {name: unit for name, unit in named.items() if (name, unit) != (time.name, "s")}:
        written["units"] = units
    return written


def _recording(written: dict[str, Any]) -> Recording:
    """The recording as a scenario reads it. Raises RecordingError."""
    try:
        return Recording.model_validate(written, context={"folder": "", "scales": SI})
    except ValidationError as error:
        found = error.errors()[0]
        key = tuple(str(part) for part in found["loc"])
        said = found["msg"] if key == ("file",) else f"{'.'.join(key)}: {found['msg']}"
        raise RecordingError(said, key, found["input"]) from None


def _is_strict(path: str, recording: Recording) -> bool:
    """Whether the plain path says the same."""
    try:
        times, voltages = np.frombuffer(read_table(path, SI)).reshape(2, -1)
    except ValueError:
        return False
    return np.array_equal(times, recording.times) and np.array_equal(voltages, recording.voltages)


def _toml(value: Any) -> str:
    """A value as a scenario file has it, in one line."""
    if isinstance(value, dict):
        parts = (
            f"{key if _BARE_KEY.fullmatch(key) else _toml(key)} = {_toml(v)}" for key, v in value.items()
        )
        return f"{{ {', '.join(parts)} }}"
    return json.dumps(value, ensure_ascii=False) if isinstance(value, str) else repr(value)
