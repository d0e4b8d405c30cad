"""What a reader sees of a sample in the terminal: how likely, how wide, and why."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from simulator.cli.summary import print_files, print_table

if TYPE_CHECKING:
    from rich.table import Table

    from simulator.sweep.quantiles import Uncertainty

_SHOWN = re.compile(r"limit_point_\d+_voltage_.*|landing_.*|largest_.*|residual_.*|loop_work")


def summarise_uncertainty(found: Uncertainty, paths: Sequence[Path]) -> None:
    """Say how likely each behaviour is, between which values results lie, and what they owe it to."""
    print("\nlikely   probability, 95 % interval")
    for name, one in found.probabilities.items():
        print(f"         {one.value:>9.4f}  {one.low:.4f} to {one.high:.4f}  {name}")
    print()
    print_table(_quantiles(found))
    for indices in found.indices:
        print(f"indices  of {indices.column}: alone, with all others")
        for key, first, total in zip(indices.keys, indices.first_order, indices.total_order, strict=True):
            print(f"         {first:>9.3f} {total:>9.3f}  {key}")
    print_files(paths)


def _quantiles(found: Uncertainty) -> Table:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False, padding=(0, 1, 0, 0))
    table.add_column("column", no_wrap=True)
    for heading in ("2.5 %", "median", "97.5 %"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    for name in found.quantiles:
        if _SHOWN.fullmatch(name):
            values = (found.quantile(name, share) for share in (0.025, 0.5, 0.975))
            table.add_row(name, *(f"{value:.5g}" for value in values), found.units.get(name, ""))
    return table
