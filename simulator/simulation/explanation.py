"""What a scenario is made of, in words: what each step assembles, and what was left out and why.

Nothing is solved. The text is read off the same assembly that a run uses.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from simulator import units
from simulator.model.conditions import shape_conditions
from simulator.model.device import Device
from simulator.model.strength import PowerStrength
from simulator.scenario import Charge, Hold, Inflate, Jump, duration, load_scenario, until_of
from simulator.simulation import motion

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from simulator.model.drive import Leg, Way
    from simulator.model.groups import Group
    from simulator.scenario import (
        ConstantBreakdown,
        Maxwell,
        PlayedStep,
        PowerBreakdown,
        Scenario,
        ScenarioLike,
    )
    from simulator.units import Scales

_MOST_STEPS = 24
_ON_LOSS = {
    "record": "that is an event, and the history goes on as one of spheres",
    "stop": "the history ends",
    "ignore": "nothing is looked for",
}
_BECOMES = {"pear": "a pear", "shear": "shear in its surface"}
_SAME_VOLTAGE = 1e-15  # what rounding leaves of a sine
_UNKNOWN = 0.123456789  # a voltage or charge that only a run can tell, and nobody asks for


def explain(scenario: ScenarioLike) -> str:
    """Unknowns, equations, events and smooth pieces of every step, and what a scenario leaves out.

    Parameters
    ----------
    scenario : Scenario, path or mapping
        From `load_scenario`, or what that takes.

    Returns
    -------
    str
        Plain text, several lines.

    Raises
    ------
    ScenarioError
        If the scenario makes no sense.

    Examples
    --------
    >>> print(explain("scenarios/fig5b_state_b.toml").splitlines()[0])
    Fig. 5b, state B: a snap that stays after switch-off
    """
    return "\n".join(_lines(load_scenario(scenario)))


class Assembled(NamedTuple):
    """A step with what it assembles: how its drive moves, and the sets of equations that move with it.

    `ways` are the different ways of its `legs`, each with its sets of equations, none where nothing moves;
    `voltage` is that before the step.
    """

    step: PlayedStep
    legs: tuple[Leg, ...]
    ways: dict[Way, list[Group]]
    voltage: Sequence[float]

    @property
    def groups(self) -> list[Group]:
        """The sets of equations of all ways."""
        return [group for groups in self.ways.values() for group in groups]


def assembled(scenario: Scenario) -> Iterator[Assembled]:
    """The steps of a scenario in the order they are played, with what each assembles; nothing is solved."""
    device = Device.from_scenario(scenario)
    nothing = [0.0] * len(device.electroded)
    source = motion.Electrodes(nothing, nothing, "voltage")
    pressure = 0.0
    some_gas = device.law.sealed(1.0, 1.0)
    for step in scenario.played_steps():
        source = replace(source, given=motion.given_by(step) or source.given)
        legs = motion.motion(step, scenario.electroded, source, pressure)
        ways: dict[Way, list[Group]] = {}
        for leg in legs:
            contents = None if motion.opens_valve(step) else some_gas
            moving = motion.moving(scenario, device, step, leg, pressure, contents)
            if moving or leg.way not in ways:
                ways[leg.way] = moving
        yield Assembled(step, legs, ways, source.voltage)
        if isinstance(step, Inflate):
            pressure = step.inflate
        elif not isinstance(step, Hold):
            way, waveform = legs[-1].way, legs[-1].waveform
            # Where a step ends early is not known here; some place on the way stands for it.
            end = waveform.at(np.array([0.4]))[0] if until_of(step) else waveform.values[-1]
            reached = way.at(float(end)).tolist()
            follows = [0.0 if value == 0.0 else _UNKNOWN for value in reached]
            voltage, charge = (reached, follows) if way.quantity == "voltage" else (follows, reached)
            source = motion.Electrodes(voltage, charge, way.quantity)


def _lines(scenario: Scenario) -> Iterator[str]:
    device = Device.from_scenario(scenario)
    yield scenario.title
    yield ""
    if scenario.scales is not None:
        yield "Scales"
        yield from (f"  {line}" for line in _scales(scenario.scales))
        yield ""
    yield "Balloons"
    for balloon in scenario.balloons:
        sizes = f"r = {balloon.radius:g}, h = {balloon.thickness:g}, k = {balloon.modulus:g}"
        electrodes = f", electrodes, e = {balloon.permittivity:g}" if balloon.electrodes else ""
        yield f"  {balloon.name}: {sizes}{electrodes}; {balloon.elastomer.words}"
        if balloon.breakdown:
            yield f"    its film breaks down at {_breakdown_law(balloon.breakdown, balloon.thickness)}"
    yield ""
    yield f"Shape: where a balloon would stop being a sphere, {_ON_LOSS[scenario.shape.on_loss]}"
    yield ""
    yield "Steps"
    was_open = False
    seen: set[str] = set()
    total = sum(1 for _ in scenario.played_steps())
    for number, (step, legs, ways, before) in enumerate(assembled(scenario), start=1):
        if number > _MOST_STEPS:
            yield f"  … and {total - _MOST_STEPS} more steps"
            break
        opens = motion.opens_valve(step)
        # Of waves by name a leg in which most move stands for all.
        groups = ways[max(ways, key=lambda way: sum(way.moves))]
        pieces = sum(leg.waveform.fractions.size - 1 for leg in legs)
        yield from _step(number, step, pieces, groups, device, scenario)
        if until := until_of(step):
            from simulator.simulation.until import Watch

            ends = " or ".join(Watch.over(until, device).labels)
            yield f"     until      {ends}: the step ends there, if that comes first"
        begins = legs[0].way.at(float(legs[0].waveform.values[0]))
        wave = motion.begins_by_jump(step) and not isinstance(step, Jump)
        if wave and np.abs(begins - before).max() > _SAME_VOLTAGE:
            to = ", ".join(f"{v:g}" for v in dict.fromkeys(begins.tolist()))
            yield f"     begins by a jump of the voltage to {to}, as a jump step does"
        if opens and not was_open and not isinstance(step, Inflate) and number > 1:
            yield "     opens the valve: a balloon that only the shared gas held would leave, by a jump"
        was_open = opens
        seen |= {condition.kind for group in groups for condition in group.conditions}
    yield ""
    yield "Left out"
    yield from (f"  {reason}" for reason in _left_out(scenario, list(scenario.played_steps()), seen))


def _scales(scales: Scales) -> Iterator[str]:
    """What one of the dimensionless numbers below is worth."""
    given = ((units.MODULUS, "μ"), (units.THICKNESS, "H"), (units.RADIUS, "R"))
    reference = ", ".join(f"{symbol} = {units.with_prefix(of, scales.of(of))}" for of, symbol in given)
    yield f"reference balloon: {reference}, ε = {scales.permittivity:g} of the vacuum"
    for of in (units.PRESSURE, units.VOLTAGE, units.FIELD, units.CHARGE, units.ENERGY, units.TIME):
        yield f"{of.scale} 1 is {units.with_prefix(of, scales.of(of))}"


def _breakdown_law(law: ConstantBreakdown | PowerBreakdown, thickness: float) -> str:
    if law.law == "constant":
        return f"φλ²/h = {law.field:g}"
    known = PowerStrength.from_thickness(law.field, law.stretch_exponent, law.thickness_exponent, thickness)
    written = f"{law.field:g} λ^{law.stretch_exponent:g} (h λ⁻²)^{law.thickness_exponent:g}"
    return f"φλ²/h = {written} = {known.field:g} λ^{known.exponent:g}"


def _step(
    number: int,
    step: PlayedStep,
    pieces: int,
    groups: list[Group],
    device: Device,
    scenario: Scenario,
) -> Iterator[str]:
    valve = "open" if isinstance(step, Inflate) else step.valve
    kind = type(step).__name__.lower()
    if not groups:
        why = "nothing moves" if not isinstance(step, Hold) else "everything is kept"
        yield f"  {number}. {kind}, {duration(step):g} long, valve {valve}: {why}; nothing is integrated"
        return
    if isinstance(step, Jump) and scenario.dynamics is not None:
        yield f"  {number}. jump, valve {valve}: the voltage changes, nothing moves at once"
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
        for equation in _equations(group, device, scenario):
            yield f"     equation   {equation}"
        kinds = dict.fromkeys(c.kind for c in group.conditions[1 if at_once else 0 :])
        yield f"     events     {', '.join(kinds) or 'none'}"
        if scenario.shape.on_loss != "ignore" and (shapes := shape_conditions(group.equations)):
            told = ", ".join(f"{device.names[group.members[s.place]]} to {_BECOMES[s.mode]}" for s in shapes)
            yield f"     shape      loss_of_sphericity: {told}"


def _drive(step: PlayedStep, group: Group) -> str:
    """What moves the equations of a group."""
    if isinstance(step, Inflate | Charge):
        return "pressure" if isinstance(step, Inflate) else "charge"
    return "voltage" if math.isinf(group.equations.longest_step) else "θ, the time in periods"


def _unknowns(group: Group, device: Device) -> list[str]:
    names = [f"stretch_{device.names[i]}" for i in group.members]
    if group.equations.has_pressure:
        names.append("pressure")
    return names


def _equations(group: Group, device: Device, scenario: Scenario) -> Iterator[str]:
    equations = group.equations
    for place, membrane in zip(group.members, equations.membranes, strict=True):
        name, drive = device.names[place], membrane.drive
        r, h, k, e = (
            part[place] for part in (device.radius, device.thickness, device.modulus, device.permittivity)
        )
        terms = f"{_factor(k)}f(λ) − {_factor(r / h)}p λ²"
        if drive is not None and drive.quantity == "charge":
            terms += f" − {2.0 / (r**4 * e):g} q² λ⁻⁵"
        elif drive is not None:
            terms += f" − {2.0 * e / h**2:g} φ² λ³"
        wave = f", {drive.wave}" if drive is not None and drive.wave else ""
        if scenario.dynamics is None:
            yield f"force balance of {name}: {terms} = 0{wave}"
            continue
        branches = [
            _branch(branch, f"{number}" if len(scenario.balloons[place].branches) > 1 else "")
            for number, branch in enumerate(scenario.balloons[place].branches, start=1)
        ]
        terms += "".join(f" + {share}" for share, _ in branches)
        slow, exponent = scenario.dynamics.friction_of(name)
        friction = f"{slow:g} λ⁻²" if exponent else f"{slow:g}"
        yield f"flow of {name}: {friction} dλ/dt = −[{terms}]{wave}"
        for _, moves in branches:
            yield f"Maxwell branch of {name}: {moves}"
        if scenario.supply is not None and place in device.electroded:
            yield f"charge of {name}: {_charging(scenario, place)}, φ = q / ({r**2 * e / h:g} λ⁴)"
    if equations.has_pressure:
        yield device.law.formula()


def _charging(scenario: Scenario, place: int) -> str:
    """How the charge of a film behind a resistance moves."""
    balloon, supply = scenario.balloons[place], scenario.supply
    assert supply is not None
    text = f"dq/dt = (φ_s − φ) / {supply.resistance_of(balloon.name):g}"
    if math.isfinite(limit := supply.current_limit_of(balloon.name)):
        text += f" within ±{limit:g}"
    if (leak := balloon.leak) is not None:
        rises = f" exp(|E| / {leak.field:g})" if leak.field else ""
        text += f" − {leak.conductivity / balloon.permittivity:g}{rises} q"
    return text


def _branch(branch: Maxwell, number: str) -> tuple[str, str]:
    """The share of a viscoelastic branch in a force balance, and how its inner strains move."""
    if branch.flow == "newtonian":
        inner = f"ξ{number}"
        return (
            f"({branch.modulus:g}/{inner}) f_v(λ/{inner})",
            f"d{inner}/dt = λ f_v(λ/{inner}) / {12.0 * branch.time:g}",
        )
    a, b = f"a{number}", f"b{number}"
    return (
        f"{2.0 * branch.modulus:g}({a} λ − {b} λ⁻⁵)",
        f"d{a}/dt = (λ⁻² − {a}) / {branch.time:g}, d{b}/dt = (λ⁴ − {b}) / {branch.time:g}",
    )


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
        vacuum = scenario.gas.law != "liquid" and scenario.gas.ambient_pressure == 0.0
        why = "a gas in a vacuum always has pressure" if vacuum else "nothing moves with the valve closed"
        yield f"loss of tension: {why}"
    if "breakdown" not in seen:
        named = any(b.breakdown for b in scenario.balloons)
        yield "breakdown: " + (
            "no voltage on the balloon that names it" if named else "no balloon names a field"
        )
    yield from _shapes_left_out(scenario)
    if scenario.dynamics is None:
        yield "time: balloons follow at once, no [dynamics]"
    elif not any(balloon.maxwell for balloon in scenario.balloons):
        yield "creep: no balloon has a Maxwell branch"
    if scenario.dynamics is not None and scenario.supply is None and scenario.electroded:
        yield "charging of the films: the sources have no resistance, no [supply]"
    if scenario.dynamics is None and any(isinstance(s, Hold) for s in steps):
        yield "integration of holds: the state is kept, and copied"


def _shapes_left_out(scenario: Scenario) -> Iterator[str]:
    """Balloons whose shape is not looked at, or not at all of it."""
    if scenario.shape.on_loss == "ignore":
        yield "loss of sphericity: [shape] ignores it"
        return
    device = Device.from_scenario(scenario)
    safe = [
        name
        for i, name in enumerate(device.names)
        if i not in device.electroded and getattr(device.elastomers[i], "stays_spherical", False)
    ]
    if safe:
        yield f"loss of sphericity of {', '.join(safe)}: without a voltage this elastomer stays a sphere"
    assumed = [b.name for b in scenario.balloons if b.elastomer.model in ("tabulated", "python")]
    if assumed:
        yield f"other shapes than a pear of {', '.join(assumed)}: known about equal stretches only"
    yield "what follows the loss of a sphere: only its onset is known"
