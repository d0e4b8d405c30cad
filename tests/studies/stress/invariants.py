"""What any history must satisfy, whatever the number of balloons: for devices without a closed form.

Nothing here uses the simulator's equations. The flow is integrated by SciPy in its own variables.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.model.elastomers import as_written
from simulator.results.history import Outcome
from simulator.scenario import Inflate, load_scenario
from tests.oracle.closed_form import Balloon
from tests.pairs import run
from tests.studies.stress.case import Finding
from tests.studies.stress.closed_form import relative

if TYPE_CHECKING:
    from simulator.results.history import Event, History

FloatArray = NDArray[np.float64]

_BEYOND = 1e-7  # relative change of the voltage that starts a flow off its limit point


@dataclass(frozen=True)
class Gas:
    """Balloons on one sealed amount of gas; voltages are given for each balloon, 0 without electrodes."""

    balloons: tuple[Balloon, ...]
    ambient: float
    amount: float

    @classmethod
    def of(cls, history: History, row: int) -> Gas:
        """That of a history, sealed as it is in a row."""
        found = []
        for written in history.scenario.balloons:
            elastomer = as_written(written.elastomer)
            ratios = (written.radius, written.thickness, written.modulus, written.permittivity)
            found.append(Balloon(elastomer, *ratios))
        ambient = history.scenario.gas.ambient_pressure
        volume = sum(b.cube * x**3 / 3.0 for b, x in zip(found, history.stretch[row], strict=True))
        return cls(tuple(found), ambient, float((history.pressure[row] + ambient) * volume))

    @cached_property
    def _ratios(self) -> FloatArray:
        return np.array([[b.pressure_load, b.electric_load, b.modulus, b.cube] for b in self.balloons]).T

    def pressure(self, stretch: FloatArray) -> FloatArray:
        """n/V − pₑ for stretches (…, n_balloons)."""
        return np.asarray(3.0 * self.amount / (stretch**3 @ self._ratios[3]) - self.ambient)

    def imbalance(self, stretch: FloatArray, pressure: FloatArray, voltage: FloatArray) -> float:
        """Largest |N − D·load| over the sum of its terms, of rows (n, n_balloons)."""
        worst = 0.0
        for i, balloon in enumerate(self.balloons):
            x = stretch[:, i]
            n, d = balloon.elastomer.pole_form(x)
            load = d * (
                balloon.pressure_load * pressure * x**2 + balloon.electric_load * voltage[:, i] ** 2 * x**3
            )
            worst = max(worst, float(np.max(np.abs(n - load) / np.maximum(np.abs(n) + load, 1.0))))
        return worst

    def rates(self, stretch: FloatArray, voltage: FloatArray) -> FloatArray:
        """dλ/dt = −g of the overdamped flow, at stretches and voltages (n_balloons,)."""
        pressure = float(self.pressure(stretch))
        out = np.empty(stretch.size)
        for i, balloon in enumerate(self.balloons):
            x = float(stretch[i])
            n, d = balloon.elastomer.pole_form(x)
            if not d > 0.0:
                return np.full(stretch.size, math.nan)
            load = balloon.pressure_load * pressure + balloon.electric_load * voltage[i] ** 2 * x
            out[i] = balloon.modulus * (load * x * x - n / d)
        return out

    def flow(self, stretch: FloatArray, voltage: FloatArray, beyond: FloatArray) -> FloatArray:
        """Where the flow rests at a voltage when it was started by one a little beyond."""
        from scipy.integrate import solve_ivp

        slowest = 1.0 / min(balloon.modulus for balloon in self.balloons)
        for now, lasts in ((beyond, 1e6 * slowest), (voltage, 1e3 * slowest)):
            with np.errstate(all="ignore"):
                result = solve_ivp(
                    lambda t, x, now=now: self.rates(x, now),
                    (0.0, lasts),
                    stretch,
                    method="Radau",
                    rtol=1e-9,
                    atol=1e-12,
                )
            if not result.success:
                raise ArithmeticError(f"SciPy's flow: {result.message}")
            stretch = result.y[:, -1]
        return np.asarray(stretch)


def invariants(history: History, bound: float = 1e-8) -> Finding:
    """Force balance, gas and energy books of the part with the valve closed, and its landings."""
    inflations = sum(isinstance(step, Inflate) for step in history.scenario.played_steps())
    closed = np.flatnonzero(history.step > inflations)
    gas = Gas.of(history, int(closed[0]))
    resting = closed
    if history.outcome is not Outcome.COMPLETED:  # where a flow ended is no equilibrium
        resting = closed[history.branch[closed] < history.branch[-1]]
    voltage = _by_balloon(history, history.voltage)
    errors = [
        gas.imbalance(history.stretch[resting], history.pressure[resting], voltage[resting]),
        float(np.max(np.abs(gas.pressure(history.stretch[closed]) - history.pressure[closed]))),
        _unbalanced(gas, history),
        *(
            _landing(gas, history, event)
            for event in history.events
            if event.step > inflations and event.kind == "limit_point" and event in history.snaps
        ),
    ]
    return Finding(max(errors), bound, "balance")


def permuted(history: History, bound: float = 1e-8) -> Finding:
    """`invariants`, and the same history when the balloons are written in reverse order."""
    return _reversed(history, history.stretch, -1, bound)


def mirrored(history: History, bound: float = 1e-8) -> Finding:
    """The same for equal balloons, of which the first one written leaves a branch point."""
    return _reversed(history, history.stretch, 1, bound)


def _reversed(history: History, stretch: FloatArray, order: int, bound: float) -> Finding:
    found = invariants(history, bound)
    written = history.scenario.to_dict()
    other = run(load_scenario({**written, "balloon": written["balloon"][::-1]}))
    if [e.kind for e in other.events] != [e.kind for e in history.events] or len(other) != len(history):
        return Finding(math.inf, bound, found.against, "other events when the balloons are reversed")
    errors = [
        relative(other.stretch[:, ::order], stretch),
        relative(other.pressure, history.pressure),
        *(relative(e.voltage[::order], f.voltage) for e, f in zip(other.events, history.events, strict=True)),
    ]
    against = f"{found.against}, reversed"
    return Finding(max(found.error, *errors), bound, against)


def alike(history: History, members: Sequence[int], bound: float = 1e-8) -> Finding:
    """`permuted`, and equal balloons stay equal."""
    found = permuted(history, bound)
    spread = float(np.ptp(history.stretch[:, list(members)], axis=1).max())
    against = f"{found.against}, equal balloons alike"
    return Finding(max(found.error, spread), bound, against)


def _unbalanced(gas: Gas, history: History) -> float:
    """Energy imbalance over the work exchanged, but for the rounding of the walls' energies."""
    books = history.energy_balance
    rounding = 1e-14 * sum(b.radius**2 * b.thickness * b.modulus for b in gas.balloons)
    return max(abs(books.imbalance) - rounding, 0.0) / books.exchanged if books.exchanged else 0.0


def _by_balloon(history: History, voltage: FloatArray) -> FloatArray:
    """Voltages (n, n_balloons), 0 without electrodes."""
    out = np.zeros((len(voltage), len(history.balloons)))
    out[:, [history.balloons.index(name) for name in history.electroded]] = voltage
    return out


def _landing(gas: Gas, history: History, event: Event) -> float:
    """How far a snap landed from where SciPy's flow rests."""
    assert event.stretch_after is not None
    voltage = _by_balloon(history, event.voltage[None])[0]
    rising = _rises(history, event)
    beyond = voltage * (1.0 + (_BEYOND if rising else -_BEYOND))
    rest = gas.flow(event.stretch_before, voltage, beyond)
    return relative(rest, event.stretch_after)


def _rises(history: History, event: Event) -> bool:
    """Whether the voltages rose when an event happened."""
    place = int(np.searchsorted(history.time, event.time))
    size = np.abs(history.voltage).sum(axis=1)
    return bool(size[place] > size[place - 1])
