"""
Does the film break before it lands?
====================================

The field rises with the square of the stretch, so the danger is in the snap and not on the way to it. An
acrylic film gets stronger as it is stretched, and a thinner one is stronger, too.
"""

import matplotlib.pyplot as plt

from simulator import load_scenario, simulate

scenario = load_scenario("../../../scenarios/breakdown_acrylic.toml")
figure, axes = plt.subplots(figsize=(7, 4.5), layout="constrained")
for strength, name in ((1.75, "film of 0.5 mm"), (2.2, "film of 0.2 mm")):
    history = simulate(scenario.with_values({"balloon.active.breakdown.field": strength}))
    shown = history.step > 1
    axes.plot(history.time[shown], history.margin[shown, 0], label=f"{name}: {history.outcome.value}")
axes.axhline(0, color="k", lw=0.8)
axes.set(xlabel="time", ylabel="margin to breakdown 1 − |E|/E_b")
axes.legend()
plt.show()
