"""Files that a scenario is made of: TOML, and tables of voltages. Every problem is a ValueError."""

from __future__ import annotations

import math
import re
import tomllib
from typing import Any

import numpy as np

from simulator import units
from simulator.scenario.errors import short
from simulator.units import Scales

_COLUMN = re.compile(r"(time|voltage)(?:\s*\[([^\[\]]*)\])?")


def _read_text(path: str) -> str:
    try:
        with open(path, "rb") as stream:
            return stream.read().decode("utf-8-sig")  # spreadsheets and Windows put a BOM in front
    except OSError as error:
        raise ValueError(f"cannot be read, {str(error.strerror).lower()}") from None
    except UnicodeDecodeError as error:
        raise ValueError(f"must be text in UTF-8, byte {error.start} is not") from None


def read_toml(file: str) -> dict[str, Any]:
    """The content of a TOML file."""
    text = _read_text(file)
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"must be TOML: {error}") from None


def read_table(path: str, scales: Scales | None) -> bytes:
    """Times, then voltages, as float64, dimensionless."""
    # Two numbers a row need no csv module, and 1e5 rows are read in half the time without it.
    rows = [(number, row) for number, row in enumerate(_read_text(path).splitlines(), start=1) if row.strip()]
    header = [cell.strip(' "') for cell in rows[0][1].split(",")] if rows else []
    columns_found = [_COLUMN.fullmatch(cell) for cell in header]
    names = [column[1] if column else "" for column in columns_found]
    if sorted(names) != ["time", "voltage"]:
        found = f"has {short(rows[0][1])}" if rows else "is empty"
        or_units = " or, with units, time [s],voltage [kV]" if scales else ""
        raise ValueError(f"must have the header time,voltage{or_units}, {found}")
    factors = [_factor(column[1], column[2], scales) for column in columns_found if column]
    if len(rows := rows[1:]) < 2:
        raise ValueError(f"must have at least two rows below the header, has {len(rows)}")
    columns = np.array([_two_numbers(row) for _, row in rows]).T
    columns *= np.array(factors)[:, None]
    times, voltages = columns if names[0] == "time" else columns[::-1]
    starts = np.arange(times.size) == 0
    for rule, broken in (
        ("must be two finite numbers", ~np.isfinite(columns).all(axis=0)),
        ("time must start at 0", starts & (times != 0.0)),
        ("time must increase", ~starts & (times <= np.roll(times, 1))),
    ):
        if broken.any():
            number, row = rows[int(broken.argmax())]
            raise ValueError(f"row {number}: {rule}, is {short(row.strip())}")
    return np.array([times, voltages]).tobytes()


def _two_numbers(row: str) -> tuple[float, float]:
    try:
        first, second = row.split(",")
        return float(first.strip(' "')), float(second.strip(' "'))
    except ValueError:
        return math.nan, math.nan


def _factor(name: str, unit: str | None, scales: Scales | None) -> float:
    """What the numbers of a column are to be multiplied by."""
    if unit is None:
        return 1.0
    if scales is None:
        raise ValueError(f"header {name} [{short(unit)}]: a unit needs [scales]")
    dimension = units.QUANTITIES[name]
    try:
        return units.read(f"1 {unit}", dimension, scales)
    except ValueError as error:
        allowed = f"must have a unit of {name} such as [{dimension.example.split()[-1]}]"
        reason = f"; {error}" if str(error) else ""
        raise ValueError(f"header {name} [{short(unit)}]: {allowed}{reason}") from None
