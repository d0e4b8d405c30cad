"""Every code block of every page says the truth; `make docs` runs this."""

from __future__ import annotations

import contextlib
import doctest
import io
import os
import subprocess
import sys
import tomllib
from itertools import zip_longest
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import simulator
from tests.pages.blocks import Block, agrees, blocks, commands

ROOT = Path(__file__).parents[2]
PAGES = sorted(
    page.relative_to(ROOT).as_posix()
    for page in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    if "_build" not in page.parts and page.name != "python.md"  # tests/test_python.py
)


def run_python(text: str, names: dict[str, Any]) -> str:
    """Run a block; what it prints, or what did not come out as it says."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        if ">>>" in text:
            example = doctest.DocTestParser().get_doctest(text, names, "block", None, 0)
            doctest.DocTestRunner().run(example, out=printed.write, clear_globs=False)
            names.update(example.globs)
        else:
            exec(compile(text, "block", "exec"), names)
    return printed.getvalue()


def check_console(text: str, folder: Path) -> None:
    shell = {
        **os.environ,
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "NO_COLOR": "1",
        "COLUMNS": "80",
    }
    for command, claimed in commands(text):
        done = subprocess.run(
            command, shell=True, capture_output=True, text=True, cwd=folder, env=shell, check=False
        )
        printed = done.stdout + done.stderr
        if claimed.strip() and not agrees(printed, claimed):
            raise AssertionError(f"{command} prints\n{printed}")


def check_toml(text: str, folder: Path) -> None:
    table = tomllib.loads(text)
    if {"balloon", "step", "title"} <= set(table):
        path = folder / "checked.toml"
        path.write_text(text, "utf-8")
        simulator.load_scenario(path)
    elif {"scenario", "vary"} <= set(table) and (folder / table["scenario"]).exists():
        path = folder / "checked.toml"
        path.write_text(text, "utf-8")
        simulator.read_sweep(path)


def check(block: Block, after: Block | None, folder: Path, names: dict[str, Any]) -> None:
    if block.word in ("file", "adds to"):
        with (folder / block.rest).open("w" if block.word == "file" else "a", encoding="utf-8") as file:
            file.write(block.text if block.word == "file" else f"\n{block.text}")
    match block.language:
        case "toml":
            check_toml(block.text, folder)
        case "console":
            check_console(block.text, folder)
        case "python":
            printed = run_python(block.text, names)
            claimed = "" if ">>>" in block.text else printed
            if after and after.follows and not after.language:
                claimed = after.text
            if not agrees(printed, claimed):
                raise AssertionError(f"prints\n{printed}")


@pytest.mark.parametrize("page", PAGES)
def test_every_block_says_the_truth(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "scenarios").symlink_to(ROOT / "scenarios")
    monkeypatch.chdir(tmp_path)
    found = blocks((ROOT / page).read_text("utf-8"))
    module = ModuleType("page")  # dataclasses look for the module that they are in
    monkeypatch.setitem(sys.modules, "page", module)
    names = vars(module)
    for block, after in zip_longest(found, found[1:]):
        if block.word != "not run":
            try:
                check(block, after, tmp_path, names)
            except Exception as error:
                pytest.fail(f"{page}:{block.line}: {type(error).__name__}: {error}", pytrace=False)
