"""
How much does the elastomer matter?
===================================

Here are the inflation curves of five elastomers with the same shear modulus. Up to a stretch of two they
hardly differ. At larger stretches the elastomer decides whether there is a second stable state at all.
"""

import matplotlib.pyplot as plt

from simulator import load_scenario, trace_inflation

ELASTOMERS = {
    "neo-Hookean": {"model": "neo-hookean"},
    "Mooney–Rivlin": {"model": "mooney-rivlin", "C1": 10, "C2": 1},
    "Gent, J_lim = 100": {"model": "gent", "J_lim": 100},
    "Arruda–Boyce, λ_L = 5": {"model": "arruda-boyce", "lambda_L": 5},
    "natural rubber (Ogden)": {"preset": "natural-rubber"},
}
written = load_scenario("../../../scenarios/fig2_inflation.toml").to_dict()
figure, axes = plt.subplots(figsize=(7, 4.5), layout="constrained")
for name, elastomer in ELASTOMERS.items():
    for balloon in written["balloon"]:
        balloon["elastomer"] = elastomer
    curve = trace_inflation(written, to_stretch=6.5)
    axes.plot(curve.stretch[:, 0], curve.pressure, label=name)
axes.set(xlabel="stretch λ", ylabel="pressure PR/(μH)", ylim=(0, 2))
axes.legend()
plt.show()
