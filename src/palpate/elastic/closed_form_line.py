"""Line contact (plane strain) on a half-plane, by complex potentials.

With zeta = x + i z and the Cauchy transform of a surface traction t, W = int t(s)/(zeta - s) ds, V' = W:

    pressure:  pi s_zz = -Im W + z Re W'    pi s_xx = -Im W - z Re W'     pi s_xz = z Im W'
    shear:     pi s_zz = z Im W'            pi s_xx = 2 Re W - z Im W'    pi s_xz = -Im W - z Re W'

and displacements from Hooke's law (see `LineFields`). They follow from superposing the Flamant and tangential line loads
s_ij = (2/pi) x_i x_j (z P + x Q)/r^4 (K. L. Johnson, Contact Mechanics, 1985, sections 2.2 to 2.7).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from palpate.elastic.channels import find_channel
from palpate.elastic.pad import Floats

__all__ = ["LineFields", "Shape", "cell_influence_line", "line_fields", "potentials"]

Complexes = npt.NDArray[Any]
Shape = Literal["load", "strip", "hertz", "punch"]


def potentials(shape: Shape, half_width: float, zeta: Complexes) -> tuple[Complexes, Complexes, Complexes]:
    """(W, W', V) of a traction of unit force per length; V is chosen so that V ~ ln zeta far away."""
    a = half_width
    zeta = np.asarray(zeta, dtype=np.complex128)
    with np.errstate(divide="ignore", invalid="ignore"):
        if shape == "load":
            inverse: Complexes = 1.0 / zeta
            return inverse, -(inverse**2), np.log(zeta)
        right: Complexes = zeta + a
        left: Complexes = zeta - a
        if shape == "strip":
            log_right, log_left = np.log(right), np.log(left)
            ends: Complexes = np.where(right == 0, 0.0, right * log_right) - np.where(left == 0, 0.0, left * log_left)
            return (
                (log_right - log_left) / (2 * a),
                (1.0 / right - 1.0 / left) / (2 * a),
                ends / (2 * a) - 1.0,
            )
        root = np.sqrt(right) * np.sqrt(left)
        outer = zeta + root
        if shape == "hertz":
            w = 2.0 / outer
            return w, -2.0 / (root * outer), (zeta / outer - 0.5) + np.log(outer) - math.log(2.0)
        return 1.0 / root, -zeta / root**3, np.log(outer) - math.log(2.0)


class LineFields:
    """Fields of a traction along ``source`` ("x" or "z") from its complex potentials; ``constants`` are (mu, nu)."""

    def __init__(
        self,
        parts: tuple[Complexes, Complexes, Complexes],
        depth: npt.ArrayLike,
        source: str,
        constants: tuple[float, float],
    ) -> None:
        w, dw, v = parts
        self._w, self._source = w, source
        mu, nu = constants
        self._nu, self._half = nu, 1.0 / (2.0 * mu)
        z = self._z = np.asarray(depth, dtype=np.float64)

        def deep(part: Floats) -> Floats:  # z times a potential: 0 on the surface, even where the potential is singular
            return np.asarray(z * np.where(z == 0, 0.0, part))

        self._deep_w = deep(w.real), deep(w.imag)
        self._deep_dw = im_dw, re_dw = deep(dw.imag), deep(dw.real)
        self._v = v
        if source == "z":
            xx, zz, xz = -w.imag - re_dw, -w.imag + re_dw, im_dw
        else:
            xx, zz, xz = 2 * w.real - im_dw, im_dw, -w.imag - re_dw
        self._xx, self._zz, self._xz = xx / math.pi, zz / math.pi, xz / math.pi

    def displacement(self, i: str) -> Any:
        """u_i, up to a constant."""
        nu, v = self._nu, self._v
        re_w, im_w = self._deep_w
        if i == "y":
            return 0.0 * self._xx
        if self._source == "z":
            u = (1 - 2 * nu) * v.imag + re_w if i == "x" else -2 * (1 - nu) * v.real - im_w
        else:
            u = -2 * (1 - nu) * v.real + im_w if i == "x" else re_w - (1 - 2 * nu) * v.imag
        return self._half / math.pi * u

    def gradient(self, i: str, j: str) -> Any:
        """du_i/dx_j."""
        nu, w = self._nu, self._w
        im_dw, re_dw = self._deep_dw
        if "y" in (i, j):
            return 0.0 * self._xx
        if i == j:
            return -self.strain(i + j)
        # u_z differentiated along x: V' = W
        slope = -2 * (1 - nu) * w.real - im_dw if self._source == "z" else re_dw - (1 - 2 * nu) * w.imag
        slope = self._half / math.pi * slope
        return slope if i == "z" else -2.0 * self.strain("xz") - slope

    def strain(self, ij: str) -> Any:
        """Strain, compression positive."""
        nu, half, xx, zz = self._nu, self._half, self._xx, self._zz
        if ij == "xx":
            return half * ((1 - nu) * xx - nu * zz)
        if ij == "zz":
            return half * ((1 - nu) * zz - nu * xx)
        return half * self._xz if ij == "xz" else 0.0 * xx

    def stress(self, ij: str) -> Any:
        """Stress, compression positive."""
        if ij == "yy":
            return self._nu * (self._xx + self._zz)
        return {"xx": self._xx, "zz": self._zz, "xz": self._xz}.get(ij, 0.0 * self._xx)


def line_fields(
    parts: tuple[Complexes, Complexes, Complexes],
    depth: npt.ArrayLike,
    component: str,
    constants: tuple[float, float],
    channels: Sequence[str],
) -> Floats:
    """Channels (channel, ...) of a traction in ``component`` ("x" or "z") from its complex potentials."""
    fields = LineFields(parts, depth, component, constants)
    return np.stack([find_channel(name).read(fields) for name in channels])


def cell_influence_line(
    constants: tuple[float, float],
    offsets: Sequence[Floats],
    widths: Sequence[float],
    depth: float,
    channels: Sequence[str],
    *,
    concentrated: bool,
    damping: float,
) -> Floats:
    """Channels (channel, component, ...) per unit traction of one cell, see `palpate.HalfSpace.influence`."""
    (x,), (width,) = offsets, widths
    zeta = x + 1j * (depth + damping)
    parts = potentials("load" if concentrated else "strip", width / 2, zeta)
    return np.stack([width * line_fields(parts, depth, component, constants, channels) for component in "xz"], axis=1)
