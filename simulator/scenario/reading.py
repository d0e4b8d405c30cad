"""Files that a scenario is made of: TOML, and tables of numbers. Every problem is a ValueError."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator import units
from simulator.scenario.errors import short
from simulator.scenario.fields import LONGEST
from simulator.units import Scales

_COLUMN = re.compile(r"(time|voltage|stretch|pressure|stress)(?:\s*\[([^\[\]]*)\])?")


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
        raise ValueError(f"must be TOML: {error}{_hint(str(error), text)}") from None


_BARE_QUANTITY = re.compile(r"([\w.-]+)\s*=\s*([-+]?\d[\d.]*(?:[eE][-+]?\d+)?\s*[^\W\d][\w/^*]*)")
_BARE_WORD = re.compile(r"([\w.-]+)\s*=\s*(?!(?i:true|false|inf|nan)\b)([^\W\d][^,\]}\"'=]*)")


def _hint(message: str, text: str) -> str:
    """What most probably is meant where a file is no TOML: double brackets, or quotes that are missing."""
    if twice := re.match(r"Cannot declare \('(balloon|step)',\) twice", message):
        return f"; several tables are written [[{twice[1]}]], each of them"
    where = re.search(r"\(at line (\d+),", message)
    lines = text.splitlines()
    line = lines[int(where[1]) - 1] if where and int(where[1]) <= len(lines) else ""
    line = line.partition("#")[0]
    if found := _BARE_QUANTITY.search(line):
        return f'; a number with a unit stands in quotes: {found[1]} = "{found[2].strip()}"'
    if found := _BARE_WORD.search(line):
        return f'; a text stands in quotes: {found[1]} = "{found[2].strip()}"'
    return ""


def read_table(path: str, scales: Scales | None) -> bytes:
    """Times, then voltages, as float64, dimensionless."""
    units_hint = " or, with units, time [s],voltage [kV]" if scales else ""
    rows, columns = _two_columns(path, (("time", "voltage"),), 2, partial(_factor, scales), units_hint)[1:]
    times = columns[0]
    starts = np.arange(times.size) == 0
    _refuse(
        rows,
        ("must be two finite numbers", ~np.isfinite(columns).all(axis=0)),
        ("time must start at 0", starts & (times != 0.0)),
        ("time must increase", ~starts & (times <= np.roll(times, 1))),
        ("time must be at most 1e100", times > LONGEST),
    )
    return columns.tobytes()


def read_curve(path: str) -> bytes:
    """Stretches, then f(λ), as float64, from stretches and either pressures p = f/λ² or stresses f/2."""
    name, rows, columns = _two_columns(path, (("stretch", "pressure"), ("stretch", "stress")), 6, _no_unit)
    stretches, values = columns
    starts = np.arange(stretches.size) == 0
    _refuse(
        rows,
        ("must be two finite numbers", ~np.isfinite(columns).all(axis=0)),
        ("stretch must start at 1", starts & (stretches != 1.0)),
        ("stretch must increase", ~starts & (stretches <= np.roll(stretches, 1))),
        (f"{name} must be 0 at stretch 1", starts & (values != 0.0)),
        (f"{name} must be > 0 beyond stretch 1", ~starts & ~(values > 0.0)),
    )
    factor = stretches**2 if name == "pressure" else 2.0
    return np.array([stretches, values * factor]).tobytes()


_Row = tuple[int, str]


def _two_columns(
    path: str,
    headers: tuple[tuple[str, str], ...],
    fewest: int,
    factor: Callable[[str, str], float],
    units_hint: str = "",
) -> tuple[str, list[_Row], NDArray[np.float64]]:
    """Name of the second column, numbered rows as text, and (2, n) numbers in the order of the names.

    `factor` says what the numbers of a column are multiplied by, of its name and the unit in its title.
    """
    # Two numbers a row need no csv module, and 1e5 rows are read in half the time without it.
    rows = [(number, row) for number, row in enumerate(_read_text(path).splitlines(), start=1) if row.strip()]
    header = [cell.strip(' "') for cell in rows[0][1].split(",")] if rows else []
    cells = [_COLUMN.fullmatch(cell) for cell in header]
    titles = [cell[1] if cell else "" for cell in cells]
    names = next((names for names in headers if sorted(titles) == sorted(names)), None)
    if names is None:
        found = f"has {short(rows[0][1])}" if rows else "is empty"
        raise ValueError(f"must have the header {' or '.join(map(','.join, headers))}{units_hint}, {found}")
    factors = [1.0 if cell[2] is None else factor(cell[1], cell[2]) for cell in cells if cell]
    if len(rows := rows[1:]) < fewest:
        count = {2: "two", 6: "six"}[fewest]
        raise ValueError(f"must have at least {count} rows below the header, has {len(rows)}")
    columns = np.array([_two_numbers(row) for _, row in rows]).T
    columns *= np.array(factors)[:, None]
    return names[1], rows, np.array(columns if titles[0] == names[0] else columns[::-1])


def _refuse(rows: list[_Row], *rules: tuple[str, Any]) -> None:
    """Raise for the first row that breaks the first rule that is broken."""
    for rule, broken in rules:
        if broken.any():
            number, row = rows[int(broken.argmax())]
            raise ValueError(f"row {number}: {rule}, is {short(row.strip())}")


def _two_numbers(row: str) -> tuple[float, float]:
    try:
        first, second = row.split(",")
        return float(first.strip(' "')), float(second.strip(' "'))
    except ValueError:
        return math.nan, math.nan


def _no_unit(name: str, unit: str) -> float:
    """The refusal of a unit in a measured curve. Raises ValueError."""
    over = {"stress": "the shear modulus of the wall", "pressure": "μH/R of the balloon"}.get(name)
    means = f"must be the {name} over {over}, without a unit" if over else "must have no unit"
    raise ValueError(f"header {name} [{short(unit)}]: {means}")


def _factor(scales: Scales | None, name: str, unit: str) -> float:
    """What the numbers of a column with a unit are multiplied by. Raises ValueError."""
    if scales is None:
        raise ValueError(f"header {name} [{short(unit)}]: a unit needs [scales]")
    dimension = units.QUANTITIES[name]
    try:
        return units.read(f"1 {unit}", dimension, scales)
    except ValueError as error:
        allowed = f"must have a unit of {name} such as [{dimension.example.split()[-1]}]"
        reason = f"; {error}" if str(error) else ""
        raise ValueError(f"header {name} [{short(unit)}]: {allowed}{reason}") from None
