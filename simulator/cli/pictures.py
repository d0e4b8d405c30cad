"""Pictures of a command, drawn after its tables, which they never cost; and what was left there."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer


class Format(StrEnum):
    """What kind of file a picture is."""

    PNG = "png"
    SVG = "svg"
    PDF = "pdf"


FormatOption = Annotated[
    Format | None,
    typer.Option("--format", help="Draw it as such a file; goes without --plot.", show_default="png"),
]


def wanted(stem: str, *, plot: bool, form: Format | None) -> str | None:
    """The name of the picture that `--plot` and `--format` ask for, None for none."""
    return f"{stem}.{form or Format.PNG}" if plot or form else None


def any_format(stem: str) -> tuple[str, ...]:
    """A picture's names in all formats."""
    return tuple(f"{stem}.{form}" for form in Format)


def draw(directory: Path, name: str | None, make: Callable[[], Any]) -> list[Path]:
    """Draw a picture into a directory in which the tables are already.

    One that cannot be drawn is a warning on stderr, and the exit code is that of the tables.

    Parameters
    ----------
    directory : Path
    name : str or None
        Of the file; its suffix is the format. None for no picture.
    make : callable
        Returns the figure.

    Returns
    -------
    list of Path
        The file, or none.

    Raises
    ------
    OutputError
        If it is drawn, and cannot be written.
    """
    if name is None:
        return []
    # A command has no windows; what a notebook left in the environment may not even be installed.
    os.environ["MPLBACKEND"] = "agg"
    from simulator.results.files import write_files

    try:
        from simulator.results.plot.style import rendered

        content = rendered(make(), name.rpartition(".")[2])
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        print(f"balloons: warning: {name} could not be drawn: {reason}", file=sys.stderr)
        return []
    return write_files(directory, {name: content})


def remove_old(directory: Path, names: Sequence[str]) -> list[str]:
    """Remove files of an earlier run, which do not belong to the new tables beside them; return which."""
    removed = []
    for name in names:
        try:
            (directory / name).unlink()
            removed.append(name)
        except OSError:  # not there, or not ours to remove
            pass
    return removed


def say_removed(names: Sequence[str]) -> None:
    """Say which files of an earlier run are gone."""
    if names:
        print(f"removed  {', '.join(names)} of an earlier run")
