"""
How many states can one voltage write?
======================================

Five unequal balloons with electrodes share one gas. One voltage, the same on all of them, goes up and down.
In the picture each arrow is a snap from one state to another.
"""

import matplotlib.pyplot as plt

from simulator import states

graph = states("../../../scenarios/five_states.toml")
figure, axes = plt.subplots(figsize=(7, 5), layout="constrained")
graph.plot(ax=axes)
plt.show()

# %%
# There are eleven states. A voltage that goes up to 0.6 and back to zero leads through the following ones.
# It does not lead back to state 0.
print([step.target for step in graph.visits([0.6, 0.0])])
