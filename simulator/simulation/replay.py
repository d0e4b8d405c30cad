"""Runs that begin alike: the last one is kept, step by step, and another goes on from where they part."""

from __future__ import annotations

import copy
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from simulator.scenario import PlayedStep, Scenario
    from simulator.simulation.run import Run

_MOST_STEPS = 16


class Replay:
    """What is kept of the last scenario that `simulate` was given this with.

    The next one that has the same device, output and solver, and begins with the same steps, is played from
    there on only. What comes out is the same to the last bit as without. It is for one thread at a time.

    Parameters
    ----------
    most : int
        After how many steps, from the first, a run is kept: the memory that it takes at most.

    Examples
    --------
    >>> from simulator import Replay, load_scenario, simulate
    >>> scenario, replay = load_scenario("scenarios/fig3c_state_b.toml"), Replay()
    >>> for voltage in (0.3, 0.35, 0.4):  # inflated once
    ...     history = simulate(scenario.with_values({"step.2.ramp": voltage}), replay=replay)
    >>> replay.known(scenario.with_values({"step.2.ramp": 0.2}))
    1
    """

    def __init__(self, most: int = _MOST_STEPS) -> None:
        if most < 1:
            raise ValueError(f"most = {most} must be at least 1")
        self.most = most
        self._device: Scenario | None = None  # without its steps
        self._kept: list[tuple[PlayedStep, Run]] = []

    def known(self, scenario: Scenario) -> int:
        """With how many steps, from the first, a scenario begins that need not be played again."""
        if self._device is None or self._device != _without_steps(scenario):
            return 0
        count = 0
        for step, (other, _) in zip(scenario.played_steps(), self._kept, strict=False):
            if step != other:
                break
            count += 1
        return count

    def begin(self, scenario: Scenario) -> tuple[Run | None, int]:
        """The run of a scenario as far as it is known, None where nothing is; and the steps it has played.

        What is known beyond that is forgotten.
        """
        count = self.known(scenario)
        if not count:
            self._device = _without_steps(scenario)
        del self._kept[count:]
        return (_copied(self._kept[-1][1], scenario) if count else None), count

    def keep(self, run: Run, step: PlayedStep) -> None:
        """Keep a run of the scenario begun last as it is after its next step."""
        if len(self._kept) < self.most:
            self._kept.append((step, _copied(run, run.scenario)))


def _without_steps(scenario: Scenario) -> Scenario:
    return scenario.model_copy(update={"steps": ()})


def _copied(run: Run, scenario: Scenario) -> Run:
    """The same run of a scenario that may have other steps to come; what never changes is shared."""
    device = run.record.present.device
    shared = {id(one): one for one in (device, *device.elastomers)}
    return copy.deepcopy(run, {**shared, id(run.scenario): scenario})
