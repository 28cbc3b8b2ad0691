"""
A cell on a gel: traction, strain energy and contractility
==========================================================

Traction force microscopy: palpate computes the traction of a cell from a field of displacements on a soft gel, and three numbers with errors.
"""

import numpy as np

import palpate as pp
from palpate.microscopy import Field, cell_forces

# %%
# A cell that pulls inwards at four adhesions, on a gel of 8 kPa: 32 x 32 vectors, one every 2 µm, with 20 nm of noise.
# `palpate.microscopy.read_field` reads your own field; `bead_displacements` computes one from two pictures.

gel = pp.HalfSpace(youngs_modulus=8e3, poissons_ratio=0.48)
vectors = pp.AreaArray(shape=(32, 32), pitch=2e-6, depth=0.0, channels=["displacement_x", "displacement_y"])
fine = pp.Skin(gel, vectors, surface=pp.AreaGrid(shape=(64, 64), spacing=1e-6))
y, x = np.meshgrid(*fine.surface.axes, indexing="ij")
traction = np.zeros((3, 64, 64))
for place in ((14e-6, 14e-6), (-14e-6, 14e-6), (14e-6, -14e-6), (-14e-6, -14e-6)):
    near = np.hypot(x - place[0], y - place[1]) < 4e-6
    traction[0][near], traction[1][near] = -500.0 * np.sign(place)
moved = fine.sense(traction) + np.random.default_rng(3).normal(0.0, 20e-9, (2, 32, 32))

# %%
# Rows of a field count downwards, as in a picture.

picture = np.stack([moved[0, ::-1], -moved[1, ::-1]])
field = Field(displacement=picture, start=(10.0, 10.0), step=20.0, pixel=0.1e-6)

# %%
# Noise, regularisation and drift are estimated from the field.

cell = cell_forces(field, gel)
print(cell["strain_energy"])
print(cell["contractility"])

# %%
# The true energy: half the integral of traction times displacement over the surface.

everywhere = pp.AreaArray(shape=(64, 64), pitch=1e-6, depth=0.0, channels=["displacement_x", "displacement_y"])
work = traction[:2] * pp.Skin(gel, everywhere, surface=fine.surface).sense(traction)
print(f"strain energy in truth: {0.5 * work.sum() * 1e-12 * 1e15:.0f} fJ")

# %%
# The map shows the four adhesions at which the cell pulls.

figure = cell.plot(title="Traction of a cell that pulls at four adhesions")
