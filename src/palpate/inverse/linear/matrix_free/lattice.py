"""M = H W H^T as a convolution: its symbol on the lattices of regular arrays, with two kinds of continuation beyond
the array's edge.

Far from edges M multiplies every wave by a small matrix with one row and column per channel. `Padded` continues
readings by zero (the inverse of a circulant matrix twice as long: R. Chan, M. Ng, SIAM Rev. 38, 1996, 427-482); it
includes the coupling of channels of different parity. `Cosines` continues them by their mirror image (M. Ng, R. Chan,
W.-C. Tang, SIAM J. Sci. Comput. 21, 1999, 851-866), which is better if the influence extends as far as the array, but
decouples channels of different parity. Both have a spectrum in closed form, used as a first approximation of sums over
the true one.
"""

from __future__ import annotations

import abc
import itertools
import math
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate.elastic.channels import mirror_parity
from palpate.elastic.pad import Floats
from palpate.inverse.linear.matrix_free.gaps import Gaps, gaps_of
from palpate.inverse.linear.matrix_free.normal import Normal
from palpate.inverse.linear.matrix_free.transforms import Cosine, along
from palpate.sensing.operator import Convolution

__all__ = ["Approximation", "Cosines", "Inverse", "Padded"]

#: Eigenvalues below this fraction of the largest count as zero.
MIN_EIGENVALUE = 1e-16
#: Inverses are computed for this many parameters per decade, and each frame uses the nearest: a preconditioner may be
#: 15 % off.
PER_DECADE = 8
#: Number of cached parameters, for small and for large inverses.
KEPT, FEW = 4, 2
#: A function of (rows, index of each row's frame) that solves approximately.
Inverse = Callable[[Floats, Any], Floats]
Index = npt.NDArray[np.intp]


@dataclass
class _Lattice:
    """Channels (plane, channel) on one lattice, and for each wave the eigenvectors (*wave, channel, mode) and
    eigenvalues of their symbol.
    """

    members: list[tuple[int, int]]
    vectors: Any
    values: Floats
    size: tuple[int, ...]


class Approximation(abc.ABC):
    """An approximation of M with ``eigenvalues`` (n,), their multiplicities ``counts``, and an inverse in closed form."""

    def __init__(self, normal: Normal) -> None:
        self.normal = normal
        self.lattices = [self._lattice(members) for members in _members(normal, self._split)]
        self.eigenvalues = np.concatenate([g.values.ravel() for g in self.lattices])
        self.counts = np.concatenate([self._counts(g).ravel() for g in self.lattices])
        self._kept: OrderedDict[tuple[tuple[float, ...], Any], tuple[list[Any], list[Gaps]]] = OrderedDict()

    _split = False

    @property
    def nbytes(self) -> int:
        """Memory in bytes."""
        kept = sum(m.nbytes for matrices, _ in self._kept.values() for m in matrices)
        return int(sum(g.values.nbytes + g.vectors.nbytes for g in self.lattices) + 2 * self.eigenvalues.nbytes + kept)

    def powers(self, rows: Floats) -> Floats:
        """Squared coefficients (frame, n) of rows; their sum is the squared length of the row."""
        planes, out = self.normal.planes(rows), []
        for g in self.lattices:
            waves = np.moveaxis(self._waves(planes, g), 1, -1)
            modes = (np.conj(np.swapaxes(g.vectors, -1, -2)) @ waves[..., None])[..., 0]
            out.append((np.abs(modes) ** 2 * self._share(g)).reshape(len(rows), -1))
        return np.concatenate(out, axis=1)

    def _symbol(self, members: list[tuple[int, int]], size: tuple[int, ...], *, real: bool) -> Any:
        """(*wave of a real FFT of size, channel, channel), Hermitian."""
        normal = self.normal
        plane = _convolution(normal, members[0][0])
        fine = tuple(n * r for n, r in zip(size, plane.ratios))
        influences = [_influence(normal, p, c, fine) / normal.scale(p, c) for p, c in members]
        priors = [prior.symbol(fine) for prior in normal.priors]
        g = len(members)
        out: Any = None
        for i, j in itertools.product(range(g), repeat=2):
            if j < i:
                continue
            total = sum(w * (a * np.conj(b)) for w, a, b in zip(priors, influences[i], influences[j]))
            part = _sampled(total, fine, plane.ratios)
            whiteness = normal.whiteness(members[i][0], part.shape, size)
            if whiteness is not None:
                part = part * whiteness
            if out is None:
                out = np.empty((*part.shape, g, g), dtype=np.float64 if real else np.complex128)
            out[..., i, j] = part.real if real else part
            out[..., j, i] = part.real if real else np.conj(part)
        return out

    def _decomposed(self, members: list[tuple[int, int]], symbol: Any, size: tuple[int, ...]) -> _Lattice:
        if len(members) == 1:
            values = symbol[..., 0].real
            return _Lattice(members, np.ones_like(symbol), np.maximum(values, MIN_EIGENVALUE * values.max()), size)
        values, vectors = np.linalg.eigh(symbol)
        return _Lattice(members, vectors, np.maximum(values, MIN_EIGENVALUE * values.max()), size)

    def at(self, parameter: Floats) -> Inverse:
        """(M + lambda)^{-1}, in the precision of the rows, for parameters near those given; symmetric and positive
        definite.
        """
        places, given = np.unique(np.round(PER_DECADE * np.log10(parameter)), return_inverse=True)
        made: dict[Any, tuple[list[Any], list[Gaps]]] = {}

        def inverse(rows: Floats, which: Any) -> Floats:
            if rows.dtype not in made:
                made[rows.dtype] = self._made(tuple(places.tolist()), rows.dtype)
            matrices, gaps = made[rows.dtype]
            place = given[which]
            out = whole(rows, place, matrices)
            if gaps:
                rows = rows.copy()
                for gap in gaps:
                    rows[:, gap.index] -= gap.weights(out[:, gap.index], place)
                out = whole(rows, place, matrices)
            return out if self.normal.valid is None else out * self.normal.valid

        def whole(rows: Floats, place: Any, matrices: list[Any]) -> Floats:
            planes = self.normal.planes(rows)
            out = [np.empty_like(p) for p in planes]
            for g, matrix in zip(self.lattices, matrices):
                waves = self._waves(planes, g)
                shape = planes[g.members[0][0]].shape[2:]
                for i, (p, c) in enumerate(g.members):
                    moved: Any = 0.0
                    for j in range(len(g.members)):
                        entry = matrix[:, i, j]
                        part = (entry if len(places) == 1 else entry[place]) * waves[:, j]
                        moved = part if j == 0 else np.add(moved, part, out=moved)
                    out[p][:, c] = self._back(moved, g, shape)
            parts = [p.reshape(len(p), -1) for p in out]
            return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)

        return inverse

    def _made(self, places: tuple[float, ...], kind: Any) -> tuple[list[Any], list[Gaps]]:
        """Matrices of the inverses and corrections for missing readings, by parameter; the last few are cached."""
        found = self._kept.get((places, kind))
        if found is None:
            parameter = 10.0 ** (np.array(places) / PER_DECADE)
            found = self._matrices(parameter, kind), self._gaps(parameter, kind)
            if len(places) <= FEW:
                self._kept[places, kind] = found
                while sum(len(key[0]) for key in self._kept) > KEPT:
                    self._kept.popitem(last=False)
        else:
            self._kept.move_to_end((places, kind))
        return found

    def _gaps(self, parameter: Floats, kind: Any) -> list[Gaps]:
        """Correction for the missing readings of each lattice that has any."""
        normal = self.normal
        if normal.valid is None:
            return []
        starts = np.cumsum([0, *normal.sizes[:-1]])
        found = []
        for g, matrix in zip(self.lattices, self._matrices(parameter, np.float64)):
            missing = [np.flatnonzero(~normal.operator.planes_of[p].valid.ravel()) for p, _ in g.members]
            points = [np.unravel_index(m, normal.shapes[p][1:]) for m, (p, _) in zip(missing, g.members)]
            index = [starts[p] + c * math.prod(normal.shapes[p][1:]) + m for m, (p, c) in zip(missing, g.members)]

            def block(
                k: int, i: int, j: int, matrix: Any = matrix, g: _Lattice = g, points: list[Any] = points
            ) -> Floats:
                return self._between(matrix[k, i, j], g, points[i], points[j])

            gap = gaps_of(index, block, len(parameter), kind)
            if gap is not None:
                found.append(gap)
        return found

    def _matrices(self, parameter: Floats, dtype: Any) -> list[Any]:
        """Matrices (parameter, channel, channel, *wave) of the inverses."""
        out = []
        for g in self.lattices:
            lam = parameter.reshape(-1, *(1,) * g.values.ndim)
            if len(g.members) == 1:
                out.append((1.0 / (g.values + lam))[..., 0][:, None, None].astype(dtype))
                continue
            inverse = (g.vectors / (g.values + lam)[..., None, :]) @ np.conj(np.swapaxes(g.vectors, -1, -2))
            kind = np.result_type(dtype, np.complex64) if np.iscomplexobj(inverse) else dtype
            out.append(np.ascontiguousarray(np.moveaxis(inverse, (-2, -1), (1, 2)), dtype=kind))
        return out

    @abc.abstractmethod
    def _lattice(self, members: list[tuple[int, int]]) -> _Lattice:
        """Symbol, eigenvalues and eigenvectors of the channels of one lattice."""

    @abc.abstractmethod
    def _counts(self, lattice: _Lattice) -> Floats:
        """The multiplicity of each eigenvalue."""

    @abc.abstractmethod
    def _share(self, lattice: _Lattice) -> Any:
        """Factor (*wave, 1) from the squares of coefficients to parts of the squared length of a row."""

    @abc.abstractmethod
    def _waves(self, planes: Sequence[Floats], g: _Lattice) -> Any:
        """Waves (frame, channel, *wave) of the channels of a lattice."""

    @abc.abstractmethod
    def _between(self, entry: Any, lattice: _Lattice, to: Sequence[Index], of: Sequence[Index]) -> Floats:
        """Entries of a matrix with the symbol ``entry`` (*wave) between two sets of places (given axis by axis):
        (place, place).
        """

    @abc.abstractmethod
    def _back(self, waves: Any, lattice: _Lattice, shape: Sequence[int]) -> Floats:
        """The readings (frame, *array) of one channel from its waves."""


class Padded(Approximation):
    """Continues the readings by zero."""

    def _lattice(self, members: list[tuple[int, int]]) -> _Lattice:
        from scipy.fft import next_fast_len

        shape = self.normal.shapes[members[0][0]][1:]
        size = tuple(2 * next_fast_len(n, real=True) for n in shape)
        return self._decomposed(members, self._symbol(members, size, real=False), size)

    def _counts(self, lattice: _Lattice) -> Floats:
        planes = self.normal.operator.planes_of
        working = np.array([planes[p].valid.sum() for p, _ in lattice.members], dtype=np.float64)
        return np.asarray(self._share(lattice) * np.einsum("...ci,c->...i", np.abs(lattice.vectors) ** 2, working))

    def _share(self, lattice: _Lattice) -> Any:
        return (_half(lattice) / math.prod(lattice.size))[..., None]

    def _waves(self, planes: Sequence[Floats], g: _Lattice) -> Any:
        from scipy.fft import rfftn

        data = np.stack([planes[p][:, c] for p, c in g.members], axis=1)
        return rfftn(data, s=g.size, axes=tuple(range(2, data.ndim)))

    def _back(self, waves: Any, lattice: _Lattice, shape: Sequence[int]) -> Floats:
        return _cropped(waves, lattice.size, shape)

    def _between(self, entry: Any, lattice: _Lattice, to: Sequence[Index], of: Sequence[Index]) -> Floats:
        from scipy.fft import irfftn

        lags = irfftn(entry, s=lattice.size)
        return np.asarray(lags[tuple((t[:, None] - o) % n for t, o, n in zip(to, of, lattice.size))])


class Cosines(Approximation):
    """Continues the readings by their mirror image."""

    _split = True

    def _lattice(self, members: list[tuple[int, int]]) -> _Lattice:
        shape = self.normal.shapes[members[0][0]][1:]
        self._axes = getattr(self, "_axes", {})
        self._axes[members[0]] = [Cosine(n) for n in shape]
        size = tuple(2 * n for n in shape)
        symbol = self._symbol(members, size, real=True)
        if len(shape) == 2:  # the mean over both directions along y
            symbol = 0.5 * (symbol + np.roll(symbol[::-1], 1, axis=0))
        return self._decomposed(members, symbol[tuple(slice(0, n) for n in shape)], size)

    def _counts(self, lattice: _Lattice) -> Floats:
        out = []
        for p, _ in lattice.members:
            array = self.normal.operator.planes_of[p]
            valid = array.valid.astype(np.float64)
            # Each wave of a complete array is one reading.
            for axis, wave in enumerate(self._axes[lattice.members[0]] if array.mask is not None else []):
                valid = np.moveaxis(np.tensordot(wave.table**2, valid, axes=(1, axis)), 0, axis)
            out.append(valid)
        return np.einsum("...ci,c...->...i", lattice.vectors**2, np.stack(out))

    def _share(self, lattice: _Lattice) -> Any:
        return 1.0

    def _waves(self, planes: Sequence[Floats], g: _Lattice) -> Floats:
        data = np.stack([planes[p][:, c] for p, c in g.members], axis=1)
        return along(data, self._axes[g.members[0]], inverse=False)

    def _back(self, waves: Any, lattice: _Lattice, shape: Sequence[int]) -> Floats:
        return along(waves, self._axes[lattice.members[0]], inverse=True)

    def _between(self, entry: Any, lattice: _Lattice, to: Sequence[Index], of: Sequence[Index]) -> Floats:
        # 2 cos a (i + 1/2) cos a (j + 1/2) = cos a (i - j) + cos a (i + j + 1)
        lags, places = entry, []
        for axis, (t, o, wave) in enumerate(zip(to, of, self._axes[lattice.members[0]])):
            n = wave.n
            k = np.arange(n)
            table = np.where(k == 0, 0.5, 1.0) / n * np.cos(np.pi / n * k * np.arange(2 * n)[:, None])
            lags = np.moveaxis(np.tensordot(table, lags, axes=(1, axis)), 0, axis)
            places.append([(t[:, None] - o) % (2 * n), (t[:, None] + o + 1) % (2 * n)])
        return np.asarray(sum(lags[place] for place in itertools.product(*places)))


def _members(normal: Normal, split: bool) -> list[list[tuple[int, int]]]:
    """Groups of channels that share a lattice; with ``split``, also a mirror parity."""
    planes = normal.operator.planes_of
    axes = "x" if planes[0].dimensions == 1 else "yx"
    found: dict[tuple[Any, ...], list[tuple[int, int]]] = {}
    for p, array in enumerate(planes):
        same = next(q for q, other in enumerate(planes) if _one_lattice(array, other))
        for c, channel in enumerate(array.channels):
            parity = tuple(mirror_parity(channel, a) for a in axes) if split else ()
            found.setdefault((same, *parity), []).append((p, c))
    return list(found.values())


def _one_lattice(a: Any, b: Any) -> bool:
    return (
        a.shape == b.shape
        and a.noise_correlation == b.noise_correlation
        and all(np.allclose(x, y, rtol=0, atol=1e-9 * float(np.ptp(x))) for x, y in zip(a.grid.axes, b.grid.axes))
    )


def _influence(normal: Normal, plane: int, channel: int, size: tuple[int, ...]) -> Any:
    """Transform (component sought, *wave) of a cell's influence, restricted to lags within ``size``."""
    from scipy.fft import rfftn

    of = _convolution(normal, plane)
    kernel = of.kernel[channel][normal.columns]
    for axis, (n, whole) in enumerate(zip(of.cells, size)):
        lags = np.arange(kernel.shape[1 + axis]) - (n - 1)
        kept = np.abs(lags) < whole // 2
        shape = list(kernel.shape)
        shape[1 + axis] = whole
        out = np.zeros(shape)
        index: list[Any] = [slice(None)] * kernel.ndim
        index[1 + axis] = lags[kept] % whole
        out[tuple(index)] = np.compress(kept, kernel, axis=1 + axis)
        kernel = out
    return rfftn(kernel, axes=tuple(range(1, kernel.ndim)))


def _convolution(normal: Normal, plane: int) -> Convolution:
    of = normal.operator.planes[plane]
    if not isinstance(of, Convolution):
        raise TypeError("a lattice needs a regular array")
    return of


def _sampled(half: Any, size: tuple[int, ...], ratios: Sequence[int]) -> Any:
    """Half spectrum of every ratio-th sample, from the half spectrum of all (Hermitian in k): the sum over aliases."""
    if all(r == 1 for r in ratios):
        return half
    from scipy.fft import irfftn, rfftn

    axes = tuple(range(len(size)))
    samples = irfftn(half, s=size, axes=axes)
    return rfftn(samples[tuple(slice(None, None, r) for r in ratios)], axes=axes)


def _half(lattice: _Lattice) -> Floats:
    """Multiplicity of each wave of the half spectrum (*wave)."""
    out = np.full(lattice.values.shape[:-1], 2.0)
    out[..., 0] = 1.0
    if lattice.size[-1] % 2 == 0:
        out[..., -1] = 1.0
    return out


def _cropped(half: Any, size: tuple[int, ...], shape: Sequence[int]) -> Floats:
    """Inverse real FFT over the last axes, cropped to the first entries."""
    from scipy.fft import ifft, irfft

    if len(size) == 2:
        half = ifft(half, axis=-2)[..., : shape[0], :]
    return irfft(half, n=size[-1], axis=-1)[..., : shape[-1]]
