"""
Can three balloons pump?
========================

Three balloons share one gas. Each is driven by the same sine, a third of a period after the one before. The
balloons snap in turn, so the gas goes round.
"""

import matplotlib.pyplot as plt

from simulator import simulate

history = simulate("../../../scenarios/ring.toml")
figure, (above, below) = plt.subplots(2, sharex=True, figsize=(7, 5), layout="constrained")
for number, name in enumerate(history.balloons):
    above.plot(history.time, history.voltage[:, number], label=name)
    below.plot(history.time, history.stretch[:, number])
above.set(ylabel="voltage")
below.set(xlabel="time", ylabel="stretch")
above.legend(loc="upper right", ncols=3)
plt.show()
