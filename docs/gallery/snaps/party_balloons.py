"""
Why is a party balloon hard to start?
=====================================

While a balloon is inflated, its pressure rises, falls, and rises again. You must first get over the peak. Two
equal balloons on one tube cannot stay equal on the falling part: one grows and the other shrinks.
"""

import matplotlib.pyplot as plt

from simulator import trace_inflation

curve = trace_inflation("../../../scenarios/fig2_inflation.toml", to_stretch=6.9)
peak, valley = (point for point in curve.points if point.kind == "limit_point")

figure, axes = plt.subplots(figsize=(7, 4.5), layout="constrained")
axes.plot(curve.stretch[:, 0], curve.pressure)
for point, name in ((peak, "peak"), (valley, "valley")):
    axes.plot(point.stretch[0], point.pressure, "ko")
    axes.annotate(
        f"{name} {point.pressure:.3f}", (point.stretch[0], point.pressure), (5, 8), textcoords="offset points"
    )
axes.axvspan(peak.stretch[0], valley.stretch[0], alpha=0.15)
axes.set(xlabel="stretch λ", ylabel="pressure PR/(μH)", title="A Gent balloon, J_lim = 100")
plt.show()

# %%
# The peak is at a stretch of 1.397. If the pressure exceeds 1.254, the balloon snaps to a stretch of 6.2.
