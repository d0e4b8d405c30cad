"""The sealed pair's closed form: all equilibria of one active and one passive balloon on one amount of gas.

The reference that errors are measured against; it shares nothing with the simulator but the elastomers.

Given λ₂, everything else is explicit:

    p = k₂h₂f₂(λ₂)/(r₂λ₂²),    r₁³λ₁³ = 3n/(p + pₑ) − r₂³λ₂³,    φ² = (k₁f₁(λ₁) − (r₁/h₁)pλ₁²) h₁²/(2e₁λ₁³),

so all equilibria, stable or not, on whatever disconnected branch, lie on one curve over λ₂ ∈ [1, λ_lim). It
ends where tension is lost (λ₂ = 1, p = 0) and where the active balloon comes to its stretch limit (φ → ∞).

Computed that way, λ₁ loses digits where λ₂ hardly changes (a large passive balloon is a supply of constant
pressure). So λ₂ serves to find the curve and to order it, while a point of it is a triple (λ₁, λ₂, p) that
solves the two equations

    passive balance  N₂ − D₂ a₂pλ₂² = 0,    gas  (p − p₀)V + (p₀ + pₑ)(V − V₀) = 0

to rounding. f = N/D has no pole, and the gas law, as the difference from the state of sealing (subscript 0),
keeps its digits at any ambient pressure. (Where V has grown far beyond V₀, (p + pₑ)V − n does better.) φ² is
explicit in such a point, and its slope along the curve is, up to a positive factor, the determinant of the
Hessian H of Π: limit points are its roots. Once all of them are known, φ² is monotone between each two, so
every equilibrium at a given voltage is bracketed.

Accuracy, measured against 40-digit arithmetic over the range of `tests/fuzz` (`tests/test_exact.py`):
limit points are good to 3e-15 in the states and 1e-14 in the voltage (1e-13 next to a stretch limit, where
1/D amplifies rounding); other states to 1e-14, and next to a limit point to that over the slope dφ/dλ. Where
a snap loses its tension is good to about 1e-9.
"""

from __future__ import annotations

from tests.oracle.closed_form.balloons import (
    Balloon,
    Extremum,
    InflationSnap,
    balloon_pressure,
    inflated_stretch,
    inflation_extrema,
    inflation_history,
    stretches_at,
)
from tests.oracle.closed_form.curve import Curve, Equilibrium, equilibria, equilibrium_curve
from tests.oracle.closed_form.flow import Flow, overdamped_flow
from tests.oracle.closed_form.history import (
    EventKind,
    Jump,
    Margin,
    ReferenceEvent,
    ReferenceHistory,
    reference_history,
)
from tests.oracle.closed_form.pair import SealedPair, State
from tests.oracle.closed_form.segments import End, Point, Segment, states_on

__all__ = [
    "Balloon",
    "Curve",
    "End",
    "Equilibrium",
    "EventKind",
    "Extremum",
    "Flow",
    "InflationSnap",
    "Jump",
    "Margin",
    "Point",
    "ReferenceEvent",
    "ReferenceHistory",
    "SealedPair",
    "Segment",
    "State",
    "balloon_pressure",
    "equilibria",
    "equilibrium_curve",
    "inflated_stretch",
    "inflation_extrema",
    "inflation_history",
    "overdamped_flow",
    "reference_history",
    "states_on",
    "stretches_at",
]
