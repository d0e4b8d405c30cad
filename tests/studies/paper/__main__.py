"""Writes the page on Sun, Wang & Zhou (2015): `make paper`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from tests.studies.command import parser, write_documents
from tests.studies.paper import paper_page


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the page. Returns the exit code of `write_documents`."""
    options = parser(
        "paper",
        "Write the page that holds every number of Sun, Wang & Zhou (2015) against what comes out here.",
    )
    options.add_argument(
        "--out", type=Path, metavar="FILE", default=Path("docs/paper.md"), help="where the page goes"
    )
    options.add_argument(
        "--scenarios", type=Path, metavar="DIR", default=Path("scenarios"), help="the paper's scenarios"
    )
    given = options.parse_args(arguments)
    page: Path = given.out

    def produce() -> dict[str, bytes]:
        return {page.name: paper_page(given.scenarios).encode()}

    return write_documents(page.parent, (page.name,), produce, quiet=given.quiet)


if __name__ == "__main__":
    sys.exit(main())
