"""
Can it pass the limit point without a snap?
===========================================

Yes, if you give the charge on the electrodes instead of the voltage. The capacitance grows with the stretch,
so the voltage falls by itself, and the balloon does not snap.
"""

import matplotlib.pyplot as plt

from simulator import simulate

by_voltage = simulate("../../../scenarios/fig3c_state_b.toml")
by_charge = simulate("../../../scenarios/charge_control.toml")

figure, axes = plt.subplots(figsize=(7, 4.5), layout="constrained")
for history, name in ((by_voltage, "voltage given"), (by_charge, "charge given")):
    rising = history.step == 2
    axes.plot(history.voltage[rising, 0], history.stretch[rising, 0], label=name)
axes.set(xlabel="voltage Φ√(ε/μ)/H", ylabel="stretch of the active balloon")
axes.legend()
plt.show()

# %%
# Both devices have the same equilibria. With a given charge, the balloon also goes through those that
# are unstable at a given voltage.
print("largest voltage:", by_voltage.voltage.max().round(4), "and", by_charge.voltage.max().round(4))
