"""
What does a real supply do to a snap?
=====================================

A snap multiplies the capacitance of the film. A source behind a resistance cannot deliver that much charge at
once, so its film loses voltage just when it grows.
"""

import matplotlib.pyplot as plt

from simulator import load_scenario, simulate

scenario = load_scenario("../../../scenarios/vhb_behind_resistance.toml")
history = simulate(scenario.with_values({"output.every": "0.02 s"}))
time = history["time [s]"]
figure, (above, below) = plt.subplots(2, figsize=(7, 5), sharex=True, layout="constrained")
above.plot(time, history["supply_active [V]"] / 1e3, "--", color="0.5", label="of the supply")
above.plot(time, history["voltage_active [V]"] / 1e3, label="of the film")
below.plot(time, history["stretch_active"])
above.set(ylabel="voltage [kV]", xlim=(30, 45))
below.set(xlabel="time [s]", ylabel="stretch of the active balloon")
above.legend()
plt.show()

# %%
# The film sags from 4.4 to 2.8 kV and recovers as the source follows. The balloon still lands where it would
# on an ideal source, only later: rests do not depend on the supply, unless the film leaks.
