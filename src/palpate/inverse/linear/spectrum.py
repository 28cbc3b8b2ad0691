"""The spectrum of the problem on a free boundary.

Whiten the readings by their noise and the traction by a prior covariance W = C C^T: H = N^{-1/2} A C. With the
eigenvectors U and eigenvalues s^2 of H H^T, every linear method (`palpate.inverse.linear.regularised`) is

    traction = V diag(phi(s)/s) U^T N^{-1/2} readings,      V = W A^T N^{-1/2} U diag(1/s).

U and V depend on the operator and the prior, not on parameter, rule or readings (V is applied as an adjoint where it would be too
large to keep). U is dense, split by mirror symmetry into independent blocks where the layout has it (16 times less work in area
contact). On a periodic surface it is the Fourier transform (`palpate.inverse.linear.fourier`).
"""

from __future__ import annotations

import abc
import itertools
import math
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from palpate._arrays import from_numpy, namespace
from palpate._recall import digest
from palpate._threads import cached_property
from palpate.elastic.channels import find_channel, mirror_parity
from palpate.elastic.pad import Floats, Pad, mirror_symmetric
from palpate.inverse.linear.lumps import lumps
from palpate.inverse.linear.parameter import Tried, tried_on
from palpate.inverse.linear.priors import DifferencePrior, Prior
from palpate.inverse.linear.whitening import axis_roots, inverse_root
from palpate.sensing.arrays import Array, ScatteredArray
from palpate.sensing.grids import Grid
from palpate.sensing.maps import Cached, body_of
from palpate.sensing.operator import Operator

__all__ = ["DataSpectrum", "Shared", "Spectrum", "in_components", "noise_scales", "recall_key"]

#: Largest dense eigenproblem (readings in one symmetry block): five matrices of 134 MB; 64 x 64 x 3 by symmetry.
LARGEST_BLOCK = 4096
#: Largest number of entries for which the modes V are cached as a matrix: 48 MB.
LARGEST_MODES = 6_000_000
#: Largest number of readings for an SVD of H, which keeps small singular values. Beyond it, use an eigendecomposition
#: of H H^T, several times faster, which keeps those above the square root of the rounding error.
LARGEST_SVD = 700
#: Largest size in bytes of cached products of the readings with themselves, which serve priors of other strengths: 32 x
#: 32 x 3 take 57 MB.
LARGEST_PRODUCTS = 100_000_000
#: Number of modes computed at a time: the adjoint's temporary memory is then small compared with a surface of some
#: thousand cells.
MODES_AT_A_TIME = 256
#: Centres closer than this fraction of a cell are equal: positions are sums of a few hundred pitches, each rounded to
#: 1e-16.
SAME_CENTRE = 1e-9


class Spectrum(abc.ABC):
    """Singular values and vectors of the whitened operator, and the changes of basis to and from them."""

    operator: Operator
    #: s^2 of the whitened operator, and how many real data each coefficient stands for.
    eigenvalues: Floats
    multiplicity: Floats
    #: Whether the readings determine the mean of each component sought.
    mean_seen: npt.NDArray[np.bool_]

    @cached_property
    def tried(self) -> Tried:
        """Quantities for choosing Tikhonov's parameter that do not depend on the readings: 5 MB for 32 x 32 x 3."""
        return tried_on(self.eigenvalues, self.multiplicity)

    @property
    @abc.abstractmethod
    def nbytes(self) -> int:
        """Memory in bytes."""

    @abc.abstractmethod
    def project(self, readings: Sequence[Any]) -> Any:
        """U^T N^{-1/2} readings: (*batch, n), from one array (*batch, channel, *array) per plane."""

    @abc.abstractmethod
    def solve(self, weights: Any) -> Any:
        """V weights: traction (*batch, component, *surface), zero in components not sought."""

    @abc.abstractmethod
    def sums(self, rows: Floats) -> tuple[Floats, Floats]:
        """For sums w't of the traction, ``rows`` w (row, component sought, *surface): (w'V_i)^2 (row, n) and w'(W - V
        V')w (row,).
        """

    @abc.abstractmethod
    def cells(self) -> tuple[Floats, Floats, Floats]:
        """Return what the variance of the traction in every cell is computed from: eigenvalues (m,), the power of a
        cell in each eigenvector (m, component sought, *surface), and the rest, outside all eigenvectors (component
        sought, *surface). If all cells are alike, the axes of the surface have length 1.
        """


def noise_scales(operator: Operator, columns: Sequence[int]) -> tuple[list[Floats], bool]:
    """Standard deviation of each channel of each plane, and whether they are the true noise.

    If noise is not given, channels of one kind (stress, strain, displacement) count equally, and kinds are balanced by
    the root mean square of their response to unit traction.
    """
    given = [a.noise_std for a in operator.planes_of]
    if all(g is not None for g in given):
        return [np.asarray(g) for g in given], True
    kinds: dict[str, list[float]] = {}
    responses = []
    for array, plane in zip(operator.planes_of, operator.planes):
        unit = np.zeros((len(columns), len(operator.surface.components), *operator.surface.shape))
        centre = tuple(n // 2 for n in operator.surface.shape)
        for row, column in enumerate(columns):
            unit[(row, column, *centre)] = 1.0
        response = plane.forward(unit)
        size = np.sqrt((response**2).sum(axis=(0, *range(2, response.ndim))))
        responses.append(size)
        for channel, value in zip(array.channels, size):
            kinds.setdefault(find_channel(channel).kind.name, []).append(float(value))
    mean = {kind: math.sqrt(float(np.mean(np.square(v)))) for kind, v in kinds.items()}
    single = len(mean) == 1
    return [
        np.array([1.0 if single else mean[find_channel(c).kind.name] for c in a.channels]) for a in operator.planes_of
    ], False


def recall_key(
    what: str, operator: Operator, columns: Sequence[int], priors: Sequence[Prior], scales: Sequence[Floats]
) -> str | None:
    """The key of a computed value in `Recall`; None if a pad or a prior has no digest."""
    kinds = [(type(p).__qualname__, p.key) for p in priors]
    return digest(what, operator.pad, operator.planes_of, operator.surface, list(columns), kinds, list(scales))


def in_components(images: Any, columns: Sequence[int], count: int, dimensions: int, fill: float = 0.0) -> Any:
    """Images (..., component sought, *surface) among all ``count`` components; ``fill`` in those not sought."""
    if list(columns) == list(range(count)):
        return images
    xp, tail = namespace(images), (slice(None),) * dimensions
    other = xp.full_like(images[(..., 0, *tail)], fill)
    each = {column: images[(..., i, *tail)] for i, column in enumerate(columns)}
    return xp.stack([each.get(column, other) for column in range(count)], axis=-1 - dimensions)


def _halves(shape: Sequence[int], parities: Sequence[int]) -> list[Floats]:
    """For each axis of ``shape``, an orthonormal basis (row, entry) of the even (parity 1) or odd (-1) vectors."""
    bases = []
    for n, sign in zip(shape, parities):
        unit = np.eye(n)[: n // 2]
        basis = math.sqrt(0.5) * (unit + sign * unit[:, ::-1])
        middle = np.eye(n)[n // 2 : n // 2 + (n % 2 if sign > 0 else 0)]
        bases.append(np.concatenate([basis, middle]))
    return bases


@dataclass
class _Block:
    """One symmetry block: for each plane and channel, the bases of its axes (None: all working taxels)."""

    bases: list[list[list[Cached]]] | None
    vectors: Cached
    eigenvalues: Floats


@dataclass
class _Products:
    """H W H' for each component in each symmetry block, for priors of these strengths; another strength is a factor."""

    strengths: list[float]
    blocks: Iterable[tuple[list[list[list[Cached]]], list[Floats]]]

    @property
    def nbytes(self) -> int:
        """Memory in bytes."""
        return sum(p.nbytes for _, each in self.blocks for p in each)


#: Return the cached value under a key, or make it.
Shared: TypeAlias = Callable[[Hashable, Callable[[], _Products]], _Products]


class DataSpectrum(Spectrum):
    """Spectrum of H H^T for any layout, in symmetry blocks."""

    def __init__(
        self,
        operator: Operator,
        priors: Sequence[Prior],
        columns: Sequence[int],
        scales: Sequence[Floats],
        shared: Shared | None = None,
    ) -> None:
        self.operator, self.priors, self.columns, self.scales = operator, list(priors), list(columns), scales
        self._shared = shared
        symmetric = in_blocks(operator.pad, operator.planes_of, operator.surface)
        self._roots = [
            None
            if symmetric or not a.noise_correlation
            else Cached(inverse_root(a.points[a.valid.ravel()], a.noise_correlation))
            for a in operator.planes_of
        ]
        self.key = recall_key("spectrum", operator, self.columns, priors, scales)
        self.blocks = self._recalled(symmetric) or (self._symmetric_blocks() if symmetric else [self._whole()])
        self.eigenvalues = np.concatenate([b.eigenvalues for b in self.blocks])
        self.multiplicity = np.ones(len(self.eigenvalues))
        self.mean_seen = np.ones(len(self.columns), dtype=bool)
        self._scales = [Cached(s.reshape(-1, *(1,) * len(a.shape))) for s, a in zip(scales, operator.planes_of)]
        self._modes: Cached | None = None
        count = len(self.eigenvalues)
        if count * len(self.columns) * math.prod(operator.surface.shape) <= LARGEST_MODES:
            starts = range(0, count, MODES_AT_A_TIME)
            modes = [self._some_modes(slice(i, min(i + MODES_AT_A_TIME, count))) for i in starts]
            self._modes = Cached(np.concatenate(modes))

    @property
    def nbytes(self) -> int:
        modes = 0 if self._modes is None else self._modes.value.nbytes
        return modes + sum(b.vectors.value.nbytes for b in self.blocks)

    def _recalled(self, symmetric: bool) -> list[_Block] | None:
        """The blocks computed by an earlier run."""
        operator = self.operator
        if operator.recall is None:
            return None
        each: list[list[list[list[Cached]]] | None] = [None]
        sizes = [sum(int(a.valid.sum()) * len(a.channels) for a in operator.planes_of)]
        if symmetric:
            bases = [self._bases(signs) for signs in itertools.product((1, -1), repeat=operator.surface.dimensions)]
            sizes = [sum(math.prod(len(axis.value) for axis in c) for p in b for c in p) for b in bases]
            each = [*bases]
        shapes = [shape for n in sizes for shape in ((n, n), (n,))]
        found = operator.recall.find(self.key, shapes)
        if found is None:
            return None
        return [_Block(b, Cached(v), e) for b, v, e in zip(each, found[::2], found[1::2])]

    def worked_out(self) -> dict[str, tuple[Floats, ...]]:
        """The blocks, for `Recall`."""
        if self.key is None:
            return {}
        return {self.key: tuple(part for b in self.blocks for part in (b.vectors.value, b.eigenvalues))}

    def _bases(self, signs: Sequence[int]) -> list[list[list[Cached]]]:
        """For one symmetry, the bases of the axes for each plane and channel."""
        axes = "x" if len(signs) == 1 else "yx"
        out: list[list[list[Cached]]] = []
        for array in self.operator.planes_of:
            roots = axis_roots(array)
            out.append([])
            for channel in array.channels:
                basis = _halves(array.shape, [s * mirror_parity(channel, ax) for s, ax in zip(signs, axes)])
                out[-1].append([Cached(b if roots is None else b @ roots[i]) for i, b in enumerate(basis)])
        return out

    def _inverse_root(self) -> Floats:
        positive = self.eigenvalues > 0
        return np.where(positive, 1.0 / np.sqrt(np.where(positive, self.eigenvalues, 1.0)), 0.0)

    def _whole(self) -> _Block:
        surface = self.operator.surface
        matrix = self.operator.dense().reshape(-1, len(surface.components), *surface.shape)[:, self.columns]
        row = 0
        for array, scale, root in zip(self.operator.planes_of, self.scales, self._roots):
            working = int(array.valid.sum())
            for value in scale:
                part = matrix[row : row + working] / value
                matrix[row : row + working] = part if root is None else np.tensordot(root.value, part, 1)
                row += working
        rooted = [prior.root(matrix[:, i]).reshape(len(matrix), -1) for i, prior in enumerate(self.priors)]
        values, vectors = _svd(np.concatenate(rooted, axis=1))
        return _Block(None, Cached(vectors), values)

    def _symmetric_blocks(self) -> list[_Block]:
        kinds = [(p.order, None) if isinstance(p, DifferencePrior) else (None, p.key) for p in self.priors]
        strengths = [p.scale if isinstance(p, DifferencePrior) else 1.0 for p in self.priors]
        if self._shared is not None and self._product_size() <= LARGEST_PRODUCTS:
            key = (tuple(kinds), tuple(float(v) for s in self.scales for v in s))
            products = self._shared(key, lambda: _Products(strengths, list(self._products())))
        else:
            products = _Products(strengths, self._products())
        blocks = []
        for bases, each in products.blocks:
            gram: Floats | None = None
            for strength, known, product in zip(strengths, products.strengths, each):
                part = product if strength == known else product * (strength / known)
                gram = part if gram is None else gram + part
            values, vectors = _eigh(np.zeros((0, 0)) if gram is None else gram.copy())
            blocks.append(_Block(bases, Cached(vectors), values))
        return blocks

    def _products(self) -> Iterator[tuple[list[list[list[Cached]]], list[Floats]]]:
        """For each symmetry block: its bases, and H W H' for each component."""
        for bases, folded in self._symmetric_rows():
            yield bases, [rows @ weighted.T for rows, weighted, _ in folded]

    def _product_size(self) -> float:
        """Bytes that the products of all blocks take."""
        readings = sum(math.prod(a.shape) * len(a.channels) for a in self.operator.planes_of)
        return 8.0 * len(self.columns) * readings**2 / 2**self.operator.surface.dimensions

    def _symmetric_rows(
        self,
    ) -> Iterator[tuple[list[list[list[Cached]]], list[tuple[Floats, Floats, list[Floats]]]]]:
        """For each symmetry block: its bases, and for each component N^{-1/2} A and N^{-1/2} A W in the basis of half
        axes, which is also returned.
        """
        surface, names = self.operator.surface, self.operator.surface.components
        d = surface.dimensions
        axes = "x" if d == 1 else "yx"
        every = self.columns == list(range(len(names)))
        dense = [p.dense() for p in self.operator.planes]
        for signs in itertools.product((1, -1), repeat=d):
            bases = self._bases(signs)
            rows: list[Floats] = []
            for of_plane, matrix, scale in zip(bases, dense, self.scales):
                for c, basis in enumerate(of_plane):
                    sought = matrix[c] if every else np.take(matrix[c], self.columns, axis=d)
                    rows.append(_rows_folded(sought, [b.value for b in basis]))
                    rows[-1] /= scale[c]
            stacked = np.concatenate(rows)
            folded = []
            for i, column in enumerate(self.columns):
                # Both images are symmetric: half of each axis contains everything.
                parities = [s * mirror_parity(names[column], ax) for s, ax in zip(signs, axes)]
                halves = _halves(surface.shape, parities)
                half = _folded(stacked[:, i], halves)
                folded.append((half, _weighted(self.priors[i], half, halves, parities), halves))
            yield bases, folded

    def project(self, readings: Sequence[Any]) -> Any:
        like = readings[0]
        xp, planes = namespace(like), self.operator.planes_of
        d, scaled = len(planes[0].shape), [r / s.like(like) for r, s in zip(readings, self._scales)]
        batch = like.shape[: -1 - d]
        out = []
        for block in self.blocks:
            parts = []
            for p, (array, part) in enumerate(zip(planes, scaled)):
                if block.bases is None:
                    flat = xp.reshape(part, (*batch, len(array.channels), -1))
                    if array.mask is not None:
                        flat = xp.take(flat, _index(np.flatnonzero(array.valid), like), axis=-1)
                    root = self._roots[p]
                    images = [flat if root is None else xp.matmul(flat, root.like(like))]
                else:
                    images = [
                        _applied(xp, [b.like(like) for b in bases], part[(..., c, *(slice(None),) * d)])
                        for c, bases in enumerate(block.bases[p])
                    ]
                parts += [xp.reshape(image, (*batch, -1)) for image in images]
            out.append(xp.matmul(xp.concat(parts, axis=-1), block.vectors.like(like)))
        return xp.concat(out, axis=-1)

    def solve(self, weights: Any) -> Any:
        xp, surface = namespace(weights), self.operator.surface
        if self._modes is None:
            # Small singular values are divided by before the operator multiplies by them again, which float32 cannot
            # represent.
            wide = xp.astype(weights, xp.float64)
            images = xp.astype(self._adjoint(wide * from_numpy(self._inverse_root(), wide)), weights.dtype)
        else:
            images = xp.matmul(weights, self._modes.like(weights))
            images = xp.reshape(images, (*weights.shape[:-1], len(self.columns), *surface.shape))
        return in_components(images, self.columns, len(surface.components), surface.dimensions)

    def sums(self, rows: Floats) -> tuple[Floats, Floats]:
        # Most rows are sums of one component: pressure.
        loaded = [i for i in range(len(self.priors)) if rows[:, i].any()] or [0]
        if len(loaded) < len(self.priors):
            rows = rows[:, loaded]
        weighted = np.stack([self.priors[i].covariance(rows[:, at]) for at, i in enumerate(loaded)], axis=1)
        whole = (rows * weighted).reshape(len(rows), -1).sum(axis=1)
        if self._modes is not None:
            modes = self._modes.value.reshape(len(self.eigenvalues), len(self.columns), -1)[:, loaded]
            inner = rows.reshape(len(rows), -1) @ modes.reshape(len(modes), -1).T
        else:
            readings = self.operator.forward(weighted, [self.columns[i] for i in loaded])
            inner = self.project(readings) * self._inverse_root()
        powers = inner**2
        return powers, np.maximum(whole - powers.sum(axis=1), 0.0)

    def cells(self) -> tuple[Floats, Floats, Floats]:
        """As `Spectrum.cells`, with close eigenvalues grouped if there are many."""
        shape = (len(self.columns), *self.operator.surface.shape)
        nodes, weights = lumps(self.eigenvalues)
        powers, total = np.zeros((len(nodes), *shape)), np.zeros(shape)
        root, start = self._inverse_root(), 0
        if self._modes is None and self.blocks[0].bases is not None:
            for block, (_, folded) in zip(self.blocks, self._symmetric_rows()):
                here = slice(start, start + len(block.eigenvalues))
                start = here.stop
                for i, (_, weighted, halves) in enumerate(folded):
                    squares = (root[here, None] * (block.vectors.value.T @ weighted)) ** 2
                    # A mode is even or odd, so that its square is even: each cell has an entry on half of each axis.
                    powers[:, i] += _unfolded(weights[:, here] @ squares, halves)
                    total[i] += _unfolded(squares.sum(axis=0)[None], halves)[0]
        else:
            for start in range(0, len(root), MODES_AT_A_TIME):
                here = slice(start, min(start + MODES_AT_A_TIME, len(root)))
                each = self._some_modes(here) ** 2
                powers += (weights[:, here] @ each).reshape(powers.shape)
                total += each.sum(axis=0).reshape(shape)
        rest = np.stack([prior.variance() for prior in self.priors]) - total
        return nodes, powers, np.maximum(rest, 0.0)

    def _some_modes(self, here: slice) -> Floats:
        """Rows of V^T (mode, component sought * cell)."""
        if self._modes is not None:
            return np.asarray(self._modes.value[here])
        root = self._inverse_root()
        unit = np.zeros((here.stop - here.start, len(root)))
        unit[np.arange(len(unit)), np.arange(here.start, here.stop)] = root[here]
        return np.asarray(self._adjoint(unit).reshape(len(unit), -1))

    def _adjoint(self, weights: Any) -> Any:
        """W A^T N^{-1/2} U weights: (..., component sought, *surface)."""
        xp, planes = namespace(weights), self.operator.planes_of
        d, batch = len(planes[0].shape), weights.shape[:-1]
        totals: list[Any] = [0.0] * len(planes)
        start = 0
        for block in self.blocks:
            n = len(block.eigenvalues)
            flat = xp.matmul(weights[..., start : start + n], block.vectors.like(weights).T)
            start += n
            row = 0
            for p, array in enumerate(planes):
                if block.bases is None:
                    channels, working = len(array.channels), int(array.valid.sum())
                    part = xp.reshape(flat[..., row : row + channels * working], (*batch, channels, working))
                    row += channels * working
                    root = self._roots[p]
                    if root is not None:
                        part = xp.matmul(part, root.like(weights))
                    if array.mask is not None:  # missing taxels are zero
                        place = np.where(array.valid, np.cumsum(array.valid).reshape(array.shape) - 1, working)
                        whole = xp.concat([part, xp.zeros_like(part[..., :1])], axis=-1)
                        part = xp.take(whole, _index(place, weights), axis=-1)
                    image = xp.reshape(part, (*batch, channels, *array.shape))
                else:
                    images = []
                    for bases in block.bases[p]:
                        shape = tuple(len(b.value) for b in bases)
                        part = xp.reshape(flat[..., row : row + math.prod(shape)], (*batch, *shape))
                        row += math.prod(shape)
                        images.append(_applied(xp, [b.like(weights).T for b in bases], part))
                    image = xp.stack(images, axis=-1 - d)
                totals[p] = totals[p] + image
        seen = self.operator.adjoint([t / s.like(weights) for t, s in zip(totals, self._scales)], self.columns)
        tail = (slice(None),) * self.operator.surface.dimensions
        parts = [prior.covariance(seen[(..., i, *tail)]) for i, prior in enumerate(self.priors)]
        return xp.stack(parts, axis=-1 - len(tail))


def _folded(rows: Floats, halves: Sequence[Floats]) -> Floats:
    rows = rows @ halves[-1].T
    if len(halves) == 2:
        rows = halves[0] @ rows
    return rows.reshape(len(rows), -1)


def _weighted(prior: Prior, rows: Floats, halves: Sequence[Floats], parities: Sequence[int]) -> Floats:
    """Rows (row, cell) in the basis of half axes times W, which takes even functions to even ones and odd to odd."""
    image = rows.reshape(len(rows), *(len(basis) for basis in halves))
    if isinstance(prior, DifferencePrior):
        sines = prior.half_sines(halves, parities)
        weighted = prior.in_sines[tuple(slice(0 if sign > 0 else 1, None, 2) for sign in parities)]
        out = _applied(np, sines, weighted * _applied(np, [s.T for s in sines], image))
        return np.asarray(out.reshape(rows.shape))
    whole = prior.covariance(_applied(np, [basis.T for basis in halves], image))
    return _folded(whole, halves)


def _rows_folded(matrix: Floats, bases: Sequence[Floats]) -> Floats:
    """(*array, component, *surface) with its array axes in these bases: (row, component, *surface)."""
    out = bases[0] @ matrix.reshape(len(matrix), -1)
    if len(bases) == 2:
        out = bases[1] @ out.reshape(len(out), matrix.shape[1], -1)
    return out.reshape(-1, *matrix.shape[len(bases) :])


def _unfolded(powers: Floats, halves: Sequence[Floats]) -> Floats:
    """Squares (row, *surface) from the basis of half axes, for functions that are even or odd."""
    out = powers.reshape(len(powers), *(len(basis) for basis in halves))
    for axis, basis in enumerate(halves):
        out = np.moveaxis(np.tensordot(out, basis**2, axes=(1 + axis, 0)), -1, 1 + axis)
    return np.asarray(out)


def _applied(xp: Any, matrices: Sequence[Any], image: Any) -> Any:
    """An image (..., *array) multiplied by one matrix along each axis."""
    if len(matrices) == 1:
        return xp.matmul(image[..., None, :], matrices[0].T)[..., 0, :]
    return xp.matmul(matrices[0], xp.matmul(image, matrices[1].T))


def _index(places: npt.NDArray[np.intp], like: Any) -> Any:
    """Flat indices on the device of ``like``."""
    return namespace(like).asarray(places.ravel(), device=getattr(like, "device", None))


def _svd(h: Floats) -> tuple[Floats, Floats]:
    """Eigenvalues and vectors of H H^T from H, which keeps small singular values.

    NumPy's decompositions let other threads run; SciPy's hold the lock of Python: a frame beside them waits 80 ms.
    """
    if len(h) > LARGEST_SVD:
        return _eigh(h @ h.T)
    u, s, _ = np.linalg.svd(h, full_matrices=False)
    if u.shape[1] < len(h):  # more readings than unknowns: the rest of the data space has eigenvalue 0
        u = np.linalg.qr(u, mode="complete")[0]
        s = np.concatenate([s, np.zeros(len(h) - len(s))])
    # Directions below rounding have no effect, such as the mean of readings without a zero.
    s = np.where(s > np.finfo(np.float64).eps * max(h.shape) * s[0], s, 0.0)
    return np.asarray(s**2), np.asarray(u)


def _eigh(gram: Floats) -> tuple[Floats, Floats]:
    values, vectors = np.linalg.eigh(0.5 * (gram + gram.T))
    floor = np.finfo(np.float64).eps * len(values) * values[-1]
    return np.where(values > floor, values, 0.0), np.asarray(vectors)


def in_blocks(pad: Pad, planes: Sequence[Array], surface: Grid) -> bool:
    """Whether the problem can be split by symmetry, and is large enough to be worth it."""
    if sum(math.prod(a.shape) * len(a.channels) for a in planes) <= LARGEST_SVD:
        return False
    return mirrored(pad, planes, surface)


def mirrored(pad: Pad, planes: Sequence[Array], surface: Grid) -> bool:
    """Whether pad, arrays and surface are mirror images of themselves about one centre."""
    if body_of(pad) is not None:  # the symmetry of its maps is unknown, but where it says it
        says = getattr(pad, "mirrored_in", None)
        if says is None or not says(planes, surface):
            return False
    for array in planes:
        if isinstance(array, ScatteredArray) or array.mask is not None:
            return False
        for a, b, dx in zip(array.grid.axes, surface.axes, surface.spacings):
            if abs((a[0] + a[-1]) - (b[0] + b[-1])) > SAME_CENTRE * dx:
                return False
    extent = max(float(np.ptp(a.points, axis=0).max()) for a in planes)
    return all(mirror_symmetric(pad, a.depth, extent) for a in planes)
