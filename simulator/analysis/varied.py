"""A device with one of its numbers, or its inflation pressure, replaced by an unknown."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from simulator.model.device import Device
from simulator.model.elastomers import Gent, Number
from simulator.scenario import Gent as GentTable
from simulator.scenario import Inflate, Problem, ScenarioError, load_scenario
from simulator.scenario.mapping import with_values

if TYPE_CHECKING:
    from simulator.scenario import PlayedStep, Scenario

_BALLOON = re.compile(r"balloon\.([^.]+)\.(radius|thickness|modulus|permittivity|elastomer\.J_lim)")

_Change = Callable[[Device, Number, Number], tuple[Device, Number]]


@dataclass(frozen=True)
class Varied:
    """A device and the pressure it is inflated to, as functions of one number q of its scenario.

    Attributes
    ----------
    device : Device
        As the scenario has it.
    inflation : float
        Pressure of the last of the inflations that the scenario begins with, 0 where there is none.
    value : float
        What q is in the scenario.
    at : callable
        The device and the pressure it is inflated to, with q, which may be complex, in its place.
    inflations : callable
        The scenario with q in its place, up to the end of its inflations.
    """

    device: Device
    inflation: float
    value: float
    at: Callable[[Number], tuple[Device, Number]]
    inflations: Callable[[float], Scenario]

    @classmethod
    def of(cls, scenario: Scenario, vary: str) -> Varied:
        """The device of a scenario, with the number of a dotted key to be varied.

        Parameters
        ----------
        scenario : Scenario
        vary : str
            `gas.ambient_pressure`, `gas.chamber` where there is one, `step.<n>.inflate` of the last
            inflation that the scenario begins with, or `balloon.<name>.` with `radius`, `thickness`,
            `modulus`, `permittivity`, `elastomer.J_lim`; `balloon.*.` is all balloons together.

        Raises
        ------
        ScenarioError
            If it is none of these, or balloons that are varied together have different values.
        """
        device = Device.from_scenario(scenario)
        steps = list(scenario.played_steps())
        count = next((i for i, step in enumerate(steps) if not isinstance(step, Inflate)), len(steps))
        last = steps[count - 1] if count else None
        inflation = float(last.inflate) if isinstance(last, Inflate) else 0.0
        value, change = _change(scenario, device, inflation, count, vary)
        # Derivatives in the other unknowns ask for the same q again and again.
        at = lru_cache(maxsize=4)(partial(change, device, inflation))
        return cls(device, inflation, value, at, partial(_inflations, scenario, steps[:count], vary))


def check_value(scenario: Scenario, vary: str, value: float, present: float) -> None:
    """Raise ScenarioError where a dimensionless value is none of the key's, or its present one."""
    if value == present:
        raise ScenarioError(
            scenario.file, Problem("to", value, f"is the present value of {vary}, must be another")
        )
    last = vary.rpartition(".")[2]
    if value <= 0.0 and last != "ambient_pressure":
        raise ScenarioError(scenario.file, Problem("to", value, f"no value of {vary}, must be a number > 0"))
    try:
        load_scenario(with_values(scenario.to_dict(), {vary: value}))
    except KeyError:
        return
    except ScenarioError as error:
        # A preset, or an elastomer made in Python, cannot be written with another number in it; that number
        # itself is what is asked about.
        for problem in error.problems:
            if problem.key.rpartition(".")[2] == last:
                raise ScenarioError(
                    scenario.file, Problem("to", value, f"no value of {vary}, {problem.allowed}")
                ) from None


def _change(
    scenario: Scenario, device: Device, inflation: float, count: int, vary: str
) -> tuple[float, _Change]:
    """The present value of a key, and what puts another in its place."""
    law = device.law
    if vary == "gas.ambient_pressure":
        return float(law.ambient), _law_changed("ambient")
    if vary == "gas.chamber" and law.chamber:
        return float(law.chamber), _law_changed("chamber")
    if count and vary == f"step.{count}.inflate":
        return inflation, lambda same, _, q: (same, q)
    found = _BALLOON.fullmatch(vary)
    chosen = [i for i, name in enumerate(device.names) if found and found[1] in (name, "*")]
    if found is None or not chosen:
        raise ScenarioError(
            scenario.file, Problem(vary, None, f"cannot be varied; {_allowed(device, count)}")
        )
    if found[2] == "elastomer.J_lim":
        limits = {getattr(device.elastomers[i], "J_lim", None) for i in chosen}
        if None in limits or len(limits) > 1:
            raise ScenarioError(scenario.file, Problem(vary, None, "must be one J_lim that all these share"))
        return float(limits.pop()), _stiffened(chosen)  # type: ignore[arg-type]
    sizes = {float(getattr(device, found[2])[i]) for i in chosen}
    if len(sizes) > 1:
        raise ScenarioError(scenario.file, Problem(vary, None, "must be one value that all these share"))
    return sizes.pop(), _resized(found[2], chosen)


def _inflations(scenario: Scenario, steps: Sequence[PlayedStep], vary: str, q: float) -> Scenario:
    """A scenario with another number, up to the end of its inflations."""
    last = vary.rpartition(".")[2]
    found = _BALLOON.fullmatch(vary)
    changed: dict[str, Any] = {"steps": tuple(steps), "dynamics": None}
    if found:
        value = {"elastomer": GentTable(model="gent", J_lim=q)} if last == "J_lim" else {last: q}
        changed["balloons"] = tuple(
            b.model_copy(update=value) if found[1] in (b.name, "*") else b for b in scenario.balloons
        )
    elif vary.startswith("gas."):
        changed["gas"] = scenario.gas.model_copy(update={last: q})
    else:
        changed["steps"] = (*steps[:-1], steps[-1].model_copy(update={last: q}))
    return scenario.model_copy(update=changed)


def _law_changed(key: str) -> _Change:
    def changed(device: Device, inflation: Number, q: Number) -> tuple[Device, Number]:
        law: Any = device.law
        return replace(device, law=replace(law, **{key: q})), inflation

    return changed


def _stiffened(chosen: Sequence[int]) -> _Change:
    def changed(device: Device, inflation: Number, q: Number) -> tuple[Device, Number]:
        elastomers = tuple(Gent(q) if i in chosen else e for i, e in enumerate(device.elastomers))
        return replace(device, elastomers=elastomers), inflation

    return changed


def _resized(key: str, chosen: Sequence[int]) -> _Change:
    def changed(device: Device, inflation: Number, q: Number) -> tuple[Device, Number]:
        sizes = [q if i in chosen else x for i, x in enumerate(getattr(device, key).tolist())]
        changes: dict[str, Any] = {key: np.array(sizes)}
        return replace(device, **changes), inflation

    return changed


def _allowed(device: Device, inflations: int) -> str:
    chamber = ["gas.chamber"] if device.law.chamber else []
    step = [f"step.{inflations}.inflate"] if inflations else []
    names = " or ".join([*device.names, "*"])
    balloon = f"balloon.<{names}>.radius, thickness, modulus, permittivity, elastomer.J_lim"
    return "can be: " + ", ".join(["gas.ambient_pressure", *chamber, *step, balloon])
