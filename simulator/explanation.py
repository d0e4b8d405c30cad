"""What a scenario is made of, in words: what each step assembles, and what was left out and why.

Nothing is solved. The text is read off the same assembly that a run uses.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from simulator import assembly, units
from simulator.charged import ChargedMembrane
from simulator.device import Device
from simulator.gas import Adiabatic, Isothermal
from simulator.model import ElectrodedMembrane, Membrane, SealedBalloons
from simulator.scenario import Charge, Hold, Inflate, Jump, Ramp, duration

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from simulator.assembly import Group
    from simulator.drive import VoltageLine, Waveform
    from simulator.gas import Law
    from simulator.scenario import PlayedStep, Scenario
    from simulator.units import Scales

_MOST_STEPS = 24
_UNKNOWN = 0.123456789  # a voltage or charge that only a run can tell, and nobody asks for


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


class Assembled(NamedTuple):
    """A step with what it assembles: how its drive moves, and the sets of equations that move with it.

    `groups` is empty where nothing moves; `voltage` is that before the step.
    """

    step: PlayedStep
    line: VoltageLine
    waveform: Waveform
    groups: list[Group]
    voltage: Sequence[float]


def assembled(scenario: Scenario) -> Iterator[Assembled]:
    """The steps of a scenario in the order they are played, with what each assembles; nothing is solved."""
    device = Device.from_scenario(scenario)
    nothing = [0.0] * len(device.electroded)
    source = assembly.Electrodes(nothing, nothing, "voltage")
    pressure = 0.0
    some_gas = device.law.sealed(1.0, 1.0)
    for step in scenario.played_steps():
        source = replace(source, given=assembly.given_by(step) or source.given)
        line, waveform = assembly.motion(step, scenario.electroded, source, pressure)
        if isinstance(step, Inflate):
            groups = assembly.inflating(device, line)
        elif scenario.dynamics is not None:
            groups = (
                assembly.held_open(device, line, pressure=pressure)
                if step.valve == "open"
                else [assembly.held(device, line, gas=some_gas)]
            )
        elif step.valve == "open":
            groups = assembly.actuated_open(device, line, pressure=pressure)
        else:
            groups = assembly.actuated(device, line, gas=some_gas)
        moves = (
            scenario.dynamics is not None
            or isinstance(step, Jump)
            or bool((waveform.values != waveform.values[0]).any())
        )
        yield Assembled(step, line, waveform, groups if moves else [], source.voltage)
        if isinstance(step, Inflate):
            pressure = step.inflate
        elif not isinstance(step, Hold):
            reached = line.at(float(waveform.values[-1])).tolist()
            follows = [0.0 if value == 0.0 else _UNKNOWN for value in reached]
            voltage, charge = (reached, follows) if line.quantity == "voltage" else (follows, reached)
            source = assembly.Electrodes(voltage, charge, line.quantity)


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
    yield ""
    yield "Steps"
    was_open = False
    seen: set[str] = set()
    total = sum(1 for _ in scenario.played_steps())
    for number, (step, line, waveform, groups, before) in enumerate(assembled(scenario), start=1):
        if number > _MOST_STEPS:
            yield f"  … and {total - _MOST_STEPS} more steps"
            break
        opens = isinstance(step, Inflate) or step.valve == "open"
        yield from _step(number, step, waveform.fractions.size - 1, groups, device, scenario)
        first = line.at(float(waveform.values[0])).tolist()
        if not isinstance(step, Inflate | Hold | Jump | Ramp | Charge) and first != before:
            yield f"     begins by a jump of the voltage to {waveform.values[0]:g}, as a jump step does"
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
    reference = ", ".join(f"{symbol} = {units.said(of, scales.of(of))}" for of, symbol in given)
    yield f"reference balloon: {reference}, ε = {scales.permittivity:g} of the vacuum"
    for of in (units.PRESSURE, units.VOLTAGE, units.FIELD, units.CHARGE, units.ENERGY, units.TIME):
        yield f"{of.scale} 1 is {units.said(of, scales.of(of))}"


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
        driven = {Inflate: "pressure", Charge: "charge"}.get(type(step), "voltage")
        drive = [] if at_once else [f"{driven} (driven)"]
        yield f"     unknowns   {', '.join(_unknowns(group, device) + drive)}"
        for equation in _equations(group, device, scenario):
            yield f"     equation   {equation}"
        kinds = dict.fromkeys(c.kind for c in group.conditions[1 if at_once else 0 :])
        yield f"     events     {', '.join(kinds) or 'none'}"


def _unknowns(group: Group, device: Device) -> list[str]:
    names = [f"stretch_{device.names[i]}" for i in group.members]
    if group.equations.has_pressure:
        names.append("pressure")
    return names


def _equations(group: Group, device: Device, scenario: Scenario) -> Iterator[str]:
    equations = group.equations
    sealed = isinstance(equations, SealedBalloons)
    membranes = equations.membranes if isinstance(equations, SealedBalloons) else (equations.membrane,)
    for place, membrane in zip(group.members, membranes, strict=True):
        name = device.names[place]
        wall = membrane if isinstance(membrane, Membrane) else membrane.wall
        terms = f"{_factor(wall.modulus)}f(λ) − {_factor(device.radius[place] / device.thickness[place])}p λ²"
        if isinstance(membrane, ElectrodedMembrane):
            e, h = device.permittivity[place], device.thickness[place]
            terms += f" − {2.0 * e / h**2:g} φ² λ³"
        elif isinstance(membrane, ChargedMembrane):
            terms += f" − {membrane.electric_load * wall.modulus:g} q² λ⁻⁵"
        if scenario.dynamics is None:
            yield f"force balance of {name}: {terms} = 0"
            continue
        maxwell = scenario.balloons[place].maxwell
        if maxwell is not None:
            terms += f" + ({maxwell.modulus:g}/ξ) f_v(λ/ξ)"
        yield f"flow of {name}: {scenario.dynamics.relaxation_of(name):g} dλ/dt = −[{terms}]"
        if maxwell is not None:
            yield f"Maxwell branch of {name}: dξ/dt = λ f_v(λ/ξ) / {12.0 * maxwell.time:g}"
    if sealed:
        yield _contents(device.law)


def _contents(law: Law) -> str:
    chamber = f"{law.chamber:g} + " if law.chamber else ""
    match law:
        case Isothermal():
            volume = f"({chamber}Σ r³λ³/3)" if chamber else "Σ r³λ³/3"
            return f"gas: (p + {law.ambient:g}) {volume} = n"
        case Adiabatic():
            return f"gas: (p + {law.ambient:g}) ({chamber}Σ r³λ³/3)^{law.exponent:g} = constant"
    return "liquid: Σ r³λ³/3 = constant"


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
    if scenario.dynamics is None:
        yield "time: balloons follow at once, no [dynamics]"
    elif not any(balloon.maxwell for balloon in scenario.balloons):
        yield "creep: no balloon has a Maxwell branch"
    if scenario.dynamics is None and any(isinstance(s, Hold) for s in steps):
        yield "integration of holds: the state is kept, and copied"
