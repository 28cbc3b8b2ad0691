"""The paper's sections 2 and 3.1 in the continuum, and every equation with the function that computes it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.elastic.quantities import transfer
from palpate.errors import InvalidInput
from palpate.paper.cases import PAD
from palpate.solutions.line import line_load

__all__ = [
    "EQUATIONS",
    "Equation",
    "hooke",
    "inverse_transform",
    "kernel_transforms",
    "kernels",
    "line_force",
    "plane_strain",
]


class Equation(NamedTuple):
    """One equation of the paper: its number, its meaning in our words, and the dotted names of what computes it."""

    number: str
    content: str
    functions: tuple[str, ...]


def line_force(y: npt.ArrayLike, depth: float, *, vertical: float, tangential: float = 0.0) -> Floats:
    """Stress (s_zz, s_xx, s_xz) at (y, depth) under a line force: equations 1 to 3.

        s_ij = (2/pi) x_i x_j (z F_v + x F_t) / (x^2 + z^2)^2

    Parameters
    ----------
    y : array_like
        Distance along the surface (our x).
    depth : float
        Depth (the paper's x), positive.
    vertical, tangential : float
        Force per length.

    Returns
    -------
    array (3, ...)
    """
    channels = ["stress_zz", "stress_xx", "stress_xz"]
    parts = [
        line_load(force=f, component=c).fields(PAD, channels, y, depth) for f, c in ((vertical, "z"), (tangential, "x"))
    ]
    return parts[0] + parts[1]


def kernels(channel: str, depth: float, y: npt.ArrayLike) -> tuple[Floats, Floats]:
    """K1 and K2 of equation 4 (channel "stress_zz") or 8 ("strain_zz"): the reading of a unit vertical and tangential line force.

    stress:  K1 = 2 z^3 / (pi r^4)               K2 = 2 z^2 y / (pi r^4)             r^2 = y^2 + z^2
    strain:  K1 = 3 z (z^2 - y^2) / (2 pi E r^4)  K2 = 3 y (z^2 - y^2) / (2 pi E r^4)  (nu = 0.5)
    """
    return (
        line_load(force=1.0, component="z").fields(PAD, [channel], y, depth)[0],
        line_load(force=1.0, component="x").fields(PAD, [channel], y, depth)[0],
    )


def hooke(stress: npt.ArrayLike, *, youngs_modulus: float, poissons_ratio: float) -> Floats:
    """The three normal strains of the three normal stresses, (3, ...): equation 5, e_i = (s_i - nu (s_j + s_k)) / E."""
    s: Floats = np.asarray(stress, dtype=np.float64)
    if s.ndim == 0 or s.shape[0] != 3:
        raise InvalidInput(f"stress must hold three normal stresses first, shape (3, ...); got shape {s.shape}.")
    return ((1.0 + poissons_ratio) * s - poissons_ratio * s.sum(axis=0)) / youngs_modulus


def plane_strain(
    stress_zz: npt.ArrayLike, stress_xx: npt.ArrayLike, *, youngs_modulus: float, poissons_ratio: float
) -> tuple[Floats, Floats]:
    """Normal strains (e_zz, e_xx) without strain along the line of contact: equation 6.

    There the stress along the line is nu (s_zz + s_xx).
    """
    zz, xx = (np.asarray(s, dtype=np.float64) for s in (stress_zz, stress_xx))
    along = poissons_ratio * (zz + xx)
    e = hooke(np.stack([zz, xx, along]), youngs_modulus=youngs_modulus, poissons_ratio=poissons_ratio)
    return e[0], e[1]


def kernel_transforms(channel: str, depth: float, omega: npt.ArrayLike) -> npt.NDArray[np.complex128]:
    """Fourier transforms of K1 and K2, (2, ...), by which equation 11 multiplies.

    stress:  K1 = (1 + |w| z) exp(-|w| z)      strain (nu = 0.5):  K1 = 1.5 |w| z exp(-|w| z) / E
    """
    w: Floats = np.asarray(omega, dtype=np.float64)
    matrix = transfer(PAD, w, 0.0, depth, [channel], line=True)
    return np.stack([matrix[..., 0, 2], matrix[..., 0, 0]])


def inverse_transform(reading: npt.ArrayLike, channel: str, depth: float, omega: Floats, y: npt.ArrayLike) -> Floats:
    """Pressure at ``y`` whose reading has the transform ``reading`` at ``omega``: equation 12.

        F(y) = (1/2 pi) int g(w) / K1(w) exp(i w y) dw

    by the trapezoidal rule; ``omega`` must be evenly spaced without 0 if K1 vanishes there.
    """
    ratio = np.asarray(reading) / kernel_transforms(channel, depth, omega)[0]
    waves = np.exp(1j * np.multiply.outer(np.asarray(y, dtype=np.float64), omega))
    return np.asarray(np.trapezoid(ratio * waves, omega, axis=-1).real / (2 * np.pi))


_CASES, _FORMULAS, _ALGORITHM = "palpate.paper.cases", "palpate.paper.formulas", "palpate.paper.algorithm"

#: Equations 1 to 26, in the paper's numbering.
EQUATIONS: tuple[Equation, ...] = (
    Equation("1–3", "stress under an inclined line force, and its parts", (f"{_FORMULAS}.line_force",)),
    Equation("4", "stress at depth: K1 and K2 superposed", (f"{_FORMULAS}.kernels", "palpate.skin.Skin.sense")),
    Equation("5", "Hooke's law", (f"{_FORMULAS}.hooke",)),
    Equation("6", "the same in plane strain", (f"{_FORMULAS}.plane_strain",)),
    Equation("7", "stress from two strains (not at ν = 0.5)", ("palpate.elastic.hooke.stress_from_strains",)),
    Equation("8", "strain at depth: K1 and K2 superposed", (f"{_FORMULAS}.kernels", "palpate.skin.Skin.sense")),
    Equation("9", "either, in one form", ("palpate.sensing.operator.Operator.forward",)),
    Equation("10", "without shear: a convolution", (f"{_CASES}.punch", "palpate.sensing.operator.Operator.forward")),
    Equation(
        "11", "in transforms: a product", (f"{_FORMULAS}.kernel_transforms", "palpate.elastic.quantities.transfer")
    ),
    Equation("12", "its inverse: a division", (f"{_FORMULAS}.inverse_transform",)),
    Equation(
        "13–15",
        "the same on samples, and cut to the array",
        ("palpate.sensing.operator.sampled_kernel", f"{_CASES}.sense"),
    ),
    Equation("16", "discrete transforms: a product", (f"{_ALGORITHM}.transform",)),
    Equation("17", "discrete division", (f"{_ALGORITHM}.divide", "palpate.inverse.paper.division.DivisionEstimator")),
    Equation("18", "constant shear from friction", (f"{_ALGORITHM}.constant_shear",)),
    Equation("19–20", "readings with friction, and on samples", (f"{_CASES}.sliding_punch", f"{_CASES}.sense")),
    Equation("21", "net pressure: transforms at 0", (f"{_ALGORITHM}.net_pressure",)),
    Equation("22", "the shear on samples", (f"{_ALGORITHM}.constant_shear",)),
    Equation("23", "the shear's reading taken out", (f"{_ALGORITHM}.without_shear",)),
    Equation("24", "what is left, solved as without friction", (f"{_ALGORITHM}.divide",)),
    Equation("25", "even part, and half-width M", (f"{_ALGORITHM}.even_part", f"{_ALGORITHM}.half_width")),
    Equation("26", "mean absolute error", (f"{_CASES}.mean_error",)),
)
