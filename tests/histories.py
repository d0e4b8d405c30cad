"""Histories made up for tests of what happens after a run: they look like physics and are none."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from simulator.results.cycles import Extremes
from simulator.results.history import EnergyBalance, Event, EventKind, History, Outcome, SolverStatistics


def scenario(title: str = "A made-up pair", **more: object) -> SimpleNamespace:
    """Just as much of a scenario as tables and pictures look at."""
    written = {"title": title, "gas": {"ambient_pressure": 0.015}, "steps": [{"ramp": 0.4, "over": 1.0}]}
    more = {"scales": None, "steps": (), "played_steps": tuple, **more}
    return SimpleNamespace(title=title, source=None, file=None, balloons=(), to_dict=lambda: written, **more)


def statistics() -> SolverStatistics:
    return SolverStatistics(
        ida_solves=3, ida_steps=120, residual_calls=300, jacobian_calls=40, branches=3, snaps=2, seconds=0.01
    )


def balance() -> EnergyBalance:
    return EnergyBalance(
        electrical_work=40.8, gas_work=0.0, stored=0.0, dissipated=40.8, imbalance=-4e-13, exchanged=81.6
    )


def _make(
    *,
    balloons: tuple[str, ...],
    electroded: tuple[str, ...],
    time: np.ndarray,
    step: np.ndarray,
    branch: np.ndarray,
    voltage: np.ndarray,
    stretch: np.ndarray,
    events: tuple[Event, ...],
    outcome: Outcome = Outcome.COMPLETED,
    title: str = "A made-up pair",
) -> History:
    n = time.size
    rates = np.sqrt(np.arange(1.0, n + 1))  # irrational: every digit counts
    marked = [balloons.index(name) for name in electroded]
    field = voltage * stretch[:, marked] ** 2
    return History(
        extremes=Extremes.of(stretch, field),
        scenario=scenario(title),  # type: ignore[arg-type]
        balloons=balloons,
        electroded=electroded,
        time=time,
        step=step.astype(np.int64),
        branch=branch.astype(np.int64),
        cycle=np.zeros(n, dtype=np.int64),
        voltage=voltage,
        stretch=stretch,
        pressure=1.3 / (1.0 + 0.2 * (stretch[:, 0] - 1.0) ** 2) if n else np.empty(0),
        volume=(stretch**3).sum(axis=1) / 3,
        gas=np.full(n, 1.47),
        field=field,
        charge=field * stretch[:, marked] ** 2,
        energy=-rates / 3,
        stability=1 / (3 * rates),
        events=events,
        outcome=outcome,
        energy_balance=balance(),
        statistics=statistics(),
    )


def cycled_pair(cycles: int = 1, samples: int = 50) -> History:
    """A pair whose active balloon snaps out at 0.36 and back at 0.27 in every cycle, and back to 0."""
    up, down, top = 0.36, 0.27, 0.4

    def low(phi: np.ndarray) -> np.ndarray:
        return 1.26 + 0.8 * (phi / up) ** 4

    def high(phi: np.ndarray) -> np.ndarray:
        return 4.9 + 1.9 * np.sqrt(np.maximum(phi - down, 0) / (top - down))

    # One cycle as (voltage, stretch, branch within the cycle, phase) with both sides of each snap.
    phi = np.concatenate(
        [
            np.linspace(0, up, samples),
            np.linspace(up, top, samples // 4),
            np.linspace(top, down, samples // 2)[1:],
            np.linspace(down, 0, samples),
        ]
    )
    within = np.repeat([0, 1, 2], [samples, samples // 4 + samples // 2 - 1, samples])
    lam = np.where(within == 1, high(phi), low(phi))
    phase = np.where(np.arange(phi.size) < samples + samples // 4, phi / top, 2 - phi / top)
    one = np.ones(phi.size)
    cycle = np.repeat(np.arange(cycles), phi.size)
    active = np.tile(lam, cycles)
    stretch = np.column_stack([active, 1.17 - 0.02 * (active - 1.26)])
    time = np.tile(phase, cycles) + 2.0 * cycle
    branch = np.tile(within, cycles) + 2 * cycle

    def snap(i: int, k: int) -> Event:
        return Event(
            time=float(time[i]),
            step=2 * k + 1,
            kind=EventKind.LIMIT_POINT,
            voltage=np.tile(phi, cycles)[i : i + 1],
            stretch_before=stretch[i],
            stretch_after=stretch[i + 1],
            pressure_before=0.48257219,
            pressure_after=0.00262142,
            field_before=np.array([0.1 + i / 3]),
            field_after=np.array([0.2 + i / 7]),
            dissipated=3.447524 / (1 + k),
        )

    at = np.flatnonzero(np.diff(branch))
    return _make(
        balloons=("active", "passive"),
        electroded=("active",),
        time=time,
        step=1 + 2 * cycle + np.tile(phase > 1, cycles) * one.repeat(1)[0].astype(int),
        branch=branch,
        voltage=np.tile(phi, cycles)[:, None],
        stretch=stretch,
        events=tuple(snap(int(i), int(cycle[i])) for i in at),
        title="Fig. 3c, state B: a loop between two branches",
    )


def slack_pair(outcome: Outcome = Outcome.LOSS_OF_TENSION) -> History:
    """A ramp that ends when the tension is lost: its last event has no after side."""
    time = np.linspace(0.0, 0.7, 36)
    phi = time / 1.1
    active = 1.07 + 0.36 * (phi / phi[-1]) ** 3
    stretch = np.column_stack([active, 2.1 - active])
    end = Event(
        time=0.7,
        step=1,
        kind=EventKind.LOSS_OF_TENSION,
        voltage=phi[-1:],
        stretch_before=stretch[-1],
        stretch_after=None,
        pressure_before=0.0,
        pressure_after=None,
        field_before=phi[-1:] * active[-1:] ** 2,
        field_after=None,
        dissipated=None,
    )
    return _make(
        balloons=("active", "passive"),
        electroded=("active",),
        time=time,
        step=np.ones(36),
        branch=np.zeros(36),
        voltage=phi[:, None],
        stretch=stretch,
        events=(end,) if outcome is Outcome.LOSS_OF_TENSION else (),
        outcome=outcome,
    )


def inflated_single() -> History:
    """One balloon without electrodes, blown past its snap: the loop is stretch over pressure."""
    time = np.concatenate([np.linspace(0, 0.9, 40), np.linspace(0.9, 1, 10)])
    stretch = np.concatenate([1 + 0.4 * np.linspace(0, 1, 40) ** 2, np.linspace(6.2, 6.26, 10)])[:, None]
    history = _make(
        balloons=("only",),
        electroded=(),
        time=time,
        step=np.ones(50),
        branch=np.repeat([0, 1], [40, 10]),
        voltage=np.empty((50, 0)),
        stretch=stretch,
        events=(
            Event(
                time=0.9,
                step=1,
                kind=EventKind.LIMIT_POINT,
                voltage=np.empty(0),
                stretch_before=stretch[39],
                stretch_after=stretch[40],
                pressure_before=1.2536545513,
                pressure_after=1.2536545513,
                field_before=np.empty(0),
                field_after=np.empty(0),
                dissipated=1.25,
            ),
        ),
        title="One balloon, blown past its snap",
    )
    history.pressure[:] = 1.4 * time
    return history


def empty_pair() -> History:
    """A run that failed before its first sample."""
    return _make(
        balloons=("active", "passive"),
        electroded=("active",),
        time=np.empty(0),
        step=np.empty(0),
        branch=np.empty(0),
        voltage=np.empty((0, 1)),
        stretch=np.empty((0, 2)),
        events=(),
        outcome=Outcome.FAILED,
    )
