"""Tables and files of a history: exact, complete, and never half there."""

from __future__ import annotations

import csv
import errno
import json
import os
import signal
import stat
import subprocess
import sys
import textwrap
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simulator.results.columns import COLUMNS, event_columns, history_columns
from simulator.results.csv_text import rows_of_text
from simulator.results.files import OutputError, check_writable, write_files
from simulator.results.history import Outcome
from simulator.results.tables import (
    RUN_FILES,
    events_table,
    history_table,
    write_run,
)
from tests.histories import cycled_pair, empty_pair, inflated_single, slack_pair

TESTS = Path(__file__).parent
# Since 3.1 pandas reads exactly unasked.
EXACT = {} if tuple(map(int, pd.__version__.split(".")[:2])) >= (3, 1) else {"float_precision": "round_trip"}
NAMES = ["history.csv", "events.csv", "run.json"]


def strict_json(path: Path) -> Any:
    def refuse(word: str) -> None:
        raise AssertionError(f"{word} is not JSON")

    return json.loads(path.read_text("utf-8"), parse_constant=refuse)


def cells(path: Path) -> tuple[list[str], list[list[str]]]:
    with open(path, newline="", encoding="utf-8") as stream:
        header, *rows = csv.reader(stream)
    return header, rows


def listing(directory: Path) -> list[str]:
    return sorted(path.name for path in directory.iterdir())


# --- columns ---


def test_history_columns_are_in_the_promised_order():
    assert list(history_columns(cycled_pair())) == [
        "time", "step", "branch", "cycle", "voltage_active", "stretch_active", "stretch_passive", "pressure",
        "volume", "gas", "field_active", "charge_active", "energy", "stability",
    ]  # fmt: skip


def test_history_columns_without_electrodes_have_nothing_electrical():
    assert list(history_columns(inflated_single())) == [
        "time", "step", "branch", "cycle", "stretch_only", "pressure", "volume", "gas", "energy", "stability",
    ]  # fmt: skip


def test_event_columns_keep_both_sides_of_a_balloon_together():
    assert list(event_columns(cycled_pair())) == [
        "time", "step", "cycle", "kind", "voltage_active", "stretch_active_before", "stretch_active_after",
        "stretch_passive_before", "stretch_passive_after", "pressure_before", "pressure_after",
        "field_active_before", "field_active_after", "dissipated",
    ]  # fmt: skip


@pytest.mark.parametrize("history", [cycled_pair(), slack_pair(), inflated_single(), empty_pair()])
def test_tables_and_files_have_the_same_columns(history, tmp_path):
    write_run(history, tmp_path)
    assert cells(tmp_path / "history.csv")[0] == list(history_table(history).columns)
    assert cells(tmp_path / "events.csv")[0] == list(events_table(history).columns)
    assert len(cells(tmp_path / "history.csv")[1]) == len(history)
    assert len(cells(tmp_path / "events.csv")[1]) == len(history.events)


def test_tables_carry_numbers_and_kinds():
    history = slack_pair()
    table, events = history.to_dataframe(), history.events_to_dataframe()
    np.testing.assert_array_equal(table["stretch_passive"], history.stretch[:, 1])
    assert table["branch"].dtype == np.int64
    assert list(events["kind"]) == ["loss_of_tension"]
    assert events["stretch_active_after"].isna().all()
    assert events["dissipated"].isna().all()
    assert events["stretch_passive_before"][0] == history.events[0].stretch_before[1]


# --- CSV text ---


def test_csv_reads_back_bit_for_bit(tmp_path):
    history = cycled_pair(cycles=3)
    history.to_csv(tmp_path)
    header, rows = cells(tmp_path / "history.csv")
    for name, column in zip(header, zip(*rows, strict=True), strict=True):
        np.testing.assert_array_equal([float(cell) for cell in column], history_columns(history)[name])
    header, rows = cells(tmp_path / "events.csv")
    for name, column in zip(header, zip(*rows, strict=True), strict=True):
        if name != "kind":
            np.testing.assert_array_equal([float(cell) for cell in column], event_columns(history)[name])


def test_pandas_reads_the_files_back_as_the_tables(tmp_path):
    history = cycled_pair(cycles=2)
    history.to_csv(tmp_path)
    for name, table in (("history.csv", history_table(history)), ("events.csv", events_table(history))):
        read = pd.read_csv(tmp_path / name, **EXACT)
        pd.testing.assert_frame_equal(read, table, check_exact=True, check_dtype=False)


@given(st.lists(st.floats(allow_subnormal=True), min_size=1, max_size=30))
def test_any_double_survives_and_nan_is_an_empty_cell(tmp_path_factory, values):
    history = inflated_single()
    energy = np.resize(np.array(values, dtype=float), len(history))
    directory = tmp_path_factory.mktemp("any")
    write_run(replace(history, energy=energy), directory)
    header, rows = cells(directory / "history.csv")
    written = [row[header.index("energy")] for row in rows]
    assert all((cell == "") == bool(np.isnan(value)) for cell, value in zip(written, energy, strict=True))
    read = np.array([float(cell or "nan") for cell in written])
    np.testing.assert_array_equal(
        read.view(np.int64)[~np.isnan(energy)], energy.view(np.int64)[~np.isnan(energy)]
    )


def test_after_side_is_empty_where_the_history_ends(tmp_path):
    write_run(slack_pair(), tmp_path)
    header, rows = cells(tmp_path / "events.csv")
    row = dict(zip(header, rows[0], strict=True))
    assert [name for name, cell in row.items() if cell == ""] == [
        "stretch_active_after", "stretch_passive_after", "pressure_after", "field_active_after", "dissipated",
    ]  # fmt: skip


def test_rows_of_many_chunks_are_all_there():
    columns = list(history_columns(cycled_pair()).values())
    whole = "".join(rows_of_text(columns))
    assert whole.count("\n") == columns[0].size
    assert "".join(rows_of_text(columns, rows_at_once=7)) == whole


# --- run.json ---


def test_run_json_says_what_ran_and_how_it_ended(tmp_path):
    history = cycled_pair(cycles=2)
    write_run(history, tmp_path)
    record = strict_json(tmp_path / "run.json")
    assert record["title"] == history.scenario.title
    assert record["scenario"] == history.scenario.to_dict()
    assert (record["outcome"], record["partial"], record["failure"]) == ("completed", False, None)
    assert record["counts"] == {
        "samples": len(history), "steps": 4, "branches": 5, "events": 4, "events_by_kind": {"limit_point": 4},
    }  # fmt: skip
    assert record["energy_balance"]["imbalance"] == -4e-13
    assert record["energy_balance"]["relative_imbalance"] == pytest.approx(4e-13 / 81.6)
    assert record["statistics"]["ida_steps"] == 120
    assert set(record["versions"]) == {
        "dielectric-balloons", "python", "numpy", "pandas", "scikit-sundae", "SUNDIALS",
    }  # fmt: skip
    assert all(version[0].isdigit() for version in record["versions"].values())


def test_run_json_labels_a_partial_history(tmp_path):
    write_run(slack_pair(Outcome.FAILED), tmp_path, failure="step 1, time 0.7: no convergence")
    record = strict_json(tmp_path / "run.json")
    assert record["outcome"] == "failed"
    assert record["partial"] is True
    assert record["failure"] == "step 1, time 0.7: no convergence"


def test_run_json_is_strict_even_where_numbers_are_not_finite(tmp_path):
    history = empty_pair()
    balance = replace(history.energy_balance, imbalance=float("nan"), exchanged=float("inf"))
    write_run(replace(history, energy_balance=balance), tmp_path)
    record = strict_json(tmp_path / "run.json")
    assert record["energy_balance"]["imbalance"] is None
    assert record["energy_balance"]["exchanged"] is None
    assert record["counts"]["samples"] == 0


# --- writing ---


def test_write_run_returns_its_files_and_leaves_no_others(tmp_path):
    paths = write_run(cycled_pair(), tmp_path / "deep" / "down")
    assert [path.name for path in paths] == NAMES
    assert listing(tmp_path / "deep" / "down") == sorted(NAMES)


def test_older_files_are_replaced(tmp_path):
    write_run(cycled_pair(cycles=9), tmp_path)
    write_run(slack_pair(), tmp_path)
    assert len(cells(tmp_path / "history.csv")[1]) == len(slack_pair())
    assert strict_json(tmp_path / "run.json")["outcome"] == "loss_of_tension"


@pytest.mark.skipif(os.name != "posix", reason="permission bits are POSIX")
def test_files_are_as_readable_as_any_other(tmp_path):
    (tmp_path / "plain").touch()
    for path in write_run(slack_pair(), tmp_path):
        assert stat.S_IMODE(path.stat().st_mode) == stat.S_IMODE((tmp_path / "plain").stat().st_mode)


def test_no_file_takes_its_name_before_all_are_complete_and_run_json_is_last(tmp_path, monkeypatch):
    calls = []
    fsync, rename = os.fsync, os.replace
    monkeypatch.setattr(os, "fsync", lambda number: (calls.append("sync"), fsync(number)))
    monkeypatch.setattr(os, "replace", lambda a, b: (calls.append(Path(b).name), rename(a, b)))
    write_run(cycled_pair(), tmp_path)
    assert calls == ["sync", "sync", "sync", *NAMES]


@pytest.fixture
def earlier(tmp_path):
    """A directory that holds the results of an earlier run, and their bytes."""
    directory = tmp_path / "results"
    write_run(slack_pair(), directory)
    return directory, {name: (directory / name).read_bytes() for name in NAMES}


def assert_untouched(directory: Path, contents: dict[str, bytes]) -> None:
    assert listing(directory) == sorted(contents)
    assert {name: (directory / name).read_bytes() for name in contents} == contents


@pytest.mark.parametrize("function", ["fsync", "replace"])
@pytest.mark.parametrize(
    ("error", "raised"),
    [
        (OSError(errno.ENOSPC, "No space left on device"), OutputError),
        (KeyboardInterrupt(), KeyboardInterrupt),
    ],
)
def test_failure_leaves_the_earlier_results_alone(earlier, monkeypatch, function, error, raised):
    directory, contents = earlier

    def fail(*_: object) -> None:
        raise error

    with monkeypatch.context() as patched:
        patched.setattr(os, function, fail)
        with pytest.raises(raised):
            write_run(cycled_pair(), directory)
    assert_untouched(directory, contents)


@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "No space left on device"), KeyboardInterrupt()])
def test_failure_in_the_last_file_leaves_nothing_of_the_others(tmp_path, error):
    def fail(stream: object) -> None:
        raise error

    directory = tmp_path / "new" / "results"
    with pytest.raises((OutputError, KeyboardInterrupt)):
        write_files(directory, {"a.csv": lambda stream: stream.write(b"1"), "b.csv": fail})
    assert listing(tmp_path) == []


def test_failure_names_the_place_and_the_reason(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OutputError, match=r"cannot write to '.*file.deep': Not a directory"):
        write_run(slack_pair(), tmp_path / "file" / "deep")
    assert (tmp_path / "file").read_text() == "in the way"


def in_another_process(program: str, directory: Path) -> subprocess.CompletedProcess[str]:
    header = f"""
        import os, signal, sys
        from tests.histories import cycled_pair
        from simulator.results.tables import write_run
        from simulator.results.files import OutputError
        directory = {str(directory)!r}
    """
    text = textwrap.dedent(header) + textwrap.dedent(program)
    return subprocess.run(
        [sys.executable, "-c", text], capture_output=True, text=True, cwd=TESTS.parent, check=False
    )


@pytest.mark.skipif(os.name != "posix", reason="SIGKILL is POSIX")
@pytest.mark.parametrize("survived", [0, 1, 2])
def test_killed_process_leaves_no_truncated_file(earlier, survived):
    directory, contents = earlier
    done = in_another_process(
        f"""
        fsync, left = os.fsync, {survived}
        def die_later(number):
            global left
            fsync(number)
            if left == 0:
                os.kill(os.getpid(), signal.SIGKILL)
            left -= 1
        os.fsync = die_later
        write_run(cycled_pair(), directory)
        """,
        directory,
    )
    assert done.returncode == -signal.SIGKILL, done.stderr
    assert {name: (directory / name).read_bytes() for name in NAMES} == contents
    strangers = set(listing(directory)) - set(NAMES)
    assert strangers
    assert all(name.startswith(".") and name.endswith(".tmp") for name in strangers)


@pytest.mark.skipif(os.name != "posix", reason="file size limits are POSIX")
def test_full_disk_leaves_the_earlier_results_alone(earlier):
    directory, contents = earlier
    done = in_another_process(
        """
        import resource
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (5000, resource.RLIM_INFINITY))
        try:
            write_run(cycled_pair(), directory)
        except OutputError as error:
            sys.exit(f"refused: {error}")
        """,
        directory,
    )
    assert done.stderr.startswith("refused: cannot write to"), done.stderr
    assert_untouched(directory, contents)


# --- looking before leaping ---


@pytest.mark.parametrize("place", [".", "new", "new/deeper/still"])
def test_check_writable_leaves_nothing_behind(tmp_path, place):
    check_writable(tmp_path / place, RUN_FILES)
    assert listing(tmp_path) == []


def test_check_writable_leaves_results_alone(earlier):
    directory, contents = earlier
    check_writable(directory, RUN_FILES)
    assert_untouched(directory, contents)


@pytest.mark.parametrize("place", ["file", "file/deep/down"])
def test_check_writable_refuses_a_file_in_the_way(tmp_path, place):
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="Not a directory"):
        check_writable(tmp_path / place, RUN_FILES)
    assert listing(tmp_path) == ["file"]


@pytest.mark.parametrize(
    "call",
    [
        lambda directory: check_writable(directory, RUN_FILES),
        lambda directory: write_run(slack_pair(), directory),
    ],
)
def test_a_directory_in_the_place_of_a_file_is_refused(tmp_path, call):
    (tmp_path / "events.csv").mkdir()
    with pytest.raises(OutputError, match=r"Is a directory .*events\.csv"):
        call(tmp_path)
    assert listing(tmp_path) == ["events.csv"]


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="root may write anywhere")
def test_check_writable_refuses_a_read_only_directory(tmp_path):
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(OutputError, match="Permission denied"):
            check_writable(tmp_path / "new", RUN_FILES)
    finally:
        tmp_path.chmod(0o700)


def test_output_error_is_an_os_error():
    assert issubclass(OutputError, OSError)


# --- what columns mean ---


def test_every_column_is_explained_once_and_the_page_says_the_same():
    page = (TESTS.parent / "docs/results.md").read_text("utf-8").replace("\\|", "|")
    for name, (words, unit) in COLUMNS.items():
        assert f"| `{name}` | {words} | {unit or '–'} |" in page
    for history in (cycled_pair(), inflated_single()):
        for column in (*history_columns(history), *event_columns(history)):
            assert column.partition("_")[0] in COLUMNS
