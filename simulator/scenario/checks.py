"""Checks of a scenario as a whole: names that must agree, and how much is asked for."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Protocol

from pydantic import BaseModel

from simulator.scenario.device import Balloon, Gas
from simulator.scenario.errors import Problem
from simulator.scenario.settings import Dynamics, Output, Shape, Supply
from simulator.scenario.steps import (
    Charge,
    Cycle,
    Hold,
    Inflate,
    Jump,
    Ramp,
    Sine,
    Step,
    Table,
    Triangle,
    Until,
    duration,
    numbered,
    periods_of,
    until_of,
)

MAX_SAMPLES = 10_000_000
MAX_CYCLES = 1_000_000  # of sines and triangles; each is a few smooth pieces, and all are in memory at once


class Parts(Protocol):
    """What a scenario is made of, as far as it must agree."""

    @property
    def balloons(self) -> tuple[Balloon, ...]:
        """The balloons."""
        ...

    @property
    def electroded(self) -> tuple[str, ...]:
        """Names of those with electrodes."""
        ...

    @property
    def gas(self) -> Gas:
        """The gas or liquid."""
        ...

    @property
    def steps(self) -> tuple[Step, ...]:
        """The steps, cycles as written."""
        ...

    @property
    def dynamics(self) -> Dynamics | None:
        """The relaxation times; None for a quasi-static history."""
        ...

    @property
    def supply(self) -> Supply | None:
        """What is between the sources and the films; None for nothing."""
        ...

    @property
    def output(self) -> Output:
        """Which samples are wanted."""
        ...

    @property
    def shape(self) -> Shape:
        """Whether the shapes of the balloons are looked at."""
        ...


def disagreements(scenario: Parts) -> Iterator[Problem]:
    """Every problem that no single field shows, in the order of the file."""
    names = [balloon.name for balloon in scenario.balloons]
    yield from _of_balloons(scenario, names)
    yield from _of_dynamics(scenario, names)
    yield from _of_supply(scenario, names)
    for key, step in numbered(scenario.steps, "step"):
        if not isinstance(step, Inflate | Hold | Cycle):
            yield from _of_drive(scenario, key, step, names)
    too_many = list(_too_many_cycles(scenario.steps))
    yield from too_many
    gas = scenario.gas
    if "exponent" in gas.model_fields_set and gas.law != "adiabatic":
        yield Problem("gas.exponent", gas.exponent, f'needs law = "adiabatic", is {gas.law}')
    output = scenario.output
    if output.every is not None and "points" in output.model_fields_set:
        yield Problem("output", output.model_dump(exclude_unset=True), "must have points or every, not both")
    elif not too_many and samples(scenario.steps, output) > MAX_SAMPLES:
        key, value = ("points", output.points) if output.every is None else ("every", output.every)
        allowed = f"must ask for at most {MAX_SAMPLES:,} samples over the whole scenario"
        yield Problem(f"output.{key}", value, allowed)


def _of_balloons(scenario: Parts, names: Sequence[str]) -> Iterator[Problem]:
    for index, balloon in enumerate(scenario.balloons):
        if (first := names.index(balloon.name)) < index:
            allowed = f"must be unique, balloon {first + 1} has this name too"
            yield Problem(f"balloon.{index + 1}.name", balloon.name, allowed)
        if balloon.breakdown and not balloon.electrodes:
            key = f"balloon.{balloon.name}.breakdown"
            yield Problem(key, _plain(balloon.breakdown), "needs electrodes = true on this balloon")
        if balloon.maxwell and scenario.dynamics is None:
            key = f"balloon.{balloon.name}.maxwell"
            yield Problem(key, _plain(balloon.maxwell), "needs [dynamics] with a relaxation_time")
        if balloon.leak and not balloon.electrodes:
            key = f"balloon.{balloon.name}.leak"
            yield Problem(key, _plain(balloon.leak), "needs electrodes = true on this balloon")
        elif balloon.leak and scenario.supply is None:
            key = f"balloon.{balloon.name}.leak"
            yield Problem(key, _plain(balloon.leak), "needs [supply] with a resistance")


def _of_dynamics(scenario: Parts, names: Sequence[str]) -> Iterator[Problem]:
    if scenario.dynamics is None:
        return
    time, viscosity = scenario.dynamics.relaxation_time, scenario.dynamics.viscosity
    if time is None and viscosity is None:
        allowed = "must be a number > 0, or a table with one for every balloon by name; or give viscosity"
        yield Problem("dynamics.relaxation_time", None, f"is missing, {allowed}")
    elif time is not None and viscosity is not None:
        yield Problem(
            "dynamics", _plain(scenario.dynamics), "must have relaxation_time or viscosity, not both"
        )
    yield from _by_name("dynamics.relaxation_time", time, names, names)
    yield from _by_name("dynamics.viscosity", viscosity, names, names)


def _of_supply(scenario: Parts, names: Sequence[str]) -> Iterator[Problem]:
    supply = scenario.supply
    if supply is None:
        return
    if scenario.dynamics is None:
        yield Problem("supply", _plain(supply), "needs [dynamics] with a relaxation_time")
    if not scenario.electroded:
        yield Problem("supply", _plain(supply), "needs a balloon with electrodes = true, there is none")
        return
    yield from _by_name("supply.resistance", supply.resistance, scenario.electroded, names)
    yield from _by_name("supply.current_limit", supply.current_limit, scenario.electroded, names)


def _by_name(
    key: str, given: float | dict[str, float] | None, wanted: Sequence[str], names: Sequence[str]
) -> Iterator[Problem]:
    """Numbers by name that are not one for each of some balloons."""
    if not isinstance(given, dict):
        return
    for name in (name for name in given if name not in wanted):
        lack = "has no electrodes" if name in names else "no such balloon"
        yield Problem(f"{key}.{name}", given[name], f"{lack}, must be one of {', '.join(wanted)}")
    for name in (name for name in wanted if name not in given):
        yield Problem(f"{key}.{name}", None, "is missing, must be a number > 0")


def _of_drive(
    scenario: Parts, key: str, step: Ramp | Charge | Jump | Sine | Triangle | Table, names: Sequence[str]
) -> Iterator[Problem]:
    """What a step that drives the electrodes cannot have in this scenario."""
    electroded = scenario.electroded
    if isinstance(step, Charge) and scenario.dynamics is not None:
        value = step.charge if isinstance(step.charge, dict) else float(step.charge)
        yield Problem(f"{key}.charge", value, "does not go with [dynamics], which needs given voltages")
    kind = next(iter(type(step).model_fields))
    voltage = getattr(step, kind)
    if not electroded:
        yield Problem(
            f"{key}.{kind}", _plain(voltage), "needs a balloon with electrodes = true, there is none"
        )
    elif isinstance(by_name := getattr(voltage, "balloons", voltage), dict):
        for name in (name for name in by_name if name not in electroded):
            lack = "has no electrodes" if name in names else "no such balloon"
            allowed = f"{lack}, must be one of {', '.join(electroded)}"
            yield Problem(f"{key}.{kind}.{name}", _plain(by_name[name]), allowed)
    ends = until_of(step)
    if ends and ends.event == "loss_of_sphericity" and scenario.shape.on_loss != "record":
        yield Problem(f"{key}.until.event", ends.event, 'needs [shape] on_loss = "record"')
    elif electroded and ends:
        yield from _never(ends, f"{key}.until", names, electroded, step.valve)


def _plain(value: object) -> object:
    """A value as it was written."""
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    return value.model_dump(exclude_unset=True) if isinstance(value, BaseModel) else value


def _never(
    ends: Until, key: str, names: Sequence[str], electroded: Sequence[str], valve: str
) -> Iterator[Problem]:
    """Ends that a step cannot have."""
    for what, wanted, known in (
        ("stretch", ends.stretch, names),
        ("field", ends.field, electroded),
    ):
        if isinstance(wanted, dict):
            for name in (name for name in wanted if name not in known):
                lack = "has no electrodes" if name in names else "no such balloon"
                allowed = f"{lack}, must be one of {', '.join(known)}"
                yield Problem(f"{key}.{what}.{name}", wanted[name], allowed)
        elif wanted is not None and len(electroded) > 1:
            allowed = f"must be a table by balloon name, {', '.join(electroded)} have electrodes"
            yield Problem(f"{key}.{what}", wanted, allowed)
    if ends.pressure is not None and valve == "open":
        yield Problem(f"{key}.pressure", ends.pressure, "needs the valve closed, open it keeps the pressure")


def _too_many_cycles(steps: Sequence[Step]) -> Iterator[Problem]:
    """The wave that has the most cycles, where there are too many in all."""
    cycles = dict(_cycles(steps, "step", 1.0))
    if cycles and sum(cycles.values()) > MAX_CYCLES:
        key = max(cycles, key=lambda wave: cycles[wave])
        step = next(step for name, step in numbered(steps, "step") if name == key.rpartition(".")[0])
        wave = step.sine if isinstance(step, Sine) else step.triangle  # type: ignore[union-attr]
        allowed = f"must be at most {MAX_CYCLES:,} cycles of sines and triangles over the whole scenario"
        yield Problem(f"{key}.cycles", wave.cycles, allowed)


def _cycles(steps: Iterable[Step], prefix: str, played: float) -> Iterator[tuple[str, float]]:
    """The key of every sine and triangle, and its cycles over all the times that it is played."""
    for number, step in enumerate(steps, start=1):
        key = f"{prefix}.{number}"
        if isinstance(step, Cycle):
            yield from _cycles(step.steps, f"{key}.steps", played * min(step.cycle, MAX_SAMPLES + 1))
        elif isinstance(step, Sine):
            yield f"{key}.sine", played * step.sine.cycles
        elif isinstance(step, Triangle):
            yield f"{key}.triangle", played * step.triangle.cycles


def samples(steps: Iterable[Step], output: Output) -> float:
    """How many samples steps lead to, about, without unrolling cycles."""
    total = 0.0
    for step in steps:
        if isinstance(step, Cycle):
            # More repetitions than samples allowed are too many already, and may not fit a float.
            total += min(step.cycle, MAX_SAMPLES + 1) * samples(step.steps, output)
        elif isinstance(step, Jump):
            total += 2
        else:
            # As for a cycle: whole numbers of a file have any number of digits.
            points = min(output.points, MAX_SAMPLES + 1) * max(1.0, periods_of(step))
            if output.rows and isinstance(step, Table):
                points = step.times.size
            total += points if output.every is None else duration(step) / output.every + 1
    return total
