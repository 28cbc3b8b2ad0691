"""Dots followed from a reference picture: displacement of each, its standard deviation, and which are lost.

Each picture is compared with the reference, not with the one before, so that errors do not add up. Dots are found anew in it and matched
(`palpate.camera.matching`); Lucas-Kanade (OpenCV) then tells the displacement to a part of a pixel, there and back, and is refined with windows that are stretched
as the dots around say. The standard deviation is that of least squares: with the gradients g over a dot's window W and what is left r = I(x + d) - I_0(x),

    cov = (sum_W g h')^-1 (sum_{W, W, near} g r r' g') (sum_W g h')^-1

with h the gradients of the picture itself, where near pixels count as they do together, because blur, colour filters and compression make their errors alike.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate.camera.dots import Found, fault_of, find_dots, levelled
from palpate.camera.matching import Neighbours, gradients, matched, predicted
from palpate.camera.pictures import grey
from palpate.camera.view import opencv
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput

__all__ = ["Markers", "Moved"]

#: Half the window over the radius of a dot, and pixels around it.
WINDOW, AROUND = 1.5, 2.0
#: There and back must end this near [pixels]; the window must look alike (correlation).
BACK, ALIKE = 0.3, 0.6
#: Part of a window that may become white, where it was not at rest: beyond, glare lies on the dot.
GLARED = 0.01
#: Least squares on the few pixels of a dot's rim leave less than there is: by 1 - 1.4 pixels over the radius. From dots at rest of 3.3 and 6.7 pixels with noise,
#: compression and blur, other prints than those of `benchmarks/camera.py`.
FEW = 1.4
#: Pixels: no displacement is known better, whatever its window says (Lucas-Kanade interpolates with 1/32 of a pixel in view, and pictures have eight bits).
LEAST = 1e-3
#: Gauss-Newton steps with windows that are stretched as the print is.
STEPS = 2
#: How well the neighbours tell the motion of a dot's rim against that of its middle, as a part of it.
RIM = 0.75
#: Grey level of the ground in the levelled pictures that are compared.
LEVEL = 150.0


@dataclass(frozen=True, eq=False)
class Moved:
    """What became of the dots in one picture.

    Attributes
    ----------
    displacement, std : array (n, 2)
        Along columns and rows [pixels], with standard deviations; NaN where a dot is lost.
    alike : array (n,)
        Correlation of each dot's window with that of the reference.
    fault : str
        Why the whole picture tells nothing; "" where it does.
    """

    displacement: Floats
    std: Floats
    alike: Floats
    fault: str = ""

    @property
    def lost(self) -> npt.NDArray[np.bool_]:
        """True (n,) for dots that are hidden, left the picture or cannot be told from others."""
        return np.asarray(np.isnan(self.displacement[:, 0]))


class Markers:
    """Dots of a print, followed from picture to picture.

    Parameters
    ----------
    reference : array (row, column) or (row, column, 3), or sequence of these
        The gel at rest: one picture, or several, whose mean has less noise.
    positions : array (n, 2), optional
        Where the dots are in it [pixels]; by default they are found.

    Raises
    ------
    InvalidInput
        No dots, or a picture that shows nothing.

    Examples
    --------
    >>> import numpy as np
    >>> import palpate as pp
    >>> from palpate.camera import Dots, Markers, Scene, dot_grid
    >>> gel = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=3e5, poissons_ratio=0.48)])
    >>> scene = Scene(pad=gel, depth=0.5e-3, print=Dots(dot_grid((5, 7), 2e-3), 0.8e-3), size=(160, 120), scale=0.1e-3)
    >>> rng = np.random.default_rng(0)
    >>> markers = Markers(scene.picture(rng=rng))
    >>> moved = markers.follow(scene.picture(pp.solutions.hertz_point(radius=2.5e-3, force=2.0), rng=rng))
    >>> len(markers.positions), int(moved.lost.sum()), bool(np.abs(moved.displacement).max() > 1.0)
    (35, 0, True)
    """

    def __init__(self, reference: Any, *, positions: npt.ArrayLike | None = None) -> None:
        plain = _mean_picture(reference)
        found = find_dots(plain)
        self.print = found.print
        self.size = (int(plain.shape[1]), int(plain.shape[0]))
        if positions is None:
            self.positions: Floats = found.positions[found.whole]
        else:
            self.positions = np.asarray(positions, dtype=np.float64).reshape(-1, 2)
        if len(self.positions) < 3:
            raise InvalidInput(
                f"{len(self.positions)} whole dots found; at least three are needed. Show more of the print, or focus."
            )
        self.positions.setflags(write=False)
        self._near = Neighbours(self.positions)
        radius = self.print.radius
        half = min(WINDOW * radius + AROUND, max(0.5 * self._near.pitch, radius + 1.0))
        self._half = max(3, round(half))
        self._around = self._near.around()
        self._level = _bytes(levelled(plain, 4.0 * self.print.blur))
        self._sharp = self._sharpness(self._level, self.positions)
        self._windows = _windows(self._level, self.positions, self._half + 1)
        self._gradients = _gradients(self._windows)
        normal = np.einsum("niyx,njyx->nij", self._gradients, self._gradients)
        self._inverse = np.linalg.inv(
            normal + (1e-3 * np.trace(normal, axis1=1, axis2=2) + 1e-9)[:, None, None] * np.eye(2)
        )
        self._white = _windows(_white(plain), self.positions, self._half).mean(axis=(1, 2))
        self.reset()

    def reset(self) -> None:
        """Forget where the dots were in the last picture."""
        self._last = np.zeros_like(self.positions)

    def follow(self, image: npt.ArrayLike | None) -> Moved:
        """Displacement of every dot in a picture.

        A picture that tells nothing (None, black, saturated, blurred, of another size) gives no displacement, and says why; the next one goes on.

        Parameters
        ----------
        image : array (row, column) or (row, column, 3), or None

        Returns
        -------
        Moved
        """
        if image is None:
            return self._nothing("there is no picture")
        plain = grey(image)
        if plain.shape[::-1] != self.size:
            return self._nothing(
                f"the picture is {plain.shape[1]} x {plain.shape[0]}, the reference {self.size[0]} x {self.size[1]}"
            )
        fault = fault_of(plain)
        if fault:
            return self._nothing(fault)
        flat = levelled(plain, 4.0 * self.print.blur)
        found = find_dots(plain, self.print, level=flat)
        level = _bytes(flat)
        start = self._started(level, found)
        known = np.isfinite(start).all(axis=1)
        if known.sum() < 3:
            return self._nothing(
                f"of {len(self.positions)} dots {len(found.positions)} are to be seen, and none can be told from others"
            )
        if len(found.positions) and self._sharpness(level, found.positions) < 0.4 * self._sharp:
            return self._nothing("the picture is blurred: it is out of focus, or the gel moved during the exposure")
        moved = self._refined(level, start, _white(plain))
        self._last = np.where(np.isfinite(moved.displacement), moved.displacement, start)
        return moved

    def _nothing(self, fault: str) -> Moved:
        none = np.full_like(self.positions, np.nan)
        return Moved(none, none, none[:, 0], fault)

    def _sharpness(self, level: npt.NDArray[np.uint8], positions: Floats) -> float:
        """Steepest gradient over a dot, typical of all."""
        return float(
            np.median(
                np.abs(np.diff(_windows(level, positions, self._half).astype(np.float64), axis=2)).max(axis=(1, 2))
            )
        )

    def _started(self, level: npt.NDArray[np.uint8], found: Found) -> Floats:
        """Displacement of each dot to within a pixel, from dots found and matched; of others, as their neighbours move."""
        best = self._matched(found, np.where(np.isfinite(self._last), self._last, 0.0))
        if np.isnan(best[:, 0]).mean() > 0.5:
            # the stage jumped: by how much, the whole picture says
            cv2 = opencv()
            (column, row), _ = cv2.phaseCorrelate(self._level.astype(np.float32), level.astype(np.float32))
            other = self._matched(found, np.zeros_like(best) + np.array([column, row]))
            if np.isnan(other[:, 0]).sum() < np.isnan(best[:, 0]).sum():
                best = other
        gaps = np.isnan(best[:, 0])
        if gaps.any() and not gaps.all():
            best[gaps] = predicted(self._near, best, np.flatnonzero(gaps))
        return best

    def _matched(self, found: Found, expected: Floats) -> Floats:
        index = matched(self._near, expected, found.positions)
        out = np.full_like(self.positions, np.nan)
        out[index >= 0] = found.positions[index[index >= 0]] - self.positions[index >= 0]
        return out

    def _stretched(self, level: npt.NDArray[np.uint8], displacement: Floats) -> tuple[Floats, npt.NDArray[np.float32]]:
        """Displacement against windows that are stretched and turned as the print is there, and these windows.

        Beside a contact a window does not only move. How its surroundings are stretched, the neighbours say; what is left over is then noise and not the
        stretch, and Gauss-Newton steps of the displacement alone (Baker and Matthews 2004) take what the plain window made of it.
        """
        known: npt.NDArray[np.bool_] = np.asarray(np.isfinite(displacement).all(axis=1))
        slopes = np.where(known[:, None, None], gradients(self._near, displacement), 0.0)
        found = displacement.copy()

        def there() -> npt.NDArray[np.float32]:
            return _windows(level, np.where(known[:, None], self.positions + found, 0.0), self._half + 1, slopes)

        for _ in range(STEPS):
            left = (self._windows - there())[:, 1:-1, 1:-1]
            step = np.einsum("nij,nj->ni", self._inverse, np.einsum("niyx,nyx->ni", self._gradients, left))
            found += np.where(np.hypot(*step.T) < 1.0, step.T, 0.0).T
        return found, there()

    def _refined(self, level: npt.NDArray[np.uint8], start: Floats, white: npt.NDArray[np.uint8]) -> Moved:
        cv2 = opencv()
        n = len(self.positions)
        known = np.isfinite(start).all(axis=1)
        rest = self.positions[known].astype(np.float32)[:, None, :]
        guess = (self.positions[known] + start[known]).astype(np.float32)[:, None, :]
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
        displacement[known] = place - self.positions[known].astype(np.float32)
        displacement, windows = self._stretched(level, displacement)
        centres = np.where(np.isfinite(displacement), self.positions + displacement, 0.0)
        std, alike = _errors(self._windows, windows, self._gradients)
        std = std / np.sqrt(max(1.0 - FEW / self.print.radius, 0.3))
        keep = np.zeros(n, dtype=bool)
        keep[known] = good
        keep &= alike > ALIKE
        keep &= _windows(white, centres, self._half).mean(axis=(1, 2)) < self._white + GLARED
        reach = self.print.radius
        now = self.positions + displacement
        with np.errstate(invalid="ignore"):
            keep &= (now >= reach).all(axis=1) & (now <= np.array(self.size) - 1 - reach).all(axis=1)
        # out of step with all around it: another dot, or glare
        trial = np.where(keep[:, None], displacement, np.nan)
        off = trial - predicted(self._near, trial, np.arange(n))
        keep &= ~(np.hypot(off[:, 0], off[:, 1]) > 0.35 * self._near.pitch)
        # a dot moves as its rim does on average: beside a contact not as its middle, by its size over the distance to its neighbours, squared
        rim = np.where(np.isfinite(off), -off, 0.0) * (self.print.radius / self._near.pitch) ** 2
        displacement = displacement - np.where(self._around[:, None], rim, 0.0)
        return Moved(
            np.where(keep[:, None], displacement, np.nan),
            np.where(keep[:, None], np.hypot(std, RIM * np.hypot(rim[:, :1], rim[:, 1:])), np.nan),
            np.where(known, alike, np.nan),
        )


def _mean_picture(reference: Any) -> npt.NDArray[Any]:
    """One grey picture from one or several."""
    several = isinstance(reference, list | tuple) or (isinstance(reference, np.ndarray) and reference.ndim == 4)
    if not several:
        return grey(reference)
    if not len(reference):
        raise InvalidInput("the reference holds no picture.")
    plain = [grey(image) for image in reference]
    if len({p.shape for p in plain}) != 1:
        raise InvalidInput("the reference pictures differ in size.")
    return np.asarray(np.mean(plain, axis=0, dtype=np.float32))


def _bytes(flat: npt.NDArray[np.float32]) -> npt.NDArray[np.uint8]:
    """What Lucas-Kanade takes: eight bits."""
    return np.clip(np.round(flat * LEVEL), 0, 255).astype(np.uint8)


def _white(plain: npt.NDArray[Any]) -> npt.NDArray[np.uint8]:
    """1 where the sensor is at its end."""
    end = {"uint8": 253.0, "uint16": 65000.0}.get(plain.dtype.name)
    return (plain >= end).astype(np.uint8) if end is not None else np.zeros(plain.shape, np.uint8)


def _windows(
    level: npt.NDArray[np.uint8], centres: Floats, half: int, slopes: Floats | None = None
) -> npt.NDArray[np.float32]:
    """Windows (n, row, column) around centres, between pixels where these are; stretched by 1 + ``slopes`` (n, 2, 2)."""
    cv2 = opencv()
    side = 2 * half + 1
    arms = np.stack(np.meshgrid(np.arange(-half, half + 1.0), np.arange(-half, half + 1.0)))  # column, row
    at = centres[:, :, None, None] + arms
    if slopes is not None:
        at = at + np.einsum("nij,jyx->niyx", slopes, arms)
    columns, rows = at[:, 0].astype(np.float32), at[:, 1].astype(np.float32)
    flat = cv2.remap(
        level, columns.reshape(-1, side), rows.reshape(-1, side), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return np.asarray(flat, dtype=np.float32).reshape(-1, side, side)


def _errors(rest: npt.NDArray[np.float32], now: npt.NDArray[np.float32], gradient: Floats) -> tuple[Floats, Floats]:
    """Standard deviation (n, 2) of each displacement, and correlation (n,) of the windows, which are a pixel wider to each side than what is compared.

    ``gradient``: those of the windows at rest.
    """
    other = _gradients(now)
    a, b = rest[:, 1:-1, 1:-1].astype(np.float64), now[:, 1:-1, 1:-1].astype(np.float64)
    mean_a, mean_b = a.mean(axis=(1, 2), keepdims=True), b.mean(axis=(1, 2), keepdims=True)
    da, db = a - mean_a, b - mean_b
    power_a, power_b = (da**2).sum(axis=(1, 2)), (db**2).sum(axis=(1, 2))
    alike = (da * db).sum(axis=(1, 2)) / np.sqrt(np.maximum(power_a * power_b, 1e-12))
    left = b - a
    # one picture's gradients with the other's: noise, which both have of their own, does not add to what they tell
    normal = np.einsum("niyx,njyx->nij", gradient, other)
    normal = 0.5 * (normal + normal.transpose(0, 2, 1))
    score = gradient * left[:, None]
    # pixels up to two apart: in full, because interpolation alone makes neighbours alike (a flat top: Politis and Romano 1995), and no less than with
    # weights that fall linearly, which never give less than nothing (Newey and West 1987)
    middle = np.einsum("niyx,njyx->nij", score, score)
    falling = middle.copy()
    size = a.shape[1]
    for dy in range(-2, 3):
        for dx in range(-2, 3):
            if (dy, dx) <= (0, 0):
                continue
            weight = (1.0 - abs(dy) / 3.0) * (1.0 - abs(dx) / 3.0)
            one = score[:, :, max(dy, 0) :, max(dx, 0) : size + min(dx, 0)]
            two = score[:, :, : size - max(dy, 0), max(-dx, 0) : size - max(dx, 0)]
            cross = np.einsum("niyx,njyx->nij", one, two)
            both = cross + cross.transpose(0, 2, 1)
            middle += both
            falling += weight * both
    # where they share nothing, nothing is known
    power = np.einsum("niyx,niyx->n", gradient, gradient)
    ridge = (1e-3 * power + 1e-12)[:, None, None] * np.eye(2)
    inverse = np.linalg.inv(normal + ridge)
    variance = np.maximum(*(np.diagonal(inverse @ part @ inverse, axis1=1, axis2=2) for part in (middle, falling)))
    return np.sqrt(np.maximum(variance, LEAST**2)), alike


def _gradients(windows: npt.NDArray[np.float32]) -> Floats:
    """Scharr's gradients (n, column and row, y, x), as Lucas-Kanade takes them, a pixel less to each side."""
    w = windows.astype(np.float64)
    down = (3.0 * w[:, :-2] + 10.0 * w[:, 1:-1] + 3.0 * w[:, 2:]) / 16.0
    across = (3.0 * w[:, :, :-2] + 10.0 * w[:, :, 1:-1] + 3.0 * w[:, :, 2:]) / 16.0
    return np.stack([0.5 * (down[:, :, 2:] - down[:, :, :-2]), 0.5 * (across[:, 2:] - across[:, :-2])], axis=1)
