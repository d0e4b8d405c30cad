"""Graphs of states of random devices, held against histories: python -m tests.fuzz.states N --seed S

Each device of one to five balloons gets a graph, and several histories of ramps that turn where chance says.
A history must visit exactly the states that the graph says: the same thresholds, landings and losses. And the
graph must be the same whatever the order of the balloons.
"""

from __future__ import annotations

import json
import sys
from collections import Counter
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from simulator import (
    EventKind,
    History,
    ScenarioError,
    SolverError,
    StateGraph,
    load_scenario,
    simulate,
    states,
)
from tests.fuzz import command
from tests.fuzz.chances import Rng, chance, log_uniform, rounded
from tests.fuzz.devices import balloons, gas

HISTORIES = 5
VOLTAGE = 1e-9  # over the range: thresholds that agree
STATE = 1e-6  # landings that agree, over the stretch
BESIDE = 1e-7  # over the range: a turn as close to a threshold proves nothing

Document = dict[str, Any]
Found = tuple[int, Document, str, list[str], int]


def device(rng: Rng, folder: Path) -> tuple[Document, float]:
    """A device with electrodes, and the highest voltage; half of them with states to choose from."""
    if chance(rng, 0.5):
        count = int(rng.integers(1, 6))
        films = [
            {
                "name": f"b{i}",
                "radius": rounded(rng, rng.uniform(0.4, 1.0)),
                "thickness": rounded(rng, rng.uniform(0.7, 1.3)),
                "electrodes": i == 0 or chance(rng, 0.8),
                "elastomer": {"model": "gent", "J_lim": float(rng.choice([60, 80, 100, 130, 200]))},
            }
            for i in range(count)
        ]
        content = {
            "ambient_pressure": rounded(rng, log_uniform(rng, 0.02, 1.0)),
            "chamber": rounded(rng, log_uniform(rng, 1.0, 500.0)),
        }
        return {"title": "states", "gas": content, "balloon": films, "step": [{"inflate": 0.9}]}, 0.6
    films = balloons(rng, False, folder)[:5]
    films[0]["electrodes"] = True
    pressure = rounded(rng, log_uniform(rng, 0.2, 3.0))
    document = {"title": "states", "gas": gas(rng, False), "balloon": films}
    return {**document, "step": [{"inflate": pressure}]}, rounded(rng, log_uniform(rng, 0.1, 1.5))


def turns(rng: Rng, high: float) -> list[float]:
    """Where a drive turns: three to ten values, up and down by turns, some of them 0."""
    found = [float(rng.uniform(0.0, high))]
    for place in range(int(rng.integers(2, 10))):
        last = found[-1]
        up = place % 2 == 1
        found.append(
            float(rng.uniform(last, high) if up else rng.uniform(0.0, last) if chance(rng, 0.8) else 0.0)
        )
    return found


def played(document: Document, graph: StateGraph, at: list[float]) -> History:
    """The history whose voltages turn at some values of the drive."""
    steps = [
        {"ramp": {name: float(part * v) for name, part in zip(graph.electroded, graph.share, strict=True)}}
        for v in at
    ]
    scenario = {
        **document,
        "step": [*document["step"], *steps],
        "output": {"points": 2},
        "shape": {"on_loss": "ignore"},
    }
    return simulate(load_scenario(scenario))


def problems_of(document: Document, graph: StateGraph, at: list[float]) -> list[str] | None:
    """What a history does otherwise than the graph says; None where a turn is too close to a threshold."""
    size = graph.high - graph.low
    for one in graph.transitions:
        if any(abs(one.drive - v) < BESIDE * size for v in at):
            return None
    history = played(document, graph, at)
    expected = graph.visits(at)
    leader = int(np.argmax(graph.share == 1.0))
    inflations = len(document["step"])
    kinds = (EventKind.LIMIT_POINT, EventKind.BRANCH_POINT)
    seen = [e for e in history.mechanical if e.step > inflations and e.kind in kinds]
    wanted = [one for one in expected if one.kind in kinds]
    if len(seen) != len(wanted):
        return [
            f"{len(seen)} events at {[float(e.voltage[leader]) for e in seen]}, not {len(wanted)}: {expected}"
        ]
    out: list[str] = []
    for event, one in zip(seen, wanted, strict=True):
        if event.kind is not one.kind or abs(float(event.voltage[leader]) - one.drive) > VOLTAGE * size:
            out.append(
                f"{event.kind.value} at {event.voltage[leader]!r}, not {one.kind.value} at {one.drive!r}"
            )
        if one.target is not None and event.stretch_after is not None and one.stretch_after is not None:
            apart = float(np.max(np.abs(event.stretch_after / one.stretch_after - 1.0)))
            if apart > STATE:
                out.append(f"a landing from {one.drive!r} is {apart:.2g} off")
            if abs((event.dissipated or 0.0) - (one.dissipated or 0.0)) > 1e-7 * (
                1.0 + abs(one.dissipated or 0.0)
            ):
                out.append(f"a loss of {event.dissipated!r}, not {one.dissipated!r}")
    ending = expected[-1].ending if expected else None
    outcome = "completed" if ending is None else ending.value
    if history.outcome.value != outcome:
        out.append(f"outcome {history.outcome.value}, not {outcome}")
    elif ending is None:
        number = next((one.target for one in reversed(expected)), graph.start)
        assert number is not None
        state = graph.states[number]
        if not state.low - VOLTAGE * size <= at[-1] <= state.high + VOLTAGE * size:
            out.append(f"ends at {at[-1]!r}, outside state {number}")
    return out


def problems_of_order(
    document: Document, graph: StateGraph, high: float, along: dict[str, float] | None, rng: Rng
) -> list[str]:
    """What is otherwise in the graph of the same device, its balloons in another order.

    Of balloons that are equal in all, which one snaps is a matter of their order: nothing is said of them.
    """
    films = document["balloon"]
    bare = [{key: value for key, value in film.items() if key != "name"} for film in films]
    if len(films) < 2 or any(one in bare[:place] for place, one in enumerate(bare)):
        return []
    shuffled = {**document, "balloon": [films[i] for i in rng.permutation(len(films)).tolist()]}
    other = states(load_scenario(shuffled), high=high, along=along)
    if len(other) != len(graph):
        return [f"in another order {len(other)} states, not {len(graph)}"]
    size, places = graph.high - graph.low, [other.balloons.index(name) for name in graph.balloons]
    out: list[str] = []
    for one, same in zip(graph.states, other.states, strict=True):
        if max(abs(same.low - one.low), abs(same.high - one.high)) > VOLTAGE * size:
            out.append(f"in another order state {one.number} is {same}, not {one}")
        elif np.max(np.abs(same.stretch[0, places] / one.stretch[0] - 1.0)) > STATE:
            out.append(f"in another order state {one.number} begins in other stretches")
    ways = [
        [(t.source, t.target, t.kind, t.ending, sorted(t.balloons)) for t in each.transitions]
        for each in (graph, other)
    ]
    return out + ([f"in another order {ways[1]}, not {ways[0]}"] if ways[0] != ways[1] else [])


def examine(number: int, histories: int = HISTORIES) -> Found:
    """One device: its scenario, what became of it, what is wrong, and how many histories were compared."""
    rng = np.random.default_rng(number)
    with TemporaryDirectory() as place:
        document, high = device(rng, Path(place))
        if chance(rng, 0.1):
            names = [b["name"] for b in document["balloon"] if b.get("electrodes")]
            along: dict[str, float] | None = {name: rounded(rng, rng.uniform(-1.0, 1.0)) for name in names}
        else:
            along = None
        try:
            graph = states(load_scenario(document), high=high, along=along)
        except ScenarioError:
            return number, document, "refused", [], 0
        except (SolverError, ArithmeticError) as failure:
            return number, document, "failed", [f"no graph: {failure}"], 0
        problems: list[str] = []
        compared = 0
        for _ in range(histories):
            at = turns(rng, high)
            try:
                found = problems_of(document, graph, at)
            except SolverError as failure:
                found = [f"no history through {at}: {failure}"]
            if found is not None:
                compared += 1
                problems += [f"turning at {at}: {one}" for one in found]
        problems += problems_of_order(document, graph, high, along, rng)
    kind = f"{min(len(graph), 9)}{'+' if len(graph) > 9 else ''} states"
    return number, document, kind, problems, compared


def main(arguments: list[str] | None = None) -> int:
    """Examine many devices; the exit code is 1 where something is wrong."""
    options = command.parser("tests.fuzz.states", __doc__ or "", 400, parallel=True).parse_args(arguments)
    wanted = command.numbers(options)
    kinds: Counter[str] = Counter()
    histories = wrong = 0
    for number, document, kind, problems, compared in command.with_progress(
        command.play(partial(examine), wanted, options.jobs), len(wanted)
    ):
        kinds[kind] += 1
        histories += compared
        if problems:
            wrong += 1
            options.keep.mkdir(parents=True, exist_ok=True)
            (options.keep / f"states-{number}.json").write_text(json.dumps(document, indent=1))
            print(f"device {number}: " + "; ".join(problems)[:2000], flush=True)
    command.print_counts(devices=Counter(dict(sorted(kinds.items()))))
    print(f"{histories} histories, {wrong} devices with something wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
