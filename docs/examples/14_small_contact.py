"""
A contact smaller than the distance of taxels
=============================================

A grain or the tip of a needle may touch between the taxels. The readings then do not determine its shape, but they determine its force, with a wide interval.
"""

import numpy as np

import palpate as pp

pad = pp.HalfSpace(youngs_modulus=200e3, poissons_ratio=0.48)
taxels = pp.AreaArray(shape=(6, 8), pitch=4e-3, depth=2.6e-3, channels=["stress_xz", "stress_yz", "stress_zz"])
skin = pp.Skin(pad, taxels)

# %%
# A small ball, in contact over a radius of 1.6 mm, on taxels 4 mm apart. It touches between four of them.

tip = pp.solutions.hertz_point(contact_radius=1.6e-3, force=0.8).shifted(1.2e-3, 1.5e-3)
readings = skin.sense(tip)
readings = readings + np.random.default_rng(0).normal(0.0, 0.01 * readings.max(), readings.shape)

touch = skin.reconstruct(readings)
low, high = touch.interval(0.95, of="force")
print(f"normal force {touch.force[2]:.2f} N, 95 % between {low[2]:.2f} and {high[2]:.2f} N; in truth 0.80 N")
x, y = touch.center_of_pressure
print(f"centre at {1e3 * x:.1f} mm, {1e3 * y:.1f} mm; in truth 1.2 mm, 1.5 mm")
for note in touch.notes:
    print("-", note)

# %%
# The map shows a spot about as wide as the depth; finer detail is not measured.

figure = touch.plot(title="A tip between the taxels")
