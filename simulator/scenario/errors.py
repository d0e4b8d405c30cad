"""What is wrong with a scenario, in the words of its file."""

from __future__ import annotations

import json
from typing import NamedTuple


class Problem(NamedTuple):
    """One thing that is wrong: the dotted key ("" for the whole file), its value (None where it has none),
    and what is allowed.
    """

    key: str
    value: object
    allowed: str


class ScenarioError(ValueError):
    """A scenario that makes no sense. Its text has one line for each problem.

    Attributes
    ----------
    file : str
        The scenario file as it was given, "<dict>" for a dict.
    key, value, allowed
        Of the first problem, see `Problem`.
    problems : tuple of Problem
    """

    def __init__(self, file: str, *problems: Problem) -> None:
        super().__init__(file, *problems)  # as `args`, so that the error survives pickling
        self.file = file
        self.problems = problems
        self.key, self.value, self.allowed = problems[0]

    def __str__(self) -> str:
        return "\n".join(
            _printable(": ".join(part for part in (self.file, _assignment(key, value), allowed) if part))
            for key, value, allowed in self.problems
        )


def _assignment(key: str, value: object) -> str:
    if value is None:
        return key
    number = isinstance(value, float)  # JSON has other names for nan and inf than TOML
    text = str(value) if number else json.dumps(value, ensure_ascii=False, skipkeys=True, default=str)
    return f"{key} = {short(text)}"


def short(text: str) -> str:
    """A text cut to fit a message."""
    return text if len(text) <= 80 else f"{text[:79]}…"


def _printable(line: str) -> str:
    # Line breaks and terminal codes can hide in any text of the user's.
    return "".join(letter if letter.isprintable() else f"\\u{ord(letter):04x}" for letter in line)
