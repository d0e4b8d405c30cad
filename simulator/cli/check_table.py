"""The command `balloons check-table`: what a recording would be read as, and the line that says so."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from simulator.cli.endings import BAD_INPUT, fail

if TYPE_CHECKING:
    from simulator.scenario.checked_table import CheckedTable, ReadColumn


def check_table(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A CSV file.", show_default=False)],
    separator: Annotated[
        str | None,
        typer.Option(metavar="C", help='Parts the cells; " " is any white space.', show_default="found"),
    ] = None,
    decimal: Annotated[
        str | None, typer.Option(metavar="C", help='"." or ",", before the decimals.', show_default="found")
    ] = None,
    skip: Annotated[
        int | None, typer.Option(metavar="N", min=0, help="Lines before the header.", show_default="found")
    ] = None,
    time: Annotated[
        str | None, typer.Option(metavar="NAME", help="Column of the time.", show_default="found")
    ] = None,
    voltage: Annotated[
        str | None, typer.Option(metavar="NAME", help="Column of the voltage.", show_default="found")
    ] = None,
    offset: Annotated[
        float | None, typer.Option(metavar="S", help="Added to the time, in s.", show_default="found")
    ] = None,
) -> None:
    """Say what a recording of a voltage would be read as; print the line for a step of a scenario."""
    from simulator.scenario.checked_table import check_table as check
    from simulator.scenario.columns import RecordingError

    separator = "\t" if separator == r"\t" else separator
    for name, given, allowed in (("--separator", separator, None), ("--decimal", decimal, (".", ","))):
        if given is not None and (len(given) != 1 or (allowed and given not in allowed)):
            rule = "one character" if allowed is None else "a point or a comma"
            fail(f"{name} {given}: must be {rule}", BAD_INPUT)
    if separator is not None and separator == decimal:
        fail(f"--decimal {decimal}: must differ from the separator", BAD_INPUT)
    try:
        checked = check(
            str(file),
            separator=separator,
            decimal=decimal,
            skip=skip,
            time=time,
            voltage=voltage,
            offset=offset,
        )
    except RecordingError as error:
        place = "" if error.key == ("file",) else f"{'.'.join(error.key)}: "
        said = str(error).removeprefix(place)
        fail(f"{file}: {place}{said}", BAD_INPUT)
    print("\n".join(_said(file, checked)))


def _said(file: Path, checked: CheckedTable) -> list[str]:
    """What is printed, line by line."""
    shown = {"\t": r"\t", " ": "white space"}.get(checked.layout.separator, checked.layout.separator)
    lines = [
        f'{file}: header in row {checked.header}, separator "{shown}", decimal "{checked.layout.decimal}"',
        f"  time     {_column(checked.time)}",
        f"  voltage  {_column(checked.voltage)}",
        f"  rows     {checked.rows:,}",
    ]
    if checked.left_out:
        lines[-1] += f", {checked.left_out:,} of them before time 0 and left out"
    lines.append(f"  lasts    {checked.duration:g}{' s' if checked.time.unit else ''} from time 0 on")
    if checked.others:
        lines.append(f"  not read {', '.join(checked.others)}")
    units = [column.unit for column in (checked.time, checked.voltage) if column.unit not in ("", "s")]
    if units:
        lines.append(f"Units ({', '.join(units)}) need [scales] in the scenario.")
    elif not checked.voltage.unit:
        lines.append('The header has no unit for the voltage; with [scales] name it, units = { … = "kV" }.')
    return [*lines, "For a step of a scenario (the path starts at the scenario's folder):", checked.line]


def _column(column: ReadColumn) -> str:
    unit = f" {column.unit}" if column.unit not in ("", "-", "1") else ""
    return f"{column.name}, {column.least:g} to {column.largest:g}{unit}"
