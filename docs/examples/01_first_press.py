"""
First press: force with its interval
====================================

A sensor has 4 x 4 taxels with three axes each, 2 mm below the surface of a soft pad. A ball presses and drags. What is its force, with which interval?
"""

import numpy as np

import palpate as pp

# %%
# The pad and the taxels. Lengths are in metres, moduli and stresses in pascals.

pad = pp.HalfSpace(youngs_modulus=200e3, poissons_ratio=0.48)
taxels = pp.AreaArray(
    shape=(4, 4), pitch=4.5e-3, depth=2e-3, aperture=3e-3, channels=["stress_xz", "stress_yz", "stress_zz"], noise=100.0
)
skin = pp.Skin(pad, taxels)

# %%
# The readings are simulated for a known contact: 2 N down, 0.6 N sideways. Put your own readings here,
# with the shape (channel, row, column).

ball = pp.solutions.hertz_point(contact_radius=4e-3, force=2.0).sliding(0.3)
readings = skin.sense(ball, rng=np.random.default_rng(0))

# %%
# The result. Nothing is tuned; the noise is estimated from the readings.

touch = skin.reconstruct(readings)
print(touch.summary(friction=0.5))

# %%
# Force and interval as numbers, for a program.

low, high = touch.interval(0.95, of="force")
for name, value, least, most in zip(skin.components, touch.force, low, high, strict=True):
    print(f"{name}: {value:.2f} N, 95 % between {least:.2f} and {most:.2f} N")

# %%
# Pressure with arrows of shear, and the truth below it. Sixteen taxels determine the force well, and the shape roughly.

figure = touch.plot(truth=skin.sample(ball))
