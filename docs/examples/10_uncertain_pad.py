"""
A pad that is not known exactly
===============================

Strain is proportional to force over modulus, so a modulus that is wrong by a tenth makes every force wrong by a tenth. State how well you know the pad;
the interval then includes this error.
"""

import matplotlib.pyplot as plt
import numpy as np

import palpate as pp

array = pp.AreaArray(shape=(12, 12), pitch=1e-3, depth=1.5e-3, channels=["strain_zz"], noise=5e-4)
measured = pp.HalfSpace(youngs_modulus=200e3, poissons_ratio=0.48)
true_pad = pp.HalfSpace(youngs_modulus=220e3, poissons_ratio=0.48)

ball = pp.solutions.hertz_point(contact_radius=3e-3, force=1.0)
readings = pp.Skin(true_pad, array).sense(ball, rng=np.random.default_rng(0))

# %%
# The stated modulus is 200 kPa, the true one 220 kPa.

fig, ax = plt.subplots(figsize=(6, 2.6), layout="constrained")
labels = []
for row, spread in enumerate((0.0, 0.1)):
    skin = pp.Skin(measured, array, uncertainty=pp.Uncertainty(youngs_modulus=spread))
    touch = skin.reconstruct(readings)
    low, high = (float(end[-1]) for end in touch.interval(0.95, of="force"))
    labels.append(f"modulus ± {spread:.0%}")
    print(f"{labels[-1]}: {touch.force[-1]:.3f} N, 95 % between {low:.3f} and {high:.3f} N")
    ax.plot([low, high], [row, row], lw=6, alpha=0.4, color="C0")
    ax.plot(touch.force[-1], row, "o", color="C0")
ax.axvline(1.0, color="k", ls="--", label="truth")
ax.set(
    yticks=[0, 1],
    yticklabels=labels,
    ylim=(-0.6, 1.6),
    xlabel="normal force (N)",
    title="The interval with and without the modulus's own error",
)
ax.legend(loc="lower right")
