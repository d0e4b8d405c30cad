"""
How much will my snap voltages scatter?
=======================================

No two films have exactly the same thickness and modulus. We draw five hundred devices, with a scatter of two
percent in each number, and play the scenario for all of them.
"""

import matplotlib.pyplot as plt
import numpy as np

from simulator import load_scenario, simulate_many

scenario = load_scenario("../../../scenarios/vhb_snap.toml")
rng = np.random.default_rng(2026)


def two_percent(number):
    """Five hundred values around a number."""
    return number * (1 + 0.02 * rng.standard_normal(500))


runs = simulate_many(
    scenario,
    {
        "balloon.active.thickness": two_percent(1.0),
        "balloon.active.modulus": two_percent(1.0),
        "balloon.passive.thickness": two_percent(3.0),
    },
)
voltage = runs["limit_point_1_voltage_active"] * scenario.scales.voltage / 1000
snapped = voltage[np.isfinite(voltage)]

figure, axes = plt.subplots(figsize=(7, 4.5), layout="constrained")
axes.hist(snapped, bins=40)
axes.set(xlabel="voltage of the snap [kV]", ylabel="devices")
plt.show()

# %%
# Two percent become ten, because the balloon is inflated to just below the peak of its pressure.
print(f"{snapped.size} of 500 snap, at {snapped.mean():.2f} ± {snapped.std():.2f} kV")
