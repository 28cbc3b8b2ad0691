"""Detect a contact much smaller than the pitch: a few readings stand out and all others read noise.

The evidence of the linear model (`palpate.inverse.linear.evidence`) depends only on the mean square of the readings
and on the correlation of neighbours. A small contact on shallow taxels changes one or two readings, which looks like
noise by both measures. But noise does not contain one reading thirty times larger than most. So the search adds cells
one after the other (orthogonal matching pursuit, Y. C. Pati, R. Rezaiifar, P. S. Krishnaprasad, Asilomar Conf. 1993,
40-44). The score is

    gain = free log(total/left) - k log(cells),

where ``total`` and ``left`` are root mean squares per degree of freedom before and after, ``free`` is the number of
degrees of freedom after, and each of the k cells pays for the choice among all. Noise that is not Gaussian has large
readings too: the gain must exceed the log likelihood gained by a Student distribution with two degrees of freedom and
one scale per channel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.inverse.contact.policy import Policy
from palpate.inverse.contact.prepared import PreparedContact
from palpate.inverse.contact.score import gain_of

__all__ = ["FewCells", "contact_in_few_cells", "heavy_tails"]

Flags = npt.NDArray[np.bool_]
Index = npt.NDArray[np.intp]


@dataclass(frozen=True)
class FewCells:
    """Gain of contact in a few cells over Gaussian noise, and its residual noise in units of the whitening."""

    gain: float
    left: float


def contact_in_few_cells(estimator: PreparedContact, data: Floats, observed: Flags) -> FewCells | None:
    """Contact in a few cells, with or without offsets; None if noise explains the readings as well."""
    policy, readings = estimator.policy, estimator.readings
    channel = estimator.noise.index[observed]
    if not policy.parts.few_cells or not _stands_out(data[observed], channel, policy):
        return None
    white = readings.whitened(data, observed)
    base = np.linalg.qr(readings.whitened(estimator.shifts[:, : estimator.usual], observed)).Q
    left = white - base @ (base.T @ white)
    free = len(white) - base.shape[1]
    if free < 2 or not (left != 0.0).any():
        return None
    heavy = heavy_tails(left, channel, free, policy)
    total = math.sqrt(float(left @ left) / free)
    known = 1.0 if estimator.noise_known else None
    # The residual noise cannot be below the accuracy of the model.
    floor = max(estimator.least_noise(data), known or 0.0)
    search = _Search(estimator, observed)
    best: FewCells | None = None
    for count in range(1, policy.discs.few + 1):
        added = search.best(left)
        added = added - base @ (base.T @ added)
        more, size = np.linalg.qr(added)
        kept = np.abs(np.diagonal(size)) > 1e-9 * np.abs(size).max(initial=0.0)
        base = np.concatenate([base, more[:, kept]], axis=1)
        left = white - base @ (base.T @ white)
        free = len(white) - base.shape[1]
        if free < 2:
            break
        size_left = max(math.sqrt(float(left @ left) / free), floor)
        gain = gain_of(free, max(total, size_left), size_left) - count * math.log(search.cells)
        if best is None or gain > best.gain:
            best = FewCells(gain, size_left)
        if size_left <= floor:
            break
    return best if best is not None and best.gain > policy.detection.in_few_cells + heavy else None


def heavy_tails(white: Floats, channel: Index, free: int, policy: Policy) -> float:
    """Log likelihood gained over Gaussian noise of one level by a Student distribution with one scale per channel."""
    v = policy.detection.student
    constant = math.lgamma(0.5 * (v + 1.0)) - math.lgamma(0.5 * v) - 0.5 * math.log(math.pi * v)
    total = float(white @ white) / free
    gauss = -0.5 * len(white) * (math.log(2.0 * math.pi * total) + 1.0)
    student = 0.0
    for one in np.unique(channel):
        squares = white[channel == one] ** 2
        scale = float(np.median(squares)) or float(squares.mean())
        if not scale > 0.0:
            continue
        for _ in range(policy.discs.scales):
            scale = max(float(((v + 1.0) / (v + squares / scale) * squares).mean()), 1e-300)
        part = constant - 0.5 * math.log(scale) - 0.5 * (v + 1.0) * np.log1p(squares / (v * scale))
        student += float(part.sum())
    return max(student - gauss, 0.0)


def _stands_out(data: Floats, channel: Index, policy: Policy) -> bool:
    """Whether one reading is far larger than most readings of its channel."""
    sizes = [np.abs(data[channel == one]) for one in np.unique(channel)]
    return any(bool(s.max() > policy.detection.stands_out * np.median(s)) for s in sizes)


class _Search:
    """Search for the cell whose traction explains most of the residual."""

    def __init__(self, estimator: PreparedContact, observed: Flags) -> None:
        policy = estimator.policy
        self.estimator, self.observed = estimator, observed
        surface = estimator.operator.surface
        fine = math.prod(surface.shape) * 2**surface.dimensions
        self.level = estimator.level(2 if fine <= policy.work.finest else 1)
        self.cells = math.prod(self.level.grid.shape)
        self.some = max(
            policy.work.entries // max(int(observed.sum()) * len(estimator.columns), 1), policy.work.nearest
        )
        self.every = self._of_all() if self.some >= self.cells else None

    def _of_all(self) -> tuple[Floats, Floats]:
        """`_of` for all cells, cached as long as the same readings are observed."""
        kept, key = self.level.orthogonal, self.observed.tobytes()
        if kept is None or kept[0] != key:
            kept = self.level.orthogonal = key, self._of(np.arange(self.cells))
        return kept[1]

    def _of(self, cells: Index) -> tuple[Floats, Floats]:
        """Whitened columns (cell, reading, component), and an orthonormal basis of the columns of each cell."""
        readings = self.estimator.readings
        matrix = self.level.matrix(cells, readings.std, self.observed)
        each = matrix.reshape(len(matrix), -1, len(cells)).transpose(2, 0, 1)
        return each, np.linalg.qr(each).Q

    def best(self, left: Floats) -> Floats:
        """Columns (reading, component) of the cell that explains most of the residual ``left``."""
        each, unit = self.every or self._of(self._near(left))
        power = (np.einsum("cri,r->ci", unit, left) ** 2).sum(axis=1)
        return np.asarray(each[int(np.argmax(power))])

    def _near(self, left: Floats) -> Index:
        """The cells nearest to the reading with the largest residual."""
        arrays = self.estimator.operator.planes_of
        points = np.concatenate([np.tile(a.points[a.valid.ravel()], (len(a.channels), 1)) for a in arrays])
        place = points[self.observed][int(np.argmax(np.abs(left)))]
        axes = np.meshgrid(*self.level.grid.axes, indexing="ij")
        squares = sum((a - p) ** 2 for a, p in zip(axes, place))
        return np.asarray(np.argsort(np.ravel(squares), kind="stable")[: self.some])
