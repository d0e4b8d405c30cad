"""A sweep on disk: chunks as they finish, one table when all are there, and what it all belongs to.

A directory holds `sweep.json`, which says what was asked for, and the rows: while the sweep runs one
file per chunk under `chunks/`, in the end `sweep.csv` and, where pyarrow is installed, `sweep.parquet`.
Every file appears complete or not at all, so whatever kills a sweep, what is there can be trusted.
"""

from __future__ import annotations

import csv
import io
import json
import shutil
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from simulator.results.files import OutputError, check_writable, write_files
from simulator.scenario import Problem, ScenarioError
from simulator.sweep.lockstep.chunk import ALONE, LOCKSTEP
from simulator.sweep.measures import titled
from simulator.sweep.rows import columns

if TYPE_CHECKING:
    from collections.abc import Callable

    import pyarrow as pa

    from simulator.sweep.plan import Sweep

RECORD, TABLE, PARQUET, CHUNKS = "sweep.json", "sweep.csv", "sweep.parquet", "chunks"
LOCK = ".lock"
WAYS = (LOCKSTEP, ALONE)

_CHUNKS_IN_ALL = 200  # that a sweep is cut into, or more
_FEW_ROWS = 4  # of a chunk of a small sweep
_MOST_ROWS = 1000  # of a chunk of a large one
_MOST_TOGETHER = 20_000  # of a chunk that is played in lockstep: the larger, the less each run costs
_GROUP = 1 << 23  # bytes of text that make a row group of the Parquet file


@dataclass(frozen=True)
class Store:
    """The directory of one sweep.

    Attributes
    ----------
    directory : Path
    size : int
        Runs of the sweep.
    chunk : int
        Runs of a chunk; the last may have fewer.
    kinds : mapping
        The columns and their kinds, see `rows.columns`.
    units : mapping
        Of the columns that have one.
    """

    directory: Path
    size: int
    chunk: int
    kinds: Mapping[str, str]
    units: Mapping[str, str]

    @property
    def titles(self) -> list[str]:
        """The columns as the table heads them: with their unit."""
        return titled(self.kinds, self.units)

    @property
    def count(self) -> int:
        """Number of chunks."""
        return -(-self.size // self.chunk)

    @property
    def complete(self) -> bool:
        """Whether the whole table is there."""
        return (self.directory / TABLE).is_file()

    def bounds(self, number: int) -> tuple[int, int]:
        """The first run of a chunk, and the first that is no longer in it."""
        return number * self.chunk, min((number + 1) * self.chunk, self.size)

    def rows_of(self, numbers: set[int]) -> int:
        """How many runs are in some chunks."""
        return sum(stop - start for start, stop in map(self.bounds, numbers))

    def done(self) -> set[int]:
        """The chunks that are there."""
        if self.complete:
            return set(range(self.count))
        found = (self.directory / CHUNKS).glob("[0-9]*.csv")
        return {int(path.stem) for path in found} & set(range(self.count))

    def write(self, number: int, text: str) -> None:
        """Write a chunk. Raises OutputError; what was there before is then still there."""
        content = text.encode(errors="replace")
        write_files(self.directory / CHUNKS, {_name(number): content})

    def texts(self) -> Iterator[bytes]:
        """The chunks that are there, in order."""
        for number in sorted(self.done()):
            yield (self.directory / CHUNKS / _name(number)).read_bytes()

    def finish(self) -> list[Path]:
        """Join all chunks into `sweep.csv` and `sweep.parquet`, and drop them. Raises OutputError."""
        if not self.complete:
            writers: dict[str, Callable[[BinaryIO], object]] = {}
            if find_spec("pyarrow") is not None:
                writers[PARQUET] = partial(_write_parquet, self)
            # The table goes last: where it is, all is there.
            writers[TABLE] = partial(_write_table, self)
            write_files(self.directory, writers)
            self._count_ways()
        shutil.rmtree(self.directory / CHUNKS, ignore_errors=True)
        return [path for name in (RECORD, TABLE, PARQUET) if (path := self.directory / name).is_file()]

    def _count_ways(self) -> None:
        """Say in `sweep.json` by which way the rows came."""
        counts: Counter[str] = Counter()
        for text in self.texts():
            for way in WAYS:
                counts[way] += text.count(f",{way},".encode())
        content = {**read_record(self.directory), "ways": dict(counts)}
        text_of_it = json.dumps(content, indent=1, ensure_ascii=False)
        write_files(self.directory, {RECORD: lambda stream: stream.write(f"{text_of_it}\n".encode())})


def fair_chunk(size: int, workers: int) -> int:
    """Runs of a chunk: few enough that all workers have some to the end, enough to be worth a file."""
    small = min(_FEW_ROWS, size // (8 * workers))
    return max(1, small, min(_MOST_ROWS, size // _CHUNKS_IN_ALL))


def large_chunk(size: int, workers: int) -> int:
    """Runs of a chunk that is played in lockstep: as many as leave no worker without one."""
    return max(1, min(_MOST_TOGETHER, -(-size // workers)))


def open_store(sweep: Sweep, directory: Path, *, resume: bool, chunk: int) -> Store:
    """The store of a sweep in a directory: a new one, or to go on with, the one that is there.

    Raises
    ------
    OutputError
        If the directory cannot be written to, or holds a sweep that is not to be resumed.
    ScenarioError
        If the sweep there is another one; names the first difference.
    """
    check_writable(directory, (RECORD, TABLE, PARQUET))
    kinds = columns(sweep.job)
    record = directory / RECORD
    if record.is_file():
        return _resumed(sweep, directory, kinds) if resume else _taken(directory)
    if (directory / TABLE).exists() or (directory / CHUNKS).exists():
        raise OutputError(f"cannot write to {str(directory)!r}: has results of a sweep but no {RECORD}")
    store = Store(directory, sweep.size, chunk, kinds, sweep.job.units)
    content = {
        "title": sweep.title,
        "runs": sweep.size,
        "chunk": store.chunk,
        "grid": None if sweep.sample else {axis.key: list(axis.values) for axis in sweep.axes},
        "units": dict(sweep.job.units),
        "columns": dict(kinds),
        "definition": sweep.definition,
    }
    text = json.dumps(content, indent=1, ensure_ascii=False)
    write_files(directory, {RECORD: f"{text}\n".encode()})
    return store


@contextmanager
def alone(directory: Path) -> Iterator[None]:
    """Hold a directory against a second process that would write the same sweep there.

    The system lets go of it when this process ends, however that happens.

    Raises
    ------
    OutputError
        If another process holds it.
    """
    try:
        import fcntl
    except ImportError:  # not on Windows
        yield
        return
    with open(directory / LOCK, "ab") as stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise OutputError(f"another process is at work on the sweep in {str(directory)!r}") from None
        except OSError:  # a file system without locks
            pass
        try:
            yield
        finally:
            (directory / LOCK).unlink(missing_ok=True)


def read_record(directory: Path) -> dict[str, Any]:
    """What `sweep.json` says. Raises OutputError where there is none that can be read."""
    try:
        record: dict[str, Any] = json.loads((directory / RECORD).read_bytes())
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise OutputError(f"no sweep in {str(directory)!r}: {RECORD} cannot be read, {reason}") from None
    except ValueError as error:
        raise OutputError(f"no sweep in {str(directory)!r}: {RECORD} is damaged, {error}") from None
    return record


def stored(directory: Path) -> Store:
    """The store in a directory, to read from."""
    record = read_record(directory)
    return Store(directory, record["runs"], record["chunk"], record["columns"], record["units"])


def tally(store: Store) -> tuple[Counter[str], list[tuple[int, str]]]:
    """How many runs there are of each behaviour, and number and error of each run that has one.

    Read in one pass and without a table in memory, whatever the number of runs.
    """
    names = list(store.kinds)
    place, last = names.index("behaviour"), len(names) - 1
    counts: Counter[str] = Counter()
    errors: list[tuple[int, str]] = []
    with open(store.directory / TABLE, newline="", encoding="utf-8") as stream:
        rows = csv.reader(stream)
        next(rows)
        for row in rows:
            counts[row[place]] += 1
            if row[last]:
                errors.append((int(row[0]), row[last]))
    return counts, errors


def _resumed(sweep: Sweep, directory: Path, kinds: Mapping[str, str]) -> Store:
    record = read_record(directory)
    now = json.loads(json.dumps(sweep.definition))
    for key, was, now_is in _differences(record["definition"], now):
        allowed = (
            f"is {_shown(now_is)}, but the sweep in {str(directory)!r} was begun with {_shown(was)}; "
            "put it back to go on with it, or choose another directory"
        )
        raise ScenarioError(sweep.file, Problem(key, None, allowed))
    for orphan in (directory / CHUNKS).glob(".*.tmp"):  # what a killed process was writing
        orphan.unlink(missing_ok=True)
    return Store(directory, record["runs"], record["chunk"], kinds, sweep.job.units)


def _taken(directory: Path) -> Store:
    store = stored(directory)
    ready = store.rows_of(store.done())
    raise OutputError(
        f"{str(directory)!r} holds a sweep already, {ready:,} of {store.size:,} runs; "
        "go on with it by --resume, or choose another directory"
    )


def _differences(was: Any, now: Any, key: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Places in which two nests of plain values differ."""
    if isinstance(was, dict) and isinstance(now, dict):
        for name in [*now, *(name for name in was if name not in now)]:
            quoted = f'"{name}"' if "." in name or "/" in name else name
            yield from _differences(was.get(name), now.get(name), f"{key}.{quoted}" if key else quoted)
    elif isinstance(was, list) and isinstance(now, list) and len(was) == len(now):
        for number, (a, b) in enumerate(zip(was, now, strict=True), start=1):
            yield from _differences(a, b, f"{key}.{number}")
    elif was != now:
        yield key, was, now


def _shown(value: Any) -> str:
    text = "not there" if value is None else json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 60 else f"{text[:59]}…"


def _name(number: int) -> str:
    return f"{number:07d}.csv"


def _header(store: Store) -> bytes:
    # Titles are keys, names and units of the grammar, none of which has a comma or a quote.
    return (",".join(store.titles) + "\n").encode()


def _write_table(store: Store, stream: BinaryIO) -> None:
    stream.write(_header(store))
    for text in store.texts():
        stream.write(text)


def _write_parquet(store: Store, stream: BinaryIO) -> None:
    import pyarrow.parquet as pq

    with pq.ParquetWriter(stream, _schema(store), compression="zstd") as writer:
        for group in _groups(store.texts()):
            writer.write_table(as_arrow(store, group))


def _groups(texts: Iterator[bytes]) -> Iterator[bytes]:
    group = bytearray()
    for text in texts:
        group += text
        if len(group) >= _GROUP:
            yield bytes(group)
            group.clear()
    if group:
        yield bytes(group)


def _schema(store: Store) -> pa.Schema:
    import pyarrow as pa

    types = {"number": pa.float64(), "whole": pa.int64(), "text": pa.string(), "truth": pa.bool_()}
    titles = zip(store.titles, store.kinds.values(), strict=True)
    return pa.schema([(title, types[kind]) for title, kind in titles])


def as_arrow(store: Store, text: bytes) -> pa.Table:
    """Rows of CSV text without a header as an Arrow table; an empty number is null."""
    from pyarrow import csv as arrow

    schema = _schema(store)
    return arrow.read_csv(
        io.BytesIO(text),
        read_options=arrow.ReadOptions(column_names=store.titles),
        convert_options=arrow.ConvertOptions(column_types=schema, strings_can_be_null=False),
    )
