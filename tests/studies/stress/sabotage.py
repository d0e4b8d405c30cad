"""Runs that are made to go wrong: loose tolerances, and parts of the solver that return something else.

A run must come out as it does undisturbed ("repaired"), or raise `SolverError`. What is disturbed is what the
checks are given to see, never a check. Each disturbance is drawn from a seed and strikes about every other
time that it could; runs in which it could not are not counted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from simulator.scenario import load_scenario
from simulator.simulation import atlas
from simulator.simulation.run import SolverError
from simulator.solver import branch, certify, flow, landing, newton, overdamped, proposals, singular
from simulator.solver.certify import Proposal
from simulator.solver.newton import NotConverged
from tests.pairs import run
from tests.studies.stress.closed_form import relative

if TYPE_CHECKING:
    from simulator.results.history import History

FloatArray = NDArray[np.float64]
Written = Mapping[str, Any]

SAME = 1e-6  # beyond that a number is another; the worst difference is reported


@dataclass
class Strikes:
    """Where a disturbance takes its chances from, and how often it struck."""

    rng: np.random.Generator
    count: int = 0

    def now(self) -> bool:
        """Whether to strike this time."""
        return bool(self.rng.random() < 0.5)


@dataclass(frozen=True)
class Disturbance:
    """A way to disturb runs: its name, and a context in which they are disturbed.

    `gap` is what is known of runs that nothing notices.
    """

    name: str
    during: Callable[[Strikes], AbstractContextManager[None]]
    rtol: float | None = None
    gap: str = ""


@dataclass
class Tally:
    """What became of the runs under one disturbance.

    Attributes
    ----------
    repaired, raised : int
    wrong : list of str
        Runs that came out with other numbers and no error, and by how much.
    idle : int
        Runs in which it could not strike.
    worst : float
        Largest difference of a repaired run, of what is above 1 relative.
    """

    disturbance: Disturbance
    repaired: int = 0
    raised: int = 0
    wrong: list[str] = field(default_factory=list)
    idle: int = 0
    worst: float = 0.0

    @property
    def runs(self) -> int:
        """How many it struck."""
        return self.repaired + self.raised + len(self.wrong)


def tallies(scenarios: Sequence[Written], disturbances: Iterable[Disturbance]) -> list[Tally]:
    """Run scenarios undisturbed, then under each disturbance, and compare."""
    undisturbed = [run(load_scenario(written)) for written in scenarios]
    found = []
    for disturbance in disturbances:
        tally = Tally(disturbance)
        for number, (written, before) in enumerate(zip(scenarios, undisturbed, strict=True)):
            _add(tally, written, before, number)
        found.append(tally)
    return found


def _add(tally: Tally, written: Written, before: History, number: int) -> None:
    disturbance = tally.disturbance
    loosened = dict(written)
    if disturbance.rtol is not None:
        loosened["solver"] = {"rtol": disturbance.rtol}
    strikes = Strikes(np.random.default_rng(number))
    try:
        with disturbance.during(strikes):
            after = run(load_scenario(loosened))
    except SolverError:
        tally.raised += 1
        return
    if disturbance.rtol is None and not strikes.count:
        tally.idle += 1
        return
    error = difference(before, after)
    if error > SAME:
        tally.wrong.append(f"{written['title']}, by {error:.2g}")
    else:
        tally.repaired += 1
        tally.worst = max(tally.worst, error)


def difference(one: History, other: History) -> float:
    """Largest difference of two histories' events and samples; infinite where those are not the same ones."""
    same = (
        one.outcome == other.outcome
        and len(one) == len(other)
        and [e.kind for e in one.events] == [e.kind for e in other.events]
        and all(
            (e.stretch_after is None) == (f.stretch_after is None)
            for e, f in zip(one.events, other.events, strict=True)
        )
    )
    if not same:
        return float("inf")
    pairs = [(one.stretch, other.stretch), (one.pressure, other.pressure)]
    for e, f in zip(one.events, other.events, strict=True):
        pairs += [(e.voltage, f.voltage), (e.stretch_before, f.stretch_before)]
        if e.stretch_after is not None and f.stretch_after is not None:
            pairs.append((e.stretch_after, f.stretch_after))
    return max((relative(b, a) for a, b in pairs if np.size(a)), default=0.0)


# -- disturbances --------------------------------------------------------------------------------------


def disturbances() -> list[Disturbance]:
    """Loose tolerances first, then paths, then limit points, flows and samples."""
    return [
        Disturbance("`solver.rtol = 1e-1`", _undisturbed, 0.1),
        Disturbance("the same, without a second attempt", _one_attempt, 0.1),
        Disturbance("one point of a path put on another branch", _paths(_stray)),
        Disturbance("the rest of a path continued on another branch", _paths(_slip)),
        Disturbance("five of six points of a path left out", _paths(_thin)),
        Disturbance("all points of a path but its ends left out", _paths(_bare)),
        Disturbance("an event taken for the end of the ramp", _paths(_overrun)),
        Disturbance("IDA's root finder blind for all events", _blind),
        Disturbance("a limit point sought from 0.1 aside", _aside),
        Disturbance("a snap started uphill", _uphill),
        Disturbance(
            "a flow stopped 0.3 aside",
            _drifting,
            gap="A flow put 0.3 aside when it is about to rest can lie in another valley, or lose its "
            "tension in another state; the state is not compared with the flow that led to it.",
        ),
        Disturbance("a flow's rest taken for another equilibrium", _elsewhere),
        Disturbance("samples sought from 0.3 aside", _misread),
    ]


@contextmanager
def _undisturbed(strikes: Strikes) -> Iterator[None]:
    yield


@contextmanager
def _replaced(owner: Any, name: str, value: object) -> Iterator[None]:
    """An attribute replaced for a while."""
    before = getattr(owner, name)
    setattr(owner, name, value)
    try:
        yield
    finally:
        setattr(owner, name, before)


def _one_attempt(strikes: Strikes) -> AbstractContextManager[None]:
    return _replaced(proposals, "ATTEMPTS", proposals.ATTEMPTS[:1])


def _paths(
    spoil: Callable[[Strikes, Any, Proposal, int], Proposal | None],
) -> Callable[[Strikes], AbstractContextManager[None]]:
    """A disturbance of what IDA proposes as a path."""

    def during(strikes: Strikes) -> AbstractContextManager[None]:
        by_ida = proposals.by_ida

        def disturbed(equations: Any, conditions: Any, *rest: Any) -> Proposal:
            followed = by_ida(equations, conditions, *rest)
            spoilt = spoil(strikes, equations, followed, len(conditions)) if strikes.now() else None
            strikes.count += spoilt is not None
            return spoilt or followed

        return _replaced(proposals, "by_ida", disturbed)

    return during


def _other(strikes: Strikes, equations: Any, state: FloatArray) -> FloatArray | None:
    """Another equilibrium at the same v, stable or not, if one is found from 30 random guesses."""
    count = len(equations.walls)
    for _ in range(30):
        guess = state.copy()
        tops = [min(wall.elastomer.stretch_limit, 10.0) for wall in equations.walls]
        guess[:count] = strikes.rng.uniform(1.0, tops)
        if equations.has_pressure:
            guess[count] = equations.gas_pressure(guess[:count].tolist(), float(guess[-1]))
        try:
            with np.errstate(all="ignore"):
                found = newton.one_at_drive(equations, guess)
        except (NotConverged, np.linalg.LinAlgError):
            continue
        limits = [wall.elastomer.stretch_limit for wall in equations.walls]
        real = np.all(np.isfinite(found)) and np.all(found[:count] >= 1.0) and np.all(found[:count] < limits)
        if real and np.max(np.abs(found - state)[:count]) > 0.05:
            return found
    return None


def _stray(strikes: Strikes, equations: Any, followed: Proposal, target: int) -> Proposal | None:
    points, directions, ended = followed.points, followed.directions, followed.ended
    if points.shape[1] < 3:
        return None
    place = int(strikes.rng.integers(1, points.shape[1] - 1))
    other = _other(strikes, equations, points[:, place])
    if other is None:
        return None
    points = points.copy()
    points[:, place] = other
    return Proposal(points, directions, ended)


def _slip(strikes: Strikes, equations: Any, followed: Proposal, target: int) -> Proposal | None:
    points, directions, ended = followed.points, followed.directions, followed.ended
    if points.shape[1] < 3 or ended != target:
        return None
    place = int(strikes.rng.integers(1, points.shape[1] - 1))
    state = _other(strikes, equations, points[:, place])
    if state is None:
        return None
    points, directions = points.copy(), directions.copy()
    for k in range(place, points.shape[1]):
        state[-1] = points[-1, k]
        try:
            state = newton.one_at_drive(equations, state)
        except (NotConverged, np.linalg.LinAlgError):
            return None
        points[:, k] = state
    ahead = np.zeros_like(points[:, place:])
    ahead[-1] = np.sign(points[-1, -1] - points[-1, 0])
    directions[:, place:] = newton.tangents(equations, points[:, place:], ahead)
    return Proposal(points, directions, ended)


def _kept(followed: Proposal, kept: Sequence[int]) -> Proposal | None:
    points, directions, ended = followed.points, followed.directions, followed.ended
    if points.shape[1] < 4:
        return None
    return Proposal(points[:, kept].copy(), directions[:, kept].copy(), ended)


def _thin(strikes: Strikes, equations: Any, followed: Proposal, target: int) -> Proposal | None:
    last = followed.points.shape[1] - 1
    return _kept(followed, [*range(0, last, 6), last])


def _bare(strikes: Strikes, equations: Any, followed: Proposal, target: int) -> Proposal | None:
    return _kept(followed, [0, followed.points.shape[1] - 1])


def _overrun(strikes: Strikes, equations: Any, followed: Proposal, target: int) -> Proposal | None:
    points, directions, ended = followed.points, followed.directions, followed.ended
    return None if ended == target else Proposal(points, directions, target)


def _blind(strikes: Strikes) -> AbstractContextManager[None]:
    by_ida = proposals.by_ida

    def disturbed(equations: Any, conditions: Any, *rest: Any) -> Proposal:
        if not strikes.now():
            return by_ida(equations, conditions, *rest)
        strikes.count += 1
        return by_ida(equations, [replace(c, margin=lambda y: 1.0) for c in conditions], *rest)

    return _replaced(proposals, "by_ida", disturbed)


def _within(module: Any, **others: Any) -> AbstractContextManager[None]:
    """What one module sees of `newton`, with some of it replaced."""
    seen = SimpleNamespace(**{**vars(newton), **others})
    return _replaced(module, "newton", seen)


def _moved(strikes: Strikes, equations: Any, state: FloatArray, distance: float) -> FloatArray:
    """A state with its stretches moved a distance in a random direction, none below 1."""
    count = len(equations.walls)
    out = state.copy()
    way = strikes.rng.standard_normal(count)
    out[:count] = np.maximum(out[:count] + distance * way / np.linalg.norm(way), 1.0)
    limits = np.array([wall.elastomer.stretch_limit for wall in equations.walls])
    out[:count] = np.minimum(out[:count], limits - 1e-3)
    return out


def _aside(strikes: Strikes) -> AbstractContextManager[None]:
    def at_event(equations: Any, condition: Any, guess: FloatArray) -> FloatArray:
        if strikes.now():
            strikes.count += 1
            guess = _moved(strikes, equations, guess, 0.1)
        return newton.at_event(equations, condition, guess)

    return _within(certify, at_event=at_event)


def _uphill(strikes: Strikes) -> AbstractContextManager[None]:
    escape = singular.escape_direction

    def disturbed(equations: Any, state: FloatArray, direction: float) -> FloatArray:
        if not strikes.now():
            return escape(equations, state, direction)
        strikes.count += 1
        return -escape(equations, state, direction)

    return _replaced(atlas, "escape_direction", disturbed)


def _drifting(strikes: Strikes) -> AbstractContextManager[None]:
    integrate = overdamped.integrate

    def disturbed(equations: Any, *rest: Any) -> tuple[FloatArray, int]:
        states, ended = integrate(equations, *rest)
        # The margin that ended it is not to be met elsewhere: only flows about to rest are moved.
        if strikes.now() and ended == len(rest[0]) - 1:
            strikes.count += 1
            moved = _moved(strikes, equations, states[:, -1], 0.3)
            if equations.has_pressure:
                moved[-2] = equations.gas_pressure(moved[:-2].tolist(), float(moved[-1]))
            states = np.concatenate([states[:, :-1], moved[:, None]], axis=1)
        return states, ended

    return _replaced(flow, "integrate", disturbed)


def _elsewhere(strikes: Strikes) -> AbstractContextManager[None]:
    def one_at_drive(equations: Any, guess: FloatArray) -> FloatArray:
        found = newton.one_at_drive(equations, guess)
        other = _other(strikes, equations, found) if strikes.now() else None
        strikes.count += other is not None
        return found if other is None else other

    return _within(landing, one_at_drive=one_at_drive)


def _misread(strikes: Strikes) -> AbstractContextManager[None]:
    guess = branch.Branch.interpolated

    def disturbed(self: branch.Branch, place: Any, v: FloatArray) -> FloatArray:
        states = guess(self, place, v)
        for k in range(states.shape[1]):
            if strikes.now():
                strikes.count += 1
                states[:, k] = _moved(strikes, self.equations, states[:, k], 0.3)
        return states

    return _replaced(branch.Branch, "interpolated", disturbed)


# -- scenarios -----------------------------------------------------------------------------------------


def random_pairs(count: int, seed: int = 0) -> list[dict[str, Any]]:
    """Random sealed pairs, half of them about to snap when inflated, with one to four ramps and jumps."""
    rng = np.random.default_rng(seed)
    found = []
    for number in range(count):
        radius = float(np.exp(rng.uniform(np.log(0.2), np.log(3.0))))
        load = rng.uniform(0.2, 1.35) / radius if rng.random() < 0.5 else rng.uniform(0.1, 3.0)
        gents = [{"model": "gent", "J_lim": float(rng.uniform(20.0, 500.0))} for _ in range(2)]
        drives = rng.choice(["ramp", "ramp", "jump"], rng.integers(1, 5))
        steps = [{str(drive): float(rng.uniform(0.0, 0.8))} for drive in drives]
        found.append(
            {
                "title": f"random pair {number}",
                "gas": {"ambient_pressure": float(rng.uniform(0.0, 1.5) ** 3)},
                "balloon": [
                    {"name": "active", "radius": radius, "electrodes": True, "elastomer": gents[0]},
                    {"name": "passive", "elastomer": gents[1]},
                ],
                "step": [{"inflate": float(min(load, 3.0))}, *steps],
                "output": {"points": 21},
            }
        )
    return found
