"""
Gas or liquid?
==============

If a liquid is sealed in, its volume is constant: one balloon can only take up what the other gives. A gas
behaves more and more like a liquid if the outside pressure is higher.
"""

import matplotlib.pyplot as plt

from simulator import load_scenario, trace

scenario = load_scenario("../../../scenarios/liquid_pair.toml")
figure, axes = plt.subplots(figsize=(7, 4.5), layout="constrained")
for outside in (0.1, 1, 10):
    path = trace(scenario.with_values({"gas.law": "isothermal", "gas.ambient_pressure": outside}))
    axes.plot(path.voltage[:, 0], path.stretch[:, 0], label=f"gas, outside pressure {outside}")
path = trace(scenario)
axes.plot(path.voltage[:, 0], path.stretch[:, 0], "k--", label="liquid")
axes.set(xlabel="voltage Φ√(ε/μ)/H", ylabel="stretch of the active balloon")
axes.legend()
plt.show()
