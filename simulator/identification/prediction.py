"""What a scenario says of the measured values, for given values of its free numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from simulator.identification.branches import Branch, Compared, branches, compare
from simulator.identification.problem import Column, FitProblem, FreeNumber, MeasuredCurve, MeasuredEvent
from simulator.model.device import Device
from simulator.results.columns import history_columns
from simulator.results.history import Event, History
from simulator.scenario import Cycle, Inflate, Output, Scenario, ScenarioError, Shape, Table, until_of
from simulator.simulation.run import SolverError, simulate

FloatArray = NDArray[np.float64]

_SAMPLES = 201  # of each step; between them splines along the curve are good to 1e-7 or so
_SHORT = 1e-3  # of the stretch limit: beyond this far from it a pressure goes on straight
_ABSENT = 2.0  # a ramp goes on to so many times its end to look for an event that is not on it


class Unplayable(Exception):
    """Values with which there is no history, or none that reaches what was measured."""


@dataclass(frozen=True)
class Predicted:
    """What is compared with one table of data.

    Attributes
    ----------
    values : (n_rows, n_y) array, of an event (n_y,)
    compared : Compared or None
        Of a curve: which branch each row is compared with.
    curve : sequence of Branch
        The branches themselves.
    """

    values: FloatArray
    compared: Compared | None = None
    curve: Sequence[Branch] = ()


@dataclass
class Model:
    """The scenario of a fit as a function of its free numbers. Counts how often it is played."""

    problem: FitProblem
    played: int = 0
    scenario: Scenario = field(init=False)

    def __post_init__(self) -> None:
        scenario = self.problem.scenario
        # Of a table, between whose rows the drive is straight, all rows are samples.
        rows = [step.times.size for step in scenario.played_steps() if isinstance(step, Table)]
        points = max(_SAMPLES, scenario.output.points, *rows)
        changed: dict[str, object] = {"output": Output(points=points, chord=1.0)}
        stops = any(
            until.event == "loss_of_sphericity"
            for step in scenario.played_steps()
            if (until := until_of(step)) is not None
        )
        if scenario.shape.on_loss == "record" and not stops and not self.problem.needs_shapes:
            changed["shape"] = Shape(on_loss="ignore")
        last = [one.step for one in self.problem.measured]
        if None not in last and not any(isinstance(step, Cycle) for step in scenario.steps):
            free = [one.key.split(".")[1] for one in self.problem.free if one.key.startswith("step.")]
            needed = [number for number in last if number is not None]
            changed["steps"] = scenario.steps[: max(*needed, *map(int, free), 1)]
        self.scenario = scenario.model_copy(update=changed)

    def device(self, values: Mapping[str, float]) -> Scenario:
        """The scenario with some values of its free numbers, each in its unit. Raises Unplayable."""
        return _with(self.scenario, self.problem.free, values)

    def predict(self, values: Mapping[str, float], weights: Sequence[FloatArray]) -> list[Predicted]:
        """What is compared with each table of data.

        Parameters
        ----------
        values : mapping of str to float
            By key, in the units of the free numbers.
        weights : sequence of (n_y,) arrays
            Of each table, what its residuals are multiplied by where rows are put on branches.

        Raises
        ------
        Unplayable
            If the values make no device, or its history cannot be computed.
        """
        scenario = self.device(values)
        history: History | None = None
        found = []
        for one, weight in zip(self.problem.measured, weights, strict=True):
            if isinstance(one, MeasuredCurve) and (balloon := inflated(one, scenario)) is not None:
                found.append(_on_inflation(one, scenario, balloon))
                continue
            if history is None:
                history = self.history(scenario)
            if isinstance(one, MeasuredCurve):
                found.append(_on_history(one, history, weight))
            else:
                found.append(Predicted(self._of_event(one, history)))
        return found

    def drawn(
        self, one: MeasuredCurve, values: Mapping[str, float], grids: Sequence[FloatArray], slope: FloatArray
    ) -> list[FloatArray]:
        """A curve at some x of each of its branches, each (n, n_y); fewer where it has fewer branches.

        Raises
        ------
        Unplayable
            As `predict`.
        """
        scenario = self.device(values)
        if (balloon := inflated(one, scenario)) is not None:
            return [_inflation(one.x, grid, scenario, balloon) for grid in grids]
        found = _branches(one, self.history(scenario))
        return [branch.at(grid, slope)[0] for branch, grid in zip(found, grids, strict=False)]

    def history(self, scenario: Scenario) -> History:
        """The history of a scenario. Raises Unplayable."""
        self.played += 1
        try:
            return simulate(scenario)
        except (SolverError, ScenarioError, ArithmeticError) as error:
            raise Unplayable(str(error)) from None

    def _of_event(self, one: MeasuredEvent, history: History) -> FloatArray:
        """The quantities of an event; of one that is not there, those it has on a longer ramp."""
        event = _event(one, history)
        if event is None:
            event = _event(one, self.history(_prolonged(history.scenario)))
        if event is None:
            raise Unplayable(f"there is no {one.label}")
        return np.array([_of_event(event, column.name, history) for column in one.y])


def _with(scenario: Scenario, free: Sequence[FreeNumber], values: Mapping[str, float]) -> Scenario:
    try:
        return scenario.with_values({one.key: one.written(values[one.key]) for one in free})
    except ScenarioError as error:
        raise Unplayable(str(error)) from None


def inflated(curve: MeasuredCurve, scenario: Scenario) -> int | None:
    """The balloon of which a pressure over the stretch is a formula; None where it is none.

    Under an open valve every stretch has one pressure at which the balloon is in equilibrium, stable at a
    given pressure or not: who measures a pressure over the stretch has pumped a volume.
    """
    if scenario.dynamics is not None or [column.name for column in curve.y] != ["pressure"]:
        return None
    word, _, name = curve.x.name.partition("_")
    steps = list(scenario.played_steps())
    last = len(steps) if curve.step is None else curve.step
    if word not in ("stretch", "radius", "diameter") or not all(isinstance(s, Inflate) for s in steps[:last]):
        return None
    return [balloon.name for balloon in scenario.balloons].index(name)


def _on_inflation(curve: MeasuredCurve, scenario: Scenario, balloon: int) -> Predicted:
    return Predicted(_inflation(curve.x, curve.at, scenario, balloon))


def _inflation(x: Column, at: FloatArray, scenario: Scenario, balloon: int) -> FloatArray:
    """The pressure over a stretch, or what it is measured as, (n, 1)."""
    pressure = inflation_pressure(Device.from_scenario(scenario), balloon, at / _unstretched(x, scenario))
    return (scenario.scales.pressure if scenario.scales else 1.0) * pressure[:, None]


def inflation_pressure(device: Device, balloon: int, stretch: FloatArray) -> FloatArray:
    """The pressure at which a balloon without a voltage is in equilibrium at some stretches, (n,).

    Up to the stretch limit, and from just before it on along the tangent there, so that a limit that a
    measured stretch exceeds is a large misfit and not an infinite one.
    """
    wall = device.walls[balloon]
    limit = wall.elastomer.stretch_limit
    highest = limit * (1.0 - _SHORT) if np.isfinite(limit) else np.inf
    inside = np.minimum(stretch, highest)

    def pressure(at: FloatArray) -> FloatArray:
        numerator, denominator = wall.elastomer.pole_form(at)
        return np.asarray(numerator / (denominator * (wall.pressure_load * at * at)))

    found = pressure(inside)
    if (stretch > highest).any():
        least = highest * (1.0 - _SHORT)
        slope = (pressure(np.array([highest])) - pressure(np.array([least]))) / (highest - least)
        found = found + np.maximum(stretch - highest, 0.0) * slope
    return found


def _on_history(curve: MeasuredCurve, history: History, weight: FloatArray) -> Predicted:
    found = _branches(curve, history)
    compared = compare(found, curve.at, curve.values, weight)
    return Predicted(compared.values, compared, found)


def _branches(curve: MeasuredCurve, history: History) -> tuple[Branch, ...]:
    """The branches that a file is compared with, one or more. Raises Unplayable."""
    columns = [_column(history, column) for column in (curve.x, *curve.y)]
    found = branches(
        columns[0],
        np.column_stack(columns[1:]),
        history.step,
        history.branch,
        broken=history.outcome.value != "completed",
        cornered=[n for n, step in enumerate(history.scenario.played_steps(), 1) if isinstance(step, Table)],
    )
    found = tuple(one for one in found if curve.step in (None, one.step))
    if not found:
        where = "the history" if curve.step is None else f"step {curve.step}"
        raise Unplayable(f"{curve.label}: {curve.x.name} does not change in {where}")
    return found


def _column(history: History, column: Column) -> FloatArray:
    """A quantity of a history in the numbers of measured ones."""
    word, _, name = column.name.partition("_")
    if word in ("stretch", "radius", "diameter"):
        at = history.balloons.index(name)
        return np.asarray(history.stretch[:, at] * _unstretched(column, history.scenario))
    columns = history_columns(history)
    if history.scenario.scales is not None and column.dimension is not None:
        return np.asarray(columns[f"{column.name} [{column.dimension.unit}]"])
    return np.asarray(columns[column.name])


def _unstretched(column: Column, scenario: Scenario) -> float:
    """What a stretch is multiplied by to be a quantity."""
    word, _, name = column.name.partition("_")
    for side in ("_before", "_after"):
        name = name.removesuffix(side)
    if word == "stretch":
        return 1.0
    radius = next(balloon.radius for balloon in scenario.balloons if balloon.name == name)
    size = radius * (scenario.scales.radius if scenario.scales else 1.0)
    return float(size * (2.0 if word == "diameter" else 1.0))


def _event(one: MeasuredEvent, history: History) -> Event | None:
    """The event that was measured, None where the history has none."""
    there = [e for e in history.events if e.kind is one.kind and one.step in (None, e.step)]
    return there[one.number - 1] if len(there) >= one.number else None


def _of_event(event: Event, quantity: str, history: History) -> float:
    """A quantity of an event, before it unless the name says otherwise."""
    side = "after" if quantity.endswith("_after") else "before"
    word, _, name = quantity.removesuffix("_after").removesuffix("_before").partition("_")
    scales = history.scenario.scales
    if word in ("stretch", "radius", "diameter"):
        stretch = getattr(event, f"stretch_{side}")
        size = _unstretched(Column(f"{word}_{name}", "", 1.0, None), history.scenario)
        return float("nan") if stretch is None else float(stretch[history.balloons.index(name)]) * size
    if word == "time":
        return event.time
    value = getattr(event, word if word == "voltage" else f"{word}_{side}")
    if value is None:
        raise Unplayable(f"{quantity}: the history ends at that event")
    number = float(value if word == "pressure" else value[history.electroded.index(name)])
    return number * (getattr(scales, word) if scales else 1.0)


def _prolonged(scenario: Scenario) -> Scenario:
    """A scenario whose last ramp or inflation, of numbers, goes on further. Raises Unplayable."""
    changed = list(scenario.steps)
    for place, step in reversed(list(enumerate(changed))):
        for word in ("ramp", "inflate"):
            value = getattr(step, word, None)
            if isinstance(value, float) and value != 0.0:
                update = {word: _ABSENT * value, "over": _ABSENT * float(getattr(step, "over", 1.0))}
                changed[place] = step.model_copy(update=update)
                return scenario.model_copy(update={"steps": tuple(changed)})
    raise Unplayable("no ramp can be prolonged")
