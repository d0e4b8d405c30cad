"""What a summary says of numbers that were written without a unit beside [scales]."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from simulator import units

if TYPE_CHECKING:
    from simulator.scenario import Scenario

_SHOWN = 6


def bare_lines(scenario: Scenario) -> Iterator[str]:
    """What each number without a unit amounts to, by key, one line each; nothing without [scales]."""
    from simulator.scenario.dimensions import bare_numbers

    scales, found = scenario.scales, bare_numbers(scenario)
    if scales is None:
        return
    for bare in found[:_SHOWN]:
        amount = units.said(bare.dimension, scales, bare.value)
        table = bare.key.rpartition(".")[2] == "table" or ".table." in bare.key
        where = f"{bare.key}: no unit in its header," if table else f"{bare.key} ="
        yield f"{where} {bare.value:.6g} is {amount}"
    if len(found) > _SHOWN:
        yield f"and {len(found) - _SHOWN} more numbers without a unit"
    if found:
        yield "(numbers without a unit are multiples of [scales])"


def print_bare(scenario: Scenario) -> None:
    """Print `bare_lines`."""
    from simulator.cli.summary import say

    for line in bare_lines(scenario):
        say("units", line)
