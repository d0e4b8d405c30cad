"""
Which film is this?
===================

We have measured an inflation curve, a voltage ramp through a snap, and the voltage of the snap. The fit finds
the numbers of the film, and how well the data determine them.
"""

import matplotlib.pyplot as plt

from simulator import fit

found = fit("../../../scenarios/fits/vhb_snap.toml")
for one in found.estimates:
    print(f"{one.key:28} {one.value:8.4g} ± {one.standard_error:.2g} {one.unit}")

# %%
# This is the ramp, with the fitted model before and after the snap. The model is not interpolated across it.

ramp = next(column for column in found.columns if column.label == "vhb_ramp.csv")
figure, (axes, below) = plt.subplots(2, 1, sharex=True, height_ratios=(3, 1), layout="constrained")
for x, y, half in ramp.curve:
    axes.fill_between(x, y - half, y + half, color="C0", alpha=0.3)
    axes.plot(x, y, color="C0")
axes.plot(ramp.x, ramp.data, "k.")
axes.set_ylabel("stretch")
below.plot(ramp.x, ramp.residual / ramp.sigma, "k.")
below.axhline(0.0, color="C0")
below.set(xlabel="voltage [kV]", ylabel="residual / σ")
plt.show()
