"""Quasi-static histories of any scenario: steps played one after the other on branches, events, and flows.

Where docs/physics.md and docs/scenario-format.md leave something open it is decided so, by physics:

- Voltages and the valve that change at one instant change together: one jump, at the new voltages and with the
  new valve, from the present stretches.
- With the valve open a jump is one flow of all balloons in one time; it stops at the first thing that ends it.
- A state let go without a change of voltage leaves along its unstable direction, to the side on which the
  potential falls more, until where that flow ends (a runaway falls without end). Several such directions, or
  balloons whose common flow ends on the way, are undecided.
- A film beyond its strength at the instant of a jump breaks at the stretches that it had.
- At zero pressure with the valve closed tension is lost at once where the drive would lower the pressure.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.oracle.general import drive, flow
from tests.oracle.general.branch import Branch, End
from tests.oracle.general.device import Contents, Device
from tests.oracle.general.drive import Leg, Line, Way
from tests.oracle.general.energy import Energy, Stay, flow_work, stored
from tests.oracle.general.equations import Equations
from tests.oracle.general.flow import Rest
from tests.oracle.general.parting import past_branch_point
from tests.oracle.general.record import Reference, ReferenceEvent, Segment, State, state_of
from tests.oracle.general.scenario import Document, Scenario, Step, read
from tests.oracle.general.until import Watched

FloatArray = NDArray[np.float64]

SAME_INSTANT = 1e-12  # parts of a step
CLOSE_INSTANT = 1e-9
TURN = 1e-9  # of a drive's scale: a turn so near an event is too close to call
SAME_VOLTAGE = 1e-14  # relatively: no jump
ENDS = ("loss_of_tension", "breakdown", "out_of_range", "runaway")
WAVES = ("jump", "sine", "triangle", "table")


@dataclass(frozen=True)
class Hit:
    """What happens next in a leg: an event of a group, or a quantity that takes its value."""

    fraction: float
    v: float
    group: int
    end: End | None = None
    watched: Watched | None = None
    y: FloatArray | None = None


def play(source: Document | str | os.PathLike[str] | Scenario) -> Reference:
    """The history of a quasi-static scenario, a dict or the path of a file.

    Where the reference itself fails, what it has got so far is returned as undecided, with the outcome "failed".

    Raises
    ------
    ValueError
        For a scenario with [dynamics].
    """
    scenario = source if isinstance(source, Scenario) else read(source)
    if scenario.in_real_time:
        raise ValueError("a scenario with [dynamics] is none of this reference")
    player = _Player(scenario)
    try:
        for step in scenario.steps:
            player.play(step)
            if player.outcome != "completed":
                break
    except (ArithmeticError, np.linalg.LinAlgError) as failure:
        player.undecided(f"the reference fails: {failure}")
        player.outcome = "failed"
    return player.reference()


class _Player:
    """Where the device is, and the record."""

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.device = Device.from_scenario(scenario)
        self.films = [self.device.names[i] for i in self.device.electroded]
        self.time, self.number, self.outcome = 0.0, 0, "completed"
        self.stretch: FloatArray = np.ones(len(self.device.balloons))
        self.pressure = 0.0
        self.values: tuple[float, ...] = (0.0,) * len(self.films)
        self.charged = False
        self.is_open = False
        self.contents: Contents
        self.amount = 0.0
        self._seal()
        self.branches: dict[Any, list[Branch]] = {}
        self.exits: dict[tuple[int, float], tuple[Rest, Branch | None]] = {}
        self.events: list[ReferenceEvent] = []
        self.ends: list[State] = []
        self.segments: list[Segment] = []
        self.stays: list[Stay] = []
        self.booked = Energy()
        self.grid: list[FloatArray] = []
        self.doubt: str | None = None
        self.certain = 0

    def reference(self) -> Reference:
        certain = len(self.events) if self.doubt is None else self.certain
        return Reference(
            self.outcome,
            tuple(self.events),
            self.state(),
            tuple(self.ends),
            self.doubt,
            certain,
            tuple(self.segments),
            tuple(self.stays),
            self.booked,
            np.concatenate(self.grid) if self.grid else np.zeros(0),
        )

    def state(self) -> State:
        """The present state."""
        return state_of(
            self.device,
            self.time,
            self.number,
            self.stretch,
            self.pressure,
            self.values,
            self.charged,
            self.is_open,
            self.amount,
        )

    def undecided(self, why: str | None) -> None:
        """From the next event on nothing is certain."""
        if why and self.doubt is None:
            self.doubt, self.certain = f"step {self.number}: {why}", len(self.events)

    def _seal(self) -> None:
        self.contents = self.device.sealed(self.stretch, self.pressure)
        self.amount = self.device.amount(self.stretch, self.pressure)

    # -- sets of equations -----------------------------------------------------------------------------

    def _equations(self, members: Sequence[int], way: Way, *, inflating: bool = False) -> Equations:
        contents = None if self.is_open else self.contents
        pressure = self.pressure if self.is_open and not inflating else None
        return Equations(self.device, tuple(members), way, self.charged, contents, pressure)

    def _present(self, eq: Equations, v: float) -> FloatArray:
        """The present state as unknowns."""
        x = self.stretch[list(eq.members)].tolist()
        return np.array([*x, self.pressure, v] if eq.closed else [*x, v])

    def _still(self) -> Line:
        return Line(self.values, (0.0,) * len(self.values))

    def _branch(self, eq: Equations, y: FloatArray) -> Branch:
        """The branch through a state, a known one if it is on one."""
        known = self.branches.setdefault(eq.key, [])
        v = float(y[-1])
        for branch in known:
            if branch.covers(v) and np.max(np.abs(branch.state(v) - y) / eq.scales(y)) < 1e-8:
                return branch
        known.append(Branch.through(eq, y))
        return known[-1]

    def _groups(self, step: Step, leg: Leg) -> list[Equations]:
        """What moves in a leg."""
        if step.kind == "inflate":
            way = self._still()
            return [self._equations([i], way, inflating=True) for i in range(len(self.stretch))]
        moving = [i for place, i in enumerate(self.device.electroded) if leg.way.moves(place)]
        if self.is_open:
            return [self._equations([i], leg.way) for i in moving]
        return [self._equations(range(len(self.stretch)), leg.way)] if moving else []

    def _move_to(self, eq: Equations, y: FloatArray) -> None:
        """Take over a state of some balloons."""
        self.stretch = self.stretch.copy()
        self.stretch[list(eq.members)] = y[: eq.size]
        self.pressure = float(eq.pressure_of(y.tolist()))

    # -- steps -----------------------------------------------------------------------------------------

    def play(self, step: Step) -> None:
        """One step: first what changes at once, then what moves."""
        self.number = step.number
        start = self.time
        opened, self.is_open = step.opens and not self.is_open, step.opens
        watched = self._watched(step)
        let_go = self._connect(step)
        legs = self._legs(step)
        first = legs[0].start
        if step.kind in WAVES and not _same(first, self.values):
            self._jump(first, opened)
        else:
            if step.kind in WAVES:
                self.values = first
            if opened or let_go:
                self._jump(self.values, True, recorded=False)
        reached = self._passed(watched)
        if self.outcome == "completed" and step.lasts > 0.0 and not reached:
            self._travel(step, legs, start, watched)
        if self.outcome == "completed":
            self.ends.append(self.state())
        self.grid.append(self._grid(start, step))
        if step.opens:
            self._seal()

    def _legs(self, step: Step) -> list[Leg]:
        if step.kind != "inflate":
            return drive.legs_of(step, self.films, self.values)
        assert not isinstance(step.target, dict)
        target = float(step.target)  # type: ignore[arg-type]
        return [Leg(self._still(), self.pressure, target, 0.0, 1.0, self.values, self.values)]

    def _connect(self, step: Step) -> bool:
        """Give voltages or charges, as the step does; whether charges were given and now voltages are."""
        charged = self.charged if step.kind in ("inflate", "hold") else step.kind == "charge"
        now = self.state()
        let_go = self.charged and not charged
        if charged != self.charged:
            self.values = tuple((now.charge if charged else now.voltage).tolist())
        self.charged = charged
        return let_go

    def _grid(self, start: float, step: Step) -> FloatArray:
        """Times of the samples that the scenario asks for in what was played."""
        lasts = self.time - start
        if self.scenario.every is None:
            return start + lasts * np.linspace(0.0, 1.0, self.scenario.points) if step.lasts else np.array([start])
        count = math.floor(lasts / self.scenario.every * (1.0 + 1e-12))
        times = np.minimum(np.arange(count + 1) * self.scenario.every, lasts)
        return start + (times if times[-1] > lasts * (1.0 - 1e-9) else np.append(times, lasts))

    def _watched(self, step: Step) -> list[Watched]:
        if step.until is None:
            return []
        names, now = self.device.names, self.state()
        out = []
        for kind, name, value in step.until.quantities:
            watched = Watched(kind, names.index(name) if name else -1, value)
            watched.note(watched.distance(self.device, now.stretch, now.pressure, now.voltage))
            out.append(watched)
        return out

    def _passed(self, watched: Sequence[Watched]) -> bool:
        """Whether what happened at once passed over a value that was waited for."""
        now = self.state()
        found = [w.note(w.distance(self.device, now.stretch, now.pressure, now.voltage)) for w in watched]
        for w in watched:
            self.undecided(w.doubt)
        return any(found)

    # -- what changes at once --------------------------------------------------------------------------

    def _jump(self, target: tuple[float, ...], let_go: bool, *, recorded: bool = True) -> None:
        """Voltages change at once, or a state is let go; the stretches follow by the flow.

        Without `recorded` nothing happens unless the state is unstable.
        """
        before, old = self.state(), self.values
        self.values = target
        moved = [i for place, i in enumerate(self.device.electroded) if target[place] != old[place]]
        members = range(len(self.stretch)) if not self.is_open or let_go else moved
        eq = self._equations(members, self._still())
        parts = [eq] if not self.is_open else [self._equations([i], self._still()) for i in members]
        loose = [part for part in parts if not set(part.members) & set(moved) and self._is_loose(part)]
        if not recorded and not loose:
            return
        y = self._present(eq, 0.0)
        if recorded and self._slack_at_once(eq, y):
            self.values = old
            self._end("loss_of_tension", before, None)
            return
        if recorded:
            self._book_charging(old, target)
        if not self.is_open:
            rest = flow.release(eq, y) if loose else self._settled(eq, y)
        else:
            rest = self._common_flow(eq, y, parts, moved, loose)
        self._land("jump", before, [(eq, y, rest)])

    def _is_loose(self, part: Equations) -> bool:
        """Whether a state in equilibrium is unstable."""
        stability = part.stability(self._present(part, 0.0).tolist())
        if abs(stability) < 1e-7:
            self.undecided("a state that is let go is only just stable or not")
        return stability < 0.0

    def _slack_at_once(self, eq: Equations, y: FloatArray) -> bool:
        """Whether tension is lost before anything has moved."""
        if not eq.closed:
            return False
        motion = flow.Motion(eq, 0.0)
        start = motion.state(y[: eq.size].tolist())
        if eq.contents is not None and eq.contents.is_liquid:
            if abs(start[-2]) < 1e-9:
                self.undecided("a liquid's pressure is only just lost, or not")
            return bool(start[-2] < 0.0)
        if self.pressure > 0.0:
            return False
        return float(eq.areas(y.tolist()) @ motion.rates(y[: eq.size].tolist())) > 0.0

    def _book_charging(self, old: Sequence[float], new: Sequence[float]) -> None:
        """Voltages change at frozen stretches: what the supplies deliver is stored."""
        unit = self.device.charge(self.stretch, np.ones(len(new)))
        work = 0.5 * float(unit @ (np.square(new) - np.square(old)))
        self.booked = self.booked.plus(electrical=work, stored=work)

    def _settled(self, eq: Equations, y: FloatArray) -> Rest:
        """The flow from stretches that are in no equilibrium; broken films break before anything moves."""
        start = np.array(flow.Motion(eq, float(y[-1])).state(y[: eq.size].tolist()))
        for name in eq.margin_names()[1:]:
            margin = float(eq.margin(name, start.tolist()))
            if name[0] == "breakdown" and abs(margin) < 1e-9:
                self.undecided("a film is only just broken by a jump, or not")
            if margin < 0.0 and name[0] != "loss_of_tension":
                return Rest(name[0], name[1], start, 0.0)
        return flow.relax(eq, float(y[-1]), y[: eq.size], y)

    def _common_flow(
        self,
        eq: Equations,
        y: FloatArray,
        parts: Sequence[Equations],
        moved: Sequence[int],
        loose: Sequence[Equations],
    ) -> Rest:
        """The flow of several balloons at one pressure, those let go by the way that lowers Π more."""
        if not loose:
            return self._settled(eq, y)
        start = y[: eq.size].copy()
        doubts: list[str | None] = []
        for part in loose:
            state = self._present(part, 0.0)
            alone = flow.release(part, state)
            if len(loose) == 1 and not moved:
                whole = y.copy()
                whole[list(eq.members).index(part.members[0])] = alone.y[0]
                balloon = list(eq.members).index(part.members[0]) if alone.kind else -1
                return Rest(alone.kind, balloon, whole, alone.lost, alone.doubt)
            doubts.append(alone.doubt)
            side = 1.0 if alone.y[0] > state[0] else -1.0
            direction = np.array([side])
            start[list(eq.members).index(part.members[0])] = flow.beside(part, state, direction)[0]
        rest = flow.relax(eq, 0.0, start, y, off=10.0 * flow.OFF)
        if rest.kind is not None:
            doubts.append("several balloons are let go and one of them ends the history")
        return Rest(rest.kind, rest.balloon, rest.y, rest.lost, next(filter(None, [rest.doubt, *doubts]), None))

    # -- what moves ------------------------------------------------------------------------------------

    def _travel(self, step: Step, legs: Sequence[Leg], start: float, watched: Sequence[Watched]) -> None:
        for leg in legs:
            groups = self._groups(step, leg)
            if leg.first == leg.last or not groups:
                self._stay(step, start, leg, leg.begin, leg.end, [], 0.0, 0.0)
                self.values = leg.values
                continue
            done = self._walk(step, leg, groups, start, watched)
            if done or self.outcome != "completed":
                return

    def _walk(
        self, step: Step, leg: Leg, groups: list[Equations], start: float, watched: Sequence[Watched]
    ) -> bool:
        """Go through a leg; whether the step ends in it."""
        if self._slack_ahead(groups, leg):
            self._end("loss_of_tension", self.state(), None)
            return True
        t, v = leg.begin, leg.first
        branches = [self._branch(eq, self._present(eq, v)) for eq in groups]
        while True:
            hits = self._hits(leg, groups, branches, v, watched)
            hit = hits[0] if hits else None
            to = leg.last if hit is None else hit.v
            until = leg.end if hit is None else hit.fraction
            pairs = list(zip(groups, branches, strict=True))
            self._stay(step, start, leg, t, until, pairs, v, to)
            for eq, branch in pairs:
                self._move_to(eq, branch.state(to))
            if step.kind != "inflate":
                places = range(len(self.values))
                self.values = leg.values if hit is None else tuple(leg.way.at(to, p) for p in places)
            if hit is None:
                return False
            if hit.watched is not None:
                assert hit.y is not None
                self._move_to(groups[hit.group], hit.y)
                return True
            t, v = until, to
            snapped = self._happen(leg, groups, branches, hits)
            if self.outcome != "completed" or self._passed(watched):
                return True
            if snapped and step.until is not None and step.until.limit_point:
                return True

    def _slack_ahead(self, groups: Sequence[Equations], leg: Leg) -> bool:
        """Whether at zero pressure, valve closed, the drive would lower it."""
        eq = groups[0]
        if not eq.closed or self.pressure > 0.0:
            return False
        v = leg.first + 1e-3 * (leg.last - leg.first)
        from tests.oracle.general.points import at_drive

        ahead = at_drive(eq, self._present(eq, leg.first), v)
        if ahead is None or abs(ahead[-2]) < 1e-13:
            self.undecided("whether tension is lost at zero pressure")
            return True
        return bool(ahead[-2] < 0.0)

    def _hits(
        self,
        leg: Leg,
        groups: Sequence[Equations],
        branches: Sequence[Branch],
        v: float,
        watched: Sequence[Watched],
    ) -> list[Hit]:
        """What comes first in the rest of a leg, and whatever else comes at that instant."""
        sense = math.copysign(1.0, leg.last - leg.first)
        found: list[Hit] = []
        for place, (eq, branch) in enumerate(zip(groups, branches, strict=True)):
            branch.extend(leg.last)
            end, far = branch.end(sense), leg.last
            if end is not None:
                at = float(end.y[-1])
                if abs(at - leg.last) < TURN * eq.scales(end.y)[-1]:
                    self.undecided(f"the drive turns, or ends, at the very place of a {end.kind}")
                if sense * (at - leg.last) <= 0.0:
                    far = at
                    found.append(Hit(leg.when(at), at, place, end=end))
            for w in watched:
                side = w.side
                y = w.met(eq, branch, v, far)
                if y is not None:
                    found.append(Hit(leg.when(float(y[-1])), float(y[-1]), place, watched=w, y=y))
                elif found and far != leg.last:
                    w.side = side or w.side
            for text in branch.doubts(v, far):
                self.undecided(text)
        found.sort(key=lambda hit: (hit.fraction, hit.watched is None))
        if not found:
            return []
        first = found[0]
        for other in found[1:]:
            gap = other.fraction - first.fraction
            mixed = (other.watched is None) != (first.watched is None)
            if (gap > SAME_INSTANT or mixed) and gap < CLOSE_INSTANT and other.watched is not first.watched:
                self.undecided("two events in one instant, or nearly")
        if first.watched is not None:
            return [first]
        return [h for h in found if h.watched is None and h.fraction - first.fraction <= SAME_INSTANT]

    def _stay(
        self,
        step: Step,
        start: float,
        leg: Leg,
        begin: float,
        end: float,
        pairs: Sequence[tuple[Equations, Branch]],
        v: float,
        to: float,
    ) -> None:
        """Record a stay, and move the clock."""
        finish = start + step.lasts * end
        self.segments.append(
            Segment(
                self.device,
                self.number,
                start + step.lasts * begin,
                finish,
                start,
                step.lasts,
                leg if pairs else None,
                tuple(pairs),
                self.stretch.copy(),
                self.pressure,
                self.values,
                self.charged,
                self.is_open,
                self.amount,
            )
        )
        self.stays += [Stay(eq, branch, v, to) for eq, branch in pairs if v != to]
        self.time = finish

    def _happen(
        self, leg: Leg, groups: Sequence[Equations], branches: list[Branch], hits: Sequence[Hit]
    ) -> bool:
        """What happens at the ends of some branches at one instant; whether a balloon snapped there."""
        before = self.state()
        sense = math.copysign(1.0, leg.last - leg.first)
        for hit in hits:
            assert hit.end is not None
            self.undecided(hit.end.doubt)
        for hit in hits:
            end, eq = hit.end, groups[hit.group]
            assert end is not None
            if end.kind in ENDS:
                self._end(end.kind, before, self._name(eq, end.balloon))
                return False
        rests = []
        kinds = []
        for hit in hits:
            end, eq = hit.end, groups[hit.group]
            assert end is not None
            assert end.mode is not None
            key = id(branches[hit.group]), sense
            if key not in self.exits:
                at_fold = end.kind == "limit_point"
                self.exits[key] = (
                    (flow.snap(eq, end.y, end.mode, sense), None) if at_fold else past_branch_point(eq, end, sense)
                )
            rest, branch = self.exits[key]
            rests.append((eq, end.y, rest))
            kinds.append(end.kind)
            if rest.kind is None:
                branches[hit.group] = branch or self._branch(eq, rest.y)
        # Balloons that are alike do all of it alike, but for a film that breaks.
        if len(rests) > 1 and any(rest.kind for *_, rest in rests):
            rests = self._together(leg, rests)
        if len(rests) > 1 and any(rest.kind for *_, rest in rests):
            self.undecided("several balloons snap at once and one of them ends the history")
        self._land(kinds[0], before, rests)
        return kinds[0] == "limit_point"

    def _together(
        self, leg: Leg, rests: list[tuple[Equations, FloatArray, Rest]]
    ) -> list[tuple[Equations, FloatArray, Rest]]:
        """The common flow of balloons that snap at one instant, where they are alike and begin it alike."""
        first, y = rests[0][:2]
        members = [eq.members[0] for eq, *_ in rests]
        way = self._still() if first.pressure is None else leg.way
        eq = Equations(self.device, tuple(members), way, self.charged, None, float(first.pressure_of(y.tolist())))
        at = float(y[-1])
        if len(eq.twins(at)) > 1 or any(abs(other[0] - y[0]) > 1e-12 * y[0] for _, other, _ in rests):
            return rests
        side = 1.0 if rests[0][2].y[0] > y[0] else -1.0
        start = flow.beside(first, y, np.array([side]))
        before = np.array([*[y[0]] * len(members), at])
        rest = flow.relax(eq, at, np.repeat(start, len(members)), before, off=10.0 * flow.OFF)
        return [(eq, before, rest)]

    # -- record ----------------------------------------------------------------------------------------

    def _name(self, eq: Equations, place: int) -> str | None:
        return self.device.names[eq.members[place]] if place >= 0 else None

    def _land(self, kind: str, before: State, rests: Sequence[tuple[Equations, FloatArray, Rest]]) -> None:
        """Record what flows did, and that one ended the history if it did."""
        for *_, rest in rests:
            self.undecided(rest.doubt)
        ended = next(((eq, rest) for eq, _, rest in rests if rest.kind is not None), None)
        if ended is not None and ended[1].kind == "runaway":
            voltage = self.state().voltage
            self.events.append(ReferenceEvent(kind, self.number, self.time, voltage, before, None, None))
            self._end("runaway", before, self._name(ended[0], ended[1].balloon))
            return
        lost = 0.0
        for eq, y, rest in rests:
            electrical, gas = flow_work(eq, y, rest.y)
            self.booked = self.booked.plus(electrical, gas, stored(eq, rest.y) - stored(eq, y), rest.lost)
            self._move_to(eq, rest.y)
            lost += rest.lost
        after = self.state()
        self.events.append(ReferenceEvent(kind, self.number, self.time, after.voltage, before, after, lost))
        if ended is not None:
            assert ended[1].kind is not None
            self._end(ended[1].kind, after, self._name(ended[0], ended[1].balloon))

    def _end(self, kind: str, state: State, balloon: str | None) -> None:
        """Record the event that ends the history."""
        voltage = self.state().voltage
        self.events.append(ReferenceEvent(kind, self.number, self.time, voltage, state, None, None, balloon))
        self.outcome = kind


def _same(one: Sequence[float], other: Sequence[float]) -> bool:
    """Whether two sets of voltages are the same but for rounding."""
    size = max((abs(value) for value in (*one, *other)), default=0.0)
    return all(abs(a - b) <= SAME_VOLTAGE * size for a, b in zip(one, other, strict=True))
