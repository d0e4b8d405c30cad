"""
How does a giant snap land safely?
==================================

The voltage that makes a balloon snap is higher than the voltage that it needs at its new stretch. So we
lower the voltage while the balloon snaps. This leaves a larger margin to breakdown.
"""

import matplotlib.pyplot as plt

from simulator import load_scenario, simulate

safe = load_scenario("../../../scenarios/safe_landing.toml")
held = safe.with_values({"step.2.ramp": 0.2, "step.3.hold": 3.0, "step.4.ramp": 0.2})
figure, axes = plt.subplots(3, 1, sharex=True, figsize=(7, 6), layout="constrained")
for scenario, label in ((held, "held"), (safe, "dropped")):
    history = simulate(scenario)
    for ax, name in zip(axes, ("voltage", "stretch", "margin"), strict=True):
        ax.plot(history.time, history[f"{name}_active"], label=label)
        ax.set_ylabel(name)
axes[0].legend()
axes[-1].set(xlim=(48, 90), xlabel="time")
plt.show()
