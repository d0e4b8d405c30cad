"""
How far may the voltage go, if the balloon is to come back?
===========================================================

Go up to each of many voltages, and back to zero. What remains?
"""

import matplotlib.pyplot as plt

from simulator import unload

figure, axes = plt.subplots(figsize=(7, 4.5), layout="constrained")
for name, label in (("fig5b_state_b", "inflated to 2.4"), ("fig5c_state_a", "inflated to 1.2, in thin air")):
    found = unload(f"../../../scenarios/{name}.toml", "0.02:0.58:113")
    axes.plot(found.peaks, found.remanent_stretch[:, 0], ".-", label=label)
axes.set(xlabel="highest voltage", ylabel="stretch when it is off again")
axes.legend()
plt.show()

# %%
# The first device stays large once it has snapped, at 0.139. It does not matter how far you went beyond.
# The other one snaps at 0.496, and comes back all the same.
