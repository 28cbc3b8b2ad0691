"""
A layered pad, and the error of a half-space model
==================================================

The pad is a thin stiff film on a soft layer on a rigid base. How does it blur a touch, and how wrong is the force if you describe it as a half-space?
"""

import numpy as np

import palpate as pp
from palpate.pads import half_space_error, plot_response

pad = pp.BondedLayers(
    [
        pp.Layer(thickness=0.3e-3, youngs_modulus=1e6, poissons_ratio=0.48),
        pp.Layer(thickness=3e-3, youngs_modulus=150e3, poissons_ratio=0.48),
    ]
)
taxels = pp.AreaArray(
    shape=(8, 8), pitch=1.6e-3, depth=3.3e-3, channels=["stress_xz", "stress_yz", "stress_zz"], noise=100.0
)
skin = pp.Skin(pad, taxels)

# %%
# The response to waves of pressure and shear. No method can recover fine patterns from readings at the base.

figure = plot_response(pad, skin.planes)

# %%
# The error of the half-space model for a typical contact.

wrong = half_space_error(skin)
print(f"taken for a half-space, the force is {wrong.force:.1f} times the true one, the peak {wrong.peak:.1f} times")

# %%
# A ball on this pad, reconstructed with the right model.

ball = pp.solutions.hertz_point(contact_radius=3e-3, force=1.0).sliding(0.3)
touch = skin.reconstruct(skin.sense(ball, rng=np.random.default_rng(0)), friction=0.5)
figure = touch.plot(truth=skin.sample(ball), title="A ball on a film over a soft layer")
