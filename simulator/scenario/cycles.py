"""Which cycle of a history every played step belongs to."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from simulator.scenario.steps import Cycle, PlayedStep, Step, periods_of

_WHOLE = 1e-9  # of a period: what rounding leaves of a whole number of them


@dataclass(frozen=True)
class Count:
    """The cycles that a played step belongs to.

    Attributes
    ----------
    first : int
        Number of the cycle in which it begins, from 1; 0 for a step outside of all cycles.
    periods : float
        How many periods of its own it has, each of them a cycle; 0 for a step that is a part of one.
    closes : bool
        Whether a repetition of a `cycle` ends with it.
    """

    first: int = 0
    periods: float = 0.0
    closes: bool = False

    @property
    def whole(self) -> bool:
        """Whether its last period is complete."""
        return abs(self.periods - round(self.periods)) <= _WHOLE


def counted(steps: Iterable[Step]) -> Iterator[tuple[PlayedStep, Count]]:
    """Steps in the order they are played, each with the cycles that it belongs to.

    A cycle is a period of a sine or triangle, or a repetition of `cycle`; where these are nested, the
    innermost that is repeated. Cycles are numbered from 1 through the whole history.
    """
    yield from _counted(steps, itertools.count(1))


def _counted(steps: Iterable[Step], numbers: Iterator[int]) -> Iterator[tuple[PlayedStep, Count]]:
    for step in steps:
        if not isinstance(step, Cycle):
            periods = periods_of(step)
            used = [next(numbers) for _ in range(math.ceil(periods - _WHOLE))]
            yield step, Count(used[0], periods) if used else Count()
        elif _repeats(step.steps):
            for _ in range(step.cycle):
                yield from _counted(step.steps, numbers)
        else:
            for number in itertools.islice(numbers, step.cycle):
                for place, one in enumerate(step.steps, start=1):
                    assert not isinstance(one, Cycle)
                    yield one, Count(number, closes=place == len(step.steps))


def _repeats(steps: Iterable[Step]) -> bool:
    """Whether anything is repeated within some steps."""
    return any(isinstance(step, Cycle) or periods_of(step) > 1.0 for step in steps)
