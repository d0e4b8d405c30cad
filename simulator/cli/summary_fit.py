"""What a reader sees of a fit in the terminal."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING

from simulator.cli.summary import print_files, print_table, printable, say

if TYPE_CHECKING:
    from rich.table import Table

    from simulator.results.fit import Estimate, Fit
    from simulator.results.fit_ranking import Ranked

_STRONG = 0.9  # a correlation that is worth a line


def summarise_fit(fit: Fit, paths: Sequence[Path]) -> None:
    """Say what a fit found, and what the data do not tell."""
    print(printable(fit.title))
    print(f"\nvalues   {fit.size:,} measured, {len(fit.estimates)} numbers sought")
    print_table(_estimates(fit))
    for label, line in _lines(fit):
        say(label, line)
    print_files(paths)


def summarise_ranking(ranked: Sequence[Ranked], paths: Sequence[Path]) -> None:
    """Say which of several candidates the data speak for."""
    print("\nranking  AICc over the best, weight")
    for one in ranked:
        print(f"         {one.delta:>10.2f} {one.weight:>7.3f}  {printable(one.fit.title)} ({one.fit.file})")
    print_files(paths)


def _estimates(fit: Fit) -> Table:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False, padding=(0, 1, 0, 0))
    table.add_column("number", overflow="fold")
    for heading in ("estimate", "standard\nerror", f"{100.0 * fit.confidence:g} %\nfrom", "\nto"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    for one in fit.estimates:
        cells = (one.value, one.standard_error, one.low, one.high)
        table.add_row(one.key, *(_number(cell, one) for cell in cells), one.unit)
    return table


def _number(value: float, one: Estimate) -> str:
    """A number with as many digits as its standard error gives a meaning to, and one more."""
    if math.isnan(value):
        return "?"
    digits = 6
    if one.standard_error > 0.0 and one.value:
        digits = 2 + max(0, math.ceil(math.log10(abs(one.value) / one.standard_error)))
    return f"{value:.{min(max(digits, 3), 10)}g}"


def _lines(fit: Fit) -> Iterator[tuple[str, str]]:
    """What else there is to be said, by label."""
    yield "chi2", f"{fit.reduced_chi2:.4g} per degree of freedom, of which there are {fit.degrees}"
    yield "interval", f"by {fit.intervals}"
    keys = [one.key for one in fit.estimates]
    for (i, one), (j, other) in combinations(enumerate(keys), 2):
        if abs(fit.correlation[i, j]) > _STRONG:
            yield "", f"{one} and {other} are correlated, {fit.correlation[i, j]:.3f}"
    for open_one in fit.undetermined:
        yield "unknown", f"the data do not tell {open_one.words}"
    for key in fit.at_bounds:
        yield "bound", f"{key} is at its bound: no standard error"
    beyond = sum(int(column.beyond.sum()) for column in fit.columns)
    if beyond:
        rows = "1 row lies" if beyond == 1 else f"{beyond} rows lie"
        yield "beyond", f"{rows} beyond the end of the branch that they are compared with"
    if len(fit.starts) > 1:
        best = fit.starts[0]
        same = sum(abs(one - best) < 1e-3 * (1.0 + best) for one in fit.starts)
        yield "starts", f"{same} of {len(fit.starts)} led to the best minimum"
    yield "cost", f"{fit.played:,} histories"
