"""
A map of depth beside the markers narrows the normal force
==========================================================

From dots that move sideways, palpate infers the normal force only through the shape of the contact. If another method (photometric stereo,
structured light) measures the depth of the indentation too, the readings determine the normal force, and its interval shrinks.
"""

import matplotlib.pyplot as plt
import numpy as np

import palpate as pp

gel = pp.BondedLayers([pp.Layer(thickness=3.5e-3, youngs_modulus=300e3, poissons_ratio=0.48)])
dots = pp.AreaArray(shape=(6, 8), pitch=2e-3, depth=0.5e-3, channels=["displacement_x", "displacement_y"], noise=1e-6)

# %%
# The depth of the surface, measured at other places with an error of 5 µm. For a video, pass a `DepthMap` to `palpate.camera.follow`.

places = np.stack(np.meshgrid(np.arange(-6, 7, 2.0), np.arange(-4, 5, 2.0)), axis=-1).reshape(-1, 2) * 1e-3
depth = pp.ScatteredArray(positions=places, depth=0.0, channels=["displacement_z"], noise=5e-6)

markers = pp.Skin(gel, dots)
both = pp.Skin(gel, [dots, depth], surface=markers.surface)

# %%
# The same press, solved without and with the depth.

ball = pp.solutions.hertz_point(contact_radius=2.5e-3, force=1.5).sliding(0.2)
readings = both.sense(ball, rng=np.random.default_rng(2))
found = {"dots alone": markers.reconstruct(readings[0]), "dots and depth": both.reconstruct(readings)}

fig, ax = plt.subplots(figsize=(6, 2.4), layout="constrained")
for row, (label, touch) in enumerate(found.items()):
    low, high = (float(end[-1]) for end in touch.interval(0.95, of="force"))
    print(f"{label}: {touch.force[-1]:.2f} N, 95 % between {low:.2f} and {high:.2f} N")
    ax.plot([low, high], [row, row], lw=6, alpha=0.4, color="C0")
    ax.plot(touch.force[-1], row, "o", color="C0")
ax.axvline(1.5, color="k", ls="--", label="truth, 1.5 N")
ax.set(
    yticks=[0, 1],
    yticklabels=list(found),
    ylim=(-0.6, 1.6),
    xlabel="normal force (N)",
    title="95 % interval of the normal force",
)
ax.legend()
