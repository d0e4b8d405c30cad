"""Whether events happened where they say, and none was passed unseen: by the equations alone.

For quasi-static histories. At a limit point the Hessian is singular, at a breakdown a film is at its
strength, where tension is lost there is no pressure. Every sample is stable, taut and below every strength.
What is left after a snap or a jump is where the flow leads, integrated anew by SciPy.
"""

from __future__ import annotations

import dataclasses
import math
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator import History
from tests.fuzz.paths import hessian
from tests.oracle.general.creeping_flow import Drive, Film, FlowError, Motion, follow
from tests.oracle.general.elastomers import Law, loaded_law
from tests.oracle.general.real_time import strength_of

FloatArray = NDArray[np.float64]

SINGULAR = 1e-6  # of an eigenvalue, over the size of the Hessian's terms
MARGIN = 1e-7
LANDING = 1e-5
_ENDS = ("loss_of_tension", "breakdown", "runaway", "out_of_range")
_NUDGE = 3e-5
_ALIKE = 1e-9  # balloons whose stretches differ by less are alike
_HARDLY = 1e-8  # a pressure whose sign depends on rounding
_REST = 1e-10  # speed of a flow that has come to rest


def problems_of(history: History) -> list[str]:
    """What is wrong with the events and samples of a quasi-static history."""
    device = _Seen(history)
    return device.events() + device.samples()


def landing_problems_of(history: History) -> list[str]:
    """What is wrong with where its snaps and jumps lead."""
    return _Seen(history).landings()


class _Seen:
    """A history as the equations see it."""

    def __init__(self, history: History) -> None:
        self.history = history
        self.scenario = history.scenario
        self.balloons = self.scenario.balloons
        self.walls: list[Law] = [loaded_law(b.elastomer) for b in self.balloons]
        self.places = [history.balloons.index(name) for name in history.electroded]
        self.open: dict[int, bool] = {}
        self.charged: dict[int, bool] = {}
        given = False
        for number, step in enumerate(self.scenario.played_steps(), start=1):
            self.open[number] = hasattr(step, "inflate") or step.valve == "open"
            if not (hasattr(step, "inflate") or hasattr(step, "hold")):
                given = hasattr(step, "charge")
            self.charged[number] = given

    def voltages(self, voltage: FloatArray) -> FloatArray:
        out = np.zeros(len(self.balloons))
        out[self.places] = voltage
        return out

    def eigenvalues(self, step: int, stretch: FloatArray, pressure: float, voltage: FloatArray) -> FloatArray:
        """Eigenvalues of the Hessian of what is held in a step, over the size of its terms."""
        phi = self.voltages(voltage)
        liquid = self.scenario.gas.law == "liquid"
        if self.open[step]:
            diagonal = []
            for i, (wall, b) in enumerate(zip(self.walls, self.balloons, strict=True)):
                x = float(stretch[i])
                film = b.permittivity / (b.thickness**2 * b.modulus) * float(phi[i]) ** 2 * x * x
                terms = (
                    wall.slope(x),
                    -2.0 * b.radius / (b.thickness * b.modulus) * pressure * x,
                    (10.0 if self.charged[step] else -6.0) * film,
                )
                diagonal.append(sum(terms) / max(map(abs, terms)))
            return np.array(diagonal)
        if self.charged[step]:
            # A given charge adds 16 c φ² λ² to what a given voltage has: 16 e φ² λ²/h² of g′.
            return _charged(self, stretch, pressure, phi)
        matrix, size = hessian(self.scenario.gas, self.balloons, self.walls, stretch, pressure, phi)
        if liquid and len(self.balloons) == 1:
            return np.ones(1)
        return np.asarray(np.linalg.eigvalsh(matrix) / size)

    def share(self, stretch: FloatArray, voltage: FloatArray) -> float:
        """The largest field over its strength."""
        phi = self.voltages(voltage)
        return max(
            (
                abs(float(v)) * float(x) ** 2 / b.thickness / strength_of(b)(float(x))
                for b, x, v in zip(self.balloons, stretch, phi, strict=True)
                if b.breakdown is not None
            ),
            default=0.0,
        )

    def events(self) -> list[str]:
        out = []
        h = self.history
        for number, event in enumerate(h.events):
            kind = event.kind.value
            jumped = (
                number > 0 and h.events[number - 1].kind == "jump" and h.events[number - 1].time == event.time
            )
            where = f"event {number}, {kind} in step {event.step} at time {event.time!r}"
            # A charge keeps its film; the voltage before is that of the same charge.
            voltage = np.asarray(event.field_before) * [
                self.balloons[i].thickness / float(event.stretch_before[i]) ** 2 for i in self.places
            ]
            if kind in ("limit_point", "branch_point"):
                near = np.min(
                    np.abs(self.eigenvalues(event.step, event.stretch_before, event.pressure_before, voltage))
                )
                if near > SINGULAR:
                    out.append(f"{where}: the Hessian is {near:.2g} from singular")
            elif kind == "breakdown":
                share = self.share(event.stretch_before, np.asarray(event.voltage) if jumped else voltage)
                if share < 1.0 - MARGIN or (share > 1.0 + MARGIN and not jumped):
                    out.append(f"{where}: the field is {share!r} of the strength")
            elif kind == "loss_of_tension" and self.scenario.gas.law != "liquid":
                if event.pressure_before > MARGIN:
                    out.append(f"{where}: the pressure is {event.pressure_before!r}")
            elif kind == "out_of_range":
                room = min(
                    abs(wall.end - float(x)) for wall, x in zip(self.walls, event.stretch_before, strict=True)
                )
                if room > MARGIN:
                    out.append(f"{where}: {room:.2g} from the end of the table")
        return out

    def samples(self) -> list[str]:
        h = self.history
        times = {event.time for event in h.events}
        for row in range(len(h)):
            if float(h.time[row]) in times:
                continue
            step = int(h.step[row])
            where = f"sample {row} in step {step} at time {float(h.time[row])!r}"
            if not self.open[step] and h.pressure[row] < -MARGIN:
                return [f"{where}: pressure {float(h.pressure[row])!r}"]
            share = self.share(h.stretch[row], h.voltage[row])
            if share > 1.0 + MARGIN:
                return [f"{where}: the field is {share!r} of the strength"]
            for wall, x in zip(self.walls, h.stretch[row], strict=True):
                if not float(x) <= min(wall.limit, wall.end) + MARGIN:
                    return [f"{where}: stretch {float(x)!r} beyond {min(wall.limit, wall.end)!r}"]
            pressure = float(h.pressure[row])
            low = float(np.min(self.eigenvalues(step, h.stretch[row], pressure, h.voltage[row])))
            if low < -SINGULAR:
                return [f"{where}: unstable, an eigenvalue of {low:.2g}"]
        return []

    # -- where flows lead ---------------------------------------------------------------------------

    def motion(self) -> Motion:
        films = [
            Film(
                b.radius,
                b.thickness,
                b.modulus,
                b.permittivity,
                wall,
                None if b.breakdown is None else strength_of(b),
                1.0,
                0.0,
                (),
            )
            for b, wall in zip(self.balloons, self.walls, strict=True)
        ]
        return Motion(films, self.scenario.gas.chamber)

    def landings(self) -> list[str]:
        """Flows of snaps and jumps at given voltages, on a gas."""
        h = self.history
        if self.scenario.gas.law == "liquid":
            return []
        out = []
        for number, event in enumerate(h.events):
            kind = event.kind.value
            after = event.stretch_after
            if kind not in ("limit_point", "jump") or after is None or self.charged[event.step]:
                continue
            following = h.events[number + 1] if number + 1 < len(h.events) else None
            ends = following is not None and following.time == event.time and following.kind in _ENDS
            if following is not None and following.time == event.time and not ends:
                continue  # several snaps of one instant
            if kind == "jump" and number > 0 and h.events[number - 1].time == event.time:
                continue  # what was before it has moved already
            if np.max(np.abs(event.stretch_before - after)) < 1e-7 or (ends and self.part_by_chance(event)):
                continue
            try:
                found = self.landing(event)
            except FlowError:
                continue
            if found is None:
                continue
            end, stretch = found
            where = f"event {number}, {kind} in step {event.step} at time {event.time!r}"
            wanted = following.kind.value if ends and following is not None else "rest"
            low = event.pressure_after is not None and event.pressure_after < _HARDLY
            if low and (end, wanted) == ("loss_of_tension", "rest"):
                continue  # rounding decides
            if end != wanted:
                out.append(f"{where}: ends in {wanted}, the flow in {end} at {stretch.tolist()}")
            elif end != "runaway":
                apart = float(np.max(np.abs(after - stretch) / np.maximum(1.0, stretch)))
                if apart > LANDING:
                    out.append(f"{where}: {apart:.2g} from where the flow leads, {stretch.tolist()}")
        return out

    def landing(self, event: Any) -> tuple[str, FloatArray] | None:
        """How the flow from an event ends, and where; None where it does not within the time tried."""
        motion = self.motion()
        stretch = np.asarray(event.stretch_before)
        voltage = self.voltages(np.asarray(event.voltage))
        gas = pressure = None
        if self.open[event.step]:
            pressure = partial(_held, event.pressure_before)
        else:
            scenario = self.scenario.gas
            gamma = scenario.exponent if scenario.law == "adiabatic" else 1.0
            constant = (event.pressure_before + scenario.ambient_pressure) * motion.volume(
                stretch.tolist()
            ) ** gamma
            gas = partial(_sealed, constant=constant, gamma=gamma, ambient=scenario.ambient_pressure)
        drive = Drive(1.0, lambda _: voltage, pressure, gas, math.inf)
        starts = [stretch]
        speed = motion.rates(0.0, np.concatenate([stretch, [0.0]]), drive)[:-1]
        released = event.kind == "jump" and float(np.max(np.abs(speed))) < _REST
        if event.kind == "limit_point" or released:
            diagonal, coupling = motion.slopes(0.0, np.concatenate([stretch, [0.0]]), voltage, drive)
            values, vectors = np.linalg.eig(np.diag(diagonal) + coupling)
            order = np.argsort(np.real(values))
            if len(values) > 1 and abs(values[order[1]]) < 1e-4 * abs(values[order[-1]]) + 1e-9:
                return None  # several balloons at once
            if released and len(values) > 1 and np.real(values[order[1]]) < 0.0:
                return None  # several ways to leave
            soft = np.real(vectors[:, order[0]])
            soft /= np.max(np.abs(soft))
            starts = [stretch + sign * _NUDGE * soft for sign in (1.0, -1.0)]
        found = [self.flow(motion, drive, start) for start in starts]
        away = [
            one for one in found if one is not None and (len(starts) == 1 or _apart(one[1], stretch) > 1e-3)
        ]
        if event.kind == "limit_point" and len(away) != 1:
            return None  # no simple fold
        # A state that is left without what held it leaves on the side on which the potential falls more.
        best = max(away, key=lambda one: one[2], default=None)
        return None if best is None or (released and len(away) < 2) else best[:2]

    def part_by_chance(self, event: Any) -> bool:
        """Whether balloons of the same numbers that are alike part: nothing says when but what is rounded."""
        before, after = np.asarray(event.stretch_before), np.asarray(event.stretch_after)
        made = [(b.radius, b.thickness, b.modulus, b.permittivity) for b in self.balloons]
        return any(
            self.balloons[i].elastomer == self.balloons[j].elastomer
            and np.allclose(made[i], made[j], rtol=1e-12, atol=0.0)
            and abs(before[i] - before[j]) < _ALIKE
            and abs(after[i] - after[j]) > LANDING
            for i, j in combinations(range(len(made)), 2)
        )

    def flow(self, motion: Motion, drive: Drive, start: FloatArray) -> tuple[str, FloatArray, float] | None:
        """How a flow ends, where, and what the potential has lost."""
        state = np.concatenate([start, [0.0]])
        for kind, _, margin in motion.margins(0.0, state, drive):
            if kind == "breakdown" and margin <= 0.0:
                return kind, start, 0.0
        for lasts in (1.0, 1e2, 1e4, 1e6, 1e8, 1e10):
            leg = follow(motion, dataclasses.replace(drive, lasts=lasts), state, np.zeros(0), "LSODA")
            state = leg.state
            if leg.ended:
                return leg.crossings[-1].kind, state[:-1], float(state[-1])
            if np.max(np.abs(motion.rates(0.0, state, drive)[:-1])) < _REST:
                # Balloons that are alike may rest where only that keeps them; how they part is not told here.
                stable = min(motion.stability(0.0, state, drive)) > 0.0
                return ("rest", state[:-1], float(state[-1])) if stable else None
        return None


def _apart(one: FloatArray, other: FloatArray) -> float:
    return float(np.max(np.abs(one - other)))


def _held(pressure: float, _: float) -> float:
    return pressure


def _sealed(volume: float, constant: float, gamma: float, ambient: float) -> tuple[float, float]:
    absolute = constant / volume**gamma
    return absolute - ambient, -gamma * absolute / volume


def _charged(seen: _Seen, stretch: FloatArray, pressure: float, phi: FloatArray) -> FloatArray:
    """Eigenvalues where charges are given, valve closed."""
    gas = seen.scenario.gas
    films = np.array(
        [
            16.0 * b.permittivity / (b.thickness**2 * b.modulus) * float(v) ** 2 * float(x) ** 2
            for b, x, v in zip(seen.balloons, stretch, phi, strict=True)
        ]
    )
    matrix, size = hessian(gas, seen.balloons, seen.walls, stretch, pressure, phi, films)
    if gas.law == "liquid" and len(films) == 1:
        return np.ones(1)
    return np.asarray(np.linalg.eigvalsh(matrix) / max(size, float(np.max(films))))
