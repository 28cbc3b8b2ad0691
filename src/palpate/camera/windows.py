"""Follow windows of a picture from the reference: the displacement of each, and its standard deviation.

Lucas-Kanade (OpenCV) gives the displacement to a fraction of a pixel, forward and backward, and windows stretched like
their neighbours refine it. The standard deviation is that of least squares: with the gradients g over a window W and
the residual r = I(x + d) - I_0(x),

    cov = (sum_W g h')^-1 (sum_{W, W, near} g r r' g') (sum_W g h')^-1

with h the gradients of the picture itself. Near pixels are summed jointly, because blur, colour filters and
compression correlate their errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate.camera.dots import fault_of
from palpate.camera.matching import Neighbours, gradients, predicted
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.sensing.view import grey, opencv

__all__ = [
    "BLURRED",
    "Followed",
    "Moved",
    "as_bytes",
    "gradients_of",
    "mean_picture",
    "pictures_of",
    "white_of",
    "windows_of",
]

#: Largest difference between forward and backward displacement [pixels]; smallest correlation of the windows.
BACK, ALIKE = 0.3, 0.6
#: A picture with less than this fraction of the reference's sharpness is blurred.
BLUR = 0.4
BLURRED = "the picture is blurred: it is out of focus, or the gel moved during the exposure"
#: Largest fraction of a window that may be saturated; more is glare.
GLARED = 0.01
#: Smallest standard deviation of a displacement [pixels]: Lucas-Kanade interpolates to 1/32 of a pixel, and pictures
#: have eight bits.
MIN_STD = 1e-3
#: Gauss-Newton steps with windows stretched like the print.
STEPS = 2
#: Relative error of the difference between the motion of a whole window and that of its middle, as estimated from the
#: neighbours.
SPREAD = 0.75
#: Largest number of rows of a picture in one call of OpenCV.
ROWS = 32000
#: Grey level of the background in the levelled pictures that are compared.
LEVEL = 150.0


@dataclass(frozen=True, eq=False)
class Moved:
    """Displacements of the dots in one picture.

    Attributes
    ----------
    displacement, std : array (n, 2)
        Along columns and rows [pixels], with standard deviations; NaN where a dot is lost.
    alike : array (n,)
        Correlation of each dot's window with that of the reference.
    fault : str
        Why the whole picture is unusable, else "".
    """

    displacement: Floats
    std: Floats
    alike: Floats
    fault: str = ""

    @property
    def lost(self) -> npt.NDArray[np.bool_]:
        """Mask (n,) of dots that are hidden, outside the picture or ambiguous."""
        return np.asarray(np.isnan(self.displacement[:, 0]))


class Followed:
    """Windows around places of the reference.

    Parameters
    ----------
    plain : array (row, column)
        The reference, grey.
    level : array (row, column)
        The same, levelled (`as_bytes`).
    positions : array (n, 2)
        Positions of the windows in the reference picture [pixels].
    half : int
        Half their side.
    reach : float
        Smallest distance [pixels] of a place from the picture's edge.
    spread : float
        A window moves by its mean, which beside a contact differs from its middle by this part of the difference between a place and its neighbours'
        plane.
    rest : sequence of array (row, column)
        The pictures averaged in the reference: white pixels of one of them are no new glare.
    known : float
        Part of the residual that remains after least squares on few pixels.
    """

    def __init__(
        self,
        plain: npt.NDArray[Any],
        level: npt.NDArray[np.uint8],
        positions: Floats,
        *,
        half: int,
        near: Neighbours,
        reach: float,
        spread: float,
        rest: Sequence[npt.NDArray[Any]],
        known: float = 1.0,
    ) -> None:
        self.size = (int(plain.shape[1]), int(plain.shape[0]))
        self.positions: Floats = positions
        self.positions.setflags(write=False)
        self._places = positions
        self._near, self._half, self._level = near, half, level
        self._reach, self._spread, self._known = reach, spread, known
        self._around = near.around()
        self._sharp = self._sharpness(level, positions)
        self._windows = windows_of(level, positions, half + 1)
        self._gradients = gradients_of(self._windows)
        normal = np.einsum("niyx,njyx->nij", self._gradients, self._gradients).astype(np.float64)
        self._inverse = np.linalg.inv(
            normal + (1e-3 * np.trace(normal, axis1=1, axis2=2) + 1e-9)[:, None, None] * np.eye(2)
        )
        self._white: Floats = np.max([self._glare(white_of(image), positions) for image in rest], axis=0)

    def _seen(self, image: npt.ArrayLike | None) -> tuple[npt.NDArray[Any] | None, str]:
        """The picture in grey, or None and the reason why it is unusable."""
        if image is None:
            return None, "there is no picture"
        plain = grey(image)
        if plain.shape[::-1] != self.size:
            return (
                None,
                f"the picture is {plain.shape[1]} x {plain.shape[0]}, the reference {self.size[0]} x {self.size[1]}",
            )
        fault = fault_of(plain)
        return (None, fault) if fault else (plain, "")

    def _blurred(self, level: npt.NDArray[np.uint8], positions: Floats) -> bool:
        """Whether the picture at these places is far less sharp than the reference."""
        return self._sharpness(level, positions) < BLUR * self._sharp

    def _nothing(self, fault: str) -> Moved:
        none = np.full_like(self._places, np.nan)
        return Moved(none, none, none[:, 0], fault)

    def _sharpness(self, level: npt.NDArray[np.uint8], positions: Floats) -> float:
        """Typical steepest gradient over a dot, from whole pixels, which interpolation does not smooth."""
        half, size = self._half, np.array(level.shape[::-1])
        column, row = np.clip(np.rint(positions), 0, size - 1).astype(np.intp).T
        views = np.lib.stride_tricks.sliding_window_view(np.pad(level, half, mode="edge"), (2 * half + 1, 2 * half + 1))
        return float(np.median(np.abs(np.diff(views[row, column].astype(np.int16), axis=2)).max(axis=(1, 2))))

    def _glare(self, white: npt.NDArray[np.uint8], centres: Floats) -> Floats:
        """Part (n,) of each window that is white."""
        if not white.any():
            return np.zeros(len(centres))
        return np.asarray(windows_of(white, centres, self._half).mean(axis=(1, 2), dtype=np.float64))

    def _stretched(self, level: npt.NDArray[np.uint8], displacement: Floats) -> tuple[Floats, npt.NDArray[np.float32]]:
        """Displacement relative to windows stretched and rotated like the print there, and these windows.

        Beside a contact a window also stretches. The neighbours give the stretch, so that the residual is only noise;
        Gauss-Newton steps of the displacement (Baker and Matthews 2004) correct the result of the plain window.
        """
        n = len(displacement)
        known: npt.NDArray[np.bool_] = np.asarray(np.isfinite(displacement).all(axis=1))
        slopes = np.where(known[:, None, None], gradients(self._near, displacement), 0.0)
        found = displacement.copy()
        arms = _arms(self._half + 1, slopes)

        def there() -> npt.NDArray[np.float32]:
            return _sampled(level, np.where(known[:, None], self._places + found, 0.0), arms)

        for _ in range(STEPS):
            left = (self._windows - there())[:, 1:-1, 1:-1]
            score = self._gradients.reshape(n, 2, -1) @ left.reshape(n, -1, 1)
            step = (self._inverse @ score)[..., 0]
            found += np.where(np.hypot(*step.T) < 1.0, step.T, 0.0).T
        return found, there()

    def _refined(self, level: npt.NDArray[np.uint8], start: Floats, white: npt.NDArray[np.uint8]) -> Moved:
        cv2 = opencv()
        n = len(self._places)
        known = np.isfinite(start).all(axis=1)
        rest = self._places[known].astype(np.float32)[:, None, :]
        guess = (self._places[known] + start[known]).astype(np.float32)[:, None, :]
        side = 2 * self._half + 1
        settings = {
            "winSize": (side, side),
            "maxLevel": 0,
            "criteria": (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-3),
            "flags": cv2.OPTFLOW_USE_INITIAL_FLOW,
        }
        there, ok, _ = cv2.calcOpticalFlowPyrLK(self._level, level, rest, guess.copy(), **settings)
        back, again, _ = cv2.calcOpticalFlowPyrLK(level, self._level, there, (rest + there - guess).copy(), **settings)
        good = (ok.ravel() > 0) & (again.ravel() > 0)
        good &= np.hypot(*(back - rest)[:, 0].T) < BACK
        good &= np.hypot(*(there - guess)[:, 0].T) < 0.3 * self._near.pitch
        place = there[:, 0].astype(np.float64)
        displacement = np.full((n, 2), np.nan)
        displacement[known] = place - self._places[known].astype(np.float32)
        displacement, windows = self._stretched(level, displacement)
        centres = np.where(np.isfinite(displacement), self._places + displacement, 0.0)
        std, alike = _errors(self._windows, windows, self._gradients)
        std = std / np.sqrt(self._known)
        keep = np.zeros(n, dtype=bool)
        keep[known] = good
        keep &= alike > ALIKE
        keep &= self._glare(white, centres) < self._white + GLARED
        reach = self._reach
        now = self._places + displacement
        with np.errstate(invalid="ignore"):
            keep &= (now >= reach).all(axis=1) & (now <= np.array(level.shape[::-1]) - 1 - reach).all(axis=1)
        # It disagrees with all its neighbours: another dot, or glare.
        trial = np.where(keep[:, None], displacement, np.nan)
        off = trial - predicted(self._near, trial, np.arange(n))
        keep &= ~(np.hypot(off[:, 0], off[:, 1]) > 0.35 * self._near.pitch)
        # A window moves by the average of its parts, which beside a contact differs from its middle.
        rim = np.where(np.isfinite(off), -off, 0.0) * self._spread
        displacement = displacement - np.where(self._around[:, None], rim, 0.0)
        return Moved(
            np.where(keep[:, None], displacement, np.nan),
            np.where(keep[:, None], np.hypot(std, SPREAD * np.hypot(rim[:, :1], rim[:, 1:])), np.nan),
            np.where(known, alike, np.nan),
        )


def pictures_of(reference: Any) -> list[Any]:
    """One picture or several, as a list."""
    several = isinstance(reference, list | tuple) or (isinstance(reference, np.ndarray) and reference.ndim == 4)
    return list(reference) if several else [reference]


def mean_picture(reference: Any) -> npt.NDArray[Any]:
    """One grey picture from one or several."""
    several = pictures_of(reference)
    if not several:
        raise InvalidInput("the reference holds no picture.")
    plain = [grey(image) for image in several]
    if len(plain) == 1:
        return plain[0]
    if len({p.shape for p in plain}) != 1:
        raise InvalidInput("the reference pictures differ in size.")
    return np.asarray(np.mean(plain, axis=0, dtype=np.float32))


def as_bytes(flat: npt.NDArray[np.float32]) -> npt.NDArray[np.uint8]:
    """Pictures in eight bits, as Lucas-Kanade needs them."""
    scaled = np.rint(flat * np.float32(LEVEL))
    return np.clip(scaled, 0, 255, out=scaled).astype(np.uint8)


def white_of(plain: npt.NDArray[Any]) -> npt.NDArray[np.uint8]:
    """Mask of saturated pixels (1)."""
    end = {"uint8": 253.0, "uint16": 65000.0}.get(plain.dtype.name)
    return (plain >= end).astype(np.uint8) if end is not None else np.zeros(plain.shape, np.uint8)


def windows_of(
    level: npt.NDArray[np.uint8], centres: Floats, half: int, slopes: Floats | None = None
) -> npt.NDArray[np.float32]:
    """Windows (n, row, column) around centres, interpolated between pixels; stretched by 1 + ``slopes`` (n, 2, 2)."""
    return _sampled(level, centres, _arms(half, slopes))


def _arms(half: int, slopes: Floats | None = None) -> npt.NDArray[np.float32]:
    """Column and row (2, row, column) of each pixel of a window relative to its middle; (n, 2, row, column) for
    windows stretched by 1 + ``slopes``.
    """
    reach = np.arange(-half, half + 1, dtype=np.float32)
    arms = np.stack(np.meshgrid(reach, reach))
    if slopes is None:
        return arms
    stretched = (np.eye(2) + slopes).astype(np.float32) @ arms.reshape(2, -1)
    return stretched.reshape(-1, *arms.shape)


def _sampled(level: npt.NDArray[np.uint8], centres: Floats, arms: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Windows (n, row, column) with these ``arms`` around centres."""
    cv2 = opencv()
    middle, side = centres.astype(np.float32)[:, :, None, None], arms.shape[-1]
    columns, rows = middle[:, 0] + arms[..., 0, :, :], middle[:, 1] + arms[..., 1, :, :]
    if int(cv2.__version__.partition(".")[0]) < 5:
        return _between(level, columns, rows)
    out = np.empty(columns.shape, dtype=np.float32)
    most = max(1, ROWS // side)  # of windows at a time
    for first in range(0, len(out), most):
        part = slice(first, first + most)
        maps = (axis[part].reshape(-1, side) for axis in (columns, rows))
        found = cv2.remap(level, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        out[part] = found.reshape(-1, side, side)
    return out


def _between(
    level: npt.NDArray[np.uint8], columns: npt.NDArray[np.float32], rows: npt.NDArray[np.float32]
) -> npt.NDArray[np.float32]:
    """Interpolate in NumPy between pixels, because OpenCV 4's remap rounds places to 1/32 of a pixel, which is coarser
    than the accuracy of dots.
    """
    height, width = level.shape
    columns, rows = np.clip(columns, 0.0, width - 1.0), np.clip(rows, 0.0, height - 1.0)
    left, top = (np.minimum(axis.astype(np.intp), size - 2) for axis, size in ((columns, width), (rows, height)))
    across, down = columns - left.astype(np.float32), rows - top.astype(np.float32)
    flat, at = level.astype(np.float32).ravel(), top * width + left
    upper = flat[at] + across * (flat[at + 1] - flat[at])
    lower = flat[at + width] + across * (flat[at + width + 1] - flat[at + width])
    return np.asarray(upper + down * (lower - upper), dtype=np.float32)


def _errors(
    rest: npt.NDArray[np.float32], now: npt.NDArray[np.float32], gradient: npt.NDArray[np.float32]
) -> tuple[Floats, Floats]:
    """Standard deviation (n, 2) of each displacement, and correlation (n,) of the windows, which are a pixel wider on
    each side than the compared part.

    ``gradient``: the gradients of the windows at rest.
    """
    other = gradients_of(now)
    a, b = rest[:, 1:-1, 1:-1], now[:, 1:-1, 1:-1]
    mean_a, mean_b = a.mean(axis=(1, 2), keepdims=True), b.mean(axis=(1, 2), keepdims=True)
    da, db = a - mean_a, b - mean_b
    power_a, power_b = (da**2).sum(axis=(1, 2)), (db**2).sum(axis=(1, 2))
    alike = (da * db).sum(axis=(1, 2)) / np.sqrt(np.maximum(power_a.astype(np.float64) * power_b, 1e-12))
    left = b - a
    # Product of the gradients of both pictures: their independent noise averages out.
    normal = np.einsum("niyx,njyx->nij", gradient, other).astype(np.float64)
    normal = 0.5 * (normal + normal.transpose(0, 2, 1))
    score = gradient * left[:, None]
    # Pixels up to two apart: with full weight, because interpolation correlates neighbours (a flat top: Politis and
    # Romano 1995), and at least the result with linearly decreasing weights, which is never negative (Newey and West
    # 1987).
    apart = np.abs(np.subtract.outer(np.arange(a.shape[1]), np.arange(a.shape[1])))
    flat, sloped = (apart <= 2).astype(np.float32), np.maximum(1.0 - apart / 3.0, 0.0).astype(np.float32)
    middle, falling = (
        np.einsum("niyx,njyx->nij", score, near @ score @ near).astype(np.float64) for near in (flat, sloped)
    )
    # Without common gradients there is no information.
    power = np.einsum("niyx,niyx->n", gradient, gradient)
    ridge = (1e-3 * power + 1e-12)[:, None, None] * np.eye(2)
    inverse = np.linalg.inv(normal + ridge)
    variance = np.maximum(*(np.diagonal(inverse @ part @ inverse, axis1=1, axis2=2) for part in (middle, falling)))
    return np.sqrt(np.maximum(variance, MIN_STD**2)), alike


def gradients_of(windows: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Scharr's gradients (n, column and row, y, x), as used by Lucas-Kanade, one pixel smaller on each side."""
    outer, inner = np.float32(3.0 / 32.0), np.float32(10.0 / 32.0)
    w = windows
    across, down = w[:, :, 2:] - w[:, :, :-2], w[:, 2:] - w[:, :-2]
    return np.stack(
        [
            outer * (across[:, :-2] + across[:, 2:]) + inner * across[:, 1:-1],
            outer * (down[:, :, :-2] + down[:, :, 2:]) + inner * down[:, :, 1:-1],
        ],
        axis=1,
    )
