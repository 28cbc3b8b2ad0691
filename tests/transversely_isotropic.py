"""A pad of one's own: the transversely isotropic half-space with its axis along z.

In the frame of a wavevector two waves exp(-k s z) couple u_r = i U and u_z, and one carries u_t; s_1 and s_2 are the roots of
c33 c44 s^4 - (c11 c33 - c13^2 - 2 c13 c44) s^2 + c11 c44 = 0, and s_3^2 = c66/c44 (H. A. Elliott, Proc. Camb. Phil. Soc. 44, 1948).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.elastic import from_radial


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
