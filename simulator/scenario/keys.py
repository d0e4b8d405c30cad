"""Numbers of a scenario by dotted key, defaults too: `gas.ambient_pressure`, `step.2.ramp`."""

from __future__ import annotations

from typing import Any

from simulator.scenario.document import Scenario
from simulator.scenario.mapping import quantities, quantity, value_at


def all_keys(scenario: Scenario) -> dict[str, Any]:
    """Every key of a scenario that holds one value, defaults too, with that value."""
    found = quantities(scenario.model_dump(mode="json", by_alias=True))
    written = quantities(scenario.to_dict())
    unused = () if scenario.gas.law == "adiabatic" else ("gas.exponent",)
    # As written: 2 kPa, not what it is read as. What has no table is no number, but title and source.
    return {key: value for key, value in {**found, **written}.items() if "." in key and key not in unused}


def physical_keys(scenario: Scenario) -> tuple[str, ...]:
    """The numbers on which the equilibria of a scenario's device depend, defaults too.

    Gas, its chamber if it has one, balloons and inflation pressures; not the breakdown strengths, the
    waveforms or the settings.
    """
    return tuple(
        key
        for key, value in all_keys(scenario).items()
        if quantity(value) is not None
        and (
            (key.startswith("gas.") and not (key == "gas.chamber" and scenario.gas.chamber == 0.0))
            or (
                key.startswith("balloon.")
                and not key.endswith((".name", ".model"))
                and ".breakdown." not in key
                and ".maxwell." not in key
            )
            or (key.startswith("step.") and key.endswith(".inflate"))
        )
    )


def number_at(scenario: Scenario, key: str) -> float:
    """One of the numbers of a scenario, in the unit it is written in, also where it has its default.

    Raises
    ------
    KeyError
        If it has no such number.
    """
    found = quantity(all_keys(scenario).get(key))
    if found is None:
        raise KeyError(key)
    return found[0]


def changed_scenario(scenario: Scenario, key: str, value: float) -> Scenario:
    """A scenario with one of its numbers changed, in the unit it is written in."""
    written = quantity(value_at(scenario.to_dict(), key))
    unit = written[1] if written else ""
    return scenario.with_values({key: f"{value!r}{unit}" if unit else value})
