"""How the colour of a lit coating changes with the slope of the surface: a polynomial in slope and place, fitted and
inverted.

A gel that is lit from its sides in several colours shows each slope in a different colour (M. K. Johnson, E. H.
Adelson, CVPR 2009). With c_k the relative change of channel k from the gel at rest and g = (du_z/dx, du_z/dy):

    c_k(g, x) = sum over m of phi_m(g) sum over b of B_b(x) beta_kmb

phi are monomials, of degree 1 and more, of the horizontal part of the unit normal, g / sqrt(1 + g^2), because the
brightness of a dull coating is linear in the normal (R. J. Woodham, Opt. Eng. 19, 1980); zero slope gives zero change.
B are functions of the place (`bases`): the place itself, and the fraction of each colour in the light at rest, which
depends on the lamps. The fit is from slope to colour, with exact slopes and noisy colours, like the camera; a
regression from colour to slope would shrink steep slopes towards zero. Three colours determine two slopes, and the
third direction tests whether a pixel fits the model.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats

__all__ = ["Response", "bases", "ranks", "solve_slopes"]

#: Largest slope in the search relative to the steepest learned one: a polynomial is meaningless far outside its data.
SLOPE_MARGIN = 1.15
#: Gauss-Newton steps: colours are mildly nonlinear in slopes, and eight steps reach single precision.
STEPS = 8
#: Degrees of the bases, and the blur of the light at rest [blocks].
BASE_DEGREES = (0, 1, 1, 2, 2, 2, 1, 1, 2, 2, 2)
SMOOTH = 5.0


def monomials(degree: int, first: int) -> list[tuple[int, int]]:
    """Exponents (of x, of y) of all monomials of degree ``first`` to ``degree``."""
    return [(n - i, i) for n in range(first, degree + 1) for i in range(n + 1)]


def bases(scaled: Floats, rest: Floats) -> Floats:
    """B of every pixel (row, column, term), from places (2, row, column) scaled to -1 to 1 and the gel at rest (row,
    column, 3); `BASE_DEGREES` are their degrees.
    """
    from scipy.ndimage import gaussian_filter

    x, y = scaled
    smooth = np.stack([gaussian_filter(v, SMOOTH) for v in np.moveaxis(rest, -1, 0)]) + 1e-3
    # the third fraction follows from two
    a, b, _ = 3.0 * smooth / smooth.sum(axis=0) - 1.0
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y, a, b, a * a, a * b, b * b], axis=-1)


def ranks(degree: int) -> tuple[Floats, Floats]:
    """Degrees above 1 of each coefficient (term, place term) in the normal, and degrees in the place, for the ridge
    penalty.
    """
    terms = np.array([a + b - 1.0 for a, b in monomials(degree, 1)])
    normal, place = np.meshgrid(terms, np.array(BASE_DEGREES, dtype=np.float64), indexing="ij")
    return normal, place


def _tilts(slopes: Floats) -> Floats:
    """The horizontal part (n, 2) of the unit normal: g / sqrt(1 + g^2)."""
    return np.asarray(slopes / np.sqrt(1.0 + (slopes**2).sum(axis=-1, keepdims=True)))


def _powers(values: Floats, exponents: list[tuple[int, int]]) -> Floats:
    """Monomials (n, term) of pairs (n, 2)."""
    return np.stack([values[:, 0] ** a * values[:, 1] ** b for a, b in exponents], axis=-1)


@dataclass(frozen=True, eq=False)
class Response:
    """A fitted polynomial: ``coefficients`` (channel, term, place term) of monomials of the slopes divided by
    ``steepest``, up to a ``degree``, times `bases`.
    """

    coefficients: Floats
    degree: int
    steepest: float

    def features(self, slopes: Floats, base: Floats) -> Floats:
        """Columns (n, term * place term) of the linear model, for slopes (n, 2) and bases (n, place term)."""
        phi = _powers(_tilts(slopes) / self.steepest, monomials(self.degree, 1))
        return (phi[:, :, None] * base[:, None, :]).reshape(len(slopes), -1)

    def local(self, base: Floats) -> Floats:
        """Coefficients (n, channel, term) at places."""
        return np.einsum("kmb,nb->nkm", self.coefficients, base)

    def change(self, slopes: Floats, base: Floats) -> Floats:
        """Colour changes (n, channel)."""
        phi = _powers(_tilts(slopes) / self.steepest, monomials(self.degree, 1))
        return np.einsum("nkm,nm->nk", self.local(base), phi)

    def derivative(self, slopes: Floats, local: Floats) -> tuple[Floats, Floats]:
        """Colour changes (n, channel) and their derivative by slope (n, channel, 2), with the coefficients at each place."""
        exponents = monomials(self.degree, 1)
        x, y = (_tilts(slopes) / self.steepest).T
        phi = np.empty((len(x), len(exponents)))
        dx, dy = np.zeros_like(phi), np.zeros_like(phi)
        for m, (a, b) in enumerate(exponents):
            phi[:, m] = x**a * y**b
            if a:
                dx[:, m] = a * x ** (a - 1) * y**b
            if b:
                dy[:, m] = b * x**a * y ** (b - 1)
        value = np.einsum("nkm,nm->nk", local, phi)
        by = np.stack([np.einsum("nkm,nm->nk", local, d) for d in (dx, dy)], axis=-1) / self.steepest
        # d tilt / d slope = (1 - t t) / sqrt(1 + g^2)
        tilt = _tilts(slopes)
        turned = by - (by * tilt[:, None, :]).sum(axis=-1, keepdims=True) * tilt[:, None, :]
        return value, turned / np.sqrt(1.0 + (slopes**2).sum(axis=-1))[:, None, None]


def solve_slopes(
    response: Response, change: Floats, base: Floats, covariance: Floats, *, steps: int = STEPS
) -> tuple[Floats, Floats, Floats, Floats]:
    """Slopes with the best fit to colour changes, pixel by pixel.

    ``change`` (n, channel), ``base`` (n, place term), ``covariance`` (channel, channel) of the noise. The prior of
    slopes is normal about zero with the steepest learned slope as standard deviation, which only matters where the
    colours hardly determine them.

    Returns slopes (n, 2), their covariance (n, 2, 2), the misfit (n,), chi-squared with one degree of freedom if the
    model holds, and the derivative (n, channel, 2).
    """
    local = response.local(base)
    weight = np.linalg.inv(covariance)
    prior = np.eye(2) / response.steepest**2
    limit = SLOPE_MARGIN * response.steepest
    slopes = np.zeros((len(change), 2))
    damping = np.full(len(change), 1e-3)
    value, by = response.derivative(slopes, local)
    cost = _cost(change - value, weight, slopes, prior)
    for _ in range(steps):
        normal = np.einsum("nki,kl,nlj->nij", by, weight, by) + prior
        right = np.einsum("nki,kl,nl->ni", by, weight, change - value) - slopes @ prior
        eased = normal + damping[:, None, None] * np.einsum("nii->n", normal)[:, None, None] * np.eye(2)
        trial = slopes + np.linalg.solve(eased, right[..., None])[..., 0]
        size = np.hypot(*trial.T)
        trial *= np.minimum(1.0, limit / np.maximum(size, 1e-300))[:, None]
        new_value, new_by = response.derivative(trial, local)
        new_cost = _cost(change - new_value, weight, trial, prior)
        better = new_cost < cost
        slopes = np.where(better[:, None], trial, slopes)
        value = np.where(better[:, None], new_value, value)
        by = np.where(better[:, None, None], new_by, by)
        cost = np.where(better, new_cost, cost)
        damping = np.where(better, 0.2 * damping, 10.0 * damping)
    normal = np.einsum("nki,kl,nlj->nij", by, weight, by) + prior
    residual = change - value
    misfit = np.einsum("nk,kl,nl->n", residual, weight, residual)
    return slopes, np.linalg.inv(normal), misfit, by


def _cost(residual: Floats, weight: Floats, slopes: Floats, prior: Floats) -> npt.NDArray[Any]:
    return np.asarray(
        np.einsum("nk,kl,nl->n", residual, weight, residual) + np.einsum("ni,ij,nj->n", slopes, prior, slopes)
    )
