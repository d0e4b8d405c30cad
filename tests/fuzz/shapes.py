"""Many scenarios with shapes recorded: losses of sphericity against an evaluation of their own.

python -m tests.fuzz.shapes N --seed S [--whole]

The margin s = k(f′ − f/λ) − 4(e/h²)φ²λ², and what viscoelastic branches add to it at once, is that of the
reference's elastomers in every row of a history with many samples. Each change of its sign must have its
event, each event its change, and the states of events on branches have s = 0 and are in balance.
"""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator import Event, History, ScenarioError, SolverError, load_scenario, simulate
from simulator.events import SHAPE_EVENTS, EventKind
from tests.fuzz import command, grammar, numpy_dice, scenario
from tests.fuzz.soundness import balance, walls_of

FloatArray = NDArray[np.float64]

POINTS = 301
ZERO = 1e-9  # of the terms of s
IN_REAL_TIME = 1e-5  # an integrator's accuracy, over steep margins
ENDED = ("completed", "failed", "loss_of_sphericity")

Found = tuple[int, dict[str, Any], str, list[str], int]


def margins(history: History) -> tuple[FloatArray, FloatArray]:
    """s of every balloon in every sample, and the sizes of its terms, (n_samples, n_balloons)."""
    return _margins(history, history.stretch, history.voltage, history.inner)


def _margins(
    history: History, stretch: FloatArray, voltage: FloatArray, inner: FloatArray
) -> tuple[FloatArray, FloatArray]:
    found, sizes = np.zeros(stretch.shape), np.zeros(stretch.shape)
    for i, (wall, b) in enumerate(zip(walls_of(history), history.scenario.balloons, strict=True)):
        x = stretch[:, i]
        stiffness = np.array([float(wall.slope(float(one))) for one in x])
        force = np.array([float(wall.force(float(one))) for one in x]) / x
        phi = voltage[:, history.electroded.index(b.name)] if b.electrodes else np.zeros(len(x))
        load = 4.0 * b.permittivity / b.thickness**2 * (phi * x) ** 2
        found[:, i] = b.modulus * (stiffness - force) - load
        sizes[:, i] = b.modulus * (np.abs(stiffness) + np.abs(force)) + load
        for number, branch in enumerate(b.branches, start=1):
            # At once a branch is a neo-Hookean film: 12k (λ/λ_v)⁻⁶/λ_v², across the film λ_v⁻² of its own.
            name = f"{b.name}_{number}" + ("_thickness" if branch.flow == "linear" else "")
            free = inner[:, history.inner_of.index(name)]
            held = free**-2 if branch.flow == "linear" else free**4
            found[:, i] += 12.0 * branch.modulus * held * x**-6
    return found, sizes


def problems_of(history: History) -> list[str]:
    """What is wrong with the shapes of a history; empty where nothing is."""
    allowed = ZERO if history.scenario.dynamics is None else IN_REAL_TIME
    s, sizes = margins(history)
    out: list[str] = []
    rows = len(history)
    if history.outcome.value not in ENDED:
        rows = int(np.searchsorted(history.time, history.time[-1]))  # a flow that ends a history has no rest
    for i, name in enumerate(history.balloons):
        events = [e for e in history.events if e.balloon == name and e.mode == "pear"]
        kinds = [event.kind for event in events]
        lost, back = EventKind.LOSS_OF_SPHERICITY, EventKind.SPHERICITY_REGAINED
        if kinds != [lost, back] * (len(kinds) // 2) + [lost] * (len(kinds) % 2):
            out.append(f"{name}: events {[kind.value for kind in kinds]}")
            continue
        told = _told(history, events)
        clear = np.abs(s[:, i]) > allowed * sizes[:, i]
        wrong = np.flatnonzero(clear & (told != (s[:, i] < 0.0)))
        wrong = wrong[wrong < rows]
        if wrong.size:
            at = int(wrong[0])
            out.append(
                f"{name}: s = {s[at, i]:.3g} in sample {at} at time {float(history.time[at])!r}, "
                f"{'lost' if told[at] else 'a sphere'} by the events"
            )
    for event in history.events:
        if event.kind in SHAPE_EVENTS and event.mode == "pear":
            out += _of_event(history, event, allowed)
    return out


def _of_event(history: History, event: Event, allowed: float) -> list[str]:
    """Whether the state of an event on a branch has s = 0 and is one."""
    after = event.stretch_after
    assert after is not None
    jumped = any(e.time == event.time and e.kind not in SHAPE_EVENTS for e in history.events)
    place = history.balloons.index(str(event.balloon))
    rows = np.flatnonzero(history.time == event.time)
    row = rows[np.argmin(np.abs(history.stretch[rows] - after).max(axis=1))]
    inner = history.inner[row : row + 1]
    s, sizes = (part[0, place] for part in _margins(history, after[None], event.voltage[None], inner))
    if not np.array_equal(after, event.stretch_before):
        lost = event.kind is EventKind.LOSS_OF_SPHERICITY
        through = any(
            e.balloon == event.balloon and e.time == event.time and e.kind is not event.kind
            for e in history.events
        )
        wrong = not through and (s < 0.0) != lost and abs(s) > allowed * sizes
        return [f"{event.kind} at time {event.time!r}: lands at s = {s:.3g}"] if wrong else []
    if not _at_a_start(history, event) and not jumped and abs(s) > allowed * sizes:
        return [f"{event.kind} at time {event.time!r}: s = {s:.3g} of {sizes:.3g}"]
    ended = history.outcome.value not in ENDED and event.time == history.time[-1]
    if history.scenario.dynamics is None and not ended:  # a flow that ends a history has no rest
        voltage = np.zeros(len(history.balloons))
        voltage[[history.balloons.index(name) for name in history.electroded]] = event.voltage
        apart = balance(
            walls_of(history), history.scenario.balloons, after, float(event.pressure_after or 0.0), voltage
        )
        if np.max(np.abs(apart)) > ZERO:
            return [f"{event.kind} at time {event.time!r}: out of balance by {np.max(np.abs(apart)):.2g}"]
    return []


def _at_a_start(history: History, event: Event) -> bool:
    """Whether an event in real time is one of a voltage that has jumped, and so of no zero of s."""
    if history.scenario.dynamics is None:
        return False
    rows = np.flatnonzero(history.time == event.time)
    return bool(np.any(np.ptp(history.voltage[rows], axis=0) > 0.0)) if rows.size else False


def _told(history: History, events: list[Event]) -> NDArray[np.bool_]:
    """Which samples are after a loss and before its end, by the events."""
    changes = np.zeros(len(history) + 1, dtype=np.int64)
    row = 0
    for event in events:
        # A voltage may jump up and back at one instant.
        rows = np.flatnonzero((history.time == event.time) & (np.arange(len(history)) >= row))
        apart = np.abs(history.stretch[rows] - np.asarray(event.stretch_after, dtype=np.float64)).max(axis=1)
        apart += np.abs(history.voltage[rows] - event.voltage).max(axis=1, initial=0.0)
        # Several events may share an instant: the first of its rows that is the state after this one.
        row = int(rows[np.argmin(apart)])
        changes[row] += 1 if event.kind is EventKind.LOSS_OF_SPHERICITY else -1
    return np.asarray(np.cumsum(changes)[:-1] > 0)


def examined(number: int, folder: Path, whole: bool) -> Found:
    """The scenario of a number, played with its shapes recorded, and what is wrong with them."""
    document = grammar.numbered(number, folder) if whole else scenario(numpy_dice(number))
    document = {**document, "shape": {"on_loss": "record"}, "output": {"points": POINTS}}
    try:
        history = simulate(load_scenario(document))
    except ScenarioError:
        return number, document, "refused", [], 0
    except SolverError as error:
        # Without shapes it must fail as well.
        try:
            simulate(load_scenario({**document, "shape": {"on_loss": "ignore"}}))
        except SolverError:
            return number, document, "solver_error", [], 0
        return number, document, "disagreement", [str(error)], 0
    except Exception as error:
        return number, document, "crash", [f"{type(error).__name__}: {error}"], 0
    try:
        problems = problems_of(history)
    except Exception as error:
        problems = [f"check: {type(error).__name__}: {error}"]
    count = sum(event.kind in SHAPE_EVENTS for event in history.events)
    return number, document, "disagreement" if problems else "agreed", problems, count


def play(numbers: range, folder: Path, jobs: int, *, whole: bool) -> Iterator[Found]:
    """Examine many scenarios, in order."""
    return command.play(partial(examined, folder=folder, whole=whole), numbers, jobs)


def main() -> int:
    parser = command.parser("tests.fuzz.shapes", __doc__.split("\n")[0], 1000, parallel=True)
    parser.add_argument("--whole", action="store_true", help="of the whole grammar, not only sealed pairs")
    options = parser.parse_args()
    kinds: Counter[str] = Counter()
    events = 0
    with TemporaryDirectory() as folder:
        found = play(command.numbers(options), Path(folder), options.jobs, whole=options.whole)
        for number, document, kind, problems, count in command.with_progress(found, options.count):
            kinds[kind] += 1
            events += count
            if problems:
                options.keep.mkdir(parents=True, exist_ok=True)
                file = options.keep / f"shapes-{number}.json"
                file.write_text(
                    json.dumps({"problems": problems, "scenario": document}, indent=1, default=str)
                )
                print(f"{file}: " + "; ".join(problems[:3]), file=sys.stderr, flush=True)
    print(f"events {events}  " + "  ".join(f"{kind} {count}" for kind, count in kinds.most_common()))
    return 1 if kinds["disagreement"] or kinds["crash"] else 0


if __name__ == "__main__":
    sys.exit(main())
