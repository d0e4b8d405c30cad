"""Branches of stable equilibria, followed in small certified steps of arclength.

A step is taken only if Newton's method lands near the tangent, the path turns little, and the determinant
of the bordered Jacobian keeps its sign; otherwise it is halved. So a step neither cuts a corner nor changes
branches. Within a step every margin is looked at in between; a dip is followed to its bottom.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize_scalar

from tests.oracle.general import points
from tests.oracle.general.equations import Equations, evened
from tests.oracle.general.points import PathError

FloatArray = NDArray[np.float64]

LARGEST_STEP = 0.15
LEAST_STEP = 1e-11
SMALL_STEP = 1e-6  # below which a change of branches is one
TURN = math.cos(0.2)
INSIDE = (0.25, 0.5, 0.75)
CLOSE = 1e-9  # margins, and distances of events, that are too close to call
ROUNDING = 1e-12  # of a margin where a branch begins
NEARLY_EVEN = 1e-5  # relative differences of stretches that may be none
BESIDE = 1e-8  # how far beyond its goal, in units of the drive, a branch is known


@dataclass(frozen=True)
class End:
    """Where a branch ends, and why; `mode` is the null vector where it is singular."""

    kind: str
    balloon: int
    y: FloatArray
    mode: FloatArray | None = None
    doubt: str | None = None


@dataclass(frozen=True)
class Piece:
    """The path between two neighbouring points."""

    eq: Equations
    a: FloatArray
    ta: FloatArray
    b: FloatArray
    tb: FloatArray

    def guess(self, share: float) -> FloatArray:
        """A cubic between the points, at a share of the way."""
        scales = self.eq.scales(self.a)
        length = float(np.linalg.norm((self.b - self.a) / scales))
        ma, mb = (t / np.linalg.norm(t / scales) * length for t in (self.ta, self.tb))
        x = share
        return np.asarray(
            self.a * (1 + 2 * x) * (1 - x) ** 2
            + self.b * x * x * (3 - 2 * x)
            + ma * x * (1 - x) ** 2
            - mb * x * x * (1 - x)
        )

    def at(self, share: float) -> FloatArray:
        """The point of the path in the plane at that share of the chord."""
        if share <= 0.0 or share >= 1.0:
            return self.a if share <= 0.0 else self.b
        scales = self.eq.scales(self.a)
        found = points.on_plane(self.eq, self.guess(share), (self.b - self.a) / scales**2)
        if found is None:
            raise PathError("a path was lost between two of its points")
        return found

    def at_drive(self, v: float) -> FloatArray:
        """The point at a given v."""
        low, high = 0.0, 1.0
        rising = self.b[-1] > self.a[-1]
        for _ in range(45):
            middle = 0.5 * (low + high)
            if (self.guess(middle)[-1] < v) == rising:
                low = middle
            else:
                high = middle
        guess = self.guess(low)
        scales = self.eq.scales(guess)
        found = points.at_drive(self.eq, guess, v)
        length = float(np.linalg.norm((self.b - self.a) / scales))
        if found is None or np.linalg.norm((found - guess) / scales) > 0.3 * length:
            share = brentq(lambda s: self.at(s)[-1] - v, 0.0, 1.0, xtol=1e-15, rtol=1e-15)
            found = self.at(float(share)).copy()
            found[-1] = v
        return found


@dataclass
class Side:
    """A branch in one sense of the drive from where it began: its points, and its end once that is found."""

    eq: Equations
    sense: float
    ys: list[FloatArray]
    ts: list[FloatArray]
    sign: float
    step: float = 0.02
    end: End | None = None
    doubts: list[tuple[float, str]] = field(default_factory=list)
    margins: list[FloatArray] = field(default_factory=list)  # of the last point and the sample before it
    last: Piece | None = None

    @classmethod
    def beginning(cls, eq: Equations, y: FloatArray, sense: float) -> Side:
        """A side of a branch through a stable state."""
        like = np.zeros(y.size)
        like[-1] = sense
        t, sign = points.tangent(eq, y, like)
        return cls(eq, sense, [y], [t], sign, margins=[eq.margins(y.tolist())])

    def extend(self, goal: float) -> None:
        """Follow the branch until it has passed `goal`, or to its end."""
        while self.end is None:
            y = self.ys[-1]
            scale = self.eq.scales(y)[-1]
            if self.sense * (y[-1] - goal) >= BESIDE * scale:
                return
            self._advance()
            if len(self.ys) > 20000:
                raise PathError("a branch without end")

    def _advance(self) -> None:
        while True:
            if self.step < LEAST_STEP:
                raise PathError(f"no step from {self.ys[-1].tolist()}")
            tried = self._tried()
            if tried is not None and (tried[2] == self.sign or self.step <= SMALL_STEP):
                break
            self.step *= 0.5
        y, t, sign, cosine = tried
        piece = Piece(self.eq, self.ys[-1], self.ts[-1], y, t)
        try:
            inside = [piece.at(x) for x in INSIDE]
        except PathError:
            self.step *= 0.5
            return
        states = [piece.a, *inside, piece.b]
        margins = np.array([self.eq.margins(state.tolist()) for state in states])
        turned = t[-1] * self.sense <= 0.0 or sign != self.sign
        found = self._first_event(piece, margins, turned)
        self._look_into_dips(piece, margins, None if found is None else found[:2])
        if found is not None:
            self.end = self._ended(piece, *found)
            if self.end.kind == "branch_point":
                # The last points before it are singular but for rounding.
                near = 1e-6 * self.eq.scales(self.end.y)[-1]
                self.doubts = [d for d in self.doubts if abs(d[0] - self.end.y[-1]) > near]
            if self.end.mode is not None:
                t = points.null_direction(self.eq, self.end.y, self.ts[-1])
            else:
                t = points.tangent(self.eq, self.end.y, self.ts[-1])[0]
            y = self.end.y
        self.ys.append(y)
        self.ts.append(t)
        self.last = piece
        self.margins = [margins[-2], margins[-1]]
        if cosine > math.cos(0.07):
            self.step = min(1.5 * self.step, LARGEST_STEP)

    def _tried(self) -> tuple[FloatArray, FloatArray, float, float] | None:
        """A step of the present length; None where it is too long."""
        y, t = self.ys[-1], self.ts[-1]
        scales = self.eq.scales(y)
        guess = y + self.step * t
        found = points.on_plane(self.eq, guess, t / scales**2)
        if found is None or np.linalg.norm((found - guess) / scales) > 0.2 * self.step + 1e-13:
            return None
        new, sign = points.tangent(self.eq, found, t)
        cosine = float((new / scales) @ (t / scales)) / float(np.linalg.norm(new / scales))
        return None if cosine < TURN else (found, new, sign, cosine)

    def _first_event(
        self, piece: Piece, margins: FloatArray, turned: bool
    ) -> tuple[float, tuple[str, int], str | None] | None:
        """Share of a piece at which the first margin vanishes, which it is, and whether that is certain."""
        shares = (0.0, *INSIDE, 1.0)
        found: list[tuple[float, tuple[str, int]]] = []
        for place, name in enumerate(self.eq.margin_names()):
            column = margins[:, place]
            if -ROUNDING < column[0] < 0.0:
                column[0] = 0.0
            if name[0] == "singular" and turned:
                found.append((self._turn(piece, column), name))
                continue
            for i in range(4):
                if column[i] >= 0.0 > column[i + 1]:
                    found.append((_root(partial(self._value, piece, name), shares[i], shares[i + 1]), name))
                    break
            else:
                if column[0] < 0.0:
                    raise PathError(f"beyond an event, {name[0]}, at the start of a step")
        if not found:
            return None
        found.sort(key=lambda item: item[0])
        length = self.step
        close = len(found) > 1 and (found[1][0] - found[0][0]) * length < CLOSE
        return *found[0], f"{found[0][1][0]} and {found[1][1][0]} coincide" if close else None

    def _value(self, piece: Piece, name: tuple[str, int], share: float) -> float:
        return float(self.eq.margin(name, piece.at(share).tolist()))

    def _turn(self, piece: Piece, stability: FloatArray) -> float:
        """Where the drive turns round on a piece, or where it becomes unstable without that."""

        def advance(share: float) -> float:
            y = piece.at(share)
            t = points.tangent(self.eq, y, piece.ta)[0]
            return float(t[-1] * self.sense)

        if advance(1.0) <= 0.0:
            if advance(0.0) <= 0.0:
                return 0.0
            return _root(advance, 0.0, 1.0, 1e-10)
        if stability[-1] < 0.0 <= stability[0]:
            return _root(lambda s: self._value(piece, ("singular", -1), s), 0.0, 1.0, 1e-10)
        raise PathError("the determinant changes its sign without a reason")

    def _look_into_dips(
        self, piece: Piece, margins: FloatArray, event: tuple[float, tuple[str, int]] | None
    ) -> None:
        """Margins that come near zero between samples without an event are doubts, or were events unseen."""
        shares = (0.0, *INSIDE, 1.0)
        rows = list(margins)
        pieces: list[tuple[Piece, float, float]] = [(piece, shares[i], shares[i + 1]) for i in range(4)]
        if self.last is not None:
            rows.insert(0, self.margins[0])
            pieces.insert(0, (self.last, INSIDE[-1], 1.0))
        for place, name in enumerate(self.eq.margin_names()):
            column = [row[place] for row in rows]
            for i in range(1, len(column) - 1):
                left, middle, right = column[i - 1 : i + 2]
                if not (left > middle <= right and 0.0 <= middle < 0.5 * (left + right)):
                    continue
                # What lies beyond an event is none of this branch, and the event's own zero is no dip.
                if event is not None and pieces[i][0] is piece:
                    reach = pieces[i][2] if name == event[1] else pieces[i][1]
                    if reach >= event[0]:
                        continue
                self._dip(name, pieces[i - 1 : i + 1])

    def _dip(self, name: tuple[str, int], pieces: list[tuple[Piece, float, float]]) -> None:
        for piece, low, high in pieces:
            found = minimize_scalar(
                lambda s, piece=piece: self._value(piece, name, s),
                bounds=(low, high),
                method="bounded",
                options={"xatol": 1e-9 * (high - low) + 1e-14},
            )
            if found.fun < CLOSE:
                v = float(piece.at(float(found.x))[-1])
                self.doubts.append((v, f"{name[0]} is only just avoided or passed, {found.fun:.2g}"))

    def _ended(self, piece: Piece, share: float, name: tuple[str, int], doubt: str | None) -> End:
        """The state at an event, polished."""
        guess = piece.at(share)
        scales = self.eq.scales(guess)
        mode = None
        if name[0] == "singular":
            solved = self._symmetric(guess) or points.singular(self.eq, guess)
            y, mode = solved if solved is not None else (None, None)
        else:
            y = points.where(self.eq, guess, lambda z: self.eq.margin(name, z))
        reach = 1e-4 if name[0] == "singular" else 1e-6
        if y is None or np.linalg.norm((y - guess) / scales) > reach + 0.3 * self.step:
            raise PathError(f"{name[0]} near {guess.tolist()} could not be polished")
        kind, balloon = name
        if mode is not None:
            kind, unsure = self._kind_of(y, mode)
            doubt = doubt or unsure
        others = [
            self.eq.margin(n, y.tolist()) for n in self.eq.margin_names() if n != name and n[0] != "singular"
        ]
        if min(others, default=1.0) < -CLOSE:
            raise PathError(f"{kind} beyond another event")
        return End(kind, balloon, y, mode, doubt)

    def _kind_of(self, y: FloatArray, mode: FloatArray) -> tuple[str, str | None]:
        """A limit point if the drive pushes along the soft mode, else a branch point; what is doubtful."""
        load = self.eq.load(y.tolist())
        parts, size = np.abs(mode * load), float(np.linalg.norm(load))
        push = abs(float(mode @ load))
        share = push / max(float(np.sum(parts)), 1e-300)  # small where the parts cancel
        near = push / max(size, 1e-300)
        kind = "limit_point" if share > 1e-8 and near > 1e-12 else "branch_point"
        if 1e-11 < share < 1e-5 or (share > 1e-5 and 1e-14 < near < 1e-10):
            return kind, f"a fold or a branch point, {share:.2g}, {near:.2g}"
        return kind, None

    def _symmetric(self, guess: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """The singular state near `guess` in which balloons that are alike are stretched alike, if any.

        At a branch point all equations for a singular state are singular themselves; not so among symmetric
        ones.
        """
        even = evened(guess, self.eq.alike(guess, NEARLY_EVEN))
        scales = self.eq.scales(guess)
        if np.max(np.abs(even - guess) / scales) > NEARLY_EVEN or np.array_equal(even, guess):
            return None
        found = points.singular(self.eq, even)
        if found is None or np.max(np.abs(found[0] - guess) / scales) > 2.0 * NEARLY_EVEN:
            return None
        return found


def _root(function: Callable[[float], float], low: float, high: float, width: float = 1e-14) -> float:
    if function(low) <= 0.0:
        return low
    return float(brentq(function, low, high, xtol=width, rtol=1e-14))


@dataclass
class Branch:
    """Stable equilibria in order of the drive, both ways from where it was first met."""

    eq: Equations
    up: Side
    down: Side

    @classmethod
    def through(cls, eq: Equations, y: FloatArray) -> Branch:
        """The branch through a stable state, polished at its v."""
        found = points.at_drive(eq, y, float(y[-1]))
        if found is None or np.linalg.norm((found - y) / eq.scales(y)) > 1e-6:
            raise PathError(f"no equilibrium at {y.tolist()}")
        return cls(eq, Side.beginning(eq, found, 1.0), Side.beginning(eq, found, -1.0))

    def side(self, v: float) -> Side:
        """The side on which v is."""
        return self.up if v >= self.up.ys[0][-1] else self.down

    def extend(self, goal: float) -> None:
        """Follow it at least to `goal`, if it does not end before."""
        self.side(goal).extend(goal)

    def end(self, sense: float) -> End | None:
        """Its end in a sense of the drive, as far as it is known."""
        return (self.up if sense > 0.0 else self.down).end

    def covers(self, v: float) -> bool:
        """Whether v is between the points that are known."""
        return bool(self.down.ys[-1][-1] <= v <= self.up.ys[-1][-1])

    def pieces(self, v0: float, v1: float) -> list[Piece]:
        """The path from one v to another, in that order, cut at its points."""
        sense = 1.0 if v1 > v0 else -1.0
        ya, yb = self.state(v0), self.state(v1)
        nodes = [*reversed(list(zip(self.down.ys[1:], self.down.ts[1:], strict=True)))]
        nodes = [(y, -t) for y, t in nodes] + list(zip(self.up.ys, self.up.ts, strict=True))
        nodes = nodes if sense > 0.0 else [(y, -t) for y, t in reversed(nodes)]
        between = [(y, t) for y, t in nodes if sense * (y[-1] - v0) > 0.0 and sense * (v1 - y[-1]) > 0.0]
        ends = []
        for y in (ya, yb):
            near = min(nodes, key=lambda node: float(np.linalg.norm((node[0] - y) / self.eq.scales(y))))
            ends.append((y, self._direction(y, near[1])))
        chain = [ends[0], *between, ends[1]]
        return [Piece(self.eq, *chain[i], *chain[i + 1]) for i in range(len(chain) - 1)]

    def _direction(self, y: FloatArray, like: FloatArray) -> FloatArray:
        for end in (self.up.end, self.down.end):
            if end is not None and end.mode is not None and np.array_equal(end.y, y):
                return points.null_direction(self.eq, y, like)
        try:
            return points.tangent(self.eq, y, like)[0]
        except np.linalg.LinAlgError:
            return points.null_direction(self.eq, y, like)

    def state(self, v: float) -> FloatArray:
        """The state at v."""
        side = self.side(v)
        side.extend(v)
        vs = [side.sense * y[-1] for y in side.ys]
        place = int(np.searchsorted(vs, side.sense * v))
        if place >= len(vs):
            if side.end is not None and abs(v - side.ys[-1][-1]) <= 1e-12 * self.eq.scales(side.ys[-1])[-1]:
                return side.ys[-1]
            raise PathError(f"no state at {v}, beyond the end of a branch")
        if vs[place] == side.sense * v or place == 0:
            return side.ys[place]
        i = place - 1
        return Piece(self.eq, side.ys[i], side.ts[i], side.ys[place], side.ts[place]).at_drive(v)

    def doubts(self, v0: float, v1: float) -> list[str]:
        """What is too close to call between two v."""
        low, high = min(v0, v1), max(v0, v1)
        return [text for side in (self.up, self.down) for v, text in side.doubts if low <= v <= high]
