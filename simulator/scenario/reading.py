"""Files that a scenario is made of: TOML, and tables of numbers.

What is wrong with a table is a ValueError that becomes a problem of the field that names it.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from simulator import units
from simulator.scenario.errors import Problem, ScenarioError, short
from simulator.scenario.fields import LONGEST
from simulator.units import Scales

_COLUMN = re.compile(r"(time|voltage|stretch|pressure|stress)(?:\s*\[([^\[\]]*)\])?")


class _Unreadable(ValueError):
    """A file that is no text."""


def _read_text(path: str) -> str:
    try:
        with open(path, "rb") as stream:
            return stream.read().decode("utf-8-sig")  # spreadsheets and Windows put a BOM in front
    except OSError as error:
        raise _Unreadable(f"cannot be read, {str(error.strerror).lower()}") from None
    except UnicodeDecodeError as error:
        raise _Unreadable(f"must be text in UTF-8, byte {error.start} is not") from None


def read_toml(file: str, kind: str) -> dict[str, Any]:
    """The content of a TOML file.

    Parameters
    ----------
    file : str
    kind : str
        What it is to hold, as in `check_kind`.

    Raises
    ------
    ScenarioError
        If it cannot be read, is no TOML, or holds something else.
    """
    text = ""
    try:
        text = _read_text(file)
        content = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        no_toml = f"must be TOML: {error}{_hint(str(error), text)}"
        reason = str(error) if isinstance(error, _Unreadable) else no_toml
        raise ScenarioError(file, Problem("", None, reason)) from None
    check_kind(file, content, kind)
    return content


# By which key a file shows its kind, and by which command that is played. An optimum has what a sweep has.
_KINDS = {
    "free": ("a fit", "fit"),
    "maximize": ("an optimum", "optimize"),
    "minimize": ("an optimum", "optimize"),
    "vary": ("a sweep", "sweep"),
    "gas": ("a scenario", "run"),
    "balloon": ("a scenario", "run"),
}


def check_kind(file: str, content: Mapping[str, Any], kind: str) -> None:
    """Raise ScenarioError where the content of a file is of another kind than is wanted.

    Parameters
    ----------
    file : str
        For the message.
    content : mapping
    kind : str
        "a scenario", "a sweep", "an optimum" or "a fit".
    """
    for key, (found, command) in _KINDS.items():
        expected = found == kind or (found, kind) == ("a sweep", "an optimum")
        if key in content and not expected:
            allowed = f"belongs to {found}, not to {kind}; {found} is played with `balloons {command}`"
            raise ScenarioError(file, Problem(key, None, allowed))


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
    """Times, then voltages, of a table, as the bytes of float64; `column` reads them.

    Parameters
    ----------
    path : str
    scales : Scales or None
        What the units in its titles are turned into dimensionless numbers with.

    Raises
    ------
    ValueError
        If it cannot be read or is no such table.
    """
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


def has_units(path: str) -> bool:
    """Whether the header of a table that `read_table` reads names a unit of the voltage."""
    rows = (row for row in _read_text(path).splitlines() if row.strip())
    cells = (_COLUMN.fullmatch(cell.strip(' "')) for cell in next(rows, "").split(","))
    return any(cell is not None and cell[1] == "voltage" and cell[2] is not None for cell in cells)


def read_curve(path: str) -> bytes:
    """Stretches, then f(λ), of a measured curve, as the bytes of float64; `column` reads them.

    The file has either pressures p = f/λ² or stresses f/2.

    Raises
    ------
    ValueError
        If it cannot be read or is no such curve.
    """
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


def column(samples: bytes, place: int) -> NDArray[np.float64]:
    """One of the two columns that `read_table` or `read_curve` gave, (n,) read-only."""
    # They are kept as bytes: an array comes out of a pickle writeable, and has no plain equality.
    found: NDArray[np.float64] = np.frombuffer(samples).reshape(2, -1)[place]
    return found


class _Rows(NamedTuple):
    """Rows of a file and their numbers in it, from 1; of a million rows no list of pairs."""

    numbers: Sequence[int]
    texts: list[str]

    @classmethod
    def of(cls, text: str) -> _Rows:
        """Those that are not blank."""
        texts = text.splitlines()
        if all(map(str.strip, texts)):
            return cls(range(1, len(texts) + 1), texts)
        numbers = [number for number, row in enumerate(texts, start=1) if row.strip()]
        return cls(numbers, [texts[number - 1] for number in numbers])

    def below(self) -> _Rows:
        """Those below the first."""
        return _Rows(self.numbers[1:], self.texts[1:])


def _two_columns(
    path: str,
    headers: tuple[tuple[str, str], ...],
    fewest: int,
    factor: Callable[[str, str], float],
    units_hint: str = "",
) -> tuple[str, _Rows, NDArray[np.float64]]:
    """Name of the second column, numbered rows as text, and (2, n) numbers in the order of the names.

    `factor` says what the numbers of a column are multiplied by, of its name and the unit in its title.
    """
    # Two numbers a row need no csv module, and 1e5 rows are read in half the time without it.
    rows = _Rows.of(_read_text(path))
    header = [cell.strip(' "') for cell in rows.texts[0].split(",")] if rows.texts else []
    cells = [_COLUMN.fullmatch(cell) for cell in header]
    titles = [cell[1] if cell else "" for cell in cells]
    names = next((names for names in headers if sorted(titles) == sorted(names)), None)
    if names is None:
        found = f"has {short(rows.texts[0])}" if rows.texts else "is empty"
        raise ValueError(f"must have the header {' or '.join(map(','.join, headers))}{units_hint}, {found}")
    factors = [1.0 if cell[2] is None else factor(cell[1], cell[2]) for cell in cells if cell]
    rows = rows.below()
    if len(rows.texts) < fewest:
        count = {2: "two", 6: "six"}[fewest]
        raise ValueError(f"must have at least {count} rows below the header, has {len(rows.texts)}")
    columns = _numbers(rows.texts).T
    columns *= np.array(factors)[:, None]
    return names[1], rows, np.array(columns if titles[0] == names[0] else columns[::-1])


def _refuse(rows: _Rows, *rules: tuple[str, Any]) -> None:
    """Raise for the first row that breaks the first rule that is broken."""
    for rule, broken in rules:
        if broken.any():
            place = int(broken.argmax())
            raise ValueError(f"row {rows.numbers[place]}: {rule}, is {short(rows.texts[place].strip())}")


def _numbers(rows: list[str]) -> NDArray[np.float64]:
    """The two numbers of each row, (n, 2); NaN in rows that have something else."""
    try:
        found = np.loadtxt(rows, delimiter=",", comments=None, quotechar='"', ndmin=2)
    except ValueError:
        found = np.empty((0, 0))
    # Where a row is no two numbers, the others are read all the same.
    return found if found.shape == (len(rows), 2) else np.array([_two_numbers(row) for row in rows])


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
