"""
A pad of your own: stiffer along its depth than across
======================================================

Any object with ``thickness``, ``states``, ``compliance`` and ``mean_compliance`` is a pad. This example is a transversely isotropic half-space, such as rubber
with fibres along its depth. Arrays, methods and error bars then work as for other pads.
"""

from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np

import palpate as pp
from palpate.elastic import from_radial

# %%
# Two waves exp(-k s z) couple u_x and u_z; a third one is u_y alone (H. A. Elliott, Proc. Camb. Phil. Soc. 44, 1948).


@dataclass(frozen=True)
class TransverselyIsotropic:
    """Stiffnesses [Pa] in the usual order, compression or tension alike; c66 = (c11 - c12)/2."""

    c11: float
    c12: float
    c13: float
    c33: float
    c44: float

    thickness = None

    @property
    def roots(self) -> np.ndarray:
        middle = self.c11 * self.c33 - self.c13**2 - 2 * self.c13 * self.c44
        square = np.roots([self.c33 * self.c44, -middle, self.c11 * self.c44]).astype(complex)
        return np.sqrt(square)

    def states(self, wavenumber: np.ndarray, direction: np.ndarray, depth: float) -> np.ndarray:
        kz = np.asarray(wavenumber, dtype=float) * depth
        s = self.roots
        w = (self.c44 * s**2 - self.c11) / ((self.c13 + self.c44) * s)  # u_z of each wave per k U
        waves = np.stack([np.ones(2), w, self.c44 * (s - w), self.c13 + self.c33 * s * w])  # k U, k u_z, S, s_zz
        decay = np.exp(-s[:, None] * kz.reshape(-1))
        in_plane = np.einsum("ij,jn,jk->ikn", waves, decay, np.linalg.inv(waves[2:])).real
        third = np.sqrt((self.c11 - self.c12) / 2 / self.c44)
        across = np.exp(-third * kz)
        return from_radial(
            in_plane.reshape(4, 2, *kz.shape), np.stack([across / (self.c44 * third), across]), direction
        )

    def compliance(self, depth: float) -> np.ndarray:
        stiffness = np.diag([self.c11, self.c11, self.c33, self.c44, self.c44, (self.c11 - self.c12) / 2])
        stiffness[0, 1] = stiffness[1, 0] = self.c12
        stiffness[:2, 2] = stiffness[2, :2] = self.c13
        return np.linalg.inv(stiffness)

    def mean_compliance(self, depth: float) -> None:
        return None


# %%
# The pad is four times as stiff along z as across [Pa]; its taxels measure normal stress.

fibres = TransverselyIsotropic(c11=3.0e5, c12=1.5e5, c13=1.5e5, c33=12.0e5, c44=0.75e5)
taxels = pp.LineArray(count=41, pitch=1e-3, depth=2e-3, channels=["stress_zz"])
cylinder = pp.solutions.hertz_line(half_width=5e-3, force=100.0)
own = pp.Skin(fibres, taxels)
plain = pp.Skin(pp.HalfSpace(youngs_modulus=200e3, poissons_ratio=0.3), taxels)

readings = own.sense(own.sample(cylinder))
readings = readings + np.random.default_rng(0).normal(0.0, 0.005 * readings.max(), readings.shape)

# %%
# The same readings, solved with the right pad and with an isotropic one. The isotropic pad explains the readings less well: its fit is lower.

fig, ax = plt.subplots(figsize=(6, 3.4), layout="constrained")
for label, skin in (("with fibres", own), ("isotropic", plain)):
    touch = skin.reconstruct(readings)
    print(f"{label}: force {touch.force[-1]:.1f} N/m, fit {float(touch.fit):.2g}")
    ax.plot(1e3 * touch.pressure["x"], touch.pressure / 1e3, label=label)
ax.plot(1e3 * own.surface.x, own.sample(cylinder)[1] / 1e3, "k--", lw=1, label="truth")
ax.set(
    xlabel="x (mm)", ylabel="pressure (kPa)", title="A pad with fibres, solved with the right model and as isotropic"
)
ax.legend()
