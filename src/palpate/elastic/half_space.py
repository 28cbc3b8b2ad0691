"""The elastic half-space, one wavenumber at a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.elastic.closed_form import across_edges, cell_influence_area
from palpate.elastic.closed_form_line import cell_influence_line
from palpate.elastic.pad import Complexes, Floats, isotropic_compliance
from palpate.errors import InvalidInput
from palpate.units import is_number

__all__ = ["HalfSpace", "check_material", "decaying_states", "from_radial"]


def check_material(youngs_modulus: float, poissons_ratio: float) -> None:
    """Raise `InvalidInput` unless the constants are those of a stable isotropic solid with 0 <= nu <= 0.5."""
    if not (is_number(youngs_modulus) and youngs_modulus > 0):
        raise InvalidInput(
            f"youngs_modulus must be a positive, finite number of pascals; got {youngs_modulus!r}. "
            "A soft silicone is about 1e5 to 2e6 Pa."
        )
    if not (is_number(poissons_ratio) and 0.0 <= poissons_ratio <= 0.5):
        raise InvalidInput(
            f"poissons_ratio must lie between 0 and 0.5 (0.5, incompressible, included); got {poissons_ratio!r}."
        )


@dataclass(frozen=True, kw_only=True)
class HalfSpace:
    """A homogeneous, isotropic elastic half-space: a pad much thicker than the contact is wide.

    Parameters
    ----------
    youngs_modulus : float
        Young's modulus E [Pa], positive.
    poissons_ratio : float
        Poisson's ratio nu, 0 <= nu <= 0.5. Exactly 0.5 (incompressible) needs no special case.

    Raises
    ------
    InvalidInput
        A modulus that is not positive and finite, or a Poisson's ratio outside 0 to 0.5.

    Notes
    -----
    With mu = E/(2(1+nu)), surface values S0, N0 and C = S0 + N0, the field that dies out with depth is

        N = [N0 + kz C] e^{-kz},        S = [S0 - kz C] e^{-kz},        T = T0 e^{-kz},
        k U   = (1-nu)/(2 mu) [S0 + (1 - kz) C - b (N0 + kz C)] e^{-kz},    b = nu/(1-nu),
        k u_z = -d(k U)/d(kz) - S/mu,     k u_t = T/mu

    (the decaying solutions of the plane-strain equations; see K. L. Johnson, Contact Mechanics, 1985, ch. 2).

    Examples
    --------
    >>> import numpy as np
    >>> import palpate as pp
    >>> pad = pp.HalfSpace(youngs_modulus=3e5, poissons_ratio=0.5)
    >>> round(pad.shear_modulus)  # E / 3
    100000

    >>> pad.thickness is None, pad.mean_compliance(0.0) is None
    (True, True)

    >>> round(1 / pad.compliance(0.0)[0, 0])  # E again
    300000

    >>> states = pad.states(np.array([1000.0]), np.array([[1.0, 0.0]]), 1e-3)  # k z = 1
    >>> states[0, 5, 2].real.round(4).item()  # s_zz for a unit pressure: (1 + k z) exp(-k z)
    0.7358

    >>> x = np.array([0.0])  # below the middle of a cell 2 mm wide that bears 1 Pa
    >>> pad.influence([x], [2e-3], 1e-3, ["stress_zz"])[0, 1].round(4).tolist()
    [0.8183]
    """

    youngs_modulus: float
    poissons_ratio: float

    def __post_init__(self) -> None:
        check_material(self.youngs_modulus, self.poissons_ratio)

    @property
    def shear_modulus(self) -> float:
        """mu = E / (2 (1 + nu)) [Pa]."""
        return self.youngs_modulus / (2.0 * (1.0 + self.poissons_ratio))

    @property
    def thickness(self) -> None:
        """None: a half-space has no base."""
        return None

    def compliance(self, depth: float) -> Floats:
        """Compliance (6, 6) [1/Pa], the same at every depth."""
        return isotropic_compliance(self.youngs_modulus, self.poissons_ratio)

    def states(self, wavenumber: Floats, direction: Floats, depth: float) -> Complexes:
        """Fields of one wavevector at ``depth`` [m], see `palpate.elastic.Pad.states`."""
        kz = np.asarray(wavenumber, dtype=np.float64) * depth
        decay = np.exp(-kz)
        in_plane = decaying_states(self.shear_modulus, self.poissons_ratio, kz)
        return from_radial(in_plane, np.stack([decay / self.shear_modulus, decay]), direction)

    def mean_compliance(self, depth: float) -> None:
        """None: the displacement of a half-space under a mean traction has no finite value."""
        return

    def influence(
        self,
        offsets: Sequence[Floats],
        widths: Sequence[float],
        depth: float,
        channels: Sequence[str],
        *,
        concentrated: bool = False,
        damping: float = 0.0,
    ) -> Floats:
        """Channels per unit traction of one uniformly loaded surface cell, in closed form.

        Parameters
        ----------
        offsets : one array (..., n) per axis, in the order (y, x), or (x,) in line contact
            Point minus cell centre [m]; in area contact they span a lattice (..., ny, nx).
        widths : one per axis
            Cell widths [m].
        concentrated : bool
            The cell's force acts at its centre.
        damping : float
            Response times exp(-k damping): its potentials lie that much deeper [m].

        Returns
        -------
        array (channel, component, ..., n) or (channel, component, ..., ny, nx)
        """
        cell = cell_influence_line if len(offsets) == 1 else cell_influence_area
        constants = (self.shear_modulus, self.poissons_ratio)

        def at(places: Sequence[Floats]) -> Floats:
            return cell(constants, places, widths, depth, channels, concentrated=concentrated, damping=damping)

        return at(offsets) if depth + damping or concentrated else across_edges(at, offsets, widths)


def from_radial(in_plane: Floats, antiplane: Floats, direction: Floats) -> Complexes:
    """States (..., 6, 3) in x, y, z from those of an isotropic body in the frame of the wavevector.

    With r along the wavevector, t across it, u_r = i U and s_rz = i S the states are real.

    Parameters
    ----------
    in_plane : array (4, 2, ...)
        Rows k U, k u_z, S, s_zz; columns per unit S and s_zz at the surface.
    antiplane : array (2, ...)
        Rows k u_t and s_tz per unit s_tz at the surface.
    direction : array (..., 2)

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.elastic import from_radial
    >>> in_plane = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 0.0], [0.0, 1.0]])
    >>> states = from_radial(in_plane, np.array([2.0, 1.0]), np.array([1.0, 0.0]))  # wavevector along x
    >>> states.shape, states[0, 0].real.item(), states[1, 1].real.item()  # k u_x is along, k u_y across
    ((6, 3), 1.0, 2.0)
    """
    cos, sin = direction[..., 0], direction[..., 1]
    out = np.empty((*np.shape(in_plane)[2:], 6, 3), dtype=np.complex128)
    for vector, (along, upward, across) in enumerate(((0, 1, antiplane[0]), (2, 3, antiplane[1]))):
        part = out[..., 3 * vector : 3 * vector + 3, :]
        radial = in_plane[along, 0]
        part[..., 0, 0] = cos**2 * radial + sin**2 * across
        part[..., 1, 1] = sin**2 * radial + cos**2 * across
        part[..., 0, 1] = part[..., 1, 0] = cos * sin * (radial - across)
        part[..., 0, 2] = 1j * cos * in_plane[along, 1]
        part[..., 1, 2] = 1j * sin * in_plane[along, 1]
        part[..., 2, 0] = -1j * cos * in_plane[upward, 0]
        part[..., 2, 1] = -1j * sin * in_plane[upward, 0]
        part[..., 2, 2] = in_plane[upward, 1]
    return out


def decaying_states(shear_modulus: float, poissons_ratio: float, kz: Floats) -> Floats:
    """(4, 2, ...): rows k U, k u_z, S, N of the waves that decay with depth; columns per unit S0 and N0 at kz = 0."""
    mu, nu = shear_modulus, poissons_ratio
    decay = np.exp(-kz)
    g, b = (1.0 - nu) / (2.0 * mu), nu / (1.0 - nu)
    out = np.empty((4, 2, *kz.shape))
    for column, (s0, n0) in enumerate(((1.0, 0.0), (0.0, 1.0))):  # C = S0 + N0 = 1 in both
        constant, slope = s0 + 1.0 - b * n0, -(1.0 + b)
        shear = s0 - kz
        out[0, column] = g * (constant + slope * kz) * decay
        out[1, column] = (g * (constant - slope + slope * kz) - shear / mu) * decay
        out[2, column] = shear * decay
        out[3, column] = (n0 + kz) * decay
    return out
