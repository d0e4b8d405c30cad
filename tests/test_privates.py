"""Tests use a package as others do: by names that do not begin with an underscore."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parent
FILES = sorted(str(path.relative_to(ROOT)) for path in ROOT.rglob("*.py"))
PRIVATE = re.compile(r"([\w.]+\.)?_[A-Za-z]\w*")
PUBLIC_ALL_THE_SAME = {"_asdict", "_exit", "_fields", "_make", "_replace"}  # of named tuples, and of os


def privates(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Line and name of every private name that a module takes from elsewhere."""
    imported, own = names_of(tree)
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute):
            here = isinstance(node.value, ast.Name) and node.value.id in {"self", "cls"}
            # Another object of a class of this module.
            here |= node.attr in own and not (isinstance(node.value, ast.Name) and node.value.id in imported)
            found = [] if here or node.attr in PUBLIC_ALL_THE_SAME else [node.attr]
        elif isinstance(node, ast.Import):
            found = [part for alias in node.names for part in alias.name.split(".")]
        elif isinstance(node, ast.ImportFrom):
            found = [*(node.module or "").split("."), *(alias.name for alias in node.names)]
        elif isinstance(node, ast.Call):
            found = told(node.args)
        elif isinstance(node, ast.Tuple):
            found = told(node.elts)
        else:
            continue
        yield from ((node.lineno, name) for name in found if PRIVATE.fullmatch(name))


def names_of(tree: ast.AST) -> tuple[set[str], set[str]]:
    """Names that a module imports, and names of the functions and attributes that its classes define."""
    imports = [node for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom)]
    imported = {alias.asname or alias.name.partition(".")[0] for node in imports for alias in node.names}
    bodies = [part for node in ast.walk(tree) if isinstance(node, ast.ClassDef) for part in node.body]
    own = {part.name for part in bodies if isinstance(part, ast.FunctionDef)}
    own |= {p.target.id for p in bodies if isinstance(p, ast.AnnAssign) and isinstance(p.target, ast.Name)}
    return imported, own


def told(words: list[ast.expr]) -> list[str]:
    """A name told as text: alone with its module, or beside it, as in `setattr(module, "_name", 1)`."""
    texts = [word.value if isinstance(word, ast.Constant) else None for word in words]
    found = [text for text in texts[:1] if isinstance(text, str) and "." in text]
    if words and isinstance(words[0], ast.Name | ast.Attribute):
        found += [text for text in texts[1:2] if isinstance(text, str)]
    return found


@pytest.mark.parametrize("name", FILES)
def test_no_private_name_is_used(name: str) -> None:
    assert list(privates(ast.parse((ROOT / name).read_text("utf-8")))) == []


@pytest.mark.parametrize(
    "line",
    [
        "module._name",
        "module._name = 1",
        "from module import _name",
        "from module._name import other",
        "import module._name",
        "setattr(module, '_name', 1)",
        "monkeypatch.setattr('package.module._name', 1)",
        "{'a check': (module, '_name')}",
        "import module\nclass Own:\n    def _name(self): return module._name",
    ],
)
def test_every_way_to_a_private_name_is_seen(line: str) -> None:
    ((_, name),) = privates(ast.parse(line))
    assert name.endswith("_name")


@pytest.mark.parametrize(
    "line",
    [
        "self._name",
        "pair._replace(x=1)",
        "module.__doc__",
        "from __future__ import annotations",
        "f'{module}_name'",
        "{'name': '_name'}",
        "os._exit(3)",
        "class Own:\n    def _name(self): return Own()._name",
    ],
)
def test_nothing_else_is_one(line: str) -> None:
    assert list(privates(ast.parse(line))) == []
