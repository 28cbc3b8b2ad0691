"""Normal matrices of large contacts, known only by products: FFTs over the contact's bounding box.

For thousands of cells under thousands of readings, the matrix of influences is slow to form and slower to factorise.
Its products are convolutions with the influence of one cell (`palpate.sensing.operator.Convolution`). The normal
matrix, smoothed by the penalty, is well enough conditioned for conjugate gradients
(`palpate.inverse.constrained.iterative`).
"""

from __future__ import annotations

import copy
import math
from collections import OrderedDict
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from palpate._arrays import irfftn, rfftn
from palpate._threads import cached_property
from palpate.elastic.channels import find_channel
from palpate.elastic.pad import Floats
from palpate.inverse.constrained.circulant import Circulant, folded, symbol_of_penalty, times
from palpate.inverse.constrained.factors import Factor
from palpate.inverse.constrained.iterative import Iterative
from palpate.inverse.constrained.quadratic import Penalty, Quadratic, Unformed, work_of_few
from palpate.inverse.linear.whitening import Readings
from palpate.sensing.operator import Convolution, Operator

if TYPE_CHECKING:
    from palpate.inverse.constrained.faces import Face

__all__ = ["AT_SIZE", "FIRST_AT_SIZE", "Applied", "Boxes", "Products", "by_products", "can_be_applied"]

Flags = npt.NDArray[np.bool_]
Index = npt.NDArray[np.intp]

#: If the mean sensitivity to the cells is at least this fraction of the typical one, use one circulant for all cells;
#: two take twice the time.
MIN_EVENNESS = 0.85
#: Boxes are rounded to multiples of STEP cells, so that the rounds of a frame share them; KEPT boxes are cached.
STEP, KEPT = 8, 6
#: A part of a contact gets its own box if that has at most this fraction of the area.
SMALLER = 0.8
#: Number of random combinations of readings that represent the independent errors of all.
SKETCH = 32
#: Systems with fewer unknowns are solved with a matrix: exactly, so that mirror images have mirror solutions.
MIN_ITERATIVE_UNKNOWNS = 600
#: Of so few readings exact factors are small. With products, frames whose contact covers the array take 3.3 to 7.3 times as
#: long on 8 x 8 x 3, 2.8 to 3.8 on 10 x 10 x 3, 1.6 on 12 x 12 x 3, and half as long on 16 x 16 x 3.
FEW_READINGS = 500
#: Number of products for solving, local weights and error bars; and cost of one entry of a padded transform relative to
#: one multiplication of a matrix product. For round contacts on 16 x 16 x 3 to 64 x 64 x 3, the ratio of the time with
#: products to that with a matrix is 1.0 to 1.1 (0.5 with friction) at 1.5e3 entries, 0.4 (0.1) at 3e3, 0.1 at 1.4e4 and
#: 0.04 at 4e4.
PRODUCTS, ENTRY = 1.6e3, 60.0
#: The same if contact may slide as a whole. With a matrix it is solved on finer cells, which is more accurate (balls
#: and blocks that slide on a bonded gel: 0.44 of the clairvoyant filter's error instead of 0.58).
FEWEST_SLIDING, PRODUCTS_SLIDING = 1200, 5e3
#: The same of displacement, which decreases so slowly with distance that a solution takes two to four times as many. On 24 x 24 x 3 and 32 x 32 x 3 with
#: noise of 0.1 % of the largest reading, frames take 2.3 s or 5 s with `PRODUCTS` and 1.0 s or 1.5 s with this; smaller contacts 0.2 s and 0.3 s.
PRODUCTS_DISPLACEMENT = 5e3
#: Number of products for a first solution, from which noise and region are estimated. With more than MANY readings its
#: cost matters, so that products are used from FEWEST_OF_MANY unknowns on.
PRODUCTS_ONCE, MANY, FEWEST_OF_MANY = 3e2, 4096, 150
#: Relative residuals at which a solution by products counts as exact (at most a hundredth of the effect of noise), and
#: for first solutions.
AT_SIZE, FIRST_AT_SIZE = 1e-4, 1e-3
#: Largest number of multiplications for an exact factor from the readings, where Newton's method cycles: with 840 readings
#: and 4485 unknowns (3.2e9) the interior-point method then takes 0.7 s instead of 3 to 7 s with conjugate gradients.
MATRIX = 5e9
#: Number of factorisations of one model, for comparison with products: of a matrix, and from the readings, whose many small calls cost more than
#: their size suggests.
FACTORS, FACTORS_OF_FEW = 3.0, 7.5


def by_products(
    operator: Operator, cells: Index, components: int, readings: int, *, once: bool = False, slides: bool = False
) -> bool:
    """Whether products are faster than matrices for this contact, by counting operations. ``once``: only a first
    solution is asked for, from which noise and region follow; ``slides``: friction is given and the contact may slide as
    a whole.
    """
    unknowns = components * len(cells)
    # With so many readings, even the columns of a few cells take long.
    once = once and readings > MANY
    displaced = any(find_channel(c).kind.absolute for a in operator.planes_of for c in a.channels)
    fewest, products = MIN_ITERATIVE_UNKNOWNS, PRODUCTS_DISPLACEMENT if displaced else PRODUCTS
    if slides and not once:
        fewest, products = FEWEST_SLIDING, PRODUCTS_SLIDING
    if readings <= FEW_READINGS or unknowns < (FEWEST_OF_MANY if once else fewest) or not can_be_applied(operator):
        return False
    box = box_of(cells, operator.surface.shape)
    row = min(b.stop - b.start for b in box) if len(box) > 1 else 1
    formed = readings * unknowns**2 + FACTORS * unknowns**3 / 3.0
    formed = min(formed, FACTORS_OF_FEW * work_of_few(unknowns, readings, components * row))
    padded = 0.0
    for plane in operator.planes:
        size = [(m - 1) * r + b.stop - b.start for m, r, b in zip(plane.taxels, plane.ratios, box)]  # type: ignore[attr-defined]
        padded += math.prod(size) * (components + plane.rows)  # type: ignore[attr-defined]
    return (PRODUCTS_ONCE if once else products) * ENTRY * padded < formed


def can_be_applied(operator: Operator) -> bool:
    """Whether products are available: regular arrays with independent noise."""
    regular = all(isinstance(p, Convolution) for p in operator.planes)
    return regular and not any(a.noise_correlation for a in operator.planes_of)


def box_of(cells: Index, shape: tuple[int, ...]) -> tuple[slice, ...]:
    """The bounding box of cells, rounded up to multiples of `STEP`."""
    places = np.unravel_index(cells, shape)
    low = [int(p.min()) // STEP * STEP for p in places]
    high = [min(-(-(int(p.max()) + 1) // STEP) * STEP, n) for p, n in zip(places, shape)]
    return tuple(slice(a, b) for a, b in zip(low, high))


class Boxes:
    """Convolutions from boxes of an operator's surface to all its readings, with a cache."""

    def __init__(self, operator: Operator, columns: Sequence[int]) -> None:
        self.operator, self.columns = operator, tuple(columns)
        self._kept: OrderedDict[tuple[tuple[int, int], ...], Box] = OrderedDict()

    def around(self, cells: Index) -> Box:
        """The box that contains some cells."""
        place = box_of(cells, self.operator.surface.shape)
        key = tuple((s.start, s.stop) for s in place)
        found = self._kept.get(key)
        if found is None:
            found = Box(self.operator, self.columns, place)
            self._kept[key] = found
            while len(self._kept) > KEPT:
                self._kept.popitem(last=False)
        else:
            self._kept.move_to_end(key)
        return found


class Box:
    """Products with the influences of the cells of a box."""

    def __init__(self, operator: Operator, columns: tuple[int, ...], place: tuple[slice, ...]) -> None:
        from scipy.fft import next_fast_len

        self.place, self.columns = place, columns
        self.shape = tuple(s.stop - s.start for s in place)
        self.valid = [np.flatnonzero(np.tile(a.valid.ravel(), len(a.channels))) for a in operator.planes_of]
        self.planes: list[tuple[Convolution, tuple[int, ...], list[Any], Any]] = []
        for plane in operator.planes:
            if not isinstance(plane, Convolution):
                raise TypeError("products by boxes need a regular array")
            kernel = plane.kernel[:, list(columns)]
            for axis, (s, n, m, r) in enumerate(zip(place, plane.cells, plane.taxels, plane.ratios)):
                here = slice(n - s.stop, (m - 1) * r - s.start + n)
                kernel = kernel[(slice(None),) * (2 + axis) + (here,)]
            size = tuple(next_fast_len(n, real=True) for n in kernel.shape[2:])
            there, squares = (self._spectrum(k, size) for k in (kernel, kernel**2))
            back = np.ascontiguousarray(np.conj(there).swapaxes(0, 1))
            spectra = [there, there.astype(np.complex64), back, back.astype(np.complex64)]
            self.planes.append((plane, size, spectra, np.conj(squares).swapaxes(0, 1)))

    def _spectrum(self, kernel: Floats, size: tuple[int, ...]) -> Any:
        d = len(size)
        padded = np.zeros((*kernel.shape[:2], *size))
        padded[(slice(None), slice(None), *(slice(0, n) for n in kernel.shape[2:]))] = kernel
        return rfftn(np.roll(padded, [-(n - 1) for n in self.shape], axis=tuple(range(2, 2 + d))), size)

    @cached_property
    def folded(self) -> tuple[tuple[int, ...], list[Any]]:
        """See `palpate.inverse.constrained.circulant.folded`."""
        return folded(self.shape, [(plane.kernel[:, list(self.columns)], plane.ratios) for plane, *_ in self.planes])

    def forward(self, x: Any) -> Any:
        """Readings (k, reading) of tractions (k, component, *box), in their precision."""
        parts = []
        for (plane, size, spectra, _), valid in zip(self.planes, self.valid):
            rows = times(spectra[x.dtype == np.float32], rfftn(x, size))
            taxels = [slice(0, (m - 1) * r + 1, r) for m, r in zip(plane.taxels, plane.ratios)]
            full = irfftn(rows, size, taxels, overwrite=True).reshape(len(x), -1)
            parts.append(full if len(valid) == full.shape[1] else full[:, valid])
        return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)

    def adjoint(self, rows: Any, *, squared: bool = False) -> Any:
        """The transpose: (k, component, *box) for readings (k, reading); ``squared``: with the squares of all
        influences.
        """
        total: Any = 0.0
        start = 0
        for (plane, size, spectra, squares), valid in zip(self.planes, self.valid):
            spectrum = squares if squared else spectra[2 + (rows.dtype == np.float32)]
            part = rows[:, start : start + len(valid)]
            start += len(valid)
            if len(valid) < plane.rows * math.prod(plane.taxels):
                whole = np.zeros((len(rows), plane.rows * math.prod(plane.taxels)), dtype=rows.dtype)
                whole[:, valid] = part
                part = whole
            image = part.reshape(len(rows), plane.rows, *plane.taxels)
            if any(r > 1 for r in plane.ratios):
                whole = np.zeros(
                    (len(rows), plane.rows, *((m - 1) * r + 1 for m, r in zip(plane.taxels, plane.ratios))),
                    dtype=rows.dtype,
                )
                every: Any = (..., *(slice(None, None, r) for r in plane.ratios))
                whole[every] = image
                image = whole
            out = times(spectrum, rfftn(image, size))
            total = total + irfftn(out, size, [slice(0, n) for n in self.shape], overwrite=True)
        return total


class Applied:
    """The whitened influences (observed reading, component * cell) of some cells, as products.

    Stands for a matrix: supports ``matrix @ x`` and ``rows @ matrix``.
    """

    #: NumPy arrays leave products to this class.
    __array_ufunc__ = None

    def __init__(
        self, boxes: Boxes, readings: Readings, shape: tuple[int, ...], cells: Index, noise: Floats, observed: Flags
    ) -> None:
        self.boxes, self.box, self.surface, self.observed = boxes, boxes.around(cells), shape, observed
        self.readings, self.weight = readings, 1.0 / noise
        self.ray: Floats | None = None
        self.slow = False  # whether a solution took too many steps (`iterative.SLOW`)
        self._place(cells)

    def _place(self, cells: Index) -> None:
        places = np.unravel_index(cells, self.surface)
        self.cells = cells
        self.inside = np.ravel_multi_index(tuple(p - s.start for p, s in zip(places, self.box.place)), self.box.shape)

    @property
    def components(self) -> int:
        return 1 if self.ray is not None else len(self.box.columns)

    @property
    def shape(self) -> tuple[int, int]:
        return int(self.observed.sum()), self.components * len(self.cells)

    def part(self, position: Index) -> Applied:
        """Return the products restricted to the cells at ``position``."""
        out = self._copy()
        cells = self.cells[position]
        if len(cells):
            place = box_of(cells, self.surface)
            if math.prod(s.stop - s.start for s in place) < SMALLER * math.prod(self.box.shape):
                out.box = self.boxes.around(cells)
        out._place(cells)
        return out

    def along(self, ray: Floats) -> Applied:
        """Products for traction ``ray`` (component,) times the unknowns."""
        out = self._copy()
        out.ray = np.asarray(ray)
        return out

    def _copy(self) -> Applied:
        out = copy.copy(self)
        for name in ("squares", "symbol"):
            out.__dict__.pop(name, None)
        return out

    @cached_property
    def symbol(self) -> tuple[tuple[int, ...], Any]:
        """Size of the box's circulant, and the normal matrix on it (component, component, *k)."""
        size, planes = self.box.folded
        weight, total, start = np.where(self.observed, self.weight**2, 0.0), None, 0
        for each, valid in zip(planes, self.box.valid):
            rows = np.array_split(weight[start : start + len(valid)], len(each))
            start += len(valid)
            part = np.tensordot(np.array([r.mean() for r in rows], dtype=np.float32), each, 1)
            total = part if total is None else total + part
        if self.ray is not None:
            total = np.einsum("i,ij...,j->...", self.ray, np.asarray(total), self.ray)[None, None]
        return size, total

    def in_box(self, x: Any) -> Any:
        """Values (k, component, cell) on the box (k, component, *box); 0 in its other cells."""
        whole = np.zeros((*x.shape[:2], math.prod(self.box.shape)), dtype=x.dtype)
        whole[:, :, self.inside] = x
        return whole.reshape(*x.shape[:2], *self.box.shape)

    def from_box(self, x: Any) -> Any:
        """The cells' values (k, component, cell) of values on the box."""
        return x.reshape(*x.shape[:2], -1)[:, :, self.inside]

    def _in_box(self, x: Any) -> Any:
        """Traction on the box of unknowns (k, component, cell)."""
        return self.in_box(x if self.ray is None else self.ray.astype(x.dtype)[None, :, None] * x)

    def _from_box(self, x: Any) -> Any:
        """The transpose of `_in_box`."""
        out = self.from_box(x)
        return out if self.ray is None else np.tensordot(out, self.ray.astype(out.dtype), (1, 0))[:, None]

    def forward(self, x: Any) -> Any:
        """Readings (k, observed reading) for x (k, component, cell)."""
        out = self.box.forward(self._in_box(x))
        out *= self.weight.astype(x.dtype)
        return out if self.observed.all() else out[:, self.observed]

    def adjoint(self, rows: Any) -> Any:
        """The transpose (k, component, cell) for readings (k, observed reading)."""
        if not self.observed.all():
            whole = np.zeros((len(rows), len(self.observed)), dtype=rows.dtype)
            whole[:, self.observed] = rows
            rows = whole
        return self._from_box(self.box.adjoint(rows * self.weight.astype(rows.dtype)))

    @cached_property
    def squares(self) -> Floats:
        """The diagonal (component * cell,) of the normal matrix."""
        rows = np.where(self.observed, self.weight**2, 0.0)[None]
        found = self.from_box(self.box.adjoint(rows, squared=True))[0]
        found = np.maximum(found, 1e-9 * float(found.max()))
        # For rays, neglect the coupling of components: this only affects the number of iterations.
        return np.asarray(found.ravel() if self.ray is None else self.ray**2 @ found)

    def __matmul__(self, x: Floats) -> Floats:
        many = x.reshape(len(x), -1).T.reshape(-1, self.components, len(self.cells))
        out = self.forward(many)
        return np.asarray(out[0] if x.ndim == 1 else out.T)

    def __rmatmul__(self, rows: Floats) -> Floats:
        out = self.adjoint(np.atleast_2d(rows))
        out = out.reshape(len(out), -1)
        return np.asarray(out[0] if rows.ndim == 1 else out)

    def sketched(self, each: Floats) -> Floats:
        """Random combinations of rows, with random signs, whose squares sum on average to those of every reading's row
        times ``each``.
        """
        rng = np.random.default_rng(0)
        signs = np.where(rng.random((SKETCH, len(each))) < 0.5, -1.0, 1.0)
        return (signs * each) @ self / math.sqrt(SKETCH)


class Products:
    """A normal matrix G'G + P (`palpate.inverse.constrained.quadratic.Quadratic`) as products."""

    by_products = True

    def __init__(self, matrix: Applied, penalty: Penalty, scales: Floats | None = None) -> None:
        self.matrix, self.penalty = matrix, penalty
        self.scales = np.ones(matrix.components) if scales is None else scales

    @property
    def slow(self) -> bool:
        """Whether a solution for these influences, or for more cells, was slow."""
        return self.matrix.slow

    def product(self, x: Floats) -> Floats:
        return np.asarray(self.many(x[None])[0])

    def many(self, x: Any) -> Any:
        """H x for x (k, component, cell), in its precision."""
        scales = self.scales.astype(x.dtype)[None, :, None]
        x = x * scales
        out = self.matrix.adjoint(self.matrix.forward(x))
        out += self.penalty.many(x)
        out *= scales
        return out

    def diagonal(self) -> Floats:
        return (self.matrix.squares + self.penalty.diagonal()) * np.repeat(self.scales**2, len(self.matrix.cells))

    @cached_property
    def circulants(self) -> list[tuple[Any, Circulant]]:
        """Circulants that approximate the matrix scaled to a unit diagonal, and the square root of the weight of each
        in the cells (cell,), in single precision: one for cells that affect the readings, one for cells beyond the
        array with only the penalty.
        """
        matrix, c = self.matrix, self.matrix.components
        size, data = matrix.symbol
        squares, each = matrix.squares.reshape(c, -1), self.diagonal().reshape(c, -1)
        told = squares.sum(axis=0)
        told = np.minimum(told / max(float(np.median(told)), 1e-300), 1.0)
        parts = [np.ones(len(told))] if told.mean() > MIN_EVENNESS else [told, 1.0 - told]
        places = np.stack(np.unravel_index(matrix.inside, matrix.box.shape))
        stencils = symbol_of_penalty(self.penalty, places, size)
        out = []
        for part in parts:
            share = part / part.sum()
            scale = self.scales / np.sqrt(np.exp(np.log(each) @ share))
            seen = (squares @ share) * scale**2
            whole = matrix.squares.reshape(c, -1).max(axis=1) * scale**2
            symbol = data * (scale[:, None] * scale[None, :]).reshape(c, c, *(1,) * len(size))
            if len(parts) > 1:
                symbol = symbol * float(seen.sum() / whole.sum())
            for i in range(c):
                symbol[i, i] += max(1.0 - float(seen[i]), 0.0) * stencils[i]
            out.append((np.sqrt(part).astype(np.float32), Circulant(matrix.box.shape, size, symbol)))
        return out

    def scaled(self, scales: Floats) -> Products:
        return Products(self.matrix, self.penalty, self.scales * scales)

    def factor(self, face: Face, more: Floats) -> Factor:
        return Iterative(self, face, more)

    @property
    def few(self) -> bool:
        """Whether the readings are few enough for an explicit matrix."""
        readings, unknowns = self.matrix.shape
        return readings**2 * unknowns <= MATRIX

    def exactly(self) -> Quadratic:
        """Return the quadratic form with an explicit matrix of the readings, if they are few enough."""
        if not self.few:
            return self
        readings = self.matrix.shape[0]
        columns = (np.eye(readings) @ self.matrix).T * np.repeat(self.scales, len(self.matrix.cells))[:, None]
        return Unformed(np.ascontiguousarray(columns), self.penalty.scaled(self.scales))

    def perturbed(self, rng: np.random.Generator, count: int) -> Floats:
        """Samples (count, component, cell) of a Gaussian whose covariance is H."""
        seen = self.matrix.adjoint(rng.standard_normal((count, self.matrix.shape[0])))
        prior = self.penalty.perturbed(rng, count)
        return np.asarray((seen + prior) * self.scales[None, :, None])

    def dense(self) -> Floats:
        n = self.matrix.components * len(self.matrix.cells)
        return np.asarray(self.many(np.eye(n).reshape(n, self.matrix.components, -1)).reshape(n, n))
