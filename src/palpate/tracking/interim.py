"""Error bars of a frame for which none are computed yet, and of one whose iteration did not converge.

Both use the inverse that the iteration keeps, for traction without constraints (`palpate.tracking.iteration`),

    cov = s^2 (H + rho)^-1,        convergence error = (H + rho)^-1 r,

where r = H z - h + rho u is the residual of the optimality conditions, and -rho u is the force of the constraints.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from palpate.elastic.pad import Floats
from palpate.inverse.contact.constrained import ConstrainedEstimator
from palpate.inverse.estimate import Errors
from palpate.tracking.health import Index
from palpate.tracking.iteration import Iteration
from palpate.tracking.region import on_surface

__all__ = ["Interim", "wider"]

#: Standard deviations that an estimated convergence error counts for: it is damped by rho and ignores changes of the
#: active constraints. Of 241 frames with one iteration each and faults of every kind, none had its force outside the 95
#: % interval.
COUNTS = 3.0


class Interim:
    """Errors of the traction on a region's cells, from the inverse that the iteration keeps."""

    def __init__(self, estimator: ConstrainedEstimator) -> None:
        self._estimator = estimator
        grid = estimator.operator.surface
        rows = np.concatenate([grid.force_rows(estimator.columns), grid.moment_rows(estimator.columns)])
        #: Net force and moment as sums of traction (quantity, component, cell of the surface).
        self._sums = rows.reshape(*rows.shape[:2], -1) * estimator.inside.ravel()

    def errors(self, solution: Iteration, noise: float) -> Errors | None:
        """Errors of a contact until others are computed; None without contact."""
        region, estimator, scales = solution.region, self._estimator, self._estimator.cone.scales
        if region is None:
            return None
        grid, columns = estimator.operator.surface, list(estimator.columns)
        c, n = len(columns), len(region.cells)
        rows, center, top = self._rows(solution, region.cells)
        scaled = (rows * scales[None, :, None]).reshape(len(rows), c * n).astype(region.inverse.dtype)
        variance = noise**2 * np.einsum("ij,ij->i", scaled @ region.inverse, scaled, dtype=np.float64)
        std = np.sqrt(np.maximum(variance, 0.0))
        square = np.maximum(np.diagonal(region.inverse).reshape(c, n).astype(np.float64), 0.0)
        each = noise * np.sqrt(square) * scales[:, None]
        traction = on_surface(estimator, region.cells, solution.traction)
        force = np.zeros(len(grid.components))
        force[columns] = std[:c]
        return Errors(
            traction=on_surface(estimator, region.cells, each),
            force=force,
            moment=std[c : len(rows) - center],
            center=std[len(rows) - center :],
            peak=np.asarray(each[-1, top]),
            variance_reduction=np.full_like(traction, math.nan),
            **estimator.posterior.outside_parts(traction),
        )

    def unconverged(self, solution: Iteration, errors: Errors) -> Errors:
        """Errors that include how far the iteration was from convergence."""
        region, change, estimator = solution.region, solution.unconverged_change, self._estimator
        if region is None or change is None:
            return errors
        rows, center, _ = self._rows(solution, region.cells)
        grid = estimator.operator.surface
        moved = COUNTS * np.abs(rows.reshape(len(rows), -1) @ change.ravel())
        traction = errors.traction.reshape(len(errors.traction), -1).copy()
        place = np.asarray(estimator.columns)[:, None], region.cells[None, :]
        traction[place] = np.hypot(traction[place], COUNTS * np.abs(change))
        force = errors.force.copy()
        axes = list(grid.force_axes(estimator.columns))
        force[axes] = np.hypot(force[axes], moved[: len(axes)])
        return replace(
            errors,
            traction=traction.reshape(errors.traction.shape),
            force=force,
            moment=np.hypot(errors.moment, moved[len(axes) : len(rows) - center]),
            center=np.hypot(errors.center, moved[len(rows) - center :]),
            peak=np.asarray(np.hypot(errors.peak, COUNTS * float(np.abs(change[-1]).max(initial=0.0)))),
        )

    def _rows(self, solution: Iteration, cells: Index) -> tuple[Floats, int, int]:
        """Net force, moment and centre of pressure as sums of traction (quantity, component, cell); the number of rows
        for the centre; the cell of the peak.
        """
        grid, traction = self._estimator.operator.surface, solution.traction
        kept = self._estimator.inside.ravel()[cells]
        axes = [axis[p] for axis, p in zip(grid.axes, np.unravel_index(cells, grid.shape))][::-1]  # x, then y
        p = traction[-1] * kept
        total = float(p.sum()) or 1.0
        center = np.zeros((len(axes), *traction.shape))
        for i, x in enumerate(axes):
            center[i, -1] = kept * (x - float((x * p).sum()) / total) / total
        return np.concatenate([self._sums[..., cells], center]), len(axes), int(np.argmax(p))


def wider(one: Errors | None, other: Errors | None) -> Errors | None:
    """The larger of two errors, number by number."""
    if one is None or other is None:
        return other if one is None else one
    return Errors.gathered([one, other], lambda both: np.fmax(*both))
