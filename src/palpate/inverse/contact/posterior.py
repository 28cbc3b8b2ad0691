"""What follows from the contact models of a frame: their mean, errors of every quantity in closed form, and samples.

Variances are those on the face of the constraints that a solution lies on, in which it may move freely.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt
import scipy.sparse

from palpate.elastic.pad import Floats
from palpate.inverse.contact.cone import TOLERANCE, Cone, Face, Solution, minimise
from palpate.inverse.contact.differences import Sparse
from palpate.inverse.contact.factors import Bordered, Dense, Factor, FewReadings, cholesky
from palpate.inverse.contact.iterative import Iterative
from palpate.inverse.contact.model import ContactModel, scattered
from palpate.inverse.contact.products import AT_SIZE, Applied, Products
from palpate.inverse.contact.quadratic import Formed, prior_factor
from palpate.inverse.contact.rows import Rows
from palpate.inverse.estimate import Errors
from palpate.inverse.linear.whitening import Readings
from palpate.sensing.grids import Grid, block_means
from palpate.sensing.operator import Operator

__all__ = ["Posterior", "posterior_factor", "shared_errors", "taken_by", "taken_of_each", "variance_of"]

Flags = npt.NDArray[np.bool_]
Index = npt.NDArray[np.intp]

#: No pad and no grid is known better than this part of the net force: the least error of it that is assumed. A convention, which
#: matters only where noise is less than that.
MODEL_FORCE = 5e-4
#: The same of a contact too large for matrices. Balls on 64 x 64 and 128 x 128 taxels read 0.21 % too little to 0.12 % too much; which way intervals
#: lean was measured on small contacts, so that one end of theirs is only 0.65 of this away.
MODEL_FORCE_AT_SIZE = 4e-3
#: The same where the channels alone do not tell pressure from shear and friction is not known: what decides is the penalty. A ball of 2 N on
#: a bonded gel reads 1.86 to 1.95 N at 1 % noise, sliding, twisted or neither, with markers in it; 1.35 to 1.72 N with markers on its surface,
#: which pressure hardly moves (`benchmarks/in_plane.py`). There it is as much more as pressure acts less than `observability.ACTS`.
AMBIGUOUS_FORCE = 0.04
#: The same where friction is given: mean errors of 1 to 3 % with markers in the gel, 1 to 7 % on its surface (docs/_generated/in_plane.md).
AMBIGUOUS_COUPLED = 0.02
#: What pressure passes for shear there, whether friction is known or not, as a part of the normal force: errors of 0.1 to 0.8 % where nothing shears.
AMBIGUOUS_SHEAR = 0.005


def posterior_factor(solution: Solution, rows: Floats) -> Floats:
    """Z (free, row) with Z'Z the posterior covariance of rows' x, on the face of the cone that the solution lies on.

    ``rows`` (row, component * cell).
    """
    face, factor = face_of(solution)
    return factor.half(face.columns(rows).T)


def face_of(solution: Solution) -> tuple[Face, Factor]:
    """The face of the cone that a solution lies on, and the factor of the normal matrix there."""
    if solution.face is None or solution.factor is None:
        raise RuntimeError("the solution was found without its face")
    return solution.face, solution.factor


def taken_by(model: ContactModel) -> float:
    """How many degrees of freedom of the readings a model takes up."""
    face, factor = face_of(model.solution)
    if isinstance(factor, Dense):
        return factor.trace(face.restrict(Formed(model.data.gram).scaled(face.scales).matrix))
    return float(taken_of_each(model).sum())


def taken_of_each(model: ContactModel) -> Floats:
    """The same of each reading."""
    factor = face_of(model.solution)[1]
    if isinstance(factor, FewReadings | Iterative):
        return factor.taken()
    if isinstance(factor, Bordered) and isinstance(factor.inner, Iterative):
        taken = factor.inner.taken()
        return taken + len(factor.corner) / max(len(taken), 1)
    return np.asarray((posterior_factor(model.solution, model.data.matrix) ** 2).sum(axis=0))


def shared_errors(model: ContactModel, columns: Floats, prior: Floats) -> Floats:
    """K (free, unknown): what a model owes to unknowns that act on many readings at once, so that K K' adds to its covariance.

    ``columns`` (reading, unknown) is what each does to the readings, whitened; ``prior`` (unknown,) its standard deviation. With
    Z = L^-1 W'A' B on the face, an unknown change c of the readings changes the traction by -L^-T Z c. Where the deviation is infinite
    the readings themselves must tell: S = (B'B - Z'Z)^-1. Where it is finite it is taken as it is: what the penalty alone says of it (how
    large the traction may be was learned from these very readings) is no knowledge.
    """
    z = posterior_factor(model.solution, columns.T @ model.data.matrix)
    told = np.isinf(prior)
    out = z * np.where(told, 0.0, prior)
    if told.any():
        b, found = columns[:, told], z[:, told]
        precision = b.T @ b - found.T @ found
        values, vectors = np.linalg.eigh(0.5 * (precision + precision.T))
        # what the readings do not tell at all stays as wide as the readings themselves allow
        floor = 1e-6 * max(float(np.trace(b.T @ b)), 1e-300)
        out[:, told] = found @ (vectors / np.sqrt(np.maximum(values, floor)))
    return np.asarray(out)


def variance_of(model: ContactModel, rows: Rows, *, few: bool = False) -> Floats:
    """Posterior variance of sparse rows' x over (component, cell), what is shared with other unknowns included; where samples tell it,
    ``few`` are enough.
    """
    face, factor = face_of(model.solution)
    local = face.rows(rows)
    out = factor.variances(local, few=few) if isinstance(factor, Iterative) else factor.variances(local)
    if model.shared is not None:
        out = out + (local.times(factor.back(model.shared)) ** 2).sum(axis=1)
    return np.asarray(out)


def variance_of_sums(model: ContactModel, rows: Floats) -> Floats:
    """The same of rows that are not sparse."""
    face, known = face_of(model.solution)
    if isinstance(known, Iterative) and model.shared is None:
        return known.squares(face.columns(rows))
    factor = posterior_factor(model.solution, rows)
    out = (factor**2).sum(axis=0)
    if model.shared is not None:
        out = out + ((model.shared.T @ factor) ** 2).sum(axis=0)
    return np.asarray(out)


def widened(variance: Floats, cells: int = 1) -> Floats:
    """The error of where the contact ends belongs to the cells just outside it too: its mean next to it, its largest farther on."""
    import scipy.ndimage

    near = (3,) * (variance.ndim - 1)
    out = np.maximum(variance, scipy.ndimage.uniform_filter(variance, (1, *near), mode="nearest"))
    if cells > 1:
        far = (2 * cells + 1,) * (variance.ndim - 1)
        out = np.where(variance > 0, out, scipy.ndimage.maximum_filter(variance, (1, *far), mode="nearest"))
    return np.asarray(out)


def variance_reduction_of(model: ContactModel, grid: Grid) -> Floats:
    """1 - posterior over prior variance of traction on the surface's cells (component, *surface); NaN out of contact."""
    face = model.solution.face
    c = len(model.solution.traction)
    out = np.full((c, math.prod(grid.shape)), math.nan)
    if face is None or not len(face.index):
        return out.reshape(c, *grid.shape)
    share, surface_cells = shares(model, grid)
    rows = face.rows(Rows.of(share).each(c, share.shape[1]))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = face_of(model.solution)[1].variances(rows) / prior_factor(model.penalty, face).variances(rows)
    out[:, surface_cells] = 1.0 - ratio.reshape(c, -1)
    return out.reshape(c, *grid.shape)


def shares(model: ContactModel, grid: Grid) -> tuple[Sparse, Index]:
    """Means over the fine cells of each surface cell, and which surface cells those are."""
    level, ratio, n = model.level, model.level.ratio, len(model.cells)
    places = np.unravel_index(model.cells, level.grid.shape)
    flat = np.ravel_multi_index(tuple(p // ratio for p in places), grid.shape)
    surface_cells, inverse = np.unique(flat, return_inverse=True)
    share = scipy.sparse.csr_array(
        (np.full(n, 1.0 / ratio**grid.dimensions), (inverse, np.arange(n))), shape=(len(surface_cells), n)
    )
    return share, surface_cells


Quantity = tuple[Floats, Floats]


def quantities(
    model: ContactModel, grid: Grid, inside: Flags
) -> tuple[Quantity, Quantity, Quantity, Quantity, Quantity]:
    """(value, variance) of traction on the surface's cells, net force, moment, centre of pressure and peak pressure.

    The numbers are those of the cells ``inside``.
    """
    level = model.level
    c, n = model.solution.traction.shape
    places = np.unravel_index(model.cells, level.grid.shape)
    share, surface_cells = shares(model, grid)
    mean, variance = np.zeros((2, c, math.prod(grid.shape)))
    mean[:, surface_cells] = (share @ model.solution.traction.T).T
    variance[:, surface_cells] = variance_of(model, Rows.of(share).each(c, n)).reshape(c, -1)
    kept = inside[tuple(p // level.ratio for p in places)].astype(np.float64)
    cell = level.grid.cell * kept
    axes = [axis[p] for axis, p in zip(level.grid.axes, places)][::-1]  # x, then y

    def linear(weights: Floats) -> Quantity:
        """Of sums of traction (quantity, component, cell)."""
        rows = weights.reshape(len(weights), -1)
        return rows @ model.solution.traction.ravel(), variance_of_sums(model, rows)

    force_rows = np.zeros((c, c, n))
    force_rows[np.arange(c), np.arange(c)] = cell
    p = model.solution.traction[-1] * kept
    total = float(p.sum()) or 1.0
    center = np.array([float((x * p).sum()) / total for x in axes])
    center_rows = np.zeros((len(axes), c, n))
    for i, x in enumerate(axes):
        center_rows[i, -1] = kept * (x - center[i]) / total
    if len(axes) == 1:
        moment_rows = np.zeros((1, c, n))
        moment_rows[0, -1] = -axes[0] * cell
    else:
        moment_rows = np.zeros((3, c, n))
        moment_rows[0, -1], moment_rows[1, -1] = axes[1] * cell, -axes[0] * cell
        if c == 3:
            moment_rows[2, 0], moment_rows[2, 1] = -axes[1] * cell, axes[0] * cell
    top = int(np.argmax(np.where(inside.ravel(), mean[-1], -1.0)))
    return (
        (mean.reshape(c, *grid.shape), variance.reshape(c, *grid.shape)),
        linear(force_rows),
        linear(moment_rows),
        (center, linear(center_rows)[1]),
        (mean[-1, top], variance[-1, top]),
    )


class Posterior:
    """What follows from the weighed contact models of a frame: means, closed-form errors, samples.

    ``inside`` are the cells of the operator's grid that the result is made of, ``outside`` those outside the outermost taxels; ``reach`` is
    how many cells round those in contact beyond doubt share their error; ``ambiguity`` is the least error of the shear
    force and of the normal force, as parts of the normal force.
    """

    def __init__(
        self,
        operator: Operator,
        columns: Sequence[int],
        cone: Cone,
        inside: Flags,
        outside: Flags,
        reach: int,
        *,
        ambiguity: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        self.operator, self.columns, self.cone = operator, tuple(columns), cone
        self.inside, self.outside, self.reach = inside, outside, reach
        self.ambiguity = ambiguity

    def summed_up(self, members: Sequence[ContactModel]) -> tuple[Floats, Errors]:
        """Mean traction (component, *grid) of the models by their weights, and the closed-form errors of every quantity."""
        grid = self.operator.surface
        parts = [quantities(m, grid, self.inside) for m in members]
        sure = [p if m.contact is None else quantities(m.contact, grid, self.inside) for p, m in zip(parts, members)]
        weights = np.array([m.weight for m in members])

        def mixed(index: int) -> tuple[Floats, Floats]:
            """Mean and total variance of a quantity over the models."""
            values = np.stack([p[index][0] for p in parts])
            within = np.stack([p[index][1] for p in sure])
            mean = np.tensordot(weights, values, 1)
            return mean, np.tensordot(weights, within + (values - mean) ** 2, 1)

        mean, variance = mixed(0)
        shape = (len(grid.components), *grid.shape)
        traction, std = np.zeros(shape), np.zeros(shape)
        traction[list(self.columns)] = mean
        std[list(self.columns)] = np.sqrt(widened(variance, self.reach))
        force = np.zeros(len(grid.components))
        total, variance = mixed(1)
        hidden = np.full(len(total), self.ambiguity[0])
        hidden[-1] = self.ambiguity[1]
        large = any(isinstance(m.data.matrix, Applied) for m in members)
        known = MODEL_FORCE_AT_SIZE if large else MODEL_FORCE
        least = np.maximum(known * np.abs(total), hidden * abs(total[-1]))
        force[list(self.columns)] = np.sqrt(variance + least**2)
        reduction = np.full(shape, math.nan)
        reduction[list(self.columns)] = variance_reduction_of(members[0].contact or members[0], grid)
        errors = Errors(
            variance_reduction=reduction,
            traction=std,
            force=force,
            **{name: np.sqrt(mixed(i)[1]) for i, name in ((2, "moment"), (3, "center"), (4, "peak"))},
            **self.outside_parts(traction),
        )
        return traction, errors

    def outside_parts(self, traction: Floats) -> dict[str, Floats]:
        """The part of traction (component, *grid), and of each number, that comes from cells beyond the outermost taxels."""
        grid = self.operator.surface
        cell = grid.cell * self.inside
        places = np.meshgrid(*grid.axes, indexing="ij")[::-1]  # x, then y
        outside = np.abs(traction) * self.outside
        p = cell * traction[-1]
        total = float(p.sum()) or 1.0
        far = cell * traction * self.outside
        if len(places) == 1:
            moment = [-(places[0] * far[-1]).sum()]
        else:
            x, y = places
            moment = [(y * far[-1]).sum(), -(x * far[-1]).sum(), (x * far[1] - y * far[0]).sum()]
        center = [((x - (x * p).sum() / total) * far[-1]).sum() / total for x in places]
        top = np.unravel_index(int(np.argmax(p)), p.shape)
        return {
            "outside_traction": outside,
            "outside_force": np.abs(far.reshape(len(far), -1).sum(axis=1)),
            "outside_moment": np.abs(moment),
            "outside_center": np.abs(center),
            "outside_peak": np.asarray(outside[-1][top]),
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
        """What would not be noticed: the error of the pressure of a patch as wide as the depth, the least that would show, over a taxel or
        between taxels.

        ``finer`` is an operator on cells that tell both places apart, where those of the surface do not. ``data`` are the frame's readings: a
        patch that they speak for, if not loudly enough, may be as large as they say.
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
            area = float(patch.sum()) * operator.surface.cell
            for i, c in enumerate(self.columns):
                std[c], force[c] = np.maximum(std[c], amplitude[i]), max(force[c], amplitude[i] * area)
        reach = max(float(np.abs(x).max()) for x in grid.axes)
        return Errors(
            std,
            force,
            np.full(1 if grid.dimensions == 1 else 3, force.max() * reach),
            np.full(grid.dimensions, math.nan),
            np.asarray(std[-1].max()),
            np.full(shape, math.nan),
            **self.outside_parts(np.zeros(shape)),
        )

    def draws(self, members: Sequence[ContactModel], weights: Floats, count: int, rng: np.random.Generator) -> Floats:
        """Samples of the traction: each minimises the problem of one model with readings and prior perturbed.

        The minimiser of 1/2 x'Hx - (h + H^{1/2} z)'x over the cone is a projection of a Gaussian posterior sample onto
        the cone (J. M. Everink, Y. Dong, M. S. Andersen, SIAM/ASA J. Uncertainty Quantification 11, 2023), so that samples
        respect the constraints and leave cells empty with finite probability.
        """
        grid = self.operator.surface
        out = np.zeros((count, len(grid.components), *grid.shape))
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
        """A sample of the traction over the pressure of a contact that slides."""
        ray, changes, factor = member.ray, member.changes, member.solution.factor
        if ray is None or changes is None or not isinstance(factor, Bordered):
            raise RuntimeError("only a contact that slides has one traction over pressure")
        count = len(changes)
        if count:
            # the last entries of a Gaussian whose precision has this factor
            ray = ray + np.linalg.solve(factor.corner.T, rng.standard_normal(count)) @ changes
        shear = float(np.linalg.norm(ray[:-1]))
        return np.append(ray[:-1] * min(1.0, float(self.cone.friction or shear) / max(shear, 1e-300)), 1.0)


def _patches(operator: Operator, depth: float) -> Iterator[tuple[Flags, tuple[Index, ...]]]:
    """Cells (*grid) within the depth of the array's middle taxel, and of the place between it and the next ones; with either, the cells of
    all such places.
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
    """The part of a field that is not empty."""
    where = [
        np.flatnonzero(patch.any(axis=tuple(a for a in range(patch.ndim) if a != axis))) for axis in range(patch.ndim)
    ]
    return patch[tuple(slice(w[0], w[-1] + 1) for w in where)].astype(np.float64)
