"""The elastic half-space, one wavenumber at a time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from palpate.errors import InvalidInput

__all__ = ["HalfSpace", "Pad", "States", "check_material", "decaying_states"]

Floats = npt.NDArray[np.floating[Any]]


@dataclass(frozen=True)
class States:
    """Fields of one wavenumber at one depth, per unit surface value.

    In the frame of the wavevector (r along it, t across it, z into the pad) write u_r = i U and s_rz = i S.
    Then the six states (U, u_z, S, N = s_zz; u_t, T = s_tz) are real linear functions of the surface values
    (S0, N0) and T0. Displacements are stored times k, which keeps them finite as k tends to 0.

    Attributes
    ----------
    in_plane : array (4, 2, ...)
        Rows k U, k u_z [Pa/Pa times 1/modulus], S, N [Pa/Pa]; columns per unit S0 and N0.
    antiplane : array (2, ...)
        Rows k u_t and T per unit T0.
    """

    in_plane: Floats
    antiplane: Floats


@runtime_checkable
class Pad(Protocol):
    """What the rest of the code asks of an elastic body."""

    def states(self, wavenumber: Floats, depth: float) -> States:
        """States at ``depth`` [m] for wavenumbers > 0 [rad/m]."""
        ...

    def material(self, depth: float) -> tuple[float, float]:
        """Shear modulus [Pa] and Poisson's ratio at ``depth`` [m]."""
        ...

    def mean_compliance(self, depth: float) -> tuple[float, float] | None:
        """Displacement at ``depth`` per unit mean shear and pressure [m/Pa]; None where it is infinite."""
        ...


def check_material(youngs_modulus: float, poissons_ratio: float) -> None:
    """Raise `InvalidInput` unless the constants are those of a stable isotropic solid with 0 <= nu <= 0.5."""
    if not (isinstance(youngs_modulus, int | float) and math.isfinite(youngs_modulus) and youngs_modulus > 0):
        raise InvalidInput(
            f"youngs_modulus must be a positive, finite number of pascals; got {youngs_modulus!r}. "
            "A soft silicone is about 1e5 to 2e6 Pa."
        )
    if not (isinstance(poissons_ratio, int | float) and 0.0 <= poissons_ratio <= 0.5):
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

    Notes
    -----
    With mu = E/(2(1+nu)), surface values S0, N0 and C = S0 + N0, the field that dies out with depth is

        N = [N0 + kz C] e^{-kz},        S = [S0 - kz C] e^{-kz},        T = T0 e^{-kz},
        k U   = (1-nu)/(2 mu) [S0 + (1 - kz) C - b (N0 + kz C)] e^{-kz},    b = nu/(1-nu),
        k u_z = -d(k U)/d(kz) - S/mu,     k u_t = T/mu

    (the decaying solutions of the plane-strain equations; see K. L. Johnson, Contact Mechanics, 1985, ch. 2).
    """

    youngs_modulus: float
    poissons_ratio: float

    def __post_init__(self) -> None:
        check_material(self.youngs_modulus, self.poissons_ratio)

    @property
    def shear_modulus(self) -> float:
        """mu = E / (2 (1 + nu)) [Pa]."""
        return self.youngs_modulus / (2.0 * (1.0 + self.poissons_ratio))

    def material(self, depth: float) -> tuple[float, float]:
        """Shear modulus [Pa] and Poisson's ratio, the same at every depth."""
        return self.shear_modulus, self.poissons_ratio

    def states(self, wavenumber: Floats, depth: float) -> States:
        """States at ``depth`` [m] per unit surface value; ``wavenumber`` [rad/m] of any shape, >= 0."""
        kz = np.asarray(wavenumber, dtype=np.float64) * depth
        decay = np.exp(-kz)
        in_plane = decaying_states(self.shear_modulus, self.poissons_ratio, kz)
        return States(in_plane, np.stack([decay / self.shear_modulus, decay]))

    def mean_compliance(self, depth: float) -> tuple[float, float] | None:
        """None: the displacement of a half-space under a mean traction has no finite value."""
        return None


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
