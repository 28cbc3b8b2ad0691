"""Convert the states of one wavevector to the quantities that a sensor can measure, in x, y, z."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from palpate.elastic.channels import find_channel
from palpate.elastic.pad import Complexes, Floats, Pad, check_below

__all__ = ["COMPONENTS", "WaveFields", "transfer"]

#: Traction components, in the order of the component axis.
COMPONENTS: dict[int, tuple[str, ...]] = {1: ("x", "z"), 2: ("x", "y", "z")}

#: Directions over which the limit at k = 0 is averaged (exact for an isotropic pad, exponentially close for any other).
DIRECTIONS = 64

#: Rows of the compliance that lie in the plane (xx, yy, xy), and those out of it (zz, yz, xz).
_IN, _OUT = [0, 1, 5], [2, 3, 4]
_PLACE = {"xx": 0, "yy": 1, "xy": 2, "zz": 3, "yz": 4, "xz": 5}
#: Entries of Hooke's law smaller than this fraction of the largest of their kind are rounding errors, such as 1 - 2 nu
#: at nu = 1/2.
_ROUNDING = 1e-14


def partial_hooke(compliance: Floats) -> Floats:
    """Solve Hooke's law for the components that the states do not contain: (6, 6), in-plane stress (xx, yy, xy) and
    out-of-plane strain (zz, yz, xz) from in-plane strain and out-of-plane stress in the same order; shear strains
    doubled.

        s_a = S_aa^-1 (e_a - S_ab s_b),    e_b = S_ba s_a + S_bb s_b.

    Of the compliance S only the in-plane block is inverted. Every stable solid has this inverse, an incompressible one
    too.
    """
    aa, ab, bb = (compliance[np.ix_(i, j)] for i, j in ((_IN, _IN), (_IN, _OUT), (_OUT, _OUT)))
    stiff = np.linalg.inv(aa)
    out = np.empty((6, 6))
    blocks = ((0, 0, stiff, stiff), (0, 1, -stiff @ ab, np.eye(1)), (1, 0, ab.T @ stiff, np.eye(1)))
    for i, j, block, size in (*blocks, (1, 1, bb - ab.T @ stiff @ ab, bb)):
        clean = np.where(np.abs(block) < _ROUNDING * np.abs(size).max(), 0.0, block)
        out[3 * i : 3 * i + 3, 3 * j : 3 * j + 3] = clean
    return out


class WaveFields:
    """Fields (..., 3) of exp(i k.x) at one depth, per unit surface traction (q_x, q_y, p)."""

    def __init__(self, states: Complexes, displacement: Complexes, direction: Floats, compliance: Floats) -> None:
        """``states`` (..., 6, 3) as of `Pad.states`; ``displacement`` (..., 3, 3) is that of the same wave, not times k."""
        self._states, self._displacement, self._direction = states, displacement, direction
        self._hooke = partial_hooke(compliance)
        self._open: dict[str, Complexes] = {}

    def displacement(self, i: str) -> Complexes:
        """u_i."""
        return self._displacement[..., "xyz".index(i), :]

    def gradient(self, i: str, j: str) -> Complexes:
        """du_i/dx_j."""
        if j == "z":
            if i == "z":
                return -self.strain("zz")
            return -2.0 * self.strain(i + "z") - self.gradient("z", i)
        wave = 1j * self._direction[..., "xy".index(j), None]
        return np.asarray(wave * self._states[..., "xyz".index(i), :])

    def strain(self, ij: str) -> Complexes:
        """Strain, compression positive."""
        i, j = ij[0], ij[1]
        if j == "z":
            found = self._solved(ij)
            return found if i == j else 0.5 * found
        return -self.gradient(i, i) if i == j else -0.5 * (self.gradient(i, j) + self.gradient(j, i))

    def stress(self, ij: str) -> Complexes:
        """Stress, compression positive."""
        if ij[1] == "z":
            return np.asarray(self._states[..., 3 + "xyz".index(ij[0]), :])
        return self._solved(ij)

    def read(self, channels: Sequence[str]) -> Complexes:
        """(..., channel, 3)."""
        out = np.empty((*self._states.shape[:-2], len(channels), 3), dtype=np.complex128)
        for row, name in enumerate(channels):
            out[..., row, :] = find_channel(name).read(self)
        return out

    def _solved(self, ij: str) -> Complexes:
        """In-plane stress or (doubled) out-of-plane strain by Hooke's law."""
        if ij not in self._open:
            total: Complexes = np.zeros(self._states[..., 0, :].shape, dtype=np.complex128)
            for key, weight in zip(_PLACE, self._hooke[_PLACE[ij]]):
                if weight != 0.0:
                    known = self.stress(key) if key[1] == "z" else self.strain(key) * (2.0 if key == "xy" else 1.0)
                    total = total + weight * known
            self._open[ij] = total
        return self._open[ij]


def transfer(
    pad: Pad,
    wavevector_x: npt.ArrayLike,
    wavevector_y: npt.ArrayLike,
    depth: float,
    channels: Sequence[str],
    *,
    line: bool = False,
) -> npt.NDArray[np.complex128]:
    """The matrix of one wavevector: channel per unit surface traction.

    For a traction t(x) = t0 exp(i k.x) on z = 0 the channels at ``depth`` are M(k) t0 exp(i k.x).

    Parameters
    ----------
    pad : Pad
        The elastic body.
    wavevector_x, wavevector_y : array_like
        Components of the wavevector [rad/m], broadcast together; line contact is wavevector_y = 0.
        k = 0 is returned as the mean over all directions of the limit k -> 0 in stress and strain (what a load
        spread wide in every direction gives). Displacement is finite on a rigid base, and NaN over a half-space, where it
        has no limit: the caller must have a policy for it.
    depth : float
        Depth below the surface [m], >= 0.
    channels : sequence of str
        Names from `AREA_CHANNELS`.
    line : bool
        Line contact: only decides which directions the limit at k = 0 is averaged over.

    Returns
    -------
    array (..., channel, 3), complex
        Columns for (q_x, q_y, p) [m/Pa, Pa/Pa or 1/Pa].

    Raises
    ------
    InvalidInput
        A channel that does not exist, and a depth above the surface or below a rigid base.

    Examples
    --------
    >>> import palpate as pp
    >>> from palpate.elastic import transfer
    >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    >>> matrix = transfer(pad, [0.0, 1000.0], 0.0, 1e-3, ["stress_zz"])
    >>> matrix.shape  # (wavevector, channel, component)
    (2, 1, 3)

    >>> matrix[:, 0, 2].real.round(4).tolist()  # pressure -> s_zz: (1 + k z) exp(-k z)
    [1.0, 0.7358]
    """
    check_below(depth)
    kx, ky = np.broadcast_arrays(np.asarray(wavevector_x, dtype=np.float64), np.asarray(wavevector_y, dtype=np.float64))
    k = np.hypot(kx, ky)
    zero = k == 0.0
    safe = np.where(zero, 1.0, k)
    direction = np.stack([np.where(zero, 1.0, kx / safe), np.where(zero, 0.0, ky / safe)], axis=-1)
    states = pad.states(k, direction, depth)
    fields = WaveFields(states, states[..., :3, :] / safe[..., None, None], direction, pad.compliance(depth))
    matrix = fields.read(channels)
    if np.any(zero):
        matrix[zero] = _mean_response(pad, depth, channels, line=line)
    return np.asarray(matrix, dtype=np.complex128)


def _mean_response(pad: Pad, depth: float, channels: Sequence[str], *, line: bool) -> npt.NDArray[np.complex128]:
    angles = np.array([0.0, np.pi]) if line else np.arange(DIRECTIONS) * (2.0 * np.pi / DIRECTIONS)
    direction = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    k = np.zeros_like(angles)
    mean = pad.mean_compliance(depth)
    level = np.full((3, 3), np.nan) if mean is None else np.asarray(mean)
    everywhere = np.broadcast_to(level, (len(k), 3, 3)).astype(np.complex128)
    fields = WaveFields(pad.states(k, direction, depth), everywhere, direction, pad.compliance(depth))
    limit = fields.read(channels)
    out = np.asarray(limit.mean(axis=0))
    out[np.abs(out) < _ROUNDING * np.abs(limit).max(axis=(0, 2))[:, None]] = 0.0
    return out
