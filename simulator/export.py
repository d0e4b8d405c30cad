"""A history on disk and as tables: `history.csv`, `events.csv`, `run.json`, pandas.

Columns are assembled once (`history_columns`, `event_columns`) and go two ways: into a pandas
table, or as text into a file. The text does not pass through pandas: formatting rows here takes
less time than `DataFrame.to_csv` and spares a command-line run the import.

Nothing is ever written under its final name: see `write_files`.
"""

from __future__ import annotations

import errno
import json
import math
import os
import platform
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from simulator.history import Outcome

if TYPE_CHECKING:
    import pandas as pd

    from simulator.history import Event, FloatArray, History

Columns = dict[str, NDArray[Any]]

RUN_FILES = ("history.csv", "events.csv", "run.json")

_ROWS_AT_ONCE = 8192


class OutputError(OSError):
    """A result cannot be written where it should go; the message names the place and the reason."""


def history_columns(history: History) -> Columns:
    """The samples by column, in the order of `history.csv`.

    Parameters
    ----------
    history : History

    Returns
    -------
    dict of str to (n_samples,) array
        `time`, `step`, `branch`, `voltage_<name>` of each electroded balloon, `stretch_<name>` of
        each balloon, `pressure`, `volume`, `gas`, `field_<name>`, `charge_<name>`, `energy`,
        `stability`. Dimensionless, see `History`.
    """
    return {
        "time": history.time,
        "step": history.step,
        "branch": history.branch,
        **_by_name("voltage", history.electroded, history.voltage),
        **_by_name("stretch", history.balloons, history.stretch),
        "pressure": history.pressure,
        "volume": history.volume,
        "gas": history.gas,
        **_by_name("field", history.electroded, history.field),
        **_by_name("charge", history.electroded, history.charge),
        "energy": history.energy,
        "stability": history.stability,
    }


def event_columns(history: History) -> Columns:
    """The events by column, in the order of `events.csv`; NaN on the after side where a history ends.

    Parameters
    ----------
    history : History

    Returns
    -------
    dict of str to (n_events,) array
        `time`, `step`, `kind`, `voltage_<name>`, `stretch_<name>_before`, `stretch_<name>_after`,
        `pressure_before`, `pressure_after`, `field_<name>_before`, `field_<name>_after`,
        `dissipated`. The two sides of one balloon stand next to each other.
    """
    events = history.events
    balloons, electroded = history.balloons, history.electroded

    def sides(quantity: str, names: tuple[str, ...]) -> Columns:
        before = _stacked(events, f"{quantity}_before", len(names))
        after = _stacked(events, f"{quantity}_after", len(names))
        return {
            f"{quantity}_{name}_{side}": values[:, i]
            for i, name in enumerate(names)
            for side, values in (("before", before), ("after", after))
        }

    return {
        "time": np.array([event.time for event in events], dtype=float),
        "step": np.array([event.step for event in events], dtype=np.int64),
        "kind": np.array([event.kind.value for event in events], dtype=object),
        **_by_name("voltage", electroded, _stacked(events, "voltage", len(electroded))),
        **sides("stretch", balloons),
        "pressure_before": _stacked(events, "pressure_before", 1)[:, 0],
        "pressure_after": _stacked(events, "pressure_after", 1)[:, 0],
        **sides("field", electroded),
        "dissipated": _stacked(events, "dissipated", 1)[:, 0],
    }


def history_table(history: History) -> pd.DataFrame:
    """The samples of a history as a pandas table, one row each; columns as in `history_columns`."""
    import pandas as pd

    return pd.DataFrame(history_columns(history))


def events_table(history: History) -> pd.DataFrame:
    """The events of a history as a pandas table, one row each; columns as in `event_columns`."""
    import pandas as pd

    return pd.DataFrame(event_columns(history))


def run_record(history: History, failure: str | None = None) -> dict[str, Any]:
    """What `run.json` says: the scenario, how its run ended, what it cost and which software did it.

    Parameters
    ----------
    history : History
    failure : str, optional
        Message of the solver failure that ended the run early.

    Returns
    -------
    dict
        Plain values that strict JSON can carry; a number that is not finite is None.
    """
    import sksundae

    scenario = history.scenario
    balance = history.energy_balance
    record = {
        "title": scenario.title,
        "source": scenario.source,
        "outcome": history.outcome.value,
        "partial": history.outcome is Outcome.FAILED,
        "failure": failure,
        "counts": {
            "samples": len(history),
            "steps": int(history.step[-1]) if len(history) else 0,
            "branches": int(history.branch[-1]) + 1 if len(history) else 0,
            "events": len(history.events),
            "events_by_kind": dict(Counter(event.kind.value for event in history.events)),
        },
        "energy_balance": {**asdict(balance), "relative_imbalance": balance.relative_imbalance},
        "statistics": asdict(history.statistics),
        "scenario": scenario.to_dict(),
        "versions": {
            "dielectric-balloons": _own_version(),
            "python": platform.python_version(),
            "numpy": np.__version__,
            "pandas": version("pandas"),
            "scikit-sundae": version("scikit-sundae"),
            "SUNDIALS": str(sksundae.SUNDIALS_VERSION),
        },
    }
    plain: dict[str, Any] = _plain(record)
    return plain


def write_run(
    history: History, directory: str | os.PathLike[str], *, failure: str | None = None
) -> list[Path]:
    """Write `history.csv`, `events.csv` and `run.json` of a history into a directory, all or none.

    Numbers are written with as many digits as it takes to read the same double back, and NaN as an
    empty cell. (Before 3.1, pandas reads them back exactly only with ``float_precision="round_trip"``.)

    Parameters
    ----------
    history : History
    directory : path
        Created if need be. Files of the same names are replaced.
    failure : str, optional
        Message of the solver failure that ended the run early, for `run.json`.

    Returns
    -------
    list of Path
        The files written, `run.json` last.

    Raises
    ------
    OutputError
        If the directory cannot be made or written to. What was there before is then still there.
    """
    tables = {"history.csv": history_columns(history), "events.csv": event_columns(history)}
    text = json.dumps(run_record(history, failure), indent=2, ensure_ascii=False, allow_nan=False)
    writers: dict[str, Callable[[BinaryIO], object]] = {
        name: partial(_write_csv, columns) for name, columns in tables.items()
    }
    # run.json goes last: a reader who sees it sees the tables it belongs to.
    writers["run.json"] = lambda stream: stream.write(f"{text}\n".encode())
    return write_files(directory, writers)


def write_files(
    directory: str | os.PathLike[str], writers: Mapping[str, Callable[[BinaryIO], object]]
) -> list[Path]:
    """Write several files into a directory so that each is either complete or not there.

    Every file is written and synced to disk under a temporary name in the same directory. Only when
    all are complete do they take their final names, in the order given. Whatever goes wrong before
    that (disk full, Ctrl-C), the temporary files and any directory made for them are removed, and
    older files are untouched; a killed process leaves at worst a hidden ``.*.tmp`` file.

    Parameters
    ----------
    directory : path
        Created if need be.
    writers : dict of file name to function
        Each is called with a binary stream to write its file to.

    Returns
    -------
    list of Path

    Raises
    ------
    OutputError
    """
    directory = Path(directory)
    temporary: dict[Path, Path] = {}
    made: list[Path] = []
    try:
        _make_directory(directory, made)
        _refuse_directories(directory, tuple(writers))
        for name, write in writers.items():
            target = directory / name
            temporary[target] = _temporary_name(target)
            with open(temporary[target], "xb") as stream:
                write(stream)
                stream.flush()
                os.fsync(stream.fileno())
        for target, source in temporary.items():
            os.replace(source, target)
    except BaseException as error:
        _discard(temporary.values(), made)
        if isinstance(error, OSError):
            raise _output_error(directory, error) from error
        raise
    return list(temporary)


def check_writable(directory: str | os.PathLike[str], names: tuple[str, ...] = RUN_FILES) -> None:
    """Find out before a long run whether its files could be written; leave no trace of having tried.

    Parameters
    ----------
    directory : path
        Need not exist yet.
    names : tuple of str
        The files to be written there later.

    Raises
    ------
    OutputError
        If the directory cannot be created or written to, or a directory stands where a file is to go.
    """
    directory = Path(directory)
    made: list[Path] = []
    probe = _temporary_name(directory / "probe")
    try:
        # Trying is the only honest test: permission bits say nothing of read-only or full disks.
        _make_directory(directory, made)
        _refuse_directories(directory, names)
        with open(probe, "xb"):
            pass
    except OSError as error:
        raise _output_error(directory, error) from error
    finally:
        _discard([probe], made)


def _by_name(quantity: str, names: tuple[str, ...], values: FloatArray) -> Columns:
    return {f"{quantity}_{name}": values[:, i] for i, name in enumerate(names)}


def _stacked(events: tuple[Event, ...], attribute: str, width: int) -> FloatArray:
    """One row per event, NaN where the event has no such side."""
    rows = np.full((len(events), width), math.nan)
    for row, event in zip(rows, events, strict=True):
        value = getattr(event, attribute)
        if value is not None:
            row[:] = value
    return rows


def _write_csv(columns: Columns, stream: BinaryIO) -> None:
    stream.write((",".join(columns) + "\n").encode())
    for rows in _rows_of_text(list(columns.values())):
        stream.write(rows.encode())


def _rows_of_text(columns: list[NDArray[Any]]) -> Iterator[str]:
    n_rows = columns[0].size
    # One %-template for a whole row is the fastest formatting there is in pure Python: %r of a
    # float is its shortest exact form.
    formats = {"f": "%r", "i": "%d"}
    gaps = [column.dtype.kind == "f" and bool(np.isnan(column).any()) for column in columns]
    cells = [
        "%s" if gap else formats.get(column.dtype.kind, "%s")
        for column, gap in zip(columns, gaps, strict=True)
    ]
    template = ",".join(cells) + "\n"
    for start in range(0, n_rows, _ROWS_AT_ONCE):
        chunk: list[list[Any]] = [column[start : start + _ROWS_AT_ONCE].tolist() for column in columns]
        chunk = [
            ["" if value != value else repr(value) for value in values] if gap else values
            for values, gap in zip(chunk, gaps, strict=True)
        ]
        yield "".join([template % row for row in zip(*chunk, strict=True)])


def _plain(value: Any) -> Any:
    """The same value in types that strict JSON knows; None for NaN and infinities, which it does not."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, bool | int):
        return value
    return str(value)


def _own_version() -> str:
    from simulator import __version__

    return __version__


def _temporary_name(target: Path) -> Path:
    # Not `tempfile`: its files are readable by their owner alone, and keep that when renamed.
    return target.with_name(f".{target.name}.{os.urandom(6).hex()}.tmp")


def _make_directory(directory: Path, made: list[Path]) -> None:
    """Create a directory and its parents, noting in `made` those that were not there, outermost first."""
    missing = []
    while not directory.exists():
        missing.append(directory)
        directory = directory.parent
    for path in reversed(missing):
        path.mkdir(exist_ok=True)
        made.append(path)
    if not directory.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(directory))


def _refuse_directories(directory: Path, names: tuple[str, ...]) -> None:
    for name in names:
        if (directory / name).is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(directory / name))


def _discard(files: Iterable[Path], made: list[Path]) -> None:
    for file in files:
        try:
            file.unlink(missing_ok=True)
        except OSError:  # the directory itself may be what is wrong; the first error is the one to report
            pass
    for path in reversed(made):
        try:
            path.rmdir()
        except OSError:  # something else has been put there meanwhile
            break


def _output_error(directory: Path, error: OSError) -> OutputError:
    reason = error.strerror or str(error) or type(error).__name__
    place = f" ({error.filename})" if error.filename and Path(error.filename) != directory else ""
    return OutputError(f"cannot write to {str(directory)!r}: {reason}{place}")
