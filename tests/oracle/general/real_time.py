"""Histories in real time, for scenarios with `[dynamics]`: the independent reference.

The scenario is read by `simulator.load_scenario`, which knows the grammar and the units; all that follows is
computed here and in `creeping_flow`. The whole history is played twice, each time with another integrator;
where the two differ by more than 1e-6 the reference is undecided.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator import Scenario, load_scenario
from tests.oracle.general.creeping_flow import Drive, Film, FlowError, Motion, follow
from tests.oracle.general.elastomers import inverse_langevin, loaded_law
from tests.oracle.general.record import Reference, ReferenceEvent, State
from tests.oracle.general.springs import AnySpring, LinearSpring, Source, Spring
from tests.oracle.general.waveforms import Part, parts_of

FloatArray = NDArray[np.float64]

AGREE = 1e-6
_METHODS = (("LSODA", "BDF"), ("Radau",))  # the second of a pair where the first gives up
_NO_PRESSURE = 1e-13


def play_real_time(
    document: Mapping[str, Any],
    samples: tuple[FloatArray, NDArray[np.int64]] | None = None,
    *,
    integrators: int = 2,
) -> Reference:
    """The history of a scenario with `[dynamics]`.

    Parameters
    ----------
    document : mapping
        As for `load_scenario`.
    samples : (n,) array of times and (n,) array of steps, optional
        Rising; states are returned at these, as far as the history gets.
    integrators : {1, 2}
        How many play it; one alone has no check here.

    Returns
    -------
    Reference
        `undecided` says why where the two integrators differ, or a margin only touches zero.
    """
    scenario = load_scenario(document)
    played: list[_Player] = []
    doubts: list[str] = []
    for methods in _METHODS[:integrators]:
        for method in methods:
            player = _Player(scenario, method, samples)
            try:
                player.play()
            except FlowError as error:
                if method == methods[-1]:
                    doubts.append(str(error))
                continue
            played.append(player)
            break
    if not played:
        return Reference("?", (), None, (), "; ".join(doubts), 0)
    first, last = played[0], played[-1]
    for player in played:
        doubts += player.doubts
    certain, difference = _compared(first, last)
    spread = _spread(first, last)
    if difference or spread > AGREE:
        doubts.append(difference or f"on the way the two integrators are {spread:.1g} apart")
    if doubts:
        certain = min(certain, 0 if len(played) < integrators else len(first.events))
    return last.reference("; ".join(dict.fromkeys(doubts)) or None, certain, spread)


class _Player:
    """Plays the steps with one integrator."""

    def __init__(
        self, scenario: Scenario, method: str, samples: tuple[FloatArray, NDArray[np.int64]] | None
    ) -> None:
        self.scenario, self.method = scenario, method
        self.names = [balloon.name for balloon in scenario.balloons]
        self.films = list(scenario.electroded)
        self.places = [self.names.index(name) for name in self.films]
        self.motion = Motion(
            [_film(scenario, balloon) for balloon in scenario.balloons], scenario.gas.chamber
        )
        self.ambient = scenario.gas.ambient_pressure
        self.gamma = scenario.gas.exponent if scenario.gas.law == "adiabatic" else 1.0
        self.state = self.motion.at_rest()
        self.voltage = np.zeros(len(self.names))
        self.held = self.voltage
        self.pressure, self.clock, self.step = 0.0, 0.0, 0
        self.stable, self.ended, self.is_open = True, False, False
        self.outcome = "completed"
        self.events: list[ReferenceEvent] = []
        self.ends: list[State] = []
        self.doubts: list[str] = []
        self.wanted = samples
        self.sampled: list[FloatArray] = []
        self.sampled_at: list[tuple[float, int]] = []
        self._seal()

    def play(self) -> None:
        for number, step in enumerate(self.scenario.played_steps(), start=1):
            self.step = number
            self._play(step)
            if self.ended:
                return
            self.ends.append(self._now())

    def reference(self, doubt: str | None, certain: int, spread: float) -> Reference:
        return Reference(
            self.outcome,
            tuple(self.events),
            self._now(),
            tuple(self.ends),
            doubt,
            certain,
            samples=np.array(self.sampled).reshape(len(self.sampled), self.motion.count),
            sample_times=np.array([time for time, _ in self.sampled_at]),
            sample_steps=np.array([step for _, step in self.sampled_at]),
            dissipated=float(self.state[-1]),
            spread=spread,
        )

    def _seal(self) -> None:
        volume = self.motion.volume(self.state[: self.motion.count].tolist())
        self.contents = (self.pressure + self.ambient) * volume**self.gamma

    def _gas_pressure(self, volume: float) -> tuple[float, float]:
        absolute = self.contents / volume**self.gamma
        return absolute - self.ambient, -self.gamma * absolute / volume

    def _play(self, step: Any) -> None:
        self.is_open = hasattr(step, "inflate") or step.valve == "open"
        parts = parts_of(step, self.names, self.films, self.voltage)
        lasts = parts[-1].begin + parts[-1].lasts
        if not self.is_open and lasts == 0.0 and np.array_equal(parts[0].voltages(0.0), self.voltage):
            return  # a jump to where the voltages are: it does not even close the valve
        first = self.pressure
        start = self.clock
        for part in parts:
            pressure: Callable[[float], float] | None = None
            if self.is_open:
                rise = ((step.inflate - first) / lasts) if hasattr(step, "inflate") else 0.0
                pressure = partial(lambda t, at, rise: at + rise * t, at=first + rise * part.begin, rise=rise)
                if hasattr(step, "inflate"):
                    pressure = partial(_ramped, first=first, last=step.inflate, lasts=lasts)
            gas = None if self.is_open else self._gas_pressure
            liquid = self.scenario.gas.law == "liquid" and not self.is_open
            drive = Drive(part.lasts, part.voltages, pressure, gas, part.longest, liquid=liquid)
            self.held, self.voltage = self.voltage, part.voltages(0.0)
            self._move(drive, start, part)
            if self.ended:
                return
        self.clock = start + lasts
        if self.is_open:
            self._seal()

    def _move(self, drive: Drive, start: float, part: Part) -> None:
        """One part of the drive: what is beyond its limit already, and then the flow."""
        self.clock = start + part.begin
        before = self.pressure
        self.pressure = self.motion.pressure(0.0, self.state, drive)
        taut = self._check(drive, before)
        if self.ended or part.lasts == 0.0:
            return
        drive = replace(drive, taut=taut)
        times = self._times(start + part.begin, part.lasts)
        leg = follow(self.motion, drive, self.state, times, self.method)
        self.sampled += [y[: self.motion.count] for y in leg.states]
        self.sampled_at += [(start + part.begin + t, self.step) for t in times[: len(leg.states)]]
        for crossing in leg.crossings:
            self.state = crossing.state
            self.clock = start + part.begin + crossing.time
            self.voltage = part.voltages(crossing.time)
            self.pressure = self.motion.pressure(crossing.time, self.state, drive)
            self._note(crossing.kind, crossing.place)
        if leg.ended:
            return
        self.doubts += [f"{kind} only touched in step {self.step}" for kind in leg.grazing]
        self.state = leg.state
        self.clock = start + part.begin + part.lasts
        self.voltage = part.voltages(part.lasts)
        self.pressure = self.motion.pressure(part.lasts, self.state, drive)
        self.stable = min(self.motion.stability(part.lasts, self.state, drive)) >= 0.0

    def _check(self, drive: Drive, before: float) -> bool:
        """Note margins that are negative before anything moves; return whether to watch the tension.

        `before` is the pressure until then.
        """
        taut = True
        if drive.liquid and self.pressure < -_NO_PRESSURE:
            self.voltage, self.pressure = self.held, before
            self._note("loss_of_tension", 0)  # with the state before a jump: nothing has moved
            return taut
        ambient = max(self.ambient, 1.0 if drive.liquid else 0.0)
        slack = drive.gas_pressure is not None and abs(self.pressure) <= _NO_PRESSURE * ambient
        if slack and drive.lasts > 0.0:  # a jump takes no time, in which nothing grows
            taut = self._check_slack(drive)
            if self.ended:
                return taut
        margins = self.motion.margins(0.0, self.state, drive)
        # A film that breaks at once ends the history, stable or not.
        for kind, place, margin in margins:
            if kind not in ("limit_point", "loss_of_tension") and margin <= 0.0 and not self.ended:
                self._note(kind, place)
        if self.ended:
            return taut
        unstable = any(m < 0.0 for kind, _, m in margins if kind == "limit_point")
        if self.stable and unstable:
            self._note("limit_point", 0)  # one, however many balloons it concerns
        self.stable = not unstable
        return taut

    def _check_slack(self, drive: Drive) -> bool:
        """A gas sealed without pressure: lost where balloons grow, not watched where nothing moves."""
        rates = self.motion.rates(0.0, self.state, drive)
        count = self.motion.count
        area = [f.radius**3 * x * x for f, x in zip(self.motion.films, self.state[:count], strict=True)]
        growth = float(np.dot(area, rates[:count]))
        still = float(np.max(np.abs(rates[:count]))) * max(drive.lasts, 1.0) < 1e-12
        moves = any(np.any(drive.voltages(share * drive.lasts) != 0.0) for share in (0.0, 0.37, 1.0))
        if (still and moves) or (not still and growth > 0.0):
            self._note("loss_of_tension", 0)
        return not still

    def _times(self, begin: float, lasts: float) -> FloatArray:
        """The samples wanted within a part, in its own time."""
        if self.wanted is None:
            return np.zeros(0)
        times, steps = self.wanted
        own = times[steps == self.step] - begin
        return np.unique(own[(own > 0.0) & (own <= lasts * (1.0 + 1e-12))].clip(max=lasts))

    def _now(self) -> State:
        count = self.motion.count
        stretch, voltage = self.state[:count].copy(), self.voltage[self.places]
        films = [self.motion.films[i] for i in self.places]
        capacitance = np.array([f.radius**2 * f.permittivity / f.thickness for f in films])
        for place, i in enumerate(self.places):
            if i in self.motion.behind:
                voltage[place] = self.state[self.motion.behind[i]]
        charge = capacitance * stretch[self.places] ** 4 * voltage
        return State(self.clock, self.step, stretch, self.pressure, voltage, charge, self.is_open)

    def _note(self, kind: str, place: int) -> None:
        now = self._now()
        ends = kind != "limit_point"
        after, lost = (None, None) if ends else (now, 0.0)
        name = self.names[place] if ends and kind != "loss_of_tension" else None
        self.events.append(ReferenceEvent(kind, self.step, self.clock, now.voltage, now, after, lost, name))
        if ends:
            self.ended, self.outcome = True, kind


def _ramped(t: float, first: float, last: float, lasts: float) -> float:
    return last if t == lasts else first + (last - first) / lasts * t


def _film(scenario: Scenario, balloon: Any) -> Film:
    assert scenario.dynamics is not None
    law = loaded_law(balloon.elastomer)
    strength = None if balloon.breakdown is None else strength_of(balloon)
    return Film(
        balloon.radius,
        balloon.thickness,
        balloon.modulus,
        balloon.permittivity,
        law,
        strength,
        *_friction(scenario.dynamics, balloon.name),
        tuple(springs_of(balloon)),
        _source(scenario, balloon),
    )


def _friction(dynamics: Any, name: str) -> tuple[float, float]:
    """c and n of c λⁿ dλ/dt = −g: a relaxation time, or 12η and −2 of a Newtonian film."""
    given = dynamics.viscosity if dynamics.relaxation_time is None else dynamics.relaxation_time
    size = given[name] if isinstance(given, dict) else given
    return (size, 0.0) if dynamics.relaxation_time is not None else (12.0 * size, -2.0)


def _source(scenario: Scenario, balloon: Any) -> Source | None:
    if scenario.supply is None or not balloon.electrodes:
        return None
    given = [scenario.supply.resistance, scenario.supply.current_limit]
    named = [one[balloon.name] if isinstance(one, dict) else one for one in given]
    resistance, limit = (np.inf if one is None else one for one in named)
    leak = balloon.leak
    if leak is None:
        return Source(resistance, limit)
    return Source(resistance, limit, leak.conductivity, leak.field or np.inf)


def springs_of(balloon: Any) -> Iterator[AnySpring]:
    """The viscoelastic branches that a balloon names: one alone is Newtonian, of a list each is linear."""
    named = balloon.maxwell
    if hasattr(named, "preset"):
        equilibrium = round(15.36 * 5.99 * float(inverse_langevin(1.0 / 5.99)) / 3.0, 3)  # kPa
        for modulus, time in ((26.06, 0.607), (26.53, 6.56), (10.83, 61.25)):
            yield LinearSpring(balloon.modulus * modulus / equilibrium, time)
        return
    alone = not isinstance(named, tuple)
    for branch in () if named is None else (named,) if alone else named:
        kind = (
            Spring if (branch.flow or ("newtonian" if alone else "linear")) == "newtonian" else LinearSpring
        )
        yield kind(branch.modulus, branch.time)


def strength_of(balloon: Any) -> Callable[[float], float]:
    """E_b of a film over its stretch."""
    return partial(_strength, breakdown=balloon.breakdown, thickness=balloon.thickness)


def _strength(stretch: float, breakdown: Any, thickness: float) -> float:
    if breakdown.law == "constant":
        return float(breakdown.field)
    present = thickness / stretch**2
    return float(
        breakdown.field * stretch**breakdown.stretch_exponent * present**breakdown.thickness_exponent
    )


def _compared(one: _Player, other: _Player) -> tuple[int, str]:
    """How many events two histories have in common, and what differs first, "" where nothing does."""
    unit = max(1.0, one.clock, other.clock)
    pairs = list(zip(one.events, other.events, strict=False))
    for number, (a, b) in enumerate(pairs):
        if a.kind != b.kind or a.step != b.step:
            return number, f"event {number}: {a.kind} by {one.method}, {b.kind} by {other.method}"
        if abs(a.time - b.time) > AGREE * unit or _apart(a.before, b.before) > AGREE:
            if a.kind == "runaway" and abs(a.time - b.time) <= AGREE * unit:
                continue
            return number, f"event {number} ({a.kind}): the two integrators differ"
    if len(one.events) != len(other.events):
        return len(pairs), f"{len(one.events)} events by {one.method}, {len(other.events)} by {other.method}"
    if one.outcome != "runaway" and _apart(one._now(), other._now()) > AGREE:
        return len(pairs), "end: the two integrators differ"
    return len(pairs), ""


def _spread(one: _Player, other: _Player) -> float:
    """How far two players of the same history are apart at most, in any state."""
    pairs = list(zip(one.sampled, other.sampled, strict=False))
    pairs += [(a.before.stretch, b.before.stretch) for a, b in zip(one.events, other.events, strict=False)]
    pairs += [(a.stretch, b.stretch) for a, b in zip(one.ends, other.ends, strict=False)]
    apart = [float(np.max(np.abs(a - b) / np.maximum(1.0, np.abs(a)))) for a, b in pairs]
    return max(apart, default=0.0)


def _apart(one: State, other: State) -> float:
    return float(np.max(np.abs(one.stretch - other.stretch) / np.maximum(1.0, np.abs(one.stretch))))
