"""
A dead taxel and an offset, and their notes
===========================================

In this array one taxel is dead, another reads the end of its range, and one channel has an offset. palpate still finds the right force,
and its notes name the faults.
"""

import matplotlib.pyplot as plt
import numpy as np

import palpate as pp

pad = pp.HalfSpace(youngs_modulus=200e3, poissons_ratio=0.48)
taxels = pp.AreaArray(shape=(12, 12), pitch=1e-3, depth=1.5e-3, channels=["stress_xz", "stress_yz", "stress_zz"])
skin = pp.Skin(pad, taxels)

ball = pp.solutions.hertz_point(contact_radius=3e-3, force=1.0).sliding(0.2)
readings = skin.sense(ball)
readings = readings + np.random.default_rng(0).normal(0.0, 0.005 * readings.max(), readings.shape)

# %%
# A taxel in the middle of the contact reads 0, one at the side reads far too much, and all normal stresses are too large by a tenth of their peak.

wrong = readings.copy()
wrong[2] += 0.1 * readings[2].max()
wrong[2, 6, 6] = 0.0
wrong[2, 2, 9] = 3.0 * readings[2].max()

touch = skin.reconstruct(wrong)
low, high = touch.interval(0.95, of="force")
print(f"normal force {touch.force[2]:.2f} N, 95 % between {low[2]:.2f} and {high[2]:.2f} N; in truth 1 N")
for note in touch.notes:
    print("-", note)

# %%
# The readings and the result. Crosses mark the readings that were left out.

fig, (left, right) = plt.subplots(1, 2, figsize=(9, 4), layout="constrained")
shown = left.imshow(wrong[2] / 1e3, origin="lower", cmap="viridis")
fig.colorbar(shown, ax=left, label="normal stress (kPa)")
rows, columns = np.nonzero(touch.outliers.reshape(3, 12, 12)[2])
left.plot(columns, rows, "rx", ms=10, label="left out")
left.set(title="Readings", xlabel="column", ylabel="row")
left.legend()
touch.plot(ax=right, title="Pressure and shear that were found")
