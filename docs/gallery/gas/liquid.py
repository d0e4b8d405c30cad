"""
Gas or liquid?
==============

What one balloon takes up the other has to give, if a liquid is sealed in. A gas under ever higher outside
pressure comes to the same.
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
