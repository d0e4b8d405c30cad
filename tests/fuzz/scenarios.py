"""Random scenarios of a sealed pair, a fifth of them with turns a hair beside its limit points."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from hypothesis import strategies as st

from simulator import load_scenario
from tests.oracle.closed_form import SealedPair, equilibrium_curve

LEAST_PRESSURE = 1e-4
LEAST_VOLTAGE = 1e-10  # of the pair's unit


@dataclass(frozen=True)
class Dice:
    """Where random numbers come from: a NumPy generator, or Hypothesis."""

    number: Callable[[float, float], float]
    whole: Callable[[int, int], int]


def numpy_dice(seed: int) -> Dice:
    rng = np.random.default_rng(seed)
    return Dice(lambda a, b: float(rng.uniform(a, b)), lambda a, b: int(rng.integers(a, b + 1)))


def scenario(dice: Dice) -> dict[str, Any]:
    """A random pair, inflated, sealed, and led through one to six voltage ramps and jumps."""

    def ratio(low: float, high: float) -> float:
        return float(np.exp(dice.number(np.log(low), np.log(high))))

    def balloon(name: str, **more: Any) -> dict[str, Any]:
        ratios = {key: ratio(0.3, 3.0) for key in ("thickness", "modulus", "permittivity")}
        return {
            "name": name,
            **more,
            **ratios,
            "elastomer": {"model": "gent", "J_lim": dice.number(20.0, 500.0)},
        }

    active = balloon("active", radius=ratio(0.1, 5.0), electrodes=True)
    passive = balloon("passive")
    if dice.whole(0, 1):  # as in the paper: two balloons of one film
        passive = {"name": "passive", "elastomer": active["elastomer"]}
        active = {key: active[key] for key in ("name", "radius", "electrodes", "elastomer")}

    def pressure() -> float:
        return dice.number(LEAST_PRESSURE, 3.0) if dice.whole(0, 20) else 0.0

    # Half of them at the load at which that balloon is about to snap open.
    last = pressure()
    if dice.whole(0, 1):
        load = active["radius"] / (active.get("thickness", 1.0) * active.get("modulus", 1.0))
        last = min(3.0, dice.number(0.2, 1.35) / load)
    pressures = [pressure() for _ in range(max(0, dice.whole(0, 6) - 4))] + [last]
    ambient = dice.number(0.0, 5.0) ** 3 / 25.0
    # The voltage that a film of this thickness and stiffness takes: limit points are at 0.1 to 0.7 of it.
    unit = active.get("thickness", 1.0) * np.sqrt(
        active.get("modulus", 1.0) / active.get("permittivity", 1.0)
    )
    legs = [float(unit * dice.number(-0.1, 1.0)) for _ in range(dice.whole(1, 6))]

    def step(leg: float) -> dict[str, Any]:
        return {"ramp": leg, "over": dice.number(0.1, 10.0)} if dice.whole(0, 5) else {"jump": leg}

    legs = [0.0 if dice.whole(0, 5) == 0 or abs(leg) < LEAST_VOLTAGE * unit else leg for leg in legs]
    written = {
        "title": "fuzz",
        "gas": {"ambient_pressure": ambient},
        "balloon": [active, passive] if dice.whole(0, 1) else [passive, active],
        "step": [{"inflate": p} for p in pressures] + [step(leg) for leg in legs],
        "output": {"points": dice.whole(2, 40)},
    }
    if dice.whole(0, 4) == 0:
        _turn_near_events(written, dice)
    return written


def _turn_near_events(written: dict[str, Any], dice: Dice) -> None:
    """Turn some ramps round, and end some jumps, a hair beside a limit point or where p = 0.

    A jump that just fails to land on a limit point creeps past it, at speeds that are the rounding of forces
    below 1e-12; so jumps keep 1e-9 away, ramps 1e-14.
    """
    pair = SealedPair.from_scenario(load_scenario(written))
    if not pair.sealed.pressure > 0.0:
        return
    curve = equilibrium_curve(pair)
    points = [*curve.limit_points, *([curve.loss_of_tension] if curve.loss_of_tension else [])]
    for step in written["step"]:
        if "inflate" not in step and points and dice.whole(0, 1):
            kind, nearest = ("jump", -9.0) if "jump" in step else ("ramp", -14.0)
            offset = 10.0 ** dice.number(nearest, -3.0) * (1 if dice.whole(0, 1) else -1)
            step[kind] = float(points[dice.whole(0, len(points) - 1)].voltage + offset)


@st.composite
def scenarios(draw: st.DrawFn) -> dict[str, Any]:
    """The same as a Hypothesis strategy, which likes the ends of the ranges, and shrinks."""
    return scenario(Dice(lambda a, b: draw(st.floats(a, b)), lambda a, b: draw(st.integers(a, b))))
