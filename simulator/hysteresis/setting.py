"""What a study of hysteresis begins with: the sealed state, and the line along which the voltages move."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.analysis.start import sealed_state
from simulator.model import groups
from simulator.model.device import Device
from simulator.model.drive import VoltageLine
from simulator.model.groups import Group
from simulator.scenario import Hold, Inflate, Jump, Problem, ScenarioError
from simulator.simulation.motion import Electrodes, motion
from simulator.simulation.present import unknowns_of

if TYPE_CHECKING:
    from simulator.scenario import PlayedStep, Scenario

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Setting:
    """Where a drive along one line of voltages begins.

    Attributes
    ----------
    device : Device
    line : VoltageLine
        Through zero; v is the voltage of the balloon with the largest share.
    groups : tuple of Group
        The sets of equations that move: with the valve closed one, with it open one of each balloon that is
        driven.
    stretch : (n_balloons,) array
    pressure : float
    highest : float
        The highest v of the scenario's own steps; 0 where they move no voltage, or along another line.
    """

    device: Device
    line: VoltageLine
    groups: tuple[Group, ...]
    stretch: FloatArray
    pressure: float
    highest: float

    def unknowns(self) -> list[FloatArray]:
        """The state y of each group at the start, where v = 0."""
        return [unknowns_of(group, self.stretch, self.pressure, 0.0) for group in self.groups]

    def states(self, of_groups: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
        """Stretches (n, n_balloons) and pressures (n,) where the groups are in n states y each."""
        count = of_groups[0].shape[1]
        stretch = np.repeat(self.stretch[None], count, axis=0)
        pressure = np.full(count, self.pressure)
        for group, y in zip(self.groups, of_groups, strict=True):
            stretch[:, list(group.members)] = y[: len(group.members)].T
            pressure[:] = group.equations.pressure(y)
        return stretch, pressure


def setting(scenario: Scenario, along: Mapping[str, float] | None) -> Setting:
    """Where a drive begins that moves the voltages of a scenario along one line.

    Parameters
    ----------
    scenario : Scenario
    along : mapping of str to float, optional
        The share of each electroded balloon, by its name; 0 for those that are not named. Default is the
        line on which the scenario's own steps move the voltages; where none does, one voltage on all.

    Raises
    ------
    ScenarioError
        If the scenario has no such drive; as `sealed_state`.
    PathError
        As `sealed_state`.
    """
    if scenario.dynamics is not None:
        raise ScenarioError(
            scenario.file,
            Problem("dynamics", None, "must not be there: these are equilibria, which take no time"),
        )
    if scenario.shape.on_loss == "stop":
        raise ScenarioError(
            scenario.file,
            Problem(
                "shape.on_loss", "stop", 'must be "record" or "ignore": this study takes balloons for spheres'
            ),
        )
    device, all_balloons, state = sealed_state(scenario)
    line, highest = _own_line(scenario) if along is None else (_line(scenario, along), 0.0)
    count = len(device.names)
    gas = all_balloons.equations.gas  # type: ignore[union-attr]
    if all_balloons.equations.is_open:
        moving = groups.actuated_open(device, line, pressure=float(state[-2]))
    else:
        moving = [groups.held(device, line, gas=gas)]
    return Setting(device, line, tuple(moving), state[:count], float(state[-2]), highest)


def _line(scenario: Scenario, along: Mapping[str, float]) -> VoltageLine:
    for name, share in along.items():
        if name not in scenario.electroded:
            allowed = f"no balloon with electrodes, has {', '.join(scenario.electroded)}"
            raise ScenarioError(scenario.file, Problem(f"along.{name}", share, allowed))
        if not np.isfinite(share):
            raise ScenarioError(scenario.file, Problem(f"along.{name}", share, "must be a number"))
    shares = [float(along.get(name, 0.0)) for name in scenario.electroded]
    line = VoltageLine.through([0.0] * len(shares), shares)
    if not any(line.rate):
        raise ScenarioError(scenario.file, Problem("along", None, "one share must be other than 0"))
    return line


def _own_line(scenario: Scenario) -> tuple[VoltageLine, float]:
    """The line through zero on which all steps of a scenario move the voltages, and the highest v on it."""
    count = len(scenario.electroded)
    found: VoltageLine | None = None
    voltage, highest = [0.0] * count, 0.0
    for number, step in enumerate(scenario.played_steps(), start=1):
        if isinstance(step, Inflate | Hold):
            continue
        lines, voltage, reached = _lines_of(step, scenario.electroded, voltage)
        highest = max(highest, reached)
        for line in lines:
            found = found or line
            if line is None or line != found or any(line.offset):
                raise ScenarioError(
                    scenario.file,
                    Problem(
                        f"step.{number}",
                        None,
                        "must move all voltages along one line through zero, the same in each step; or say "
                        f"which balloon gets which share (along, --along {scenario.electroded[0]}=1)",
                    ),
                )
    return found or VoltageLine.common(count), highest


def _lines_of(
    step: PlayedStep, electroded: Sequence[str], voltage: list[float]
) -> tuple[list[VoltageLine | None], list[float], float]:
    """The lines that a step moves the voltages along, None for what is none; where it ends; its highest v."""
    lines: list[VoltageLine | None] = []
    highest = 0.0
    for leg in motion(step, electroded, Electrodes(voltage, [0.0] * len(voltage), "voltage"), 0.0):
        way, values = leg.way, leg.waveform.values
        if not isinstance(way, VoltageLine) or way.quantity != "voltage":
            lines.append(None)
        elif any(way.rate) and (isinstance(step, Jump) or values.any()):
            lines.append(way)
            highest = max(highest, float(np.abs(values).max()))
        voltage = way.at(float(values[-1])).tolist()
    return lines, voltage, highest
