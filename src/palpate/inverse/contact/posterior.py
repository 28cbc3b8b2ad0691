"""Posterior of a frame from its contact models: mean, closed-form errors of every quantity, and samples."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.inverse.constrained.cone import TOLERANCE, Cone, minimise
from palpate.inverse.constrained.factors import Bordered, cholesky
from palpate.inverse.constrained.model import ContactModel, dilated, scattered
from palpate.inverse.constrained.products import AT_SIZE, Products
from palpate.inverse.contact.policy import Policy
from palpate.inverse.estimate import Errors
from palpate.inverse.linear.whitening import Readings
from palpate.sensing.grids import block_means
from palpate.sensing.operator import Operator

__all__ = ["Posterior", "ambiguity_of"]

Flags = npt.NDArray[np.bool_]
Index = npt.NDArray[np.intp]


def ambiguity_of(acting: Floats, usual: float, policy: Policy, *, coupled: bool) -> tuple[float, float, float, float]:
    """Minimum errors (`Posterior`) if channels cannot separate pressure from shear.

    ``acting`` is the effect of pressure relative to that of equal shear, at several wavelengths; ``usual`` is the
    value at which pressure is as well determined as inside a gel; ``coupled``: friction is given.
    """
    normal = (policy.errors.ambiguous_coupled if coupled else policy.errors.ambiguous_force) * max(
        1.0, usual / max(float(np.median(acting)), 1e-3)
    )
    peak = policy.errors.ambiguous_peak * max(
        1.0 / max(float(np.min(acting)), 1e-3) - 1.0 / policy.errors.ambiguous_shape, 0.0
    )
    peak = (0.5 if coupled else 1.0) * min(peak, policy.errors.most_ambiguous)
    return policy.errors.ambiguous_shear, normal, policy.errors.ambiguous_cells * peak, peak


class Posterior:
    """Posterior of the weighted contact models of a frame: means, closed-form errors, samples.

    ``inside`` marks the cells of the operator's grid that belong to the result, ``outside`` those beyond the outermost
    taxels. ``reach`` is the width in cells of the margin around the contact whose error bars include the uncertainty
    of its edge. ``ambiguity`` holds four minimum errors: of the shear force and of the normal force, as fractions of
    the normal force; of the pressure in a cell and of the peak, as fractions of these.
    """

    def __init__(
        self,
        operator: Operator,
        columns: Sequence[int],
        cone: Cone,
        inside: Flags,
        outside: Flags,
        reach: int,
        policy: Policy,
        *,
        ambiguity: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0),
    ) -> None:
        self.operator, self.columns, self.cone = operator, tuple(columns), cone
        self.inside, self.outside, self.reach, self.policy = inside, outside, reach, policy
        self.ambiguity = ambiguity
        #: Cells at the outermost taxels, if the surface does not end there.
        self.at_edge = dilated(outside, 1) & ~outside

    def _sizes(self, traction: Floats) -> Floats:
        """Magnitude of the traction (*grid) in the cells of the result."""
        return np.asarray(np.sqrt((traction**2).sum(axis=0)) * self.inside)

    def beyond(self, traction: Floats) -> tuple[float, float, float]:
        """Three fractions. First, the load beyond the outermost taxels over the whole load (sums of magnitudes). Second, the largest traction there over the largest anywhere. Third, the largest traction at the outermost taxels over the largest anywhere (0 if the surface ends there)."""
        size = self._sizes(traction)
        there, largest = size[self.outside], max(float(size.max()), 1e-300)
        return (
            float(there.sum()) / max(float(size.sum()), 1e-300),
            float(there.max(initial=0.0)) / largest,
            float(size[self.at_edge].max(initial=0.0)) / largest,
        )

    def going_on(self, traction: Floats) -> tuple[Floats, Floats]:
        """Possible net force (component,) beyond the outermost taxels, where nothing is measured, and its place
        (axis,); zero if contact does not reach them.

        The traction at the outermost taxels is continued outwards as far as the contact extends inwards: a contact
        symmetric about the edge has as much beyond it.
        """
        policy = self.policy
        grid, at, size = self.operator.surface, self.at_edge, self._sizes(traction)
        loaded = size > policy.extent.faint * max(float(size.max()), 1e-300)
        here = at & loaded
        if not here.any() or float(size[at].max()) < policy.extent.at_edge * float(size.max()):
            return np.zeros(len(traction)), np.zeros(len(grid.shape))
        inwards = float((loaded & ~self.outside).sum()) / float(here.sum())
        force = inwards * grid.total_force(traction * here)
        places = np.meshgrid(*grid.axes, indexing="ij")[::-1]
        return force, np.array([float(np.average(x[here], weights=size[here])) for x in places])

    def outside_parts(self, traction: Floats) -> dict[str, Floats]:
        """The part of the traction (component, *grid), and of each number, that comes from cells beyond the outermost
        taxels.
        """
        grid = self.operator.surface
        cell = grid.areas * self.inside
        places = np.meshgrid(*grid.axes, indexing="ij")[::-1]  # x, then y
        outside = np.abs(traction) * self.outside
        p = cell * traction[-1]
        total = float(p.sum()) or 1.0
        far = cell * traction * self.outside
        there = traction * (self.inside & self.outside)
        center = [((x - (x * p).sum() / total) * far[-1]).sum() / total for x in places]
        top = np.unravel_index(int(np.argmax(p)), p.shape)
        return {
            "outside_traction": outside,
            "outside_force": np.abs(grid.total_force(there)),
            "outside_moment": np.abs(grid.total_moment(there)),
            "outside_center": np.abs(center),
            "outside_peak": np.asarray(outside[-1][top]),
            "beyond_force": np.abs(self.going_on(traction)[0]),
        }

    def undetected(
        self,
        readings: Readings,
        depth: float,
        scale: float,
        *,
        finer: Operator | None = None,
        data: Floats | None = None,
    ) -> Errors:
        """Errors of a frame without contact: the smallest pressure of a patch as wide as the depth that would be
        detected, above a taxel or between taxels.

        ``finer`` is an operator with cells fine enough to separate both places, if the surface's are not. ``data`` are
        the frame's readings: if they support a patch without proving it, the patch may be as large as they suggest.
        """
        grid, names = self.operator.surface, self.operator.surface.components
        shape = (len(names), *grid.shape)
        noise = readings.std * scale
        std, force = np.zeros(shape), np.zeros(len(names))
        operator = finer or self.operator
        every = np.ones(len(noise), dtype=bool)
        slope = None
        if data is not None and (noise > 0).all():
            white = readings.white(readings.white(data / noise, every), every)
            slope = operator.adjoint(readings.planes(white / noise))[list(self.columns)]
        for patch, places in _patches(operator, depth):
            response = operator.columns(self.columns, np.flatnonzero(patch)).sum(axis=2)
            with np.errstate(divide="ignore", invalid="ignore"):
                sharp = np.where(noise[:, None] > 0, response / noise[:, None], np.inf)
            if np.isfinite(sharp).all():
                sharp = readings.white(sharp, every)
            amplitude = 1.0 / np.sqrt((sharp**2).sum(axis=0))
            if slope is not None:
                import scipy.ndimage

                near = np.abs(scipy.ndimage.correlate(slope, _cropped(patch)[None], mode="constant"))
                amplitude = amplitude * (1.0 + 0.5 * amplitude * near[(slice(None), *places)].max(axis=1))
            area = float(operator.surface.areas[patch].sum())
            for i, c in enumerate(self.columns):
                std[c], force[c] = np.maximum(std[c], amplitude[i]), max(force[c], amplitude[i] * area)
        reach = max(float(np.abs(x).max()) for x in grid.axes)
        return Errors(
            std,
            grid.turned_errors(force, np.zeros(shape)),
            np.full(1 if grid.dimensions == 1 else 3, force.max() * reach),
            np.full(grid.dimensions, math.nan),
            np.asarray(std[-1].max()),
            np.full(shape, math.nan),
            **self.outside_parts(np.zeros(shape)),
        )

    def draws(self, members: Sequence[ContactModel], count: int, rng: np.random.Generator) -> Floats:
        """Samples of the traction: each minimises one model with perturbed readings and prior.

        The minimiser of 1/2 x'Hx - (h + H^{1/2} z)'x over the cone is a projection of a Gaussian posterior sample onto
        the cone (J. M. Everink, Y. Dong, M. S. Andersen, SIAM/ASA J. Uncertainty Quantification 11, 2023). So samples
        satisfy the constraints, and cells are empty with finite probability.
        """
        grid = self.operator.surface
        out = np.zeros((count, len(grid.components), *grid.shape))
        weights = np.array([m.weight for m in members])
        picks = rng.choice(len(members), size=count, p=weights / weights.sum())
        for i, member in enumerate(members):
            chosen = np.flatnonzero(picks == i)
            if not len(chosen):
                continue
            products = member.hessian if isinstance(member.hessian, Products) else None
            root = np.zeros((0, 0)) if products is not None else cholesky(member.hessian.dense().copy())
            data, cone, start = member.data, self.cone, member.solution.traction
            if member.ray is not None:
                data, cone, start = data.along(member.ray), Cone(cone.components[-1:]), start[-1:]
            for j in chosen:
                if products is not None:
                    shaken, tolerance = products.perturbed(rng, 1)[0], AT_SIZE
                else:
                    shaken, tolerance = (root @ rng.standard_normal(len(root))).reshape(data.linear.shape), TOLERANCE
                x = minimise(member.hessian, data.linear + shaken, cone, start, tolerance=tolerance).traction
                if member.ray is not None:
                    x = self._turned(member, rng)[:, None] * x
                for k, column in enumerate(self.columns):
                    out[j, column] = block_means(
                        scattered(x[k], member.cells, member.level.grid.shape), member.level.ratio, grid.dimensions
                    )
        return out

    def _turned(self, member: ContactModel, rng: np.random.Generator) -> Floats:
        """A sample of the ratio of traction to pressure of a sliding contact."""
        ray, changes, factor = member.ray, member.changes, member.solution.factor
        if ray is None or changes is None or not isinstance(factor, Bordered):
            raise RuntimeError("only a contact that slides has one traction over pressure")
        count = len(changes)
        if count:
            # Solve with the corner of the factor: this samples the last entries of the Gaussian.
            ray = ray + np.linalg.solve(factor.corner.T, rng.standard_normal(count)) @ changes
        shear = float(np.linalg.norm(ray[:-1]))
        return np.append(ray[:-1] * min(1.0, float(self.cone.friction or shear) / max(shear, 1e-300)), 1.0)


def _patches(operator: Operator, depth: float) -> Iterator[tuple[Flags, tuple[Index, ...]]]:
    """Cells (*grid) within one depth of the array's middle taxel, then of the midpoint to its neighbour; each with the
    cells of all such places.
    """
    grid = operator.surface
    points = np.concatenate([a.points[np.ravel(a.valid)] for a in operator.planes_of])
    middle = int(np.argmin(((points - points.mean(axis=0)) ** 2).sum(axis=1)))
    away = np.sqrt(((points - points[middle]) ** 2).sum(axis=1))
    next_to = float(away[away > 0].min(initial=math.inf))
    for aside in (0.0, 0.5 * next_to):
        if not math.isfinite(aside):
            continue
        radius, places = np.zeros(grid.shape), []
        for axis, x in enumerate(grid.axes):
            offset = (x - points[middle, axis] - aside) ** 2
            radius = radius + offset.reshape([-1 if a == axis else 1 for a in range(grid.dimensions)])
            places.append(np.abs(x[:, None] - points[:, axis] - aside).argmin(axis=0))
        patch = radius <= max(depth**2, max(grid.spacings) ** 2, float(radius.min())) * (1.0 + 1e-9)
        yield patch, tuple(places)


def _cropped(patch: Flags) -> Floats:
    """The bounding box of a mask, as numbers."""
    where = [
        np.flatnonzero(patch.any(axis=tuple(a for a in range(patch.ndim) if a != axis))) for axis in range(patch.ndim)
    ]
    return patch[tuple(slice(w[0], w[-1] + 1) for w in where)].astype(np.float64)
