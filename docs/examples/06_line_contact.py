"""
Line contact: a dragged cylinder with partial slip
==================================================

A row of sensors lies under a long contact. Two components of stress separate pressure from shear. The rim of the contact slips,
while its middle sticks.
"""

import numpy as np

import palpate as pp

pad = pp.HalfSpace(youngs_modulus=200e3, poissons_ratio=0.48)
row = pp.LineArray(count=61, pitch=1e-3, depth=2e-3, channels=["stress_xz", "stress_zz"], noise=20.0)
skin = pp.Skin(pad, row)

# %%
# 200 N/m of pressure, 60 N/m of drag, friction 0.5: Cattaneo's and Mindlin's solution.

cylinder = pp.solutions.hertz_line(half_width=8e-3, force=200.0).partial_slip(0.5, 60.0)
touch = skin.reconstruct(skin.sense(cylinder, rng=np.random.default_rng(1)))
print(touch.summary(friction=0.5))

# %%
# The estimate with its 95 % band, and the truth.

figure = touch.plot(truth=skin.sample(cylinder), title="Pressure and shear under a dragged cylinder")
