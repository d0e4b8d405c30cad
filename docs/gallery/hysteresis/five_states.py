"""
How many states can one voltage write?
======================================

Five unequal balloons with electrodes, one gas, one voltage that goes up and down. Each arrow is a snap.
"""

import matplotlib.pyplot as plt

from simulator import states

graph = states("../../../scenarios/five_states.toml")
figure, axes = plt.subplots(figsize=(7, 5), layout="constrained")
graph.plot(ax=axes)
plt.show()

# %%
# Eleven. Up to 0.6 and back to zero leads through these, and not back to state 0:
print([step.target for step in graph.visits([0.6, 0.0])])
