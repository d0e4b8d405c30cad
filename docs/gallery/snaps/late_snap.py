"""
Can a snap come late?
=====================

Yes, because real films creep. We raise the voltage to a little more than the limit point of the relaxed film,
hold it there, and wait.
"""

import matplotlib.pyplot as plt

from simulator import load_scenario, simulate

scenario = load_scenario("../../../scenarios/delayed_snap.toml")
figure, axes = plt.subplots(figsize=(7, 4.5), layout="constrained")
for voltage in (0.365, 0.37, 0.375):
    history = simulate(scenario.with_values({"step.3.ramp": voltage, "output.points": 501}))
    held = (history.step == 3) | (history.step == 4)
    start = history.time[held][0]
    axes.plot(history.time[held] - start, history.stretch[held, 0], label=f"held at {voltage}")
axes.set(xlabel="time since the voltage went up", ylabel="stretch of the active balloon", xlim=(0, 100))
axes.legend()
plt.show()

# %%
# The closer the voltage is to the limit point, the longer the snap takes to come. The balloon moves slowly
# where the stable state has just disappeared.
