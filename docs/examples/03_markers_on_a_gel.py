"""
Markers on a glued gel: pressure from sideways motion
=====================================================

A camera sees dots move sideways, 0.5 mm below the surface of a gel that is glued to a window. palpate finds the pressure from this
motion, because contact pushes and never pulls.
"""

import matplotlib.pyplot as plt
import numpy as np

import palpate as pp

gel = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=300e3, poissons_ratio=0.48)])
dots = pp.AreaArray(shape=(9, 9), pitch=1.5e-3, depth=0.5e-3, channels=["displacement_x", "displacement_y"])
skin = pp.Skin(gel, dots)

# %%
# A ball presses with 0.5 N and slides with 0.15 N. The positions of dots have an error of about a micrometre. Put your own displacements here [m].

ball = pp.solutions.hertz_point(contact_radius=2.5e-3, force=0.5).sliding(0.3)
rng = np.random.default_rng(1)
moved = skin.sense(ball)
moved = moved + rng.normal(0.0, 1e-6, moved.shape)

touch = skin.reconstruct(moved, friction=0.5)
print(touch.summary(friction=0.5))

# %%
# The motion of the dots, and the result. Dots around the contact move away from it, and all dots move with the drag.

fig, (left, right) = plt.subplots(1, 2, figsize=(9, 4), layout="constrained")
y, x = np.meshgrid(*(1.5 * (np.arange(9) - 4),) * 2, indexing="ij")
left.quiver(x, y, *(1e6 * moved), np.hypot(*moved) * 1e6, angles="xy", cmap="viridis")
left.set(
    aspect="equal", xlabel="x (mm)", ylabel="y (mm)", title=f"Dots move up to {1e6 * np.hypot(*moved).max():.0f} µm"
)
touch.plot(ax=right, title="Pressure and shear that were found")
