"""What a reference says of a scenario: outcome, events, states, and where it cannot decide."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class State:
    """One state: stretches of all balloons, the pressure, and voltages of those with electrodes."""

    time: float
    step: int
    stretch: FloatArray
    pressure: float
    voltage: FloatArray


@dataclass(frozen=True)
class ReferenceEvent:
    """One event with both of its sides; `after` is None where the history ends."""

    kind: str
    step: int
    time: float
    before: State
    after: State | None
    dissipated: float | None


@dataclass(frozen=True)
class Reference:
    """A whole history.

    Attributes
    ----------
    outcome : str
    events : tuple of ReferenceEvent
    end : State or None
    step_ends : tuple of State
        At the end of each step that was played whole.
    undecided : tuple of str
        Why something might be otherwise; empty where nothing might.
    certain : int
        How many of the events are certain.
    samples : (n, n_balloons) array or None
        Stretches at `sample_times` in `sample_steps`.
    dissipated : float
        In all.
    spread : float
        How far two ways to compute it are apart, where it was computed in two ways.
    """

    outcome: str
    events: tuple[ReferenceEvent, ...]
    end: State | None
    step_ends: tuple[State, ...]
    undecided: tuple[str, ...]
    certain: int
    samples: FloatArray | None = None
    sample_times: FloatArray | None = None
    sample_steps: FloatArray | None = None
    dissipated: float = float("nan")
    spread: float = 0.0
