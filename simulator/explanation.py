"""What a scenario is made of, in words: what each step assembles, and what was left out and why.

Nothing is solved. The text is read off the same assembly that a run uses.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from simulator import assembly
from simulator.device import Device
from simulator.model import Membrane, OscillatingMembrane, SealedBalloons
from simulator.scenario import Hold, Inflate, Jump, duration, until_of
from simulator.strength import PowerStrength
from simulator.until import Watch

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from simulator.assembly import Group
    from simulator.scenario import ConstantBreakdown, PlayedStep, PowerBreakdown, Scenario

_MOST_STEPS = 24


def explain(scenario: Scenario) -> str:
    """Unknowns, equations, events and smooth pieces of every step, and what a scenario leaves out.

    Parameters
    ----------
    scenario : Scenario

    Returns
    -------
    str
        Plain text, several lines.
    """
    return "\n".join(_lines(scenario))


def _lines(scenario: Scenario) -> Iterator[str]:
    device = Device.from_scenario(scenario)
    yield scenario.title
    yield ""
    yield "Balloons"
    for balloon in scenario.balloons:
        elastomer = ", ".join(f"{key} = {value}" for key, value in balloon.elastomer.model_dump().items())
        sizes = f"r = {balloon.radius:g}, h = {balloon.thickness:g}, k = {balloon.modulus:g}"
        electrodes = f", electrodes, e = {balloon.permittivity:g}" if balloon.electrodes else ""
        yield f"  {balloon.name}: {sizes}{electrodes}; {elastomer}"
        if balloon.breakdown:
            yield f"    its film breaks down at {_breakdown_law(balloon.breakdown, balloon.thickness)}"
    yield ""
    yield "Steps"
    voltage: Sequence[float] = [0.0] * len(device.electroded)
    pressure, was_open = 0.0, False
    seen: set[str] = set()
    steps = list(scenario.played_steps())
    for number, step in enumerate(steps, start=1):
        if number > _MOST_STEPS:
            yield f"  … and {len(steps) - _MOST_STEPS} more steps"
            break
        legs = assembly.motion(step, scenario.electroded, voltage, pressure)
        first, last = legs[0], legs[-1]
        # Of waves by name a leg in which most move stands for all.
        way = max((leg.way for leg in legs), key=lambda way: sum(way.moves))
        opens = isinstance(step, Inflate) or step.valve == "open"
        if isinstance(step, Inflate):
            groups = assembly.inflating(device, voltage)
        elif opens:
            groups = assembly.actuated_open(device, way, pressure=pressure)
        else:
            groups = assembly.actuated(device, way, amount=1.0)
        moves = isinstance(step, Jump) or any(
            (leg.waveform.values != leg.waveform.values[0]).any() for leg in legs
        )
        pieces = sum(leg.waveform.fractions.size - 1 for leg in legs)
        yield from _step(number, step, pieces, groups if moves else [], device)
        if until := until_of(step):
            ends = " or ".join(Watch.over(until, device).labels)
            yield f"     until      {ends}: the step ends there, if that comes first"
        begins = first.way.at(float(first.waveform.values[0]))
        if not isinstance(step, Inflate | Hold | Jump) and np.abs(begins - voltage).max() > 1e-15:
            to = ", ".join(f"{v:g}" for v in dict.fromkeys(begins.tolist()))
            yield f"     begins by a jump of the voltage to {to}, as a jump step does"
        if opens and not was_open and not isinstance(step, Inflate) and number > 1:
            yield "     opens the valve: a balloon that only the shared gas held would leave, by a jump"
        was_open = opens
        for group in groups if moves else []:
            seen |= {condition.kind for condition in group.conditions}
        if isinstance(step, Inflate):
            pressure = step.inflate
        elif not isinstance(step, Hold):
            # Where a step ends early is not known here; some voltage on the way stands for it.
            waveform = last.waveform
            end = float(waveform.at(np.array([0.4]))[0] if until_of(step) else waveform.values[-1])
            voltage = last.way.at(end).tolist()
    yield ""
    yield "Left out"
    yield from (f"  {reason}" for reason in _left_out(scenario, steps, seen))


def _breakdown_law(law: ConstantBreakdown | PowerBreakdown, thickness: float) -> str:
    if law.law == "constant":
        return f"φλ²/h = {law.field:g}"
    known = PowerStrength.from_thickness(law.field, law.stretch_exponent, law.thickness_exponent, thickness)
    written = f"{law.field:g} λ^{law.stretch_exponent:g} (h λ⁻²)^{law.thickness_exponent:g}"
    return f"φλ²/h = {written} = {known.field:g} λ^{known.exponent:g}"


def _step(number: int, step: PlayedStep, pieces: int, groups: list[Group], device: Device) -> Iterator[str]:
    valve = "open" if isinstance(step, Inflate) else step.valve
    kind = type(step).__name__.lower()
    if not groups:
        why = "nothing moves" if not isinstance(step, Hold) else "everything is kept"
        yield f"  {number}. {kind}, {duration(step):g} long, valve {valve}: {why}; nothing is integrated"
        return
    if isinstance(step, Jump):
        yield f"  {number}. jump, valve {valve}: the overdamped flow at the new voltage"
    else:
        plural = "piece" if pieces == 1 else "pieces"
        yield f"  {number}. {kind}, {duration(step):g} long, valve {valve}: {pieces} smooth {plural}"
    at_once = isinstance(step, Jump)
    for group in groups:
        drive = [] if at_once else [f"{_drive(step, group)} (driven)"]
        yield f"     unknowns   {', '.join(_unknowns(group, device) + drive)}"
        for equation in _equations(group, device):
            yield f"     equation   {equation}"
        kinds = dict.fromkeys(c.kind for c in group.conditions[1 if at_once else 0 :])
        yield f"     events     {', '.join(kinds) or 'none'}"


def _drive(step: PlayedStep, group: Group) -> str:
    """What moves the equations of a group."""
    if isinstance(step, Inflate):
        return "pressure"
    return "voltage" if math.isinf(group.equations.longest_step) else "θ, the time in periods"


def _unknowns(group: Group, device: Device) -> list[str]:
    names = [f"stretch_{device.names[i]}" for i in group.members]
    if group.equations.has_pressure:
        names.append("pressure")
    return names


def _equations(group: Group, device: Device) -> Iterator[str]:
    equations = group.equations
    sealed = isinstance(equations, SealedBalloons)
    membranes = equations.membranes if isinstance(equations, SealedBalloons) else (equations.membrane,)
    for place, membrane in zip(group.members, membranes, strict=True):
        name = device.names[place]
        wall = membrane if isinstance(membrane, Membrane) else membrane.wall
        terms = f"{_factor(wall.modulus)}f(λ) − {_factor(device.radius[place] / device.thickness[place])}p λ²"
        if not isinstance(membrane, Membrane):
            e, h = device.permittivity[place], device.thickness[place]
            terms += f" − {2.0 * e / h**2:g} φ² λ³"
        wave = ""
        if isinstance(membrane, OscillatingMembrane):
            wave = f", φ = {membrane.mean:g} + {membrane.amplitude:g} sin 2π(θ + {membrane.phase:g})"
        yield f"force balance of {name}: {terms} = 0{wave}"
    if sealed:
        yield f"gas: (p + {device.ambient:g}) Σ r³λ³/3 = n"


def _factor(value: float) -> str:
    return "" if value == 1.0 else f"{value:g} "


def _left_out(scenario: Scenario, steps: Sequence[PlayedStep], seen: set[str]) -> Iterator[str]:
    closed = any(not isinstance(s, Inflate | Hold) and s.valve == "closed" for s in steps)
    if not scenario.electroded:
        yield "electrical terms: no balloon has electrodes"
    elif len(scenario.electroded) < len(scenario.balloons):
        bare = [b.name for b in scenario.balloons if not b.electrodes]
        yield f"electrical terms of {', '.join(bare)}: no electrodes"
    if not closed:
        yield "gas law and coupling: no voltage moves with the valve closed"
    if len(scenario.balloons) == 1:
        yield "coupling: there is one balloon"
    if "loss_of_tension" not in seen and closed:
        yield "loss of tension: nothing moves with the valve closed"
    if "breakdown" not in seen:
        named = any(b.breakdown for b in scenario.balloons)
        yield "breakdown: " + (
            "no voltage on the balloon that names it" if named else "no balloon names a field"
        )
    if any(isinstance(s, Hold) for s in steps):
        yield "integration of holds: the state is kept, and copied"
