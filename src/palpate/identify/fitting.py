"""Fit round contacts to readings: places and radii by Gauss-Newton, forces and offsets by least squares in each step
(variable projection).

See G. H. Golub, V. Pereyra, SIAM Journal on Numerical Analysis 10, 1973, 413-432, with Kaufman's derivative. The
likelihood is Gaussian with the noise of each reading. The interval of a radius is that of its profile likelihood:
radii below the blur of the pad give the same readings, and the profile then has no lower end.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.special

from palpate.elastic.pad import Floats
from palpate.identify.shapes import Shapes

__all__ = ["Data", "Fit", "columns_of", "fit", "fit_of", "profile"]

#: Largest number of Gauss-Newton steps, and the decrease of the sum of squares below which they stop.
STEPS, ENOUGH = 40, 1e-3
#: Largest change in one step of the fit: of a position, as a fraction of depth plus radius; of a radius, as a factor.
FAR, FACTOR = 0.7, 1.6
#: Largest number of steps to either end of a profile.
TO_END = 14
#: Step of the log of a radius for finite differences.
STEP_LOG = 0.04


@dataclass(frozen=True)
class Data:
    """One frame: readings divided by their noise, the noise, and columns (n, reading) of nuisance effects."""

    values: Floats
    weights: Floats
    others: Floats

    @property
    def count(self) -> int:
        """Number of readings with a weight above zero."""
        return int((self.weights > 0).sum())


@dataclass(frozen=True)
class Fit:
    """The contacts that explain a frame best.

    ``centers`` (contact, 2), ``radii`` (contact,), ``forces`` (contact, component). ``squares`` is the sum of squared
    residuals divided by their noise. ``covariance`` is that of centres and log radii (x, y, log a of each contact),
    followed by forces and offsets, in order.
    """

    shape: str
    centers: Floats
    radii: Floats
    forces: Floats
    others: Floats
    squares: float
    freedom: int
    covariance: Floats
    residual: Floats

    @property
    def misfit(self) -> float:
        """Return the probability that noise alone makes a misfit at least this large."""
        return float(scipy.special.chdtrc(self.freedom, self.squares)) if self.freedom > 0 else math.nan

    @property
    def parameters(self) -> int:
        """Number of fitted parameters."""
        return 3 * len(self.radii) + self.forces.size + len(self.others)

    def std(self, which: str, contact: int, item: int = 0) -> float:
        """Return the standard deviation of a "center" (x, y), of the log of a "radius", or of a "force" (component)."""
        k, c = len(self.radii), self.forces.shape[1]
        at = {"center": 3 * contact + item, "radius": 3 * contact + 2, "force": 3 * k + c * contact + item}[which]
        return math.sqrt(max(float(self.covariance[at, at]), 0.0))


def fit(shapes: Shapes, data: Data, shape: str, centers: Floats, radii: Floats, *, held: Sequence[int] = ()) -> Fit:
    """Fit contacts from a start; radii of the contacts ``held`` stay fixed."""
    centers, radii = np.array(centers, dtype=np.float64), np.clip(radii, shapes.smallest, shapes.largest)
    free = _free(len(radii), held)
    damping = 1e-3
    now = _project(shapes, data, shape, centers, radii)
    for _ in range(STEPS):
        slopes = _slopes(shapes, data, shape, centers, radii, now)[free]
        normal = slopes @ slopes.T
        gradient = slopes @ now.residual
        better = None
        while damping < 1e6:
            step = np.zeros(3 * len(radii))
            step[free] = np.linalg.lstsq(
                normal + damping * np.diag(np.diag(normal)) + 1e-12 * np.trace(normal) * np.eye(len(normal)),
                gradient,
                rcond=None,
            )[0]
            moved, grown = _moved(shapes, centers, radii, step.reshape(-1, 3))
            there = _project(shapes, data, shape, moved, grown)
            if there.squares < now.squares:
                better = there
                break
            damping *= 5.0
        if better is None:
            break
        gained = now.squares - better.squares
        centers, radii, now, damping = moved, grown, better, max(damping / 5.0, 1e-6)
        if gained < ENOUGH:
            break
    return _ended(shapes, data, shape, centers, radii, now)


def fit_of(shapes: Shapes, data: Data, found: Fit) -> Fit:
    """Return these contacts with the forces and residuals that they have in ``data``, even if they were fitted to
    other data.
    """
    now = _project(shapes, data, found.shape, found.centers, found.radii)
    return _ended(shapes, data, found.shape, found.centers, found.radii, now)


def profile(shapes: Shapes, data: Data, best: Fit, contact: int, rise: float) -> tuple[float, float, list[Fit]]:
    """Return the radii [m] at which the best fit has squares larger by ``rise``, and the fits on the way; 0 or inf if
    there is no end.
    """
    ends, fits = [], []
    start = min(max(best.std("radius", contact), 0.02), 0.5)
    for sign in (-1.0, 1.0):
        inner, outer = 0.0, math.nan
        step, squares, centers = start * math.sqrt(rise), best.squares, best.centers
        at = 0.0
        for _ in range(TO_END):
            at = inner + step if math.isnan(outer) else 0.5 * (inner + outer)
            radii = best.radii.copy()
            radii[contact] *= math.exp(sign * at)
            ended = radii[contact] <= shapes.smallest or radii[contact] >= shapes.largest
            radii[contact] = min(max(radii[contact], shapes.smallest), shapes.largest)
            found = fit(shapes, data, best.shape, centers, radii, held=(contact,))
            fits.append(found)
            squares, centers = found.squares, found.centers
            if squares - best.squares < rise:
                inner = at
                if ended and math.isnan(outer):
                    inner = math.inf
                    break
            else:
                outer = at
            if outer - inner < 0.05 * outer:
                break
        ends.append(
            float(best.radii[contact]) * math.exp(sign * (inner if math.isnan(outer) else 0.5 * (inner + outer)))
        )
    return ends[0], ends[1], fits


def columns_of(shapes: Shapes, data: Data, best: Fit) -> Floats:
    """Orthonormal rows that span the derivatives of the whitened readings with respect to all parameters of a fit."""
    now = _project(shapes, data, best.shape, best.centers, best.radii)
    slopes = _slopes(shapes, data, best.shape, best.centers, best.radii, now)
    sizes = np.linalg.norm(slopes, axis=1)
    _, values, basis = np.linalg.svd(slopes[sizes > 0] / sizes[sizes > 0, None], full_matrices=False)
    return np.concatenate([now.basis, basis[values > 1e-6]])


# -- one step --------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Projected:
    columns: Floats  # (linear parameter, reading), divided by the noise
    basis: Floats  # orthonormal rows that span them
    linear: Floats
    residual: Floats
    squares: float


def _project(shapes: Shapes, data: Data, shape: str, centers: Floats, radii: Floats) -> _Projected:
    cells = [shapes.traction(shape, c, float(a)) for c, a in zip(centers, radii)]
    columns = shapes.read(cells).reshape(-1, len(data.values)) * data.weights
    columns = np.concatenate([columns, data.others * data.weights])
    sizes = np.linalg.norm(columns, axis=1)
    sizes[sizes == 0] = 1.0
    left, values, basis = np.linalg.svd(columns / sizes[:, None], full_matrices=False)
    keep = values > 1e-10 * values[0]
    linear = (left[:, keep] / values[keep]) @ (basis[keep] @ data.values) / sizes
    residual = data.values - linear @ columns
    return _Projected(columns, basis[keep], linear, residual, float(residual @ residual))


def _slopes(
    shapes: Shapes, data: Data, shape: str, centers: Floats, radii: Floats, now: _Projected, *, projected: bool = True
) -> Floats:
    """Return the derivatives of the whitened readings with respect to x, y and log radius of each contact (3 per contact,
    reading); with ``projected`` without the part that forces and offsets can explain.
    """
    cells = []
    steps = []
    for center, radius in zip(centers, radii):
        h, grow = shapes.step(float(radius)), STEP_LOG
        for axis in range(2):
            move = np.zeros(2)
            move[axis] = h
            cells.append(
                shapes.traction(shape, center + move, float(radius))
                - shapes.traction(shape, center - move, float(radius))
            )
            steps.append(2.0 * h)
        cells.append(
            shapes.traction(shape, center, float(radius * math.exp(grow)))
            - shapes.traction(shape, center, float(radius * math.exp(-grow)))
        )
        steps.append(2.0 * grow)
    k, c = len(radii), len(shapes.components)
    forces = now.linear[: k * c].reshape(k, c)
    read = shapes.read(cells)
    out = np.einsum("pcr,pc->pr", read, np.repeat(forces, 3, axis=0)) * data.weights / np.array(steps)[:, None]
    return out - (out @ now.basis.T) @ now.basis if projected else out


def _free(count: int, held: Sequence[int]) -> npt.NDArray[np.bool_]:
    free = np.ones(3 * count, dtype=bool)
    free[[3 * i + 2 for i in held]] = False
    return free


def _moved(shapes: Shapes, centers: Floats, radii: Floats, step: Floats) -> tuple[Floats, Floats]:
    reach = FAR * (shapes.depth + radii)[:, None]
    grown = radii * np.exp(np.clip(step[:, 2], -math.log(FACTOR), math.log(FACTOR)))
    low, high = shapes.bounds
    moved = np.clip(centers + np.clip(step[:, :2], -reach, reach), low, high)
    return moved, np.clip(grown, shapes.smallest, shapes.largest)


def _ended(shapes: Shapes, data: Data, shape: str, centers: Floats, radii: Floats, now: _Projected) -> Fit:
    k, c = len(radii), len(shapes.components)
    slopes = _slopes(shapes, data, shape, centers, radii, now, projected=False)
    every = np.concatenate([slopes, now.columns])
    sizes = np.linalg.norm(every, axis=1)
    sizes[sizes == 0] = 1.0
    scaled = every / sizes[:, None]
    covariance = np.linalg.pinv(scaled @ scaled.T, rcond=1e-12, hermitian=True) / np.outer(sizes, sizes)
    forces = now.linear[: k * c].reshape(k, c)
    return Fit(
        shape,
        centers,
        radii,
        forces,
        now.linear[k * c :],
        now.squares,
        data.count - 3 * k - len(now.linear),
        covariance,
        now.residual,
    )
