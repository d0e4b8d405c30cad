"""
What does one cycle cost?
=========================

If you plot the charge over the voltage, the area of the loop is the work of the source. All of it is lost in
the two snaps.
"""

import matplotlib.pyplot as plt

from simulator import loops, simulate

history = simulate("../../../scenarios/fig3c_state_b.toml")
(loop,) = loops(history)

figure, axes = plt.subplots(figsize=(7, 4.5), layout="constrained")
axes.plot(history.voltage[:, 0], history.charge[:, 0])
axes.fill(history.voltage[:, 0], history.charge[:, 0], alpha=0.2)
axes.set(xlabel="voltage Φ√(ε/μ)/H", ylabel="charge Q/(4πR²√(εμ))", title=f"loop work {loop.area:.4f}")
plt.show()

# %%
# The area is an integral along the loop. The losses are differences of energy across the snaps. Both agree.
print(f"area {loop.area:.9f}, lost in snaps {loop.dissipated:.9f}")
