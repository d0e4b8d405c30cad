"""High voltages, odd ambient pressures; turns, jumps and failures exactly at an event."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import optimize

from simulator.analysis.trace import trace
from simulator.scenario import load_scenario
from tests.oracle.closed_form import SealedPair, equilibrium_curve, reference_history
from tests.studies.stress.case import Case, Finding
from tests.studies.stress.closed_form import AGAINST, closed_form, closed_form_beside, limit_point, relative
from tests.studies.stress.devices import Written, pair, ramps

if TYPE_CHECKING:
    from simulator.results.curve import Curve
    from simulator.results.history import History


def cases() -> list[Case]:
    """Loads first, then turns and jumps, then what coincides."""
    return [*_loads(), *_turns(), *_jumps(), *_coincidences()]


def _loads() -> list[Case]:
    found = [
        Case(
            "φ up to 1e4",
            "the stretch comes within 1e-9 of its limit, where the force has a pole",
            pair(1.3, *ramps(1e4, 0.0)),
            closed_form,
        )
    ]
    for ambient, hard in (
        (0.0, "vacuum: the gas alone carries the walls"),
        (1e-12, "nearly so"),
        (1e6, "a gas that hardly gives: the pressure is a small difference"),
    ):
        found.append(
            Case(f"pₑ = {ambient:g}", hard, pair(1.2, *ramps(0.4, 0.0), ambient=ambient), closed_form)
        )
    return found


def _snapping(*steps: Written, **more: Any) -> Written:
    """Fig. 3c, state B, which snaps out at 0.360 and back at 0.270."""
    return pair(1.2, *steps, ambient=0.015, **more)


def _fold(number: int = 0) -> float:
    return limit_point(load_scenario(_snapping(*ramps(0.1))), number)


def _turns() -> list[Case]:
    fold = _fold()
    found = [
        Case(
            "turn at a limit point",
            "whether it snaps is the last digit of a voltage",
            _snapping(*ramps(fold, 0.0)),
            partial(closed_form_beside, leg=0, voltages=(fold, fold + 1e-12)),
        )
    ]
    for offset, name in ((-1e-12, "1e-12 before"), (1e-12, "1e-12 beyond")):
        found.append(
            Case(
                f"turn {name} a limit point",
                "it must not snap" if offset < 0.0 else "it must snap",
                _snapping(*ramps(fold + offset, 0.0)),
                closed_form,
            )
        )
    found.append(
        Case(
            "ramps to the present voltage",
            "nothing moves, at rest, beside a limit point and at the loaded state",
            _snapping(*ramps(0.0, 0.2, 0.2, fold - 1e-12, fold - 1e-12, 0.4, 0.4, 0.0, 0.0)),
            closed_form,
        )
    )
    return found


def _jumps() -> list[Case]:
    fold, back = _fold(), _fold(1)
    return [
        Case(
            "jump onto a limit point",
            "the flow creeps up to a rest that is stable from one side only",
            _snapping({"jump": fold}, {"hold": 1.0}),
            partial(_rests_at_limit_point, fold=fold),
        ),
        Case(
            "jumps 1e-6 beyond a limit point",
            "the flow passes the ghost of a rest, a thousand times slower",
            _snapping({"jump": fold + 1e-6}, {"jump": back - 1e-6}, {"jump": 0.0}),
            closed_form,
        ),
        Case(
            "jumps across limit points",
            "start far from any rest; the side on which it lands depends on the flow",
            _snapping({"jump": 0.5}, {"jump": 0.26}, {"jump": 0.4}, {"jump": 2.0}, {"jump": 0.0}),
            closed_form,
            "loss_of_tension",
        ),
    ]


def _rests_at_limit_point(history: History, fold: float) -> Finding:
    state = equilibrium_curve(SealedPair.from_scenario(history.scenario)).limit_points[0].state
    error = relative([*history.stretch[-1], history.pressure[-1]], state)
    # A last digit of the voltage is 1e-8 in the state of a limit point.
    return Finding(error, 1e-7, f"the limit point of the {AGAINST}")


def _coincidences() -> list[Case]:
    ambient = coincidence()
    landing = reference_history(_pair_of(_snapping()), [0.4]).events[0]
    assert landing.after is not None
    field = landing.voltage * landing.after.active**2
    found = [
        Case(
            f"limit point at p = 0 (pₑ = {ambient:.8f})",
            "the path turns round in the very point where tension is lost",
            pair(1.2, *ramps(0.6), ambient=ambient),
            # Where both margins vanish the state moves like the root of the voltage.
            partial(_slack, ambient=ambient),
            "loss_of_tension",
        ),
        Case(
            "nearly touching limit points (Fig. 5b, A)",
            "a traced path turns round twice within 2e-4 in voltage, unstable",
            pair(1.2, *ramps(0.1), active={"radius": 0.5}, shape={"on_loss": "ignore"}),
            _limit_points,
            "loss_of_tension",
            trace,
        ),
        Case(
            "breakdown at the landing",
            "the film's strength is the field of the rest that a snap flows up to for ever",
            _snapping(*ramps(0.4), active={"breakdown": {"field": field}}),
            partial(_breaks_at, stretch=landing.after.active),
            "breakdown",
        ),
    ]
    for share, outcome in ((1.0 - 1e-6, "breakdown"), (1.0 + 1e-6, "breakdown")):
        found.append(
            Case(
                f"breakdown {abs(share - 1.0):.0e} {'before' if share < 1.0 else 'after'} the landing",
                "in the flow, nearly at rest" if share < 1.0 else "on the branch, just after the snap",
                _snapping(*ramps(0.4), active={"breakdown": {"field": field * share}}),
                partial(closed_form, bound=1e-6),
                outcome,
            )
        )
    return found


def _pair_of(written: Written) -> SealedPair:
    return SealedPair.from_scenario(load_scenario(written))


def coincidence() -> float:
    """The ambient pressure at which the first limit point of two equal balloons, P₀ = 1.2, has p = 0.

    Where p = 0 on their exact path, det H as a function of pₑ changes its sign.
    """

    def determinant(ambient: float) -> float:
        pair_there = _pair_of(pair(1.2, ambient=ambient))
        point = equilibrium_curve(pair_there).loss_of_tension
        if point is None:
            raise ArithmeticError(f"no loss of tension at the ambient pressure {ambient!r}")
        return float(np.linalg.det(pair_there.hessian(point.state, point.voltage)))

    return float(optimize.brentq(determinant, 0.2, 1.0, xtol=1e-15, rtol=4e-15))


def _slack(history: History, ambient: float) -> Finding:
    """Where p = 0 in closed form: λ₂ = 1, and λ₁ from the gas law."""
    point = equilibrium_curve(SealedPair.from_scenario(history.scenario)).loss_of_tension
    assert point is not None
    if not history.events:
        return Finding(math.inf, 1e-7, AGAINST, "no event")
    event = history.events[-1]
    errors = [
        relative(event.voltage[0], point.voltage),
        relative([*event.stretch_before, event.pressure_before], point.state) ** 2,
    ]
    return Finding(max(errors), 1e-12, f"{AGAINST}: voltage, and state squared")


def _limit_points(curve: Curve) -> Finding:
    """All limit points of a traced path."""
    exact = equilibrium_curve(_pair_of(pair(1.2, active={"radius": 0.5})))
    found = [point for point in curve.points if point.kind == "limit_point"]
    if len(found) != len(exact.limit_points):
        return Finding(
            math.inf, 1e-10, AGAINST, f"{len(found)} limit points, should be {len(exact.limit_points)}"
        )
    errors = [
        relative([*f.stretch, f.pressure, *f.voltage], [*e.state, e.voltage])
        for f, e in zip(found, exact.limit_points, strict=True)
    ]
    assert exact.loss_of_tension is not None
    errors.append(relative(curve.end.voltage, exact.loss_of_tension.voltage))
    return Finding(max(errors), 1e-8, AGAINST)


def _breaks_at(history: History, stretch: float) -> Finding:
    """A strength within rounding of the landing's field: it breaks in the flow or at rest, but there."""
    error = relative(history.events[-1].stretch_before[0], stretch)
    return Finding(error, 1e-6, f"the landing in {AGAINST}")
