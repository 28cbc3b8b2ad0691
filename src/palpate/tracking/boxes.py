"""Fast A'A of the cells of a box, for arrays whose response is the same at every place.

If cells and taxels have the same spacing, shifting two cells by one step leaves their product unchanged except for the
taxels at both ends:

    (A'A)(i + e, j + e) = (A'A)(i, j) + first(i + e) first(j + e)' - last(i) last(j)',

where (A'A)(i, j) is the block (component, component) of the cells i and j, e is a step by one cell along an axis, and
first(i) and last(i) are the responses (component, reading) of the first and the last row of taxels along that axis to
a load on cell i. So full products are only needed along three sides of the box: a tenth of the work, and less for
larger arrays.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from palpate._threads import give_way
from palpate.elastic.pad import Floats
from palpate.inverse.contact.constrained import ConstrainedEstimator
from palpate.sensing.operator import Convolution
from palpate.tracking.health import Flags, Index
from palpate.tracking.pieces import product

__all__ = ["Alike", "Box"]

#: Use a box only if the cells fill at least this fraction of it.
FULL = 0.5
#: With fewer readings, the direct product is as fast.
FEWEST = 1000


@dataclass(frozen=True)
class Box:
    """A'A of all cells of the box of ``shape`` at ``corner``: (cell * component, cell * component)."""

    corner: tuple[int, int]
    shape: tuple[int, int]
    gram: Floats

    def places(self, where: tuple[Index, ...]) -> Index | None:
        """Indices of cells within the box; None if some lie outside."""
        y, x = (w - c for w, c in zip(where, self.corner))
        height, width = self.shape
        inside = len(y) and y.min() >= 0 and x.min() >= 0 and y.max() < height and x.max() < width
        return np.asarray(y * width + x) if inside else None


class Alike:
    """Responses of such arrays to cells. ``possible``: whether the arrays have the property."""

    def __init__(self, estimator: ConstrainedEstimator) -> None:
        operator, readings = estimator.operator, estimator.readings
        self._columns = list(estimator.columns)
        self.grid = operator.surface.shape
        planes = operator.planes
        self.possible = (
            len(self.grid) == 2
            and len(readings.std) >= FEWEST
            and readings.independent
            and all(isinstance(p, Convolution) and set(p.ratios) == {1} for p in planes)
            and all(a.mask is None for a in operator.planes_of)
        )
        if not self.possible:
            return
        self._windows = [p.windows for p in planes if isinstance(p, Convolution)]
        self._weights, start = [], 0  # one over the standard deviation of each channel
        for windows in self._windows:
            channels, taxels = windows.shape[3], math.prod(windows.shape[4:])
            stop = start + channels * taxels
            self._weights.append(1.0 / readings.std[start:stop:taxels])
            start = stop

    def fits(self, where: tuple[Index, ...], entries: int) -> tuple[slice, slice] | None:
        """The bounding box of some cells, if they fill enough of it and its A'A has at most ``entries`` entries."""
        if not self.possible or not len(where[0]):
            return None
        y, x = (slice(int(w.min()), int(w.max()) + 1) for w in where)
        count = (y.stop - y.start) * (x.stop - x.start)
        serves = len(where[0]) >= FULL * count and (len(self._columns) * count) ** 2 <= entries
        return (y, x) if serves else None

    def _seen(self, y: slice, x: slice, rows: slice, columns: slice) -> Floats:
        """Whitened responses of some rows and columns of taxels to cells: (y, x, component, reading)."""
        taken = [windows[:, y, x, :, rows, columns] for windows in self._windows]
        _, height, width, *_ = taken[0].shape
        sizes = [math.prod(seen.shape[3:]) for seen in taken]
        out, stop = np.empty((height, width, len(self._columns), sum(sizes))), 0
        for seen, size, weights in zip(taken, sizes, self._weights):
            start, stop = stop, stop + size
            for k, component in enumerate(self._columns):
                part = out[:, :, k, start:stop].reshape(height, width, *seen.shape[3:])
                np.multiply(seen[component], weights[:, None, None], out=part)
        return out

    def box(self, y: slice, x: slice) -> Box:
        """Compute A'A of the cells of a box."""
        every, first, last = slice(None), slice(0, 1), slice(-1, None)
        height, width, c = y.stop - y.start, x.stop - x.start, len(self._columns)

        def rows(cells: Floats) -> Floats:
            return cells.reshape(-1, cells.shape[-1])

        give_way()
        top = rows(self._seen(slice(y.start, y.start + 1), x, every, every))
        bottom = rows(self._seen(slice(y.stop - 1, y.stop), x, every, every))
        give_way()
        left = rows(self._seen(y, slice(x.start, x.start + 1), every, every))
        lowest = product(left, bottom.T).reshape(height, c, -1)
        across = product(top, left.T).reshape(width, c, height, c)
        give_way()
        upper, lower = self._seen(y, x, first, every), self._seen(y, x, last, every)

        # First cell of each row with all rows from there on, from the last row to the first.
        corner = lowest[-1]
        for i in range(height - 1, 0, -1):
            give_way()
            further = upper[i, 0] @ rows(upper[i:]).T - lower[i - 1, 0] @ rows(lower[i - 1 : -1]).T
            corner = np.concatenate([corner - further, lowest[i - 1]], axis=1)
        # First row with all rows, cell by cell.
        give_way()
        before, after = self._seen(y, x, every, first), self._seen(y, x, every, last)
        further = product(rows(before[0, 1:]), rows(before[:, 1:]).T) - product(
            rows(after[0, :-1]), rows(after[:, :-1]).T
        )
        further = further.reshape(width - 1, c, height, width - 1, c)
        row = np.empty((width, c, height, width, c))
        row[0] = corner.reshape(c, height, width, c)
        for i in range(1, width):
            row[i, :, :, 0] = across[i]
            row[i, :, :, 1:] = row[i - 1, :, :, :-1] + further[i - 1]
        # Then row by row.
        out = np.empty((height, width * c, height, width * c))
        out[0] = row.reshape(width * c, height, width * c)
        for i in range(1, height):
            give_way()
            more = product(rows(upper[i]), rows(upper[i:]).T) - product(rows(lower[i - 1]), rows(lower[i - 1 : -1]).T)
            out[i, :, i:] = out[i - 1, :, i - 1 : -1] + more.reshape(width * c, -1, width * c)
        for i in range(height):
            give_way()
            out[i, :, i] = 0.5 * (out[i, :, i] + out[i, :, i].T)
            out[i + 1 :, :, i] = np.moveaxis(out[i, :, i + 1 :], 0, 2)
        return Box((y.start, x.start), (height, width), out.reshape(height * width * c, -1))

    def of(self, where: tuple[Index, ...], unused: Flags) -> Floats:
        """Whitened responses of some readings to cells: (component * cell, reading)."""
        parts, start = [], 0
        y, x = (w[:, None] for w in where)
        for windows, weights in zip(self._windows, self._weights):
            size = math.prod(windows.shape[3:])
            channel, *taxel = np.unravel_index(np.flatnonzero(unused[start : start + size]), windows.shape[3:])
            seen = windows[:, y, x, channel[None, :], taxel[0][None, :], taxel[1][None, :]]
            parts.append((seen[self._columns] * weights[channel]).reshape(len(self._columns) * len(y), -1))
            start += size
        return np.concatenate(parts, axis=1)
