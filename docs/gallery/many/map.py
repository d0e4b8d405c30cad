"""
Which inflation, in which air?
==============================

We vary the inflation and the outside pressure, with forty values of each. The sixteen hundred histories are
computed together, in a second or two.
"""

import matplotlib.pyplot as plt
import numpy as np

from simulator import simulate_many

outside, inflation = np.meshgrid(np.geomspace(0.01, 1, 40), np.linspace(0.3, 2.6, 40))
runs = simulate_many(
    "../../../scenarios/fig5b_state_b.toml",
    {"gas.ambient_pressure": outside.ravel(), "step.1.inflate": inflation.ravel(), "step.2.ramp": 0.6},
)
kinds, codes = np.unique(runs["behaviour"].astype(str), return_inverse=True)

figure, axes = plt.subplots(figsize=(7, 4.5), layout="constrained")
colours = plt.get_cmap("Set2", len(kinds))
image = axes.pcolormesh(
    outside, inflation, codes.reshape(outside.shape), cmap=colours, vmin=-0.5, vmax=len(kinds) - 0.5
)
bar = figure.colorbar(image, ticks=range(len(kinds)))
bar.ax.set_yticklabels(kinds)
axes.set(xscale="log", xlabel="outside pressure", ylabel="inflation")
plt.show()
