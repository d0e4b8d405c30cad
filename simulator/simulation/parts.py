"""The parts of a response to a waveform that lie on one branch each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from simulator.model.drive import Waveform
from simulator.simulation.atlas import Exit, Response
from simulator.solver.branch import Branch


@dataclass(frozen=True)
class Part:
    """A part of a response on one branch, from one exit to the next.

    `pieces` are the monotone pieces of the waveform in it: which, and v at both ends.
    """

    number: int
    branch: Branch
    pieces: tuple[tuple[int, float, float], ...]
    exit: Exit | None


def parts_of(response: Response, waveform: Waveform) -> Iterator[Part]:
    """The parts of a response on its branches, in order."""
    branch, since, v = response.branch, 0.0, float(waveform.values[0])
    for number in range(len(response.exits) + 1):
        if branch is None:
            return
        exit = response.exits[number] if number < len(response.exits) else None
        end = 1.0 if exit is None else exit.fraction
        target = float(waveform.values[-1]) if exit is None else float(exit.before[-1])
        first = int(np.searchsorted(waveform.fractions[:-1], since, side="right")) - 1
        last = max(int(np.searchsorted(waveform.fractions, end, side="left")) - 1, first)
        corners = [v, *waveform.values[first + 1 : last + 1].tolist(), target]
        pieces = [(first + i, corners[i], corners[i + 1]) for i in range(len(corners) - 1)]
        yield Part(number, branch, tuple(piece for piece in pieces if piece[1] != piece[2]), exit)
        if exit is not None:
            branch, since, v = exit.onward, exit.fraction, target
