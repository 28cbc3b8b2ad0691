"""A factor (`palpate.inverse.constrained.factors.Factor`) of a normal matrix that is known only by products.

Solutions use conjugate gradients, preconditioned by the circulant of the matrix
(`palpate.inverse.constrained.circulant`), in single precision. Variances come from samples: if H x = G'e + P^(1/2) e
with white e, x has the covariance H^-1 (G. Papandreou, A. Yuille, NIPS 23, 2010).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from palpate.elastic.pad import Floats
from palpate.inverse.constrained.rows import Rows

if TYPE_CHECKING:
    from palpate.inverse.constrained.faces import Face

__all__ = ["SAMPLES", "Iterative"]

#: Relative tolerances: of a Newton step (the next step corrects it), of samples, and of the errors of sums, which use
#: exact products.
STEP, SAMPLE, SHARP = 1e-2, 2e-2, 1e-3
#: Largest number of steps of conjugate gradients.
MAX_STEPS = 400
#: Number of steps after which a Newton step ends, and is slow, where the readings are few enough for an exact factor
#: (`products.MATRIX`): that takes as long as 100 to 300 steps, and 12 to 27 are usual. With 60, a frame of 17 x 18 x 3 took
#: 1.7 times as long.
SLOW = 200
#: Number of samples for variances, and for variances that are only added to squared gradients and smoothed.
SAMPLES, FEW = 16, 8


class Multiplied(Protocol):
    """A normal matrix known by its products only; `palpate.inverse.constrained.products.Products` is one."""

    @property
    def matrix(self) -> Any: ...
    @property
    def scales(self) -> Floats: ...
    @property
    def circulants(self) -> Any: ...
    @property
    def few(self) -> bool: ...
    def diagonal(self) -> Floats: ...
    def many(self, x: Any) -> Any: ...
    def perturbed(self, rng: Any, count: int) -> Any: ...


class Iterative:
    """Factor of W'HW + diag(more) on the free directions W of a face."""

    def __init__(self, hessian: Multiplied, face: Face, more: Floats) -> None:
        self.hessian, self.face, self.more = hessian, face, more
        c, n = face.free.shape
        self._shape = (c, n)
        diagonal = hessian.diagonal().reshape(c, n)
        if face.mixed:
            diagonal = np.einsum("idk,di->ki", face.basis**2, diagonal)
        self.diagonal = diagonal.ravel()[face.index] + more
        self._small = (1.0 / np.sqrt(self.diagonal)).astype(np.float32)
        component, cell = np.divmod(face.index, n)
        #: Position in the box of each free direction that is a component.
        self._places = component * math.prod(hessian.matrix.box.shape) + hessian.matrix.inside[cell]
        self._drawn: Floats = np.zeros((0, len(self.diagonal)))
        # Cells last, so that sums run over contiguous memory.
        turned = np.ascontiguousarray(face.basis.transpose(1, 2, 0)) if face.mixed else np.zeros((c, c, 0))
        #: The basis (component, direction, cell) in the precision of what it multiplies.
        self._turned: dict[Any, Any] = {np.dtype(kind): turned.astype(kind) for kind in (np.float32, np.float64)}
        self._root_of_more = np.sqrt(more).astype(np.float32)

    def _unfolded(self, v: Any) -> Any:
        """W v (k, component, cell) of values in the free directions (k, free)."""
        whole = np.zeros((len(v), self._shape[0] * self._shape[1]), dtype=v.dtype)
        whole[:, self.face.index] = v
        x = whole.reshape(len(v), *self._shape)
        return np.einsum("dki,ski->sdi", self._turned[v.dtype], x) if self.face.mixed else x

    def _folded(self, x: Any) -> Any:
        """W'x (k, free), the transpose of `_unfolded`."""
        if self.face.mixed:
            x = np.einsum("dki,sdi->ski", self._turned[x.dtype], x)
        return x.reshape(len(x), -1)[:, self.face.index]

    def _apply(self, v: Any) -> Any:
        """The product with H (k, free)."""
        # Scale by one root at a time: nearly fixed directions exceed single precision.
        root = self._root_of_more
        return self._folded(self.hessian.many(self._unfolded(v))) + root * (root * v)

    def _near(self, r: Any) -> Any:
        """Approximate H^-1 r for r (k, free), in single precision, by circulants of H
        (`palpate.inverse.constrained.circulant`).
        """
        matrix, circulants, r = self.hessian.matrix, self.hessian.circulants, self._small * r
        if len(circulants) == 1 and not self.face.mixed:  # one copy instead of two
            shape = len(r), self._shape[0], *matrix.box.shape
            y = np.zeros((len(r), math.prod(shape[1:])), dtype=r.dtype)
            y[:, self._places] = r
            return self._small * circulants[0][1].apply(y.reshape(shape)).reshape(len(r), -1)[:, self._places]
        x, found = self._unfolded(r), np.float32(0.0)
        for part, circulant in circulants:
            found = found + part * matrix.from_box(circulant.apply(matrix.in_box(part * x)))
        return self._small * self._folded(found)

    def solve(self, right: Floats) -> Floats:
        found = self._solved(right[None], STEP)[0]
        # Replace a step that overflows by zero; the exact residual that follows decides.
        return np.asarray(np.where(np.isfinite(found), found, 0.0))

    def _solved(self, right: Floats, tolerance: float) -> Floats:
        """H^-1 right (k, free), in single precision, with a tolerance relative to each row; NaN on overflow, so that
        errors are unknown.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            size = np.sqrt((right**2 / self.diagonal).sum(axis=1))
            there = np.flatnonzero(size > 0)
            out = np.zeros(right.shape)
            if not len(there) or not right.shape[1]:
                return out
            r = (right[there] / size[there, None]).astype(np.float32)
            x = np.zeros_like(r)
            here = np.arange(len(there))
            z = self._near(r)
            direction, rz = z.copy(), _dots(r, z)
            small = tolerance**2 * rz
            bounded = tolerance == STEP and self.hessian.few
            for _ in range(SLOW if bounded else MAX_STEPS):
                moved = self._apply(direction)
                curvature = _dots(direction, moved)
                good = curvature > 0
                step = np.where(good, rz / np.where(good, curvature, 1.0), 0.0)[:, None].astype(np.float32)
                x[here] += step * direction
                r = r - step * moved
                z = self._near(r)
                new = _dots(r, z)
                going = (new > small) & good
                if not going.all():
                    here, rz, new, small = here[going], rz[going], new[going], small[going]
                    r, z, direction = r[going], z[going], direction[going]
                    if not len(here):
                        break
                direction = z + (new / rz)[:, None].astype(np.float32) * direction
                rz = new
            else:
                self.hessian.matrix.slow |= bounded
            out[there] = x.astype(np.float64) * size[there, None]
        return out

    def inverse(self, right: Floats) -> Floats:
        return self._solved(right.T, SHARP).T

    def roughly(self, right: Floats) -> Floats:
        """H^-1 right, for (free, k), with the accuracy of samples."""
        return self._solved(right.T, SAMPLE).T

    def squares(self, rows: Floats) -> Floats:
        """Diagonal of rows H^-1 rows', for (k, free); its error is the square of that of the solutions."""
        return np.asarray((rows * self._solved(rows, SAMPLE)).sum(axis=1))

    # -- samples

    def samples(self, count: int = SAMPLES) -> Floats:
        """Samples (sample, free) of a Gaussian with mean 0 and covariance H^-1, generated `FEW` at a time; the first
        ones are always the same.
        """
        while len(self._drawn) < count:
            rng = np.random.default_rng(len(self._drawn))
            right = self._folded(self.hessian.perturbed(rng, FEW))
            right = right + np.sqrt(self.more) * rng.standard_normal(right.shape)
            self._drawn = np.concatenate([self._drawn, self._solved(right, SAMPLE)])
        return self._drawn[:count]

    def variances(self, rows: Rows, *, few: bool = False) -> Floats:
        if not len(self.diagonal):
            return np.zeros(rows.count)
        return np.asarray((rows.times(self.samples(FEW if few else SAMPLES).T) ** 2).mean(axis=1))

    def taken(self) -> Floats:
        """Degrees of freedom that H uses of each reading."""
        matrix = self.hessian.matrix
        if not len(self.diagonal):
            return np.zeros(matrix.shape[0])
        seen = matrix.forward(self._unfolded(self.samples(FEW)) * self.hessian.scales[None, :, None])
        return np.asarray((seen**2).mean(axis=0))


def _dots(a: Any, b: Any) -> Floats:
    return np.array([float(np.dot(x, y)) for x, y in zip(a, b)])
