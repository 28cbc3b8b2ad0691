"""Mean and errors of every quantity, from the weighted contact models of a frame."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import fields

import numpy as np
import numpy.typing as npt
import scipy.sparse

from palpate._threads import cached_property, give_way
from palpate.elastic.pad import Floats
from palpate.inverse.constrained.differences import Sparse
from palpate.inverse.constrained.model import ContactModel
from palpate.inverse.constrained.quadratic import prior_factor
from palpate.inverse.constrained.rows import Rows
from palpate.inverse.constrained.variances import (
    by_gains,
    face_of,
    stated_variance_of,
    stated_variance_of_sums,
    told_by_each,
    variance_of,
    variance_of_sums,
)
from palpate.inverse.contact.policy import STATED
from palpate.inverse.contact.posterior import Posterior
from palpate.inverse.estimate import Errors, Stated
from palpate.inverse.linear.spectrum import in_components
from palpate.sensing.grids import Grid

__all__ = ["Quantities", "Summary"]

Flags = npt.NDArray[np.bool_]
Index = npt.NDArray[np.intp]

#: Quantities that are sums over the contact.
SUMS = ("force", "moment", "center")


def widened(variance: Floats, cells: int) -> Floats:
    """Give the cells just outside the contact an error from the cells at its edge: their mean error next to the edge, their largest error farther out."""
    import scipy.ndimage

    near = (3,) * (variance.ndim - 1)
    out = np.maximum(variance, scipy.ndimage.uniform_filter(variance, (1, *near), mode="nearest"))
    if cells > 1:
        far = (2 * cells + 1,) * (variance.ndim - 1)
        out = np.where(variance > 0, out, scipy.ndimage.maximum_filter(variance, (1, *far), mode="nearest"))
    return np.asarray(out)


def variance_reduction_of(model: ContactModel, grid: Grid) -> Floats:
    """1 - posterior over prior variance of traction on the surface cells (component, *surface); NaN outside the
    contact.
    """
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
    """Sparse averaging matrix from fine cells to surface cells, and the indices of these surface cells."""
    level, ratio, n = model.level, model.level.ratio, len(model.cells)
    places = np.unravel_index(model.cells, level.grid.shape)
    flat = np.ravel_multi_index(tuple(p // ratio for p in places), grid.shape)
    surface_cells, inverse = np.unique(flat, return_inverse=True)
    share = scipy.sparse.csr_array(
        (np.full(n, 1.0 / ratio**grid.dimensions), (inverse, np.arange(n))), shape=(len(surface_cells), n)
    )
    return share, surface_cells


Quantity = tuple[Floats, Floats]


class Quantities:
    """(value, variance) of each quantity of one model, computed on first access.

    Only cells ``inside`` contribute. With ``known``, the same quantities with other variances, the variances are only
    those due to pad properties that are not known exactly.
    """

    def __init__(
        self, model: ContactModel, grid: Grid, inside: Flags, columns: Sequence[int], *, known: Quantities | None = None
    ) -> None:
        self.model, self.grid, self.inside, self.columns, self._known = model, grid, inside, columns, known
        self._of, self._of_sums = (
            (variance_of, variance_of_sums) if known is None else (stated_variance_of, stated_variance_of_sums)
        )
        level = model.level
        places = np.unravel_index(model.cells, level.grid.shape)
        self.kept = inside[tuple(p // level.ratio for p in places)].astype(np.float64)
        self.axes = [axis[p] for axis, p in zip(level.grid.axes, places)][::-1]  # x, then y

    @cached_property
    def _shares(self) -> tuple[Sparse, Index]:
        return shares(self.model, self.grid) if self._known is None else self._known._shares

    @cached_property
    def mean(self) -> Floats:
        """Traction on the surface's cells (component, *surface)."""
        if self._known is not None:
            return self._known.mean
        share, surface_cells = self._shares
        traction = self.model.solution.traction
        out = np.zeros((len(traction), math.prod(self.grid.shape)))
        out[:, surface_cells] = (share @ traction.T).T
        return out.reshape(len(traction), *self.grid.shape)

    @cached_property
    def traction(self) -> Quantity:
        share, surface_cells = self._shares
        c, n = self.model.solution.traction.shape
        variance = np.zeros((c, math.prod(self.grid.shape)))
        variance[:, surface_cells] = self._of(self.model, Rows.of(share).each(c, n)).reshape(c, -1)
        return self.mean, variance.reshape(self.mean.shape)

    @property
    def totals(self) -> Floats:
        """Rows that sum traction to the net force (axis, component * cell)."""
        rows = self._here(self.model.level.grid.force_rows(self.columns))
        return rows.reshape(len(rows), -1)

    @property
    def pressing(self) -> Floats:
        """Row that sums the pressure over the surface (1, component * cell)."""
        rows = np.zeros((1, *self.model.solution.traction.shape))
        rows[0, -1] = self.model.level.grid.areas.ravel()[self.model.cells] * self.kept
        return rows.reshape(1, -1)

    def _here(self, rows: Floats) -> Floats:
        """Restrict sums over the whole surface (sum, component, *surface) to the model's cells."""
        return np.asarray(rows.reshape(*rows.shape[:2], -1)[..., self.model.cells] * self.kept)

    @cached_property
    def force(self) -> Quantity:
        return self._sums(self.totals)

    @cached_property
    def moment(self) -> Quantity:
        return self._sums(self._here(self.model.level.grid.moment_rows(self.columns)))

    @cached_property
    def center(self) -> Quantity:
        weights = self.pressing.reshape(self.model.solution.traction.shape)[-1]
        weights = weights / self.model.level.grid.cell
        p = self.model.solution.traction[-1] * weights
        total = float(p.sum())
        total = total if abs(total) > 1e-150 else 1.0  # the square of 1 / total must be finite
        center = np.array([float((x * p).sum()) / total for x in self.axes])
        rows = np.zeros((len(self.axes), *self.model.solution.traction.shape))
        for i, x in enumerate(self.axes):
            rows[i, -1] = weights * (x - center[i]) / total
        return center, self._sums(rows)[1]

    @cached_property
    def peak(self) -> Quantity:
        mean, variance = (part[-1].ravel() for part in self.traction)
        top = int(np.argmax(np.where(self.inside.ravel(), mean, -1.0)))
        return mean[top], variance[top]

    def _sums(self, weights: Floats) -> Quantity:
        """Values and variances of sums of traction (quantity, component, cell)."""
        rows = weights.reshape(len(weights), -1)
        return rows @ self.model.solution.traction.ravel(), self._of_sums(self.model, rows)


class Summary:
    """Mean of the weighted models of a frame, and the errors of every quantity (`Errors`), each computed on demand."""

    def __init__(self, members: Sequence[ContactModel], posterior: Posterior) -> None:
        self.members, self.posterior, self.policy = members, posterior, posterior.policy
        self.grid = posterior.operator.surface
        self._parts = [Quantities(m, self.grid, posterior.inside, posterior.columns) for m in members]
        self._sure = [
            p if m.contact is None else Quantities(m.contact, self.grid, posterior.inside, posterior.columns)
            for p, m in zip(self._parts, members)
        ]
        self._weights = np.array([m.weight for m in members])
        self.gain = 0.0  # assumed relative error of the gains
        self.whites: list[Floats] = []  # the readings of each model, whitened
        self.doubted = 0.0  # fraction of the normal force that may not exist
        self.in_gaps: Floats | None = None  # `gaps.load_in_gaps`

    def _mixed(self, name: str) -> Quantity:
        """Mean and total variance of a quantity over the models."""
        values = np.stack([getattr(p, name)[0] for p in self._parts])
        within = np.stack([getattr(p, name)[1] for p in self._sure])
        mean = np.tensordot(self._weights, values, 1)
        at_size = name in SUMS and any(m.data.at_size for m in self.members)
        within = (self.policy.errors.sums_at_size if at_size else 1.0) ** 2 * within
        return mean, np.tensordot(self._weights, within + (values - mean) ** 2, 1)

    def stated(self) -> Stated | None:
        """Errors due to pad properties and gains that are not known exactly, averaged over the models; None if there
        are none.
        """
        models = [p.model for p in self._sure]
        gains = self._by_gains()
        if gains is None and all(m.stated is None for m in models):
            return None
        grid, inside, columns = self.grid, self.posterior.inside, self.posterior.columns
        parts = [Quantities(p.model, grid, inside, columns, known=p) for p in self._sure]

        def owed(name: str) -> Floats:
            return np.asarray(np.tensordot(self._weights, np.stack([getattr(p, name)[1] for p in parts]), 1))

        traction = np.sqrt(widened(owed("traction"), self.posterior.reach))
        numbers = [np.sqrt(owed(name)) for name in ("moment", "center", "peak")]
        force = owed("force") + (0.0 if gains is None else gains)
        return Stated(self._everywhere(traction), self._along(np.sqrt(force)), *numbers)

    def _by_gains(self) -> Floats | None:
        """Variance of the net force (component sought,) due to the assumed error of the gains."""
        if not self.gain:
            return None
        each = [by_gains(p.model, p.totals, white) for p, white in zip(self._sure, self.whites)]
        return self.gain**2 * np.tensordot(self._weights, np.stack(each), 1)

    def largest_part(self) -> float:
        """Largest fraction of the normal force that rests on one reading, by the leading model."""
        first = self._sure[0]
        total = first.pressing
        force = float((total @ first.model.solution.traction.ravel())[0])
        if not force > 0.0:
            return 0.0
        return float(np.abs(told_by_each(first.model, total, self.whites[0])).max(initial=0.0)) / force

    def _everywhere(self, sought: Floats, fill: float = 0.0) -> Floats:
        """Expand a field (component sought, *surface) to all components."""
        columns, count = self.posterior.columns, len(self.grid.components)
        return np.asarray(in_components(sought, columns, count, self.grid.dimensions, fill))

    @cached_property
    def mean(self) -> Floats:
        """Traction (component, *surface)."""
        return self._everywhere(np.tensordot(self._weights, np.stack([p.mean for p in self._parts]), 1))

    def traction(self) -> Floats:
        mean, variance = self._mixed("traction")
        out = widened(variance, self.posterior.reach)
        out[-1] += (self.posterior.ambiguity[2] * mean[-1]) ** 2
        return self._everywhere(np.sqrt(out))

    @cached_property
    def _beyond(self) -> tuple[Floats, Floats]:
        """Standard deviation of the net force (component,) due to contact beyond the outermost taxels, for moment and
        centre; and its place (axis,).
        """
        force, place = self.posterior.going_on(self.mean)
        return self.policy.errors.beyond / STATED * np.abs(force), place

    def force(self) -> Floats:
        policy = self.policy
        total, variance = self._mixed("force")
        hidden = np.full(len(self.posterior.columns), self.posterior.ambiguity[0])
        hidden[-1] = math.hypot(self.posterior.ambiguity[1], self.doubted)
        hidden = self.grid.turned_errors(hidden, self.mean)
        large = any(m.data.at_size for m in self.members)
        known = policy.errors.force_at_size if large else policy.errors.force
        least = np.maximum(known * np.abs(total), hidden * self._normal_force())
        return self._along(np.sqrt(variance + least**2))

    def _normal_force(self) -> float:
        """Magnitude of the pressure integrated over the surface [N]."""
        each = [float((p.pressing @ p.model.solution.traction.ravel())[0]) for p in self._parts]
        return abs(float(self._weights @ each))

    def _along(self, force: Floats) -> Floats:
        """Expand values for the axes of `Grid.force_axes` to all axes."""
        out = np.zeros(len(self.grid.components))
        out[list(self.grid.force_axes(self.posterior.columns))] = force
        return out

    def moment(self) -> Floats:
        force, place = self._beyond
        arms = np.zeros((3 if len(place) == 2 else 1, len(force)))
        if len(place) == 2:
            arms[0, -1], arms[1, -1] = place[1], -place[0]
            if len(force) == 3:
                arms[2, 0], arms[2, 1] = -place[1], place[0]
        else:
            arms[0, -1] = -place[0]
        return np.asarray(np.sqrt(self._mixed("moment")[1] + (np.abs(arms) @ force) ** 2))

    def center(self) -> Floats:
        center, variance = self._mixed("center")
        (*_, more), place = self._beyond
        total = float(self._mixed("force")[0][-1])
        part = more / (abs(total) + more) if more > 0.0 else 0.0
        return np.asarray(np.sqrt(variance + (part * (place - center)) ** 2))

    def peak(self) -> Floats:
        mean, variance = self._mixed("peak")
        return np.asarray(np.sqrt(variance + (self.posterior.ambiguity[3] * mean) ** 2))

    def variance_reduction(self) -> Floats:
        first = self.members[0]
        return self._everywhere(variance_reduction_of(first.contact or first, self.grid), math.nan)

    @cached_property
    def _outside(self) -> dict[str, Floats]:
        parts = self.posterior.outside_parts(self.mean)
        if self.in_gaps is not None:
            parts["beyond_force"] = parts["beyond_force"] + self.in_gaps
        return parts

    def of(self, name: str) -> Floats:
        """The field of `Errors` with this name."""
        give_way()
        return np.asarray(self._outside[name] if name.startswith(("outside_", "beyond_")) else getattr(self, name)())

    def errors(self) -> Errors:
        """All fields of `Errors`."""
        return Errors(**{f.name: self.of(f.name) for f in fields(Errors)})
