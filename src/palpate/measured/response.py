"""Estimate the response at every place from a table of presses, as a Gaussian process, corrected for the size of the
indenter.

The response G(x) of a reading, per newton at the point x of the surface, is

    G_t(x) = g(x - x_t) + h_t(x),

where g is the response that readings at all places x_t share (a pad responds similarly everywhere), and h_t is the
individual part of the reading at x_t (edges, gains, inexact positions). Both are Gaussian processes whose spectrum
falls as exp(-2 k l): in a pad every field decays with depth z as exp(-k z), so that l is roughly the depth of the
sensing elements. A press with force F, spread over a disc as w(x), gives the reading

    y = F integral w(x - x_press) G_t(x) dx + noise,

in which each wave of G is multiplied by the transform of w (`spread`). The posterior of G (C. E. Rasmussen, C. K. I.
Williams, Gaussian Processes for Machine Learning, 2006, section 2.1) interpolates, deconvolves and states its own
uncertainty at once. l, the sizes of g and h, and the noise maximise the evidence (same book, section 5.4). The waves
are those of a rectangle that contains all lags, as in A. Solin, S. Sarkka, Statistics and Computing 30, 2020, 419-446.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from palpate.elastic.channels import mirror_parity
from palpate.elastic.pad import Floats
from palpate.sensing.grids import AreaGrid

__all__ = ["SHAPES", "Response", "fitted", "spread"]

#: Distributions of an indenter's pressure over the disc that it touches.
SHAPES = ("hertz", "disc", "punch")
#: Largest number of waves of a process along an axis, and of all components together: their products take a second.
ALONG, WAVES = 34, 1200
#: Largest number of rows (presses times readings) for the shared response; of more rows a random sample is used.
ROWS = 20_000
#: Number of rows that are computed at a time.
BLOCK = 4000
#: Lengths l that are tried, as multiples of the distance of neighbouring presses.
LENGTHS = (0.25, 0.4, 0.6, 0.85, 1.2, 1.8, 2.7)
#: Margin added to the lags, in distances of neighbouring presses: without it, waves would wrap around.
ROOM = 2.0
#: Number of places between the presses at which the uncertainty is computed.
PLACES = 120
#: Number of parts of the table in cross-validation.
FOLDS = 5

_PARITIES = ((0, 0), (0, 1), (1, 0), (1, 1))


def spread(k: Floats, radius: Floats, shape: str) -> Floats:
    """Return the transform (..., k) of a unit force spread over discs of ``radius`` (...).

    hertz, p ~ sqrt(1 - r^2/a^2): 3 (sin s - s cos s)/s^3; disc, p uniform: 2 J1(s)/s; punch, p ~ 1/sqrt(1 - r^2/a^2):
    sin s/s; s = k a (I. N. Sneddon, Fourier Transforms, 1951, chapter 10).
    """
    from scipy.special import j1

    s = np.maximum(np.multiply.outer(np.asarray(radius, dtype=np.float64), k), 1e-4)
    if shape == "hertz":
        small = s < 1e-2
        safe = np.where(small, 1.0, s)
        return np.where(small, 1.0 - s**2 / 10.0, 3.0 * (np.sin(safe) - safe * np.cos(safe)) / safe**3)
    return np.asarray(2.0 * j1(s) / s if shape == "disc" else np.sin(s) / s)


@dataclass(frozen=True)
class Waves:
    """Waves cos(j pi x / half) or sin(j pi x / half) along each axis, relative to a middle."""

    middle: Floats
    half: Floats
    along: int

    @property
    def axes(self) -> tuple[Floats, Floats]:
        """Wavenumbers along y and x [rad/m]."""
        steps = np.pi * np.arange(self.along) / self.half[:, None]
        return steps[0], steps[1]

    @property
    def size(self) -> Floats:
        """Magnitude |k| of the wavevectors (wave, wave) [rad/m]."""
        return np.hypot(*np.meshgrid(*self.axes, indexing="ij"))

    def prior(self, length: float) -> Floats:
        """Return the variance of each wave of a process whose total variance is 1."""
        k = self.size
        many = np.multiply.outer(*(np.where(a > 0, 2.0, 1.0) for a in self.axes))
        found = many * np.exp(-2.0 * length * k)
        found[k > min(float(a[-1]) for a in self.axes)] = 0.0
        return np.asarray(found / found.sum())

    def trig(self, axis: int, x: Floats, odd: int, width: float = 0.0) -> Floats:
        """Return cos or sin (..., wave) at positions along an axis, averaged over ``width``."""
        k = self.axes[axis]
        phase = np.multiply.outer(x - self.middle[axis], k)
        return np.asarray((np.sin(phase) if odd else np.cos(phase)) * np.sinc(k * width / (2.0 * np.pi)))

    def at(self, points: Floats, odd: tuple[int, int]) -> Floats:
        """Return the waves (point, wave, wave) at points (point, (y, x))."""
        y, x = (self.trig(i, points[:, i], odd[i]) for i in range(2))
        return y[:, :, None] * x[:, None, :]


@dataclass(frozen=True)
class Response:
    """Posterior of the responses of all readings.

    Attributes
    ----------
    length : float
        l [m].
    noise : array (channel,)
        Standard deviation of the table's readings.
    error : array (channel,)
        Error of the response between the pressed places, for a press like those of the table: root mean square over its
        readings, relative to their root mean square.
    held_out : array (channel,)
        The same of presses that were left out, noise and all.
    """

    length: float
    noise: Floats
    error: Floats
    held_out: Floats
    places: Floats = field(repr=False)
    shared: Floats = field(repr=False)
    own: Floats = field(repr=False)
    odd: npt.NDArray[np.intp] = field(repr=False)
    lags: Waves = field(repr=False)
    here: Waves = field(repr=False)

    def cells(self, surface: AreaGrid, channel: int, taxels: Sequence[int]) -> Floats:
        """Return the readings (taxel, component, *surface) [1/Pa] for unit traction in each cell."""
        (ys, xs), (dy, dx) = surface.axes, surface.spacings
        own = [(self.here.trig(0, ys, a, dy), self.here.trig(1, xs, b, dx)) for a, b in _PARITIES]
        out = np.empty((len(taxels), self.shared.shape[1], *surface.shape))
        for row, t in enumerate(taxels):
            for c in range(self.shared.shape[1]):
                a, b = self.odd[channel, c]
                y = self.lags.trig(0, ys - self.places[t, 0], int(a), dy)
                x = self.lags.trig(1, xs - self.places[t, 1], int(b), dx)
                total = y @ self.shared[channel, c] @ x.T
                for p, (left, right) in enumerate(own):
                    total = total + left @ self.own[channel, c, p, t] @ right.T
                out[row, c] = total
        return out * surface.cell


@dataclass(frozen=True)
class _Data:
    """Presses at places (press, (y, x)) with forces (press, component), and readings (press, channel, taxel) of taxels
    at (taxel, (y, x)).
    """

    presses: Floats
    forces: Floats
    radius: Floats
    shape: str
    readings: Floats
    taxels: Floats
    odd: npt.NDArray[np.intp]

    def some(self, rows: npt.NDArray[np.intp]) -> _Data:
        return _Data(
            self.presses[rows], self.forces[rows], self.radius[rows], self.shape, self.readings[rows], self.taxels, self.odd
        )  # fmt: skip


def fitted(
    presses: Floats,
    forces: Floats,
    radius: Floats,
    shape: str,
    readings: Floats,
    taxels: Floats,
    channels: Sequence[str],
    components: Sequence[str],
) -> Response:
    """Fit the response to a table.

    Parameters
    ----------
    presses, taxels : array (n, 2)
        Places (y, x) [m].
    forces : array (press, component) [N]
    radius : array (press,)
        Radius of the disc that was touched [m].
    readings : array (press, channel, taxel)
    """
    odd = np.array(
        [[[int(mirror_parity(c, a) * mirror_parity(f, a) < 0) for a in "yx"] for f in components] for c in channels],
        dtype=np.intp,
    )
    data = _Data(presses, forces, radius, shape, readings, taxels, odd)
    near = spacing(presses)
    along = min(ALONG, int(math.sqrt(WAVES / (len(components) * np.pi / 4.0))))
    both = np.concatenate([presses, taxels])
    low, high = both.min(axis=0), both.max(axis=0)
    lag = np.abs(presses[:, None] - taxels).max(axis=(0, 1)) + ROOM * near
    lags = Waves(np.zeros(2), lag, along)
    # the individual processes of readings are needed only near presses
    low, high = presses.min(axis=0), presses.max(axis=0)
    here = Waves(0.5 * (low + high), (high - low) + ROOM * near, along)
    fit = _Fit(data, lags, here, near)
    return fit.response()


def spacing(presses: Floats) -> float:
    """Mean distance of neighbouring presses [m]: that of a square grid with as many places over the same extent."""
    places = np.unique(presses, axis=0)
    extent, n = np.ptp(places, axis=0), len(places)
    half = 0.5 * float(extent.sum()) / max(n - 1, 1)
    return half + math.sqrt(half**2 + float(np.prod(extent)) / max(n - 1, 1))


class _Fit:
    def __init__(self, data: _Data, lags: Waves, here: Waves, near: float) -> None:
        self.data, self.lags, self.here, self.near = data, lags, here, near
        self.components = data.forces.shape[1]
        self.channels = data.readings.shape[1]

    def response(self) -> Response:
        data = self.data
        part = np.random.default_rng(1).permutation(len(data.presses)) % FOLDS
        parts = [
            [self.products(data.some(np.flatnonzero(part == p)), i) for p in range(FOLDS)] for i in range(self.channels)
        ]
        normal = [_Normal.sum(p) for p in parts]
        length = self.length(normal)
        posts, own, noise, errors, held = [], [], [], [], []
        for i in range(self.channels):
            post = _Shared.of(normal[i], self.weights(length))
            left = data.readings[:, i] - self.predicted(data, i, post.mean)
            mine = _Own.of(self.kernel(data, data, length), left)
            posts.append(post)
            own.append(mine)
            noise.append(mine.noise)
            errors.append(self.error(length, i, post, mine))
            held.append(self.held_out(length, i, part, parts[i], post))
        shared = np.stack([p.mean.reshape(self.components, *self.lags.size.shape) for p in posts])
        return Response(
            length,
            np.array(noise),
            np.array(errors),
            np.array(held),
            data.taxels,
            shared,
            np.stack([self.own_waves(length, m) for m in own]),
            data.odd,
            self.lags,
            self.here,
        )

    # -- the shared response -------------------------------------------------------------------------------------------

    def weights(self, length: float) -> Floats:
        return np.tile(self.lags.prior(length).ravel(), self.components)

    def rows(self, data: _Data, channel: int, press: npt.NDArray[np.intp], taxel: npt.NDArray[np.intp]) -> Floats:
        """Return the readings that waves of the shared response would give (row, component and wave)."""
        lag = data.presses[press] - data.taxels[taxel]
        radii, which = np.unique(data.radius[press], return_inverse=True)
        seen = spread(self.lags.size, radii, data.shape)
        seen = seen if len(radii) == 1 else seen[which]
        parts = []
        for c in range(self.components):
            a, b = data.odd[channel, c]
            each = self.lags.at(lag, (int(a), int(b))) * seen * data.forces[press, c][:, None, None]
            parts.append(each.reshape(len(press), -1))
        return np.concatenate(parts, axis=1)

    def products(self, data: _Data, channel: int) -> _Normal:
        """Return the products of the waves with themselves and with the readings. If there are many readings, a random
        sample is used.
        """
        n, _, taxels = data.readings.shape
        index = np.arange(n * taxels)
        if len(index) > ROWS // FOLDS:
            index = np.sort(np.random.default_rng(0).choice(index, ROWS // FOLDS, replace=False))
        size = self.components * self.lags.size.size
        gram, right, square = np.zeros((size, size)), np.zeros(size), 0.0
        for start in range(0, len(index), BLOCK):
            press, taxel = np.divmod(index[start : start + BLOCK], taxels)
            rows = self.rows(data, channel, press, taxel)
            y = data.readings[press, channel, taxel]
            gram += rows.T @ rows
            right += rows.T @ y
            square += float(y @ y)
        return _Normal(gram, right, square, len(index))

    def length(self, normal: Sequence[_Normal]) -> float:
        """Return the length with the largest evidence over all channels. The search starts in the middle and continues
        while the evidence grows.
        """

        @functools.cache
        def evidence(place: int) -> float:
            weights = self.weights(LENGTHS[place] * self.near)
            return sum(_Shared.of(n, weights, mean=False).evidence for n in normal)

        place = len(LENGTHS) // 2
        while True:
            beside = [i for i in (place - 1, place + 1) if 0 <= i < len(LENGTHS)]
            best = max(beside, key=evidence)
            if evidence(best) <= evidence(place):
                return LENGTHS[place] * self.near
            place = best

    def predicted(self, data: _Data, channel: int, mean: Floats) -> Floats:
        """Return the readings (press, taxel) that the shared response predicts."""
        n, _, taxels = data.readings.shape
        means = mean.reshape(self.components, *self.lags.size.shape)
        out = np.empty((n, taxels))
        for radius in np.unique(data.radius):
            here = np.flatnonzero(data.radius == radius)
            lag = (data.presses[here][:, None] - data.taxels).reshape(-1, 2)
            seen, total = spread(self.lags.size, radius, data.shape), np.zeros(len(lag))
            for c in range(self.components):
                y, x = (self.lags.trig(i, lag[:, i], int(data.odd[channel, c, i])) for i in range(2))
                total += np.repeat(data.forces[here, c], taxels) * ((y @ (means[c] * seen)) * x).sum(axis=1)
            out[here] = total.reshape(len(here), taxels)
        return out

    # -- the individual part of each reading ----------------------------------------------------------------------------

    def seen(self, data: _Data, length: float) -> Floats:
        """Return the readings of presses for waves of the individual responses, multiplied by the square root of their
        variance (component, press, parity and wave).
        """
        root = np.sqrt(self.here.prior(length)) * spread(self.here.size, data.radius, data.shape)
        waves = np.concatenate(
            [(self.here.at(data.presses, p) * root).reshape(len(root), -1) for p in _PARITIES], axis=1
        )
        return np.stack([waves * data.forces[:, c, None] for c in range(self.components)])

    def kernel(self, one: _Data, other: _Data, length: float) -> Floats:
        """Return the covariance of the readings of presses (press, press), for an individual process of variance 1."""
        left, right = self.seen(one, length), self.seen(other, length)
        return np.asarray(sum(a @ b.T for a, b in zip(left, right)))

    def own_waves(self, length: float, own: _Own) -> Floats:
        """Return the waves of the individual responses (component, parity, taxel, wave, wave)."""
        seen = self.seen(self.data, length)
        shape = self.here.size.shape
        out = np.einsum("cpw,pt->ctw", seen, own.weights * own.variance)
        out = out.reshape(self.components, own.weights.shape[1], len(_PARITIES), *shape).swapaxes(1, 2)
        return np.asarray(out * np.sqrt(self.here.prior(length)))

    # -- how well ------------------------------------------------------------------------------------------------------

    def error(self, length: float, channel: int, post: _Shared, own: _Own) -> float:
        """Return the error of predictions for presses like those of the table, at places between them."""
        data, rng = self.data, np.random.default_rng(0)
        one = rng.integers(len(data.presses), size=PLACES)
        other = np.array([_neighbour(data.presses, i, rng) for i in one])
        share = rng.uniform(0.0, 1.0, (PLACES, 1))
        places = data.presses[one] + share * (data.presses[other] - data.presses[one])
        moved = _Data(places, data.forces[one], data.radius[one], data.shape, data.readings[one], data.taxels, data.odd)
        square = own.predictive_variance(
            self.kernel(moved, data, length), self.kernel(moved, moved, length).diagonal()
        ) * len(data.taxels)
        each = rng.integers(len(data.taxels), size=(PLACES, min(8, len(data.taxels))))
        for press, taxels in enumerate(each):
            rows = self.rows(moved, channel, np.full(len(taxels), press), taxels)
            square[press] += post.predictive_variance(rows).mean() * len(data.taxels)
        mean = self.predicted(moved, channel, post.mean) + own.variance * self.kernel(moved, data, length) @ own.weights
        size = float((mean**2).sum())
        return float(math.sqrt(square.sum() / max(size, 1e-300)))

    def held_out(
        self, length: float, channel: int, part: npt.NDArray[np.intp], parts: Sequence[_Normal], post: _Shared
    ) -> float:
        """Return the cross-validation error of the presses, relative to their readings."""
        data = self.data
        left, size = 0.0, float((data.readings[:, channel] ** 2).sum())
        for p in range(FOLDS):
            rest, gone = data.some(np.flatnonzero(part != p)), data.some(np.flatnonzero(part == p))
            mean = post.again(_Normal.sum([n for i, n in enumerate(parts) if i != p]), self.weights(length))
            own = _Own.of(
                self.kernel(rest, rest, length), rest.readings[:, channel] - self.predicted(rest, channel, mean)
            )
            found = self.predicted(gone, channel, mean) + own.variance * self.kernel(gone, rest, length) @ own.weights
            left += float(((found - gone.readings[:, channel]) ** 2).sum())
        return math.sqrt(left / max(size, 1e-300))


def _neighbour(presses: Floats, index: int, rng: np.random.Generator) -> int:
    """Return one of the four nearest other places."""
    distance = np.hypot(*(presses - presses[index]).T)
    order = np.argsort(distance)
    order = order[distance[order] > 0][:4]
    return int(rng.choice(order)) if len(order) else index


@dataclass(frozen=True)
class _Normal:
    """The products A'A, A'y, y'y and the number of rows."""

    gram: Floats
    right: Floats
    square: float
    rows: int

    @classmethod
    def sum(cls, parts: Sequence[_Normal]) -> _Normal:
        return cls(
            np.asarray(sum(p.gram for p in parts)),
            np.asarray(sum(p.right for p in parts)),
            sum(p.square for p in parts),
            sum(p.rows for p in parts),
        )


@dataclass(frozen=True)
class _Shared:
    """Posterior of the waves of the shared response: linear regression with a prior of variance ``size`` and noise."""

    evidence: float
    mean: Floats
    root: Floats
    scale: Floats
    kept: npt.NDArray[np.bool_]
    over: float

    @classmethod
    def of(cls, normal: _Normal, prior: Floats, *, mean: bool = True) -> _Shared:
        gram, right, square, rows = normal.gram, normal.right, normal.square, normal.rows
        kept = prior > 1e-12 * prior.max()
        d = np.sqrt(prior[kept])
        values, vectors = np.linalg.eigh(d[:, None] * gram[np.ix_(kept, kept)] * d)
        values = np.maximum(values, 0.0)
        b2 = (vectors.T @ (d * right[kept])) ** 2
        best: tuple[float, float, float] = (-math.inf, 1.0, 1.0)
        for over in np.geomspace(1e-3, 1e9, 73) / max(float(values.max()), 1e-300):
            left = 1.0 + over * values
            noise = max((square - float((over * b2 / left).sum())) / rows, 1e-12 * square / rows, 1e-300)
            value = -0.5 * (float(np.log(left).sum()) + rows * math.log(noise))
            best = max(best, (value, float(over), noise))
        value, over, noise = best
        out = np.zeros(len(prior))
        if mean:
            out[kept] = d * (vectors @ (over / (1.0 + over * values) * (vectors.T @ (d * right[kept]))))
        return cls(value, out, d[:, None] * vectors, over * noise / (1.0 + over * values), kept, over)

    def again(self, normal: _Normal, prior: Floats) -> Floats:
        """Return the mean of the waves for other rows, with the same constants."""
        from scipy.linalg import solve

        d = np.sqrt(prior[self.kept])
        matrix = self.over * d[:, None] * normal.gram[np.ix_(self.kept, self.kept)] * d
        matrix[np.diag_indices_from(matrix)] += 1.0
        out = np.zeros(len(prior))
        out[self.kept] = self.over * d * solve(matrix, d * normal.right[self.kept], assume_a="pos")
        return out

    def predictive_variance(self, rows: Floats) -> Floats:
        """Predictive variance for rows of waves."""
        return np.asarray(((rows[:, self.kept] @ self.root) ** 2) @ self.scale)


@dataclass(frozen=True)
class _Own:
    """Posterior of the individual part of each reading: ``weights`` (press, taxel) times ``variance`` times the
    covariance with the presses.
    """

    variance: float
    noise: float
    weights: Floats
    vectors: Floats
    values: Floats

    @classmethod
    def of(cls, kernel: Floats, left: Floats) -> _Own:
        n, taxels = left.shape
        values, vectors = np.linalg.eigh(0.5 * (kernel + kernel.T))
        values = np.maximum(values, 0.0)
        b = vectors.T @ left
        best: tuple[float, float, float] = (-math.inf, 0.0, 1e-300)
        for over in np.concatenate([[0.0], np.geomspace(1e-3, 1e6, 55) / max(float(values.max()), 1e-300)]):
            size = 1.0 + over * values
            noise = max(float((b**2 / size[:, None]).sum()) / (n * taxels), 1e-300)
            value = -0.5 * taxels * (float(np.log(size).sum()) + n * math.log(noise))
            best = max(best, (value, float(over), noise))
        _, over, noise = best
        total = over * noise * values + noise
        weights = vectors @ (b / total[:, None])
        return cls(over * noise, math.sqrt(noise), weights, vectors, total)

    def predictive_variance(self, across: Floats, itself: Floats) -> Floats:
        """Return the variance at places with the covariances ``across`` (place, press) and the variances ``itself``
        (place,) of a process of variance 1.
        """
        explained = (self.variance * across @ self.vectors) ** 2 / self.values
        return np.asarray(np.maximum(self.variance * itself - explained.sum(axis=1), 0.0))
