"""
Which number should I measure best?
===================================

Measure the number best to which the result is most sensitive. This picture shows by how many percent the
voltage of the snap changes if a number of the device is one percent larger. The sensitivities are derivatives
of the equations, not differences of two runs.
"""

import matplotlib.pyplot as plt

from simulator import sensitivities, simulate

history = simulate("../../../scenarios/vhb_snap.toml")
snap = next(event for event in history.events if event.kind == "limit_point")
keys = [
    "balloon.active.thickness",
    "balloon.active.modulus",
    "balloon.active.radius",
    "balloon.active.permittivity",
    "balloon.active.elastomer.J_lim",
    "balloon.passive.radius",
    "step.1.inflate",
    "gas.ambient_pressure",
]
found = sensitivities(history, snap, keys)
percent = [one.derivative * one.parameter / one.value for one in found]

figure, axes = plt.subplots(figsize=(7, 4.5), layout="constrained")
axes.barh([one.key for one in found], percent)
axes.axvline(0, color="k", lw=0.8)
axes.invert_yaxis()
axes.set(xlabel="percent of the snap voltage, for one percent of the number")
plt.show()
