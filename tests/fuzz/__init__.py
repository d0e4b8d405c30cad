"""Random scenarios of a sealed pair, simulated and compared with `tests.oracle.closed_form`.

    make fuzz N=10000 SEED=2026        (or: python -m tests.fuzz 10000 --seed 2026)

plays N scenarios, the same for the same seed, prints how they ended and the worst errors, writes these counts
to `docs/fuzz.json` (if interrupted, up to there), and keeps each scenario on which the two disagree as a JSON
file; what is under its "scenario" goes into `load_scenario`. What "agree" means:

- The same outcome and the same sequence of events, in the same steps, inflation included.
- Event voltages (inflation: pressures) within 1e-9. The states before an event, and after it where they are
  at rest, within 1e-8.
- The state in which a snap loses its tension, or breaks, depends on the whole trajectory. Both flows are
  integrated with an error of about 1e-10 a step, the reference's ends good to a few 1e-9: within 1e-6.
- Every sample within 1e-8 of the exact state at its voltage, on the segment that the reference is on, where
  that is well conditioned. A state y(φ) is computed from forces g that are rounded, so it is the exact state
  at a voltage φ + δ with δ = −g/(∂g/∂φ): its backward error, a few 1e-16 of the forces' terms, up to 1e-14.
  In y that is |dy/dφ| δ, and next to a limit point φ* = φ + c |y − y*|², so |dy/dφ| = 1/(2 √(c (φ* − φ))) has
  no bound: at φ* − φ = 1e-14 no arithmetic of 16 digits gives y to better than 1e-9, at φ* itself than 1e-8.
  What is bounded is δ. How far the exact state moves under a change of the voltage by `SAME_VOLTAGE` (1e-13)
  is therefore taken off the distance; 1e-3 away from a limit point that is 1e-12, elsewhere it is nothing.
- Energy imbalance within 1e-8 of the work exchanged, but for the rounding of energies of order r²hk (a pair
  that hardly moves exchanges less than that); what each event dissipated within 1e-8.

A scenario can be undecidable: a ramp turns round at the very voltage of an event, or a snap only just keeps
its tension. `Margin` in `tests.oracle.closed_form` says how near each such decision was; below `UNDECIDED`
(1e-11 of the film's voltage, as margins of events are solved to 1e-12; the error of a flow) the two may go
different ways and both be right. Where it is a turn, the simulator must agree in everything with the
reference of a turn just before the event, or at it, or just beyond it. Where it is a flow, it is compared up
to there. Such scenarios are counted as undecided.

Pressures are 0 or at least `LEAST_PRESSURE`. At a lower one the stretch is 1 + p/12 and has few digits left:
what happens then is a matter of rounding (an inflation to 1e-16 cannot be told from none). Likewise voltages:
a jump by less than the rounding of the largest voltage so far is none.
"""

from __future__ import annotations

from tests.fuzz.comparison import Verdict, examine
from tests.fuzz.scenarios import Dice, numpy_dice, scenario, scenarios

__all__ = ["Dice", "Verdict", "examine", "numpy_dice", "scenario", "scenarios"]
