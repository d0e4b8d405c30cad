"""Numbers of a scenario by dotted key, defaults too: `gas.ambient_pressure`, `step.2.ramp`."""

from __future__ import annotations

from typing import Any

from simulator.scenario.document import Scenario
from simulator.scenario.mapping import all_values, number_and_unit, value_at


def all_keys(scenario: Scenario) -> dict[str, Any]:
    """Every key of a scenario that holds one value, defaults too, with that value as it is written."""
    found = all_values(scenario.model_dump(mode="json", by_alias=True))
    written = all_values(scenario.to_dict())
    unused = () if scenario.gas.law == "adiabatic" else ("gas.exponent",)
    # As written: 2 kPa, not what it is read as. What has no table is no number, but title and source.
    return {key: value for key, value in {**found, **written}.items() if "." in key and key not in unused}


def physical_keys(scenario: Scenario) -> tuple[str, ...]:
    """The numbers on which the equilibria of a scenario's device depend, defaults too.

    Gas, its chamber if it has one, balloons and inflation pressures; not the breakdown strengths, the
    waveforms or the settings, nor what films do in time.
    """
    return tuple(
        key
        for key, value in all_keys(scenario).items()
        if number_and_unit(value) is not None
        and (
            (key.startswith("gas.") and not (key == "gas.chamber" and scenario.gas.chamber == 0.0))
            or (
                key.startswith("balloon.")
                and not key.endswith((".name", ".model"))
                and not any(part in key for part in (".breakdown.", ".maxwell.", ".leak."))
            )
            or (key.startswith("step.") and key.endswith(".inflate"))
        )
    )


def number_at(scenario: Scenario, key: str) -> float:
    """One of the numbers of a scenario, in the unit it is written in, also where it has its default.

    Parameters
    ----------
    scenario : Scenario
    key : str
        Dotted, with a balloon by its name: `balloon.active.radius`.

    Raises
    ------
    KeyError
        If it has no such number.
    """
    found = number_and_unit(all_keys(scenario).get(key))
    if found is None:
        raise KeyError(key)
    return found[0]


def changed_scenario(scenario: Scenario, key: str, value: float) -> Scenario:
    """A scenario with one of its numbers changed.

    Parameters
    ----------
    scenario : Scenario
    key : str
        As in `number_at`.
    value : float
        In the unit that the number is written in.

    Raises
    ------
    ScenarioError
        If there is no such key, or the value is not allowed there.
    """
    written = number_and_unit(value_at(scenario.to_dict(), key))
    unit = written[1] if written else ""
    return scenario.with_values({key: f"{value!r}{unit}" if unit else value})
