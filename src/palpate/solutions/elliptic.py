"""Hertz contact of bodies with different curvatures in two directions: the contact area is an ellipse."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput

__all__ = ["hertz_ellipse"]

#: Number of steps and smallest ratio b/a for which the ratio of curvatures is tabulated. A more slender contact counts
#: as a line.
STEPS, SLENDER = 4000, 1e-4


@lru_cache(maxsize=1)
def _table() -> tuple[Floats, Floats, Floats]:
    """Return log(b/a), the log of the ratio of curvatures A/B, and (K - E)/e^2, for decreasing b/a."""
    from scipy.special import ellipe, ellipkm1

    ratio = np.exp(np.linspace(0.0, np.log(SLENDER), STEPS))
    square = 1.0 - ratio**2  # e^2
    with np.errstate(invalid="ignore", divide="ignore"):
        k, e = ellipkm1(ratio**2), ellipe(square)
        along = (k - e) / square
        across = (e / ratio**2 - k) / square
    # near a circle both differences vanish: (K - E)/e^2 = pi/4 (1 + 3/8 e^2 + ...), and the other pi/4 (1 + 9/8 e^2 + ...)
    near = square < 1e-5
    along[near] = 0.25 * np.pi * (1.0 + 0.375 * square[near])
    across[near] = 0.25 * np.pi * (1.0 + 1.125 * square[near])
    return np.log(ratio), np.log(along / across), along


def hertz_ellipse(
    curvatures: npt.ArrayLike, force: npt.ArrayLike, modulus: npt.ArrayLike
) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """Semi-axes (a, b) [m] of the ellipse in which two smooth bodies touch.

    With relative curvatures 1/R1 <= 1/R2 (each the sum of both bodies' in that direction), A = 1/(2 R1), B = 1/(2 R2), e^2 = 1 - b^2/a^2 and complete
    elliptic integrals K and E of e,

        A/B = (K - E) / ((a^2/b^2) E - K),     a^3 = 3 P (K - E) / (2 pi E* e^2 A),

    and the pressure is 3P/(2 pi a b) sqrt(1 - x^2/a^2 - y^2/b^2), x along the lesser curvature (K. L. Johnson, Contact Mechanics, 1985, section 4.2).

    Parameters
    ----------
    curvatures : array (..., 2)
        Principal relative curvatures [1/m], the lesser first; both positive.
    force : array (...)
        Normal force P [N].
    modulus : array (...)
        1/E* = (1 - nu1^2)/E1 + (1 - nu2^2)/E2 [Pa]; of a pad under a rigid body E/(1 - nu^2).

    Returns
    -------
    a, b : arrays (...)
        Semi-axes along the lesser and the greater curvature; 0 if there is no force.

    Raises
    ------
    InvalidInput
        Curvatures that are not positive, or a negative force.

    Notes
    -----
    Below a ratio of curvatures of some 1e-7 (b/a = 1e-4) the contact is a line: use `hertz_contact_half_width`.

    Examples
    --------
    >>> from palpate import solutions
    >>> a, b = solutions.hertz_ellipse([100.0, 100.0], 1.0, 4e5)  # a ball of 10 mm radius: a^3 = 3 P R/(4 E*)
    >>> round(float(a), 6), round(float(b), 6)
    (0.002657, 0.002657)

    >>> a, b = solutions.hertz_ellipse([50.0, 200.0], 1.0, 4e5)
    >>> round(float(a), 6), round(float(b), 6)
    (0.004096, 0.001638)
    """
    c = np.asarray(curvatures, dtype=np.float64)
    p, e = np.asarray(force, dtype=np.float64), np.asarray(modulus, dtype=np.float64)
    if c.shape[-1:] != (2,) or not ((c[..., 0] > 0) & (c[..., 0] <= c[..., 1]) & np.isfinite(c[..., 1])).all():
        raise InvalidInput(
            "curvatures must be positive, finite and rising along the last axis of length 2: the lesser curvature [1/m] and the greater one."
        )
    if not (p >= 0).all() or not (e > 0).all():
        raise InvalidInput("force must not be negative [N], and modulus must be positive [Pa].")
    log_ratio, log_curvatures, along = _table()
    asked = np.log(c[..., 0] / c[..., 1])
    # the table decreases, but interpolation needs increasing values
    ratio = np.exp(np.interp(asked, log_curvatures[::-1], log_ratio[::-1]))
    shape = np.interp(asked, log_curvatures[::-1], along[::-1])
    a = np.cbrt(3.0 * p * shape / (np.pi * e * c[..., 0]))
    return a, ratio * a
