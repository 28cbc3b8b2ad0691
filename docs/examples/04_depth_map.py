"""
A map of depth beside the markers narrows the normal force
==========================================================

Dots that move sideways tell the normal force only through the shape of the contact. Where another method (photometric stereo,
structured light) also says how far the surface is pressed in, the readings tell it themselves, and the interval shrinks.
"""

import matplotlib.pyplot as plt
import numpy as np

import palpate as pp

gel = pp.BondedLayers([pp.Layer(thickness=3.5e-3, youngs_modulus=300e3, poissons_ratio=0.48)])
dots = pp.AreaArray(shape=(6, 8), pitch=2e-3, depth=0.5e-3, channels=["displacement_x", "displacement_y"], noise=1e-6)

# %%
# The depth of the surface, known at places of its own with 5 µm. For a video, `palpate.camera.follow` takes a `DepthMap` of such places.

places = np.stack(np.meshgrid(np.arange(-6, 7, 2.0), np.arange(-4, 5, 2.0)), axis=-1).reshape(-1, 2) * 1e-3
depth = pp.ScatteredArray(positions=places, depth=0.0, channels=["displacement_z"], noise=5e-6)

markers = pp.Skin(gel, dots)
both = pp.Skin(gel, [dots, depth], surface=markers.surface)

# %%
# The same press, read without and with the depth.

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
