"""
Is it still a sphere?
=====================

A real balloon turns into a pear where its tension no longer rises with its stretch. Every history and every
path has a column with the margin ``s``. Where it is negative, the balloon does not stay a sphere.
"""

import matplotlib.pyplot as plt

from simulator import trace_all

figure, axes = plt.subplots(figsize=(7, 4.5), layout="constrained")
for name, colour in (("fig3c_state_b", "C0"), ("fig5b_state_b", "C1")):
    for path in trace_all(f"../../../scenarios/{name}.toml"):
        axes.plot(path.stretch[:, 0], path.sphericity[:, 0], color=colour)
axes.plot([], [], "C0", label="equal balloons, thin air")
axes.plot([], [], "C1", label="a small one on a large one")
axes.axhline(0, color="k", lw=0.8)
axes.set(xlabel="stretch of the active balloon", ylabel="margin s", ylim=(-5, 40), xlim=(1, 7))
axes.legend()
plt.show()

# %%
# The small balloon on the large one is a sphere in all of its stable states. For the equal balloons the
# margin is negative between the stretches 1.58 and 5.04: there the active balloon would turn into a pear.
