"""The parts of a response to a waveform that lie on one branch each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulator.model.drive import Waveform
from simulator.simulation.atlas import Exit, Response
from simulator.solver.branch import Branch

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class Part:
    """A part of a response on one branch, from one exit to the next.

    Attributes
    ----------
    number : int
        From 0.
    branch : Branch
    first : int
        The piece of the waveform in which it begins.
    corners : (n,) array
        v at its start, at the corners of the waveform within it, and at its end.
    exit : Exit or None
        What it ends with.
    """

    number: int
    branch: Branch
    first: int
    corners: FloatArray
    exit: Exit | None

    @property
    def pieces(self) -> Iterator[tuple[int, float, float]]:
        """The monotone pieces of the waveform in it on which v moves: which, and v at both ends."""
        for i in np.flatnonzero(self.corners[1:] != self.corners[:-1]).tolist():
            yield self.first + i, float(self.corners[i]), float(self.corners[i + 1])

    def passing(self, v: float) -> IntArray:
        """The pieces of the waveform in it that lead across some v."""
        one, other = self.corners[:-1], self.corners[1:]
        across = ((one < v) & (v < other)) | ((other < v) & (v < one))
        return self.first + np.flatnonzero(across)


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
        corners = np.concatenate([[v], waveform.values[first + 1 : last + 1], [target]])
        yield Part(number, branch, first, corners, exit)
        if exit is not None:
            branch, since, v = exit.onward, exit.fraction, target
