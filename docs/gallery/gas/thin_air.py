"""
Does thin air help?
===================

The gas is sealed. Under a high outside pressure it is hard to compress or expand, so one balloon can only
grow if the other shrinks. In thin air the gas expands easily, and the balloon grows more.
"""

import matplotlib.pyplot as plt

from simulator import load_scenario, plot_histories, simulate

scenario = load_scenario("../../../scenarios/fig3c_state_b.toml").with_values({"step.2.ramp": 0.45})
outside = (0.2, 0.05, 0.015)
histories = [simulate(scenario.with_values({"gas.ambient_pressure": p})) for p in outside]

figure, axes = plt.subplots(figsize=(7, 4.5), layout="constrained")
plot_histories(histories, labels=[f"outside pressure {p}" for p in outside], ax=axes)
plt.show()

# %%
# All three snap. Only in the thinnest air does the balloon come to rest: the other two lose their tension
# on the way.
for p, history in zip(outside, histories, strict=True):
    print(p, history.outcome.value)
