"""
Why does it snap there?
=======================

A history shows what happens, and the path of all equilibria shows why. The path turns round at a
largest or smallest voltage. Beyond that voltage there is no equilibrium close by, and the balloon must snap.
"""

import matplotlib.pyplot as plt

from simulator import simulate, trace

scenario = "../../../scenarios/fig3c_state_b.toml"
figure, axes = plt.subplots(figsize=(7, 4.5), layout="constrained")
path, history = trace(scenario), simulate(scenario)
path.plot(ax=axes)
axes.plot(history.voltage[:, 0], history.stretch[:, 0], color="orange", lw=5, alpha=0.5, zorder=0)
plt.show()

# %%
# The blue path has two turns, at the voltages 0.360 and 0.270. The orange history snaps up at the first and
# down at the second. It leaves out the unstable states in between.
for point in path.points:
    print(f"{point.kind:20} voltage {point.voltage[0]:.4f}  stretch {point.stretch[0]:.3f}")
