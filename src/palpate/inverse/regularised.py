"""Linear regularised inversion through the spectrum of the problem.

Whiten the readings by their noise and the traction by a prior covariance W = C C^T: H = N^{-1/2} A C. With the
eigenvectors U and eigenvalues s^2 of H H^T, every linear method is

    traction = V diag(phi(s)/s) U^T N^{-1/2} readings,      V = W A^T N^{-1/2} U diag(1/s),

prepared once; a frame costs two changes of basis (V is applied as an adjoint where it would be too large to keep). On a periodic surface U is the Fourier transform and
a small matrix per wavevector; otherwise U is dense, split by mirror symmetry into independent blocks where the layout
has it (16 times less work in area contact).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate._arrays import from_numpy, irfftn, namespace, rfftn, to_numpy
from palpate._memory import SHARE, SMALL, available, gigabytes, require
from palpate.elastic.channels import find_channel, mirror_parity
from palpate.elastic.half_space import Floats
from palpate.elastic.pad import Pad, mirror_symmetric
from palpate.errors import InvalidInput, Unsupported
from palpate.inverse.parameter import Filter, choose_parameter
from palpate.inverse.priors import Prior, wavenumbers
from palpate.inverse.whitening import axis_roots, inverse_root
from palpate.sensing.arrays import AreaArray, Array, LineArray, ScatteredArray
from palpate.sensing.grids import Grid
from palpate.sensing.operator import Operator, periodic_transfer
from palpate.sensing.surface import default_surface

__all__ = ["Estimate", "Regularised", "noise_scales"]

#: Largest dense eigenproblem that is tried (readings in one symmetry block).
LARGEST_BLOCK = 4096
#: How far past the array the widest default surface reaches, in depths (`palpate.skin.WIDE`).
WIDEST = 4.0
#: The modes V are kept as a matrix up to this many entries.
LARGEST_MODES = 6_000_000
#: Up to this many readings the decomposition is an SVD of H, beyond it an eigendecomposition of H H^T.
LARGEST_SVD = 700


@dataclass(frozen=True)
class Estimate:
    """What an inversion returns: the traction and how it was chosen.

    ``parameter``, ``noise_scale`` (noise in units of the whitening; 1 where the noise was given) and ``residual`` (root mean
    square misfit in the same units) have the batch shape, the noise of the
    constrained methods (*batch, channel); None from methods that have no such thing. Likewise ``errors``
    (`palpate.inverse.account.Errors`), ``converged``, ``contact`` (False: noise alone explains the frame), ``outliers``
    (*batch, reading), ``draws`` (*batch, draw, component, *surface), ``settling``, the time an
    analog network takes in units of its RC, ``pushed`` (False: contact that only pushes does not explain the frame), ``resolution`` [m] and
    ``sliding`` (probability that the contact slides as a whole; NaN where nothing touches).
    """

    traction: Any
    parameter: Floats | None
    noise_scale: Floats | None
    residual: Floats | None
    errors: Any = None
    converged: npt.NDArray[np.bool_] | None = None
    contact: npt.NDArray[np.bool_] | None = None
    outliers: npt.NDArray[np.bool_] | None = None
    draws: Floats | None = None
    settling: Floats | None = None
    pushed: npt.NDArray[np.bool_] | None = None
    resolution: Floats | None = None
    sliding: Floats | None = None


def noise_scales(operator: Operator, columns: Sequence[int]) -> tuple[list[Floats], bool]:
    """Standard deviation of each channel of each plane, and whether they are the true noise.

    Where noise was not given, channels of one kind (stress, strain, displacement) count equally, and kinds are
    balanced by the root mean square of their response to unit traction.
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


class _Fold:
    """Change of basis of a regular grid into mirror-symmetric and antisymmetric halves."""

    def __init__(self, shape: Sequence[int]) -> None:
        self.halves = [{s: _half_basis(n, s) for s in (1, -1)} for n in shape]

    def matrix(self, parities: Sequence[int]) -> list[Floats]:
        return [halves[p] for halves, p in zip(self.halves, parities)]


def _half_basis(n: int, sign: int) -> Floats:
    """Rows: an orthonormal basis of the even (+1) or odd (-1) vectors of length n."""
    pairs = n // 2
    basis = np.zeros((pairs + (n % 2 if sign > 0 else 0), n))
    for i in range(pairs):
        basis[i, i], basis[i, n - 1 - i] = math.sqrt(0.5), sign * math.sqrt(0.5)
    if n % 2 and sign > 0:
        basis[pairs, pairs] = 1.0
    return basis


@dataclass
class _Block:
    """One symmetry block: for each plane and channel, the bases of its axes (None: all working taxels)."""

    bases: list[list[list[Floats]]] | None
    vectors: Floats
    eigenvalues: Floats


class _DataSpectrum:
    """Spectrum of H H^T for any layout, in blocks."""

    def __init__(
        self, operator: Operator, priors: Sequence[Prior], columns: Sequence[int], scales: Sequence[Floats]
    ) -> None:
        self.operator, self.priors, self.columns, self.scales = operator, list(priors), list(columns), scales
        symmetric = _in_blocks(operator.pad, operator.planes_of, operator.surface)
        self._roots = [
            None
            if symmetric or not a.noise_correlation
            else inverse_root(a.points[a.valid.ravel()], a.noise_correlation)
            for a in operator.planes_of
        ]
        self.blocks = self._symmetric_blocks() if symmetric else [self._whole()]
        self.eigenvalues = np.concatenate([b.eigenvalues for b in self.blocks])
        self.multiplicity = np.ones(len(self.eigenvalues))
        self._copies: dict[tuple[Any, ...], Any] = {}
        self._modes: npt.NDArray[np.float64] | None = None
        unknowns = len(self.columns) * math.prod(operator.surface.shape)
        if len(self.eigenvalues) * unknowns <= LARGEST_MODES:
            unit = np.diag(self._inverse_root())
            rows = [self._adjoint(unit[i : i + 256])[:, self.columns] for i in range(0, len(unit), 256)]
            self._modes = np.concatenate(rows).reshape(-1, unknowns)
            self._copies.clear()

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
                matrix[row : row + working] = part if root is None else np.tensordot(root, part, 1)
                row += working
        rooted = [prior.root(matrix[:, i]).reshape(len(matrix), -1) for i, prior in enumerate(self.priors)]
        values, vectors = _svd(np.concatenate(rooted, axis=1))
        return _Block(None, vectors, values)

    def _symmetric_blocks(self) -> list[_Block]:
        surface, names = self.operator.surface, self.operator.surface.components
        d = surface.dimensions
        axes = "x" if d == 1 else "yx"
        cell_fold = _Fold(surface.shape)
        plane_folds = [_Fold(a.shape) for a in self.operator.planes_of]
        dense = [p.dense() for p in self.operator.planes]
        blocks = []
        for signs in itertools.product((1, -1), repeat=d):
            bases: list[list[list[Floats]]] = []
            rows: list[Floats] = []
            for array, fold, matrix, scale in zip(self.operator.planes_of, plane_folds, dense, self.scales):
                bases.append([])
                roots = axis_roots(array)
                for c, channel in enumerate(array.channels):
                    basis = fold.matrix([s * mirror_parity(channel, ax) for s, ax in zip(signs, axes)])
                    if roots is not None:
                        basis = [b @ r for b, r in zip(basis, roots)]
                    bases[-1].append(basis)
                    parts = []
                    for column in self.columns:
                        entry = np.take(matrix[c], column, axis=d)
                        for axis in range(d):
                            entry = np.moveaxis(np.tensordot(basis[axis], entry, axes=(1, axis)), 0, axis)
                        parts.append(entry.reshape(-1, *surface.shape) / scale[c])
                    rows.append(np.stack(parts, axis=1))
            stacked = np.concatenate(rows)
            gram = np.zeros((len(stacked), len(stacked)))
            for i, column in enumerate(self.columns):
                # both images are mirror images of themselves: half of each axis carries all
                halves = cell_fold.matrix([s * mirror_parity(names[column], ax) for s, ax in zip(signs, axes)])
                weighted = self.priors[i].covariance(stacked[:, i])
                gram += _folded(stacked[:, i], halves) @ _folded(weighted, halves).T
            values, vectors = _eigh(gram)
            blocks.append(_Block(bases, vectors, values))
        return blocks

    def project(self, readings: Sequence[Any]) -> Any:
        """U^T N^{-1/2} readings: (..., n)."""
        xp = namespace(readings[0])
        bases, vectors, scales, picks, roots, _ = self._prepared(readings[0])
        scaled = [r / s for r, s in zip(readings, scales)]
        out = []
        for block, basis, vector in zip(self.blocks, bases, vectors):
            parts = []
            for plane, part in enumerate(scaled):
                d = len(self.operator.planes_of[plane].shape)
                batch = part.shape[: -1 - d]
                if block.bases is None:
                    flat = xp.reshape(part, (*batch, part.shape[-1 - d], -1))
                    if picks[plane] is not None:
                        flat = xp.take(flat, picks[plane], axis=-1)
                    if roots[plane] is not None:
                        flat = xp.matmul(flat, roots[plane])
                    parts.append(xp.reshape(flat, (*batch, -1)))
                    continue
                for c, mats in enumerate(basis[plane]):
                    image = part[(..., c, *(slice(None),) * d)]
                    image = (
                        xp.matmul(image[..., None, :], mats[-1].T)[..., 0, :]
                        if d == 1
                        else xp.matmul(mats[0], xp.matmul(image, mats[1].T))
                    )
                    parts.append(xp.reshape(image, (*batch, -1)))
            out.append(xp.matmul(xp.concat(parts, axis=-1), vector))
        return xp.concat(out, axis=-1)

    def solve(self, weights: Any) -> Any:
        """V weights: traction (..., component, *surface), zero in components not sought."""
        xp = namespace(weights)
        if self._modes is None:
            # small singular values are divided by before the operator multiplies by them again: not in float32
            wide = xp.astype(weights, xp.float64)
            out = self._adjoint(wide * from_numpy(self._inverse_root(), wide))
            return xp.astype(out, weights.dtype)
        surface = self.operator.surface
        modes = self._prepared(weights)[5]
        batch = weights.shape[:-1]
        images = xp.reshape(xp.matmul(weights, modes), (*batch, len(self.columns), *surface.shape))
        tail = (slice(None),) * surface.dimensions
        zero = xp.zeros_like(images[(..., 0, *tail)])
        parts = [
            images[(..., self.columns.index(i), *tail)] if i in self.columns else zero
            for i in range(len(surface.components))
        ]
        return xp.stack(parts, axis=-1 - surface.dimensions)

    def _adjoint(self, weights: Any) -> Any:
        """W A^T N^{-1/2} U weights."""
        xp = namespace(weights)
        bases, vectors, scales, picks, roots, _ = self._prepared(weights)
        planes = self.operator.planes_of
        batch = weights.shape[:-1]
        totals: list[Any] = [None] * len(planes)
        start = 0
        for block, basis, vector in zip(self.blocks, bases, vectors):
            n = block.vectors.shape[1]
            flat = xp.matmul(weights[..., start : start + n], vector.T)
            start += n
            row = 0
            for plane, array in enumerate(planes):
                d = len(array.shape)
                if block.bases is None:
                    working = int(array.valid.sum())
                    size = working * len(array.channels)
                    part = xp.reshape(flat[..., row : row + size], (*batch, len(array.channels), working))
                    row += size
                    if roots[plane] is not None:
                        part = xp.matmul(part, roots[plane])
                    if picks[plane] is not None:
                        part = _scatter(xp, part, array.valid)
                    image = xp.reshape(part, (*batch, len(array.channels), *array.shape))
                else:
                    images = []
                    for mats in basis[plane]:
                        shape = tuple(m.shape[0] for m in mats)
                        size = math.prod(shape)
                        part = xp.reshape(flat[..., row : row + size], (*batch, *shape))
                        row += size
                        images.append(
                            xp.matmul(part[..., None, :], mats[-1])[..., 0, :]
                            if d == 1
                            else xp.matmul(mats[0].T, xp.matmul(part, mats[1]))
                        )
                    image = xp.stack(images, axis=-1 - d)
                totals[plane] = image if totals[plane] is None else totals[plane] + image
        adjoint = self.operator.adjoint([t / s for t, s in zip(totals, scales)])
        return self._select(xp, adjoint)

    def _select(self, xp: Any, adjoint: Any) -> Any:
        d = self.operator.surface.dimensions
        tail = (slice(None),) * d
        out = []
        for column in range(len(self.operator.surface.components)):
            part = adjoint[(..., column, *tail)]
            sought = column in self.columns
            out.append(self.priors[self.columns.index(column)].covariance(part) if sought else xp.zeros_like(part))
        return xp.stack(out, axis=-1 - d)

    def _prepared(self, like: Any) -> Any:
        xp = namespace(like)
        key = (xp.__name__, str(like.dtype), str(getattr(like, "device", "")))
        if key not in self._copies:
            bases = [
                None
                if b.bases is None
                else [[[from_numpy(m, like) for m in mats] for mats in plane] for plane in b.bases]
                for b in self.blocks
            ]
            vectors = [from_numpy(b.vectors, like) for b in self.blocks]
            scales = [
                from_numpy(s.reshape(-1, *(1,) * len(a.shape)), like)
                for s, a in zip(self.scales, self.operator.planes_of)
            ]
            picks = [
                None
                if a.mask is None
                else xp.asarray(np.flatnonzero(a.valid.ravel()), device=getattr(like, "device", None))
                for a in self.operator.planes_of
            ]
            modes = None if self._modes is None else from_numpy(self._modes, like)
            roots = [None if r is None else from_numpy(r, like) for r in self._roots]
            self._copies[key] = bases, vectors, scales, picks, roots, modes
        return self._copies[key]


def _folded(rows: Floats, halves: Sequence[Floats]) -> Floats:
    for axis, basis in enumerate(halves):
        rows = np.moveaxis(np.tensordot(rows, basis, axes=(1 + axis, 1)), -1, 1 + axis)
    return rows.reshape(len(rows), -1)


def _scatter(xp: Any, part: Any, valid: npt.NDArray[np.bool_]) -> Any:
    """Put working taxels back into full rows, zero where masked."""
    place = np.zeros((int(valid.sum()), valid.size))
    place[np.arange(len(place)), np.flatnonzero(valid.ravel())] = 1.0
    return xp.matmul(part, from_numpy(place, part))


def _svd(h: Floats) -> tuple[Floats, Floats]:
    """Eigenvalues and vectors of H H^T from H, which keeps small singular values."""
    import scipy.linalg

    if len(h) > LARGEST_SVD:
        return _eigh(h @ h.T)
    u, s, _ = scipy.linalg.svd(h, full_matrices=False)
    if u.shape[1] < len(h):  # more readings than unknowns: the rest of the data space has eigenvalue 0
        u = np.linalg.qr(u, mode="complete")[0]
        s = np.concatenate([s, np.zeros(len(h) - len(s))])
    return np.asarray(s**2), np.asarray(u)


def _eigh(gram: Floats) -> tuple[Floats, Floats]:
    import scipy.linalg

    values, vectors = scipy.linalg.eigh(0.5 * (gram + gram.T), overwrite_a=True, check_finite=False)
    floor = np.finfo(np.float64).eps * len(values) * values[-1]
    return np.where(values > floor, values, 0.0), np.asarray(vectors)


def _in_blocks(pad: Pad, planes: Sequence[Array], surface: Grid) -> bool:
    """Whether the problem is worth splitting, and pad, arrays and surface are mirror images of themselves about one centre."""
    if sum(math.prod(a.shape) * len(a.channels) for a in planes) <= LARGEST_SVD:
        return False
    for array in planes:
        if isinstance(array, ScatteredArray) or array.mask is not None:
            return False
        for a, b, dx in zip(array.grid.axes, surface.axes, surface.spacings):
            if abs((a[0] + a[-1]) - (b[0] + b[-1])) > 1e-9 * dx:
                return False
    extent = max(float(np.ptp(a.points, axis=0).max()) for a in planes)
    return all(mirror_symmetric(pad, a.depth, extent) for a in planes)


# -- what it takes, known before any work ------------------------------------------------------------------------------


def block_size(pad: Pad, planes: Sequence[Array], surface: Grid) -> int:
    """Readings in the largest symmetry block."""
    if _in_blocks(pad, planes, surface):
        return sum(len(a.channels) * math.prod((n + 1) // 2 for n in a.shape) for a in planes)
    return sum(int(a.valid.sum()) * len(a.channels) for a in planes)


def spectrum_memory(pad: Pad, planes: Sequence[Array], surface: Grid, sought: int) -> float:
    """Most bytes at a time while the spectrum of ``sought`` components is prepared (`_DataSpectrum`).

    The matrix of each plane is made of one cell's influence, whole, and copied once into order: twice its size. In blocks, all planes
    stay while a quarter of them (half on a line) is weighted; else what is sought is whitened, weighted and joined, and an SVD needs two
    more. The eigenproblem of n readings holds five matrices of n^2.
    """
    cells, components = math.prod(surface.shape), len(surface.components)
    count = sum(math.prod(a.shape) * len(a.channels) for a in planes)
    largest = max(math.prod(a.shape) * len(a.channels) for a in planes)
    n = block_size(pad, planes, surface)
    row = 8.0 * cells * components
    part = sought / components
    if _in_blocks(pad, planes, surface):
        blocks = 2**surface.dimensions
        matrices = row * count + max(row * largest, row * count * (2.0 * part + 1.0) / blocks)
        kept = 8.0 * n * n * blocks
    else:
        matrices = row * count * max(2.0, 1.0 + part, (5.0 if n <= LARGEST_SVD else 3.0) * part)
        kept = 8.0 * n * n
    total = matrices + 5.0 * 8.0 * n * n + kept
    modes = 0.0
    if count * sought * cells <= LARGEST_MODES:
        modes = kept + 16.0 * count * sought * cells + 8.0 * row * min(count, 256)
    return max(total, modes)


def check_spectrum(pad: Pad, planes: Sequence[Array], surface: Grid, sought: int) -> None:
    """Refuse what the dense spectrum cannot serve, with what serves these very taxels instead."""
    size, peak, free = block_size(pad, planes, surface), spectrum_memory(pad, planes, surface, sought), available()
    fits = free is None or peak <= SHARE * free or peak < SMALL
    if size <= LARGEST_BLOCK and fits:
        return
    where = " x ".join(map(str, surface.shape))
    readings = sum(int(a.valid.sum()) * len(a.channels) for a in planes)
    need = f"{readings} readings on a surface of {where} cells need about {gigabytes(peak)} of memory"
    if free is not None:
        need += f" ({gigabytes(free)} are free)"
    if size > LARGEST_BLOCK:
        need += f" and an eigenproblem of {size} readings (limit {LARGEST_BLOCK})"
    raise Unsupported(f"{need}. {_remedy(pad, planes, sought, free)}")


def _check_waves(planes: Sequence[Array], surface: Grid) -> None:
    """Refuse more wavevectors of a periodic surface than memory holds."""
    waves = math.prod(surface.shape) // surface.shape[-1] * (surface.shape[-1] // 2 + 1)
    rows = sum(len(a.channels) for a in planes)
    # the matrices of all wavevectors, their whitened copy and the factors of the decomposition, complex
    require(
        16.0 * waves * (4.0 * rows * len(surface.components) + 2.0 * rows * rows + 4.0 * rows),
        f"{waves} wavevectors of {rows} channels",
        "Cut the readings into parts that overlap by a few depths.",
    )


def _served(pad: Pad, planes: Sequence[Array], sought: int, free: int | None) -> bool:
    surface = default_surface(planes, depths=WIDEST)
    peak = spectrum_memory(pad, planes, surface, sought)
    return block_size(pad, planes, surface) <= LARGEST_BLOCK and (free is None or peak <= 0.5 * free or peak < SMALL)


def _remedy(pad: Pad, planes: Sequence[Array], sought: int, free: int | None) -> str:
    """What would be served, tried by the same estimates."""
    first = planes[0]
    if isinstance(first, ScatteredArray):
        extent = np.ptp(first.points, axis=0)
        pitch = float((np.prod(extent) / len(first.points)) ** (1.0 / first.dimensions))
        for _ in range(200):
            pitch = float(f"{1.1 * pitch:.2g}")
            counts = np.maximum(2, np.floor(extent / pitch + 1e-9).astype(int))
            channels = first.channels
            if first.dimensions == 2:
                thin: list[Array] = [
                    AreaArray(shape=(counts[1], counts[0]), pitch=pitch, depth=a.depth, channels=channels)
                    for a in planes
                ]
                if _served(pad, thin, sought, free):
                    return (
                        f'Grid the recording with a pitch of {pitch:g} m or more (Recording.gridded({pitch:g}), palpate convert --grid "{1e3 * pitch:g} mm") '
                        "and describe it as an area plane."
                    )
            else:
                break
        return "Give fewer positions."
    words = []
    if all(a.mask is None and not a.noise_correlation and a.grid == first.grid for a in planes):  # type: ignore[union-attr]
        words.append('Skin(..., boundary="periodic") serves it (boundary = "periodic" in skin.toml, without a surface)')
    for step in range(2, 100):
        thinner = [_thinned(a, step) for a in planes]
        if _served(pad, thinner, sought, free):
            slices = ", ".join([f"::{step}"] * first.dimensions)
            words.append(
                f"every {step}{_ORDINAL.get(step, 'th')} taxel does (readings[..., {slices}], a pitch {step} times as large)"
            )
            break
    text = " or ".join(words) or "give fewer taxels"
    return f"{text[0].upper()}{text[1:]}."


_ORDINAL = {2: "nd", 3: "rd"}


def _thinned(array: Array, step: int) -> Array:
    """Every ``step``-th taxel of a regular array."""
    counts = [(n + step - 1) // step for n in array.shape]
    if isinstance(array, LineArray):
        return LineArray(count=max(counts[0], 2), pitch=step * array.pitch, depth=array.depth, channels=array.channels)
    pitch = (step * array.grid.spacings[0], step * array.grid.spacings[1])  # type: ignore[union-attr]
    return AreaArray(
        shape=(max(counts[0], 2), max(counts[1], 2)), pitch=pitch, depth=array.depth, channels=array.channels
    )


class _FourierSpectrum:
    """Spectrum of a periodic surface: a small SVD per wavevector."""

    def __init__(
        self, operator: Operator, priors: Sequence[Prior], columns: Sequence[int], scales: Sequence[Floats]
    ) -> None:
        self.operator, self.columns = operator, list(columns)
        grid = operator.surface
        if any(a.mask is not None for a in operator.planes_of):
            raise Unsupported('boundary="periodic" cannot leave out taxels; use boundary="free", or fill them first.')
        if any(a.noise_correlation for a in operator.planes_of):
            raise Unsupported(
                'boundary="periodic" takes noise as independent; use boundary="free" for correlated noise.'
            )
        matrices = [
            periodic_transfer(operator.pad, grid, a) / s.reshape(-1, *(1,) * (1 + grid.dimensions))
            for a, s in zip(operator.planes_of, scales)
        ]
        stacked = np.moveaxis(np.concatenate(matrices)[:, self.columns], (0, 1), (-2, -1))
        k = wavenumbers(grid.shape, grid.spacings)
        root = np.sqrt(np.stack([prior.spectrum(k) for prior in priors], axis=-1))  # (*k, component)
        u, s, vh = np.linalg.svd(stacked * root[..., None, :], full_matrices=True)
        rank = s.shape[-1]
        values = np.zeros(u.shape[:-1])
        values[..., :rank] = s**2
        half = np.full(values.shape, 2.0)
        half[..., 0, :] = 1.0
        if grid.shape[-1] % 2 == 0:
            half[..., -1, :] = 1.0
        self._shape = values.shape
        self.eigenvalues, self.multiplicity = values.ravel(), half.ravel()
        self._forward = np.conj(np.swapaxes(u, -1, -2))  # (*k, n, channel)
        shape: tuple[int, ...] = values.shape
        self._back = np.zeros((*shape[:-1], len(self.columns), shape[-1]), dtype=np.complex128)
        self._back[..., :rank] = root[..., :, None] * np.conj(np.swapaxes(vh, -1, -2))[..., :rank]
        self._scales = scales
        self._norm = math.sqrt(math.prod(grid.shape))
        self._copies: dict[tuple[Any, ...], Any] = {}

    def _prepared(self, like: Any) -> Any:
        # single-precision readings and coefficients share one key through the real dtype of the readings
        xp = namespace(like)
        key = (xp.__name__, str(like.dtype), str(getattr(like, "device", "")))
        if key not in self._copies:
            scales = [from_numpy(s.reshape(-1, *(1,) * self.operator.surface.dimensions), like) for s in self._scales]
            self._copies[key] = from_numpy(self._forward, like), from_numpy(self._back, like), scales
        return self._copies[key]

    def project(self, readings: Sequence[Any]) -> Any:
        xp, grid = namespace(readings[0]), self.operator.surface
        forward, _, scales = self._prepared(readings[0])
        d = grid.dimensions
        spectra = [rfftn(r / s, grid.shape) / self._norm for r, s in zip(readings, scales)]
        data = xp.moveaxis(xp.concat(spectra, axis=-1 - d), -1 - d, -1)
        out = xp.matmul(forward, data[..., None])[..., 0]
        return xp.reshape(out, (*out.shape[: -1 - d], -1))

    def solve(self, weights: Any) -> Any:
        xp, grid = namespace(weights), self.operator.surface
        _, back, _ = self._prepared(xp.real(weights))
        d = grid.dimensions
        batch = weights.shape[:-1]
        spectrum = xp.matmul(back, xp.reshape(weights, (*batch, *self._shape))[..., None])[..., 0]
        images = irfftn(xp.moveaxis(spectrum, -1, -1 - d) * self._norm, grid.shape)
        out = []
        for column in range(len(grid.components)):
            if column in self.columns:
                out.append(images[(..., self.columns.index(column), *(slice(None),) * d)])
            else:
                out.append(xp.zeros_like(images[(..., 0, *(slice(None),) * d)]))
        return xp.stack(out, axis=-1 - d)


class Regularised:
    """A regularised inversion, prepared once for an operator, priors and the components sought.

    Parameters
    ----------
    operator : Operator
    priors : sequence of Prior
        One per component sought.
    columns : sequence of int
        Indices of the traction components sought.
    filter_factors : Filter
        phi(s^2, lambda).
    parameter : float or str
        lambda, or the rule that chooses it for each frame.
    """

    def __init__(
        self,
        operator: Operator,
        priors: Sequence[Prior],
        columns: Sequence[int],
        filter_factors: Filter,
        parameter: float | str,
    ) -> None:
        if operator.boundary == "free":
            check_spectrum(operator.pad, operator.planes_of, operator.surface, len(columns))
        else:
            _check_waves(operator.planes_of, operator.surface)
        self.operator, self.filter, self.parameter = operator, filter_factors, parameter
        scales, self.noise_known = noise_scales(operator, columns)
        self.scales = scales
        spectrum = _FourierSpectrum if operator.boundary == "periodic" else _DataSpectrum
        self.spectrum = spectrum(operator, priors, columns, scales)
        if not isinstance(parameter, str) and not (math.isfinite(parameter) and parameter > 0):
            raise InvalidInput(f"parameter must be a positive number or the name of a rule; got {parameter!r}.")

    def solve(self, readings: Sequence[Any]) -> Estimate:
        """Traction from one readings array per plane."""
        xp = namespace(readings[0])
        coefficients = self.spectrum.project(readings)
        batch = coefficients.shape[:-1]
        values, counts = self.spectrum.eigenvalues, self.spectrum.multiplicity
        power = np.abs(to_numpy(coefficients).astype(np.complex128)) ** 2
        power = np.real(power).reshape(-1, len(values))
        if isinstance(self.parameter, str):
            chosen, variance = choose_parameter(
                self.parameter, self.filter, values, counts, power, noise_known=self.noise_known
            )
        else:
            chosen = np.full(len(power), float(self.parameter))
            phi = self.filter(values[None, :], chosen[:1, None])[0]
            free = max(float(counts @ (1.0 - phi)), 1.0)
            variance = (
                np.ones(len(power)) if self.noise_known else (power * counts * (1.0 - phi) ** 2).sum(axis=1) / free
            )
        phi = self.filter(values[None, :], chosen[:, None])
        gain = np.where(values > 0, phi / np.sqrt(np.where(values > 0, values, 1.0)), 0.0).reshape(*batch, -1)
        residual = np.sqrt((power * counts * (1.0 - phi) ** 2).sum(axis=1) / counts.sum())
        real = xp.real(coefficients) if xp.isdtype(coefficients.dtype, "complex floating") else coefficients
        traction = self.spectrum.solve(coefficients * from_numpy(gain, real))
        return Estimate(traction, chosen.reshape(batch), np.sqrt(variance).reshape(batch), residual.reshape(batch))
