"""
How large must the reservoir be?
================================

A balloon alone can hardly move: its gas has nowhere to come from. On a large chamber it snaps, and on a
very large one it stays open when the voltage is gone. Keplinger and others (2012) built that.
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
# Dotted is unstable. The balloon itself holds 1/3 in these units, so a chamber of 1000 is three thousand
# balloons.
