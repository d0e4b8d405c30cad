"""
How far may the voltage go, if the balloon is to come back?
===========================================================

We raise the voltage to each of many peaks, lower it to zero again, and look at the stretch that remains.
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
# The first device snaps at 0.139 and then stays large, however far the voltage went beyond. The other device
# snaps at 0.496, and still comes back when the voltage is off.
