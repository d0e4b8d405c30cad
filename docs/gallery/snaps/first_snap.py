"""
At which voltage does it snap, and where does it go?
====================================================

A small balloon with electrodes shares its gas with a large one. Play a rising voltage, and look at the
events.
"""

import matplotlib.pyplot as plt

from simulator import simulate

history = simulate("../../../scenarios/fig5b_state_b.toml")
for event in history.events:
    print(
        event.kind.value, event.voltage.round(4), event.stretch_before.round(3), event.stretch_after.round(3)
    )

# %%
# The balloon snaps at 0.139. The dashed line is the snap. When the voltage is off, the balloon is still
# large.
figure, axes = plt.subplots(figsize=(7, 4.5), layout="constrained")
history.plot(ax=axes)
plt.show()
