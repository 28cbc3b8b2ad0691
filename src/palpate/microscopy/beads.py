"""Measure displacements from two pictures of beads: correlate windows, then refine by least squares on the deformed
picture.

Coarse: cross-correlation of windows by FFT, outliers detected by their neighbours (J. Westerweel, F. Scarano, Exp. Fluids 39, 2005, 1096-1100). Fine:
the second picture is deformed by the field so far, and each window's remaining displacement d solves

    sum w (g g^T) d = -sum w g r,      r = second(x + u(x)) - first(x),

with the gradient g of the mean of both pictures, so that noise does not add to it (in N, the product of both pictures' gradients), and Gaussian
weights w, which give no wavelength the wrong sign. In the last round w is the window itself, and the field so far enters by its mean over the window,
so that each displacement is a mean. Its covariance is N^-1 M N^-1, with N = sum w g g^T and M the covariance of the scores w g r, summed over
neighbouring pixels (the residuals of one bead are correlated). It needs no model of the noise.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.fft
import scipy.ndimage

from palpate.camera import grey
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.microscopy.fields import Field, mended
from palpate.sensing.view import opencv

__all__ = ["bead_displacements"]

#: Standard deviation of the Gaussian weights as a fraction of the window: with this value they average over as many
#: pixels as a square of the window's side.
SIGMA = 1.0 / 3.545
#: Number of rounds in which the second picture is deformed by the current field and compared again. Between rounds the
#: field is smoothed over SMOOTHED steps.
ROUNDS, SMOOTHED = 5, 0.4
#: Residuals are correlated over this many pixels.
RESIDUAL_LENGTH = 5
#: A vector with a larger standard deviation [px] is left out.
MAX_STD = 1.0
#: If the median correlation of windows is still below this after deformation, the pictures do not show the same beads.
MIN_CORRELATION = 0.35
#: A window whose correlation is below this fraction of the median contains no beads, or other beads than before.
UNLIKE = 0.4
#: A window whose correlation after a round is below SOUGHT times the median (its beads moved by more than their width)
#: is searched for within FAR pixels, or within half a window if that is less. A match counts if its correlation exceeds
#: PLACE.
SOUGHT, FAR, PLACE = 0.7, 8, 0.5
#: Smallest standard deviation of a vector, due to interpolation and pixels [px].
FLOOR = 0.005


def bead_displacements(
    rest: npt.ArrayLike,
    pulled: npt.ArrayLike,
    *,
    pixel: float,
    window: int = 32,
    step: int | None = None,
    drift: bool = True,
) -> Field:
    """Displacements of the gel from a picture of its beads at rest to one while the cell pulls.

    Parameters
    ----------
    rest, pulled : array (row, column)
        The beads without the cell (after it was taken off), and with it; 8 or 16 bits, or floats.
    pixel : float
        Metres in a pixel.
    window : int
        Side of the windows [px]: wide enough for some ten beads. It is the finest that is resolved.
    step : int, optional
        Pixels between vectors; default: half a window.
    drift : bool
        The shift of the whole picture is taken out (default) and said in `Field.drift`.

    Returns
    -------
    Field
        With ``std``, the standard deviation of each displacement, and ``aperture``: each displacement is the mean over its
        window.

    Raises
    ------
    InvalidInput
        Pictures of different sizes, the same picture twice, pictures without beads or of different beads, windows that do not fit.

    Examples
    --------
    >>> import numpy as np
    >>> import scipy.ndimage
    >>> from palpate.microscopy import bead_displacements
    >>> rng = np.random.default_rng(0)
    >>> beads = np.zeros((160, 192))
    >>> beads[tuple(rng.integers(0, (160, 192), (900, 2)).T)] = 200.0
    >>> rest = scipy.ndimage.gaussian_filter(beads, 1.3)
    >>> pulled = scipy.ndimage.shift(rest, (0.0, 2.4), order=3)  # the stage drifted to the right
    >>> field = bead_displacements(rest, pulled, pixel=0.1e-6)
    >>> [round(d / 0.1e-6, 1) for d in field.drift], field.shape
    ([2.4, 0.0], (9, 11))
    """
    first, second = (_checked(p, name) for p, name in ((rest, "rest"), (pulled, "pulled")))
    if first.shape != second.shape:
        raise InvalidInput(
            f"the pictures have {first.shape[1]} x {first.shape[0]} and {second.shape[1]} x {second.shape[0]} pixels: both must show the same field of view."
        )
    if not (np.isfinite(pixel) and pixel > 0):
        raise InvalidInput(f"pixel must be a positive number of metres; got {pixel!r}.")
    step = window // 2 if step is None else step
    if not (isinstance(window, int) and 8 <= window <= min(first.shape) // 4):
        raise InvalidInput(
            f"window must be from 8 pixels to a quarter of the picture's smaller side, {min(first.shape) // 4}; got {window!r}."
        )
    if not (isinstance(step, int) and 1 <= step <= window):
        raise InvalidInput(f"step must be from 1 pixel to the window, {window}; got {step!r}.")
    if np.array_equal(first, second):
        raise InvalidInput("both pictures are the same: give the beads at rest and the beads that are pulled.")
    a, b = _evened(first, 2.0 * window), _evened(second, 2.0 * window)
    grid = tuple(np.arange((window - 1) / 2.0, n - (window - 1) / 2.0, step) for n in first.shape)  # rows, columns
    u = _coarse(a, b, grid, window)
    fine = _Fine(a, b, grid, window, step)
    for last in (*[False] * (ROUNDS - 1), True):
        u = mended(u)[0]
        smooth = np.stack(
            [scipy.ndimage.gaussian_filter(c, SMOOTHED * max(1.0, window / (2.0 * step)), mode="nearest") for c in u]
        )
        u, std, alike = fine.round(smooth, last=last)
        if not last:
            u = fine.sought(smooth, u, alike)
    if not np.nanmedian(alike) > MIN_CORRELATION:
        raise InvalidInput(
            f"the pictures do not show the same beads in the same places: windows correlate by {float(np.nanmedian(alike)):.2f} after deformation. Are they a pair, in "
            "focus, and is the window large enough for the shift between them?"
        )
    unlike = alike < UNLIKE * np.nanmedian(alike)
    bad = ~np.isfinite(u).all(axis=0) | (std.max(axis=0) > MAX_STD) | unlike
    bad |= mended(np.where(bad, np.nan, u))[1]
    notes = [f"windows of {window} px every {step} px, first picture at rest, second pulled"]
    count = int(bad.sum())
    if count > 0.5 * bad.size:
        raise InvalidInput(
            f"{count} of {bad.size} windows show no displacement that their neighbours share: take larger windows, or sharper pictures with more beads."
        )
    if count:
        notes.append(f"{count} of {bad.size} vectors are left out: no beads, or far from what the neighbours do")
    u = np.where(bad, np.nan, u)
    std = np.where(bad, np.nan, np.hypot(std, FLOOR))
    field = Field(
        displacement=u * pixel,
        start=(float(grid[1][0]), float(grid[0][0])),
        step=float(step),
        pixel=float(pixel),
        std=std * pixel,
        aperture=float(window * pixel),
        notes=tuple(notes),
    )
    return field.without_drift() if drift else field


def _checked(picture: Any, name: str) -> Floats:
    values = np.asarray(picture)
    if values.dtype == np.bool_ or values.dtype.kind not in "iuf":
        raise InvalidInput(f"{name}: a picture holds grey levels; got {values.dtype}.")
    if values.dtype not in (np.uint8, np.uint16):
        values = values.astype(np.float32)
    plain = grey(values).astype(np.float32)
    if not np.isfinite(plain).all():
        raise InvalidInput(f"{name}: the picture holds values that are not finite.")
    if float(np.ptp(plain)) == 0:
        raise InvalidInput(f"{name}: the picture is even: it shows no beads.")
    if values.dtype.kind == "u":
        full = float(np.mean(plain >= np.iinfo(values.dtype).max))
        if full > 0.05:
            raise InvalidInput(f"{name}: {100 * full:.0f} % of the picture is saturated: expose it less.")
    return np.asarray(plain)


def _evened(image: Floats, length: float) -> Floats:
    """Return the picture with slow changes of brightness removed and with the same contrast everywhere."""

    def slow(values: Floats, sigma: float) -> Floats:
        # three box filters approximate a Gaussian, and their cost does not depend on its width
        side = max(3, round(2.0 * sigma))
        for _ in range(3):
            values = scipy.ndimage.uniform_filter(values, side, mode="nearest")
        return values

    flat = image - slow(image, length / 2)
    size = np.sqrt(np.maximum(slow(flat**2, length), 0.0))
    return np.asarray(flat / np.maximum(size, 0.1 * float(np.sqrt((flat**2).mean()))))


def _shift(a: Floats, b: Floats) -> tuple[int, int]:
    """Shift (row, column) of ``b`` relative to ``a`` in whole pixels, by cross-correlation of whole pictures."""
    shape = [scipy.fft.next_fast_len(n, True) for n in a.shape]
    product = np.conj(scipy.fft.rfft2(a, shape)) * scipy.fft.rfft2(b, shape)
    surface = scipy.fft.irfft2(product, shape)
    at = np.unravel_index(int(surface.argmax()), surface.shape)
    row, column = ((int(k) + n // 2) % n - n // 2 for k, n in zip(at, shape))
    return row, column


def _coarse(a: Floats, b: Floats, grid: Any, window: int) -> Floats:
    """Displacements (2, row, column) [px] on the grid: shift the second picture, then correlate wide windows."""
    wide = min(max(64, 2 * window), min(a.shape) // 2)
    row, column = _shift(a, b)
    moved = np.roll(b, (-row, -column), axis=(0, 1))
    hop = wide // 2
    starts = [np.unique(np.append(np.arange(0, n - wide + 1, hop), n - wide)) for n in a.shape]
    taper = np.outer(*[np.hanning(wide + 2)[1:-1]] * 2).astype(np.float32)
    found = np.full((2, len(starts[0]), len(starts[1])), np.nan)
    for i, top in enumerate(starts[0]):
        parts = []
        for image in (a, moved):
            block = np.stack([image[top : top + wide, left : left + wide] for left in starts[1]])
            parts.append((block - block.mean(axis=(1, 2), keepdims=True)) * taper)
        surface = scipy.fft.irfft2(np.conj(scipy.fft.rfft2(parts[0])) * scipy.fft.rfft2(parts[1]), (wide, wide))
        for j, one in enumerate(surface):
            at = np.unravel_index(int(one.argmax()), one.shape)
            for axis in (0, 1):
                line = [one[tuple((at[k] + (s if k == axis else 0)) % wide for k in (0, 1))] for s in (-1, 0, 1)]
                bend = line[0] - 2 * line[1] + line[2]
                part = 0.5 * (line[0] - line[2]) / bend if bend < 0 else 0.0
                found[1 - axis, i, j] = (at[axis] + wide // 2) % wide - wide // 2 + part
    found = mended(found)[0] + np.array([column, row], dtype=np.float64)[:, None, None]
    middles = [s + (wide - 1) / 2.0 for s in starts]
    places = [np.interp(g, m, np.arange(len(m))) for g, m in zip(grid, middles)]
    at = np.meshgrid(*places, indexing="ij")
    return np.stack([scipy.ndimage.map_coordinates(c, at, order=1, mode="nearest") for c in found])


class _Fine:
    """Least squares on the deformed picture. Sums over windows, and interpolation of the field between vectors, are
    each computed by two matrices, one for each axis.
    """

    def __init__(self, a: Floats, b: Floats, grid: Any, window: int, step: int) -> None:
        self.a, self.b, self.window, self.sigma = a, b, window, SIGMA * window
        self.grid, self.seen = grid, b
        self.slopes = _slope(a, 0), _slope(a, 1)
        self.rows, self.columns = np.meshgrid(*(np.arange(n, dtype=np.float32) for n in a.shape), indexing="ij")
        self.weights = {
            name: [self._weights(g, n, name) for g, n in zip(grid, a.shape)] for name in ("gaussian", "box")
        }
        self.between = [_between(g, n) for g, n in zip(grid, a.shape)]

    def _weights(self, grid: Floats, count: int, name: str) -> Floats:
        """Return the weight of every pixel along an axis for each vector; the weights of a vector add up to 1."""
        off = np.arange(count)[None, :] - grid[:, None]
        if name == "box":
            each = (np.abs(off) < 0.5 * self.window).astype(np.float64)
        else:
            each = np.where(np.abs(off) < 2.6 * self.sigma, np.exp(-(off**2) / (2 * self.sigma**2)), 0.0)
        return np.asarray(each / each.sum(axis=1, keepdims=True), dtype=np.float32)

    def _summed(self, image: Floats, weights: str) -> Floats:
        """Return the weighted mean of ``image`` around each vector."""
        rows, columns = self.weights[weights]
        return np.asarray(rows @ image @ columns.T, dtype=np.float64)

    def round(self, known: Floats, *, last: bool) -> tuple[Floats, Floats, Floats]:
        """Do one round from the field ``known``; return displacements [px], their standard deviations [px] and the
        correlation of each window.

        In the ``last`` round displacements are means over the windows: ``known`` enters with uniform weights, so that
        the positions of beads weight only what remains. Earlier rounds have no standard deviations.
        """
        weights = "box" if last else "gaussian"
        dense = [self.between[0] @ c.astype(np.float32) @ self.between[1].T for c in known]
        rows, columns = self.rows + dense[1], self.columns + dense[0]
        inside = (rows >= 0) & (rows <= self.a.shape[0] - 1) & (columns >= 0) & (columns <= self.a.shape[1] - 1)
        warped = self._warped(rows, columns, exact=last)
        r = (warped - self.a) * inside
        mean = 0.5 * (warped + self.a)
        gy, gx = (_slope(mean, axis) * inside for axis in (0, 1))
        # variance that both pictures share, which excludes the noise of each
        ay, ax, by, bx = *self.slopes, _slope(warped, 0) * inside, _slope(warped, 1) * inside
        nxx, nxy, nyy = (self._summed(p, weights) for p in (ax * bx, 0.5 * (ax * by + ay * bx), ay * by))
        sx, sy = gx * r, gy * r
        qx, qy = self._summed(sx, weights), self._summed(sy, weights)
        det = nxx * nyy - nxy**2
        good = (det > 1e-4 * np.median(np.abs(nxx + nyy)) ** 2) & (nxx + nyy > 0)
        safe = np.where(good, det, 1.0)
        d = np.stack([-(nyy * qx - nxy * qy), -(nxx * qy - nxy * qx)]) / safe
        # limit the step to the range within which a bead's image is nearly linear
        d = d * np.minimum(1.0, 2.0 / np.maximum(np.hypot(*d), 1e-9))
        before = np.stack([self._summed(c, weights) for c in dense]) if last else known
        u = before + np.where(good, d, np.nan)
        ab, bb, aa = (self._summed(p * inside, weights) for p in (warped * self.a, warped * warped, self.a * self.a))
        alike = np.asarray(ab / np.sqrt(np.maximum(aa * bb, 1e-30)))
        if not last:
            self.seen = warped
            return u, np.zeros_like(u), alike
        near = [
            scipy.ndimage.uniform_filter(s, RESIDUAL_LENGTH, mode="constant") * RESIDUAL_LENGTH**2 for s in (sx, sy)
        ]
        factor = 1.0 / self.window**2
        mxx, myy = (factor * self._summed(s * n, weights) for s, n in zip((sx, sy), near))
        mxy = factor * 0.5 * (self._summed(sx * near[1], weights) + self._summed(sy * near[0], weights))
        mxx, myy = (np.maximum(m, factor * self._summed(s * s, weights)) for m, s in ((mxx, sx), (myy, sy)))
        vx = (nyy**2 * mxx - 2 * nxy * nyy * mxy + nxy**2 * myy) / safe**2
        vy = (nxx**2 * myy - 2 * nxy * nxx * mxy + nxy**2 * mxx) / safe**2
        std = np.sqrt(np.maximum(np.stack([vx, vy]), 0.0))
        return u, np.where(good, std, np.inf), alike

    def sought(self, known: Floats, u: Floats, alike: Floats) -> Floats:
        """Search for windows that correlate poorly, and return ``u`` with their displacements replaced where the
        search succeeds. Each is searched for in the picture deformed by ``known``.
        """
        cv2 = opencv()
        u, half, reach = u.copy(), self.window // 2, min(FAR, self.window // 2)
        for row, column in np.argwhere(~(alike > SOUGHT * np.nanmedian(alike))):
            top, left = (int(g[i]) - half + 1 for g, i in zip(self.grid, (row, column)))
            inner = [slice(max(k, 0), k + self.window) for k in (top, left)]
            outer = [slice(max(i.start - reach, 0), i.stop + reach) for i in inner]
            block, where = self.a[tuple(inner)], np.ascontiguousarray(self.seen[tuple(outer)])
            if min(np.subtract(where.shape, block.shape)) < 0:
                continue
            found = cv2.matchTemplate(where, np.ascontiguousarray(block), cv2.TM_CCOEFF_NORMED)
            _, best, _, (x, y) = cv2.minMaxLoc(found)
            if best > PLACE:
                shift = x - (inner[1].start - outer[1].start), y - (inner[0].start - outer[0].start)
                u[:, row, column] = known[:, row, column] + shift
        return u

    def _warped(self, rows: Floats, columns: Floats, *, exact: bool) -> Floats:
        """Return the second picture deformed by the field. Without ``exact`` OpenCV does it, which rounds positions to
        1/32 pixel; that suffices for intermediate rounds.
        """
        if not exact:
            cv2 = opencv()
            return np.asarray(cv2.remap(self.b, columns, rows, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT_101))
        return np.asarray(
            scipy.ndimage.map_coordinates(self.b, [rows, columns], order=3, mode="mirror", output=np.float32)
        )


def _between(grid: Floats, count: int) -> Floats:
    """Matrix that interpolates linearly from a grid to every pixel along an axis, and repeats the end values."""
    at = np.clip(np.interp(np.arange(count), grid, np.arange(len(grid))), 0, len(grid) - 1)
    low = np.minimum(at.astype(int), len(grid) - 2)
    out = np.zeros((count, len(grid)), dtype=np.float32)
    out[np.arange(count), low] = 1.0 - (at - low)
    out[np.arange(count), low + 1] = at - low
    return out


def _slope(image: Floats, axis: int) -> Floats:
    """Return the derivative along an axis by the five-point formula."""
    return np.asarray(
        scipy.ndimage.correlate1d(image, [1 / 12, -8 / 12, 0.0, 8 / 12, -1 / 12], axis=axis, mode="nearest")
    )
