"""What a summary says of a likely mistake: one sentence each, with the key it is about."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from simulator import units
from simulator.events import Outcome
from simulator.scenario import Inflate
from simulator.scenario.elastomer import Ogden, Tabulated

if TYPE_CHECKING:
    from simulator.results.history import FloatArray, History
    from simulator.scenario import Scenario

STRONGEST = 1e9  # V/m: more than any elastomer film has withstood
_OF_A_MATERIAL = 2  # turns of the inflation curve of a balloon: it falls, and stiffens again
_LOOKS = 32  # at a measured curve between two rows


def hint_lines(history: History) -> Iterator[str]:
    """Hints at what was probably not meant."""
    yield from _never_inflated(history)
    yield from _strong_fields(history)
    yield from elastomer_hints(history.scenario)


def _never_inflated(history: History) -> Iterator[str]:
    if history.outcome is not Outcome.LOSS_OF_TENSION:
        return
    last = int(history.step[-1])
    played = zip(range(1, last + 1), history.scenario.played_steps(), strict=False)
    if not any(isinstance(step, Inflate) for _, step in played):
        yield (
            f"no step up to step {last} inflates the balloons, so no film is under tension: "
            "should a step with inflate come first?"
        )


def _strong_fields(history: History) -> Iterator[str]:
    scales = history.scenario.scales
    if scales is None or not len(history):
        return
    for name, field in zip(history.electroded, history.extremes.largest_field, strict=True):
        if name not in history.rated and field * scales.field > STRONGEST:
            yield (
                f"the field of {name} reaches {units.said(units.FIELD, scales, float(field), 4)}, which no "
                f"known film withstands: balloon.{name}.breakdown names a strength"
            )


def elastomer_hints(scenario: Scenario) -> Iterator[str]:
    """Hints at elastomers that are probably not what was meant, by their keys."""
    keys: dict[Ogden | Tabulated, list[str]] = {}
    for balloon in scenario.balloons:
        if isinstance(balloon.elastomer, Ogden | Tabulated):
            keys.setdefault(balloon.elastomer, []).append(f"balloon.{balloon.name}.elastomer")
    for law, where in keys.items():
        found = _negative_terms(law) if isinstance(law, Ogden) else _doubtful_turns(law)
        yield from (f"{', '.join(where)}: {what}" for what in found)


def _negative_terms(law: Ogden) -> Iterator[str]:
    for number, (mu, alpha) in enumerate(zip(law.mu, law.alpha, strict=True), start=1):
        if mu * alpha < 0.0:
            yield (
                f"term {number} has mu alpha < 0 ({mu:g}, {alpha:g}) and softens the film; "
                "here a term is (mu/alpha) λ^alpha, elsewhere often (2 mu/alpha²) λ^alpha"
            )


def _doubtful_turns(law: Tabulated) -> Iterator[str]:
    """Limit points of a balloon of a measured elastomer that its rows do not show, or too many."""
    places, shown = inflation_turns(law), _shown(law)
    unseen = [place for place, interval in places if not {interval, interval + 1} & shown]
    if unseen:
        where = ", ".join(f"{place:.4g}" for place in unseen[:3]) + (", …" if len(unseen) > 3 else "")
        yield (
            "the curve through the rows has a limit point of inflation that no row shows, "
            f"at stretch {where}: should there be more rows, or fewer?"
        )
    if len(places) - len(unseen) > _OF_A_MATERIAL:
        yield (
            f"the pressure in a balloon turns {len(places)} times along the rows, that of an elastomer "
            f"at most {_OF_A_MATERIAL} times: should the rows be smoothed?"
        )


def inflation_turns(law: Tabulated) -> list[tuple[float, int]]:
    """Where the pressure of a balloon turns as it is inflated, f/λ² of the curve through the rows.

    Returns
    -------
    list of (float, int)
        Stretch, and the row, from 0, at which the interval begins that it lies in.
    """
    from scipy.optimize import brentq

    from simulator.model.elastomers.tabulated import Tabulated as Curve

    rows = law.stretches
    curve = Curve.through(rows, law.forces)

    def slope(stretch: FloatArray) -> FloatArray:
        """λ³ times that of f/λ²."""
        force, rise = curve.pole_form(stretch)[0], curve.pole_form_slope(stretch)[0]
        return np.asarray(rise * stretch - 2.0 * force)

    parts = np.linspace(0.0, 1.0, _LOOKS, endpoint=False)
    looked = np.append((rows[:-1, None] + np.diff(rows)[:, None] * parts).ravel(), rows[-1])
    rises = slope(looked) > 0.0
    found = []
    for i in np.flatnonzero(rises[1:] != rises[:-1]):
        place = float(brentq(lambda x: float(slope(np.array([x]))[0]), looked[i], looked[i + 1]))
        found.append((place, int(i) // _LOOKS))
    return found


def _shown(law: Tabulated) -> set[int]:
    """The rows, from 0, at which the measured pressure is larger or smaller than on both sides."""
    rises = np.diff(law.forces / law.stretches**2) > 0.0
    return set((np.flatnonzero(rises[1:] != rises[:-1]) + 1).tolist())
