"""The numbers of a scenario as controls: labels, groups, ranges of sliders; steps added and removed."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from simulator.scenario import Cycle, Problem, ScenarioError, load_scenario
from simulator.scenario.checks import samples
from simulator.scenario.keys import all_keys
from simulator.scenario.mapping import number_and_unit
from simulator.scenario.steps import duration

if TYPE_CHECKING:
    from simulator.scenario import Scenario

MOST_SAMPLES = 20_000
_TEXTS = ("name", "model", "table", "file", "law", "citation")
_WHOLE = {"points": 2, "cycle": 1, "skip": 0}  # the least that each may be
_DIGITS = 6

NEW_STEPS: dict[str, dict[str, Any]] = {
    "ramp": {"ramp": 0.1, "over": 5.0},
    "hold": {"hold": 5.0},
    "jump": {"jump": 0.0},
    "inflate": {"inflate": 1.0},
    "charge": {"charge": 0.1, "over": 5.0},
    "triangle": {"triangle": {"low": 0.0, "high": 0.1, "period": 5.0, "cycles": 2}},
    "sine": {"sine": {"mean": 0.1, "amplitude": 0.1, "period": 5.0, "cycles": 2}},
}


@dataclass(frozen=True)
class Number:
    """One number of a scenario.

    Attributes
    ----------
    key : str
        Dotted, as in messages.
    group, label : str
        The heading that it stands under, and its words there.
    value : float
    unit : str
        As it is written, with its blank; "" for none.
    low, high, step : float
        Of its slider, in that unit.
    """

    key: str
    group: str
    label: str
    value: float
    unit: str
    low: float
    high: float
    step: float

    @property
    def text(self) -> str:
        """The value as the exact field shows it."""
        return f"{shortest(self.value)}{self.unit}"


def shortest(value: float) -> str:
    """A number without digits that say nothing: 0.2, 101, 1e-05."""
    return repr(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(value)


def numbers(scenario: Scenario) -> list[Number]:
    """Every number of a scenario, defaults too, in the order of the file."""
    found = {
        key: read
        for key, value in all_keys(scenario).items()
        if key.rpartition(".")[2] not in _TEXTS
        and (key != "output.points" or scenario.output.every is None)  # one or the other
        and (read := number_and_unit(value)) is not None
    }
    largest: dict[tuple[str, str], float] = {}
    for key, (value, unit) in found.items():
        kind = (_kind(key), unit)
        largest[kind] = max(largest.get(kind, 0.0), abs(value))
    return [_number(scenario, key, *read, largest[_kind(key), read[1]]) for key, read in found.items()]


def dimensionless(scenario: Scenario, key: str) -> float:
    """A number of a scenario as it computes with it, whatever unit it is written in. Raises KeyError."""
    first, *rest = key.split(".")
    found: Any = scenario
    if first == "balloon":
        found = {balloon.name: balloon for balloon in scenario.balloons}[rest.pop(0)]
    elif first == "step":
        found = scenario.steps[int(rest.pop(0)) - 1]
    else:
        rest = [first, *rest]
    for part in rest:
        found = found[part] if isinstance(found, Mapping) else getattr(found, part, None)
    if not isinstance(found, float | int):
        raise KeyError(key)
    return float(found)


def _kind(key: str) -> str:
    last = key.rpartition(".")[2]
    return "voltage" if last in ("ramp", "jump") else last


def _number(scenario: Scenario, key: str, value: float, unit: str, like: float) -> Number:
    first, *rest = key.split(".")
    group = {"gas": "Gas", "scales": "Scales", "dynamics": "Dynamics"}.get(first, "Settings")
    if first == "balloon":
        group = f"Balloon {rest.pop(0)}"
    elif first == "step":
        number = int(rest.pop(0))
        step = scenario.steps[number - 1]
        group = f"Step {number}: {next(iter(type(step).model_fields))}"
    elif group == "Settings":
        rest = [first, *rest]
    label = " ".join(rest).replace("_", " ")
    low, high = _range(key, value, like)
    whole = rest[-1] in _WHOLE
    return Number(key, group, label, value, unit, low, high, 1.0 if whole else _nice((high - low) / 200))


def _range(key: str, value: float, like: float) -> tuple[float, float]:
    """The ends of a slider: from nothing to twice the value; of a zero, to twice what is like it."""
    last = key.rpartition(".")[2]
    if last in _WHOLE:
        return float(_WHOLE[last]), max(10.0, 2.0 * value)
    if key == "solver.rtol":
        return 1e-6, 0.1
    far = 2.0 * (abs(value) or like or 0.5)
    return (-far, 0.0) if value < 0.0 else (0.0, far)


def _nice(step: float) -> float:
    """A step with one digit, not above the given one."""
    size = 10.0 ** math.floor(math.log10(step))
    return float(f"{max(d for d in (1, 2, 5) if d * size <= step * (1 + 1e-9)) * size:.1g}")


def rounded(value: float) -> float:
    """What a slider shows, without the digits of its arithmetic."""
    return float(f"{value:.{_DIGITS}g}")


def written(text: str) -> float | str:
    """What an exact field says, as a scenario takes it: a number, or a text such as "2 kPa"."""
    try:
        value = float(text)
    except ValueError:
        return text.strip()
    return value


def with_step(scenario: Scenario, kind: str, after: int) -> Scenario:
    """The scenario with a new step behind step number `after`. Raises ScenarioError."""
    document = scenario.to_dict()
    document["step"].insert(after, copy.deepcopy(NEW_STEPS[kind]))
    return load_scenario(document)


def with_kind(scenario: Scenario, number: int, kind: str) -> Scenario:
    """The scenario with one of its steps of another kind; voltage and time stay. Raises ScenarioError."""
    document = scenario.to_dict()
    old, new = document["step"][number - 1], copy.deepcopy(NEW_STEPS[kind])
    voltage = old.get("ramp", old.get("jump"))
    if kind in ("ramp", "jump") and voltage is not None:
        new[kind] = voltage
    if "over" in old and kind in ("ramp", "charge", "inflate"):
        new["over"] = old["over"]
    document["step"][number - 1] = new
    return load_scenario(document)


@dataclass(frozen=True)
class Corner:
    """Where the voltage of a step ends: the key of that voltage, of its time if it takes any; both values."""

    voltage_key: str
    time_key: str
    begins: float
    time: float
    voltage: float


def corners(scenario: Scenario) -> list[Corner]:
    """The ends of ramps and jumps that all electrodes share, up to a step whose end is not written."""
    found, time = [], 0.0
    for number, step in enumerate(scenario.steps, start=1):
        if isinstance(step, Cycle) or getattr(step, "until", None) is not None:
            break
        begins, time = time, time + duration(step)
        voltage = getattr(step, "ramp", getattr(step, "jump", None))
        if isinstance(voltage, float):
            kind = "ramp" if hasattr(step, "ramp") else "jump"
            time_key = f"step.{number}.over" if kind == "ramp" else ""
            found.append(Corner(f"step.{number}.{kind}", time_key, begins, time, voltage))
    return found


def without_step(scenario: Scenario, number: int) -> Scenario:
    """The scenario without one of its steps. Raises ScenarioError, for the last one too."""
    document = scenario.to_dict()
    del document["step"][number - 1]
    return load_scenario(document)


def check_size(scenario: Scenario) -> None:
    """Raise ScenarioError where a history would have more samples than a page can draw."""
    count = samples(scenario.steps, scenario.output)
    if count > MOST_SAMPLES:
        key = "output.points" if scenario.output.every is None else "output.every"
        allowed = f"makes {count:.3g} samples, and at most {MOST_SAMPLES:,} are drawn here"
        raise ScenarioError(scenario.file, Problem(key, None, allowed))
