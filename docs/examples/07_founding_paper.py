"""
The founding paper's case: division, with and without noise
===========================================================

The paper recovered a cylinder's pressure from 121 sensors by dividing Fourier transforms. Without noise, division is exact enough.
With noise of a thousandth it fails; a method that estimates the noise is still accurate.
"""

import matplotlib.pyplot as plt
import numpy as np

import palpate as pp
from palpate import paper

traction, readings = paper.data("cylinder", "stress_zz")
skin = pp.Skin(paper.PAD, paper.array(["stress_zz"]))
position = paper.PITCH * (np.arange(paper.SENSORS) - paper.SENSORS // 2)

fig, panels = plt.subplots(1, 2, figsize=(9, 3.4), sharey=True, layout="constrained")
rng = np.random.default_rng(0)
for ax, noise in zip(panels, (0.0, 1e-3), strict=True):
    noisy = readings + noise * np.abs(readings).max() * rng.standard_normal(readings.shape)
    for method, label in (("dft", "division, as in the paper"), ("automatic", "automatic")):
        pressure = skin.reconstruct(noisy, method=method).pressure
        ax.plot(pressure["x"], pressure, label=label)
    ax.plot(position, traction[1], "k--", lw=1, label="truth")
    ax.set(xlim=(-10, 10), ylim=(-0.1, 0.25), xlabel="x", title=f"noise {noise:.1%} of the largest reading")
panels[0].set_ylabel("pressure")
panels[0].legend()
