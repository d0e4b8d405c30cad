"""Draws the figures of Sun, Wang & Zhou (2015) and others: `make figures`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from tests.studies.command import parser, write_documents
from tests.studies.figures import FIGURES, MORE, draw_figures


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw all figures. Returns the exit code of `write_documents`."""
    options = parser(
        "figures",
        "Draw the figures of Sun, Wang & Zhou (2015) and the histories behind them, as SVG and PNG.",
    )
    options.add_argument(
        "--out", type=Path, metavar="DIR", default=Path("docs/figures"), help="where they go"
    )
    options.add_argument(
        "--scenarios", type=Path, metavar="DIR", default=Path("scenarios"), help="the paper's scenarios"
    )
    given = options.parse_args(arguments)
    names = tuple(f"{name}.{kind}" for name in (*FIGURES, *MORE) for kind in ("svg", "png"))
    return write_documents(given.out, names, lambda: draw_figures(given.scenarios), quiet=given.quiet)


if __name__ == "__main__":
    sys.exit(main())
