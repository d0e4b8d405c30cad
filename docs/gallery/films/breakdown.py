"""
Does the film break before it lands?
====================================

At a given voltage the true field rises with the square of the stretch. So the film is in danger during the
snap, and not on the way to it. An acrylic film gets stronger when it is stretched, and a thinner film is
stronger, too.
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
