"""
How large must the reservoir be?
================================

A sealed balloon without a chamber can hardly grow, because no gas can flow into it. On a large chamber it
snaps. On a very large one it stays large after the voltage is switched off. Keplinger and others (2012) built
such a device.
"""

import matplotlib.pyplot as plt

from simulator import load_scenario, trace

scenario = load_scenario("../../../scenarios/keplinger_chamber.toml")
figure, axes = plt.subplots(figsize=(7, 4.5), layout="constrained")
for chamber in (0, 100, 300, 1000, 3000):
    path = trace(scenario.with_values({"gas.chamber": chamber}), to_voltage=0.2)
    stable = path.unstable == 0
    (line,) = axes.plot(path.voltage[:, 0], path.stretch[:, 0], ":")
    stretch = path.stretch[:, 0].copy()
    stretch[~stable] = float("nan")
    axes.plot(path.voltage[:, 0], stretch, color=line.get_color(), label=f"chamber {chamber}")
axes.set(xlabel="voltage Φ√(ε/μ)/H", ylabel="stretch", xlim=(0, 0.2))
axes.legend()
plt.show()

# %%
# Dotted lines are unstable states. In these units the unstretched balloon has the volume 1/3, so a chamber of
# 1000 has the volume of three thousand balloons.
