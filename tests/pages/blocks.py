"""The code blocks of a page of the docs, and what each of them claims.

- ``toml`` is parsed; a whole scenario or sweep is checked as the program checks it.
- ``python`` is run, all of a page with one set of names. With ``>>>`` it is compared line by line; without, a
  block without a language right behind it is what it prints.
- ``console`` has commands behind ``$`` and what they print. An ellipsis stands for anything.
- ``sh`` and blocks without a language are not run.

A comment right before a block says more, and no reader sees it:

- ``<!-- file: pair.toml -->``: the block is that file from here on; ``<!-- adds to: pair.toml -->``: its end.
- ``<!-- wrong file: typo.toml -->``: the same for a file that is to be refused, and is not checked.
- ``<!-- not run: reason -->``.
- ``<!-- from: results/pair/history.png -->``, before a picture: a block further up has drawn it.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

_BLOCK = re.compile(
    r"(?:^<!-- (?P<word>file|adds to|wrong file|not run): (?P<rest>.*?) -->\n+)?"
    r"^(?P<indent> *)```(?P<language>[\w{}]*)[^\n]*\n(?P<text>.*?)^(?P=indent)```[ ]*$",
    re.DOTALL | re.MULTILINE,
)

_PICTURE = re.compile(r"^<!-- from: (?P<drawn>.*?) -->\n+!\[[^\]]*\]\((?P<shown>.*?)\)", re.MULTILINE)


@dataclass(frozen=True)
class Block:
    """One code block of a page.

    `word` and `rest` are those of the comment before it, empty where there is none; `follows` says that
    nothing stands between it and the block before.
    """

    line: int
    language: str
    text: str
    word: str
    rest: str
    follows: bool


@dataclass(frozen=True)
class Picture:
    """A picture that a block further up draws: into which file, and which file the page shows."""

    line: int
    drawn: str
    shown: str


def blocks(page: str) -> list[Block]:
    """The blocks of a page in their order."""
    found: list[Block] = []
    end = 0
    for match in _BLOCK.finditer(page):
        indent = len(match["indent"])
        text = "".join(line[indent:] for line in match["text"].splitlines(keepends=True))
        follows = bool(found) and not page[end : match.start()].strip()
        line = page.count("\n", 0, match.start()) + 1
        found.append(Block(line, match["language"], text, match["word"] or "", match["rest"] or "", follows))
        end = match.end()
    return found


def pictures(page: str) -> list[Picture]:
    """The pictures of a page that its blocks draw."""
    found = _PICTURE.finditer(page)
    return [Picture(page.count("\n", 0, at.start()) + 1, at["drawn"], at["shown"]) for at in found]


def links(page: str) -> list[str]:
    """The files that a page links to, without their anchors; what stands in blocks is none."""
    text = re.sub(r"`[^`]*`", "", _BLOCK.sub("", page))
    targets = re.findall(r"\]\(([^)#\s]+)[^)]*\)", text)
    return [target for target in targets if "://" not in target]


def commands(text: str) -> list[tuple[str, str]]:
    """The commands of a console block, each with what it is to print."""
    parts = re.split(r"^\$ ", text, flags=re.MULTILINE)[1:]
    split = (part.partition("\n") for part in parts)
    return [(command, printed) for command, _, printed in split]


def agrees(printed: str, claimed: str) -> bool:
    """Whether something printed is what a page says, blanks at the ends of lines aside."""
    lines = "\n".join(line.rstrip() for line in claimed.strip().splitlines())
    pattern = ".*?".join(re.escape(part) for part in lines.split("…"))
    plain = "\n".join(line.rstrip() for line in printed.strip().splitlines())
    return re.fullmatch(pattern, plain, re.DOTALL) is not None
