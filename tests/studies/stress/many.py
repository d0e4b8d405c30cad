"""More balloons than two, very unlike or exactly alike: stiff flows and symmetry."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from scipy import optimize

from simulator.model.elastomers import Gent, Number
from simulator.scenario import load_scenario
from tests.pairs import run
from tests.studies.stress.case import Case, Finding
from tests.studies.stress.closed_form import closed_form, closed_form_thick, relative
from tests.studies.stress.devices import Written, device, pair, ramps
from tests.studies.stress.invariants import alike, invariants, mirrored, permuted

if TYPE_CHECKING:
    from collections.abc import Sequence

    from simulator.results.history import History


def cases() -> list[Case]:
    """Sizes, stiffnesses, symmetry, and twelve on one gas."""
    return [*_sizes(), *_stiffness(), *_twins(), *_dozens()]


def _sizes() -> list[Case]:
    return [
        Case(
            "radius ratio 1e-3",
            "a large passive balloon: its stretch changes by 1e-9 of what the active one's does",
            pair(1.2, *ramps(0.8, 0.0), ambient=0.05, active={"radius": 1e-3}),
            closed_form,
        ),
        Case(
            "radius ratio 1e3",
            "a passive balloon that is nothing",
            pair(1.2e-3, *ramps(0.4, 0.0), ambient=1.5e-5, active={"radius": 1e3}),
            closed_form,
        ),
    ]


def _stiffness() -> list[Case]:
    found = []
    for ratio in (1e3, 1e6, 1e9, 1e12):
        found.append(
            Case(
                f"modulus ratio {ratio:.0e}",
                "snaps out and back beside a wall that moves so much faster: a stiff flow",
                pair(1.2, *ramps(0.5, 0.0), ambient=0.0, passive={"modulus": ratio, "radius": 2.0}),
                closed_form_thick,
            )
        )
    found += [
        Case(
            "thickness ratio 1e12",
            "energies of very different size; the passive stretch has four digits",
            pair(1.2, *ramps(0.5, 0.0), ambient=0.0, passive={"thickness": 1e12, "radius": 2.0}),
            closed_form,
        ),
        Case(
            "moduli 1e-6, 1 and 1e6",
            "three rates of flow on one gas; pressures and voltages of 1e-6 and 1e-3",
            device(
                [
                    {"name": "soft", "electrodes": True, "modulus": 1e-6},
                    {"name": "middle"},
                    {"name": "stiff", "modulus": 1e6},
                ],
                [{"inflate": 1.2e-6}, *ramps(0.4e-3, 0.0)],
                1.5e-8,
            ),
            invariants,
        ),
    ]
    return found


def _actuators(radii: Sequence[float]) -> list[Written]:
    return [{"name": f"b{i}", "radius": r, "electrodes": True} for i, r in enumerate(radii, start=1)]


def _twins() -> list[Case]:
    steps = [{"inflate": 0.6}, *ramps(0.7)]
    return [
        Case(
            "two equal actuators",
            "a branch point: both modes of leaving it are equally good",
            device(_actuators([1.0, 1.0]), steps, 0.05),
            _parts,
            "loss_of_tension",
        ),
        Case(
            "two actuators, radii 1e-9 apart",
            "the branch point breaks up into a fold 5e-8 before it",
            device(_actuators([1.0, 1.0 + 1e-9]), steps, 0.05),
            _koiter,
            "loss_of_tension",
        ),
    ]


def _symmetric_branch_point(pressure: float, ambient: float) -> tuple[float, float, float]:
    """Stretch, pressure and voltage at which equal actuators part, in closed form up to one root."""
    gent = Gent(100.0)

    def force(x: Number) -> Number:
        n, d = gent.pole_form(x)
        return n / d

    inflated = float(optimize.brentq(lambda x: force(x) - pressure * x * x, 1.0, 1.39, xtol=1e-15))
    amount = (pressure + ambient) * inflated**3

    def state(x: float) -> tuple[float, float]:
        p = amount / x**3 - ambient
        return p, (force(x) - p * x * x) / (2.0 * x**3)

    def stiffness(x: float) -> float:
        # Of the modes that leave the volume alone.
        p, square = state(x)
        slope = complex(force(x + 1e-40j)).imag / 1e-40
        return slope - 2.0 * p * x - 6.0 * square * x * x

    grid = np.linspace(inflated * 1.001, 3.0, 2000)
    values = [stiffness(x) for x in grid]
    place = int(np.argmax(np.array(values) < 0.0))
    x = float(optimize.brentq(stiffness, grid[place - 1], grid[place], xtol=1e-15))
    p, square = state(x)
    return x, p, float(np.sqrt(square))


def _parts(history: History, pressure: float = 0.6, ambient: float = 0.05) -> Finding:
    """The branch point of equal actuators, and the same history whichever of them is written first."""
    x, p, voltage = _symmetric_branch_point(pressure, ambient)
    event = next(e for e in history.events if e.kind == "branch_point")
    error = relative(
        [*event.stretch_before, event.pressure_before, event.voltage[0]],
        [*[x] * len(history.balloons), p, voltage],
    )
    found = mirrored(history)
    return replace(
        found, error=max(found.error, error), against=f"{found.against}, symmetric state in closed form"
    )


def _koiter(history: History) -> Finding:
    """The limit point lies below the branch point by a distance that goes as the imperfection to the 2/3."""
    voltage = _symmetric_branch_point(0.6, 0.05)[2]
    written = history.scenario.to_dict()
    larger = run(load_scenario({**written, "balloon": _with_electrodes(written, 1.0 + 8e-9)}))
    gaps = [voltage - h.events[0].voltage[0] for h in (history, larger)]
    if gaps[0] <= 0.0 or history.events[0].kind != "limit_point":
        return Finding(np.inf, 0.0, "Koiter's law", "no limit point before the branch point")
    found = permuted(history)
    if found.error > found.bound:
        return found
    return Finding(
        abs(gaps[1] / gaps[0] / 4.0 - 1.0), 0.05, f"Koiter's 2/3-power law ({found.against} within 1e-8)"
    )


def _with_electrodes(written: Written, radius: float) -> list[Written]:
    first, second = written["balloon"]
    return [first, {**second, "radius": radius}]


def _dozens() -> list[Case]:
    """Twelve wells on one gas, as in the micro-bioreactor array that the paper names (its ref. 21)."""
    spread = np.geomspace(0.6, 1.8, 12).tolist()
    unlike = _actuators(spread)
    one = [{**b, "electrodes": i == 0} for i, b in enumerate(unlike)]
    equal = [{**b, "radius": 1.0} for b in one]
    steps = [{"inflate": 0.6}, *ramps(0.7, 0.0)]
    return [
        Case(
            "12 balloons, one driven",
            "radii from 0.6 to 1.8; 12 stretches, each with its own rate",
            device(one, steps, 0.05),
            permuted,
        ),
        Case(
            "12 actuators",
            "radii from 0.6 to 1.8; the limit points of the largest are near each other",
            device(unlike, steps, 0.05),
            permuted,
            "loss_of_tension",
        ),
        Case(
            "12 equal balloons, one driven",
            "eleven eigenvalues are one",
            device(equal, [{"inflate": 1.2}, *ramps(0.3, 0.0)], 0.1),
            partial(alike, members=range(1, 12)),
        ),
        Case(
            "12 equal actuators",
            "a branch point at which eleven eigenvalues vanish together",
            device(_actuators([1.0] * 12), steps, 0.05),
            _parts,
            "loss_of_tension",
        ),
    ]
