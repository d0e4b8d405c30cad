"""The overdamped flow dλ/dt = −g at a frozen drive, by two integrators of SciPy that must agree.

The gas law holds throughout: of a gas the pressure is a formula of the stretches, of a liquid it follows
from a volume that stays. A flow ends where it comes to rest (Newton's method close by, a positive definite
Hessian), or where a margin vanishes. A passage so close to an unstable equilibrium, or to an event, that
rounding might send it the other way is a doubt.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import BDF, LSODA, Radau
from scipy.optimize import brentq, minimize_scalar

from tests.oracle.general import points
from tests.oracle.general.equations import STEP, Equations

FloatArray = NDArray[np.float64]

LANDING = 1e-5  # relative distance from which Newton's method may take over
SAME = 1e-7  # what two integrators may differ by
SLOW = 1e-7  # a speed on the way that tells of an equilibrium passed closely
CLOSE = 1e-8  # a margin on the way that tells of an event passed closely
OFF = 1e-4  # relative distance at which a flow begins beside an equilibrium
MOST_STEPS = 2500
SIDES = (1.0, -1.0)


class FlowError(ArithmeticError):
    """A flow that came to no end."""


@dataclass(frozen=True)
class Rest:
    """Where a flow ended: `kind` is that of an event, None at rest; `lost` is what the potential fell by."""

    kind: str | None
    balloon: int
    y: FloatArray
    lost: float
    doubt: str | None = None


@dataclass(frozen=True)
class Motion:
    """The flow of a set of equations at one v."""

    eq: Equations
    v: float
    classes: tuple[tuple[int, ...], ...] = ()

    def whole(self, x: Sequence[Any]) -> list[Any]:
        """All stretches, of one for each class of balloons that move alike."""
        if not self.classes:
            return list(x)
        out = [x[0]] * self.eq.size
        for value, places in zip(x, self.classes, strict=True):
            for place in places:
                out[place] = value
        return out

    def reduced(self, x: Sequence[Any]) -> list[Any]:
        """One stretch for each class."""
        return [x[places[0]] for places in self.classes] if self.classes else list(x)

    def state(self, x: Sequence[Any]) -> list[Any]:
        """All unknowns of stretches in motion (one for each class)."""
        eq, x = self.eq, self.whole(x)
        if eq.contents is None:
            return [*x, self.v]
        if not eq.contents.is_liquid:
            return [*x, eq.contents.law(eq.contents.swelling(x))[0], self.v]
        without = eq.residual([*x, 0.0, self.v])[:-1]
        areas = eq.areas(x)
        lift = sum(a * b.radius / b.thickness * xi * xi for a, b, xi in zip(areas, eq.walls, x, strict=True))
        return [*x, sum(a * g for a, g in zip(areas, without, strict=True)) / lift, self.v]

    def rates(self, x: Sequence[Any]) -> NDArray[Any]:
        """dλ/dt, one for each class."""
        y = self.state(x)
        return np.array(self.reduced((-self.eq.residual(y)[: self.eq.size]).tolist()))

    def slopes(self, x: FloatArray) -> FloatArray:
        """Its derivatives, by complex steps."""
        columns = []
        for j in range(x.size):
            z = [complex(value) if i == j else value for i, value in enumerate(x.tolist())]
            z[j] += 1j * STEP
            columns.append(np.imag(self.rates(z)) / STEP)
        return np.array(columns).T

    def projected(self, x: FloatArray) -> FloatArray:
        """Stretches (of all balloons) nearby that have the volume of a liquid."""
        contents = self.eq.contents
        if contents is None or not contents.is_liquid:
            return x
        for _ in range(8):
            areas = self.eq.areas(x.tolist())
            excess = contents.swelling(x.tolist()) * contents.volume
            x = x - excess / float(areas @ areas) * areas
        return x


@dataclass
class _Record:
    """A trajectory: steps with their interpolants, and margins and speeds along it."""

    times: list[float]
    margins: list[FloatArray]
    speeds: list[float]
    distances: list[float]
    pieces: list[Callable[[float], FloatArray]]


def relax(eq: Equations, v: float, start: FloatArray, before: FloatArray, *, off: float = 0.0) -> Rest:
    """The flow from stretches `start`; `before` is the state whose potential it is reckoned from.

    Within `off` of the start a low speed is no doubt: there the flow leaves an equilibrium.
    """
    start = Motion(eq, v).projected(start)
    motion = Motion(eq, v, _classes(eq, v, start))
    top = eq.potential(before.tolist())
    # Off an equilibrium the second begins further away: where it ends should not depend on that.
    other = Motion(eq, v).projected(before[: eq.size] + 2.0 * (start - before[: eq.size])) if off else start
    first, second = _by_two_methods(motion, start, other, off, eq.device.integrators)
    doubt = first.doubt or second.doubt
    if (first.kind, first.balloon) != (second.kind, second.balloon):
        doubt = f"two integrators end in {first.kind} and {second.kind}"
    elif first.kind != "runaway":
        apart = float(np.max(np.abs(first.y - second.y) / eq.scales(first.y)))
        if apart > SAME:
            doubt = doubt or f"two integrators end {apart:.2g} apart"
    lost = top - eq.potential(first.y.tolist()) if first.kind != "runaway" else math.inf
    if first.kind is None and not eq.stability(first.y.tolist()) > 0.0:
        # Balloons that are alike rest where only that keeps them: there they part, the first one growing.
        onward = parted(eq, first.y)
        return replace(onward, lost=lost + onward.lost, doubt=doubt or onward.doubt)
    if lost < -1e-9 * (1.0 + abs(top)):
        raise FlowError(f"the potential rises by {-lost:.3g} in a flow")
    return replace(first, lost=lost, doubt=doubt)


def _by_two_methods(
    motion: Motion, start: FloatArray, other: FloatArray, off: float, wanted: int
) -> tuple[Rest, Rest]:
    """Ends of a flow by the first two integrators that come to one; each is at a loss with some flow.

    Both are the same where only one is wanted.
    """
    found: list[Rest] = []
    failure: FlowError | None = None
    for looser in (1.0, 100.0):  # rounding may be all that is seen at a tight tolerance
        for method, rtol in ((LSODA, 1e-10), (Radau, 1e-9), (BDF, 1e-9)):
            at_rest = found and found[0].kind is None
            try:
                tolerance = rtol * looser * (10.0 if at_rest and method is Radau else 1.0)
                found.append(_followed(motion, other if found else start, method, tolerance, off))
            except FlowError as error:
                failure = error
            if len(found) == wanted:
                return found[0], found[-1]
    if not found:
        raise failure or FlowError("no end")
    return found[0], replace(
        found[0], doubt=found[0].doubt or f"one integrator alone comes to an end: {failure}"
    )


def _classes(eq: Equations, v: float, start: FloatArray) -> tuple[tuple[int, ...], ...]:
    """Balloons that move alike from a start, together; none where all move by themselves."""
    out: list[tuple[int, ...]] = []
    for places in eq.twins(v):
        rest = list(places)
        while rest:
            same = [i for i in rest if abs(start[i] - start[rest[0]]) <= 1e-13 * start[i]]
            out.append(tuple(same))
            rest = [i for i in rest if i not in same]
    return tuple(out) if len(out) < eq.size else ()


def parted(eq: Equations, y: FloatArray) -> Rest:
    """The flow off an equilibrium whose unstable direction breaks a symmetry."""
    growth, directions = soft_modes(eq, y)
    mode = directions[:, 0]
    mode = mode * np.sign(mode[int(np.argmax(np.abs(mode) > 1e-6 * np.max(np.abs(mode))))])
    doubt = "several directions are unstable" if growth.size > 1 and growth[1] > 0.0 else None
    if growth[0] < 1e-7:
        doubt = "balloons that are alike are only just unstable"
    rest = relax(eq, float(y[-1]), beside(eq, y, mode), y, off=10.0 * OFF)
    return replace(rest, doubt=rest.doubt or doubt)


def _followed(motion: Motion, start: FloatArray, method: Any, rtol: float, off: float) -> Rest:
    eq = motion.eq
    names = eq.margin_names()[1:]
    start = np.array(motion.reduced(start.tolist()))

    def margins(x: FloatArray) -> FloatArray:
        y = motion.state(x.tolist())
        return np.array([eq.margin(name, y) for name in names])

    solver = method(
        lambda _, x: motion.rates(x.tolist()),
        0.0,
        start,
        1e18,
        rtol=rtol,
        atol=1e-2 * rtol,
        jac=lambda _, x: motion.slopes(x),
        first_step=1e-6 / (1.0 + _size(motion.rates(start.tolist()))),
    )
    record = _Record([0.0], [margins(start)], [_size(motion.rates(start.tolist()))], [0.0], [])
    for _ in range(MOST_STEPS):
        try:
            message = solver.step()
        except ValueError as error:  # beyond the stretch limit nothing is a number
            raise FlowError(f"a flow could not be integrated: {error}") from None
        if solver.status != "running" or not np.all(np.isfinite(solver.y)):
            raise FlowError(f"a flow could not be integrated: {message}")
        dense = solver.dense_output()
        before = record.times[-1]
        for share in (1.0 / 3.0, 2.0 / 3.0, 1.0):
            t = before + share * (solver.t - before)
            record.times.append(t)
            record.margins.append(margins(dense(t) if share < 1.0 else solver.y))
            record.pieces.append(dense)
        record.speeds.append(_size(motion.rates(solver.y.tolist())))
        record.distances.append(float(np.max(np.abs(solver.y / start - 1.0))))
        if any(np.any(m < 0.0) for m in record.margins[-3:]):
            return _ended(motion, names, record, margins, off)
        landed = _landing(motion, solver.y, record.speeds[-1])
        if landed is not None:
            dip = _dip(names, record, margins)
            if dip is not None and dip[1] < 0.0:
                return _ended(motion, names, record, margins, off, dip)
            doubt = _doubt_of(record, off)
            if dip is not None and dip[1] < CLOSE:
                doubt = f"{dip[0]} only just avoided in a flow, {dip[1]:.2g}"
            return Rest(None, -1, landed, 0.0, doubt)
    raise FlowError(f"a flow has no end within {MOST_STEPS} steps")


def _size(rates: FloatArray) -> float:
    return float(np.max(np.abs(rates)))


def _landing(motion: Motion, x: FloatArray, speed: float) -> FloatArray | None:
    """The equilibrium that a flow is about to rest in, if it is that near."""
    eq = motion.eq
    if speed > 1e-2:
        return None
    y = np.array(motion.state(x.tolist()))
    if not _holds(motion, y):
        return None
    found = points.at_drive(eq, y, motion.v)
    if found is None or not _holds(motion, found):
        return None
    return found if float(np.max(np.abs(found - y) / eq.scales(y))) < LANDING else None


def _holds(motion: Motion, y: FloatArray) -> bool:
    """Whether a state is stable against what the flow can do."""
    eq, liquid = motion.eq, motion.eq.contents is not None and motion.eq.contents.is_liquid
    if not motion.classes:
        return eq.stability(y.tolist()) > 0.0
    even = np.zeros((eq.size, len(motion.classes)))
    for column, places in enumerate(motion.classes):
        even[list(places), column] = 1.0
    h = even.T @ eq.hessian(y.tolist()) @ even
    if liquid:
        basis = np.linalg.svd((even.T @ eq.areas(y.tolist()))[None])[2][1:].T
        h = basis.T @ h @ basis
    return bool(np.all(np.isfinite(h)) and np.all(np.linalg.eigvalsh(h) > 0.0))


def _doubt_of(record: _Record, off: float) -> str | None:
    speeds = record.speeds
    for i in range(1, len(speeds) - 1):
        if speeds[i - 1] > speeds[i] < speeds[i + 1] and speeds[i] < SLOW and record.distances[i] > off:
            return f"an unstable equilibrium is passed closely in a flow, at speed {speeds[i]:.2g}"
    return None


def _at(record: _Record, i: int, t: float) -> FloatArray:
    """The stretches at a time between samples i and i + 1."""
    return np.asarray(record.pieces[i](t))


def _ended(
    motion: Motion,
    names: Sequence[tuple[str, int]],
    record: _Record,
    margins: Callable[[FloatArray], FloatArray],
    off: float,
    dip: tuple[str, float, int, float] | None = None,
) -> Rest:
    """The first event of a flow."""
    found: list[tuple[float, int, int]] = []
    for place in range(len(names)):
        for i in range(len(record.times) - 1):
            low, high = record.times[i], record.times[i + 1]
            if dip is not None and names[place][0] == dip[0] and i == dip[2]:
                high = dip[3]
            elif not record.margins[i + 1][place] < 0.0:
                continue
            if record.margins[i][place] <= 0.0:
                found.append((low, place, i))
            else:
                t = brentq(
                    lambda t, i=i, p=place: margins(_at(record, i, t))[p], low, high, xtol=1e-300, rtol=1e-14
                )
                found.append((float(t), place, i))
            break
    found.sort()
    t, place, i = found[0]
    kind, balloon = names[place]
    x = _at(record, i, t)
    doubt = _doubt_of(record, off)
    if len(found) > 1 and kind != names[found[1][1]][0]:
        gap = float(np.max(np.abs(_at(record, *found[1][2:], found[1][0]) - x)))
        doubt = doubt or (f"two events of a flow coincide, {gap:.2g} apart" if gap < CLOSE else None)
    whole = motion.projected(np.array(motion.whole(x.tolist())))
    return Rest(kind, balloon, np.array(Motion(motion.eq, motion.v).state(whole.tolist())), 0.0, doubt)


def _dip(
    names: Sequence[tuple[str, int]], record: _Record, margins: Callable[[FloatArray], FloatArray]
) -> tuple[str, float, int, float] | None:
    """The lowest margin between samples: kind, value, where, when; None where none came near zero."""
    lowest: tuple[str, float, int, float] | None = None
    for place, name in enumerate(names):
        column = [float(m[place]) for m in record.margins]
        for i in range(1, len(column) - 1):
            left, middle, right = column[i - 1 : i + 2]
            if not (left > middle <= right and middle < 2.0 * max(left - middle, right - middle) + CLOSE):
                continue
            for j in (i - 1, i):
                found = minimize_scalar(
                    lambda t, j=j, p=place: margins(_at(record, j, t))[p],
                    bounds=(record.times[j], record.times[j + 1]),
                    method="bounded",
                    options={"xatol": 1e-10 * (record.times[j + 1] - record.times[j])},
                )
                if lowest is None or found.fun < lowest[1]:
                    lowest = name[0], float(found.fun), j, float(found.x)
    return lowest


def soft_modes(eq: Equations, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rates of growth of the flow about an equilibrium, falling, and their directions as columns."""
    root = 1.0 / np.sqrt(np.array(eq.weights))
    h = eq.hessian(y.tolist()) * np.outer(root, root)
    basis = np.eye(eq.size)
    if eq.contents is not None and eq.contents.is_liquid:
        basis = np.linalg.svd((eq.areas(y.tolist()) * root)[None])[2][1:].T
    values, vectors = np.linalg.eigh(basis.T @ h @ basis)
    directions = root[:, None] * (basis @ vectors)
    return -values, directions / np.linalg.norm(directions, axis=0)


def beside(eq: Equations, y: FloatArray, direction: FloatArray, size: float = OFF) -> FloatArray:
    """Stretches a little off a state, so little that no margin has changed much."""
    motion = Motion(eq, float(y[-1]))
    names = eq.margin_names()[1:]
    here = np.array([eq.margin(name, y.tolist()) for name in names])
    while size > 1e-9:
        change = direction / np.max(np.abs(direction) / y[: eq.size])
        x = motion.projected(y[: eq.size] + size * change)
        there = motion.state(x.tolist())
        if all(eq.margin(name, there) > 0.5 * m for name, m in zip(names, here, strict=True)):
            break
        size *= 0.1
    return x


def snap(eq: Equations, y: FloatArray, mode: FloatArray, sense: float) -> Rest:
    """The flow off a fold, the way on which the drive was pushing it."""
    direction = -mode * np.sign(sense * float(mode @ eq.load(y.tolist())))
    return relax(eq, float(y[-1]), beside(eq, y, direction), y, off=10.0 * OFF)


def release(eq: Equations, y: FloatArray) -> Rest:
    """The flow off an unstable equilibrium: of its two ways the one on which the potential falls more."""
    growth, directions = soft_modes(eq, y)
    doubt = "several directions are unstable" if growth.size > 1 and growth[1] > 0.0 else None
    if growth[0] < 1e-7:
        doubt = "a state is only just unstable"
    ways = [
        relax(eq, float(y[-1]), beside(eq, y, side * directions[:, 0]), y, off=10.0 * OFF) for side in SIDES
    ]
    best, other = sorted(ways, key=lambda rest: -rest.lost)
    if not math.isinf(best.lost) and best.lost - other.lost < 1e-6 * (1.0 + abs(best.lost)):
        doubt = doubt or "both ways from an unstable state lower the potential equally"
    return replace(best, doubt=best.doubt or other.doubt or doubt)
