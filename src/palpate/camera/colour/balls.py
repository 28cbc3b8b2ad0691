"""Find the contact circle of a ball in a picture of a colour gel.

Opposite flanks of a ball have opposite slopes, and so nearly opposite changes of colour. The centre is the point about
which the picture differs most from itself rotated by half a turn. The contact ends where the slope is largest:
outside, the gel recovers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.elastic.pad import Floats

__all__ = ["Circle", "find_circle"]

#: A change of colour counts if it exceeds this many standard deviations of noise and this fraction of the strongest
#: change.
CLEAR, PART = 6.0, 0.2
#: Smallest contact radius to learn from [pixels].
MIN_CONTACT_RADIUS = 5.0


@dataclass(frozen=True)
class Circle:
    """Centre (column, row) and radius of a contact [pixels]."""

    column: float
    row: float
    radius: float


def find_circle(change: Floats, noise: float) -> Circle | None:
    """The contact circle of a ball, from changes of colour (row, column, channel) with noise of this standard
    deviation; None without a significant circle.
    """
    from scipy.ndimage import binary_fill_holes, gaussian_filter, label
    from scipy.signal import fftconvolve

    smooth = np.stack([gaussian_filter(part, 1.5) for part in np.moveaxis(change, -1, 0)])
    size = np.sqrt((smooth**2).sum(axis=0))
    strong = float(np.quantile(size, 0.998))
    # Smoothing by 1.5 pixels leaves a fifth of the noise.
    if strong < CLEAR * noise * 0.2 * np.sqrt(len(smooth)):
        return None
    spots, count = label(binary_fill_holes(size > max(PART * strong, CLEAR * 0.2 * noise)))
    if not count:
        return None
    largest = 1 + int(np.argmax(np.bincount(spots.ravel())[1:]))
    rows, columns = np.nonzero(spots == largest)
    if len(rows) < np.pi * MIN_CONTACT_RADIUS**2:
        return None
    # Only the pattern within the box around it.
    margin = 4
    low = max(rows.min() - margin, 0), max(columns.min() - margin, 0)
    box = smooth[:, low[0] : rows.max() + margin + 1, low[1] : columns.max() + margin + 1]
    turned = sum(fftconvolve(part, part) for part in box)
    middle = np.asarray(turned)
    # Twice the position of the centre; only centres within the middle half of the box.
    h, w = box.shape[1:]
    inner = middle[h // 2 : -(h // 2) or None, w // 2 : -(w // 2) or None]
    at = np.unravel_index(int(np.argmin(inner)), inner.shape)
    row = 0.5 * (at[0] + h // 2) + low[0]
    column = 0.5 * (at[1] + w // 2) + low[1]
    y, x = np.indices(size.shape)
    far = np.hypot(x - column, y - row)
    most = int(min(0.75 * max(h, w), min(size.shape) / 2.0))
    ring = [float(size[(far >= r - 0.7) & (far < r + 0.7)].mean()) for r in range(2, most)]
    radius = 2.0 + float(np.argmax(ring))
    return Circle(float(column), float(row), radius) if radius >= MIN_CONTACT_RADIUS else None
