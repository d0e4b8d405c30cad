"""What the steps of a scenario ask for, as data: valve, and where the drive goes, corner by corner."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice

from simulator.model import drive
from simulator.scenario import (
    Hold,
    Inflate,
    Jump,
    Ramp,
    RecordingByName,
    Scenario,
    Sine,
    SineWave,
    Table,
    Triangle,
    TriangleWave,
    until_of,
)

_MOST_CORNERS = 200  # of all steps together: longer histories come back to branches that `simulate` keeps


class NotCovered(Exception):
    """A scenario, or what varies in it, is not for lockstep; the message says why."""


@dataclass(frozen=True)
class Move:
    """One step, its cycles unrolled.

    Attributes
    ----------
    kind : str
        "inflate" (the pressure moves), "hold", "ramp", "jump" or "wave" (all voltages together, through
        corners; to the first of them at once).
    valve_open : bool
        During the step.
    number : int
        Of the step as written, from 1; 0 within a cycle.
    targets : tuple
        The pressure; the voltage of each electrode, None for one that stays; or the corners.
    """

    kind: str
    valve_open: bool
    number: int
    targets: tuple[float | None, ...]


def programme(scenario: Scenario) -> tuple[Move, ...]:
    """The steps of a scenario. Raises NotCovered."""
    if scenario.dynamics is not None:
        raise NotCovered("real time")
    if scenario.shape.on_loss == "stop":
        raise NotCovered("a history that ends with a sphere")
    places = {id(step): number for number, step in enumerate(scenario.steps, start=1)}
    moves: list[Move] = []
    corners = 0
    for step in islice(scenario.played_steps(), _MOST_CORNERS + 1):
        if until_of(step) is not None:
            raise NotCovered("until")
        number = places.get(id(step), 0)
        match step:
            case Inflate():
                move = Move("inflate", True, number, (step.inflate,))
            case Hold():
                move = Move("hold", step.valve == "open", number, ())
            case Ramp():
                move = Move("ramp", step.valve == "open", number, _by_name(step.ramp, scenario))
            case Jump():
                move = Move("jump", step.valve == "open", number, _by_name(step.jump, scenario))
            case Sine(sine=SineWave() as wave):
                values = drive.sine(wave.mean, wave.amplitude, wave.cycles).values
                move = Move("wave", step.valve == "open", number, tuple(values.tolist()))
            case Triangle(triangle=TriangleWave() as sides):
                values = drive.triangle(sides.low, sides.high, sides.cycles).values
                move = Move("wave", step.valve == "open", number, tuple(values.tolist()))
            case Table(table=table) if not isinstance(table, RecordingByName):
                values = drive.table(step.times, step.voltages).values
                move = Move("wave", step.valve == "open", number, tuple(values.tolist()))
            case _:
                raise NotCovered(f"a step {type(step).__name__.lower()}")
        corners += 1 + len(move.targets)
        if corners > _MOST_CORNERS:
            raise NotCovered("so many steps")
        moves.append(move)
    return tuple(moves)


def _by_name(wanted: float | dict[str, float], scenario: Scenario) -> tuple[float | None, ...]:
    return tuple(
        wanted.get(name) if isinstance(wanted, dict) else float(wanted) for name in scenario.electroded
    )
