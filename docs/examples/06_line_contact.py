"""
Line contact: a cylinder that is dragged and slips in part
==========================================================

A row of sensors under a long contact. Stress along two directions tells pressure and shear apart; at the rim the contact slips already,
and its middle still sticks.
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
# Estimate with its 95 % band, and the truth.

figure = touch.plot(truth=skin.sample(cylinder), title="Pressure and shear under a dragged cylinder")
