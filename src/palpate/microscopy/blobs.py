"""Adhesions as blobs of shear: displacement of the gel, work, and traction on a grid.

A blob is a force with a Gaussian density of variance s^2. An isotropic gel moves by u = [g0 + g2 (2 r r^T/|r|^2 - 1)] F at a point r from it. On the surface of a
half-space, with q = |r|^2/4 s^2 and modified Bessel functions scaled by exp(-q),

    g0 = a (1 - nu/2) I0(q),  g2 = a nu/2 I1(q),  a = (1 + nu)/(pi E s) sqrt(pi/2),

which is Cerruti's solution (K. L. Johnson, Contact Mechanics, 1985, section 3.6) averaged over the Gaussian. Variances add for displacements averaged
over a window, and for the mean over another blob: the work of blobs on each other has a closed form.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.special import erf, i0e, i1e, jv

from palpate.elastic.pad import Floats, Pad
from palpate.elastic.quantities import transfer
from palpate.errors import Unsupported

__all__ = ["PROFILES", "Response", "painted", "profiled", "work_of"]

CHANNELS = ("displacement_x", "displacement_y")
#: Nodes of the table of corrections for gels other than a half-space: numbers of variances, distances and wavenumbers.
VARIANCES, DISTANCES, WAVES = 24, 240, 4000
#: Profiles that an adhesion may have. They have the same force and second moments, and a window cannot tell them apart;
#: but the largest traction differs: 1/(2 pi s^2) of the force for a Gaussian, 1/(4 pi s^2) for an even one.
PROFILES = ("Gaussian", "half ellipsoid", "even")
#: A profile is made of this many small Gaussians, whose standard deviation is PART_SIZE times its radius.
PARTS, PART_SIZE = 37, 0.17
#: For blobs narrower than this fraction of a square, the mean traction over the square does not depend on the profile.
NARROW = 0.3
#: The error function is 1 to double precision beyond this argument.
ERF_ONE = 6.0
#: A gel counts as isotropic in its surface if its responses along and across differ by less than this fraction.
ISOTROPIC = 1e-6


@dataclass(frozen=True, eq=False)
class Response:
    """Displacement of a gel under blobs. ``table`` holds the correction for a finite or layered gel, or for beads at
    some depth: (log variance, asinh(distance/unit), g0 and g2).
    """

    scale: float
    ratio: float
    table: tuple[Floats, Floats, Floats, float] | None = None

    @classmethod
    def of(cls, pad: Pad, depth: float, least: float, reach: float) -> Response:
        """Compute the response for blobs of standard deviation ``least`` [m] or more at distances up to ``reach`` [m]."""
        first = 1.0 / reach
        k = np.geomspace(1e-2 * first, 8.0 / least, WAVES)
        along, across = _responses(pad, k, 0.0)
        # short waves do not reach below the top layer
        ratio = 1.0 - float(along[-1] / across[-1])
        modulus = 2.0 * (1.0 + ratio) / float(across[-1] * k[-1])
        half = cls((1.0 + ratio) / (math.pi * modulus) * math.sqrt(math.pi / 2), ratio)
        if depth > 0:
            along, across = _responses(pad, k, depth)
        plain = 2.0 * (1.0 + ratio) / (modulus * k)
        more = along - (1.0 - ratio) * plain, across - plain
        if max(float(np.abs(m / plain).max()) for m in more) < ISOTROPIC:
            return half
        weight = np.gradient(k) * k / (4 * math.pi)
        variances = np.geomspace(least**2, (4 * reach) ** 2, VARIANCES)
        unit = max(least, 0.01 * reach)
        places = np.linspace(0.0, math.asinh(1.5 * reach / unit), DISTANCES)
        kr = k[:, None] * (unit * np.sinh(places))[None, :]
        even, odd = jv(0, kr), jv(2, kr)
        damped = np.exp(-0.5 * variances[:, None] * k**2) * weight
        table = np.stack([(damped * (more[0] + more[1])) @ even, -(damped * (more[0] - more[1])) @ odd], axis=-1)
        return cls(half.scale, ratio, (np.log(variances), places, table, unit))

    def __call__(self, squares: Any, variance: Any) -> tuple[Any, Any]:
        """Return g0 and g2 [m/N] at squared distances ``squares`` [m^2] from blobs of variance ``variance`` [m^2]."""
        q, a = squares / (4.0 * variance), self.scale / np.sqrt(variance)
        g0, g2 = a * (1.0 - 0.5 * self.ratio) * i0e(q), a * (0.5 * self.ratio) * i1e(q)
        if self.table is None:
            return g0, g2
        logs, places, table, unit = self.table
        i = np.clip((np.log(variance) - logs[0]) / (logs[1] - logs[0]), 0.0, len(logs) - 1.001)
        j = np.clip(np.arcsinh(np.sqrt(squares) / unit) / places[1], 0.0, len(places) - 1.001)
        i, j = np.broadcast_arrays(i, j)
        row, column = i.astype(int), j.astype(int)
        fi, fj = (i - row)[..., None], (j - column)[..., None]
        low = (1 - fj) * table[row, column] + fj * table[row, column + 1]
        high = (1 - fj) * table[row + 1, column] + fj * table[row + 1, column + 1]
        more = (1 - fi) * low + fi * high
        return g0 + more[..., 0], g2 + more[..., 1]

    def tensor(self, x: Any, y: Any, variance: Any) -> tuple[Any, Any, Any]:
        """Return u_x per F_x, u_x per F_y (equal to u_y per F_x), and u_y per F_y [m/N]."""
        squares = x * x + y * y
        g0, g2 = self(squares, variance)
        safe = np.maximum(squares, 1e-300)
        even, odd = g2 * (x * x - y * y) / safe, g2 * 2 * x * y / safe
        return g0 + even, odd, g0 - even


def _responses(pad: Pad, k: Floats, depth: float) -> tuple[Floats, Floats]:
    """Return the displacement per shear traction along and across the wavevector."""
    one = transfer(pad, k, 0.0 * k, depth, CHANNELS).real
    other = transfer(pad, 0.0 * k, k, depth, CHANNELS).real
    along, across = one[:, 0, 0], one[:, 1, 1]
    if not np.allclose(along, other[:, 1, 1], rtol=1e-6, atol=0) or not np.allclose(
        across, other[:, 0, 0], rtol=1e-6, atol=0
    ):
        raise Unsupported('this gel is not the same in all directions: use method="tikhonov" (--method tikhonov).')
    return along, across


def work_of(places: Floats, variance: Floats, forces: Floats, response: Response) -> Floats:
    """Return half the work [J] of each blob's force on the mean displacement over the blob. Arguments: places (blob,
    2) [m], variance (blob,) [m^2], forces (blob, 2) [N].
    """
    apart = places[:, None, :] - places[None, :, :]
    xx, xy, yy = response.tensor(apart[..., 0], apart[..., 1], variance[:, None] + variance[None, :])
    fx, fy = forces.T
    return np.asarray(0.5 * (fx * (xx @ fx + xy @ fy) + fy * (xy @ fx + yy @ fy)))


def painted(places: Floats, variance: Floats, x: Floats, y: Floats, side: float) -> tuple[Floats, Floats]:
    """Return the fractions of each blob in the columns and in the rows (blob, n) of squares of side ``side`` [m]
    centred on ``x`` and ``y``; the fraction in a square is the product of both.
    """
    wide = np.sqrt(2.0 * variance)[:, None]

    def parts(middle: Floats, at: Floats) -> Floats:
        ends = (np.append(at - 0.5 * side, at[-1] + 0.5 * side) - middle[:, None]) / wide
        # the error function is slow: evaluate it only near the blob, elsewhere it is 1 or -1
        near = np.abs(ends) < ERF_ONE
        sums = np.sign(ends)
        sums[near] = erf(ends[near])
        return np.asarray(0.5 * np.diff(sums, axis=1))

    return parts(places[:, 0], x), parts(places[:, 1], y)


def profiled(
    places: Floats, variance: Floats, profiles: npt.NDArray[np.intp], side: float
) -> tuple[Floats, Floats, Floats, npt.NDArray[np.intp]]:
    """Replace each blob by small Gaussians that together have its profile, its force and its second moments.

    ``places`` (blob, 2) [m], ``variance`` (blob,) [m^2] and ``profiles`` (blob,), indices of `PROFILES`, describe the
    blobs; ``side`` [m] is that of a vector's square. Gaussian blobs, and blobs narrower than `NARROW` times ``side``,
    stay one Gaussian. Return for each Gaussian its place, its variance, its fraction of the blob's force, and the index
    of its blob.

    The Gaussians lie on a sunflower spiral, which fills a disc evenly (H. Vogel, Math. Biosci. 44, 1979, 179-189).
    """
    plain = (profiles == 0) | (variance < (NARROW * side) ** 2)
    number = np.flatnonzero(~plain)
    k = np.arange(PARTS)
    part = (k + 0.5) / PARTS
    angle = math.pi * (3.0 - math.sqrt(5.0)) * k
    out = [(places[plain], variance[plain], np.ones(int(plain.sum())), np.flatnonzero(plain))]
    for profile, radius in ((1, np.sqrt(1.0 - (1.0 - part) ** (2.0 / 3.0))), (2, np.sqrt(part))):
        these = number[profiles[number] == profile]
        if not len(these):
            continue
        unit = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        unit = unit - unit.mean(axis=0)
        second = 0.5 * float((unit**2).sum(axis=1).mean()) + PART_SIZE**2
        wide = np.sqrt(variance[these] / second)
        at = places[these, None, :] + wide[:, None, None] * unit
        each = np.repeat((PART_SIZE * wide) ** 2, PARTS)
        out.append((at.reshape(-1, 2), each, np.full(len(each), 1.0 / PARTS), np.repeat(these, PARTS)))
    p, v, w, i = (np.concatenate(a) for a in zip(*out))
    return p, v, w, i
