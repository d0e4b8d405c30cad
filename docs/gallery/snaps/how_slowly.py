"""
How slowly must the voltage rise?
=================================

In a quasi-static history the speed of the voltage does not matter. With ``[dynamics]`` it does: a balloon
needs time to move and snaps late. The more slowly the voltage rises, the smaller is the delay in voltage.
"""

import matplotlib.pyplot as plt

from simulator import load_scenario, simulate

scenario = load_scenario("../../../scenarios/fig3c_state_b.toml")
figure, axes = plt.subplots(figsize=(7, 4.5), layout="constrained")
for duration in (30, 100, 1000):
    slow = load_scenario({**scenario.to_dict(), "dynamics": {"relaxation_time": 1.0}})
    history = simulate(slow.with_values({"step.1.over": 100, "step.2.over": duration, "step.2.ramp": 0.45}))
    rising = history.step == 2
    axes.plot(
        history.voltage[rising, 0], history.stretch[rising, 0], label=f"0.45 in {duration} relaxation times"
    )
quick = simulate(scenario.with_values({"step.2.ramp": 0.45}))
rising = quick.step == 2
axes.plot(quick.voltage[rising, 0], quick.stretch[rising, 0], "k--", label="quasi-static")
axes.set(xlabel="voltage Φ√(ε/μ)/H", ylabel="stretch of the active balloon")
axes.legend()
plt.show()
