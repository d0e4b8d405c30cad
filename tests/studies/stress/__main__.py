"""Plays stiff and extreme scenarios, and runs made to go wrong: `make stress`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from tests.studies.command import at_least_one, parser, write_documents
from tests.studies.stress.page import FULL, Effort, stability_page

FILE = "stability.md"


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the page. Returns the exit code of `write_documents`."""
    options = parser(
        "stress",
        f"Play stiff and extreme scenarios, and runs made to go wrong; write {FILE} (takes minutes).",
    )
    options.add_argument("--out", type=Path, metavar="DIR", default=Path("docs"), help=f"where {FILE} goes")
    options.add_argument(
        "--scenarios", type=Path, metavar="DIR", default=Path("scenarios"), help="the paper's scenarios"
    )
    counts = {
        "repeat": (FULL.repetitions, "repetitions of every case"),
        "rows": (FULL.rows, "rows of the noisy table"),
        "cycles": (FULL.cycles, "cycles of the sine"),
        "pairs": (FULL.pairs, "random pairs to disturb"),
    }
    for name, (default, what) in counts.items():
        options.add_argument(f"--{name}", type=at_least_one, metavar="N", default=default, help=what)
    given = options.parse_args(arguments)
    effort = Effort(given.repeat, given.rows, given.cycles, given.pairs)

    def produce() -> dict[str, bytes]:
        return {FILE: stability_page(given.scenarios, given.out / "fuzz.json", effort).encode()}

    return write_documents(given.out, (FILE,), produce, quiet=given.quiet)


if __name__ == "__main__":
    sys.exit(main())
