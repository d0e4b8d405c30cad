"""Scenarios kept as JSON files, with the tables that they read."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

Document = dict[str, Any]

TABLES = "tables"  # key of a kept scenario: its CSV files by name
PATHS = ("table", "file")


def tables_of(document: Any) -> list[str]:
    """Paths of all tables that a scenario names."""
    if isinstance(document, dict):
        own = [v for k, v in document.items() if k in PATHS and isinstance(v, str)]
        return own + list(itertools.chain.from_iterable(map(tables_of, document.values())))
    if isinstance(document, list):
        return list(itertools.chain.from_iterable(map(tables_of, document)))
    return []


def keep(document: Document, file: Path, **more: Any) -> None:
    """Write a scenario with its tables into one JSON file."""
    tables = {Path(path).name: Path(path).read_text() for path in tables_of(document)}
    kept = {**more, "scenario": _renamed(document, lambda path: Path(path).name), TABLES: tables}
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(kept, indent=1) + "\n")


def kept(file: Path, folder: Path) -> Document:
    """The scenario of such a file; its tables are written into a folder."""
    content = json.loads(file.read_text())
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in content.get(TABLES, {}).items():
        (folder / name).write_text(text)
    document: Document = _renamed(content["scenario"], lambda name: str(folder / name))
    return document


def _renamed(item: Any, rename: Any) -> Any:
    if isinstance(item, list):
        return [_renamed(part, rename) for part in item]
    if not isinstance(item, dict):
        return item
    return {
        key: rename(value) if key in PATHS and isinstance(value, str) else _renamed(value, rename)
        for key, value in item.items()
    }
