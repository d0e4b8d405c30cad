"""
How sure is a snap?
===================

The modulus of a film is known to 3 %, its permittivity to 2 %. Two thousand runs, computed together, show
where the balloon snaps. There is one band for the runs that have snapped and one for those that have not.
"""

import matplotlib.pyplot as plt
import numpy as np

from simulator.sweep.bands import bands

found = bands(
    "../../../scenarios/vhb_snap.toml",
    {"balloon.active.modulus": 0.03, "balloon.active.permittivity": 0.02},
)
low, middle, high = (
    found.uncertainty.quantile("limit_point_1_voltage_active", q) for q in (0.025, 0.5, 0.975)
)
print(f"It snaps at {middle / 1e3:.2f} kV; 95 % of its like between {low / 1e3:.2f} and {high / 1e3:.2f} kV.")

figure, axes = plt.subplots(layout="constrained")
for snaps, colour in ((0, "C0"), (1, "C1")):
    rows = np.flatnonzero((found.step == 2) & (found.snaps == snaps))
    lower, median, upper = found.stretch[rows, 0].T
    axes.fill_between(found.voltage[rows, 0], lower, upper, color=colour, alpha=0.4)
    axes.plot(found.voltage[rows, 0], median, color=colour, label=f"{snaps} snaps so far")
axes.set(xlabel="voltage over H√(μ/ε)", ylabel="stretch of the active balloon")
axes.legend()
plt.show()
