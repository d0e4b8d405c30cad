"""Recordings that drive a step: which columns of which file are time and voltage, and in which units."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    AfterValidator,
    ConfigDict,
    Field,
    PrivateAttr,
    TypeAdapter,
    ValidationInfo,
)

from simulator.scenario.columns import (
    Layout,
    Opened,
    RecordingError,
    name_and_unit,
    numbers,
    opened,
    place_of,
    unit_in_name,
)
from simulator.scenario.errors import short
from simulator.scenario.fields import Chosen, Frozen, Int, Measured, Number, Text, absolute, refused
from simulator.scenario.reading import column
from simulator.units import QUANTITIES, TIME, Scales, has_unit
from simulator.units import read as read_unit

FloatArray = NDArray[np.float64]

_OF_COLUMNS = 'a table of units by column such as { CH1 = "kV" }'
_BARE = ("", "-", "1")  # what stands for a unit where there is none
_ZERO = 4 * np.finfo(np.float64).eps  # of a time: what rounding leaves of it when the offset is added
_ONE_CORNER = 1e-12  # rows of two recordings closer than this part of the whole time are one


# How a CSV file is written: what recordings and the data of fits have in common.
Separator = Annotated[
    str,
    Field(
        strict=True,
        pattern=r"^[^\w.+\-\"\r\n]$",
        description='one character such as ";" or "\\t"; " " is any white space',
    ),
]
DecimalSign = Annotated[Literal[".", ","], Field(description='"." or ","')]
LinesBefore = Annotated[Int, Field(ge=0, description="a whole number >= 0")]


def _units(value: Any, _: ValidationInfo) -> dict[str, str]:
    if not isinstance(value, Mapping):
        raise refused(f"must be {_OF_COLUMNS}", value)
    for name, unit in value.items():
        if not isinstance(unit, str):
            raise refused('must be a text such as "kV"', unit, str(name))
    return dict(value)


class Recording(Frozen):
    """Time and voltage in two columns of a CSV file, linear between its rows.

    The file is read once, when the scenario is loaded; `file` is its absolute path from then on.
    """

    file: Annotated[
        Annotated[str, Field(strict=True, min_length=1)],
        AfterValidator(absolute),
        Field(description="the path of a CSV file"),
    ]
    time: Annotated[Text | None, Field(description="the name of a column")] = None
    voltage: Annotated[Text | None, Field(description="the name of a column")] = None
    separator: Separator = ","
    decimal: DecimalSign = "."
    skip: LinesBefore = 0
    offset: Annotated[Number, Measured(TIME)] = 0.0
    units: Annotated[dict[str, str], Chosen(_units), Field(description=_OF_COLUMNS)] = Field(
        default_factory=dict
    )
    # Bytes, because an array comes out of a pickle writeable and has no plain equality.
    _samples: bytes = PrivateAttr(default=b"")
    _bare: bool = PrivateAttr(default=False)

    def model_post_init(self, context: Any, /) -> None:
        """Read the file."""
        found = context or {}
        try:
            samples, self._bare = _read(self, found.get("scales"))
        except RecordingError as error:
            value = _as_written(self.file, found.get("folder", "")) if error.key == ("file",) else error.value
            raise refused(error.allowed, value, *error.key) from None
        self._samples = samples.tobytes()

    @property
    def layout(self) -> Layout:
        """How the file is written."""
        return Layout(self.separator, self.decimal, self.skip)

    @property
    def bare(self) -> bool:
        """Whether neither the header nor `units` say what the voltages are in."""
        return self._bare

    @property
    def times(self) -> FloatArray:
        """Times of the rows from the start of the step, (n,) read-only; the first is 0."""
        return column(self._samples, 0)

    @property
    def voltages(self) -> FloatArray:
        """Voltages of the rows, (n,) read-only."""
        return column(self._samples, 1)


class RecordingByName(Frozen):
    """Recordings that end together, each of the named balloons with its own."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Recording] = Field(init=False)
    _times: bytes = PrivateAttr(default=b"")
    _voltages: bytes = PrivateAttr(default=b"")

    def model_post_init(self, context: Any, /) -> None:
        """Bring the rows of all recordings to common times."""
        times = _common_times(self.balloons)
        found = [_at(times, recording) for recording in self.balloons.values()]
        self._times, self._voltages = times.tobytes(), np.array(found).tobytes()

    @property
    def balloons(self) -> dict[str, Recording]:
        """The recordings by balloon name."""
        return self.__pydantic_extra__

    @property
    def times(self) -> FloatArray:
        """The times of all rows of all recordings, (n,) read-only; the first is 0."""
        return np.frombuffer(self._times)

    @property
    def voltages(self) -> dict[str, FloatArray]:
        """The voltages at these times by balloon name, each (n,) read-only."""
        rows = np.frombuffer(self._voltages).reshape(len(self.balloons), -1)
        return dict(zip(self.balloons, rows, strict=True))


_PATH: TypeAdapter[str] = TypeAdapter(
    Annotated[Annotated[str, Field(strict=True, min_length=1)], AfterValidator(absolute)]
)


def recorded(value: Any, info: ValidationInfo) -> str | Recording | RecordingByName:
    """The value of a step's `table`: a path, a recording, or recordings by balloon name."""
    if not isinstance(value, Mapping):
        return _PATH.validate_python(value, context=info.context)
    one = isinstance(value.get("file"), str) or not any(
        isinstance(part, Mapping) and (name != "units" or "file" in part) for name, part in value.items()
    )
    kind: type[Recording | RecordingByName] = Recording if one else RecordingByName
    return kind.model_validate(value, context=info.context)


def _read(recording: Recording, scales: Scales | None) -> tuple[FloatArray, bool]:
    """Times, then voltages, (2, n), dimensionless; and whether nothing says what the voltages are in."""
    if recording.separator == recording.decimal:
        raise RecordingError("must differ from the separator", ("decimal",), recording.decimal)
    file = opened(recording.file, recording.layout)
    asked = {"time": recording.time, "voltage": recording.voltage}
    places = {key: place_of(file, key, name) for key, name in asked.items()}
    if places["time"] == places["voltage"]:
        raise RecordingError("must be another column than that of the time", ("voltage",), recording.voltage)
    known = {key: (asked[key] or key, *_names(file, place)) for key, place in places.items()}
    for named, unit in recording.units.items():
        if not any(named in names for names in known.values()):
            columns = " and ".join(names[0] for names in known.values())
            raise RecordingError(f"must be of a column that is read, {columns}", ("units", named), unit)
    factors, bare = [], False
    for key, place in places.items():
        name = next((name for name in known[key] if name in recording.units), None)
        bare = name is None and name_and_unit(file.names[place])[1] is None  # in the end of the voltage
        if name is not None:
            factors.append(_factor(key, ("units", name), recording.units[name], scales))
        else:
            factors.append(_factor_of_header(key, known[key][0], file.names[place], scales))
    columns = numbers(file, (places["time"], places["voltage"])) * np.array(factors)[:, None]
    explicit = "offset" in recording.model_fields_set
    return _from_zero(file, columns, float(recording.offset), explicit=explicit), bare


def _as_written(path: str, folder: str) -> str:
    """A path for a message: within the folder of the scenario it starts there."""
    inside = os.path.join(os.path.abspath(folder), "")
    return path.removeprefix(inside)


def _names(file: Opened, place: int) -> tuple[str, str]:
    cell = file.names[place]
    return cell, name_and_unit(cell)[0]


def _factor_of_header(key: str, name: str, cell: str, scales: Scales | None) -> float:
    """What the numbers of a column are to be multiplied by, as its header says."""
    unit = name_and_unit(cell)[1]
    if unit is not None:
        return _factor(key, (key,), unit, scales, cell)
    named = unit_in_name(cell, key)
    # Seconds are what a bare time is in; and without [scales] a time may be in any unit.
    if named is None or (key == "time" and (named == "s" or scales is None)):
        return 1.0
    lack = "; a unit needs [scales]" if scales is None else ""
    said = f'is missing, column {cell} has a unit in its name: units = {{ "{name}" = "{named}" }}'
    raise RecordingError(f'{said}, or "1" for bare numbers{lack}', ("units",))


def _factor(
    key: str, blamed: tuple[str, ...], unit: str, scales: Scales | None, cell: str | None = None
) -> float:
    """What a unit, or a number of a unit such as "2 kV", is in the dimensionless model."""
    if unit.strip() in _BARE:
        return 1.0
    value = unit if cell is None else cell
    if scales is None:
        raise RecordingError("a unit needs [scales]", blamed, value)
    dimension = QUANTITIES[key]
    try:
        factor = read_unit(unit if has_unit(unit) else f"1 {unit}", dimension, scales)
    except ValueError as error:
        factor, reason = 0.0, f"; {error}" if str(error) else ""
    else:
        reason = ""
    if factor <= 0.0:
        example = dimension.example.split()[-1]
        allowed = f'must be a unit of {key} such as "{example}", or "1" for bare numbers'
        raise RecordingError(f"{allowed}{reason}", blamed, value)
    return factor


def _from_zero(file: Opened, columns: FloatArray, offset: float, *, explicit: bool) -> FloatArray:
    """Rows from time 0 on, which increases; with an explicit offset those before time 0 are left out."""
    recorded_times, voltages = columns
    times = recorded_times + offset
    times[np.abs(times) <= _ZERO * np.abs(recorded_times)] = 0.0
    stuck = np.diff(times) <= 0.0
    if stuck.any():
        row = file.row(int(stuck.argmax()) + 1)
        raise RecordingError(f"row {row.number}: time must increase, is {short(row.text)}")
    first = int(np.searchsorted(times, 0.0)) if explicit else 0
    if first == times.size or times[first] != 0.0:
        near = first % times.size
        row, there = file.row(near), float(recorded_times[near])
        passes_zero = not explicit and (times == 0.0).any()
        hint = "; offset = 0 leaves out the rows before it" if passes_zero else ""
        after = f" after the offset of {offset:g}" if explicit else ""
        begins = "a row must be at time 0" if explicit else "time must start at 0"
        said = f"row {row.number}: {begins}, it is at {float(times[near])!r}{after}"
        would = f"; offset = {-there + 0.0!r} puts it there{hint}"
        raise RecordingError(said + would, ("offset",) if explicit else ("file",), offset)
    if times.size - first < 2:
        raise RecordingError(f"must have at least two rows from time 0 on, has {times.size - first}")
    return np.array([times[first:], voltages[first:]])


def _common_times(recordings: Mapping[str, Recording]) -> FloatArray:
    """The times of all rows of all recordings, (n,); those apart by rounding are one."""
    last = {name: float(recording.times[-1]) for name, recording in recordings.items()}
    end = max(last.values())
    apart = _ONE_CORNER * end
    # So far that rows of one recording stay two, whatever rows of the others lie between them.
    least = len(recordings) * apart
    for name, ends in last.items():
        if end - ends > apart:
            longest = max(last, key=lambda other: last[other])
            said = f"recordings of one step must end together, it ends at {ends!r} and {longest} at {end!r}"
            raise refused(said, recordings[name].file, name, "file")
        gaps = np.diff(recordings[name].times)
        if (gaps <= least).any():
            when = float(recordings[name].times[int(np.argmax(gaps <= least))])
            said = f"rows must be more than {least / end:g} of the whole time apart, not so at time {when!r}"
            raise refused(said, recordings[name].file, name, "file")
    times = np.unique(np.concatenate([recording.times for recording in recordings.values()]))
    return np.asarray(times[np.append(True, np.diff(times) > apart)])


def _at(times: FloatArray, recording: Recording) -> FloatArray:
    """The voltages of a recording at times that lie within rounding of all its own."""
    own = times[np.searchsorted(times, recording.times, side="right") - 1]
    return np.asarray(np.interp(times, own, recording.voltages))
