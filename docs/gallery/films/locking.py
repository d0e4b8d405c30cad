"""
How early must the rubber lock for nothing to snap?
===================================================

Rubber locks when its chains are fully stretched. We lower ``J_lim``, so that the rubber locks at smaller and
smaller stretches, and follow the peak and the valley of the inflation curve. They meet in a cusp. If the
rubber locks even earlier, the pressure only rises.
"""

import matplotlib.pyplot as plt

from simulator import fold

scenario = "../../../scenarios/fig2_inflation.toml"
figure, axes = plt.subplots(figsize=(7, 4.5), layout="constrained")
for number, name in ((1, "peak"), (2, "valley")):
    border = fold(scenario, "balloon.*.elastomer.J_lim", 1.0, inflation="first", point=number)
    axes.plot(border.value, border.pressure, label=name)
axes.plot(border.value[-1], border.pressure[-1], "ko", label=f"cusp at J_lim = {border.value[-1]:.2f}")
axes.set(xlabel="J_lim", ylabel="pressure of the limit point PR/(μH)")
axes.legend()
plt.show()

# %%
# Between the two lines there are three stretches for each pressure. Left of the cusp there is only one.
