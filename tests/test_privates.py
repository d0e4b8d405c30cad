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
OF_NAMEDTUPLES = {"_asdict", "_fields", "_make", "_replace"}


def privates(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Line and name of every private name that a module takes from elsewhere."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute):
            own = isinstance(node.value, ast.Name) and node.value.id in {"self", "cls"}
            if PRIVATE.fullmatch(node.attr) and not own and node.attr not in OF_NAMEDTUPLES:
                yield node.lineno, node.attr
        elif isinstance(node, ast.ImportFrom | ast.Import):
            module = node.module or "" if isinstance(node, ast.ImportFrom) else ""
            for name in (*module.split("."), *(part for n in node.names for part in n.name.split("."))):
                if PRIVATE.fullmatch(name):
                    yield node.lineno, name
        # As in `setattr(module, "_name", ...)`.
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and PRIVATE.fullmatch(node.value):
            yield node.lineno, node.value


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
    ],
)
def test_every_way_to_a_private_name_is_seen(line: str) -> None:
    ((_, name),) = privates(ast.parse(line))
    assert name.endswith("_name")


@pytest.mark.parametrize(
    "line",
    ["self._name", "pair._replace(x=1)", "module.__doc__", "from __future__ import annotations", "'a _name'"],
)
def test_nothing_else_is_one(line: str) -> None:
    assert list(privates(ast.parse(line))) == []
