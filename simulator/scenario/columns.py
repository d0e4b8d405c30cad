"""Columns of a recording: a CSV file as amplifiers, oscilloscopes and spreadsheets write it.

A file is opened once: its bytes, its header and how its cells are parted. Two of its columns are then read by
pandas, exactly and in one pass. Where that fails, the first row to blame is looked for line by line.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator.scenario.errors import short

FloatArray = NDArray[np.float64]

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_IN_BRACKETS = re.compile(r"(.*?)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))")

# What a name may end in, or be, that leaves no doubt what its numbers are in.
_UNITS_IN_NAMES = {
    "time": ("s", "ms", "us", "µs", "μs", "ns", "min"),
    "voltage": ("V", "mV", "kV", "MV", "µV", "μV", "uV"),
}


class RecordingError(ValueError):
    """A recording that cannot be read as asked.

    Attributes
    ----------
    key : tuple of str
        What is to blame, as one key below another: ("file",), ("units", "CH1").
    value : object
        Its value, None where it has none.
    allowed : str
        What is allowed, and in which row it is not so.
    """

    def __init__(self, allowed: str, key: tuple[str, ...] = ("file",), value: object = None) -> None:
        super().__init__(allowed, key, value)
        self.key, self.value, self.allowed = key, value, allowed

    def __str__(self) -> str:
        return self.allowed


@dataclass(frozen=True)
class Layout:
    """How a file parts its cells, writes its numbers, and how many lines come before its header."""

    separator: str = ","
    decimal: str = "."
    skip: int = 0

    @property
    def is_white(self) -> bool:
        """Whether any stretch of white space parts the cells."""
        return self.separator == " "

    def number(self, cell: str) -> float | None:
        """The number that a cell holds, None where it holds none."""
        text = cell.strip()
        if self.decimal == ",":
            text = text.replace(".", "?").replace(",", ".")
        return float(text) if _NUMBER.fullmatch(text) else None


@dataclass(frozen=True)
class Row:
    """One line of a file: its number from 1, its text, and its cells."""

    number: int
    text: str
    cells: tuple[str, ...]


@dataclass(frozen=True)
class Opened:
    """A file with its header found.

    Attributes
    ----------
    path : str
    content : bytes
    encoding : str
    layout : Layout
    header : Row
    """

    path: str
    content: bytes
    encoding: str
    layout: Layout
    header: Row

    @property
    def names(self) -> tuple[str, ...]:
        """The columns as the header has them."""
        return self.header.cells

    def rows(self) -> Iterator[Row]:
        """The rows below the header, blank lines left out."""
        return (row for row in rows_of(self.content, self.encoding, self.layout) if row.number > self._top)

    def row(self, place: int) -> Row:
        """The row at a place below the header, from 0."""
        return next(row for number, row in enumerate(self.rows()) if number == place)

    @property
    def _top(self) -> int:
        return self.header.number


def decoded(path: str) -> tuple[bytes, str]:
    """The content of a file and its encoding: UTF-8, or the Windows one where it is not that.

    Numbers are the same in both; only names and remarks have letters in which the two differ.

    Raises
    ------
    RecordingError
        If the file cannot be read, or is no text.
    """
    try:
        with open(path, "rb") as stream:
            content = stream.read()
    except OSError as error:
        raise RecordingError(f"cannot be read, {str(error.strerror).lower()}") from None
    if b"\0" in content:
        raise RecordingError("must be text in UTF-8, has bytes that are 0")
    try:
        content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content, "latin-1"
    return content, "utf-8-sig"


def rows_of(content: bytes, encoding: str, layout: Layout) -> Iterator[Row]:
    """The lines of a file with their cells, one after the other; blank ones are left out."""
    for number, line in enumerate(io.TextIOWrapper(io.BytesIO(content), encoding, newline=None), start=1):
        if line.strip():
            white, separator = layout.is_white, layout.separator
            cells = (
                line.split()
                if white
                else next(csv.reader([line], delimiter=separator, skipinitialspace=True))
            )
            yield Row(number, line.strip("\n"), tuple(cell.strip() for cell in cells))


def opened(path: str, layout: Layout) -> Opened:
    """A recording with its header found.

    Raises
    ------
    RecordingError
        If there is none.
    """
    content, encoding = decoded(path)
    last, header = 0, None
    for row in rows_of(content, encoding, layout):
        last = row.number
        if last > layout.skip:
            header = row
            break
    if last == 0:
        raise RecordingError("must have a header and rows below it, is empty")
    if header is None:
        raise RecordingError(f"must be less than the {last} lines of the file", ("skip",), layout.skip)
    if header.number != layout.skip + 1:
        line = layout.skip + 1
        raise RecordingError(
            f"the header must be in line {line}, that is blank; skip = {header.number - 1}",
            ("skip",),
            layout.skip,
        )
    return Opened(path, content, encoding, layout, header)


def place_of(file: Opened, key: str, name: str | None) -> int:
    """Where in the header a column is: by its whole name, or by what stands before its unit.

    Parameters
    ----------
    file : Opened
    key : {"time", "voltage"}
    name : str or None
        As the scenario has it; None for a column named as the key.

    Raises
    ------
    RecordingError
        If there is no such column, or more than one.
    """
    wanted = key if name is None else name
    whole = [i for i, cell in enumerate(file.names) if cell == wanted]
    found = whole or [i for i, cell in enumerate(file.names) if name_and_unit(cell)[0] == wanted]
    if len(found) == 1:
        return found[0]
    columns = ", ".join(cell or '""' for cell in file.names)
    if found:
        raise RecordingError(f"must be one column, the header has it {len(found)} times", (key,), wanted)
    hint = ""
    others = {";": ";", "\t": "\\t", ",": ","}
    if len(file.names) == 1:
        other = next((s for s in others if s in file.header.text and s != file.layout.separator), None)
        hint = f'; its cells seem to be parted by separator = "{others[other]}"' if other else ""
    missing = "is missing, " if name is None else ""
    allowed = f"{missing}must be a column of the header in row {file.header.number}: {short(columns)}{hint}"
    raise RecordingError(allowed, (key,), name)


def name_and_unit(cell: str) -> tuple[str, str | None]:
    """A name in a header and the unit behind it, in brackets of either kind; None where there is none."""
    found = _IN_BRACKETS.fullmatch(cell)
    if found is None:
        return cell, None
    return found[1], (found[2] if found[2] is not None else found[3]).strip()


def unit_in_name(cell: str, key: str) -> str | None:
    """The unit that a name such as `time_ms` or `kV` ends in or is; None where it has none."""
    last = re.split(r"[_\s]", cell)[-1]
    return last if last in _UNITS_IN_NAMES[key] else None


def numbers(file: Opened, columns: tuple[int, ...]) -> FloatArray:
    """Columns of a recording, (n_columns, n_rows) in the order asked for, finite.

    Raises
    ------
    RecordingError
        If they are not all numbers, or a row has more cells than the header.
    """
    import pandas as pd

    layout, count = file.layout, len(file.names)
    # From 3.1 on pandas reads every number exactly, and warns of the word that older ones need for it.
    old = tuple(int(part) for part in pd.__version__.split(".")[:2]) < (3, 1)
    exactly: dict[str, Any] = {"float_precision": "round_trip"} if old else {}
    try:
        frame = pd.read_csv(
            io.BytesIO(file.content),
            sep=r"\s+" if layout.is_white else layout.separator,
            decimal=layout.decimal,
            skiprows=file.header.number,
            header=None,
            names=range(count),
            dtype=dict.fromkeys(columns, np.float64),
            encoding=file.encoding,
            skipinitialspace=True,
            low_memory=False,
            **exactly,
        )
    except ValueError as error:  # a ParserError is one, too
        _blame(file, columns)
        raise RecordingError(f"cannot be read: {short(str(error).strip())}") from None
    # Where the first row has more cells than the header, pandas makes an index of those in front.
    if not isinstance(frame.index, pd.RangeIndex):
        _blame(file, columns)
        raise RecordingError("must have no more cells in a row than in the header")
    if len(frame) < 2:
        raise RecordingError(f"must have at least two rows below the header, has {len(frame)}")
    found = np.array([frame[place].to_numpy() for place in columns])
    if not np.isfinite(found).all():
        _blame(file, columns)
        place = int(np.argmin(np.isfinite(found).all(axis=0)))
        row = file.row(place)
        raise RecordingError(f"row {row.number}: must be finite numbers, is {short(row.text)}")
    return found


def _blame(file: Opened, columns: tuple[int, ...]) -> None:
    """Raise for the first row that cannot be read; pass where there is none."""
    count, layout = len(file.names), file.layout
    for row in file.rows():
        if len(row.cells) > count:
            said = f"row {row.number}: must have at most {count} cells, as the header has"
            comma = layout.separator == ","
            hint = '; decimal commas need another separator and decimal = ","' if comma else ""
            raise RecordingError(f"{said}, is {short(row.text)}{hint}")
        for place in columns:
            cell = row.cells[place] if place < len(row.cells) else ""
            number = layout.number(cell)
            if number is not None and np.isfinite(number):
                continue
            said = f"row {row.number}: must be a finite number in column {short(file.names[place])}"
            other = Layout(decimal="," if layout.decimal == "." else ".")
            hint = f'; it needs decimal = "{other.decimal}"' if other.number(cell) is not None else ""
            raise RecordingError(f"{said}, is {short(cell) or 'empty'}{hint}")
