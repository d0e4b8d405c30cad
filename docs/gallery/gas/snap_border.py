"""
How does the snap move with the outside pressure?
=================================================

You could play the scenario for many outside pressures. It is quicker to follow the limit point itself.
"""

import matplotlib.pyplot as plt

from simulator import fold

figure, axes = plt.subplots(figsize=(7, 4.5), layout="constrained")
for state in ("a", "b"):
    for outside in (0.0, 3.0):
        border = fold(f"../../../scenarios/fig3c_state_{state}.toml", "gas.ambient_pressure", outside)
        axes.plot(border.value, border.voltage, color={"a": "C0", "b": "C1"}[state])
axes.text(0.4, 0.575, "inflated to 0.6", color="C0")
axes.text(0.4, 0.395, "inflated to 1.2", color="C1")
axes.set(xlabel="outside pressure", ylabel="voltage of the limit point")
plt.show()

# %%
# Each point of a line is a limit point, to rounding. No history was played for it. A line ends where the
# excess pressure at the limit point is zero. Beyond that end the film goes slack before the balloon snaps.
