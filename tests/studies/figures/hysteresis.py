"""What a voltage that comes and goes can write, and what it leaves behind."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from simulator.hysteresis.states import states
from simulator.hysteresis.unloading import unload

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIVE = "five_states.toml"


def draw_states(scenarios: Path) -> Figure:
    """The states of five actuators on one gas, from the folder of the scenario files."""
    return states(scenarios / FIVE).plot()


def draw_unloading(scenarios: Path) -> Figure:
    """What five actuators keep from every peak, from the folder of the scenario files."""
    return unload(scenarios / FIVE, "0.3:0.6:61", points=15).plot()
