"""Every code block of every page says the truth; `make docs` runs this."""

from __future__ import annotations

import contextlib
import doctest
import io
import os
import shutil
import subprocess
import sys
import tomllib
from itertools import zip_longest
from pathlib import Path
from subprocess import PIPE, STDOUT
from types import ModuleType
from typing import Any

import pytest

import simulator
from tests.pages.blocks import Block, Picture, agrees, blocks, commands, links, pictures

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
BESIDE = ["CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md"]  # of the docs
# With BALLOONS_PICTURES=1 the pictures that the blocks draw become those of the docs.
KEPT = bool(os.environ.get("BALLOONS_PICTURES"))


def walks() -> list[tuple[str, ...]]:
    """Pages that are read one after the other, in one folder: those of the tutorial, and each other one."""
    tutorial = sorted((DOCS / "tutorial").glob("[0-9]*.md"))
    others = [ROOT / "README.md", *sorted({*DOCS.rglob("*.md")} - {*tutorial, DOCS / "python.md"})]
    found = [tutorial, *([page] for page in others if "_build" not in page.parts)]
    return [tuple(page.relative_to(ROOT).as_posix() for page in pages) for pages in found]


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
            command, shell=True, stdout=PIPE, stderr=STDOUT, text=True, cwd=folder, env=shell, check=False
        )
        printed = done.stdout
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
    if block.word == "adds to":
        with (folder / block.rest).open("a", encoding="utf-8") as file:
            file.write(f"\n{block.text}")
    elif block.word:
        (folder / block.rest).write_text(block.text, "utf-8")
    match block.language:
        case "toml" if block.word != "wrong file":
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


def check_picture(picture: Picture, page: Path, folder: Path) -> None:
    assert (folder / picture.drawn).exists(), picture.drawn
    if KEPT:
        shutil.copyfile(folder / picture.drawn, page.parent / picture.shown)


def check_page(page: Path, folder: Path, names: dict[str, Any]) -> None:
    text = page.read_text("utf-8")
    found, waiting = blocks(text), pictures(text)
    for block, after in zip_longest(found, found[1:]):
        while waiting and waiting[0].line < block.line:  # a later block may draw another one into its file
            check_picture(waiting.pop(0), page, folder)
        if block.word != "not run":
            try:
                check(block, after, folder, names)
            except Exception as error:
                pytest.fail(f"{page}:{block.line}: {type(error).__name__}: {error}", pytrace=False)
    for picture in waiting:
        check_picture(picture, page, folder)


@pytest.mark.parametrize("page", [page for walk in walks() for page in walk] + BESIDE)
def test_every_link_is_to_a_file_that_is_there(page: str) -> None:
    for target in links((ROOT / page).read_text("utf-8")):
        assert ((ROOT / page).parent / target).exists(), target


@pytest.mark.parametrize("walk", walks(), ids=lambda walk: walk[0])
def test_every_block_says_the_truth(
    walk: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "scenarios").symlink_to(ROOT / "scenarios")
    monkeypatch.chdir(tmp_path)
    module = ModuleType("page")  # dataclasses look for the module that they are in
    monkeypatch.setitem(sys.modules, "page", module)
    for page in walk:
        check_page(ROOT / page, tmp_path, vars(module))
