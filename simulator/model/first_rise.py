"""Where a voltage or charge that falls begins to rise."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from simulator.model.drive import AffineDrive, Drive

_AFTER = 1e-4  # of what is left of a way: right at a turn rounding says which way it goes


def first_rise(drives: Iterable[Drive], values: NDArray[np.float64]) -> tuple[int, float] | None:
    """Where the magnitude of one of several drives first grows as v goes through some values.

    Returns
    -------
    (int, float) or None
        After which of the values, and at which v; None where none ever grows.
    """
    drives = list(drives)
    for part, (v, target) in enumerate(pairwise(values.tolist())):
        found = [at for drive in drives if (at := _rises_at(drive, v, target)) is not None]
        if found:
            return part, min(found, key=lambda at: abs(at - v))
    return None


def _rises_at(drive: Drive, v: float, target: float) -> float | None:
    """Where the magnitude begins to grow on the way from one v to another."""
    if drive.grows(v, target):
        return v
    turns = sorted(_turns(drive, v, target), key=lambda at: abs(at - v))
    ahead = (at for at in turns if abs(at - v) < abs(target - v))
    return next((at for at in ahead if drive.grows(at + _AFTER * (target - at), target)), None)


def _turns(drive: Drive, v: float, target: float) -> list[float]:
    """Where ahead of v the magnitude may turn: at extremes, and where it is zero."""
    if isinstance(drive, AffineDrive):
        crosses = drive.at(v) * drive.at(target) < 0.0
        return [-drive.offset / drive.rate] if crosses else []
    zero = np.arcsin(np.clip(-drive.mean / drive.amplitude, -1.0, 1.0)) / (2.0 * np.pi)
    turns = np.array([0.25, 0.75, zero, 0.5 - zero]) - drive.phase
    ways = (turns - v) % 1.0 if target > v else -((v - turns) % 1.0)
    return [float(at) for at in v + ways]
