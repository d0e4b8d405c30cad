"""Inflation about to snap, or just no longer; the valve closed at the snap itself, or at no pressure."""

from __future__ import annotations

from functools import partial

from tests.studies.stress.case import Case
from tests.studies.stress.closed_form import closed_form
from tests.studies.stress.devices import SNAP_PRESSURE, pair, ramps


def cases() -> list[Case]:
    """Inflated and deflated, sealed, driven."""
    there_and_back = [1.5, 0.2, 0.9]
    found = [
        Case(
            f"J_lim {J_lim:.8g}",
            hard,
            pair(there_and_back, *ramps(0.5, 0.0), J_lim=J_lim),
            closed_form,
        )
        for J_lim, hard in (
            (17.6, "peak and valley of the inflation have just vanished: nearly vertical"),
            (17.64, "peak and valley 0.01 apart in stretch, 5e-7 in pressure"),
            (17.638081, "1e-6 beyond the cusp: peak and valley 2e-4 apart in stretch, 5e-12 in pressure"),
            (1.0, "locks at a stretch of 1.37"),
            (1e6, "locks at 707: the snap goes out to there"),
        )
    ]
    found += [
        Case(
            "P₀ = 0",
            "no pressure: tension is lost at once",
            pair(0.0, *ramps(0.1)),
            closed_form,
            "loss_of_tension",
        )
    ]
    for below, name in ((-1e-12, "1e-12 below the snap"), (1e-12, "1e-12 above the snap")):
        for radius in (1.0, 0.5):
            found.append(
                Case(
                    f"P₀ {name}, radius {radius:g}",
                    "sealed where the stiffness of both balloons (radius 0.5: of the passive one) is 1e-6",
                    pair(SNAP_PRESSURE + below, *ramps(0.2, 0.0), ambient=0.05, active={"radius": radius}),
                    closed_form,
                )
            )
    sealed_there = "sealed where the stiffness of {} is zero to the last digit"
    found += [
        Case(
            "P₀ at the snap, radius 0.5",
            sealed_there.format("the passive balloon"),
            pair(SNAP_PRESSURE, *ramps(0.2, 0.0), ambient=0.05, active={"radius": 0.5}),
            closed_form,
        ),
        Case(
            "P₀ at the snap, radius 1",
            sealed_there.format("both balloons") + ": only their gas holds them, a branch point at rest",
            pair(SNAP_PRESSURE, *ramps(0.2, 0.0), ambient=0.05),
            # At φ = 0 it is a threefold root, good to the cube root of rounding.
            partial(closed_form, bound=6e-6),
        ),
    ]
    return found
