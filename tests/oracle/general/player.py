"""Where the device is while a history is played, and what each step makes of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.oracle.general import drive, flow, jumps
from tests.oracle.general.branch import Branch
from tests.oracle.general.device import Contents, Device
from tests.oracle.general.drive import Leg, Line, Way
from tests.oracle.general.energy import Stay, flow_work, stored
from tests.oracle.general.equations import Equations
from tests.oracle.general.flow import Rest
from tests.oracle.general.hits import Hit, first_hits
from tests.oracle.general.journal import Journal
from tests.oracle.general.parting import past_branch_point
from tests.oracle.general.record import ReferenceEvent, Segment, State, state_of
from tests.oracle.general.scenario import Scenario, Step
from tests.oracle.general.until import Watched

FloatArray = NDArray[np.float64]

SAME_VOLTAGE = 1e-14  # relatively: no jump
ENDS = ("loss_of_tension", "breakdown", "out_of_range", "runaway")
WAVES = ("jump", "sine", "triangle", "table")


class Player:
    """Where the device is, and the record."""

    def __init__(self, scenario: Scenario, integrators: int) -> None:
        self.device = Device(scenario.balloons, scenario.gas, integrators)
        self.films = [self.device.names[i] for i in self.device.electroded]
        self.time, self.number, self.outcome = 0.0, 0, "completed"
        self.stretch: FloatArray = np.ones(len(self.device.balloons))
        self.pressure = 0.0
        self.values: tuple[float, ...] = (0.0,) * len(self.films)
        self.charged = False
        self.is_open = False
        self.contents: Contents
        self._seal()
        self.branches: dict[Any, list[Branch]] = {}
        self.exits: dict[tuple[int, float], tuple[Rest, Branch | None]] = {}
        self.journal = Journal()

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
        )

    def undecided(self, *reasons: str | None) -> None:
        """From the next event on nothing is certain, if there is a reason."""
        for why in filter(None, reasons):
            self.journal.undecided(f"step {self.number}: {why}")

    def _seal(self) -> None:
        self.contents = self.device.sealed(self.stretch, self.pressure)

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
        if step.kind in WAVES and not _same(first, self.values, _reach(legs)):
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
            self.journal.ends.append(self.state())
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
        self.undecided(*(w.doubt for w in watched))
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
        slack, doubt = jumps.slack_at_once(eq, y) if recorded else (False, None)
        self.undecided(doubt)
        if slack:
            self.values = old
            self._end("loss_of_tension", before, None)
            return
        if recorded:
            self._book_charging(old, target)
        if not self.is_open:
            rest = flow.release(eq, y) if loose else jumps.settled(eq, y)
        else:
            rest = jumps.common_flow(eq, y, loose, only=not moved)
        self._land("jump", before, [(eq, y, rest)])

    def _is_loose(self, part: Equations) -> bool:
        """Whether a set that is let go leaves."""
        loose, doubt = jumps.is_loose(part, self._present(part, 0.0))
        self.undecided(doubt)
        return loose

    def _book_charging(self, old: Sequence[float], new: Sequence[float]) -> None:
        """Voltages change at frozen stretches: what the supplies deliver is stored."""
        unit = self.device.charge(self.stretch, np.ones(len(new)))
        work = 0.5 * float(unit @ (np.square(new) - np.square(old)))
        self.journal.book(electrical=work, stored=work)

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
        slack, doubt = jumps.slack_ahead(groups[0], self._present(groups[0], leg.first), leg.last)
        self.undecided(doubt)
        if slack:
            self._end("loss_of_tension", self.state(), None)
            return True
        t, v = leg.begin, leg.first
        branches = [self._branch(eq, self._present(eq, v)) for eq in groups]
        while True:
            hits, doubts = first_hits(leg, groups, branches, v, watched)
            self.undecided(*doubts)
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
        self.journal.segments.append(
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
            )
        )
        self.journal.stays += [Stay(eq, branch, v, to) for eq, branch in pairs if v != to]
        self.time = finish

    def _happen(
        self, leg: Leg, groups: Sequence[Equations], branches: list[Branch], hits: Sequence[Hit]
    ) -> bool:
        """What happens at the ends of some branches at one instant; whether a balloon snapped there."""
        before = self.state()
        sense = math.copysign(1.0, leg.last - leg.first)
        self.undecided(*(hit.end.doubt for hit in hits if hit.end is not None))
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
                    (flow.snap(eq, end.y, end.mode, sense), None)
                    if at_fold
                    else past_branch_point(eq, end, sense)
                )
            rest, branch = self.exits[key]
            rests.append((eq, end.y, rest))
            kinds.append(end.kind)
            if rest.kind is None:
                branches[hit.group] = branch or self._branch(eq, rest.y)
        # Balloons that are alike do all of it alike, but for a film that breaks.
        if len(rests) > 1 and any(rest.kind for *_, rest in rests):
            members = [eq.members[0] for eq, *_ in rests]
            pressure = float(rests[0][0].pressure_of(rests[0][1].tolist()))
            way = self._still() if rests[0][0].pressure is None else leg.way
            common = Equations(self.device, tuple(members), way, self.charged, None, pressure)
            rests = jumps.together(common, rests)
        if len(rests) > 1 and any(rest.kind for *_, rest in rests):
            self.undecided("several balloons snap at once and one of them ends the history")
        self._land(kinds[0], before, rests)
        return kinds[0] == "limit_point"

    # -- record ----------------------------------------------------------------------------------------

    def _name(self, eq: Equations, place: int) -> str | None:
        return self.device.names[eq.members[place]] if place >= 0 else None

    def _land(self, kind: str, before: State, rests: Sequence[tuple[Equations, FloatArray, Rest]]) -> None:
        """Record what flows did, and that one ended the history if it did."""
        self.undecided(*(rest.doubt for *_, rest in rests))
        ended = next(((eq, rest) for eq, _, rest in rests if rest.kind is not None), None)
        if ended is not None and ended[1].kind == "runaway":
            voltage = self.state().voltage
            self.journal.events.append(
                ReferenceEvent(kind, self.number, self.time, voltage, before, None, None)
            )
            self._end("runaway", before, self._name(ended[0], ended[1].balloon))
            return
        lost = 0.0
        for eq, y, rest in rests:
            electrical, gas = flow_work(eq, y, rest.y)
            self.journal.book(electrical, gas, stored(eq, rest.y) - stored(eq, y), rest.lost)
            self._move_to(eq, rest.y)
            lost += rest.lost
        after = self.state()
        self.journal.events.append(
            ReferenceEvent(kind, self.number, self.time, after.voltage, before, after, lost)
        )
        if ended is not None:
            assert ended[1].kind is not None
            self._end(ended[1].kind, after, self._name(ended[0], ended[1].balloon))

    def _end(self, kind: str, state: State, balloon: str | None) -> None:
        """Record the event that ends the history."""
        voltage = self.state().voltage
        self.journal.events.append(
            ReferenceEvent(kind, self.number, self.time, voltage, state, None, None, balloon)
        )
        self.outcome = kind


def _reach(legs: Sequence[Leg]) -> float:
    """The largest voltage or charge of some legs, or nearly: one of them is as near to 0 as that rounds."""
    return max(
        float(abs(leg.way.at(leg.first + share * (leg.last - leg.first), place)))
        for leg in legs
        for place in range(len(leg.start))
        for share in (0.0, 0.3, 0.7, 1.0)
    )


def _same(one: Sequence[float], other: Sequence[float], reach: float = 0.0) -> bool:
    """Whether two sets of voltages are the same but for rounding, also that of others as large as `reach`."""
    size = max(reach, *(abs(value) for value in (*one, *other)))
    return all(abs(a - b) <= SAME_VOLTAGE * size for a, b in zip(one, other, strict=True))
