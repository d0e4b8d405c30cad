"""Where samples are too far apart for their chords: beside limit points, where the curve bends.

A chord of length s, between whose ends the curve turns by the angle θ, is off the curve by about sθ/8. So
√(sθ) says how many chords a part of the curve needs, and adds up along it. It is measured on the branch in
outline.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.model.drive import Waveform

if TYPE_CHECKING:
    from simulator.solver.branch import Branch

FloatArray = NDArray[np.float64]

_AIM = 0.5  # of the distance allowed: what is measured in outline is not exact
_BETWEEN = 4  # states of the outline between two points of a branch
_FLAT = 1e-6  # of a quantity's size: what ranges over less stands still
_SHORT = 1e-9  # chords so short have no direction


def needed(columns: FloatArray, spans: FloatArray, chord: float) -> FloatArray:
    """How many chords a curve needs up to each of its points.

    Parameters
    ----------
    columns : (n, n_quantities) array
        The points of the curve in order, much closer than the chords that are wanted.
    spans : (n_quantities,) array
        What each quantity ranges over in the picture.
    chord : float
        How far a chord may be from the curve, over the spans.

    Returns
    -------
    (n,) array
        Rising from 0.
    """
    steps = np.diff(columns / spans, axis=0)
    length = np.sqrt(np.einsum("ij,ij->i", steps, steps))
    ahead = steps / np.maximum(length, _SHORT)[:, None]
    turn = np.sqrt(np.einsum("ij,ij->i", np.diff(ahead, axis=0), np.diff(ahead, axis=0)))
    turn[(length[1:] < _SHORT) | (length[:-1] < _SHORT)] = 0.0
    # Half of what the curve turns by at a point belongs to either side.
    both = np.concatenate([turn[:1], 0.5 * (turn[1:] + turn[:-1]), turn[-1:]])
    return np.concatenate([[0.0], np.cumsum(np.sqrt(length * both / (8.0 * _AIM * chord)))])


@dataclass
class Ranges:
    """What the quantities of a run have ranged over so far."""

    low: FloatArray = field(default_factory=lambda: np.empty(0))
    high: FloatArray = field(default_factory=lambda: np.empty(0))

    def widen(self, columns: FloatArray) -> None:
        """Take in some states."""
        low, high = columns.min(axis=0), columns.max(axis=0)
        if self.low.size:
            low, high = np.minimum(low, self.low), np.maximum(high, self.high)
        self.low, self.high = low, high

    @property
    def spans(self) -> FloatArray:
        """From the smallest to the largest of each; that of a quantity that stands still is infinite."""
        size = np.maximum(np.abs(self.low), np.abs(self.high))
        span = self.high - self.low
        return np.where(span > _FLAT * size, span, np.inf)


@dataclass
class _Measured:
    """A branch of `size` points in outline: v, all quantities, and how many chords it needs up to each."""

    branch: Branch
    size: int
    v: FloatArray
    columns: FloatArray
    seen: tuple[float, float] = (np.inf, -np.inf)
    spans: FloatArray = field(default_factory=lambda: np.empty(0))
    needed: FloatArray = field(default_factory=lambda: np.empty(0))


@dataclass
class Chords:
    """What is known in a run of how its branches bend; chords are to be so near their curve."""

    chord: float
    ranges: Ranges = field(default_factory=Ranges)
    _known: dict[int, _Measured] = field(default_factory=dict)

    def bend(
        self, branch: Branch, v: FloatArray, quantities: Callable[[FloatArray], FloatArray]
    ) -> tuple[FloatArray, FloatArray]:
        """The v of a branch in outline, and how many chords are needed up to each.

        Parameters
        ----------
        branch : Branch
            Of more than one point.
        v : (n,) array
            Where the run has been on it.
        quantities : callable
            All that a picture may show, (n, n_quantities), in states (n_unknowns, n).
        """
        size = branch.states.shape[1]
        known = self._known.get(id(branch))
        if known is None or known.branch is not branch or known.size != size:  # a copy of a run has others
            outline = branch.outline(_BETWEEN)
            known = self._known[id(branch)] = _Measured(branch, size, outline[-1], quantities(outline))
        low, high = min(float(v.min()), known.seen[0]), max(float(v.max()), known.seen[1])
        if known.seen != (low, high):
            known.seen = low, high
            been = known.columns[(known.v >= low) & (known.v <= high)]
            if been.size:
                self.ranges.widen(been)
        spans = self.ranges.spans
        if not np.array_equal(known.spans, spans):
            known.spans, known.needed = spans, needed(known.columns, spans, self.chord)
        return known.v, known.needed


def closer(
    fractions: FloatArray,
    waveform: Waveform,
    v: FloatArray,
    bends: Sequence[tuple[FloatArray, FloatArray]],
) -> FloatArray:
    """Fractions of a leg between some, at which further samples keep all chords on the curve.

    Parameters
    ----------
    fractions : (n,) array
        Rising, with the ends of the part of the leg that is looked at.
    waveform : Waveform
    v : (n,) array
        Of the fractions.
    bends : list of (v, needed)
        Of each branch.
    """
    grid, total = bends[0]
    if len(bends) > 1:
        grid = np.unique(np.concatenate([one for one, _ in bends]))
        total = sum((np.interp(grid, one, upto) for one, upto in bends), np.zeros(grid.size))
    at = np.interp(v, grid, total)
    pieces = np.ceil(np.abs(np.diff(at))).astype(np.int64)
    wide = np.flatnonzero(pieces > 1)
    if not wide.size:
        return np.empty(0)
    more = pieces[wide] - 1
    gap = np.repeat(wide, more)
    shares = (np.arange(gap.size) - np.repeat(np.cumsum(more) - more, more) + 1) / pieces[gap]
    wanted = np.interp(at[gap] + shares * (at[gap + 1] - at[gap]), total, grid)
    if waveform.shape == "linear" and waveform.values.size == 2:
        start, end = waveform.values
        return np.asarray((wanted - start) / (end - start))
    parts = zip(wide.tolist(), np.split(wanted, np.cumsum(more)[:-1]), strict=True)
    found = [_first_passages(waveform, fractions[k], fractions[k + 1], part) for k, part in parts]
    return np.concatenate(found)


def _first_passages(waveform: Waveform, start: float, end: float, wanted: FloatArray) -> FloatArray:
    """When v first gets to some values, in the order in which it does, between two fractions."""
    first = max(int(np.searchsorted(waveform.fractions, start, side="right")) - 1, 0)
    last = max(int(np.searchsorted(waveform.fractions, end, side="left")), first + 1)
    sign = 1.0 if wanted[-1] >= wanted[0] else -1.0
    if len(wanted) == 1:
        sign = float(np.sign(wanted[0] - waveform.at(np.array(start)))) or 1.0
    reached = np.maximum.accumulate(sign * waveform.values[first + 1 : last + 1])
    places = np.minimum(np.searchsorted(reached, sign * wanted), reached.size - 1)
    when = [waveform.when(first + k, v) for k, v in zip(places.tolist(), wanted.tolist(), strict=True)]
    return np.array(when)
