"""Files that are either complete or not there: the only writer of results.

Nothing is ever written under its final name: see `write_files`.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import BinaryIO


class OutputError(OSError):
    """A result cannot be written where it should go; the message names the place and the reason."""


def write_files(
    directory: str | os.PathLike[str], contents: Mapping[str, bytes | Callable[[BinaryIO], object]]
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
    contents : mapping of file name to bytes or callable
        What goes into each file; a callable is called with a binary stream to write it to. Names may lead
        into folders of the directory.

    Returns
    -------
    list of Path
        The files, in the order of `contents`.

    Raises
    ------
    OutputError
        If the directory cannot be made or written to. What was there before is then still there.
    """
    directory = Path(directory)
    temporary: dict[Path, Path] = {}
    made: list[Path] = []
    try:
        _make_directory(directory, made)
        _refuse_directories(directory, tuple(contents))
        for name, content in contents.items():
            target = directory / name
            _make_directory(target.parent, made)
            temporary[target] = _temporary_name(target)
            with open(temporary[target], "xb") as stream:
                if isinstance(content, bytes):
                    stream.write(content)
                else:
                    content(stream)
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


def check_writable(directory: str | os.PathLike[str], names: tuple[str, ...]) -> None:
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
