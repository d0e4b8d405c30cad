"""Stiff and extreme scenarios, each held against an exact reference or an invariant; runs made to go wrong.

`cases` is the table of the one, `sabotage` the other; `page` writes both, with the cost of the checks, to
`docs/stability.md`.
"""

from __future__ import annotations

from tests.studies.stress import inflations, many, voltages, waveforms
from tests.studies.stress.case import FAILS, Case, Finding, Row, examine

__all__ = ["FAILS", "Case", "Finding", "Row", "cases", "examine", "groups"]


def groups(rows: int = 100_000, cycles: int = 1000) -> dict[str, list[Case]]:
    """All cases by subject.

    Parameters
    ----------
    rows, cycles : int
        Rows of the noisy table, and cycles of the sine.
    """
    return {
        "Inflation and sealing": inflations.cases(),
        "Voltages, turns and coincidences": voltages.cases(),
        "Waveforms": waveforms.cases(rows, cycles),
        "Devices": many.cases(),
    }


def cases(rows: int = 100_000, cycles: int = 1000) -> list[Case]:
    """All cases, one after the other. Parameters as `groups`."""
    return [case for group in groups(rows, cycles).values() for case in group]
