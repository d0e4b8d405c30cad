"""Quasi-static histories of any scenario: steps played one after the other on branches, events, and flows.

Where docs/physics.md and docs/scenario-format.md leave something open it is decided so, by physics:

- Voltages and the valve that change at one instant change together: one jump, at the new voltages and with
  the new valve, from the present stretches.
- With the valve open a jump is one flow of all balloons in one time; the first thing that ends it stops it.
- So do balloons that are alike and snap at one instant; of others that do, with one ending the history, it is
  undecided where they then are.
- A state let go without a change of voltage leaves along its unstable direction, to the side on which the
  potential falls more, until where that flow ends (a runaway falls without end). Several such directions, or
  balloons whose common flow ends on the way, are undecided.
- A film beyond its strength at the instant of a jump breaks at the stretches that it had.
- At zero pressure with the valve closed tension is lost at once where the drive would lower the pressure.
"""

from __future__ import annotations

import os

import numpy as np

from tests.oracle.general.player import Player
from tests.oracle.general.record import Reference
from tests.oracle.general.scenario import Document, Scenario, read


def play(source: Document | str | os.PathLike[str] | Scenario, *, integrators: int = 2) -> Reference:
    """The history of a quasi-static scenario, a dict or the path of a file.

    Where the reference itself fails, what it has got so far is returned as undecided, with the outcome
    "failed". With one of the `integrators` alone, what a flow does has no check here.

    Raises
    ------
    ValueError
        For a scenario with [dynamics].
    """
    scenario = source if isinstance(source, Scenario) else read(source)
    if scenario.in_real_time:
        raise ValueError("a scenario with [dynamics] is none of this reference")
    player = Player(scenario, integrators)
    try:
        for step in scenario.steps:
            player.play(step)
            if player.outcome != "completed":
                break
    except (ArithmeticError, np.linalg.LinAlgError) as failure:
        player.undecided(f"the reference fails: {failure}")
        player.outcome = "failed"
    return player.journal.reference(player.outcome, player.state())
