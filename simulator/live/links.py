"""What a visitor of the page may say: changes in its address, and a scenario as text. No file is read for it.

Paths of tables are refused but for those that the opened scenario names.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qsl, quote, urlencode

from simulator.live.controls import written
from simulator.scenario import Problem, ScenarioError, load_scenario
from simulator.scenario.keys import all_keys
from simulator.scenario.mapping import all_values

if TYPE_CHECKING:
    from simulator.scenario import Scenario

_PATHS = ("table", "file")
_LONGEST = 100_000  # letters of a scenario as text


def link(opened: Scenario, scenario: Scenario, also: Mapping[str, str] = MappingProxyType({})) -> str:
    """The part of an address that says what was changed: `?step.2.ramp=0.3`, "" for nothing.

    Steps that were added or removed are told as a whole, as JSON under `step`.
    """
    before, after = opened.to_dict(), scenario.to_dict()
    changes: dict[str, str] = dict(also)
    if _shape(before["step"]) != _shape(after["step"]):
        changes["step"] = json.dumps(after["step"], ensure_ascii=False, separators=(",", ":"))
        before["step"] = after["step"]
    known = all_values(before)
    for key, value in all_values(after).items():
        if "." in key and value != known.get(key):
            changes[key] = value if isinstance(value, str) else json.dumps(value)
    return "?" + urlencode(changes, quote_via=quote, safe="[]{}:,. ") if changes else ""


def values_of(scenario: Scenario) -> dict[str, Any]:
    """Every value that a scenario writes, by dotted key."""
    return all_values(scenario.to_dict())


def opened_at(opened: Scenario, address: str) -> Scenario:
    """The scenario that an address tells of. Raises ScenarioError for keys that it does not have."""
    said = dict(parse_qsl(address.removeprefix("?"), keep_blank_values=True))
    said.pop("theme", None)
    said.pop("scenario", None)
    scenario = opened
    if steps := said.pop("step", None):
        try:
            document = {**opened.to_dict(), "step": json.loads(steps)}
        except (ValueError, RecursionError) as error:
            raise ScenarioError("link", Problem("step", steps, f"must be JSON: {error}")) from None
        scenario = _checked(document, opened)
    known = all_keys(scenario)
    unknown = [key for key in said if key not in known or key.rpartition(".")[2] in _PATHS]
    if unknown:
        raise ScenarioError("link", *(Problem(key, said[key], "no such number here") for key in unknown))
    flags = {"true": True, "false": False}
    return scenario.with_values({key: flags.get(text, written(text)) for key, text in said.items()})


def from_text(text: str, opened: Scenario) -> Scenario:
    """The scenario of a TOML text. Raises ScenarioError where it makes no sense, or names another file."""
    if len(text) > _LONGEST:
        raise ScenarioError("text", Problem("", None, f"must have at most {_LONGEST:,} letters"))
    try:
        document = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise ScenarioError("text", Problem("", None, f"must be TOML: {error}")) from None
    return _checked(document, opened)


def to_text(scenario: Scenario) -> str:
    """The scenario as a TOML file."""
    import tomli_w

    text: str = tomli_w.dumps(scenario.to_dict())
    return text


def _checked(document: Mapping[str, Any], opened: Scenario) -> Scenario:
    allowed = set(_paths(opened.to_dict(), ""))
    for key, path in _paths(document, ""):
        if path not in {known for _, known in allowed}:
            raise ScenarioError("text", Problem(key, path, "must be a file that the opened scenario names"))
    return load_scenario(document)


def _paths(value: Any, key: str) -> Iterator[tuple[str, str]]:
    """Every text under a key that may name a file, with its dotted key."""
    items: Iterator[tuple[str, Any]] = iter(())
    if isinstance(value, Mapping):
        items = iter(value.items())
    elif isinstance(value, list | tuple):
        items = ((str(number), item) for number, item in enumerate(value, start=1))
    for name, item in items:
        place = f"{key}.{name}".lstrip(".")
        if isinstance(item, str) and name in _PATHS:
            yield place, item
        else:
            yield from _paths(item, place)


def _shape(steps: list[dict[str, Any]]) -> Any:
    return [sorted(all_values(step)) for step in steps]
